//! Where a robot can drive, and what it takes to get anywhere: the map inflated by the robot's radius, and Dijkstra's costs on it.

use crate::map::{Cell, OccupancyMap};

/// Cost of a step to a neighbour at a side and at a corner, in a clear place: a block and its diagonal, halved for each end.
const STRAIGHT: u32 = 5;
const DIAGONAL: u32 = 7;
/// What a clear step to a side costs.
pub(crate) const CLEAR_STEP: u32 = 2 * STRAIGHT;
/// An end of a step near walls counts so many times: paths keep to the middle of doors.
const NEAR_WALL: u8 = 2;
/// So many times where a robot can only stand because one has stood there: the way out of a place whose walls grew as more of them was seen.
const TIGHT: u8 = 8;
/// Buckets of the queue: more than the dearest step.
const BUCKETS: usize = 128;
/// Cells along a block's side.
const BLOCK: usize = 2;
/// Not to be reached.
pub(crate) const NOWHERE: u32 = u32::MAX;

/// Where a robot of some radius can stand.
///
/// Ways lead from block to block of two by two cells. Open cells of one block are neighbours of each other, so that whatever can be reached
/// from cell to cell can be reached from block to block where two of their cells are neighbours, at a quarter of the work.
#[derive(Debug, Clone)]
pub struct Terrain {
    /// What an end of a step costs in each cell, in times its length; zero where the robot cannot stand.
    pub(crate) weight: Vec<u8>,
    blocks: Vec<Block>,
    blocks_wide: usize,
    radius_m: f64,
}

/// Four cells.
#[derive(Debug, Clone, Copy, Default)]
struct Block {
    /// The least weight of an open cell.
    weight: u8,
    /// A bit for each cell that is open, and for each that has the least weight.
    open: u8,
    clear: u8,
    /// A bit for each neighbour that it leads to, in the order of [`Terrain::offsets`].
    leads: u8,
}

impl Block {
    /// Of cells with these weights: lower left, lower right, upper left, upper right.
    #[inline]
    fn of(weights: [u8; 4]) -> Self {
        let least = weights.iter().fold(u8::MAX, |least, &weight| if weight > 0 { least.min(weight) } else { least });
        if least == u8::MAX {
            return Self::default();
        }
        let mut block = Self { weight: least, ..Self::default() };
        for (bit, weight) in weights.into_iter().enumerate() {
            block.open |= u8::from(weight > 0) << bit;
            block.clear |= u8::from(weight == least) << bit;
        }
        block
    }
}

impl Terrain {
    /// The free cells from which nothing occupied is nearer than the robot's radius and a cell, and those where a robot has stood. Unknown
    /// cells cannot be driven on.
    #[must_use]
    pub fn new(map: &OccupancyMap, radius_m: f64) -> Self {
        let half_m = 0.5 * map.resolution_m();
        let mut weight: Vec<u8> = map.cells().iter().map(|cell| u8::from(*cell == Cell::Free)).collect();
        // What stands in a cell may be half a cell nearer.
        let blocked = disc(map, radius_m + half_m);
        // Nearer than a radius to the walls that are kept away from by a radius.
        let near = disc(map, 2.0 * (radius_m + half_m) + half_m);
        for index in map.inner() {
            let is_wall = map.cells()[index] == Cell::Occupied;
            if is_wall && map.around(index).iter().any(|&k| map.cells()[k] != Cell::Occupied) {
                stamp(&mut weight, index, &near, |weight| if weight == 1 { NEAR_WALL } else { weight });
                stamp(&mut weight, index, &blocked, |_| 0);
            }
        }
        // Where one has stood others can: nobody is shut in where walls grew as more of them was seen.
        for index in map.inner().filter(|&index| map.has_stood(index)) {
            weight[index] = if weight[index] == 0 { TIGHT } else { weight[index] };
        }
        let [width, height] = map.size();
        let blocks_wide = width.div_ceil(BLOCK);
        let mut terrain = Self { weight, blocks: Vec::new(), blocks_wide, radius_m };
        terrain.blocks.reserve(blocks_wide * height.div_ceil(BLOCK));
        for rows in terrain.weight.chunks(BLOCK * width) {
            let (lower, upper) = rows.split_at(width);
            for column in (0..width).step_by(BLOCK) {
                let weight = |row: &[u8], dx: usize| row.get(column + dx).copied().unwrap_or(0);
                let block = Block::of([weight(lower, 0), weight(lower, 1), weight(upper, 0), weight(upper, 1)]);
                terrain.blocks.push(block);
            }
        }
        terrain.link();
        terrain
    }

