//! The names of runs and keyframes.

/// Which run of which robot: what the names of keyframes begin with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct RunId {
    /// The robot.
    pub robot: u128,
    /// Which of its runs, from zero.
    pub session: u32,
}

impl RunId {
    /// The robot of this name: the same on every machine (128-bit FNV-1a of the name's bytes).
    #[must_use]
    pub fn of_robot(name: &str) -> Self {
        const OFFSET: u128 = 0x6c62_272e_07bb_0142_62b8_2175_6295_c58d;
        const PRIME: u128 = 0x0000_0000_0100_0000_0000_0000_0000_013b;
        let robot = name.bytes().fold(OFFSET, |hash, byte| (hash ^ u128::from(byte)).wrapping_mul(PRIME));
        Self { robot, session: 0 }
    }

    /// The keyframe that is the `seq`th of this run, from zero.
    #[must_use]
    pub fn keyframe(self, seq: u32) -> KeyframeId {
        KeyframeId { robot: self.robot, session: self.session, seq }
    }
}

/// Name of a keyframe for ever and across robots. Order within a session is `seq`; stamps are neither unique nor ordered.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct KeyframeId {
    /// Who took it.
    pub robot: u128,
    /// Which run of that robot.
    pub session: u32,
    /// Place in that run's order.
    pub seq: u32,
}

impl KeyframeId {
    /// The run it belongs to.
    #[must_use]
    pub fn run(self) -> RunId {
        RunId { robot: self.robot, session: self.session }
    }
}
