//! How an inertial sensor sits on the robot, in what units it reads and with what sign: what matches say where they contradict what is told.
//!
//! Rotations that were read and rotations of matches are two sets of vectors; the rotation between them is Wahba's problem
//! ([`BestRotation`]), and their lengths tell radians from degrees. Where the robot has
//! turned about one axis alone, as one with wheels does, the mount is one of the 24 of a box on a box.

use mapwright_geom::{BestRotation, stored};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

/// Turns of matches that tell something, radians: more than noise makes up, less than half a turn.
const TELLING_RAD: [f64; 2] = [0.03, 1.5];
/// Before anything is said the robot has turned by so much in all, radians, in so many turns.
const TURNED_RAD: f64 = 1.0;
const TURNS: u32 = 8;
/// What is told holds while it leaves less than this share of the squared turns unexplained, as one that is off by six degrees does;
const HOLDS_SHARE: f64 = 0.01;
/// another mount is taken that leaves less than this, and less than this share of what it leaves.
const FITS_SHARE: f64 = 0.04;
const BETTER_SHARE: f64 = 0.25;
/// Axes about which the robot has turned less than this share of what it has about another say nothing.
const AXIS_SHARE: f64 = 0.02;

/// A robot whose z axis is within 45 degrees of up stands as its axes do.
pub(super) const UPRIGHT_COS: f64 = 0.7;

/// How an inertial sensor sits and reads, where that is not what was told.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ImuMount {
    /// It is turned about the robot's axes by this rotation vector, radians: from its axes as told to the robot's.
    pub robot_from_told_rad: [f64; 3],
    /// It gives turn rates in degrees a second.
    pub in_degrees: bool,
    /// It gives the force of gravity, which points down, where the force that holds it up is meant.
    pub forces_down: bool,
}

/// How it sits and reads.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Mount {
    /// From its axes as told to the robot's.
    pub(super) robot_from_told: UnitQuaternion<f64>,
    /// Turn rates are in degrees.
    pub(super) in_degrees: bool,
    /// Forces are those of gravity, not those that hold the robot up.
    pub(super) forces_down: bool,
}
stored!(Mount { robot_from_told, in_degrees, forces_down });

impl Default for Mount {
    fn default() -> Self {
        Self { robot_from_told: UnitQuaternion::identity(), in_degrees: false, forces_down: false }
    }
}

impl Mount {
    /// A turn rate as it is.
    pub(super) fn rate(&self, told: Vector3<f64>) -> Vector3<f64> {
        self.robot_from_told * told * self.unit()
    }

    /// A force as it is.
    pub(super) fn force(&self, told: Vector3<f64>) -> Vector3<f64> {
        self.robot_from_told * told * if self.forces_down { -1.0 } else { 1.0 }
    }

    /// As others are told of it.
    pub(super) fn told(&self) -> ImuMount {
        let Self { robot_from_told, in_degrees, forces_down } = *self;
        ImuMount { robot_from_told_rad: robot_from_told.scaled_axis().into(), in_degrees, forces_down }
    }

    fn unit(&self) -> f64 {
        if self.in_degrees { 1f64.to_radians() } else { 1.0 }
    }
}

/// Turns as read by a sensor that sits and reads as told, and as matches say that they were.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Turns {
    /// Sum of matched times read, transposed; of the squares of both.
    across: Matrix3<f64>,
    read2: f64,
    matched2: f64,
    turned_rad: f64,
    count: u32,
    /// Forces that hold the robot up, added up as told.
    held: Vector3<f64>,
}
stored!(Turns { across, read2, matched2, turned_rad, count, held });

impl Turns {
    /// A force as told.
    pub(super) fn hold(&mut self, told: Vector3<f64>) {
        self.held += if told.norm().is_finite() { told } else { Vector3::zeros() };
    }

