//! Buildings made to deceive: places that look the same and are not.

use crate::band::WALL_M;
use crate::build::{Builder, Frame};
use crate::drive::{Drive, DriveSettings};
use crate::furnish::{Inside, corridor_piece, furnish};
use crate::math::{Point, add, between, compose, distance, lerp, scale};
use crate::odometry::OdometryNoise;
use crate::rng::Rng;
use crate::route::{Route, Site};
use crate::shape::{Circle, Segment};
use crate::views::{Revisits, true_path};
use crate::world::World;
use mapwright_geom::{Pose2, Stamp, wrap_angle};
use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

/// What looks alike.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LookAlikeKind {
    /// Two of three parallel corridors are the same.
    ParallelCorridors,
    /// A floor that a half or quarter turn maps to itself.
    SymmetricFloor,
    /// A corridor with rooms of one shape and the same furniture.
    RepeatedRooms,
}

/// A place and its look-alike, both on the way of one drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Alias {
    /// When the drive first comes through the one place.
    pub original: Stamp,
    /// When it first comes through the other.
    pub copy: Stamp,
    /// The relative pose of the robot at the two times that a deceived closure would find.
    pub deceived_original_from_copy: Pose2,
    /// The true one.
    pub original_from_copy: Pose2,
    /// How far the deceived position lies from that of odometry, in sigmas of odometry's position: Mahalanobis distance by
    /// the motion model from the first to the second time. The ellipse of two sigma is where this is at most 2.
    pub position_sigmas: f64,
    /// The same for the heading.
    pub heading_sigmas: f64,
}

impl Alias {
    /// Whether odometry cannot tell: position inside the two-sigma ellipse, heading within two sigma.
    #[must_use]
    pub fn inside_two_sigma(&self) -> bool {
        self.position_sigmas <= 2.0 && self.heading_sigmas <= 2.0
    }
}

/// A building made to deceive, a drive through it, and the truth.
#[derive(Debug, Clone)]
pub struct LookAlike {
    /// What looks alike.
    pub kind: LookAlikeKind,
    /// World and way.
    pub site: Arc<Site>,
    /// The drive.
    pub settings: DriveSettings,
    /// The deception. For even seeds it lies inside the two-sigma ellipse of odometry, for odd ones outside of three.
    pub alias: Alias,
}

impl LookAlike {
    /// The recording, with its truth.
    #[must_use]
    pub fn drive(&self) -> Drive {
        Drive::new(Arc::clone(&self.site), self.settings.clone())
    }

    /// The times that truly see the same place; computed anew each time it is asked for.
    #[must_use]
    pub fn revisits(&self) -> Revisits {
        Revisits::of(&self.site, &self.settings)
    }
}

/// The look-alike of a seed: identical parallel corridors, symmetric floors and repeated rooms take turns.
///
/// For even seeds the alias lies inside the two-sigma ellipse of odometry when the robot comes there, for odd seeds
/// more than three sigma off; the wheels are made worse or better than the default ones until it is so.
#[must_use]
pub fn look_alike(seed: u64) -> LookAlike {
    let mut rng = Rng::keyed(seed, 0x616c_6961_7365);
    let (kind, plan) = match seed / 2 % 3 {
        0 => (LookAlikeKind::ParallelCorridors, parallel_corridors(&mut rng)),
        1 => (LookAlikeKind::SymmetricFloor, symmetric_floor(seed.is_multiple_of(2), &mut rng)),
        _ => (LookAlikeKind::RepeatedRooms, repeated_rooms(&mut rng)),
    };
    let site = Arc::new(Site { world: World::new(plan.shapes.segments, plan.shapes.circles), route: plan.route });
    let (settings, alias) = deceive(&site, plan.original, plan.copy_from_original, seed.is_multiple_of(2), &mut rng);
    LookAlike { kind, site, settings, alias }
}

/// A building with its way, a place on it, and the motion of the world that maps the place to its copy.
struct Plan {
    shapes: Shapes,
    route: Route,
    original: Point,
    copy_from_original: Pose2,
}

