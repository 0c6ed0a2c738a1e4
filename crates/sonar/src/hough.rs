//! Walls by votes: each arc votes for all the lines that it is tangent to (Tardós, Neira, Newman and Leonard 2002).

use crate::arc::Arc2;
use crate::edge::edge;
use crate::fit::{Fit, GATE_SIGMAS, LEAST_ECHOES, Line, places};
use crate::wall::{KNOWN_TO_M, Wall};
use mapwright_geom::{sin_cos, wrap_angle};
use std::f64::consts::TAU;

/// Directions of normals that are told apart: 3 degrees, a sixth of a cone.
const DIRECTIONS: usize = 120;
/// Depths that are told apart, metres: an echo's noise.
const DEPTH_STEP_M: f64 = 0.05;
/// Directions count as equally good down to this share of the most votes.
const PLATEAU_SHARE: f64 = 0.85;
/// Two echoes of one wall are no farther apart along it, metres: narrower than a door.
const GAP_M: f64 = 0.4;
/// Directions to either side that are looked at no more where a line came to nothing: 9 degrees.
const FORGOTTEN: usize = 3;
/// Standard deviation of a direction found by votes alone, radians.
const VOTED_RAD: f64 = 0.1;

/// All walls in the arcs, those with most echoes first.
pub(crate) fn walls(arcs: &[Arc2], most_beyond_m: f64) -> Vec<Wall> {
    let mut votes = Votes::of(arcs);
    let mut free: Vec<bool> = vec![true; arcs.len()];
    let mut walls = Vec::new();
    while let Some((guess, peak)) = votes.best() {
        let found = fitted(arcs, &free, guess);
        let pieces = match edge(arcs, &free, &found) {
            Some(edge) => vec![edge],
            None => pieces(arcs, &found, most_beyond_m),
        };
        let used: Vec<usize> = pieces.iter().flat_map(|wall| wall.echoes.iter().map(|echo| echo.0)).collect();
        for &echo in &used {
            free[echo] = false;
            votes.vote(&arcs[echo], -1);
        }
        if used.is_empty() {
            votes.forget(peak);
        }
        walls.extend(pieces);
    }
    walls
}

struct Votes {
    depths: usize,
    counts: Vec<i32>,
    /// Depth of the first row, metres.
    first_m: f64,
}

impl Votes {
    fn of(arcs: &[Arc2]) -> Self {
        let reach = |arc: &Arc2| arc.stretch_from_sonar.x.hypot(arc.stretch_from_sonar.y);
        let low_m = -arcs.iter().map(reach).fold(0.0, f64::max) - DEPTH_STEP_M;
        let high_m = arcs.iter().map(|arc| reach(arc) + arc.range_m).fold(0.0, f64::max) + 2.0 * DEPTH_STEP_M;
        let depths = ((high_m - low_m) / DEPTH_STEP_M).ceil().clamp(1.0, 10_000.0) as usize + 1;
        let mut votes = Self { depths, counts: vec![0; DIRECTIONS * depths], first_m: low_m };
        arcs.iter().for_each(|arc| votes.vote(arc, 1));
        votes
    }

    /// Two neighbouring depths a direction: a tangent between two rows counts in both.
    fn vote(&mut self, arc: &Arc2, by: i32) {
        for direction in 0..DIRECTIONS {
            let normal_rad = direction_rad(direction);
            if !arc.faces(normal_rad) {
                continue;
            }
            let (sin, cos) = sin_cos(normal_rad);
            let row = ((arc.depth_m([cos, sin]) - self.first_m) / DEPTH_STEP_M - 0.5).floor().max(0.0) as usize;
            for row in [row, row + 1] {
                if let Some(count) = self.counts.get_mut(direction * self.depths + row.min(self.depths - 1)) {
                    *count += by;
                }
            }
        }
    }

    /// The line with most votes, in the middle of the directions that have nearly as many; none with too few.
    fn best(&self) -> Option<(Line, [usize; 2])> {
        let (mut most, mut place) = (LEAST_ECHOES as i32 - 1, None);
        for (at, &count) in self.counts.iter().enumerate() {
            if count > most {
                (most, place) = (count, Some(at));
            }
        }
        let place = place?;
        let (direction, row) = (place / self.depths, place % self.depths);
        let least = PLATEAU_SHARE * f64::from(most);
        let votes_at = |direction: usize| {
            let rows = row.saturating_sub(2)..(row + 3).min(self.depths);
            rows.map(|row| self.counts[direction * self.depths + row]).max().unwrap_or(0)
        };
        let steps = |sign: usize| {
            let next = |k: usize| (direction + DIRECTIONS + sign * k) % DIRECTIONS;
            (1..DIRECTIONS / 4).take_while(|&k| f64::from(votes_at(next(k))) >= least).count()
        };
        let (ahead, behind) = (steps(1), steps(DIRECTIONS - 1));
        let normal_rad = direction_rad(direction) + 0.5 * (ahead as f64 - behind as f64) * TAU / DIRECTIONS as f64;
        let depth_m = self.first_m + (row as f64 + 0.5) * DEPTH_STEP_M;
        Some((Line { normal_rad, depth_m }, [direction, row]))
    }

