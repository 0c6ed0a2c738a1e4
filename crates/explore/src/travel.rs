//! Where a robot can drive, and what it takes to get anywhere: the map inflated by the robot's radius, and Dijkstra's costs on it.

use crate::map::{Cell, OccupancyMap};

/// Cost of a step to a neighbour at a side and at a corner: a cell and its diagonal.
const STRAIGHT: u32 = 5;
const DIAGONAL: u32 = 7;
/// A step near walls counts so many times: paths keep to the middle of doors.
const NEAR_WALL: u32 = 2;
/// A step close to where another robot stands counts so many times more.
const NEAR_ROBOT: u32 = 6;
/// Buckets of the queue: more than the dearest step.
const BUCKETS: usize = 128;
/// Not to be reached.
pub(crate) const NOWHERE: u32 = u32::MAX;

/// Where a robot of some radius can stand.
#[derive(Debug, Clone)]
pub struct Terrain {
    /// What a step into each cell costs, in times its length; zero where the robot cannot stand.
    pub(crate) weight: Vec<u8>,
    radius_m: f64,
}

impl Terrain {
    /// The free cells from which nothing occupied is nearer than the robot's radius and half a cell. Unknown cells cannot be driven on.
    #[must_use]
    pub fn new(map: &OccupancyMap, radius_m: f64) -> Self {
        let cell_m = map.resolution_m();
        let free = |cell: &Cell| if *cell == Cell::Free { 1 } else { 0 };
        let mut weight: Vec<u8> = map.cells().iter().map(free).collect();
        // Nearer than a radius to the walls that are kept away from by a radius.
        let (blocked, near) = (disc(map, radius_m + 0.5 * cell_m), disc(map, 2.0 * radius_m + 0.5 * cell_m));
        for index in map.inner() {
            if map.cells()[index] != Cell::Occupied
                || map.around(index).iter().all(|&k| map.cells()[k] == Cell::Occupied)
            {
                continue;
            }
            stamp(&mut weight, index, &near, |weight| if weight == 1 { NEAR_WALL as u8 } else { weight });
            stamp(&mut weight, index, &blocked, |_| 0);
        }
        Self { weight, radius_m }
    }

    /// Radius of the robot it is for, metres.
    #[must_use]
    pub fn radius_m(&self) -> f64 {
        self.radius_m
    }

    /// Whether a robot can stand in the cell that holds a point.
    #[must_use]
    pub fn is_open(&self, map: &OccupancyMap, point_m: [f64; 2]) -> bool {
        map.index_of(point_m).is_some_and(|index| self.weight[index] > 0)
    }

    /// The same with discs that cannot be driven through: robots that stand in the way.
    #[must_use]
    pub fn without(mut self, map: &OccupancyMap, discs: &[([f64; 2], f64)]) -> Self {
        for &(center_m, radius_m) in discs {
            let Some(index) = map.index_of(center_m) else { continue };
            stamp(&mut self.weight, index, &disc(map, radius_m), |_| 0);
        }
        self
    }

    /// The same with discs that are better driven around.
    #[must_use]
    pub fn avoiding(mut self, map: &OccupancyMap, discs: &[([f64; 2], f64)]) -> Self {
        for &(center_m, radius_m) in discs {
            let Some(index) = map.index_of(center_m) else { continue };
            let dearer = |weight: u8| if weight > 0 { (NEAR_WALL + NEAR_ROBOT) as u8 } else { 0 };
            stamp(&mut self.weight, index, &disc(map, radius_m), dearer);
        }
        self
    }

    /// The cell to start from: that of the point, or the nearest open one that free cells lead to, for a pose may lie a little too near to
    /// a wall.
    fn start(&self, map: &OccupancyMap, from_m: [f64; 2]) -> Option<usize> {
        let here = map.index_of(from_m)?;
        if self.weight[here] > 0 {
            return Some(here);
        }
        let reach_m = 4.0 * self.radius_m + map.resolution_m();
        let (mut seen, mut next) = (vec![here], 0);
        while let Some(&cell) = seen.get(next) {
            next += 1;
            for near in map.around(cell) {
                let passable = map.cells()[near] != Cell::Occupied && map.between_m(near, here) <= reach_m;
                if map.is_edge(near) || !passable || seen.contains(&near) {
                    continue;
                }
                if self.weight[near] > 0 {
                    return Some(near);
                }
                seen.push(near);
            }
        }
        None
    }
}

