//! Odometry of a folder of `.bin` clouds by scan matching alone, as a TUM trajectory. A trial.
#![allow(missing_docs, clippy::print_stdout, clippy::unwrap_used)]
use mapwright_geom::{Cov6, Pose3};
use mapwright_voxel::*;
use std::time::Instant;

fn main() {
    let a: Vec<String> = std::env::args().collect();
    let (dir, out) = (&a[1], &a[2]);
    let get = |name: &str, d: f64| {
        a.iter().find_map(|v| v.strip_prefix(&format!("{name}="))).map_or(d, |v| v.parse().unwrap())
    };
    let res = get("res", 0.5);
    let levels = get("levels", 4.0) as usize;
    let last = get("last", 1e9) as usize;
    let every = get("every", 1.0) as usize;
    let cv = get("cv", 1.0) > 0.5;
    let mut names: Vec<_> = std::fs::read_dir(dir)
        .unwrap()
        .map(|e| e.unwrap().path())
        .filter(|p| p.extension().is_some_and(|e| e == "bin"))
        .collect();
    names.sort();
    let mut map = SurfelMap::new(SurfelMapSettings { resolution_m: res, levels, noise_m: get("noise", 0.01) });
    let mut matcher = Matcher::new(MatcherSettings {
        points: get("points", 4000.0) as usize,
        steps: get("steps", 15.0) as usize,
        kernel_medians: get("k", 3.0),
        ..MatcherSettings::default()
    });
    let (mut thinner, mut pose, mut before) = (Thinner::default(), Pose3::identity(), Pose3::identity());
    let mut drawn: std::collections::VecDeque<(Vec<[f32; 3]>, Pose3)> = Default::default();
    let mut text = String::new();
    let (mut total, mut n) = (0.0, 0);
    for (k, name) in names.iter().enumerate().step_by(every) {
        let bytes = std::fs::read(name).unwrap();
        let f = |c: &[u8]| f32::from_le_bytes(c.try_into().unwrap());
        let points: Vec<[f32; 3]> = bytes
            .chunks_exact(16)
            .map(|c| [f(&c[..4]), f(&c[4..8]), f(&c[8..12])])
            .filter(|p| {
                let r = p[0].hypot(p[1]).hypot(p[2]);
                r > 0.5 && r < 120.0
            })
            .collect();
        let t = Instant::now();
        let (mut dense, mut sparse) = (Vec::new(), Vec::new());
        thinner.thin(&points, res * get("dense", 0.2), &mut dense);
        thinner.thin(&dense, res * get("sparse", 0.8), &mut sparse);
        if !map.is_empty() {
            let prior = Prior { map_from_cloud: pose, information: Cov6::identity() * 1e-2 };
            let mut best = matcher.climb(&map, &sparse, &prior, pose);
            let mut from = "stand";
            let score = |f: &Fit| f.inlier_share * f.known_share;
            if cv {
                let other = matcher.climb(&map, &sparse, &prior, pose * before.between(pose));
                if score(&other) > score(&best) {
                    best = other;
                    from = "cv";
                }
            }
            if score(&best) < get("guard", 0.0) {
                let starts = (-11..=12).map(|k| {
                    pose * Pose3::exp(nalgebra::Vector6::new(0., 0., 0., 0., 0., 15f64.to_radians() * f64::from(k)))
                });
                for start in matcher.rough(&map, &sparse, &prior, starts, 2) {
                    let other = matcher.climb(&map, &sparse, &prior, start);
                    if score(&other) > score(&best) {
                        best = other;
                        from = "yaw";
                    }
                }
            }
            before = pose;
            pose = best.map_from_cloud;
            let step = before.between(pose);
            if get("v", 0.0) > 0.5 {
                println!(
                    "{k} {} pts {} known {:.3} in {:.3} ev {} step {:.2} m {:.1} deg {from}",
                    points.len(),
                    sparse.len(),
                    best.known_share,
                    best.inlier_share,
                    best.evaluations,
                    step.translation.norm(),
                    step.rotation.angle().to_degrees()
                );
            }
        }
        map.draw(&dense, pose, Change::Add, k as u32);
        drawn.push_back((dense, pose));
        if drawn.len() > last {
            let (d, p) = drawn.pop_front().unwrap();
            map.draw(&d, p, Change::Remove, k as u32);
        }
        map.refresh();
        total += t.elapsed().as_secs_f64();
        n += 1;
        let (p, q) = (pose.translation, pose.rotation.coords);
        text += &format!("{} {} {} {} {} {} {} {}\n", k, p.x, p.y, p.z, q.x, q.y, q.z, q.w);
    }
    std::fs::write(out, text).unwrap();
    println!("{:.1} ms a scan", 1e3 * total / n as f64);
}
