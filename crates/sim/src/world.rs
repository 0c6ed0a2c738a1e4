//! A world: walls and furniture that stand still, doors that open and close, people who walk.

use crate::grid::Grid;
use crate::math::{Point, distance, lerp};
use crate::shape::{Circle, Segment};

/// People step aside until this far from the laser, metres.
const PERSONAL_SPACE_M: f64 = 0.6;

/// When something is there, in seconds since the start of the recording.
#[derive(Debug, Clone, PartialEq)]
pub enum Schedule {
    /// At all times.
    Always,
    /// From the first to the second number of each pair.
    During(Vec<[f64; 2]>),
    /// There for `present_s`, gone for `absent_s`, for ever; `phase_s` into that cycle at time zero.
    Repeating {
        /// How long it is there, seconds.
        present_s: f64,
        /// How long it is gone, seconds.
        absent_s: f64,
        /// Where in the cycle time zero lies, seconds.
        phase_s: f64,
    },
}

impl Schedule {
    /// Whether the thing is there at the time.
    #[must_use]
    pub fn holds(&self, time_s: f64) -> bool {
        match self {
            Self::Always => true,
            Self::During(spans) => spans.iter().any(|span| span[0] <= time_s && time_s < span[1]),
            Self::Repeating { present_s, absent_s, phase_s } => {
                (time_s + phase_s).rem_euclid(present_s + absent_s) < *present_s
            }
        }
    }
}

/// A door: one leaf that is either shut or open.
#[derive(Debug, Clone, PartialEq)]
pub struct Door {
    /// The leaf when shut.
    pub shut: Segment,
    /// The leaf when open, where it can be seen then.
    pub open: Option<Segment>,
    /// When it is shut.
    pub shut_when: Schedule,
}

impl Door {
    /// Every position its leaf is ever in.
    pub(crate) fn leaves(&self) -> impl Iterator<Item = Segment> {
        let never_shut = self.shut_when == Schedule::During(Vec::new());
        (!never_shut).then_some(self.shut).into_iter().chain(self.open)
    }

    fn leaf(&self, time_s: f64) -> Option<Segment> {
        if self.shut_when.holds(time_s) { Some(self.shut) } else { self.open }
    }
}

/// A person who walks a path to and fro.
#[derive(Debug, Clone, PartialEq)]
pub struct Walker {
    path: Vec<Point>,
    along_m: Vec<f64>,
    /// Walking speed, metres a second.
    pub speed_m_per_s: f64,
    /// How far along the path at time zero, metres.
    pub start_m: f64,
    /// Radius of the body, metres.
    pub radius_m: f64,
}

impl Walker {
    /// A person of radius 0.25 m at the start of `path` at time zero.
    #[must_use]
    pub fn new(path: Vec<Point>, speed_m_per_s: f64) -> Self {
        let mut along_m = vec![0.0];
        for leg in path.windows(2) {
            along_m.push(along_m[along_m.len() - 1] + distance(leg[0], leg[1]));
        }
        Self { path, along_m, speed_m_per_s, start_m: 0.0, radius_m: 0.25 }
    }

    /// Where the person is; `None` for an empty path.
    #[must_use]
    pub fn at(&self, time_s: f64) -> Option<Circle> {
        let length_m = self.along_m[self.along_m.len() - 1];
        let walked_m = (self.start_m + self.speed_m_per_s * time_s).rem_euclid((2.0 * length_m).max(1e-9));
        let at_m = if walked_m > length_m { (2.0 * length_m - walked_m).max(0.0) } else { walked_m };
        Some(Circle { center: self.point_at(at_m)?, radius_m: self.radius_m })
    }

    fn point_at(&self, at_m: f64) -> Option<Point> {
        let next = self.along_m.partition_point(|&m| m <= at_m);
        let (Some(&to), Some(&to_m)) = (self.path.get(next), self.along_m.get(next)) else {
            return self.path.last().copied();
        };
        let from_m = self.along_m[next - 1];
        Some(lerp(self.path[next - 1], to, (at_m - from_m) / (to_m - from_m)))
    }
}

/// Everything a laser can see.
#[derive(Debug, Clone)]
pub struct World {
    segments: Vec<Segment>,
    circles: Vec<Circle>,
    doors: Vec<Door>,
    /// Around each door's leaf, shut and open.
    door_boxes: Vec<Bounds>,
    walkers: Vec<Walker>,
    /// Around each walker's path.
    walker_boxes: Vec<Bounds>,
    grid: Grid,
}

/// A box that is looked at before what is in it.
#[derive(Debug, Clone, Copy)]
struct Bounds {
    low: Point,
    high: Point,
}

impl Bounds {
    fn around(points: impl Iterator<Item = Point>) -> Self {
        let start = Self { low: [f64::INFINITY; 2], high: [f64::NEG_INFINITY; 2] };
        points.fold(start, |b, p| Self {
            low: [b.low[0].min(p[0]), b.low[1].min(p[1])],
            high: [b.high[0].max(p[0]), b.high[1].max(p[1])],
        })
    }

