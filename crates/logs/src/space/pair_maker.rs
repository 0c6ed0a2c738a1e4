//! Clouds out of the images of two cameras, which come one by one.

use super::stereo::StereoTopics;
use crate::links::stamp_or;
use mapwright_clouds::{CameraImage, NoteKind, Notes, StereoDepth, is_turned_words, read_camera_image};
use mapwright_geom::Stamp;
use mapwright_ros::Picture;
use mapwright_ros::messages::{CompressedImage, Image};
use mapwright_sensor::{Cloud, SpaceSensor};
use std::collections::VecDeque;
use std::sync::Arc;

/// Images of both cameras within this are of one moment, nanoseconds: cameras that are triggered together differ by transport.
const TOGETHER_NS: u64 = 5_000_000;
/// Images that wait for their partner, of each side: a second at 30 Hz.
const WAITING_MOST: usize = 32;
/// So many pairs are asked whether they are pairs.
const LOOKED_AT: usize = 3;
/// No image has more pixels; bounds the memory that one message may take.
const PIXELS_MOST: u64 = 1 << 24;

/// Which camera took an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Side {
    Left,
    Right,
}

/// An image that waits for its partner.
#[derive(Debug)]
struct Waiting {
    stamp: Stamp,
    is_unstamped: bool,
    /// The frame of its header.
    frame: String,
    /// Where its message is.
    at: usize,
    image: CameraImage,
}

/// Makes clouds of two topics.
#[derive(Debug)]
pub(super) struct PairMaker {
    depth: StereoDepth,
    topics: [String; 2],
    size: [u32; 2],
    waiting: [VecDeque<Waiting>; 2],
    /// Pairs that were asked, and those that are swapped.
    asked: [usize; 2],
    swapped: Option<String>,
    doubts: Vec<String>,
}

/// A pair that became a cloud, of a message whose header had this frame, and whether it had a stamp.
#[derive(Debug)]
pub(super) struct MadePair {
    pub(super) cloud: Cloud,
    pub(super) is_unstamped: bool,
}

impl PairMaker {
    pub(super) fn new(left: &str, topics: &StereoTopics) -> Option<Self> {
        let depth = StereoDepth::new(&topics.pair, None).ok()?;
        Some(Self {
            depth,
            topics: [left.to_owned(), topics.right.clone()],
            size: topics.pair.size(),
            waiting: Default::default(),
            asked: [0; 2],
            swapped: None,
            doubts: Vec::new(),
        })
    }

    /// What casts doubt on the pairs so far, in words.
    pub(super) fn doubts(&self) -> &[String] {
        &self.doubts
    }

    /// Takes in an image.
    ///
    /// # Errors
    /// Why it is none, in words.
    pub(super) fn add(&mut self, side: Side, image: &Image<'_>, (recorded, at): (Stamp, usize)) -> Result<(), String> {
        let found = [image.width, image.height];
        self.check_size(found)?;
        let picture = image.picture().map_err(|error| error.to_string())?;
        let mut taken = CameraImage::default();
        let set = match picture {
            Picture::Grey(values) => {
                let set = taken.grey.set_grey8(found[0], found[1], &values);
                taken.colours = values.into_iter().map(|value| [value; 3]).collect();
                set
            }
            Picture::Colours(colours) => {
                let set = taken.grey.set_rgb8(found[0], found[1], &colours);
                taken.colours = colours;
                set
            }
        };
        set.map_err(|error| error.to_string())?;
        self.wait(side, (image.header.stamp, image.header.frame()), taken, (recorded, at));
        Ok(())
    }

    /// Takes in an image that is packed as a file.
    ///
    /// # Errors
    /// Why it is none, in words.
    pub(super) fn add_file(
        &mut self,
        side: Side,
        image: &CompressedImage<'_>,
        (recorded, at): (Stamp, usize),
    ) -> Result<(), String> {
        let taken = read_camera_image("the image", image.data, Some(self.size), PIXELS_MOST);
        let taken = taken.map_err(|error| error.to_string())?;
        self.wait(side, (image.header.stamp, image.header.frame()), taken, (recorded, at));
        Ok(())
    }

