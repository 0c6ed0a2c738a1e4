//! Settings: plain values with units in their names; one set of defaults serves every log.
//!
//! Each section is declared once, with default, allowed range, unit and meaning; reading, writing, checking and the
//! list that `mapwright config` prints come from that declaration.

use mapwright_geom::Pose2;
use mapwright_grid::MatcherSettings;
use mapwright_loops::PlaneSubmapSettings;
use serde::{Deserialize, Serialize};
use std::fmt::Display;
use std::ops::RangeInclusive;

/// A setting that is out of its range, unknown, or not of its type.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SettingsError {
    /// There is no such key.
    #[error("there is no setting `{key}`; `mapwright config` lists them all")]
    Unknown {
        /// What was asked for.
        key: String,
    },
    /// The text is not a value of the setting's type.
    #[error("setting `{key}` expects {expected}, found `{found}`")]
    NotAValue {
        /// Dotted key.
        key: String,
        /// What would do.
        expected: String,
        /// What was given.
        found: String,
    },
    /// The value is outside its range.
    #[error("setting `{key}` must be within {expected}, found {found}")]
    OutOfRange {
        /// Dotted key.
        key: String,
        /// The range.
        expected: String,
        /// What was given.
        found: String,
    },
}

/// One setting as shown to people.
#[derive(Debug, Clone, PartialEq)]
pub struct SettingLine {
    /// Section, such as `map`.
    pub section: &'static str,
    /// Key within the section.
    pub key: &'static str,
    /// Value as TOML.
    pub value: String,
    /// Unit, or an empty text.
    pub unit: &'static str,
    /// One line of meaning.
    pub meaning: &'static str,
}

/// A type that settings may have.
trait Value: Sized {
    type Bounds: Display;
    fn parse(text: &str) -> Result<Self, String>;
    fn show(&self) -> String;
    fn check(&self, bounds: &RangeInclusive<Self::Bounds>) -> bool;
}

impl Value for f64 {
    type Bounds = f64;
    fn parse(text: &str) -> Result<Self, String> {
        text.parse().map_err(|_| "a number".to_owned())
    }
    fn show(&self) -> String {
        let text = format!("{self}");
        if text.contains(['.', 'e', 'n', 'i']) { text } else { format!("{text}.0") }
    }
    fn check(&self, bounds: &RangeInclusive<f64>) -> bool {
        bounds.contains(self)
    }
}

impl Value for u32 {
    type Bounds = u32;
    fn parse(text: &str) -> Result<Self, String> {
        text.parse().map_err(|_| "a whole number".to_owned())
    }
    fn show(&self) -> String {
        self.to_string()
    }
    fn check(&self, bounds: &RangeInclusive<u32>) -> bool {
        bounds.contains(self)
    }
}

impl Value for bool {
    type Bounds = u32;
    fn parse(text: &str) -> Result<Self, String> {
        text.parse().map_err(|_| "true or false".to_owned())
    }
    fn show(&self) -> String {
        self.to_string()
    }
    fn check(&self, _bounds: &RangeInclusive<u32>) -> bool {
        true
    }
}

