//! Who goes where.

/// How robots are given goals.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Strategy {
    /// The best pair of robot and goal first; what a chosen goal will show counts no more for the others (Burgard et al. 2005, algorithm 1).
    #[default]
    Greedy,
    /// The best sum over all robots, with what overlaps between goals discounted beforehand (Kuhn 1955, Munkres 1957).
    Hungarian,
    /// Each robot to the frontier nearest to it, whatever the others do (Yamauchi 1998): to compare with.
    Nearest,
}

/// A goal that may be given.
#[derive(Debug, Clone)]
pub(crate) struct Candidate {
    /// Blocks seen from there.
    pub(crate) blocks: Vec<u32>,
    /// Each robot's way there, seconds; none where there is none.
    pub(crate) seconds: Vec<Option<f64>>,
    /// Which robot is on its way there.
    pub(crate) held_by: Option<usize>,
    /// Which robot must go on to it.
    pub(crate) bound: Option<usize>,
}

/// How worth is weighed.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Weights {
    /// A second of way costs as much as so many square metres.
    pub(crate) m2_per_s: f64,
    /// More new area than this is worth no more, square metres.
    pub(crate) most_m2: f64,
    /// A robot on its way changes its mind for this much more, square metres.
    pub(crate) loyal_m2: f64,
    /// Goals that show less than this beyond what others will see are given to nobody, square metres.
    pub(crate) least_m2: f64,
}

/// What each goal would show.
pub(crate) struct Shown<'a, M: Fn(u32) -> f64> {
    /// Blocks of the map, and the unknown area of each, square metres.
    pub(crate) blocks: usize,
    pub(crate) m2: M,
    /// What robots that decide for themselves will see.
    pub(crate) claims: &'a [Claim],
}

/// A robot that decides for itself goes there.
#[derive(Debug, Clone)]
pub(crate) struct Claim {
    /// Blocks seen from there.
    pub(crate) blocks: Vec<u32>,
    /// Its number is lower than that of the robots that are given goals here: who is on its way to the same leaves it to that one.
    pub(crate) is_first: bool,
}

/// What becomes of a block.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd)]
enum Block {
    Unseen,
    /// By a robot that leaves it to who is on its way there here.
    Claimed,
    Covered,
}

impl<M: Fn(u32) -> f64> Shown<'_, M> {
    fn claimed(&self) -> Vec<Block> {
        let mut all = vec![Block::Unseen; self.blocks];
        for claim in self.claims {
            let as_what = if claim.is_first { Block::Covered } else { Block::Claimed };
            for &block in &claim.blocks {
                let block = &mut all[block as usize];
                *block = if *block < as_what { as_what } else { *block };
            }
        }
        all
    }

    /// New area that a goal shows beyond what others see, each block counted as `share` says.
    fn by(&self, candidate: &Candidate, known: &[Block], share: impl Fn(u32) -> f64) -> f64 {
        let most = if candidate.held_by.is_some() { Block::Claimed } else { Block::Unseen };
        let new = candidate.blocks.iter().filter(|&&block| known[block as usize] <= most);
        new.map(|&block| (self.m2)(block) * share(block)).sum()
    }
}

/// The goal of each robot, if any.
pub(crate) fn assign(
    strategy: Strategy,
    candidates: &[Candidate],
    robots: usize,
    weights: Weights,
    shown: &Shown<'_, impl Fn(u32) -> f64>,
) -> Vec<Option<usize>> {
    match strategy {
        Strategy::Greedy => greedy(candidates, robots, weights, shown),
        Strategy::Hungarian => {
            let worths = worths(candidates, robots, weights, shown);
            hungarian(&worths)
        }
        Strategy::Nearest => (0..robots).map(|robot| nearest(candidates, robot)).collect(),
    }
}

fn nearest(candidates: &[Candidate], robot: usize) -> Option<usize> {
    let reachable = candidates.iter().enumerate().filter_map(|(k, candidate)| Some((k, candidate.seconds[robot]?)));
    reachable.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(k, _)| k)
}

/// What a goal is worth to a robot, in square metres, when it shows so much. All goals must be gone to in the end: who leaves one leaves it
/// to the next nearest robot, whose way is spared (the regret of vehicle routing; Potvin and Rousseau 1993).
fn worth(candidate: &Candidate, robot: usize, shown_m2: f64, weights: Weights) -> Option<f64> {
    let own_s = candidate.seconds[robot]?;
    let others = candidate.seconds.iter().enumerate().filter(|&(other, _)| other != robot);
    let spared_s =
        others.filter_map(|(_, seconds)| *seconds).min_by(f64::total_cmp).map_or(0.0, |next_s| next_s - own_s);
    let loyal_m2 = if candidate.held_by == Some(robot) { weights.loyal_m2 } else { 0.0 };
    Some(shown_m2.min(weights.most_m2) + weights.m2_per_s * (spared_s - own_s) + loyal_m2)
}

