//! `mapwright fleet keys`

use super::robot::{AUTHORITY, CERTIFICATE, MemberToml, PRIVATE_KEY, ROBOT, SIGNING_KEY, TEAM, TeamToml, hex};
use super::state::{make_private, private};
use crate::args::FleetKeysArgs;
use crate::failure::{Failure, Outcome};
use crate::terminal::{say, say_json};
use mapwright_fleet::{Roster, Secret};
use mapwright_net::{Authority, NetError, is_team_name, random_bytes};
use serde_json::json;
use std::fs;
use std::io::Write;
use std::path::Path;

/// Where the others find a robot for which none is given.
const PORT: u16 = 7447;
/// For so many days who says which certificates are of the team may say so; certificates of robots end before.
const AUTHORITY_DAYS: u32 = 3650;
/// The authority's private key: needed to make certificates, and nowhere else.
const AUTHORITY_KEY: &str = "authority.key";

pub(super) fn run(args: &FleetKeysArgs) -> Result<Outcome, Failure> {
    let asked = args.robots.iter().map(|robot| Asked::read(robot)).collect::<Result<Vec<_>, _>>()?;
    let path = args.output.join(TEAM);
    let mut team =
        if path.exists() { TeamToml::read(&path)? } else { TeamToml { team: args.team.clone(), robot: Vec::new() } };
    check(args, &asked, &team)?;
    let before: Vec<String> = team.robot.iter().map(|member| member.name.clone()).collect();
    make_private(&args.output)?;
    let authority = authority(args, &team.team)?;
    let days = args.days.min(AUTHORITY_DAYS);
    let mut secrets = Vec::new();
    for robot in &asked {
        let secret = random_bytes().map_err(not_made)?;
        let key = hex(&Secret::from_bytes(&secret).public());
        let member = MemberToml { name: robot.name.clone(), address: robot.address.clone(), key };
        team.robot.retain(|known| known.name != member.name);
        team.robot.push(member);
        secrets.push(secret);
    }
    team.robot.sort_by(|a, b| a.name.cmp(&b.name));
    for (robot, secret) in asked.iter().zip(&secrets) {
        let folder = args.output.join(&robot.name);
        make_private(&folder)?;
        let issued = authority.issue(&robot.name, days).map_err(not_made)?;
        write(&folder.join(SIGNING_KEY), &format!("{}\n", hex(secret)))?;
        write(&folder.join(PRIVATE_KEY), &issued.private_key_pem)?;
        write(&folder.join(CERTIFICATE), &issued.certificate_pem)?;
        write(&folder.join(AUTHORITY), authority.certificate_pem())?;
        write(&folder.join(ROBOT), &robot.to_toml(&team.team, &args.router))?;
    }
    for name in &args.router {
        let folder = args.output.join(name);
        make_private(&folder)?;
        let issued = authority.issue(name, days).map_err(not_made)?;
        write(&folder.join(PRIVATE_KEY), &issued.private_key_pem)?;
        write(&folder.join(CERTIFICATE), &issued.certificate_pem)?;
        write(&folder.join(AUTHORITY), authority.certificate_pem())?;
    }
    let text = team.to_toml();
    for member in &team.robot {
        let folder = args.output.join(&member.name);
        if folder.is_dir() {
            write(&folder.join(TEAM), &text)?;
        }
    }
    write(&path, &text)?;
    told(args, &asked, &before, days)
}

/// Nothing is touched where something is wrong.
fn check(args: &FleetKeysArgs, asked: &[Asked], team: &TeamToml) -> Result<(), Failure> {
    if team.team != args.team && args.team != "team" {
        let cause = format!("expected the team {}, found {}", args.team, team.team);
        return Err(Failure::Config { path: args.output.join(TEAM), cause });
    }
    for name in [&args.team].into_iter().chain(&args.router) {
        if !is_team_name(name) {
            return Err(Failure::Usage(NetError::Name { found: name.clone() }.to_string()));
        }
    }
    let known = |name: &str| team.robot.iter().any(|member| member.name == name) || args.output.join(name).exists();
    let names = || asked.iter().map(|robot| &robot.name).chain(&args.router);
    if let Some(name) = names().find(|name| *name == "authority") {
        return Err(Failure::Usage(format!("{name}: expected another name, found that of the authority's folder")));
    }
    if let Some(name) = names().find(|name| known(name) && !args.force) {
        return Err(Failure::Usage(format!(
            "{} has keys already; --force makes new ones, and the old ones are not believed any more",
            args.output.join(name).display()
        )));
    }
    // What a roster refuses is refused here.
    let keys = names().enumerate().map(|(k, name)| {
        let mut number = [0; 32];
        number[..8].copy_from_slice(&(k as u64 + 1).to_le_bytes());
        (name.clone(), Secret::from_bytes(&number).public())
    });
    Roster::new(keys).map(drop).map_err(|cause| Failure::Usage(cause.to_string()))
}

