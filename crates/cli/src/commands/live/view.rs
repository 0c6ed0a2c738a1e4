//! The page in a browser that shows what is mapped.

#[cfg(feature = "view")]
mod shown {
    use crate::args::ViewArgs;
    use crate::failure::Failure;
    use mapwright::{Cloud, LaserScan, Session, Settings, Update};
    use mapwright_live::Passed;
    pub(crate) use mapwright_viewer::View as Shown;
    use mapwright_viewer::{Pen, Settings as Access, Viewer, ViewerError};
    use nalgebra::Vector3;

    /// Points of a cloud that are shown while it is the newest.
    const POINTS_SHOWN: usize = 2000;

    impl From<ViewerError> for Failure {
        fn from(error: ViewerError) -> Self {
            Self::Usage(error.to_string())
        }
    }

    /// How the map is drawn.
    pub(crate) fn pen(settings: &Settings) -> Pen {
        Pen {
            resolution_m: settings.map.resolution_m,
            free_range_m: settings.scan.free_range_m,
            passes_per_hit: settings.map.passes_per_hit,
        }
    }

    /// Who may look, and where.
    pub(crate) fn access(args: &ViewArgs, can_pause: bool) -> Access {
        let address = args.view.flatten().unwrap_or_else(|| Access::default().address);
        Access { address, token: args.view_token.clone(), can_pause, ..Access::default() }
    }

    /// A page that shows a robot that drives.
    pub(crate) struct View(Viewer);

    impl View {
        pub(crate) fn open(args: &ViewArgs, settings: &Settings) -> Result<Option<Self>, Failure> {
            if args.view.is_none() {
                return Ok(None);
            }
            Ok(Some(Self(Viewer::start(access(args, true), pen(settings))?)))
        }

        pub(crate) fn url(&self) -> String {
            self.0.url()
        }

        pub(crate) fn show<M: Shown>(&mut self, passed: Option<&Passed>, update: &Update<M>, session: &Session<M>) {
            match passed {
                Some(Passed::Scan(scan)) => self.0.scan(|| points_m(scan)),
                Some(Passed::Cloud(cloud)) => self.0.scan(|| some_points_m(cloud)),
                Some(Passed::Reading(_)) | None => {}
            }
            self.0.show(update, session);
        }

        pub(crate) fn status(&mut self, lines: &[(String, String)]) {
            self.0.status(lines);
        }

        pub(crate) fn is_paused(&self) -> bool {
            self.0.is_paused()
        }
    }

    /// Some points of a cloud, in the robot's frame, metres.
    fn some_points_m(cloud: &Cloud) -> Vec<[f32; 3]> {
        let every = cloud.points_m.len().div_ceil(POINTS_SHOWN).max(1);
        let there = cloud.points_m.iter().step_by(every).filter(|point| point.iter().all(|v| v.is_finite()));
        let in_robot = |point: &[f32; 3]| {
            let at = cloud.sensor.robot_from_sensor.transform(Vector3::from(point.map(f64::from)));
            [at.x as f32, at.y as f32, at.z as f32]
        };
        there.map(in_robot).collect()
    }

    /// Where the beams of a scan end, in the robot's frame, metres.
    fn points_m(scan: &LaserScan) -> Vec<[f32; 3]> {
        let laser = &scan.laser;
        let ends = scan.ranges_m.iter().enumerate().filter_map(|(beam, &range_m)| {
            let range_m = f64::from(range_m);
            if !(laser.range_min_m..laser.range_max_m).contains(&range_m) {
                return None;
            }
            let bearing = laser.angle_min_rad + beam as f64 * laser.angle_step_rad;
            let side = if laser.inverted { -1.0 } else { 1.0 };
            let [x, y] = laser.robot_from_laser.transform([range_m * bearing.cos(), side * range_m * bearing.sin()]);
            Some([x as f32, y as f32, 0.0])
        });
        ends.collect()
    }
}

#[cfg(not(feature = "view"))]
mod shown {
    use crate::args::ViewArgs;
    use crate::failure::Failure;
    use mapwright::{Maps, Session, Settings, Update};
    use mapwright_live::Passed;

    /// What could be shown.
    pub(crate) trait Shown: Maps {}
    impl<M: Maps> Shown for M {}

    /// There is no page in this build.
    pub(crate) enum View {}

    impl View {
        pub(crate) fn open(args: &ViewArgs, _settings: &Settings) -> Result<Option<Self>, Failure> {
            match args.view {
                None => Ok(None),
                Some(_) => Err(Failure::Usage(
                    "this mapwright was built without the view; build it with `cargo build --release --features view`, or use a package".to_owned(),
                )),
            }
        }

        pub(crate) fn url(&self) -> String {
            match *self {}
        }

        pub(crate) fn show<M: Shown>(&mut self, _passed: Option<&Passed>, _update: &Update<M>, _session: &Session<M>) {
            match *self {}
        }

        pub(crate) fn status(&mut self, _lines: &[(String, String)]) {
            match *self {}
        }

        pub(crate) fn is_paused(&self) -> bool {
            match *self {}
        }
    }
}

pub(crate) use shown::{Shown, View};
#[cfg(feature = "view")]
pub(crate) use shown::{access, pen};
