//! Adam, Kingma & Ba 2015, with torch's defaults.

const BETA1: f32 = 0.9;
const BETA2: f32 = 0.999;
const EPSILON: f32 = 1e-8;

/// Moments of the gradient. They start afresh at each stage.
#[derive(Debug, Clone, PartialEq)]
pub struct Adam {
    /// Updates done.
    pub updates: u64,
    /// First moment.
    pub first: Vec<f32>,
    /// Second moment.
    pub second: Vec<f32>,
}

impl Adam {
    /// No update yet.
    #[must_use]
    pub fn new(parameters: usize) -> Self {
        Self { updates: 0, first: vec![0.0; parameters], second: vec![0.0; parameters] }
    }

    /// `θ ← θ − lr · m̂ / (√v̂ + ε)`.
    pub fn step(&mut self, weights: &mut [f32], gradient: &[f32], learning_rate: f32) {
        self.updates += 1;
        let t = i32::try_from(self.updates).unwrap_or(i32::MAX);
        let rate = learning_rate / (1.0 - BETA1.powi(t));
        let root = (1.0 - BETA2.powi(t)).sqrt();
        let moments = self.first.iter_mut().zip(&mut self.second);
        for ((w, g), (m, v)) in weights.iter_mut().zip(gradient).zip(moments) {
            *m = BETA1 * *m + (1.0 - BETA1) * g;
            *v = BETA2 * *v + (1.0 - BETA2) * g * g;
            *w -= rate * *m / (v.sqrt() / root + EPSILON);
        }
    }
}

/// Scales `gradient` down to global norm `limit` when it is longer (torch's `clip_grad_norm_`); returns the norm before.
pub fn clip_norm(gradient: &mut [f32], limit: f32) -> f64 {
    let norm = gradient.iter().map(|&g| f64::from(g) * f64::from(g)).sum::<f64>().sqrt();
    let scale = f64::from(limit) / (norm + 1e-6);
    if scale < 1.0 {
        for g in gradient {
            *g *= scale as f32;
        }
    }
    norm
}
