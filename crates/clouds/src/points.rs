//! Points of a file by the names of their fields.

use crate::scalar::Scalar;
use mapwright_geom::Stamp;

/// The points of a file as they were read.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Points {
    /// Metres, in the file's frame.
    pub points_m: Vec<[f32; 3]>,
    /// Red, green and blue of each; empty where there are none.
    pub colours: Vec<[u8; 3]>,
    /// How bright each is, in units of whatever took it; empty where the file does not say, or says the same of all.
    pub intensities: Vec<f32>,
    /// When each was taken, as the file has it; empty where it does not say.
    pub times: Vec<f64>,
    /// What the field of times is called and whether it holds integers.
    pub time_field: Option<(String, bool)>,
}

/// A field of a point.
#[derive(Debug, Clone)]
pub(crate) struct Field {
    pub(crate) name: String,
    pub(crate) scalar: Scalar,
}

/// Names of the field of times.
const TIME: [&str; 6] = ["t", "time", "timestamp", "offset_time", "time_offset", "time_stamp"];
/// Names of the field of intensities.
const INTENSITY: [&str; 3] = ["intensity", "intensities", "reflectivity"];
/// CloudCompare puts this before names that it does not know.
const FOREIGN_PREFIX: &str = "scalar_";

/// How colours are given.
enum Colours {
    /// `0xRRGGBB` in a field.
    Packed(usize),
    /// A field each, and what makes 255 of its largest number.
    Apart([usize; 3], f64),
}

/// Puts points together; `value` gives a point's field.
///
/// # Errors
/// The axis that is missing.
pub(crate) fn assemble(
    fields: &[Field],
    count: usize,
    value: impl Fn(usize, usize) -> f64,
) -> Result<Points, &'static str> {
    let names: Vec<String> = fields.iter().map(|field| plain_name(&field.name)).collect();
    let find = |name: &str| names.iter().position(|n| n == name);
    let [x, y, z] = [find("x").ok_or("x")?, find("y").ok_or("y")?, find("z").ok_or("z")?];
    let points_m = (0..count).map(|at| [value(at, x) as f32, value(at, y) as f32, value(at, z) as f32]).collect();
    let colours = match colours_of(fields, &names) {
        Some(Colours::Packed(field)) => (0..count).map(|at| unpacked(value(at, field), fields[field].scalar)).collect(),
        Some(Colours::Apart(rgb, scale)) => {
            (0..count).map(|at| rgb.map(|field| (value(at, field) * scale) as u8)).collect()
        }
        None => Vec::new(),
    };
    let time = TIME.iter().find_map(|name| find(name));
    let intensity = INTENSITY.iter().find_map(|name| find(name));
    let intensities = intensity.map_or_else(Vec::new, |field| (0..count).map(|at| value(at, field) as f32).collect());
    Ok(Points {
        points_m,
        colours,
        intensities: telling(intensities),
        times: time.map_or_else(Vec::new, |field| (0..count).map(|at| value(at, field)).collect()),
        time_field: time.map(|field| (names[field].clone(), fields[field].scalar.is_integer())),
    })
}

/// Intensities that are the same of all say nothing.
pub(crate) fn telling(intensities: Vec<f32>) -> Vec<f32> {
    if intensities.windows(2).all(|pair| pair[0] == pair[1]) { Vec::new() } else { intensities }
}

fn plain_name(name: &str) -> String {
    let name = name.to_ascii_lowercase();
    name.strip_prefix(FOREIGN_PREFIX).map_or_else(|| name.clone(), str::to_owned)
}

/// Whether a field holds packed colours: its bits count, not its number.
pub(crate) fn is_packed_colour(name: &str) -> bool {
    matches!(plain_name(name).as_str(), "rgb" | "rgba")
}

fn colours_of(fields: &[Field], names: &[String]) -> Option<Colours> {
    if let Some(packed) = names.iter().position(|name| is_packed_colour(name)) {
        return (fields[packed].scalar.size() >= 4).then_some(Colours::Packed(packed));
    }
    let find = |name: &str| names.iter().position(|n| n == name);
    let apart = [["red", "green", "blue"], ["r", "g", "b"], ["diffuse_red", "diffuse_green", "diffuse_blue"]];
    let rgb = apart.iter().find_map(|[r, g, b]| Some([find(r)?, find(g)?, find(b)?]))?;
    let scale = match fields[rgb[0]].scalar {
        Scalar::F32 | Scalar::F64 => 255.0,
        Scalar::U16 => 1.0 / 257.0,
        _ => 1.0,
    };
    Some(Colours::Apart(rgb, scale))
}

/// Colours packed in an integer, or in the bits of a float as PCL has it.
fn unpacked(value: f64, scalar: Scalar) -> [u8; 3] {
    let bits = if scalar.is_integer() { value as i64 as u32 } else { (value as f32).to_bits() };
    let [_, r, g, b] = bits.to_be_bytes();
    [r, g, b]
}

/// A sweep is not longer, seconds.
const SWEEP_S: f64 = 1.5;
/// Seconds of the Unix epoch between 2001 and 2049.
pub(crate) const UNIX_S: std::ops::Range<f64> = 1e9..2.5e9;
/// Seconds, milliseconds, microseconds, nanoseconds.
const UNITS_S: [f64; 4] = [1.0, 1e-3, 1e-6, 1e-9];

