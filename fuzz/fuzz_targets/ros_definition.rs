//! Any text as a definition, behind a byte for its language, and a message of it behind a zero byte: no panic, and no
//! more memory than the message is worth.
//! `cargo +nightly fuzz run ros_definition -- -max_total_time=60`
#![no_main]

use libfuzzer_sys::fuzz_target;
use mapwright_ros::{Channel, Definition, DefinitionFormat, Encoding};

fuzz_target!(|data: &[u8]| {
    let Some((selector, rest)) = data.split_first() else { return };
    let end = rest.iter().position(|byte| *byte == 0).unwrap_or(rest.len());
    let Ok(text) = std::str::from_utf8(&rest[..end]) else { return };
    let message = rest.get(end + 1..).unwrap_or_default();
    let (format, encoding) = match selector % 4 {
        0 => (DefinitionFormat::Ros1Msg, Encoding::Ros1),
        1 => (DefinitionFormat::Ros2Msg, Encoding::Cdr),
        2 => (DefinitionFormat::Ros2Idl, Encoding::Cdr),
        _ => (DefinitionFormat::Ros2Msg, Encoding::Ros1),
    };
    if let Ok(definition) = Definition::parse("pkg/Type", format, text) {
        let (schema, sum) = (definition.schema(), definition.md5sum());
        assert!(sum.is_err() || schema.is_ok(), "a checksum needs all types, a schema no more");
    }
    if let Ok(channel) = Channel::new("pkg/Type", encoding, Some((format, text))) {
        let _ = channel.value(message);
    }
});
