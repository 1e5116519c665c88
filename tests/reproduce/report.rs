//! What the report says.

use std::fs;

use serde_json::{Value, json};

use crate::runs::{SMALL, csv, folder, report, reproduce, told};

fn numbers(matrix: &Value) -> Vec<Vec<f64>> {
    let row = |row: &Value| row.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect();
    matrix.as_array().unwrap().iter().map(row).collect()
}

#[test]
fn every_method_has_full_tables_and_stage_one_is_one() {
    let folder = folder(20);
    let methods = "joint,naive,ewc,mas,si,replay,replay_ewc,replay_mas";
    let output = reproduce(folder.path(), &["--events", "events.csv", "--json", "--no-safety", "--methods", methods])
        .args(SMALL)
        .output()
        .unwrap();
    let report = report(folder.path(), &output);
    assert_eq!(serde_json::from_slice::<Value>(&output.stdout).unwrap(), report, "--json prints the report");
    assert_eq!((&report["events"], &report["seeds"]), (&json!(60), &json!([1, 2])));
    assert_eq!(report["tasks"], json!(["fast", "middle", "slow"]));
    assert!(report["threads"].as_u64().unwrap() >= 1);
    let [low, high] = [0, 1].map(|edge| report["split_mps"][edge].as_f64().unwrap());
    assert!(low < high, "{low} {high}");
    for (name, method) in report["methods"].as_object().unwrap() {
        let stages = if name == "joint" { 1 } else { 3 };
        for table in ["spacing_mse", "speed_mse", "collision_rate_percent"] {
            let mean = numbers(&method[table]);
            assert_eq!((mean.len(), mean[0].len()), (stages, 3), "{name} {table}");
            let seeds = [0, 1].map(|seed| numbers(&method["per_seed"][seed][table]));
            for (stage, row) in mean.iter().enumerate() {
                for (task, cell) in row.iter().enumerate() {
                    let half = f64::midpoint(seeds[0][stage][task], seeds[1][stage][task]);
                    assert!((cell - half).abs() <= 1e-9 * half.abs(), "{name} {table}: the mean over seeds");
                }
            }
        }
        what_is_served_is_told(name, method, stages);
        let consolidates = !["joint", "naive", "replay"].contains(&name.as_str());
        assert_eq!(method["strength"].is_number(), consolidates, "{name}");
        let lambda: Vec<_> = method["lambda"].as_array().into_iter().flatten().map(Value::is_number).collect();
        assert_eq!(lambda, if consolidates { vec![false, true, true] } else { Vec::new() }, "{name}");
        assert!(method["train_events_per_s"].as_f64().unwrap() > 0.0);
        assert_eq!(method["search"].is_object(), consolidates, "{name}");
        if consolidates {
            the_best_candidate_was_taken(method);
        }
    }
    let first = |method: &str| report["methods"][method]["per_seed"][0]["weights_sha256"][0].clone();
    for method in ["ewc", "mas", "si", "replay", "replay_ewc", "replay_mas"] {
        assert_eq!(first("naive"), first(method), "{method}");
    }
    let compared: Vec<_> =
        report["comparisons"].as_array().unwrap().iter().map(|c| (&c["model"], &c["baseline"])).collect();
    assert!(compared.contains(&(&json!("ewc"), &json!("naive"))), "{compared:?}");
    for (name, reference) in report["references"].as_object().unwrap() {
        for table in ["spacing_mse", "speed_mse", "collision_rate_percent"] {
            assert_eq!(reference[table].as_array().unwrap().len(), 3, "{name} {table}");
        }
        let of_tasks = |list: &str| numbers(&json!([reference[list]])).remove(0);
        assert_eq!(of_tasks("calibration_events"), [14.0; 3], "{name}: the training events");
        let (fitted, published) = (of_tasks("spacing_mse_calibration"), of_tasks("spacing_mse_published"));
        assert!(fitted.len() == 3 && fitted.iter().all(|error| *error > 0.0), "{name}: {fitted:?}");
        let unchanged = published == of_tasks("spacing_mse");
        assert_eq!(unchanged, name == "constant", "{name}: only who has no parameters drives as before: {published:?}");
    }
    assert!(report["references"]["idm"].is_object() && report["references"]["gipps"].is_object());
    let ratio = &report["methods"]["naive"]["measures"];
    assert_eq!(ratio["plasticity_loss"], json!([1.0, 1.0, 1.0]));
}

