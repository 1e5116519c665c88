//! The kernels of training: the same bits in every way of computing, and what the formulas say.

use super::backward::{ThroughGates, ThroughWeights};
use super::forward::Forward;
use super::lanes::run_one_way;
use super::lines::{GATES, LINE, Line, Lines, gate_row, lines};
use super::outer::{OuterProducts, Segment};
use super::tiles::{TOGETHER, place};
use super::*;

fn values(count: usize, seed: usize) -> Vec<Line<f32>> {
    (0..count).map(|line| Line(std::array::from_fn(|lane| ((line * LINE + lane + seed) as f32 * 1.7).sin()))).collect()
}

fn network(hidden: usize) -> Network<f32> {
    let layout = Layout { hidden, inputs: INPUTS };
    let weights: Vec<f32> = initial_weights(layout, 5).into_iter().map(|w| 3.0 * w).collect();
    Network::new(layout, &weights)
}

/// What `compute` leaves, which has to be the same in every way of computing.
fn every_way(compute: &dyn Fn(usize) -> Option<Vec<Line<f32>>>) -> Vec<Line<f32>> {
    let bits = |lines: &[Line<f32>]| lines.iter().flat_map(|line| line.0.map(f32::to_bits)).collect::<Vec<_>>();
    let single = compute(0).expect("one number at a time");
    assert!(single.iter().all(|line| line.0.iter().all(|x| x.is_finite())));
    for way in 1..4 {
        if let Some(other) = compute(way) {
            assert_eq!(bits(&other), bits(&single), "way {way}");
        }
    }
    single
}

#[test]
fn a_step_forward_has_the_same_bits_in_every_way() {
    for hidden in [5, 16, 40] {
        let (network, units) = (network(hidden), lines(hidden));
        for (begun, later) in [(3, 0), (0, 1), (2, 5), (1, 14)] {
            let (rows, before) = (begun + later, later + 2);
            let events: Vec<_> = (0..rows).map(|row| row % 3).collect();
            let (p, h, c) = (values(4 * GATES * units, 1), values(before * units, 2), values(before * units, 3));
            every_way(&|way| {
                let mut out = values(rows * (GATES + 2) * units, 4);
                let (z, states) = out.split_at_mut(rows * GATES * units);
                let (c_after, h_after) = states.split_at_mut(rows * units);
                let step = Forward {
                    weights: &network.to_gates,
                    events: &events,
                    begun,
                    projected: Lines::new(&p, 4),
                    first: 1,
                    h_before: Lines::new(&h, before),
                    c_before: Lines::new(&c, before),
                    z,
                    c: c_after,
                    h: h_after,
                };
                run_one_way(way, step).then_some(out)
            });
        }
    }
}

#[test]
fn a_step_back_through_the_gates_has_the_same_bits_in_every_way() {
    let (units, begun, later) = (3, 2, 5);
    let (rows, before) = (begun + later, later + 1);
    let events: Vec<_> = (0..rows).map(|row| row % 3).collect();
    let [z, c, dh, dc] = [(GATES, 1), (1, 2), (1, 3), (1, 4)].map(|(each, seed)| values(rows * each * units, seed));
    let c_before = values(before * units, 5);
    every_way(&|way| {
        let (mut dz, mut dz_sum, mut dc_before) =
            (values(later * GATES * units, 6), values(3 * GATES * units, 7), values(before * units, 8));
        let step = ThroughGates {
            events: &events,
            begun,
            z: Lines::new(&z, rows),
            c: Lines::new(&c, rows),
            c_before: Lines::new(&c_before, before),
            dh: Lines::new(&dh, rows),
            dc: Lines::new(&dc, rows),
            dz: &mut dz,
            dz_sum: &mut dz_sum,
            summed: 3,
            dc_before: &mut dc_before,
            rows_before: before,
        };
        run_one_way(way, step).then(|| [dz, dz_sum, dc_before].concat())
    });
}