    /// A turn as it was read with a mount, and as a match says, both as rotation vectors, radians.
    pub(super) fn add(&mut self, mount: &Mount, read: Vector3<f64>, matched: Vector3<f64>) {
        let turned_rad = matched.norm();
        if !(TELLING_RAD[0]..TELLING_RAD[1]).contains(&turned_rad) {
            return;
        }
        let told = mount.robot_from_told.inverse() * read / mount.unit();
        self.across += matched * told.transpose();
        self.read2 += told.norm_squared();
        self.matched2 += matched.norm_squared();
        self.turned_rad += turned_rad;
        self.count += 1;
    }

    /// Another mount, where that which is taken does not hold and one does.
    pub(super) fn other(&self, mount: &Mount) -> Option<Mount> {
        let left = self.left(mount);
        if self.count < TURNS || self.turned_rad < TURNED_RAD || left < HOLDS_SHARE {
            return None;
        }
        let turned = self.rotations().into_iter().map(|robot_from_told| Mount { robot_from_told, ..*mount });
        let tried = turned.flat_map(|mount| [false, true].map(|in_degrees| Mount { in_degrees, ..mount }));
        // of equals the first
        let best = tried.map(|mount| (self.left(&mount), mount)).reduce(|a, b| if b.0 + 1e-6 < a.0 { b } else { a })?;
        (best.0 < FITS_SHARE.min(BETTER_SHARE * left)).then_some(best.1)
    }

    /// What share of the squared turns a mount leaves unexplained.
    fn left(&self, mount: &Mount) -> f64 {
        let explained = 2.0
            * mount.unit()
            * (mount.robot_from_told.to_rotation_matrix().matrix().transpose() * self.across).trace();
        (self.matched2 - explained + mount.unit().powi(2) * self.read2) / self.matched2.max(f64::MIN_POSITIVE)
    }

    /// Rotations to try: the likeliest, where turns tell it, and as told. Where they do not, those of a box on a box by which forces hold the
    /// robot up, first that about x by half, as of axes that look forward, right and down.
    fn rotations(&self) -> Vec<UnitQuaternion<f64>> {
        if let Some(likeliest) = self.likeliest() {
            return vec![UnitQuaternion::identity(), likeliest];
        }
        let half_about_x = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        let holds = |rotation: &UnitQuaternion<f64>| (rotation * self.held).z >= UPRIGHT_COS * self.held.norm();
        let others = [UnitQuaternion::identity(), half_about_x].into_iter().chain(boxes());
        others.filter(holds).collect()
    }

    /// The rotation that fits best; none where turns about one axis do not tell it.
    fn likeliest(&self) -> Option<UnitQuaternion<f64>> {
        let best = BestRotation::of(&self.across)?;
        (best.common[1] >= AXIS_SHARE * best.common[0]).then_some(best.rotation)
    }
}

/// The 24 rotations that lay axes on axes.
fn boxes() -> impl Iterator<Item = UnitQuaternion<f64>> {
    let signed = |k: usize| if k.is_multiple_of(2) { Vector3::ith(k / 2, 1.0) } else { Vector3::ith(k / 2, -1.0) };
    let pairs = (0..6).flat_map(move |a| (0..6).filter(move |b| a / 2 != b / 2).map(move |b| (signed(a), signed(b))));
    pairs.map(|(x, y): (Vector3<f64>, Vector3<f64>)| {
        let rotation = nalgebra::Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, y, x.cross(&y)]));
        UnitQuaternion::from_rotation_matrix(&rotation)
    })
}

/// What accelerations by matches say of the forces' sign, in logarithms of odds.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Pushes {
    last: Option<(Vector3<f64>, Vector3<f64>)>,
    nats: f64,
}
stored!(Pushes { last, nats });

/// Variance of a difference of two accelerations by matches in a row, each of which shares a velocity with the next, m^2/s^4.
const DIFFERENCE_M2_PER_S4: f64 = 0.14;
/// One pair says so much at most, nats.
const PAIR_NATS: f64 = 3.0;
/// What is believed at 10 to 1, and a sign that is put right at 1000 to 1, of one in a hundred sensors.
const BELIEVED_NATS: f64 = 2.3;
const PUT_RIGHT_NATS: f64 = -11.5;

