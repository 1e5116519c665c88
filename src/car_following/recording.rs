//! An event as it was sent, before anything about it is known to be right.

/// One leader–follower trajectory as recorded. Arrays may differ in length and hold anything.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Recording {
    /// Seconds between steps, where declared.
    pub dt_s: Option<f64>,
    /// Time of each step, s, where recorded; gives the step when none is declared.
    pub t_s: Option<Vec<f64>>,
    /// Spacing as the upload defines it, m.
    pub spacing_m: Vec<f64>,
    /// Follower speed, m/s.
    pub follower_speed_mps: Vec<f64>,
    /// Leader speed, m/s.
    pub leader_speed_mps: Vec<f64>,
    /// Leader speed − follower speed, m/s, where recorded; only compared.
    pub rel_speed_mps: Option<Vec<f64>>,
}

/// What a recorded spacing is measured between.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub enum SpacingDefinition {
    /// Bumper to bumper: the leader's rear to the follower's front.
    #[default]
    Net,
    /// Front to front.
    Front {
        /// Leader's length, m.
        leader_length_m: f64,
    },
    /// Centre to centre.
    Centre {
        /// Leader's length, m.
        leader_length_m: f64,
        /// Follower's length, m.
        follower_length_m: f64,
    },
}

impl SpacingDefinition {
    /// What to subtract from a recorded spacing to get the net one, m.
    #[must_use]
    pub fn excess_m(self) -> f64 {
        match self {
            Self::Net => 0.0,
            Self::Front { leader_length_m } => leader_length_m,
            Self::Centre { leader_length_m, follower_length_m } => f64::midpoint(leader_length_m, follower_length_m),
        }
    }
}

/// How the recordings of an upload are to be read.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Conversion {
    /// Seconds between the steps of recordings that do not declare it themselves.
    pub dt_s: Option<f64>,
    /// What their spacing is measured between.
    pub spacing: SpacingDefinition,
}

/// What the model that will learn an event needs of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target {
    /// The model's step, s.
    pub dt_s: f64,
    /// Steps it needs at least, at that step.
    pub min_steps: usize,
    /// Steps it has memory for.
    pub max_steps: usize,
}

/// Why a recording is not an event.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Defect {
    /// The array or value at fault, by its name on the wire; none when it is the recording as a whole.
    pub field: Option<&'static str>,
    /// The step at fault, from 0.
    pub step: Option<usize>,
    /// Stable name.
    pub code: &'static str,
    /// For a person, with the numbers.
    pub detail: String,
}

impl Defect {
    pub(super) fn new(
        field: impl Into<Option<&'static str>>,
        step: impl Into<Option<usize>>,
        code: &'static str,
        detail: String,
    ) -> Self {
        Self { field: field.into(), step: step.into(), code, detail }
    }
}
