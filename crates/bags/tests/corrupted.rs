//! Cut and flipped recordings: 2,000 of each container. No panic, memory in bounds, everything before the damage as it
//! was, and the damage reported with its place.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // tests unwrap what they expect and say what they skip

mod common;

use common::{Made, Random, Seen};
use mapwright_bags::{Bag1Compression, McapCompression, Place, ReadReport};

/// Damaged copies of each container.
const COPIES: usize = 2000;
/// Beyond twice the file, buffers may hold this.
const SLACK_BYTES: usize = 1 << 17;

/// A whole file, and what is in it.
struct Whole {
    name: &'static str,
    content: Vec<u8>,
    messages: Vec<(Seen, u64)>,
    /// Where records of the file itself begin; chunks are such records.
    records: Vec<usize>,
    /// Whether checksums, or compression with them, tell any flip within a chunk.
    is_checked: bool,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Harm {
    Cut(usize),
    Flip { first: usize },
}

fn whole(name: &'static str, content: Vec<u8>, made: &[Made], is_checked: bool) -> Whole {
    let (messages, report, _) = common::read(&content).unwrap();
    assert_eq!(messages.len(), made.len(), "{name}");
    assert!(report.damages.is_empty(), "{name}: {:?}", report.damages);
    let records = if name.starts_with("mcap") { mcap_records(&content) } else { bag1_records(&content) };
    Whole { name, content, messages, records, is_checked }
}

fn mcap_records(content: &[u8]) -> Vec<usize> {
    let (mut at, mut records) = (8, Vec::new());
    while at + 9 <= content.len() {
        records.push(at);
        at += 9 + u64::from_le_bytes(content[at + 1..at + 9].try_into().unwrap()) as usize;
    }
    records
}

fn bag1_records(content: &[u8]) -> Vec<usize> {
    let number = |at: usize| u32::from_le_bytes(content[at..at + 4].try_into().unwrap()) as usize;
    let (mut at, mut records) = (13, Vec::new());
    while at < content.len() {
        records.push(at);
        let data_at = at + 4 + number(at);
        at = data_at + 4 + number(data_at);
    }
    records
}

impl Whole {
    /// How many messages lie wholly before a place: in chunks before it where chunks are checked as a whole.
    fn messages_before(&self, place: usize) -> usize {
        let chunk = self.records.iter().rev().find(|at| **at <= place).copied().unwrap_or(0);
        let before = |(seen, offset): &(Seen, u64)| {
            let offset = *offset as usize;
            if self.is_checked { offset < chunk } else { offset + 100 + seen.length < place }
        };
        self.messages.iter().take_while(|message| before(message)).count()
    }

    fn harmed(&self, random: &mut Random) -> (Vec<u8>, Harm) {
        let (mut content, place) = (self.content.clone(), random.below(self.content.len()));
        if random.below(3) == 0 {
            content.truncate(place);
            return (content, Harm::Cut(place));
        }
        for _ in 0..=random.below(3) {
            let near = (place + random.below(16)).min(content.len() - 1);
            content[near] ^= 1 + random.below(255) as u8;
        }
        (content, Harm::Flip { first: place })
    }

    fn check(&self, harmed: &[u8], harm: Harm) {
        let context = || format!("{} {harm:?} of {}", self.name, self.content.len());
        let Ok((messages, report, held)) = common::read(harmed) else {
            let (Harm::Cut(place) | Harm::Flip { first: place }) = harm;
            assert!(place < 16, "{} refused", context());
            return;
        };
        assert!(held <= 2 * self.content.len() + SLACK_BYTES, "{}: {held} bytes held", context());
        let seen: Vec<&Seen> = messages.iter().map(|(seen, _)| seen).collect();
        let original: Vec<&Seen> = self.messages.iter().map(|(seen, _)| seen).collect();
        let (Harm::Cut(place) | Harm::Flip { first: place }) = harm;
        let before = self.messages_before(place);
        assert!(seen.len() >= before && seen[..before] == original[..before], "{}: {} {before}", context(), seen.len());
        match harm {
            Harm::Cut(_) => {
                assert!(original.starts_with(&seen), "{}", context());
                assert!(report.has_losses() || seen.len() == original.len(), "{}", context());
            }
            Harm::Flip { .. } if self.is_checked => {
                let mut rest = original.iter();
                assert!(seen.iter().all(|s| rest.any(|o| o == s)), "{}", context());
                assert!(report.has_losses() || seen.len() == original.len(), "{}", context());
            }
            Harm::Flip { .. } => {
                let payload_only = seen.len() == original.len();
                assert!(payload_only || !report.damages.is_empty(), "{}: {} {before}", context(), seen.len());
            }
        }
        if report.has_losses() {
            self.check_places(&report, place, &context());
        }
    }

