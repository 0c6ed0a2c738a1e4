//! Surfels at several resolutions at once.

use crate::key::{Key, corner, key_of};
use crate::surfel::{Sums, Surfel};
use mapwright_geom::Pose3;
use rustc_hash::FxHashMap;

/// How a map is made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfelMapSettings {
    /// Side of the smallest voxels, metres.
    pub resolution_m: f64,
    /// How many resolutions; each has voxels twice as large as the one before.
    pub levels: usize,
    /// Standard deviation of points across a surface at least, metres.
    pub noise_m: f64,
}

impl SurfelMapSettings {
    /// Side of the voxels of a resolution, the finest is 0, metres.
    fn size_m(&self, level: usize) -> f64 {
        self.resolution_m * f64::from(1_u32 << level.min(16))
    }

    /// Side of the largest voxels, metres.
    #[must_use]
    pub fn coarsest_m(&self) -> f64 {
        self.size_m(self.levels.saturating_sub(1))
    }
}

/// Whether points come or go.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Change {
    /// They are added.
    Add,
    /// They are taken away again, exactly.
    Remove,
}

/// A map to match clouds against.
#[derive(Debug, Clone)]
pub struct SurfelMap {
    settings: SurfelMapSettings,
    levels: Vec<Level>,
}

/// One resolution.
#[derive(Debug, Clone)]
pub(crate) struct Level {
    pub(crate) size_m: f64,
    per_m: f64,
    /// Where its voxels begin, of their side.
    offset: f64,
    noise_m: f64,
    /// Of the coarser half, which lead to a pose and do not judge it.
    leads: bool,
    places: FxHashMap<Key, u32>,
    voxels: Vec<Voxel>,
    /// Beside each voxel, for matching reads nothing else.
    surfels: Vec<Option<Surfel>>,
    touched: Vec<u32>,
    /// Voxels that are empty and may be used again.
    empty: Vec<u32>,
}

/// A voxel that was looked for, and its place.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Looked {
    key: Key,
    /// In which of the resolutions asked.
    level: u32,
    place: u32,
    is_there: bool,
}

/// The place of a voxel that is not there.
const NOWHERE: u32 = u32::MAX;

impl Looked {
    /// None yet.
    pub(crate) const NOTHING: Self = Self { key: Key::MAX, level: 0, place: NOWHERE, is_there: false };

    /// Whether the voxel has a surfel, be it one that tells nothing.
    #[inline]
    pub(crate) fn is_there(&self) -> bool {
        self.is_there
    }
}

#[derive(Debug, Clone, Copy)]
struct Voxel {
    key: Key,
    sums: Sums,
    /// Who added to it last.
    supplier: u32,
    is_touched: bool,
}

/// Each resolution's voxels begin by so much of their side elsewhere, the golden section: what lies on faces of the one lies within voxels of
/// the others. A cloud of a wall on faces of all is beside it in empty voxels, wherever it is, and is not drawn to it.
const OFFSET: f64 = 0.618_033_988_749_895;

impl SurfelMap {
    /// An empty map.
    #[must_use]
    pub fn new(settings: SurfelMapSettings) -> Self {
        let levels = settings.levels.max(1);
        let level = |k: usize| {
            let offset = (OFFSET * k as f64).fract();
            Level { offset, leads: k > 0 && k >= levels / 2, ..Level::new(settings.size_m(k), settings.noise_m) }
        };
        Self { settings, levels: (0..levels).map(level).collect() }
    }

    /// How it was made.
    #[must_use]
    pub fn settings(&self) -> &SurfelMapSettings {
        &self.settings
    }

    /// The finest first.
    pub(crate) fn levels(&self) -> &[Level] {
        &self.levels
    }

