//! A simulated RPLIDAR: what it answers, and nodes and capsules of a room as it would send them.
#![allow(dead_code)] // each test uses what it needs

use mapwright_geom::Stamp;
use mapwright_lidars::{Request, Revolution, Rplidar};

/// 64ths of a degree in a turn.
pub(crate) const TURN_Q6: u32 = 360 * 64;

/// What it is like.
pub(crate) struct Device {
    pub(crate) model: u8,
    /// What it says of its health, one after the other; the last one stays.
    pub(crate) health: Vec<u8>,
    /// Typical mode, the type of its answer, and 256ths of a microsecond from reading to reading, where it knows configurations.
    pub(crate) typical: Option<(u16, u8, u32)>,
    pub(crate) knows_sample_times: bool,
    pub(crate) knows_express: bool,
    /// Type of the answer that its stream is of.
    pub(crate) kind: u8,
    pub(crate) is_scanning: bool,
    /// Commands that it has heard.
    pub(crate) heard: Vec<u8>,
}

impl Device {
    pub(crate) fn of(kind: u8) -> Self {
        Self {
            model: 0x18,
            health: vec![0],
            typical: None,
            knows_sample_times: true,
            knows_express: true,
            kind,
            is_scanning: false,
            heard: Vec::new(),
        }
    }

    /// Its answer to a request.
    pub(crate) fn answer(&mut self, request: &[u8]) -> Vec<u8> {
        assert_eq!(request[0], 0xA5, "a request begins with its sync byte");
        let payload = request.get(3..request.len().saturating_sub(1)).unwrap_or(&[]);
        if request.len() > 2 {
            assert_eq!(request.iter().fold(0, |sum, byte| sum ^ byte), 0, "the checksum of {request:02x?}");
        }
        self.heard.push(request[1]);
        match request[1] {
            0x25 | 0x40 => self.is_scanning = false,
            0x50 => {
                let number: Vec<u8> = (1..=16).collect();
                return [&[0xA5, 0x5A, 20, 0, 0, 0, 4, self.model, 29, 1, 7][..], &number].concat();
            }
            0x52 => {
                let health = if self.health.len() > 1 { self.health.remove(0) } else { self.health[0] };
                return vec![0xA5, 0x5A, 3, 0, 0, 0, 6, health, 0x01, 0x80];
            }
            0x59 if self.knows_sample_times => {
                let [standard, express] = [500_u16, 250].map(u16::to_le_bytes);
                return [&[0xA5, 0x5A, 4, 0, 0, 0, 0x15][..], &standard, &express].concat();
            }
            0x84 => return self.configuration(payload),
            0x20 => return self.scan(0x81),
            0x82 if self.knows_express => return self.scan(if payload[0] == 0 { 0x82 } else { self.kind }),
            _ => {}
        }
        Vec::new()
    }

    fn configuration(&self, payload: &[u8]) -> Vec<u8> {
        let Some((mode, kind, sample)) = self.typical else { return Vec::new() };
        let value = match payload[0] {
            0x7C => mode.to_le_bytes().to_vec(),
            0x75 => vec![kind],
            0x71 => sample.to_le_bytes().to_vec(),
            _ => Vec::new(),
        };
        [&[0xA5, 0x5A, 4 + value.len() as u8, 0, 0, 0, 0x20][..], &payload[..4], &value].concat()
    }

    fn scan(&mut self, kind: u8) -> Vec<u8> {
        self.is_scanning = true;
        let length = match kind {
            0x81 => 5,
            0x84 => 132,
            _ => 84,
        };
        vec![0xA5, 0x5A, length, 0, 0, 0x40, kind]
    }
}

/// A room, millimetres by degrees clockwise: some readings are none.
pub(crate) fn room_mm(number: usize, deg: f64) -> u32 {
    if number.is_multiple_of(17) {
        return 0;
    }
    let wave = (deg.to_radians() * 3.0).sin() * 700.0 + (number % 5) as f64;
    (2500.0 + wave) as u32
}

/// Standard nodes: five bytes each, `per_turn` a revolution.
pub(crate) fn nodes(count: usize, per_turn: u32) -> Vec<Vec<u8>> {
    let mut last_q6 = TURN_Q6;
    (0..count)
        .map(|number| {
            let angle_q6 = (number as u32 + 40) * TURN_Q6 / per_turn % TURN_Q6;
            let is_new = angle_q6 < last_q6;
            last_q6 = angle_q6;
            let range_q2 = room_mm(number, f64::from(angle_q6) / 64.0) * 4 + (number % 4) as u32;
            let quality = (number % 64) as u8;
            let angle = (angle_q6 as u16) << 1 | 1;
            let flags = quality << 2 | if is_new { 1 } else { 2 };
            let [low, high] = angle.to_le_bytes();
            let [range_low, range_high] = (range_q2 as u16).to_le_bytes();
            vec![flags, low, high, range_low, range_high]
        })
        .collect()
}

/// Start of a capsule, 64ths of a degree: it turns a little unevenly.
pub(crate) fn start_q6(number: usize, per_turn: f64) -> u32 {
    let turned = f64::from(TURN_Q6) * (number as f64 + 0.1 * (number as f64 * 0.7).sin()) / per_turn;
    (turned as u32 + 700) % TURN_Q6
}

