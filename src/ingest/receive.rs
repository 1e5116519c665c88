//! From a spooled body to a batch in an open transaction.

use std::collections::BTreeSet;

use jiff::Timestamp;

use super::decode::{Arrivals, Decoding};
use super::receipt::{Receipt, Summary};
use super::sources::Sources;
use super::{IngestError, IngestSettings, Upload};
use crate::store::batch::{self, BatchOutcome, NewBatch};
use crate::store::{Actor, Store, WriteTransaction, event, rejection};

/// An upload that is stored as soon as its transaction is committed.
#[derive(Debug)]
pub struct Received {
    /// Holds the batch; whatever must happen with it or not at all belongs in here too.
    pub transaction: WriteTransaction,
    /// What to answer after the commit.
    pub receipt: Receipt,
}

/// Decodes, checks and stores an upload in one transaction in the name of `by`, which is left to the caller to commit. A body whose events
/// are all refused is a batch too: of rejections.
///
/// # Errors
/// When the body as a whole or an option cannot be used, or the database fails; nothing is stored then.
pub async fn receive(
    store: &Store,
    by: &Actor,
    upload: Upload,
    settings: &IngestSettings,
) -> Result<Received, IngestError> {
    let now = upload.received_at;
    let new = NewBatch {
        model_id: upload.model_id,
        source: upload.options.source.clone(),
        regime: upload.options.regime.clone(),
        content_type: upload.format.media_type().to_owned(),
        body_sha256: upload.body.sha256,
        body_bytes: upload.body.bytes,
        created_at: now,
    };
    let mut decoding = Decoding::start(upload, settings)?;
    // The database has one writer: an upload that fits into the buffer takes it only when everything is decoded.
    let (mut buffer, mut bytes, mut over) = (Vec::new(), 0, false);
    while !over && bytes < settings.buffer_bytes {
        match decoding.next().await? {
            Some(arrivals) => {
                bytes += arrivals.bytes();
                buffer.push(arrivals);
            }
            None => over = true,
        }
    }
    let mut transaction = store.begin_for(by).await?;
    let batch_id = batch::begin(&mut transaction, &new).await?;
    let sources = Sources::new(new.model_id, settings.sources.clone());
    let mut writer = Writer::new(new.model_id, batch_id, now, settings.max_listed_rejections, sources);
    for arrivals in buffer {
        writer.take(&mut transaction, arrivals).await?;
    }
    while !over {
        match decoding.next().await? {
            Some(arrivals) => writer.take(&mut transaction, arrivals).await?,
            None => over = true,
        }
    }
    writer.receipt.summary.extraction = decoding.extraction.take();
    let receipt = writer.end(&mut transaction).await?;
    Ok(Received { transaction, receipt })
}

/// Writes arrivals, and keeps count.
struct Writer {
    model_id: i64,
    now: Timestamp,
    max_listed: usize,
    linked: i64,
    sources: Sources,
    receipt: Receipt,
}

impl Writer {
    fn new(model_id: i64, batch_id: i64, now: Timestamp, max_listed: u32, sources: Sources) -> Self {
        let receipt = Receipt {
            batch_id,
            accepted: 0,
            duplicates: 0,
            rejected_count: 0,
            rejected: Vec::new(),
            summary: Summary::default(),
            held_sources: Vec::new(),
        };
        Self { model_id, now, max_listed: max_listed as usize, linked: 0, sources, receipt }
    }

    async fn take(&mut self, transaction: &mut WriteTransaction, arrivals: Arrivals) -> Result<(), IngestError> {
        let Arrivals { mut accepted, mut rejected, checked, .. } = arrivals;
        let batch_id = self.receipt.batch_id;
        let mut held = BTreeSet::new();
        for (source, passed) in checked {
            if self.sources.note(transaction, &source, passed).await? {
                held.insert(source);
            }
        }
        for event in &mut accepted {
            event.held = event.source.as_ref().is_some_and(|source| held.contains(source));
        }
        let links = event::store(transaction, self.model_id, batch_id, &accepted, self.now).await?;
        event::link(transaction, batch_id, self.linked, &links).await?;
        self.linked += i64::try_from(links.len()).expect("a body's events are bounded");
        for (event, link) in accepted.iter().zip(links) {
            if link.duplicate {
                self.receipt.duplicates += 1;
            } else {
                self.receipt.accepted += 1;
                self.receipt.summary.add(event);
            }
        }
        let ordinal = self.receipt.rejected_count.cast_signed();
        rejection::store(transaction, batch_id, ordinal, &rejected).await?;
        self.receipt.rejected_count += rejected.len() as u64;
        rejected.truncate(self.max_listed - self.receipt.rejected.len());
        self.receipt.rejected.append(&mut rejected);
        Ok(())
    }

    async fn end(mut self, transaction: &mut WriteTransaction) -> Result<Receipt, IngestError> {
        self.receipt.held_sources = self.sources.end(transaction, self.now).await?;
        let outcome = BatchOutcome {
            accepted: self.receipt.accepted,
            duplicates: self.receipt.duplicates,
            rejected: self.receipt.rejected_count,
            summary: serde_json::to_value(&self.receipt.summary).expect("a summary is plain data"),
        };
        batch::end(transaction, self.receipt.batch_id, &outcome).await?;
        Ok(self.receipt)
    }
}