    /// To which neighbours each block leads: those with an open cell beside an open cell of its own.
    fn link(&mut self) {
        const LEFT: u8 = 0b0101;
        const RIGHT: u8 = 0b1010;
        const LOWER: u8 = 0b0011;
        const UPPER: u8 = 0b1100;
        let wide = self.blocks_wide;
        // The sides that face each other: own, other, distance, and the bits of the way there and back.
        let links = [
            (RIGHT, LEFT, 1, 0, 1),
            (UPPER, LOWER, wide, 2, 3),
            (RIGHT & UPPER, LEFT & LOWER, wide + 1, 4, 7),
            (LEFT & UPPER, RIGHT & LOWER, wide.saturating_sub(1), 5, 6),
        ];
        for block in 0..self.blocks.len() {
            if self.blocks[block].open == 0 {
                continue;
            }
            for (own, other, distance, there, back) in links {
                let near = block + distance;
                let faces = self.blocks.get(near).is_some_and(|near| near.open & other != 0);
                if faces && self.blocks[block].open & own != 0 {
                    self.blocks[block].leads |= 1 << there;
                    self.blocks[near].leads |= 1 << back;
                }
            }
        }
    }

    fn offsets(&self) -> [isize; 8] {
        let wide = self.blocks_wide as isize;
        [1, -1, wide, -wide, wide + 1, wide - 1, 1 - wide, -wide - 1]
    }

    /// Columns and rows of the neighbours in the same order.
    pub(crate) const STEPS: [[i32; 2]; 8] = [[1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [-1, 1], [1, -1], [-1, -1]];

    /// The blocks that a block leads to: which neighbour, which block, and what the step costs.
    #[inline]
    pub(crate) fn leads(&self, block: usize) -> impl Iterator<Item = (usize, usize, u32)> + '_ {
        let (from, offsets) = (self.blocks[block], self.offsets());
        let mut ways = from.leads;
        std::iter::from_fn(move || {
            let way = ways.trailing_zeros() as usize;
            let near = block.wrapping_add_signed(*offsets.get(way)?);
            ways &= ways - 1;
            let ends = u32::from(from.weight) + u32::from(self.blocks[near].weight);
            Some((way, near, ends * if way < 4 { STRAIGHT } else { DIAGONAL }))
        })
    }

    /// The block of a cell.
    #[inline]
    fn block_of(&self, map: &OccupancyMap, index: usize) -> usize {
        let width = map.size()[0];
        index / width / BLOCK * self.blocks_wide + index % width / BLOCK
    }

    /// Where a robot stands in a block, metres: the middle of its clearest cells; in a narrow one where exactly one has stood.
    pub(crate) fn middle_m(&self, map: &OccupancyMap, block: usize) -> [f64; 2] {
        let Block { clear, weight, .. } = self.blocks[block];
        let (x, y) = (block % self.blocks_wide * BLOCK, block / self.blocks_wide * BLOCK);
        let first = y * map.size()[0] + x;
        if weight == TIGHT {
            let cell = |bit: usize| first + bit / BLOCK * map.size()[0] + bit % BLOCK;
            let stood = (0..BLOCK * BLOCK).filter(|bit| clear & (1 << bit) != 0).find_map(|bit| map.stood_m(cell(bit)));
            if let Some(stood_m) = stood {
                return stood_m;
            }
        }
        let [left, below] = map.center_m(first);
        // Which share of them is in the second column, in the second row.
        let share = |second: u8| f64::from((clear & second).count_ones()) / f64::from(clear.count_ones().max(1));
        [left + share(0b1010) * map.resolution_m(), below + share(0b1100) * map.resolution_m()]
    }

    /// Side of a block, metres.
    pub(crate) fn block_m(map: &OccupancyMap) -> f64 {
        BLOCK as f64 * map.resolution_m()
    }

