//! The protocol on recorded events: how many, and where the thirds part.
//!
//! They are not part of the project: `HEADWAY_RECORDED_DATA` names the folder that holds them.

#![expect(clippy::print_stderr, reason = "tells what was not there to look at")]

use std::path::PathBuf;

use serde_json::json;

use crate::runs::{report, reproduce};

#[test]
fn the_protocol_has_its_events_and_its_thirds() {
    let data = std::env::var_os("HEADWAY_RECORDED_DATA").map_or_else(|| PathBuf::from("../shared/data"), PathBuf::from);
    let data = std::path::absolute(data).unwrap();
    let names = ["waymo", "ngsim_i80", "openacc_zalazone", "napoli"];
    let files: Vec<_> = names.iter().map(|name| data.join(format!("{name}.parquet"))).collect();
    let splits = ["protocol_random.csv", "protocol_by_run.csv"].map(|name| data.join(name));
    if let Some(absent) = files.iter().chain(&splits).find(|path| !path.exists()) {
        eprintln!("skipped: {} is not there; set HEADWAY_RECORDED_DATA", absent.display());
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let quick = [
        "--methods",
        "naive",
        "--seeds",
        "1",
        "--hidden",
        "1",
        "--epochs",
        "1",
        "--resamples",
        "1",
        "--no-figures",
        "--no-references",
    ];
    let run = |arguments: &[&std::ffi::OsStr]| {
        let mut command = reproduce(folder.path(), &quick);
        let output = command.arg("--events").args(&files).args(arguments).output().unwrap();
        report(folder.path(), &output)
    };
    let mut reports: Vec<_> = splits.iter().map(|path| run(&["--splits".as_ref(), path.as_os_str()])).collect();
    reports.push(run(&[]));
    reports.push(run(&["--split".as_ref(), "run".as_ref()]));
    for report in &reports {
        assert_eq!((&report["events"], &report["tasks"]), (&json!(4371), &json!(["fast", "middle", "slow"])));
        let edges: Vec<_> = report["split_mps"].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect();
        assert!((edges[0] - 7.84).abs() < 0.005 && (edges[1] - 11.90).abs() < 0.005, "{edges:?}");
    }
    for report in &reports {
        for task in report["protocol"]["tasks"].as_array().unwrap() {
            let counts = ["train", "validation", "test"].map(|side| task[side].as_i64().unwrap());
            assert!(
                (1019..=1021).contains(&counts[0]) && counts[1..].iter().all(|n| (218..=219).contains(n)),
                "{task}"
            );
        }
    }
    let leaks: Vec<_> =
        reports.iter().map(|report| report["protocol"]["runs_on_several_sides"].as_i64().unwrap()).collect();
    assert!(leaks[0] > 200 && leaks[1] == 0 && leaks[2] > 200 && leaks[3] == 0, "{leaks:?}");
}
