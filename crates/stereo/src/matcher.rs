//! From two images to disparities.

use crate::census::{Costs, Padded, Planes, WINDOW};
use crate::clean::Cleaner;
use crate::disparity::DisparityMap;
use crate::error::StereoError;
use crate::image::GreyImage;
use crate::lanes::{Kernel, LANES, Lanes, lanes_for, run};
use crate::paths::{Front, PATHS, PassRow};
use crate::penalties::{Penalties, SMALL};
use crate::refine::Refined;
use crate::winners::{Choose, Keep, Winner};

/// Pixels times disparities, at most: costs and sums take a byte each.
const CELLS_MOST: u64 = 1 << 31;
/// Without a distance given, the nearest thing is seen by an eighth of the image's width apart, as in OpenCV's examples: at a field of view
/// of 60 degrees, that is 7 baselines away.
const WIDTH_SHARE: u32 = 8;
/// Pixels to the left and right whose costs say where the minimum is, of three rows: together some 500 bits.
const ACROSS: usize = 2;

/// How images are matched.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MatcherSettings {
    /// Disparities that are looked at, from 0 on; what is nearer than the last of them is not seen. `None` is an eighth of the
    /// image's width; [`StereoCamera::disparities_for`](crate::StereoCamera::disparities_for) says how many a distance takes.
    pub disparities: Option<u32>,
    /// The best disparity costs at most so much of what any other one costs that is not beside it, from 0 to 1: 1 takes all, 0.95
    /// leaves out what is ambiguous.
    pub uniqueness: f32,
    /// Disparities of the same point, as the left and the right image have it, differ by no more pixels.
    pub left_right_px: u16,
    /// Patches of fewer pixels than this stand for nothing, and are left out.
    pub patch_px: u32,
}

impl Default for MatcherSettings {
    /// Patches have at least the pixels that one of them was compared by.
    fn default() -> Self {
        Self { disparities: None, uniqueness: 1.0, left_right_px: 2, patch_px: WINDOW as u32 }
    }
}

/// Matches rectified pairs; its memory is used again from one pair to the next.
///
/// Semi-global matching (Hirschmueller, PAMI 30(2), 2008) along eight paths, of the census of 7 x 5 pixels. All costs are integers, so that
/// the same images give the same bytes everywhere.
#[derive(Debug)]
pub struct Matcher {
    settings: MatcherSettings,
    images: [Padded; 2],
    left: Planes,
    right: Planes,
    mirrored: Planes,
    costs: Vec<u8>,
    sums: Vec<u8>,
    of_rows: Vec<u8>,
    front: Front,
    large: [Vec<u8>; PATHS],
    of_pixel: [Vec<u8>; 2],
    winners: Vec<Winner>,
    refined: Refined,
    claims: Vec<Claim>,
    cleaner: Cleaner,
}

/// Sizes of a match.
#[derive(Debug, Clone, Copy)]
struct Extent {
    width: usize,
    height: usize,
    /// Disparities that are asked for.
    asked: usize,
    /// The same in whole lanes.
    disparities: usize,
}

/// The pixel of the left image that a pixel of the right one belongs to: of all that chose it, the one that costs least.
#[derive(Debug, Clone, Copy)]
struct Claim {
    least: u16,
    disparity: u16,
}

impl Matcher {
    /// A matcher that has seen no images yet.
    ///
    /// # Errors
    /// [`StereoError::Settings`] names a setting that cannot be.
    pub fn new(settings: MatcherSettings) -> Result<Self, StereoError> {
        if settings.disparities.is_some_and(|disparities| disparities < 2) {
            return Err(refused("disparities", "2 at least", settings.disparities.unwrap_or(0)));
        }
        if !(0.0..=1.0).contains(&settings.uniqueness) {
            return Err(refused("uniqueness", "a share from 0 to 1", settings.uniqueness));
        }
        Ok(Self {
            settings,
            images: Default::default(),
            left: Planes::default(),
            right: Planes::default(),
            mirrored: Planes::default(),
            costs: Vec::new(),
            sums: Vec::new(),
            of_rows: Vec::new(),
            front: Front::default(),
            large: Default::default(),
            of_pixel: Default::default(),
            winners: Vec::new(),
            refined: Refined::default(),
            claims: Vec::new(),
            cleaner: Cleaner::default(),
        })
    }

