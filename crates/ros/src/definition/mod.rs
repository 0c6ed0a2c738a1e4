//! Definitions as bags carry them: a message's text and, behind lines of `=`, those of the types it uses.

mod idl;
mod md5;
mod msg;
mod resolve;
mod rihs;

use crate::error::{RosError, excerpt};
use crate::schema::{Arity, Constant, StructType};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Longest text that is read, bytes.
const TEXT_LIMIT: usize = 1 << 20;

/// The language of a definition's text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DefinitionFormat {
    /// ROS 1 `.msg`: `time` and `duration` are built in, `Header` is `std_msgs/Header`.
    Ros1Msg,
    /// ROS 2 `.msg`.
    Ros2Msg,
    /// ROS 2 `.idl`.
    Ros2Idl,
}

impl DefinitionFormat {
    /// The format that a container calls by this name: `ros1msg`, `ros2msg` or `ros2idl`.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        match name {
            "ros1msg" => Some(Self::Ros1Msg),
            "ros2msg" => Some(Self::Ros2Msg),
            "ros2idl" => Some(Self::Ros2Idl),
            _ => None,
        }
    }
}

/// A message's parsed definition with those of the types it uses.
#[derive(Debug, Clone)]
pub struct Definition {
    root: String,
    messages: BTreeMap<String, Message>,
}

/// One message as written.
#[derive(Debug, Clone, Default)]
pub(crate) struct Message {
    fields: Vec<Field>,
    constants: Vec<Constant>,
}

/// A field as written.
#[derive(Debug, Clone)]
pub(crate) struct Field {
    name: String,
    /// The type with its brackets, as written; what the checksum is taken of.
    type_text: String,
    /// The type without brackets and package filled in.
    base: String,
    arity: Arity,
    line: usize,
}

impl Definition {
    /// Parses a definition of `type_name` (with or without `msg` in the middle).
    ///
    /// # Errors
    /// [`RosError::Definition`] with the line that is not what it should be.
    pub fn parse(type_name: &str, format: DefinitionFormat, text: &str) -> Result<Self, RosError> {
        let root = short_name(type_name);
        if text.len() > TEXT_LIMIT {
            let found = format!("{} bytes", text.len());
            return Err(RosError::Definition { message: root, line: 0, expected: "a text of at most 1 MiB", found });
        }
        let messages = match format {
            DefinitionFormat::Ros1Msg | DefinitionFormat::Ros2Msg => msg::parse(&root, text)?,
            DefinitionFormat::Ros2Idl => idl::parse(&root, text)?,
        };
        Ok(Self { root, messages })
    }

    /// The message as a tree of types.
    ///
    /// # Errors
    /// [`RosError::MissingType`] and [`RosError::Nesting`].
    pub fn schema(&self) -> Result<Arc<StructType>, RosError> {
        resolve::resolve(&self.root, &self.messages)
    }

    /// ROS 1's checksum, which a bag carries beside the definition: 32 hexadecimal digits.
    ///
    /// # Errors
    /// [`RosError::MissingType`] and [`RosError::Nesting`].
    pub fn md5sum(&self) -> Result<String, RosError> {
        md5::md5sum(&self.root, &self.messages)
    }

    /// ROS 2's hash of the fields, by which its nodes tell whether they mean the same type: `RIHS01_` and 64 hexadecimal digits.
    ///
    /// # Errors
    /// [`RosError::MissingType`] and [`RosError::Nesting`].
    pub fn type_hash(&self) -> Result<String, RosError> {
        rihs::type_hash(&self.root, &self.messages)
    }
}

/// `package/Type` of `package/Type` or `package/msg/Type`.
#[must_use]
pub fn short_name(type_name: &str) -> String {
    let type_name = type_name.trim();
    match type_name.split_once("/msg/") {
        Some((package, name)) => format!("{package}/{name}"),
        None => type_name.to_owned(),
    }
}

/// `package/msg/Type` of `package/Type` or `package/msg/Type`.
#[must_use]
pub fn long_name(type_name: &str) -> String {
    let short = short_name(type_name);
    short.split_once('/').map_or(short.clone(), |(package, name)| format!("{package}/msg/{name}"))
}

/// Where in a definition's text something stands.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Place<'a> {
    root: &'a str,
    line: usize,
}

impl Place<'_> {
    fn refuse(self, expected: &'static str, found: &str) -> RosError {
        RosError::Definition { message: self.root.to_owned(), line: self.line, expected, found: excerpt(found) }
    }
}

fn is_identifier(text: &str) -> bool {
    text.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
        && text.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
}

fn is_type_name(text: &str) -> bool {
    text.split('/').count() <= 3 && text.split('/').all(is_identifier)
}

#[cfg(test)]
mod tests;