/// When points were taken.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PointTimes {
    /// After the first, seconds.
    pub(crate) times_s: Vec<f32>,
    /// The first: after the file's stamp, seconds; or of the Unix epoch.
    pub(crate) first: First,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum First {
    AfterStamp(f64),
    At(Stamp),
}

/// What the times of points mean. Nothing in a file tells the unit; it is found so:
///
/// 1. Integers named `t` or `offset_time` are nanoseconds after the stamp, as Ouster and Livox have it.
/// 2. Numbers that are times between 2001 and 2049 in some unit are times of the Unix epoch.
/// 3. All else is after (or before) the stamp, in the largest unit in which no point is farther than 1.5 s from it;
///    integers cannot be seconds.
///
/// None where no unit fits or a point that is there has none; empty where all are the same.
pub(crate) fn times_of(points: &Points) -> Option<PointTimes> {
    let (name, is_integer) = points.time_field.as_ref()?;
    let is_there = |point: &[f32; 3]| point.iter().all(|v| v.is_finite());
    // what brought nothing back may stand in the sensor, with any time
    let brings_something = |point: &[f32; 3]| is_there(point) && *point != [0.0; 3];
    times_of_those(points, (name, *is_integer), &is_there)
        .or_else(|| times_of_those(points, (name, *is_integer), &brings_something))
}

fn times_of_those(
    points: &Points,
    (name, is_integer): (&str, bool),
    is_there: &dyn Fn(&[f32; 3]) -> bool,
) -> Option<PointTimes> {
    let there =
        || points.times.iter().zip(&points.points_m).filter(|(_, point)| is_there(point)).map(|(time, _)| *time);
    if !there().all(f64::is_finite) {
        return None;
    }
    let (first, last) = there().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), t| (a.min(t), b.max(t)));
    if first >= last {
        return Some(PointTimes { times_s: Vec::new(), first: First::AfterStamp(0.0) });
    }
    let (unit_s, is_absolute) = unit_of(name, is_integer, [first, last])?;
    let start = if is_absolute { first } else { first.min(0.0) };
    let seconds =
        |(time, point): (&f64, &[f32; 3])| if is_there(point) { ((time - start) * unit_s) as f32 } else { 0.0 };
    let first = if is_absolute {
        First::At(Stamp((first * unit_s * 1e9).round() as i64))
    } else {
        First::AfterStamp(start * unit_s)
    };
    Some(PointTimes { times_s: points.times.iter().zip(&points.points_m).map(seconds).collect(), first })
}

fn unit_of(name: &str, is_integer: bool, ends: [f64; 2]) -> Option<(f64, bool)> {
    let spans_s = |unit_s: f64| (ends[1] - ends[0]) * unit_s;
    if is_integer && matches!(name, "t" | "offset_time") && spans_s(1e-9) <= SWEEP_S && ends[1] * 1e-9 < UNIX_S.start {
        return Some((1e-9, false));
    }
    let is_unix =
        |unit_s: &f64| ends.iter().all(|time| UNIX_S.contains(&(time * unit_s))) && spans_s(*unit_s) <= SWEEP_S;
    if let Some(unit_s) = UNITS_S.into_iter().find(is_unix) {
        return Some((unit_s, true));
    }
    let in_sweep = |unit_s: &f64| ends.iter().all(|time| (time * unit_s).abs() <= SWEEP_S);
    let units_s = if is_integer { &UNITS_S[1..] } else { &UNITS_S[..] };
    units_s.iter().copied().find(in_sweep).map(|unit_s| (unit_s, false))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_those_of_the_usual_drivers() {
        let now = 1_700_000_000.0;
        for (driver, name, is_integer, ends, expected) in [
            ("Ouster", "t", true, [0.0, 99_990_000.0], Some((1e-9, false))),
            ("Velodyne", "time", false, [-0.1, 0.0], Some((1.0, false))),
            ("Hesai", "timestamp", false, [now, now + 0.1], Some((1.0, true))),
            ("nanoseconds", "timestamp", false, [now * 1e9, (now + 0.1) * 1e9], Some((1e-9, true))),
            ("microseconds after", "time", true, [0.0, 99_900.0], Some((1e-6, false))),
            ("nonsense", "time", false, [0.0, 1e30], None),
        ] {
            assert_eq!(unit_of(name, is_integer, ends), expected, "{driver}");
        }
    }

    #[test]
    fn times_begin_with_the_first_point() {
        let points = Points {
            points_m: vec![[0.0; 3], [1.0; 3], [f32::NAN; 3]],
            times: vec![0.0, -0.1, f64::NAN],
            time_field: Some(("time".into(), false)),
            ..Points::default()
        };
        let times = times_of(&points).unwrap();
        assert_eq!((times.times_s, times.first), (vec![0.1, 0.0, 0.0], First::AfterStamp(-0.1)));
        let broken = Points { times: vec![0.0, f64::NAN, 0.0], ..points };
        assert_eq!(times_of(&broken), None);
    }

    #[test]
    fn packed_colours_are_bits() {
        assert_eq!(unpacked(f64::from(0x0010_2030_u32), Scalar::U32), [0x10, 0x20, 0x30]);
        assert_eq!(unpacked(f64::from(f32::from_bits(0x0010_2030)), Scalar::F32), [0x10, 0x20, 0x30]);
        assert_eq!(unpacked(f64::from(0xff10_2030_u32), Scalar::U32), [0x10, 0x20, 0x30]);
    }
}
