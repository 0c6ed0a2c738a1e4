//! The topics of a recording, as lines.

use crate::terminal::{count, duration, grouped};
use mapwright_logs::{Survey, TopicSurvey};
use std::fmt::Write;

/// Topics that are listed; of further ones only the number.
const TOPICS_SHOWN: usize = 60;

/// What a recording holds.
pub(super) fn words(name: &str, survey: &Survey) -> String {
    let container = &survey.container;
    let kind = container.container.map_or_else(|| "a recording".to_owned(), |kind| kind.to_string());
    let span_s = survey.recorded().map_or(0.0, |(first, last)| last.secs_since(first));
    let mut text = format!(
        "{name}: {kind}, {}, {} over {}, {} bytes\n",
        count(container.parts.len().max(1) as u64, "file"),
        count(container.messages, "message"),
        duration(span_s),
        grouped(container.file_bytes)
    );
    for topic in survey.topics.iter().take(TOPICS_SHOWN) {
        text += &line(topic);
    }
    if survey.topics.len() > TOPICS_SHOWN {
        let _ = writeln!(text, "topic    and {} more", survey.topics.len() - TOPICS_SHOWN);
    }
    text
}

fn line(topic: &TopicSurvey) -> String {
    let mut text = format!("topic    {} ({}): {}", topic.name, topic.type_name, count(topic.messages, "message"));
    if let Some(rate_hz) = topic.rate_hz() {
        let _ = write!(text, ", {rate_hz:.1} a second");
    }
    if !topic.shape.is_empty() {
        let _ = write!(text, ", {}", topic.shape);
    }
    if !topic.frame().is_empty() {
        let _ = write!(text, ", in '{}'", topic.frame());
    }
    if !topic.child_frame().is_empty() {
        let _ = write!(text, " moving '{}'", topic.child_frame());
    }
    if let Some(error) = &topic.first_error {
        let _ = write!(text, "; {} unreadable: {error}", grouped(topic.undecodable));
    }
    text + "\n"
}
