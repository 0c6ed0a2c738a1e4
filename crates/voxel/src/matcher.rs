//! Clouds matched against surfels: the pose of greatest likelihood, coarse resolutions first.
//!
//! A point is held to the plane of the voxel that it ends in, along the plane's normal (Chen and Medioni 1992, "Object modelling by
//! registration of multiple range images"; voxels and resolutions as in Magnusson 2009), by Cauchy's kernel where it is far off. The
//! kernel's width follows the residuals at each resolution: a tight one at a coarse resolution has no basin. Where the voxel knows no
//! plane there, as between two rings of a sweep, the next coarser one that does is asked ([`surfel_at`]).

use crate::eigen::axes;
use crate::surfel::Surfel;
use crate::surfel_map::{Level, Looked, SurfelMap, surfel_at};
use mapwright_geom::{Cov6, Pose3};
use nalgebra::{Matrix6, Rotation3, UnitQuaternion, Vector3, Vector6};
use std::iter;
use std::ops::Range;

/// How the objective is climbed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Ascent {
    /// Damped Gauss-Newton (Levenberg 1944, Marquardt 1963).
    #[default]
    GaussNewton,
    /// The gradient ascent of Thrun, Burgard and Fox's chapter on fast incremental mapping, with one adaptive step length `kappa`. Steps are
    /// `kappa diag(1, 1, 1, 1/L^2, 1/L^2, 1/L^2) grad / c`, with `L` the rms range and `c` the mean curvature along the axes of
    /// translation: a metre and a radian count alike, and one `kappa` serves all clouds.
    Gradient,
    /// The same with `L` = 1 m: a radian counts as a metre whatever the range.
    UnscaledGradient,
}

/// Through which resolutions starts are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Descent {
    /// All, the coarsest first: for starts that lie close to each other.
    Whole,
    /// And each through the finer half alone, which coarse voxels cannot lead astray: for a few that lie far apart.
    WholeAndFine,
}

/// How clouds are matched.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MatcherSettings {
    /// How the objective is climbed.
    pub ascent: Ascent,
    /// Steps at most, at each resolution.
    pub steps: usize,
    /// Points at most; others are passed over evenly.
    pub points: usize,
    /// The kernel's width: so many times the median residual of points on surfels.
    pub kernel_medians: f64,
    /// A point fits whose residual is below so many standard deviations of its surfel.
    pub fit_sigmas: f64,
}

impl Default for MatcherSettings {
    fn default() -> Self {
        Self { ascent: Ascent::GaussNewton, steps: 15, points: 4000, kernel_medians: 3.0, fit_sigmas: 3.0 }
    }
}

/// What is known of the pose before the cloud is looked at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prior {
    /// Where the cloud is thought to be.
    pub map_from_cloud: Pose3,
    /// Information of its right perturbation, translation first.
    pub information: Cov6,
}

/// Neighbouring points err alike: so many tell as much as one.
const POINTS_AS_ONE: f64 = 10.0;

impl Prior {
    /// Less the log likelihood of a pose, beside the mean of what so many points say.
    fn unlikeliness(&self, pose: Pose3, points: usize) -> f64 {
        let error = self.map_from_cloud.between(pose).log();
        0.5 * error.dot(&(self.information * error)) * POINTS_AS_ONE / points.max(1) as f64
    }
}

/// A match.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fit {
    /// The pose.
    pub map_from_cloud: Pose3,
    /// Information of its right perturbation by the points alone.
    pub information: Cov6,
    /// How evenly surfaces hold it: the least of what they say of a direction as a share of the most, of its translations and of its
    /// rotations about its own origin. Next to nothing where they all lie along one direction, or nowhere.
    pub held_shares: [f64; 2],
    /// Points that took part.
    pub points: u32,
    /// Share of the points that lie where a surfel says something, of the finest resolution that does.
    pub known_share: f64,
    /// Share of those that fit it.
    pub inlier_share: f64,
    /// Share of the points that lie where something was seen that says nothing of a surface, as points on a line.
    pub lines_share: f64,
    /// How far they lie off it, the median, metres.
    pub off_m: f64,
    /// How much more likely its points are there than anywhere, the mean of their log likelihood ratios: a point where nothing is known
    /// counts nothing, one that contradicts what is known less.
    pub log_likelihood: f64,
    /// Evaluations of the objective.
    pub evaluations: u32,
}

