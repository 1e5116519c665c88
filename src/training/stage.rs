//! One stage: from a parent's weights and the training events of one regime to new weights and what to remember.

use std::time::Instant;

use rayon::ThreadPool;

use super::adam::clip_norm;
use super::checkpoint::{Checkpoint, fingerprint};
use super::input::{LearnSettings, StageInput};
use super::learned::{LearnError, Learned};
use super::loss::Penalties;
use super::minibatch::minibatch_gradient;
use super::observer::{Interim, Observer, Progress};
use super::order::{by_content, keyed, shuffle};
use super::replay::Replay;
use super::sanity::{DRIFT_MPS2, coasting_loss, drift_loss};
use super::start::late;
use crate::car_following::Event;
use crate::consolidation::{
    Accumulate, Method, PathIntegral, Penalty, PenaltyStep, RegimeMemory, default_accumulation, default_strength,
    importance, lambda,
};
use crate::driver::{Crew, Scaling};
use crate::evaluation::{Errors, drive_all};
use crate::lstm::{Network, initial_weights, kernel_name};

/// Validation events driven between two looks at whether to stop.
const VALIDATED_TOGETHER: usize = 64;

/// Learns one stage. The same input gives the same bits whatever the threads of `workers` and wherever it was resumed.
///
/// # Errors
/// See [`LearnError`].
pub fn learn_stage(
    input: &StageInput<'_>,
    resume: Option<&[u8]>,
    workers: &ThreadPool,
    observer: &mut dyn Observer,
) -> Result<Learned, LearnError> {
    let horizon = input.settings.shape.horizon;
    let train: Vec<&Event> = by_content(input.train, horizon).into_iter().map(|i| &input.train[i]).collect();
    if train.is_empty() {
        return Err(LearnError::NoTrainingEvents);
    }
    let validation: Vec<&Event> = input.validation.iter().filter(|event| event.steps() > horizon).collect();
    let mut stage = Stage::begin(input, &train, &validation, workers);
    if let Some(bytes) = resume {
        stage.state = Checkpoint::from_bytes(bytes, &stage.fingerprint).map_err(LearnError::Checkpoint)?;
    }
    if let Some(interim) = &stage.state.interim {
        observer.evaluated(interim);
    }
    while stage.state.epoch < input.settings.epochs {
        stage.epoch(observer)?;
    }
    stage.finish(observer)
}

/// A stage under way.
struct Stage<'a> {
    input: &'a StageInput<'a>,
    train: &'a [&'a Event],
    validation: &'a [&'a Event],
    replay: Replay<'a>,
    crew: Crew<'a, f32>,
    network: Network<f32>,
    scaling: Scaling,
    penalty: Option<(Penalty, f64)>,
    strength: Option<f64>,
    /// Loss beyond which an epoch counts as diverged.
    loss_limit: f64,
    fingerprint: [u8; 32],
    state: Checkpoint,
    gradient: Vec<f32>,
    /// The gradient as it was before the penalty and the clipping, where its path is followed.
    plain_gradient: Vec<f32>,
    /// The weights before an update.
    before: Vec<f32>,
    /// What was told last.
    told: Option<Progress>,
    resumed_at: Instant,
    events_since: u64,
}

