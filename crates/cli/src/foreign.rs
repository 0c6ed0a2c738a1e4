//! What a file is, told by its first bytes: said where it is given to a command that does not read it.

use mapwright_formats::{Excerpt, open_log};
use std::borrow::Cow;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// So many bytes tell what a file is.
pub(crate) const HEAD_BYTES: u64 = 4096;

/// A kind of file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Kind {
    what: Cow<'static, str>,
    /// What reads it, with `FILE` for its name.
    remedy: &'static str,
}

/// Beginnings of files that are no text, each with what it is and what can be done.
const BYTES: [(&[u8], &str, &str); 25] = [
    (b"\x89PNG\r\n\x1a\n", "a PNG picture", ""),
    (b"\xff\xd8\xff", "a JPEG picture", ""),
    (b"GIF8", "a GIF picture", ""),
    (b"II*\0", "a TIFF picture", ""),
    (b"MM\0*", "a TIFF picture", ""),
    (b"P5\n", "a PGM picture, as maps are", ""),
    (b"P6\n", "a PPM picture", ""),
    (b"%PDF", "a PDF document", ""),
    (b"PK\x03\x04", "a ZIP archive", "unpack it first"),
    (b"7z\xbc\xaf\x27\x1c", "a 7z archive", "unpack it first"),
    (b"\xfd7zXZ\0", "a file compressed by xz", "unpack it first: xz -d FILE"),
    (b"\x04\x22\x4d\x18", "a file compressed by lz4", "unpack it first: lz4 -d FILE"),
    (b"\x7fELF", "a program (ELF)", ""),
    (b"\x89HDF", "an HDF5 file", ""),
    (
        b"\xdb\x01\xf5\x5b\x7b\x1f\x1d\x7b",
        "a Cartographer state (pbstream)",
        "its trajectory can be compared once it is exported as TUM",
    ),
    (b"ply\n", "a cloud as PLY", "a name that ends in .ply is mapped: mapwright map FILE.ply -o OUT"),
    (b"ply\r\n", "a cloud as PLY", "a name that ends in .ply is mapped: mapwright map FILE.ply -o OUT"),
    (b"# .PCD", "a cloud as PCD", "a name that ends in .pcd is mapped: mapwright map FILE.pcd -o OUT"),
    (
        b"\xd4\xc3\xb2\xa1",
        "a capture of packets",
        "a name that ends in .pcap is mapped: mapwright map FILE.pcap -o OUT",
    ),
    (
        b"\x0a\x0d\x0d\x0a",
        "a capture of packets",
        "a name that ends in .pcap is mapped: mapwright map FILE.pcap -o OUT",
    ),
    (
        b"livox_tech",
        "a Livox's recording (LVX)",
        "convert it first: roslaunch livox_ros_driver lvx_to_rosbag.launch lvx_file_path:=FILE, whose bag is mapped",
    ),
    (b"LASF", "a cloud as LAS", "convert it to PLY or PCD first"),
    (b"\xff\xfe", "text as UTF-16", "convert it first: iconv -f UTF-16 -t UTF-8 FILE"),
    (b"\xfe\xff", "text as UTF-16", "convert it first: iconv -f UTF-16 -t UTF-8 FILE"),
    (
        b"mapwright session\n",
        "a session of mapwright",
        "give its folder of results to `mapwright export`, or to `mapwright map` as --resume",
    ),
];

const JSON: &str = "JSON";

/// Beginnings of texts.
const TEXTS: [(&str, &str, &str); 7] = [
    ("version https://git-lfs", "a Git LFS pointer, not the data", "fetch the data: git lfs pull"),
    ("<!DOCTYPE", "a web page, not the data", ""),
    ("<html", "a web page, not the data", ""),
    ("<?xml", "an XML document", ""),
    ("{", JSON, ""),
    ("image:", "what says where a map lies (map.yaml)", ""),
    ("VERSION .7", "a cloud as PCD", "a name that ends in .pcd is mapped: mapwright map FILE.pcd -o OUT"),
];

const GRAPH_TAGS: [&str; 10] = [
    "VERTEX_SE2",
    "VERTEX2",
    "EDGE_SE2",
    "EDGE2",
    "VERTEX_SE3:QUAT",
    "VERTEX3",
    "EDGE_SE3:QUAT",
    "EDGE3",
    "PARAMS_SE3OFFSET",
    "FIX",
];

const LOG_TAGS: [&str; 6] = ["PARAM", "ODOM", "FLASER", "RLASER", "ROBOTLASER1", "RAWLASER1"];

/// By the first bytes, after decompression.
pub(crate) fn kind_of(head: &[u8]) -> Option<Kind> {
    let by_bytes = BYTES.iter().find(|(beginning, ..)| head.starts_with(beginning));
    let found = by_bytes.map(|&(_, what, remedy)| Kind::new(what, remedy));
    found.or_else(|| of_tar(head)).or_else(|| of_osf(head)).or_else(|| of_text(head))
}