/// Where surfaces say less of a direction than this share of what they say of another, they do not hold it ([`Fit::held_shares`]).
/// Above what fields, tunnels and a wall on a field have, and below bare rooms (mapwright's tests/held.rs).
pub const HELD_SHARE: f64 = 0.006;
/// Rough matches are made with so many points, and so many steps a resolution.
const ROUGH_POINTS: usize = 1000;
const ROUGH_STEPS: usize = 8;
/// So many of those that the coarser resolutions lead to are climbed on.
const ROUGH_KEPT: usize = 8;
/// Poses so near to each other are one, of the voxel's side, and radians.
const SAME_SHARE: f64 = 0.5;
const SAME_RAD: f64 = 0.1;
/// The kernel's width is found anew after so many steps.
const WIDTH_EVERY: usize = 3;
/// A step so small ends the search, of the voxel's side, and radians.
const STEP_SHARE: f64 = 1e-3;
const STEP_RAD: f64 = 1e-4;
/// Damping after the first step that fails, by how much it grows and shrinks, and where nothing moves any more.
const FIRST_DAMPING: f64 = 1e-3;
const GROWTH: f64 = 10.0;
const SHRINKING: f64 = 0.3;
const LAST_DAMPING: f64 = 1e6;
/// Gradient ascent begins with this `kappa`, which grows and shrinks so after a step that succeeds or fails; it takes so many times the
/// steps of Gauss-Newton at most. Where it has come to rest it tries these once more: where points change voxels there are dents.
const FIRST_KAPPA: f64 = 1.0;
const KAPPA_GROWTH: f64 = 1.5;
const KAPPA_SHRINKING: f64 = 0.4;
const GRADIENT_STEPS: usize = 20;
const DENT_STRIDES: [f64; 3] = [30.0, 10.0, 3.0];
/// A point where nothing is known costs as much as one so many squared kernel widths off its surfel.
const UNKNOWN_WIDTHS2: f64 = 9.0;
/// A point where something is known is of something else with such a probability,
const ELSE_SHARE: f64 = 0.05;
/// and lies anywhere within so many of the smallest voxels then.
const ANYWHERE_VOXELS: f64 = 2.0;

/// Matches clouds; keeps its buffers.
#[derive(Debug, Clone, Default)]
pub struct Matcher {
    /// Its settings.
    pub settings: MatcherSettings,
    points: Vec<[f64; 3]>,
    /// Where they were seen from: all, or each.
    origins: Vec<[f64; 3]>,
    /// Standard deviation of each along its ray, metres; none where the surfels' own says all.
    sigmas: Vec<f32>,
    /// The voxel where each was looked for last, at the present resolution.
    looked: Vec<Looked>,
    residuals: Vec<f32>,
    /// When each point was taken, seconds after the cloud's middle, and where it lies undistorted by what was known before; of sweeps alone.
    times: Vec<f64>,
    straight: Vec<[f64; 3]>,
}

/// The objective and its derivatives around a pose, by a perturbation about the cloud's origin along the map's axes.
#[derive(Debug, Clone, Copy)]
struct Evaluation {
    cost: f64,
    gradient: Vector6<f64>,
    hessian: Matrix6<f64>,
    held_shares: [f64; 2],
    known: u32,
    fitting: u32,
    lines: u32,
}

impl Fit {
    /// Log likelihood by points and prior, by which fits are compared.
    #[must_use]
    pub fn posterior(&self, prior: &Prior) -> f64 {
        self.log_likelihood - prior.unlikeliness(self.map_from_cloud, self.points as usize)
    }

