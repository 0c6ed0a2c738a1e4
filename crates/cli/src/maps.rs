//! The maps of a session: what each file shows, and what it is called.

use crate::advice::{numbered, seen_from};
use crate::drawing::{draw_believed, wall_angle};
use crate::failure::Failure;
use crate::image::{MapImage, map_image};
use crate::output::OutputFolder;
use crate::picture::{MapOfRuns, RunNames};
use crate::sonar::Sonars;
use mapwright::{Advice, CountGrid, KeyframeId, Pose2, SeparateMap, Session, Settings, Stamp, Visits};
use mapwright_formats::{Confidence, Frame, Picture, Runs, write_map_yaml, write_pgm, write_png};
use mapwright_geom::Pose;
use mapwright_record::Measurement;
use serde_json::{Value, json};

/// What `mapwright report` makes of a folder.
pub(crate) const PAGE: &str = "report.html";
/// What there is of each map.
const ENDINGS: [&str; 4] = ["png", "pgm", "yaml", "ply"];

/// The name of a file of a map, the first one's without a number.
pub(crate) fn map_file(map: usize, ending: &str) -> String {
    if map == 0 { format!("map.{ending}") } else { format!("map-{}.{ending}", map + 1) }
}

/// With the folder's commit the files go that an earlier run with more maps has left in it, and the page that shows them.
pub(crate) fn remove_outdated_maps(output: &mut OutputFolder, maps: usize) {
    output.remove_outdated(PAGE.to_owned());
    for map in maps.. {
        let files = ENDINGS.map(|ending| output.remove_outdated(map_file(map, ending)));
        if files == [false; ENDINGS.len()] {
            return;
        }
    }
}

/// The names that exports have unless they are given others, and what lies beside them.
pub(crate) const EXPORTS: [&str; 14] = [
    "export.tum",
    "export.kitti",
    "export.times",
    "export.csv",
    "export.mcap",
    "export.pgm",
    "export.yaml",
    "map_plain.png",
    "map_plain.pgw",
    "export.ply",
    "export.pcd",
    "export.bt",
    "mesh.glb",
    "mesh.ply",
];

/// With the folder's commit the files go that `mapwright export` has made there of an earlier run, under the names that it gives
/// them; in words, if there are any.
pub(crate) fn remove_outdated_exports(output: &mut OutputFolder) -> Option<String> {
    let mut gone: Vec<String> =
        EXPORTS.map(str::to_owned).into_iter().filter(|name| output.remove_outdated(name.clone())).collect();
    for map in 2.. {
        let files = ["glb", "ply"].map(|ending| format!("mesh-{map}.{ending}"));
        let is_new = files.iter().any(|name| output.has_begun(name));
        let found: Vec<String> = files.into_iter().filter(|name| output.remove_outdated(name.clone())).collect();
        if found.is_empty() && !is_new {
            break;
        }
        gone.extend(found);
    }
    (!gone.is_empty()).then(|| format!("exports of the results before are gone: {}", gone.join(" ")))
}

/// What a map's files show, for report and people.
#[derive(Debug, Clone)]
pub(crate) struct MadeMap {
    pub(crate) cells: [usize; 2],
    /// Sides of what the picture shows, metres.
    pub(crate) sides_m: [f64; 2],
    pub(crate) cells_left_out: u64,
    pub(crate) keyframes_left_out: Vec<KeyframeId>,
    pub(crate) wall_angle_rad: Option<f64>,
    pub(crate) advice: Advice,
    pub(crate) visits: Visits,
}

impl MadeMap {
    /// For `report.json`.
    pub(crate) fn to_json(&self) -> Value {
        json!({
            "cells": self.cells,
            "cells_left_out": self.cells_left_out,
            "keyframes_left_out": self.keyframes_left_out.len(),
            "wall_angle_rad": self.wall_angle_rad,
            "visits": {
                "compared": self.visits.compared,
                "misfits": self.visits.misfits,
                "mean_m": self.visits.mean_m,
                "percentile_90_m": self.visits.percentile_90_m,
            },
        })
    }
}

/// How maps are written.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MapWriter<'a> {
    pub(crate) settings: &'a Settings,
    pub(crate) session: &'a Session,
    /// What the mapper has drawn already of a session of one map, if that is all of it.
    pub(crate) drawn: Option<&'a CountGrid>,
    /// Sonars that all the maps are of.
    pub(crate) sonars: Option<&'a Sonars>,
    pub(crate) turn_upright: bool,
    /// Longer side of a picture, pixels, where it was asked for.
    pub(crate) picture_side: Option<u16>,
    /// What runs are called, where there are several.
    pub(crate) names: &'a RunNames,
}

