//! A run in space that stops, and one that goes on.

use super::SpaceMapper;
use crate::back::BackEnd;
use crate::settings::{Settings, SettingsError};
use crate::space::front::{FrontEnd, LevelWatch};
use crate::store::Store;
use crate::told::{Newest, Told};
use mapwright_geom::{Stamp, Stored, is_in_place};
use mapwright_record::{RunId, Session, Status, Update};
use mapwright_sensor::SpaceSweep;

/// Of the bytes; another one's are not read.
const VERSION: u8 = 5;

impl SpaceMapper {
    /// Takes down what keyframes and edges do not say, where a run stops: [`SpaceMapper::resume`] goes on with it to the same poses, bit
    /// by bit, as this mapper would. Jobs that wait are done before. The entry is the update's; this mapper
    /// may go on as well. There is none while a job is out.
    pub fn checkpoint(&mut self) -> Update<SpaceSweep> {
        while let Some(job) = self.back.hand_out() {
            let result = job.run();
            self.back.came_back();
            self.take_in(result);
        }
        if !self.back.is_busy() {
            let mut state = vec![VERSION];
            self.store.put(&mut state);
            self.back.put(&mut state);
            self.front.put(&mut state);
            self.level.put(&mut state);
            self.store.add_checkpoint(state);
        }
        self.report(Told::default())
    }

    /// A mapper that goes on where a session ends, as a new run of the robot that ended it: with the next number, its clouds and
    /// keyframes after those of the session, the robot where it was.
    ///
    /// Where the session ends with a [checkpoint](SpaceMapper::checkpoint) that was made with the same settings, it goes on from that.
    /// Else, as after a run that was killed, the local map is made again from keyframes and edges, and the robot stands still. Either
    /// way stamps and odometry are taken to go on: a pause is a gap between two clouds. The first update holds the beginning of the run.
    ///
    /// # Errors
    /// A setting outside its range.
    pub fn resume(settings: Settings, session: Session<SpaceSweep>) -> Result<Self, SettingsError> {
        settings.validate()?;
        let run = session.next_run().unwrap_or(RunId::of_robot("robot"));
        let stamp = session.scans().last().map_or(Stamp(0), |scan| scan.stamp);
        let is_alike = session.runs().last().is_some_and(|run| run.settings == settings.to_text());
        let checkpoint = session.checkpoint().filter(|_| is_alike).cloned();
        let store = Store::resume(session, run, settings.to_text());
        let restored = checkpoint.and_then(|checkpoint| restore(settings, &store, &checkpoint.state));
        let (store, back, front, level) = restored.unwrap_or_else(|| made_again(settings, store));
        let newest = Newest { stamp, status: Status::Tracking };
        Ok(Self { store, front, back, level, newest })
    }
}

type Stages = (Store<SpaceSweep>, BackEnd<SpaceSweep>, FrontEnd, LevelWatch);

/// All that goes on as it was, if these are bytes of this session's end.
fn restore(settings: Settings, store: &Store<SpaceSweep>, mut state: &[u8]) -> Option<Stages> {
    let from = &mut state;
    u8::take(from).filter(|version| *version == VERSION)?;
    let store = store.restored(from)?;
    let back = BackEnd::restore(&settings, store.past(), from)?;
    let front = FrontEnd::restore(settings, store.past(), from)?;
    let level = LevelWatch::take(from).filter(|level| level.is_of(store.session()))?;
    let map_from_robot = store.map_from_local() * front.pose().local_from_robot();
    (from.is_empty() && is_in_place(map_from_robot)).then_some((store, back, front, level))
}

/// What keyframes, edges and the last clouds say.
fn made_again(settings: Settings, mut store: Store<SpaceSweep>) -> Stages {
    let back = BackEnd::made_again(&settings, &mut store);
    let front = FrontEnd::resume(settings, store.past());
    (store, back, front, LevelWatch::default())
}
