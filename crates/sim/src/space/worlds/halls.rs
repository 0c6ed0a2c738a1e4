//! A building without end.

use super::rings::STOREY_M;
use crate::math::Point;
use crate::rng::Rng;
use crate::space::SpaceSite;
use crate::space::build::{Opening, SLAB_M, SpaceBuilder, Wall};
use crate::space::furnish::furnish_room;
use crate::space::plan::{Rect, Storey};

/// A hall's size, squares, and how many are in a row.
const HALL: [usize; 2] = [24, 16];
const ROW: usize = 10;
/// Width and height of the openings between halls, metres.
const OPENING_M: [f64; 2] = [1.8, 2.4];
/// An opening's middle is at least so far from the hall's corners, metres.
const FROM_CORNER_M: f64 = 1.6;

/// Furnished halls in a row, then in the next one back, and so on: the drive leads through each once, so that it never comes back, and
/// is at least `length_m` long, seen from above. A longer building begins with the same halls but for what stands in them.
#[must_use]
pub fn growing_halls(seed: u64, length_m: f64) -> SpaceSite {
    let mut builder = SpaceBuilder::new(1);
    let mut way = vec![Hall(0).middle_m()];
    let (mut driven_m, mut halls) = (0.0, 1);
    Hall(0).raise(&mut builder, None);
    while driven_m < length_m {
        let mut rng = Rng::keyed(seed ^ 0x6861_6c6c_7300, halls as u64);
        let opening = Hall(halls - 1).opening(&mut rng);
        Hall(halls).raise(&mut builder, Some(&opening));
        let before = way.len() - 1;
        way.extend([opening.middle_m(), Hall(halls).middle_m()]);
        driven_m += way[before..].windows(2).map(|leg| crate::math::distance(leg[0], leg[1])).sum::<f64>();
        halls += 1;
    }
    let way: Vec<[f64; 3]> = way.into_iter().map(|[x, y]| [x, y, 0.0]).collect();
    builder.reserve(&way);
    for hall in 0..halls {
        let mut rng = Rng::keyed(seed ^ 0x6675_726e_6973, hall as u64);
        furnish_room(&mut builder, 0, &storey(), Hall(hall).rect(), &mut rng);
    }
    builder.build(way)
}

fn storey() -> Storey {
    Storey { floor_m: 0.0, height_m: STOREY_M, corridor_m: OPENING_M[0], shaft_open: [false; 2], windows: false }
}

/// A hall by its number on the way.
#[derive(Clone, Copy)]
struct Hall(usize);

/// An opening to the next hall: the axis along its wall, where that stands on the other axis, its middle along it, metres.
#[derive(Clone, Copy)]
struct Passage {
    along: usize,
    across_m: f64,
    at_m: f64,
}

impl Passage {
    fn middle_m(&self) -> Point {
        if self.along == 0 { [self.at_m, self.across_m] } else { [self.across_m, self.at_m] }
    }
}

impl Hall {
    /// Column and row: every second row is driven back.
    fn place(self) -> [usize; 2] {
        let (row, at) = (self.0 / ROW, self.0 % ROW);
        [if row.is_multiple_of(2) { at } else { ROW - 1 - at }, row]
    }

    fn rect(self) -> Rect {
        let low: [usize; 2] = std::array::from_fn(|k| self.place()[k] * HALL[k]);
        Rect::new(low, std::array::from_fn(|k| low[k] + HALL[k]))
    }

    fn middle_m(self) -> Point {
        let [low, high] = self.rect().corners_m();
        std::array::from_fn(|k| 0.5 * (low[k] + high[k]))
    }

    /// Where the next hall is entered.
    fn opening(self, rng: &mut Rng) -> Passage {
        let ([low, high], (along, across_m)) = (self.rect().corners_m(), self.way_out());
        let at_m = rng.uniform(low[along] + FROM_CORNER_M, high[along] - FROM_CORNER_M);
        Passage { along, across_m, at_m }
    }

    /// Floor, ceiling, and four walls of which one has the way in. Halls share their walls: the older one's way out is the way in
    /// of the newer, which builds it.
    fn raise(self, builder: &mut SpaceBuilder, entrance: Option<&Passage>) {
        let corners = self.rect().corners_m();
        builder.slab(corners, None, 0.0);
        builder.slab(corners, None, STOREY_M);
        let [low, high] = corners;
        for (along, across_m) in [(0, low[1]), (0, high[1]), (1, low[0]), (1, high[0])] {
            if self.way_out() == (along, across_m) {
                continue;
            }
            let height_m = [0.0, STOREY_M - SLAB_M];
            let wall = Wall { along, across_m, span_m: [low[along], high[along]], height_m };
            let is_entrance = |passage: &&Passage| passage.along == along && passage.across_m == across_m;
            let opening = entrance.filter(is_entrance).map(|passage| Opening {
                span_m: [passage.at_m - 0.5 * OPENING_M[0], passage.at_m + 0.5 * OPENING_M[0]],
                height_m: [0.0, OPENING_M[1]],
            });
            builder.wall(&wall, opening.as_slice());
        }
    }

    /// The wall that it shares with the next hall: the axis along it, and where it stands on the other, metres.
    fn way_out(self) -> (usize, f64) {
        let ([low, high], [column, row]) = (self.rect().corners_m(), self.place());
        match Self(self.0 + 1).place() {
            [_, next] if next != row => (0, high[1]),
            [next, _] if next > column => (1, high[0]),
            _ => (1, low[0]),
        }
    }
}
