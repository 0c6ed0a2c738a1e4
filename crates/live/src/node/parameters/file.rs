//! Parameter files of ROS 2: `node: {ros__parameters: {name: value}}`.

use super::value::ParameterValue;
use crate::node::{NodeError, NodeName, excerpt};
use serde::de::{Deserialize, Deserializer, MapAccess, SeqAccess, Visitor};
use serde_saphyr::{NonFiniteFloatPolicy, Spanned};
use std::fmt;

/// Longest file that is read, bytes.
const MOST_BYTES: usize = 1 << 20;
/// The mark between a node and its parameters.
const MARK: &str = "ros__parameters";
/// Deepest nesting of groups and namespaces.
const DEPTH_MOST: usize = 16;

/// A parameter file: what it says of which nodes, in its order.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ParameterFile {
    groups: Vec<Group>,
}

/// What is said of the nodes that a pattern means.
#[derive(Debug, Clone, PartialEq)]
struct Group {
    pattern: String,
    parameters: Tree,
}

/// YAML as it is, with the lines of values.
#[derive(Debug, Clone, PartialEq)]
enum Tree {
    Nothing,
    Bool(bool),
    Integer(i64),
    Double(f64),
    Text(String),
    List(Vec<Tree>),
    Map(Vec<(String, u64, Tree)>),
}

impl ParameterFile {
    /// Reads a file's text. Of values no more is asked than that they are YAML: [`super::Parameters::take`] looks at those of one node, as a file is
    /// often that of many.
    ///
    /// # Errors
    /// [`NodeError::File`] where it is no YAML, or has values without a node.
    pub fn parse(text: &str) -> Result<Self, NodeError> {
        if text.len() > MOST_BYTES {
            let found = format!("{} bytes", text.len());
            return Err(wrong(0, "a file of at most 1 MiB", found));
        }
        if text.lines().all(|line| line.trim().is_empty() || line.trim_start().starts_with('#')) {
            return Ok(Self::default());
        }
        // a file of many nodes may well say of another one that something is infinite
        let options = serde_saphyr::options! { non_finite_float_policy: NonFiniteFloatPolicy::PassThrough };
        let tree: Tree = serde_saphyr::from_str_with_options(text, options).map_err(|error| {
            let line = error.location().map_or(0, |location| location.line());
            let words = error.without_snippet().to_string();
            let words = words.lines().next().unwrap_or("none");
            let words = words.split(" at line ").next().unwrap_or(words);
            wrong(line, "YAML", excerpt(words))
        })?;
        let mut groups = Vec::new();
        match tree {
            Tree::Map(entries) => nodes("", entries, 0, &mut groups)?,
            Tree::Nothing => {}
            other => return Err(wrong(1, "names of nodes", other.words())),
        }
        Ok(Self { groups })
    }

    /// What it says of a node, in its order: name, line and value. `*` in place of a word of the node's name means any, `**` any number of them.
    pub(super) fn of(&self, node: &NodeName) -> Result<Vec<(String, u64, ParameterValue)>, NodeError> {
        let full = node.full();
        let mut values = Vec::new();
        for group in self.groups.iter().filter(|group| is_meant(&group.pattern, &full)) {
            if let Tree::Map(entries) = &group.parameters {
                parameters("", entries, 0, &mut values)?;
            }
        }
        Ok(values)
    }
}

fn wrong(line: u64, expected: &str, found: String) -> NodeError {
    NodeError::File { line, expected: expected.to_owned(), found }
}

/// Namespaces and nodes, up to the mark.
fn nodes(
    above: &str,
    entries: Vec<(String, u64, Tree)>,
    depth: usize,
    groups: &mut Vec<Group>,
) -> Result<(), NodeError> {
    for (name, line, tree) in entries {
        if name == MARK {
            if above.is_empty() {
                return Err(wrong(line, "a node's name or `/**` above `ros__parameters`", "none".to_owned()));
            }
            if !matches!(tree, Tree::Map(_) | Tree::Nothing) {
                return Err(wrong(line, "names and values below `ros__parameters`", tree.words()));
            }
            groups.push(Group { pattern: above.to_owned(), parameters: tree });
            continue;
        }
        let word = name.trim_matches('/');
        let below = if word.is_empty() { above.to_owned() } else { format!("{above}/{word}") };
        match tree {
            Tree::Map(entries) if depth < DEPTH_MOST => nodes(&below, entries, depth + 1, groups)?,
            Tree::Map(_) => return Err(wrong(line, "at most 16 namespaces", "more".to_owned())),
            Tree::Nothing => {}
            other => {
                let expected = format!("`ros__parameters:` below `{}`", excerpt(&name));
                return Err(NodeError::File { line, expected, found: other.words() });
            }
        }
    }
    Ok(())
}

