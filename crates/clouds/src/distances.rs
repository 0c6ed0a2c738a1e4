//! Whether points of a sensor in space are in metres, by how far they lie.

use mapwright_sensor::{Cloud, SpaceSensor};

/// What the command line calls what one stands for in the coordinates of clouds.
pub const RANGE_UNIT_KEY: &str = "--range-unit M";

/// Clouds that are looked at, and points of each.
const CLOUDS: usize = 8;
const POINTS_OF_CLOUD: usize = 1000;
/// Fewer points say nothing.
const POINTS_LEAST: usize = 100;
/// Such a share is as good as all: some readings are always wrong.
const ALL: f64 = 0.98;
/// In another unit such a share lies where the sensor sees.
const MOST: f64 = 0.9;
/// No depth camera sees so far, metres: nearly all depths beyond are in another unit.
const NO_CAMERA_M: f64 = 50.0;
/// A lidar looks around: the mean of all directions in which it sees something is shorter. What looks down from an aeroplane sees a
/// kilometre of air before anything else.
const ONE_WAY: f64 = 0.9;
/// Where all points lie nearer than a sensor usually sees, those count that are farther than this, metres; unless they are the
/// sensor itself.
const NEAR_FROM_M: f64 = 0.02;
const NEAR_LEAST_M: f64 = 0.05;
const MILLIMETRE_M: f64 = 0.001;

/// How far the points of a recording's first clouds lie.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Distances {
    clouds: usize,
    ranges_m: Vec<f64>,
    /// Sum of the directions to them.
    ways: [f64; 3],
}

/// What distances say, in words, and what is made of it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Units {
    /// What a coordinate of one stands for, metres, where it is not what the recording says.
    pub unit_m: Option<f64>,
    /// Points count from here on, where all are nearer than the sensor usually sees, metres.
    pub range_min_m: Option<f64>,
    /// What was taken for granted.
    pub assumed: Option<String>,
    /// What speaks against the unit, and what to type.
    pub odd: Option<String>,
}

/// What says what a unit is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum UnitOf {
    /// Coordinates of clouds; what one was said to be, metres.
    Clouds(Option<f64>),
    /// Images of depth: the number that stands for a metre, and whether it was said by who asks.
    Images {
        /// The number.
        per_m: f64,
        /// Whether it was asked for.
        is_asked: bool,
    },
}

impl Distances {
    /// Whether more clouds tell more.
    #[must_use]
    pub fn wants_more(&self) -> bool {
        self.clouds < CLOUDS
    }

    /// Looks at a cloud's points, metres in the sensor's frame; those without a place and in the sensor itself say nothing.
    pub fn add(&mut self, points_m: impl Iterator<Item = [f64; 3]>, count: usize) {
        if !self.wants_more() {
            return;
        }
        self.clouds += 1;
        for point in points_m.step_by((count / POINTS_OF_CLOUD).max(1)) {
            let range_m = point.iter().map(|v| v * v).sum::<f64>().sqrt();
            if range_m.is_finite() && range_m > 0.0 {
                self.ranges_m.push(range_m);
                (0..3).for_each(|k| self.ways[k] += point[k] / range_m);
            }
        }
    }

    /// Looks at a cloud.
    pub fn add_cloud(&mut self, cloud: &Cloud) {
        self.add(cloud.points_m.iter().map(|point| point.map(f64::from)), cloud.points_m.len());
    }

    /// The same, as if one stood for so many metres.
    #[must_use]
    pub fn scaled(&self, unit_m: f64) -> Self {
        Self { ranges_m: self.ranges_m.iter().map(|range_m| range_m * unit_m).collect(), ..self.clone() }
    }

    /// What they say of a sensor's unit; distances are as they are with what was said of it.
    #[must_use]
    pub fn judge(&self, sensor: &SpaceSensor, of: UnitOf) -> Units {
        if self.ranges_m.len() < POINTS_LEAST {
            return Units::default();
        }
        let far = self.share(|range_m| range_m >= sensor.range_max_m);
        if far >= ALL && self.are_millimetres(sensor, of) {
            return Units {
                unit_m: Some(MILLIMETRE_M),
                assumed: Some(self.millimetre_words(sensor, of)),
                ..Units::default()
            };
        }
        if far >= ALL || (far >= 0.5 && matches!(of, UnitOf::Images { .. })) {
            return Units { odd: Some(self.far_words(sensor, of, far)), ..Units::default() };
        }
        let near = self.share(|range_m| range_m < sensor.range_min_m);
        if near >= ALL && self.quantile(1.0 - ALL) >= NEAR_FROM_M && self.quantile(ALL) >= NEAR_LEAST_M {
            let (assumed, range_min_m) = (Some(self.near_words(sensor, of)), Some(NEAR_FROM_M));
            return Units { range_min_m, assumed, ..Units::default() };
        }
        Units::default()
    }

