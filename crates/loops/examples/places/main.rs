//! How often a place seen before is among the first hits, by descriptor; what that costs; what verifying a hit costs.
//!
//! `cargo run --release -p mapwright-loops --example places [SEEDS] [NAME LOG TRAJECTORY.tum]...`

#![allow(clippy::print_stdout)]

mod recordings;
mod rivals;

use mapwright_geom::{Pose2, wrap_angle};
use mapwright_grid::{Change, CorrelativeSearch, LocalMap, LocalMapSettings, SearchWindow};
use mapwright_loops::PlaceIndex;
use mapwright_record::NodeId;
use mapwright_sensor::SweepPoints;
use mapwright_sim::{DriveSettings, kidnapping, worlds};
use recordings::{APART_M, Recording};
use rivals::Rival;
use std::error::Error;
use std::f64::consts::PI;
use std::sync::Arc;
use std::time::Instant;

const SUBMAP_M: f64 = 7.0;
const NEIGHBOURS: usize = 4;
/// Seeds below were looked at while choosing.
const FIRST_SEED: u64 = 11;
type Found = Vec<(u32, f64)>;
type Views = Vec<Vec<[f64; 2]>>;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let seeds = arguments.first().map_or(Ok(10), |text| text.parse::<u64>())?;
    let mut worlds = simulated(seeds);
    for log in arguments.get(1..).unwrap_or_default().chunks_exact(3) {
        worlds.push((log[0].clone(), vec![Recording::real(&log[1], &log[2])?]));
    }
    for length_m in [0.0, SUBMAP_M] {
        println!("\npoints of the last {length_m} m; same direction | opposite direction");
        println!("descriptor  world       asked  @1  @5 @10 @20  @10 in 3 m  heading");
        for (name, recordings) in &worlds {
            table(name, recordings, length_m);
        }
    }
    kidnapped(seeds);
    costs(&worlds);
    Ok(())
}

fn simulated(seeds: u64) -> Vec<(String, Vec<Recording>)> {
    let seeds = FIRST_SEED..FIRST_SEED + seeds;
    let office = |seed| {
        let settings = DriveSettings { duration_s: 1000.0, ..DriveSettings::long_drive(seed) };
        Recording::simulated(&Arc::new(worlds::office_floor(seed)), &settings)
    };
    let ring = |seed: u64| {
        let site = worlds::loop_of(seed, 200.0 + 100.0 * (seed % 4) as f64);
        Recording::simulated(&Arc::new(site), &DriveSettings::long_drive(seed))
    };
    let alike = |seed| {
        let alike = worlds::look_alike(seed);
        Recording::simulated(&alike.site, &alike.settings)
    };
    vec![
        ("office".to_owned(), seeds.clone().map(office).collect()),
        ("loop".to_owned(), seeds.clone().map(ring).collect()),
        ("look-alike".to_owned(), seeds.map(alike).collect()),
    ]
}

fn views(recording: &Recording, length_m: f64) -> Views {
    (0..recording.places.len()).map(|k| recording.submap(k, length_m)).collect()
}