    /// Log evidence of a prior, nats: how likely its points are, wherever by that prior the pose may be (Laplace's approximation). By it priors
    /// are compared, one that says more being worth more where it is right.
    #[must_use]
    pub fn evidence(&self, prior: &Prior) -> f64 {
        let log_determinant = |information: Cov6| information.determinant().max(f64::MIN_POSITIVE).ln();
        let narrower = log_determinant(prior.information + self.information) - log_determinant(prior.information);
        f64::from(self.points) / POINTS_AS_ONE * self.posterior(prior) - 0.5 * narrower
    }
}

impl Matcher {
    /// A matcher.
    #[must_use]
    pub fn new(settings: MatcherSettings) -> Self {
        Self { settings, ..Self::default() }
    }

    /// Climbs from `start` through the resolutions, the coarsest first.
    pub fn climb<'a>(
        &mut self,
        map: &SurfelMap,
        seen: impl Into<Seen<'a>>,
        prior: &Prior,
        start: impl Into<Start>,
    ) -> Fit {
        self.climb_levels(map, map.levels().len(), seen.into(), (prior, start.into()))
    }

    /// Climbs from `start` through the finer half of the resolutions: for a start that is trusted, which coarse voxels may lead astray.
    pub fn climb_near<'a>(
        &mut self,
        map: &SurfelMap,
        seen: impl Into<Seen<'a>>,
        prior: &Prior,
        start: impl Into<Start>,
    ) -> Fit {
        self.climb_levels(map, map.levels().len().div_ceil(2), seen.into(), (prior, start.into()))
    }

    fn climb_levels(&mut self, map: &SurfelMap, levels: usize, seen: Seen<'_>, (prior, start): (&Prior, Start)) -> Fit {
        self.take_points(seen, self.settings.points);
        self.bend(&start.twist_per_s);
        let (mut pose, mut evaluations) = (start.map_from_cloud, 0);
        for finest in (0..levels).rev() {
            pose = self.climb_level(&map.levels()[finest..], prior, pose, self.settings.steps, &mut evaluations);
        }
        self.fit(map.levels(), pose, evaluations)
    }

    /// How a cloud fits where it is.
    pub fn judge<'a>(&mut self, map: &SurfelMap, seen: impl Into<Seen<'a>>, pose: Pose3) -> Fit {
        self.take_points(seen.into(), self.settings.points);
        self.fit(map.levels(), pose, 0)
    }

    fn fit(&mut self, levels: &[Level], pose: Pose3, evaluations: u32) -> Fit {
        self.forget_voxels();
        let width2 = self.width2(levels, pose);
        let at = self.evaluate(levels, pose, width2);
        let body = along_body(pose);
        let share = |part: u32, all: u32| if all == 0 { 0.0 } else { f64::from(part) / f64::from(all) };
        let points = self.points.len() as u32;
        Fit {
            map_from_cloud: pose,
            information: body.transpose() * at.hessian * body,
            held_shares: at.held_shares,
            points,
            known_share: share(at.known, points),
            lines_share: share(at.lines, points),
            inlier_share: share(at.fitting, at.known),
            off_m: self.median_off_m(levels, pose),
            log_likelihood: self.log_likelihood(levels, pose),
            evaluations: evaluations + 1,
        }
    }

    /// The most promising poses to climb from, of those that `starts` lead to, the best first, each once. They climb the coarser
    /// resolutions with a few points, or these and by themselves the finer ones; the most likely of what they come to climb the finer ones.
    pub fn rough<'a, S: Into<Start>>(
        &mut self,
        map: &SurfelMap,
        seen: impl Into<Seen<'a>>,
        prior: &Prior,
        starts: impl Iterator<Item = S>,
        descent: Descent,
        at_most: usize,
    ) -> Vec<Start> {
        self.take_points(seen.into(), ROUGH_POINTS);
        let (levels, middle) = (map.levels(), map.levels().len() / 2);
        let mut found: Vec<(f64, Start)> = Vec::new();
        for start in starts.map(Into::into) {
            let fine = (descent == Descent::WholeAndFine).then_some(0..middle);
            for which in iter::once(middle..levels.len()).chain(fine) {
                let start = self.descend((levels, which), prior, start);
                found.push((self.unlikeliness(levels, prior, start.map_from_cloud), start));
            }
        }
        sort_out(&mut found, levels[middle].size_m, ROUGH_KEPT);
        if found.len() > 1 {
            for (unlikeliness, start) in &mut found {
                *start = self.descend((levels, 0..middle), prior, *start);
                *unlikeliness = self.unlikeliness(levels, prior, start.map_from_cloud);
            }
            sort_out(&mut found, levels[0].size_m, at_most);
        }
        found.into_iter().map(|(_, start)| start).collect()
    }

    /// From a pose through some resolutions, the coarsest first, roughly.
    fn descend(&mut self, (levels, which): (&[Level], Range<usize>), prior: &Prior, start: Start) -> Start {
        self.bend(&start.twist_per_s);
        let climb = |pose, finest: usize| self.climb_level(&levels[finest..], prior, pose, ROUGH_STEPS, &mut 0);
        Start { map_from_cloud: which.rev().fold(start.map_from_cloud, climb), ..start }
    }

    /// By which poses are compared: less the log likelihood, by points and prior.
    fn unlikeliness(&mut self, levels: &[Level], prior: &Prior, pose: Pose3) -> f64 {
        self.forget_voxels();
        prior.unlikeliness(pose, self.points.len()) - self.log_likelihood(levels, pose)
    }

    fn take_points(&mut self, seen: Seen<'_>, most: usize) {
        let every = seen.points_m.len().div_ceil(most.max(1)).max(1);
        self.points.clear();
        self.points.extend(seen.points_m.iter().step_by(every).map(|point| point.map(f64::from)));
        self.origins.clear();
        let every_origin = if seen.origins_m.len() == seen.points_m.len() { every } else { 1 };
        self.origins.extend(seen.origins_m.iter().step_by(every_origin).map(|origin| origin.map(f64::from)));
        self.sigmas.clear();
        self.sigmas.extend(seen.sigmas_m.iter().step_by(every));
        self.times.clear();
        self.times.extend(seen.times_s.iter().step_by(every).map(|&s| f64::from(s)));
        self.straight.clear();
        if !self.times.is_empty() {
            self.times.resize(self.points.len(), 0.0);
            self.straight.clone_from(&self.points);
        }
        self.forget_voxels();
    }

    fn climb_level(
        &mut self,
        levels: &[Level],
        prior: &Prior,
        start: Pose3,
        steps: usize,
        evaluations: &mut u32,
    ) -> Pose3 {
        match self.settings.ascent {
            Ascent::GaussNewton => self.gauss_newton(levels, prior, start, steps, evaluations),
            Ascent::Gradient => {
                let squares: f64 = self.points.iter().flatten().map(|v| v * v).sum();
                let lever2 = (squares / self.points.len().max(1) as f64).max(1e-6);
                self.gradient_ascent(levels, (prior, start), steps, lever2, evaluations)
            }
            Ascent::UnscaledGradient => self.gradient_ascent(levels, (prior, start), steps, 1.0, evaluations),
        }
    }

    fn gradient_ascent(
        &mut self,
        levels: &[Level],
        (prior, start): (&Prior, Pose3),
        steps: usize,
        lever2: f64,
        evaluations: &mut u32,
    ) -> Pose3 {
        self.forget_voxels();
        let (mut pose, mut kappa) = (start, FIRST_KAPPA);
        let mut width2 = self.width2(levels, pose);
        let mut at = self.evaluated(prior, levels, pose, width2);
        *evaluations += 1;
        let mut strides = DENT_STRIDES.iter();
        for taken in 1..=GRADIENT_STEPS * steps {
            let curvature = at.hessian.diagonal().fixed_rows::<3>(0).mean().max(1e-9);
            let scaled = Vector6::from_fn(|axis, _| -at.gradient[axis] / if axis < 3 { 1.0 } else { lever2 });
            let step = scaled * (kappa / curvature);
            let (move_m, turn_rad) = (step.fixed_rows::<3>(0).norm(), step.fixed_rows::<3>(3).norm());
            if move_m < STEP_SHARE * levels[0].size_m && turn_rad < STEP_RAD {
                let Some(&stride) = strides.next() else { break };
                kappa = stride;
                continue;
            }
            let next = moved(pose, &step);
            let tried = self.evaluated(prior, levels, next, width2);
            *evaluations += 1;
            if tried.cost.is_nan() || tried.cost >= at.cost {
                kappa *= KAPPA_SHRINKING;
                continue;
            }
            (pose, at, kappa) = (next, tried, kappa * KAPPA_GROWTH);
            if taken % (WIDTH_EVERY * GRADIENT_STEPS) == 0 {
                width2 = self.width2(levels, pose);
                at = self.evaluated(prior, levels, pose, width2);
                *evaluations += 1;
            }
        }
        pose
    }

    fn gauss_newton(
        &mut self,
        levels: &[Level],
        prior: &Prior,
        start: Pose3,
        steps: usize,
        evaluations: &mut u32,
    ) -> Pose3 {
        self.forget_voxels();
        let (mut pose, mut damping) = (start, 0.0);
        let mut width2 = self.width2(levels, pose);
        let mut at = self.evaluated(prior, levels, pose, width2);
        *evaluations += 1;
        for taken in 1..=steps {
            let damped = at.hessian + Matrix6::from_diagonal(&at.hessian.diagonal().map(|v| damping * v + 1e-9));
            let Some(factor) = damped.cholesky() else { break };
            let step = factor.solve(&-at.gradient);
            let next = moved(pose, &step);
            let tried = self.evaluated(prior, levels, next, width2);
            *evaluations += 1;
            if tried.cost.is_nan() || tried.cost > at.cost {
                damping = if damping == 0.0 { FIRST_DAMPING } else { damping * GROWTH };
                if damping > LAST_DAMPING {
                    break;
                }
                continue;
            }
            (pose, at, damping) = (next, tried, damping * SHRINKING);
            let (move_m, turn_rad) = (step.fixed_rows::<3>(0).norm(), step.fixed_rows::<3>(3).norm());
            if move_m < STEP_SHARE * levels[0].size_m && turn_rad < STEP_RAD {
                break;
            }
            if taken % WIDTH_EVERY == 0 && taken < steps {
                width2 = self.width2(levels, pose);
                at = self.evaluated(prior, levels, pose, width2);
                *evaluations += 1;
            }
        }
        pose
    }

    /// To be called where another resolution is looked at.
    fn forget_voxels(&mut self) {
        self.looked.clear();
        self.looked.resize(self.points.len(), Looked::NOTHING);
    }

    /// Squared width of the kernel: what residuals are like there, in standard deviations.
    fn width2(&mut self, levels: &[Level], pose: Pose3) -> f64 {
        let median = self.median(levels, pose, |information, off_m| information * off_m * off_m);
        median.map_or(1.0, |median| (self.settings.kernel_medians.powi(2) * median).max(1.0))
    }

    /// See [`Fit::log_likelihood`]: a point is normally distributed about its surfel, or of something else and lies anywhere near.
    fn log_likelihood(&mut self, levels: &[Level], pose: Pose3) -> f64 {
        let rotation = pose.rotation.to_rotation_matrix();
        let scale = (1.0 - ELSE_SHARE) * ANYWHERE_VOXELS * levels[0].size_m / std::f64::consts::TAU.sqrt();
        let (mut log_sum, mut product) = (0.0_f64, 1.0_f64);
        let eyes = Eyes::new((&self.origins, &self.sigmas), rotation);
        for (number, (point, looked)) in self.points.iter().zip(&mut self.looked).enumerate() {
            let arm = rotation * Vector3::from(*point);
            let at = arm + pose.translation;
            let Some(surfel) = surfel_seen(levels, (arm, eyes.of(number)), at, looked) else { continue };
            let (off_m, information) = (surfel.off_m(at), eyes.information(number, surfel, arm));
            product *= ELSE_SHARE + scale * information.sqrt() * (-0.5 * information * off_m * off_m).exp();
            if !(1e-200..1e200).contains(&product) {
                (log_sum, product) = (log_sum + product.ln(), 1.0);
            }
        }
        (log_sum + product.ln()) / self.points.len().max(1) as f64
    }

    fn median_off_m(&mut self, levels: &[Level], pose: Pose3) -> f64 {
        self.median(levels, pose, |_, off_m| off_m.abs()).unwrap_or(0.0)
    }

    /// The median of what is said of the points by what they tell along their surfels' normals, 1/m^2, and by how far they lie off them, metres.
    fn median(&mut self, levels: &[Level], pose: Pose3, of: impl Fn(f64, f64) -> f64) -> Option<f64> {
        let rotation = pose.rotation.to_rotation_matrix();
        let eyes = Eyes::new((&self.origins, &self.sigmas), rotation);
        self.residuals.clear();
        for (number, (point, looked)) in self.points.iter().zip(&mut self.looked).enumerate() {
            let arm = rotation * Vector3::from(*point);
            let at = arm + pose.translation;
            if let Some(surfel) = surfel_seen(levels, (arm, eyes.of(number)), at, looked) {
                self.residuals.push(of(eyes.information(number, surfel, arm), surfel.off_m(at)) as f32);
            }
        }
        if self.residuals.is_empty() {
            return None;
        }
        let middle = self.residuals.len() / 2;
        Some(f64::from(*self.residuals.select_nth_unstable_by(middle, f32::total_cmp).1))
    }

    /// The objective by points and prior.
    fn evaluated(&mut self, prior: &Prior, levels: &[Level], pose: Pose3, width2: f64) -> Evaluation {
        let mut at = self.evaluate(levels, pose, width2);
        let error = prior.map_from_cloud.between(pose).log();
        let body = along_body(pose);
        let information = prior.information * POINTS_AS_ONE;
        let pull = information * error;
        at.cost += 0.5 * error.dot(&pull);
        at.gradient += body * pull;
        at.hessian += body * information * body.transpose();
        at
    }

    /// The objective by the points alone. Logarithms are taken of products.
    fn evaluate(&mut self, levels: &[Level], pose: Pose3, width2: f64) -> Evaluation {
        let rotation = pose.rotation.to_rotation_matrix();
        let eyes = Eyes::new((&self.origins, &self.sigmas), rotation);
        // whether surfaces hold the pose is asked of them alone: a wall that is seen from afar is one
        let (mut sums, mut of_surfaces) = (Sums::default(), Sums::default());
        let (mut log_sum, mut product) = (0.0_f64, 1.0_f64);
        let (mut known, mut fitting, mut lines) = (0, 0, 0);
        let (fit2, per_width2) = (self.settings.fit_sigmas.powi(2), 1.0 / width2);
        for (number, (point, looked)) in self.points.iter().zip(&mut self.looked).enumerate() {
            let arm = rotation * Vector3::from(*point);
            let at = arm + pose.translation;
            if product > 1e200 {
                (log_sum, product) = (log_sum + product.ln(), 1.0);
            }
            let Some(surfel) = surfel_seen(levels, (arm, eyes.of(number)), at, looked) else {
                product *= 1.0 + UNKNOWN_WIDTHS2;
                lines += u32::from(looked.is_there());
                continue;
            };
            let (off_m, information) = (surfel.off_m(at), eyes.information(number, surfel, arm));
            let d2 = information * off_m * off_m;
            known += 1;
            fitting += u32::from(d2 < fit2);
            let widths2 = d2 * per_width2;
            if widths2 >= UNKNOWN_WIDTHS2 {
                product *= 1.0 + UNKNOWN_WIDTHS2;
                continue;
            }
            product *= 1.0 + widths2;
            let normal = surfel.normal.map(f64::from);
            sums.add(information / (1.0 + widths2), off_m, normal, &arm);
            if !self.sigmas.is_empty() {
                of_surfaces.add(f64::from(surfel.information) / (1.0 + widths2), off_m, normal, &arm);
            }
        }
        let (mut gradient, mut hessian) = sums.derivatives();
        let of_surfaces = if self.sigmas.is_empty() { hessian } else { of_surfaces.derivatives().1 };
        let held_shares = leave_open(&of_surfaces, &mut gradient, &mut hessian);
        let cost = 0.5 * width2 * (log_sum + f64::ln(product));
        Evaluation { cost, gradient, hessian, held_shares, known, fitting, lines }
    }
}

