//! What to use of a recording, and why.

use crate::channel::TopicKind;
use crate::choice::{Choice, MountChoice, SliceBounds};
use crate::directions::Directions;
use crate::frames::{Place, list, place, placed_by_hand};
use crate::odometry::{self, OdometrySource};
use crate::sonars::{self, SonarSource};
use crate::survey::{Survey, TopicSurvey, same_name};
use crate::turning::{self, TurningSource};
use crate::unread;
use crate::words::{grouped, with_damage};
use mapwright_geom::{Pose2, Pose3};
use mapwright_ros::Mounting;
use mapwright_ros::messages::Image;
use mapwright_sensor::{OdometryCalibration, SweepTimes};
use std::collections::BTreeMap;

/// The most by which a scan plane may be tilted against the robot's, degrees.
pub(crate) const TILT_MOST_DEG: f64 = 5.0;

/// No two lasers sit so near to each other and look so much the same way, metres and radians.
pub(crate) const SAME_PLACE_M: f64 = 0.02;
pub(crate) const SAME_PLACE_RAD: f64 = 0.02;

/// Where a sensor's scans go.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Mount {
    /// A planar laser.
    Planar(Mounting),
    /// A sensor in space.
    Space(Pose3),
}

/// What is used of a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// The topic of the scans.
    pub scans: String,
    /// What kind of scans.
    pub kind: TopicKind,
    /// Lasers of the same robot that are mapped with it.
    pub further: Vec<FurtherLaser>,
    /// Sonars of the same robot. Where `kind` is that of sonars there is no laser.
    pub sonars: Vec<SonarSource>,
    /// Heights of the slice, for clouds.
    pub slice: Option<SliceBounds>,
    /// The robot's frame.
    pub robot_frame: String,
    /// The frame of most of the scans.
    pub sensor_frame: String,
    /// Where odometry comes from.
    pub odometry: OdometrySource,
    /// Where turn rates come from, for the robot's motion during a sweep.
    pub turning: Option<TurningSource>,
    /// Each decision and why: the name of what was decided, and the words.
    pub reasons: Vec<(&'static str, String)>,
    /// What had to be assumed, in words.
    pub assumed: Vec<String>,
    /// Where the recording has the planar laser, where another place is asked for.
    pub(crate) said_mount: Option<Pose2>,
    /// What is taken out of odometry.
    pub(crate) calibration: Option<OdometryCalibration>,
    /// The topics of the robot's transforms.
    pub(crate) transforms: Vec<String>,
    /// Mountings by the scans' frames.
    pub(crate) mounts: BTreeMap<String, Mount>,
    /// What the times of clouds' points are.
    pub(crate) times: SweepTimes,
}

/// A laser beside the first.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FurtherLaser {
    /// The topic of its scans.
    pub topic: String,
    /// What kind of scans.
    pub kind: TopicKind,
}

/// A topic of scans that can be used.
struct Candidate<'a> {
    topic: &'a TopicSurvey,
    place: Place,
    mount: Mount,
    /// Where the recording has it, where another place is asked for.
    said_mount: Option<Pose2>,
}

impl Plan {
    /// Decides what to use.
    ///
    /// # Errors
    /// Why nothing can be mapped, what is there instead and what to type, in words.
    pub fn of(survey: &Survey, choice: &Choice) -> Result<Self, String> {
        Self::of_sound(survey, choice).map_err(|reason| with_damage(&reason, survey))
    }

    fn of_sound(survey: &Survey, choice: &Choice) -> Result<Self, String> {
        choice.not_in_plane()?;
        for name in &choice.topics {
            if survey.topic(name).is_none() {
                return Err(format!("there is no topic {name}; there are {}", contents(survey)));
            }
        }
        let survey = &*survey.of_robot(choice)?;
        if is_of_sonars(survey, choice) {
            return of_sonars(survey, choice);
        }
        let (mut candidates, refused) = candidates(survey, choice)?;
        candidates.sort_by_key(|candidate| {
            let wanted = (candidate.topic.kind == TopicKind::Cloud) == choice.slice.is_some();
            (!wanted, candidate.place.assumed.is_some(), u64::MAX - candidate.topic.usable())
        });
        if let Some(chosen) = candidates.first()
            && choice.slice.is_some()
            && chosen.topic.kind != TopicKind::Cloud
        {
            let found = format!("{} ({})", chosen.topic.name, chosen.topic.type_name);
            let reasons = refused.iter().map(|reason| format!("; {reason}")).collect::<String>();
            return Err(format!("--slice makes scans of point clouds: expected such, found {found}{reasons}"));
        }
        let mut candidates = candidates.into_iter();
        match candidates.next() {
            Some(chosen) => Ok(decide(survey, choice, Lasers::of(chosen, candidates, choice), &refused)),
            None => Err(refused.join("; ")),
        }
    }