    /// Whether nothing is in it.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.levels[0].places.is_empty()
    }

    /// Voxels that hold points, of all resolutions.
    #[must_use]
    pub fn voxels(&self) -> usize {
        self.levels.iter().map(|level| level.places.len()).sum()
    }

    /// Adds the points of a cloud at `map_from_cloud`, or takes them away again; both they and where they were seen from, `origin_m`, are in its
    /// frame. Those that are not finite or beyond 2^20 voxels from the map's origin are left out. `supplier` is the number of who saw them.
    pub fn draw(
        &mut self,
        points_m: &[[f32; 3]],
        origin_m: [f64; 3],
        map_from_cloud: Pose3,
        change: Change,
        supplier: u32,
    ) {
        let rotation = map_from_cloud.rotation.to_rotation_matrix();
        let origin = rotation * nalgebra::Vector3::from(origin_m);
        for &[x, y, z] in points_m {
            let point = nalgebra::Vector3::new(f64::from(x), f64::from(y), f64::from(z));
            let arm = rotation * point;
            let at: [f64; 3] = (arm + map_from_cloud.translation).into();
            let along = arm - origin;
            let ray: [f64; 3] = (along / along.norm().max(f64::MIN_POSITIVE)).into();
            self.levels.iter_mut().for_each(|level| level.draw(at, ray, change, supplier));
        }
    }

    /// Brings the surfels in line with the points; to be called before matching.
    pub fn refresh(&mut self) {
        self.levels.iter_mut().for_each(Level::refresh);
    }

    /// Calls with the supplier of each point's voxel at the finest resolution, where it has a surfel.
    pub fn each_supplier(&self, points_m: &[[f32; 3]], map_from_cloud: Pose3, mut call: impl FnMut(u32)) {
        self.each_place(points_m, map_from_cloud, |_, place| call(self.levels[0].voxels[place].supplier));
    }

    /// Who supplied each voxel of the finest resolution, in the order of the voxels' places: what the points drawn do not say.
    #[must_use]
    pub fn suppliers(&self) -> Vec<u32> {
        let level = &self.levels[0];
        level.in_order().into_iter().map(|place| level.voxels[place as usize].supplier).collect()
    }

    /// Names those who supplied the voxels anew, as [`SurfelMap::suppliers`] told of a map of the same points; false where they are
    /// not as many as voxels.
    #[must_use]
    pub fn set_suppliers(&mut self, suppliers: &[u32]) -> bool {
        let level = &mut self.levels[0];
        let places = level.in_order();
        for (&place, &supplier) in places.iter().zip(suppliers) {
            level.voxels[place as usize].supplier = supplier;
        }
        places.len() == suppliers.len()
    }

    /// Calls with the number of each point and the place of its voxel at the finest resolution, where it has a surfel.
    pub fn each_place(&self, points_m: &[[f32; 3]], map_from_cloud: Pose3, mut call: impl FnMut(usize, usize)) {
        let rotation = map_from_cloud.rotation.to_rotation_matrix();
        let level = &self.levels[0];
        for (number, point) in points_m.iter().enumerate() {
            let point = nalgebra::Vector3::from(point.map(f64::from));
            let at: [f64; 3] = (rotation * point + map_from_cloud.translation).into();
            if let Some(place) = level.place_at(at).filter(|&place| level.surfels[place].is_some()) {
                call(number, place);
            }
        }
    }

    /// The surfels of the finest resolution with the places of their voxels and who supplied these last, in an order that depends on
    /// nothing but where they lie.
    pub fn placed_surfels(&self) -> impl Iterator<Item = (usize, u32, &Surfel)> {
        let level = &self.levels[0];
        level
            .in_order()
            .into_iter()
            .map(|place| place as usize)
            .filter_map(|place| Some((place, level.voxels[place].supplier, level.surfels[place].as_ref()?)))
    }

    /// The surfels of the finest resolution.
    pub fn surfels(&self) -> impl Iterator<Item = &Surfel> {
        self.levels[0].surfels.iter().flatten()
    }
}