/// Where points are seen from, beside the place of their cloud, along the map's axes.
#[derive(Clone, Copy)]
struct Eyes<'a> {
    rotation: Rotation3<f64>,
    of_all: Option<Vector3<f64>>,
    of_each: &'a [[f64; 3]],
    /// Standard deviation of each point along its ray, metres; none where surfels say all.
    sigmas: &'a [f32],
}

impl<'a> Eyes<'a> {
    /// `origins` in the cloud's frame: one for all, or one for each.
    fn new((origins, sigmas): (&'a [[f64; 3]], &'a [f32]), rotation: Rotation3<f64>) -> Self {
        match origins {
            [origin] => Self { rotation, of_all: Some(rotation * Vector3::from(*origin)), of_each: &[], sigmas },
            each => Self { rotation, of_all: None, of_each: each, sigmas },
        }
    }

    /// What a point at the end of `arm` tells along the normal of its surfel, 1/m^2: variances of surface and point add up, that of the
    /// point as its ray meets the surface.
    #[inline]
    fn information(&self, number: usize, surfel: &Surfel, arm: Vector3<f64>) -> f64 {
        let of_surfel = f64::from(surfel.information);
        let Some(&sigma_m) = self.sigmas.get(number) else { return of_surfel };
        let ray = self.of(number).map_or(arm, |eye| arm - eye);
        let across = Vector3::from(surfel.normal.map(f64::from)).dot(&ray) * f64::from(sigma_m);
        of_surfel / (1.0 + of_surfel * across * across / ray.norm_squared().max(f64::MIN_POSITIVE))
    }

