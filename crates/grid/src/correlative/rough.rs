//! Whether a search can find anything at all, told roughly.

use super::lattice::Lattice;
use super::{CorrelativeSearch, SearchWindow};

/// Steps are `2^DOUBLINGS` times as wide as those of a search; of them blocks of `2^level` to a side are looked at, at as many headings fewer.
const DOUBLINGS: u32 = 1;
const LEVELS: [u32; 2] = [1, 0];

impl CorrelativeSearch {
    /// Whether points may be found among end points, of which a map with cells of this size would be drawn. They are not where even the bounds of
    /// blocks of poses do not reach the least share: steps of several cells count as the best of theirs. Between two headings that are looked at
    /// the farthest points move by as much as such a block is wide, so that what a search would find is hardly ever ruled out.
    #[must_use]
    pub fn may_find(
        &mut self,
        ends: &[[f64; 2]],
        resolution_m: f64,
        points: &[[f64; 2]],
        window: &SearchWindow,
    ) -> bool {
        self.scored = 0;
        let Some(farthest_m) = self.keep_usable(points) else { return true };
        let lattice = Lattice::new(window, resolution_m, farthest_m, DOUBLINGS);
        let Some(lattice) = lattice else { return true };
        self.heading.forget();
        self.pyramid.build_of_ends(ends, &lattice, &self.points, self.settings.sigma_m);
        let least = self.least_score();
        let may_find = LEVELS.into_iter().all(|level| {
            self.bound_blocks(&lattice, 1 << level);
            self.any_block_reaches(&lattice, level, least)
        });
        self.heading.forget();
        may_find
    }

    fn any_block_reaches(&mut self, lattice: &Lattice, level: u32, least: u32) -> bool {
        self.stack.clear();
        for k in 0..self.blocks.len() {
            self.stack.push(self.blocks[k]);
            while let Some(block) = self.stack.pop() {
                if block.bound.0 < least {
                    continue;
                }
                if block.level <= level {
                    self.stack.clear();
                    return true;
                }
                self.split(lattice, &block);
            }
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Change, LocalMap, LocalMapSettings, SearchSettings};
    use mapwright_geom::Pose2;
    use mapwright_sensor::SweepPoints;
    use mapwright_sim::Rng;

    /// End points on walls.
    fn walls(rng: &mut Rng) -> Vec<[f64; 2]> {
        let mut ends = Vec::new();
        for _ in 0..12 {
            let (x, y, length_m) = (rng.uniform(-8.0, 8.0), rng.uniform(-8.0, 8.0), rng.uniform(1.0, 5.0));
            let is_along_x = rng.uniform(0.0, 1.0) < 0.5;
            let at = |k: i32| if is_along_x { [x + 0.05 * f64::from(k), y] } else { [x, y + 0.05 * f64::from(k)] };
            ends.extend((0..(length_m / 0.05) as i32).map(at));
        }
        ends
    }

    #[test]
    fn what_a_search_finds_is_not_ruled_out_and_most_of_the_rest_is() {
        let mut rng = Rng::new(7);
        let (mut found, mut ruled_out, mut nothing) = (0, 0, 0);
        for case in 0..60 {
            let ends = walls(&mut rng);
            let mut map = LocalMap::new(LocalMapSettings { resolution_m: 0.05, ..LocalMapSettings::default() });
            for &hit in &ends {
                let (hits, normals) = (vec![hit], vec![[0.0; 2]]);
                let points = SweepPoints { origin: hit, hits, normals, ..SweepPoints::default() };
                map.change(&points, Pose2::IDENTITY, Change::Add, 0);
            }
            let truth = Pose2::new(rng.uniform(-1.5, 1.5), rng.uniform(-1.5, 1.5), rng.uniform(-0.2, 0.2));
            let seen = if case % 2 == 0 { ends.clone() } else { walls(&mut rng) };
            let robot_from_world = truth.inverse();
            let points: Vec<[f64; 2]> = seen.iter().step_by(3).map(|&end| robot_from_world.transform(end)).collect();
            let window = SearchWindow { world_from_robot: Pose2::IDENTITY, half_width_m: 2.0, half_width_rad: 0.3 };
            let settings = SearchSettings { least_share: 0.45, ..SearchSettings::default() };
            let mut searcher = CorrelativeSearch::new(settings);
            let is_found = searcher.search(&map, &points, &window, None).is_some();
            let may_find = searcher.may_find(&ends, 0.05, &points, &window);
            assert!(may_find || !is_found, "case {case}");
            found += u32::from(is_found);
            nothing += u32::from(!is_found);
            ruled_out += u32::from(!may_find);
        }
        assert!(found >= 30 && 2 * ruled_out > nothing, "{found} found, {ruled_out} of {nothing} ruled out");
    }

    #[test]
    fn nothing_is_ruled_out_where_nothing_can_be_told() {
        let mut searcher = CorrelativeSearch::new(SearchSettings { least_share: 0.45, ..SearchSettings::default() });
        let window =
            |half_width_m| SearchWindow { world_from_robot: Pose2::IDENTITY, half_width_m, half_width_rad: 0.3 };
        assert!(searcher.may_find(&[], 0.05, &[], &window(2.0)));
        assert!(searcher.may_find(&[[1.0, 1.0]], 0.05, &[[1.0, 1.0]], &window(f64::INFINITY)));
        assert!(!searcher.may_find(&[], 0.05, &[[1.0, 1.0]], &window(2.0)));
        assert!(!searcher.may_find(&[[f64::NAN, 1e300]], 0.05, &[[1.0, 1.0]], &window(2.0)));
    }
}