    fn share(&self, is_such: impl Fn(f64) -> bool) -> f64 {
        let such = self.ranges_m.iter().filter(|range_m| is_such(**range_m)).count();
        such as f64 / self.ranges_m.len().max(1) as f64
    }

    fn quantile(&self, share: f64) -> f64 {
        let mut sorted = self.ranges_m.clone();
        sorted.sort_by(f64::total_cmp);
        let at = (share * sorted.len() as f64) as usize;
        sorted.get(at.min(sorted.len().saturating_sub(1))).copied().unwrap_or(0.0)
    }

    /// Whether they cannot be metres, and are where the sensor sees as millimetres.
    fn are_millimetres(&self, sensor: &SpaceSensor, of: UnitOf) -> bool {
        let is_free = match of {
            UnitOf::Clouds(said) => said.is_none(),
            // Integers are in no metres anyhow, and the encoding's millimetres have been taken as such.
            UnitOf::Images { per_m, is_asked } => !is_asked && per_m == 1.0 && self.quantile(1.0 - ALL) > NO_CAMERA_M,
        };
        let looks_around = matches!(of, UnitOf::Images { .. }) || {
            let mean = self.ways.map(|way| way / self.ranges_m.len() as f64);
            mean.iter().map(|way| way * way).sum::<f64>().sqrt() < ONE_WAY
        };
        is_free && looks_around && self.fits(sensor, MILLIMETRE_M)
    }

    fn fits(&self, sensor: &SpaceSensor, unit_m: f64) -> bool {
        let seen_m = 0.2 * sensor.range_min_m..sensor.range_max_m;
        self.share(|range_m| seen_m.contains(&(unit_m * range_m))) >= MOST
    }

    /// `points at 180 to 9,012 m`.
    fn span_words(&self, of: UnitOf) -> String {
        let what = if matches!(of, UnitOf::Clouds(_)) { "points" } else { "depths" };
        let [least, most] = [self.quantile(1.0 - ALL), self.quantile(ALL)].map(metres);
        format!("{what} at {least} to {most} m")
    }

    fn millimetre_words(&self, sensor: &SpaceSensor, of: UnitOf) -> String {
        let (span, most) = (self.span_words(of), sensor.range_max_m);
        let otherwise = if matches!(of, UnitOf::Clouds(_)) { "--range-unit 1" } else { "--depth-scale 1" };
        format!(
            "{span}, though {most} m is as far as they count: taken for millimetres; `{otherwise}` takes them for metres"
        )
    }

    fn far_words(&self, sensor: &SpaceSensor, of: UnitOf, far: f64) -> String {
        let (span, most) = (self.span_words(of), sensor.range_max_m);
        let share = if far >= ALL { String::new() } else { format!(" ({:.0} % of them)", 100.0 * far) };
        let beyond = format!("{span}, beyond the {most} m up to which they count{share}");
        match of {
            UnitOf::Clouds(_) if self.fits(sensor, MILLIMETRE_M) => {
                format!("{beyond}: millimetres? `--range-unit 0.001` takes them as such")
            }
            UnitOf::Clouds(_) => format!("{beyond}: are they metres? `{RANGE_UNIT_KEY}` says what one stands for"),
            UnitOf::Images { per_m: 1.0, .. } => {
                format!("{beyond}: millimetres? `--depth-scale 1000` takes them as such")
            }
            UnitOf::Images { per_m, .. } => format!(
                "{beyond}: does {per_m} stand for a metre? It does not for a RealSense D405 (`--depth-scale 10000`), a RealSense L515 \
                 (4000), images of TUM (5000)"
            ),
        }
    }

    fn near_words(&self, sensor: &SpaceSensor, of: UnitOf) -> String {
        let (span, least) = (self.span_words(of), sensor.range_min_m);
        let otherwise = match of {
            UnitOf::Clouds(_) => format!("`{RANGE_UNIT_KEY}` says what one stands for where that is not a metre"),
            UnitOf::Images { .. } => "`--depth-scale S` says which number stands for a metre".to_owned(),
        };
        format!(
            "{span}, all nearer than the {least} m from which on they usually count: they count from {NEAR_FROM_M} m on; {otherwise}"
        )
    }
}

