//! Uploads into a database: what is stored, and what is not.

use std::ops::Range;

use bytes::Bytes;
use futures_util::stream;

use super::*;
use crate::car_following::Recording;
use crate::consolidation::Method;
use crate::formats::tests::encode::encode;
use crate::formats::{Encoding, Format, FormatError, Origin, Preset, RawEvent};
use crate::lineage::{EventCounts, ModelSettings, RegimeRule};
use crate::store::Actor;
use crate::store::fixture::{Fixture, now, regime};
use crate::store::retract::retract;

/// One event a line, told apart by its number.
fn lines(numbers: Range<u32>) -> String {
    numbers.map(line).collect()
}

fn line(number: u32) -> String {
    let spacing = 20.0 + f64::from(number) / 100.0;
    let event = serde_json::json!({
        "event_id": format!("e{number}"),
        "dt_s": 0.1,
        "spacing_m": vec![spacing; 20],
        "follower_speed_mps": vec![10.0; 20],
        "leader_speed_mps": vec![10.0; 20],
    });
    format!("{event}\n")
}

/// An upload of NDJSON to a model, under `settings` of uploads.
async fn receive_with(
    fixture: &Fixture,
    model_id: i64,
    body: String,
    settings: &IngestSettings,
) -> Result<Received, IngestError> {
    let body = spool(stream::iter([Ok::<_, ()>(Bytes::from(body))]), settings, u64::MAX).await.unwrap();
    let upload = Upload {
        model_id,
        model: ModelSettings::default(),
        format: Format::Ndjson,
        encoding: Encoding::Identity,
        options: UploadOptions { regime: Some(regime("fast")), ..UploadOptions::default() },
        body,
        received_at: now(),
    };
    receive(&fixture.store, &Actor::local(), upload, settings).await
}

async fn stored(fixture: &Fixture, model_id: i64, body: String) -> Receipt {
    let Received { transaction, receipt } =
        receive_with(fixture, model_id, body, &IngestSettings::default()).await.unwrap();
    transaction.commit().await.unwrap();
    receipt
}

async fn model(fixture: &Fixture) -> i64 {
    fixture.model("m", Method::Naive, &ModelSettings::default()).await
}

fn refused() -> String {
    line(0).replace("20.0", "-20.0")
}

#[tokio::test]
async fn an_upload_counts_only_once_its_transaction_is_committed() {
    let fixture = Fixture::new().await;
    let model_id = model(&fixture).await;
    let received = receive_with(&fixture, model_id, lines(0..3), &IngestSettings::default()).await.unwrap();
    assert_eq!((received.receipt.accepted, received.receipt.duplicates), (3, 0));
    drop(received.transaction);
    assert_eq!(fixture.store.batches(model_id, 0, 9).await.unwrap(), []);
    assert_eq!(stored(&fixture, model_id, lines(0..3)).await.accepted, 3);
}

#[tokio::test]
async fn a_body_that_breaks_off_leaves_nothing_however_much_was_written() {
    let fixture = Fixture::new().await;
    let model_id = model(&fixture).await;
    let cut = lines(0..200) + "{\"event_id\": \"cut";
    // Written as it is decoded, and decoded before anything is written.
    for buffer_bytes in [0, u64::MAX] {
        let settings = IngestSettings { buffer_bytes, ..IngestSettings::default() };
        let error = receive_with(&fixture, model_id, cut.clone(), &settings).await.err().unwrap();
        assert!(matches!(error, IngestError::Format(FormatError::Truncated { .. })), "{error}");
    }
    assert_eq!(fixture.store.batches(model_id, 0, 9).await.unwrap(), []);
    assert_eq!(stored(&fixture, model_id, lines(0..200)).await.accepted, 200);
}

#[tokio::test]
async fn the_buffer_makes_no_difference() {
    let body = lines(0..600) + &refused() + &lines(0..2);
    let mut receipts = Vec::new();
    for buffer_bytes in [0, 10_000, u64::MAX] {
        let fixture = Fixture::new().await;
        let model_id = model(&fixture).await;
        let settings = IngestSettings { buffer_bytes, ..IngestSettings::default() };
        let Received { transaction, receipt } =
            receive_with(&fixture, model_id, body.clone(), &settings).await.unwrap();
        transaction.commit().await.unwrap();
        let counts = fixture.store.batch_event_counts(receipt.batch_id).await.unwrap();
        assert_eq!(counts, EventCounts { pending: 600, ..EventCounts::default() });
        receipts.push(receipt);
    }
    assert_eq!((receipts[0].accepted, receipts[0].duplicates, receipts[0].rejected_count), (600, 2, 1));
    assert!(receipts.iter().all(|receipt| *receipt == receipts[0]));
}