/// What stands still; built once, it may be put up as often as liked.
#[derive(Default)]
pub(super) struct Shapes {
    pub(super) segments: Vec<Segment>,
    pub(super) circles: Vec<Circle>,
}

impl Shapes {
    pub(super) fn of(builder: Builder) -> Self {
        let world = builder.build();
        Self { segments: world.segments().to_vec(), circles: world.circles().to_vec() }
    }

    /// Puts up a copy, turned by quarters of a turn about the origin, then moved.
    pub(super) fn put_up(&mut self, module: &Self, quarters: usize, moved: Point) {
        let place = |p: Point| add(turned(p, quarters), moved);
        self.segments.extend(module.segments.iter().map(|s| Segment { a: place(s.a), b: place(s.b) }));
        self.circles.extend(module.circles.iter().map(|c| Circle { center: place(c.center), ..*c }));
    }

    pub(super) fn polyline(&mut self, points: &[Point]) {
        self.segments.extend(points.windows(2).map(|pair| Segment { a: pair[0], b: pair[1] }));
    }
}

/// Exactly: no copy may differ by rounding of a sine.
pub(super) fn turned([x, y]: Point, quarters: usize) -> Point {
    match quarters % 4 {
        0 => [x, y],
        1 => [-y, x],
        2 => [-x, -y],
        _ => [y, -x],
    }
}

/// A corridor along x from `from_m` to `to_m` around y = `y_m`, walls with niches and pillars and what stands there.
pub(super) fn corridor_module(builder: &mut Builder, [from_m, to_m]: [f64; 2], y_m: f64, half_m: f64, rng: &mut Rng) {
    builder.reserve(&[[from_m, y_m], [to_m, y_m]]);
    for side in [-1.0, 1.0] {
        let wall_m = y_m + side * half_m;
        builder.feature_wall([from_m, wall_m], [to_m, wall_m], [0.0, side], 3.5, rng);
        let wall = Frame { origin: [from_m, wall_m], u: [1.0, 0.0], v: [0.0, -side] };
        for _ in 0..1 + ((to_m - from_m) / 9.0) as usize {
            corridor_piece(builder, &wall, rng.uniform(1.5, (to_m - from_m - 1.5).max(1.6)), rng);
        }
    }
}

/// A ladder of three corridors, the lower two the same, between two connecting ones.
fn parallel_corridors(rng: &mut Rng) -> Plan {
    let (long_m, pitch_m, half_m) = (rng.uniform(22.0, 40.0), rng.uniform(8.0, 12.0), rng.uniform(0.95, 1.25));
    let module = |rng: &mut Rng| {
        let mut builder = Builder::new();
        corridor_module(&mut builder, [half_m, long_m - half_m], 0.0, half_m, rng);
        Shapes::of(builder)
    };
    let (same, other) = (module(rng), module(rng));
    let mut shapes = Shapes::default();
    shapes.put_up(&same, 0, [0.0, 0.0]);
    shapes.put_up(&same, 0, [0.0, pitch_m]);
    shapes.put_up(&other, 0, [0.0, 2.0 * pitch_m]);
    let (low_m, high_m) = (-half_m, 2.0 * pitch_m + half_m);
    let mut outside = Builder::new();
    outside.feature_wall([-half_m, low_m], [-half_m, high_m], [-1.0, 0.0], 5.0, rng);
    outside.feature_wall([long_m + half_m, low_m], [long_m + half_m, high_m], [1.0, 0.0], 5.0, rng);
    shapes.put_up(&Shapes::of(outside), 0, [0.0, 0.0]);
    for x_m in [0.0, long_m] {
        for y_m in [low_m, high_m] {
            shapes.polyline(&[[x_m - half_m, y_m], [x_m + half_m, y_m]]);
        }
        let inner_m = if x_m == 0.0 { half_m } else { long_m - half_m };
        for row in [0.0, 1.0] {
            shapes.polyline(&[[inner_m, row * pitch_m + half_m], [inner_m, (row + 1.0) * pitch_m - half_m]]);
        }
    }
    let [a, b, c] = [0.0, pitch_m, 2.0 * pitch_m];
    let first = [[2.0, a], [long_m, a], [long_m, c], [0.0, c], [0.0, b], [long_m, b]];
    let again = [[long_m, c], [0.0, c], [0.0, a], [long_m, a], [long_m, b]];
    let route = Route::new(first.into_iter().chain(again).collect());
    Plan { shapes, route, original: [0.5 * long_m, a], copy_from_original: Pose2::new(0.0, pitch_m, 0.0) }
}

