//! ROS 2's hash of a type (REP 2016): SHA-256 of its description (REP 2011) as JSON, with those of the types it uses in the order of their names.

use super::resolve::check_nesting;
use super::{Field, Message};
use crate::error::RosError;
use crate::schema::Arity;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::fmt::Write;

/// Numbers of `type_description_interfaces/msg/FieldType`.
const MESSAGE: u8 = 1;
const TEXT: u8 = 17;
const WIDE_TEXT: u8 = 18;
const BOUNDED_TEXT: u8 = 21;
const BOUNDED_WIDE_TEXT: u8 = 22;
/// What lists have on top of the number of one element.
const FIXED: u8 = 48;
const AT_MOST: u8 = 96;
const ANY: u8 = 144;

pub(super) fn type_hash(root: &str, messages: &BTreeMap<String, Message>) -> Result<String, RosError> {
    let mut described = BTreeMap::new();
    Describer { root, messages, described: &mut described, open: Vec::new() }.describe(root, 0)?;
    let own = described.remove(&interface_name(root)).unwrap_or_default();
    let used: Vec<_> = described.into_values().collect();
    let json = format!("{{\"type_description\": {own}, \"referenced_type_descriptions\": [{}]}}", used.join(", "));
    Ok(Sha256::digest(json).iter().fold("RIHS01_".to_owned(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}"); // writing to a String does not fail
        text
    }))
}

struct Describer<'a> {
    root: &'a str,
    messages: &'a BTreeMap<String, Message>,
    /// Descriptions by the types' names.
    described: &'a mut BTreeMap<String, String>,
    open: Vec<String>,
}

impl Describer<'_> {
    fn describe(&mut self, name: &str, line: usize) -> Result<(), RosError> {
        check_nesting(self.root, &self.open, name)?;
        let long = interface_name(name);
        if self.described.contains_key(&long) {
            return Ok(());
        }
        let message = self.messages.get(name).ok_or_else(|| RosError::MissingType {
            message: self.root.to_owned(),
            line,
            missing: name.to_owned(),
        })?;
        self.open.push(name.to_owned());
        let mut fields = Vec::new();
        for field in &message.fields {
            if number(field) == MESSAGE {
                self.describe(&field.base, field.line)?;
            }
            fields.push(described(field));
        }
        self.open.pop();
        let description = format!("{{\"type_name\": \"{long}\", \"fields\": [{}]}}", fields.join(", "));
        self.described.insert(long, description);
        Ok(())
    }
}

fn described(field: &Field) -> String {
    let one = number(field);
    let (list, capacity) = match field.arity {
        Arity::One => (0, 0),
        Arity::Fixed(count) => (FIXED, count),
        Arity::AtMost(count) => (AT_MOST, count),
        Arity::Any => (ANY, 0),
    };
    let nested = if one == MESSAGE { interface_name(&field.base) } else { String::new() };
    format!(
        "{{\"name\": \"{}\", \"type\": {{\"type_id\": {}, \"capacity\": {capacity}, \"string_capacity\": {}, \"nested_type_name\": \"{nested}\"}}}}",
        field.name,
        one + list,
        bound(field).unwrap_or(0),
    )
}

/// The number of one element's type.
fn number(field: &Field) -> u8 {
    match (field.base.as_str(), bound(field)) {
        ("int8", _) => 2,
        ("uint8" | "char", _) => 3,
        ("int16", _) => 4,
        ("uint16", _) => 5,
        ("int32", _) => 6,
        ("uint32", _) => 7,
        ("int64", _) => 8,
        ("uint64", _) => 9,
        ("float32", _) => 10,
        ("float64", _) => 11,
        ("bool", _) => 15,
        ("byte", _) => 16,
        ("string", None) => TEXT,
        ("string", Some(_)) => BOUNDED_TEXT,
        ("wstring", None) => WIDE_TEXT,
        ("wstring", Some(_)) => BOUNDED_WIDE_TEXT,
        _ => MESSAGE,
    }
}

/// How long a text may be: `string<=5[]`.
fn bound(field: &Field) -> Option<u32> {
    let one = field.type_text.split('[').next()?;
    one.split_once("<=")?.1.parse().ok()
}

/// `package/msg/Type`, and `package/srv/Type_Request` of the parts of a service.
fn interface_name(name: &str) -> String {
    let kind = if ["_Request", "_Response", "_Event"].iter().any(|part| name.ends_with(part)) { "srv" } else { "msg" };
    match name.split_once('/') {
        Some((package, rest)) if !rest.contains('/') => format!("{package}/{kind}/{rest}"),
        _ => name.to_owned(),
    }
}