fn greedy(
    candidates: &[Candidate],
    robots: usize,
    weights: Weights,
    shown: &Shown<'_, impl Fn(u32) -> f64>,
) -> Vec<Option<usize>> {
    let mut known = shown.claimed();
    let mut shown_m2 = vec![0.0; candidates.len()];
    let count = |known: &[Block], shown_m2: &mut [f64]| {
        for (candidate, m2) in candidates.iter().zip(shown_m2) {
            *m2 = shown.by(candidate, known, |_| 1.0);
        }
    };
    count(&known, &mut shown_m2);
    let mut goals = vec![None; robots];
    let mut take = |chosen: usize, shown_m2: &mut [f64]| {
        for &block in &candidates[chosen].blocks {
            known[block as usize] = Block::Covered;
        }
        count(&known, shown_m2);
    };
    for (k, candidate) in candidates.iter().enumerate() {
        let Some(robot) = candidate.bound.filter(|&robot| candidate.seconds[robot].is_some()) else { continue };
        goals[robot] = Some(k);
        take(k, &mut shown_m2);
    }
    loop {
        let mut best: Option<(f64, usize, usize)> = None;
        for (k, candidate) in candidates.iter().enumerate().filter(|&(k, _)| shown_m2[k] >= weights.least_m2) {
            for robot in (0..robots).filter(|&robot| goals[robot].is_none()) {
                let Some(worth) = worth(candidate, robot, shown_m2[k], weights) else { continue };
                if best.is_none_or(|(most, ..)| worth > most) {
                    best = Some((worth, robot, k));
                }
            }
        }
        let Some((_, robot, chosen)) = best else { return goals };
        goals[robot] = Some(chosen);
        take(chosen, &mut shown_m2);
    }
}

/// Of each goal to each robot: what several goals show is shared among them, so that their sum is what all show together.
fn worths(
    candidates: &[Candidate],
    robots: usize,
    weights: Weights,
    shown: &Shown<'_, impl Fn(u32) -> f64>,
) -> Vec<Vec<Option<f64>>> {
    let mut seers = vec![0.0; shown.blocks];
    for &block in candidates.iter().flat_map(|candidate| &candidate.blocks) {
        seers[block as usize] += 1.0;
    }
    let known = shown.claimed();
    let m2: Vec<f64> =
        candidates.iter().map(|candidate| shown.by(candidate, &known, |block| 1.0 / seers[block as usize])).collect();
    let of = |k: usize, robot: usize| {
        let is_some = shown.claims.is_empty() || m2[k] > 0.0;
        worth(&candidates[k], robot, m2[k], weights).filter(|_| is_some)
    };
    (0..robots).map(|robot| (0..candidates.len()).map(|k| of(k, robot)).collect()).collect()
}

/// The assignment of rows to columns with the largest sum, where rows that can do without a column only do so where there is none left
/// (shortest augmenting paths; Jonker and Volgenant 1987).
fn hungarian(worths: &[Vec<Option<f64>>]) -> Vec<Option<usize>> {
    /// Cost of having no goal: more than any way costs.
    const NONE: f64 = 1e9;
    let (rows, columns) = (worths.len(), worths.first().map_or(0, Vec::len));
    let all = columns + rows;
    let cost = |row: usize, column: usize| worths[row].get(column).copied().flatten().map_or(NONE, |worth| -worth);
    // Numbered from one: row and column zero stand for none.
    let (mut u, mut v) = (vec![0.0; rows + 1], vec![0.0; all + 1]);
    let mut row_of = vec![0; all + 1];
    for row in 1..=rows {
        let (mut least, mut used, mut way) = (vec![f64::INFINITY; all + 1], vec![false; all + 1], vec![0; all + 1]);
        row_of[0] = row;
        let mut at = 0;
        while row_of[at] != 0 {
            used[at] = true;
            let (here, mut delta, mut next) = (row_of[at], f64::INFINITY, 0);
            for column in (1..=all).filter(|&column| !used[column]) {
                let reduced = cost(here - 1, column - 1) - u[here] - v[column];
                if reduced < least[column] {
                    (least[column], way[column]) = (reduced, at);
                }
                if least[column] < delta {
                    (delta, next) = (least[column], column);
                }
            }
            for column in 0..=all {
                if used[column] {
                    u[row_of[column]] += delta;
                    v[column] -= delta;
                } else {
                    least[column] -= delta;
                }
            }
            at = next;
        }
        while at != 0 {
            row_of[at] = row_of[way[at]];
            at = way[at];
        }
    }
    let mut goals = vec![None; rows];
    for column in (1..=columns).filter(|&column| row_of[column] > 0) {
        let row = row_of[column] - 1;
        goals[row] = worths[row][column - 1].map(|_| column - 1);
    }
    goals
}

#[cfg(test)]
mod tests {
    use super::*;

    const WEIGHTS: Weights = Weights { m2_per_s: 1.0, most_m2: 100.0, loyal_m2: 5.0, least_m2: 0.5 };

