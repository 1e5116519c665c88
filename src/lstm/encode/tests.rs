//! The arithmetic against the formulas, and against itself on other instructions.

use pulp::{Scalar, Simd, WithSimd};

use super::step::{States, StatesMut, Step};
use super::*;
use crate::lstm::initial_weights;

/// Weights that are not small, so that gates saturate.
fn weights(layout: Layout) -> Vec<f32> {
    initial_weights(layout, 5).into_iter().map(|w| 3.0 * w).collect()
}

fn inputs(count: usize) -> Vec<f32> {
    (0..count).map(|i| 2.0 * (i as f32 * 1.7).sin()).collect()
}

fn sigmoid(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}

/// The head's value of one window, by the formulas of `torch.nn.LSTMCell`.
fn by_formula(layout: Layout, weights: &[f32], window: &[f32]) -> f64 {
    let Layout { hidden, inputs } = layout;
    let w: Vec<f64> = weights.iter().map(|&w| f64::from(w)).collect();
    let (mut h, mut c) = (vec![0.0; hidden], vec![0.0; hidden]);
    for x in window.chunks(inputs) {
        let before = h.clone();
        for unit in 0..hidden {
            let z: [f64; 4] = std::array::from_fn(|gate| {
                let row = gate * hidden + unit;
                let input = &w[layout.input()][row * inputs..][..inputs];
                let recurrent = &w[layout.recurrent()][row * hidden..][..hidden];
                let by_input: f64 = input.iter().zip(x).map(|(w, &x)| w * f64::from(x)).sum();
                let by_state: f64 = recurrent.iter().zip(&before).map(|(w, h)| w * h).sum();
                by_input + by_state + w[layout.bias()][row]
            });
            c[unit] = sigmoid(z[1]) * c[unit] + sigmoid(z[0]) * z[2].tanh();
            h[unit] = sigmoid(z[3]) * c[unit].tanh();
        }
    }
    w[layout.head()].iter().zip(&h).map(|(w, h)| w * h).sum::<f64>() + w[layout.head_bias()]
}

#[test]
fn windows_of_every_size_and_number_agree_with_the_formulas() {
    let mut buffers = EncoderBuffers::default();
    for hidden in [1, 5, 16, 19, 128] {
        let layout = Layout { hidden, inputs: 4 };
        let encoder = Encoder::new(layout, weights(layout)).unwrap();
        for windows in [1, 2, 3, 4, 5, 6, 13] {
            let inputs = inputs(windows * 7 * 4);
            let mut values = vec![f32::NAN; windows];
            encoder.head_values(&inputs, &mut buffers, &mut values);
            for (window, value) in inputs.chunks(7 * 4).zip(values) {
                let expected = by_formula(layout, encoder.weights(), window);
                assert!((f64::from(value) - expected).abs() < 1e-5, "{hidden} units: {value} {expected}");
            }
        }
    }
}

#[test]
fn a_state_and_overlapping_windows_end_where_a_window_does() {
    let layout = Layout { hidden: 21, inputs: 3 };
    let encoder = Encoder::new(layout, weights(layout)).unwrap();
    let (steps, each) = (11, layout.inputs);
    let inputs = inputs(steps * each);
    let alone = |from: usize, to: usize| {
        let mut value = [f32::NAN];
        encoder.head_values(&inputs[from * each..to * each], &mut EncoderBuffers::default(), &mut value);
        value[0]
    };
    for horizon in [1, 2, 4] {
        let (mut state, mut windows) = (encoder.state(), encoder.overlapping_windows(horizon));
        for again in 0..2 {
            for (t, x) in inputs.chunks(each).enumerate() {
                let full = encoder.slide(&mut windows, x);
                assert_eq!(full, (t + 1 >= horizon).then(|| alone(t + 1 - horizon, t + 1)), "{again}");
                if again == 0 {
                    assert_eq!(encoder.advance(&mut state, x), alone(0, t + 1));
                }
            }
            windows.clear();
        }
    }
}

#[test]
fn overlapping_windows_may_read_different_inputs() {
    let layout = Layout { hidden: 7, inputs: 2 };
    let encoder = Encoder::new(layout, weights(layout)).unwrap();
    let (horizon, steps) = (4, 9);
    // What the window that began at step `from` reads at step t.
    let read = |from: usize, t: usize| [(t as f32).sin(), (t - from) as f32];
    let mut windows = encoder.overlapping_windows(horizon);
    for t in 0..steps {
        let inputs: Vec<f32> = (0..windows.reading()).flat_map(|back| read(t - back, t)).collect();
        let full = encoder.slide(&mut windows, &inputs);
        let from = (t + 1).checked_sub(horizon);
        let alone = from.map(|from| {
            let (mut state, mut value) = (encoder.state(), 0.0);
            for t in from..=t {
                value = encoder.advance(&mut state, &read(from, t));
            }
            value
        });
        assert_eq!(full, alone);
    }
}

/// States after a first and a later step.
fn two_steps(packed: &Packed, rows: usize, inputs: usize, take: &dyn Fn(Step<'_>)) -> [Vec<f32>; 2] {
    let x = self::inputs(2 * rows * inputs);
    let zeros = || vec![f32::NAN; rows * packed.units()];
    let ([mut h1, mut c1], [mut h2, mut c2]) = ([zeros(), zeros()], [zeros(), zeros()]);
    let row = |step: usize| Rows { values: &x[step * rows * inputs..], stride: inputs };
    let after = StatesMut { h: &mut h1, c: &mut c1 };
    take(Step { packed, inputs: row(0), before: None, after, backwards: false });
    let (before, after) = (Some(States { h: &h1, c: &c1 }), StatesMut { h: &mut h2, c: &mut c2 });
    take(Step { packed, inputs: row(1), before, after, backwards: true });
    [h2, c2]
}

#[test]
fn the_portable_path_and_every_instruction_set_of_this_machine_give_the_same_bits() {
    for hidden in [5, 16, 40] {
        let layout = Layout { hidden, inputs: 4 };
        let packed = Packed::new(layout, &weights(layout));
        for rows in 1..=14 {
            let portable = two_steps(&packed, rows, 4, &|step| step.with_simd(Scalar));
            assert!(portable.iter().flatten().all(|value| value.is_finite()));
            assert_eq!(two_steps(&packed, rows, 4, &|step| step.take()), portable, "{hidden} units, {rows} rows");
            #[cfg(target_arch = "x86_64")]
            if let Some(narrow) = pulp::x86::V3::try_new() {
                assert_eq!(two_steps(&packed, rows, 4, &|step| Simd::vectorize(narrow, step)), portable);
            }
        }
    }
}
