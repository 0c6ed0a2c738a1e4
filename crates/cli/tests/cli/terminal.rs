//! What is said on a terminal and what into a pipe: wrapped lines, colours, the bar.

use crate::support::{assert_code, folder, run, small_log_in, text, three_rooms};
use mapwright_geom::Pose2;
use std::fs;
use std::process::{Command, Stdio};

/// What a command writes to a terminal that is so many columns wide; none where no `script` of util-linux makes one.
fn on_terminal(command: &str, columns: usize, environment: &[(&str, &str)]) -> Option<String> {
    let line = format!("stty cols {columns} rows 40; {command}");
    let mut script = Command::new("script");
    script.args(["-qec", &line, "/dev/null"]).stdin(Stdio::null());
    for variable in ["NO_COLOR", "CLICOLOR", "CLICOLOR_FORCE", "CI"] {
        script.env_remove(variable);
    }
    script.env("TERM", "xterm");
    script.envs(environment.iter().copied());
    let Ok(output) = script.output() else {
        eprintln!("a terminal: skipped: no `script` of util-linux");
        return None;
    };
    Some(text(&output.stdout).replace("\r\n", "\n"))
}

fn mapped(name: &str) -> (String, String) {
    let folder = folder(name);
    let log = small_log_in(&folder);
    let out = folder.join("out").display().to_string();
    (format!("{} map {log} -o {out}", env!("CARGO_BIN_EXE_mapwright")), out)
}

/// Without the codes of colours.
fn plain(text: &str) -> String {
    let mut rest = text.split('\u{1b}');
    let first = rest.next().unwrap_or_default().to_owned();
    rest.fold(first, |text, part| text + part.split_once('m').map_or("", |(_, part)| part))
}

#[test]
fn a_pipe_gets_whole_lines_without_colours() {
    let folder = folder("piped");
    let (log, out) = (small_log_in(&folder), folder.join("out").display().to_string());
    let output = run(&["map", &log, "-o", &out]);
    assert_code(&output, 0);
    let said = text(&output.stdout);
    assert!(!said.contains('\u{1b}') && output.stderr.is_empty(), "{said}");
    let written = said.lines().find(|line| line.starts_with("written  ")).unwrap();
    assert!(written.len() > 120 && written.ends_with("timing.json"), "{written}");
    // the verdict first, then numbers, what is there, and details last
    let at =
        |what: &str| said.lines().position(|line| line.starts_with(what)).unwrap_or_else(|| panic!("{what}: {said}"));
    assert_eq!(at("good     "), 0);
    assert!(at("map      ") < at("speed    ") && at("speed    ") < at("written  "), "{said}");
    let always = text(&run(&["map", &log, "-o", &out, "--color", "always"]).stdout);
    assert!(always.starts_with("\u{1b}[1m\u{1b}[32mgood\u{1b}[0m     "), "{always:?}");
    assert_eq!(plain(&always).lines().next(), said.lines().next());
}

#[test]
fn a_terminal_gets_lines_wrapped_at_words_and_a_coloured_verdict() {
    let (command, _) = mapped("terminal");
    let Some(said) = on_terminal(&format!("{command} 2>/dev/null"), 60, &[]) else { return };
    assert!(said.starts_with("\u{1b}[1m\u{1b}[32mgood\u{1b}[0m     "), "{said:?}");
    let lines: Vec<String> = plain(&said).lines().map(str::to_owned).collect();
    let is_one_word = |line: &str| !line.trim().contains(' ');
    for line in &lines {
        assert!(line.chars().count() <= 60 || is_one_word(line), "{line:?}");
    }
    let written = lines.iter().position(|line| line.starts_with("written  ")).unwrap();
    assert!(lines[written + 1].starts_with("         "), "{:?}", &lines[written..]);
    for environment in [&[("NO_COLOR", "1")][..], &[("TERM", "dumb")], &[("TERM", "dumb"), ("CI", "true")]] {
        let said = on_terminal(&format!("{command} 2>/dev/null"), 60, environment).unwrap();
        assert!(said.starts_with("good     "), "{environment:?}: {said:?}");
    }
    let never = on_terminal(&format!("{command} --color never 2>/dev/null"), 60, &[]).unwrap();
    assert!(never.starts_with("good     "), "{never:?}");
}

#[test]
fn a_bar_with_the_time_left_stands_on_a_terminal_alone() {
    let folder = folder("bar");
    let log = folder.join("long.clf");
    fs::write(&log, three_rooms(600.0, Pose2::IDENTITY, Pose2::IDENTITY)).unwrap();
    let out = folder.join("out");
    let command = format!("{} map {} -o {}", env!("CARGO_BIN_EXE_mapwright"), log.display(), out.display());
    let bar = |more: &str, environment: &[(&str, &str)]| {
        on_terminal(&format!("{command} {more} >/dev/null"), 120, environment)
    };
    let Some(drawn) = bar("", &[]) else { return };
    assert!(drawn.contains(" s left, ") && drawn.contains(" %  ") && drawn.contains("x real time"), "{drawn:?}");
    for (more, environment) in [("--quiet", &[][..]), ("--json", &[]), ("", &[("TERM", "dumb")])] {
        assert_eq!(bar(more, environment).unwrap(), "", "{more} {environment:?}");
    }
}
