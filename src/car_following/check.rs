//! From a recording to an event: units, spacing, step, and whether a vehicle can have moved like that.

use super::check_settings::CheckSettings;
use super::resample::resampled_steps;
use super::{Conversion, Defect, Event, Recording, Target};

/// Most defects named of one recording.
const MAX_DEFECTS: usize = 4;

const SPACING: &str = "spacing_m";
const FOLLOWER: &str = "follower_speed_mps";
const LEADER: &str = "leader_speed_mps";
const REL: &str = "rel_speed_mps";

impl CheckSettings {
    /// The event a recording is, at its own step: net spacing, speeds ≥ 0, values rounded to f32.
    ///
    /// # Errors
    /// What is wrong with it: at most four defects, one per array and kind, each naming its first step.
    pub fn check(&self, recording: &Recording, conversion: &Conversion, target: &Target) -> Result<Event, Vec<Defect>> {
        let mut defects = Vec::new();
        lengths(recording, &mut defects);
        let dt_s = match self.step(recording, conversion) {
            Ok(dt_s) => Some(dt_s),
            Err(defect) => {
                defects.push(defect);
                None
            }
        };
        self.values(recording, conversion, &mut defects);
        let (Some(dt_s), true) = (dt_s, defects.is_empty()) else {
            defects.truncate(MAX_DEFECTS);
            return Err(defects);
        };
        let excess_m = conversion.spacing.excess_m();
        let spacing: Vec<f64> = recording.spacing_m.iter().map(|s| s - excess_m).collect();
        let follower: Vec<f64> = recording.follower_speed_mps.iter().copied().map(forward).collect();
        let leader: Vec<f64> = recording.leader_speed_mps.iter().copied().map(forward).collect();
        fitting_steps(spacing.len(), dt_s, target, &mut defects);
        self.accelerations(FOLLOWER, &follower, dt_s, &mut defects);
        self.accelerations(LEADER, &leader, dt_s, &mut defects);
        self.spacing_changes(&spacing, &follower, &leader, dt_s, &mut defects);
        defects.truncate(MAX_DEFECTS);
        if defects.is_empty() {
            Ok(Event::new(dt_s, single(&spacing), single(&follower), single(&leader)))
        } else {
            Err(defects)
        }
    }

    /// The recording's step: declared, else the upload's, else from its times; whole microseconds, so that 0.1 s is
    /// the same step however it was said.
    fn step(&self, recording: &Recording, conversion: &Conversion) -> Result<f64, Defect> {
        let from_times = match &recording.t_s {
            Some(times) => self.mean_step(times)?,
            None => None,
        };
        let (field, dt_s) = match (recording.dt_s.or(conversion.dt_s), from_times) {
            (Some(dt_s), _) => ("dt_s", dt_s),
            (None, Some(dt_s)) => ("t", dt_s),
            (None, None) => {
                let detail = "no dt_s, no dt_s of the upload and no times to take it from".to_owned();
                return Err(Defect::new(None, None, "missing_dt", detail));
            }
        };
        let rounded = (dt_s * 1e6).round() / 1e6;
        if (self.min_dt_s..=self.max_dt_s).contains(&rounded) {
            return Ok(rounded);
        }
        let detail = format!("a step of {dt_s} s is not within {} to {} s", self.min_dt_s, self.max_dt_s);
        Err(Defect::new(field, None, "dt_out_of_range", detail))
    }

    /// Mean step of evenly spaced times; none for fewer than two.
    fn mean_step(&self, times: &[f64]) -> Result<Option<f64>, Defect> {
        if let Some(step) = times.iter().position(|t| !t.is_finite()) {
            return Err(Defect::new("t", step, "not_finite", format!("t at step {step} is {}", times[step])));
        }
        let [first, .., last] = times else { return Ok(None) };
        let mean = (last - first) / (times.len() - 1) as f64;
        let even = |t: &[f64]| (t[1] - t[0] - mean).abs() <= self.max_time_jitter * mean.abs();
        let uneven = times.windows(2).position(|t| !even(t));
        match uneven {
            None if mean > 0.0 => Ok(Some(mean)),
            None => Err(Defect::new("t", 0, "uneven_t", "t does not increase".to_owned())),
            Some(before) => {
                let detail = format!(
                    "t goes from {} to {} at step {}, by {:.4} s, while the mean step is {mean:.4} s",
                    times[before],
                    times[before + 1],
                    before + 1,
                    times[before + 1] - times[before],
                );
                Err(Defect::new("t", before + 1, "uneven_t", detail))
            }
        }
    }

