//! The language of `.msg` files, ROS 1 and ROS 2.

use super::{Field, Message, Place, is_identifier, is_type_name, short_name};
use crate::error::RosError;
use crate::schema::{Arity, Constant, Primitive};
use std::collections::BTreeMap;

const HEADER: &str = "std_msgs/Header";

/// Messages by their name; the text before the first separator is `root`.
pub(super) fn parse(root: &str, text: &str) -> Result<BTreeMap<String, Message>, RosError> {
    let mut messages = BTreeMap::new();
    let mut name = root.to_owned();
    let mut message = Message::default();
    for (index, line) in text.lines().enumerate() {
        let place = Place { root, line: index + 1 };
        let line = line.trim();
        if is_separator(line) {
            continue;
        }
        if let Some(next) = line.strip_prefix("MSG:") {
            keep(&mut messages, &name, std::mem::take(&mut message));
            name = short_name(next);
            if !is_type_name(&name) {
                return Err(place.refuse("a type's name behind `MSG:`", next));
            }
        } else {
            parse_line(&mut message, package_of(&name), place, line)?;
        }
    }
    keep(&mut messages, &name, message);
    messages.entry(root.to_owned()).or_default();
    // bags of before 2010 define `Header` under this name
    if let (false, Some(header)) = (messages.contains_key(HEADER), messages.get("roslib/Header").cloned()) {
        messages.insert(HEADER.to_owned(), header);
    }
    Ok(messages)
}

/// A text may begin with a separator, and then nothing stands before it; the first definition of a type counts.
fn keep(messages: &mut BTreeMap<String, Message>, name: &str, message: Message) {
    let kept = messages.entry(name.to_owned()).or_default();
    if kept.fields.is_empty() && kept.constants.is_empty() {
        *kept = message;
    }
}

fn is_separator(line: &str) -> bool {
    line.len() >= 3 && line.bytes().all(|byte| byte == b'=')
}

fn package_of(name: &str) -> &str {
    name.split_once('/').map_or("", |(package, _)| package)
}

fn parse_line(message: &mut Message, package: &str, place: Place<'_>, line: &str) -> Result<(), RosError> {
    if line.is_empty() || line.starts_with('#') {
        return Ok(());
    }
    let (type_text, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
    let rest = rest.trim_start();
    let name_end = rest.find(|c: char| !(c.is_ascii_alphanumeric() || c == '_')).unwrap_or(rest.len());
    let (name, behind) = rest.split_at(name_end);
    if !is_identifier(name) {
        return Err(place.refuse("a type and a name", line));
    }
    let (base, arity) = parse_type(package, place, type_text)?;
    match behind.trim_start().strip_prefix('=') {
        Some(value) => message.constants.push(constant(type_text, name, value)),
        None if behind.is_empty() || behind.starts_with(char::is_whitespace) || behind.starts_with('#') => {
            let (name, type_text) = (name.to_owned(), type_text.to_owned());
            message.fields.push(Field { name, type_text, base, arity, line: place.line });
        }
        None => return Err(place.refuse("a field's name, a default or a comment", behind)),
    }
    Ok(())
}

/// A text's value goes to the end of its line, `#` included.
fn constant(type_text: &str, name: &str, value: &str) -> Constant {
    let is_text = type_text.starts_with("string") || type_text.starts_with("wstring");
    let value = if is_text { value } else { value.split('#').next().unwrap_or_default() };
    Constant { type_name: type_text.to_owned(), name: name.to_owned(), value: value.trim().to_owned() }
}

/// `float32`, `string<=5[<=3]`, `Header`, `Type[]`, `package/Type[36]`.
fn parse_type(package: &str, place: Place<'_>, text: &str) -> Result<(String, Arity), RosError> {
    let (base, brackets) = text.find('[').map_or((text, ""), |at| text.split_at(at));
    let base = match base.split_once("<=") {
        Some((base @ ("string" | "wstring"), bound)) if bound.parse::<u32>().is_ok() => base,
        Some(_) => return Err(place.refuse("`string<=` and a number", text)),
        None => base,
    };
    let arity = parse_brackets(brackets).ok_or_else(|| place.refuse("`[]`, `[N]` or `[<=N]`", brackets))?;
    if !is_type_name(base) {
        return Err(place.refuse("a type's name", base));
    }
    Ok((full_name(package, base), arity))
}

fn parse_brackets(text: &str) -> Option<Arity> {
    if text.is_empty() {
        return Some(Arity::One);
    }
    let inside = text.strip_prefix('[')?.strip_suffix(']')?.trim();
    let count = |text: &str| text.trim().parse::<u32>().ok().map(|count| count as usize);
    match inside.strip_prefix("<=") {
        _ if inside.is_empty() => Some(Arity::Any),
        Some(bound) => count(bound).map(Arity::AtMost),
        None => count(inside).map(Arity::Fixed),
    }
}

fn full_name(package: &str, base: &str) -> String {
    if Primitive::from_name(base).is_some() || matches!(base, "string" | "wstring" | "time" | "duration") {
        base.to_owned()
    } else if base == "Header" {
        HEADER.to_owned()
    } else if base.contains('/') {
        short_name(base)
    } else {
        format!("{package}/{base}")
    }
}
