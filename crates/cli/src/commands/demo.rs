//! `mapwright demo`

mod fleet;
mod show;
mod sonar;
mod space;

use crate::args::DemoArgs;
use crate::events::Interrupt;
use crate::failure::{Failure, Outcome};
use crate::mapping::{Mapping, settings_of};
use crate::output::OutputFolder;
use crate::report::{self, LastWords};
use crate::session::earlier_in_plane;
use crate::simulated::{PEOPLE, office, true_relations};
use crate::terminal::{say, say_json};
use mapwright_eval::{Alignment, Ate, RelationReport, StampedPose, ate, relation_errors};
use mapwright_formats::TumWriter;
use mapwright_sim::Event;
use serde_json::{Value, json};

pub(super) fn run(args: &DemoArgs) -> Result<Outcome, Failure> {
    if let Some(show) = args.show {
        return show::run(args, show);
    }
    if args.fleet {
        return fleet::run(args);
    }
    if args.space || args.depth || args.stereo {
        return space::run(args);
    }
    if args.sonar {
        return sonar::run(args);
    }
    let mapping_args = &args.mapping;
    settings_of(mapping_args)?;
    let interrupt = Interrupt::watch()?;
    let earlier = mapping_args.resume.as_ref().map(|path| earlier_in_plane(path)).transpose()?;
    let output = OutputFolder::create(&args.output)?;
    let name = format!("simulated office floor, seed {}", args.seed);
    let mut mapping = Mapping::begin(mapping_args, output, None, earlier)?;
    let mut truth = Vec::new();
    for event in office(args.seed, PEOPLE) {
        match event {
            Event::Odometry(odometry) => mapping.add_odometry(&odometry, 0)?,
            Event::Scan(scan) => {
                mapping.add_scan(&scan.scan, 0)?;
                truth.push(StampedPose { stamp: scan.scan.stamp, world_from_robot: scan.world_from_robot });
            }
        }
        if interrupt.came() {
            break;
        }
    }
    mapping.end_of_scans()?;
    if !interrupt.came() {
        mapping.look_again()?;
    }
    finish(args, &name, mapping, &truth, interrupt.came(), |_, _| Ok(None))
}

fn finish(
    args: &DemoArgs,
    name: &str,
    mut mapping: Mapping,
    truth: &[StampedPose],
    interrupted: bool,
    further: impl Fn(&Mapping, &Ate) -> Result<Option<(String, Value)>, Failure>,
) -> Result<Outcome, Failure> {
    let made = mapping.write_results()?;
    write_truth(&mut mapping, truth)?;
    let score = Score::of(&mapping, truth, args)?;
    let further = further(&mapping, &score.absolute)?;
    let mut lost = report::mapping_losses(&mapping, &made);
    if interrupted {
        lost.push(format!("interrupted after {} scans", truth.len()));
    }
    let usable = report::usable(&mapping, &made, 0);
    let losses: Vec<_> = lost.iter().cloned().chain(usable.loss()).collect();
    let mut full = report::full_report(name, Value::Null, &mut mapping, &made, &usable, &losses);
    full["against_truth"] = score.to_json();
    if let Some((_, value)) = &further {
        full["against_truth"]["sonars"] = value.clone();
    }
    mapping.output.write_json("report.json", &full)?;
    let timing = mapping.clock.report(mapping.tally.scans, mapping.tally.log_s());
    mapping.output.write_json("timing.json", &timing)?;
    let words = LastWords {
        name,
        usable: &usable,
        made: &made,
        timing: &timing,
        truth: score.to_words() + &further.map_or(String::new(), |(words, _)| words),
        losses: &lost,
        odd: &[],
        used: String::new(),
        folder: &args.output,
    };
    let words = words.of(&mapping);
    let files = mapping.output.commit()?;
    let voice = args.mapping.voice;
    if voice.json {
        say_json(&json!({ "files": files, "report": full, "timing": timing }))?;
    } else if !voice.quiet {
        say(&words)?;
    }
    Ok(Outcome::of_losses(&losses))
}

fn write_truth(mapping: &mut Mapping, truth: &[StampedPose]) -> Result<(), Failure> {
    mapping.output.write("truth.tum", |writer| {
        let mut trajectory = TumWriter::new(writer);
        truth.iter().try_for_each(|pose| trajectory.write_planar(pose.stamp, pose.world_from_robot))?;
        trajectory.finish().map(|_| ())
    })
}

/// The trajectory against the truth.
struct Score {
    absolute: Ate,
    relations: RelationReport,
}

impl Score {
    fn of(mapping: &Mapping, truth: &[StampedPose], args: &DemoArgs) -> Result<Self, Failure> {
        let estimate: Vec<_> = mapping
            .session()
            .trajectory()
            .map(|pose| StampedPose { stamp: pose.stamp, world_from_robot: pose.map_from_robot })
            .collect();
        let absolute = ate(truth, &estimate, Alignment::Rigid)
            .map_err(|cause| Failure::Score { path: args.output.clone(), cause })?;
        Ok(Self { absolute, relations: relation_errors(&estimate, &true_relations(truth)) })
    }

    fn to_words(&self) -> String {
        let metres = self.absolute.translation_m;
        let mut text = format!("truth    ATE rmse {:.3} m, at most {:.3} m\n", metres.rmse, metres.max);
        let rows = [("a few metres on", self.relations.within_10_s), ("met again later", self.relations.beyond_60_s)];
        for (what, errors) in rows.iter().filter_map(|(what, errors)| errors.map(|e| (what, e))) {
            text += &format!(
                "         {what}: relation error {:.4} m, {:.3} deg\n",
                errors.translation_m.mean, errors.rotation_deg.mean
            );
        }
        text
    }

    fn to_json(&self) -> Value {
        let mean = |errors: Option<mapwright_eval::PoseErrors>| {
            errors.map(|e| json!({ "translation_m": e.translation_m.mean, "rotation_deg": e.rotation_deg.mean }))
        };
        json!({
            "ate_rmse_m": self.absolute.translation_m.rmse,
            "ate_max_m": self.absolute.translation_m.max,
            "relation_error_within_10_s": mean(self.relations.within_10_s),
            "relation_error_beyond_60_s": mean(self.relations.beyond_60_s),
        })
    }
}
