//! ROS 1's checksum of a definition.

use super::resolve::check_nesting;
use super::{Field, Message};
use crate::error::RosError;
use crate::schema::Primitive;
use md5::{Digest, Md5};
use std::collections::BTreeMap;
use std::fmt::Write;

pub(super) fn md5sum(root: &str, messages: &BTreeMap<String, Message>) -> Result<String, RosError> {
    Summer { root, messages, done: BTreeMap::new(), open: Vec::new() }.sum(root, 0)
}

struct Summer<'a> {
    root: &'a str,
    messages: &'a BTreeMap<String, Message>,
    done: BTreeMap<String, String>,
    open: Vec<String>,
}

impl Summer<'_> {
    /// Constants first, then fields; a field that is a message counts by that message's sum, without brackets.
    fn sum(&mut self, name: &str, line: usize) -> Result<String, RosError> {
        if let Some(done) = self.done.get(name) {
            return Ok(done.clone());
        }
        check_nesting(self.root, &self.open, name)?;
        let message = self.messages.get(name).ok_or_else(|| RosError::MissingType {
            message: self.root.to_owned(),
            line,
            missing: name.to_owned(),
        })?;
        self.open.push(name.to_owned());
        let constants = message.constants.iter().map(|c| format!("{} {}={}", c.type_name, c.name, c.value));
        let mut lines: Vec<_> = constants.collect();
        for field in &message.fields {
            lines.push(self.line(field)?);
        }
        self.open.pop();
        let sum = hex(&Md5::digest(lines.join("\n").trim().as_bytes()));
        self.done.insert(name.to_owned(), sum.clone());
        Ok(sum)
    }

    fn line(&mut self, field: &Field) -> Result<String, RosError> {
        let built_in = Primitive::from_name(&field.base).is_some()
            || matches!(field.base.as_str(), "string" | "wstring" | "time" | "duration");
        let kind = if built_in { field.type_text.clone() } else { self.sum(&field.base, field.line)? };
        Ok(format!("{kind} {}", field.name))
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}"); // writing to a String does not fail
        text
    })
}
