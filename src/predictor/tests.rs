//! Against a real database, with versions a fake learner made.

use std::sync::Arc;

use futures_util::FutureExt;

use super::*;
use crate::consolidation::Method;
use crate::driver::{Seen, Window};
use crate::lineage::{ModelSettings, Preset, Promotion, PromotionDecision, PromotionPolicy};
use crate::lstm::{INPUTS, Layout};
use crate::store::fixture::{Fixture, now};
use crate::store::live::{MoveRequest, promote};
use crate::store::new_version::NewVersion;
use crate::store::outcome::{self, Outcome};
use crate::store::task;

const HIDDEN: usize = 2;

/// A model with versions 1, 2 and 3, told apart by their weights; the last is live.
pub(super) async fn three_versions() -> (Fixture, i64) {
    let fixture = Fixture::new().await;
    let settings = ModelSettings { hidden: 2, ..Preset::Paper.settings() };
    let model_id = fixture.model("m", Method::Naive, &settings).await;
    for version in 1..=3_u16 {
        fixture.batch(model_id, "fast", version..version + 1).await;
        let task_id = fixture.tasks_of_pending(model_id).await[0];
        let mut transaction = fixture.store.begin().await.unwrap();
        task::start(&mut transaction, task_id, 1, now()).await.unwrap();
        let judged_against = (version > 1).then(|| i64::from(version) - 1);
        let outcome = outcome(&settings, f32::from(version), judged_against);
        outcome::succeeded(&mut transaction, task_id, &outcome, now()).await.unwrap().unwrap();
        transaction.commit().await.unwrap();
    }
    (fixture, model_id)
}

fn outcome(settings: &ModelSettings, weight: f32, judged_against: Option<i64>) -> Outcome {
    let promotion =
        Promotion { policy: PromotionPolicy::Auto, decision: PromotionDecision::Promoted, reason: "a test".to_owned() };
    Outcome {
        version: NewVersion {
            method: Method::Naive,
            settings: settings.clone(),
            strength: None,
            lambda: None,
            strength_search: None,
            kernel: "none".to_owned(),
            train_events: 1,
            events_sha256: [0; 32],
            scaling: serde_json::json!({
                "mean": [10.0, 10.0, 0.0, 20.0], "spread": [5.0, 5.0, 1.0, 10.0],
                "low": [0.0, 0.0, -5.0, 0.0], "high": [20.0, 20.0, 5.0, 100.0]
            }),
            importance: serde_json::Value::Null,
            weights: vec![weight / 10.0; Layout { hidden: HIDDEN, inputs: INPUTS }.len()],
        },
        memory: None,
        reservoir: Vec::new(),
        regimes: Vec::new(),
        promotion,
        judged_against,
    }
}

pub(super) async fn predictor(fixture: &Fixture) -> Predictor {
    let settings = PredictorSettings {
        named_versions: 1,
        inline_windows: 1,
        waiting_windows: 64,
        threads: 3,
        sequences: 2,
        sequence_idle_s: 60.0,
    };
    let predictor = Predictor::new(Arc::clone(&fixture.store), settings);
    assert!(!predictor.ready(), "nothing is ready before it was looked for");
    predictor.load_all().await.unwrap();
    predictor
}

pub(super) fn window(follower: f32, spacing: f32) -> Window {
    Window { follower_speed_mps: vec![follower; 10], leader_speed_mps: vec![10.0; 10], spacing_m: vec![spacing; 10] }
}

async fn promoted(fixture: &Fixture, model_id: i64, version: i64) {
    let request = MoveRequest { version: Some(version), reason: "r", force: false };
    let mut transaction = fixture.store.begin().await.unwrap();
    promote(&mut transaction, model_id, &request, now()).await.unwrap().unwrap();
    transaction.commit().await.unwrap();
}

