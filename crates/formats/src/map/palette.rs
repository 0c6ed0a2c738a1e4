//! What all pictures of maps have in common: colours and margins.

use super::canvas::{Colour, blend};

pub(super) const UNSEEN: Colour = [196, 207, 220];
pub(super) const FREE: Colour = [253, 253, 250];
pub(super) const WALL: Colour = [24, 30, 42];
pub(super) const INK: Colour = [52, 62, 78];
pub(super) const START: Colour = [34, 150, 84];
pub(super) const END: Colour = [212, 48, 40];

/// The way's colours from first to last pose, all of them dark enough for a white ground, and none of them the orange of what is uncertain.
const WAY: [Colour; 5] = [[18, 58, 150], [70, 44, 168], [126, 26, 160], [176, 20, 124], [206, 24, 76]];

/// Blank rim around the map, pixels.
pub(super) const MARGIN_PX: usize = 24;

/// The way's colour at a share of its time.
pub(super) fn way_colour(share: f32) -> Colour {
    let at = share.clamp(0.0, 1.0) * (WAY.len() - 1) as f32;
    let below = (at as usize).min(WAY.len() - 2);
    blend(WAY[below], WAY[below + 1], at - below as f32)
}