    fn within(&self, reach_m: f64, point: Point) -> bool {
        (0..2).all(|axis| point[axis] >= self.low[axis] - reach_m && point[axis] <= self.high[axis] + reach_m)
    }
}

impl World {
    /// A world that stands still.
    #[must_use]
    pub fn new(segments: Vec<Segment>, circles: Vec<Circle>) -> Self {
        let grid = Grid::new(&segments, &circles);
        let (doors, walkers) = (Vec::new(), Vec::new());
        Self { segments, circles, doors, door_boxes: Vec::new(), walkers, walker_boxes: Vec::new(), grid }
    }

    /// The same with doors added.
    #[must_use]
    pub fn with_doors(mut self, doors: impl IntoIterator<Item = Door>) -> Self {
        self.doors.extend(doors);
        let leaves = |door: &Door| Bounds::around(std::iter::once(door.shut).chain(door.open).flat_map(|l| [l.a, l.b]));
        self.door_boxes = self.doors.iter().map(leaves).collect();
        self
    }

    pub(crate) fn without_doors(mut self) -> Self {
        self.doors.clear();
        self.door_boxes.clear();
        self
    }

    /// The same with its doors standing still: open those that are shut at times only.
    pub(crate) fn with_doors_settled(mut self) -> Self {
        for door in &mut self.doors {
            if door.shut_when != Schedule::Always {
                door.shut_when = Schedule::During(Vec::new());
            }
        }
        self
    }

    /// The same with people added.
    #[must_use]
    pub fn with_walkers(mut self, walkers: impl IntoIterator<Item = Walker>) -> Self {
        self.walkers.extend(walkers);
        self.walker_boxes = self.walkers.iter().map(|walker| Bounds::around(walker.path.iter().copied())).collect();
        self
    }

    /// Walls and furniture edges that stand still.
    #[must_use]
    pub fn segments(&self) -> &[Segment] {
        &self.segments
    }

    /// Round things that stand still.
    #[must_use]
    pub fn circles(&self) -> &[Circle] {
        &self.circles
    }

    /// Doors.
    #[must_use]
    pub fn doors(&self) -> &[Door] {
        &self.doors
    }

    /// People.
    #[must_use]
    pub fn walkers(&self) -> &[Walker] {
        &self.walkers
    }

    /// Distance to the first thing that stands still, metres; infinite where there is none within `longest_m`.
    pub(crate) fn cast_still(&self, origin: Point, direction: Point, longest_m: f64) -> f64 {
        self.grid.cast(origin, direction, longest_m)
    }

    /// The world at one time, ready for rays of at most `longest_m` from about `viewpoint`.
    ///
    /// People nearer than 0.6 m to the viewpoint step aside.
    #[must_use]
    pub fn at(&self, time_s: f64, viewpoint: Point, longest_m: f64) -> Moment<'_> {
        let doors = self.doors.iter().zip(&self.door_boxes).filter(|(_, near)| near.within(longest_m, viewpoint));
        let leaves = doors.filter_map(|(door, _)| door.leaf(time_s)).map(Mover::Leaf);
        let walkers = self.walkers.iter().zip(&self.walker_boxes);
        // A person who steps aside only comes into reach from well within it.
        let walkers = walkers.filter(|(w, near)| near.within(longest_m + w.radius_m + PERSONAL_SPACE_M, viewpoint));
        let people = walkers.filter_map(|(walker, _)| walker.at(time_s));
        let people = people.map(|person| Mover::Person(person.kept_from(viewpoint, PERSONAL_SPACE_M)));
        let mut moment = Moment { grid: &self.grid, viewpoint, longest_m, movers: Vec::new() };
        leaves.chain(people).for_each(|mover| moment.admit(mover));
        moment.movers.sort_by(|a, b| a.0.total_cmp(&b.0));
        moment
    }
}

/// What does not stand still.
#[derive(Debug, Clone, Copy)]
enum Mover {
    Leaf(Segment),
    Person(Circle),
}

impl Mover {
    fn distance_to_point(&self, point: Point) -> f64 {
        match self {
            Self::Leaf(leaf) => leaf.distance_to_point(point),
            Self::Person(person) => distance(person.center, point) - person.radius_m,
        }
    }

    fn cast(&self, origin: Point, direction: Point) -> f64 {
        match self {
            Self::Leaf(leaf) => leaf.cast(origin, direction),
            Self::Person(person) => person.cast(origin, direction),
        }
    }
}

/// A world at one time.
#[derive(Debug, Clone)]
pub struct Moment<'a> {
    grid: &'a Grid,
    viewpoint: Point,
    longest_m: f64,
    /// With their distances from the viewpoint, nearest first.
    movers: Vec<(f64, Mover)>,
}