    fn check_size(&self, found: [u32; 2]) -> Result<(), String> {
        if found == self.size {
            return Ok(());
        }
        let [expected, found] = [self.size, found].map(|[width, height]| format!("{width} x {height} pixels"));
        Err(format!("the camera has {expected}, the image {found}"))
    }

    fn wait(&mut self, side: Side, (header, frame): (Stamp, &str), image: CameraImage, (recorded, at): (Stamp, usize)) {
        let (stamp, is_unstamped) = stamp_or(header, recorded);
        let waiting = Waiting { stamp, is_unstamped, frame: frame.to_owned(), at, image };
        self.waiting[side as usize].push_back(waiting);
    }

    /// The clouds of the pairs that are complete; images that have waited for their partner in vain are noted.
    ///
    /// # Errors
    /// Why the images of the cameras are none of a pair, in words.
    pub(super) fn ended<'a>(
        &mut self,
        sensor_of: impl Fn(&str) -> Result<&'a Arc<SpaceSensor>, String>,
        notes: &mut Notes,
    ) -> Result<Vec<MadePair>, String> {
        let mut made = Vec::new();
        while let Some([left, right]) = self.next_pair(notes) {
            self.ask(&left, &right);
            if let Some(words) = &self.swapped {
                return Err(words.clone());
            }
            let sensor = sensor_of(&left.frame)?;
            let images = (&left.image.grey, &right.image.grey);
            let cloud = self.depth.cloud(images, (left.stamp, sensor), left.image.colours);
            let cloud = cloud.map_err(|error| error.to_string())?;
            made.push(MadePair { cloud, is_unstamped: left.is_unstamped });
        }
        Ok(made)
    }

    /// The images that still wait, noted.
    pub(super) fn finish(&mut self, notes: &mut Notes) {
        for side in [0, 1] {
            while let Some(alone) = self.waiting[side].pop_front() {
                self.note_alone(side, alone.at, notes);
            }
        }
    }

    fn next_pair(&mut self, notes: &mut Notes) -> Option<[Waiting; 2]> {
        loop {
            let [left, right] = [self.waiting[0].front(), self.waiting[1].front()].map(|first| first.map(|w| w.stamp));
            let alone = match (left, right) {
                (Some(left), Some(right)) if left.0.abs_diff(right.0) <= TOGETHER_NS => {
                    let pair = [self.waiting[0].pop_front()?, self.waiting[1].pop_front()?];
                    return Some(pair);
                }
                (Some(left), Some(right)) => usize::from(right < left),
                _ => (0..2).find(|side| self.waiting[*side].len() > WAITING_MOST)?,
            };
            let waiting = self.waiting[alone].pop_front()?;
            self.note_alone(alone, waiting.at, notes);
        }
    }

    fn note_alone(&self, side: usize, at: usize, notes: &mut Notes) {
        let missing = self.topics.get(1 - side).map_or("", String::as_str);
        let name = self.topics.get(side).map_or("", String::as_str);
        notes.note(NoteKind::WithoutPartner, name, at, || (format!("an image of {missing} within 5 ms"), "none"));
    }

    /// Whether the first pairs are pairs.
    fn ask(&mut self, left: &Waiting, right: &Waiting) {
        if self.asked[0] >= LOOKED_AT {
            return;
        }
        let Ok(pairing) = self.depth.pairing(&left.image.grey, &right.image.grey) else { return };
        self.asked[0] += 1;
        if pairing.words().is_empty() {
            return;
        }
        self.asked[1] += usize::from(pairing.is_swapped());
        let words = is_turned_words(&format!("{} and {}", self.topics[0], self.topics[1]), &pairing);
        if 2 * self.asked[1] > self.asked[0] {
            let type_this = format!(" (--topic {} --topic {})", self.topics[1], self.topics[0]);
            self.swapped = Some(words.clone() + &type_this);
        }
        if self.doubts.is_empty() {
            self.doubts.push(words);
        }
    }
}
