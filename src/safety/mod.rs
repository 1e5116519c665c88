//! Safety: what keeps a served driver from colliding, and how close a driver comes.
//!
//! `Envelope` bounds what is served. The rest measures any driver the same way: `assess` takes a set of
//! `stress_set` scenarios, a `Platoon` and a function that drives events closed loop (`&[Event]` to `Vec<Trajectory>`, in
//! their order), and gives a `SafetyReport` that serialises; `markdown` puts reports of several drivers side by side.
//! `evaluation::drive_events` drives a network so, with the envelope and without; a `reference::Driven` is a `Trajectory` too.

mod assess;
mod envelope;
mod platoon;
mod stress;
mod surrogate;
mod table;
mod trajectory;

pub use assess::{SafetyReport, Spread, StressOutcome, assess};
pub use envelope::{Bounded, Cause, Envelope, HARDEST_BRAKING_MPS2, MARGIN_M};
pub use platoon::{Platoon, PlatoonOutcome, WaveGain};
pub use stress::{StressClass, StressScenario, StressSettings, stress_set};
pub use surrogate::Surrogates;
pub use table::markdown;
pub use trajectory::Trajectory;