/// A ring of corridors of twofold or fourfold symmetry, driven around twice; a large one gives odometry the time to get
/// lost before the copy.
fn symmetric_floor(large: bool, rng: &mut Rng) -> Plan {
    let half_m = rng.uniform(0.95, 1.25);
    let fourfold = rng.chance(0.5);
    let a_m = match (large, fourfold) {
        (false, _) => rng.uniform(8.0, 13.0),
        (true, true) => rng.uniform(14.0, 19.0),
        (true, false) => rng.uniform(22.0, 28.0),
    };
    let b_m = if fourfold { a_m } else { a_m * rng.uniform(0.6, 0.85) };
    let mut shapes = Shapes::default();
    // A fourfold floor repeats its lower side, a twofold one its lower and right sides.
    let lower = ring_side(a_m, b_m, half_m, rng);
    if fourfold {
        (0..4).for_each(|quarters| shapes.put_up(&lower, quarters, [0.0, 0.0]));
    } else {
        let right = ring_side(b_m, a_m, half_m, rng);
        for half_turn in [0, 2] {
            shapes.put_up(&lower, half_turn, [0.0, 0.0]);
            shapes.put_up(&right, half_turn + 1, [0.0, 0.0]);
        }
    }
    let corners = [[a_m, -b_m], [a_m, b_m], [-a_m, b_m], [-a_m, -b_m]];
    let mut way = vec![[-0.6 * a_m, -b_m]];
    way.extend(corners.iter().chain(&corners));
    way.push([0.5 * a_m, -b_m]);
    let quarters = match (large, fourfold) {
        (_, false) => 2,
        (true, true) => 3,
        (false, true) => 1 + rng.below(3),
    };
    let copy_from_original = Pose2::new(0.0, 0.0, quarters as f64 * FRAC_PI_2);
    Plan { shapes, route: Route::new(way), original: [0.1 * a_m, -b_m], copy_from_original }
}

/// The lower side of a ring around the origin.
fn ring_side(a_m: f64, b_m: f64, half_m: f64, rng: &mut Rng) -> Shapes {
    let mut builder = Builder::new();
    builder.reserve(&[[-a_m, b_m], [-a_m, -b_m], [a_m, -b_m], [a_m, b_m]]);
    for (side, end_m) in [(-1.0, a_m + half_m), (1.0, a_m - half_m)] {
        let y_m = -b_m + side * half_m;
        builder.feature_wall([-end_m, y_m], [end_m, y_m], [0.0, side], 3.0, rng);
        let wall = Frame { origin: [0.0, y_m], u: [1.0, 0.0], v: [0.0, -side] };
        for _ in 0..1 + (a_m / 6.0) as usize {
            corridor_piece(&mut builder, &wall, rng.uniform(2.0 - a_m, a_m - 2.0), rng);
        }
    }
    Shapes::of(builder)
}

