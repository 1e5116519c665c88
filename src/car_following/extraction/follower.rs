//! One vehicle's rows into segments in which it follows the same leader.

use super::counts::{Extraction, Why};
use super::settings::ExtractionSettings;
use crate::car_following::Recording;

/// Who drives ahead of a vehicle at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Ahead<L> {
    /// Nobody.
    Nobody,
    /// Somebody of whom nothing is known at this time.
    Unknown,
    /// A leader.
    Leader {
        /// Which vehicle.
        leader: L,
        /// Net spacing to it, m.
        spacing_m: f64,
        /// Its speed, m/s.
        speed_mps: f64,
    },
}

/// A vehicle at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting<L> {
    /// Its row in the body, from 1.
    pub row: u64,
    /// When, ms.
    pub time_ms: i64,
    /// Whether it comes right after the sighting before: no step of the recording lies between them.
    pub follows: bool,
    /// Its speed, m/s.
    pub speed_mps: f64,
    /// Who is ahead.
    pub ahead: Ahead<L>,
}

/// Consecutive steps with one leader.
#[derive(Debug, Clone, PartialEq)]
pub struct Segment<L> {
    /// The leader.
    pub leader: L,
    /// Row of its first step.
    pub first_row: u64,
    /// When its first step is, ms.
    pub first_ms: i64,
    last_ms: i64,
    /// Unknown before its second step.
    dt_ms: Option<i64>,
    spacing_m: Vec<f64>,
    follower_speed_mps: Vec<f64>,
    leader_speed_mps: Vec<f64>,
}

/// A vehicle on its way through a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Follower<L> {
    open: Option<Segment<L>>,
    /// Why the row before was in no segment.
    outside: Option<Why>,
}

impl<L> Default for Follower<L> {
    fn default() -> Self {
        Self { open: None, outside: None }
    }
}

impl<L> Follower<L> {
    /// Steps of the segment that is not over yet.
    #[must_use]
    pub fn open_steps(&self) -> usize {
        self.open.as_ref().map_or(0, Segment::steps)
    }
}

impl<L> Segment<L> {
    fn begin(leader: L, sighting: (u64, i64)) -> Self {
        let (first_row, first_ms) = sighting;
        let none = Vec::new;
        Self {
            leader,
            first_row,
            first_ms,
            last_ms: first_ms,
            dt_ms: None,
            spacing_m: none(),
            follower_speed_mps: none(),
            leader_speed_mps: none(),
        }
    }

    fn steps(&self) -> usize {
        self.spacing_m.len()
    }

    /// Whether a step at this time is the next one.
    fn continues(&self, time_ms: i64) -> bool {
        self.dt_ms.is_none_or(|dt_ms| time_ms - self.last_ms == dt_ms)
    }

    fn push(&mut self, time_ms: i64, spacing_m: f64, follower_speed_mps: f64, leader_speed_mps: f64) {
        if self.steps() > 0 {
            self.dt_ms = Some(time_ms - self.last_ms);
        }
        self.last_ms = time_ms;
        self.spacing_m.push(spacing_m);
        self.follower_speed_mps.push(follower_speed_mps);
        self.leader_speed_mps.push(leader_speed_mps);
    }

    /// Its leader, and its numbers as a recording.
    #[must_use]
    pub fn into_recording(self) -> Recording {
        Recording {
            dt_s: self.dt_ms.map(|dt_ms| dt_ms as f64 / 1e3),
            spacing_m: self.spacing_m,
            follower_speed_mps: self.follower_speed_mps,
            leader_speed_mps: self.leader_speed_mps,
            ..Recording::default()
        }
    }
}

/// Applies the criteria, and counts.
#[derive(Debug)]
pub struct Extractor {
    min_ms: i64,
    max_ms: i64,
    max_steps: usize,
    min_spacing_m: f64,
    max_spacing_m: f64,
    /// What became of the rows so far; vehicles and pairs are counted by who knows them.
    pub counts: Extraction,
}

