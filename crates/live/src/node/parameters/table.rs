//! Which parameters there are.

use super::excerpt;
use super::value::{Misfit, ParameterKind, ParameterValue};

/// What a parameter sets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
#[allow(missing_docs)] // the table says what each means
pub enum Setting {
    RobotFrame,
    OdomFrame,
    MapFrame,
    ScanTopic,
    MapTopic,
    Resolution,
    MapInterval,
    TransformPeriod,
    TransformWait,
    TransformTolerance,
    Broadcast,
    Mode,
    MapFile,
    StartPose,
    SetInitialPose,
    InitialX,
    InitialY,
    InitialZ,
    InitialYaw,
    SimTime,
    LoopClosing,
    MaxRange,
    MinRange,
    Paused,
    BondPeriod,
    Autostart,
}

/// When a parameter can be set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum When {
    /// At any time.
    Running,
    /// As long as the node is not configured.
    Configuring,
    /// By the node alone.
    Never,
}

/// What a setting is as long as nobody says otherwise.
pub(super) enum Given {
    Bool(bool),
    Double(f64),
    Text(&'static str),
    Doubles(&'static [f64]),
}

impl Given {
    pub(super) fn value(&self) -> ParameterValue {
        match self {
            Self::Bool(value) => ParameterValue::Bool(*value),
            Self::Double(value) => ParameterValue::Double(*value),
            Self::Text(value) => ParameterValue::Text((*value).to_owned()),
            Self::Doubles(values) => ParameterValue::Doubles(values.to_vec()),
        }
    }

    fn kind(&self) -> ParameterKind {
        match self {
            Self::Bool(_) => ParameterKind::Bool,
            Self::Double(_) => ParameterKind::Double,
            Self::Text(_) => ParameterKind::Text,
            Self::Doubles(_) => ParameterKind::Doubles,
        }
    }
}

/// A setting, its names, and what it may be.
pub(super) struct Entry {
    pub(super) setting: Setting,
    /// slam_toolbox's first, then AMCL's.
    pub(super) names: &'static [&'static str],
    pub(super) default: Given,
    pub(super) when: When,
    pub(super) range: Option<(f64, f64)>,
    /// Texts that it may be; any where there are none.
    choices: &'static [&'static str],
    /// Numbers that a list has, besides none.
    length: usize,
    pub(super) means: &'static str,
}

const fn entry(
    setting: Setting,
    names: &'static [&'static str],
    default: Given,
    when: When,
    means: &'static str,
) -> Entry {
    Entry { setting, names, default, when, range: None, choices: &[], length: 0, means }
}

impl Entry {
    const fn within(mut self, least: f64, most: f64) -> Self {
        self.range = Some((least, most));
        self
    }

    const fn one_of(mut self, choices: &'static [&'static str]) -> Self {
        self.choices = choices;
        self
    }

    const fn long(mut self, length: usize) -> Self {
        self.length = length;
        self
    }

    /// What values have to be besides their kind and range, in words.
    pub(super) fn constraints(&self) -> String {
        let lists = if self.length > 0 { format!("{} numbers or none", self.length) } else { String::new() };
        let when = if self.when == When::Configuring { "read when the node is configured" } else { "" };
        let parts = [self.choices.join(" or "), lists, when.to_owned()];
        parts.into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join("; ")
    }

    /// The value as this setting has it.
    ///
    /// # Errors
    /// Where it is none of its values.
    pub(super) fn fit(&self, value: ParameterValue) -> Result<ParameterValue, Misfit> {
        if value == ParameterValue::NotSet {
            return Err(Misfit::new(self.default.kind(), "nothing; it cannot be removed"));
        }
        let value = value.into_kind(self.default.kind())?;
        match &value {
            ParameterValue::Double(number) => {
                let (least, most) = self.range.unwrap_or((f64::MIN, f64::MAX));
                // a NaN fails the comparison
                if !(*number >= least && *number <= most) {
                    return Err(Misfit::new(format_args!("a number from {least} to {most}"), number));
                }
            }
            ParameterValue::Text(text) if !self.choices.is_empty() && !self.choices.contains(&text.as_str()) => {
                return Err(Misfit::new(self.choices.join(" or "), format_args!("`{}`", excerpt(text))));
            }
            ParameterValue::Text(text) if text.len() > TEXT_MOST => {
                return Err(Misfit::new(format_args!("a string of at most {TEXT_MOST} bytes"), text.len()));
            }
            ParameterValue::Doubles(numbers) => {
                let is_long = numbers.is_empty() || numbers.len() == self.length;
                if !is_long || numbers.iter().any(|number| !number.is_finite()) {
                    let expected = format!("{} finite numbers or none", self.length);
                    return Err(Misfit::new(expected, format_args!("{} numbers", numbers.len())));
                }
            }
            _ => {}
        }
        Ok(value)
    }
}

