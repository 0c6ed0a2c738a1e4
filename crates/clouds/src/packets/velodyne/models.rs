//! What the models' lasers do: elevations, offsets and times of firing as their manuals have them.

use mapwright_geom::sin_cos;

/// A kind of sensor whose packets have 12 blocks of 32 readings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Model {
    Vlp16,
    PuckHiRes,
    Hdl32,
    Vlp32c,
}

/// What a model's lasers do.
pub(super) struct Lasers {
    /// Sine and cosine of each one's elevation.
    pub(super) elevations: Vec<(f64, f64)>,
    /// How far above the origin each beam starts, metres.
    pub(super) heights_m: Vec<f64>,
    /// By how much each looks to the left of the block's angle, degrees.
    pub(super) left_deg: Vec<f64>,
    /// When each fires after the first, nanoseconds.
    pub(super) after_ns: Vec<i64>,
    /// From one firing of all to the next, nanoseconds.
    pub(super) firing_ns: i64,
    /// Metres of a distance's unit.
    pub(super) distance_m: f64,
}

/// 63-9243 Rev. E, table 9-1, of which the Hi-Res has a third less each way (63-9318 Rev. E).
const VLP16_DEG: [f64; 16] =
    [-15.0, 1.0, -13.0, 3.0, -11.0, 5.0, -9.0, 7.0, -7.0, 9.0, -5.0, 11.0, -3.0, 13.0, -1.0, 15.0];
const VLP16_MM: [f64; 16] = [11.2, -0.7, 9.7, -2.2, 8.1, -3.7, 6.6, -5.1, 5.1, -6.6, 3.7, -8.1, 2.2, -9.7, 0.7, -11.2];
const HI_RES_MM: [f64; 16] = [7.4, -0.9, 6.5, -1.8, 5.5, -2.7, 4.6, -3.7, 3.7, -4.6, 2.7, -5.5, 1.8, -6.5, 0.9, -7.4];

/// 63-9325 Rev. D, table 9-3: elevation, and offset of the azimuth, degrees.
const VLP32C_DEG: [(f64, f64); 32] = [
    (-25.0, 1.4),
    (-1.0, -4.2),
    (-1.667, 1.4),
    (-15.639, -1.4),
    (-11.31, 1.4),
    (0.0, -1.4),
    (-0.667, 4.2),
    (-8.843, -1.4),
    (-7.254, 1.4),
    (0.333, -4.2),
    (-0.333, 1.4),
    (-6.148, -1.4),
    (-5.333, 4.2),
    (1.333, -1.4),
    (0.667, 4.2),
    (-4.0, -1.4),
    (-4.667, 1.4),
    (1.667, -4.2),
    (1.0, 1.4),
    (-3.667, -4.2),
    (-3.333, 4.2),
    (3.333, -1.4),
    (2.333, 1.4),
    (-2.667, -1.4),
    (-3.0, 1.4),
    (7.0, -1.4),
    (4.667, 1.4),
    (-2.333, -4.2),
    (-2.0, 4.2),
    (15.0, -1.4),
    (10.333, 1.4),
    (-1.333, -1.4),
];

impl Model {
    /// By the last byte of a packet.
    pub(crate) fn of_product(product: u8) -> Option<Self> {
        match product {
            0x21 => Some(Self::Hdl32),
            // the Puck LITE is a VLP-16 of less weight
            0x22 | 0x23 => Some(Self::Vlp16),
            0x24 => Some(Self::PuckHiRes),
            0x28 => Some(Self::Vlp32c),
            _ => None,
        }
    }

    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Vlp16 => "VLP-16",
            Self::PuckHiRes => "Puck Hi-Res",
            Self::Hdl32 => "HDL-32E",
            Self::Vlp32c => "VLP-32C",
        }
    }

    pub(crate) fn range_max_m(self) -> f64 {
        if self == Self::Vlp32c { 200.0 } else { 100.0 }
    }

    pub(super) fn lasers(self) -> Lasers {
        let puck = |degrees: [f64; 16], millimetres: [f64; 16]| Lasers {
            heights_m: millimetres.map(|millimetres| 1e-3 * millimetres).to_vec(),
            ..Lasers::new(&degrees, 2304, 55_296)
        };
        match self {
            Self::Vlp16 => puck(VLP16_DEG, VLP16_MM),
            Self::PuckHiRes => puck(VLP16_DEG.map(|degrees| degrees * 2.0 / 3.0), HI_RES_MM),
            // the lower and the upper half of the fan in turns, a third of four degrees apart
            Self::Hdl32 => Lasers::new(
                &std::array::from_fn::<f64, 32, _>(|laser| {
                    let step = (laser / 2 + if laser % 2 == 0 { 0 } else { 16 }) as f64;
                    -92.0 / 3.0 + step * 4.0 / 3.0
                }),
                1152,
                46_080,
            ),
            Self::Vlp32c => Lasers {
                left_deg: VLP32C_DEG.map(|(_, left)| left).to_vec(),
                // two lasers fire at once
                after_ns: (0..32).map(|laser| laser / 2 * 2304).collect(),
                distance_m: 0.004,
                ..Lasers::new(&VLP32C_DEG.map(|(elevation, _)| elevation), 2304, 55_296)
            },
        }
    }
}

impl Lasers {
    /// Lasers in a column that fire one after the other.
    fn new(elevations_deg: &[f64], laser_ns: i64, firing_ns: i64) -> Self {
        let count = elevations_deg.len();
        Self {
            elevations: elevations_deg.iter().map(|degrees| sin_cos(degrees.to_radians())).collect(),
            heights_m: vec![0.0; count],
            left_deg: vec![0.0; count],
            after_ns: (0..count as i64).map(|laser| laser * laser_ns).collect(),
            firing_ns,
            distance_m: 0.002,
        }
    }
}
