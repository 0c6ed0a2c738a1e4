//! The finished map as points and as occupancy: every keyframe's at its present pose.

use mapwright_record::Session;
use mapwright_sensor::SpaceSweep;
use mapwright_voxel::{Change, Occupancy, OccupancySettings, Thinner};

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

/// What a session's keyframes hit and looked through.
#[must_use]
pub fn occupancy_of(session: &Session<SpaceSweep>, settings: OccupancySettings) -> Occupancy {
    let mut occupancy = Occupancy::new(settings);
    for (sweep, &map_from_keyframe) in session.drawn().iter().zip(session.map_from_keyframe()) {
        let Some(sweep) = sweep else { continue };
        let sensor_m = sweep.sensor.robot_from_sensor.translation.into();
        occupancy.draw(sweep.points_m(), sensor_m, map_from_keyframe, Change::Add);
    }
    occupancy
}
