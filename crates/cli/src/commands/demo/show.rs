//! `mapwright demo --show`: what goes wrong with a loop, and what rights it.

use crate::args::{DemoArgs, Show};
use crate::batch::{information, open_graph, true_edge, true_pairs};
use crate::drawing::write_before_and_after;
use crate::failure::{Failure, Outcome};
use crate::mapping::settings_of;
use crate::output::OutputFolder;
use crate::pose_graph::poses_of;
use crate::simulated::{PoseError, Simulated};
use crate::terminal::{say, say_json};
use mapwright::{LaserModel, LivePolicy, Pose2, Settings};
use mapwright_graph::spread::{shares_by_motion, spread};
use mapwright_graph::{Edge, Gnc, PoseGraph2, SolverSettings, optimize};
use mapwright_sim::{Drive, DriveSettings, Event, LaserSettings, PerturbScans, Revisits, worlds};
use serde_json::{Value, json};
use std::fmt::Display;
use std::sync::Arc;

/// What the wheels of `--show spread` turn too much over the whole loop, radians; beyond half a turn no closure could say
/// which way they erred.
const BIAS_RAD: f64 = 1.0;
/// Standard deviations of the closures that are shown, metres and radians.
const SIGMA_M: f64 = 0.05;
const SIGMA_RAD: f64 = 0.01;
/// The false closure lies so far beside the truth: metres ahead, metres to the left, radians.
const FALSE_BY: [f64; 3] = [2.4, 1.8, 0.35];
/// True closures at most.
const TRUE_CLOSURES: usize = 8;

/// A loop that came back to where it began, and the place where it did.
struct Loop {
    world: Simulated,
    /// Keyframes on known ground, each with an earlier one that sees the same.
    pairs: Vec<[usize; 2]>,
    /// That with the earliest keyframe: nearly the whole way lies between.
    closure: [usize; 2],
}

/// What is shown.
struct Shown {
    before: Vec<Pose2>,
    after: Vec<Pose2>,
    words: String,
    errors: Value,
}

pub(super) fn run(args: &DemoArgs, show: Show) -> Result<Outcome, Failure> {
    let mut settings = settings_of(&args.mapping)?;
    settings.live.policy = LivePolicy::Gated;
    let mut output = OutputFolder::create(&args.output)?;
    let name = format!("simulated loop of {:.0} m, seed {}", args.length, args.seed);
    let drawn = Loop::drive(args, show, &settings)?;
    let shown = match show {
        Show::NoClosure => drawn.no_closure(),
        Show::FalseClosure => drawn.false_closure(),
        Show::Spread => drawn.wheels_spread(),
    };
    let shown = shown.map_err(|reason| Failure::World { name: name.clone(), reason })?;
    let poses = [shown.before.as_slice(), &shown.after];
    let world = (&settings, drawn.world.session());
    write_before_and_after(&mut output, world, poses, args.mapping.picture_side)?;
    let files = output.commit()?;
    if args.mapping.voice.json {
        say_json(&json!({ "files": files, "world": name, "errors": shown.errors }))?;
    } else if !args.mapping.voice.quiet {
        say(&format!("{name}\n{}written  {}: {}\n", shown.words, args.output.display(), files.join(" ")))?;
    }
    Ok(Outcome::Done)
}

