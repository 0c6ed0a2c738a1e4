//! Parameters by the names that slam_toolbox and AMCL have for them, where ours mean the same.
//!
//! One setting may have several names, such as `base_frame` and `base_frame_id`: who sets one sees it in the others. What those nodes have and this one does
//! not need is known by name, so that a parameter file of theirs can be taken as it is ([`Parameters::take`]).

mod file;
mod table;
mod value;

pub use file::ParameterFile;
pub use table::{Setting, When};
pub use value::{ParameterKind, ParameterValue};

use super::{NodeError, NodeName, bytes_of, decode, excerpt};
use mapwright_geom::Stamp;
use mapwright_ros::messages::parameters::{
    DescribeParametersResponse, FloatingPointRange, GetParameterTypesResponse, GetParametersResponse, IntegerRange,
    ListParametersRequest, ListParametersResponse, ListParametersResult, Parameter, ParameterDescriptor,
    ParameterEvent, ParameterNames, SetParametersAtomicallyResponse, SetParametersRequest, SetParametersResponse,
    SetParametersResult,
};
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use table::{Entry, IGNORED, TABLE};
use value::Misfit;

/// A request may name so many parameters; one of more is refused.
const NAMES_MOST: usize = 1000;

/// A service that reads or sets parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ParameterService {
    /// Values.
    Get,
    /// Kinds.
    Types,
    /// Descriptions.
    Describe,
    /// Names.
    List,
    /// Sets each for itself.
    Set,
    /// Sets all or none.
    SetAtomically,
}

/// Names and types of the six services below a node.
#[must_use]
pub fn services(node: &NodeName) -> [(String, &'static str, ParameterService); 6] {
    use ParameterService::{Describe, Get, List, Set, SetAtomically, Types};
    [
        (node.below("get_parameters"), "rcl_interfaces/srv/GetParameters", Get),
        (node.below("get_parameter_types"), "rcl_interfaces/srv/GetParameterTypes", Types),
        (node.below("describe_parameters"), "rcl_interfaces/srv/DescribeParameters", Describe),
        (node.below("list_parameters"), "rcl_interfaces/srv/ListParameters", List),
        (node.below("set_parameters"), "rcl_interfaces/srv/SetParameters", Set),
        (node.below("set_parameters_atomically"), "rcl_interfaces/srv/SetParametersAtomically", SetAtomically),
    ]
}

/// A setting that is another now.
#[derive(Debug, Clone, PartialEq)]
pub struct Change {
    /// Which.
    pub setting: Setting,
    /// The name by which it was set.
    pub name: &'static str,
    /// What it is.
    pub value: ParameterValue,
}

/// What a request of a parameter service is answered.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Answered {
    /// The response.
    pub bytes: Vec<u8>,
    /// What is another now, in order. [`Parameters::event`] tells all others.
    pub changes: Vec<Change>,
    /// What was refused and why, in words.
    pub refusals: Vec<String>,
}

/// What a parameter file brought besides what was set.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Taken {
    /// Names that slam_toolbox or AMCL have, without a meaning here.
    pub ignored: Vec<String>,
    /// Names that are none of ours nor theirs.
    pub unknown: Vec<String>,
}

impl Taken {
    /// Lines for the log, one of each kind.
    #[must_use]
    pub fn words(&self) -> Vec<String> {
        let line = |what: &str, names: &[String]| (!names.is_empty()).then(|| format!("{what}: {}", names.join(", ")));
        let ignored = line("parameters without a meaning here are ignored", &self.ignored);
        ignored.into_iter().chain(line("parameters that nobody knows", &self.unknown)).collect()
    }
}

/// A node's parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameters {
    values: BTreeMap<Setting, ParameterValue>,
    is_configured: bool,
}

impl Default for Parameters {
    fn default() -> Self {
        let values = TABLE.iter().map(|entry| (entry.setting, entry.default.value())).collect();
        Self { values, is_configured: false }
    }
}

