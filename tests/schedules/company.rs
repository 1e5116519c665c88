use std::sync::Arc;

use futures_util::future::join_all;
use shuttle::future::{block_on, spawn};

use crate::predictor::{Company, Loaded, PredictError, ask};
use crate::store::Work;
use crate::try_orders;

/// Two requests of one version and one of another, with room for all of them but one.
fn three_requests() {
    let (company, work) = (Company::new(3), Arc::new(Work::default()));
    let versions = [Arc::new(Loaded::new(1, &work)), Arc::new(Loaded::new(2, &work))];
    let requests = [(0, vec![10]), (1, vec![20]), (0, vec![30, 31])].map(|(version, numbers)| {
        let (company, loaded) = (company.clone(), Arc::clone(&versions[version]));
        spawn(async move {
            let windows = numbers.iter().copied().map(ask).collect();
            let answer = company.predict(Arc::clone(&loaded), windows).await;
            (loaded.version(), numbers, answer)
        })
    });
    block_on(async {
        let mut refused = 0;
        for request in join_all(requests).await {
            let (version, numbers, answer) = request.unwrap();
            let expected: Vec<_> = numbers.iter().map(|&number| (f32::from(number), version as f32)).collect();
            match answer {
                Ok(answers) => {
                    let told: Vec<_> = answers.iter().map(|one| (one.accel_mps2, one.raw_accel_mps2)).collect();
                    assert_eq!(told, expected);
                    assert!(numbers.iter().all(|&number| work.times(number) == 1), "computed once");
                }
                Err(PredictError::Busy) => refused += 1,
                Err(error) => panic!("{error}"),
            }
        }
        assert!(refused <= 1, "two of them fit");
        assert_eq!(company.waiting(), (0, false));
    });
}

#[test]
fn each_of_three_requests_is_answered_its_own_and_at_most_one_is_refused() {
    try_orders(three_requests);
}
