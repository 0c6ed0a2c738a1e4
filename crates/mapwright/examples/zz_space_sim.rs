//! A trial on simulated drives.
#![allow(missing_docs, clippy::print_stdout, clippy::unwrap_used)]
use mapwright::*;
use mapwright_eval::space_errors;
use mapwright_sim::space::{LidarSettings, SpaceDrive, SpaceDriveSettings, worlds};
use std::sync::Arc;
use std::time::Instant;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let get = |name: &str, d: f64| {
        a.iter().find_map(|v| v.strip_prefix(&format!("{name}="))).map_or(d, |v| v.parse().unwrap())
    };
    let seed = get("seed", 1.0) as u64;
    let site = match a[1].as_str() {
        "two" => worlds::two_storey(seed),
        "loops" => worlds::loops_1km(seed),
        "alike" => worlds::look_alike_storeys(seed),
        _ => worlds::courtyard(seed),
    };
    let mut lidar = LidarSettings::spinning(get("beams", 32.0) as usize);
    lidar.columns = get("columns", 512.0) as usize;
    let settings =
        SpaceDriveSettings { lidar, seed, duration_s: get("duration", 1e9), ..SpaceDriveSettings::default() };
    println!("way {:.0} m", site.length_m());
    let drive = SpaceDrive::new(Arc::new(site), settings);
    let mut set = Settings::default();
    set.loops.by_pose = get("close", 1.0) > 0.5;
    set.loops.by_place = get("close", 1.0) > 0.5;
    let mut mapper = SpaceMapper::new(set).unwrap();
    let (mut total, mut n, mut truth, mut online) = (0.0, 0, Vec::new(), Vec::new());
    let every = get("every", 2.0) as u64;
    let mut worst = 0.0_f64;
    let (mut nees, mut errors, mut stated) = (Vec::<f64>::new(), [0.0; 2], [0.0; 2]);
    let (mut per, mut said, mut ratio, mut chi, mut count) = ([0.0_f64; 6], [0.0_f64; 6], [0.0_f64; 6], 0.0, 0.0);
    let mut middles: Vec<Pose3> = Vec::new();
    let mut k = 0;
    while let Some(t) = drive.cloud(k) {
        let mut cloud = t.cloud;
        if get("times", 1.0) < 0.5 {
            cloud.times_s.clear();
        }
        if get("odom", 1.0) < 0.5 {
            cloud.odom_from_robot = None;
        }
        let s = Instant::now();
        let u = mapper.add_cloud(&cloud);
        let ms = 1e3 * s.elapsed().as_secs_f64();
        worst = worst.max(ms);
        total += ms;
        n += 1;
        let half = drive
            .world_from_robot(Stamp(cloud.stamp.0 + if cloud.times_s.is_empty() { 0 } else { 50_000_000 }))
            .unwrap_or(t.world_from_robot);
        middles.push(half);
        if let Some(anchor) = u.anchor.filter(|_| u.status == Status::Tracking) {
            let s = mapper.session();
            let place = s.place(anchor).unwrap();
            let scan = s.keyframes()[place].scan as usize;
            if let Some(world_from_anchor) = middles.get(scan) {
                let (estimate, real) = (
                    s.map_from_keyframe()[place].between(u.map_from_robot),
                    Pose3::between(*world_from_anchor, t.world_from_robot),
                );
                let e = real.between(estimate).log();
                if let Some(inv) = u.covariance.try_inverse() {
                    nees.push(e.dot(&(inv * e)));
                }
                errors[0] += e.fixed_rows::<3>(0).norm_squared();
                errors[1] += e.fixed_rows::<3>(3).norm_squared();
                stated[0] += u.covariance.fixed_view::<3, 3>(0, 0).trace();
                stated[1] += u.covariance.fixed_view::<3, 3>(3, 3).trace();
            }
        }
        truth.push((cloud.stamp, t.world_from_robot));
        if n % 100 == 0 {
            let known = mapper.certainty();
            let s = mapper.session();
            let (Some(newest), poses) = (s.keyframes().last(), s.map_from_keyframe()) else { continue };
            let at = |k: usize| middles[s.keyframes()[k].scan as usize];
            let last = s.place(newest.id).unwrap();
            for (id, cov) in known {
                let k = s.place(id).unwrap();
                if last - k < 60 {
                    continue;
                }
                let e = at(k).between(at(last)).between(poses[k].between(poses[last])).log();
                count += 1.0;
                for a in 0..6 {
                    per[a] += e[a] * e[a];
                    said[a] += cov[(a, a)];
                    ratio[a] += e[a] * e[a] / cov[(a, a)];
                }
                chi += e.dot(&(cov.try_inverse().unwrap() * e));
            }
        }
        online.push((cloud.stamp, u.map_from_robot));
        if get("v", 0.0) > 0.5 && n % get("v", 1.0) as usize == 0 {
            let m = u.matched;
            let e = truth[0].1.between(t.world_from_robot).between(online[0].1.between(u.map_from_robot));
            println!(
                "{k} {:?} kf {} live {} known {:.3} in {:.3} restarts {} sigmas {:.1} err {:.3} z {:.3} {:.2} deg {ms:.1} ms",
                u.status,
                mapper.session().keyframes().len(),
                u.local_map.keyframes,
                m.map_or(0.0, |m| m.known_share),
                m.map_or(0.0, |m| m.inlier_share),
                m.map_or(0, |m| m.restarts),
                m.map_or(0.0, |m| m.odometry_sigmas),
                e.translation.norm(),
                e.translation.z,
                e.rotation.angle().to_degrees()
            );
        }
        k += every;
    }
    let s = mapper.session();
    let last: Vec<_> = s.trajectory().map(|p| (p.stamp, p.map_from_robot)).collect();
    for c in s.candidates() {
        if get("c", 0.0) > 0.5 {
            let at = |id: KeyframeId| middles[s.keyframes()[s.place(id).unwrap()].scan as usize];
            let e = c.from_from_to.map(|p| at(c.from).between(at(c.to)).between(p));
            let t = at(c.from).between(at(c.to));
            let w = c.from_from_to.map(|p| t.between(p).translation);
            println!(
                "true [{:.2} {:.2} {:.2}] {:.1} deg off [{:.2?}] {} -> {} {} {:?} error {:?} {:?}",
                t.translation.x,
                t.translation.y,
                t.translation.z,
                t.rotation.angle().to_degrees(),
                w.map(|w| [w.x, w.y, w.z]),
                c.to.seq,
                c.from.seq,
                c.detection.name(),
                c.verdict,
                e.map(|e| (e.translation.norm(), e.rotation.angle().to_degrees())),
                c.evidence
            );
        }
    }
    let (mut wrong, mut closures) = (0, 0);
    for e in s.edges().filter(|e| e.kind == EdgeKind::Closure) {
        let at = |id: KeyframeId| middles[s.keyframes()[s.place(id).unwrap()].scan as usize];
        let off = at(e.from).between(at(e.to)).between(e.from_from_to);
        closures += 1;
        wrong += u32::from(off.translation.norm() > 0.3 || off.rotation.angle() > 0.1);
    }
    let show = |name: &str, est: &[(Stamp, Pose3)]| {
        let e = space_errors(&truth, est, mapwright_eval::Alignment::Rigid, &mapwright_eval::RpeSettings::default())
            .unwrap();
        println!(
            "{name} ATE {:.3} worst {:.3} m, RPE {:.4} m {:.3} deg",
            e.absolute.translation_m.rmse,
            e.absolute.translation_m.max,
            e.relative.translation_m.median,
            e.relative.rotation_deg.median
        );
    };
    let c = nees.len() as f64;
    nees.sort_by(f64::total_cmp);
    println!(
        "NEES mean {:.2} median {:.2} of {}; rms error {:.4} m {:.4} rad, stated {:.4} m {:.4} rad",
        nees.iter().sum::<f64>() / c,
        nees[nees.len() / 2],
        nees.len(),
        (errors[0] / c as f64).sqrt(),
        (errors[1] / c as f64).sqrt(),
        (stated[0] / c as f64).sqrt(),
        (stated[1] / c as f64).sqrt()
    );
    let root = |v: [f64; 6]| v.map(|v| (v / count as f64).sqrt());
    println!(
        "far: rms {:.4?} stated {:.4?}; mean squared ratios {:.2?}, chi2 {:.2}",
        root(per),
        root(said),
        ratio.map(|v| v / count),
        chi / count
    );
    show("online", &online);
    show("final ", &last);
    println!(
        "{n} clouds, {:.1} ms a cloud, worst {worst:.0}; {} keyframes, {} candidates, {closures} closures, {wrong} wrong, {} corrections, resolution {:?}",
        total / n as f64,
        s.keyframes().len(),
        s.candidates().len(),
        s.corrections(),
        mapper.resolution_m()
    );
}
