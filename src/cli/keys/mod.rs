//! `headway keys`: make, list and revoke keys, in a database that nobody serves or at a server.

/// Of a database that no server owns.
mod local;
/// Of a server, over its interface.
mod remote;

use std::io::Write;

use anyhow::{Context, bail};
use clap::{Args, Subcommand};
use jiff::{SpanRelativeTo, Timestamp};
use serde_json::Value;

use super::asked::{Somewhere, print};
use super::member::{text, time};
use super::table::table;
use super::waiting::block_on;
use crate::access::{KeyWish, Scope};
use crate::lineage::ModelName;
use local::Database;
use remote::Server;

/// What `headway keys` can be told.
#[derive(Debug, Args)]
pub(super) struct KeysArguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Make a key, and print it for the only time.
    Create(CreateArguments),
    /// List keys, without their secret parts.
    List(Somewhere),
    /// End a key at once.
    Revoke(RevokeArguments),
}

#[derive(Debug, Args)]
struct CreateArguments {
    /// What it is to be used for: predict, ingest, train, admin
    #[arg(long, value_name = "SCOPE", required = true, value_delimiter = ',')]
    scope: Vec<Scope>,
    /// The only model it is for, as often as needed [default: every model]
    #[arg(long, value_name = "NAME", value_parser = ModelName::parse)]
    model: Vec<ModelName>,
    /// When it stops by itself: a span from now (90d, 12h) or a time (2027-01-31T00:00:00Z) [default: never]
    #[arg(long, value_name = "WHEN", value_parser = when)]
    expires: Option<Timestamp>,
    /// What people call it
    #[arg(long, value_name = "TEXT")]
    name: Option<String>,
    #[command(flatten)]
    whose: Somewhere,
}

#[derive(Debug, Args)]
struct RevokeArguments {
    /// Its public part: 16 hexadecimal digits
    #[arg(value_name = "KEY_ID")]
    key_id: String,
    /// Also when it is the last active admin key
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    whose: Somewhere,
}

/// A time as a person says it: in RFC 3339, or as a span from now with days of 24 hours.
fn when(text: &str) -> Result<Timestamp, String> {
    if let Ok(time) = text.parse() {
        return Ok(time);
    }
    let span: jiff::Span = text.parse().map_err(|_| "neither a span such as 90d nor a time in RFC 3339".to_owned())?;
    let span = span.to_duration(SpanRelativeTo::days_are_24_hours()).map_err(|error| error.to_string())?;
    Timestamp::now().checked_add(span).map_err(|error| error.to_string())
}

/// Where keys are.
enum Keys {
    Database(Database),
    Server(Server),
}

impl Keys {
    async fn of(whose: &Somewhere, create: bool) -> anyhow::Result<Self> {
        match whose.place.server()? {
            Some(service) => Ok(Self::Server(Server(service))),
            None => Database::open(whose.place.database(), create).await.map(Self::Database),
        }
    }

    async fn create(&self, wish: &KeyWish) -> anyhow::Result<Value> {
        match self {
            Self::Database(database) => database.create(wish).await,
            Self::Server(server) => server.create(wish).await,
        }
    }

    async fn list(&self) -> anyhow::Result<Vec<Value>> {
        match self {
            Self::Database(database) => database.list().await,
            Self::Server(server) => server.list().await,
        }
    }

    async fn revoke(&self, key_id: &str, force: bool) -> anyhow::Result<Value> {
        match self {
            Self::Database(database) => database.revoke(key_id, force).await,
            Self::Server(server) => server.revoke(key_id, force).await,
        }
    }

    async fn close(self) {
        if let Self::Database(database) = self {
            database.close().await;
        }
    }
}

/// Does what was asked, and prints what came of it.
pub(super) fn run(arguments: KeysArguments) -> anyhow::Result<()> {
    block_on(perform(arguments.command))
}

async fn perform(command: Command) -> anyhow::Result<()> {
    match command {
        Command::Create(arguments) => {
            let CreateArguments { scope, model, expires, name, whose } = arguments;
            let models = Some(model).filter(|models| !models.is_empty());
            let wish = KeyWish { name, scopes: scope.into_iter().collect(), models, expires_at: expires };
            wish.check(Timestamp::now()).context("there can be no such key")?;
            let keys = Keys::of(&whose, true).await?;
            let made = keys.create(&wish).await;
            keys.close().await;
            show_made(&made?, whose.json)
        }
        Command::List(whose) => {
            let keys = Keys::of(&whose, false).await?;
            let listed = keys.list().await;
            keys.close().await;
            show_list(&listed?, whose.json)
        }
        Command::Revoke(RevokeArguments { key_id, force, whose }) => {
            let keys = Keys::of(&whose, false).await?;
            let revoked = keys.revoke(&key_id, force).await;
            keys.close().await;
            let (revoked, mut out) = (revoked?, std::io::stdout().lock());
            if whose.json {
                writeln!(out, "{revoked}")?;
            } else {
                writeln!(out, "{key_id} is revoked")?;
            }
            Ok(())
        }
    }
}

/// The key alone on stdout, so that it can be sent to a file; what is to be known of it on stderr.
fn show_made(made: &Value, json: bool) -> anyhow::Result<()> {
    let Some(key) = made["key"].as_str() else { bail!("the server answered without a key: {made}") };
    let mut out = std::io::stdout().lock();
    if json {
        writeln!(out, "{made}")?;
    } else {
        writeln!(out, "{key}")?;
        let (id, scopes) = (text(&made["key_id"]), text(&made["scopes"]));
        writeln!(std::io::stderr(), "key {id} ({scopes}) is made; it is shown this once and kept nowhere")?;
    }
    Ok(out.flush()?)
}

fn show_list(keys: &[Value], json: bool) -> anyhow::Result<()> {
    print(json, &serde_json::json!({"keys": keys}), || {
        let rows = keys.iter().map(|key| {
            let [id, state, scopes, models, name] =
                ["key_id", "state", "scopes", "models", "name"].map(|member| text(&key[member]));
            let models = if models.is_empty() { "all".to_owned() } else { models };
            let expires = time(&key["expires_at"]);
            vec![id, state, scopes, models, if expires.is_empty() { "never".to_owned() } else { expires }, name]
        });
        table(&["KEY", "STATE", "SCOPES", "MODELS", "EXPIRES", "NAME"], rows.collect())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_end_is_a_time_or_a_span_from_now() {
        assert_eq!(when("2027-01-31T00:00:00Z"), Ok("2027-01-31T00:00:00Z".parse().unwrap()));
        let day = jiff::SignedDuration::from_hours(24);
        let (before, end, after) = (Timestamp::now(), when("2d").unwrap(), Timestamp::now());
        assert!(before + day + day <= end && end <= after + day + day);
        for bad in ["", "tomorrow", "90", "2027-01-31"] {
            assert!(when(bad).is_err(), "{bad}");
        }
    }
}