/// The surfel that says something where a point lies, of the first of these resolutions that has one: a resolution that leads says
/// something everywhere in its voxels, the others where their points lie. `last` is the voxel of the first
/// where it was looked for before, and what was found from there.
#[inline]
pub(crate) fn surfel_at<'a>(levels: &'a [Level], at: [f64; 3], last: &mut Looked) -> Option<&'a Surfel> {
    let key = key_of(levels[0].scaled(at))?;
    if key != last.key {
        *last = look(levels, key, at);
    }
    levels[last.level as usize].surfels.get(last.place as usize)?.as_ref()
}

fn look(levels: &[Level], key: Key, at: [f64; 3]) -> Looked {
    let mut is_there = false;
    for (number, level) in levels.iter().enumerate() {
        let place = if number == 0 { level.place_of(key) } else { level.place_at(at) };
        let Some(place) = place else { continue };
        is_there |= number == 0 && level.surfels[place].is_some();
        let leads = number == 0 && level.leads;
        if level.surfels[place].is_some_and(|surfel| surfel.is_telling() && (leads || surfel.covers(at))) {
            return Looked { key, level: number as u32, place: place as u32, is_there };
        }
    }
    Looked { key, level: 0, place: NOWHERE, is_there }
}

impl Level {
    fn new(size_m: f64, noise_m: f64) -> Self {
        Self {
            size_m,
            noise_m,
            leads: false,
            per_m: 1.0 / size_m,
            offset: 0.0,
            places: FxHashMap::default(),
            voxels: Vec::new(),
            surfels: Vec::new(),
            touched: Vec::new(),
            empty: Vec::new(),
        }
    }

    /// A point in voxels of this resolution.
    #[inline]
    fn scaled(&self, at: [f64; 3]) -> [f64; 3] {
        at.map(|v| v * self.per_m + self.offset)
    }

    fn draw(&mut self, at: [f64; 3], ray: [f64; 3], change: Change, supplier: u32) {
        let scaled = self.scaled(at);
        let Some(key) = key_of(scaled) else { return };
        let place = match change {
            Change::Add => *self.places.entry(key).or_insert_with(|| {
                let voxel = Voxel { key, sums: Sums::default(), supplier, is_touched: false };
                let new = self.empty.pop().unwrap_or(self.voxels.len() as u32);
                if new as usize == self.voxels.len() {
                    self.voxels.push(voxel);
                    self.surfels.push(None);
                } else {
                    let is_touched = self.voxels[new as usize].is_touched;
                    self.voxels[new as usize] = Voxel { is_touched, ..voxel };
                }
                new
            }),
            Change::Remove => match self.places.get(&key) {
                Some(&place) => place,
                None => return,
            },
        };
        let corner = corner(key);
        let voxel = &mut self.voxels[place as usize];
        let within = [0, 1, 2].map(|k| scaled[k] - corner[k]);
        voxel.sums.add(within, ray, if change == Change::Add { 1 } else { -1 });
        if change == Change::Add {
            voxel.supplier = supplier;
        }
        if !voxel.is_touched {
            voxel.is_touched = true;
            self.touched.push(place);
        }
    }

    fn refresh(&mut self) {
        for place in std::mem::take(&mut self.touched) {
            let voxel = &mut self.voxels[place as usize];
            voxel.is_touched = false;
            self.surfels[place as usize] =
                voxel.sums.surfel(corner(voxel.key).map(|v| v - self.offset), self.size_m, self.noise_m);
            if voxel.sums.count == 0 && self.places.get(&voxel.key) == Some(&place) {
                self.places.remove(&voxel.key);
                self.empty.push(place);
            }
        }
    }

    /// Where its voxels are kept, sorted by where they lie.
    fn in_order(&self) -> Vec<u32> {
        let mut places: Vec<(Key, u32)> = self.places.iter().map(|(key, place)| (*key, *place)).collect();
        places.sort_unstable_by_key(|(key, _)| *key);
        places.into_iter().map(|(_, place)| place).collect()
    }

