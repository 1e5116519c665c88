//! Which table the rows of a body are for.

use super::FormatLimits;
use super::columns::{Preset, Role};
use super::rows::Rows;
use super::scene::{Fcd, Ngsim};
use super::table::Table;
use crate::car_following::ExtractionSettings;

/// What takes rows of these columns.
pub(super) fn table(
    preset: Preset,
    roles: Vec<Role>,
    limits: &FormatLimits,
    extraction: &ExtractionSettings,
) -> Box<dyn Table> {
    match preset {
        Preset::Headway | Preset::Follownet => Box::new(Rows::new(roles)),
        Preset::Ngsim => Box::new(Ngsim::new(&roles, limits, extraction)),
        Preset::Fcd => Box::new(Fcd::of_rows(&roles, limits, extraction)),
    }
}