fn table(name: &str, recordings: &[Recording], length_m: f64) {
    let all: Vec<Views> = recordings.iter().map(|recording| views(recording, length_m)).collect();
    let rivals = [("polar", Rival::Polar), ("free", Rival::Free), ("lengths", Rival::Lengths), ("hough", Rival::Hough)];
    for (label, rival) in rivals {
        let mut scores = [Score::default(); 2];
        for (recording, views) in recordings.iter().zip(&all) {
            let described: Vec<_> = views.iter().map(|view| rival.describe(view)).collect();
            count(recording, &mut scores, |k| {
                let old = (0..k).filter(|&e| recording.apart_m(e, k) > APART_M);
                let mut found: Vec<_> = old.map(|e| (rival.compare(&described[k], &described[e]), e)).collect();
                found.sort_by(|a, b| b.0.0.total_cmp(&a.0.0));
                let mut kept: Vec<(u32, f64)> = Vec::new();
                for ((_, turn_rad), e) in found {
                    if kept.len() < 20 && kept.iter().all(|&(other, _)| e.abs_diff(other as usize) > NEIGHBOURS) {
                        kept.push((e as u32, turn_rad));
                    }
                }
                kept
            });
        }
        print_scores(label, name, &scores);
    }
    let mut scores = [Score::default(); 2];
    let mut distances = [Vec::new(), Vec::new()];
    for (recording, views) in recordings.iter().zip(&all) {
        let mut index = PlaceIndex::default();
        views.iter().enumerate().for_each(|(k, view)| index.add(NodeId::at(k), view));
        count(recording, &mut scores, |k| {
            let hits = index.query(&views[k], 20, |e| recording.apart_m(e.index(), k) > APART_M);
            for hit in hits.iter().take(10) {
                distances[usize::from(!recording.overlap(hit.node.index(), k))].push(hit.distance);
            }
            hits.iter().map(|hit| (hit.node.number(), hit.heading_rad.unwrap_or(f64::NAN))).collect()
        });
    }
    print_scores("pairs", name, &scores);
    for (label, distances) in ["right", "wrong"].iter().zip(&mut distances) {
        distances.sort_by(f64::total_cmp);
        let at = |share: f64| distances.get((share * distances.len() as f64) as usize).copied().unwrap_or(f64::NAN);
        let [a, b, c, d, e] = [0.05, 0.25, 0.5, 0.75, 0.95].map(at);
        println!("  distance of {label} hits, 5 to 95 %: {a:.3} {b:.3} {c:.3} {d:.3} {e:.3}");
    }
}

#[derive(Clone, Copy, Default)]
struct Score {
    asked: u32,
    at: [u32; 4],
    near: u32,
    hits: u32,
    headings: u32,
}

/// Asks at every second place that was seen before; places seen only the other way around count apart.
fn count(recording: &Recording, scores: &mut [Score; 2], mut ask: impl FnMut(usize) -> Found) {
    let turn_rad = |e: u32, k: usize| recording.pose(e as usize).between(recording.pose(k)).theta;
    for k in (0..recording.places.len()).step_by(2).filter(|&k| !recording.same[k].is_empty()) {
        let opposite = recording.same[k].iter().all(|&e| wrap_angle(turn_rad(e, k)).abs() > 1.0);
        let score = &mut scores[usize::from(opposite)];
        let found = ask(k);
        let same = |hit: &&(u32, f64)| recording.same[k].contains(&hit.0);
        let near = |hit: &(u32, f64)| recording.pose(hit.0 as usize).distance(recording.pose(k)) < 3.0;
        score.asked += 1;
        for (at, first) in score.at.iter_mut().zip([1, 5, 10, 20]) {
            *at += u32::from(found.iter().take(first).any(|hit| same(&hit)));
        }
        score.near += u32::from(found.iter().take(10).filter(same).any(near));
        for hit in found.iter().take(10).filter(same) {
            score.hits += 1;
            let off_rad = 0.5 * wrap_angle(2.0 * (hit.1 - turn_rad(hit.0, k)));
            score.headings += u32::from(off_rad.abs() < 15_f64.to_radians());
        }
    }
}

fn print_scores(label: &str, name: &str, scores: &[Score; 2]) {
    print!("{label:10}  {name:10} ");
    for score in scores {
        let percent = |n: u32, of: u32| 100.0 * f64::from(n) / f64::from(of.max(1));
        let [a, b, c, d] = score.at.map(|n| percent(n, score.asked));
        let near = percent(score.near, score.asked);
        print!(" {:5} {a:3.0} {b:3.0} {c:3.0} {d:3.0}  {near:9.0}", score.asked);
        print!("  {:7.0} |", percent(score.headings, score.hits));
    }
    println!();
}