/// A capsule of any kind around its payload.
pub(crate) fn capsule(start_q6: u32, is_first: bool, payload: &[u8]) -> Vec<u8> {
    let mut bytes = vec![0, 0];
    bytes.extend_from_slice(&(start_q6 as u16 | if is_first { 0x8000 } else { 0 }).to_le_bytes());
    bytes.extend_from_slice(payload);
    let sum = bytes[2..].iter().fold(0, |sum, byte| sum ^ byte);
    (bytes[0], bytes[1]) = (0xA0 | sum & 0xF, 0x50 | sum >> 4);
    bytes
}

/// Express capsules: readings are corrected by up to `most_q3` eighths of a degree.
pub(crate) fn express(count: usize, per_turn: f64, most_q3: usize) -> Vec<Vec<u8>> {
    let of = |number: usize| {
        let start = start_q6(number, per_turn);
        let reading = |place: usize| {
            let whole = number * 32 + place;
            (room_mm(whole, f64::from(start) / 64.0), (whole * 7 % (most_q3 + 1)) as u8)
        };
        let cabins = (0..16).flat_map(|cabin| {
            let [(first_mm, first_q3), (second_mm, second_q3)] = [reading(2 * cabin), reading(2 * cabin + 1)];
            let word = |mm: u32, q3: u8| ((mm << 2) as u16 | u16::from(q3 >> 4)).to_le_bytes();
            let ([a, b], [c, d]) = (word(first_mm, first_q3), word(second_mm, second_q3));
            [a, b, c, d, first_q3 & 0xF | second_q3 << 4]
        });
        capsule(start, number == 0, &cabins.collect::<Vec<_>>())
    };
    (0..count).map(of).collect()
}

/// Dense capsules: 40 readings of 16 bits.
pub(crate) fn dense(count: usize, per_turn: f64) -> Vec<Vec<u8>> {
    let of = |number: usize| {
        let start = start_q6(number, per_turn);
        let reading = |place: usize| room_mm(number * 40 + place, f64::from(start) / 64.0) as u16;
        let cabins = (0..40).flat_map(|place| reading(place).to_le_bytes());
        capsule(start, number == 0, &cabins.collect::<Vec<_>>())
    };
    (0..count).map(of).collect()
}

/// Ultra capsules: 32 cabins of any three codes.
pub(crate) fn ultra(count: usize, per_turn: f64) -> Vec<Vec<u8>> {
    let of = |number: usize| {
        let cabins = (0..32).flat_map(|cabin| {
            let whole = number * 32 + cabin;
            // majors of all scales, some none; relatives small, some none
            let major = if whole.is_multiple_of(13) { 0 } else { (400 + whole * 37 % 3300) as u32 };
            // beside a major that is none, relatives below zero would be no ranges
            let least = if (whole + 1) % 13 <= 1 { 0 } else { 20 };
            let relative = |seed: usize| match seed % 11 {
                0 => 511_u32,
                1 => 512,
                _ => ((seed % 41) as u32 + 1024 - least) & 0x3FF,
            };
            (major | relative(whole * 3) << 12 | relative(whole * 5 + 1) << 22).to_le_bytes()
        });
        capsule(start_q6(number, per_turn), number == 0, &cabins.collect::<Vec<_>>())
    };
    (0..count).map(of).collect()
}

/// A lidar and a device that talk with each other as time goes by, without a line.
pub(crate) struct Talk {
    pub(crate) lidar: Rplidar,
    pub(crate) device: Device,
    pub(crate) now: Stamp,
    pub(crate) dtr: Option<bool>,
}

impl Talk {
    pub(crate) fn new(lidar: Rplidar, device: Device) -> Self {
        Self { lidar, device, now: Stamp(1_000_000_000), dtr: None }
    }

    /// Lets time go by until the lidar scans, or so many steps of 50 ms have gone by.
    pub(crate) fn begin(&mut self, steps: usize) {
        for _ in 0..steps {
            if self.device.is_scanning {
                return;
            }
            self.pass(50);
        }
    }

    /// Lets milliseconds go by and does what is asked for.
    pub(crate) fn pass(&mut self, ms: i64) {
        self.now.0 += ms * 1_000_000;
        while let Some(request) = self.lidar.next_request(self.now) {
            match request {
                Request::Dtr(on) => self.dtr = Some(on),
                Request::Bytes(bytes) => {
                    let answer = self.device.answer(&bytes);
                    self.lidar.receive(&answer, self.now);
                }
            }
        }
    }

    pub(crate) fn revolutions(&mut self) -> Vec<Revolution> {
        std::iter::from_fn(|| self.lidar.next_scan()).collect()
    }
}

/// Degrees clockwise and millimetres of all beams, in their order; both are exact in the units of the protocol.
pub(crate) fn points(revolutions: &[Revolution]) -> Vec<(f64, f64)> {
    let beams = revolutions.iter().flat_map(|revolution| &revolution.beams);
    beams
        .map(|beam| {
            let deg = (-beam.bearing_rad.to_degrees()).rem_euclid(360.0);
            let deg = (deg * 2048.0 * 15.0).round() / (2048.0 * 15.0);
            (deg % 360.0, (f64::from(beam.range_m) * 4000.0).round() / 4.0)
        })
        .collect()
}
