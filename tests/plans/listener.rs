//! The database's driver tells every statement to the log, and this is one.

use std::collections::BTreeSet;
use std::fmt::Debug;
use std::sync::{Mutex, PoisonError};

use tracing::field::{Field, Visit};
use tracing::{Event, Subscriber};
use tracing_subscriber::layer::{Context, Layer, SubscriberExt};
use tracing_subscriber::util::SubscriberInitExt;

static HEARD: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());

/// Listens from here on, in all of this process.
pub(crate) fn start() {
    tracing_subscriber::registry().with(Listener).init();
}

/// Statements about rows so far, each once.
pub(crate) fn heard() -> BTreeSet<String> {
    HEARD.lock().unwrap_or_else(PoisonError::into_inner).clone()
}

struct Listener;

impl<S: Subscriber> Layer<S> for Listener {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        if event.metadata().target() != "sqlx::query" {
            return;
        }
        let mut told = Told::default();
        event.record(&mut told);
        // The summary is the whole of a short statement.
        let statement = if told.statement.trim().is_empty() { told.summary } else { told.statement };
        let verb = statement.split_whitespace().next().unwrap_or_default().to_ascii_lowercase();
        let about_rows = ["select", "insert", "update", "delete", "with"].contains(&verb.as_str());
        if about_rows && !statement.contains("_sqlx_migrations") {
            HEARD.lock().unwrap_or_else(PoisonError::into_inner).insert(statement);
        }
    }
}

#[derive(Default)]
struct Told {
    summary: String,
    statement: String,
}

impl Visit for Told {
    fn record_str(&mut self, field: &Field, value: &str) {
        match field.name() {
            "summary" => value.clone_into(&mut self.summary),
            "db.statement" => value.clone_into(&mut self.statement),
            _ => {}
        }
    }

    fn record_debug(&mut self, _: &Field, _: &dyn Debug) {}
}
