#![allow(clippy::unwrap_used)]
use super::*;
use crate::occupancy::{Occupancy, OccupancySettings};
use crate::surfel_map::Change;
use mapwright_geom::Pose3;
use proptest::prelude::*;

fn room(points_m: &[[f32; 3]]) -> Occupancy {
    let mut occupancy = Occupancy::new(OccupancySettings { resolution_m: 0.5, max_range_m: 40.0 });
    occupancy.draw(points_m.iter().copied(), [0.1; 3], Pose3::identity(), Change::Add);
    occupancy
}

/// A wall that is seen without gaps, and free space before it.
fn wall() -> Occupancy {
    let across = || (-40..40).map(|k| 0.25 + 0.5 * k as f32);
    let points: Vec<_> = across().flat_map(|y| across().map(move |z| [10.2, 0.25 * y, 0.25 * z])).collect();
    room(&points)
}

fn written(tree: &Octree) -> [Vec<u8>; 2] {
    let (mut bt, mut ot) = (Vec::new(), Vec::new());
    tree.write_bt(&mut bt).unwrap();
    tree.write_ot(&mut ot).unwrap();
    [bt, ot]
}

fn read_bt(mut bytes: &[u8]) -> Result<Octree, OctreeError> {
    Octree::read_bt(&mut bytes)
}

fn read_ot(mut bytes: &[u8]) -> Result<Octree, OctreeError> {
    Octree::read_ot(&mut bytes)
}

#[test]
fn a_tree_says_of_every_voxel_what_counts_say() {
    let occupancy = wall();
    let [full, simple] = [Leaves::LogOdds, Leaves::MostLikely].map(|leaves| Octree::of(&occupancy, leaves));
    let mut voxels = 0_u64;
    for voxel in occupancy.voxels() {
        let at_m = voxel.index.map(|v| (f64::from(v) + 0.5) * 0.5);
        assert_eq!(full.log_odds_at(at_m, 16), Some(voxel.log_odds()));
        let state = if voxel.log_odds() > 0.0 { State::Occupied } else { State::Free };
        assert_eq!((full.state_at(at_m, 16), simple.state_at(at_m, 16)), (state, state));
        voxels += 1;
    }
    let volume = |tree: &Octree| tree.leaves().map(|leaf| u64::from(leaf.side).pow(3)).sum::<u64>();
    assert_eq!((volume(&full), volume(&simple)), (voxels, voxels));
    assert!(simple.leaves().any(|leaf| leaf.side > 1), "what is the same is one");
    assert_eq!(simple, full.most_likely());
    assert_eq!(Octree::left_out(&occupancy), 0);
}

#[test]
fn coarser_cubes_are_occupied_where_any_of_them_is() {
    let tree = Octree::of(&room(&[[3.3, 0.1, 0.1]]), Leaves::LogOdds);
    let [before, end, beside] = [[2.8, 0.1, 0.1], [3.3, 0.1, 0.1], [3.3, 0.6, 0.1]];
    assert_eq!([before, end, beside].map(|at| tree.state_at(at, 16)), [State::Free, State::Occupied, State::Unknown]);
    assert_eq!([before, end, beside].map(|at| tree.state_at(at, 15)), [State::Free, State::Occupied, State::Occupied]);
    assert_eq!([before, end, beside].map(|at| tree.state_at(at, 0)), [State::Occupied; 3]);
    assert_eq!(tree.state_at([f64::NAN, 0.0, 0.0], 16), State::Unknown);
    assert_eq!(tree.state_at([1e5, 0.0, 0.0], 3), State::Unknown);
}

#[test]
fn nothing_known_is_a_file_as_well() {
    let tree = Octree::of(&room(&[]), Leaves::LogOdds);
    let [bt, ot] = written(&tree);
    assert_eq!((read_bt(&bt).unwrap(), read_ot(&ot).unwrap()), (tree.clone(), tree));
}

#[test]
fn a_world_that_is_all_the_same_survives_the_binary_file() {
    let ot = [b"# Octomap OcTree file\nid OcTree\nsize 1\nres 1\ndata\n".as_slice(), &(-1.0_f32).to_le_bytes(), &[0]]
        .concat();
    let tree = read_ot(&ot).unwrap();
    let [bt, _] = written(&tree);
    let back = read_bt(&bt).unwrap();
    assert_eq!((tree.node_count(), back.node_count()), (1, 9));
    assert_eq!(back.state_at([5.0, -7.0, 9.0], 16), State::Free);
}

