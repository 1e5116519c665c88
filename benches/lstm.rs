//! Passes of training, forward and backward through some events: `cargo bench --bench lstm`.

use divan::{Bencher, counter::ItemsCount};
use headway::lstm::{Gradients, INPUTS, Layout, Magnitude, Network, Passes, Windows, initial_weights};

fn main() {
    divan::main();
}

/// Steps that the network reads of an event of 150.
const STEPS: usize = 149;
const HORIZON: usize = 10;

fn network(hidden: usize) -> Network<f32> {
    let layout = Layout { hidden, inputs: INPUTS };
    Network::new(layout, &initial_weights(layout, 42))
}

fn inputs(rows: usize) -> Vec<f32> {
    (0..rows * INPUTS).map(|i| (i as f32 * 0.7).sin()).collect()
}

fn there_and_back(bencher: Bencher<'_, '_>, hidden: usize, events: usize, passes: fn(Layout) -> Passes<f32>) {
    let network = network(hidden);
    let mut passes = passes(network.layout());
    let mut gradient = vec![0.0; network.weights().len()];
    let inputs = inputs(events);
    bencher.counter(ItemsCount::new(events)).bench_local(|| {
        passes.begin(HORIZON, &vec![STEPS; events]);
        for t in 0..STEPS {
            passes.forward(&network, t, &inputs);
        }
        passes.turn(Gradients::Summed);
        for t in (0..STEPS).rev() {
            let dy = vec![0.01; passes.answering(t)];
            passes.backward(&network, t, &dy);
            passes.by_inputs(&network, t);
        }
        passes.finish(&mut gradient);
    });
}

/// Windows of eight events, which is a piece.
#[divan::bench(args = [64, 128])]
fn windows(bencher: Bencher<'_, '_>, hidden: usize) {
    there_and_back(bencher, hidden, 8, Passes::windows);
}

/// One state along each of some events.
#[divan::bench(args = [4, 8, 16])]
fn carried(bencher: Bencher<'_, '_>, events: usize) {
    there_and_back(bencher, 128, events, Passes::carried);
}

/// Own gradients of the windows of an event: what exact importance adds up.
#[divan::bench(args = [64, 128])]
fn own_gradients(bencher: Bencher<'_, '_>, hidden: usize) {
    let network = network(hidden);
    let mut windows = Windows::<f32>::new(network.layout(), HORIZON);
    let inputs = inputs(Windows::<f32>::AT_ONCE + HORIZON - 1);
    bencher.counter(ItemsCount::new(Windows::<f32>::AT_ONCE)).bench_local(|| {
        windows.forward(&network, &inputs);
        windows.add_magnitudes(&network, &[0.1; Windows::<f32>::AT_ONCE], Magnitude::Square);
    });
}

/// Weights arranged for the passes, once an update.
#[divan::bench]
fn arrange_weights(bencher: Bencher<'_, '_>) {
    let mut network = network(128);
    let weights = network.weights().to_vec();
    bencher.bench_local(|| network.set(&weights));
}
