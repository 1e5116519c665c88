//! The part of an upload that computes: decoding and checking, on a thread that may block.

use std::ops::ControlFlow;

use tokio::sync::mpsc::{Receiver, Sender, channel};
use tokio::task::JoinHandle;

use super::{IngestError, IngestSettings, OptionError, Upload};
use crate::car_following::{CheckSettings, Conversion, Extraction, ExtractionSettings, Target};
use crate::formats::{BodyKind, FormatError, FormatLimits, RawEvent, decode};
use crate::lineage::{ModelSettings, RegimeName, Rejection, Split};
use crate::store::event::{NewEvent, STORED_AT_ONCE};

/// Bytes of events that make them go to the writer, however few they are.
const BYTES_AT_ONCE: u64 = 256 << 10;
/// Such groups between the thread that decodes and the writer.
const IN_FLIGHT: usize = 4;

/// Events on their way to the store, not more than are stored at once; accepted and refused ones in their order.
#[derive(Default)]
pub(super) struct Arrivals {
    pub(super) accepted: Vec<NewEvent>,
    pub(super) rejected: Vec<Rejection>,
    /// Of every event with a source that was checked, in order: the source, and whether it passed.
    pub(super) checked: Vec<(String, bool)>,
    bytes: u64,
}

impl Arrivals {
    /// About how much memory they take.
    pub(super) fn bytes(&self) -> u64 {
        self.bytes
    }

    fn accept(&mut self, event: NewEvent) {
        self.bytes += 12 * event.event.steps() as u64 + Self::OVERHEAD;
        self.accepted.push(event);
    }

    fn reject(&mut self, rejection: Rejection) {
        self.bytes += rejection.detail.len() as u64 + Self::OVERHEAD;
        self.rejected.push(rejection);
    }

    fn note(&mut self, source: Option<&str>, passed: bool) {
        if let Some(source) = source {
            self.bytes += source.len() as u64;
            self.checked.push((source.to_owned(), passed));
        }
    }

    fn are_enough(&self) -> bool {
        self.accepted.len() + self.rejected.len() == STORED_AT_ONCE || self.bytes >= BYTES_AT_ONCE
    }

    const OVERHEAD: u64 = 512;
}

/// The thread that decodes, and what comes from it. Dropped, it stops soon.
pub(super) struct Decoding {
    arrivals: Receiver<Arrivals>,
    thread: Option<JoinHandle<Result<Option<Extraction>, FormatError>>>,
    /// What became of the rows of a whole road, once the body has ended.
    pub(super) extraction: Option<Extraction>,
}

/// What is looked at while a body is decoded.
struct Rules {
    conversion: Conversion,
    extraction: ExtractionSettings,
    limits: FormatLimits,
    checks: CheckSettings,
}

impl Decoding {
    /// Begins to decode and check the body.
    ///
    /// # Errors
    /// When an option cannot be used.
    pub(super) fn start(upload: Upload, settings: &IngestSettings) -> Result<Self, OptionError> {
        let rules = Rules {
            conversion: upload.options.conversion(upload.format)?,
            extraction: upload.options.extraction(upload.format, &settings.extraction)?,
            limits: settings.limits.clone(),
            checks: settings.checks.clone(),
        };
        let (sender, arrivals) = channel(IN_FLIGHT);
        let thread = tokio::task::spawn_blocking(move || run(upload, &rules, &sender));
        Ok(Self { arrivals, thread: Some(thread), extraction: None })
    }

    /// The next arrivals; none when the body ended as it should.
    pub(super) async fn next(&mut self) -> Result<Option<Arrivals>, IngestError> {
        if let Some(arrivals) = self.arrivals.recv().await {
            return Ok(Some(arrivals));
        }
        if let Some(thread) = self.thread.take() {
            self.extraction = thread.await.map_err(|_| IngestError::Panicked)??;
        }
        Ok(None)
    }
}

/// Decodes and checks `upload`'s body into `sender`, until its end or until nobody listens.
fn run(upload: Upload, rules: &Rules, sender: &Sender<Arrivals>) -> Result<Option<Extraction>, FormatError> {
    let Rules { conversion, extraction, limits, checks } = rules;
    let kind = BodyKind { format: upload.format, encoding: upload.encoding, preset: upload.options.preset };
    let model = &upload.model;
    // A window, a step to predict and one to compare with.
    let (min_steps, max_steps) = (model.horizon as usize + 2, limits.max_steps as usize);
    let target = Target { dt_s: model.dt_s, min_steps, max_steps };
    let (source, regime) = (upload.options.source.as_deref(), upload.options.regime.as_ref());
    let mut arrivals = Arrivals::default();
    let extracted = decode(upload.body.file, kind, limits, extraction, &mut |decoded| {
        match decoded {
            Err(rejection) => arrivals.reject(rejection),
            Ok(raw) => match checks.check(&raw.recording, conversion, &target) {
                Err(defects) => {
                    arrivals.note(raw.source.as_deref().or(source), false);
                    arrivals.reject(raw.reject(defects));
                }
                Ok(event) => {
                    arrivals.note(raw.source.as_deref().or(source), true);
                    arrivals.accept(arriving(raw, event, model, source, regime));
                }
            },
        }
        if arrivals.are_enough() && sender.blocking_send(std::mem::take(&mut arrivals)).is_err() {
            return ControlFlow::Break(());
        }
        ControlFlow::Continue(())
    })?;
    // Nobody who listens is nobody who minds.
    let _ = sender.blocking_send(arrivals);
    Ok(extracted)
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
        held: false,
    }
}