/// An enumeration whose values have names.
macro_rules! named {
    ($(#[$doc:meta])* $name:ident { $($(#[$vdoc:meta])* $variant:ident = $text:literal),+ $(,)? } default $default:ident) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
        pub enum $name { $($(#[$vdoc])* #[serde(rename = $text)] $variant),+ }
        impl Value for $name {
            type Bounds = u32;
            fn parse(text: &str) -> Result<Self, String> {
                match text.trim_matches('"') {
                    $($text => Ok(Self::$variant),)+
                    _ => Err(["one of", $(concat!("\"", $text, "\"")),+].join(" ")),
                }
            }
            fn show(&self) -> String {
                match self { $(Self::$variant => concat!("\"", $text, "\"").to_owned()),+ }
            }
            fn check(&self, _bounds: &RangeInclusive<u32>) -> bool { true }
        }
    };
}

macro_rules! section {
    ($(#[$doc:meta])* $name:ident, $section:literal {
        $($field:ident: $type:ty = $default:expr, $range:expr, $unit:literal, $meaning:literal;)+
    }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
        #[serde(default, deny_unknown_fields)]
        pub struct $name { $(#[doc = $meaning] pub $field: $type,)+ }

        impl Default for $name {
            fn default() -> Self { Self { $($field: $default,)+ } }
        }

        impl $name {
            fn lines(&self, lines: &mut Vec<SettingLine>) {
                $(lines.push(SettingLine {
                    section: $section, key: stringify!($field), value: self.$field.show(), unit: $unit, meaning: $meaning,
                });)+
            }

            fn set(&mut self, key: &str, text: &str) -> Result<(), SettingsError> {
                match key {
                    $(stringify!($field) => {
                        self.$field = <$type as Value>::parse(text).map_err(|expected| SettingsError::NotAValue {
                            key: concat!($section, ".", stringify!($field)).to_owned(), expected, found: text.to_owned(),
                        })?;
                        Ok(())
                    })+
                    _ => Err(SettingsError::Unknown { key: format!("{}.{key}", $section) }),
                }
            }

            fn validate(&self) -> Result<(), SettingsError> {
                $({
                    let range: RangeInclusive<<$type as Value>::Bounds> = $range;
                    if !self.$field.check(&range) {
                        return Err(SettingsError::OutOfRange {
                            key: concat!($section, ".", stringify!($field)).to_owned(),
                            expected: format!("{} to {}", range.start(), range.end()),
                            found: self.$field.show(),
                        });
                    }
                })+
                Ok(())
            }
        }
    };
}

named! {
    /// How the objective of a match is maximised.
    Optimizer {
        /// Damped Gauss-Newton.
        #[default]
        GaussNewton = "gauss-newton",
        /// The chapter's gradient ascent, scaled so that rotation and translation count alike.
        GradientAscent = "gradient-ascent",
        /// Gradient ascent in which a radian counts as a metre: slower, but it forgives larger errors of heading.
        UnscaledGradientAscent = "unscaled-gradient-ascent",
    } default GaussNewton
}

named! {
    /// Which keyframes a scan is matched against.
    LivePolicy {
        /// Everything ever seen.
        Everything = "everything",
        /// Only keyframes whose pose relative to the robot is certain.
        #[default]
        Gated = "gated",
    } default Gated
}

section! {
    /// The grid.
    MapSettings, "map" {
        resolution_m: f64 = 0.05, 0.005..=1.0, "m", "side of a cell";
        passes_per_hit: u32 = 5, 1..=1000, "", "a cell is an obstacle while hits times this reach its passes";
    }
}
section! {
    /// What is taken from a scan.
    ScanSettings, "scan" {
        min_range_m: f64 = 0.0, 0.0..=100.0, "m", "returns nearer than this are dropped, beside the laser's own minimum";
        max_range_m: f64 = 80.0, 0.1..=10_000.0, "m", "readings from here on are no returns, beside the laser's own maximum";
        drop_moving: bool = true, 0..=1, "", "what moves while it is seen, as people do, and what travels with the robot is neither matched nor drawn";
        free_range_m: f64 = 6.0, 0.0..=100.0, "m", "a beam without return clears free space up to here";
    }
}
section! {
    /// Motion model: variances per squared motion (Probabilistic Robotics 2005, Table 5.5) and floors.
    MotionSettings, "motion" {
        use_odometry: bool = true, 0..=1, "", "false predicts with constant velocity even where the log has odometry";
        alpha1: f64 = 0.1, 0.0..=10.0, "", "rotation variance per squared rotation";
        alpha2: f64 = 0.05, 0.0..=10.0, "rad^2/m^2", "rotation variance per squared translation";
        alpha3: f64 = 0.03, 0.0..=10.0, "", "translation variance per squared translation";
        alpha4: f64 = 0.02, 0.0..=10.0, "m^2/rad^2", "translation variance per squared rotation";
        tail: f64 = 1e8, 0.1..=1e9, "", "weight of the heavy tail that allows for slip; larger is more like a normal";
        translation_floor_m: f64 = 0.005, 1e-6..=10.0, "m", "least standard deviation of a step's translation";
        rotation_floor_rad: f64 = 0.005, 1e-6..=3.2, "rad", "least standard deviation of a step's rotation";
        translation_per_second_m: f64 = 0.005, 0.0..=10.0, "m/s", "growth of the translation floor with time";
        rotation_per_second_rad: f64 = 0.005, 0.0..=3.2, "rad/s", "growth of the rotation floor with time";
    }
}
section! {
    /// The match.
    MatchingSettings, "matching" {
        optimizer: Optimizer = Optimizer::GaussNewton, 0..=1, "", "\"gauss-newton\", \"gradient-ascent\" or \"unscaled-gradient-ascent\"";
        sigma_m: f64 = 0.025, 0.001..=1.0, "m", "standard deviation of a hit in the last stage";
        capture_sigma_m: f64 = 0.15, 0.001..=2.0, "m", "standard deviation of a hit in the first stage";
        random_ratio: f64 = 0.02, 1e-4..=1.0, "", "density of random readings relative to a hit at distance zero";
        beam_share: f64 = 1.0, 1e-6..=1.0, "", "beams are correlated: their summed log likelihood counts with this share";
        max_evaluations: u32 = 30, 1..=1000, "", "evaluations of the objective a stage may use";
    }
}
section! {
    /// When a scan becomes a keyframe.
    KeyframeSettings, "keyframes" {
        distance_m: f64 = 0.2, 0.01..=10.0, "m", "after this much translation";
        angle_rad: f64 = 0.1, 0.01..=3.2, "rad", "or this much rotation";
    }
}
section! {
    /// The local map.
    LiveSettings, "live" {
        policy: LivePolicy = LivePolicy::Gated, 0..=1, "", "\"everything\" ever seen, breaks or not, or \"gated\" by certainty";
        gate_m: f64 = 0.08, 0.001..=10.0, "m", "gated: so certain keyframes are matched against; those that the robot stays near until 2.5 times as uncertain";
        views_per_area: u32 = 24, 1..=10_000, "", "gated: live keyframes per square metre and quarter turn";
    }
}
named! {
    /// How the past is corrected when a loop is closed.
    Correction {
        /// The whole graph is brought to its optimum.
        #[default]
        Graph = "graph",
        /// The error is spread over the loop in proportion to the motion.
        Spread = "spread",
        /// Not at all: closures are only reported.
        None = "none",
    } default Graph
}

named! {
    /// Who does the work that may take longer than a scan.
    Jobs {
        /// The mapper, at once.
        #[default]
        Inline = "inline",
        /// The caller: [`crate::Mapper::next_job`], [`crate::Mapper::apply`].
        HandedOut = "handed-out",
    } default Inline
}

section! {
    /// Coming back to places.
    LoopSettings, "loops" {
        by_pose: bool = true, 0..=1, "", "old places within the pose's uncertainty are looked for, and those that matches are supported by verified";
        by_place: bool = true, 0..=1, "", "places that look like this one are looked for where the pose is too uncertain";
        correction: Correction = Correction::Graph, 0..=1, "", "\"graph\", \"spread\" or \"none\"";
        jobs: Jobs = Jobs::Inline, 0..=1, "", "\"inline\", or \"handed-out\" to a worker of the caller's";
    }
}

section! {
    /// Maps of space.
    SpaceSettings, "space" {
        resolution_m: f64 = 0.0, 0.0..=10.0, "m", "side of the smallest voxels; 0 derives it from how far the first cloud sees";
        max_range_m: f64 = 120.0, 0.1..=10_000.0, "m", "points from here on are no returns, beside the sensor's own maximum";
    }
}

/// All settings.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// The grid.
    pub map: MapSettings,
    /// What is taken from a scan.
    pub scan: ScanSettings,
    /// Motion model.
    pub motion: MotionSettings,
    /// The match.
    pub matching: MatchingSettings,
    /// Keyframes.
    pub keyframes: KeyframeSettings,
    /// The local map.
    pub live: LiveSettings,
    /// Coming back to places.
    pub loops: LoopSettings,
    /// Maps of space.
    pub space: SpaceSettings,
}

impl KeyframeSettings {
    /// Whether a motion is enough for another keyframe.
    pub(crate) fn is_far(&self, step: Pose2) -> bool {
        step.x.hypot(step.y) > self.distance_m || step.theta.abs() > self.angle_rad
    }
}

/// Sessions of earlier versions name it; there is nothing to be set any more.
const RETIRED: &str = "loops.relocate";

/// End points of a submap that lie farther from its origin are not compared, cells.
const REACH_CELLS: f64 = 300.0;

impl Settings {
    /// What the defaults are where scans stand for what sonars heard: each over a metre of way, its walls known to half a cell of 0.1 m.
    #[must_use]
    pub fn of_sonars() -> Self {
        let defaults = Self::default();
        Self {
            map: MapSettings { resolution_m: 0.1, ..defaults.map },
            // Echoes of moving things are no walls: they are sorted out before.
            scan: ScanSettings { drop_moving: false, ..defaults.scan },
            // Wheels count as what they are, 10 % of ways, for scans of sonars say too little to tell; headings as walls have corrected them.
            motion: MotionSettings { alpha1: 0.002, alpha2: 3e-4, alpha3: 0.02, alpha4: 0.002, ..defaults.motion },
            // Some ten walls are seen by two hundred beams, right or wrong each as a whole.
            matching: MatchingSettings {
                sigma_m: 0.05,
                capture_sigma_m: 0.1,
                random_ratio: 0.3,
                beam_share: 0.02,
                ..defaults.matching
            },
            live: LiveSettings { gate_m: 0.3, ..defaults.live },
            ..defaults
        }
    }

    /// How what was seen along the way is drawn to be compared.
    pub(crate) fn submaps(&self) -> PlaneSubmapSettings {
        PlaneSubmapSettings {
            resolution_m: self.map.resolution_m,
            passes_per_hit: self.map.passes_per_hit,
            free_range_m: self.scan.free_range_m,
            reach_m: REACH_CELLS * self.map.resolution_m,
            thin_cells: 2,
        }
    }

    /// How scans and submaps are matched.
    pub(crate) fn matcher(&self) -> MatcherSettings {
        let MatchingSettings { sigma_m, capture_sigma_m, random_ratio, beam_share, max_evaluations, .. } =
            self.matching;
        MatcherSettings {
            sigma_m,
            capture_sigma_m,
            random_ratio,
            beam_share,
            max_evaluations,
            ..MatcherSettings::default()
        }
    }

    /// Every setting with its present value, unit and meaning, in order.
    #[must_use]
    pub fn lines(&self) -> Vec<SettingLine> {
        let mut lines = Vec::new();
        self.map.lines(&mut lines);
        self.scan.lines(&mut lines);
        self.motion.lines(&mut lines);
        self.matching.lines(&mut lines);
        self.keyframes.lines(&mut lines);
        self.live.lines(&mut lines);
        self.loops.lines(&mut lines);
        self.space.lines(&mut lines);
        lines
    }

    /// Every setting as a line `section.key = value`, which [`Settings::from_text`] reads.
    #[must_use]
    pub fn to_text(&self) -> String {
        let line = |line: SettingLine| format!("{}.{} = {}\n", line.section, line.key, line.value);
        self.lines().into_iter().map(line).collect()
    }

    /// The settings that these lines set; those that they do not name are the defaults.
    ///
    /// # Errors
    /// A line that is no `section.key = value`, and those of [`Settings::set`] and [`Settings::validate`].
    pub fn from_text(text: &str) -> Result<Self, SettingsError> {
        let mut settings = Self::default();
        for line in text.lines().filter(|line| !line.trim().is_empty()) {
            let (key, value) =
                line.split_once('=').ok_or_else(|| SettingsError::Unknown { key: line.trim().to_owned() })?;
            if key.trim() != RETIRED {
                settings.set(key.trim(), value.trim())?;
            }
        }
        settings.validate()?;
        Ok(settings)
    }

    /// Sets one value by its dotted key, such as `map.resolution_m`.
    ///
    /// # Errors
    /// An unknown key, or a text that is no value of the setting's type. Ranges are checked by [`Settings::validate`].
    pub fn set(&mut self, key: &str, text: &str) -> Result<(), SettingsError> {
        let unknown = || SettingsError::Unknown { key: key.to_owned() };
        let (section, name) = key.split_once('.').ok_or_else(unknown)?;
        match section {
            "map" => self.map.set(name, text),
            "scan" => self.scan.set(name, text),
            "motion" => self.motion.set(name, text),
            "matching" => self.matching.set(name, text),
            "keyframes" => self.keyframes.set(name, text),
            "live" => self.live.set(name, text),
            "loops" => self.loops.set(name, text),
            "space" => self.space.set(name, text),
            _ => Err(unknown()),
        }
    }

    /// Checks every range.
    ///
    /// # Errors
    /// The first setting that is outside its range.
    pub fn validate(&self) -> Result<(), SettingsError> {
        self.map.validate()?;
        self.scan.validate()?;
        self.motion.validate()?;
        self.matching.validate()?;
        self.keyframes.validate()?;
        self.live.validate()?;
        self.loops.validate()?;
        self.space.validate()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_listed_setting_can_be_set_to_what_is_listed() {
        let mut settings = Settings::default();
        for line in Settings::default().lines() {
            settings.set(&format!("{}.{}", line.section, line.key), &line.value).expect("its own value");
        }
        assert_eq!(settings, Settings::default());
        assert_eq!(settings.validate(), Ok(()));
    }

    #[test]
    fn settings_are_read_back_from_their_text() {
        let mut settings = Settings::default();
        settings.set("map.resolution_m", "0.1").expect("a number");
        settings.set("live.policy", "everything").expect("a policy");
        assert_eq!(Settings::from_text(&settings.to_text()), Ok(settings));
        assert_eq!(Settings::from_text("\n"), Ok(Settings::default()));
        assert!(Settings::from_text("map.resolution_m 0.1").is_err() && Settings::from_text("a = 1").is_err());
        assert!(Settings::from_text("map.resolution_m = 99").is_err());
        assert_eq!(Settings::from_text("loops.relocate = true\n"), Ok(Settings::default()), "of an earlier version");
    }

    #[test]
    fn wrong_settings_say_what_was_expected_and_found() {
        let mut settings = Settings::default();
        assert!(settings.set("map.colour", "1").unwrap_err().to_string().contains("map.colour"));
        let error = settings.set("live.policy", "some").unwrap_err().to_string();
        assert!(error.contains("everything") && error.contains("some"), "{error}");
        settings.set("map.resolution_m", "NaN").expect("a number");
        assert!(settings.validate().unwrap_err().to_string().contains("map.resolution_m"));
    }
}
