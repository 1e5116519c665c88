//! From a spooled body to events in memory: everything an upload does but storing.

use std::collections::BTreeMap;

use super::decode::Decoding;
use super::receipt::Summary;
use super::{IngestError, IngestSettings, Upload};
use crate::car_following::resampled_steps;
use crate::lineage::Rejection;
use crate::store::event::NewEvent;

/// What a body holds.
#[derive(Debug)]
pub struct Examined {
    /// Events that would be stored in a model that knows none of them, in order of their digests.
    pub events: Vec<NewEvent>,
    /// Events whose content the body has before them.
    pub duplicates: u64,
    /// Events refused.
    pub rejected_count: u64,
    /// The first of them, one entry an event, as an upload lists them.
    pub rejected: Vec<Rejection>,
    /// What was accepted.
    pub summary: Summary,
}

/// Decodes and checks a body as an upload of it would, and keeps nothing: accepted events of up to `max_steps` steps,
/// counted at the model's step, are given back.
///
/// # Errors
/// When the body as a whole or an option cannot be used, or the events have more steps.
pub async fn examine(upload: Upload, settings: &IngestSettings, max_steps: u64) -> Result<Examined, IngestError> {
    let (model_dt_s, mut steps) = (upload.model.dt_s, 0);
    let mut decoding = Decoding::start(upload, settings)?;
    let (mut events, mut summary) = (BTreeMap::new(), Summary::default());
    let (mut duplicates, mut rejected_count, mut rejected) = (0, 0, Vec::new());
    while let Some(arrivals) = decoding.next().await? {
        for event in arrivals.accepted {
            if events.contains_key(&event.content_sha256) {
                duplicates += 1;
                continue;
            }
            summary.add(&event);
            steps += resampled_steps(event.event.steps(), event.event.dt_s(), model_dt_s) as u64;
            if steps > max_steps {
                return Err(IngestError::TooManySteps { max_steps });
            }
            events.insert(event.content_sha256, event);
        }
        rejected_count += arrivals.rejected.len() as u64;
        let room = settings.max_listed_rejections as usize - rejected.len();
        rejected.extend(arrivals.rejected.into_iter().take(room));
    }
    summary.extraction = decoding.extraction.take();
    Ok(Examined { events: events.into_values().collect(), duplicates, rejected_count, rejected, summary })
}