#[test]
fn a_step_back_through_the_weights_sums_in_order() {
    for hidden in [5, 16, 40, 70, 150] {
        let (network, units) = (network(hidden), lines(hidden));
        let recurrent = &network.weights()[network.layout().recurrent()];
        for later in [1, 4, 6, 11, 12] {
            let before = later + 3;
            let dz = values(later * GATES * units, 1);
            let out = every_way(&|way| {
                let mut out = values(before * units, 2);
                let (weights, dz) = (&network.to_states, Lines::new(&dz, later));
                let step = ThroughWeights { weights, dz, later, dh_before: &mut out, rows_before: before };
                run_one_way(way, step).then_some(out)
            });
            for (row, unit) in (0..later).flat_map(|row| (0..hidden).map(move |unit| (row, unit))) {
                let sum = (0..GATES * units * LINE).fold(0.0_f32, |sum, at| {
                    let weight = gate_row(hidden, at).map_or(0.0, |gate| recurrent[gate * hidden + unit]);
                    dz[at / LINE * later + row].0[at % LINE].mul_add(weight, sum)
                });
                assert_eq!(out[unit / LINE * before + row].0[unit % LINE], sum, "{hidden} units, {later} rows");
            }
        }
    }
}

#[test]
fn outer_products_are_sums_in_order_however_steps_are_put_together() {
    for units in [1, 2, 3] {
        let outputs = GATES * units * LINE;
        let steps = [(3, 4), (7, 9), (1, 1)];
        let mut segments: Vec<Segment> = Vec::new();
        let (mut at_dz, mut at_h) = (0, 0);
        for (rows, h_rows) in steps {
            segments.push(Segment { rows, dz: at_dz, h: at_h, h_rows });
            at_dz += rows * GATES * units;
            at_h += h_rows * units;
        }
        let (dz, h, start) = (values(at_dz, 1), values(at_h, 2), values(outputs * units.next_multiple_of(TOGETHER), 3));
        let gather = |way: usize, parts: &[&[Segment]]| {
            let mut sums = start.clone();
            let done = parts.iter().all(|segments| {
                run_one_way(way, OuterProducts { segments, dz: &dz, h: &h, lines: units, outputs, sums: &mut sums })
            });
            done.then_some(sums)
        };
        let together = every_way(&|way| gather(way, &[&segments]));
        let apart = every_way(&|way| gather(way, &[&segments[..1], &segments[1..]]));
        for (output, unit) in (0..outputs).flat_map(|output| (0..units * LINE).map(move |unit| (output, unit))) {
            let (place, lane) = (place(outputs, output, unit / LINE), unit % LINE);
            let sum = segments.iter().flat_map(|s| (0..s.rows).map(move |row| (s, row))).fold(
                start[place].0[lane],
                |sum, (s, row)| {
                    let dz = dz[s.dz + output / LINE * s.rows + row].0[output % LINE];
                    dz.mul_add(h[s.h + unit / LINE * s.h_rows + row].0[lane], sum)
                },
            );
            assert_eq!((together[place].0[lane], apart[place].0[lane]), (sum, sum));
        }
    }
}

#[test]
fn windows_answer_in_training_what_they_answer_when_served() {
    for hidden in [3, 16, 19] {
        let network = network(hidden);
        let encoder = Encoder::new(network.layout(), network.weights().to_vec()).unwrap();
        let (horizon, steps) = (4, [9, 9, 7, 5]);
        let input = |event: usize, t: usize| -> [f32; INPUTS] {
            std::array::from_fn(|k| ((event * 31 + t * 7 + k) as f32).sin())
        };
        let mut passes = Passes::windows(network.layout());
        passes.begin(horizon, &steps);
        for t in 0..passes.steps() {
            let inputs: Vec<_> = (0..passes.events(t)).flat_map(|event| input(event, t)).collect();
            let answers = passes.forward(&network, t, &inputs);
            for (event, answer) in answers.iter().enumerate() {
                let window: Vec<_> = (t + 1 - horizon..=t).flat_map(|t| input(event, t)).collect();
                let mut served = [0.0];
                encoder.head_values(&window, &mut EncoderBuffers::default(), &mut served);
                assert_eq!(*answer, served[0], "{hidden} units, event {event}, step {t}");
            }
            assert_eq!(answers.len(), steps.iter().filter(|&&steps| t < steps && t + 1 >= horizon).count());
        }
    }
}