    /// The topics of all lasers that are used.
    pub fn lasers(&self) -> impl Iterator<Item = &str> {
        std::iter::once(self.scans.as_str()).chain(self.further.iter().map(|further| further.topic.as_str()))
    }

    /// Scans say when their beams were taken, or whether they do not.
    fn deskew(topic: &TopicSurvey, odometry: &OdometrySource, turning: Option<&TurningSource>) -> String {
        let are_refused = topic.sweeps.times().unit_s().is_none();
        match (topic.kind, topic.has_times) {
            (TopicKind::Cloud, true) if are_refused => format!(
                "not undone: times of points span {:.2} s, and clouds come so often that they are of no sweep",
                topic.sweeps.span_s
            ),
            (TopicKind::Cloud, true) if *odometry == OdometrySource::None && turning.is_some() => {
                "undone as to turning: the points have times, and there is no odometry to say how else the robot moved"
                    .to_owned()
            }
            (TopicKind::Cloud, true) if *odometry == OdometrySource::None => {
                "not undone, though the points have times: there is no odometry to say how the robot moved".to_owned()
            }
            (TopicKind::Cloud, true) => {
                "undone: the points have times, and odometry says how the robot moved".to_owned()
            }
            (TopicKind::Cloud, false) => "not undone: the points have no times".to_owned(),
            (_, true) => "undone: time_increment says when each beam was taken, the stamp when the first".to_owned(),
            (_, false) => "not undone: time_increment is 0, so that all beams count as taken at once".to_owned(),
        }
    }
}

/// The lasers that are mapped together.
struct Lasers<'a> {
    chosen: Candidate<'a>,
    /// The others, and why.
    further: Vec<(Candidate<'a>, String)>,
    /// Those that are not, and why.
    unused: Vec<String>,
}

impl<'a> Lasers<'a> {
    /// Beside the chosen one those on the same robot that see other directions, or that are asked for.
    fn of(chosen: Candidate<'a>, others: impl Iterator<Item = Candidate<'a>>, choice: &Choice) -> Self {
        let mut lasers = Self { chosen, further: Vec::new(), unused: Vec::new() };
        let mut seen = Directions::default();
        lasers.chosen.adds_to(&mut seen);
        for other in others {
            match lasers.why_further(&other, choice, &mut seen) {
                Ok(why) => lasers.further.push((other, why)),
                Err(why) => lasers.unused.push(format!("{}: {why}", other.topic.name)),
            }
        }
        lasers
    }

    /// Why another laser is mapped with those before it, or why not.
    fn why_further(&self, other: &Candidate<'a>, choice: &Choice, seen: &mut Directions) -> Result<String, String> {
        let chosen = &self.chosen;
        if !(chosen.topic.kind.is_planar() && other.topic.kind.is_planar()) {
            return Err("not a planar laser beside another".to_owned());
        }
        if choice.mount.is_some() {
            return Err("a mounting that is asked for is that of one laser".to_owned());
        }
        for candidate in [chosen, other] {
            if candidate.place.assumed.is_some() {
                return Err(format!("nothing says where '{}' sits on the robot", candidate.topic.frame()));
            }
        }
        if chosen.place.robot_frame != other.place.robot_frame {
            return Err(format!("it sits on '{}', not on '{}'", other.place.robot_frame, chosen.place.robot_frame));
        }
        if is_asked(other.topic, choice) {
            return Ok("as asked for".to_owned());
        }
        let mut used = std::iter::once(chosen).chain(self.further.iter().map(|(further, _)| further));
        if let Some(same) = used.find(|used| used.is_of_one_laser_with(other)) {
            return Err(format!("it has scans of the laser of {}", same.topic.name));
        }
        let new = other.adds_to(seen);
        new.map(|degrees| format!("it sees {degrees} deg around the robot that the others do not")).ok_or_else(|| {
            let also = self.names().map(|name| format!(" --topic {name}")).collect::<String>();
            format!("it sees no direction that the others do not; to map it too:{also} --topic {}", other.topic.name)
        })
    }