/// Offsets of the cells whose middles lie within a radius, by rows: index offset of the first and how many.
fn disc(map: &OccupancyMap, radius_m: f64) -> Vec<(isize, usize)> {
    let cells = radius_m / map.resolution_m() + 1e-9;
    let width = map.size()[0] as isize;
    let most = cells.floor().min(1e4) as isize;
    let row = |dy: isize| {
        let half = (cells * cells - (dy * dy) as f64).max(0.0).sqrt().floor() as isize;
        (dy * width - half, 2 * half as usize + 1)
    };
    (-most..=most).map(row).collect()
}

#[inline]
fn stamp(weight: &mut [u8], center: usize, disc: &[(isize, usize)], change: impl Fn(u8) -> u8) {
    for &(offset, count) in disc {
        let first = center as isize + offset;
        let range = first.max(0) as usize..((first + count as isize).max(0) as usize).min(weight.len());
        if let Some(cells) = weight.get_mut(range) {
            cells.iter_mut().for_each(|cell| *cell = change(*cell));
        }
    }
}

/// What it takes to get from one place to every other (Dijkstra 1959, with buckets as Dial 1969).
#[derive(Debug, Clone)]
pub struct Travel {
    cost: Vec<u32>,
    start: Option<usize>,
    unit_m: f64,
}

impl Travel {
    /// Costs from a point to everywhere.
    #[must_use]
    pub fn from(map: &OccupancyMap, terrain: &Terrain, from_m: [f64; 2]) -> Self {
        Self::until(map, terrain, from_m, |_, _| false)
    }

    /// Costs from a point on, in their order, until a cell is the one looked for; that and those dearer have none.
    pub(crate) fn until(
        map: &OccupancyMap,
        terrain: &Terrain,
        from_m: [f64; 2],
        mut found: impl FnMut(usize, u32) -> bool,
    ) -> Self {
        let mut cost = vec![NOWHERE; map.cells().len()];
        let start = terrain.start(map, from_m);
        let unit_m = map.resolution_m() / f64::from(STRAIGHT);
        let Some(first) = start else { return Self { cost, start, unit_m } };
        cost[first] = 0;
        let mut buckets: Vec<Vec<u32>> = vec![Vec::new(); BUCKETS];
        buckets[0].push(first as u32);
        let (mut now, mut waiting) = (0_u32, 1_usize);
        'all: while waiting > 0 {
            while let Some(cell) = buckets[now as usize % BUCKETS].pop() {
                waiting -= 1;
                let cell = cell as usize;
                if cost[cell] != now {
                    continue;
                }
                if found(cell, now) {
                    break 'all;
                }
                for (k, near) in map.around(cell).into_iter().enumerate() {
                    let weight = u32::from(terrain.weight[near]);
                    let there = now + weight * if k < 4 { STRAIGHT } else { DIAGONAL };
                    if weight > 0 && there < cost[near] {
                        cost[near] = there;
                        buckets[there as usize % BUCKETS].push(near as u32);
                        waiting += 1;
                    }
                }
            }
            now += 1;
        }
        Self { cost, start, unit_m }
    }

    /// Cost to a cell in metres of clear way: steps near walls count double. None where there is no way.
    #[must_use]
    pub fn cost_m(&self, index: usize) -> Option<f64> {
        let cost = *self.cost.get(index)?;
        (cost != NOWHERE).then(|| f64::from(cost) * self.unit_m)
    }

    /// The cheapest way to a cell, from the start on, both included; empty where there is none.
    #[must_use]
    pub fn path(&self, map: &OccupancyMap, to: usize) -> Vec<usize> {
        if self.start.is_none() || self.cost.get(to).is_none_or(|cost| *cost == NOWHERE) {
            return Vec::new();
        }
        let (mut path, mut at) = (vec![to], to);
        while Some(at) != self.start {
            let near = map.around(at).into_iter().filter(|&near| self.cost[near] < self.cost[at]);
            // From which of them the cost came does not matter: each step gets nearer.
            let Some(before) = near.min_by_key(|&near| self.cost[near]) else { break };
            path.push(before);
            at = before;
        }
        path.reverse();
        path
    }
}

/// A way to a cell as points without those in a straight row, metres.
#[must_use]
pub fn corners_m(map: &OccupancyMap, path: &[usize]) -> Vec<[f64; 2]> {
    let mut corners = Vec::new();
    for (k, &cell) in path.iter().enumerate() {
        let step = |from: Option<&usize>, to: Option<&usize>| Some(to?.wrapping_sub(*from?));
        let before = k.checked_sub(1).and_then(|k| path.get(k));
        let (in_step, out_step) = (step(before, Some(&cell)), step(Some(&cell), path.get(k + 1)));
        if in_step.is_none() || out_step.is_none() || in_step != out_step {
            corners.push(map.center_m(cell));
        }
    }
    corners
}

