//! One vehicle that is answered step by step.

use super::{Driver, DriverShape, Seen};
use crate::lstm::OverlappingWindows;

/// The windows of one vehicle that overlap at its newest step, and what they were told.
///
/// All of them advance with the newest step, so that the answer for the last `horizon` steps comes after one step's work. With
/// the paper's inputs, 128 hidden units and a horizon of 10 it takes about 21 KB.
#[derive(Debug, Clone)]
pub struct Sequence {
    windows: OverlappingWindows,
    /// The last `horizon` steps: step t at t modulo `horizon`.
    recent: Vec<Seen>,
    /// Steps that the windows have read.
    read: usize,
    inputs: Vec<f32>,
}

impl Sequence {
    /// The last `horizon` steps, oldest first; the first ever seen stands for those before it. None while nothing was seen.
    pub fn recent(&self) -> impl Iterator<Item = Seen> + '_ {
        let horizon = self.recent.len();
        let steps = if self.read == 0 { 0 } else { horizon };
        (0..steps).map(move |back| self.recent[(self.read + back) % horizon])
    }
}

impl Driver {
    /// A vehicle of which nothing was seen yet.
    #[must_use]
    pub fn sequence(&self) -> Sequence {
        let DriverShape { horizon, features, .. } = self.shape();
        let nothing = Seen { follower_speed_mps: 0.0, leader_speed_mps: 0.0, spacing_m: 0.0 };
        Sequence {
            windows: self.encoder.overlapping_windows(horizon),
            recent: vec![nothing; horizon],
            read: 0,
            inputs: Vec::with_capacity(horizon * features.inputs()),
        }
    }

    /// The network's acceleration after this step, m/s²: bit for bit what [`Self::accelerations`] answers for the last
    /// `horizon` steps, in which the first step stands for those that are missing. With [`super::Memory::Carried`] too, whose state is
    /// warmed on those steps. Nothing is allocated.
    ///
    /// # Panics
    /// When the sequence is not of a driver of this shape.
    pub fn next_acceleration(&self, sequence: &mut Sequence, seen: Seen) -> f32 {
        if sequence.read == 0 {
            for _ in 1..self.shape.horizon {
                self.read(sequence, seen);
            }
        }
        self.read(sequence, seen).expect("the first step filled a window")
    }

    /// Lets every window read a step; the acceleration of the one that is full then.
    ///
    /// A window measures accelerations from its own first step, so that with [`super::Features::Motion`] each reads other inputs.
    pub(super) fn read(&self, sequence: &mut Sequence, seen: Seen) -> Option<f32> {
        let Sequence { windows, recent, read, inputs } = sequence;
        let horizon = recent.len();
        assert_eq!(horizon, self.shape.horizon, "a sequence of this driver");
        recent[*read % horizon] = seen;
        inputs.clear();
        let readers = if self.shape.features.depend_on_the_window() { windows.reading() } else { 1 };
        for back in 0..readers {
            self.standardise(seen, recent[(*read - back) % horizon], back, inputs);
        }
        *read += 1;
        let mut head = [self.encoder.slide(windows, inputs)?];
        self.squash(&mut head);
        Some(head[0])
    }
}
