//! Captures of a lidar's packets.

use crate::error::CloudError;
use crate::folder::{Listing, ends_with, parts};
use crate::notes::Notes;
use crate::packets::capture::Capture;
use crate::packets::flows::{Survey, survey};
use crate::packets::lidar::OUSTER_METADATA;
use crate::packets::ouster::OusterInfo;
use crate::packets::window::Window;
use crate::plan::{Decode, Frame, Kind, Plan, stem};
use crate::text::excerpt;
use mapwright_sensor::SpaceSensor;
use std::sync::Arc;

/// No sensor has more to say of itself, bytes.
const METADATA_BYTES_MAX: usize = 1 << 20;

pub(super) fn find(listing: &Listing<'_>) -> Result<Option<Plan>, CloudError> {
    let is_capture = |name: &str| ends_with(name, ".pcap") || ends_with(name, ".pcapng");
    let names = match listing.only() {
        Some(name) => vec![name.to_owned()],
        None => listing.in_one_folder(is_capture)?,
    };
    let name = match names.as_slice() {
        [] => return Ok(None),
        [name] => name,
        _ => return Err(CloudError::Several { folders: names.into_iter().take(10).collect() }),
    };
    let begin = Capture::begin(&listing.head(name)?);
    if begin.is_none() && !is_capture(name) {
        return Ok(None);
    }
    let metadata = metadata(listing, name);
    let info = metadata.as_ref().and_then(|(_, info)| info.as_ref().ok()).cloned();
    let survey = match begin {
        Some(capture) => survey(&mut Window::open(listing.folder, name), capture, info)?,
        None => None,
    };
    let Some(survey) = survey else {
        let expected =
            "a capture with packets of a Velodyne (1206 bytes by UDP), a Hesai PandarXT-32 (1080) or an Ouster";
        let found = match begin_of(listing, name)? {
            true => format!(
                "none: {} converts other lidars'",
                "the vendor's driver, with its PointCloud2 recorded as a bag,"
            ),
            false => excerpt(&listing.head(name)?),
        };
        return Err(CloudError::content(name, 0, expected, found));
    };
    let lidar = survey.sender.2;
    let title =
        lidar.name(survey.info.as_deref()).map_err(|reason| unread(name, &survey, metadata.as_ref(), &reason))?;
    let range_max_m = lidar.range_max_m(survey.info.as_deref());
    let decisions = decisions(&survey, metadata.as_ref().map(|(file, _)| file.as_str()));
    Ok(Some(Plan {
        kind: Kind::Packets,
        frames: vec![Frame { file: name.clone(), stamp: None, colour: None, right: None }],
        sensor: SpaceSensor { range_max_m, ..SpaceSensor::lidar(&title) },
        decode: Decode::Packets(survey),
        references: Vec::new(),
        decisions,
        notes: Notes::default(),
    }))
}

fn begin_of(listing: &Listing<'_>, name: &str) -> Result<bool, CloudError> {
    Ok(Capture::begin(&listing.head(name)?).is_some())
}

/// A file of metadata and what is in it.
type Metadata = (String, Result<Arc<OusterInfo>, String>);

/// Beside a capture: the file that has its name, else the only one that is such.
fn metadata(listing: &Listing<'_>, capture: &str) -> Option<Metadata> {
    let folder = parts(capture).0;
    let beside = |name: &&str| parts(name).0 == folder && ends_with(name, ".json");
    let read = |name: &str| {
        let bytes = listing.folder.read_part(name, 0, METADATA_BYTES_MAX).ok()?;
        let text = String::from_utf8_lossy(&bytes);
        OusterInfo::is_like(&text).then(|| (name.to_owned(), OusterInfo::parse(&text).map(Arc::new)))
    };
    let named = format!("{folder}{}.json", stem(capture));
    if listing.has(&named) {
        return read(&named);
    }
    let mut others = listing.names().filter(beside).filter_map(read);
    others.next().filter(|_| others.next().is_none())
}

/// Why packets are not read, and what to do about it.
fn unread(name: &str, survey: &Survey, metadata: Option<&Metadata>, reason: &str) -> CloudError {
    if !survey.sender.2.is_ouster() {
        return CloudError::content(name, 0, "a lidar whose packets are read", reason);
    }
    let expected = format!("the sensor's metadata beside it as {}.json ({OUSTER_METADATA})", stem(name));
    match metadata {
        Some((file, Err(wrong))) => CloudError::content(file, 0, "the metadata of an Ouster", wrong),
        Some((file, Ok(_))) => CloudError::content(file, 0, expected, reason),
        None => CloudError::content(name, 0, expected, format!("no such file, and {reason}")),
    }
}

fn decisions(survey: &Survey, metadata: Option<&str>) -> Vec<String> {
    let (source, port, lidar) = survey.sender;
    let mut decisions = lidar.decisions(survey.info.as_deref());
    decisions.extend(metadata.filter(|_| lidar.is_ouster()).map(|file| format!("the sensor is as {file} says")));
    decisions.push(
        "the first packet's stamp is that of the capture, unless the sensor's clock is within a second of it; further ones are by the \
         sensor's clock"
            .to_owned(),
    );
    if survey.is_dual {
        decisions.push("both returns of a beam are points where they differ".to_owned());
    }
    if survey.readings > 0 {
        decisions.push(format!("{} readings of its inertial sensor are used", survey.readings));
    }
    if survey.senders > 1 {
        let [a, b, c, d] = source;
        decisions.push(format!(
            "{} sensors send: {a}.{b}.{c}.{d} to port {port} is read, for it sends most",
            survey.senders
        ));
    }
    decisions
}
