//! Clouds as PCD and PLY files.

use crate::error::CloudError;
use crate::folder::{Listing, ends_with};
use crate::notes::Notes;
use crate::pcd::is_pcd;
use crate::plan::{Decode, Frame, Kind, Plan, stamps_of_names, stem};
use crate::ply::is_ply;
use crate::text::excerpt;
use mapwright_sensor::SpaceSensor;

pub(super) fn find(listing: &Listing<'_>) -> Result<Option<Plan>, CloudError> {
    let is_cloud = |name: &str| ends_with(name, ".pcd") || ends_with(name, ".ply");
    let names = match listing.only() {
        Some(name) if !is_cloud(name) => {
            let bytes = listing.head(name)?;
            if is_pcd(&bytes) || is_ply(&bytes) { vec![name.to_owned()] } else { Vec::new() }
        }
        _ => listing.in_one_folder(is_cloud)?,
    };
    if names.is_empty() {
        return Ok(None);
    }
    listing.check_first(&names, |name| {
        let head = listing.head(name)?;
        let is_one = is_pcd(&head) || is_ply(&head);
        is_one.then_some(()).ok_or_else(|| CloudError::content(name, 0, "a PCD or PLY file", excerpt(&head)))
    })?;
    let stems: Vec<&str> = names.iter().map(|name| stem(name)).collect();
    let by_name = stamps_of_names(&stems);
    let mut decisions = vec!["the robot's frame is that of the files".to_owned()];
    decisions.push(match by_name {
        Some(_) => "stamps are the names of the files".to_owned(),
        None => {
            "files do not bear stamps: where their points have no times of the epoch, they are taken to be 0.1 s apart"
                .to_owned()
        }
    });
    let frame = |(place, file): (usize, String)| {
        let stamp = by_name.as_ref().map(|stamps| stamps[place]);
        Frame { file, stamp, colour: None, right: None }
    };
    Ok(Some(Plan {
        kind: Kind::Files,
        frames: names.clone().into_iter().enumerate().map(frame).collect(),
        sensor: SpaceSensor::lidar("clouds"),
        decode: Decode::Files,
        references: Vec::new(),
        decisions,
        notes: Notes::default(),
    }))
}
