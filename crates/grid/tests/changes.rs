//! Shares of the work that were counted beside a grid and taken in make the grid that counts all itself.

mod common;

use common::views;
use mapwright_geom::Pose2;
use mapwright_grid::{Change, Changes, CountGrid};
use mapwright_sim::worlds;
use proptest::prelude::*;

/// All that can be seen of a grid in the order it is seen.
fn seen(grid: &CountGrid) -> impl PartialEq + std::fmt::Debug + use<> {
    let cells: Vec<_> = grid.known_cells().collect();
    let slots: Vec<_> = (0..grid.slot_count() as u32).map(|slot| *grid.cell(slot)).collect();
    (cells, slots, grid.tile_count(), grid.to_bytes())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// Views are drawn, and some moved, by three who know nothing of each other; then all that moved are drawn anew.
    #[test]
    fn the_order_and_the_shares_do_not_matter(
        seed in 0..1000_u64,
        moves in proptest::collection::vec((0..12_usize, -3.0..3.0_f64, -3.0..3.0_f64, -3.2..3.2_f64, 0..3_usize), 0..30),
    ) {
        let views = views(&worlds::office_floor(seed).into(), seed, 3, 12);
        let mut poses: Vec<Pose2> = views.iter().map(|view| view.world_from_robot).collect();
        let mut lived = CountGrid::new(0.05);
        let mut listened = CountGrid::new(0.05);
        let mut shares: Vec<Changes> = (0..3).map(|_| Changes::new(0.05)).collect();
        for (k, (view, &pose)) in views.iter().zip(&poses).enumerate() {
            shares[k % 3].draw(&view.points, pose, Change::Add);
            listened.draw(&view.points, pose, Change::Add, &mut Vec::new());
        }
        lived.take_in(shares);
        prop_assert!(lived.to_bytes() == listened.to_bytes());

        let mut shares: Vec<Changes> = (0..3).map(|_| Changes::new(0.05)).collect();
        for (k, x, y, theta, share) in moves {
            shares[share].draw(&views[k].points, poses[k], Change::Remove);
            poses[k] = Pose2::new(x, y, theta);
            shares[(share + k) % 3].draw(&views[k].points, poses[k], Change::Add);
        }
        lived.take_in(shares);
        lived.compact();
        let mut scratch = CountGrid::new(0.05);
        for (view, &pose) in views.iter().zip(&poses) {
            scratch.draw(&view.points, pose, Change::Add, &mut Vec::new());
        }
        prop_assert!(lived.to_bytes() == scratch.to_bytes());
        scratch.compact();
        prop_assert!(seen(&lived) == seen(&scratch));
    }
}

#[test]
fn what_was_counted_in_and_out_leaves_nothing() {
    let views = views(&worlds::office_floor(1).into(), 1, 3, 6);
    let mut grid = CountGrid::new(0.05);
    for change in [Change::Add, Change::Remove] {
        let mut share = Changes::new(0.05);
        views.iter().for_each(|view| share.draw(&view.points, view.world_from_robot, change));
        grid.take_in(vec![share]);
        assert_eq!(grid.to_bytes().is_empty(), change == Change::Remove);
    }
    grid.compact();
    assert_eq!((grid.tile_count(), grid.slot_count()), (0, 0));
}
