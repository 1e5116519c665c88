//! What cannot be reproduced is said, with what is missing and where.

use std::fs;
use std::path::Path;

use crate::runs::{csv, reproduce, told};

/// Runs it with each of these arguments: it says the reason, for a person, and has written nothing.
fn refused(folder: &Path, cases: &[(&[&str], &str)]) {
    for (arguments, reason) in cases {
        let steps = if arguments.contains(&"--steps") { &[][..] } else { &["--steps", "40"] };
        let output = reproduce(folder, steps).args(*arguments).output().unwrap();
        assert!(!output.status.success() && output.stdout.is_empty(), "{arguments:?}: {}", told(&output));
        assert!(told(&output).contains(reason), "{arguments:?}: {}", told(&output));
        assert!(!told(&output).contains("backtrace"), "for a person: {}", told(&output));
    }
    assert!(!folder.join("out").exists(), "nothing is written before the input is known to be good");
}

/// A folder with these files.
fn holding(files: &[(&str, &str)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in files {
        fs::write(folder.path().join(name), text).unwrap();
    }
    folder
}

/// The same rows, each changed.
fn changed(csv: &str, change: impl Fn(&mut [String])) -> String {
    let (head, rows) = csv.split_once('\n').unwrap();
    let row = |row: &str| {
        let mut cells: Vec<_> = row.split(',').map(str::to_owned).collect();
        change(&mut cells);
        cells.join(",") + "\n"
    };
    format!("{head}\n{}", rows.lines().map(row).collect::<String>())
}

/// The same without the rows that `left` does not want.
fn only(csv: &str, left: impl Fn(&str) -> bool) -> String {
    let lines = csv.lines().enumerate().filter(|(number, line)| *number == 0 || left(line));
    lines.map(|(_, line)| line.to_owned() + "\n").collect()
}

#[test]
fn files_without_what_is_needed_are_refused_with_what_is_missing() {
    let all = csv(12, |_, _| 0.0);
    let at_speed = |cells: &mut [String], speed: &str| {
        (cells[4], cells[5], cells[6]) = ("20".to_owned(), speed.to_owned(), speed.to_owned());
    };
    let constant = changed(&all, |cells| at_speed(cells, "8"));
    let steady = changed(&all, |cells| {
        let digits: String = cells[0].chars().filter(char::is_ascii_digit).collect();
        at_speed(cells, &format!("{}.{digits}", cells[0].len()));
    });
    let lone = changed(&only(&all, |line| line.starts_with("fast-5-0000,")), |cells| {
        (cells[0], cells[1]) = ("lone".to_owned(), "site".to_owned());
    });
    let folder = holding(&[
        ("one.csv", &only(&all, |line| line.starts_with("fast-5-0000,"))),
        ("five.csv", &only(&all, |line| line.starts_with("fast-5-000") && line[..11] < *"fast-5-0005")),
        ("lone.csv", &(all.clone() + lone.split_once('\n').unwrap().1)),
        ("constant.csv", &constant),
        ("steady.csv", &steady),
        ("good.csv", &all),
        ("columns.csv", "event_id,t,spacing,lv_speed\na,0.0,1,2\n"),
        ("two_columns.csv", "event_id,t,spacing\na,0.0,1\n"),
        ("no_event_id.csv", "t,spacing,sv_speed,lv_speed\n0.0,1,2,3\n"),
        ("no_spacing.csv", "event_id,follower_speed_mps,leader_speed_mps\na,2,3\n"),
        ("other_column.csv", "event_id,spacing,sv_speed,lv_speed,mood\na,1,2,3,4\n"),
        ("no_rows.csv", "event_id,t,spacing,sv_speed,lv_speed\n"),
        ("empty.csv", ""),
        ("empty.parquet", ""),
        ("garbage.parquet", "this is no Parquet"),
        ("events.xml", ""),
    ]);
    refused(
        folder.path(),
        &[
            (&["--events", "one.csv"], "1 event in 1 file: 1 events cannot make 3 tasks"),
            (
                &["--events", "five.csv"],
                "5 events cannot make 3 tasks: each needs events to learn from and events to be tested",
            ),
            (&["--events", "one.csv", "--tasks", "source"], "only one source is named (fast)"),
            (
                &["--events", "lone.csv", "--tasks", "source"],
                "task site has 1 event of 1 runs, and none of them is for training",
            ),
            (&["--events", "constant.csv"], "task fast is empty, since the speeds, from 8.000 to 8.000 m/s"),
            (
                &["--events", "steady.csv"],
                "task fast has 8 training events in which no speed changes: nothing to learn",
            ),
            (&["--events", "columns.csv"], "cannot read columns.csv: column sv_speed of preset follownet is missing"),
            (&["--events", "two_columns.csv"], "columns sv_speed, lv_speed of preset follownet are missing"),
            (
                &["--events", "no_event_id.csv"],
                "cannot read no_event_id.csv: column event_id of preset follownet is missing",
            ),
            (
                &["--events", "no_spacing.csv"],
                "cannot read no_spacing.csv: column spacing_m of preset headway is missing",
            ),
            (&["--events", "other_column.csv"], "unknown column \"mood\"; preset follownet knows"),
            (&["--events", "no_rows.csv"], "no event is left: no_rows.csv holds none"),
            (&["--events", "empty.csv"], "cannot read empty.csv: it is empty"),
            (&["--events", "good.csv", "empty.parquet"], "cannot read empty.parquet: it is empty"),
            (&["--events", "garbage.parquet"], "cannot read garbage.parquet"),
            (&["--events", "absent.csv"], "cannot read absent.csv"),
            (&["--events", "events.xml"], ".parquet, .csv, .json and .ndjson"),
        ],
    );
}

#[test]
fn a_splits_file_that_does_not_fit_is_refused_with_the_event_the_row_or_the_column() {
    let all = csv(12, |_, _| 0.0);
    let places = |of: &[(&str, u32, &str)]| {
        let rows = of.iter().map(|(event, task, side)| format!("{event},{task},{side}\n"));
        "event_id,task,split\n".to_owned() + &rows.collect::<String>()
    };
    let [one, two] = ["fast-5-0000", "slow-5-0000"];
    let folder = holding(&[
        ("good.csv", &all),
        ("absent_event.csv", &places(&[(one, 1, "train"), (two, 2, "train"), ("nobody", 1, "train")])),
        ("twice.csv", &places(&[(one, 1, "train"), (two, 2, "train"), (one, 2, "test")])),
        ("bad_side.csv", &places(&[(one, 1, "train"), (two, 2, "training")])),
        ("one_event.csv", &places(&[(one, 1, "train"), (two, 2, "train")])),
        ("one_task.csv", &places(&[(one, 1, "train"), (two, 1, "test")])),
        ("no_event_id.csv", "task,split\n1,train\n"),
        ("no_task.csv", "event_id,split\na,train\n"),
        ("no_split.csv", "event_id,task\na,1\n"),
        ("no_rows.csv", "event_id,task,split\n"),
        ("empty.csv", ""),
    ]);
    for (splits, reason) in [
        ("absent_event.csv", "1 of its 3 events are not among those of --events that can be used: nobody\n"),
        ("twice.csv", "--splits twice.csv: it lists event fast-5-0000 twice"),
        ("bad_side.csv", "row 2: split \"training\" is none of train, validation and test"),
        ("one_event.csv", "task 1 has 1 event of 1 runs, and none of them is for test"),
        ("one_task.csv", "all its events are of task 1: two tasks are needed at least"),
        ("no_event_id.csv", "column event_id is missing; it has task, split"),
        ("no_task.csv", "column task is missing; it has event_id, split"),
        ("no_split.csv", "column split is missing; it has event_id, task"),
        ("no_rows.csv", "--splits no_rows.csv: it lists no event"),
        ("empty.csv", "--splits empty.csv: it is empty"),
        ("absent.csv", "--splits absent.csv: No such file"),
    ] {
        refused(folder.path(), &[(&["--events", "good.csv", "--splits", splits], reason)]);
    }
    let bad = csv(12, |id, _| if id == one { -1000.0 } else { 0.0 });
    fs::write(folder.path().join("bad.csv"), bad).unwrap();
    let why = "1 of its 2 events are not among those of --events that can be used: fast-5-0000 (left out of --events: 1 of bad.csv: refused by the physics checks";
    refused(folder.path(), &[(&["--events", "bad.csv", "--splits", "one_event.csv"], why)]);
}

#[test]
fn arguments_that_mean_nothing_are_refused_by_name() {
    let folder = holding(&[("good.csv", &csv(12, |_, _| 0.0)), ("a_file", "")]);
    for (arguments, reason) in [
        (&["--steps", "5"][..], "--steps: 5 is not within"),
        (&["--steps", "500"], "no event is left: 36 of good.csv: shorter than 500 steps"),
        (&["--methods", "ewc,best"], "--methods: \"best\" is no method"),
        (&["--methods", ""], "--methods: at least one is needed"),
        (&["--seeds", ""], "--seeds: at least one is needed"),
        (&["--seeds", "1,x"], "--seeds: \"x\" is not a whole number"),
        (&["--seeds=-1"], "--seeds: \"-1\" is not a whole number"),
        (&["--seeds", "1,1"], "--seeds: 1 is there twice"),
        (&["--set", "hiden=3"], "setting hiden: unknown"),
        (&["--preset", "papers"], "setting preset:"),
        (&["--set", "preset=paper"], "--set preset: --preset says it"),
        (&["--set", "estimator=empirical"], "method mas: setting estimator:"),
        (&["--hidden", "0"], "setting hidden: 0 is not within"),
        (&["--order", "fast,slow"], "--order: the order names fast, slow, but the tasks are fast, middle, slow"),
        (&["--order", "fast,medium,slow"], "the order names fast, medium, slow, but the tasks are fast, middle, slow"),
        (&["--order", ""], "the order names nothing, but the tasks are fast, middle, slow"),
        (&["--tasks", "0"], "--tasks: \"0\" is neither a number from 2 to 20 nor source"),
        (&["--tasks", "1"], "--tasks: \"1\" is neither a number from 2"),
        (&["--tasks", "19"], "36 events cannot make 19 tasks"),
        (&["--strength", "naive=1"], "naive consolidates nothing"),
        (&["--strength", "si=1"], "--strength: si is not among --methods"),
        (&["--strength", "foo=1"], "--strength: \"foo\" is no method"),
        (&["--strength", "ewc=much"], "\"much\" is not a number"),
        (&["--strength", "ewc=-1"], "--strength ewc=-1: a number from 0 on is needed"),
        (&["--lambda", "ewc=inf"], "--lambda ewc=inf: a number from 0 on is needed"),
    ] {
        refused(folder.path(), &[(&[&["--events", "good.csv"], arguments].concat(), reason)]);
    }
}

#[test]
fn a_folder_that_cannot_be_written_to_is_said_before_anything_is_learned() {
    let folder = holding(&[("good.csv", &csv(12, |_, _| 0.0)), ("out", "")]);
    let output = reproduce(folder.path(), &["--events", "good.csv", "--steps", "40"]).output().unwrap();
    assert!(!output.status.success() && output.stdout.is_empty());
    assert!(told(&output).contains("cannot make out/stages"), "{}", told(&output));
}