    fn names(&self) -> impl Iterator<Item = &str> {
        std::iter::once(&self.chosen).chain(self.further.iter().map(|(other, _)| other)).map(|c| c.topic.name.as_str())
    }

    /// The first, as it is chosen among the others.
    fn why_chosen(&self, choice: &Choice) -> String {
        let why = match self.further.len() + self.unused.len() {
            _ if is_asked(self.chosen.topic, choice) => "as asked for",
            0 => "the only topic of scans that can be mapped with",
            _ => "the most scans",
        };
        let not_used = list(self.unused.iter().map(String::as_str));
        if self.unused.is_empty() { why.to_owned() } else { format!("{why}; not used: {not_used}") }
    }
}

impl Candidate<'_> {
    fn words(&self, why: &str) -> String {
        let TopicSurvey { name, type_name, shape, .. } = self.topic;
        format!("{name} ({type_name}, {} messages, {shape}): {why}", grouped(self.topic.usable()))
    }

    /// Whether both are scans of one laser, as one topic may have another's filtered: in one frame, or from one place that looks one way.
    fn is_of_one_laser_with(&self, other: &Self) -> bool {
        let (Mount::Planar(a), Mount::Planar(b)) = (&self.mount, &other.mount) else { return false };
        let apart = a.robot_from_laser.between(b.robot_from_laser);
        let is_one_place = apart.x.hypot(apart.y) <= SAME_PLACE_M && apart.theta.abs() <= SAME_PLACE_RAD;
        self.topic.frame() == other.topic.frame() || is_one_place && a.inverted == b.inverted
    }

    /// The directions that it adds to those that are seen, degrees.
    fn adds_to(&self, seen: &mut Directions) -> Option<usize> {
        let Mount::Planar(mounting) = &self.mount else { return None };
        seen.add(&self.topic.reach, mounting)
    }
}

fn is_asked(topic: &TopicSurvey, choice: &Choice) -> bool {
    choice.topics.iter().any(|name| same_name(name, &topic.name))
}

fn decide(survey: &Survey, choice: &Choice, lasers: Lasers<'_>, refused: &[String]) -> Plan {
    let Candidate { topic, place, mount, said_mount } = &lasers.chosen;
    let found = odometry::find(survey, place, choice);
    let (turning, why_turning) = turning::find(survey, topic, place, choice);
    let motion = Plan::deskew(topic, &found.source, turning.as_ref());
    let mut reasons = vec![
        ("scans", lasers.chosen.words(&lasers.why_chosen(choice))),
        ("robot", format!("'{}', {}", place.robot_frame, place.reason)),
        ("mounting", mounting_words(survey, topic.frame(), place, mount, choice.mount.is_some())),
        ("odometry", found.reason.clone()),
        ("motion", motion.clone()),
    ];
    for (further, why) in &lasers.further {
        reasons.push(("scans", further.words(&format!("mapped too, {why}"))));
        reasons
            .push(("mounting", mounting_words(survey, further.topic.frame(), &further.place, &further.mount, false)));
        let of_this = Plan::deskew(further.topic, &found.source, turning.as_ref());
        reasons.extend((of_this != motion).then(|| ("motion", format!("{}: {of_this}", further.topic.name))));
    }
    reasons.extend(why_turning.map(|why| ("turning", why)));
    reasons.extend(refused.iter().map(|reason| ("refused", reason.clone())));
    let of_driver = |topic: &TopicSurvey| topic.kind.is_clouds() && topic.kind != TopicKind::Cloud;
    let other = survey.topics.iter().filter(|topic| of_driver(topic) && topic.usable() > 0);
    reasons.extend(other.map(|topic| {
        let (count, name) = (grouped(topic.usable()), &topic.type_name);
        ("refused", format!("{}: {count} messages of {name}; `--space` maps these instead", topic.name))
    }));
    let depth = survey.topics.iter().filter(|topic| topic.is_depth && topic.usable() > 0);
    reasons.extend(depth.map(|topic| {
        let count = grouped(topic.usable());
        ("refused", format!("{}: {count} images of depth; `--space` maps these instead", topic.name))
    }));
    let mut mounts = BTreeMap::new();
    for laser in std::iter::once(&lasers.chosen).chain(lasers.further.iter().map(|(further, _)| further)) {
        mounts_of(laser, survey, choice, &mut mounts);
    }
    let heard = sonars::find(survey, choice, Some(&place.robot_frame));
    reasons.extend(sonars_words(&heard.sonars, "drawn where the laser says that the robot was"));
    reasons.extend(heard.refused.into_iter().map(|reason| ("refused", reason)));
    let further = lasers.further.iter().map(|(other, _)| other.topic);
    Plan {
        scans: topic.name.clone(),
        kind: topic.kind,
        further: further.map(|topic| FurtherLaser { topic: topic.name.clone(), kind: topic.kind }).collect(),
        sonars: heard.sonars,
        slice: choice.slice.filter(|_| topic.kind == TopicKind::Cloud),
        said_mount: *said_mount,
        robot_frame: place.robot_frame.clone(),
        sensor_frame: topic.frame().to_owned(),
        calibration: choice.odometry.filter(|_| found.source != OdometrySource::None),
        odometry: found.source,
        turning,
        transforms: transform_topics(survey),
        reasons,
        assumed: place.assumed.iter().cloned().chain(found.assumed).collect(),
        mounts,
        times: topic.sweeps.times(),
    }
}

