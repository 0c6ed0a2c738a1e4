//! The finished map as points and as occupancy: every keyframe's at its present pose.

use crate::render::FOLLOW_CELLS;
use mapwright_geom::Pose3;
use mapwright_record::Session;
use mapwright_sensor::SpaceSweep;
use mapwright_voxel::{Change, Occupancy, OccupancySettings, Thinner};
use std::sync::Arc;

/// Points of a map, metres, and a colour each where the sensor has any.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MapPoints {
    /// Points in the map's frame.
    pub points_m: Vec<[f32; 3]>,
    /// Red, green and blue of each; empty where there are none.
    pub colours: Vec<[u8; 3]>,
}

/// All points of a session, of those in each cube of side `size_m` their mean.
#[must_use]
pub fn points_of(session: &Session<SpaceSweep>, size_m: f64) -> MapPoints {
    let mut all = MapPoints::default();
    let is_coloured = session.drawn().iter().flatten().all(|sweep| sweep.colours.len() == sweep.points.len());
    for (sweep, pose) in session.drawn().iter().zip(session.map_from_keyframe()) {
        let Some(sweep) = sweep else { continue };
        let rotation = pose.rotation.to_rotation_matrix();
        all.points_m.extend(sweep.points_m().map(|point| {
            let at = rotation * nalgebra::Vector3::from(point.map(f64::from)) + pose.translation;
            [at.x as f32, at.y as f32, at.z as f32]
        }));
        if is_coloured {
            all.colours.extend_from_slice(&sweep.colours);
        }
    }
    let mut thinned = MapPoints::default();
    let out = (&mut thinned.points_m, &mut thinned.colours);
    Thinner::default().thin_coloured((&all.points_m, &all.colours), size_m.max(1e-3), out);
    thinned
}

/// What a session's keyframes hit and looked through, drawn once. A map that follows a session is a [`SpaceMap`].
#[must_use]
pub fn occupancy_of(session: &Session<SpaceSweep>, settings: OccupancySettings) -> Occupancy {
    let mut occupancy = Occupancy::new(settings);
    for (sweep, &map_from_keyframe) in session.drawn().iter().zip(session.map_from_keyframe()) {
        let Some(sweep) = sweep else { continue };
        draw(&mut occupancy, sweep, map_from_keyframe, Change::Add);
    }
    occupancy
}

fn draw(occupancy: &mut Occupancy, sweep: &SpaceSweep, map_from_keyframe: Pose3, change: Change) {
    let sensor_m = sweep.sensor.robot_from_sensor.translation.into();
    occupancy.draw(sweep.points_m(), sensor_m, map_from_keyframe, change);
}

/// The occupancy of a session, drawn once and then kept in step with corrections: what [`crate::GlobalMap`] is in the plane.
///
/// Each keyframe has a *render pose*, where its cloud is drawn. [`SpaceMap::follow`] sets it to the present pose where the two are
/// visibly apart, [`SpaceMap::export`] everywhere. Counts are integers: however it came about, an exported map equals the one of
/// [`occupancy_of`] to the bit.
///
/// ```
/// # use mapwright::{OccupancySettings, Settings, SpaceMap, SpaceMapper};
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// # let mapper = SpaceMapper::new(Settings::default())?;
/// let mut map = SpaceMap::new(OccupancySettings::default());
/// // After each correction, or when somebody looks:
/// map.follow(mapper.session());
/// let known = map.occupancy().voxels().count();
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone)]
pub struct SpaceMap {
    settings: OccupancySettings,
    occupancy: Occupancy,
    drawn: Vec<Option<Drawn>>,
}

#[derive(Debug, Clone)]
struct Drawn {
    sweep: Arc<SpaceSweep>,
    map_from_keyframe: Pose3,
    /// Distance of the farthest point or of the sensor from the keyframe, metres; how far a rotation moves it.
    lever_m: f64,
}

/// What is to be drawn of a keyframe, if anything, and where.
type Wanted<'a> = Option<(&'a Arc<SpaceSweep>, Pose3)>;

impl SpaceMap {
    /// An empty map.
    #[must_use]
    pub fn new(settings: OccupancySettings) -> Self {
        Self { settings, occupancy: Occupancy::new(settings), drawn: Vec::new() }
    }