    /// The first damage lies in the record that was harmed, or behind.
    fn check_places(&self, report: &ReadReport, place: usize, context: &str) {
        let record = self.records.iter().rev().find(|at| **at <= place).copied().unwrap_or(0);
        let damages = report.damages.iter().filter(|(kind, _)| kind.loses_messages());
        let first = damages.flat_map(|(_, damages)| &damages.first).map(|damage| damage.place).min().unwrap();
        // a length that was harmed is found out at the record before at the earliest
        let earliest = if self.is_checked { record } else { record.saturating_sub(2000) } as u64;
        assert!(
            matches!(first, Place::Byte(at) if at >= earliest && at <= self.content.len() as u64),
            "{context}: {first:?} {record}"
        );
    }
}

fn survive(wholes: &[Whole], seed: u64) {
    let before = resident_bytes();
    let mut random = Random(seed);
    for copy in 0..COPIES {
        let whole = &wholes[copy % wholes.len()];
        let (harmed, harm) = whole.harmed(&mut random);
        whole.check(&harmed, harm);
    }
    let grown = resident_bytes().saturating_sub(before);
    assert!(grown < 128 << 20, "memory grew by {grown} bytes");
}

/// The most memory this process ever had; nothing where the system does not say.
fn resident_bytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmHWM:")).unwrap_or_default();
    line.split_whitespace().nth(1).and_then(|kib| kib.parse::<u64>().ok()).unwrap_or(0) << 10
}

/// The same file of the given ones, where it is at hand.
fn given(test: &str, file: &str) -> Option<Vec<u8>> {
    common::given(test).map(|folder| std::fs::read(folder.join(file)).unwrap())
}

#[test]
fn ros_1_bags() {
    let made = common::messages(240);
    let bag = |compression| common::bag1(&made, compression);
    let mut wholes = vec![
        whole("bag1 none", bag(Bag1Compression::None), &made, false),
        whole("bag1 lz4", bag(Bag1Compression::Lz4), &made, true),
        whole("bag1 bz2", bag(Bag1Compression::Bz2), &made, true),
    ];
    survive(&wholes, 1);
    wholes.clear();
    if let Some(content) = given("ros_1_bags", "derived_intel/intel_180s.bag") {
        let count = common::read(&content).unwrap().0.len();
        assert_eq!(count, 4509);
        let whole = whole("bag1 given", content, &vec![made[0].clone(); count], false);
        let mut random = Random(2);
        for _ in 0..COPIES / 20 {
            let (harmed, harm) = whole.harmed(&mut random);
            whole.check(&harmed, harm);
        }
    }
}

#[test]
fn mcap_files() {
    let made = common::messages(240);
    let options = || mcap::WriteOptions::new().compression(None);
    let wholes = [
        whole("mcap none", common::mcap(&made, McapCompression::None), &made, true),
        whole("mcap zstd", common::mcap(&made, McapCompression::Zstd), &made, true),
        whole("mcap unchunked", common::foreign_mcap(&made, options().use_chunks(false)), &made, false),
        whole(
            "mcap unchecked",
            common::foreign_mcap(&made, options().calculate_chunk_crcs(false).chunk_size(Some(9000))),
            &made,
            false,
        ),
    ];
    survive(&wholes, 3);
    if let Some(content) = given("mcap_files", "derived_intel/intel_180s_mcap/intel_180s_mcap.mcap") {
        let whole = whole("mcap given", content, &vec![made[0].clone(); 4509], false);
        let mut random = Random(4);
        for _ in 0..COPIES / 20 {
            let (harmed, harm) = whole.harmed(&mut random);
            whole.check(&harmed, harm);
        }
    }
}

