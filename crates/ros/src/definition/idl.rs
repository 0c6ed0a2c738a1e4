//! The part of OMG IDL that ROS 2 generates: modules, structs, constants, typedefs, sequences and arrays.

use super::{Field, Message, Place, is_identifier};
use crate::error::RosError;
use crate::schema::{Arity, Constant};
use std::collections::BTreeMap;

/// Messages by their name. Lines of `=` and `IDL: package/msg/Type` are passed over: modules say the same.
pub(super) fn parse(root: &str, text: &str) -> Result<BTreeMap<String, Message>, RosError> {
    let tokens = tokens(root, text)?;
    let mut parser =
        Parser { root, tokens: &tokens, scope: Vec::new(), typedefs: BTreeMap::new(), out: BTreeMap::new() };
    while !parser.tokens.is_empty() {
        parser.declaration()?;
    }
    if !parser.out.contains_key(root) {
        return Err(Place { root, line: 1 }.refuse("a struct of that name", root));
    }
    Ok(parser.out)
}

/// A word, number, text or single sign, and its line.
#[derive(Debug, Clone, Copy)]
struct Token<'a> {
    text: &'a str,
    line: usize,
}

fn tokens<'a>(root: &str, text: &'a str) -> Result<Vec<Token<'a>>, RosError> {
    let mut tokens = Vec::new();
    let mut in_comment = false;
    for (index, line) in text.lines().enumerate() {
        let trimmed = line.trim();
        let skip = trimmed.starts_with('#') || trimmed.starts_with("IDL:") || trimmed.starts_with("===");
        let mut rest = if skip && !in_comment { "" } else { trimmed };
        while !rest.is_empty() {
            let length = token_length(rest, &mut in_comment);
            let length =
                length.ok_or_else(|| Place { root, line: index + 1 }.refuse("a text's closing quote", rest))?;
            let (token, behind) = rest.split_at(length.bytes);
            if length.counts {
                tokens.push(Token { text: token, line: index + 1 });
            }
            rest = behind.trim_start();
        }
    }
    Ok(tokens)
}

struct Length {
    bytes: usize,
    counts: bool,
}

fn token_length(rest: &str, in_comment: &mut bool) -> Option<Length> {
    let skipped = |bytes| Some(Length { bytes, counts: false });
    if *in_comment {
        let end = rest.find("*/");
        *in_comment = end.is_none();
        return skipped(end.map_or(rest.len(), |end| end + 2));
    }
    if rest.starts_with("//") {
        return skipped(rest.len());
    }
    if rest.starts_with("/*") {
        *in_comment = true;
        return skipped(2);
    }
    let is_word = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '.' | '+' | '-');
    let first = rest.chars().next()?;
    let bytes = match first {
        '"' => closing_quote(rest)?,
        ':' if rest.starts_with("::") => 2,
        c if is_word(c) => rest.find(|c| !is_word(c)).unwrap_or(rest.len()),
        c => c.len_utf8(),
    };
    Some(Length { bytes, counts: true })
}

fn closing_quote(rest: &str) -> Option<usize> {
    let mut escaped = false;
    for (at, c) in rest.char_indices().skip(1) {
        match c {
            _ if escaped => escaped = false,
            '\\' => escaped = true,
            '"' => return Some(at + 1),
            _ => {}
        }
    }
    None
}

#[derive(Debug, Clone)]
struct IdlType {
    base: String,
    arity: Arity,
}

struct Parser<'a> {
    root: &'a str,
    tokens: &'a [Token<'a>],
    scope: Vec<String>,
    typedefs: BTreeMap<String, IdlType>,
    out: BTreeMap<String, Message>,
}

impl<'a> Parser<'a> {
    fn declaration(&mut self) -> Result<(), RosError> {
        let token = self.next()?;
        match token.text {
            "module" => {
                let name = self.identifier()?.to_owned();
                self.scope.push(name);
                self.expect("{")
            }
            "}" if self.scope.pop().is_some() => self.expect(";"),
            "struct" => self.structure(),
            "typedef" => self.typedef(),
            "const" => self.constant(),
            "@" => self.annotation(),
            other => Err(self.refuse(token, "module, struct, typedef, const or `}`", other)),
        }
    }

    fn structure(&mut self) -> Result<(), RosError> {
        let name = self.scoped(self.tokens.first().map_or("", |token| token.text));
        self.identifier()?;
        self.expect("{")?;
        let mut fields = Vec::new();
        while !self.accept("}") {
            if self.accept("@") {
                self.annotation()?;
                continue;
            }
            let line = self.tokens.first().map_or(0, |token| token.line);
            let kind = self.kind(0)?;
            let (name, kind) = self.declarator(kind)?;
            let type_text = kind.base.clone();
            fields.push(Field { name, type_text, base: kind.base, arity: kind.arity, line });
        }
        self.expect(";")?;
        self.out.entry(name).or_default().fields = fields;
        Ok(())
    }

    /// `typedef double double__36[36];`
    fn typedef(&mut self) -> Result<(), RosError> {
        let kind = self.kind(0)?;
        let (name, kind) = self.declarator(kind)?;
        self.typedefs.insert(name, kind);
        Ok(())
    }

