//! Services: queries with the request as their payload. They are answered one after another on a thread of their own, so that one that takes
//! long keeps nothing else from arriving.

use crate::keys::{Attachment, MESSAGE_MOST, now_ns};
use mapwright_live::wire::Answer;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread::{self, JoinHandle};
use zenoh::key_expr::KeyExpr;
use zenoh::query::Query;
use zenoh::{Session, Wait};

/// Requests that wait at most; who asks then is told so.
const REQUESTS_MOST: usize = 100;

enum Work {
    /// Another service, with the key of its responses.
    Serve(KeyExpr<'static>, Answer),
    /// A request to the service of this number.
    Asked(usize, Query),
    Over,
}

/// Answers services until dropped.
pub(crate) struct Services {
    work: SyncSender<Work>,
    count: usize,
    thread: Option<JoinHandle<()>>,
}

impl Services {
    pub(crate) fn begin() -> io::Result<Self> {
        let (work, given) = sync_channel(REQUESTS_MOST);
        let thread = thread::Builder::new().name("services".to_owned()).spawn(move || answer_until_over(&given))?;
        Ok(Self { work, count: 0, thread: Some(thread) })
    }

    /// Answers requests to `any_key`; a response to one that names no single key has `key`.
    pub(crate) fn serve(
        &mut self,
        session: &Session,
        (key, any_key): (String, String),
        answer: Answer,
    ) -> zenoh::Result<()> {
        let (number, work) = (self.count, self.work.clone());
        let key = KeyExpr::try_from(key)?;
        self.work.send(Work::Serve(key, answer)).map_err(|_| "the thread that answers services has ended")?;
        self.count += 1;
        let asked = move |query: Query| {
            let full = work.try_send(Work::Asked(number, query));
            if let Err(TrySendError::Full(Work::Asked(_, query)) | TrySendError::Disconnected(Work::Asked(_, query))) =
                full
            {
                refuse(&query, "too many requests wait");
            }
        };
        session.declare_queryable(any_key).complete(true).callback(asked).background().wait()
    }
}

impl Drop for Services {
    fn drop(&mut self) {
        let _ = self.work.send(Work::Over);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn answer_until_over(work: &Receiver<Work>) {
    let mut services = Vec::new();
    while let Ok(work) = work.recv() {
        match work {
            Work::Serve(key, answer) => services.push((key, answer)),
            Work::Asked(number, query) => {
                if let Some((key, answer)) = services.get_mut(number) {
                    answer_query(&query, key, answer);
                }
            }
            Work::Over => return,
        }
    }
}

fn answer_query(query: &Query, key: &KeyExpr<'static>, answer: &mut Answer) {
    let Some(asked) = query.attachment().and_then(|bytes| Attachment::from_bytes(&bytes.to_bytes())) else {
        return refuse(query, "expected an attachment of 33 bytes: number, time and sender of the request");
    };
    let Some(request) = query.payload().filter(|request| (4..=MESSAGE_MOST).contains(&request.len())) else {
        return refuse(query, "expected a request in CDR");
    };
    let Ok(response) = catch_unwind(AssertUnwindSafe(|| answer(&request.to_bytes()))) else {
        return refuse(query, "the request could not be answered");
    };
    let key = if query.key_expr().is_wild() { key } else { query.key_expr() };
    let attachment = Attachment { stamp_ns: now_ns(), ..asked }.to_bytes();
    // Whoever has gone meanwhile gets nothing.
    let _ = query.reply(key, response).attachment(attachment).wait();
}

fn refuse(query: &Query, why: &str) {
    let _ = query.reply_err(why).wait();
}