/// By what lies at a path, which may be compressed.
pub(crate) fn kind_at(path: &Path) -> Option<Kind> {
    let plain = plain_beginning(path);
    if mapwright_logs::Input::is_recording(&plain) {
        return Some(Kind::new("a recording of messages", "`mapwright map FILE -o OUT` maps it"));
    }
    kind_of(&plain)
}

/// The first bytes of a file that may be compressed, after decompression; nothing where it is damaged there.
pub(crate) fn plain_beginning(path: &Path) -> Vec<u8> {
    let mut plain = Vec::new();
    if let Some(stream) = File::open(path).ok().and_then(|file| open_log(file).ok()) {
        let _ = stream.take(HEAD_BYTES).read_to_end(&mut plain); // who reads it tells what is wrong with it
    }
    plain
}

/// The beginning of a file as it is after decompression, as far as it can be known from these bytes.
pub(crate) fn plain_head(head: &[u8]) -> Vec<u8> {
    let mut plain = Vec::new();
    if let Ok(stream) = open_log(head) {
        // what is cut off with the rest of the file is no fault
        let _ = stream.take(HEAD_BYTES).read_to_end(&mut plain);
    }
    plain
}

fn of_tar(head: &[u8]) -> Option<Kind> {
    let is_tar = head.get(257..262) == Some(b"ustar");
    is_tar.then(|| Kind::new("a tar archive", "unpack it first: tar -xf FILE"))
}

/// Ouster's OSF is a flatbuffer, whose identifier stands behind its size and the place of its root.
fn of_osf(head: &[u8]) -> Option<Kind> {
    let is_osf = head.get(8..11) == Some(b"OSF");
    is_osf.then(|| {
        Kind::new(
            "an Ouster's recording (OSF)",
            "convert it first: ouster-cli source FILE save FILE.pcap, which writes the sensor's metadata beside it as well",
        )
    })
}

fn of_text(head: &[u8]) -> Option<Kind> {
    let text = String::from_utf8_lossy(head.strip_prefix(b"\xef\xbb\xbf").unwrap_or(head));
    let text = text.trim_start();
    if let Some(&(_, what, remedy)) = TEXTS.iter().find(|(beginning, ..)| text.starts_with(beginning)) {
        return Some(Kind::new(what, remedy));
    }
    // the last line may be cut
    let whole = text.rfind('\n').map_or(text, |end| &text[..end]);
    let line = whole.lines().map(str::trim).find(|line| !line.is_empty() && !line.starts_with('#'))?;
    let words: Vec<_> = line.split_ascii_whitespace().collect();
    let tag = *words.first()?;
    if GRAPH_TAGS.contains(&tag) {
        return Some(Kind::new("a pose graph (g2o or TORO)", "`mapwright optimize FILE -o OUT.g2o` reads it"));
    }
    if LOG_TAGS.contains(&tag) {
        return Some(Kind::new("a CARMEN log", "`mapwright map FILE -o OUT` maps it"));
    }
    if let Some(kind) = of_labelled_rows(whole) {
        return Some(kind);
    }
    let is_number = |word: &&str| word.parse::<f64>().is_ok();
    let what = match words.len() {
        4 => "a trajectory (rows of a stamp, x, y and a heading)",
        8 => "a trajectory as TUM (rows of a stamp, a place and a quaternion), or relations",
        12 => "a trajectory as KITTI has it (rows of 12 numbers)",
        _ => return None,
    };
    words.iter().all(is_number).then(|| Kind::new(what, "`mapwright eval FILE --reference OTHER` compares it"))
}

/// Rows of as many numbers each and a word, between commas: readings to learn from.
fn of_labelled_rows(text: &str) -> Option<Kind> {
    let mut rows = text.lines().filter(|line| !line.trim().is_empty()).map(numbers_and_word);
    let (count, word) = rows.next()??;
    rows.all(|row| row.is_some_and(|(other, _)| other == count)).then(|| Kind {
        what: Cow::Owned(format!(
            "{count} numbers and a word in each line, such as {}, without a header, stamps or poses",
            Excerpt::new(word.as_bytes())
        )),
        remedy: "a map needs to be told when each reading was taken, from where (odometry or poses), and where on the robot \
                 its sensors sit: a CARMEN log with SONAR or FLASER lines says so, or a recording of ROS",
    })
}

/// How many numbers stand in a line before its word.
fn numbers_and_word(line: &str) -> Option<(usize, &str)> {
    let (numbers, word) = line.rsplit_once(',')?;
    let is_word = word.trim().starts_with(|first: char| first.is_ascii_alphabetic());
    let are_numbers = numbers.split(',').all(|number| number.trim().parse::<f64>().is_ok());
    (is_word && are_numbers).then(|| (numbers.split(',').count(), word.trim()))
}

