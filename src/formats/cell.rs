//! What tables have in their rows.

use std::borrow::Cow;

/// One value of a row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Cell<'a> {
    /// Empty or null.
    Missing,
    /// A number.
    Number(f64),
    /// Text; a number where one is needed and it reads as one.
    Text(&'a str),
}

/// What a column holds in consecutive rows of one event.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Run<'a> {
    /// The same in all of them.
    Same(Cell<'a>),
    /// Numbers, none of which is missing.
    Numbers(&'a [f64]),
}

impl<'a> Run<'a> {
    pub(super) fn cell(&self, row: usize) -> Cell<'a> {
        match self {
            Self::Same(cell) => *cell,
            Self::Numbers(numbers) => Cell::Number(numbers[row]),
        }
    }
}

/// A cell as text.
pub(super) fn text_of(cell: Cell<'_>) -> Cow<'_, str> {
    match cell {
        Cell::Missing => Cow::from(""),
        Cell::Text(text) => Cow::from(text),
        Cell::Number(number) => Cow::from(number.to_string()),
    }
}