impl Loop {
    /// A short-sighted robot around a loop; for `--show spread` with wheels that always turn a little too much.
    fn drive(args: &DemoArgs, show: Show, settings: &Settings) -> Result<Self, Failure> {
        let site = Arc::new(worlds::loop_of(args.seed, args.length));
        let mut drive = DriveSettings { laser: short_sighted(), ..DriveSettings::long_drive(args.seed) };
        let mut bias_rad_per_m = 0.0;
        if show == Show::Spread {
            // The wheels are what is shown: where the laser knows the place no more, they go on.
            bias_rad_per_m = BIAS_RAD / args.length;
            (drive.odometry.heading_bias_sigma_rad_per_m, drive.odometry.turn_scale_sigma) = (0.0, 0.0);
        }
        let turned = move |step: Pose2| {
            let half = Pose2::new(0.0, 0.0, 0.5 * bias_rad_per_m * step.x.hypot(step.y));
            half * step * half
        };
        let scans = Drive::new(Arc::clone(&site), drive.clone()).scans().reintegrate_odometry(turned);
        let world = Simulated::map_watched(scans.map(Event::Scan), settings, |_, _, _| {})?;
        let pairs = true_pairs(&world, &Revisits::of(&site, &drive));
        let nowhere = || Failure::World {
            name: format!("simulated loop, seed {}", args.seed),
            reason: "expected a drive that comes back to ground it has seen, found none".to_owned(),
        };
        let closure = *pairs.iter().min_by_key(|[from, _]| from).ok_or_else(nowhere)?;
        Ok(Self { world, pairs, closure })
    }

    /// Local matching alone; then a closure's error spread, and all closures optimised.
    fn no_closure(&self) -> Result<Shown, String> {
        let (mut graph, open) = self.open()?;
        let spread = self.spread_over(&open)?;
        graph.vertices.iter_mut().zip(&spread).for_each(|(vertex, &pose)| vertex.world_from_vertex = pose);
        // One alone would leave the ground driven twice after it as it was.
        graph.edges.extend(self.true_closures());
        let after = solved(&mut graph, &SolverSettings::default())?.0;
        let (ate_open, ate_spread, ate_after) = (self.ate_m(&open)?, self.ate_m(&spread)?, self.ate_m(&after)?);
        let words = format!(
            "before   wheels and local matching, the loop left open: ATE {ate_open:.3} m, {} where it should close\n\
             after    closed, the error spread over the loop: ATE {ate_spread:.3} m; then {} closures optimised: {ate_after:.3} m\n",
            gap_words(self.gap(&open)),
            self.true_closures().count(),
        );
        let ate_m = json!({ "open": ate_open, "spread": ate_spread, "optimised": ate_after });
        let errors = json!({ "gap": gap_json(self.gap(&open)), "ate_m": ate_m });
        Ok(Shown { before: open, after, words, errors })
    }

    /// The wheels alone, which turn too much; then the closure's error spread backwards over the loop.
    fn wheels_spread(&self) -> Result<Shown, String> {
        let wheels = |k: usize| self.world.wheels_between(0, k).ok_or("expected odometry with every scan, found none");
        let before = (0..self.world.keyframe_count()).map(wheels).collect::<Result<Vec<_>, _>>()?;
        let after = self.spread_over(&before)?;
        let (ate_before, ate_after) = (self.ate_m(&before)?, self.ate_m(&after)?);
        let words = format!(
            "before   wheels alone, turning {:.0} deg too much on the way: ATE {ate_before:.3} m, the ends {}\n\
             after    the error spread backwards, turns first: ATE {ate_after:.3} m, nothing matched, nothing optimised\n",
            BIAS_RAD.to_degrees(),
            gap_words(self.gap(&before)),
        );
        let errors = json!({
            "gap": gap_json(self.gap(&before)),
            "ate_m": { "wheels": ate_before, "spread": ate_after },
        });
        Ok(Shown { before, after, words, errors })
    }

