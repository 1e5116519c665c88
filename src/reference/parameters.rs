//! Which parameters a reference driver has, and within what bounds they are plausible.

/// A parameter and the closed range that calibration looks in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    /// Its name on the wire, the unit last.
    pub name: &'static str,
    /// Least plausible value.
    pub low: f64,
    /// Greatest plausible value.
    pub high: f64,
}

const fn within(name: &'static str, low: f64, high: f64) -> Parameter {
    Parameter { name, low, high }
}

/// Those of the IDM, in the order of its fields, within the bounds of Kesting and Treiber (Calibrating car-following models
/// by using trajectory data, Transportation Research Record 2088, 148, 2008).
pub(super) const IDM: [Parameter; 5] = [
    within("desired_speed_mps", 1.0, 70.0),
    within("time_headway_s", 0.1, 5.0),
    within("jam_spacing_m", 0.1, 8.0),
    within("max_accel_mps2", 0.1, 6.0),
    within("comfortable_braking_mps2", 0.1, 6.0),
];

/// Those of Gipps, in the order of its fields: what it shares with the IDM within the same bounds, reaction times as
/// measured on drivers, and braking within what tyres allow.
pub(super) const GIPPS: [Parameter; 6] = [
    within("desired_speed_mps", 1.0, 70.0),
    within("reaction_s", 0.1, 2.0),
    within("jam_spacing_m", 0.1, 8.0),
    within("max_accel_mps2", 0.1, 6.0),
    within("hardest_braking_mps2", 0.1, 8.0),
    within("leader_braking_mps2", 0.1, 8.0),
];
