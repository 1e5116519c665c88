//! The words of the service: what a client of the interface names, checked once and then known to be right.

mod batch;
mod model;
mod names;
mod promotion;
mod regime;
mod preset;
mod replay;
mod retention;
mod settings;
mod split;
mod stored_event;
mod strength;
mod strength_search;
mod task;
mod task_settings;
mod version;

pub use batch::{Batch, EventCounts, Place, Rejection};
pub use model::Model;
pub use names::{ModelName, NameError, RegimeName};
pub use preset::Preset;
pub use promotion::{Promotion, PromotionDecision, PromotionPolicy, RegimeComparison};
pub use regime::{RegimeRule, Schedule, SpeedBands};
pub use replay::{ReplayPart, ReplayReport, ReplayedLive, ReplayedRegimes, ReplayedStage};
pub use retention::Retention;
pub use settings::{ModelSettings, SettingsError};
pub use split::Split;
pub use stored_event::StoredEvent;
pub use strength::{Auto, Strength};
pub use strength_search::{SearchedRegime, SearchedStrength, StrengthSearch};
pub use task::{Task, TaskError, TaskKind, TaskState};
pub use version::{RegimeEvaluation, ServedMeasures, TestMeasures, Version};
