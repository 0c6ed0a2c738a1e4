//! What became of all that arrived.

use std::fmt;

/// What became of all that a lidar sent. `bytes_received` is `bytes_used` plus `bytes_skipped` plus the bytes of a packet that has only begun.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Bytes that arrived.
    pub bytes_received: u64,
    /// Bytes of good packets and of answers.
    pub bytes_used: u64,
    /// All other bytes: damaged packets, rests of packets, what came while nothing was expected.
    pub bytes_skipped: u64,
    /// Good packets: of an LD06, nodes or capsules of an RPLIDAR, datagrams of points.
    pub packets: u64,
    /// Packets whose checksum or check bits are wrong, or where none began though one should have.
    pub bad_checksums: u64,
    /// Packets with a good checksum whose numbers cannot be.
    pub implausible: u64,
    /// Packets that were lost on the way, by what the angles (RPLIDAR) or the lidar's clock (LD06) say.
    pub lost: u64,
    /// Capsules of an RPLIDAR that arrived, and whose end nothing says, because the next one was lost or damaged: their readings are left out.
    pub unplaced: u64,
    /// Whole revolutions, or clouds.
    pub revolutions: u64,
    /// Parts of revolutions that were left out: before the first whole one, around a break of the line.
    pub partial_revolutions: u64,
    /// Revolutions that nobody asked for before too many newer ones came.
    pub overtaken: u64,
    /// Requests that the lidar did not answer.
    pub timeouts: u64,
    /// Times that the lidar was started anew: silence, or a cable that was put back.
    pub restarts: u64,
    /// Times that the lidar was reset, because it had stopped to protect itself.
    pub resets: u64,
}

impl Counts {
    /// Whether something that the lidar measured may be missing.
    #[must_use]
    pub fn has_losses(&self) -> bool {
        let lost = [self.bad_checksums, self.implausible, self.lost, self.unplaced, self.overtaken, self.restarts];
        lost.iter().any(|&count| count > 0)
    }
}

impl fmt::Display for Counts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} revolutions of {} packets", self.revolutions, self.packets)?;
        let rest = [
            (self.bad_checksums, "damaged"),
            (self.implausible, "with numbers that cannot be"),
            (self.lost, "lost"),
            (self.unplaced, "left out beside lost or damaged ones"),
            (self.partial_revolutions, "parts of revolutions left out"),
            (self.overtaken, "revolutions overtaken by newer ones"),
            (self.bytes_skipped, "bytes skipped"),
            (self.timeouts, "requests without an answer"),
            (self.restarts, "restarts"),
            (self.resets, "resets"),
        ];
        rest.iter().filter(|(count, _)| *count > 0).try_for_each(|(count, what)| write!(f, ", {count} {what}"))
    }
}
