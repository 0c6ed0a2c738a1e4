//! Whether the definition in a file has what a typed message needs.

use super::Field;
use crate::error::RosError;
use crate::schema::{Arity, Base, FieldType, StructType};
use crate::wire::Encoding;
use std::sync::Arc;

/// How a definition in a file relates to the typed message that is read by it.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Fit {
    /// Whether both have the same fields in the same order, and messages are read straight through.
    pub exact: bool,
    /// Fields of the file's that are passed over.
    pub extra: Vec<String>,
    /// Optional fields that the file's does not have; they come out empty or zero.
    pub missing: Vec<String>,
}

/// A check on its way through a definition.
#[derive(Debug)]
pub struct FitCheck<'s> {
    message: &'s str,
    encoding: Encoding,
    path: Vec<&'static str>,
    fit: Fit,
}

impl<'s> FitCheck<'s> {
    /// Checks a whole message.
    pub(crate) fn run<'a, M: Field<'a>>(kind: &'s Arc<StructType>, encoding: Encoding) -> Result<Fit, RosError> {
        let fit = Fit { exact: true, ..Fit::default() };
        let mut check = Self { message: &kind.name, encoding, path: Vec::new(), fit };
        M::fit(&FieldType::one(Base::Struct(kind.clone())), &mut check)?;
        Ok(check.fit)
    }

    /// How the messages are serialized.
    #[must_use]
    pub fn encoding(&self) -> Encoding {
        self.encoding
    }

    /// The message that a field has to be.
    pub(crate) fn structure(&self, ty: &FieldType, name: &str) -> Result<Arc<StructType>, RosError> {
        match (&ty.base, ty.arity) {
            (Base::Struct(kind), Arity::One) => Ok(kind.clone()),
            _ => Err(self.refuse(ty, name)),
        }
    }

    /// Checks the next field of a message.
    pub(crate) fn member<'a, F: Field<'a>>(
        &mut self,
        kind: &StructType,
        name: &'static str,
        optional: bool,
        next: &mut usize,
    ) -> Result<(), RosError> {
        self.path.push(name);
        match kind.position(name) {
            Some(position) => {
                self.fit.exact &= position == *next;
                F::fit(&kind.fields[position].ty, self)?;
            }
            None if optional => {
                self.fit.exact = false;
                self.fit.missing.push(self.path.join("."));
            }
            None => return Err(self.missing::<F>(kind)),
        }
        *next += 1;
        self.path.pop();
        Ok(())
    }

    /// Notes the fields of a message that are not among `known`.
    pub(crate) fn others(&mut self, kind: &StructType, known: &[&'static str]) {
        for field in &kind.fields {
            if !known.iter().any(|name| kind.position(name).is_some_and(|at| kind.fields[at].name == field.name)) {
                self.fit.exact = false;
                self.fit
                    .extra
                    .push(self.path.iter().copied().chain([field.name.as_str()]).collect::<Vec<_>>().join("."));
            }
        }
    }

    fn missing<'a, F: Field<'a>>(&self, kind: &StructType) -> RosError {
        RosError::MissingField {
            message: self.message.to_owned(),
            field: self.path.join("."),
            expected: type_name::<F>(self),
            found: kind.field_names(),
        }
    }

    /// That the message is not read straight through, whatever else its definition says.
    pub(crate) fn read_by_name(&mut self) {
        self.fit.exact = false;
    }

    /// That a field has another type.
    #[must_use]
    pub fn refuse(&self, found: &FieldType, expected: &str) -> RosError {
        RosError::FieldType {
            message: self.message.to_owned(),
            field: self.path.join("."),
            expected: expected.to_owned(),
            found: found.to_string(),
        }
    }
}

/// The type that a field wants, as it says itself when it is offered something else.
fn type_name<'a, F: Field<'a>>(check: &FitCheck<'_>) -> String {
    let mut probe = FitCheck { message: "", encoding: check.encoding, path: Vec::new(), fit: Fit::default() };
    match F::fit(&FieldType { base: Base::WString, arity: Arity::One }, &mut probe) {
        Err(RosError::FieldType { expected, .. }) => expected,
        _ => "a message".to_owned(),
    }
}
