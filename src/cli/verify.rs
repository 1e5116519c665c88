//! `headway verify`: whether a database is what was written.

use std::path::PathBuf;

use anyhow::{Context, bail};
use clap::Args;
use serde::Serialize;

use super::looking::Bar;
use super::waiting::block_on;
use crate::lineage::ModelName;
use crate::scheduler::{MOST_THREADS, Retrained, retrain};
use crate::store::Store;
use crate::store::verify::{Verification, verify};

/// What `headway verify` can be told.
#[derive(Debug, Args)]
pub(super) struct VerifyArguments {
    /// The database file. A server may be running on it: nothing is written
    #[arg(long, value_name = "FILE")]
    database: PathBuf,
    /// Learn a version again from the events of its ledger, and compare the digest of its weights: a version of the model
    /// `default`, or MODEL@VERSION. As often as needed; each takes as long as its task did
    #[arg(long, value_name = "[MODEL@]VERSION", value_parser = wish)]
    retrain: Vec<Wish>,
    /// Print one JSON object instead of tables
    #[arg(long)]
    json: bool,
}

/// A version to be learned again.
#[derive(Debug, Clone)]
struct Wish {
    model: ModelName,
    version: i64,
}

fn wish(text: &str) -> Result<Wish, String> {
    let (model, version) = text.rsplit_once('@').unwrap_or(("default", text));
    let model = ModelName::parse(model).map_err(|e| e.to_string())?;
    Ok(Wish { model, version: version.parse().map_err(|_| format!("{version} is no version"))? })
}

/// What came out, for programs.
#[derive(Debug, Serialize)]
struct Report {
    sound: bool,
    #[serde(flatten)]
    verification: Verification,
    /// Faults in all; `faults` lists the first of them.
    faults_in_all: u64,
    retrained: Vec<Again>,
}

#[derive(Debug, Serialize)]
struct Again {
    model: ModelName,
    same: bool,
    #[serde(flatten)]
    retrained: Retrained,
}

/// Verifies, and fails unless everything is as it must be.
pub(super) fn run(arguments: &VerifyArguments) -> anyhow::Result<()> {
    let bar = Bar::new();
    let (verification, retrained) = block_on(async {
        let verification = verify(&arguments.database, &|looking| bar.show(looking)).await?;
        let mut retrained = Vec::new();
        if !arguments.retrain.is_empty() {
            let store = Store::open_to_read(&arguments.database).await?;
            for wish in &arguments.retrain {
                retrained.push(again(&store, wish, &bar).await?);
            }
        }
        anyhow::Ok((verification, retrained))
    })?;
    bar.end();
    let sound = verification.is_sound() && retrained.iter().all(|again| again.same);
    let faults_in_all = verification.faults_in_all();
    Report { sound, verification, faults_in_all, retrained }.print(arguments.json)?;
    if !sound {
        bail!("{} is not what was written", arguments.database.display());
    }
    Ok(())
}

async fn again(store: &Store, wish: &Wish, bar: &Bar) -> anyhow::Result<Again> {
    let Wish { model, version } = wish;
    let known = store.model(model).await?.with_context(|| format!("there is no model {model}"))?;
    let threads = std::thread::available_parallelism().map_or(1, usize::from).min(MOST_THREADS);
    let label = format!("{model}@{version}");
    let retrained = retrain(store, known.model_id, *version, threads, &mut |share| bar.share(&label, share)).await;
    let retrained = retrained.with_context(|| format!("cannot learn {label} again"))?;
    Ok(Again { model: model.clone(), same: retrained.is_same(), retrained })
}

impl Report {
    #[expect(clippy::print_stdout, reason = "the result")]
    fn print(&self, json: bool) -> anyhow::Result<()> {
        if json {
            println!("{}", serde_json::to_string_pretty(self)?);
            return Ok(());
        }
        let Verification { database, schema, checks, faults } = &self.verification;
        println!("{}, schema {schema}\n", database.display());
        println!("| check | looked at | faults |\n| --- | --- | --- |");
        for checked in checks {
            println!("| {} | {} | {} |", checked.check, checked.looked_at, checked.faults);
        }
        for Again { model, same, retrained } in &self.retrained {
            let Retrained { version, kernel, this_kernel, weights_sha256, again_sha256, .. } = retrained;
            let verdict = match (same, kernel == this_kernel) {
                _ if !retrained.same_events => "not all of the events that it learned are there any more".to_owned(),
                (true, _) => format!("learned again, its weights are the same: {weights_sha256}"),
                (false, true) => format!("learned again, its weights are {again_sha256}, not {weights_sha256}"),
                (false, false) => format!("learned by kernel {kernel}, this machine has {this_kernel}: other bits"),
            };
            println!("\n{model}, version {version}: {verdict}");
        }
        if !faults.is_empty() {
            println!("\n{} faults:", self.faults_in_all);
        }
        for fault in faults {
            println!("  {}: {}: {}", fault.check, fault.place, fault.detail);
        }
        println!("\n{}", if self.sound { "all is well" } else { "not all is well" });
        Ok(())
    }
}
