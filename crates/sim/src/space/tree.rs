//! A tree of boxes around boxes, four to a node, through which rays fall quickly.

use super::solid::{Point3, Ray, Solid};

/// Children of a node.
const WIDE: usize = 4;
/// Marks a child that is a solid, and one that is a turned solid.
const SOLID: u32 = 1 << 31;
const TURNED: u32 = 1 << 30;
/// As deep as any ray's list of nodes to come may get: three for each level of a tree of 2^30 solids.
const STACK: usize = 96;
/// Single precision is out by less than this share of a coordinate; bounds are wider by it.
const ROUNDING: f64 = 2e-7;

type Lanes = [f32; WIDE];

#[derive(Debug, Clone, Copy)]
struct Node {
    /// Bounds of the children: low and high, by axis, by child.
    bounds: [[Lanes; 3]; 2],
    child: [u32; WIDE],
}

/// The tree (bounding volume hierarchy, split by surface area: MacDonald and Booth 1990).
#[derive(Debug, Clone)]
pub(crate) struct Tree {
    nodes: Vec<Node>,
}

/// A solid's number and bounds while the tree is built.
#[derive(Clone, Copy)]
struct Item {
    number: u32,
    low: Point3,
    high: Point3,
}

impl Tree {
    pub(crate) fn new(solids: &[Solid]) -> Self {
        let item = |(number, solid): (usize, &Solid)| {
            let [low, high] = solid.bounds();
            let mark = if solid.is_aligned() { SOLID } else { SOLID | TURNED };
            Item { number: number as u32 | mark, low, high }
        };
        let mut items: Vec<Item> = solids.iter().enumerate().map(item).collect();
        let mut tree = Self { nodes: Vec::new() };
        tree.add(&mut items);
        tree
    }

    /// Adds the node of these items and all below it.
    fn add(&mut self, items: &mut [Item]) -> u32 {
        let number = self.nodes.len();
        let nothing = [[[f32::INFINITY; WIDE]; 3], [[f32::NEG_INFINITY; WIDE]; 3]];
        self.nodes.push(Node { bounds: nothing, child: [0; WIDE] });
        for (k, group) in groups(items).into_iter().enumerate() {
            let (low, high) = around(group);
            let child = if let [item] = group { item.number } else { self.add(group) };
            let node = &mut self.nodes[number];
            for axis in 0..3 {
                node.bounds[0][axis][k] = (low[axis] - ROUNDING * low[axis].abs()) as f32;
                node.bounds[1][axis][k] = (high[axis] + ROUNDING * high[axis].abs()) as f32;
            }
            node.child[k] = child;
        }
        number as u32
    }

    /// The first solid on a ray's way, and roughly how far it is, in lengths of the direction.
    pub(crate) fn cast(&self, solids: &[Solid], ray: &Ray, far: f64) -> Option<(usize, f64)> {
        let slabs = Slabs::new(ray);
        let mut best = (far as f32, 0);
        let mut stack = [(0.0_f32, 0_u32); STACK];
        let mut waiting = 1;
        while waiting > 0 {
            waiting -= 1;
            let (near, number) = stack[waiting];
            if near >= best.0 {
                continue;
            }
            let node = &self.nodes[number as usize];
            let entry = slabs.enter(node, best.0);
            let before = waiting;
            for k in 0..WIDE {
                let (near, child) = (entry[k], node.child[k]);
                if near >= best.0 {
                    continue;
                }
                if child & TURNED != 0 {
                    let solid = &solids[(child & !(SOLID | TURNED)) as usize];
                    if let Some(at) = solid.cast(ray).filter(|at| (*at as f32) < best.0) {
                        best = (at as f32, child);
                    }
                } else if child & SOLID != 0 {
                    best = (near, child);
                } else {
                    stack[waiting] = (near, child);
                    waiting += 1;
                    // the nearest comes last and is looked at first
                    let mut at = waiting - 1;
                    while at > before && stack[at - 1].0 < stack[at].0 {
                        stack.swap(at - 1, at);
                        at -= 1;
                    }
                }
            }
        }
        (best.1 != 0).then(|| ((best.1 & !(SOLID | TURNED)) as usize, f64::from(best.0)))
    }
}

