//! How far obstacles are from places around the robot, as a planner asks.
//! `cargo run -p mapwright --example distance_field`
#![allow(clippy::print_stdout, reason = "an example's result")]

use mapwright::{LaserModel, LaserScan, Mapper, Pose2, Settings, Stamp};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut mapper = Mapper::new(Settings::default())?;
    let laser = LaserModel { range_max_m: 30.0, ..LaserModel::half_circle("front", 361) };
    // All around something stands 1.2 m away.
    let scan = LaserScan {
        stamp: Stamp(0),
        laser: laser.into(),
        ranges_m: vec![1.2; 361],
        odom_from_robot: Some(Pose2::IDENTITY),
    };
    let robot = mapper.add_scan(&scan).map_from_robot;
    let field = mapper.local_map().field();
    let cell_m = mapper.settings().map.resolution_m;
    let reach_m = f64::from(field.radius_cells()) * cell_m;
    for ahead_m in [0.0, 0.5, 0.8, 0.9, 1.0, 1.1, 1.2] {
        let place = robot * Pose2::new(ahead_m, 0.0, 0.0);
        let cell = [place.x, place.y].map(|metres| (metres / cell_m).floor() as i32);
        match field.nearest_cell(cell[0], cell[1]) {
            Some((squared_cells, _)) => {
                println!(
                    "{ahead_m} m ahead: {:.2} m to the nearest obstacle",
                    f64::from(squared_cells).sqrt() * cell_m
                );
            }
            None => println!("{ahead_m} m ahead: nothing within {reach_m} m"),
        }
    }
    Ok(())
}
