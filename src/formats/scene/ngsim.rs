//! NGSIM: one vehicle a row, vehicle by vehicle, so that a row's leader may be anywhere in the body and all of it is held.
//!
//! Ten frames a second, lengths in feet and speeds in feet per second. `Space_Headway` is measured from the front of the
//! vehicle to the front of the one that `Preceding` names (0 for none), so that
//!
//! spacing = 0.3048 (`Space_Headway` − the leader's `v_Length`),
//!
//! with length and speed of the leader from its own row at the same time. The published files number vehicles and frames anew
//! for each period and place: `Location` tells places apart, and `Global_Time` (ms) periods.

use std::collections::BTreeSet;

use super::labels::Labels;
use super::room::Room;
use super::{Names, flaw, needed, number, put, ragged};
use crate::car_following::{Ahead, Extraction, ExtractionSettings, Extractor, Follower, Segment, Sighting};
use crate::formats::cell::Cell;
use crate::formats::columns::Role;
use crate::formats::output::Output;
use crate::formats::table::Table;
use crate::formats::{FormatError, FormatLimits};

/// m.
const FOOT_M: f64 = 0.3048;
/// Between two frames, ms.
const FRAME_MS: i64 = 100;
/// Largest time that a double holds to the millisecond.
const MAX_MS: f64 = 9_007_199_254_740_992.0;

/// One vehicle in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Row {
    time_ms: i64,
    speed_mps: f64,
    length_m: f64,
    /// Not a number where there is none.
    headway_m: f64,
    road: u32,
    vehicle: u32,
    /// 0 for none.
    leader: u32,
    frame: u32,
    label: u32,
    number: u32,
}

impl Row {
    fn key(&self) -> (u32, u32, i64) {
        (self.road, self.vehicle, self.time_ms)
    }

    /// Whether both say the same of the same vehicle and time.
    fn repeats(&self, other: &Self) -> bool {
        let numbers = |row: &Self| [row.speed_mps, row.length_m, row.headway_m].map(f64::to_bits);
        let whole = |row: &Self| (row.key(), row.leader, row.frame, row.label);
        numbers(self) == numbers(other) && whole(self) == whole(other)
    }
}

/// Columns by their places.
#[derive(Debug)]
struct Columns {
    vehicle: usize,
    frame: usize,
    clock: Option<usize>,
    length: usize,
    speed: usize,
    leader: usize,
    headway: usize,
}

/// All rows of a body.
pub(in crate::formats) struct Ngsim {
    columns: Columns,
    labels: Labels,
    rows: Vec<Row>,
    room: Room,
    extractor: Extractor,
    max_text_bytes: u32,
}

impl Ngsim {
    pub(in crate::formats) fn new(roles: &[Role], limits: &FormatLimits, settings: &ExtractionSettings) -> Self {
        let place = |role| roles.iter().position(|&known| known == role);
        let required = |role| place(role).expect("the preset requires it");
        let columns = Columns {
            vehicle: required(Role::Vehicle),
            frame: required(Role::Frame),
            clock: place(Role::Clock),
            length: required(Role::Length),
            speed: required(Role::Speed),
            leader: required(Role::Leader),
            headway: required(Role::Headway),
        };
        Self {
            columns,
            labels: Labels::new(roles),
            rows: Vec::new(),
            room: Room::new(settings),
            extractor: Extractor::new(settings, limits.max_steps as usize),
            max_text_bytes: limits.max_text_bytes,
        }
    }

    /// Sorts by vehicle and time, and leaves out what the body says twice.
    fn sort(&mut self) -> Result<(), FormatError> {
        self.rows.sort_unstable_by_key(|row| (row.key(), row.number));
        let contradicts = |rows: &&[Row]| rows[0].key() == rows[1].key() && !rows[0].repeats(&rows[1]);
        if let Some([first, second]) = self.rows.windows(2).find(contradicts).map(|rows| [rows[0], rows[1]]) {
            let detail = format!(
                "rows {} and {} say different things of vehicle {} in frame {}; recordings put together need Location or \
                 Global_Time to be told apart",
                first.number, second.number, first.vehicle, first.frame
            );
            return Err(flaw(second.number.into(), "contradicting_rows", detail));
        }
        let all = self.rows.len();
        self.rows.dedup_by_key(|row| row.key());
        self.extractor.counts.repeated((all - self.rows.len()) as u64);
        Ok(())
    }

