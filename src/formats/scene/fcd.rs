//! SUMO's floating-car data: one vehicle a row, step by step, so that only what still goes on is held.
//!
//! `leaderGap` is measured from bumper to bumper; −1, or no `leaderID`, stands for nobody ahead. SUMO's clock counts
//! milliseconds, and so are times compared.

use std::collections::{BTreeMap, HashSet};
use std::hash::{DefaultHasher, Hash, Hasher};

use super::labels::{Label, Labels};
use super::room::Room;
use super::{Names, flaw, needed, number, put, ragged};
use crate::car_following::{Ahead, Extraction, ExtractionSettings, Extractor, Follower, Segment, Sighting};
use crate::formats::cell::{Cell, text_of};
use crate::formats::columns::{LEADERS, Role};
use crate::formats::excerpt::shortened;
use crate::formats::output::Output;
use crate::formats::table::Table;
use crate::formats::{FormatError, FormatLimits};

/// Rows that a vehicle on the road counts for beside its steps: its name, its leader's, and where they are kept.
const PRESENT_ROWS: u64 = 24;
/// Largest time, s: the millisecond is known of it.
const MAX_TIME_S: f64 = 1e12;

/// A vehicle at one time.
#[derive(Debug)]
pub(super) struct Vehicle<'a> {
    /// From 1.
    pub(super) row: u64,
    pub(super) id: &'a str,
    pub(super) speed_mps: f64,
    pub(super) leader_id: &'a str,
    pub(super) leader_speed_mps: Option<f64>,
    pub(super) gap_m: Option<f64>,
    pub(super) label: u32,
}

/// A vehicle that is on the road.
#[derive(Debug)]
struct Present {
    /// The time at which it was last seen, counted from 1.
    last: u64,
    label: u32,
    follower: Follower<String>,
}

/// The road at one time, and what goes on.
pub(in crate::formats) struct Fcd {
    /// Places of the columns, where there are any.
    columns: [usize; 6],
    labels: Labels,
    extractor: Extractor,
    room: Room,
    /// The time that is being read, ms, and which it is, from 1.
    time_ms: i64,
    times: u64,
    present: BTreeMap<String, Present>,
    /// Digests of the names of all vehicles and pairs so far, to count them.
    vehicles: HashSet<u64>,
    pairs: HashSet<u64>,
    max_text_bytes: u32,
    /// Whether any vehicle says who is ahead, if only that nobody is.
    pub(super) says_leaders: bool,
}

impl Fcd {
    /// Of an XML document.
    pub(super) fn of_document(limits: &FormatLimits, settings: &ExtractionSettings) -> Self {
        Self::new([0; 6], Labels::new(&[]), limits, settings)
    }

    /// Of a table.
    pub(in crate::formats) fn of_rows(roles: &[Role], limits: &FormatLimits, settings: &ExtractionSettings) -> Self {
        let roles_wanted = [Role::Time, Role::VehicleName, Role::Speed, Role::LeaderName, Role::LeaderSpeed, Role::Gap];
        let required = |role| roles.iter().position(|&known| known == role).expect("the preset requires it");
        let mut fcd = Self::new(roles_wanted.map(required), Labels::new(roles), limits, settings);
        fcd.says_leaders = true;
        fcd
    }

    fn new(columns: [usize; 6], labels: Labels, limits: &FormatLimits, settings: &ExtractionSettings) -> Self {
        Self {
            columns,
            labels,
            extractor: Extractor::new(settings, limits.max_steps as usize),
            room: Room::new(settings),
            time_ms: i64::MIN,
            times: 0,
            present: BTreeMap::new(),
            vehicles: HashSet::new(),
            pairs: HashSet::new(),
            max_text_bytes: limits.max_text_bytes,
            says_leaders: false,
        }
    }

    /// The next time begins: vehicles without a row at the one before are gone.
    pub(super) fn time(&mut self, time_s: f64, row: u64, output: &mut Output<'_, '_>) -> Result<(), FormatError> {
        if time_s.abs() > MAX_TIME_S {
            return Err(flaw(row, "wrong_type", format!("{time_s} s is no time of a simulation")));
        }
        let time_ms = (time_s * 1e3).round() as i64;
        if time_ms <= self.time_ms {
            let detail = format!("time {time_s} s comes after {} s; times must increase", self.time_ms as f64 / 1e3);
            return Err(flaw(row, "time_not_increasing", detail));
        }
        self.leave(|present, now| present.last != now, output)?;
        self.time_ms = time_ms;
        self.times += 1;
        Ok(())
    }