    /// Radius of the robot it is for, metres.
    #[must_use]
    pub fn radius_m(&self) -> f64 {
        self.radius_m
    }

    /// Whether a robot can stand in a cell with room to spare.
    pub(crate) fn is_roomy(&self, cell: usize) -> bool {
        (1..TIGHT).contains(&self.weight[cell])
    }

    /// Whether a robot can stand in the cell that holds a point.
    #[must_use]
    pub fn is_open(&self, map: &OccupancyMap, point_m: [f64; 2]) -> bool {
        map.index_of(point_m).is_some_and(|index| self.weight[index] > 0)
    }

    /// The block to start from: that of the point, or the nearest open one that free cells lead to, for a pose may lie a little too near
    /// to a wall.
    pub(crate) fn start(&self, map: &OccupancyMap, from_m: [f64; 2]) -> Option<usize> {
        let here = map.index_of(from_m)?;
        let reach_m = 4.0 * self.radius_m + map.resolution_m();
        let (mut seen, mut next) = (vec![here], 0);
        while let Some(&cell) = seen.get(next) {
            next += 1;
            if self.weight[cell] > 0 {
                return Some(self.block_of(map, cell));
            }
            for near in map.around(cell) {
                let passable = map.cells()[near] != Cell::Occupied && map.between_m(near, here) <= reach_m;
                if !map.is_edge(near) && passable && !seen.contains(&near) {
                    seen.push(near);
                }
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
#[derive(Debug, Clone, Default)]
pub struct Travel {
    cost: Vec<u32>,
    buckets: Vec<Vec<u32>>,
    start: Option<usize>,
    unit_m: f64,
}

impl Travel {
    /// Costs from a point to everywhere.
    #[must_use]
    pub fn from(map: &OccupancyMap, terrain: &Terrain, from_m: [f64; 2]) -> Self {
        let mut travel = Self::default();
        travel.fill(map, terrain, from_m);
        travel
    }

    /// The same in the memory of what was there.
    pub fn fill(&mut self, map: &OccupancyMap, terrain: &Terrain, from_m: [f64; 2]) {
        self.cost.clear();
        self.cost.resize(terrain.blocks.len(), NOWHERE);
        self.buckets.resize_with(BUCKETS, Vec::new);
        self.unit_m = Terrain::block_m(map) / f64::from(CLEAR_STEP);
        self.start = terrain.start(map, from_m);
        let Some(first) = self.start else { return };
        self.cost[first] = 0;
        self.buckets[0].push(first as u32);
        let (mut now, mut waiting) = (0_u32, 1_usize);
        while waiting > 0 {
            while let Some(block) = self.buckets[now as usize % BUCKETS].pop() {
                waiting -= 1;
                if self.cost[block as usize] != now {
                    continue;
                }
                for (_, near, step) in terrain.leads(block as usize) {
                    let there = now + step;
                    if there < self.cost[near] {
                        self.cost[near] = there;
                        self.buckets[there as usize % BUCKETS].push(near as u32);
                        waiting += 1;
                    }
                }
            }
            now += 1;
        }
    }

    /// Cost to a cell in metres of clear way: steps near walls count double. None where there is no way.
    #[must_use]
    pub fn cost_m(&self, map: &OccupancyMap, terrain: &Terrain, index: usize) -> Option<f64> {
        if *terrain.weight.get(index)? == 0 {
            return None;
        }
        let cost = self.cost(terrain.block_of(map, index));
        (cost != NOWHERE).then(|| f64::from(cost) * self.unit_m)
    }

    /// Cost to a block.
    #[inline]
    pub(crate) fn cost(&self, block: usize) -> u32 {
        self.cost.get(block).copied().unwrap_or(NOWHERE)
    }

    /// The cheapest way to a cell as points, from the start on, both included; empty where there is none.
    #[must_use]
    pub fn path_m(&self, map: &OccupancyMap, terrain: &Terrain, to: usize) -> Vec<[f64; 2]> {
        if self.cost_m(map, terrain, to).is_none() {
            return Vec::new();
        }
        let mut at = terrain.block_of(map, to);
        let mut path = vec![map.center_m(to)];
        while Some(at) != self.start {
            let before = terrain.leads(at).map(|(_, near, step)| (self.cost(near).saturating_add(step), near)).min();
            let Some((_, before)) = before.filter(|&(_, near)| self.cost(near) < self.cost(at)) else { break };
            path.push(terrain.middle_m(map, before));
            at = before;
        }
        path.reverse();
        path
    }
}

#[cfg(test)]
pub(crate) mod tests {
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

    fn way_m(map: &OccupancyMap, terrain: &Terrain, from_m: [f64; 2], to_m: [f64; 2]) -> Vec<[f64; 2]> {
        map.index_of(to_m).map_or(Vec::new(), |to| Travel::from(map, terrain, from_m).path_m(map, terrain, to))
    }

    #[test]
    fn a_robot_passes_a_door_that_is_wider_than_itself() {
        for (door, passes) in [(9, true), (7, true), (3, false)] {
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
        assert!((travel.cost_m(&map, &terrain, to).unwrap() - 1.0).abs() < 1e-9);
        let way = travel.path_m(&map, &terrain, to);
        assert!((way.last().unwrap()[0] - 2.05).abs() < 1e-9 && way.len() == 6);
        assert!(travel.cost_m(&map, &terrain, map.index_of([3.15, 2.5]).unwrap()).is_none(), "in the wall");
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
    fn who_got_in_gets_out() {
        use crate::map::SharedMap;
        use mapwright_geom::Pose2;
        use mapwright_grid::Change;
        use mapwright_sensor::SweepPoints;
        // A wall from y = -3 to 3 at x = 2 with a gap of 0.4 m, seen from the left; behind it and around another wall.
        let hits = |gap: bool| {
            let mut hits: Vec<[f64; 2]> = (0..=600).map(|k| [2.0, 0.01 * f64::from(k - 300)]).collect();
            hits.retain(|[_, y]| !gap || y.abs() > 0.2);
            if gap {
                hits.extend((0..40).map(|k| [4.0, 0.01 * f64::from(k - 20)]));
            }
            SweepPoints { normals: vec![[0.0; 2]; hits.len()], hits, ..SweepPoints::default() }
        };
        let mut shared = SharedMap::new(0.1, 12);
        (0..3).for_each(|_| assert!(shared.draw(&hits(true), Pose2::IDENTITY, Change::Add)));
        let is_linked = |shared: &SharedMap| {
            let terrain = Terrain::new(shared.map(), 0.22);
            !way_m(shared.map(), &terrain, [3.0, 0.05], [0.8, 0.05]).is_empty()
        };
        assert!(!is_linked(&shared), "narrower than the robot");
        (0..60).for_each(|k| shared.stand([0.5 + 0.05 * f64::from(k), 0.02]));
        assert!(is_linked(&shared), "one has passed");
        shared.feel([2.05, 0.05], 0.44, f64::INFINITY);
        assert!(!is_linked(&shared), "one has died in the gap");
    }

    #[test]
    fn blocks_reach_what_cells_reach() {
        use mapwright_sim::Rng;
        let (width, height) = (41, 37);
        for seed in 0..20 {
            let mut rng = Rng::keyed(seed, 1);
            let cells = (0..width * height).map(|_| if rng.chance(0.42) { Cell::Occupied } else { Cell::Free });
            let map = OccupancyMap::new([0.0; 2], 0.1, width, cells.collect()).unwrap();
            let terrain = Terrain::new(&map, 0.0);
            let first = map.inner().find(|&index| terrain.weight[index] > 0).unwrap();
            let (mut reached, mut next) = (vec![first], 0);
            while let Some(&cell) = reached.get(next) {
                next += 1;
                for near in map.around(cell) {
                    if terrain.weight[near] > 0 && !reached.contains(&near) {
                        reached.push(near);
                    }
                }
            }
            let travel = Travel::from(&map, &terrain, map.center_m(first));
            for index in map.inner() {
                let is_reached = travel.cost_m(&map, &terrain, index).is_some();
                assert_eq!(is_reached, reached.contains(&index), "seed {seed}, cell {index}");
            }
        }
    }
}
