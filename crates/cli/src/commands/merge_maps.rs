//! `mapwright merge-maps`

use crate::args::MergeMapsArgs;
use crate::failure::{Failure, Outcome};
use crate::foreign::kind_at;
use crate::output::write_whole;
use crate::terminal::{grouped, say, say_json};
use mapwright_formats::{
    FormatError, GridImage, MapDescription, UNKNOWN, read_map_image, read_map_yaml, write_map_yaml, write_pgm,
    write_tinted_png,
};
use mapwright_grid::{Alignment, Occupancy, OccupancyMap, Source, WallAgreement, align, join};
use serde_json::{Value, json};
use std::fs::File;
use std::io::{BufReader, BufWriter};
use std::path::{Path, PathBuf};

/// Colours of what a joined map has from each source, in the order of [`tint`]: the first map alone, the second alone, both, and where
/// they contradict each other.
const TINTS: [[u8; 3]; 4] = [[70, 130, 220], [230, 150, 40], [90, 90, 90], [205, 40, 90]];

pub(super) fn run(args: &MergeMapsArgs) -> Result<Outcome, Failure> {
    let yamls = [&args.first, &args.second].map(|path| yaml_of(path));
    let outputs = ["pgm", "yaml", "png"].map(|ending| with_ending(&args.output, ending));
    refuse_to_overwrite(&yamls, &outputs)?;
    let a = occupancy(&read(&yamls[0])?);
    let b = occupancy(&read(&yamls[1])?);
    let found = align(&a, &b)
        .map_err(|(which, cause)| Failure::Read { path: yamls[which].clone(), cause: cause.to_string() })?;
    let inputs = yamls.map(|path| path.display().to_string());
    if let Some(why) = found.refusal {
        if !args.voice.json && !args.voice.quiet {
            say(&words(&inputs, &found))?;
        }
        let [first, second] = inputs;
        return Err(Failure::NotJoined { first, second, why: why.to_string() });
    }
    let (joined, sources) = join(&a, &b, found.a_from_b)
        .map_err(|cause| Failure::Write { path: args.output.clone(), cause: cause.to_string() })?;
    write(&image(&joined), &sources, &outputs)?;
    if args.voice.json {
        say_json(&to_json(&inputs, &found, &joined, &sources, &outputs))?;
    } else if !args.voice.quiet {
        let size = format!("map      {}\n", size_words(&joined, &sources));
        let written = outputs.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(" ");
        say(&format!("{}{size}written  {written}\n", words(&inputs, &found)))?;
    }
    Ok(Outcome::Done)
}

/// Of a folder of results its map.
pub(crate) fn yaml_of(path: &Path) -> PathBuf {
    if path.is_dir() { path.join("map.yaml") } else { path.to_owned() }
}

fn with_ending(output: &Path, ending: &str) -> PathBuf {
    let given = output.extension().is_some_and(|given| ["pgm", "yaml", "png"].iter().any(|ending| given == *ending));
    let mut name = if given { output.with_extension("") } else { output.to_owned() }.into_os_string();
    name.push(format!(".{ending}"));
    PathBuf::from(name)
}

fn refuse_to_overwrite(yamls: &[PathBuf; 2], outputs: &[PathBuf; 3]) -> Result<(), Failure> {
    let place = |path: &PathBuf| path.canonicalize().ok();
    let images = yamls.iter().flat_map(|yaml| [yaml.with_extension("pgm"), yaml.with_extension("png"), yaml.clone()]);
    let inputs: Vec<_> = images.filter_map(|path| place(&path)).collect();
    match outputs.iter().find(|output| place(output).is_some_and(|output| inputs.contains(&output))) {
        Some(output) => {
            let why =
                format!("expected another name for the joined map, found {}, which is an input", output.display());
            Err(Failure::Usage(why))
        }
        None => Ok(()),
    }
}

/// The map that a YAML tells of.
pub(crate) fn read(yaml: &Path) -> Result<GridImage, Failure> {
    let opened = |path: &Path| match File::open(path) {
        Ok(_) if path.is_dir() => Err(Failure::open(path, "expected a file, found a directory")),
        Ok(file) => Ok(BufReader::new(file)),
        Err(error) => Err(Failure::open(path, error)),
    };
    let about: MapDescription = read_map_yaml(opened(yaml)?).map_err(|cause| not_a_map(yaml, cause))?;
    let beside = yaml.parent().unwrap_or(Path::new("."));
    let image = beside.join(&about.image);
    read_map_image(&about, opened(&image)?).map_err(|cause| Failure::read(&image, cause))
}

/// What a file is instead of a map's YAML, where that is known.
fn not_a_map(yaml: &Path, cause: FormatError) -> Failure {
    match (&cause, kind_at(yaml)) {
        (FormatError::MapFile { place, .. }, Some(kind)) if place == "map" => {
            Failure::Log(kind.instead(&yaml.display().to_string(), "the YAML of a map"))
        }
        _ => Failure::read(yaml, cause),
    }
}

fn occupancy(image: &GridImage) -> OccupancyMap {
    let cell = |&cell: &u8| match cell {
        0 => Occupancy::Free,
        100 => Occupancy::Occupied,
        _ => Occupancy::Unknown,
    };
    OccupancyMap {
        width: image.width,
        height: image.height,
        resolution_m: image.resolution_m,
        world_from_map: image.world_from_map,
        cells: image.cells.iter().map(cell).collect(),
    }
}