#[tokio::test]
async fn of_copies_the_first_is_stored_and_the_others_are_counted() {
    let fixture = Fixture::new().await;
    let model_id = model(&fixture).await;
    let first = stored(&fixture, model_id, line(1) + &line(1).replace("e1", "copy")).await;
    assert_eq!((first.accepted, first.duplicates, first.summary.events), (1, 1, 1));
    let second = stored(&fixture, model_id, lines(1..3)).await;
    assert_eq!((second.accepted, second.duplicates), (1, 1));
    let copies = stored(&fixture, model_id, lines(1..3)).await;
    assert!(copies.accepted == 0 && !copies.holds_nothing());
    let batch = fixture.store.batch(model_id, copies.batch_id).await.unwrap().unwrap();
    assert_eq!((batch.accepted, batch.duplicates, batch.rejected), (0, 2, 0));
}

/// An upload of `body`, which says no step of its own where it is FollowNet's array.
async fn of_format(model_id: i64, format: Format, body: Vec<u8>) -> Upload {
    let body =
        spool(stream::iter([Ok::<_, ()>(Bytes::from(body))]), &IngestSettings::default(), u64::MAX).await.unwrap();
    let (model, options) = (ModelSettings::default(), UploadOptions::default());
    Upload { model_id, model, format, encoding: Encoding::Identity, options, body, received_at: now() }
}

/// As `FollowNet` has them: numbers of four decimals, of lengths that differ.
fn recorded(number: u32) -> RawEvent {
    let steps = 150 + number;
    let of = |f: &dyn Fn(f64) -> f64| -> Vec<f64> {
        (0..steps).map(|step| (f(f64::from(step) * 0.1) * 1e4).round() / 1e4).collect()
    };
    let (phase, closing) = (f64::from(number) * 0.7, 0.3);
    let follower = of(&|t| 12.0 + (0.4 * t + phase).sin());
    let rel = of(&|_| -closing);
    RawEvent {
        index: number.into(),
        event_id: number.to_string(),
        source: None,
        run: None,
        split: None,
        recording: Recording {
            dt_s: Some(0.1),
            t_s: None,
            spacing_m: of(&|t| 30.0 - closing * t),
            leader_speed_mps: follower.iter().zip(&rel).map(|(v, rel)| ((v + rel) * 1e4).round() / 1e4).collect(),
            follower_speed_mps: follower,
            rel_speed_mps: Some(rel),
        },
        origin: Origin::Entry(number.into()),
    }
}

#[tokio::test]
async fn the_same_events_are_the_same_bytes_in_every_format_and_copies_of_one_another() {
    const FORMATS: [Format; 5] = [Format::Npy, Format::Csv, Format::Parquet, Format::Json, Format::Ndjson];
    let events: Vec<_> = (0..9).map(recorded).collect();
    let settings = IngestSettings::default();
    let mut contents = Vec::new();
    for format in FORMATS {
        let examined = examine(of_format(1, format, encode(&events, format)).await, &settings, u64::MAX).await.unwrap();
        assert_eq!((examined.events.len(), examined.rejected_count), (9, 0), "{format:?}: {:?}", examined.rejected);
        let bytes: Vec<_> = examined
            .events
            .iter()
            .map(|arrived| (arrived.name.clone(), arrived.event.to_bytes(), arrived.split))
            .collect();
        contents.push(bytes);
    }
    assert!(contents.iter().all(|content| *content == contents[0]));
    let fixture = Fixture::new().await;
    for first in FORMATS {
        let model_id = fixture.model(&format!("{first:?}"), Method::Naive, &ModelSettings::default()).await;
        for (nth, format) in [first].into_iter().chain(FORMATS).enumerate() {
            let upload = of_format(model_id, format, encode(&events, format)).await;
            let received = receive(&fixture.store, &Actor::local(), upload, &settings).await.unwrap();
            received.transaction.commit().await.unwrap();
            let (accepted, duplicates) = (received.receipt.accepted, received.receipt.duplicates);
            assert_eq!((accepted, duplicates), if nth == 0 { (9, 0) } else { (0, 9) }, "{format:?} after {first:?}");
        }
    }
}