#[test]
fn errors_say_where_and_what() {
    let head = "# Octomap OcTree binary file\n# a comment\nid OcTree\nsize 9\nres 0.1\nwhatever\ndata\n";
    let told = |bytes: &[u8]| read_bt(bytes).unwrap_err().to_string();
    let with = |old: &str, new: &str, data: &[u8]| told(&[head.replace(old, new).as_bytes(), data].concat());
    let at = head.len();
    assert_eq!(told(b"solid cube"), "byte 0: expected the line \"# Octomap OcTree binary file\"");
    assert_eq!(told(b"# Octomap OcTree file\n"), "byte 0: expected the line \"# Octomap OcTree binary file\"");
    assert_eq!(told(&head.as_bytes()[..60]), "byte 60: expected the line \"data\", found the end of the file");
    assert_eq!(with("id OcTree", "id Colour", b""), "byte 41: expected a tree of kind OcTree, found \"id Colour\"");
    assert_eq!(
        with("res 0.1", "res -1", b""),
        "byte 58: expected a voxel's side in metres, above zero, found \"res -1\""
    );
    assert_eq!(with("size 9", "size x", b""), "byte 51: expected the number of nodes, found \"size x\"");
    assert_eq!(with("id OcTree\n", "", b""), "byte 65: expected a line \"id\" before, found \"data\"");
    assert_eq!(with("", "", &[3]), format!("byte {}: expected two bytes of a node, found the end of the file", at + 1));
    assert_eq!(with("", "", &[0, 0]), format!("byte {at}: expected a node with children, found one without"));
    assert_eq!(with("", "", &[1, 0]), "the header says 9 nodes, found 2");
    assert_eq!(with("", "", &[1, 0, 7]), format!("byte {}: expected the end of the file, found 1 bytes more", at + 2));
    let deep = [3, 0].repeat(20);
    assert_eq!(with("", "", &deep), format!("byte {}: expected 16 levels at most, found more", at + 30));
    let ot =
        [b"# Octomap OcTree file\nid OcTree\nsize 1\nres 1\ndata\n".as_slice(), &f32::NAN.to_le_bytes(), &[0]].concat();
    assert_eq!(
        read_ot(&ot).unwrap_err().to_string(),
        "byte 50: expected the logarithm of odds, found no finite number"
    );
    let deep = [0, 0, 0, 0, 1].repeat(20);
    let ot = [b"# Octomap OcTree file\nid OcTree\nsize 17\nres 1\ndata\n".as_slice(), &deep].concat();
    assert_eq!(read_ot(&ot).unwrap_err().to_string(), "byte 131: expected 16 levels at most, found more");
}

fn any_room() -> impl Strategy<Value = Occupancy> {
    prop::collection::vec([-30.0_f32..30.0, -30.0..30.0, -9.0..9.0], 0..60).prop_map(|points| room(&points))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn files_say_what_the_tree_says(occupancy in any_room()) {
        for leaves in [Leaves::LogOdds, Leaves::MostLikely] {
            let tree = Octree::of(&occupancy, leaves);
            let [bt, ot] = written(&tree);
            prop_assert_eq!(&read_ot(&ot).unwrap(), &tree);
            prop_assert_eq!(read_bt(&bt).unwrap(), tree.most_likely());
            let mut direct = Vec::new();
            let counts = write_bt(&occupancy, &mut direct).unwrap();
            let simple = tree.most_likely();
            prop_assert!(direct == bt, "written without a tree");
            let occupied = simple.leaves().filter(Leaf::is_occupied).count();
            prop_assert_eq!((counts.nodes, counts.occupied), (simple.node_count(), occupied));
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn any_bytes_are_read_or_refused(data in prop::collection::vec(any::<u8>(), 0..400), size in 0..60_u64, has_head in any::<bool>()) {
        for (kind, is_bt) in [("# Octomap OcTree binary file", true), ("# Octomap OcTree file", false)] {
            let head = format!("{kind}\nid OcTree\nsize {size}\nres 0.1\ndata\n");
            let bytes = if has_head { [head.as_bytes(), &data].concat() } else { data.clone() };
            if let Ok(tree) = if is_bt { read_bt(&bytes) } else { read_ot(&bytes) } {
                prop_assert!(tree.leaves().count() <= tree.node_count());
                prop_assert!(read_bt(&written(&tree)[0]).is_ok());
            }
        }
    }

    #[test]
    fn a_damaged_file_is_read_or_refused(at in 0..4000_usize, to in any::<u8>(), cut in 0..4000_usize) {
        let tree = Octree::of(&room(&[[3.3, 0.1, 0.1], [-7.0, 2.0, 1.0]]), Leaves::LogOdds);
        for (number, mut bytes) in written(&tree).into_iter().enumerate() {
            let length = bytes.len();
            bytes[at % length] = to;
            bytes.truncate(cut.max(1) % (2 * length));
            let read = if number == 0 { read_bt(&bytes) } else { read_ot(&bytes) };
            prop_assert!(read.is_err() || read.unwrap().leaves().count() > 0);
        }
    }
}
