//! Names of nodes, and of what hangs below them.

use super::{NodeError, excerpt};

/// The longest name, as `rmw_validate_full_topic_name` has it.
const MOST_BYTES: usize = 247;

/// A node's name with its namespace.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct NodeName {
    /// Empty, or `/` and words with `/` between.
    namespace: String,
    name: String,
}

impl NodeName {
    /// Of `slam_toolbox` or `/robot1/slam_toolbox`.
    ///
    /// # Errors
    /// [`NodeError::Name`].
    pub fn new(full: &str) -> Result<Self, NodeError> {
        let words: Vec<_> = full.strip_prefix('/').unwrap_or(full).split('/').collect();
        match words.split_last() {
            Some((name, above)) if full.len() <= MOST_BYTES && words.iter().all(|word| is_word(word)) => {
                let namespace = above.iter().flat_map(|word| ["/", word]).collect();
                Ok(Self { namespace, name: (*name).to_owned() })
            }
            _ => Err(NodeError::Name { found: excerpt(full) }),
        }
    }

    /// The name alone.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The namespace: `/` where it has none.
    #[must_use]
    pub fn namespace(&self) -> &str {
        if self.namespace.is_empty() { "/" } else { &self.namespace }
    }

    /// With its namespace: `/robot1/slam_toolbox`.
    #[must_use]
    pub fn full(&self) -> String {
        format!("{}/{}", self.namespace, self.name)
    }

    /// Something of the node's own: `/robot1/slam_toolbox/save_map`.
    #[must_use]
    pub fn below(&self, what: &str) -> String {
        format!("{}/{}/{what}", self.namespace, self.name)
    }

    /// Something in the node's namespace: `/robot1/set_initial_pose`. What begins with `/` is in none.
    #[must_use]
    pub fn beside(&self, what: &str) -> String {
        if what.starts_with('/') { what.to_owned() } else { format!("{}/{what}", self.namespace) }
    }
}

fn is_word(word: &str) -> bool {
    word.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
        && word.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_have_namespaces() {
        let node = NodeName::new("/robot1/slam_toolbox").unwrap();
        assert_eq!(node, NodeName::new("robot1/slam_toolbox").unwrap());
        assert_eq!((node.name(), node.full()), ("slam_toolbox", "/robot1/slam_toolbox".to_owned()));
        assert_eq!(node.below("save_map"), "/robot1/slam_toolbox/save_map");
        assert_eq!((node.beside("scan"), node.beside("/scan")), ("/robot1/scan".to_owned(), "/scan".to_owned()));
        assert_eq!(NodeName::new("amcl").unwrap().beside("map_server/load_map"), "/map_server/load_map");
        for wrong in ["", "/", "a b", "a//b", "1a", "ä", "a/", &"a".repeat(300)] {
            assert!(NodeName::new(wrong).is_err(), "{wrong}");
        }
    }
}