    /// Finds the disparity of each pixel of the left image: NaN where it is seen by the left camera only, nearer than what was
    /// looked for, or not told from what else it may be.
    ///
    /// # Errors
    /// [`StereoError::Size`] where the images have not the same size, [`StereoError::Settings`] where the disparities that are asked for do
    /// not fit them.
    pub fn match_pair(
        &mut self,
        left: &GreyImage,
        right: &GreyImage,
        out: &mut DisparityMap,
    ) -> Result<(), StereoError> {
        let extent = self.extent(left.size(), right.size())?;
        self.make_room(extent);
        self.images[0].set(left);
        self.images[1].set(right);
        let penalties = Penalties::of(&self.images[0], extent.width, extent.height);
        out.reset(left.size());
        self.down(extent, penalties);
        self.up(extent, penalties, out);
        self.cleaner.median(out);
        self.cleaner.speckles(out, self.settings.patch_px as usize);
        self.cleaner.holes(out);
        Ok(())
    }

    fn extent(&self, left: [u32; 2], right: [u32; 2]) -> Result<Extent, StereoError> {
        if left != right {
            return Err(StereoError::Size { what: "right image", expected: left, found: right });
        }
        let [width, height] = left;
        let asked = self.settings.disparities.unwrap_or((width / WIDTH_SHARE).max(2));
        if asked >= width {
            let expected = format!("fewer than the image's {width} columns");
            return Err(refused("disparities", expected, asked));
        }
        let [width, height, asked] = [width, height, asked].map(|count| count as usize);
        let disparities = lanes_for(asked);
        let cells = (width * height) as u64 * disparities as u64;
        if cells > CELLS_MOST {
            let expected = format!("at most {CELLS_MOST} pixels times disparities");
            return Err(refused("disparities", expected, format!("{asked} of {width} x {height} pixels")));
        }
        Ok(Extent { width, height, asked, disparities })
    }

    fn make_room(&mut self, extent: Extent) {
        let Extent { width, height, disparities, .. } = extent;
        for volume in [&mut self.costs, &mut self.sums] {
            volume.resize(width * height * disparities, 0);
        }
        for room in &mut self.of_pixel {
            room.resize(disparities, 0);
        }
        self.winners.resize(width, Winner::default());
    }

    /// The first pass: costs of all pixels, and their sums along the paths that run down the image.
    fn down(&mut self, extent: Extent, penalties: Penalties) {
        let Extent { width, height, asked, disparities } = extent;
        let row_len = width * disparities;
        self.front.reset(width, disparities);
        for y in 0..height {
            let (costs, sums) = (&mut self.costs[y * row_len..][..row_len], &mut self.sums[y * row_len..][..row_len]);
            self.left.set(&self.images[0], y);
            self.right.set(&self.images[1], y);
            self.right.mirror(width, disparities, &mut self.mirrored);
            run(Costs { left: &self.left, right: &self.mirrored, width, asked, disparities, costs: &mut *costs });
            penalties.set_row(&self.images[0], y, false, &mut self.large);
            run(PassRow {
                front: &mut self.front,
                costs,
                disparities,
                small: SMALL,
                large: &self.large,
                turned: false,
                sums: &mut self.of_pixel[0],
                sink: Keep { sums },
            });
            self.front.next_row();
        }
    }

    /// The second pass: sums along the paths that run up the image, and what all of them say.
    fn up(&mut self, extent: Extent, penalties: Penalties, out: &mut DisparityMap) {
        let Extent { width, height, disparities, .. } = extent;
        let row_len = width * disparities;
        self.front.reset(width, disparities);
        for y in (0..height).rev() {
            penalties.set_row(&self.images[0], y, true, &mut self.large);
            let [sums, totals] = &mut self.of_pixel;
            let first = &self.sums[y * row_len..][..row_len];
            run(PassRow {
                front: &mut self.front,
                costs: &self.costs[y * row_len..][..row_len],
                disparities,
                small: SMALL,
                large: &self.large,
                turned: true,
                sums,
                sink: Choose {
                    first,
                    is_second_asked: self.settings.uniqueness < 1.0,
                    totals,
                    found: &mut self.winners,
                },
            });
            self.front.next_row();
            self.claim();
            let row = y * width..(y + 1) * width;
            self.add_rows(extent, y);
            self.settle(extent, &mut out.disparity[row.clone()], &mut out.sigma[row]);
        }
    }

