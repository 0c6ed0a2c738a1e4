//! From raw messages of one topic to values and typed messages.

use crate::builtin;
use crate::definition::{Definition, DefinitionFormat, short_name};
use crate::encoder::Encoder;
use crate::error::RosError;
use crate::field::{Field, Fit, FitCheck};
use crate::messages::Kind;
use crate::schema::StructType;
use crate::value::{Record, Value, decode_record};
use crate::wire::{Cursor, Encoding};
use std::marker::PhantomData;
use std::sync::Arc;

/// Where a channel's definition is from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DefinitionSource {
    /// It came with the messages.
    File,
    /// The built-in one of the standard type; a file without definitions says nothing about changed messages.
    BuiltIn,
}

/// What is known about the raw messages of a topic.
#[derive(Debug, Clone)]
pub struct Channel {
    encoding: Encoding,
    schema: Arc<StructType>,
    source: DefinitionSource,
}

impl Channel {
    /// A channel of messages of a type, with the definition that came with them or the built-in one. An empty text is
    /// no definition.
    ///
    /// # Errors
    /// What is wrong with the definition, or [`RosError::UnknownType`] where there is none.
    pub fn new(
        type_name: &str,
        encoding: Encoding,
        definition: Option<(DefinitionFormat, &str)>,
    ) -> Result<Self, RosError> {
        let given = definition.filter(|(_, text)| !text.trim().is_empty());
        let (schema, source) = match given {
            Some((format, text)) => (Definition::parse(type_name, format, text)?.schema()?, DefinitionSource::File),
            None => (builtin::definition(type_name, encoding)?.schema()?, DefinitionSource::BuiltIn),
        };
        Ok(Self { encoding, schema, source })
    }

    /// Name of the type, as `package/Type`.
    #[must_use]
    pub fn type_name(&self) -> &str {
        &self.schema.name
    }

    /// How its messages are serialized.
    #[must_use]
    pub fn encoding(&self) -> Encoding {
        self.encoding
    }

    /// What its messages consist of.
    #[must_use]
    pub fn schema(&self) -> &Arc<StructType> {
        &self.schema
    }

    /// Where its definition is from.
    #[must_use]
    pub fn source(&self) -> DefinitionSource {
        self.source
    }

    /// Any message as a tree of values.
    ///
    /// # Errors
    /// [`RosError::Cut`], [`RosError::Trailing`] and others with the field and the byte.
    pub fn value<'a>(&self, message: &'a [u8]) -> Result<Record<'a>, RosError> {
        self.counted_value(message).map(|(record, _)| record)
    }

    fn counted_value<'a>(&self, message: &'a [u8]) -> Result<(Record<'a>, u64), RosError> {
        let mut cursor = Cursor::new(self.encoding, message)?;
        let record = decode_record(&self.schema, &mut cursor)?;
        cursor.finish()?;
        Ok((record, cursor.lossy_texts()))
    }
}

/// Typed messages of a channel.
///
/// Where the file's definition is exactly the standard one, messages are read straight through; otherwise by the file's
/// definition, and fields are taken by name.
#[derive(Debug, Clone)]
pub struct Decoder<K> {
    channel: Channel,
    fit: Fit,
    lossy_texts: u64,
    kind: PhantomData<fn() -> K>,
}

impl<K: Kind> Decoder<K> {
    /// A decoder of a channel's messages as `K`.
    ///
    /// # Errors
    /// [`RosError::MissingField`] and [`RosError::FieldType`] where the file's definition lacks something.
    pub fn new(channel: &Channel) -> Result<Self, RosError> {
        let fit = FitCheck::run::<K::Message<'_>>(&channel.schema, channel.encoding)?;
        Ok(Self { channel: channel.clone(), fit, lossy_texts: 0, kind: PhantomData })
    }

    /// How the file's definition relates to the standard one.
    #[must_use]
    pub fn fit(&self) -> &Fit {
        &self.fit
    }

    /// Texts so far that were no UTF-8.
    #[must_use]
    pub fn lossy_texts(&self) -> u64 {
        self.lossy_texts
    }

    /// A message.
    ///
    /// # Errors
    /// [`RosError::Cut`], [`RosError::Trailing`] and others with the field and the byte.
    pub fn decode<'a>(&mut self, message: &'a [u8]) -> Result<K::Message<'a>, RosError> {
        if !self.fit.exact {
            return self.decode_by_name(message);
        }
        let mut cursor = Cursor::new(self.channel.encoding, message)?;
        let decoded = K::Message::read(&mut cursor)?;
        cursor.finish()?;
        self.lossy_texts += cursor.lossy_texts();
        Ok(decoded)
    }

    /// A message by the file's definition, slower than [`Decoder::decode`] where that reads straight through.
    ///
    /// # Errors
    /// The same.
    pub fn decode_by_name<'a>(&mut self, message: &'a [u8]) -> Result<K::Message<'a>, RosError> {
        let (record, lossy_texts) = self.channel.counted_value(message)?;
        self.lossy_texts += lossy_texts;
        K::Message::pick(&Value::Struct(record))
    }
}

/// The bytes of a message in the standard definition of its type, which [`builtin::text`] gives.
///
/// # Errors
/// [`RosError::TooLong`].
pub fn encode<'a, M: Field<'a>>(message: &M, encoding: Encoding) -> Result<Vec<u8>, RosError> {
    let mut out = Encoder::new(encoding);
    message.write(&mut out);
    out.finish()
}

/// Whether a type's name is one that has a built-in definition.
#[must_use]
pub fn is_built_in(type_name: &str) -> bool {
    builtin::knows(&short_name(type_name))
}