/// With as many digits as are of use: `0.08`, `3.2`, `9,012`.
fn metres(length_m: f64) -> String {
    match length_m {
        far if far >= 1000.0 => format!("{},{:03}", (far.round() as u64) / 1000, (far.round() as u64) % 1000),
        far if far >= 100.0 => format!("{far:.0}"),
        near if near >= 1.0 => format!("{near:.1}"),
        near => format!("{near:.2}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points all around, from the nearest to the farthest.
    fn around(least_m: f64, most_m: f64) -> Distances {
        let mut distances = Distances::default();
        let point = |k: usize| {
            let (range_m, angle) = (least_m + (most_m - least_m) * k as f64 / 499.0, 0.7 * k as f64);
            [range_m * angle.cos(), range_m * angle.sin(), 0.0]
        };
        distances.add((0..500).map(point), 500);
        distances
    }

    fn lidar() -> SpaceSensor {
        SpaceSensor::lidar("lidar")
    }

    const CLOUDS_AS_THEY_ARE: UnitOf = UnitOf::Clouds(None);

    #[test]
    fn metres_are_metres() {
        for distances in
            [around(0.3, 90.0), around(0.6, 8.0), around(3.0, 200.0), around(0.01, 0.01), Distances::default()]
        {
            assert_eq!(distances.judge(&lidar(), CLOUDS_AS_THEY_ARE), Units::default());
        }
    }

    #[test]
    fn what_can_only_be_millimetres_is_taken_as_such_and_said() {
        let found = around(180.0, 9000.0).judge(&lidar(), CLOUDS_AS_THEY_ARE);
        let said = found.assumed.unwrap();
        assert_eq!(found.unit_m, Some(0.001));
        assert!(
            said.contains("to 8,8") && said.contains("taken for millimetres") && said.contains("--range-unit 1"),
            "{said}"
        );
        let asked = around(180.0, 9000.0).judge(&lidar(), UnitOf::Clouds(Some(1.0)));
        assert!(asked.unit_m.is_none() && asked.odd.unwrap().contains("--range-unit 0.001"));
        let mut down = Distances::default();
        down.add((0..500).map(|k| [f64::from(k % 20), f64::from(k / 20), -900.0]), 500);
        let from_above = down.judge(&lidar(), CLOUDS_AS_THEY_ARE);
        assert!(from_above.unit_m.is_none() && from_above.odd.is_some(), "{from_above:?}");
        let farther = around(1e6, 9e6).judge(&lidar(), CLOUDS_AS_THEY_ARE).odd.unwrap();
        assert!(farther.contains("--range-unit M"), "{farther}");
    }

    #[test]
    fn depths_in_another_unit_are_named_with_what_to_type() {
        let camera = SpaceSensor::depth_camera("depth");
        let floats = UnitOf::Images { per_m: 1.0, is_asked: false };
        assert_eq!(around(300.0, 4000.0).judge(&camera, floats).unit_m, Some(0.001));
        let outdoors = around(7.0, 30.0).judge(&camera, floats);
        assert!(outdoors.unit_m.is_none() && outdoors.odd.unwrap().contains("--depth-scale 1000"));
        let numbers = UnitOf::Images { per_m: 1000.0, is_asked: false };
        let tenths = around(8.0, 50.0).judge(&camera, numbers);
        let said = tenths.odd.unwrap();
        assert!(
            tenths.unit_m.is_none() && said.contains("--depth-scale 10000") && said.contains("1000 stand"),
            "{said}"
        );
        let partly = around(3.0, 20.0).judge(&camera, numbers).odd.unwrap();
        assert!(partly.contains("% of them"), "{partly}");
        assert_eq!(around(0.5, 8.0).judge(&camera, numbers), Units::default());
    }

    #[test]
    fn what_lies_near_throughout_counts() {
        let near = around(0.05, 0.3).judge(&lidar(), CLOUDS_AS_THEY_ARE);
        assert_eq!(near.range_min_m, Some(0.02));
        assert!(near.assumed.unwrap().contains("from 0.02 m on; `--range-unit M`"));
        assert_eq!(around(0.05, 0.3).scaled(10.0).judge(&lidar(), UnitOf::Clouds(Some(10.0))), Units::default());
    }
}
