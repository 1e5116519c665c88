//! What cannot be reproduced is said, with what is missing and where.

use std::fs;

use crate::runs::{csv, reproduce, told};

#[test]
fn bad_input_is_refused_with_what_is_missing() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    let all = csv(12, |_, _| 0.0);
    let rows = |wanted: &dyn Fn(&str) -> bool| {
        let lines = all.lines().enumerate().filter(|(number, line)| *number == 0 || wanted(line));
        lines.map(|(_, line)| line.to_owned() + "\n").collect::<String>()
    };
    let first = all.lines().nth(1).unwrap().split(',').next().unwrap();
    write("good.csv", &all);
    write("one.csv", &rows(&|line| line.starts_with(&format!("{first},"))));
    let still = |line: &str| {
        let mut cells: Vec<_> = line.split(',').collect();
        (cells[4], cells[5], cells[6]) = ("20", "8", "8");
        cells.join(",")
    };
    let constant: Vec<_> = all.lines().enumerate().map(|(n, l)| if n == 0 { l.to_owned() } else { still(l) }).collect();
    write("constant.csv", &constant.join("\n"));
    write("columns.csv", "event_id,t,spacing,lv_speed\na,0.0,1,2\n");
    write("garbage.parquet", "this is no Parquet");
    write("events.xml", "");
    write("absent_event.csv", "event_id,task,split\nnobody,1,train\n");
    write("no_column.csv", "event_id,task\na,1\n");
    write("bad_side.csv", &format!("event_id,task,split\n{first},1,training\n"));
    write("one_event.csv", &format!("event_id,task,split\n{first},1,train\n"));
    for (arguments, reason) in [
        (&["--events", "one.csv"][..], "1 events cannot make 3 tasks"),
        (&["--events", "one.csv", "--tasks", "source"], "only one source is named (fast)"),
        (&["--events", "constant.csv"], "task fast is empty, since the speeds, from 8.000 to 8.000 m/s"),
        (&["--events", "columns.csv"], "column sv_speed of preset follownet is missing"),
        (&["--events", "garbage.parquet"], "cannot read garbage.parquet"),
        (&["--events", "absent.csv"], "cannot read absent.csv"),
        (&["--events", "events.xml"], ".parquet, .csv, .json and .ndjson"),
        (&["--events", "good.csv", "--steps", "500"], "no event is left: 36 of good.csv: shorter than 500 steps"),
        (&["--events", "good.csv", "--steps", "5"], "--steps: 5 is not within"),
        (&["--events", "good.csv", "--methods", "ewc,best"], "--methods: \"best\" is no method"),
        (&["--events", "good.csv", "--methods", ""], "--methods: at least one is needed"),
        (&["--events", "good.csv", "--seeds", ""], "--seeds: at least one is needed"),
        (&["--events", "good.csv", "--seeds", "1,x"], "--seeds: \"x\" is not a whole number"),
        (&["--events", "good.csv", "--set", "hiden=3"], "setting hiden: unknown"),
        (&["--events", "good.csv", "--preset", "papers"], "setting preset:"),
        (&["--events", "good.csv", "--set", "preset=paper"], "--set preset: --preset says it"),
        (&["--events", "good.csv", "--set", "estimator=empirical"], "method mas: setting estimator:"),
        (&["--events", "good.csv", "--hidden", "0"], "setting hidden: 0 is not within"),
        (&["--events", "good.csv", "--order", "fast,slow"], "the tasks are fast, middle, slow"),
        (&["--events", "good.csv", "--tasks", "1"], "--tasks: \"1\" is neither a number from 2"),
        (&["--events", "good.csv", "--tasks", "19"], "36 events cannot make 19 tasks"),
        (&["--events", "good.csv", "--strength", "naive=1"], "naive consolidates nothing"),
        (&["--events", "good.csv", "--strength", "ewc=much"], "\"much\" is not a number"),
        (
            &["--events", "good.csv", "--splits", "absent_event.csv"],
            "1 of its 1 events are not among those of --events",
        ),
        (&["--events", "good.csv", "--splits", "no_column.csv"], "column split is missing"),
        (&["--events", "good.csv", "--splits", "bad_side.csv"], "row 1: split \"training\" is none of"),
        (
            &["--events", "good.csv", "--splits", "one_event.csv"],
            "task 1 has 1 event of 1 runs, and none of them is for test",
        ),
    ] {
        let steps = if arguments.contains(&"--steps") { &[][..] } else { &["--steps", "40"] };
        let output = reproduce(folder.path(), steps).args(arguments).output().unwrap();
        assert!(!output.status.success() && output.stdout.is_empty(), "{arguments:?}: {}", told(&output));
        assert!(told(&output).contains(reason), "{arguments:?}: {}", told(&output));
        assert!(!told(&output).contains("backtrace"), "for a person: {}", told(&output));
    }
    assert!(!folder.path().join("out").exists(), "nothing is written before the input is known to be good");
}