    /// Counts of all keyframes at their render poses.
    #[must_use]
    pub fn occupancy(&self) -> &Occupancy {
        &self.occupancy
    }

    /// Where a keyframe is drawn, if it is.
    #[must_use]
    pub fn render_pose(&self, number: usize) -> Option<Pose3> {
        self.drawn.get(number)?.as_ref().map(|drawn| drawn.map_from_keyframe)
    }

    /// Draws new keyframes, takes out what is left out, and draws those anew of which a point may have moved by more than a quarter of
    /// a voxel since they were drawn. Returns how many there were of all these.
    pub fn follow(&mut self, session: &Session<SpaceSweep>) -> usize {
        let visible_m = FOLLOW_CELLS * self.occupancy.resolution_m();
        self.update(session, |drawn, now| {
            let turned_rad = drawn.map_from_keyframe.rotation.angle_to(&now.rotation);
            drawn.map_from_keyframe.distance(now) + drawn.lever_m * turned_rad > visible_m
        })
    }

    /// As [`SpaceMap::follow`], for all that have moved at all: afterwards the map is the one drawn from scratch.
    pub fn export(&mut self, session: &Session<SpaceSweep>) -> &Occupancy {
        self.update(session, |drawn, now| drawn.map_from_keyframe != now);
        &self.occupancy
    }

    /// The counts, when nothing more is to follow.
    #[must_use]
    pub fn into_occupancy(self) -> Occupancy {
        self.occupancy
    }

    fn update(&mut self, session: &Session<SpaceSweep>, moved: impl Fn(&Drawn, Pose3) -> bool) -> usize {
        let wanted = wanted(session);
        self.drawn.resize(wanted.len().max(self.drawn.len()), None);
        let wanted = |number: usize| wanted.get(number).copied().flatten();
        let stays = |(number, drawn): (usize, &Option<Drawn>)| match (drawn, wanted(number)) {
            (None, None) => true,
            (Some(drawn), Some((sweep, now))) => Arc::ptr_eq(&drawn.sweep, sweep) && !moved(drawn, now),
            _ => false,
        };
        let changed: Vec<usize> =
            self.drawn.iter().enumerate().filter(|&it| !stays(it)).map(|(number, _)| number).collect();
        let gone = changed.iter().filter_map(|&number| self.drawn[number].take()).collect();
        self.take_out(gone);
        for &number in &changed {
            self.drawn[number] = wanted(number).map(|(sweep, now)| self.add(sweep, now));
        }
        changed.len()
    }

    /// Takes keyframes out; where they are more than those that stay, these are drawn from scratch: the counts are the same.
    fn take_out(&mut self, gone: Vec<Drawn>) {
        let staying = self.drawn.iter().flatten();
        if gone.len() <= staying.clone().count() {
            gone.iter().for_each(|it| draw(&mut self.occupancy, &it.sweep, it.map_from_keyframe, Change::Remove));
            return;
        }
        self.occupancy = Occupancy::new(self.settings);
        staying.for_each(|it| draw(&mut self.occupancy, &it.sweep, it.map_from_keyframe, Change::Add));
    }

    fn add(&mut self, sweep: &Arc<SpaceSweep>, map_from_keyframe: Pose3) -> Drawn {
        draw(&mut self.occupancy, sweep, map_from_keyframe, Change::Add);
        Drawn { sweep: Arc::clone(sweep), map_from_keyframe, lever_m: farthest_m(sweep) }
    }
}

fn wanted(session: &Session<SpaceSweep>) -> Vec<Wanted<'_>> {
    let poses = session.map_from_keyframe();
    session.drawn().iter().zip(poses).map(|(sweep, &pose)| Some((sweep.as_ref()?, pose))).collect()
}

/// Distance of the farthest point from the robot, or of the sensor where that is farther, metres.
fn farthest_m(sweep: &SpaceSweep) -> f64 {
    let points = sweep.points_m().map(|point| nalgebra::Vector3::from(point.map(f64::from)).norm());
    points.fold(sweep.sensor.robot_from_sensor.translation.norm(), f64::max)
}