#[tokio::test]
async fn the_live_version_serves_and_a_swap_leaves_requests_under_way_alone() {
    let (fixture, model_id) = three_versions().await;
    let predictor = predictor(&fixture).await;
    assert!(predictor.ready());
    let under_way = predictor.version(model_id, None).await.unwrap();
    promoted(&fixture, model_id, 1).await;
    predictor.refresh(model_id).await;
    assert_eq!(under_way.version(), 3);
    let live = predictor.version(model_id, None).await.unwrap();
    assert_eq!(live.version(), 1);
    let (old, new) = (under_way.predict(&[window(9.0, 20.0)]).unwrap(), live.predict(&[window(9.0, 20.0)]).unwrap());
    assert_ne!(old[0].raw_accel_mps2.to_bits(), new[0].raw_accel_mps2.to_bits());
    assert_eq!(new[0].accel_mps2.to_bits(), new[0].raw_accel_mps2.to_bits());
}

#[tokio::test]
async fn a_name_is_known_as_long_as_something_of_it_is_live() {
    let (fixture, model_id) = three_versions().await;
    let fresh = predictor(&fixture).await;
    let empty = fixture.model("empty", Method::Naive, &ModelSettings::default()).await;
    fresh.refresh(empty).await;
    assert_eq!((fresh.serving("m"), fresh.serving("empty"), fresh.serving("other")), (Some(model_id), None, None));
    fixture.execute("update model set name = 'other' where name = 'm'").await;
    fresh.refresh(model_id).await;
    assert_eq!((fresh.serving("m"), fresh.serving("other")), (None, Some(model_id)));
    fixture.execute("update model set live_version = null").await;
    fresh.refresh(model_id).await;
    assert_eq!(fresh.serving("other"), None);
}

#[tokio::test]
async fn a_named_version_answers_and_an_unknown_one_is_named() {
    let (fixture, model_id) = three_versions().await;
    let predictor = predictor(&fixture).await;
    for named in [1, 2, 1, 3] {
        assert_eq!(predictor.version(model_id, Some(named)).await.unwrap().version(), named);
    }
    assert!(matches!(predictor.version(model_id, Some(9)).await, Err(PredictError::UnknownVersion(9))));
    let empty = fixture.model("empty", Method::Naive, &ModelSettings::default()).await;
    predictor.refresh(empty).await;
    assert!(matches!(predictor.version(empty, None).await, Err(PredictError::NoLiveVersion)));
    assert!(predictor.ready(), "a model without a live version keeps nobody waiting");
}

#[tokio::test]
async fn damaged_weights_are_never_served() {
    let (fixture, model_id) = three_versions().await;
    fixture.execute("update weights set weights = zeroblob(length(weights)) where version = 3").await;
    let predictor = predictor(&fixture).await;
    assert!(predictor.ready(), "an ancestor answers");
    assert_eq!(predictor.version(model_id, None).await.unwrap().version(), 2);
    assert!(matches!(predictor.version(model_id, Some(3)).await, Err(PredictError::Unusable(3))));
    let degraded = Degraded { model: "m".to_owned(), live: 3, serving: Some(2) };
    assert_eq!(predictor.degraded(), [degraded]);
    assert!(fixture.store.corruption(model_id, 3).unwrap().contains("digest"));
    assert_eq!((fixture.store.corrupt_versions(model_id), fixture.store.corruption(model_id, 2)), (1, None));
    promoted(&fixture, model_id, 1).await;
    predictor.refresh(model_id).await;
    assert_eq!((predictor.degraded(), predictor.answering(model_id)), (vec![], Some(1)));
}

#[tokio::test]
async fn the_newest_good_ancestor_answers_and_nothing_does_without_one() {
    let (fixture, model_id) = three_versions().await;
    fixture.execute("update weights set weights = x'00' where version = 3").await;
    fixture.execute("update version set scaling = replace(scaling, '10', '11') where version = 2").await;
    let one_left = predictor(&fixture).await;
    assert_eq!((one_left.ready(), one_left.answering(model_id)), (true, Some(1)));
    assert!(fixture.store.corruption(model_id, 2).unwrap().contains("its row"), "a number of its scaling was changed");
    fixture.execute("delete from weights where version = 1").await;
    let none_left = predictor(&fixture).await;
    assert!(!none_left.ready());
    assert!(matches!(none_left.version(model_id, None).await, Err(PredictError::Unusable(3))));
    assert_eq!(none_left.degraded()[0].serving, None);
}