/// A ring of corridors with the same room over and over along one side. The drive starts at one of the rooms, goes
/// around, comes to another of them from the other end of the row, and then to the first again.
fn repeated_rooms(rng: &mut Rng) -> Plan {
    let half_m = rng.uniform(0.95, 1.3);
    let (width_m, depth_m, count) = (rng.uniform(4.6, 6.6), rng.uniform(4.5, 6.5), 4 + rng.below(3));
    let door_m = rng.uniform(1.0, width_m - 1.0);
    let goal = [rng.uniform(1.4, width_m - 1.4), half_m + depth_m * rng.uniform(0.6, 0.75)];
    let room = [[door_m, 0.0], [door_m, half_m + 1.4], goal];
    let mut shapes = Shapes::default();
    let module = room_module(&room, width_m, depth_m, half_m, rng);
    let at = |k: usize| k as f64 * width_m;
    (0..count).for_each(|k| shapes.put_up(&module, 0, [at(k), 0.0]));
    let end_m = at(count);
    shapes.polyline(&[[end_m, half_m + depth_m], [end_m, half_m]]);
    let (left_m, right_m, low_m) = (-1.5, end_m + 1.5, -rng.uniform(14.0, 22.0));
    shapes.put_up(&way_back(end_m, [left_m, right_m], low_m, half_m, rng), 0, [0.0, 0.0]);
    let visit = |k: usize| {
        let way = room.map(|p| add(p, [at(k), 0.0]));
        [way[0], way[1], way[2], way[1], way[0]]
    };
    let first = 2 + rng.below(count - 2);
    let second = rng.below(first);
    let mut way = vec![[at(first) + door_m - 0.6, 0.0]];
    way.extend(visit(first));
    way.extend([[right_m, 0.0], [right_m, low_m], [left_m, low_m], [left_m, 0.0]]);
    way.extend(visit(second));
    way.extend(visit(first));
    way.extend([[right_m, 0.0], [right_m, 0.5 * low_m]]);
    let original = add(lerp(room[1], room[2], 0.5), [at(first), 0.0]);
    let copy_from_original = Pose2::new(at(second) - at(first), 0.0, 0.0);
    Plan { shapes, route: Route::new(way), original, copy_from_original }
}

/// From the right end of a row of rooms down, back, and up to its left end.
pub(super) fn way_back(end_m: f64, [left_m, right_m]: [f64; 2], low_m: f64, half_m: f64, rng: &mut Rng) -> Shapes {
    let mut builder = Builder::new();
    builder.polyline(&[[left_m - half_m, half_m], [0.0, half_m]]);
    builder.polyline(&[[end_m, half_m], [right_m + half_m, half_m]]);
    builder.polyline(&[[left_m + half_m, -half_m], [0.0, -half_m]]);
    builder.polyline(&[[end_m, -half_m], [right_m - half_m, -half_m]]);
    for (side, edge_m) in [(1.0, half_m), (-1.0, -half_m)] {
        let (top_m, bottom_m) = (edge_m, low_m - edge_m);
        let (x0, x1) = (left_m - edge_m, right_m + edge_m);
        builder.feature_wall([x1, top_m], [x1, bottom_m], [side, 0.0], 3.5, rng);
        builder.feature_wall([x0, top_m], [x0, bottom_m], [-side, 0.0], 3.5, rng);
        builder.feature_wall([x0, bottom_m], [x1, bottom_m], [0.0, -side], 3.5, rng);
    }
    builder.reserve(&[[right_m, 0.0], [right_m, low_m], [left_m, low_m], [left_m, 0.0]]);
    let wall = Frame { origin: [0.0, low_m - half_m], u: [1.0, 0.0], v: [0.0, 1.0] };
    for _ in 0..3 {
        corridor_piece(&mut builder, &wall, rng.uniform(0.0, end_m), rng);
    }
    Shapes::of(builder)
}

