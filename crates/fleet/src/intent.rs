//! Where a robot is and where it goes: what it says with each beat, and nobody keeps.

use crate::bytes::Cursor;
use mapwright::{KeyframeId, Pose2};

/// Bytes that a beat may carry beside what the protocol needs.
pub(crate) const NOTE_AT_MOST: usize = 64;

/// Where a robot is and where it goes, beside one of its own keyframes: so others find it in their map, whatever frame that has.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Intent {
    /// A keyframe of the robot, as recent as others may know.
    pub keyframe: KeyframeId,
    /// Where it is, in the frame of that keyframe.
    pub keyframe_from_robot: Pose2,
    /// Where it goes, in the frame of that keyframe, metres; none where it has nothing to do.
    pub keyframe_from_goal_m: Option<[f64; 2]>,
    /// Radius of the circle that it needs, metres.
    pub radius_m: f64,
    /// How fast it drives, m/s.
    pub speed_m_per_s: f64,
    /// How far its sensor sees, metres.
    pub reach_m: f64,
}

impl Intent {
    /// As bytes; numbers in single precision.
    pub(crate) fn encode(&self) -> Vec<u8> {
        let mut out = Vec::with_capacity(NOTE_AT_MOST);
        out.extend_from_slice(&self.keyframe.session.to_le_bytes());
        out.extend_from_slice(&self.keyframe.seq.to_le_bytes());
        let Pose2 { x, y, theta } = self.keyframe_from_robot;
        let numbers = [x, y, theta, self.radius_m, self.speed_m_per_s, self.reach_m];
        let goal = self.keyframe_from_goal_m.into_iter().flatten();
        numbers.into_iter().chain(goal).for_each(|number| out.extend_from_slice(&(number as f32).to_le_bytes()));
        out
    }

    /// Of the robot that says it; none where it is none.
    pub(crate) fn decode(bytes: &[u8], robot: u128) -> Option<Self> {
        let mut from = Cursor(bytes);
        let keyframe = KeyframeId { robot, session: from.u32()?, seq: from.u32()? };
        let mut number = || {
            let number = f64::from(f32::from_le_bytes(from.array()?));
            number.is_finite().then_some(number)
        };
        let keyframe_from_robot = Pose2 { x: number()?, y: number()?, theta: number()? };
        let [radius_m, speed_m_per_s, reach_m] = [number()?, number()?, number()?];
        ([radius_m, speed_m_per_s, reach_m].iter().all(|&number| number >= 0.0)).then_some(())?;
        let goal = number().zip(number());
        let length = if goal.is_some() { 40 } else { 32 };
        (bytes.len() == length).then_some(())?;
        let keyframe_from_goal_m = goal.map(|(x, y)| [x, y]);
        Some(Self { keyframe, keyframe_from_robot, keyframe_from_goal_m, radius_m, speed_m_per_s, reach_m })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_intent_is_what_was_said_and_nothing_else_is_one() {
        let keyframe = KeyframeId { robot: 7, session: 1, seq: 300 };
        for keyframe_from_goal_m in [None, Some([4.5, -2.25])] {
            let intent = Intent {
                keyframe,
                keyframe_from_robot: Pose2 { x: 0.5, y: -0.25, theta: 1.5 },
                keyframe_from_goal_m,
                radius_m: 0.25,
                speed_m_per_s: 0.5,
                reach_m: 12.0,
            };
            let bytes = intent.encode();
            assert!(bytes.len() <= NOTE_AT_MOST);
            assert_eq!(Intent::decode(&bytes, 7), Some(intent));
            for cut in 0..bytes.len() {
                // Without its goal it is an intent, too.
                assert!(Intent::decode(&bytes[..cut], 7).is_none_or(|_| cut == 32), "{cut}");
            }
            let mut wrong = bytes.clone();
            wrong[8..12].copy_from_slice(&f32::NAN.to_le_bytes());
            assert_eq!(Intent::decode(&wrong, 7), None);
            let mut wrong = bytes;
            wrong[20..24].copy_from_slice(&(-1.0_f32).to_le_bytes());
            assert_eq!(Intent::decode(&wrong, 7), None);
        }
        assert_eq!(Intent::decode(&[0; 65], 7), None);
    }
}