impl Pushes {
    /// The mean force of a time, and the acceleration by matches, both in one frame that does not turn: gravity and what is even fall out
    /// of differences.
    pub(super) fn add(&mut self, force: Vector3<f64>, push: Vector3<f64>) {
        if let Some((force_before, push_before)) = self.last.replace((force, push)) {
            let nats = 2.0 * (force - force_before).dot(&(push - push_before)) / DIFFERENCE_M2_PER_S4;
            self.nats += nats.clamp(-PAIR_NATS, PAIR_NATS);
        }
    }

    /// The next has nothing before it.
    pub(super) fn break_off(&mut self) {
        self.last = None;
    }

    /// Whether forces that say that the robot stands as its axes do, or otherwise, are borne out.
    pub(super) fn is_borne_out(&self, is_upright: bool) -> bool {
        self.nats >= if is_upright { -BELIEVED_NATS } else { BELIEVED_NATS }
    }

    /// Whether they have the other sign; asked once.
    pub(super) fn take_reversed(&mut self) -> bool {
        let is_reversed = self.nats <= PUT_RIGHT_NATS;
        if is_reversed {
            *self = Self { last: None, nats: -self.nats };
        }
        is_reversed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn turns(mount: &Mount, axes: &[[f64; 3]]) -> Turns {
        let mut turns = Turns::default();
        for k in 0..40 {
            let matched = Vector3::from(axes[k % axes.len()]) * if k % 3 == 0 { -0.2 } else { 0.1 };
            let told = mount.robot_from_told.inverse() * matched / mount.unit();
            turns.add(&Mount::default(), told + Vector3::repeat(1e-3), matched);
        }
        turns
    }

    #[test]
    fn a_mount_is_found_by_turns_about_two_axes_and_units_by_their_length() {
        let robot_from_told = UnitQuaternion::from_euler_angles(0.4, -1.1, 2.0);
        for in_degrees in [false, true] {
            let mount = Mount { robot_from_told, in_degrees, forces_down: false };
            let found = turns(&mount, &[[1.0, 0.0, 0.2], [0.0, 1.0, 0.0]]).other(&Mount::default()).unwrap();
            assert!(found.robot_from_told.angle_to(&robot_from_told) < 0.02 && found.in_degrees == in_degrees);
        }
    }

    #[test]
    fn turns_about_one_axis_tell_which_side_is_up_and_nothing_is_found_that_does_not_fit() {
        let about_z = [[0.0, 0.0, 1.0]];
        let down = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        let found =
            turns(&Mount { robot_from_told: down, ..Mount::default() }, &about_z).other(&Mount::default()).unwrap();
        assert!(found.robot_from_told.angle_to(&down) < 1e-9, "{found:?}");
        assert!(turns(&Mount::default(), &about_z).other(&Mount::default()).is_none(), "it sits as told");
        let leaning = Mount { robot_from_told: UnitQuaternion::from_euler_angles(0.7, 0.0, 0.0), ..Mount::default() };
        assert!(turns(&leaning, &about_z).other(&Mount::default()).is_none(), "one axis does not tell how");
        let mut mirrored = Turns::default();
        for k in 0..60 {
            let matched = Vector3::ith(k % 3, 0.2);
            mirrored.add(&Mount::default(), -matched, matched);
        }
        assert!(mirrored.other(&Mount::default()).is_none(), "no rotation mirrors");
    }

    #[test]
    fn the_sign_of_forces_shows_where_the_robot_is_pushed() {
        for sign in [1.0, -1.0] {
            let mut pushes = Pushes::default();
            assert!(pushes.is_borne_out(true) && !pushes.is_borne_out(false));
            for k in 0..30 {
                let push = Vector3::new(f64::from(k % 3) * 0.5, 0.0, 0.0);
                pushes.add((push + Vector3::new(0.1, 0.0, 9.8)) * sign, push);
            }
            assert_eq!(pushes.is_borne_out(false), sign > 0.0);
            assert_eq!(pushes.take_reversed(), sign < 0.0);
            assert!(pushes.is_borne_out(false));
        }
    }
}