fn image(map: &OccupancyMap) -> GridImage {
    let cell = |cell: &Occupancy| match cell {
        Occupancy::Free => 0,
        Occupancy::Occupied => 100,
        Occupancy::Unknown => UNKNOWN,
    };
    GridImage {
        width: map.width,
        height: map.height,
        resolution_m: map.resolution_m,
        world_from_map: map.world_from_map,
        cells: map.cells.iter().map(cell).collect(),
    }
}

/// Number of the colour in [`TINTS`].
fn tint(source: &Source) -> Option<u8> {
    match source {
        Source::Neither => None,
        Source::A => Some(0),
        Source::B => Some(1),
        Source::Both => Some(2),
        Source::Contradicted => Some(3),
    }
}

fn write(map: &GridImage, sources: &[Source], [pgm, yaml, png]: &[PathBuf; 3]) -> Result<(), Failure> {
    let whole = |path: &Path, write: &dyn Fn(&mut BufWriter<File>) -> Result<(), FormatError>| {
        write_whole(path, |writer| write(writer).map_err(|cause| Failure::write(path, cause)))
    };
    let name = pgm.file_name().unwrap_or_default().to_string_lossy();
    let tints: Vec<u8> = sources.iter().map(|source| tint(source).unwrap_or(u8::MAX)).collect();
    whole(pgm, &|writer| write_pgm(map, writer))?;
    whole(png, &|writer| write_tinted_png(map, &tints, &TINTS, writer))?;
    whole(yaml, &|writer| write_map_yaml(map, &name, writer))
}

fn words([first, second]: &[String; 2], found: &Alignment) -> String {
    let pose = found.a_from_b;
    let [x, y, heading] = found.deviations();
    let of = |name: &str, other: &str, walls: &WallAgreement| {
        format!(
            "{:.1} m of {name}'s walls, {:.0} % of those that {other} looked at",
            walls.confirmed_m,
            100.0 * walls.share()
        )
    };
    let rival = found.rival.map_or("none".to_owned(), |(pose, evidence)| {
        format!(
            "x {:.2} m, y {:.2} m, heading {:.1} deg; {:.1} m of wall speak for it",
            pose.x,
            pose.y,
            pose.theta.to_degrees(),
            evidence.support_m
        )
    });
    format!(
        "{second} in {first}: x {:.3} m, y {:.3} m, heading {:.2} deg (deviations {:.3} m, {:.3} m, {:.2} deg)\n\
         support  {:.1} m of wall speak for it, {:.0} % of what is in the overlap is in both\n\
         walls    {}; {}\n\
         overlap  {:.1} m2\n\
         misfit   walls of both maps lie {:.3} m apart in the median, 95 % of them within {:.3} m\n\
         rival    {rival}\n\
         tried    {} headings, shifts in steps of {:.2} m, the best of them refined\n\
         decided  {}\n",
        pose.x,
        pose.y,
        pose.theta.to_degrees(),
        x,
        y,
        heading.to_degrees(),
        found.evidence.support_m,
        100.0 * found.evidence.share(),
        of("A", "B", &found.evidence.of_a),
        of("B", "A", &found.evidence.of_b),
        found.overlap_m2,
        found.misfit_m[0],
        found.misfit_m[1],
        found.headings,
        found.step_m,
        if found.refusal.is_some() {
            "not joined"
        } else {
            "joined: walls agree, and no other pose fits nearly as well"
        },
    )
}

fn size_words(map: &OccupancyMap, sources: &[Source]) -> String {
    let area = |which: Source| {
        let cells = sources.iter().filter(|source| **source == which).count();
        cells as f64 * map.resolution_m * map.resolution_m
    };
    format!(
        "{} x {} cells of {} m: {:.1} m2 of A alone, {:.1} m2 of B alone, {:.1} m2 of both, {:.1} m2 where one has a wall and the \
         other none",
        grouped(map.width as u64),
        grouped(map.height as u64),
        map.resolution_m,
        area(Source::A),
        area(Source::B),
        area(Source::Both),
        area(Source::Contradicted)
    )
}

fn to_json(
    [first, second]: &[String; 2],
    found: &Alignment,
    joined: &OccupancyMap,
    sources: &[Source],
    outputs: &[PathBuf; 3],
) -> Value {
    let walls = |walls: &WallAgreement| {
        json!({
            "confirmed_m": walls.confirmed_m,
            "contradicted_m": walls.contradicted_m,
            "share": walls.share(),
        })
    };
    let pose = |pose: mapwright::Pose2| json!([pose.x, pose.y, pose.theta]);
    let covariance: Vec<Vec<f64>> = (0..3).map(|row| (0..3).map(|k| found.covariance[(row, k)]).collect()).collect();
    json!({
        "a": first,
        "b": second,
        "a_from_b": pose(found.a_from_b),
        "covariance": covariance,
        "deviations": found.deviations(),
        "support_m": found.evidence.support_m,
        "share": found.evidence.share(),
        "walls_of_a": walls(&found.evidence.of_a),
        "walls_of_b": walls(&found.evidence.of_b),
        "overlap_m2": found.overlap_m2,
        "overlap_middle_b": found.overlap_middle_b,
        "misfit_median_m": found.misfit_m[0],
        "misfit_95_m": found.misfit_m[1],
        "rival": found.rival.map(|(at, evidence)| json!({ "a_from_b": pose(at), "support_m": evidence.support_m })),
        "headings": found.headings,
        "step_m": found.step_m,
        "cells": [joined.width, joined.height],
        "cells_contradicted": sources.iter().filter(|source| **source == Source::Contradicted).count(),
        "written": outputs.iter().map(|path| path.display().to_string()).collect::<Vec<_>>(),
    })
}
