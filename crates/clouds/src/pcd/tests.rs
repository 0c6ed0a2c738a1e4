use super::*;
use proptest::prelude::*;

const HEADER: &str = "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z rgb t\nSIZE 4 8 4 4 4\nTYPE F F F F U\nCOUNT 1 1 1 1 1\n";

fn record(point: [f32; 3], rgb: u32, t: u32) -> Vec<u8> {
    let mut bytes = point[0].to_le_bytes().to_vec();
    bytes.extend(f64::from(point[1]).to_le_bytes());
    bytes.extend(point[2].to_le_bytes());
    bytes.extend(rgb.to_le_bytes());
    bytes.extend(t.to_le_bytes());
    bytes
}

fn binary(points: &[[f32; 3]], claimed: usize) -> Vec<u8> {
    let mut file = format!("{HEADER}WIDTH {claimed}\nHEIGHT 1\nPOINTS {claimed}\nDATA binary\n").into_bytes();
    points.iter().enumerate().for_each(|(at, point)| file.extend(record(*point, 0xffff_8001, at as u32)));
    file
}

/// As it would be compressed by a writer that finds nothing twice.
fn compressed(points: &[[f32; 3]]) -> Vec<u8> {
    let records: Vec<Vec<u8>> = points.iter().map(|point| record(*point, 0xffff_8001, 7)).collect();
    let columns: Vec<u8> = [0..4, 4..12, 12..16, 16..20, 20..24]
        .into_iter()
        .flat_map(|part| records.iter().flat_map(move |record| record[part.clone()].to_vec()))
        .collect();
    let packed: Vec<u8> = columns.chunks(32).flat_map(|c| [&[c.len() as u8 - 1], c].concat()).collect();
    let mut file =
        format!("{HEADER}WIDTH {0}\nHEIGHT 1\nPOINTS {0}\nDATA binary_compressed\n", points.len()).into_bytes();
    file.extend((packed.len() as u32).to_le_bytes());
    file.extend((columns.len() as u32).to_le_bytes());
    file.extend(packed);
    file
}

fn ascii(points: &[[f32; 3]]) -> Vec<u8> {
    let mut file = format!("{HEADER}WIDTH {0}\nHEIGHT 1\nDATA ascii\n", points.len());
    let rgb = f32::from_bits(0x00ff_8001);
    points.iter().enumerate().for_each(|(at, [x, y, z])| file += &format!("{x} {y} {z} {rgb:e} {at}\n"));
    file.into_bytes()
}

fn same(a: &[[f32; 3]], b: &[[f32; 3]]) -> bool {
    a.len() == b.len() && a.iter().flatten().zip(b.iter().flatten()).all(|(a, b)| a == b || (a.is_nan() && b.is_nan()))
}

#[test]
fn a_truncated_file_gives_what_came_before() {
    let file = binary(&[[1.0; 3], [2.0; 3]], 1 << 40);
    let mut notes = Notes::default();
    let points = read_pcd("a.pcd", &file, &mut notes).unwrap();
    assert_eq!(points.points_m, [[1.0; 3], [2.0; 3]]);
    let note = &notes.kinds[&NoteKind::Truncated].first[0];
    assert_eq!((note.offset_bytes as usize, note.found.as_str()), (file.len(), "2"));
    let points = read_pcd("a.pcd", &file[..file.len() - 1], &mut notes).unwrap();
    assert_eq!(points.points_m.len(), 1);
}

#[test]
fn headers_that_are_none_are_said_so() {
    for (text, expected) in [
        ("", "a PCD header with DATA"),
        ("# .PCD\nHELLO\n", "a line of a PCD header"),
        ("FIELDS x y\nSIZE 4 4\nTYPE F F\nPOINTS 1\nDATA ascii\n", "FIELDS with x, y and z"),
        ("FIELDS x y z\nSIZE 4 4\nTYPE F F\nPOINTS 1\nDATA ascii\n", "SIZE and TYPE of each field"),
        ("FIELDS x\nSIZE 4\nTYPE F\nCOUNT 99999999999\nPOINTS 1\nDATA ascii\n", "COUNT of each field"),
        ("FIELDS x\nSIZE 4\nTYPE F\nDATA ascii\n", "POINTS, or WIDTH and HEIGHT"),
        ("FIELDS x\nSIZE 4\nTYPE F\nPOINTS 1\nDATA zipped\n", "DATA ascii"),
        ("FIELDS x\nSIZE 4\nTYPE F\nPOINTS 9\nDATA binary_compressed\n\0\0", "two lengths"),
    ] {
        let error = read_pcd("a.pcd", text.as_bytes(), &mut Notes::default()).unwrap_err().to_string();
        assert!(error.contains(expected), "{text}: {error}");
    }
}

#[test]
fn bad_rows_and_organised_clouds() {
    let text = "VERSION .7\nFIELDS x y z _\nSIZE 4 4 4 1\nTYPE F F F U\nCOUNT 1 1 1 2\nWIDTH 2\nHEIGHT 2\n\
        VIEWPOINT 1 0 0 1 0 0 0\nPOINTS 4\nDATA ascii\n1 2 3 0 0\nnan nan nan 0 0\n1 2 x 0 0\n1 2 3\n";
    let mut notes = Notes::default();
    let points = read_pcd("a.pcd", text.as_bytes(), &mut notes).unwrap();
    assert!(same(&points.points_m, &[[1.0, 2.0, 3.0], [f32::NAN; 3]]), "{points:?}");
    assert_eq!((notes.count(NoteKind::BadRow), notes.count(NoteKind::Viewpoint)), (2, 1));
}

#[test]
fn a_field_of_no_numbers_is_nothing() {
    for data in ["ascii\n1 2 3\n".to_owned(), "binary\n".to_owned() + &"\0".repeat(12)] {
        let text = format!("FIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 0\nPOINTS 1\nDATA {data}");
        assert_eq!(read_pcd("a.pcd", text.as_bytes(), &mut Notes::default()).unwrap().points_m.len(), 1);
    }
}

proptest! {
    #[test]
    fn what_is_written_is_read(points in prop::collection::vec(prop::array::uniform3(prop::num::f32::ANY), 0..40)) {
        for file in [binary(&points, points.len()), compressed(&points), ascii(&points)] {
            let mut notes = Notes::default();
            let read = read_pcd("a.pcd", &file, &mut notes).unwrap();
            prop_assert!(same(&read.points_m, &points));
            prop_assert!(read.colours.iter().all(|colour| *colour == [0xff, 0x80, 0x01]));
            prop_assert_eq!(read.times.len(), points.len());
            prop_assert_eq!(notes, Notes::default());
        }
    }

    #[test]
    fn any_bytes(bytes: Vec<u8>, cut in 0..400_usize, at in 0..400_usize, byte: u8) {
        let _ = read_pcd("a.pcd", &bytes, &mut Notes::default());
        let points = [[1.0, 2.0, 3.0]; 5];
        for mut file in [binary(&points, 5), compressed(&points), ascii(&points)] {
            let at = at.min(file.len() - 1);
            file[at] = byte;
            file.truncate(file.len().saturating_sub(cut).max(1));
            let _ = read_pcd("a.pcd", &file, &mut Notes::default());
        }
    }
}
