//! A learner that a test leads by the hand.

use std::sync::mpsc;

use tokio::sync::mpsc::{UnboundedReceiver, unbounded_channel};

use super::fake::Script;

/// A test's side of a paced learner.
pub(super) struct Pace {
    pub(super) arrived: UnboundedReceiver<u64>,
    pub(super) leave: mpsc::Sender<()>,
}

impl Pace {
    pub(super) fn new() -> (Self, Script) {
        let (arrived, at) = unbounded_channel();
        let (go, leave) = mpsc::channel();
        (Self { arrived: at, leave: go }, Script { pace: Some((arrived, leave)), ..Script::default() })
    }

    /// Waits until the learner has done this update; it waits too.
    pub(super) async fn until(&mut self, update: u64) {
        while self.arrived.recv().await.unwrap() != update {
            self.leave.send(()).unwrap();
        }
    }

    /// Lets the learner go on, for ever.
    pub(super) fn free(self) {
        for _ in 0..100 {
            self.leave.send(()).unwrap();
        }
    }
}
