//! What was measured, for people or for programs.

use serde::Serialize;

use super::timing::{median, quantile};

/// One measured figure.
#[derive(Debug, Serialize)]
pub(super) struct Figure {
    /// A name for programs.
    name: String,
    /// What it is, for people.
    #[serde(skip)]
    says: String,
    /// Of the median and the range.
    unit: &'static str,
    median: f64,
    least: f64,
    greatest: f64,
}

impl Figure {
    /// Of samples of one measurement.
    pub(super) fn new(name: impl Into<String>, says: impl Into<String>, unit: &'static str, samples: &[f64]) -> Self {
        let (least, greatest) = (quantile(samples, 0.0), quantile(samples, 1.0));
        Self { name: name.into(), says: says.into(), unit, median: median(samples), least, greatest }
    }

    /// The middle of its samples.
    pub(super) fn median(&self) -> f64 {
        self.median
    }
}

/// What a benchmark found.
#[derive(Debug, Serialize)]
pub(super) struct Findings {
    /// Name of the arithmetic.
    pub(super) kernel: &'static str,
    /// Hidden units.
    pub(super) hidden: usize,
    /// In the order measured.
    pub(super) figures: Vec<Figure>,
}

impl Findings {
    /// Prints them as a Markdown table, or as JSON.
    #[expect(clippy::print_stdout, reason = "the result")]
    pub(super) fn print(&self, json: bool) -> anyhow::Result<()> {
        if json {
            println!("{}", serde_json::to_string_pretty(self)?);
            return Ok(());
        }
        println!("{} hidden units, kernel {}\n", self.hidden, self.kernel);
        println!("| what | median | least – greatest | unit |");
        println!("| --- | --- | --- | --- |");
        for Figure { says, unit, median, least, greatest, .. } in &self.figures {
            println!("| {says} | {} | {} – {} | {unit} |", digits(*median), digits(*least), digits(*greatest));
        }
        Ok(())
    }
}

/// Three digits, more before the point.
fn digits(value: f64) -> String {
    match value.abs() {
        100.0.. => format!("{value:.0}"),
        10.0.. => format!("{value:.1}"),
        _ => format!("{value:.2}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_keep_three_digits() {
        assert_eq!([1234.5, 12.34, 1.234].map(digits), ["1234", "12.3", "1.23"]);
    }
}
