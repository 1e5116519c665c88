use std::sync::Arc;

use super::tests::{predictor, three_versions};
use super::*;
use crate::driver::{Seen, Window};

fn settings(sequences: usize, sequence_idle_s: f64) -> PredictorSettings {
    PredictorSettings {
        named_versions: 1,
        inline_windows: 1,
        waiting_windows: 1,
        threads: 1,
        sequences,
        sequence_idle_s,
    }
}

fn step(t: u8) -> Seen {
    Seen { follower_speed_mps: 10.0, leader_speed_mps: 9.0 + f32::from(t) / 9.0, spacing_m: 20.0 + f32::from(t) }
}

fn id(number: u64) -> SequenceId {
    SequenceId::Number(number)
}

/// What a version answers for the last ten steps up to `t`.
fn window_up_to(loaded: &Loaded, t: u8) -> Prediction {
    let cut = |value: fn(Seen) -> f32| (0..10).rev().map(|back| value(step(t.saturating_sub(back)))).collect();
    let window = Window {
        follower_speed_mps: cut(|seen| seen.follower_speed_mps),
        leader_speed_mps: cut(|seen| seen.leader_speed_mps),
        spacing_m: cut(|seen| seen.spacing_m),
    };
    let mut answer = loaded.predict(&[window]).unwrap().remove(0);
    if t < 9 {
        answer.flags.push(Flag::WarmingUp);
    }
    answer
}

#[tokio::test]
async fn a_vehicle_that_moves_to_another_version_is_answered_as_if_it_had_always_been_there() {
    let (fixture, model_id) = three_versions().await;
    let predictor = predictor(&fixture).await;
    let (old, new) =
        (predictor.version(model_id, Some(2)).await.unwrap(), predictor.version(model_id, None).await.unwrap());
    // In the middle of warming up, just when it is over, and long after.
    for moves_at in [3, 9, 10, 25] {
        let sequences = Sequences::new(&settings(1, 60.0));
        let first = sequences.start(model_id, id(1), Arc::clone(&old), step(0)).unwrap();
        assert_eq!(first, window_up_to(&old, 0));
        for t in 1..30 {
            let onto = (t >= moves_at).then(|| Arc::clone(&new));
            let expected = if onto.is_some() { (3, window_up_to(&new, t)) } else { (2, window_up_to(&old, t)) };
            assert_eq!(sequences.step(model_id, &id(1), step(t), onto).unwrap(), expected, "{moves_at}, {t}");
        }
        assert_eq!(sequences.version(model_id, &id(1)).unwrap(), 3);
    }
}

#[tokio::test]
async fn sequences_are_told_apart_by_model_and_id_and_there_are_not_too_many() {
    let (fixture, model_id) = three_versions().await;
    let loaded = predictor(&fixture).await.version(model_id, None).await.unwrap();
    let sequences = Sequences::new(&settings(2, 60.0));
    let start = |model, id| sequences.start(model, id, Arc::clone(&loaded), step(0));
    start(model_id, id(1)).unwrap();
    start(model_id + 1, id(1)).unwrap();
    assert!(matches!(start(model_id, SequenceId::Text("1".into())), Err(SequenceError::Full)));
    start(model_id, id(1)).expect("one that is open begins anew");
    let hollow = Seen { spacing_m: f32::NAN, ..step(0) };
    assert!(matches!(sequences.step(model_id, &id(1), hollow, None), Err(SequenceError::Predict(_))));
    sequences.end(model_id, id(1));
    assert!(matches!(sequences.step(model_id, &id(1), step(1), None), Err(SequenceError::Unknown)));
    sequences.step(model_id + 1, &id(1), step(1), None).unwrap();
    assert_eq!(sequences.count(), 1);
}

#[tokio::test]
async fn one_of_which_nothing_comes_has_ended() {
    let (fixture, model_id) = three_versions().await;
    let loaded = predictor(&fixture).await.version(model_id, None).await.unwrap();
    let sequences = Sequences::new(&settings(1, 0.0));
    sequences.start(model_id, id(1), Arc::clone(&loaded), step(0)).unwrap();
    assert!(matches!(sequences.step(model_id, &id(1), step(1), None), Err(SequenceError::Unknown)));
    sequences.start(model_id, id(2), Arc::clone(&loaded), step(0)).expect("it makes room");
    assert_eq!(sequences.count(), 1);
    sequences.tidy();
    assert_eq!(sequences.count(), 0);
}
