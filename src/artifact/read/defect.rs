//! What may be wrong with a file.

/// Why a file is no version.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ArtifactError {
    /// It is no safetensors file.
    #[error("{0}")]
    Malformed(String),
    /// It is one, and cannot be a version of this model.
    #[error("{}", .0.first().map_or("it cannot be used", |defect| &defect.detail))]
    Unusable(Vec<Defect>),
}

/// One thing wrong with the contents of a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Defect {
    /// A JSON pointer into the header: `/lstm.weight_ih_l0`, `/__metadata__/scaling`.
    pub pointer: String,
    /// Stable name.
    pub code: &'static str,
    /// For a person.
    pub detail: String,
}

impl Defect {
    /// In a tensor.
    pub(super) fn tensor(name: &str, code: &'static str, detail: String) -> Self {
        // RFC 6901; names may be anything.
        Self { pointer: format!("/{}", name.replace('~', "~0").replace('/', "~1")), code, detail }
    }

    /// In a value of `__metadata__`.
    pub(super) fn key(key: &str, code: &'static str, detail: impl Into<String>) -> Self {
        Self { pointer: format!("/__metadata__/{key}"), code, detail: format!("{key}: {}", detail.into()) }
    }
}

impl From<Defect> for ArtifactError {
    fn from(defect: Defect) -> Self {
        Self::Unusable(vec![defect])
    }
}
