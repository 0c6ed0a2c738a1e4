//! How a topic of a lidar's packets becomes clouds.

use crate::frames::list;
use crate::packets::Metadata;
use crate::survey::{Survey, TopicSurvey};
use mapwright_clouds::{Lidar, OUSTER_METADATA, OusterInfo};
use std::sync::Arc;

/// How a topic's packets become clouds.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct PacketPlan {
    pub(super) lidar: Lidar,
    pub(super) info: Option<Arc<OusterInfo>>,
}

impl PacketPlan {
    /// The plan of a topic of packets.
    ///
    /// # Errors
    /// Why they are not read, and what to do about it, in words.
    pub(super) fn of(survey: &Survey, topic: &TopicSurvey) -> Result<Self, String> {
        let lidar = topic.packets.lidar.ok_or(
            "packets of no lidar that is read (Velodyne with 16 or 32 lasers, Hesai PandarXT-32, Ouster): play them through the lidar's \
             driver and record its PointCloud2",
        )?;
        let info = if lidar.is_ouster() { Some(metadata(survey, topic)?) } else { None };
        lidar.name(info.as_deref())?;
        Ok(Self { lidar, info })
    }

    /// How many clouds a topic has.
    pub(super) fn clouds(&self, topic: &TopicSurvey) -> u64 {
        match &self.info {
            Some(info) => topic.packets.changes[usize::from(info.is_numbered_in_columns())],
            None => topic.usable(),
        }
    }

    /// In words.
    pub(super) fn words(&self) -> String {
        self.lidar.decisions(self.info.as_deref()).join("; ")
    }
}

/// What the sensor says of itself that sends a topic's packets: in a topic of the same namespace, else in the only one that says it, else
/// beside the recording.
fn metadata(survey: &Survey, topic: &TopicSurvey) -> Metadata {
    let folder =
        |name: &str| name.rfind('/').map_or(String::new(), |slash| name[..slash].trim_start_matches('/').to_owned());
    let all: Vec<_> = survey.topics.iter().filter_map(|said| Some((said, said.ouster.as_ref()?))).collect();
    let beside = all.iter().find(|(said, _)| folder(&said.name) == folder(&topic.name));
    let found = beside.or(if all.len() == 1 { all.first() } else { None });
    if let Some(&(said, metadata)) = found {
        return Metadata::clone(metadata).map_err(|reason| format!("{}: {reason}", said.name));
    }
    if let Some(metadata) = &survey.metadata_beside {
        return metadata.clone().map_err(|reason| format!("the file of metadata beside the recording: {reason}"));
    }
    let several = list(all.iter().map(|(said, _)| said.name.as_str()));
    let found = if all.is_empty() { String::new() } else { format!(" ({several} are other sensors')") };
    Err(format!(
        "packets of an Ouster, and no topic says where its beams look{found}: put the sensor's metadata beside the recording, with its name \
         and the ending .json ({OUSTER_METADATA})"
    ))
}
