//! How much of a map is there and how much is invented.

use crate::error::EvalError;

/// What a map says of a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum CellState {
    /// Never seen.
    #[default]
    Unknown,
    /// Nothing there.
    Free,
    /// Something there.
    Occupied,
}

/// Cells of a map, row by row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CellImage<'a> {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` cells, row by row.
    pub cells: &'a [CellState],
}

/// Agreement of a map's occupied cells with those of a reference.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct MapScore {
    /// Occupied cells of the reference.
    pub reference_occupied: usize,
    /// Those of them that the map has, within the tolerance.
    pub found: usize,
    /// Occupied cells of the map.
    pub map_occupied: usize,
    /// Those of them that the reference has, within the tolerance.
    pub justified: usize,
    /// Cells that both know: free or occupied in each.
    pub both_known: usize,
    /// Those of them on which both agree exactly.
    pub both_equal: usize,
}

impl MapScore {
    /// Share of the map's occupied cells that are in the reference; none where the map has none.
    #[must_use]
    pub fn precision(&self) -> Option<f64> {
        share(self.justified, self.map_occupied)
    }

    /// Share of the reference's occupied cells that are in the map; none where the reference has none.
    #[must_use]
    pub fn recall(&self) -> Option<f64> {
        share(self.found, self.reference_occupied)
    }

    /// Harmonic mean of precision and recall; zero where nothing agrees, none where one of them is missing.
    #[must_use]
    pub fn f1(&self) -> Option<f64> {
        let (precision, recall) = (self.precision()?, self.recall()?);
        Some(if precision + recall > 0.0 { 2.0 * precision * recall / (precision + recall) } else { 0.0 })
    }

    /// Share of the cells known to both on which both agree exactly, free ones included; none where there are none.
    #[must_use]
    pub fn accuracy(&self) -> Option<f64> {
        share(self.both_equal, self.both_known)
    }
}

fn share(part: usize, whole: usize) -> Option<f64> {
    (whole > 0).then(|| part as f64 / whole as f64)
}

/// Compares a map with a reference of the same area and cell size. An occupied cell agrees when the other image has one
/// at most `tolerance_cells` away in x and in y; one cell forgives a wall that falls on a cell's border.
///
/// A fair reference knows only what the sensor could see: rendered from the same scans at their true poses, say.
///
/// # Errors
/// When an image's slice does not fill it, or the images differ in size.
pub fn score_map(
    reference: &CellImage<'_>,
    map: &CellImage<'_>,
    tolerance_cells: usize,
) -> Result<MapScore, EvalError> {
    reference.check()?;
    map.check()?;
    if (reference.width, reference.height) != (map.width, map.height) {
        return Err(EvalError::ImageSizes {
            reference: (reference.width, reference.height),
            estimate: (map.width, map.height),
        });
    }
    let (reference_occupied, found) = reference.count_matched(map, tolerance_cells);
    let (map_occupied, justified) = map.count_matched(reference, tolerance_cells);
    let known = |(a, b): &(&CellState, &CellState)| **a != CellState::Unknown && **b != CellState::Unknown;
    let both: Vec<_> = reference.cells.iter().zip(map.cells).filter(known).collect();
    let both_equal = both.iter().filter(|(a, b)| a == b).count();
    Ok(MapScore { reference_occupied, found, map_occupied, justified, both_known: both.len(), both_equal })
}

impl CellImage<'_> {
    fn check(&self) -> Result<(), EvalError> {
        if self.width.checked_mul(self.height) == Some(self.cells.len()) {
            return Ok(());
        }
        Err(EvalError::BadImage { width: self.width, height: self.height, cells: self.cells.len() })
    }

    /// Occupied cells, and those with an occupied cell of `other` nearby.
    fn count_matched(&self, other: &CellImage<'_>, tolerance_cells: usize) -> (usize, usize) {
        let (mut occupied, mut matched) = (0, 0);
        for (place, cell) in self.cells.iter().enumerate() {
            if *cell == CellState::Occupied {
                occupied += 1;
                let nearby = other.has_occupied_near(place % self.width, place / self.width, tolerance_cells);
                matched += usize::from(nearby);
            }
        }
        (occupied, matched)
    }

    fn has_occupied_near(&self, x: usize, y: usize, tolerance_cells: usize) -> bool {
        let columns = window(x, tolerance_cells, self.width);
        window(y, tolerance_cells, self.height)
            .any(|row| columns.clone().any(|column| self.cells[row * self.width + column] == CellState::Occupied))
    }
}

fn window(centre: usize, reach: usize, end: usize) -> std::ops::Range<usize> {
    centre.saturating_sub(reach)..centre.saturating_add(reach).saturating_add(1).min(end)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cells(picture: &str) -> Vec<CellState> {
        picture
            .chars()
            .filter(|c| !c.is_whitespace())
            .map(|c| match c {
                '#' => CellState::Occupied,
                '.' => CellState::Free,
                _ => CellState::Unknown,
            })
            .collect()
    }

    fn score(reference: &str, map: &str, tolerance_cells: usize) -> MapScore {
        let (reference, map) = (cells(reference), cells(map));
        let image = |cells| CellImage { width: 5, height: 3, cells };
        score_map(&image(&reference), &image(&map), tolerance_cells).unwrap()
    }

    #[test]
    fn a_wall_one_cell_off_is_forgiven_and_an_invented_one_is_not() {
        let reference = "##### ..... ?????";
        let shifted = "..... ####. ?????";
        let invented = "##### ..... #####";
        assert_eq!(score(reference, reference, 0).f1(), Some(1.0));
        assert_eq!(score(reference, shifted, 1).f1(), Some(1.0));
        assert_eq!(score(reference, shifted, 0).f1(), Some(0.0));
        let score = score(reference, invented, 1);
        assert_eq!((score.precision(), score.recall(), score.accuracy()), (Some(0.5), Some(1.0), Some(1.0)));
    }

    #[test]
    fn empty_maps_have_no_score_and_odd_sizes_are_refused() {
        let nothing = score("..... ..... .....", "????? ????? ?????", 1);
        assert_eq!((nothing.precision(), nothing.recall(), nothing.f1(), nothing.accuracy()), (None, None, None, None));
        let image = |width, height, cells| CellImage { width, height, cells };
        let six = cells("...###");
        assert!(score_map(&image(2, 3, &six), &image(3, 2, &six), 1).is_err());
        assert!(score_map(&image(2, 2, &six), &image(2, 2, &six), 1).is_err());
        assert!(score_map(&image(usize::MAX, 2, &six), &image(2, 3, &six), 1).is_err());
        assert!(score_map(&image(0, 0, &[]), &image(0, 0, &[]), 9).is_ok());
    }
}