#[tokio::test]
async fn inputs_beyond_what_training_saw_are_flagged() {
    let (fixture, model_id) = three_versions().await;
    let live = predictor(&fixture).await.version(model_id, None).await.unwrap();
    let flags = |follower, spacing| live.predict(&[window(follower, spacing)]).unwrap()[0].flags.clone();
    assert_eq!(flags(10.0, 20.0), []);
    assert_eq!(flags(10.0, 104.9), [], "a hair beyond the end of the recordings");
    assert_eq!(flags(10.0, 105.1), [Flag::OutOfRange]);
    assert_eq!(flags(19.0, 20.0), [Flag::OutOfRange], "relative speed counts too");
    assert_eq!(
        serde_json::to_value([Flag::OutOfRange, Flag::Envelope, Flag::WarmingUp]).unwrap(),
        serde_json::json!(["out_of_range", "envelope", "warming_up"])
    );
}

#[tokio::test]
async fn a_window_holds_exactly_the_horizon_in_finite_numbers() {
    let (fixture, model_id) = three_versions().await;
    let live = predictor(&fixture).await.version(model_id, None).await.unwrap();
    let mut short = window(10.0, 20.0);
    short.leader_speed_mps.pop();
    assert_eq!(
        live.predict(&[window(10.0, 20.0), short]).unwrap_err().to_string(),
        "window 1: leader_speed_mps holds 9 steps, exactly 10 are needed"
    );
    let mut hollow = window(10.0, 20.0);
    hollow.spacing_m[4] = f32::NAN;
    assert_eq!(live.predict(&[hollow]).unwrap_err().to_string(), "window 0: spacing_m[4] is not finite");
}

#[tokio::test]
async fn large_requests_answer_what_small_ones_do() {
    let (fixture, model_id) = three_versions().await;
    let predictor = predictor(&fixture).await;
    let live = predictor.version(model_id, None).await.unwrap();
    let windows: Vec<_> = (0..250_u8).map(|i| window(10.0 + f32::from(i) / 100.0, 20.0)).collect();
    let together = predictor.predict(Arc::clone(&live), windows.clone()).await.unwrap();
    assert_eq!(together.len(), windows.len());
    for (window, answer) in windows.iter().zip(together) {
        assert_eq!(predictor.predict(Arc::clone(&live), vec![window.clone()]).await.unwrap(), [answer]);
    }
    let mut hollow = windows;
    for at in [201, 240] {
        hollow[at].spacing_m[2] = f32::INFINITY;
    }
    let refused = predictor.predict(live, hollow).await.unwrap_err();
    assert_eq!(refused.to_string(), "window 201: spacing_m[2] is not finite", "the first, as the request numbers them");
}

#[tokio::test]
async fn large_requests_take_no_more_threads_than_they_are_given() {
    let (fixture, model_id) = three_versions().await;
    let predictor = predictor(&fixture).await;
    let live = predictor.version(model_id, None).await.unwrap();
    let taken = Arc::clone(&predictor.threads).try_acquire_many_owned(3).unwrap();
    let windows = vec![window(10.0, 20.0); 250];
    let mut waiting = std::pin::pin!(predictor.predict(Arc::clone(&live), windows));
    assert!((&mut waiting).now_or_never().is_none());
    let mut drive = std::pin::pin!(predictor.simulate(live, window(10.0, 20.0), vec![10.0; 30]));
    assert!((&mut drive).now_or_never().is_none());
    assert_eq!(predictor.threads.available_permits(), 0, "nothing is computed");
    drop(taken);
    assert_eq!(waiting.await.unwrap().len(), 250);
    assert_eq!(drive.await.unwrap().spacing_m.len(), 30);
    assert_eq!(predictor.threads.available_permits(), 3);
}