/// The longest text that is kept, bytes.
const TEXT_MOST: usize = 4096;

use Given::{Bool, Double, Doubles, Text};
use When::{Configuring, Never, Running};

/// All of them. Defaults are those of the gate, of the mapper's settings and of the node, not slam_toolbox's.
pub(super) static TABLE: [Entry; 26] = [
    entry(
        Setting::RobotFrame,
        &["base_frame", "base_frame_id"],
        Text("base_link"),
        Configuring,
        "The robot's own frame.",
    ),
    entry(
        Setting::OdomFrame,
        &["odom_frame", "odom_frame_id"],
        Text("odom"),
        Configuring,
        "The frame that odometry has the robot in.",
    ),
    entry(Setting::MapFrame, &["map_frame", "global_frame_id"], Text("map"), Configuring, "The frame of the map."),
    entry(Setting::ScanTopic, &["scan_topic"], Text("/scan"), Configuring, "The topic of scans."),
    entry(Setting::MapTopic, &["map_name"], Text("/map"), Configuring, "The topic of the map."),
    entry(Setting::Resolution, &["resolution"], Double(0.05), Configuring, "Side of a cell of the map, metres.")
        .within(0.005, 1.0),
    entry(Setting::MapInterval, &["map_update_interval"], Double(5.0), Running, "Time between two maps, seconds.")
        .within(0.05, 3600.0),
    entry(
        Setting::TransformPeriod,
        &["transform_publish_period"],
        Double(0.02),
        Running,
        "Time between two transforms from the map to odometry, seconds; 0 for none.",
    )
    .within(0.0, 10.0),
    entry(
        Setting::TransformWait,
        &["transform_timeout"],
        Double(0.5),
        Configuring,
        "A scan waits for its transforms so long at most, seconds.",
    )
    .within(0.0, 10.0),
    entry(
        Setting::TransformTolerance,
        &["transform_tolerance"],
        Double(0.1),
        Running,
        "Transforms from the map to odometry are valid for so long, seconds.",
    )
    .within(0.0, 10.0),
    entry(
        Setting::Broadcast,
        &["tf_broadcast"],
        Bool(true),
        Running,
        "Whether the transform from the map to odometry is published.",
    ),
    entry(
        Setting::Mode,
        &["mode"],
        Text("mapping"),
        Configuring,
        "Whether the map grows, or the robot is only found in it.",
    )
    .one_of(&["mapping", "localization"]),
    entry(
        Setting::MapFile,
        &["map_file_name"],
        Text(""),
        Configuring,
        "A session to go on with, or to find the robot in, without an ending; empty for none.",
    ),
    entry(
        Setting::StartPose,
        &["map_start_pose"],
        Doubles(&[]),
        Configuring,
        "Where the robot stands in that session's map: metres, metres, radians; empty where it is not known.",
    )
    .long(3),
    entry(
        Setting::SetInitialPose,
        &["set_initial_pose"],
        Bool(false),
        Configuring,
        "Whether the robot stands at initial_pose.",
    ),
    entry(
        Setting::InitialX,
        &["initial_pose.x"],
        Double(0.0),
        Configuring,
        "Where the robot stands in the map, metres.",
    ),
    entry(
        Setting::InitialY,
        &["initial_pose.y"],
        Double(0.0),
        Configuring,
        "Where the robot stands in the map, metres.",
    ),
    entry(
        Setting::InitialZ,
        &["initial_pose.z"],
        Double(0.0),
        Configuring,
        "Its height there, metres; without meaning in the plane.",
    ),
    entry(
        Setting::InitialYaw,
        &["initial_pose.yaw"],
        Double(0.0),
        Configuring,
        "How the robot is turned in the map, radians.",
    ),
    entry(
        Setting::SimTime,
        &["use_sim_time"],
        Bool(false),
        Configuring,
        "Whether the time is that of the topic /clock.",
    ),
    entry(Setting::LoopClosing, &["do_loop_closing"], Bool(true), Configuring, "Whether old places are looked for."),
    entry(
        Setting::MaxRange,
        &["max_laser_range", "laser_max_range"],
        Double(0.0),
        Configuring,
        "Hits that are further away are not used, metres; 0 and less for what scans say.",
    )
    .within(-1.0, 1000.0),
    entry(
        Setting::MinRange,
        &["min_laser_range", "laser_min_range"],
        Double(0.0),
        Configuring,
        "Hits that are nearer are not used, metres; 0 and less for what scans say.",
    )
    .within(-1.0, 1000.0),
    entry(
        Setting::Paused,
        &["paused_new_measurements"],
        Bool(false),
        Never,
        "Whether scans are not taken in at present.",
    ),
    entry(
        Setting::BondPeriod,
        &["bond_heartbeat_period"],
        Double(0.25),
        Configuring,
        "Time between two of those messages, seconds; 0 for none.",
    )
    .within(0.0, 2.0),
    entry(
        Setting::Autostart,
        &["autostart_node"],
        Bool(true),
        Configuring,
        "Whether the node configures and activates itself.",
    ),
];