    /// Each value by itself.
    fn values(&self, recording: &Recording, conversion: &Conversion, defects: &mut Vec<Defect>) {
        let excess_m = conversion.spacing.excess_m();
        let spacing = Array { name: SPACING, unit: "m", values: &recording.spacing_m };
        spacing.finite(defects);
        let net = if excess_m == 0.0 { String::new() } else { format!(" net of {excess_m} m") };
        // As f32, because that is what is kept: a spacing that rounds to 0 is none.
        let touches = |s: f64| s.is_finite() && (s - excess_m) as f32 <= 0.0;
        spacing.bad("spacing_not_positive", &format!("not above 0{net}"), touches, defects);
        let (max_m, max_mps) = (self.max_spacing_m, self.max_speed_mps);
        let far = |s: f64| s.is_finite() && s - excess_m > max_m;
        spacing.bad("spacing_too_large", &format!("above {max_m} m{net}"), far, defects);
        for (name, values) in [(FOLLOWER, &recording.follower_speed_mps), (LEADER, &recording.leader_speed_mps)] {
            let speed = Array { name, unit: "m/s", values };
            speed.finite(defects);
            let backward = |v: f64| v.is_finite() && v < -self.speed_noise_mps;
            speed.bad("speed_negative", &format!("below −{} m/s", self.speed_noise_mps), backward, defects);
            speed.bad("speed_too_high", &format!("above {max_mps} m/s"), |v| v.is_finite() && v > max_mps, defects);
        }
        if let Some(rel) = &recording.rel_speed_mps {
            Array { name: REL, unit: "m/s", values: rel }.finite(defects);
            self.relative_speed(rel, &recording.follower_speed_mps, &recording.leader_speed_mps, defects);
        }
    }

    fn relative_speed(&self, rel: &[f64], follower: &[f64], leader: &[f64], defects: &mut Vec<Defect>) {
        let expected: Vec<f64> = leader.iter().zip(follower).map(|(l, f)| l - f).collect();
        let bad = |k: usize| (rel[k] - expected[k]).abs() > self.max_rel_speed_error_mps;
        let Some((step, count)) = offence(rel.len().min(expected.len()), bad) else { return };
        let detail = format!(
            "rel_speed_mps at step {step} is {} m/s, but leader − follower is {:.4} m/s{}",
            rel[step],
            expected[step],
            more(count)
        );
        defects.push(Defect::new(REL, step, "rel_speed_mismatch", detail));
    }

    fn accelerations(&self, name: &'static str, speed: &[f64], dt_s: f64, defects: &mut Vec<Defect>) {
        let accel = |k: usize| (speed[k + 1] - speed[k]) / dt_s;
        let possible = -self.max_braking_mps2..=self.max_accel_mps2;
        let Some((before, count)) = offence(speed.len() - 1, |k| !possible.contains(&accel(k))) else { return };
        let detail = format!(
            "{name} changes by {:.2} m/s² at step {}, outside −{} to {} m/s²{}",
            accel(before),
            before + 1,
            self.max_braking_mps2,
            self.max_accel_mps2,
            more(count)
        );
        defects.push(Defect::new(name, before + 1, "acceleration_out_of_range", detail));
    }