    /// True closures and a false one across the loop: obeyed by least squares, outvoted by graduated non-convexity.
    fn false_closure(&self) -> Result<Shown, String> {
        let (mut open, _) = self.open()?;
        open.edges.extend(self.true_closures());
        let without = solved(&mut open.clone(), &SolverSettings::default())?.0;
        let mut false_edge = self.closure_edge([1, 3].map(|k| k * self.world.keyframe_count() / 4));
        let [x, y, theta] = FALSE_BY;
        false_edge.from_from_to = false_edge.from_from_to * Pose2::new(x, y, theta);
        open.edges.push(false_edge);
        let before = solved(&mut open.clone(), &SolverSettings::default())?.0;
        let gnc = Gnc { consensus: None, ..Gnc::default() };
        let robust = SolverSettings { robust: Some(gnc), ..SolverSettings::default() };
        let (after, weights) = solved(&mut open, &robust)?;
        let outvoted = weights.last().is_some_and(|weight| *weight < 0.5);
        let others = weights.iter().rev().skip(1).filter(|weight| **weight < 0.5).count();
        let (ate_without, ate_before, ate_after) = (self.ate_m(&without)?, self.ate_m(&before)?, self.ate_m(&after)?);
        let words = format!(
            "false    one closure {:.1} m and {:.0} deg wrong among {} true ones; without it ATE {ate_without:.3} m\n\
             before   obeyed by least squares: ATE {ate_before:.3} m\n\
             after    {} by graduated non-convexity, with {others} other edges: ATE {ate_after:.3} m\n",
            x.hypot(y),
            theta.to_degrees(),
            self.true_closures().count(),
            if outvoted { "outvoted" } else { "NOT outvoted" },
        );
        let errors = json!({
            "ate_m": { "without": ate_without, "obeyed": ate_before, "outvoted": ate_after },
            "false_closure_outvoted": outvoted,
            "other_edges_outvoted": others,
        });
        Ok(Shown { before, after, words, errors })
    }

    /// The graph without closures, and the poses that its steps alone give.
    fn open(&self) -> Result<(PoseGraph2, Vec<Pose2>), String> {
        let mut graph = open_graph(&self.world);
        graph.start_from_odometry().map_err(in_words)?;
        let poses = solved(&mut graph, &SolverSettings::default())?.0;
        Ok((graph, poses))
    }

    /// Evenly over the ground that was driven twice, its end among them.
    fn true_closures(&self) -> impl Iterator<Item = Edge<Pose2>> + '_ {
        let every = self.pairs.len().div_ceil(TRUE_CLOSURES);
        self.pairs.iter().rev().step_by(every).map(|&pair| self.closure_edge(pair))
    }

    fn closure_edge(&self, pair: [usize; 2]) -> Edge<Pose2> {
        true_edge(&self.world, pair, information(SIGMA_M, SIGMA_RAD))
    }

    /// The chain with the closure's error shared among the steps of the loop.
    fn spread_over(&self, world_from_keyframe: &[Pose2]) -> Result<Vec<Pose2>, String> {
        let [first, last] = self.closure;
        let mut poses = world_from_keyframe.to_vec();
        let shares = shares_by_motion(&poses[first..=last]);
        spread(&mut poses, first, last, self.world.true_between(first, last), &shares).map_err(in_words)?;
        Ok(poses)
    }

    fn ate_m(&self, world_from_keyframe: &[Pose2]) -> Result<f64, String> {
        self.world.keyframe_ate_m(world_from_keyframe).map_err(in_words)
    }

    /// How far apart the loop's ends lie that should meet.
    fn gap(&self, world_from_keyframe: &[Pose2]) -> PoseError {
        self.world.error_between(world_from_keyframe, self.closure[0], self.closure[1])
    }
}

/// A cheap laser: few beams, noise, and not far to see; so drift becomes visible on a loop that is quickly mapped.
fn short_sighted() -> LaserSettings {
    let mut laser =
        LaserSettings { range_sigma_m: 0.04, ..LaserSettings::with_field_of_view(std::f64::consts::PI, 61) };
    laser.model = Arc::new(LaserModel { range_max_m: 4.0, ..(*laser.model).clone() });
    laser
}

/// Poses and weights at the optimum.
fn solved(graph: &mut PoseGraph2, settings: &SolverSettings) -> Result<(Vec<Pose2>, Vec<f64>), String> {
    let solution = optimize(graph, settings).map_err(in_words)?;
    Ok((poses_of(graph), solution.weights))
}

fn in_words(cause: impl Display) -> String {
    cause.to_string()
}

fn gap_words(gap: PoseError) -> String {
    format!("{:.2} m and {:.1} deg apart", gap.metres, gap.degrees)
}

fn gap_json(gap: PoseError) -> Value {
    json!({ "translation_m": gap.metres, "rotation_deg": gap.degrees })
}
