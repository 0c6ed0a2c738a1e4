//! What is asked of those who map and draw, and what they say.

use mapwright::{Entry, Session};
use mapwright_live::node::asked::{Said, Why};
use mapwright_live::outgoing::Grid;
use mapwright_record::Measurement;
use std::sync::mpsc::SyncSender;

/// What comes of what somebody asks.
pub(super) enum Reply {
    Said(Said<'static>),
    Map(Grid),
}

impl Reply {
    pub(super) fn refused(why: Why, words: impl Into<String>) -> Self {
        Self::Said(Said::Refused(why, words.into()))
    }
}

/// What the drawer is told.
pub(super) enum ToDraw<M: Measurement> {
    /// What was written down.
    Entries(Vec<Entry<M>>),
    /// Everything begins anew, with this.
    Anew(Box<Session<M>>),
    /// Somebody wants the map as it is.
    Map(SyncSender<Reply>),
    /// Somebody wants the map in files of a name.
    Save { name: String, reply: SyncSender<Reply> },
    /// Somebody wants the session in a file.
    Serialize { file: String, reply: SyncSender<Reply> },
    /// Nothing more comes.
    End,
}