    #[inline]
    fn of(&self, number: usize) -> Option<Vector3<f64>> {
        self.of_all.or_else(|| Some(self.rotation * Vector3::from(*self.of_each.get(number)?)))
    }
}

/// The surfel that says something where a point at the end of `arm` lies, if that was seen from its side; `eye` is where from, as the arm is.
#[inline]
fn surfel_seen<'a>(
    levels: &'a [Level],
    (arm, eye): (Vector3<f64>, Option<Vector3<f64>>),
    at: Vector3<f64>,
    looked: &mut Looked,
) -> Option<&'a Surfel> {
    surfel_at(levels, at.into(), looked).filter(|surfel| eye.is_none_or(|eye| !surfel.is_behind(arm - eye)))
}

/// Sums of the derivatives over points.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    gradient: [f64; 6],
    /// The upper triangle.
    hessian: [[f64; 6]; 6],
}

impl Sums {
    /// A point at the end of `arm`, so far off a plane with this normal, of this weight. A turn about the cloud's origin moves it by its
    /// cross product with that.
    #[inline]
    fn add(&mut self, weight: f64, off_m: f64, [x, y, z]: [f64; 3], arm: &Vector3<f64>) {
        let slope = [x, y, z, arm.y * z - arm.z * y, arm.z * x - arm.x * z, arm.x * y - arm.y * x];
        for row in 0..6 {
            let weighted = weight * slope[row];
            self.gradient[row] += weighted * off_m;
            for column in row..6 {
                self.hessian[row][column] += weighted * slope[column];
            }
        }
    }

