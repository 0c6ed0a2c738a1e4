//! Nodes and capsules of an RPLIDAR's scans.
//!
//! Angles of a capsule's readings lie evenly between its start and the next capsule's; those of express scans are corrected by an angle of each
//! reading, in eighths of a degree without a sign, as the maker's own driver reads it (the manual speaks of a sign).

/// 64ths of a degree in a turn.
const TURN_Q6: i32 = 360 * 64;

/// A kind of scan, by the type of its answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scan {
    /// Nodes of five bytes, 0x81.
    Standard,
    /// Capsules of 84 bytes with 32 readings, 0x82.
    Express,
    /// Capsules of 132 bytes with 96 readings, 0x84.
    Ultra,
    /// Capsules of 84 bytes with 40 readings, 0x85.
    Dense,
}

impl Scan {
    pub(super) fn of(kind: u8) -> Option<Self> {
        match kind {
            0x81 => Some(Self::Standard),
            0x82 => Some(Self::Express),
            0x84 => Some(Self::Ultra),
            0x85 => Some(Self::Dense),
            _ => None,
        }
    }

    /// Bytes of a node or capsule.
    pub(super) fn bytes(self) -> usize {
        match self {
            Self::Standard => 5,
            Self::Express | Self::Dense => 84,
            Self::Ultra => 132,
        }
    }

    /// Readings of a node or capsule.
    pub(super) fn readings(self) -> usize {
        match self {
            Self::Standard => 1,
            Self::Express => 32,
            Self::Ultra => 96,
            Self::Dense => 40,
        }
    }
}

/// A reading of a node.
pub(super) struct Node {
    pub(super) clockwise_deg: f64,
    pub(super) range_m: f32,
    pub(super) quality: u8,
}

impl Node {
    /// A node of five bytes, where its check bits allow it.
    pub(super) fn parse(bytes: &[u8]) -> Option<Self> {
        let [flags, angle_low, angle_high, low, high] = *bytes.first_chunk::<5>()?;
        let is_new = flags & 1;
        let angle_q6 = i32::from(angle_low >> 1) | i32::from(angle_high) << 7;
        let is_one = is_new != flags >> 1 & 1 && angle_low & 1 == 1 && angle_q6 < TURN_Q6;
        is_one.then(|| Self {
            clockwise_deg: f64::from(angle_q6) / 64.0,
            range_m: quarters(i32::from(u16::from_le_bytes([low, high]))),
            quality: flags >> 2,
        })
    }
}

/// A capsule with a good checksum.
#[derive(Debug, Clone)]
pub(super) struct Capsule {
    scan: Scan,
    bytes: Vec<u8>,
}

impl Capsule {
    /// Whether a capsule may begin with these bytes.
    pub(super) fn may_begin(bytes: &[u8]) -> bool {
        bytes.first().is_none_or(|first| first >> 4 == 0xA) && bytes.get(1).is_none_or(|second| second >> 4 == 0x5)
    }

    /// A capsule of that many bytes, where its checksum is right.
    pub(super) fn parse(scan: Scan, bytes: &[u8]) -> Option<Self> {
        let said = bytes.first()? & 0xF | bytes.get(1)? << 4;
        let sum = bytes.get(2..)?.iter().fold(0, |sum, byte| sum ^ byte);
        (Self::may_begin(bytes) && said == sum && bytes.len() == scan.bytes())
            .then(|| Self { scan, bytes: bytes.to_vec() })
    }

    fn word(&self, at: usize) -> u16 {
        u16::from_le_bytes([self.bytes[at], self.bytes[at + 1]])
    }

    /// Where its first reading looks, 64ths of a degree clockwise; beyond a turn from a lidar that is none.
    pub(super) fn start_q6(&self) -> i32 {
        i32::from(self.word(2) & 0x7FFF)
    }

    pub(super) fn is_plausible(&self) -> bool {
        self.start_q6() < TURN_Q6
    }

    /// The first capsule since the lidar began to scan: nothing came before it.
    pub(super) fn is_first(&self) -> bool {
        self.word(2) & 0x8000 != 0
    }

    /// How far the lidar turned from this capsule to another, 64ths of a degree below a turn.
    pub(super) fn turn_to_q6(&self, next: &Self) -> i32 {
        (next.start_q6() - self.start_q6()).rem_euclid(TURN_Q6)
    }

