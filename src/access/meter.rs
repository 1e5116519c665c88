//! How much one key may ask: a bucket of requests that fills up again evenly (GCRA), for predictions and for all else.

use std::num::NonZeroU32;
use std::time::Duration;

use governor::clock::{Clock, DefaultClock};
use governor::middleware::StateInformationMiddleware;
use governor::state::{InMemoryState, NotKeyed};
use governor::{Quota, RateLimiter};

use super::AccessSettings;

type Limiter = RateLimiter<NotKeyed, InMemoryState, DefaultClock, StateInformationMiddleware>;

/// What is counted together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Class {
    /// Predictions, simulations, evaluations.
    Predict,
    /// Everything else.
    Default,
}

impl Class {
    /// Its name on the wire.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Predict => "predict",
            Self::Default => "default",
        }
    }
}

/// The rule of a class.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Policy {
    /// Which class.
    pub class: Class,
    /// Requests within a window.
    pub requests: u32,
    /// The window, s.
    pub window_s: u32,
}

/// Where a key stands after a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Standing {
    /// The rule.
    pub policy: Policy,
    /// Requests that could follow at once.
    pub remaining: u32,
    /// Until as many are allowed as at first, s.
    pub full_in_s: u32,
}

/// A request too many.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TooMany {
    /// Where the key stands.
    pub standing: Standing,
    /// Until one more is allowed, s; at least 1.
    pub retry_after_s: u32,
}

/// The buckets of one key.
#[derive(Debug)]
pub struct Meters {
    predict: Option<Meter>,
    default: Option<Meter>,
}

#[derive(Debug)]
struct Meter {
    policy: Policy,
    limiter: Limiter,
}

impl Meters {
    /// Full ones, as these settings have it; a class with 0 requests is not limited.
    #[must_use]
    pub fn new(settings: &AccessSettings) -> Self {
        let meter = |class, requests| Meter::new(Policy { class, requests, window_s: settings.rate_window_s });
        Self {
            predict: meter(Class::Predict, settings.rate_predictions),
            default: meter(Class::Default, settings.rate_requests),
        }
    }

    /// Takes one request; where the key stands then, unless the class is not limited.
    ///
    /// # Errors
    /// When there is none to take.
    pub fn take(&self, class: Class) -> Result<Option<Standing>, TooMany> {
        let meter = match class {
            Class::Predict => &self.predict,
            Class::Default => &self.default,
        };
        meter.as_ref().map(Meter::take).transpose()
    }
}

impl Meter {
    fn new(policy: Policy) -> Option<Self> {
        let burst = NonZeroU32::new(policy.requests)?;
        let each = Duration::from_secs(policy.window_s.into()) / burst.get();
        let quota = Quota::with_period(each)?.allow_burst(burst);
        let limiter = RateLimiter::direct(quota).with_middleware::<StateInformationMiddleware>();
        Some(Self { policy, limiter })
    }

    fn take(&self) -> Result<Standing, TooMany> {
        match self.limiter.check() {
            Ok(after) => Ok(self.standing(after.remaining_burst_capacity())),
            Err(until) => {
                let wait = until.wait_time_from(self.limiter.clock().now());
                let retry_after_s = (wait.as_secs_f64().ceil() as u32).max(1);
                Err(TooMany { standing: self.standing(0), retry_after_s })
            }
        }
    }

    fn standing(&self, remaining: u32) -> Standing {
        let Policy { requests, window_s, .. } = self.policy;
        let missing = f64::from(requests.saturating_sub(remaining)) / f64::from(requests);
        Standing { policy: self.policy, remaining, full_in_s: (missing * f64::from(window_s)).ceil() as u32 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn meters(rate_requests: u32, rate_predictions: u32, rate_window_s: u32) -> Meters {
        let settings = AccessSettings {
            key_file: std::path::PathBuf::new(),
            max_keys: 1,
            rate_window_s,
            rate_requests,
            rate_predictions,
            refusal_log_s: 1.0,
        };
        Meters::new(&settings)
    }

    #[test]
    fn a_bucket_empties_one_by_one_and_then_says_how_long_to_wait() {
        let meters = meters(4, 0, 86_400);
        let policy = Policy { class: Class::Default, requests: 4, window_s: 86_400 };
        for remaining in (0..4).rev() {
            let standing = meters.take(Class::Default).unwrap().unwrap();
            assert_eq!((standing.policy, standing.remaining), (policy, remaining));
            assert_eq!(standing.full_in_s, (4 - remaining) * 21_600);
        }
        let refused = meters.take(Class::Default).unwrap_err();
        assert_eq!((refused.standing.remaining, refused.standing.full_in_s), (0, 86_400));
        assert!((1..=21_600).contains(&refused.retry_after_s), "{refused:?}");
    }

    #[test]
    fn classes_are_counted_apart_and_none_is_no_limit() {
        let meters = meters(1, 0, 86_400);
        meters.take(Class::Default).unwrap();
        assert!(meters.take(Class::Default).is_err());
        for _ in 0..100 {
            assert_eq!(meters.take(Class::Predict), Ok(None));
        }
    }
}