/// Beside the errors within the envelope: how often it acts and holds, and how close drives come.
#[track_caller]
fn what_is_served_is_told(name: &str, method: &Value, stages: usize) {
    assert_eq!(numbers(&method["served"]["spacing_mse"]).len(), stages, "{name}");
    let [acted, held] = ["acted_percent", "held_percent"].map(|share| numbers(&method["served"][share]));
    assert_eq!((acted.len(), held.len()), (stages, stages), "{name}");
    let both = acted.iter().flatten().zip(held.iter().flatten()).map(|(acted, held)| acted + held);
    assert!(both.clone().count() == 3 * stages && both.into_iter().all(|percent| (0.0..=100.0).contains(&percent)));
    for driver in ["alone", "served"] {
        let closest = method["min_ttc_s"][driver].as_array().unwrap();
        assert_eq!((closest.len(), closest[0].as_array().unwrap().len()), (stages, 3), "{name} {driver}");
        for cell in closest.iter().flat_map(|row| row.as_array().unwrap()) {
            let [median, worst] = ["median", "worst"].map(|one| cell[one].as_f64().unwrap_or(f64::INFINITY));
            assert!(0.0 <= worst && worst <= median, "{name} {driver}: {cell}");
        }
    }
}

#[test]
fn tasks_are_by_speed_by_source_or_as_a_file_says_in_any_order() {
    let folder = folder(12);
    let one = ["--events", "events.csv", "--methods", "naive", "--seeds", "1", "--no-safety"];
    let small = &SMALL[..6];
    let tasks = |arguments: &[&str]| {
        let output = reproduce(folder.path(), &one).args(small).args(arguments).output().unwrap();
        let report = report(folder.path(), &output);
        (report["tasks"].clone(), report["events"].clone(), report["split_mps"].clone())
    };
    let (names, _, edges) = tasks(&["--tasks", "2"]);
    assert_eq!((names, edges.as_array().unwrap().len()), (json!(["speed-1", "speed-2"]), 1));
    let (names, _, edges) = tasks(&["--tasks", "source", "--split", "run", "--order", "slow,fast,middle"]);
    assert_eq!((names, edges), (json!(["slow", "fast", "middle"]), Value::Null));
    let mut splits = "task,event_id,split\n".to_owned();
    for line in csv(12, |_, _| 0.0).lines().skip(1).step_by(44) {
        let cells: Vec<_> = line.split(',').collect();
        let (task, run) = (["fast", "middle", "slow"].iter().position(|s| *s == cells[1]).unwrap() + 1, &cells[2]);
        let split = ["test", "train", "train", "validation", "train", "train"][run.parse::<usize>().unwrap()];
        let row = format!("{task},{},{split}\n", cells[0]);
        if task != 2 && !splits.contains(&row) {
            splits += &row;
        }
    }
    fs::write(folder.path().join("splits.csv"), splits).unwrap();
    let (names, events, edges) = tasks(&["--splits", "splits.csv", "--order", "3,1"]);
    assert_eq!((names, events), (json!(["3", "1"]), json!(24)), "what is not listed is ignored");
    assert_eq!(edges.as_array().unwrap().len(), 2);
}

#[test]
fn what_is_left_out_is_said_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let text = csv(12, |id, step| {
        let bad_early = id.ends_with("-0000") && step == 3;
        let bad_late = id.ends_with("-0001") && step == 43;
        if bad_early || bad_late { -1000.0 } else { 0.0 }
    });
    let bad = text.lines().filter(|line| line.contains(",-9")).count();
    fs::write(folder.path().join("events.csv"), text).unwrap();
    let arguments = ["--events", "events.csv", "--methods", "naive", "--seeds", "1", "--no-safety"];
    let output = reproduce(folder.path(), &arguments).args(&SMALL[..6]).output().unwrap();
    let report = report(folder.path(), &output);
    assert_eq!(bad, 6, "an early and a late one of each regime");
    assert_eq!(report["events"], json!(33), "what comes after the cut need not be right");
    let left_out = &report["protocol"]["left_out"][0];
    assert_eq!((&left_out["events"], &left_out["file"]), (&json!(3), &json!("events.csv")));
    assert!(left_out["reason"].as_str().unwrap().contains("spacing_not_positive"), "{left_out}");
    assert!(told(&output).contains("left out 3 of events.csv: refused by the physics checks"), "{}", told(&output));
}

#[test]
fn the_page_has_the_tables_and_embeds_figures_that_are_there() {
    for preset in ["best", "paper"] {
        page_is_whole(preset);
    }
}

