//! Predicting without allocating. Alone in its process: it counts what the process allocates.

use allocation_counter::measure;
use headway::driver::{Driver, DriverBuffers, DriverShape, Features, Scaling, Seen, Window};
use headway::lstm::initial_weights;

fn driver(features: Features) -> Driver {
    let shape = DriverShape { hidden: 128, features, ..DriverShape::PAPER };
    let (mean, spread) = ([8.0, 8.5, 0.3, 14.0], [3.0, 3.5, 1.2, 5.0]);
    let scaling = Scaling { mean, spread, low: [0.0; 4], high: [40.0; 4], motion: None };
    Driver::new(shape, scaling, initial_weights(shape.layout(), 1)).expect("the weights fit")
}

fn window(driver: &Driver) -> Window {
    let steps = |from: f32| (0..driver.shape().horizon).map(|t| from + t as f32 * 0.1).collect();
    Window { follower_speed_mps: steps(8.0), leader_speed_mps: steps(9.0), spacing_m: steps(15.0) }
}

#[test]
fn a_window_is_answered_without_allocating_once_a_thread_has_its_buffers() {
    let (driver, other) = (driver(Features::Raw), driver(Features::Motion));
    let windows = [window(&driver)];
    let mut buffers = DriverBuffers::default();
    let mut answer = |driver: &Driver| {
        let mut accel_mps2 = [f32::NAN];
        driver.accelerations_into(&windows, &mut buffers, &mut accel_mps2);
        assert!(accel_mps2[0].is_finite());
    };
    let first = measure(|| answer(&other));
    assert!(first.count_total > 0, "the buffers grow, and that is counted: {first:?}");
    let later = measure(|| (0..10).for_each(|_| [&driver, &other].into_iter().for_each(&mut answer)));
    assert_eq!(later.count_total, 0, "{later:?}");
    let convenient = measure(|| drop(driver.accelerations(&windows)));
    assert!(convenient.count_total > 0, "{convenient:?}");
}

#[test]
fn a_step_of_a_sequence_is_answered_without_allocating() {
    for features in [Features::Raw, Features::Motion] {
        let driver = driver(features);
        let mut sequence = driver.sequence();
        let steps = measure(|| {
            for t in 0..30_u8 {
                let leader_speed_mps = 8.0 + f32::from(t) * 0.1;
                let seen = Seen { follower_speed_mps: 8.0, leader_speed_mps, spacing_m: 20.0 };
                assert!(driver.next_acceleration(&mut sequence, seen).is_finite());
            }
        });
        assert_eq!(steps.count_total, 0, "{steps:?}");
    }
}
