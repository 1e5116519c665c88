//! Safety: what keeps a served driver from colliding, and how close it comes.

mod envelope;

pub use envelope::{Envelope, HARDEST_BRAKING_MPS2, MARGIN_M};
