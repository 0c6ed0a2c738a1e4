//! What a folder holds, by the names in it and by its `metadata.yaml`.

use serde::Deserialize;
use std::cmp::Ordering;

/// The name of rosbag2's description of a folder.
pub const METADATA: &str = "metadata.yaml";

/// Endings of files with messages, the kind taken first where a folder has several.
const ENDINGS: [&str; 4] = [".mcap", ".db3", ".bag", ".bag.active"];

/// The files of a recording in a folder.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct FolderContents {
    /// Whether there is a `metadata.yaml`.
    pub has_metadata: bool,
    /// Files with messages in the order of their names, numbers counted as such; all of one kind.
    pub parts: Vec<String>,
    /// Files with messages that are left out: of another kind, or compressed ones beside the same uncompressed.
    pub left_out: Vec<String>,
}

impl FolderContents {
    /// What the names in a folder say.
    ///
    /// ```
    /// let names = ["drive_10.mcap", "drive_9.mcap", "metadata.yaml", "notes.txt"].map(String::from);
    /// let contents = mapwright_bags::FolderContents::of(&names);
    /// assert!(contents.has_metadata);
    /// assert_eq!(contents.parts, ["drive_9.mcap", "drive_10.mcap"]);
    /// ```
    #[must_use]
    pub fn of(names: &[String]) -> Self {
        let mut parts: Vec<(usize, &String)> = names.iter().filter_map(|n| Some((kind(n)?, n))).collect();
        parts.sort_by(|a, b| a.0.cmp(&b.0).then_with(|| by_number(a.1, b.1)));
        let mut contents = Self { has_metadata: names.iter().any(|n| n == METADATA), ..Self::default() };
        let first_kind = parts.first().map(|(kind, _)| *kind);
        for (kind, name) in &parts {
            let is_double = plain(name) != name.as_str() && parts.iter().any(|(_, other)| *other == plain(name));
            let list =
                if Some(*kind) == first_kind && !is_double { &mut contents.parts } else { &mut contents.left_out };
            list.push((*name).clone());
        }
        contents
    }

    /// Brings the parts into the order that the metadata give; those that it names and that are not there are returned.
    pub(crate) fn arrange(&mut self, metadata: &Metadata) -> Vec<String> {
        let (mut parts, mut missing) = (Vec::new(), Vec::new());
        for path in &metadata.relative_file_paths {
            // older versions wrote the folder before the name
            let name = path.rsplit(['/', '\\']).next().unwrap_or(path);
            let there = self.parts.iter().chain(&self.left_out).find(|p| *p == name);
            let there = there.or_else(|| self.parts.iter().find(|p| plain(p) == plain(name)));
            match there {
                Some(part) if parts.contains(part) => {}
                Some(part) => parts.push(part.clone()),
                None => missing.push(name.to_owned()),
            }
        }
        if !parts.is_empty() {
            let before = std::mem::replace(&mut self.parts, parts);
            self.left_out.extend(before);
            self.left_out.retain(|name| !self.parts.contains(name));
        }
        missing
    }
}

fn kind(name: &str) -> Option<usize> {
    ENDINGS.iter().position(|ending| plain(name).ends_with(ending))
}

/// The name without the ending of a compressed file.
fn plain(name: &str) -> &str {
    name.strip_suffix(".zstd").or_else(|| name.strip_suffix(".zst")).unwrap_or(name)
}

/// `part_9` before `part_10`.
fn by_number(a: &str, b: &str) -> Ordering {
    let (mut rest_a, mut rest_b) = (a, b);
    while let (Some(first_a), Some(first_b)) = (rest_a.chars().next(), rest_b.chars().next()) {
        let order = if first_a.is_ascii_digit() && first_b.is_ascii_digit() {
            let (number_a, number_b) = (digits(&mut rest_a), digits(&mut rest_b));
            number_a.len().cmp(&number_b.len()).then_with(|| number_a.cmp(number_b))
        } else {
            (rest_a, rest_b) = (&rest_a[first_a.len_utf8()..], &rest_b[first_b.len_utf8()..]);
            first_a.cmp(&first_b)
        };
        if order != Ordering::Equal {
            return order;
        }
    }
    rest_a.len().cmp(&rest_b.len()).then_with(|| a.cmp(b))
}

/// Takes the digits off the front; leading zeros do not count.
fn digits<'a>(text: &mut &'a str) -> &'a str {
    let end = text.find(|c: char| !c.is_ascii_digit()).unwrap_or(text.len());
    let (number, rest) = text.split_at(end);
    *text = rest;
    number.trim_start_matches('0')
}

/// What of `metadata.yaml` is of use; all else in it is left alone.
#[derive(Debug, Clone, PartialEq, Eq, Default, Deserialize)]
pub(crate) struct Metadata {
    #[serde(default)]
    pub(crate) relative_file_paths: Vec<String>,
}

impl Metadata {
    pub(crate) fn parse(text: &str) -> Result<Self, String> {
        #[derive(Deserialize)]
        struct File {
            rosbag2_bagfile_information: Metadata,
        }
        let file: File = serde_saphyr::from_str(text).map_err(|error| {
            let text = error.to_string();
            text.lines().next().unwrap_or("no YAML").to_owned()
        })?;
        Ok(file.rosbag2_bagfile_information)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn contents(names: &[&str]) -> FolderContents {
        FolderContents::of(&names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>())
    }

    #[test]
    fn parts_are_ordered_by_number_and_of_one_kind() {
        let found = contents(&["a_10.db3", "a_2.db3", "a_2.db3.zstd", "a_1.db3.zstd", "x.bag", "readme"]);
        assert_eq!(found.parts, ["a_1.db3.zstd", "a_2.db3", "a_10.db3"]);
        assert_eq!(found.left_out, ["a_2.db3.zstd", "x.bag"]);
        assert!(!found.has_metadata && contents(&["metadata.yaml"]).has_metadata);
        assert!(contents(&[]).parts.is_empty());
    }

    #[test]
    fn metadata_give_the_order_and_what_they_lack_is_left_out() {
        let text = "rosbag2_bagfile_information:\n  version: 4\n  duration: {nanoseconds: 5}\n  relative_file_paths:\n\
                    \x20   - bag/b.db3\n    - bag/a.db3\n    - c.db3\n  compression_mode: FILE\n";
        let mut found = contents(&["a.db3.zstd", "b.db3", "z.db3"]);
        assert_eq!(found.arrange(&Metadata::parse(text).unwrap()), ["c.db3"]);
        assert_eq!(found.parts, ["b.db3", "a.db3.zstd"]);
        assert_eq!(found.left_out, ["z.db3"]);
    }

    #[test]
    fn broken_metadata_are_refused_in_one_line() {
        for text in ["", "{", "a: [1, 2", "rosbag2_bagfile_information: 7", "&a [*a, *a]", "\0"] {
            let error = Metadata::parse(text).unwrap_err();
            assert!(!error.is_empty() && !error.contains('\n'));
        }
    }
}