impl Parameters {
    /// That the node is configured, or not any more: what is read then ([`When::Configuring`]) is fixed while it is.
    pub fn set_configured(&mut self, is_configured: bool) {
        self.is_configured = is_configured;
    }

    /// What a setting is.
    #[must_use]
    pub fn get(&self, setting: Setting) -> &ParameterValue {
        const NONE: &ParameterValue = &ParameterValue::NotSet;
        self.values.get(&setting).unwrap_or(NONE)
    }

    /// A setting that is yes or no; no where it is of another kind.
    #[must_use]
    pub fn flag(&self, setting: Setting) -> bool {
        matches!(self.get(setting), ParameterValue::Bool(true))
    }

    /// A setting that is a number; NaN where it is of another kind.
    #[must_use]
    pub fn number(&self, setting: Setting) -> f64 {
        if let ParameterValue::Double(number) = self.get(setting) { *number } else { f64::NAN }
    }

    /// A setting that is a text; empty where it is of another kind.
    #[must_use]
    pub fn text(&self, setting: Setting) -> &str {
        if let ParameterValue::Text(text) = self.get(setting) { text } else { "" }
    }

    /// Says what a setting is that others cannot set, such as [`Setting::Paused`], or sets one regardless of when that is possible.
    ///
    /// # Errors
    /// [`NodeError::Request`] where the value is none of this setting's.
    pub fn tell(&mut self, setting: Setting, value: ParameterValue) -> Result<(), NodeError> {
        let refuse = |words| NodeError::Request { what: "a setting", expected: "a value of it", found: words };
        let entry = TABLE.iter().find(|entry| entry.setting == setting);
        let entry = entry.ok_or_else(|| refuse(format!("{setting:?}")))?;
        let value = entry.fit(value).map_err(|misfit| refuse(misfit.to_string()))?;
        self.values.insert(setting, value);
        Ok(())
    }

    /// Sets the parameter of a name.
    ///
    /// # Errors
    /// Why it cannot be set, in words.
    pub fn set(&mut self, name: &str, value: ParameterValue) -> Result<Change, String> {
        let change = self.check(name, value)?;
        self.values.insert(change.setting, change.value.clone());
        Ok(change)
    }

    /// Takes what a parameter file says of a node, the last word of each name.
    ///
    /// # Errors
    /// [`NodeError::File`] with the line of a value that cannot be; nothing is set then.
    pub fn take(&mut self, file: &ParameterFile, node: &NodeName) -> Result<Taken, NodeError> {
        let mut values = self.values.clone();
        let (mut ignored, mut unknown) = (BTreeSet::new(), BTreeSet::new());
        for (name, line, value) in file.of(node)? {
            let Some((entry, own)) = table::find(&name) else {
                let is_theirs = IGNORED.contains(&name.as_str()) || name.starts_with("qos_overrides.");
                if is_theirs {
                    ignored.insert(name)
                } else {
                    unknown.insert(name)
                };
                continue;
            };
            let refuse = |misfit: Misfit| {
                let expected = format!("{} as `{own}`", misfit.expected);
                NodeError::File { line, expected, found: misfit.found }
            };
            values.insert(entry.setting, entry.fit(value).map_err(refuse)?);
        }
        self.values = values;
        Ok(Taken { ignored: ignored.into_iter().collect(), unknown: unknown.into_iter().collect() })
    }

    /// The answer to a request. A request that is none is answered with an empty response.
    pub fn answer(&mut self, service: ParameterService, request: &[u8]) -> Answered {
        let answered = match service {
            ParameterService::Get => self.names(request, Self::values_of),
            ParameterService::Types => self.names(request, Self::kinds_of),
            ParameterService::Describe => self.names(request, Self::descriptions_of),
            ParameterService::List => list(request),
            ParameterService::Set => self.set_each(request),
            ParameterService::SetAtomically => self.set_all(request),
        };
        answered.unwrap_or_else(|error| {
            let words = error.to_string();
            let bytes = match service {
                ParameterService::Get => bytes_of(&GetParametersResponse::default()),
                ParameterService::Types => bytes_of(&GetParameterTypesResponse::default()),
                ParameterService::Describe => bytes_of(&DescribeParametersResponse::default()),
                ParameterService::List => bytes_of(&ListParametersResponse::default()),
                ParameterService::Set => bytes_of(&SetParametersResponse::default()),
                ParameterService::SetAtomically => {
                    bytes_of(&SetParametersAtomicallyResponse { result: result(Some(&words)) })
                }
            };
            Answered { bytes, changes: Vec::new(), refusals: vec![words] }
        })
    }