    /// The line with most votes came to nothing, and so would those beside it.
    fn forget(&mut self, [direction, row]: [usize; 2]) {
        for aside in 0..=2 * FORGOTTEN {
            let direction = (direction + DIRECTIONS + aside - FORGOTTEN) % DIRECTIONS;
            for row in row.saturating_sub(1)..(row + 2).min(self.depths) {
                self.counts[direction * self.depths + row] = 0;
            }
        }
    }
}

fn direction_rad(direction: usize) -> f64 {
    TAU * direction as f64 / DIRECTIONS as f64
}

/// Least squares over the arcs near the line, the direction held by the votes; the arcs anew by the line found.
fn fitted(arcs: &[Arc2], free: &[bool], guess: Line) -> Fit {
    let mut line = depth_by_median(arcs, free, guess);
    let mut sigma_rad = VOTED_RAD;
    for widening in [2.0, 1.0, 1.0] {
        let chosen = tangent(arcs, free, line, widening);
        let (refined, sigma) = least_squares(arcs, &chosen, line);
        (line, sigma_rad) = (refined, sigma);
    }
    let mut echoes = tangent(arcs, free, line, 1.0);
    echoes.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
    Fit { line, direction_sigma_rad: sigma_rad, echoes }
}

/// The middle of the depths that arcs near the voted row have in the voted direction.
fn depth_by_median(arcs: &[Arc2], free: &[bool], guess: Line) -> Line {
    let (sin, cos) = sin_cos(guess.normal_rad);
    let near = |(arc, _): &(&Arc2, &bool)| {
        arc.faces(guess.normal_rad) && (arc.depth_m([cos, sin]) - guess.depth_m).abs() <= 3.0 * DEPTH_STEP_M
    };
    let candidates = arcs.iter().zip(free).filter(|(_, free)| **free).filter(near);
    let mut depths: Vec<f64> = candidates.map(|(arc, _)| arc.depth_m([cos, sin])).collect();
    depths.sort_by(f64::total_cmp);
    Line { depth_m: depths.get(depths.len() / 2).copied().unwrap_or(guess.depth_m), ..guess }
}

fn tangent(arcs: &[Arc2], free: &[bool], line: Line, widening: f64) -> Vec<(usize, f64)> {
    let (sin, cos) = sin_cos(line.normal_rad);
    let fits = |arc: &Arc2| {
        let off_m = (arc.depth_m([cos, sin]) - line.depth_m).abs();
        arc.faces(line.normal_rad) && off_m <= widening * GATE_SIGMAS * arc.sigma_m()
    };
    let chosen = arcs.iter().enumerate().filter(|&(k, arc)| free[k] && fits(arc));
    chosen.map(|(k, arc)| (k, arc.along_m([-sin, cos]))).collect()
}

/// With `n(a + d) = n + d u`: depths `s.n + r = depth - d s.u`, by least squares, `d` with a normal prior.
fn least_squares(arcs: &[Arc2], chosen: &[(usize, f64)], line: Line) -> (Line, f64) {
    let (sin, cos) = sin_cos(line.normal_rad);
    let (mut w, mut wt, mut wtt, mut wd, mut wtd) = (0.0, 0.0, 1.0 / VOTED_RAD.powi(2), 0.0, 0.0);
    for &(k, along_m) in chosen {
        let weight = arcs[k].sigma_m().powi(-2);
        let off_m = arcs[k].depth_m([cos, sin]) - line.depth_m;
        w += weight;
        wt += weight * along_m;
        wtt += weight * along_m * along_m;
        wd += weight * off_m;
        wtd += weight * along_m * off_m;
    }
    let determinant = w * wtt - wt * wt;
    if w <= 0.0 || determinant <= 1e-9 * w * wtt {
        return (line, VOTED_RAD);
    }
    // off = depth' - turn * along
    let turn_rad = (wt * wd - w * wtd) / determinant;
    let depth_m = (wtt * wd - wt * wtd) / determinant;
    let turned = Line { normal_rad: wrap_angle(line.normal_rad + turn_rad), depth_m: line.depth_m + depth_m };
    (turned, (w / determinant).sqrt())
}

/// The line's pieces between gaps, of those that answered often enough.
fn pieces(arcs: &[Arc2], fit: &Fit, most_beyond_m: f64) -> Vec<Wall> {
    let mut pieces = Vec::new();
    let mut from = 0;
    for next in 1..=fit.echoes.len() {
        let ends = next == fit.echoes.len() || fit.echoes[next].1 - fit.echoes[next - 1].1 > GAP_M;
        if !ends {
            continue;
        }
        let run = &fit.echoes[from..next];
        from = next;
        if places(arcs, run) < LEAST_ECHOES {
            continue;
        }
        let (Some(first), Some(last)) = (run.first(), run.last()) else { continue };
        pieces.push(Wall {
            normal_rad: fit.line.normal_rad,
            depth_m: fit.line.depth_m,
            seen_m: [first.1, last.1],
            known_beyond_m: known_beyond_m(last.1 - first.1, fit.direction_sigma_rad).min(most_beyond_m),
            echoes: run.to_vec(),
        });
    }
    pieces
}

/// How far a line goes on where a piece of it was heard: as far as its direction is known, and no farther than half of what was heard.
fn known_beyond_m(length_m: f64, direction_sigma_rad: f64) -> f64 {
    (KNOWN_TO_M / direction_sigma_rad).min(KNOWN_TO_M + 0.5 * length_m)
}
