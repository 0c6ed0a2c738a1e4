//! Several runs in one map: of a robot that is switched on again, of other robots, of sessions that were mapped apart. Wherever they
//! stand, each begins a fragment, and joins hold them together ([`mapwright_loops::Closing`]).

use super::MapperOf;
use crate::breaks::anywhere;
use crate::front_end::{FrontEnd, Locates, Maps};
use crate::settings::{Correction, Settings, SettingsError};
use crate::store::{Import, Store};
use crate::told::{Newest, Told};
use mapwright_geom::{Pose, Stamp};
use mapwright_record::{NodeId, RunId, Session, Status, Update};

impl<M: Maps> MapperOf<M> {
    /// A run of this robot begins, or of another one, somewhere: nobody knows where it stands, nor where its odometry has its origin.
    /// Its first scan begins a fragment, which is [apart](mapwright_record::Localisation) until the robot comes to a place that is
    /// known and recognises it. The update holds the beginning of the run; a robot that had runs before gets the next number.
    pub fn switch_on(&mut self, robot: RunId) -> Update<M> {
        self.begin_run(robot);
        if let Some(submaps) = self.front.submaps() {
            self.back.closing.switch_on(self.store.past(), &submaps);
        }
        self.report(Told::default())
    }

    fn begin_run(&mut self, robot: RunId) {
        self.store.switch_on(robot, self.settings().to_text());
        self.front.switch_on();
    }

    /// Takes in a session that was mapped apart, of this robot or another one: its keyframes one after the other, as if they were made
    /// now, each with its edges. They are apart until one of them is recognised. An update a keyframe goes to `told`, whose error ends it.
    ///
    /// Runs keep their names, but where one of that name is here already: it gets the robot's next number. Before scans are added
    /// [`MapperOf::switch_on`] says whose they are. A session that is here already ([`Session::shares_keyframes`]) would be mapped twice.
    ///
    /// # Errors
    /// That of `told`.
    pub fn import<E>(&mut self, other: &Session<M>, mut told: impl FnMut(Update<M>) -> Result<(), E>) -> Result<(), E> {
        let Some(begin) = other.map_from_keyframe().first() else { return Ok(()) };
        let local_from_other = self.front.pose().local_from_robot() * begin.inverse();
        let first = NodeId::at(self.store.len());
        let mut import = Import::new(&self.store, other, local_from_other);
        self.front.switch_on();
        while let Some(keyframe) = import.next() {
            let Some(imported) = import.write_next(&mut self.store, &anywhere::<M::Pose>()) else { break };
            if imported.is_first || imported.is_closed {
                self.back.closing.see_pieces(self.store.past());
            }
            self.front.take_in(self.store.past(), imported.first_edge, imported.is_first);
            self.newest = Newest { stamp: keyframe.stamp, status: Status::Tracking };
            self.detect(true, Some(first));
            self.work_all();
            told(self.report(Told { keyframe: self.store.past().newest(), ..Told::default() }))?;
        }
        import.write_rest(&mut self.store);
        self.front.switch_on();
        self.store.wait_for_scans();
        told(self.report(Told::default()))
    }

    /// A mapper that finds a robot in the map of a session, where it may be anywhere, and tracks it there. What the session has mapped
    /// stays where it is. Keyframes are made as ever, to tell how the robot moves where the map is not known or has changed, so that memory
    /// grows with the way; they are a fragment of their own. The robot is [apart](mapwright_record::Localisation) until it is known where
    /// it is.
    ///
    /// In the plane the finished map alone says that ([`location`](MapperOf::location)): the robot is lost until one place leads all rivals, and again
    /// where what it sees contradicts that place ([`withdrawal`](MapperOf::withdrawal)). In space a join of what it maps with the finished map does.
    ///
    /// # Errors
    /// A setting outside its range.
    pub fn localising(settings: Settings, session: Session<M>) -> Result<Self, SettingsError> {
        let mut settings = settings;
        settings.loops.correction = Correction::Graph;
        settings.validate()?;
        let run = session.next_run().unwrap_or(RunId::of_robot("robot"));
        let mut store = Store::resume(session, run, settings.to_text());
        store.fix();
        let (store, back, front) = Self::made_again(settings, store);
        let newest = Newest { stamp: Stamp(0), status: Status::Tracking };
        let locator = M::Locator::of(&settings, store.session()).map(Box::new);
        let mut mapper = Self { store, front, back, newest, locator, ways: super::WaysSeen::default() };
        mapper.begin_run(run);
        if mapper.locator.is_none()
            && let Some(submaps) = mapper.front.submaps()
        {
            mapper.back.closing.switch_on(mapper.store.past(), &submaps);
        }
        Ok(mapper)
    }
}
