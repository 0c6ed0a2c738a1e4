//! Scans before a break, of which odometry alone says where the robot was: once what came after it is joined, both ends of their way are known.

use super::Session;
use super::pieces::Layout;
use crate::keyframe::Measurement;
use mapwright_geom::{Pose, TangentMatrix};

/// A pose follows odometry where it lies no farther from where that says, metres and radians: what remains is rounding. A way is bent until it
/// misses its end by no more.
const ROUNDING: f64 = 1e-6;
/// Corrections of a way at most; one that has not settled by then stays as odometry left it.
const CORRECTIONS: usize = 20;

/// Successive scans that followed odometry from the last match to a break.
#[derive(Debug)]
pub(super) struct Spell<P: Pose> {
    /// The place of the first of them.
    first: usize,
    /// Where the robot was at each, on the likeliest way that ends where the map has the robot after the break.
    poses: Vec<P>,
}

impl<P: Pose> Spell<P> {
    /// The pose of a scan, if it is of a spell.
    pub(super) fn pose(spells: &[Self], place: usize) -> Option<P> {
        let begun = spells.partition_point(|spell| spell.first <= place);
        let spell = spells.get(begun.checked_sub(1)?)?;
        spell.poses.get(place - spell.first).copied()
    }
}

impl<M: Measurement> Session<M> {
    /// All spells before breaks over which the map is joined, in order.
    pub(super) fn spells(&self) -> Vec<Spell<M::Pose>> {
        if self.fragments.len() < 2 {
            return Vec::new();
        }
        let layout = Layout::of(self);
        let mut spells: Vec<_> = layout.over_breaks().filter_map(|to| self.spell_before(&layout, to)).collect();
        spells.sort_by_key(|spell| spell.first);
        spells
    }

    /// The spell that ends at the keyframe `to`, with which a fragment begins.
    fn spell_before(&self, layout: &Layout, to: usize) -> Option<Spell<M::Pose>> {
        let end = self.scan_numbers.place(self.keyframes.get(to)?.scan)?;
        let last = end.checked_sub(1)?;
        let from = self.place(self.scans.get(last)?.keyframe?)?;
        if !layout.is_one_piece([from, to]) {
            return None;
        }
        let pose = |place: usize| Some(self.corrected(self.scans.get(place)?));
        let step = |place: usize| {
            let [before, after] = [self.scans.get(place.checked_sub(1)?)?, self.scans.get(place)?];
            Some(before.odom_from_robot.between(after.odom_from_robot))
        };
        let follows = |place: &usize| {
            let said = place.checked_sub(1).and_then(pose).zip(step(*place)).map(|(before, step)| before * step);
            let beside = said.zip(pose(*place)).map(|(said, is)| said.between(is));
            beside.is_some_and(|beside| beside.length() <= ROUNDING && beside.angle() <= ROUNDING)
        };
        let first = (1..=last).rev().take_while(follows).last()?;
        let steps = (first..=end).map(step).collect::<Option<Vec<_>>>()?;
        let mut poses = bent(pose(first - 1)?, steps, pose(end)?)?;
        poses.pop();
        Some(Spell { first, poses })
    }
}

/// The likeliest way from a pose to another whose steps were measured, all alike for their lengths (a radian counts as a metre): pose by pose, the
/// end with it. Gauss-Newton with the end as a constraint; none where that finds no way.
fn bent<P: Pose>(start: P, mut steps: Vec<P>, end: P) -> Option<Vec<P>> {
    let lengths: Vec<f64> = steps.iter().map(|step| step.length() + step.angle()).collect();
    // who stands by its wheels was carried, evenly
    let is_still = lengths.iter().all(|length| *length <= ROUNDING);
    let variance = |at: usize| if is_still { 1.0 } else { lengths[at] };
    for _ in 0..CORRECTIONS {
        let poses: Vec<P> = steps.iter().scan(start, |pose, step| Some(step_from(pose, *step))).collect();
        let reached = *poses.last()?;
        let missed = reached.local(end);
        let beside = reached.between(end);
        if beside.length() <= ROUNDING && beside.angle() <= ROUNDING {
            return Some(poses);
        }
        // how a small motion at each pose moves the end
        let at_end = || poses.iter().map(|pose| reached.between(*pose).adjoint());
        let mut covariance = P::Matrix::zero();
        for (at, jacobian) in at_end().enumerate() {
            covariance += P::Matrix::from_variances(variance(at), variance(at)).carried_by(&jacobian);
        }
        let force = covariance.inverted()? * missed;
        for (at, jacobian) in at_end().enumerate() {
            let back = P::Matrix::from_fn(|row, column| jacobian[(column, row)]);
            steps[at] = steps[at].retract(&(back * force * variance(at)));
        }
    }
    None
}

fn step_from<P: Pose>(pose: &mut P, step: P) -> P {
    *pose = *pose * step;
    *pose
}

#[cfg(test)]
mod tests {
    use super::*;
    use mapwright_geom::{Pose2, Pose3};

    #[test]
    fn a_way_that_turned_too_much_ends_where_it_should() {
        // an arc by wheels that turn 20 % too much
        let steps = |turn: f64| vec![Pose2::new(0.1, 0.0, turn); 200];
        let way = |steps: Vec<Pose2>| -> Vec<Pose2> {
            steps.iter().scan(Pose2::IDENTITY, |pose, step| Some(step_from(pose, *step))).collect()
        };
        let (truth, wheels) = (way(steps(0.01)), way(steps(0.012)));
        let bent = bent(Pose2::IDENTITY, steps(0.012), truth[199]).unwrap();
        let worst = |other: &[Pose2]| truth.iter().zip(other).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
        assert!(worst(&wheels) > 2.0 && worst(&bent) < 0.1, "{} {}", worst(&wheels), worst(&bent));
        assert!(bent[199].distance(truth[199]) < 1e-5);
    }

    #[test]
    fn who_stood_by_the_wheels_was_carried_evenly() {
        let end = Pose2::new(4.0, 0.0, 0.0);
        let bent = bent(Pose2::IDENTITY, vec![Pose2::IDENTITY; 4], end).unwrap();
        for (pose, x) in bent.iter().zip([1.0, 2.0, 3.0, 4.0]) {
            assert!(pose.distance(Pose2::new(x, 0.0, 0.0)) < 1e-5, "{bent:?}");
        }
    }

    #[test]
    fn a_way_that_fits_stays_as_it_is() {
        let step = Pose2::new(0.2, 0.0, 0.1).in_space();
        let ends: Vec<Pose3> = (0..9).scan(Pose3::identity(), |pose, _| Some(step_from(pose, step))).collect();
        assert_eq!(bent(Pose3::identity(), vec![step; 9], ends[8]).unwrap(), ends);
    }
}