    fn candidate(blocks: &[u32], seconds: &[f64]) -> Candidate {
        Candidate {
            blocks: blocks.to_vec(),
            seconds: seconds.iter().map(|&s| Some(s)).collect(),
            held_by: None,
            bound: None,
        }
    }

    fn goals(strategy: Strategy, candidates: &[Candidate], robots: usize) -> Vec<Option<usize>> {
        goals_beside(&[], strategy, candidates, robots)
    }

    fn goals_beside(
        claims: &[Claim],
        strategy: Strategy,
        candidates: &[Candidate],
        robots: usize,
    ) -> Vec<Option<usize>> {
        assign(strategy, candidates, robots, WEIGHTS, &Shown { blocks: 100, m2: |_| 1.0, claims })
    }

    #[test]
    fn who_decides_for_itself_is_left_what_it_goes_to_unless_this_robot_was_first() {
        let (same, other): (Vec<u32>, Vec<u32>) = ((0..20).collect(), (50..60).collect());
        let mut candidates = [candidate(&same, &[1.0]), candidate(&other, &[9.0])];
        let claim = |is_first| [Claim { blocks: same.clone(), is_first }];
        for strategy in [Strategy::Greedy, Strategy::Hungarian] {
            let with = |claims: &[Claim], candidates: &[Candidate]| goals_beside(claims, strategy, candidates, 1);
            candidates[0].held_by = None;
            assert_eq!(with(&[], &candidates), [Some(0)]);
            assert_eq!(with(&claim(true), &candidates), [Some(1)]);
            assert_eq!(with(&claim(false), &candidates), [Some(1)]);
            assert_eq!(with(&claim(true), &candidates[..1]), [None]);
            // On its way there it goes on, where the other has the higher number.
            candidates[0].held_by = Some(0);
            assert_eq!(with(&claim(true), &candidates), [Some(1)]);
            assert_eq!(with(&claim(false), &candidates), [Some(0)]);
        }
    }

    #[test]
    fn robots_do_not_go_where_another_will_see_the_same() {
        let same: Vec<u32> = (0..20).collect();
        let other: Vec<u32> = (50..60).collect();
        let candidates = [candidate(&same, &[1.0, 2.0]), candidate(&same, &[2.0, 1.0]), candidate(&other, &[9.0, 9.0])];
        assert_eq!(goals(Strategy::Greedy, &candidates, 2), [Some(0), Some(2)]);
        assert_eq!(goals(Strategy::Nearest, &candidates, 2), [Some(0), Some(1)]);
    }

    #[test]
    fn a_robot_goes_where_others_would_have_far_to_go() {
        let candidates = [candidate(&[1, 2], &[3.0, 4.0]), candidate(&[3, 4], &[4.0, 20.0])];
        assert_eq!(goals(Strategy::Greedy, &candidates, 2), [Some(1), Some(0)]);
        assert_eq!(goals(Strategy::Nearest, &candidates, 2), [Some(0), Some(0)]);
    }

    #[test]
    fn who_is_on_its_way_needs_a_reason_to_turn() {
        let mut candidates = [candidate(&[1, 2, 3], &[3.0]), candidate(&[4, 5, 6], &[1.0])];
        assert_eq!(goals(Strategy::Greedy, &candidates, 1), [Some(1)]);
        candidates[0].held_by = Some(0);
        assert_eq!(goals(Strategy::Greedy, &candidates, 1), [Some(0)]);
        candidates[0].seconds[0] = Some(30.0);
        assert_eq!(goals(Strategy::Greedy, &candidates, 1), [Some(1)]);
        candidates[0].bound = Some(0);
        assert_eq!(goals(Strategy::Greedy, &candidates, 1), [Some(0)]);
    }

    #[test]
    fn the_hungarian_sum_is_the_best_of_all() {
        let mut state = 7_u64;
        let mut any = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f64
        };
        for _ in 0..50 {
            let worths: Vec<Vec<Option<f64>>> = (0..3).map(|_| (0..4).map(|_| Some(any())).collect()).collect();
            let sum = |columns: [usize; 3]| (0..3).filter_map(|row| worths[row][columns[row]]).sum::<f64>();
            let mut most = 0.0_f64;
            for (a, b, c) in (0..64).map(|k| (k & 3, k >> 2 & 3, k >> 4)) {
                if a != b && b != c && a != c {
                    most = most.max(sum([a, b, c]));
                }
            }
            let found = hungarian(&worths);
            let columns: Vec<usize> = found.into_iter().flatten().collect();
            assert_eq!(columns.len(), 3);
            assert!((sum([columns[0], columns[1], columns[2]]) - most).abs() < 1e-6);
        }
        assert_eq!(hungarian(&[vec![None, Some(1.0)], vec![None, Some(2.0)]]), [None, Some(1)]);
        assert_eq!(hungarian(&[vec![], vec![]]), [None, None]);
    }
}
