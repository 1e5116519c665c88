//! The greatest acceleration from which full braking still avoids a collision, whatever the leader does.

/// Both cars can brake this hard, m/s²: what the physics checks accept, and the envelope's own limit whatever the network's.
pub const HARDEST_BRAKING_MPS2: f64 = 8.0;

/// Spacing that the envelope keeps in the worst case, m. Rounding to f32 costs less than a millimetre of it.
pub const MARGIN_M: f64 = 0.2;

/// What is served, and why where it is not what the network asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounded {
    /// m/s².
    pub accel_mps2: f32,
    /// Nothing where the network's is served.
    pub cause: Option<Cause>,
}

/// Why the network's acceleration is not served.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cause {
    /// Its leader could brake so that the follower could not avoid it any more.
    Leader,
    /// It would drive backwards: a car that stops or stands is braked no further.
    Standstill,
}

/// A bound on the follower's acceleration that no braking of its leader can turn into a collision.
///
/// A state (spacing s, follower speed v, leader speed l) is *safe* when both cars, braking at B = 8 m/s² from now to
/// standstill, stay `MARGIN_M` apart. With D(v) the distance in which a car stops, the spacing is least either now (the
/// leader is faster) or when both stand (it is not), so safe means
///
/// `s − m ≥ max(0, D(v) − D(l))`.
///
/// An acceleration is admissible when the state after it is safe though the leader brakes at B meanwhile, that is when the
/// follower may begin to brake one step after its leader. This is the safe speed of Gipps (Transportation Research B 15,
/// 105, 1981) and the longitudinal distance of Responsibility-Sensitive Safety (Shalev-Shwartz, Shammah and Shashua, 2017)
/// with equal braking of both cars and a response time of one step, during which the follower does what is asked of it.
///
/// D is exact for the project's integrator (`v' = v + dt·a`, distances by the trapezoid rule, no car reverses): with
/// q = B·dt and v = k·q + r, `D(v) = dt·(k·v − q·k²/2 + r/2)`, which is v²/(2B) at whole k and its chords between.
/// So from a safe state full braking leads to a safe state, every admissible acceleration leads to a safe state, and a
/// leader that brakes less only adds room. From a state that is not safe the envelope brakes fully until it is.
///
/// The car it bounds reacts at once: delays and lags of a real actuator are not in it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Envelope {
    dt_s: f64,
}

impl Envelope {
    /// The envelope of a driver that decides every `dt_s` > 0 seconds.
    #[must_use]
    pub fn new(dt_s: f32) -> Self {
        Self { dt_s: f64::from(dt_s) }
    }

    /// What to serve where the network asks for `raw_mps2`, m/s²: exactly that where it is admissible, else the greatest
    /// acceleration that is, else full braking. Never one that makes a speed negative; a car found rolling backwards is not
    /// driven further back. Grows with `raw_mps2`, spacing and leader speed.
    #[must_use]
    pub fn bounded(self, raw_mps2: f32, spacing_m: f32, follower_mps: f32, leader_mps: f32) -> Bounded {
        let (s, v, l) = (f64::from(spacing_m), f64::from(follower_mps).max(0.0), f64::from(leader_mps).max(0.0));
        let stop = stopping_mps2(v, self.dt_s);
        let hardest = stop.max(-HARDEST_BRAKING_MPS2 as f32);
        let bound = rounded_down((self.greatest_next_mps(s, v, l) - v) / self.dt_s).max(hardest);
        if raw_mps2 < stop {
            Bounded { accel_mps2: stop, cause: Some(Cause::Standstill) }
        } else if raw_mps2 > bound {
            Bounded { accel_mps2: bound, cause: Some(Cause::Leader) }
        } else {
            // A raw value that is no number stays one that is none: it is not for this to hide.
            Bounded { accel_mps2: raw_mps2, cause: None }
        }
    }

    /// The acceleration of [`Self::bounded`].
    #[must_use]
    pub fn served_mps2(self, raw_mps2: f32, spacing_m: f32, follower_mps: f32, leader_mps: f32) -> f32 {
        self.bounded(raw_mps2, spacing_m, follower_mps, leader_mps).accel_mps2
    }

    /// Whether both cars, braking at B from now to standstill, stay [`MARGIN_M`] apart.
    #[must_use]
    pub fn is_safe(self, spacing_m: f64, follower_mps: f64, leader_mps: f64) -> bool {
        spacing_m - MARGIN_M >= (self.stopping_m(follower_mps) - self.stopping_m(leader_mps)).max(0.0)
    }

    /// D: the distance in which a car at this speed stops when it brakes at B, m.
    #[must_use]
    pub fn stopping_m(self, speed_mps: f64) -> f64 {
        let q = HARDEST_BRAKING_MPS2 * self.dt_s;
        let k = (speed_mps / q).floor();
        self.dt_s * (k * speed_mps - q * k * k / 2.0 + (speed_mps - k * q) / 2.0)
    }

    /// The greatest speed v' after this step from which the follower is safe, m/s; negative when there is none.
    ///
    /// With the leader at l' = max(0, l − q) the state after the step is safe when both
    /// `s + dt·((l + l')/2 − (v + v')/2) ≥ m` and, since D(l) = dt·(l + l')/2 + D(l'),
    /// `dt·v'/2 + D(v') ≤ s − m + D(l) − dt·v/2`.
    fn greatest_next_mps(self, s: f64, v: f64, l: f64) -> f64 {
        let (dt, q) = (self.dt_s, HARDEST_BRAKING_MPS2 * self.dt_s);
        let apart_now = 2.0 * (s - MARGIN_M) / dt + l + (l - q).max(0.0) - v;
        let room = s - MARGIN_M + self.stopping_m(l) - dt * v / 2.0;
        if room < 0.0 {
            return -1.0;
        }
        // dt·v'/2 + D(v') is dt·q·k·(k + 1)/2 at v' = k·q, and grows by dt·(k + 1) a m/s from there to the next.
        let k = (((1.0 + 8.0 * room / (dt * q)).sqrt() - 1.0) / 2.0).floor();
        let apart_at_rest = k * q + (room - dt * q * k * (k + 1.0) / 2.0) / (dt * (k + 1.0));
        apart_now.min(apart_at_rest)
    }
}

/// The acceleration that ends a step at standstill, m/s², and in f32 as in f64 never below it: a hair less than −v/dt, so
/// that it holds for the step of an f64 caller too, which its f32 may undercut.
fn stopping_mps2(v: f64, dt_s: f64) -> f32 {
    // Not a negation: a standing car is answered 0, not −0.
    0.0 - rounded_down(v / (dt_s * (1.0 + f64::from(f32::EPSILON))))
}

/// The greatest f32 that is not above `x`.
fn rounded_down(x: f64) -> f32 {
    let near = x as f32;
    if f64::from(near) > x { near.next_down() } else { near }
}

#[cfg(test)]
#[path = "envelope_tests.rs"]
mod tests;
