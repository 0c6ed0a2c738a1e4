//! nuScenes' lidar sweeps (Caesar et al. 2020): `...__LIDAR_TOP__1532402927647951.pcd.bin`, five floats a point.

use crate::bins::{BinReader, Columns};
use crate::error::CloudError;
use crate::folder::{Listing, ends_with, number, parts};
use crate::notes::Notes;
use crate::plan::{Decode, FRAME_NS, Frame, Kind, Plan};
use mapwright_geom::Stamp;
use mapwright_sensor::SpaceSensor;

const ENDING: &str = ".pcd.bin";
/// Names bear microseconds.
const NAME_NS: i64 = 1000;

pub(super) fn find(listing: &Listing<'_>) -> Result<Option<Plan>, CloudError> {
    let is_sweep = |name: &str| ends_with(name, ENDING);
    let mut names = match listing.only() {
        Some(name) if is_sweep(name) => vec![name.to_owned()],
        _ => listing.in_one_folder(is_sweep)?,
    };
    if names.is_empty() {
        return Ok(None);
    }
    listing.check_first(&names, |name| {
        let bytes = listing.read(name)?;
        BinReader::default().read(name, &bytes, Columns::Five, &mut Notes::default()).map(drop)
    })?;
    let has_stamps = names.iter().all(|name| stamp(name).is_some());
    if has_stamps {
        names.sort_by_key(|name| stamp(name));
    }
    let decisions = vec![
        "the robot's frame is the lidar's".to_owned(),
        "points are five floats, x y z intensity ring, as nuScenes has them".to_owned(),
        if has_stamps { "stamps are the names of the files" } else { "frames are taken to be 0.1 s apart" }.to_owned(),
    ];
    let frame = |(place, file): (usize, String)| {
        let by_place = Stamp((place as i64).saturating_mul(FRAME_NS));
        let stamp = stamp(&file).filter(|_| has_stamps).unwrap_or(by_place);
        Frame { file, stamp: Some(stamp), colour: None, right: None }
    };
    Ok(Some(Plan {
        kind: Kind::NuScenes,
        frames: names.into_iter().enumerate().map(frame).collect(),
        sensor: SpaceSensor::lidar("lidar"),
        decode: Decode::Bins(Columns::Five),
        references: Vec::new(),
        decisions,
        notes: Notes::default(),
    }))
}

/// Of the digits behind the last underscore.
fn stamp(name: &str) -> Option<Stamp> {
    let file = parts(name).1;
    let stem = file.get(..file.len().checked_sub(ENDING.len())?)?;
    let digits = number(stem.rsplit('_').next()?)?;
    i64::try_from(digits).ok()?.checked_mul(NAME_NS).map(Stamp)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_bear_stamps() {
        let name = "sweeps/LIDAR_TOP/n015-2018-07-24-11-22-45+0800__LIDAR_TOP__1532402927647951.pcd.bin";
        assert_eq!(stamp(name), Some(Stamp(1_532_402_927_647_951_000)));
        assert_eq!(
            [stamp("a.pcd.bin"), stamp(".pcd.bin"), stamp("x"), stamp("99999999999999999999.pcd.bin")],
            [None; 4]
        );
    }
}
