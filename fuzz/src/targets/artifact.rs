use headway::artifact::{ArtifactError, BroughtRegime, read};
use headway::consolidation::Method;
use headway::lineage::ModelSettings;

/// A safetensors file as a version of a small model of one of three methods: what is taken can be learned from.
pub(super) fn run(data: &[u8]) {
    let Some((choice, file)) = super::chosen(data, 3) else { return };
    let method = [Method::Ewc, Method::Si, Method::Naive][choice];
    let settings = ModelSettings { hidden: 2, horizon: 3, ..ModelSettings::default() };
    // Settings and what is told of them; entries of a header beside their text.
    let most = (1 << 20) + 64 * file.len() as u64;
    match super::within(most, || read(file, method, &settings)) {
        Ok(brought) => {
            let weights = brought.settings.shape().layout().len();
            assert_eq!(brought.settings.shape(), settings.shape());
            let numbers = |values: &[f32]| values.len() == weights && values.iter().all(|x| x.is_finite());
            assert!(numbers(&brought.weights) && brought.scaling.spread.iter().all(|&spread| spread > 0.0));
            assert!(brought.strength.into_iter().chain(brought.lambda).all(|x| x >= 0.0 && x.is_finite()));
            let own = |one: &&BroughtRegime| one.regime == brought.regime && one.stage == brought.stage;
            assert_eq!(brought.regimes.iter().filter(own).count(), 1);
            for memory in brought.regimes.iter().filter_map(|one| one.memory.as_ref()) {
                assert!(method.consolidates() && numbers(&memory.importance) && numbers(&memory.anchor));
                assert!(memory.importance.iter().all(|&x| x >= 0.0) && memory.stage <= brought.stage);
            }
        }
        Err(ArtifactError::Malformed(detail)) => assert!(!detail.is_empty() && detail.len() < 4096),
        Err(ArtifactError::Unusable(defects)) => {
            assert!(!defects.is_empty());
            assert!(defects.iter().all(|it| it.pointer.starts_with('/') && it.pointer.len() + it.detail.len() < 8192));
        }
    }
}