    #[inline]
    fn place_at(&self, at: [f64; 3]) -> Option<usize> {
        self.place_of(key_of(self.scaled(at))?)
    }

    #[inline]
    fn place_of(&self, key: Key) -> Option<usize> {
        self.places.get(&key).map(|&place| place as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector6;
    use proptest::prelude::*;

    fn any_cloud() -> impl Strategy<Value = (Vec<[f32; 3]>, [f64; 6])> {
        let number = prop_oneof![20 => -20.0..20.0_f32, 1 => proptest::num::f32::ANY];
        let points = prop::collection::vec([number.clone(), number.clone(), number], 0..200);
        (points, [-3.0..3.0, -3.0..3.0, -3.0..3.0, -1.0..1.0, -1.0..1.0, -1.0..1.0_f64])
    }

    /// All surfels by their voxels.
    fn surfels(map: &SurfelMap) -> Vec<Vec<(Key, Surfel)>> {
        let of_level = |level: &Level| {
            let mut all: Vec<(Key, Surfel)> =
                level.places.iter().filter_map(|(key, place)| Some((*key, level.surfels[*place as usize]?))).collect();
            all.sort_by_key(|(key, _)| *key);
            all
        };
        map.levels.iter().map(of_level).collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn clouds_come_and_go_to_the_bit_in_any_order(clouds in prop::collection::vec(any_cloud(), 1..5), gone in 0..5_usize) {
            let settings = SurfelMapSettings { resolution_m: 0.5, levels: 3, noise_m: 0.01 };
            let pose = |numbers: &[f64; 6]| Pose3::exp(Vector6::from(*numbers));
            let (mut a, mut b) = (SurfelMap::new(settings), SurfelMap::new(settings));
            for (k, (points, numbers)) in clouds.iter().enumerate() {
                a.draw(points, [0.0; 3], pose(numbers), Change::Add, k as u32);
                a.refresh();
            }
            let gone = gone % clouds.len();
            a.draw(&clouds[gone].0, [0.0; 3], pose(&clouds[gone].1), Change::Remove, gone as u32);
            a.refresh();
            for (k, (points, numbers)) in clouds.iter().enumerate().rev().filter(|(k, _)| *k != gone) {
                b.draw(points, [0.0; 3], pose(numbers), Change::Add, k as u32);
            }
            b.refresh();
            prop_assert_eq!(surfels(&a), surfels(&b));
            prop_assert_eq!(a.levels[0].places.len(), b.levels[0].places.len());
        }
    }

    #[test]
    fn a_surfel_has_the_normal_of_its_plane() {
        let mut map = SurfelMap::new(SurfelMapSettings { resolution_m: 1.0, levels: 1, noise_m: 0.01 });
        let points: Vec<[f32; 3]> =
            (0..100).map(|k| [0.05 + 0.09 * (k % 10) as f32, 0.05 + 0.09 * (k / 10) as f32, 0.5]).collect();
        map.draw(&points, [0.0; 3], Pose3::identity(), Change::Add, 7);
        map.refresh();
        let surfel = *map.surfels().next().unwrap();
        assert!(
            surfel.count == 100 && surfel.normal[2].abs() > 0.999 && (surfel.mean_m[2] - 0.5).abs() < 1e-3,
            "{surfel:?}"
        );
        // Evenly spread over a square of side a: a^2 / 12 along each side.
        assert!((surfel.radius_m() - (1.0_f64 / 3.0).sqrt() * 0.9).abs() < 0.01, "{}", surfel.radius_m());
        assert_eq!(map.placed_surfels().map(|(_, supplier, _)| supplier).collect::<Vec<_>>(), [7]);
        let mut suppliers = Vec::new();
        map.each_supplier(&points[..3], Pose3::identity(), |supplier| suppliers.push(supplier));
        assert_eq!(suppliers, [7, 7, 7]);
    }
}