/// Whether there are sonars and nothing else to map with, or sonars are asked for.
fn is_of_sonars(survey: &Survey, choice: &Choice) -> bool {
    let is_usable = |topic: &&TopicSurvey| topic.kind == TopicKind::Range && topic.usable() > 0;
    let mut sonars = survey.topics.iter().filter(is_usable).peekable();
    let scans = || survey.topics.iter().any(|topic| topic.kind.is_scans() || topic.kind.is_clouds());
    sonars.peek().is_some() && (!scans() || sonars.any(|topic| is_asked(topic, choice)))
}

/// A recording of sonars alone.
fn of_sonars(survey: &Survey, choice: &Choice) -> Result<Plan, String> {
    let sonars::Found { sonars, place, refused } = sonars::find(survey, choice, None);
    let (Some(place), Some(first)) = (place, sonars.first()) else {
        return Err(format!("expected sonars that can be mapped with, found none: {}", refused.join("; ")));
    };
    let found = odometry::find(survey, &place, choice);
    if found.source == OdometrySource::None {
        return Err(format!(
            "expected odometry beside sonars, for single cones say nothing of how the robot moves, found none: {}",
            found.reason
        ));
    }
    let mut reasons = sonars_words(&sonars, "mapped by walls that several of their cones agree on").collect::<Vec<_>>();
    reasons.push(("robot", format!("'{}', {}", place.robot_frame, place.reason)));
    reasons.push(("odometry", found.reason.clone()));
    reasons.extend(refused.into_iter().map(|reason| ("refused", reason)));
    Ok(Plan {
        scans: first.topic.clone(),
        kind: TopicKind::Range,
        further: Vec::new(),
        slice: None,
        robot_frame: place.robot_frame.clone(),
        sensor_frame: first.frame.clone(),
        odometry: found.source,
        turning: None,
        reasons,
        assumed: found.assumed.into_iter().collect(),
        said_mount: None,
        calibration: choice.odometry,
        transforms: transform_topics(survey),
        mounts: BTreeMap::new(),
        times: SweepTimes::Seconds,
        sonars,
    })
}

/// What sonars are used, and for what.
fn sonars_words(sonars: &[SonarSource], what_for: &str) -> impl Iterator<Item = (&'static str, String)> {
    let mut topics: Vec<&str> = sonars.iter().map(|sonar| sonar.topic.as_str()).collect();
    topics.dedup();
    let is_millimetres = sonars.iter().any(|sonar| sonar.unit_m != 1.0);
    let unit = if is_millimetres { "; ranges are millimetres, and used as such" } else { "" };
    let words = format!("{} of {}: {what_for}{unit}", sonars.len(), list(topics.into_iter()));
    (!sonars.is_empty()).then_some(("sonars", words)).into_iter()
}

