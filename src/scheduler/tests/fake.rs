//! A learner whose weights tell what it was given, and whose pace a test sets.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, mpsc};

use rayon::ThreadPool;
use tokio::sync::mpsc::UnboundedSender;

use crate::car_following::Event;
use crate::consolidation::RegimeMemory;
use crate::driver::{DriverShape, Scaling};
use crate::evaluation::{Errors, ServedErrors};
use crate::scheduler::Learner;
use crate::training::{LearnError, Learned, Observer, Progress, StageInput};

/// Updates of every stage.
const UPDATES: u64 = 4;

/// What happens when a regime is learned; regimes that are not named are learned.
#[derive(Debug, Clone, Copy)]
pub(super) enum Behaviour {
    Diverge,
    Panic,
    /// Ends with this squared error per step on every event.
    Err(f32),
    /// Ends as the strength says: with these squared errors per step on events before and from [`NEW`] on; none diverges.
    ByStrength(fn(Option<f64>) -> Option<[f32; 2]>),
}

/// The first mark of events that [`Behaviour::ByStrength`] has for new.
const NEW: f32 = 10.0;

/// Told of every update; leave to go on.
pub(super) type Pacing = (UnboundedSender<u64>, mpsc::Receiver<()>);

/// What the fake does.
#[derive(Default)]
pub(super) struct Script {
    pub(super) regimes: HashMap<&'static str, Behaviour>,
    /// Where none, it runs through.
    pub(super) pace: Option<Pacing>,
}

#[derive(Clone)]
pub(super) struct Fake {
    regimes: Arc<HashMap<&'static str, Behaviour>>,
    pace: Arc<Mutex<Option<Pacing>>>,
    log: Arc<Mutex<Vec<String>>>,
}

impl Fake {
    pub(super) fn new(script: Script) -> Self {
        Self { regimes: Arc::new(script.regimes), pace: Arc::new(Mutex::new(script.pace)), log: Arc::default() }
    }

    /// What was learned and measured, in order.
    pub(super) fn log(&self) -> Vec<String> {
        std::mem::take(&mut *self.log.lock().unwrap())
    }

    fn note(&self, line: String) {
        self.log.lock().unwrap().push(line);
    }

    fn note_start(&self, input: &StageInput<'_>, update: u64) {
        let kept: Vec<_> = input.memory.iter().map(|memory| memory.regime.as_str()).collect();
        let replayed: Vec<_> =
            input.replay.iter().map(|of| format!(", {} of {}", of.events.len(), of.regime)).collect();
        let strength = input.settings.strength.map(|strength| format!(", strength {strength}")).unwrap_or_default();
        self.note(format!(
            "{} stage {} from update {update}, {} events, keeps [{}]{}{strength}",
            input.regime,
            input.stage,
            input.train.len(),
            kept.join(" "),
            replayed.concat()
        ));
    }

    fn wait(&self, update: u64) {
        if let Some((arrived, leave)) = &*self.pace.lock().unwrap() {
            // A test that is over hears and says nothing more.
            let _ = arrived.send(update);
            let _ = leave.recv();
        }
    }
}

fn scaling() -> Scaling {
    Scaling {
        mean: [0.0; 4],
        spread: [1.0; 4],
        low: [0.0, 0.0, -5.0, 0.0],
        high: [40.0, 40.0, 5.0, 100.0],
        motion: None,
    }
}

impl Learner for Fake {
    fn learn(
        &self,
        input: &StageInput<'_>,
        resume: Option<&[u8]>,
        _: &ThreadPool,
        observer: &mut dyn Observer,
    ) -> Result<Learned, LearnError> {
        let behaviour = self.regimes.get(input.regime).copied();
        let mut update = 0;
        let mut weight = input.parent_weights.map_or(1.0, |weights| weights[0]);
        if let Some(state) = resume {
            update = u64::from(state[0]);
            weight = f32::from_le_bytes(state[1..5].try_into().unwrap());
        }
        self.note_start(input, update);
        while update < UPDATES {
            update += 1;
            weight = weight * 0.5 + input.train.iter().map(|event| event.spacing_m()[0]).sum::<f32>() / 1000.0;
            let diverges = match behaviour {
                Some(Behaviour::Diverge) => true,
                Some(Behaviour::ByStrength(errors)) => errors(input.settings.strength).is_none(),
                _ => false,
            };
            if diverges {
                return Err(LearnError::Diverged { update, detail: "as told".to_owned() });
            }
            assert!(!matches!(behaviour, Some(Behaviour::Panic)), "as told");
            self.wait(update);
            let progress = Progress { epoch: 1, update, updates: UPDATES, loss: 1.0, penalty: 0.0, events_per_s: 1.0 };
            let go_on = observer.updated(&progress);
            if !go_on || observer.wants_checkpoint() {
                let mut state = vec![u8::try_from(update).unwrap()];
                state.extend(weight.to_le_bytes());
                observer.checkpoint(&progress, state);
            }
            if !go_on {
                return Err(LearnError::Stopped);
            }
        }
        if let Some(Behaviour::Err(error)) = behaviour {
            weight = error;
        }
        let mut weights = vec![weight; input.settings.shape.layout().len()];
        if let Some(Behaviour::ByStrength(errors)) = behaviour
            && let Some(errors) = errors(input.settings.strength)
        {
            weights[..2].copy_from_slice(&errors);
        }
        Ok(Learned {
            memory: input.method.consolidates().then(|| RegimeMemory {
                regime: input.regime.to_owned(),
                importance: weights.clone(),
                anchor: weights.clone(),
                samples: input.train.len() as u64,
                stage: input.stage,
            }),
            weights,
            scaling: scaling(),
            strength: input.settings.strength.or(Some(1.0)),
            lambda: None,
            kernel: "fake".to_owned(),
            update_s: 0.0,
        })
    }

    fn evaluate(&self, _: DriverShape, _: &Scaling, weights: &[f32], events: &[Event], _: &ThreadPool) -> Errors {
        self.note(format!("drive {} events", events.len()));
        let steps = events.len() as u64;
        let is_new = |event: &&Event| event.spacing_m()[0] > 20.0 + (NEW - 0.5) / 100.0;
        let new = events.iter().filter(is_new).count() as f64;
        let sum = f64::from(weights[0]) * (steps as f64 - new) + f64::from(weights[1]) * new;
        Errors { spacing_sq: sum, speed_sq: sum, collisions: 0, events: u32::try_from(steps).unwrap(), steps }
    }

    fn evaluate_served(
        &self,
        _: DriverShape,
        _: &Scaling,
        weights: &[f32],
        events: &[Event],
        _: &ThreadPool,
    ) -> ServedErrors {
        let steps = events.len() as u64;
        let sum = 2.0 * f64::from(weights[0]) * steps as f64;
        let errors =
            Errors { spacing_sq: sum, speed_sq: sum, collisions: 0, events: u32::try_from(steps).unwrap(), steps };
        ServedErrors { errors, acted_steps: 1, held_steps: 0 }
    }
}
