//! The part of an upload that computes: decoding and checking, on a thread that may block.

use std::ops::ControlFlow;

use tokio::sync::mpsc::{Receiver, Sender, channel};
use tokio::task::JoinHandle;

use super::{IngestError, IngestSettings, Upload};
use crate::car_following::{CheckSettings, Conversion, Target};
use crate::formats::{BodyKind, FormatError, FormatLimits, RawEvent, decode};
use crate::lineage::{ModelSettings, RegimeName, Rejection, Split};
use crate::store::event::NewEvent;

/// Events between the thread that decodes and the writer.
const IN_FLIGHT: usize = 64;

/// An event on its way to the store.
pub(super) enum Arrival {
    Accepted(Box<NewEvent>),
    Rejected(Rejection),
}

impl Arrival {
    /// About how much memory it takes.
    pub(super) fn bytes(&self) -> u64 {
        const OVERHEAD: u64 = 512;
        match self {
            Self::Accepted(event) => 12 * event.event.steps() as u64 + OVERHEAD,
            Self::Rejected(rejection) => rejection.detail.len() as u64 + OVERHEAD,
        }
    }
}

/// The thread that decodes, and what comes from it. Dropped, it stops at the next event.
pub(super) struct Decoding {
    arrivals: Receiver<Arrival>,
    thread: Option<JoinHandle<Result<(), FormatError>>>,
}

impl Decoding {
    /// Begins to decode and check the body.
    pub(super) fn start(upload: Upload, conversion: Conversion, settings: &IngestSettings) -> Self {
        let (sender, arrivals) = channel(IN_FLIGHT);
        let (limits, checks) = (settings.limits.clone(), settings.checks.clone());
        let thread = tokio::task::spawn_blocking(move || run(upload, conversion, &limits, &checks, &sender));
        Self { arrivals, thread: Some(thread) }
    }

    /// The next arrival; none when the body ended as it should.
    pub(super) async fn next(&mut self) -> Result<Option<Arrival>, IngestError> {
        if let Some(arrival) = self.arrivals.recv().await {
            return Ok(Some(arrival));
        }
        if let Some(thread) = self.thread.take() {
            thread.await.map_err(|_| IngestError::Panicked)??;
        }
        Ok(None)
    }
}

/// Decodes and checks `upload`'s body into `arrivals`, until its end or until nobody listens.
fn run(
    upload: Upload,
    conversion: Conversion,
    limits: &FormatLimits,
    checks: &CheckSettings,
    arrivals: &Sender<Arrival>,
) -> Result<(), FormatError> {
    let kind = BodyKind { format: upload.format, encoding: upload.encoding, preset: upload.options.preset };
    let model = &upload.model;
    // A window, a step to predict and one to compare with.
    let (min_steps, max_steps) = (model.horizon as usize + 2, limits.max_steps as usize);
    let target = Target { dt_s: model.dt_s, min_steps, max_steps };
    let (source, regime) = (upload.options.source.as_deref(), upload.options.regime.as_ref());
    decode(upload.body.file, kind, limits, &mut |decoded| {
        let arrival = match decoded {
            Err(rejection) => Arrival::Rejected(rejection),
            Ok(raw) => match checks.check(&raw.recording, &conversion, &target) {
                Err(defects) => Arrival::Rejected(raw.reject(defects)),
                Ok(event) => Arrival::Accepted(Box::new(arriving(raw, event, model, source, regime))),
            },
        };
        match arrivals.blocking_send(arrival) {
            Ok(()) => ControlFlow::Continue(()),
            Err(_) => ControlFlow::Break(()),
        }
    })
}

fn arriving(
    raw: RawEvent,
    event: crate::car_following::Event,
    model: &ModelSettings,
    source: Option<&str>,
    regime: Option<&RegimeName>,
) -> NewEvent {
    let content_sha256 = event.content_sha256();
    let source = raw.source.or_else(|| source.map(str::to_owned));
    let split = raw
        .split
        .unwrap_or_else(|| Split::assign(model.split_seed, source.as_deref(), raw.run.as_deref(), &content_sha256));
    NewEvent {
        name: raw.event_id,
        source,
        run: raw.run,
        split,
        regime: model.regimes.regime(regime, event.mean_speed_mps()),
        content_sha256,
        event,
    }
}
