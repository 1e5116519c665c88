//! Everything a stage needs to go on, as bytes.

use sha2::{Digest, Sha256};

use super::adam::Adam;
use super::input::StageInput;
use super::observer::Interim;
use super::order::by_content;
use crate::car_following::Event;
use crate::consolidation::PathIntegral;
use crate::evaluation::Errors;

const MAGIC: &[u8; 8] = b"HWCKPT03";

/// Where a stage stands between two updates.
#[derive(Debug, Clone, PartialEq)]
pub struct Checkpoint {
    /// Of the input it belongs to.
    pub fingerprint: [u8; 32],
    /// Epochs done.
    pub epoch: u32,
    /// Minibatches of the next epoch done.
    pub minibatch: u64,
    /// Loss summed over the events of that epoch.
    pub epoch_loss: f64,
    /// Time inside updates, s.
    pub update_s: f64,
    /// After the last epoch done.
    pub interim: Option<Interim>,
    /// The weights.
    pub weights: Vec<f32>,
    /// The optimiser.
    pub adam: Adam,
    /// What the way so far was worth, for synaptic intelligence.
    pub path: Option<PathIntegral>,
}

impl Checkpoint {
    /// Before the first update.
    pub(super) fn begin(fingerprint: [u8; 32], weights: Vec<f32>) -> Self {
        let adam = Adam::new(weights.len());
        Self {
            fingerprint,
            epoch: 0,
            minibatch: 0,
            epoch_loss: 0.0,
            update_s: 0.0,
            interim: None,
            weights,
            adam,
            path: None,
        }
    }

    /// As it is kept.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = MAGIC.to_vec();
        bytes.extend(self.fingerprint);
        bytes.extend(self.epoch.to_le_bytes());
        bytes.extend(self.minibatch.to_le_bytes());
        bytes.extend(self.epoch_loss.to_le_bytes());
        bytes.extend(self.update_s.to_le_bytes());
        bytes.extend(self.adam.updates.to_le_bytes());
        // Epoch 0 ends before anything is evaluated, and stands for none.
        let interim = self.interim.unwrap_or(Interim { epoch: 0, errors: Errors::default() });
        bytes.extend(interim.epoch.to_le_bytes());
        bytes.extend(interim.errors.spacing_sq.to_le_bytes());
        bytes.extend(interim.errors.speed_sq.to_le_bytes());
        bytes.extend(interim.errors.collisions.to_le_bytes());
        bytes.extend(interim.errors.events.to_le_bytes());
        bytes.extend(interim.errors.steps.to_le_bytes());
        let path = self.path.as_ref().map(PathIntegral::sums).unwrap_or_default();
        bytes.extend((self.weights.len() as u64).to_le_bytes());
        bytes.extend((path.len() as u64).to_le_bytes());
        for values in [&self.weights, &self.adam.first, &self.adam.second, path] {
            bytes.extend(values.iter().flat_map(|x| x.to_le_bytes()));
        }
        bytes
    }

    /// The checkpoint in `bytes`, which must belong to the input of this fingerprint.
    ///
    /// # Errors
    /// Why they are none, for a person.
    pub fn from_bytes(bytes: &[u8], fingerprint: &[u8; 32]) -> Result<Self, String> {
        let mut rest = bytes;
        let mut take = |len: usize| {
            let (head, tail) = rest.split_at_checked(len).ok_or("it is too short")?;
            rest = tail;
            Ok::<_, String>(head)
        };
        let four = |bytes: &[u8]| <[u8; 4]>::try_from(bytes).expect("four were taken");
        let eight = |bytes: &[u8]| <[u8; 8]>::try_from(bytes).expect("eight were taken");
        if take(8)? != MAGIC {
            return Err("it is of another format".to_owned());
        }
        if take(32)? != fingerprint {
            return Err("it belongs to other events, settings or parent".to_owned());
        }
        let epoch = u32::from_le_bytes(four(take(4)?));
        let minibatch = u64::from_le_bytes(eight(take(8)?));
        let epoch_loss = f64::from_le_bytes(eight(take(8)?));
        let update_s = f64::from_le_bytes(eight(take(8)?));
        let updates = u64::from_le_bytes(eight(take(8)?));
        let interim = Interim {
            epoch: u32::from_le_bytes(four(take(4)?)),
            errors: Errors {
                spacing_sq: f64::from_le_bytes(eight(take(8)?)),
                speed_sq: f64::from_le_bytes(eight(take(8)?)),
                collisions: u32::from_le_bytes(four(take(4)?)),
                events: u32::from_le_bytes(four(take(4)?)),
                steps: u64::from_le_bytes(eight(take(8)?)),
            },
        };
        let interim = Some(interim).filter(|interim| interim.epoch > 0);
        let parameters = u64::from_le_bytes(eight(take(8)?));
        let of_path = u64::from_le_bytes(eight(take(8)?));
        if of_path != 0 && of_path != parameters {
            return Err("its arrays differ in length".to_owned());
        }
        let mut floats = |count: u64| {
            let bytes =
                usize::try_from(count).ok().and_then(|count| count.checked_mul(4)).ok_or("its arrays are too long")?;
            Ok::<Vec<f32>, String>(take(bytes)?.chunks_exact(4).map(|x| f32::from_le_bytes(four(x))).collect())
        };
        let weights = floats(parameters)?;
        let adam = Adam { updates, first: floats(parameters)?, second: floats(parameters)? };
        let path = Some(floats(of_path)?).filter(|sums| !sums.is_empty()).map(PathIntegral::resumed);
        if !rest.is_empty() {
            return Err("its arrays are too long".to_owned());
        }
        Ok(Self { fingerprint: *fingerprint, epoch, minibatch, epoch_loss, update_s, interim, weights, adam, path })
    }
}