    /// A vehicle at this time.
    pub(super) fn vehicle(&mut self, vehicle: &Vehicle<'_>, output: &mut Output<'_, '_>) -> Result<(), FormatError> {
        let ahead = ahead(vehicle);
        self.note(vehicle, matches!(ahead, Ahead::Leader { .. }))?;
        let Self { extractor, room, labels, present, .. } = self;
        if !present.contains_key(vehicle.id) {
            room.take(PRESENT_ROWS)?;
            let new = Present { last: 0, label: vehicle.label, follower: Follower::default() };
            present.insert(vehicle.id.to_owned(), new);
        }
        let Present { last, label, follower } = present.get_mut(vehicle.id).expect("it was just put there");
        if *last == self.times {
            let (id, time_s) = (shortened(vehicle.id), self.time_ms as f64 / 1e3);
            let detail = format!("vehicle {id:?} is there twice at {time_s} s");
            return Err(flaw(vehicle.row, "contradicting_rows", detail));
        }
        let steps = follower.open_steps() as u64;
        let same_label = *label == vehicle.label;
        if !same_label {
            hand_over(extractor.end(follower), vehicle.id, labels.get(*label), output)?;
            *label = vehicle.label;
        }
        let sighting = Sighting {
            row: vehicle.row,
            time_ms: self.time_ms,
            follows: *last > 0 && same_label,
            speed_mps: vehicle.speed_mps,
            ahead,
        };
        *last = self.times;
        let ended = extractor.see(follower, sighting);
        room.give(steps);
        room.take(follower.open_steps() as u64)?;
        hand_over(ended, vehicle.id, labels.get(*label), output)
    }

    /// Counts the vehicle, and the pair where it follows somebody.
    fn note(&mut self, vehicle: &Vehicle<'_>, follows: bool) -> Result<(), FormatError> {
        for id in [vehicle.id, vehicle.leader_id] {
            if id.len() > self.max_text_bytes as usize {
                let detail = format!("a vehicle's id has {} bytes, at most {} are kept", id.len(), self.max_text_bytes);
                return Err(flaw(vehicle.row, "text_too_long", detail));
            }
        }
        if self.vehicles.insert(digest(vehicle.id)) {
            self.room.take(1)?;
        }
        if follows && self.pairs.insert(digest((vehicle.id, vehicle.leader_id))) {
            self.room.take(1)?;
        }
        Ok(())
    }

    /// Vehicles of which `gone` is true have left the road.
    fn leave(&mut self, gone: impl Fn(&Present, u64) -> bool, output: &mut Output<'_, '_>) -> Result<(), FormatError> {
        let Self { extractor, room, labels, present, times, .. } = self;
        let mut left = Ok(());
        present.retain(|id, vehicle| {
            if left.is_err() || !gone(vehicle, *times) {
                return true;
            }
            room.give(PRESENT_ROWS + vehicle.follower.open_steps() as u64);
            left = hand_over(extractor.end(&mut vehicle.follower), id, labels.get(vehicle.label), output);
            false
        });
        left
    }

    /// The recording has ended.
    pub(super) fn close(mut self, output: &mut Output<'_, '_>) -> Result<Extraction, FormatError> {
        if self.extractor.counts.rows > 0 && !self.says_leaders {
            let detail = format!("no vehicle says who is ahead of it; {LEADERS}");
            return Err(FormatError::invalid(None, "no_leaders", detail));
        }
        self.leave(|_, _| true, output)?;
        let mut counts = self.extractor.counts;
        counts.vehicles = self.vehicles.len() as u64;
        counts.pairs = self.pairs.len() as u64;
        Ok(counts)
    }
}

impl Table for Fcd {
    fn row(&mut self, row: u64, cells: &[Cell<'_>], output: &mut Output<'_, '_>) -> Result<(), FormatError> {
        let [time, id, speed, leader, leader_speed, gap] = self.columns.map(|column| cells[column]);
        let time_s = needed(time, Role::Time, row)?;
        if (time_s * 1e3).round() as i64 != self.time_ms {
            self.time(time_s, row, output)?;
        }
        let (id, leader_id) = (text_of(id), text_of(leader));
        // A time at which nobody drives, or somebody who walks.
        if id.is_empty() {
            return Ok(());
        }
        let label = self.labels.of(cells, row, self.max_text_bytes, &mut self.room)?;
        let vehicle = Vehicle {
            row,
            id: &id,
            speed_mps: needed(speed, Role::Speed, row)?,
            leader_id: &leader_id,
            leader_speed_mps: number(leader_speed, Role::LeaderSpeed, row)?,
            gap_m: number(gap, Role::Gap, row)?,
            label,
        };
        self.vehicle(&vehicle, output)
    }

    fn ragged(&mut self, row: u64, found: usize, wanted: usize) -> Result<(), FormatError> {
        Err(ragged(row, found, wanted))
    }

    fn end(self: Box<Self>, output: &mut Output<'_, '_>) -> Result<Option<Extraction>, FormatError> {
        self.close(output).map(Some)
    }
}

fn hand_over(
    ended: Option<Segment<String>>,
    follower: &str,
    label: &Label,
    output: &mut Output<'_, '_>,
) -> Result<(), FormatError> {
    let Some(mut segment) = ended else { return Ok(()) };
    let leader = std::mem::take(&mut segment.leader);
    let at = (segment.first_ms as f64 / 1e3).to_string();
    put(segment, &Names { follower, leader: &leader, at: &at, label }, output)
}

fn ahead(vehicle: &Vehicle<'_>) -> Ahead<String> {
    match (vehicle.leader_id, vehicle.gap_m, vehicle.leader_speed_mps) {
        ("", ..) | (_, None | Some(-1.0), _) => Ahead::Nobody,
        (_, _, None) => Ahead::Unknown,
        (leader, Some(spacing_m), Some(speed_mps)) => Ahead::Leader { leader: leader.to_owned(), spacing_m, speed_mps },
    }
}

fn digest(names: impl Hash) -> u64 {
    let mut hasher = DefaultHasher::new();
    names.hash(&mut hasher);
    hasher.finish()
}
