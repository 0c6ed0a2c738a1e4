//! The sensors of a robot, lasers or those of space: what is learnt of one says nothing of another.

use mapwright_geom::Stored;
use mapwright_record::{Measurement, NodeId, Past};
use mapwright_sensor::{LaserModel, SpaceSensor};
use std::sync::Arc;

/// Sensors that are told apart; those beyond count as the last: a robot has fewer.
const SENSORS_AT_MOST: usize = 16;

/// What tells a robot's sensors apart.
pub(crate) trait Sensor: Stored + Clone {
    /// Whether readings of both are one stream, of one sensor.
    fn is_one_with(&self, other: &Self) -> bool;
}

impl Sensor for LaserModel {
    fn is_one_with(&self, other: &Self) -> bool {
        LaserModel::is_one_with(self, other)
    }
}

impl Sensor for SpaceSensor {
    fn is_one_with(&self, other: &Self) -> bool {
        SpaceSensor::is_one_with(self, other)
    }
}

/// One of the robot's sensors, by the order in which they were first heard.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct SensorId(usize);

/// The sensors heard so far.
#[derive(Debug, Clone)]
pub(crate) struct Sensors<S> {
    known: Vec<Arc<S>>,
}

impl<S> Default for Sensors<S> {
    fn default() -> Self {
        Self { known: Vec::new() }
    }
}

impl<S: Sensor> Sensors<S> {
    /// Which one a reading is of.
    pub(crate) fn of(&mut self, sensor: &Arc<S>) -> SensorId {
        let by_model = || self.known.iter().position(|known| known.is_one_with(sensor));
        let at = self.known.iter().position(|known| Arc::ptr_eq(known, sensor)).or_else(by_model);
        let at = at.unwrap_or_else(|| {
            self.known.truncate(SENSORS_AT_MOST - 1);
            self.known.push(Arc::clone(sensor));
            self.known.len() - 1
        });
        if !Arc::ptr_eq(&self.known[at], sensor) {
            self.known[at] = Arc::clone(sensor);
        }
        SensorId(at)
    }

    /// Whether there are several.
    pub(crate) fn are_several(&self) -> bool {
        self.known.len() > 1
    }
}

impl<S: Sensor> Stored for Sensors<S> {
    fn put(&self, out: &mut Vec<u8>) {
        self.known.iter().map(|sensor| S::clone(sensor)).collect::<Vec<_>>().put(out);
    }

    fn take(from: &mut &[u8]) -> Option<Self> {
        let known = Vec::<S>::take(from).filter(|known| known.len() <= SENSORS_AT_MOST)?;
        Some(Self { known: known.into_iter().map(Arc::new).collect() })
    }
}

/// A value for each sensor.
#[derive(Debug, Clone, Default)]
pub(crate) struct PerSensor<T>(Vec<T>);

impl<T: Default> PerSensor<T> {
    pub(crate) fn of(&mut self, sensor: SensorId) -> &mut T {
        if self.0.len() <= sensor.0 {
            self.0.resize_with(sensor.0 + 1, T::default);
        }
        &mut self.0[sensor.0]
    }

    pub(crate) fn get(&self, sensor: SensorId) -> Option<&T> {
        self.0.get(sensor.0)
    }

    /// Those of all sensors, in their order.
    pub(crate) fn iter(&self) -> impl Iterator<Item = &T> {
        self.0.iter()
    }

    pub(crate) fn iter_mut(&mut self) -> impl Iterator<Item = &mut T> {
        self.0.iter_mut()
    }
}

/// Keyframes of other sensors that may have come since the newest one of a sensor.
const OTHERS_SINCE: usize = 64;

/// The newest keyframe of a sensor in the present fragment, for each sees elsewhere; none where it is long ago.
pub(crate) fn newest_of<M: Measurement<Sensor: Sensor>>(past: Past<'_, M>, sensor: &M::Sensor) -> Option<NodeId> {
    let session = past.session;
    let first = session.fragments().last().and_then(|fragment| session.place(fragment.first)).unwrap_or(0);
    let own = |node: &usize| session.keyframes()[*node].sweep.sensor().is_one_with(sensor);
    (first..session.keyframes().len()).rev().take(OTHERS_SINCE).find(own).map(NodeId::at)
}

impl<T: Stored> Stored for PerSensor<T> {
    fn put(&self, out: &mut Vec<u8>) {
        self.0.put(out);
    }

    fn take(from: &mut &[u8]) -> Option<Self> {
        Vec::take(from).filter(|all| all.len() <= SENSORS_AT_MOST).map(Self)
    }
}

impl Stored for SensorId {
    fn put(&self, out: &mut Vec<u8>) {
        self.0.put(out);
    }

    fn take(from: &mut &[u8]) -> Option<Self> {
        usize::take(from).filter(|at| *at < SENSORS_AT_MOST).map(Self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mapwright_geom::Pose2;

    #[test]
    fn each_laser_keeps_its_number_and_no_log_has_more_than_a_few() {
        let named = |name: &str, x: f64| {
            let laser = LaserModel::half_circle(name, 181);
            Arc::new(LaserModel { robot_from_laser: Pose2::new(x, 0.0, 0.0), ..laser })
        };
        let (mut lasers, front, rear) = (Sensors::default(), named("front", 0.2), named("rear", -0.2));
        assert_eq!([&front, &rear, &front].map(|laser| lasers.of(laser).0), [0, 1, 0]);
        let longer = Arc::new(LaserModel { range_max_m: 5.0, ..LaserModel::clone(&rear) });
        assert_eq!([&longer, &rear].map(|laser| lasers.of(laser).0), [1, 1]);
        let most = (0..1000).map(|k| lasers.of(&named(&format!("laser {k}"), f64::from(k))).0).max();
        assert_eq!((most, lasers.of(&front).0), (Some(SENSORS_AT_MOST - 1), 0));
        let mut bytes = Vec::new();
        lasers.put(&mut bytes);
        let mut again = Sensors::<LaserModel>::take(&mut &bytes[..]).unwrap();
        assert_eq!(again.of(&rear), lasers.of(&rear));
    }
}
