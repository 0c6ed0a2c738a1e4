//! The lasers of a robot: what is learnt of one says nothing of another.

use mapwright_geom::Stored;
use mapwright_sensor::LaserModel;
use std::sync::Arc;

/// Lasers that are told apart; those beyond count as the last: a robot has fewer.
const LASERS_AT_MOST: usize = 16;

/// One of the robot's lasers, by the order in which they were first heard.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct LaserId(usize);

/// The lasers heard so far.
#[derive(Debug, Clone, Default)]
pub(super) struct Lasers {
    known: Vec<Arc<LaserModel>>,
}

impl Lasers {
    /// Which one a scan is of.
    pub(super) fn of(&mut self, laser: &Arc<LaserModel>) -> LaserId {
        let by_model = || self.known.iter().position(|known| known.is_one_with(laser));
        let at = self.known.iter().position(|known| Arc::ptr_eq(known, laser)).or_else(by_model);
        let at = at.unwrap_or_else(|| {
            self.known.truncate(LASERS_AT_MOST - 1);
            self.known.push(Arc::clone(laser));
            self.known.len() - 1
        });
        if !Arc::ptr_eq(&self.known[at], laser) {
            self.known[at] = Arc::clone(laser);
        }
        LaserId(at)
    }
}

impl Stored for Lasers {
    fn put(&self, out: &mut Vec<u8>) {
        self.known.iter().map(|laser| LaserModel::clone(laser)).collect::<Vec<_>>().put(out);
    }

    fn take(from: &mut &[u8]) -> Option<Self> {
        let known = Vec::<LaserModel>::take(from).filter(|known| known.len() <= LASERS_AT_MOST)?;
        Some(Self { known: known.into_iter().map(Arc::new).collect() })
    }
}

/// A value for each laser.
#[derive(Debug, Clone, Default)]
pub(super) struct PerLaser<T>(Vec<T>);

impl<T: Default> PerLaser<T> {
    pub(super) fn of(&mut self, laser: LaserId) -> &mut T {
        if self.0.len() <= laser.0 {
            self.0.resize_with(laser.0 + 1, T::default);
        }
        &mut self.0[laser.0]
    }

    pub(super) fn get(&self, laser: LaserId) -> Option<&T> {
        self.0.get(laser.0)
    }

    /// Those of all lasers, in their order.
    pub(super) fn iter(&self) -> impl Iterator<Item = &T> {
        self.0.iter()
    }

    pub(super) fn iter_mut(&mut self) -> impl Iterator<Item = &mut T> {
        self.0.iter_mut()
    }
}

impl<T: Stored> Stored for PerLaser<T> {
    fn put(&self, out: &mut Vec<u8>) {
        self.0.put(out);
    }

    fn take(from: &mut &[u8]) -> Option<Self> {
        Vec::take(from).filter(|all| all.len() <= LASERS_AT_MOST).map(Self)
    }
}

impl Stored for LaserId {
    fn put(&self, out: &mut Vec<u8>) {
        self.0.put(out);
    }

    fn take(from: &mut &[u8]) -> Option<Self> {
        usize::take(from).filter(|at| *at < LASERS_AT_MOST).map(Self)
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
        let (mut lasers, front, rear) = (Lasers::default(), named("front", 0.2), named("rear", -0.2));
        assert_eq!([&front, &rear, &front].map(|laser| lasers.of(laser).0), [0, 1, 0]);
        let longer = Arc::new(LaserModel { range_max_m: 5.0, ..LaserModel::clone(&rear) });
        assert_eq!([&longer, &rear].map(|laser| lasers.of(laser).0), [1, 1]);
        let most = (0..1000).map(|k| lasers.of(&named(&format!("laser {k}"), f64::from(k))).0).max();
        assert_eq!((most, lasers.of(&front).0), (Some(LASERS_AT_MOST - 1), 0));
        let mut bytes = Vec::new();
        lasers.put(&mut bytes);
        let mut again = Lasers::take(&mut &bytes[..]).unwrap();
        assert_eq!(again.of(&rear), lasers.of(&rear));
    }
}