/// Where in the file the data of each message end; data within one page stand there in one piece. The last such place
/// counts: pages that were split keep what they held.
#[cfg(feature = "sqlite")]
fn data_ends(content: &[u8], made: &[Made]) -> Vec<usize> {
    let find = |data: &[u8]| content.windows(data.len()).rposition(|window| window == data);
    made.iter().map(|(_, _, data)| find(data).map_or(usize::MAX, |at| at + data.len())).collect()
}

#[cfg(feature = "sqlite")]
#[test]
fn databases() {
    let folder = common::folder("corrupted_databases");
    let (made, path) = (common::messages(60), folder.join("whole.db3"));
    common::database(&path, &made, 4);
    let (content, original) = (std::fs::read(&path).unwrap(), common::expected(&made, false));
    let (ends, page) = (data_ends(&content, &made), 4096);
    let (before, path, mut random) = (resident_bytes(), folder.join("harmed.db3"), Random(5));
    let (mut refused, mut complete) = (0, 0);
    for _ in 0..COPIES {
        let (mut harmed, place) = (content.clone(), random.below(content.len()));
        let is_cut = random.below(3) == 0;
        if is_cut {
            harmed.truncate(place);
        } else {
            for _ in 0..=random.below(3) {
                let near = (place + random.below(16)).min(content.len() - 1);
                harmed[near] ^= 1 + random.below(255) as u8;
            }
        }
        std::fs::write(&path, &harmed).unwrap();
        let context = format!("{} at {place} of {}", if is_cut { "cut" } else { "flip" }, content.len());
        let (seen, report) = match common::read_path(&path) {
            Ok((seen, report, _)) => (seen, report),
            Err(error) => {
                // without the first page, which tells where the tables are, nothing can be read
                assert!(place < page, "refused: {context}: {error}");
                let (end, whole) = (harmed.len(), content.len());
                let first = content.iter().zip(&harmed).position(|(was, is)| was != is).unwrap_or(end);
                let told = match first {
                    _ if is_cut && end < 100 => format!("at byte {end}"),
                    _ if is_cut => format!("at byte {end} of {whole}"),
                    0..16 => format!("from byte {first} on"),
                    16..100 => "from byte 0 on".into(),
                    _ => "from byte 100 on".into(),
                };
                assert!(error.to_string().ends_with(&told), "{context}: {error}");
                refused += 1;
                continue;
            }
        };
        let lost = original.iter().filter(|message| !seen.contains(message)).count();
        complete += usize::from(lost == 0);
        if is_cut {
            // pages before the cut are read, but for what only pages behind it say
            assert!(seen.iter().all(|message| original.contains(message)), "{context}");
            assert!(report.has_losses(), "{context}");
            let before_cut = |place: usize| ends[place] <= harmed.len() / page * page;
            let missing = (0..made.len()).filter(|p| before_cut(*p) && !seen.contains(&original[*p])).count();
            assert!(missing == 0, "{context}: {missing} missing, {:?}", report.damages);
        } else {
            // a flip costs the messages of its page; undetected it may change one
            let page_of = |at: usize| at.saturating_sub(1) / page;
            let others = |p: &usize| page_of(ends[*p]).abs_diff(page_of(place)) > 1;
            let missing = (0..made.len()).filter(others).filter(|p| !seen.contains(&original[*p])).count();
            assert!(missing == 0 || report.has_losses() || place < 7 * page, "{context}: {missing} missing silently");
        }
    }
    println!("databases: {refused} of {COPIES} refused, {complete} complete");
    assert!(refused < COPIES / 4);
    let grown = resident_bytes().saturating_sub(before);
    assert!(grown < 128 << 20, "memory grew by {grown} bytes");
}
