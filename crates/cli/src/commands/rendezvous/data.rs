//! Files of a data set of several robots, from a folder or an archive.

use super::archive;
use crate::failure::Failure;
use mapwright_formats::{
    FormatError, MrclamPose, MrclamRows, MrclamSighting, MrclamVelocity, read_mrclam_barcodes,
    read_mrclam_measurements, read_mrclam_odometry, read_mrclam_truth,
};
use mapwright_geom::{Pose2, Stamp};
use mapwright_rendezvous::{DeadReckoning, RobotId, Velocity};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

/// Robots are numbered from 1 without a gap; no data set has more.
const MOST_ROBOTS: RobotId = 64;
/// Poses of the truth farther apart say nothing of what lies between, seconds.
const TRUTH_GAP_S: f64 = 0.5;

/// All that is known of the robots.
pub(super) struct DataSet {
    pub(super) robots: Vec<Robot>,
    /// Subject of each barcode.
    pub(super) subjects: BTreeMap<u32, u32>,
    /// What was odd about the files, in words.
    pub(super) losses: Vec<String>,
}

/// What one robot recorded.
pub(super) struct Robot {
    pub(super) id: RobotId,
    pub(super) wheels: DeadReckoning,
    pub(super) seen: Vec<MrclamSighting>,
    pub(super) truth: Option<Truth>,
}

/// Where motion capture saw a robot, sorted by stamp.
pub(super) struct Truth(Vec<MrclamPose>);

impl Truth {
    /// None outside, and in gaps.
    pub(super) fn at(&self, stamp: Stamp) -> Option<Pose2> {
        let after = self.0.partition_point(|pose| pose.stamp <= stamp);
        let (one, two) = (self.0.get(after.checked_sub(1)?)?, self.0.get(after)?);
        let (gap_s, into_s) = (two.stamp.secs_since(one.stamp), stamp.secs_since(one.stamp));
        let step = one.world_from_robot.between(two.world_from_robot).log();
        let part = if gap_s > 0.0 { into_s / gap_s } else { 0.0 };
        (gap_s <= TRUTH_GAP_S).then(|| one.world_from_robot * Pose2::exp(step.map(|component| part * component)))
    }
}

/// Reads what there is; barcodes and two robots at least there must be.
pub(super) fn read(path: &Path) -> Result<DataSet, Failure> {
    let files = Files::open(path)?;
    let barcodes = files.read("Barcodes.dat", read_mrclam_barcodes)?;
    let barcodes = barcodes.ok_or_else(|| files.lacks("Barcodes.dat"))?;
    let mut subjects = BTreeMap::new();
    for [subject, barcode] in barcodes {
        if let Some(other) = subjects.insert(barcode, subject) {
            let reason = format!("expected one subject for each barcode, found {other} and {subject} for {barcode}");
            return Err(Failure::Log(format!("{}: {reason}", files.name("Barcodes.dat"))));
        }
    }
    let mut set = DataSet { robots: Vec::new(), subjects, losses: Vec::new() };
    for id in 1..=MOST_ROBOTS {
        match read_robot(&files, id, &mut set.losses)? {
            Some(robot) => set.robots.push(robot),
            None => break,
        }
    }
    if set.robots.len() < 2 {
        return Err(files.lacks(&format!("Robot{}_Odometry.dat", set.robots.len() + 1)));
    }
    Ok(set)
}

/// None where there is no odometry of this robot.
fn read_robot(files: &Files, id: RobotId, losses: &mut Vec<String>) -> Result<Option<Robot>, Failure> {
    let name = |kind: &str| format!("Robot{id}_{kind}.dat");
    let Some(odometry) = files.read(&name("Odometry"), read_mrclam_odometry)? else { return Ok(None) };
    let seen = files.read(&name("Measurement"), read_mrclam_measurements)?;
    let seen = seen.ok_or_else(|| files.lacks(&name("Measurement")))?;
    let truth = files.read(&name("Groundtruth"), read_mrclam_truth)?;
    push_losses(&name("Odometry"), &odometry, losses);
    push_losses(&name("Measurement"), &seen, losses);
    let truth = truth.map(|mut truth| {
        push_losses(&name("Groundtruth"), &truth, losses);
        truth.rows.sort_by_key(|pose| pose.stamp);
        Truth(truth.rows)
    });
    let velocity = |row: &MrclamVelocity| Velocity {
        stamp: row.stamp,
        forward_m_per_s: row.forward_m_per_s,
        turn_rad_per_s: row.turn_rad_per_s,
    };
    let velocities: Vec<Velocity> = odometry.rows.iter().map(velocity).collect();
    Ok(Some(Robot { id, wheels: DeadReckoning::from_velocities(&velocities), seen: seen.rows, truth }))
}

fn push_losses<T>(name: &str, rows: &MrclamRows<T>, losses: &mut Vec<String>) {
    let what =
        [(rows.not_finite, "not finite, left out"), (rows.unsorted, "with a stamp before an earlier row's, sorted in")];
    for (count, what) in what.into_iter().filter(|(count, _)| *count > 0) {
        losses.push(format!("{name}: {} {what}", crate::terminal::count(count as u64, "row")));
    }
}

/// Where the files are.
enum Files {
    Folder(PathBuf),
    /// Contents by name without folders.
    Archive(PathBuf, BTreeMap<String, Vec<u8>>),
}

impl Files {
    fn open(path: &Path) -> Result<Self, Failure> {
        if path.is_dir() {
            return Ok(Self::Folder(path.to_owned()));
        }
        let file = File::open(path).map_err(|error| Failure::open(path, error))?;
        let contents = archive::read(BufReader::new(file)).map_err(|reason| Failure::open(path, reason))?;
        Ok(Self::Archive(path.to_owned(), contents))
    }

    fn name(&self, file: &str) -> String {
        match self {
            Self::Folder(folder) => folder.join(file).display().to_string(),
            Self::Archive(archive, _) => format!("{} in {}", file, archive.display()),
        }
    }

    fn lacks(&self, file: &str) -> Failure {
        Failure::Log(format!("expected {}, found no such file", self.name(file)))
    }

    /// Reads a file, if there is one.
    fn read<'a, T>(
        &'a self,
        file: &str,
        parse: impl FnOnce(Box<dyn Read + 'a>) -> Result<T, FormatError>,
    ) -> Result<Option<T>, Failure> {
        let reader: Box<dyn Read + 'a> = match self {
            Self::Folder(folder) => match File::open(folder.join(file)) {
                Ok(opened) => Box::new(BufReader::new(opened)),
                Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
                Err(error) => return Err(Failure::open(&folder.join(file), error)),
            },
            Self::Archive(_, contents) => match contents.get(file) {
                Some(content) => Box::new(content.as_slice()),
                None => return Ok(None),
            },
        };
        parse(reader).map(Some).map_err(|cause| Failure::read(Path::new(&self.name(file)), cause))
    }
}