/// Digest of everything a stage's result depends on.
#[must_use]
pub fn stage_fingerprint(input: &StageInput<'_>) -> [u8; 32] {
    let train: Vec<&Event> =
        by_content(input.train, input.settings.shape.horizon).into_iter().map(|i| &input.train[i]).collect();
    fingerprint(input, &train)
}

/// The same, with the training events that are long enough in the order of their digests.
pub(super) fn fingerprint(input: &StageInput<'_>, train: &[&Event]) -> [u8; 32] {
    let mut hasher = Sha256::new();
    let kept: Vec<_> = input.memory.iter().map(|m| (&m.regime, m.samples, m.stage)).collect();
    let plain = format!(
        "{:?} {:?} {} {} {:?} {kept:?}",
        input.method, input.settings, input.stage, input.regime, input.scaling
    );
    hasher.update(plain);
    let memory = input.memory.iter().flat_map(|m| [&m.importance, &m.anchor]).flatten();
    for value in input.parent_weights.unwrap_or_default().iter().chain(memory) {
        hasher.update(value.to_le_bytes());
    }
    for event in train {
        hasher.update(event.content_sha256());
    }
    for of in input.replay {
        hasher.update(&of.regime);
        for event in &of.events {
            hasher.update(event.content_sha256());
        }
    }
    hasher.finalize().into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_checkpoint_survives_its_bytes_and_refuses_strangers() {
        let mut checkpoint = Checkpoint::begin([7; 32], vec![1.0, -2.0, 3.0]);
        checkpoint.epoch = 2;
        checkpoint.minibatch = 9;
        checkpoint.epoch_loss = 0.1;
        assert_eq!(Checkpoint::from_bytes(&checkpoint.to_bytes(), &[7; 32]).as_ref(), Ok(&checkpoint));
        let errors = Errors { spacing_sq: 1.5, speed_sq: 0.1, collisions: 3, events: 4, steps: 5 };
        checkpoint.interim = Some(Interim { epoch: 2, errors });
        checkpoint.adam.step(&mut checkpoint.weights, &[0.5, 0.5, 0.5], 0.1);
        checkpoint.path = Some(PathIntegral::resumed(vec![0.5, 0.25, -1.0]));
        let bytes = checkpoint.to_bytes();
        assert_eq!(Checkpoint::from_bytes(&bytes, &[7; 32]).as_ref(), Ok(&checkpoint));
        assert!(Checkpoint::from_bytes(&bytes, &[8; 32]).is_err());
        let mut short = checkpoint.clone();
        short.path = Some(PathIntegral::resumed(vec![0.5]));
        assert!(Checkpoint::from_bytes(&short.to_bytes(), &[7; 32]).is_err());
        assert!(Checkpoint::from_bytes(&bytes[..bytes.len() - 1], &[7; 32]).is_err());
        assert!(Checkpoint::from_bytes(&bytes[..20], &[7; 32]).is_err());
        assert!(Checkpoint::from_bytes(b"", &[7; 32]).is_err());
    }
}
