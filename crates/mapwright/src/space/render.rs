//! The finished map as points, as surfels and as occupancy: every keyframe's at its present pose.

use crate::render::FOLLOW_CELLS;
use mapwright_geom::Pose3;
use mapwright_record::{SeparateMap, Session};
use mapwright_sensor::SpaceSweep;
use mapwright_voxel::{
    Change, Occupancy, OccupancySettings, PointColumns, Surfel, SurfelMap, SurfelMapSettings, Thinner,
};
use std::sync::Arc;

/// Points of a map in its frame, metres, with a colour and an intensity each where all of its clouds have any.
pub type MapPoints = PointColumns;

/// All points of a session, of those in each cube of side `size_m` their mean.
#[must_use]
pub fn points_of(session: &Session<SpaceSweep>, size_m: f64) -> MapPoints {
    points_of_places(session, 0..session.keyframes().len(), size_m)
}

/// The same of one of its maps ([`Session::maps`]).
#[must_use]
pub fn points_of_map(session: &Session<SpaceSweep>, map: &SeparateMap, size_m: f64) -> MapPoints {
    points_of_places(session, map.places(), size_m)
}

fn points_of_places(session: &Session<SpaceSweep>, places: impl Iterator<Item = usize>, size_m: f64) -> MapPoints {
    let mut all = MapPoints::default();
    let is_of_all = |has: &dyn Fn(&SpaceSweep) -> usize| {
        session.drawn().iter().flatten().all(|sweep| has(sweep.as_ref()) == sweep.points.len())
    };
    let (is_coloured, has_intensities) =
        (is_of_all(&|sweep| sweep.colours.len()), is_of_all(&|sweep| sweep.intensities.len()));
    for place in places {
        let (Some(Some(sweep)), Some(pose)) = (session.drawn().get(place), session.map_from_keyframe().get(place))
        else {
            continue;
        };
        let rotation = pose.rotation.to_rotation_matrix();
        all.points_m.extend(sweep.points_m().map(|point| {
            let at = rotation * nalgebra::Vector3::from(point.map(f64::from)) + pose.translation;
            [at.x as f32, at.y as f32, at.z as f32]
        }));
        if is_coloured {
            all.colours.extend_from_slice(&sweep.colours);
        }
        if has_intensities {
            all.intensities.extend(sweep.intensities());
        }
    }
    let mut thinned = MapPoints::default();
    Thinner::default().thin_columns(&all, size_m.max(1e-3), &mut thinned);
    thinned
}

/// A piece of a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapSurfel {
    /// Mean of the points on it, metres, in the map's frame.
    pub mean_m: [f32; 3],
    /// Of length one, towards the sensor that saw it last.
    pub normal: [f32; 3],
    /// Radius of a disc as wide as the points are spread, metres.
    pub radius_m: f32,
}

/// Pieces of surfaces, and a colour each where the sensor has any.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MapSurfels {
    /// In an order that depends on nothing but where they lie.
    pub surfels: Vec<MapSurfel>,
    /// Red, green and blue of each, the mean of its points; empty where there are none.
    pub colours: Vec<[u8; 3]>,
    /// Cubes of which the points lie on a line, so that no normal is known.
    pub lines: usize,
}

/// Points that spread by less than this share of a cube's side across the way along which they spread most lie on a line: three times
/// what a surface is thick at least; points all over a square spread by 0.29 of it.
const LINE_SHARE: f64 = 0.06;
/// Standard deviation of points across a surfel is taken to be this at least, metres: what keyframes' steps round off. It says nothing
/// of where a surfel lies or faces.
const SURFEL_NOISE_M: f64 = 0.001;

/// The surfaces of a session: of each cube of side `resolution_m` with five points or more the plane through them.
#[must_use]
pub fn surfels_of(session: &Session<SpaceSweep>, resolution_m: f64) -> MapSurfels {
    let resolution_m = resolution_m.max(1e-3);
    let mut map = SurfelMap::new(SurfelMapSettings { resolution_m, levels: 1, noise_m: SURFEL_NOISE_M });
    let wanted = wanted(session);
    let mut points_m: Vec<[f32; 3]> = Vec::new();
    for (number, &(sweep, map_from_keyframe)) in wanted.iter().enumerate().filter_map(|(k, it)| Some((k, it.as_ref()?)))
    {
        points_m.clear();
        points_m.extend(sweep.points_m());
        map.draw(&points_m, sweep.origin_m(), map_from_keyframe, Change::Add, number as u32);
    }
    map.refresh();
    let known: Vec<(usize, u32, &Surfel)> = map.placed_surfels().collect();
    let is_surface = |surfel: &Surfel| surfel.spread_m()[0] >= LINE_SHARE * resolution_m;
    let surfaces: Vec<_> = known.iter().copied().filter(|(.., surfel)| is_surface(surfel)).collect();
    let surfel = |&(.., surfel): &(usize, u32, &Surfel)| {
        let Surfel { mean_m, normal, .. } = *surfel;
        MapSurfel { mean_m, normal, radius_m: surfel.radius_m() as f32 }
    };
    let places: Vec<usize> = surfaces.iter().map(|(place, ..)| *place).collect();
    MapSurfels {
        surfels: surfaces.iter().map(surfel).collect(),
        colours: colours_of(&map, &places, &wanted),
        lines: known.len() - surfaces.len(),
    }
}

/// The mean colour of the points in each of these places; none where any keyframe has none.
fn colours_of(map: &SurfelMap, places: &[usize], wanted: &[Wanted<'_>]) -> Vec<[u8; 3]> {
    let is_coloured = wanted.iter().flatten().all(|(sweep, _)| sweep.colours.len() == sweep.points.len());
    if !is_coloured || wanted.iter().flatten().all(|(sweep, _)| sweep.points.is_empty()) {
        return Vec::new();
    }
    let mut sums = vec![([0_u64; 3], 0_u64); map.voxels()];
    let mut points_m: Vec<[f32; 3]> = Vec::new();
    for &(sweep, map_from_keyframe) in wanted.iter().flatten() {
        points_m.clear();
        points_m.extend(sweep.points_m());
        map.each_place(&points_m, map_from_keyframe, |point, place| {
            let Some((sum, count)) = sums.get_mut(place) else { return };
            (0..3).for_each(|k| sum[k] += u64::from(sweep.colours[point][k]));
            *count += 1;
        });
    }
    let mean = |(sum, count): ([u64; 3], u64)| sum.map(|v| (v / count.max(1)) as u8);
    places.iter().filter_map(|&place| sums.get(place).copied()).map(mean).collect()
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