impl Extractor {
    /// Nothing extracted yet; an event has at most `max_steps` steps.
    #[must_use]
    pub fn new(settings: &ExtractionSettings, max_steps: usize) -> Self {
        let ms = |s: f64| (s * 1e3).round() as i64;
        Self {
            min_ms: ms(settings.min_duration_s),
            max_ms: ms(settings.max_duration_s),
            max_steps: max_steps.max(2),
            min_spacing_m: settings.min_spacing_m,
            max_spacing_m: settings.max_spacing_m,
            counts: Extraction::default(),
        }
    }

    /// Takes the next sighting of a vehicle; gives the segment that it ends, if that is an event.
    pub fn see<L: PartialEq>(&mut self, follower: &mut Follower<L>, sighting: Sighting<L>) -> Option<Segment<L>> {
        let Sighting { row, time_ms, follows, speed_mps, ahead } = sighting;
        self.counts.rows += 1;
        let (leader, spacing_m, leader_speed_mps) = match self.within(ahead) {
            Ok(leader) => leader,
            Err(why) => {
                let begins = !follows || follower.outside != Some(why);
                self.counts.drop(why.as_str(), begins.into(), 1);
                follower.outside = Some(why);
                return self.close(follower, if follows { why } else { Why::RowMissing });
            }
        };
        follower.outside = None;
        let cut = follower.open.as_ref().and_then(|open| {
            if !follows || !open.continues(time_ms) {
                Some(Why::RowMissing)
            } else if open.leader != leader {
                Some(Why::LeaderChanged)
            } else {
                self.is_full(open, time_ms).then_some(Why::TooLong)
            }
        });
        let ended = cut.and_then(|why| self.close(follower, why));
        follower.open.get_or_insert_with(|| Segment::begin(leader, (row, time_ms))).push(
            time_ms,
            spacing_m,
            speed_mps,
            leader_speed_mps,
        );
        ended
    }

    /// The vehicle is not seen any more.
    pub fn end<L>(&mut self, follower: &mut Follower<L>) -> Option<Segment<L>> {
        follower.outside = None;
        self.close(follower, Why::RowMissing)
    }

    /// The leader, the spacing and the leader's speed, where they can be a step of an event.
    fn within<L>(&self, ahead: Ahead<L>) -> Result<(L, f64, f64), Why> {
        match ahead {
            Ahead::Nobody => Err(Why::NoLeader),
            Ahead::Unknown => Err(Why::LeaderMissing),
            Ahead::Leader { spacing_m, .. } if spacing_m < self.min_spacing_m => Err(Why::TooClose),
            Ahead::Leader { spacing_m, .. } if spacing_m > self.max_spacing_m => Err(Why::TooFar),
            Ahead::Leader { leader, spacing_m, speed_mps } => Ok((leader, spacing_m, speed_mps)),
        }
    }

    /// Whether one step more, at this time, would be too many.
    fn is_full<L>(&self, open: &Segment<L>, time_ms: i64) -> bool {
        let steps = open.steps();
        steps >= self.max_steps || lasts_ms(steps + 1, time_ms - open.last_ms) > self.max_ms
    }

    fn close<L>(&mut self, follower: &mut Follower<L>, why: Why) -> Option<Segment<L>> {
        let segment = follower.open.take()?;
        self.counts.segments += 1;
        self.counts.cut(why);
        let steps = segment.steps();
        match segment.dt_ms {
            Some(dt_ms) if lasts_ms(steps, dt_ms) >= self.min_ms => {
                self.counts.events += 1;
                Some(segment)
            }
            _ => {
                self.counts.drop("too_short", 1, steps as u64);
                None
            }
        }
    }
}

/// How long so many steps last, ms.
fn lasts_ms(steps: usize, dt_ms: i64) -> i64 {
    i64::try_from(steps).unwrap_or(i64::MAX).saturating_mul(dt_ms)
}