#[tokio::test]
async fn a_vehicle_is_answered_step_by_step_what_its_windows_are_answered() {
    let (fixture, model_id) = three_versions().await;
    let live = predictor(&fixture).await.version(model_id, None).await.unwrap();
    let mut vehicle = Vehicle::new(Arc::clone(&live));
    assert_eq!(vehicle.version(), 3);
    let (mut seen, mut flags) = (Vec::new(), Vec::new());
    for t in 0..60_u8 {
        // Once far away, then close to a leader that stands.
        let spacing_m = if t == 14 { 120.0 } else { 20.0 - f32::from(t) / 3.0 };
        let leader_speed_mps = 10.0 - f32::from(t) / 6.0;
        seen.push(Seen { follower_speed_mps: 10.0, leader_speed_mps, spacing_m });
        let hollow = Seen { spacing_m: f32::NAN, ..seen[0] };
        assert_eq!(vehicle.step(hollow).unwrap_err().to_string(), "window 0: spacing_m[0] is not finite");
        let answer = vehicle.step(*seen.last().unwrap()).unwrap();
        let of = |back: usize| seen[seen.len().saturating_sub(back + 1)];
        let cut = |value: fn(Seen) -> f32| (0..10).rev().map(|back| value(of(back))).collect();
        let window = Window {
            follower_speed_mps: cut(|seen| seen.follower_speed_mps),
            leader_speed_mps: cut(|seen| seen.leader_speed_mps),
            spacing_m: cut(|seen| seen.spacing_m),
        };
        let mut expected = live.predict(&[window]).unwrap().remove(0);
        if t < 9 {
            expected.flags.push(Flag::WarmingUp);
        }
        assert_eq!(answer, expected, "step {t}");
        flags.extend(answer.flags);
    }
    for flag in [Flag::OutOfRange, Flag::Envelope, Flag::WarmingUp] {
        assert!(flags.contains(&flag), "the case is meant to show {flag:?}");
    }
}

#[tokio::test]
async fn a_simulation_gives_one_value_a_leader_step_and_tells_of_a_collision() {
    let (fixture, model_id) = three_versions().await;
    let predictor = predictor(&fixture).await;
    let live = predictor.version(model_id, None).await.unwrap();
    let drive = predictor.simulate(live, window(10.0, 2.0), vec![0.0; 30]).await.unwrap();
    assert_eq!((drive.spacing_m.len(), drive.follower_speed_mps.len(), drive.accel_mps2.len()), (30, 30, 30));
    assert!(drive.collided, "10 m/s towards a standing leader 2 m ahead");
    assert_eq!(drive.flags, [Flag::OutOfRange, Flag::Envelope]);
    assert!(drive.accel_mps2[1..12].iter().all(|&accel| accel == -8.0), "braked as hard as it goes all the same");
    assert!(drive.follower_speed_mps.iter().all(|&speed| speed >= 0.0));
}

#[tokio::test]
async fn the_envelope_bounds_what_is_served_where_the_settings_say_so() {
    let (fixture, model_id) = three_versions().await;
    let predictor = predictor(&fixture).await;
    let live = predictor.version(model_id, None).await.unwrap();
    let ample = live.predict(&[window(10.0, 20.0)]).unwrap().remove(0);
    assert_eq!((ample.accel_mps2, &ample.flags[..]), (ample.raw_accel_mps2, &[][..]));
    let close = live.predict(&[window(10.0, 0.3)]).unwrap().remove(0);
    assert!((-8.0..-4.0).contains(&close.accel_mps2) && close.flags == [Flag::Envelope], "{close:?}");
    assert!(close.raw_accel_mps2.abs() <= 4.0, "the network's own is told beside it");
    fixture.execute("update version set settings = json_set(settings, '$.envelope', json('false')), seal = null").await;
    let unbounded = Loaded::load(&fixture.store, model_id, 3).await.unwrap();
    let free = unbounded.predict(&[window(10.0, 0.3)]).unwrap().remove(0);
    assert_eq!((free.accel_mps2, &free.flags[..]), (close.raw_accel_mps2, &[][..]));
    assert!(unbounded.simulate(&window(10.0, 2.0), &[0.0; 30]).unwrap().accel_mps2.iter().all(|a| a.abs() <= 4.0));
}

#[tokio::test]
async fn a_version_that_was_let_go_of_while_it_was_read_is_not_kept() {
    let (fixture, model_id) = three_versions().await;
    let loaded = Arc::new(Loaded::load(&fixture.store, model_id, 1).await.unwrap());
    let mut recent = recent::Recent::new(2);
    let before = recent.forgotten();
    recent.forget(model_id, 1);
    recent.put(model_id, Arc::clone(&loaded), before);
    assert!(recent.get(model_id, 1).is_none());
    let forgotten = recent.forgotten();
    recent.put(model_id, loaded, forgotten);
    assert!(recent.get(model_id, 1).is_some());
}