/// Names with their groups in front, dots between.
fn parameters(
    group: &str,
    entries: &[(String, u64, Tree)],
    depth: usize,
    values: &mut Vec<(String, u64, ParameterValue)>,
) -> Result<(), NodeError> {
    for (name, line, tree) in entries {
        let name = if group.is_empty() { name.clone() } else { format!("{group}.{name}") };
        match tree {
            Tree::Map(entries) if depth < DEPTH_MOST => parameters(&name, entries, depth + 1, values)?,
            Tree::Map(_) => return Err(wrong(*line, "at most 16 groups", "more".to_owned())),
            Tree::Nothing => {
                return Err(NodeError::File {
                    line: *line,
                    expected: format!("a value of `{name}`"),
                    found: "none".to_owned(),
                });
            }
            other => {
                let value = other.value().ok_or_else(|| wrong(*line, "a list of values of one kind", other.words()))?;
                values.push((name, *line, value));
            }
        }
    }
    Ok(())
}

/// Whether a pattern means a node: word by word, over the places in the name that it may have come to.
fn is_meant(pattern: &str, node: &str) -> bool {
    let words: Vec<_> = node.split('/').filter(|word| !word.is_empty()).collect();
    let mut reached = vec![false; words.len() + 1];
    reached[0] = true;
    for part in pattern.split('/').filter(|part| !part.is_empty()) {
        if part == "**" {
            let first = reached.iter().position(|is| *is).unwrap_or(reached.len());
            reached[first..].fill(true);
            continue;
        }
        for at in (0..words.len()).rev() {
            reached[at + 1] = reached[at] && (part == "*" || part == words[at]);
        }
        reached[0] = false;
    }
    reached.last().copied().unwrap_or(false)
}

impl Tree {
    fn words(&self) -> String {
        match self {
            Self::Nothing => "nothing".to_owned(),
            Self::Bool(value) => value.to_string(),
            Self::Integer(value) => value.to_string(),
            Self::Double(value) => value.to_string(),
            Self::Text(value) => format!("`{}`", excerpt(value)),
            Self::List(values) => format!("a list of {}", values.len()),
            Self::Map(entries) => format!("{} names", entries.len()),
        }
    }

    /// A value, of a list one whose elements are of a kind; integers among doubles are doubles.
    fn value(&self) -> Option<ParameterValue> {
        Some(match self {
            Self::Nothing | Self::Map(_) => return None,
            Self::Bool(value) => ParameterValue::Bool(*value),
            Self::Integer(value) => ParameterValue::Integer(*value),
            Self::Double(value) => ParameterValue::Double(*value),
            Self::Text(value) => ParameterValue::Text(value.clone()),
            Self::List(values) => return list(values),
        })
    }
}

fn list(values: &[Tree]) -> Option<ParameterValue> {
    let all = |pick: &dyn Fn(&Tree) -> bool| values.iter().all(pick);
    if all(&|tree| matches!(tree, Tree::Integer(_))) && !values.is_empty() {
        let pick = |tree: &Tree| if let Tree::Integer(value) = tree { Some(*value) } else { None };
        return Some(ParameterValue::Integers(values.iter().filter_map(pick).collect()));
    }
    if all(&|tree| matches!(tree, Tree::Integer(_) | Tree::Double(_))) {
        let pick = |tree: &Tree| match tree {
            Tree::Integer(value) => Some(*value as f64),
            Tree::Double(value) => Some(*value),
            _ => None,
        };
        return Some(ParameterValue::Doubles(values.iter().filter_map(pick).collect()));
    }
    if all(&|tree| matches!(tree, Tree::Bool(_))) {
        return Some(ParameterValue::Bools(values.iter().map(|tree| *tree == Tree::Bool(true)).collect()));
    }
    let pick = |tree: &Tree| if let Tree::Text(text) = tree { Some(text.clone()) } else { None };
    values.iter().map(pick).collect::<Option<_>>().map(ParameterValue::Texts)
}

impl<'de> Deserialize<'de> for Tree {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(TreeVisitor)
    }
}

struct TreeVisitor;

impl<'de> Visitor<'de> for TreeVisitor {
    type Value = Tree;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a value, a list or names with values")
    }

    fn visit_unit<E>(self) -> Result<Tree, E> {
        Ok(Tree::Nothing)
    }

    fn visit_bool<E>(self, value: bool) -> Result<Tree, E> {
        Ok(Tree::Bool(value))
    }

    fn visit_i64<E>(self, value: i64) -> Result<Tree, E> {
        Ok(Tree::Integer(value))
    }

    fn visit_u64<E>(self, value: u64) -> Result<Tree, E> {
        Ok(i64::try_from(value).map_or(Tree::Double(value as f64), Tree::Integer))
    }

    fn visit_f64<E>(self, value: f64) -> Result<Tree, E> {
        Ok(Tree::Double(value))
    }

    fn visit_str<E>(self, value: &str) -> Result<Tree, E> {
        Ok(Tree::Text(value.to_owned()))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Tree, A::Error> {
        let mut values = Vec::new();
        while let Some(value) = list.next_element()? {
            values.push(value);
        }
        Ok(Tree::List(values))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Tree, A::Error> {
        let mut entries = Vec::new();
        while let Some(name) = map.next_key::<String>()? {
            let value: Spanned<Tree> = map.next_value()?;
            entries.push((name, value.referenced.line(), value.value));
        }
        Ok(Tree::Map(entries))
    }
}
