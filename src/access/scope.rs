//! What a key may be used for.

use serde::{Deserialize, Serialize};

/// A kind of thing to do. Whatever a key may do, it may read what concerns it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Scope {
    /// Ask for predictions, simulations and evaluations.
    Predict,
    /// Upload events.
    Ingest,
    /// Decide what is learned and what serves: models, tasks, versions, promotions, rollbacks, retractions.
    Train,
    /// Everything, also keys and the audit log.
    Admin,
}

impl Scope {
    /// Every scope, in the order they are written.
    pub const ALL: [Self; 4] = [Self::Predict, Self::Ingest, Self::Train, Self::Admin];

    /// Its name on the wire.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Predict => "predict",
            Self::Ingest => "ingest",
            Self::Train => "train",
            Self::Admin => "admin",
        }
    }
}

impl std::str::FromStr for Scope {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let known = Self::ALL.into_iter().find(|scope| scope.as_str() == text);
        known.ok_or_else(|| format!("{text:?} is none of predict, ingest, train, admin"))
    }
}

/// A set of scopes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(from = "Vec<Scope>", into = "Vec<Scope>")]
pub struct Scopes(u8);

impl Scopes {
    /// Whether it allows what needs `scope`: it is in the set, or `admin` is.
    #[must_use]
    pub fn allow(self, scope: Scope) -> bool {
        self.0 & (bit(scope) | bit(Scope::Admin)) != 0
    }

    /// Whether no scope is in it.
    #[must_use]
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }
}

fn bit(scope: Scope) -> u8 {
    1 << scope as u8
}

impl FromIterator<Scope> for Scopes {
    fn from_iter<T: IntoIterator<Item = Scope>>(scopes: T) -> Self {
        Self(scopes.into_iter().fold(0, |set, scope| set | bit(scope)))
    }
}

impl From<Vec<Scope>> for Scopes {
    fn from(scopes: Vec<Scope>) -> Self {
        scopes.into_iter().collect()
    }
}

impl From<Scopes> for Vec<Scope> {
    fn from(scopes: Scopes) -> Self {
        Scope::ALL.into_iter().filter(|&scope| scopes.0 & bit(scope) != 0).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn admin_implies_every_scope_and_no_other_scope_implies_any() {
        for held in Scope::ALL {
            for needed in Scope::ALL {
                let allowed = Scopes::from_iter([held]).allow(needed);
                assert_eq!(allowed, held == needed || held == Scope::Admin, "{held:?} for {needed:?}");
            }
        }
        assert!(Scopes::default().is_empty() && Scope::ALL.iter().all(|&scope| !Scopes::default().allow(scope)));
    }

    #[test]
    fn a_set_is_written_in_one_order_whatever_it_was_made_of() {
        let scopes: Scopes = serde_json::from_str(r#"["train", "predict", "train"]"#).unwrap();
        assert_eq!(serde_json::to_string(&scopes).unwrap(), r#"["predict","train"]"#);
        assert_eq!("ingest".parse(), Ok(Scope::Ingest));
        assert!("Ingest".parse::<Scope>().is_err());
    }
}
