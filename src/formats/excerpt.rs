//! Quoting a body in a message without quoting all of it.

/// Most characters of its beginning, and of its end, which says where in the body.
const BEGINNING: usize = 200;
const END: usize = 60;

/// What a library says of a body, which may quote all of it: its beginning and its end.
#[must_use]
pub fn excerpt(error: &impl ToString) -> String {
    let said = error.to_string();
    let length = said.chars().count();
    if length <= BEGINNING + END {
        return said;
    }
    said.chars().take(BEGINNING).chain([' ', '…', ' ']).chain(said.chars().skip(length - END)).collect()
}

/// Text from a body, short enough for a message.
pub(super) fn shortened(text: &str) -> String {
    const MOST: usize = 60;
    if text.chars().count() <= MOST { text.to_owned() } else { text.chars().take(MOST).chain(['…']).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_said_keeps_its_beginning_and_its_end() {
        let said = format!("invalid type: string \"{}\", expected a number at line 1 column 9", "ä".repeat(5000));
        let short = excerpt(&said);
        assert!(
            short.starts_with("invalid type: string \"ä") && short.ends_with("a number at line 1 column 9"),
            "{short}"
        );
        assert!(short.len() < 600);
        assert_eq!(excerpt(&"short"), "short");
    }
}
