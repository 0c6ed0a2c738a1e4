//! Scans made by hand: a robot drives through a hall of 8 m by 5 m. `cargo run -p mapwright --example feed_scans`
#![allow(clippy::print_stdout, reason = "an example's result")]

use mapwright::{LaserModel, LaserScan, Mapper, Pose2, Settings, Stamp};
use std::sync::Arc;

/// Distance from (x, 0) to the walls at x = -4 and 4, y = -2.5 and 2.5.
fn range_m(x: f64, bearing_rad: f64) -> f64 {
    let (sin, cos) = bearing_rad.sin_cos();
    let along = if cos > 0.0 { (4.0 - x) / cos } else { (-4.0 - x) / cos };
    along.min(2.5 / sin.abs())
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut mapper = Mapper::new(Settings::default())?;
    let laser = Arc::new(LaserModel { range_max_m: 30.0, ..LaserModel::half_circle("front", 181) });
    for k in 0..20_i32 {
        let x = 0.1 * f64::from(k);
        let ranges_m = (0..181).map(|beam| range_m(x, laser.bearing_in_robot(beam)) as f32).collect();
        // These wheels report 5 % too much; the walls know better.
        let odom_from_robot = Some(Pose2::new(1.05 * x, 0.0, 0.0));
        let stamp = Stamp::from_secs_f64(0.1 * f64::from(k));
        let update = mapper.add_scan(&LaserScan { stamp, laser: Arc::clone(&laser), ranges_m, odom_from_robot });
        let (found, sigma_m) = (update.map_from_robot.x, update.covariance[(0, 0)].sqrt());
        println!("true {x:.3} m, found {found:.3} m +- {sigma_m:.3} m, {}", update.status.name());
    }
    Ok(())
}