fn page_is_whole(preset: &str) {
    let folder = folder(20);
    let output =
        reproduce(folder.path(), &["--events", "events.csv", "--methods", "joint,naive,ewc", "--preset", preset])
            .args(SMALL)
            .output();
    let report = report(folder.path(), &output.unwrap());
    let memory = if preset == "paper" { "window" } else { "carried" };
    assert_eq!((&report["preset"], &report["settings"]["memory"]), (&json!(preset), &json!(memory)));
    let page = fs::read_to_string(folder.path().join("out/report.md")).unwrap();
    for part in [
        "## Spacing error: mean squared error over simulated steps, m²",
        "| naive | fast |",
        "23.01 / 47.78 / 81.35",
        "## Methods against each other",
        "## Reference drivers",
        "on the test events with published parameters",
        "## Served, within the envelope",
        "| least TTC alone, s: median (worst) |",
        "| ewc, served |",
        "Sides: 70/15/15 at random inside each task, split_seed 0.",
        "\"collision_margin_m\"",
    ] {
        assert!(page.contains(part), "{part} is missing in:\n{page}");
    }
    let cell = format!("{:.2} (", report["methods"]["joint"]["spacing_mse"][0][1].as_f64().unwrap());
    let row = page.lines().find(|line| line.starts_with("| joint | middle |")).unwrap();
    assert!(row.contains(&cell), "{row} has the number of report.json, {cell}");
    let held = format!("{:.3}", report["methods"]["ewc"]["served"]["held_percent"][2][2].as_f64().unwrap());
    let served = page.split_once("## Served").unwrap().1.lines();
    let cell = |row: &str| {
        let row = served.clone().find(|line| line.starts_with(row)).unwrap();
        row.split(" | ").nth(6).unwrap().to_owned()
    };
    assert_eq!((cell("| method | task |"), cell("| ewc | slow |")), ("held, % of steps".to_owned(), held));
    let figures: Vec<_> = page.split("](").skip(1).map(|rest| rest.split(')').next().unwrap()).collect();
    assert_eq!(figures.len(), 7, "{figures:?}");
    for figure in figures {
        let svg = fs::read_to_string(folder.path().join("out").join(figure)).unwrap();
        assert!(svg.starts_with("<svg ") && svg.ends_with("</svg>\n"), "{figure}");
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{figure}: {svg}");
    }
    let sweep = report["lambda_sweep"]["ewc"].as_array().unwrap();
    let lambdas: Vec<_> = sweep.iter().map(|point| point["lambda"].as_f64().unwrap()).collect();
    assert!(lambdas.len() == 5 && lambdas.is_sorted_by(|a, b| a < b), "{lambdas:?}");
    assert_eq!(report["safety"].as_array().unwrap().len(), 7, "three methods alone and served, and the IDM");
}

/// By the rule that the report states: fewest collisions, within 5 % of the least cost, within 5 % of the least worse end of
/// the front, the strongest.
fn the_best_candidate_was_taken(method: &Value) {
    let search = &method["search"];
    let candidates = search["candidates"].as_array().unwrap();
    assert_eq!(candidates.len(), 5);
    let number = |candidate: &Value, name: &str| candidate[name].as_f64().unwrap();
    let collisions = |candidate: &Value| number(candidate, "collisions");
    let cost = |candidate: &Value| number(candidate, "cost");
    let worse =
        |candidate: &Value| number(candidate, "forgetting_ratio").max(number(candidate, "plasticity_loss")).max(1.0);
    let mut left: Vec<&Value> = candidates.iter().collect();
    for (measure, slack) in [(&collisions as &dyn Fn(&Value) -> f64, 1.0), (&cost, 1.05), (&worse, 1.05)] {
        let limit = slack * left.iter().map(|c| measure(c)).reduce(f64::min).unwrap();
        left.retain(|c| measure(c) <= limit);
    }
    let strongest = left.iter().map(|c| number(c, "strength")).reduce(f64::max);
    assert_eq!(strongest, search["chosen"].as_f64(), "{search}");
    assert_eq!(method["strength"], search["chosen"]);
    assert_eq!(search["seeds"].as_array().unwrap().len(), 2, "both seeds were asked: {search}");
    let costs: std::collections::BTreeSet<_> = candidates.iter().map(|c| c["cost"].to_string()).collect();
    assert!(costs.len() > 1, "strengths make a difference: {costs:?}");
}
