//! What a run says of inertial readings.

use super::source::Read;
use crate::terminal::{count, grouped};
use mapwright::{ImuMount, ImuReport, SpaceMapper};
use nalgebra::Vector3;
use serde_json::{Value, json};

/// The readings of a run.
#[derive(Debug, Clone)]
pub(super) struct Felt {
    topic: String,
    report: ImuReport,
}

impl Felt {
    /// None where the recording has no inertial sensor.
    pub(super) fn of(read: &Read, mapper: &SpaceMapper) -> Option<Self> {
        Some(Self { topic: read.imu.clone()?, report: mapper.imu_report() })
    }

    pub(super) fn to_json(&self) -> Value {
        let ImuReport {
            readings,
            unsound,
            too_fast,
            late,
            set_back,
            pushed,
            predicted,
            unread,
            contradicted,
            gravity,
            mount,
            bias_rad_per_s,
            bias_sigma_rad_per_s,
        } = self.report;
        json!({
            "topic": self.topic,
            "readings": readings,
            "unsound": unsound,
            "beyond_100_rad_per_s_as_told": too_fast,
            "late": late,
            "clock_set_back": set_back,
            "far_from_gravity": pushed,
            "clouds_predicted": predicted,
            "clouds_without": unread,
            "clouds_that_contradict": contradicted,
            "gravity_edges": gravity,
            "turned_beside_what_is_told_rad": mount.robot_from_told_rad,
            "in_degrees": mount.in_degrees,
            "forces_reversed": mount.forces_down,
            "gyroscope_bias_rad_per_s": bias_rad_per_s,
            "gyroscope_bias_sigma_rad_per_s": bias_sigma_rad_per_s,
        })
    }

    pub(super) fn to_words(&self) -> String {
        let report = &self.report;
        let [x, y, z] = report.bias_rad_per_s.map(|bias| format!("{:.4}", bias + 0.0));
        format!(
            "imu      {}: {}, {} turned by it, {} of gravity; bias {x} {y} {z} rad/s (+- {:.4})\n",
            self.topic,
            count(report.readings, "reading"),
            count(report.predicted, "cloud"),
            count(report.gravity, "edge"),
            report.bias_sigma_rad_per_s
        )
    }

    /// What was lost, in words.
    pub(super) fn loss(&self) -> Option<String> {
        let ImuReport { unsound, too_fast, mount, .. } = self.report;
        // Where matches say that they are in degrees, readings that seemed too fast were sound.
        let unsound = unsound + if mount.in_degrees { 0 } else { too_fast };
        (unsound > 0).then(|| {
            format!("inertial readings that are not finite, or beyond 100 rad/s or 50 g: {}", grouped(unsound))
        })
    }

    /// What is odd, in words.
    pub(super) fn odd(&self) -> Vec<String> {
        let ImuReport { late, set_back, unread, contradicted, .. } = self.report;
        let odd = [
            (late, "inertial readings later than the cloud that they tell of, not used"),
            (set_back, "inertial readings more than a second older than the one before"),
            (unread, "clouds without enough inertial readings since the one before"),
            (contradicted, "clouds whose match contradicts the inertial readings"),
        ];
        let odd = odd.into_iter().filter(|(count, _)| *count > 0);
        let odd = odd.map(|(count, what)| format!("{what}: {}", grouped(count)));
        odd.chain(self.report.mount.put_right()).collect()
    }
}

/// What was put right.
trait PutRight {
    fn put_right(&self) -> Vec<String>;
}

impl PutRight for ImuMount {
    fn put_right(&self) -> Vec<String> {
        let [x, y, z] = self.robot_from_told_rad.map(f64::to_degrees);
        let turned_deg = Vector3::new(x, y, z).norm();
        let turned = format!(
            "the inertial sensor is turned by {turned_deg:.0} deg beside what is told, about the axis {:.2} {:.2} {:.2} of the robot: taken as \
             matches say",
            x / turned_deg,
            y / turned_deg,
            z / turned_deg
        );
        let said = [
            (turned_deg > 0.0, turned.as_str()),
            (self.in_degrees, "turn rates of the inertial sensor are in degrees a second, as matches say: taken so"),
            (self.forces_down, "forces of the inertial sensor are negated, as matches say: taken so"),
        ];
        said.into_iter().filter(|(is_so, _)| *is_so).map(|(_, words)| words.to_owned()).collect()
    }
}
