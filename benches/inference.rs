//! Kernels of serving: `cargo bench --bench inference`.

use std::cell::RefCell;
use std::hint::black_box;

use divan::Bencher;
use divan::counter::ItemsCount;
use headway::driver::{Driver, DriverBuffers, DriverShape, Features, Memory, Scaling, Seen, Window};
use headway::lstm::initial_weights;

const HIDDEN: [usize; 3] = [32, 64, 128];
const SEEN: Seen = Seen { follower_speed_mps: 8.0, leader_speed_mps: 8.6, spacing_m: 15.0 };

fn main() {
    divan::main();
}

fn driver(shape: DriverShape) -> Driver {
    let (mean, spread) = ([8.0, 8.5, 0.3, 14.0], [3.0, 3.5, 1.2, 5.0]);
    let scaling = Scaling { mean, spread, low: [0.0; 4], high: [40.0; 4], motion: None };
    Driver::new(shape, scaling, initial_weights(shape.layout(), 1)).expect("made for the shape")
}

fn windows(count: usize) -> Vec<Window> {
    let steps = |n: usize, from: f32| (0..10).map(|t| from + ((n + t) as f32 * 0.1).sin()).collect();
    let window = |n| Window {
        follower_speed_mps: steps(n, 8.0),
        leader_speed_mps: steps(n + 3, 8.5),
        spacing_m: steps(n + 5, 14.0),
    };
    (0..count).map(window).collect()
}

/// So many windows, on one thread.
fn answer(bencher: Bencher<'_, '_>, hidden: usize, count: usize) {
    let (driver, windows) = (driver(DriverShape { hidden, ..DriverShape::PAPER }), windows(count));
    let buffers = RefCell::new((DriverBuffers::default(), vec![0.0; count]));
    bencher.counter(ItemsCount::new(count)).bench_local(|| {
        let (buffers, accel_mps2) = &mut *buffers.borrow_mut();
        driver.accelerations_into(black_box(&windows), buffers, accel_mps2);
    });
}

#[divan::bench(args = HIDDEN)]
fn one_window(bencher: Bencher<'_, '_>, hidden: usize) {
    answer(bencher, hidden, 1);
}

#[divan::bench(args = HIDDEN)]
fn windows_together(bencher: Bencher<'_, '_>, hidden: usize) {
    answer(bencher, hidden, 480);
}

/// The newest step of a vehicle's overlapping windows, with each kind of inputs.
#[divan::bench(args = [Features::Raw, Features::Motion])]
fn sequence_step(bencher: Bencher<'_, '_>, features: Features) {
    let driver = driver(DriverShape { features, ..DriverShape::PAPER });
    let mut sequence = driver.sequence();
    bencher.bench_local(|| driver.next_acceleration(&mut sequence, black_box(SEEN)));
}

/// 100 steps behind a given leader.
#[divan::bench(args = [Memory::Window, Memory::Carried])]
fn simulation(bencher: Bencher<'_, '_>, memory: Memory) {
    let driver = driver(DriverShape { memory, ..DriverShape::PAPER });
    let (initial, leader) = (windows(1).remove(0), [8.5; 100]);
    bencher.counter(ItemsCount::new(leader.len())).bench_local(|| driver.simulate(&initial, black_box(&leader), None));
}
