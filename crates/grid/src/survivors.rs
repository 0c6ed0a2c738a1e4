//! The nearest of some obstacles, eight looked at a time.

const LANES: usize = 8;
/// Where no obstacle is: farther than any radius from all cells, and its squared distance still fits.
const NOWHERE: i16 = 120;

/// Obstacles within a box of at most 61 cells a side, by their place in it, in the order in which ties go.
#[derive(Debug, Clone, Default)]
pub(crate) struct Survivors {
    count: usize,
    x: Vec<[i16; LANES]>,
    y: Vec<[i16; LANES]>,
}

impl Survivors {
    pub(crate) fn clear(&mut self) {
        self.count = 0;
        self.x.clear();
        self.y.clear();
    }

    pub(crate) fn push(&mut self, x: i16, y: i16) {
        let lane = self.count % LANES;
        if lane == 0 {
            self.x.push([NOWHERE; LANES]);
            self.y.push([NOWHERE; LANES]);
        }
        if let (Some(xs), Some(ys)) = (self.x.last_mut(), self.y.last_mut()) {
            (xs[lane], ys[lane]) = (x, y);
        }
        self.count += 1;
    }

    /// Squared distance of the nearest to a cell, and where it is; of several the first. Far off where there is none.
    pub(crate) fn nearest(&self, x: i16, y: i16) -> (i16, (i16, i16)) {
        let (mut least, mut block) = ([i16::MAX; LANES], [0_i16; LANES]);
        for (k, (xs, ys)) in self.x.iter().zip(&self.y).enumerate() {
            for l in 0..LANES {
                let (dx, dy) = (xs[l] - x, ys[l] - y);
                let d2 = dx * dx + dy * dy;
                // Both are taken or left, so that no lane branches.
                let nearer = d2 < least[l];
                least[l] = if nearer { d2 } else { least[l] };
                block[l] = if nearer { k as i16 } else { block[l] };
            }
        }
        let lane = (0..LANES).min_by_key(|&l| (least[l], block[l])).unwrap_or(0);
        let place = |all: &[[i16; LANES]]| all.get(block[lane] as usize).map_or(NOWHERE, |lanes| lanes[lane]);
        (least[lane], (place(&self.x), place(&self.y)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_several_that_are_as_near_the_first_is_taken() {
        let mut survivors = Survivors::default();
        assert_eq!(survivors.nearest(3, 4).0, i16::MAX, "nothing is far off");
        // The eighth and the ninth are as near: the last lane of the first block and the first of the second.
        for k in 0..7 {
            survivors.push(40 + k, 40);
        }
        survivors.push(3, 10);
        survivors.push(10, 3);
        assert_eq!(survivors.nearest(10, 10), (49, (3, 10)));
        survivors.clear();
        survivors.push(60, 60);
        assert_eq!(survivors.nearest(0, 0), (7200, (60, 60)));
    }
}