impl Kind {
    fn new(what: &'static str, remedy: &'static str) -> Self {
        Self { what: Cow::Borrowed(what), remedy }
    }

    /// What was found instead of what a command reads.
    pub(crate) fn instead(&self, name: &str, expected: &str) -> String {
        let remedy = if self.remedy.is_empty() { String::new() } else { format!("; {}", self.remedy) };
        format!("{name}: expected {expected}, found {}{}", self.what, remedy.replace("FILE", name))
    }

    /// Whether it is a pose graph, of which what reads it knows better what is wrong.
    pub(crate) fn is_graph(&self) -> bool {
        self.remedy.starts_with("`mapwright optimize ")
    }

    /// Whether it is JSON, of which a parser knows better what is wrong.
    pub(crate) fn is_json(&self) -> bool {
        self.what == JSON
    }

    /// Whether it is a trajectory.
    pub(crate) fn is_trajectory(&self) -> bool {
        self.remedy.starts_with("`mapwright eval ")
    }

    /// Whether it is a log, which commands that read logs have to judge themselves.
    pub(crate) fn is_log(&self) -> bool {
        self.remedy.starts_with("`mapwright map ")
    }
}

/// What a folder is in which there is no recording, by the names in it.
pub(crate) fn folder_in_words(path: &Path, names: &[String]) -> String {
    let (folder, has) = (path.display(), |name: &str| names.iter().any(|known| known == name));
    let log = |name: &&String| [".clf", ".log", ".clf.gz", ".clf.bz2"].iter().any(|ending| name.ends_with(ending));
    if has("session.mapwright") {
        return format!(
            "found a folder of results; `mapwright export {folder}`, `mapwright explain {folder}` and --resume {folder} read it"
        );
    }
    if let Some(log) = names.iter().find(log) {
        return format!("expected a log, found a directory; give the log in it: {}", path.join(log).display());
    }
    if has("image_0") || has("image_2") || has("image_00") {
        return "expected a log, found a directory of KITTI's pictures; its clouds are mapped: a folder `velodyne` beside these"
            .to_owned();
    }
    let is_picture = |name: &&String| [".png", ".jpg", ".pgm", ".ppm"].iter().any(|ending| name.ends_with(ending));
    let pictures = names.iter().filter(is_picture).count();
    let what = if pictures > 0 && 2 * pictures >= names.len() { "of pictures " } else { "" };
    format!("expected a log, found a directory {what}without .mcap, .db3 or .bag files")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(head: &[u8]) -> String {
        kind_of(head).map_or_else(|| "unknown".to_owned(), |kind| kind.instead("x", "a log"))
    }

    #[test]
    fn files_are_named_by_their_bytes_with_what_reads_them() {
        for (head, says) in [
            (&b"\x89PNG\r\n\x1a\n\0\0"[..], "found a PNG picture"),
            (b"\xff\xd8\xff\xe0\0\x10JFIF", "found a JPEG picture"),
            (b"\x7fELF\x02\x01", "found a program (ELF)"),
            (b"ply\nformat ascii 1.0\n", "found a cloud as PLY"),
            (b"# .PCD v0.7 - Point Cloud Data\n", "mapwright map x.pcd -o OUT"),
            (b"version https://git-lfs.github.com/spec/v1\noid sha256:b90\nsize 990\n", "git lfs pull"),
            (b"VERTEX_SE2 0 1 2 3\nEDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n", "mapwright optimize x -o OUT.g2o"),
            (b"# stamp x y z\n5.0 1 2 3 0 0 0 1\n6.", "found a trajectory as TUM"),
            (b"1 0 0 0 0 1 0 0 0 0 1 0\n", "found a trajectory as KITTI has it"),
            (b"5.0 1 2 0.3\n", "mapwright eval x --reference OTHER"),
            (b"\xdb\x01\xf5\x5b\x7b\x1f\x1d\x7b\x10", "pbstream"),
            (b"\xef\xbb\xbf{\"a\": 1}", "found JSON"),
            (b"\xff\xfeF\0L\0", "UTF-16"),
            (b"# log\nPARAM robot_length 1\n", "found a CARMEN log"),
            (
                b"0.4,5.000,1.6,Move-Forward\n0.4,5,1,Turn\n0.4,",
                "found 3 numbers and a word in each line, such as `Move-Forward`",
            ),
            (b"0.4,5,Move\n0.4,Turn\n", "unknown"),
            (b"0.4,5\n0.4,3\n", "unknown"),
            (b"hello world\n", "unknown"),
            (b"", "unknown"),
        ] {
            assert!(words(head).contains(says), "{says}: {}", words(head));
        }
        let mut tar = vec![0; 512];
        tar[257..262].copy_from_slice(b"ustar");
        assert!(words(b"\x30\0\0\0\x10\0\0\0OSF!").contains("ouster-cli source x save x.pcap"));
        assert!(words(&tar).contains("tar -xf x"));
    }
}
