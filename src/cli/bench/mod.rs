//! `headway bench`: how fast this machine learns and answers, in process, beside what its arithmetic allows.

mod gemm;
mod inference;
mod products;
mod table;
mod timing;
mod training;

use clap::{Args, Subcommand};

/// Arguments of `headway bench`.
#[derive(Debug, Args)]
pub(super) struct BenchArguments {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    /// Closed-loop training and importance, beside the rate of matrix products of the same shapes.
    Training(training::TrainingArguments),
    /// Predictions: windows one by one and thousands together, and the steps of a vehicle's sequence.
    Inference(inference::InferenceArguments),
}

/// Measures, and prints a table or JSON.
///
/// # Errors
/// When an argument cannot be used.
pub(super) fn run(arguments: &BenchArguments) -> anyhow::Result<()> {
    match &arguments.what {
        What::Training(arguments) => training::run(arguments),
        What::Inference(arguments) => inference::run(arguments),
    }
}
