//! One word for all of them: which there are, and one with its parameters.

use super::parameters::{GIPPS, IDM};
use super::{Gipps, Parameter};
use crate::car_following::Idm;

/// Which reference driver.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ReferenceKind {
    /// The Intelligent Driver Model.
    Idm,
    /// Gipps's model.
    Gipps,
    /// Whoever keeps the speed of the last recorded step, whatever the leader does. It has no parameters.
    Constant,
}

/// A reference driver with its parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ReferenceDriver {
    /// See [`Idm`].
    Idm(Idm),
    /// See [`Gipps`].
    Gipps(Gipps),
    /// See [`ReferenceKind::Constant`].
    Constant,
}

impl ReferenceKind {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Idm, Self::Gipps, Self::Constant];

    /// The name on the wire.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Idm => "idm",
            Self::Gipps => "gipps",
            Self::Constant => "constant",
        }
    }

    /// The reference driver of this name.
    #[must_use]
    pub fn parse(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.as_str() == name)
    }

    /// Its parameters and their bounds, in the order of [`ReferenceDriver::values`].
    #[must_use]
    pub fn parameters(self) -> &'static [Parameter] {
        match self {
            Self::Idm => &IDM,
            Self::Gipps => &GIPPS,
            Self::Constant => &[],
        }
    }

    /// With the parameters of the paper that introduced it.
    ///
    /// IDM: table I of Treiber et al. 2000, with a desired speed of 120 km/h. Gipps: the means that he drew his drivers from,
    /// a = 1.7 m/s², b = 2a, b̂ = max(3, (b + 3)/2) = 3.2 m/s², V = 20 m/s, τ = 2/3 s, and of his 6.5 m from front to front at
    /// standstill the 2 m that are not the vehicle.
    #[must_use]
    pub fn published(self) -> ReferenceDriver {
        match self {
            Self::Idm => self.with(&[120.0 / 3.6, 1.6, 2.0, 0.73, 1.67]),
            Self::Gipps => self.with(&[20.0, 2.0 / 3.0, 2.0, 1.7, 3.4, 3.2]),
            Self::Constant => self.with(&[]),
        }
    }

    /// With these values of [`Self::parameters`].
    ///
    /// # Panics
    /// When there are not as many.
    #[must_use]
    pub fn with(self, values: &[f64]) -> ReferenceDriver {
        match (self, values) {
            (
                Self::Idm,
                &[desired_speed_mps, time_headway_s, jam_spacing_m, max_accel_mps2, comfortable_braking_mps2],
            ) => ReferenceDriver::Idm(Idm {
                desired_speed_mps,
                time_headway_s,
                jam_spacing_m,
                max_accel_mps2,
                comfortable_braking_mps2,
            }),
            (
                Self::Gipps,
                &[
                    desired_speed_mps,
                    reaction_s,
                    jam_spacing_m,
                    max_accel_mps2,
                    hardest_braking_mps2,
                    leader_braking_mps2,
                ],
            ) => ReferenceDriver::Gipps(Gipps {
                desired_speed_mps,
                reaction_s,
                jam_spacing_m,
                max_accel_mps2,
                hardest_braking_mps2,
                leader_braking_mps2,
            }),
            (Self::Constant, &[]) => ReferenceDriver::Constant,
            (kind, values) => {
                panic!("{} has {} parameters, not {}", kind.as_str(), kind.parameters().len(), values.len())
            }
        }
    }
}

impl ReferenceDriver {
    /// Which it is.
    #[must_use]
    pub fn kind(&self) -> ReferenceKind {
        match self {
            Self::Idm(_) => ReferenceKind::Idm,
            Self::Gipps(_) => ReferenceKind::Gipps,
            Self::Constant => ReferenceKind::Constant,
        }
    }

    /// The values of its [`ReferenceKind::parameters`].
    #[must_use]
    pub fn values(&self) -> Vec<f64> {
        match *self {
            Self::Idm(Idm {
                desired_speed_mps,
                time_headway_s,
                jam_spacing_m,
                max_accel_mps2,
                comfortable_braking_mps2,
            }) => vec![desired_speed_mps, time_headway_s, jam_spacing_m, max_accel_mps2, comfortable_braking_mps2],
            Self::Gipps(Gipps {
                desired_speed_mps,
                reaction_s,
                jam_spacing_m,
                max_accel_mps2,
                hardest_braking_mps2,
                leader_braking_mps2,
            }) => vec![
                desired_speed_mps,
                reaction_s,
                jam_spacing_m,
                max_accel_mps2,
                hardest_braking_mps2,
                leader_braking_mps2,
            ],
            Self::Constant => Vec::new(),
        }
    }

    /// The same driver, with the reaction time that it has when it is driven in steps of `dt_s`.
    #[must_use]
    pub fn in_steps_of(self, dt_s: f64) -> Self {
        match self {
            Self::Gipps(gipps) => Self::Gipps(Gipps { reaction_s: gipps.reaction_steps(dt_s) as f64 * dt_s, ..gipps }),
            other => other,
        }
    }

    /// Its parameters by name.
    pub fn named_values(&self) -> impl Iterator<Item = (&'static str, f64)> {
        self.kind().parameters().iter().map(|parameter| parameter.name).zip(self.values())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_values_and_bounds_agree() {
        for kind in ReferenceKind::ALL {
            assert_eq!(ReferenceKind::parse(kind.as_str()), Some(kind));
            let published = kind.published();
            assert_eq!(published.kind(), kind);
            assert_eq!(kind.with(&published.values()), published);
            for (parameter, value) in kind.parameters().iter().zip(published.values()) {
                assert!((parameter.low..=parameter.high).contains(&value), "{parameter:?} {value}");
            }
        }
        assert_eq!(ReferenceKind::parse("IDM"), None);
    }
}