    /// Its readings, of which the next capsule says where they end: degrees clockwise from 0 to below 360, and metres.
    pub(super) fn readings(&self, next: &Self) -> Vec<(f64, f32)> {
        let count = self.scan.readings();
        let step = f64::from(self.turn_to_q6(next)) / (64 * count) as f64;
        let start_deg = f64::from(self.start_q6()) / 64.0;
        let at = |place: usize, back_deg: f64, range_q2: i32| {
            let deg = (start_deg + step * place as f64 - back_deg).rem_euclid(360.0);
            (if deg < 360.0 { deg } else { 0.0 }, quarters(range_q2))
        };
        match self.scan {
            Scan::Standard => Vec::new(),
            Scan::Express => (0..count)
                .map(|place| {
                    let (range_mm, back_q3) = self.express(place);
                    at(place, f64::from(back_q3) / 8.0, range_mm << 2)
                })
                .collect(),
            Scan::Dense => (0..count).map(|place| at(place, 0.0, i32::from(self.word(4 + 2 * place)) << 2)).collect(),
            Scan::Ultra => (0..count / 3)
                .flat_map(|cabin| {
                    let ranges_q2 = self.ultra(cabin, next);
                    (0..3).map(move |one| (3 * cabin + one, ranges_q2[one]))
                })
                .map(|(place, range_q2)| at(place, ultra_back_deg(range_q2), range_q2))
                .collect(),
        }
    }

    /// Cabins of five bytes with two readings: twice 14 bits of millimetres over the upper two bits of an angle, then the angles' lower four.
    fn express(&self, place: usize) -> (i32, u8) {
        let (cabin, second) = (4 + 5 * (place / 2), place % 2);
        let word = self.word(cabin + 2 * second);
        let low = if second == 0 { self.bytes[cabin + 4] & 0xF } else { self.bytes[cabin + 4] >> 4 };
        (i32::from(word >> 2), (word & 3) as u8 * 16 + low)
    }

    fn ultra_word(&self, cabin: usize) -> u32 {
        u32::from(self.word(4 + 4 * cabin)) | u32::from(self.word(6 + 4 * cabin)) << 16
    }

    /// Cabins of three readings: one in 12 bits of a scale that grows, and two relative to it and to that of the next cabin, in 10 bits each.
    fn ultra(&self, cabin: usize, next: &Self) -> [i32; 3] {
        let cabins = self.scan.readings() / 3;
        let word = self.ultra_word(cabin);
        let following = if cabin + 1 < cabins { self.ultra_word(cabin + 1) } else { next.ultra_word(0) };
        let (major, major_scale) = grown(word & 0xFFF);
        let (major_next, scale_next) = grown(following & 0xFFF);
        let (base, scale) = if major == 0 && major_next != 0 { (major_next, scale_next) } else { (major, major_scale) };
        let relative = |bits: i32, base: i32, scale: u32| match bits {
            -512 | 511 => 0,
            bits => ((bits << scale) + base).max(0) << 2,
        };
        let (first, second) = ((word << 10) as i32 >> 22, word as i32 >> 22);
        [major << 2, relative(first, base, scale), relative(second, major_next, scale_next)]
    }
}

/// Metres of quarters of a millimetre.
fn quarters(range_q2: i32) -> f32 {
    range_q2 as f32 / 4000.0
}

/// Millimetres of the scale that grows, and by how many bits it has.
fn grown(scaled: u32) -> (i32, u32) {
    let steps = [(3328, 14, 4), (1792, 12, 3), (1280, 11, 2), (512, 9, 1)];
    let step = steps.into_iter().find(|&(from, _, _)| scaled >= from);
    step.map_or((scaled as i32, 0), |(from, bit, scale)| ((1_i32 << bit) + ((scaled - from) << scale) as i32, scale))
}

/// By how much less a reading of an ultra capsule lies clockwise: the laser sits beside the lens. In whole numbers, as the maker computes it.
fn ultra_back_deg(range_q2: i32) -> f64 {
    const RAD_Q16: f64 = 65_536.0 / 180.0 * std::f64::consts::PI;
    let back_q16 = if range_q2 >= 200 {
        let near = 98_361 / range_q2;
        (8.0 * RAD_Q16) as i32 - (near << 6) - near * near * near / 98_304
    } else {
        (7.5 * RAD_Q16) as i32
    };
    f64::from((f64::from(back_q16) * 180.0 / std::f64::consts::PI) as i32) / 65_536.0
}