fn authority(args: &FleetKeysArgs, team: &str) -> Result<Authority, Failure> {
    let folder = args.output.join("authority");
    let [certificate, key] = [AUTHORITY, AUTHORITY_KEY].map(|name| folder.join(name));
    if certificate.exists() || key.exists() {
        let read = |path: &Path| fs::read_to_string(path).map_err(|error| Failure::open(path, error));
        let authority = Authority::read(team, &read(&certificate)?, &read(&key)?);
        return authority.map_err(|cause| Failure::Config { path: folder, cause: cause.to_string() });
    }
    if args.output.join(TEAM).exists() {
        let cause = "expected the authority that has made this team's certificates, found none".to_owned();
        return Err(Failure::Config { path: folder, cause });
    }
    make_private(&folder)?;
    let authority = Authority::new(team, AUTHORITY_DAYS).map_err(not_made)?;
    write(&key, &authority.private_key_pem())?;
    write(&certificate, authority.certificate_pem())?;
    Ok(authority)
}

fn told(args: &FleetKeysArgs, asked: &[Asked], before: &[String], days: u32) -> Result<Outcome, Failure> {
    let names: Vec<&str> = asked.iter().map(|robot| robot.name.as_str()).collect();
    let others: Vec<&String> = before.iter().filter(|name| !names.contains(&name.as_str())).collect();
    if args.voice.json {
        say_json(&json!({ "made": names, "days": days, "needs_team_toml": others }))?;
        return Ok(Outcome::Done);
    }
    let mut lines: Vec<String> = asked.iter().map(|robot| line_of(args, robot)).collect();
    for name in &args.router {
        lines.push(format!("{}: for the router; a certificate for {days} days", args.output.join(name).display()));
    }
    lines.push(format!("certificates are valid for {days} days"));
    lines.push(format!(
        "{} stays here: whoever has it can add robots to the team",
        args.output.join("authority").display()
    ));
    if !others.is_empty() {
        let others = others.iter().map(|name| name.as_str()).collect::<Vec<_>>().join(", ");
        lines.push(format!("{} has changed: {others} need it too", args.output.join(TEAM).display()));
    }
    if !args.voice.quiet {
        say(&(lines.join("\n") + "\n"))?;
    }
    Ok(Outcome::Done)
}

fn line_of(args: &FleetKeysArgs, robot: &Asked) -> String {
    let folder = args.output.join(&robot.name);
    format!("{}: copy it to {} alone, found at {}", folder.display(), robot.name, robot.address)
}

/// A file that its owner alone may read; under its name when it is complete.
fn write(path: &Path, text: &str) -> Result<(), Failure> {
    let part = path.with_extension("part");
    let written = || -> std::io::Result<()> {
        let _ = fs::remove_file(&part); // of an attempt before, with who knows which mode
        let mut file = private().create_new(true).open(&part)?;
        file.write_all(text.as_bytes())?;
        file.sync_all()?;
        fs::rename(&part, path)
    };
    written().map_err(|error| Failure::write(path, error))
}

fn not_made(cause: NetError) -> Failure {
    Failure::Usage(cause.to_string())
}

/// A robot that keys are asked for.
struct Asked {
    name: String,
    address: String,
    listen: String,
}

impl Asked {
    fn read(text: &str) -> Result<Self, Failure> {
        let (name, place) = text.split_once('@').unwrap_or((text, ""));
        let refused = |cause: String| Failure::Usage(format!("{text}: {cause}"));
        if !is_team_name(name) {
            return Err(refused(NetError::Name { found: name.to_owned() }.to_string()));
        }
        let (host, port) = host_and_port(place).ok_or_else(|| {
            refused("expected NAME, NAME@HOST or NAME@HOST:PORT, such as anna@192.168.1.7:7447".to_owned())
        })?;
        let host = if host.is_empty() { name } else { host };
        let is_local = host == "localhost" || host.starts_with("127.") || host == "[::1]";
        let any = if host.starts_with('[') { "[::]" } else { "0.0.0.0" };
        let listen = format!("tls/{}:{port}", if is_local { host } else { any });
        Ok(Self { name: name.to_owned(), address: format!("tls/{host}:{port}"), listen })
    }

    fn to_toml(&self, team: &str, relays: &[String]) -> String {
        let Self { name, listen, .. } = self;
        let relays = match relays {
            [] => "# relays = [\"hub\"]        # common names of routers that may pass on what any robot says\n"
                .to_owned(),
            names => format!("relays = {names:?}\n"),
        };
        format!(
            "# {name}, a robot of the team {team}; paths are relative to this file.
name = \"{name}\"
team = \"{TEAM}\"               # who is in the team: the same file on all robots
certificate = \"{CERTIFICATE}\"
authority = \"{AUTHORITY}\"       # who says which certificates are of the team
private_key = \"{PRIVATE_KEY}\"     # secret
signing_key = \"{SIGNING_KEY}\"     # secret
state = \"state\"                 # folder of what the robot must not forget
listen = [\"{listen}\"]
# connect = [\"tls/HOST:PORT\"]   # otherwise the addresses in {TEAM} of those whose names come before
{relays}
# [settings.map]                # any setting of `mapwright config`; the same on all robots
# resolution_m = 0.05
"
        )
    }
}

/// Of HOST, HOST:PORT or nothing.
fn host_and_port(place: &str) -> Option<(&str, u16)> {
    let end = if place.starts_with('[') { place.find(']')? + 1 } else { place.find(':').unwrap_or(place.len()) };
    let (host, rest) = place.split_at(end);
    let is_host = |byte: u8| byte.is_ascii_alphanumeric() || b".-_:[]".contains(&byte);
    let port = match rest.strip_prefix(':') {
        None if rest.is_empty() => PORT,
        Some(port) => port.parse().ok().filter(|port| *port > 0)?,
        None => return None,
    };
    host.bytes().all(is_host).then_some((host, port))
}
