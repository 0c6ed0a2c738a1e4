//! Which edges of a cell belong to one sheet of surface.

/// The ends of an edge of a cell as corners. Bit `k` of a corner is its place along axis `k`; edge `4 a + bu + 2 bv` runs along axis `a` and lies at `bu` along
/// axis `a + 1` and at `bv` along axis `a + 2`, counted in a circle.
pub(super) const fn ends(edge: usize) -> [usize; 2] {
    let axis = edge / 4;
    let low = (edge & 1) << ((axis + 1) % 3) | (edge >> 1 & 1) << ((axis + 2) % 3);
    [low, low | 1 << axis]
}

/// How the surface goes through a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Case {
    /// The sheet that each crossed edge belongs to.
    pub(super) sheet: [u8; 12],
    /// How many there are.
    pub(super) sheets: u8,
}

/// Not crossed.
pub(super) const NO_SHEET: u8 = u8::MAX;

/// All cases, by the corners that lie behind the surface, a bit each.
///
/// Crossed edges that a line on a face joins belong to one sheet. Where all four edges of a face are crossed, the lines go around the corners behind the surface, so
/// that two cells say the same of the face between them.
pub(super) fn all() -> [Case; 256] {
    std::array::from_fn(case)
}

fn case(behind: usize) -> Case {
    let is_crossed = |edge: usize| ends(edge).map(|corner| behind >> corner & 1).iter().sum::<usize>() == 1;
    let mut group: [usize; 12] = std::array::from_fn(|edge| edge);
    for face in 0..6 {
        let on_face: Vec<usize> = (0..12).filter(|&edge| is_on(edge, face) && is_crossed(edge)).collect();
        for (&a, &b) in on_face.iter().flat_map(|a| on_face.iter().map(move |b| (a, b))) {
            if a < b && (on_face.len() == 2 || shares_behind(a, b, behind)) {
                let (from, to) = (group[b], group[a]);
                group.iter_mut().filter(|it| **it == from).for_each(|it| *it = to);
            }
        }
    }
    let mut case = Case { sheet: [NO_SHEET; 12], sheets: 0 };
    for edge in (0..12).filter(|&edge| is_crossed(edge)) {
        let earlier = (0..edge).find(|&other| is_crossed(other) && group[other] == group[edge]);
        case.sheet[edge] = earlier.map_or(case.sheets, |other| case.sheet[other]);
        case.sheets += u8::from(earlier.is_none());
    }
    case
}

/// Whether an edge lies on a face: `2 k + side` of axis `k`.
fn is_on(edge: usize, face: usize) -> bool {
    ends(edge).iter().all(|corner| corner >> (face / 2) & 1 == face % 2)
}

fn shares_behind(a: usize, b: usize, behind: usize) -> bool {
    ends(a).iter().any(|corner| behind >> corner & 1 == 1 && ends(b).contains(corner))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_corner_is_one_sheet_and_opposite_corners_are_two() {
        let all = all();
        assert_eq!((all[0].sheets, all[255].sheets), (0, 0));
        assert!((0..8).all(|corner| all[1 << corner].sheets == 1 && all[255 ^ 1 << corner].sheets == 1));
        assert_eq!(all[0b1000_0001].sheets, 2);
        assert_eq!(all[0b0000_1001].sheets, 2, "two corners across a face, behind the surface: apart");
        assert_eq!(all[0b1111_0110].sheets, 1, "the same of corners before it: joined");
        assert_eq!(all[0b0110_1001].sheets, 4);
    }

    #[test]
    fn each_edge_has_its_ends() {
        let mut seen: Vec<_> = (0..12).map(ends).collect();
        assert!(seen.iter().all(|[a, b]| (a ^ b).count_ones() == 1 && a < b));
        seen.sort_unstable();
        seen.dedup();
        assert_eq!(seen.len(), 12);
    }
}
