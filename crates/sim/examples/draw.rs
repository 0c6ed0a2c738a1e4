//! Draws a ready world, the drive through it and what its scans see: `draw office 7 floor.png`.

use mapwright_sim::{Drive, DriveSettings, Point, Segment, Site, worlds};
use std::error::Error;
use std::fs::File;
use std::sync::Arc;

const MOST_PIXELS_PER_M: f64 = 28.0;
/// Longest edge of a picture, pixels.
const MOST_PIXELS: f64 = 3000.0;
const MARGIN_M: f64 = 1.0;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [name, seed, file] = arguments.as_slice() else {
        return Err("usage: draw <world> <seed> <file.png>".into());
    };
    let site = Arc::new(site(name, seed.parse()?)?);
    let mut picture = Picture::around(&site);
    picture.draw_drive(&site);
    picture.draw_world(&site);
    picture.write(File::create(file)?)
}

fn site(name: &str, seed: u64) -> Result<Site, Box<dyn Error>> {
    Ok(match name {
        "office" => worlds::office_floor(seed).with_people(4, seed),
        "rooms" => worlds::rooms(seed),
        "corridor" => worlds::corridor(seed, worlds::CorridorWalls::Features),
        "three_rooms" => worlds::three_rooms(seed),
        "growing" => worlds::growing_building(seed, 400.0),
        "loop_of_60" => worlds::loop_of(seed, 60.0),
        "loop_of_200" => worlds::loop_of(seed, 200.0).with_people(8, seed).with_changing_doors(0.3, seed),
        "loop_of_500" => worlds::loop_of(seed, 500.0),
        "look_alike" => Site::clone(&worlds::look_alike(seed).site),
        "loop" => worlds::grand_loop(seed, 120.0),
        _ => return Err(format!("no world called {name}").into()),
    })
}

struct Picture {
    low: Point,
    pixels_per_m: f64,
    width: usize,
    height: usize,
    rgb: Vec<u8>,
}

impl Picture {
    fn around(site: &Site) -> Self {
        let points = site.world.segments().iter().flat_map(|s| [s.a, s.b]);
        let start = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        let (low, high) = points.fold(start, |(low, high), p| {
            ([low[0].min(p[0]), low[1].min(p[1])], [high[0].max(p[0]), high[1].max(p[1])])
        });
        let size_m = |axis: usize| high[axis] - low[axis] + 2.0 * MARGIN_M;
        let pixels_per_m = MOST_PIXELS_PER_M.min(MOST_PIXELS / size_m(0).max(size_m(1)));
        let pixels = |axis: usize| (size_m(axis) * pixels_per_m) as usize + 1;
        let (width, height) = (pixels(0), pixels(1));
        Self { low, pixels_per_m, width, height, rgb: vec![255; 3 * width * height] }
    }

    fn dot(&mut self, [x_m, y_m]: Point, color: [u8; 3]) {
        let x = ((x_m - self.low[0] + MARGIN_M) * self.pixels_per_m) as usize;
        let y = ((y_m - self.low[1] + MARGIN_M) * self.pixels_per_m) as usize;
        if x < self.width && y < self.height {
            let at = 3 * ((self.height - 1 - y) * self.width + x);
            self.rgb[at..at + 3].copy_from_slice(&color);
        }
    }

    fn line(&mut self, Segment { a, b }: Segment, color: [u8; 3]) {
        let steps = ((a[0] - b[0]).hypot(a[1] - b[1]) * self.pixels_per_m * 1.5) as usize + 1;
        for step in 0..=steps {
            let share = step as f64 / steps as f64;
            self.dot([a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])], color);
        }
    }

    fn circle(&mut self, center: Point, radius_m: f64, color: [u8; 3]) {
        for step in 0..100 {
            let (s, c) = (f64::from(step) * 0.0628).sin_cos();
            self.dot([center[0] + radius_m * c, center[1] + radius_m * s], color);
        }
    }

    fn draw_drive(&mut self, site: &Arc<Site>) {
        let mut last: Option<Point> = None;
        for (index, seen) in Drive::new(Arc::clone(site), DriveSettings::default()).scans().take(20_000).enumerate() {
            let here = seen.world_from_robot;
            let angles = seen.scan.ranges_m.iter().enumerate().filter(|_| index % 50 == 0);
            for (beam, &range_m) in angles {
                let angle_rad =
                    seen.scan.laser.angle_min_rad + beam as f64 * seen.scan.laser.angle_step_rad + here.theta;
                let range_m = f64::from(range_m);
                self.dot([here.x + range_m * angle_rad.cos(), here.y + range_m * angle_rad.sin()], [255, 170, 0]);
            }
            if let Some(a) = last.replace([here.x, here.y]) {
                self.line(Segment { a, b: [here.x, here.y] }, [90, 140, 255]);
            }
        }
    }

    fn draw_world(&mut self, site: &Site) {
        let world = &site.world;
        world.segments().iter().for_each(|&segment| self.line(segment, [0, 0, 0]));
        world.circles().iter().for_each(|circle| self.circle(circle.center, circle.radius_m, [0, 0, 0]));
        for door in world.doors() {
            self.line(door.shut, if door.shut_when.holds(0.0) { [200, 0, 0] } else { [250, 200, 200] });
            door.open.into_iter().for_each(|leaf| self.line(leaf, [0, 150, 0]));
        }
        for person in world.walkers().iter().filter_map(|walker| walker.at(0.0)) {
            self.circle(person.center, person.radius_m, [200, 0, 200]);
        }
    }

    fn write(&self, file: File) -> Result<(), Box<dyn Error>> {
        let mut encoder = png::Encoder::new(file, self.width as u32, self.height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.write_header()?.write_image_data(&self.rgb)?;
        Ok(())
    }
}