impl Moment<'_> {
    /// The same with other round things in it, such as robots.
    #[must_use]
    pub fn with_others(mut self, others: impl IntoIterator<Item = Circle>) -> Self {
        others.into_iter().for_each(|other| self.admit(Mover::Person(other)));
        self.movers.sort_by(|a, b| a.0.total_cmp(&b.0));
        self
    }

    /// The same with one more person in it.
    #[must_use]
    pub fn with_person(mut self, person: Circle) -> Self {
        self.admit(Mover::Person(person));
        self.movers.sort_by(|a, b| a.0.total_cmp(&b.0));
        self
    }

    fn admit(&mut self, mover: Mover) {
        let away_m = mover.distance_to_point(self.viewpoint);
        if away_m <= self.longest_m {
            self.movers.push((away_m, mover));
        }
    }

    /// Distance to the first thing along the ray from `origin` in unit `direction`, metres; infinite where there is
    /// none within reach. Doors and people are seen from within `longest_m` of the viewpoint.
    #[must_use]
    pub fn cast(&self, origin: Point, direction: Point) -> f64 {
        let mut nearest_m = self.grid.cast(origin, direction, self.longest_m);
        let moved_m = (origin[0] - self.viewpoint[0]).abs() + (origin[1] - self.viewpoint[1]).abs();
        for (away_m, mover) in &self.movers {
            if away_m - moved_m > nearest_m {
                break;
            }
            nearest_m = nearest_m.min(mover.cast(origin, direction));
        }
        if nearest_m <= self.longest_m { nearest_m } else { f64::INFINITY }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rotate;
    use crate::rng::Rng;

    fn clutter(rng: &mut Rng) -> (Vec<Segment>, Vec<Circle>) {
        let mut point = || [rng.uniform(0.0, 40.0), rng.uniform(0.0, 30.0)];
        let mut segments: Vec<Segment> = (0..60).map(|_| Segment { a: point(), b: point() }).collect();
        segments.extend((0..100).map(|_| point()).map(|[x, y]| Segment { a: [x, y], b: [x + 1.5, y] }));
        segments.push(Segment { a: [10.0, 5.0], b: [10.0, 25.0] });
        let circles = (0..40).map(|k| Circle { center: point(), radius_m: 0.02 * f64::from(k) }).collect();
        (segments, circles)
    }

    #[test]
    fn the_grid_equals_looking_at_everything() {
        let mut rng = Rng::new(3);
        let (segments, circles) = clutter(&mut rng);
        let world = World::new(segments.clone(), circles.clone());
        for k in 0..10_000 {
            let origin = [rng.uniform(-10.0, 50.0), rng.uniform(-10.0, 40.0)];
            let angle_rad = if k % 10 == 0 { f64::from(k % 40) * 0.157_079_632_679 } else { rng.uniform(-3.2, 3.2) };
            let direction = if k % 100 == 0 { [0.0, 1.0] } else { rotate([1.0, 0.0], angle_rad) };
            let by_segment = segments.iter().map(|s| s.cast(origin, direction));
            let by_circle = circles.iter().map(|c| c.cast(origin, direction));
            let nearest_m = by_segment.chain(by_circle).fold(f64::INFINITY, f64::min);
            let expected = if nearest_m <= 30.0 { nearest_m } else { f64::INFINITY };
            assert_eq!(world.at(0.0, origin, 30.0).cast(origin, direction), expected, "ray {k}");
        }
    }

    #[test]
    fn odd_rays_are_survived() {
        let world = World::new(vec![], vec![]);
        let moment = world.at(0.0, [0.0; 2], 30.0);
        for direction in [[0.0, 0.0], [f64::NAN, 1.0], [1.0, 0.0]] {
            assert_eq!(moment.cast([0.5, 0.5], direction), f64::INFINITY);
            assert_eq!(moment.cast([f64::NAN, f64::INFINITY], direction), f64::INFINITY);
        }
    }

    #[test]
    fn doors_follow_their_schedule_and_people_walk() {
        let shut = Segment { a: [2.0, -1.0], b: [2.0, 1.0] };
        let open = Some(Segment { a: [2.0, 1.0], b: [4.0, 1.0] });
        let door = Door { shut, open, shut_when: Schedule::During(vec![[10.0, 20.0]]) };
        let walker = Walker::new(vec![[8.0, 0.0], [12.0, 0.0]], 1.0);
        let world = World::new(vec![], vec![]).with_doors([door]).with_walkers([walker]);
        let ahead = |time_s: f64| world.at(time_s, [0.0; 2], 30.0).cast([0.0; 2], [1.0, 0.0]);
        assert_eq!(ahead(0.0), 7.75);
        assert_eq!(ahead(3.0), 10.75);
        assert_eq!(ahead(15.0), 2.0);
        assert_eq!(ahead(21.0), 10.75);
        let cycle = Schedule::Repeating { present_s: 2.0, absent_s: 3.0, phase_s: 1.0 };
        assert_eq!([0.0, 1.5, 4.5].map(|t| cycle.holds(t)), [true, false, true]);
    }
}