    /// Extracts what one vehicle does; `rows` are its own.
    fn vehicle(&mut self, rows: &[Row], all: &[Row], output: &mut Output<'_, '_>) -> Result<(), FormatError> {
        let mut follower = Follower::default();
        let (mut before, mut near): (Option<&Row>, usize) = (None, 0);
        for row in rows {
            let same_label = before.is_none_or(|before| before.label == row.label);
            if let (false, Some(before)) = (same_label, before) {
                let ended = self.extractor.end(&mut follower);
                self.hand_over(ended, before, output)?;
            }
            let next = |before: &Row| row.frame == before.frame + 1 && row.time_ms == before.time_ms + FRAME_MS;
            let sighting = Sighting {
                row: row.number.into(),
                time_ms: row.time_ms,
                follows: same_label && before.is_some_and(next),
                speed_mps: row.speed_mps,
                ahead: ahead(row, all, &mut near),
            };
            let ended = self.extractor.see(&mut follower, sighting);
            self.hand_over(ended, before.unwrap_or(row), output)?;
            before = Some(row);
        }
        let ended = self.extractor.end(&mut follower);
        self.hand_over(ended, before.expect("a vehicle has rows"), output)
    }

    fn hand_over(
        &self,
        ended: Option<Segment<u32>>,
        follower: &Row,
        output: &mut Output<'_, '_>,
    ) -> Result<(), FormatError> {
        let Some(segment) = ended else { return Ok(()) };
        let at = if self.columns.clock.is_some() { segment.first_ms } else { segment.first_ms / FRAME_MS };
        let (vehicle, leader, at) = (follower.vehicle.to_string(), segment.leader.to_string(), at.to_string());
        let label = self.labels.get(follower.label);
        put(segment, &Names { follower: &vehicle, leader: &leader, at: &at, label }, output)
    }
}

impl Table for Ngsim {
    fn row(&mut self, at: u64, cells: &[Cell<'_>], _: &mut Output<'_, '_>) -> Result<(), FormatError> {
        self.room.take(1)?;
        let Columns { vehicle, frame, clock, length, speed, leader, headway } = self.columns;
        let frame = whole(cells[frame], Role::Frame, at)?;
        let time_ms = match clock {
            None => i64::from(frame) * FRAME_MS,
            Some(clock) => match needed(cells[clock], Role::Clock, at)? {
                time if time.fract() == 0.0 && time.abs() < MAX_MS => time as i64,
                time => return Err(flaw(at, "wrong_type", format!("Global_Time in row {at} is {time}"))),
            },
        };
        let label = self.labels.of(cells, at, self.max_text_bytes, &mut self.room)?;
        let leader = match cells[leader] {
            Cell::Missing => 0,
            cell => whole(cell, Role::Leader, at)?,
        };
        self.rows.push(Row {
            time_ms,
            speed_mps: needed(cells[speed], Role::Speed, at)? * FOOT_M,
            length_m: needed(cells[length], Role::Length, at)? * FOOT_M,
            headway_m: number(cells[headway], Role::Headway, at)?.map_or(f64::NAN, |feet| feet * FOOT_M),
            road: self.labels.road(label),
            vehicle: whole(cells[vehicle], Role::Vehicle, at)?,
            leader,
            frame,
            label,
            number: u32::try_from(at).expect("rows are counted in 32 bits"),
        });
        Ok(())
    }

    fn ragged(&mut self, number: u64, found: usize, wanted: usize) -> Result<(), FormatError> {
        Err(ragged(number, found, wanted))
    }

    fn end(mut self: Box<Self>, output: &mut Output<'_, '_>) -> Result<Option<Extraction>, FormatError> {
        self.sort()?;
        let rows = std::mem::take(&mut self.rows);
        for of_one in rows.chunk_by(|a, b| (a.road, a.vehicle) == (b.road, b.vehicle)) {
            self.extractor.counts.vehicles += 1;
            let leaders: BTreeSet<u32> = of_one.iter().map(|row| row.leader).filter(|&leader| leader != 0).collect();
            self.extractor.counts.pairs += leaders.len() as u64;
            self.vehicle(of_one, &rows, output)?;
        }
        Ok(Some(self.extractor.counts))
    }
}

/// Who is ahead of a vehicle in one frame. `near` is where its leader was found the last time.
fn ahead(row: &Row, all: &[Row], near: &mut usize) -> Ahead<u32> {
    if row.leader == 0 {
        return Ahead::Nobody;
    }
    let wanted = (row.road, row.leader, row.time_ms);
    // Mostly the next row of the same leader.
    if all.get(*near + 1).is_some_and(|next| next.key() == wanted) {
        *near += 1;
    } else {
        match all.binary_search_by_key(&wanted, Row::key) {
            Ok(found) => *near = found,
            Err(_) => return Ahead::Unknown,
        }
    }
    let leader = &all[*near];
    if row.headway_m.is_nan() || row.leader == row.vehicle {
        return Ahead::Unknown;
    }
    Ahead::Leader { leader: row.leader, spacing_m: row.headway_m - leader.length_m, speed_mps: leader.speed_mps }
}

/// A cell's whole number.
fn whole(cell: Cell<'_>, role: Role, row: u64) -> Result<u32, FormatError> {
    let number = needed(cell, role, row)?;
    if number.fract() == 0.0 && (0.0..f64::from(u32::MAX)).contains(&number) {
        return Ok(number as u32);
    }
    Err(flaw(row, "wrong_type", format!("{} in row {row} is {number}, not a whole number from 0", role.field())))
}
