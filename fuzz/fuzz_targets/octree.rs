//! Any bytes as OctoMap's files: no panic, and an octree written anew reads back.
//! `cargo +nightly fuzz run octree -- -max_total_time=60`
#![no_main]

use libfuzzer_sys::fuzz_target;
use mapwright_voxel::Octree;

fuzz_target!(|bytes: &[u8]| {
    let mut bytes = bytes;
    let trees = [Octree::read_bt(&mut { bytes }), Octree::read_ot(&mut bytes)];
    for tree in trees.into_iter().flatten() {
        let (mut bt, mut ot) = (Vec::new(), Vec::new());
        tree.write_bt(&mut bt).expect("a vector does not fail");
        tree.write_ot(&mut ot).expect("a vector does not fail");
        assert!(Octree::read_bt(&mut bt.as_slice()).is_ok());
        assert_eq!(Octree::read_ot(&mut ot.as_slice()).expect("what is written can be read"), tree);
    }
});
