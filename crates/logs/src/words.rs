//! Words and numbers for people.

use crate::survey::Survey;

/// What is said of a recording, and what of it is damaged, for that may be why.
pub(crate) fn with_damage(reason: &str, survey: &Survey) -> String {
    let lossy = survey.container.damages.iter().find(|(kind, _)| kind.loses_messages());
    let first = lossy.and_then(|(kind, damages)| Some((kind, damages.first.first()?)));
    match first {
        Some((kind, first)) => format!("{reason}; the recording is damaged: {kind}, first at {first}"),
        None => reason.to_owned(),
    }
}

/// `12,345`.
pub(crate) fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let mut out = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            out.push(',');
        }
        out.push(digit);
    }
    out
}

#[cfg(test)]
mod tests {
    #[test]
    fn thousands_are_set_apart() {
        assert_eq!([0, 999, 1000, 1_234_567].map(super::grouped), ["0", "999", "1,000", "1,234,567"]);
    }
}
