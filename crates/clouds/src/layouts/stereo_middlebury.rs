//! Middlebury's pairs (Scharstein et al. 2014, and those before, which are numbered and come without a calibration).

use super::stereo_pair::{CAMERAS_FRAME, Said, frames, is_image, plan, size, text_of};
use crate::error::CloudError;
use crate::folder::{Listing, number, parts};
use crate::notes::Notes;
use crate::plan::{Kind, Plan, stem};
use crate::stereo::StereoPairPlan;
use mapwright_geom::{Pose3, Stamp};
use mapwright_stereo::MiddleburyPair;

/// Names before the number: of all sets, and of those of 2005 and 2006.
const NAMES: [&str; 2] = ["im", "view"];
/// Of more than two images these two are the pair whose disparities are known, in sets of nine and seven.
const USUAL: [[u64; 2]; 2] = [[2, 6], [1, 5]];

pub(super) fn find(listing: &Listing<'_>) -> Result<Option<Plan>, CloudError> {
    for word in NAMES {
        let of_pair = |name: &str| is_image(name) && numbered(name, word).is_some();
        let mut names = listing.in_one_folder(of_pair)?;
        // an image may be there in several formats
        names.dedup_by(|later, first| stem(later) == stem(first));
        let numbers: Vec<u64> = names.iter().filter_map(|name| numbered(parts(name).1, word)).collect();
        let usual = USUAL.into_iter().find(|pair| pair.iter().all(|number| numbers.contains(number)));
        let chosen = match numbers[..] {
            [left, right] if left != right => Some([left, right]),
            _ => usual.filter(|_| names.len() > 2),
        };
        let of = |wanted: u64| numbers.iter().position(|number| *number == wanted).and_then(|at| names.get(at));
        if let Some([left, right]) = chosen
            && let (Some(left), Some(right)) = (of(left), of(right))
        {
            let others = (names.len() > 2).then(|| {
                format!(
                    "{} and {} are used, the other {} images are not",
                    parts(left).1,
                    parts(right).1,
                    names.len() - 2
                )
            });
            return one(listing, left, right, others).map(Some);
        }
    }
    Ok(None)
}

fn one(listing: &Listing<'_>, left: &str, right: &str, others: Option<String>) -> Result<Plan, CloudError> {
    let folder = parts(left).0;
    let frames = frames(vec![(left.to_owned(), right.to_owned())], vec![Stamp(0)]);
    let size = size(listing, &frames)?;
    let said = calibration(listing, &format!("{folder}calib.txt"), size);
    let mut decisions = vec![CAMERAS_FRAME.to_owned(), "one pair makes one cloud".to_owned()];
    decisions.extend(others);
    let rest = (Vec::new(), decisions, Notes::default());
    Ok(plan(Kind::Middlebury, (frames, size), said, Pose3::identity(), rest))
}

fn calibration(listing: &Listing<'_>, file: &str, size: [u32; 2]) -> Said {
    if !listing.has(file) {
        return Said::nothing("there is no calib.txt");
    }
    let read = || -> Result<MiddleburyPair, String> {
        let text = text_of(listing, file).map_err(|error| error.to_string())?;
        let pair = MiddleburyPair::parse(&text).map_err(|error| error.to_string())?;
        let expected = [pair.camera.width, pair.camera.height];
        if expected != size {
            let [[width, height], [found_width, found_height]] = [expected, size];
            return Err(format!("expected images of {width} x {height} pixels, found {found_width} x {found_height}"));
        }
        Ok(pair)
    };
    match read() {
        Ok(MiddleburyPair { camera, disparities }) => {
            Said { disparities, ..Said::of(file, Ok::<_, String>(StereoPairPlan::Rectified(camera))) }
        }
        Err(reason) => Said::nothing(format!("{file}: {reason}")),
    }
}

/// The number of `im2.png`.
fn numbered(name: &str, word: &str) -> Option<u64> {
    number(stem(name).strip_prefix(word)?)
}