/// Mountings by the frames of a laser's scans.
fn mounts_of(laser: &Candidate<'_>, survey: &Survey, choice: &Choice, mounts: &mut BTreeMap<String, Mount>) {
    let Candidate { topic, place, mount, .. } = laser;
    mounts.insert(topic.frame().to_owned(), *mount);
    for frame in topic.frames.keys().filter(|frame| *frame != topic.frame()) {
        let robot = Choice { frame: Some(place.robot_frame.clone()), ..choice.clone() };
        if let Some(by_hand) = by_hand(choice) {
            mounts.insert(frame.clone(), by_hand);
        } else if let Ok(other) = crate::frames::place(&survey.links, frame, &[], &robot)
            && let Ok(mount) = mount_of(topic.kind, &other)
        {
            mounts.insert(frame.clone(), mount);
        }
    }
}

fn transform_topics(survey: &Survey) -> Vec<String> {
    let topics = survey.topics.iter().filter(|topic| topic.kind == TopicKind::Transforms);
    topics.map(|topic| topic.name.clone()).collect()
}

/// The mounting that is asked for, if one is.
fn by_hand(choice: &Choice) -> Option<Mount> {
    let MountChoice { robot_from_laser, inverted } = choice.mount?;
    Some(Mount::Planar(Mounting { robot_from_laser, inverted, ..Mounting::IDENTITY }))
}

/// Links between a sensor and its robot that jitter, in words.
fn jitter_words(survey: &Survey, sensor: &str, robot_frame: &str) -> Option<String> {
    let above = survey.links.above(sensor);
    let way = above.iter().position(|link| link.parent == robot_frame).map_or(&above[..0], |at| &above[..=at]);
    let link = way.iter().find(|link| link.jitters())?;
    let (moved_m, turned_deg) = (link.moved_m, link.turned_rad.to_degrees());
    Some(format!(
        "; '{}' moves in '{}' by up to {moved_m:.3} m and {turned_deg:.2} deg: its median",
        link.child, link.parent
    ))
}

fn mounting_words(survey: &Survey, sensor: &str, place: &Place, mount: &Mount, is_asked: bool) -> String {
    let mut words = place_words(sensor, place, mount);
    if is_asked {
        words += ", as asked for";
    } else {
        words += &jitter_words(survey, sensor, &place.robot_frame).unwrap_or_default();
    }
    words
}

fn place_words(sensor: &str, place: &Place, mount: &Mount) -> String {
    if place.assumed.is_some() {
        return format!("'{sensor}' in the robot's origin, assumed");
    }
    match mount {
        Mount::Planar(mounting) => {
            let at = mounting.robot_from_laser;
            let way_up = if mounting.inverted { "upside down" } else { "upright" };
            format!(
                "'{sensor}' at x {:.3} m, y {:.3} m, yaw {:.1} deg, {way_up}, {:.3} m up, tilted by {:.1} deg",
                at.x,
                at.y,
                at.theta.to_degrees(),
                mounting.height_m,
                mounting.tilt_deg
            )
        }
        Mount::Space(pose) => {
            let at = pose.translation;
            format!("'{sensor}' at x {:.3} m, y {:.3} m, z {:.3} m", at.x, at.y, at.z)
        }
    }
}

fn mount_of(kind: TopicKind, place: &Place) -> Result<Mount, String> {
    if kind == TopicKind::Cloud {
        return Ok(Mount::Space(place.robot_from_sensor));
    }
    let mounting = Mounting::project(place.robot_from_sensor, TILT_MOST_DEG);
    mounting.map(Mount::Planar).map_err(|error| format!("{error}, seen from '{}'", place.robot_frame))
}

/// Topics of scans that can be used, and why others cannot.
fn candidates<'a>(survey: &'a Survey, choice: &Choice) -> Result<(Vec<Candidate<'a>>, Vec<String>), String> {
    let asked = |topic: &&TopicSurvey| is_asked(topic, choice);
    let mut all: Vec<_> = survey.topics.iter().filter(|topic| topic.kind.is_scans()).collect();
    if all.iter().any(asked) {
        all.retain(asked);
    }
    for name in &choice.topics {
        let mut named = survey.topics.iter().filter(|topic| same_name(&topic.name, name)).peekable();
        let first = named.peek().map_or("", |topic| topic.type_name.as_str());
        if !named.any(|topic| topic.kind.is_scans() || topic.kind.is_motion() || topic.kind == TopicKind::Range) {
            return Err(format!("{name} is {first}, expected scans or odometry"));
        }
    }
    if all.is_empty() {
        let expected = "laser scans, found no topic of LaserScan, MultiEchoLaserScan, PointCloud2 or Range";
        return Err(nothing_of(expected, survey));
    }
    let odometry = odometry::topics(survey, choice);
    let moved: Vec<_> =
        odometry.first().map(|topic| topic.child_frame()).into_iter().filter(|f| !f.is_empty()).collect();
    let (mut found, mut refused) = (Vec::new(), Vec::new());
    for topic in all {
        match candidate(survey, choice, topic, &moved) {
            Ok(candidate) => found.push(candidate),
            Err(reason) => refused.push(format!("{}: {reason}", topic.name)),
        }
    }
    Ok((found, refused))
}