/// One room above a corridor along x, and the corridor before it.
pub(super) fn room_module(way: &[Point; 3], width_m: f64, depth_m: f64, half_m: f64, rng: &mut Rng) -> Shapes {
    let mut builder = Builder::new();
    builder.reserve(way);
    builder.reserve(&[[0.0, 0.0], [width_m, 0.0]]);
    let door_m = way[0][0];
    builder.wall([0.0, half_m], [width_m, half_m], WALL_M, &[[door_m - 0.5, door_m + 0.5]]);
    builder.wall([0.0, half_m], [0.0, half_m + depth_m], WALL_M, &[]);
    builder.wall([0.0, half_m + depth_m], [width_m, half_m + depth_m], WALL_M, &[]);
    builder.feature_wall([0.0, -half_m], [width_m, -half_m], [0.0, -1.0], 2.5, rng);
    let frame = Frame { origin: [0.5 * WALL_M, half_m + 0.5 * WALL_M], u: [1.0, 0.0], v: [0.0, 1.0] };
    let inside = Inside { frame, width_m: width_m - WALL_M, depth_m: depth_m - WALL_M };
    furnish(&mut builder, &inside, rng);
    Shapes::of(builder)
}

/// Makes the wheels as bad, or as good, as it takes to have the alias inside the ellipse, or outside.
fn deceive(
    site: &Arc<Site>,
    original: Point,
    copy_from_original: Pose2,
    inside: bool,
    rng: &mut Rng,
) -> (DriveSettings, Alias) {
    let settings = DriveSettings { seed: rng.next_u64(), ..DriveSettings::long_drive(0) };
    let factor = |k: i32| if inside { 1.3f64.powi(k) } else { 0.75f64.powi(k) };
    let tries = (0..30).flat_map(|k| (0..8u64).map(move |again| (k, again)));
    let mut best = None;
    for (k, again) in tries {
        let odometry = OdometryNoise::default().times(factor(k));
        let settings = DriveSettings { odometry, seed: settings.seed ^ again, ..settings.clone() };
        let alias = alias(site, &settings, original, copy_from_original);
        let done = alias.is_some_and(|alias| if inside { snug(&alias) } else { alias.position_sigmas > 3.0 });
        best = alias.map(|alias| (settings, alias));
        if done {
            break;
        }
    }
    best.unwrap_or((settings, NOWHERE))
}

/// Inside with something to spare.
fn snug(alias: &Alias) -> bool {
    alias.position_sigmas < 1.9 && alias.heading_sigmas < 1.9
}

/// A drive that never comes through the two places.
const NOWHERE: Alias = Alias {
    original: Stamp(0),
    copy: Stamp(0),
    deceived_original_from_copy: Pose2::IDENTITY,
    original_from_copy: Pose2::IDENTITY,
    position_sigmas: f64::INFINITY,
    heading_sigmas: f64::INFINITY,
};

fn alias(site: &Arc<Site>, settings: &DriveSettings, original: Point, copy_from_original: Pose2) -> Option<Alias> {
    let path = true_path(site, settings);
    let copy = compose(copy_from_original, Pose2::new(original[0], original[1], 0.0));
    let passes = |at: Point| path.iter().position(|(_, p, _)| distance([p.x, p.y], at) < 0.4);
    let (from, to) = (passes(original)?, passes([copy.x, copy.y])?);
    let (&(original, world_from_original, odom_from_original), &(copy, world_from_copy, odom_from_copy)) =
        (path.get(from)?, path.get(to)?);
    let back = |pose: Pose2| compose(between(copy_from_original, Pose2::IDENTITY), pose);
    let deceived = between(world_from_original, back(world_from_copy));
    let reported = between(odom_from_original, odom_from_copy);
    let cov = settings.odometry.covariance(path.get(from..=to)?.iter().map(|&(_, _, odom)| odom));
    let [dx, dy] = add([deceived.x, deceived.y], scale([reported.x, reported.y], -1.0));
    let determinant = cov[(0, 0)] * cov[(1, 1)] - cov[(0, 1)] * cov[(1, 0)];
    let squared = (cov[(1, 1)] * dx * dx - 2.0 * cov[(0, 1)] * dx * dy + cov[(0, 0)] * dy * dy) / determinant;
    Some(Alias {
        original,
        copy,
        deceived_original_from_copy: deceived,
        original_from_copy: between(world_from_original, world_from_copy),
        position_sigmas: squared.sqrt(),
        heading_sigmas: wrap_angle(deceived.theta - reported.theta).abs() / cov[(2, 2)].sqrt(),
    })
}