    /// A `rcl_interfaces/ParameterEvent` for the topic `/parameter_events`.
    #[must_use]
    pub fn event(node: &NodeName, stamp: Stamp, changes: &[Change]) -> Vec<u8> {
        let changed_parameters = changes.iter().map(|change| message(change.name, &change.value)).collect();
        bytes_of(&ParameterEvent { stamp, node: node.full().into(), changed_parameters, ..ParameterEvent::default() })
    }

    fn names(&self, request: &[u8], answer: impl Fn(&Self, &[Cow<'_, str>]) -> Vec<u8>) -> Result<Answered, NodeError> {
        let names = decode::<ParameterNames<'_>>(request)?.names;
        check_count(names.len())?;
        Ok(Answered { bytes: answer(self, &names), ..Answered::default() })
    }

    fn value(&self, name: &str) -> &ParameterValue {
        table::find(name).map_or(&ParameterValue::NotSet, |(entry, _)| self.get(entry.setting))
    }

    fn values_of(&self, names: &[Cow<'_, str>]) -> Vec<u8> {
        bytes_of(&GetParametersResponse { values: names.iter().map(|name| self.value(name).message()).collect() })
    }

    fn kinds_of(&self, names: &[Cow<'_, str>]) -> Vec<u8> {
        let types: Vec<_> = names.iter().map(|name| self.value(name).kind() as u8).collect();
        bytes_of(&GetParameterTypesResponse { types: &types })
    }

    fn descriptions_of(&self, names: &[Cow<'_, str>]) -> Vec<u8> {
        let describe = |name: &Cow<'_, str>| match table::find(name) {
            Some((entry, own)) => self.describe(entry, own),
            None => ParameterDescriptor { name: excerpt(name).into(), ..ParameterDescriptor::default() },
        };
        bytes_of(&DescribeParametersResponse { descriptors: names.iter().map(describe).collect() })
    }

    fn describe(&self, entry: &Entry, name: &'static str) -> ParameterDescriptor<'static> {
        let others: Vec<_> =
            entry.names.iter().filter(|other| **other != name).map(|other| format!("`{other}`")).collect();
        let others = if others.is_empty() { String::new() } else { format!(" The same as {}.", others.join(", ")) };
        let range = entry.range.map(|(from_value, to_value)| FloatingPointRange { from_value, to_value, step: 0.0 });
        ParameterDescriptor {
            name: name.into(),
            r#type: self.get(entry.setting).kind() as u8,
            description: format!("{}{others}", entry.means).into(),
            additional_constraints: entry.constraints().into(),
            read_only: !self.is_open(entry.when),
            dynamic_typing: false,
            floating_point_range: range.into_iter().collect(),
            integer_range: Vec::<IntegerRange>::new(),
        }
    }

    fn is_open(&self, when: When) -> bool {
        match when {
            When::Running => true,
            When::Configuring => !self.is_configured,
            When::Never => false,
        }
    }

    fn check(&self, name: &str, value: ParameterValue) -> Result<Change, String> {
        let (entry, name) = table::find(name).ok_or_else(|| unknown(name))?;
        match entry.when {
            When::Never => return Err(format!("`{name}` says what is and cannot be set")),
            when if !self.is_open(when) => {
                return Err(format!(
                    "`{name}` is read when the node is configured: it can be set before that or in a parameter file"
                ));
            }
            _ => {}
        }
        let value = entry.fit(value).map_err(|misfit| format!("`{name}`: {misfit}"))?;
        Ok(Change { setting: entry.setting, name, value })
    }

    fn set_each(&mut self, request: &[u8]) -> Result<Answered, NodeError> {
        let asked = wanted(request)?;
        let mut answered = Answered::default();
        let mut results = Vec::with_capacity(asked.len());
        for (name, value) in asked {
            match self.set(&name, value) {
                Ok(change) => {
                    answered.changes.push(change);
                    results.push(result(None));
                }
                Err(words) => {
                    results.push(result(Some(&words)));
                    answered.refusals.push(words);
                }
            }
        }
        answered.bytes = bytes_of(&SetParametersResponse { results });
        Ok(answered)
    }

    fn set_all(&mut self, request: &[u8]) -> Result<Answered, NodeError> {
        let checked = wanted(request)?.into_iter().map(|(name, value)| self.check(&name, value)).collect();
        let checked: Result<Vec<_>, _> = checked;
        let bytes = |words: Option<&str>| bytes_of(&SetParametersAtomicallyResponse { result: result(words) });
        Ok(match checked {
            Ok(changes) => {
                for change in &changes {
                    self.values.insert(change.setting, change.value.clone());
                }
                Answered { bytes: bytes(None), changes, refusals: Vec::new() }
            }
            Err(words) => Answered { bytes: bytes(Some(&words)), changes: Vec::new(), refusals: vec![words] },
        })
    }
}

/// A name and a value as they are sent.
pub(super) fn message<'a>(name: &'a str, value: &'a ParameterValue) -> Parameter<'a> {
    Parameter { name: Cow::Borrowed(name), value: value.message() }
}

fn check_count(found: usize) -> Result<(), NodeError> {
    if found <= NAMES_MOST {
        return Ok(());
    }
    Err(NodeError::Request { what: "names", expected: "at most 1000", found: found.to_string() })
}

/// What a request wants set.
fn wanted(request: &[u8]) -> Result<Vec<(String, ParameterValue)>, NodeError> {
    let asked = decode::<SetParametersRequest<'_>>(request)?.parameters;
    check_count(asked.len())?;
    Ok(asked.iter().map(|parameter| (excerpt(&parameter.name), ParameterValue::of(&parameter.value))).collect())
}

fn result(refused: Option<&str>) -> SetParametersResult<'static> {
    SetParametersResult { successful: refused.is_none(), reason: refused.unwrap_or_default().to_owned().into() }
}

fn unknown(name: &str) -> String {
    if IGNORED.contains(&name) {
        return format!("`{name}` has no meaning here; slam_toolbox or AMCL need it");
    }
    let near = table::nearest(name)
        .map_or_else(|| "list_parameters says which there are".to_owned(), |near| format!("is `{near}` meant?"));
    format!("no parameter `{name}` here; {near}")
}

/// Names below groups, as `rclcpp::Node::list_parameters` gives them.
fn list(request: &[u8]) -> Result<Answered, NodeError> {
    let asked = decode::<ListParametersRequest<'_>>(request)?;
    check_count(asked.prefixes.len())?;
    let is_shallow = |rest: &str| asked.depth == 0 || (rest.matches('.').count() as u64) < asked.depth;
    let is_below = |name: &str, prefix: &str| {
        let rest = name.strip_prefix(prefix).and_then(|rest| rest.strip_prefix('.'));
        name == prefix || rest.is_some_and(is_shallow)
    };
    let is_wanted = |name: &&str| match &asked.prefixes[..] {
        [] => is_shallow(name),
        prefixes => prefixes.iter().any(|prefix| is_below(name, prefix)),
    };
    let names: BTreeSet<_> = TABLE.iter().flat_map(|entry| entry.names).copied().filter(is_wanted).collect();
    let prefixes: BTreeSet<_> = names.iter().filter_map(|name| Some(name.rsplit_once('.')?.0)).collect();
    let cows = |texts: BTreeSet<&'static str>| texts.into_iter().map(Cow::Borrowed).collect();
    let bytes = bytes_of(&ListParametersResponse {
        result: ListParametersResult { names: cows(names), prefixes: cows(prefixes) },
    });
    Ok(Answered { bytes, ..Answered::default() })
}
