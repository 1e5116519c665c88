//! Experience replay: which earlier events take part in which update.

use super::order::{keyed, shuffle};
use crate::car_following::Event;

/// Training events of a regime learned earlier, at the model's step, in order of content.
#[derive(Debug, Clone, PartialEq)]
pub struct ReplayedRegime {
    /// The regime.
    pub regime: String,
    /// Some of its training events.
    pub events: Vec<Event>,
}

/// Earlier events, regime by regime, and their share of an update.
///
/// An update of `minibatch` events holds the share of replayed ones and new ones for the rest, at least one; its loss is the
/// mean over all steps of all of them, so the share is also the weight of earlier traffic in the gradient, however many
/// regimes there are: each counts as much as the others. An epoch is once through the new events.
#[derive(Debug)]
pub(super) struct Replay<'a> {
    regimes: Vec<(&'a str, Vec<&'a Event>)>,
    /// New events of a full update.
    pub(super) new: usize,
    /// Replayed events of a full update.
    replayed: usize,
}

impl<'a> Replay<'a> {
    /// Regimes without an event longer than the horizon are left out; with none left, every update is of new events.
    pub(super) fn new(regimes: &'a [ReplayedRegime], share: f64, minibatch: usize, horizon: usize) -> Self {
        let mut kept: Vec<(&str, Vec<&Event>)> = regimes
            .iter()
            .map(|of| (of.regime.as_str(), of.events.iter().filter(|event| event.steps() > horizon).collect()))
            .filter(|(_, events): &(_, Vec<_>)| !events.is_empty())
            .collect();
        kept.sort_by_key(|(regime, _)| *regime);
        let replayed = if kept.is_empty() { 0 } else { (share * minibatch as f64).round() as usize };
        let new = minibatch.saturating_sub(replayed).max(1);
        Self { regimes: kept, new, replayed }
    }

    /// All of them.
    pub(super) fn events(&self) -> Vec<&'a Event> {
        self.regimes.iter().flat_map(|(_, events)| events).copied().collect()
    }

    /// Replayed events beside so many new ones.
    fn beside(&self, new: usize) -> usize {
        (new * self.replayed).div_ceil(self.new)
    }

    /// Replayed events of an epoch of so many new ones.
    pub(super) fn of_epoch(&self, new: usize) -> usize {
        new / self.new * self.replayed + self.beside(new % self.new)
    }

    /// The replayed events of an update with `new` new ones, `before` replayed ones into the stage: the regimes take turns,
    /// and each goes through its events again and again, in another order each time. Depends on nothing else, so that a
    /// resumed stage replays the same.
    pub(super) fn draw(&self, seed: u64, stage: u32, before: usize, new: usize) -> Vec<&'a Event> {
        (before..before + self.beside(new)).map(|at| self.at(seed, stage, at)).collect()
    }

    fn at(&self, seed: u64, stage: u32, at: usize) -> &'a Event {
        let (regime, events) = &self.regimes[at % self.regimes.len()];
        let turn = at / self.regimes.len();
        let (pass, within) = (turn / events.len(), turn % events.len());
        let mut order: Vec<usize> = (0..events.len()).collect();
        shuffle(&mut order, &mut keyed(&format!("replay {regime}"), seed, stage, pass as u32));
        events[order[within]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn regime(name: &str, spacings: std::ops::Range<u16>) -> ReplayedRegime {
        let event = |s: u16| Event::new(0.1, vec![f32::from(s); 9], vec![5.0; 9], vec![5.0; 9]);
        ReplayedRegime { regime: name.to_owned(), events: spacings.map(event).collect() }
    }

    fn spacings(events: &[&Event]) -> Vec<f32> {
        events.iter().map(|event| event.spacing_m()[0]).collect()
    }

    #[test]
    fn regimes_take_turns_and_every_event_comes_before_any_comes_again() {
        let regimes = [regime("b", 10..13), regime("a", 20..22)];
        let replay = Replay::new(&regimes, 0.5, 8, 5);
        assert_eq!((replay.new, replay.events().len()), (4, 5));
        let drawn = spacings(&replay.draw(1, 2, 0, 12));
        let of = |low: f32| drawn.iter().copied().filter(|s| (low..low + 10.0).contains(s)).collect::<Vec<_>>();
        let (a, b) = (of(20.0), of(10.0));
        assert_eq!((a.len(), b.len()), (6, 6));
        for (drawn, events) in [(a, 2), (b, 3)] {
            for pass in drawn.chunks(events) {
                let mut sorted = pass.to_vec();
                sorted.sort_by(f32::total_cmp);
                sorted.dedup();
                assert_eq!(sorted.len(), events);
            }
        }
    }

    #[test]
    fn updates_draw_one_after_another_what_the_epoch_draws_at_once() {
        let regimes = [regime("a", 20..29)];
        let replay = Replay::new(&regimes, 0.4, 8, 5);
        assert_eq!(replay.new, 5);
        let whole = spacings(&replay.draw(1, 2, 0, 10));
        let parts = [spacings(&replay.draw(1, 2, 0, 5)), spacings(&replay.draw(1, 2, 3, 5))].concat();
        assert_eq!(parts, whole);
        assert_eq!([5, 10, 11, 14].map(|new| replay.of_epoch(new)), [3, 6, 7, 9]);
    }

    #[test]
    fn with_nothing_to_replay_an_update_is_all_new() {
        let short = ReplayedRegime { regime: "a".to_owned(), events: regime("a", 1..3).events };
        for regimes in [vec![], vec![short]] {
            let replay = Replay::new(&regimes, 0.5, 8, 9);
            assert_eq!((replay.new, replay.of_epoch(20), replay.draw(1, 1, 0, 8).len()), (8, 0, 0));
        }
    }
}
