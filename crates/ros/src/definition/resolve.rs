//! From definitions as written to a tree of types.

use super::{Field, Message};
use crate::error::RosError;
use crate::schema::{Base, FieldDef, FieldType, Primitive, StructType};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Deepest nesting; the messages of ROS reach seven.
const DEPTH_LIMIT: usize = 32;

pub(super) fn resolve(root: &str, messages: &BTreeMap<String, Message>) -> Result<Arc<StructType>, RosError> {
    Resolver { root, messages, done: BTreeMap::new(), open: Vec::new() }.message(root, 0)
}

/// What a definition may leave out: ROS 2's time and duration, which are messages only by name.
pub(super) fn implied(name: &str) -> Option<StructType> {
    use Primitive::{I32, U32};
    match name {
        "time" => Some(StructType::time("builtin_interfaces/Time", U32, U32)),
        "duration" => Some(StructType::time("builtin_interfaces/Duration", I32, I32)),
        "builtin_interfaces/Time" | "builtin_interfaces/Duration" => Some(StructType::time(name, I32, U32)),
        _ => None,
    }
}

/// An error where a chain of types is too long or bites its tail.
pub(super) fn check_nesting(root: &str, open: &[String], next: &str) -> Result<(), RosError> {
    let problem = if open.iter().any(|name| name == next) {
        "contains itself"
    } else if open.len() >= DEPTH_LIMIT {
        "nests deeper than 32 levels"
    } else {
        return Ok(());
    };
    let chain = open.iter().map(String::as_str).chain([next]).collect::<Vec<_>>().join(" > ");
    Err(RosError::Nesting { message: root.to_owned(), problem, chain })
}

struct Resolver<'a> {
    root: &'a str,
    messages: &'a BTreeMap<String, Message>,
    done: BTreeMap<String, Arc<StructType>>,
    open: Vec<String>,
}

impl Resolver<'_> {
    fn message(&mut self, name: &str, line: usize) -> Result<Arc<StructType>, RosError> {
        if let Some(done) = self.done.get(name) {
            return Ok(done.clone());
        }
        check_nesting(self.root, &self.open, name)?;
        let kind = match (self.messages.get(name), implied(name)) {
            (Some(message), _) => self.fields(name, message)?,
            (None, Some(implied)) => implied,
            (None, None) => return Err(self.missing(name, line)),
        };
        let kind = Arc::new(kind);
        self.done.insert(name.to_owned(), kind.clone());
        Ok(kind)
    }

    fn fields(&mut self, name: &str, message: &Message) -> Result<StructType, RosError> {
        self.open.push(name.to_owned());
        let fields = message.fields.iter().map(|field| self.field(field)).collect::<Result<Vec<_>, _>>()?;
        self.open.pop();
        Ok(StructType::new(name.to_owned(), fields, message.constants.clone()))
    }

    fn field(&mut self, field: &Field) -> Result<FieldDef, RosError> {
        let base = match (field.base.as_str(), Primitive::from_name(&field.base)) {
            (_, Some(primitive)) => Base::Number(primitive),
            ("string", None) => Base::String,
            ("wstring", None) => Base::WString,
            (name, None) => Base::Struct(self.message(name, field.line)?),
        };
        Ok(FieldDef { name: field.name.clone(), ty: FieldType { base, arity: field.arity } })
    }

    fn missing(&self, name: &str, line: usize) -> RosError {
        RosError::MissingType { message: self.root.to_owned(), line, missing: name.to_owned() }
    }
}
