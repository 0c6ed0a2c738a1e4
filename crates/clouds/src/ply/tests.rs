use super::*;
use proptest::prelude::*;

fn header(order: &str, count: usize, has_list: bool) -> String {
    let list = if has_list { "property list uchar short views\n" } else { "" };
    format!(
        "ply\nformat {order} 1.0\ncomment made here\nelement camera 2\nproperty list uchar int ids\nelement vertex {count}\n\
         property double x\nproperty float y\n{list}property float z\nproperty uchar red\nproperty uchar green\n\
         property uchar blue\nelement face 0\nproperty list uchar int vertex_indices\nend_header\n"
    )
}

fn binary(points: &[[f32; 3]], claimed: usize, is_big: bool, has_list: bool) -> Vec<u8> {
    let mut file =
        header(if is_big { "binary_big_endian" } else { "binary_little_endian" }, claimed, has_list).into_bytes();
    let mut put = |bytes: &[u8]| {
        if is_big {
            file.extend(bytes.iter().rev());
        } else {
            file.extend(bytes);
        }
    };
    put(&[1]);
    put(&7_i32.to_le_bytes());
    put(&[0]);
    for [x, y, z] in points {
        put(&f64::from(*x).to_le_bytes());
        put(&y.to_le_bytes());
        if has_list {
            put(&[2]);
            put(&3_i16.to_le_bytes());
            put(&4_i16.to_le_bytes());
        }
        put(&z.to_le_bytes());
        [1, 2, 3].iter().for_each(|byte| put(&[*byte]));
    }
    file
}

fn ascii(points: &[[f32; 3]], has_list: bool) -> Vec<u8> {
    let mut file = header("ascii", points.len(), has_list) + "1 7\n0\n";
    let list = if has_list { "2 3 4 " } else { "" };
    points.iter().for_each(|[x, y, z]| file += &format!("{x} {y} {list}{z} 1 2 3\n"));
    file.into_bytes()
}

fn same(a: &[[f32; 3]], b: &[[f32; 3]]) -> bool {
    a.len() == b.len() && a.iter().flatten().zip(b.iter().flatten()).all(|(a, b)| a == b || (a.is_nan() && b.is_nan()))
}

#[test]
fn promises_beyond_the_file_are_not_believed() {
    for has_list in [false, true] {
        let file = binary(&[[1.0, 2.0, 3.0]], usize::MAX, false, has_list);
        let mut notes = Notes::default();
        assert_eq!(read_ply("a.ply", &file, &mut notes).unwrap().points_m, [[1.0, 2.0, 3.0]]);
        assert_eq!(notes.kinds[&NoteKind::Truncated].first[0].offset_bytes as usize, file.len());
    }
    let text = "ply\nformat binary_little_endian 1.0\nelement camera 9999999999999\nproperty float f\nelement vertex 1\n\
        property float x\nproperty float y\nproperty float z\nend_header\n1234";
    let mut notes = Notes::default();
    assert_eq!(read_ply("a.ply", text.as_bytes(), &mut notes).unwrap().points_m.len(), 0);
    assert_eq!(notes.count(NoteKind::Truncated), 1);
}

#[test]
fn headers_that_are_none_are_said_so() {
    for (text, expected) in [
        ("plyy", "expected `ply`"),
        ("ply\nformat ascii 1.0\n", "`end_header`"),
        ("ply\nformat unary 1.0\nend_header\n", "a line of a PLY header"),
        ("ply\nproperty float x\nend_header\n", "a line of a PLY header"),
        ("ply\nend_header\n", "`format`"),
        ("ply\nformat ascii 1.0\nend_header\n", "`element vertex`"),
        ("ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n", "no y"),
    ] {
        let error = read_ply("a.ply", text.as_bytes(), &mut Notes::default()).unwrap_err().to_string();
        assert!(error.contains(expected), "{text}: {error}");
    }
}

proptest! {
    #[test]
    fn what_is_written_is_read(
        points in prop::collection::vec(prop::array::uniform3(prop::num::f32::ANY), 0..40),
        has_list: bool,
    ) {
        let files = [
            binary(&points, points.len(), false, has_list),
            binary(&points, points.len(), true, has_list),
            ascii(&points, has_list),
        ];
        for file in files {
            let mut notes = Notes::default();
            let read = read_ply("a.ply", &file, &mut notes).unwrap();
            prop_assert!(same(&read.points_m, &points));
            prop_assert!(read.colours.iter().all(|colour| *colour == [1, 2, 3]));
            prop_assert_eq!(notes, Notes::default());
        }
    }

    #[test]
    fn any_bytes(bytes: Vec<u8>, cut in 0..500_usize, at in 0..500_usize, byte: u8, has_list: bool) {
        let _ = read_ply("a.ply", &[b"ply\n".as_slice(), &bytes].concat(), &mut Notes::default());
        let points = [[1.0, 2.0, 3.0]; 5];
        for mut file in [binary(&points, 5, false, has_list), binary(&points, 5, true, has_list), ascii(&points, has_list)] {
            let at = at.min(file.len() - 1);
            file[at] = byte;
            file.truncate(file.len().saturating_sub(cut).max(1));
            let _ = read_ply("a.ply", &file, &mut Notes::default());
        }
    }
}
