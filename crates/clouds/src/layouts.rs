//! How recordings lie in folders: each kind says what it finds there.

mod depth;
mod files;
mod kitti;
mod open3d;
mod seven_scenes;
mod tum;
mod velodyne;

use crate::error::CloudError;
use crate::folder::Listing;
use crate::plan::Plan;

/// The first kind that the folder is of: kinds that need more to be there come first.
pub(crate) fn find(listing: &Listing<'_>) -> Result<Option<Plan>, CloudError> {
    let kinds = [tum::find, seven_scenes::find, open3d::find, kitti::find, velodyne::find, files::find];
    for kind in kinds {
        if let Some(plan) = kind(listing)? {
            return Ok(Some(plan));
        }
    }
    Ok(None)
}