/// A ray ready to be held against bounds.
struct Slabs {
    origin: [f32; 3],
    inverse: [f32; 3],
    /// Which of the two bounds of an axis is met first.
    first: [usize; 3],
}

impl Slabs {
    fn new(ray: &Ray) -> Self {
        Self {
            origin: ray.origin.map(|v| v as f32),
            inverse: ray.inverse.map(|v| v as f32),
            first: ray.inverse.map(|v| usize::from(v < 0.0)),
        }
    }

    /// Where the children of a node are entered; infinite for those that are missed.
    #[inline]
    fn enter(&self, node: &Node, far: f32) -> Lanes {
        let (mut near, mut exit) = ([0.0_f32; WIDE], [far; WIDE]);
        for axis in 0..3 {
            let (origin, inverse, first) = (self.origin[axis], self.inverse[axis], self.first[axis]);
            let (enter, leave) = (&node.bounds[first][axis], &node.bounds[1 - first][axis]);
            for k in 0..WIDE {
                let a = (enter[k] - origin) * inverse;
                let b = (leave[k] - origin) * inverse;
                near[k] = if a > near[k] { a } else { near[k] };
                exit[k] = if b < exit[k] { b } else { exit[k] };
            }
        }
        std::array::from_fn(|k| if near[k] <= exit[k] { near[k] } else { f32::INFINITY })
    }
}

fn around(items: &[Item]) -> (Point3, Point3) {
    items.iter().fold(([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]), |(low, high), item| grown(low, high, item))
}

fn grown(low: Point3, high: Point3, item: &Item) -> (Point3, Point3) {
    (std::array::from_fn(|k| low[k].min(item.low[k])), std::array::from_fn(|k| high[k].max(item.high[k])))
}

/// Half the surface of a box.
fn surface((low, high): (Point3, Point3)) -> f64 {
    let [x, y, z]: Point3 = std::array::from_fn(|k| high[k] - low[k]);
    x * y + y * z + z * x
}

/// The items in up to four groups: whatever is cheapest in two, and the costlier groups in two again.
fn groups(items: &mut [Item]) -> Vec<&mut [Item]> {
    if items.is_empty() {
        return Vec::new();
    }
    let mut groups = vec![items];
    while groups.len() < WIDE {
        let cost = |group: &[Item]| if group.len() > 1 { surface(around(group)) } else { -1.0 };
        let costs: Vec<f64> = groups.iter().map(|group| cost(group)).collect();
        let dearest = (1..groups.len()).fold(0, |best, k| if costs[k] > costs[best] { k } else { best });
        if costs[dearest] < 0.0 {
            break;
        }
        let (left, right) = split(groups.swap_remove(dearest));
        groups.extend([left, right]);
    }
    groups
}

fn split(items: &mut [Item]) -> (&mut [Item], &mut [Item]) {
    let best = (0..3)
        .map(|axis| best_split(items, axis))
        .fold((f64::INFINITY, 0, 1), |best, found| if found.0 < best.0 { found } else { best });
    sort(items, best.1);
    items.split_at_mut(best.2)
}

fn sort(items: &mut [Item], axis: usize) {
    items.sort_by(|a, b| {
        (a.low[axis] + a.high[axis]).total_cmp(&(b.low[axis] + b.high[axis])).then(a.number.cmp(&b.number))
    });
}

/// Cost, axis and size of the first part.
fn best_split(items: &mut [Item], axis: usize) -> (f64, usize, usize) {
    sort(items, axis);
    let nothing = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    let sweep = |bounds: &mut (Point3, Point3), item: &Item| {
        *bounds = grown(bounds.0, bounds.1, item);
        Some(surface(*bounds))
    };
    let ahead: Vec<f64> = items.iter().scan(nothing, sweep).collect();
    let mut behind: Vec<f64> = items.iter().rev().scan(nothing, sweep).collect();
    behind.reverse();
    let cost = |first: usize| ahead[first - 1] * first as f64 + behind[first] * (items.len() - first) as f64;
    let costs = (1..items.len()).map(|first| (cost(first), axis, first));
    costs.fold((f64::INFINITY, axis, 1), |best, found| if found.0 < best.0 { found } else { best })
}