    fn derivatives(&self) -> (Vector6<f64>, Matrix6<f64>) {
        let hessian = Matrix6::from_fn(|row, column| self.hessian[row.min(column)][row.max(column)]);
        (Vector6::from(self.gradient), hessian)
    }
}

/// Leaves open what surfaces hardly hold, of the translations and of the rotations: where they say less of a direction than
/// [`HELD_SHARE`] of what they say of another, that is noise of their normals, and counts by the square of how far it is below. The shares
/// are those of surfaces, whatever single points know of themselves (Zhang, Kaess, Singh 2016, "On degeneracy of optimization-based state estimation problems").
fn leave_open(of_surfaces: &Matrix6<f64>, gradient: &mut Vector6<f64>, hessian: &mut Matrix6<f64>) -> [f64; 2] {
    let (scale, shares) = held(of_surfaces);
    if let Some(scale) = scale {
        *gradient = scale * scale * *gradient;
        *hessian = scale * *hessian * scale;
    }
    shares
}

/// By what to scale both for that, if by anything, and the shares.
fn held(hessian: &Matrix6<f64>) -> (Option<Matrix6<f64>>, [f64; 2]) {
    let mut scale: Option<Matrix6<f64>> = None;
    let shares = [0, 3].map(|first| {
        let (values, vectors) = axes(hessian.fixed_view::<3, 3>(first, first).into_owned());
        let share = |k: usize| if values[2] > 0.0 { (values[k] / values[2]).max(0.0) } else { 0.0 };
        for k in (0..2).filter(|k| share(*k) < HELD_SHARE) {
            let mut direction = Vector6::zeros();
            direction.fixed_rows_mut::<3>(first).copy_from(&vectors.column(k));
            let kept = share(k) / HELD_SHARE;
            let open = Matrix6::identity() - direction * direction.transpose() * (1.0 - kept);
            scale = Some(scale.map_or(open, |scale| open * scale));
        }
        share(0)
    });
    (scale, shares)
}

