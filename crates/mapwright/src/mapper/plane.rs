//! What a mapper of the plane has beside.

use super::Mapper;
use crate::front::PlaneFrontEnd;
use crate::front_end::{FrontEnd, Maps};
use crate::locate::{Location, Locator, Withdrawal};
use crate::render::GlobalMap;
use mapwright_geom::{Cov3, Pose2, TangentMatrix};
use mapwright_grid::{CountGrid, LocalMap};
use mapwright_loops::KnownPlace;
use mapwright_record::KeyframeId;
use mapwright_sensor::{LaserScan, Odometry, Sweep, TurnRate};

impl Maps for Sweep {
    type Scan = LaserScan;
    type FrontEnd = PlaneFrontEnd;
    type Locator = Locator;
}

impl Mapper {
    /// Remembers a reading of the wheels: for scans up to 2 s later that carry none of their own, and for the robot's motion
    /// during a sweep.
    ///
    /// Hand in what was read during a sweep before its scan, as it arrives from a robot.
    pub fn add_odometry(&mut self, odometry: &Odometry) {
        self.front.add_odometry(odometry);
    }

    /// Remembers a reading of a gyroscope, for the robot's motion during a sweep: hand in what was read during it before its
    /// scan. False where it is no rate that a robot can have; it is left out then.
    pub fn add_turn_rate(&mut self, rate: &TurnRate) -> bool {
        self.front.add_turn_rate(rate)
    }

    /// Where the robot is likeliest to be in the finished map, and the evidence; none where nothing is known, and of a mapper that is not
    /// [localising](Mapper::localising).
    #[must_use]
    pub fn location(&self) -> Option<Location> {
        self.locator.as_ref()?.location()
    }

    /// Why the newest scan has withdrawn what was said of where the robot is in the finished map, if it has.
    #[must_use]
    pub fn withdrawal(&self) -> Option<Withdrawal> {
        self.locator.as_ref()?.withdrawal()
    }

    /// The map that scans are matched against.
    #[must_use]
    pub fn local_map(&self) -> &LocalMap {
        self.front.local_map()
    }

    /// Somebody says where the robot is in the finished map now, with the covariance of a right perturbation (m^2, m rad, rad^2): that place is
    /// believed from the next scan on that agrees, and as long as what is seen does not speak against it. Nothing where there is no finished
    /// map ([`Mapper::localising`](crate::MapperOf::localising)), or the numbers are no pose and no covariance.
    pub fn place(&mut self, map_from_robot: Pose2, covariance: Cov3) -> bool {
        let is_sound = map_from_robot.is_finite() && covariance.cholesky().is_some();
        match self.locator.as_mut().filter(|_| is_sound) {
            Some(locator) => {
                locator.place(map_from_robot, covariance);
                true
            }
            None => false,
        }
    }

    /// The robot may have been carried anywhere in the finished map: it is looked for anew. Whether there is one.
    pub fn find_anew(&mut self) -> bool {
        self.locator.as_mut().map(|locator| locator.find_anew()).is_some()
    }

    /// How certain the first keyframe of each patch of the map is relative to the newest one: larger standard deviation
    /// of the position, metres, and that of the heading, radians.
    pub fn certainty(&mut self) -> Vec<(KeyframeId, f64, f64)> {
        let sigmas = |known: KnownPlace| {
            let (m2, rad2) = (known.covariance.position_variance_m2(), known.covariance.rotation_variance_rad2());
            (self.store.id(known.first), m2.sqrt(), rad2.sqrt())
        };
        self.front.survey(self.store.past()).into_iter().map(sigmas).collect()
    }

    /// Counts of every keyframe of the first map ([`maps`](mapwright_record::Session::maps)) at its present pose, drawn from scratch on two threads, without those
    /// that hardly fitted and contradict the others: the map to export. Others are drawn by [`GlobalMap::export_believed_of`].
    #[must_use]
    pub fn render(&self) -> CountGrid {
        self.render_with(2)
    }

    /// As [`Mapper::render`], on so many threads; the map is the same.
    #[must_use]
    pub fn render_with(&self, threads: usize) -> CountGrid {
        let mut map = GlobalMap::new(self.settings());
        let maps = self.session().maps();
        map.export_believed_of(self.session(), &maps.into_iter().next().unwrap_or_default(), threads);
        map.into_counts()
    }
}
