//! `mapwright fleet status`

use super::join::wire_settings;
use super::robot::RobotFiles;
use super::told::{SUBJECT, Told, plain};
use crate::args::FleetStatusArgs;
use crate::failure::{Failure, Outcome};
use crate::interrupt::Interrupt;
use crate::terminal::{count, say, say_json};
use mapwright_net::{Wire, WireSettings};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

const TICK: Duration = Duration::from_millis(50);

pub(super) fn run(args: &FleetStatusArgs) -> Result<Outcome, Failure> {
    let robot = RobotFiles::read(&args.config)?;
    let interrupt = Interrupt::watch()?;
    // It speaks to nobody, and listens nowhere: the robot itself may be running, and is asked as well.
    let connect = robot.team.robot.iter().map(|member| member.address.clone()).chain(robot.connect.iter().cloned());
    let mut connect: Vec<String> = connect.collect();
    connect.sort();
    connect.dedup();
    let settings = WireSettings { listen: Vec::new(), connect, ..wire_settings(&robot) };
    let failed = |cause: mapwright_net::NetError| Failure::Usage(cause.to_string());
    let wire = Wire::overhear(settings, &robot.credentials, SUBJECT).map_err(failed)?;
    let begun = Instant::now();
    let mut told: BTreeMap<String, (Instant, Told)> = BTreeMap::new();
    let names = robot.names();
    while begun.elapsed().as_secs_f64() < args.seconds && !interrupt.came() {
        if let Some(arrival) = wire.receive(TICK)
            && let Some(said) = Told::decode(&arrival.bytes)
            && names.contains(&arrival.from)
        {
            told.insert(arrival.from, (Instant::now(), said));
        }
    }
    let rows: Vec<Row<'_>> = names.iter().map(|name| Row::of(name, &told)).collect();
    let links: Vec<String> = wire.links().into_iter().map(|link| link.name).collect();
    let complaints = wire.complaints();
    if args.json {
        let robots: Vec<Value> = rows.iter().map(Row::to_json).collect();
        let complaints: Vec<Value> =
            complaints.iter().map(|said| json!({ "what": plain(&said.what), "times": said.times })).collect();
        say_json(&json!({ "team": robot.team.team, "robots": robots, "links": links, "complaints": complaints }))?;
    } else {
        let mut lines: Vec<String> = rows.iter().flat_map(Row::words).collect();
        if told.len() < names.len() {
            lines.extend(complaints.iter().map(|said| format!("  {}", plain(&said.what))));
        }
        say(&(lines.join("\n") + "\n"))?;
    }
    Ok(if told.is_empty() { Outcome::WithLoss } else { Outcome::Done })
}

/// What is known of a robot: by itself, and by others.
struct Row<'a> {
    name: &'a str,
    told: Option<(f64, &'a Told)>,
    /// Who has heard it last, and how long ago, seconds.
    heard: Option<(&'a str, f64)>,
}

impl<'a> Row<'a> {
    fn of(name: &'a str, told: &'a BTreeMap<String, (Instant, Told)>) -> Self {
        let own = told.get(name).map(|(at, told)| (at.elapsed().as_secs_f64(), told));
        let by_others = told.iter().flat_map(|(who, (at, told))| {
            let since_s = at.elapsed().as_secs_f64();
            let heard = told.hears.iter().filter(|heard| heard.robot == name);
            heard.map(move |heard| (who.as_str(), heard.age_s + since_s))
        });
        let heard = by_others.min_by(|a, b| a.1.total_cmp(&b.1));
        Self { name, told: own, heard }
    }

    fn records(told: &Told) -> u64 {
        told.holds.iter().map(|held| u64::from(held.records)).sum()
    }

    fn words(&self) -> Vec<String> {
        let name = self.name;
        let heard = self.heard.map(|(who, age_s)| format!("; {who} heard it {age_s:.1} s ago"));
        let Some((age_s, told)) = self.told else {
            return vec![format!("{name}: not reached{}", heard.unwrap_or_default())];
        };
        let solves = if told.solves { ", solves" } else { "" };
        let over = if told.log_is_over { ", its log is over" } else { "" };
        let mut lines = vec![format!(
            "{name}: {age_s:.1} s ago{solves}{over}; {}, {} of all in its map, holds {}{}",
            count(told.keyframes, "keyframe"),
            told.in_map,
            count(Self::records(told), "record"),
            heard.unwrap_or_default(),
        )];
        let hears: Vec<String> =
            told.hears.iter().map(|heard| format!("{} {:.1} s ago", heard.robot, heard.age_s)).collect();
        lines.push(format!("  hears {}", if hears.is_empty() { "nobody".to_owned() } else { hears.join(", ") }));
        for held in &told.holds {
            lines.push(format!(
                "  holds {} of {}, session {}",
                count(u64::from(held.records), "record"),
                held.robot,
                held.session
            ));
        }
        for refused in &told.refused {
            let of = refused.of.as_ref().map_or(String::new(), |of| format!(" of {of}"));
            lines.push(format!("  refused{of}, {}: {}", count(refused.times, "time"), refused.why));
        }
        lines.iter().map(|line| plain(line)).collect()
    }

    fn to_json(&self) -> Value {
        json!({
            "name": self.name,
            "age_s": self.told.map(|(age_s, _)| age_s),
            "heard_by": self.heard.map(|(who, age_s)| json!({ "robot": who, "age_s": age_s })),
            "records": self.told.map(|(_, told)| Self::records(told)),
            "says": self.told.map(|(_, told)| json!(told)),
        })
    }
}
