//! Values of parameters.

use mapwright_ros::messages::parameters::ParameterValue as ValueMessage;
use std::borrow::Cow;
use std::fmt;

/// A kind of values, with its number in `rcl_interfaces/ParameterType`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
#[allow(missing_docs)] // the names say it
pub enum ParameterKind {
    NotSet = 0,
    Bool = 1,
    Integer = 2,
    Double = 3,
    Text = 4,
    Bytes = 5,
    Bools = 6,
    Integers = 7,
    Doubles = 8,
    Texts = 9,
}

impl fmt::Display for ParameterKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NotSet => "nothing",
            Self::Bool => "a bool",
            Self::Integer => "an integer",
            Self::Double => "a double",
            Self::Text => "a string",
            Self::Bytes => "bytes",
            Self::Bools => "a list of bools",
            Self::Integers => "a list of integers",
            Self::Doubles => "a list of doubles",
            Self::Texts => "a list of strings",
        })
    }
}

/// That a value is none of a parameter's.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Misfit {
    pub(super) expected: String,
    pub(super) found: String,
}

impl Misfit {
    pub(super) fn new(expected: impl fmt::Display, found: impl fmt::Display) -> Self {
        Self { expected: expected.to_string(), found: found.to_string() }
    }
}

impl fmt::Display for Misfit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "expected {}, found {}", self.expected, self.found)
    }
}

/// A parameter's value.
#[derive(Debug, Clone, PartialEq, Default)]
#[allow(missing_docs)] // the names say it
pub enum ParameterValue {
    #[default]
    NotSet,
    Bool(bool),
    Integer(i64),
    Double(f64),
    Text(String),
    Bytes(Vec<u8>),
    Bools(Vec<bool>),
    Integers(Vec<i64>),
    Doubles(Vec<f64>),
    Texts(Vec<String>),
}

impl ParameterValue {
    /// Its kind.
    #[must_use]
    pub fn kind(&self) -> ParameterKind {
        match self {
            Self::NotSet => ParameterKind::NotSet,
            Self::Bool(_) => ParameterKind::Bool,
            Self::Integer(_) => ParameterKind::Integer,
            Self::Double(_) => ParameterKind::Double,
            Self::Text(_) => ParameterKind::Text,
            Self::Bytes(_) => ParameterKind::Bytes,
            Self::Bools(_) => ParameterKind::Bools,
            Self::Integers(_) => ParameterKind::Integers,
            Self::Doubles(_) => ParameterKind::Doubles,
            Self::Texts(_) => ParameterKind::Texts,
        }
    }

    /// Of a message; a kind that is none is not set.
    pub(super) fn of(message: &ValueMessage<'_>) -> Self {
        match message.r#type {
            1 => Self::Bool(message.bool_value),
            2 => Self::Integer(message.integer_value),
            3 => Self::Double(message.double_value),
            4 => Self::Text(message.string_value.clone().into_owned()),
            5 => Self::Bytes(message.byte_array_value.to_vec()),
            6 => Self::Bools(message.bool_array_value.to_vec()),
            7 => Self::Integers(message.integer_array_value.to_vec()),
            8 => Self::Doubles(message.double_array_value.to_vec()),
            9 => Self::Texts(message.string_array_value.iter().map(|text| text.clone().into_owned()).collect()),
            _ => Self::NotSet,
        }
    }

    pub(super) fn message(&self) -> ValueMessage<'_> {
        let mut message = ValueMessage { r#type: self.kind() as u8, ..ValueMessage::default() };
        match self {
            Self::NotSet => {}
            Self::Bool(value) => message.bool_value = *value,
            Self::Integer(value) => message.integer_value = *value,
            Self::Double(value) => message.double_value = *value,
            Self::Text(value) => message.string_value = Cow::Borrowed(value),
            Self::Bytes(values) => message.byte_array_value = values,
            Self::Bools(values) => message.bool_array_value = values[..].into(),
            Self::Integers(values) => message.integer_array_value = values[..].into(),
            Self::Doubles(values) => message.double_array_value = values[..].into(),
            Self::Texts(values) => {
                message.string_array_value = values.iter().map(|text| text.as_str().into()).collect()
            }
        }
        message
    }

    /// The same as another kind, where nothing is lost: integers are doubles, and an empty list is one of anything.
    ///
    /// # Errors
    /// Where it is of yet another kind.
    pub(super) fn into_kind(self, kind: ParameterKind) -> Result<Self, Misfit> {
        let is_empty = matches!(&self, Self::Bools(v) if v.is_empty())
            || matches!(&self, Self::Integers(v) if v.is_empty())
            || matches!(&self, Self::Doubles(v) if v.is_empty())
            || matches!(&self, Self::Texts(v) if v.is_empty());
        match (self, kind) {
            (value, kind) if value.kind() == kind => Ok(value),
            (Self::Integer(value), ParameterKind::Double) => Ok(Self::Double(value as f64)),
            (Self::Integers(values), ParameterKind::Doubles) => {
                Ok(Self::Doubles(values.into_iter().map(|value| value as f64).collect()))
            }
            (_, ParameterKind::Doubles) if is_empty => Ok(Self::Doubles(Vec::new())),
            (value, kind) => Err(Misfit::new(kind, value.kind())),
        }
    }
}