    /// Spacing must change as the integrated relative speed does, step by step and over the whole event.
    fn spacing_changes(&self, spacing: &[f64], follower: &[f64], leader: &[f64], dt_s: f64, defects: &mut Vec<Defect>) {
        let rel = |k: usize| leader[k] - follower[k];
        let integrated = |k: usize| dt_s * f64::midpoint(rel(k), rel(k + 1));
        let residual = |k: usize| spacing[k + 1] - spacing[k] - integrated(k);
        let steps = spacing.len() - 1;
        if let Some((before, count)) = offence(steps, |k| residual(k).abs() > self.max_spacing_jump_m) {
            let detail = format!(
                "spacing_m changes by {:.3} m at step {}, relative speed by {:.3} m: more than {} m apart{}",
                spacing[before + 1] - spacing[before],
                before + 1,
                integrated(before),
                self.max_spacing_jump_m,
                more(count)
            );
            defects.push(Defect::new(SPACING, before + 1, "spacing_inconsistent", detail));
            return;
        }
        let drift_m: f64 = (0..steps).map(residual).sum();
        let allowed_m = self.max_spacing_drift_m + self.max_spacing_drift_mps * steps as f64 * dt_s;
        if drift_m.abs() > allowed_m {
            let detail = format!(
                "spacing_m changes by {:.2} m over the event, relative speed by {:.2} m: more than {allowed_m:.2} m apart",
                spacing[steps] - spacing[0],
                spacing[steps] - spacing[0] - drift_m,
            );
            defects.push(Defect::new(SPACING, steps, "spacing_drifts", detail));
        }
    }
}

/// One array of a recording.
struct Array<'a> {
    name: &'static str,
    unit: &'static str,
    values: &'a [f64],
}

impl Array<'_> {
    fn finite(&self, defects: &mut Vec<Defect>) {
        self.bad("not_finite", "not a finite number", |x| !x.is_finite(), defects);
    }

    fn bad(&self, code: &'static str, why: &str, bad: impl Fn(f64) -> bool, defects: &mut Vec<Defect>) {
        if let Some((step, count)) = offence(self.values.len(), |k| bad(self.values[k])) {
            let Self { name, unit, values } = self;
            let detail = format!("{name} at step {step} is {} {unit}, {why}{}", values[step], more(count));
            defects.push(Defect::new(*name, step, code, detail));
        }
    }
}

/// The first of `steps` that is bad, and how many are.
fn offence(steps: usize, bad: impl Fn(usize) -> bool) -> Option<(usize, usize)> {
    let first = (0..steps).find(|&k| bad(k))?;
    Some((first, (first..steps).filter(|&k| bad(k)).count()))
}

fn more(count: usize) -> String {
    if count > 1 { format!("; so at {count} steps") } else { String::new() }
}

/// Noise around standstill is standstill; −0 is 0, so that copies have equal bytes.
fn forward(speed: f64) -> f64 {
    if speed > 0.0 { speed } else { 0.0 }
}

/// Every value is within the settings' bounds, which f32 holds.
fn single(values: &[f64]) -> Vec<f32> {
    values.iter().map(|&x| x as f32).collect()
}

fn lengths(recording: &Recording, defects: &mut Vec<Defect>) {
    let steps = recording.spacing_m.len();
    if steps == 0 {
        defects.push(Defect::new(SPACING, None, "no_steps", "spacing_m is empty".to_owned()));
    }
    let others = [
        (FOLLOWER, Some(recording.follower_speed_mps.len())),
        (LEADER, Some(recording.leader_speed_mps.len())),
        (REL, recording.rel_speed_mps.as_ref().map(Vec::len)),
        ("t", recording.t_s.as_ref().map(Vec::len)),
    ];
    for (name, length) in others {
        if let Some(length) = length.filter(|&length| length != steps) {
            let detail = format!("{name} has {length} steps, spacing_m {steps}");
            defects.push(Defect::new(name, None, "length_mismatch", detail));
        }
    }
}

fn fitting_steps(steps: usize, dt_s: f64, target: &Target, defects: &mut Vec<Defect>) {
    let at_target = resampled_steps(steps, dt_s, target.dt_s);
    let (code, wanted) = match at_target {
        few if few < target.min_steps => ("too_short", format!("it needs {}", target.min_steps)),
        many if many > target.max_steps => ("too_many_steps", format!("at most {} are taken", target.max_steps)),
        _ => return,
    };
    let detail = format!("{steps} steps of {dt_s} s are {at_target} of the model's {} s; {wanted}", target.dt_s);
    defects.push(Defect::new(None, None, code, detail));
}

#[cfg(test)]
#[path = "check_tests.rs"]
mod tests;