/// Best first, of poses near to each other the best, so many at most.
fn sort_out(found: &mut Vec<(f64, Start)>, size_m: f64, at_most: usize) {
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut kept: Vec<(f64, Start)> = Vec::new();
    for (cost, start) in found.drain(..) {
        let pose = start.map_from_cloud;
        let same = |(_, other): &(f64, Start)| {
            let other = other.map_from_cloud;
            other.distance(pose) < SAME_SHARE * size_m && other.rotation.angle_to(&pose.rotation) < SAME_RAD
        };
        if kept.len() < at_most && !kept.iter().any(same) {
            kept.push((cost, start));
        }
    }
    *found = kept;
}

/// From perturbations along the axes of the cloud to those along the map's.
fn along_body(pose: Pose3) -> Matrix6<f64> {
    let rotation = pose.rotation.to_rotation_matrix().into_inner();
    let mut body = Matrix6::zeros();
    body.fixed_view_mut::<3, 3>(0, 0).copy_from(&rotation);
    body.fixed_view_mut::<3, 3>(3, 3).copy_from(&rotation);
    body
}

fn moved(pose: Pose3, step: &Vector6<f64>) -> Pose3 {
    let turn = UnitQuaternion::from_scaled_axis(step.fixed_rows::<3>(3).into_owned());
    let mut rotation = turn * pose.rotation;
    rotation.renormalize();
    Pose3 { translation: pose.translation + step.fixed_rows::<3>(0), rotation }
}

mod bent;

pub use bent::{BentFit, Seen, Start, TwistPrior};

#[cfg(test)]
mod tests;