/// Put down on known ground: whether the right place is found, by the way driven since.
fn kidnapped(seeds: u64) {
    println!("\nput down on known ground: drives, of those a right place at @1 @5 @10");
    let drives: Vec<_> = (FIRST_SEED..FIRST_SEED + 2 * seeds).filter(|seed| seed % 2 == 0).map(kidnapping).collect();
    let recorded: Vec<_> =
        drives.iter().map(|drive| (drive, Recording::simulated(&drive.site, &drive.settings))).collect();
    for after_m in [0.0, 2.0, 4.0, 7.0] {
        let mut score = [0; 4];
        for (drive, recording) in &recorded {
            let put_down = recording.places.partition_point(|place| place.stamp < drive.put_down);
            let Some(k) = (put_down..recording.places.len()).find(|&k| recording.apart_m(put_down, k) >= after_m)
            else {
                continue;
            };
            let before = recording.places.partition_point(|place| place.stamp < drive.taken);
            let mut index = PlaceIndex::default();
            (0..before).for_each(|e| index.add(NodeId::at(e), &recording.submap(e, SUBMAP_M)));
            let hits = index.query(&recording.submap_from(k, put_down), 10, |_| true);
            score[0] += 1;
            for (found, first) in score[1..].iter_mut().zip([1, 5, 10]) {
                *found += u32::from(hits.iter().take(first).any(|hit| recording.overlap(hit.node.index(), k)));
            }
        }
        println!("{after_m} m later: {score:?}");
    }
}

fn costs(worlds: &[(String, Vec<Recording>)]) {
    let all: Views = worlds.iter().flat_map(|w| &w.1).flat_map(|recording| views(recording, SUBMAP_M)).collect();
    let mut index = PlaceIndex::default();
    let started = Instant::now();
    all.iter().cycle().take(10_000).enumerate().for_each(|(k, view)| index.add(NodeId::at(k), view));
    println!("\nadd {:.1} us", started.elapsed().as_secs_f64() * 1e2);
    let asked: Vec<f64> = all
        .iter()
        .step_by(all.len() / 300 + 1)
        .map(|view| {
            let started = Instant::now();
            std::hint::black_box(index.query(view, 10, |_| true));
            started.elapsed().as_secs_f64() * 1e6
        })
        .collect();
    let worst = asked.iter().fold(0.0, |a: f64, &b| a.max(b));
    println!("query among 10,000: {:.0} us, worst {worst:.0} us", asked.iter().sum::<f64>() / asked.len() as f64);
    for resolution_m in [0.05, 0.1] {
        for (label, windows) in [("full turn", vec![(0.0, PI)]), ("two of 15 deg", vec![(0.0, 0.262), (PI, 0.262)])] {
            let (mut spent_s, mut tries) = (0.0, 0);
            for (_, recordings) in worlds.iter().filter(|w| !w.1.is_empty()) {
                let recording = &recordings[0];
                for k in (0..recording.places.len()).step_by(60).filter(|&k| !recording.same[k].is_empty()) {
                    let e = recording.same[k][0] as usize;
                    spent_s += verify(recording, e, k, resolution_m, &windows);
                    tries += 1;
                }
            }
            let each_ms = 1e3 * spent_s / f64::from(tries.max(1));
            println!("verify at {resolution_m} m, {label}: {each_ms:.1} ms over {tries}");
        }
    }
}

/// Seconds it takes to search 3 m and these headings of a submap.
fn verify(recording: &Recording, e: usize, k: usize, resolution_m: f64, windows: &[(f64, f64)]) -> f64 {
    let hits = recording.submap(e, SUBMAP_M);
    let mut map = LocalMap::new(LocalMapSettings { resolution_m, ..LocalMapSettings::default() });
    let points = SweepPoints { normals: vec![[0.0; 2]; hits.len()], hits, ..SweepPoints::default() };
    map.change(&points, Pose2::IDENTITY, Change::Add, 0);
    let all = recording.submap(k, SUBMAP_M);
    let thinned: Vec<_> = all.iter().step_by(all.len() / 300 + 1).copied().collect();
    let turn_rad = recording.pose(e).between(recording.pose(k)).theta;
    let mut search = CorrelativeSearch::default();
    let started = Instant::now();
    for (aside_rad, half_width_rad) in windows {
        let world_from_robot = Pose2::new(0.0, 0.0, turn_rad + aside_rad);
        let window = SearchWindow { world_from_robot, half_width_m: 3.0, half_width_rad: *half_width_rad };
        std::hint::black_box(search.search(&map, &thinned, &window, None));
    }
    started.elapsed().as_secs_f64()
}