fn candidate<'a>(
    survey: &Survey,
    choice: &Choice,
    topic: &'a TopicSurvey,
    moved: &[&str],
) -> Result<Candidate<'a>, String> {
    if topic.usable() == 0 {
        let why = topic.first_error.as_ref().map_or_else(|| "no messages".to_owned(), |e| format!("unreadable: {e}"));
        return Err(why);
    }
    if topic.kind == TopicKind::Cloud && choice.slice.is_none() {
        return Err(format!(
            "{} point clouds ({}); `--space` maps the clouds instead, or a slice of them can be mapped: mapwright map LOG \
             --topic {} --slice 0.1:1.0 -o OUT",
            grouped(topic.usable()),
            topic.shape,
            topic.name
        ));
    }
    if let Some(mount) = by_hand(choice) {
        if topic.kind == TopicKind::Cloud {
            return Err("a mounting is asked for, which is for planar lasers, found point clouds".to_owned());
        }
        let said = place(&survey.links, topic.frame(), moved, choice).ok().filter(|said| said.assumed.is_none());
        let said_mount = said.and_then(|said| match mount_of(topic.kind, &said) {
            Ok(Mount::Planar(mounting)) => Some(mounting.robot_from_laser),
            _ => None,
        });
        let place = placed_by_hand(&survey.links, topic.frame(), moved, choice);
        return Ok(Candidate { topic, place, mount, said_mount });
    }
    let place = place(&survey.links, topic.frame(), moved, choice)?;
    let mount = mount_of(topic.kind, &place)?;
    Ok(Candidate { topic, place, mount, said_mount: None })
}

/// There is nothing of what is expected: what is there instead.
pub(crate) fn nothing_of(expected: &str, survey: &Survey) -> String {
    let untyped = survey.topics.iter().filter(|topic| topic.messages > 0 && topic.type_name.is_empty());
    let untyped: Vec<_> = untyped.map(|topic| topic.name.as_str()).collect();
    if !untyped.is_empty() {
        return format!(
            "expected {expected}; the channels {} have no schema, so that the types of their messages are unknown: record or \
             convert them again with schemas",
            list(untyped.into_iter())
        );
    }
    format!("expected {expected}; there are {}{}; {}", contents(survey), images_words(survey), unread::words(survey))
}

/// Images of one number a pixel that are none of depth by their encoding, which may be all that keeps them from being mapped.
fn images_words(survey: &Survey) -> String {
    let may_be_depth = |topic: &TopicSurvey| topic.name.contains("depth") || topic.shape.contains("C1`");
    let is_image = |topic: &TopicSurvey| topic.kind == TopicKind::Image && topic.usable() > 0;
    let is_other = |topic: &&TopicSurvey| is_image(topic) && !topic.is_depth && may_be_depth(topic);
    let words = survey.topics.iter().filter(is_other).map(|topic| format!("{}: {}", topic.name, topic.shape));
    let words: Vec<_> = words.collect();
    if words.is_empty() {
        return String::new();
    }
    format!("; {}: images are mapped that have depth as {}", words.join(", "), Image::ENCODINGS_OF_DEPTH)
}

/// The topics with types and counts.
pub(crate) fn contents(survey: &Survey) -> String {
    let with_messages = survey.topics.iter().filter(|topic| topic.messages > 0);
    let words: Vec<_> = with_messages
        .map(|topic| format!("{} ({}, {})", topic.name, type_words(topic), grouped(topic.messages)))
        .collect();
    if words.is_empty() { "no messages".to_owned() } else { list(words.iter().map(String::as_str)) }
}

fn type_words(topic: &TopicSurvey) -> &str {
    if topic.type_name.is_empty() { "of no type" } else { &topic.type_name }
}
