//! Tables that a person reads: aligned, numbers to the right, nothing around them.

use comfy_table::presets::NOTHING;
use comfy_table::{CellAlignment, Table};

/// What stands for nothing.
const NONE: &str = "–";

/// A table of these columns; a cell of nothing is told as one.
pub(super) fn table(head: &[&str], rows: Vec<Vec<String>>) -> String {
    let numeric = |column: usize| {
        let mut cells = rows.iter().map(|row| row[column].as_str()).filter(|cell| !cell.is_empty()).peekable();
        cells.peek().is_some() && cells.all(|cell| cell.parse::<f64>().is_ok())
    };
    let numeric: Vec<bool> = (0..head.len()).map(numeric).collect();
    let mut table = Table::new();
    table.load_preset(NOTHING).set_header(head);
    for row in rows {
        table.add_row(row.into_iter().map(|cell| if cell.is_empty() { NONE.to_owned() } else { cell }));
    }
    for (at, numeric) in numeric.into_iter().enumerate() {
        let column = table.column_mut(at).expect("as many as there are heads");
        column.set_padding((0, 2));
        if numeric {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    table.lines().map(|line| line.trim_end().to_owned()).collect::<Vec<_>>().join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_aligned_and_what_is_not_known_is_a_dash() {
        let row = |cells: [&str; 3]| cells.map(str::to_owned).to_vec();
        let rows = vec![row(["fast", "1.50", ""]), row(["slow traffic", "12.25", "live"])];
        assert_eq!(
            table(&["REGIME", "ERROR", "STATE"], rows),
            "REGIME        ERROR  STATE\nfast           1.50  –\nslow traffic  12.25  live"
        );
    }
}