impl<'a> Stage<'a> {
    fn begin(
        input: &'a StageInput<'a>,
        train: &'a [&'a Event],
        validation: &'a [&'a Event],
        workers: &'a ThreadPool,
    ) -> Self {
        let settings = &input.settings;
        let weights = first_weights(input);
        let rule = settings.accumulation.unwrap_or_else(|| default_accumulation(input.method));
        let accumulate = Accumulate { rule, decay: settings.online_decay };
        let penalty = Penalty::collapse(input.method, accumulate, input.memory, &weights);
        let strength = input.method.consolidates().then(|| settings.strength.unwrap_or(default_strength(input.method)));
        let penalty = penalty.map(|penalty| {
            let lambda = settings
                .lambda
                .unwrap_or_else(|| lambda(strength.unwrap_or_default(), settings.penalty_step, &penalty));
            (penalty, lambda)
        });
        let fingerprint = fingerprint(input, train);
        let replayed = if input.method.replays() { input.replay } else { &[] };
        let replay = Replay::new(replayed, settings.replay_share, settings.minibatch, settings.shape.horizon);
        let coasting = |events: &[&Event]| coasting_loss(events, settings.shape, penalties(settings));
        let path = input.method.follows_path().then(|| PathIntegral::new(weights.len()));
        Self {
            train,
            validation,
            crew: Crew::new(settings.shape, workers),
            network: Network::new(settings.shape.layout(), &weights),
            scaling: input.scaling.unwrap_or_else(|| Scaling::estimate(settings.shape, train)),
            penalty,
            strength: strength.filter(|_| settings.lambda.is_none()),
            loss_limit: 4.0 * coasting(train).max(coasting(&replay.events())).max(drift_loss(train, settings.shape)),
            replay,
            gradient: vec![0.0; weights.len()],
            plain_gradient: Vec::new(),
            before: Vec::new(),
            told: None,
            state: Checkpoint { path, ..Checkpoint::begin(fingerprint, weights) },
            fingerprint,
            resumed_at: Instant::now(),
            events_since: 0,
            input,
        }
    }

    fn epoch(&mut self, observer: &mut dyn Observer) -> Result<(), LearnError> {
        let settings = &self.input.settings;
        let mut order: Vec<usize> = (0..self.train.len()).collect();
        shuffle(&mut order, &mut keyed("order", settings.seed, self.input.stage, self.state.epoch));
        let minibatches: Vec<&[usize]> = order.chunks(self.replay.new).collect();
        let updates = minibatches.len() as u64 * u64::from(settings.epochs);
        for minibatch in minibatches.iter().skip(self.state.minibatch as usize) {
            let began = Instant::now();
            let mut events: Vec<&Event> = minibatch.iter().map(|&i| self.train[i]).collect();
            events.extend(self.replayed(minibatch.len()));
            let (loss, penalty) = self.update(&events, updates)?;
            self.state.update_s += began.elapsed().as_secs_f64();
            self.state.epoch_loss += loss * events.len() as f64;
            self.state.minibatch += 1;
            self.events_since += minibatch.len() as u64;
            let progress = Progress {
                epoch: self.state.epoch + 1,
                update: self.state.adam.updates,
                updates,
                loss,
                penalty,
                events_per_s: self.events_since as f64 / self.resumed_at.elapsed().as_secs_f64().max(1e-9),
            };
            observer.weights(&progress, &self.scaling, &self.state.weights);
            let go_on = observer.updated(&progress);
            if !go_on || observer.wants_checkpoint() {
                observer.checkpoint(&progress, self.state.to_bytes());
            }
            if !go_on {
                return Err(LearnError::Stopped);
            }
            self.told = Some(progress);
        }
        self.refuse_divergence()?;
        self.validate(observer)?;
        self.state.epoch += 1;
        self.state.minibatch = 0;
        self.state.epoch_loss = 0.0;
        Ok(())
    }

    /// Earlier events for the next update, beside so many new ones.
    fn replayed(&self, new: usize) -> Vec<&'a Event> {
        let Checkpoint { epoch, minibatch, .. } = self.state;
        let of_epochs = epoch as usize * self.replay.of_epoch(self.train.len());
        let before = of_epochs + self.replay.of_epoch(minibatch as usize * self.replay.new);
        self.replay.draw(self.input.settings.seed, self.input.stage, before, new)
    }

    /// Drives the validation events with the weights as they are, which stay as they are. Stopped on the way, the stage has
    /// lost nothing: resumed, it drives them again.
    fn validate(&mut self, observer: &mut dyn Observer) -> Result<(), LearnError> {
        let began = Instant::now();
        let mut errors = Errors::default();
        for events in self.validation.chunks(VALIDATED_TOGETHER) {
            if observer.wants_stop() {
                return Err(self.stopped(observer));
            }
            let horizon = self.input.settings.shape.horizon;
            errors += drive_all(&self.crew, horizon, &self.scaling, &self.state.weights, events);
        }
        if errors.events > 0 {
            let interim = Interim { epoch: self.state.epoch + 1, errors };
            self.state.interim = Some(interim);
            observer.evaluated(&interim);
        }
        // Training events per second are those of training.
        self.resumed_at += began.elapsed();
        Ok(())
    }

    /// Leaves a checkpoint between two updates.
    fn stopped(&self, observer: &mut dyn Observer) -> LearnError {
        // Without an update since the stage was resumed, its checkpoint is the one it was resumed from.
        if let Some(progress) = &self.told {
            observer.checkpoint(progress, self.state.to_bytes());
        }
        LearnError::Stopped
    }

    fn refuse_divergence(&self) -> Result<(), LearnError> {
        let events = self.train.len() + self.replay.of_epoch(self.train.len());
        let mean_loss = self.state.epoch_loss / events as f64;
        if mean_loss > self.loss_limit {
            let detail = format!(
                "the loss of epoch {} is {mean_loss:.1}, more than {:.1}: four times that of a driver who never accelerates, or who is \
                 off by {DRIFT_MPS2} m/s² all along",
                self.state.epoch + 1,
                self.loss_limit
            );
            return Err(LearnError::Diverged { update: self.state.adam.updates, detail });
        }
        Ok(())
    }

    /// One update on one minibatch; its loss and penalty at the weights before.
    fn update(&mut self, events: &[&Event], updates: u64) -> Result<(f64, f64), LearnError> {
        let settings = &self.input.settings;
        let horizon = settings.shape.horizon;
        let key = (settings.seed, self.input.stage, self.state.adam.updates);
        let started = (settings.random_start > 0.0).then(|| late(events, settings.random_start, horizon, key));
        let started: Option<Vec<&Event>> = started.as_ref().map(|events| events.iter().collect());
        let events = started.as_deref().unwrap_or(events);
        let weights = &mut self.state.weights;
        self.network.set(weights);
        let loss = minibatch_gradient(
            &self.crew,
            horizon,
            &self.scaling,
            &self.network,
            events,
            penalties(settings),
            &mut self.gradient,
        );
        if self.state.path.is_some() {
            self.plain_gradient.clone_from(&self.gradient);
        }
        let mut value = 0.0;
        if let Some((penalty, lambda)) = &self.penalty {
            value = lambda * penalty.value(weights);
            if settings.penalty_step == PenaltyStep::Coupled {
                penalty.add_gradient(*lambda as f32, weights, &mut self.gradient);
            }
        }
        let norm = clip_norm(&mut self.gradient, settings.clip_norm);
        self.before.clone_from(weights);
        let factor = settings.learning_rate_schedule.factor(self.state.adam.updates + 1, updates);
        let learning_rate = f64::from(settings.learning_rate) * factor;
        self.state.adam.step(weights, &self.gradient, learning_rate as f32);
        if let Some((penalty, lambda)) = &self.penalty {
            let eta = learning_rate * lambda;
            match settings.penalty_step {
                PenaltyStep::Coupled => {}
                PenaltyStep::Proximal => penalty.pull(eta, weights),
                PenaltyStep::Modulated => penalty.modulate(eta, &self.before, weights),
            }
        }
        if let Some(path) = &mut self.state.path {
            path.add(&self.plain_gradient, &self.before, weights);
        }
        if loss.is_finite() && norm.is_finite() {
            Ok((loss, value))
        } else {
            let detail = "the loss or its gradient is not finite".to_owned();
            Err(LearnError::Diverged { update: self.state.adam.updates, detail })
        }
    }

    fn finish(self, observer: &mut dyn Observer) -> Result<Learned, LearnError> {
        Ok(Learned {
            memory: self.memory(observer)?,
            scaling: self.scaling,
            strength: self.strength,
            lambda: self.penalty.map(|(_, lambda)| lambda),
            kernel: kernel_name().to_owned(),
            update_s: self.state.update_s,
            weights: self.state.weights,
        })
    }

    /// What to keep of the regime. Stopped on the way, the stage goes on here.
    fn memory(&self, observer: &mut dyn Observer) -> Result<Option<RegimeMemory>, LearnError> {
        let (settings, weights) = (&self.input.settings, &self.state.weights);
        let (importance, samples) = if let Some(path) = &self.state.path {
            let steps: usize = self.train.iter().map(|event| event.steps() - settings.shape.horizon).sum();
            (path.importance(&first_weights(self.input), weights, settings.si_damping), steps as u64)
        } else if let Some(kept) = self.input.method.keeps() {
            let mut go_on = || !observer.wants_stop();
            let options = settings.importance;
            importance(kept, options, &self.crew, &self.scaling, weights, self.train, &mut go_on)
                .ok_or_else(|| self.stopped(observer))?
        } else {
            return Ok(None);
        };
        let earlier = self.input.memory.iter().find(|kept| kept.regime == self.input.regime);
        let new = (importance.as_slice(), samples);
        Ok(Some(RegimeMemory::after(self.input.regime, self.input.stage, earlier, new, weights)))
    }
}

/// The weights a stage starts from.
fn first_weights(input: &StageInput<'_>) -> Vec<f32> {
    match (input.method, input.parent_weights) {
        (Method::Joint, _) | (_, None) => initial_weights(input.settings.shape.layout(), input.settings.seed),
        (_, Some(parent)) => parent.to_vec(),
    }
}

fn penalties(settings: &LearnSettings) -> Penalties {
    Penalties {
        collision: settings.collision_penalty.into(),
        backward: settings.backward_penalty.into(),
        collision_margin_m: settings.collision_margin_m.into(),
    }
}