impl MapWriter<'_> {
    /// Writes the three files of a map; `number` counts from zero, and `way` is that of the robot within it, where it is one run.
    pub(crate) fn write(
        &self,
        output: &mut OutputFolder,
        (number, map): (usize, &SeparateMap),
        way: &[Pose2],
    ) -> Result<MadeMap, Failure> {
        let (drawn, keyframes_left_out) = self.render(map);
        let image = &drawn.image;
        let pgm = map_file(number, "pgm");
        output.write(pgm.clone(), |writer| write_pgm(image, writer))?;
        output.write(map_file(number, "yaml"), |writer| write_map_yaml(image, &pgm, writer))?;
        let wall_angle_rad = if self.turn_upright { wall_angle(&drawn) } else { None };
        let advice = Advice::of_map(self.session, map);
        let (seen_from, places) = (seen_from(self.session, map, &advice), numbered(&advice));
        let runs = MapOfRuns::of(self.session, map, self.names);
        let picture = Picture {
            world_from_robot: if runs.is_some() { &[] } else { way },
            runs: runs.as_ref().map(|runs| Runs { ways: &runs.ways, meetings: &runs.meetings }),
            level_rad: wall_angle_rad.unwrap_or(0.0),
            seen: Some(&drawn.seen),
            confidence: Some(Confidence { seen_from: &seen_from, places: &places }),
            side_px: self.picture_side.map(usize::from),
            ..Picture::default()
        };
        let frame = Frame::of(image, &picture);
        let picture = Picture { frame: Some(frame), ..picture };
        output.write(map_file(number, "png"), |writer| write_png(image, &picture, writer))?;
        Ok(MadeMap {
            cells: [image.width, image.height],
            sides_m: frame.sides_m(),
            cells_left_out: drawn.cells_left_out,
            keyframes_left_out,
            wall_angle_rad,
            advice,
            visits: Visits::of_map(self.session, map, self.settings),
        })
    }

    /// What sonars heard beside a laser, drawn along its trajectory: `sonar.pgm`, `sonar.yaml` and `sonar.png`.
    pub(crate) fn write_sonars(&self, output: &mut OutputFolder, sonars: &Sonars) -> Result<(), Failure> {
        let trajectory: Vec<_> = self.session.trajectory().map(|pose| (pose.stamp, pose.map_from_robot)).collect();
        let drawn = map_image(&sonars.draw(&trajectory), self.settings.map.passes_per_hit);
        let way: Vec<_> = trajectory.iter().map(|(_, pose)| *pose).collect();
        let picture = Picture {
            world_from_robot: &way,
            seen: Some(&drawn.seen),
            side_px: self.picture_side.map(usize::from),
            ..Picture::default()
        };
        output.write("sonar.pgm", |writer| write_pgm(&drawn.image, writer))?;
        output.write("sonar.yaml", |writer| write_map_yaml(&drawn.image, "sonar.pgm", writer))?;
        output.write("sonar.png", |writer| write_png(&drawn.image, &picture, writer))
    }

    /// The trajectory's poses that belong to a map.
    fn poses_within(&self, map: &SeparateMap) -> Vec<(Stamp, Pose2)> {
        let scans = self.session.scans().iter().zip(self.session.trajectory());
        let is_within =
            |id: Option<KeyframeId>| id.and_then(|id| self.session.place(id)).is_some_and(|place| map.has(place));
        let within = scans.filter(|(scan, _)| is_within(scan.keyframe));
        within.map(|(_, pose)| (pose.stamp, pose.map_from_robot)).collect()
    }

    /// Its keyframes at their present poses, and the names of those that are left out.
    fn render(&self, map: &SeparateMap) -> (MapImage, Vec<KeyframeId>) {
        let passes_per_hit = self.settings.map.passes_per_hit;
        if let Some(counts) = self.drawn {
            return (map_image(counts, passes_per_hit), Vec::new());
        }
        if let Some(sonars) = self.sonars {
            return (map_image(&sonars.draw(&self.poses_within(map)), passes_per_hit), Vec::new());
        }
        let (counts, left_out) = draw_believed(self.settings, self.session, map);
        (map_image(&counts, passes_per_hit), left_out)
    }
}

/// The ways of the robot within each map, and their length over all poses, metres; what lies between two maps is no way.
pub(crate) fn ways<M: Measurement>(session: &Session<M>, maps: &[SeparateMap]) -> (Vec<Vec<M::Pose>>, f64) {
    let map_of = |place: usize| maps.iter().position(|map| map.has(place));
    let by_place: Vec<usize> = (0..session.keyframes().len()).map(|place| map_of(place).unwrap_or(0)).collect();
    let (mut ways, mut length_m) = (vec![Vec::new(); maps.len().max(1)], 0.0);
    let mut last: Option<(usize, M::Pose)> = None;
    for (scan, pose) in session.scans().iter().zip(session.trajectory()) {
        let place = scan.keyframe.and_then(|id| session.place(id));
        let map = place.and_then(|place| by_place.get(place).copied()).unwrap_or(0);
        let pose = pose.map_from_robot;
        length_m += last.filter(|(of, _)| *of == map).map_or(0.0, |(_, last)| pose.distance(last));
        last = Some((map, pose));
        ways[map].push(pose);
    }
    (ways, length_m)
}