#[tokio::test]
async fn every_rejection_is_kept_and_the_first_are_listed() {
    let fixture = Fixture::new().await;
    let model_id = model(&fixture).await;
    let body: String = (0..5).map(|_| refused()).collect();
    let settings = IngestSettings { max_listed_rejections: 2, ..IngestSettings::default() };
    let Received { transaction, receipt } = receive_with(&fixture, model_id, body, &settings).await.unwrap();
    transaction.commit().await.unwrap();
    assert!(receipt.holds_nothing());
    assert_eq!((receipt.rejected_count, receipt.rejected.len()), (5, 2));
    let kept = fixture.store.rejections(receipt.batch_id, 0, 9).await.unwrap();
    assert_eq!((kept.len(), &kept[..2]), (5, &receipt.rejected[..]));
    assert_eq!(kept.iter().map(|rejection| rejection.index).collect::<Vec<_>>(), [0, 1, 2, 3, 4]);
}

#[tokio::test]
async fn what_an_upload_says_counts_where_an_event_says_nothing() {
    let fixture = Fixture::new().await;
    let model_id = model(&fixture).await;
    let bands = serde_json::json!({"by": "mean_speed_mps", "edges": [9.0], "names": ["slow", "fast"]});
    let rule: RegimeRule = serde_json::from_value(bands).unwrap();
    let body = "event_id,split,spacing,sv_speed,lv_speed\n".to_owned()
        + &"a,validation,20,10,10\n".repeat(15)
        + &"b,test,20,8,8\n".repeat(15);
    let settings = IngestSettings::default();
    let upload = Upload {
        model_id,
        model: ModelSettings { regimes: rule, ..ModelSettings::default() },
        format: Format::Csv,
        encoding: Encoding::Identity,
        options: UploadOptions { preset: Preset::Follownet, dt_s: Some(0.1), ..UploadOptions::default() },
        body: spool(stream::iter([Ok::<_, ()>(Bytes::from(body))]), &settings, u64::MAX).await.unwrap(),
        received_at: now(),
    };
    let summary = receive(&fixture.store, &Actor::local(), upload, &settings).await.unwrap().receipt.summary;
    assert_eq!(summary.regimes, [("fast".to_owned(), 1), ("slow".to_owned(), 1)].into());
    assert_eq!(summary.splits, [("test", 1), ("validation", 1)].into());
    assert_eq!((summary.steps, summary.mean_speed_mps), (30, Some(SpeedRange { min: 8.0, max: 10.0 })));
    assert!((summary.seconds - 3.0).abs() < 1e-6);
}

#[tokio::test]
async fn copies_are_told_from_new_events_and_from_retracted_ones_wherever_they_stand() {
    let fixture = Fixture::new().await;
    let model_id = model(&fixture).await;
    let first = stored(&fixture, model_id, lines(0..150)).await;
    let mut transaction = fixture.store.begin().await.unwrap();
    retract(&mut transaction, model_id, first.batch_id, now()).await.unwrap();
    transaction.commit().await.unwrap();
    stored(&fixture, model_id, lines(0..100)).await;
    // Known, new, retracted, and a copy of each beside it or far from it: fewer, as many and more than are stored at once.
    let mixed: String = (50..130).map(line).chain([line(500), line(500), line(149), refused(), line(149)]).collect();
    let receipt = stored(&fixture, model_id, mixed + &lines(95..105) + &line(500)).await;
    assert_eq!((receipt.accepted, receipt.duplicates, receipt.rejected_count), (30 + 1 + 1, 50 + 2 + 11, 1));
    let counts = fixture.store.batch_event_counts(receipt.batch_id).await.unwrap();
    assert_eq!(counts, EventCounts { pending: 82, ..EventCounts::default() });
    let again = stored(&fixture, model_id, lines(0..130)).await;
    assert_eq!((again.accepted, again.duplicates), (0, 130));
    assert_eq!(fixture.store.batch_event_counts(first.batch_id).await.unwrap().retracted, 19);
}