    /// `module Type_Constants { const int32 NAME = 1; }` belongs to `Type`.
    fn constant(&mut self) -> Result<(), RosError> {
        let type_name = self.kind(0)?.base;
        let name = self.identifier()?.to_owned();
        self.expect("=")?;
        let mut value = String::new();
        while !self.accept(";") {
            value.push_str(self.next()?.text);
        }
        let module = self.scope.last().cloned().unwrap_or_default();
        if let Some(message) = module.strip_suffix("_Constants") {
            let owner = format!("{}/{message}", self.scope.first().map_or("", String::as_str));
            self.out.entry(owner).or_default().constants.push(Constant { type_name, name, value });
        }
        Ok(())
    }

    /// `@verbatim (language="comment", text="...")`; what it says is passed over.
    fn annotation(&mut self) -> Result<(), RosError> {
        self.identifier()?;
        if self.accept("(") {
            while !self.accept(")") {
                self.next()?;
            }
        }
        Ok(())
    }

    /// A name and perhaps `[N]`, up to the semicolon.
    fn declarator(&mut self, kind: IdlType) -> Result<(String, IdlType), RosError> {
        let name = self.identifier()?.to_owned();
        let mut kind = kind;
        if self.accept("[") {
            kind = IdlType { arity: self.listed(&kind, Arity::Fixed(self.peek_number()?))?, ..kind };
            self.next()?;
            self.expect("]")?;
        }
        self.expect(";")?;
        Ok((name, kind))
    }

    fn kind(&mut self, depth: usize) -> Result<IdlType, RosError> {
        let token = self.next()?;
        if depth > 1 {
            return Err(self.refuse(token, "a list of numbers, texts or messages", "a list of lists"));
        }
        let one = |base: &str| IdlType { base: base.to_owned(), arity: Arity::One };
        Ok(match token.text {
            "sequence" => return self.sequence(depth),
            "string" | "wstring" => {
                self.bound()?;
                one(token.text)
            }
            "boolean" => one("bool"),
            "octet" | "char" => one("uint8"),
            "float" => one("float32"),
            "double" => one("float64"),
            "short" => one("int16"),
            "long" => one(if self.accept("long") { "int64" } else { "int32" }),
            "unsigned" => self.unsigned()?,
            name => self.named(name)?,
        })
    }

    fn unsigned(&mut self) -> Result<IdlType, RosError> {
        let token = self.next()?;
        let base = match token.text {
            "short" => "uint16",
            "long" if self.accept("long") => "uint64",
            "long" => "uint32",
            other => return Err(self.refuse(token, "`short` or `long`", other)),
        };
        Ok(IdlType { base: base.to_owned(), arity: Arity::One })
    }

    fn sequence(&mut self, depth: usize) -> Result<IdlType, RosError> {
        self.expect("<")?;
        let inner = self.kind(depth + 1)?;
        let mut arity = Arity::Any;
        if self.accept(",") {
            arity = Arity::AtMost(self.peek_number()?);
            self.next()?;
        }
        self.expect(">")?;
        Ok(IdlType { arity: self.listed(&inner, arity)?, ..inner })
    }

    fn listed(&self, inner: &IdlType, arity: Arity) -> Result<Arity, RosError> {
        let token = self.tokens.first().copied().unwrap_or(Token { text: "", line: 0 });
        if inner.arity == Arity::One { Ok(arity) } else { Err(self.refuse(token, "one dimension", "several")) }
    }

    fn bound(&mut self) -> Result<(), RosError> {
        if self.accept("<") {
            self.peek_number()?;
            self.next()?;
            self.expect(">")?;
        }
        Ok(())
    }

    /// A typedef, a plain name such as `int32`, or `package::msg::Type`.
    fn named(&mut self, first: &str) -> Result<IdlType, RosError> {
        let mut path = vec![first.to_owned()];
        while self.accept("::") {
            path.push(self.identifier()?.to_owned());
        }
        let last = path.last().cloned().unwrap_or_default();
        if let Some(kind) = self.typedefs.get(&last) {
            return Ok(kind.clone());
        }
        let base = match path.len() {
            1 if crate::schema::Primitive::from_name(&last).is_some() => last,
            1 => self.scoped(&last),
            _ => format!("{}/{last}", path[0]),
        };
        Ok(IdlType { base, arity: Arity::One })
    }

    fn scoped(&self, name: &str) -> String {
        format!("{}/{name}", self.scope.first().map_or("", String::as_str))
    }

    fn peek_number(&self) -> Result<usize, RosError> {
        let token = self.tokens.first().copied().unwrap_or(Token { text: "the end", line: 0 });
        let number = token.text.parse::<u32>().map_err(|_| self.refuse(token, "a number", token.text))?;
        Ok(number as usize)
    }

    fn identifier(&mut self) -> Result<&'a str, RosError> {
        let token = self.next()?;
        if is_identifier(token.text) { Ok(token.text) } else { Err(self.refuse(token, "a name", token.text)) }
    }

    fn expect(&mut self, sign: &'static str) -> Result<(), RosError> {
        let token = self.next()?;
        if token.text == sign { Ok(()) } else { Err(self.refuse(token, sign, token.text)) }
    }

    fn accept(&mut self, sign: &str) -> bool {
        let found = self.tokens.first().is_some_and(|token| token.text == sign);
        if found {
            self.tokens = &self.tokens[1..];
        }
        found
    }

    fn next(&mut self) -> Result<Token<'a>, RosError> {
        let end = Place { root: self.root, line: 0 };
        let (first, rest) = self.tokens.split_first().ok_or_else(|| end.refuse("more", "the end"))?;
        self.tokens = rest;
        Ok(*first)
    }

    fn refuse(&self, token: Token<'_>, expected: &'static str, found: &str) -> RosError {
        Place { root: self.root, line: token.line }.refuse(expected, found)
    }
}
