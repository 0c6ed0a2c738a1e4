//! Requests to an RPLIDAR, and what its answers say ("SLAMTEC RPLIDAR interface protocol", LR001, 2.2 to 2.8).

/// Begins a request.
const SYNC: u8 = 0xA5;
/// Revolutions a minute of lidars whose motor is told them: 10 Hz.
const RPM: u16 = 600;
/// Share of 1,023 by which the motor of an A2 or A3 is driven.
const PWM: u16 = 660;
/// From this family on (S1) a motor is told its revolutions a minute.
const FAMILY_OF_RPM: u8 = 6;

/// What is to be done to the serial line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Request {
    /// Bytes to send.
    Bytes(Vec<u8>),
    /// The line DTR is to be set so. The motor of an RPLIDAR A1 turns while it is off; other lines (a pseudo-terminal) have no DTR, and nothing is lost.
    Dtr(bool),
}

/// What an RPLIDAR says of itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RplidarInfo {
    /// Its model, such as 0x18 for an A1M8.
    pub model: u8,
    /// Its firmware, major and minor.
    pub firmware: [u8; 2],
    /// Its hardware.
    pub hardware: u8,
    /// Its number.
    pub serial: [u8; 16],
}

impl RplidarInfo {
    pub(super) fn parse(bytes: &[u8]) -> Option<Self> {
        let (head, serial) = bytes.split_at_checked(4)?;
        Some(Self { model: head[0], firmware: [head[2], head[1]], hardware: head[3], serial: serial.try_into().ok()? })
    }

    /// The name of its family, such as `RPLIDAR A1`.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self.model >> 4 {
            1 => "RPLIDAR A1",
            2 => "RPLIDAR A2",
            3 => "RPLIDAR A3",
            4 => "RPLIDAR C1",
            6 => "RPLIDAR S1",
            7 => "RPLIDAR S2",
            8 => "RPLIDAR S3",
            _ => "RPLIDAR",
        }
    }

    /// Farthest that its family sees, metres, by the data sheets.
    #[must_use]
    pub fn range_max_m(&self) -> f64 {
        match self.model >> 4 {
            1 => 12.0,
            2 => 18.0,
            3 => 25.0,
            4 => 16.0,
            7 => 30.0,
            _ => 40.0,
        }
    }
}

/// What an RPLIDAR is asked before it scans.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Question {
    Info,
    Health,
    /// From reading to reading, microseconds, of standard and express scans.
    SampleTimes,
    TypicalMode,
    ModeAnswer(u16),
    ModeSampleTime(u16),
}

const CONF_SAMPLE_TIME: u32 = 0x71;
const CONF_ANSWER: u32 = 0x75;
const CONF_TYPICAL: u32 = 0x7C;

impl Question {
    pub(super) fn bytes(self) -> Vec<u8> {
        match self {
            Self::Info => vec![SYNC, 0x50],
            Self::Health => vec![SYNC, 0x52],
            Self::SampleTimes => vec![SYNC, 0x59],
            Self::TypicalMode => conf(CONF_TYPICAL, None),
            Self::ModeAnswer(mode) => conf(CONF_ANSWER, Some(mode)),
            Self::ModeSampleTime(mode) => conf(CONF_SAMPLE_TIME, Some(mode)),
        }
    }

    /// Type of the answer, and whether it may have so many bytes.
    pub(super) fn is_answer(self, kind: u8, length: usize) -> bool {
        match self {
            Self::Info => (kind, length) == (0x04, 20),
            Self::Health => (kind, length) == (0x06, 3),
            Self::SampleTimes => (kind, length) == (0x15, 4),
            Self::TypicalMode | Self::ModeAnswer(_) | Self::ModeSampleTime(_) => {
                kind == 0x20 && (5..=64).contains(&length)
            }
        }
    }

    /// Which configuration it asks for, as its answer repeats.
    fn conf(self) -> u32 {
        match self {
            Self::TypicalMode => CONF_TYPICAL,
            Self::ModeAnswer(_) => CONF_ANSWER,
            _ => CONF_SAMPLE_TIME,
        }
    }

    /// The number in an answer of a configuration.
    pub(super) fn number(self, answer: &[u8]) -> Option<u32> {
        let (said, value) = answer.split_first_chunk::<4>()?;
        let is_it = u32::from_le_bytes(*said) == self.conf();
        let mut number = [0; 4];
        let count = value.len().min(4);
        number[..count].copy_from_slice(&value[..count]);
        is_it.then_some(u32::from_le_bytes(number))
    }
}

pub(super) const STOP: [u8; 2] = [SYNC, 0x25];
pub(super) const RESET: [u8; 2] = [SYNC, 0x40];
pub(super) const SCAN: [u8; 2] = [SYNC, 0x20];

/// An express scan of a mode; 0 is the one that all firmwares know.
pub(super) fn express(mode: u8) -> Vec<u8> {
    with_payload(0x82, &[mode, 0, 0, 0, 0])
}

/// Starts the motor of a model.
pub(super) fn start_motor(model: u8) -> Vec<u8> {
    if model >> 4 >= FAMILY_OF_RPM {
        with_payload(0xA8, &RPM.to_le_bytes())
    } else {
        with_payload(0xF0, &PWM.to_le_bytes())
    }
}

pub(super) fn stop_motor(model: u8) -> Vec<u8> {
    with_payload(if model >> 4 >= FAMILY_OF_RPM { 0xA8 } else { 0xF0 }, &[0, 0])
}

fn conf(kind: u32, mode: Option<u16>) -> Vec<u8> {
    let mut payload = kind.to_le_bytes().to_vec();
    payload.extend(mode.into_iter().flat_map(u16::to_le_bytes));
    with_payload(0x84, &payload)
}

fn with_payload(command: u8, payload: &[u8]) -> Vec<u8> {
    let mut bytes = vec![SYNC, command, payload.len() as u8];
    bytes.extend_from_slice(payload);
    bytes.push(bytes.iter().fold(0, |sum, byte| sum ^ byte));
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_are_those_of_the_protocol() {
        assert_eq!(express(0), [0xA5, 0x82, 0x05, 0, 0, 0, 0, 0, 0x22]);
        assert_eq!(start_motor(0x18), [0xA5, 0xF0, 0x02, 0x94, 0x02, 0xC1]);
        assert_eq!(Question::TypicalMode.bytes(), [0xA5, 0x84, 0x04, 0x7C, 0, 0, 0, 0x59]);
        assert_eq!(Question::ModeAnswer(2).number(&[0x75, 0, 0, 0, 0x84]), Some(0x84));
        assert_eq!(Question::ModeAnswer(2).number(&[0x71, 0, 0, 0, 0x84]), None);
    }
}