/// Parameters of slam_toolbox (Jazzy) and AMCL (Kilted) without a meaning here.
pub(super) const IGNORED: [&str; 97] = [
    "alpha1",
    "alpha2",
    "alpha3",
    "alpha4",
    "alpha5",
    "always_reset_initial_pose",
    "angle_variance_penalty",
    "beam_skip_distance",
    "beam_skip_error_threshold",
    "beam_skip_threshold",
    "bond_disable_heartbeat_timeout",
    "ceres_dogleg_type",
    "ceres_linear_solver",
    "ceres_loss_function",
    "ceres_preconditioner",
    "ceres_trust_strategy",
    "check_min_dist_and_heading_precisely",
    "coarse_angle_resolution",
    "coarse_search_angle_offset",
    "correlation_search_space_dimension",
    "correlation_search_space_resolution",
    "correlation_search_space_smear_deviation",
    "debug_logging",
    "distance_variance_penalty",
    "do_beamskip",
    "enable_interactive_mode",
    "fine_search_angle_offset",
    "first_map_only",
    "freespace_downsampling",
    "interactive_mode",
    "introspection_mode",
    "lambda_short",
    "laser_likelihood_max_dist",
    "laser_model_type",
    "lifelong_candidates_scale",
    "lifelong_constraint_multiplier",
    "lifelong_iou_match",
    "lifelong_minimum_score",
    "lifelong_nearby_penalty",
    "lifelong_node_removal_score",
    "lifelong_overlap_score_scale",
    "lifelong_search_use_tree",
    "link_match_minimum_response_fine",
    "link_scan_maximum_distance",
    "localization_on_configure",
    "loop_match_maximum_variance_coarse",
    "loop_match_minimum_chain_size",
    "loop_match_minimum_response_coarse",
    "loop_match_minimum_response_fine",
    "loop_search_maximum_distance",
    "loop_search_space_dimension",
    "loop_search_space_resolution",
    "loop_search_space_smear_deviation",
    "map_start_at_dock",
    "map_topic",
    "max_beams",
    "max_particles",
    "min_particles",
    "min_pass_through",
    "minimum_angle_penalty",
    "minimum_distance_penalty",
    "minimum_time_interval",
    "minimum_travel_distance",
    "minimum_travel_heading",
    "occupancy_threshold",
    "odom_topic",
    "pf_err",
    "pf_z",
    "position_covariance_scale",
    "random_seed",
    "recovery_alpha_fast",
    "recovery_alpha_slow",
    "resample_interval",
    "restore_defaults",
    "robot_model_type",
    "save_pose_rate",
    "scan_buffer_maximum_scan_distance",
    "scan_buffer_size",
    "scan_queue_size",
    "service_introspection_mode",
    "sigma_hit",
    "solver_plugin",
    "stack_size_to_use",
    "tf_buffer_duration",
    "throttle_scans",
    "update_min_a",
    "update_min_d",
    "use_lifecycle_manager",
    "use_map_saver",
    "use_response_expansion",
    "use_scan_barycenter",
    "use_scan_matching",
    "yaw_covariance_scale",
    "z_hit",
    "z_max",
    "z_rand",
    "z_short",
];

/// The setting of a name, and the name as the table has it.
pub(super) fn find(name: &str) -> Option<(&'static Entry, &'static str)> {
    TABLE.iter().find_map(|entry| Some((entry, *entry.names.iter().find(|own| **own == name)?)))
}

/// The name that is like this one up to two letters.
pub(super) fn nearest(name: &str) -> Option<&'static str> {
    const LETTERS: usize = 2;
    let names = TABLE.iter().flat_map(|entry| entry.names).copied();
    let near = names.filter(|own| own.len().abs_diff(name.len()) <= LETTERS);
    near.map(|own| (distance(own, name), own)).filter(|(distance, _)| *distance <= LETTERS).min().map(|(_, own)| own)
}

/// Letters to add, to leave out or to change from one word to the other (Levenshtein 1966).
fn distance(a: &str, b: &str) -> usize {
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, letter) in a.bytes().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, other) in b.bytes().enumerate() {
            let above = row[j + 1];
            row[j + 1] = (above + 1).min(row[j] + 1).min(diagonal + usize::from(letter != other));
            diagonal = above;
        }
    }
    row[b.len()]
}
