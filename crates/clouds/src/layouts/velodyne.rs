//! Captures of a Velodyne's packets.

use crate::error::CloudError;
use crate::folder::{Listing, ends_with};
use crate::notes::Notes;
use crate::packets::capture::Capture;
use crate::packets::velodyne::survey;
use crate::packets::window::Window;
use crate::plan::{Decode, Frame, Kind, Plan};
use crate::text::excerpt;
use mapwright_sensor::SpaceSensor;

/// Both models' range, metres.
const RANGE_MAX_M: f64 = 100.0;

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
    let survey = match begin {
        Some(capture) => survey(&mut Window::open(listing.folder, name), capture)?,
        None => None,
    };
    let Some(survey) = survey else {
        let expected = "a capture with packets of a Velodyne (1206 bytes by UDP)";
        return Err(CloudError::content(name, 0, expected, excerpt(&listing.head(name)?)));
    };
    let model = survey.model.map_err(|product| {
        let expected = "packets of a VLP-16 (0x22) or HDL-32E (0x21)";
        CloudError::content(name, 0, expected, format!("those of product {product:#04x}"))
    })?;
    let mut decisions = vec![
        format!("{}, its default angles; x is ahead, where its azimuth is zero, y to the left", model.name()),
        "the first packet's stamp is that of the capture, further ones by the sensor's clock".to_owned(),
    ];
    if survey.is_dual {
        decisions.push("both returns of a beam are points where they differ".to_owned());
    }
    if survey.senders > 1 {
        let ([a, b, c, d], port, _) = survey.sender;
        decisions.push(format!(
            "{} sensors send: {a}.{b}.{c}.{d} to port {port} is read, for it sends most",
            survey.senders
        ));
    }
    Ok(Some(Plan {
        kind: Kind::Velodyne,
        frames: vec![Frame { file: name.clone(), stamp: None, colour: None }],
        sensor: SpaceSensor { range_max_m: RANGE_MAX_M, ..SpaceSensor::lidar(model.name()) },
        decode: Decode::Packets(survey),
        references: Vec::new(),
        decisions,
        notes: Notes::default(),
    }))
}