    /// Each pixel of the right image belongs to one of the left.
    fn claim(&mut self) {
        self.claims.clear();
        self.claims.resize(self.winners.len(), Claim { least: u16::MAX, disparity: 0 });
        for (x, Winner { disparity, least, .. }) in self.winners.iter().enumerate() {
            let claim = x.checked_sub(usize::from(*disparity)).map(|x| &mut self.claims[x]);
            if let Some(claim) = claim.filter(|claim| *least < claim.least) {
                *claim = Claim { least: *least, disparity: *disparity };
            }
        }
    }

    /// What is known of each pixel of a row.
    fn settle(&mut self, extent: Extent, disparities: &mut [f32], sigmas: &mut [f32]) {
        let MatcherSettings { uniqueness, left_right_px, .. } = self.settings;
        self.refined.reset(extent.width);
        for x in 0..extent.width {
            let winner = self.winners[x];
            let Some(in_right) = x.checked_sub(usize::from(winner.disparity)) else { continue };
            let is_same = self.claims[in_right].disparity.abs_diff(winner.disparity) <= left_right_px;
            // the best of those looked at may be a slope towards what was not
            let is_within = usize::from(winner.disparity) + 1 < extent.asked;
            if is_same && is_within && winner.is_unique(uniqueness) {
                let costs = self.around(extent, x, usize::from(winner.disparity));
                self.refined.set(x, winner, costs);
            }
        }
        self.refined.write(disparities, sigmas);
    }

    /// Sums the costs of three rows.
    fn add_rows(&mut self, extent: Extent, y: usize) {
        let row_len = extent.width * extent.disparities;
        let row = |y: usize| &self.costs[y * row_len..][..row_len];
        let rows = [row(y.saturating_sub(1)), row(y), row((y + 1).min(extent.height - 1))];
        self.of_rows.resize(row_len + LANES, 0);
        run(AddRows { rows, sums: &mut self.of_rows[..row_len] });
    }

    /// Costs of the disparities below, at and above one, summed over the pixels around one.
    #[inline]
    fn around(&self, extent: Extent, x: usize, disparity: usize) -> [u16; 3] {
        let Extent { width, disparities, .. } = extent;
        let (mut even, mut odd) = (0_u32, 0_u32);
        let from = x.saturating_sub(ACROSS);
        let sums = &self.of_rows[from * disparities + disparity.saturating_sub(1)..];
        for k in 0..(x + ACROSS + 1).min(width) - from {
            // four bytes at once: the row has room for what is read beyond the third
            if let Some(costs) = sums[k * disparities..].first_chunk::<4>() {
                let costs = u32::from_le_bytes(*costs);
                even += costs & 0x00ff_00ff;
                odd += (costs >> 8) & 0x00ff_00ff;
            }
        }
        [even as u16, odd as u16, (even >> 16) as u16]
    }
}

/// Sums three rows of costs: of three bytes of bits no sum is more than a byte.
struct AddRows<'a> {
    rows: [&'a [u8]; 3],
    sums: &'a mut [u8],
}

impl Kernel for AddRows<'_> {
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let sums = self.sums.as_chunks_mut::<LANES>().0;
        let [a, b, c] = self.rows;
        let (a, b, c) = (a.as_chunks::<LANES>().0, b.as_chunks::<LANES>().0, c.as_chunks::<LANES>().0);
        let (a, b, c) = (&a[..sums.len()], &b[..sums.len()], &c[..sums.len()]);
        for lane in 0..sums.len() {
            let two = lanes.add_bytes(lanes.bytes(&a[lane]), lanes.bytes(&b[lane]));
            lanes.store_bytes(lanes.add_bytes(two, lanes.bytes(&c[lane])), &mut sums[lane]);
        }
    }
}

impl Winner {
    /// `second` is in quarters of what all paths cost, `least` in halves.
    fn is_unique(&self, uniqueness: f32) -> bool {
        uniqueness >= 1.0 || f32::from(self.least) <= uniqueness * 2.0 * f32::from(self.second)
    }
}

fn refused(setting: &'static str, expected: impl Into<String>, found: impl ToString) -> StereoError {
    StereoError::Settings { setting, expected: expected.into(), found: found.to_string() }
}
