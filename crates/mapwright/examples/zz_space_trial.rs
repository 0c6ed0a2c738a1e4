//! A trial.
#![allow(missing_docs, clippy::print_stdout, clippy::unwrap_used)]
use mapwright::*;
use std::sync::Arc;
use std::time::Instant;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let get = |name: &str, d: f64| {
        a.iter().find_map(|v| v.strip_prefix(&format!("{name}="))).map_or(d, |v| v.parse().unwrap())
    };
    let mut names: Vec<_> = std::fs::read_dir(&a[1])
        .unwrap()
        .map(|e| e.unwrap().path())
        .filter(|p| p.extension().is_some_and(|e| e == "bin"))
        .collect();
    names.sort();
    let sensor = Arc::new(SpaceSensor::lidar("lidar"));
    let mut settings = Settings::default();
    settings.space.resolution_m = get("res", 0.0);
    let mut mapper = SpaceMapper::new(settings).unwrap();
    let (mut text, mut total, mut n) = (String::new(), 0.0, 0);
    let dt = get("dt", 0.5);
    for (k, name) in names.iter().enumerate().step_by(get("every", 1.0) as usize) {
        let bytes = std::fs::read(name).unwrap();
        let f = |c: &[u8]| f32::from_le_bytes(c.try_into().unwrap());
        let points_m: Vec<[f32; 3]> = bytes.chunks_exact(16).map(|c| [f(&c[..4]), f(&c[4..8]), f(&c[8..12])]).collect();
        let cloud = Cloud {
            stamp: Stamp((k as f64 * dt * 1e9) as i64),
            sensor: Arc::clone(&sensor),
            points_m,
            times_s: vec![],
            colours: vec![],
            odom_from_robot: None,
        };
        let t = Instant::now();
        let u = mapper.add_cloud(&cloud);
        total += t.elapsed().as_secs_f64();
        n += 1;
        let (p, q) = (u.map_from_robot.translation, u.map_from_robot.rotation.coords);
        text += &format!("{} {} {} {} {} {} {} {}\n", k, p.x, p.y, p.z, q.x, q.y, q.z, q.w);
        if get("v", 0.0) > 0.5 {
            let m = u.matched;
            println!(
                "{k} {:?} kf {} live {} known {:.3} in {:.3} ev {} restarts {} sigmas {:.1} sd {:.4} {:.1} ms",
                u.status,
                u.keyframe.is_some(),
                u.local_map.keyframes,
                m.map_or(0.0, |m| m.known_share),
                m.map_or(0.0, |m| m.inlier_share),
                m.map_or(0, |m| m.evaluations),
                m.map_or(0, |m| m.restarts),
                m.map_or(0.0, |m| m.odometry_sigmas),
                u.covariance[(0, 0)].sqrt(),
                1e3 * t.elapsed().as_secs_f64()
            );
        }
    }
    for c in mapper.session().candidates() {
        if get("c", 0.0) > 0.5 {
            println!("{} -> {} {} {:?} {:?}", c.to.seq, c.from.seq, c.detection.name(), c.verdict, c.evidence);
        }
    }
    let closures = mapper.session().edges().filter(|e| e.kind == EdgeKind::Closure).count();
    println!(
        "{} candidates, {closures} closures, {} corrections",
        mapper.session().candidates().len(),
        mapper.session().corrections()
    );
    let mut last = String::new();
    for (k, p) in mapper.session().trajectory().enumerate() {
        let k = k * get("every", 1.0) as usize;
        let (p, q) = (p.map_from_robot.translation, p.map_from_robot.rotation.coords);
        last += &format!("{} {} {} {} {} {} {} {}\n", k, p.x, p.y, p.z, q.x, q.y, q.z, q.w);
    }
    std::fs::write(format!("{}.final", a[2]), last).unwrap();
    std::fs::write(&a[2], text).unwrap();
    println!(
        "{:.1} ms a cloud, resolution {:?}, keyframes {}",
        1e3 * total / n as f64,
        mapper.resolution_m(),
        mapper.session().keyframes().len()
    );
}