/// A way from a point to another for a robot that knows where others are; empty where there is none.
#[must_use]
pub fn way_m(map: &OccupancyMap, terrain: &Terrain, from_m: [f64; 2], to_m: [f64; 2]) -> Vec<[f64; 2]> {
    let Some(to) = map.index_of(to_m) else { return Vec::new() };
    let travel = Travel::until(map, terrain, from_m, |cell, _| cell == to);
    corners_m(map, &travel.path(map, to))
}

/// The nearest place where a robot is out of the way of others: farther than `keep_m` from every point of their paths. The way there, empty
/// where there is no such place.
#[must_use]
pub fn aside_m(
    map: &OccupancyMap,
    terrain: &Terrain,
    from_m: [f64; 2],
    paths_m: &[[f64; 2]],
    keep_m: f64,
) -> Vec<[f64; 2]> {
    let mut free = terrain.clone();
    let keep = disc(map, keep_m);
    for index in paths_m.iter().filter_map(|&point| map.index_of(point)) {
        stamp(&mut free.weight, index, &keep, |_| 0);
    }
    let mut place = None;
    let travel = Travel::until(map, terrain, from_m, |cell, _| {
        place = (free.weight[cell] > 0).then_some(cell);
        place.is_some()
    });
    place.map_or(Vec::new(), |place| corners_m(map, &travel.path(map, place)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two rooms of 3 by 3 m and a door of so many cells between them.
    pub(crate) fn rooms(door: usize) -> OccupancyMap {
        let (width, height) = (64, 34);
        let cell = |index: usize| {
            let (x, y) = (index % width, index / width);
            let edge = x < 2 || y < 2 || x >= width - 2 || y >= height - 2;
            let wall = (31..33).contains(&x) && !(10..10 + door).contains(&y);
            if edge || wall { Cell::Occupied } else { Cell::Free }
        };
        OccupancyMap::new([0.0; 2], 0.1, width, (0..width * height).map(cell).collect()).unwrap()
    }

    #[test]
    fn a_robot_passes_a_door_that_is_wider_than_itself() {
        for (door, passes) in [(9, true), (6, true), (3, false)] {
            let map = rooms(door);
            let terrain = Terrain::new(&map, 0.22);
            let way = way_m(&map, &terrain, [1.0, 2.5], [5.0, 2.5]);
            assert_eq!(!way.is_empty(), passes, "{door}");
            assert!(way.iter().all(|&point| terrain.is_open(&map, point)));
        }
    }

    #[test]
    fn costs_are_lengths_and_ways_end_where_asked() {
        let map = rooms(9);
        let terrain = Terrain::new(&map, 0.0);
        let travel = Travel::from(&map, &terrain, [1.05, 1.05]);
        let to = map.index_of([2.05, 1.05]).unwrap();
        assert!((travel.cost_m(to).unwrap() - 1.0).abs() < 1e-9);
        let way = corners_m(&map, &travel.path(&map, to));
        assert_eq!(way.len(), 2);
        assert!((way[1][0] - 2.05).abs() < 1e-9);
        assert!(travel.cost_m(map.index_of([3.15, 2.5]).unwrap()).is_none(), "in the wall");
    }

    #[test]
    fn a_start_in_the_inflated_wall_is_left_by_the_nearest_way() {
        let map = rooms(9);
        let terrain = Terrain::new(&map, 0.22);
        assert!(!terrain.is_open(&map, [0.25, 1.0]));
        assert!(!way_m(&map, &terrain, [0.25, 1.0], [2.0, 1.0]).is_empty());
        assert!(way_m(&map, &terrain, [90.0, 1.0], [2.0, 1.0]).is_empty());
    }

    #[test]
    fn who_stands_in_the_door_steps_aside() {
        let map = rooms(9);
        let terrain = Terrain::new(&map, 0.22);
        let other = way_m(&map, &terrain, [1.0, 1.45], [5.0, 1.45]);
        let points: Vec<[f64; 2]> = (0..400).map(|k| [1.0 + 0.01 * f64::from(k), 1.45]).collect();
        assert!(other.len() >= 2);
        let way = aside_m(&map, &terrain, [3.2, 1.45], &points, 0.6);
        let [x, y] = *way.last().unwrap();
        assert!((y - 1.45).abs() >= 0.55 && (1.0..5.5).contains(&x), "{x} {y}");
    }

    #[test]
    fn robots_in_the_way_are_driven_around() {
        let map = rooms(9);
        let around = Terrain::new(&map, 0.22).without(&map, &[([1.5, 1.5], 0.5)]);
        let way = way_m(&map, &around, [0.8, 1.5], [2.4, 1.5]);
        assert!(way.iter().any(|point| (point[1] - 1.5).abs() > 0.4), "{way:?}");
    }
}
