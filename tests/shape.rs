//! The shape of the code: layers point downwards, files and functions stay short, words stay where they belong.
//!
//! `tests/shape/rules.rs` holds the rules; the second half of this file shows that each of them can fail.

#[path = "shape/rules.rs"]
mod rules;
#[path = "shape/source.rs"]
mod source;

use std::fs;
use std::path::Path;

use rules::File;

/// Lines of a file. Hold it by splitting the idea, not the text.
const FILE_LINES: usize = 500;

/// Lines of a function: a screen.
const FUNCTION_LINES: usize = 70;

/// Every Rust file below the given directories of the project.
fn files(directories: &[&str]) -> Vec<File> {
    fn gather(root: &Path, directory: &Path, found: &mut Vec<File>) {
        for entry in fs::read_dir(directory).into_iter().flatten() {
            let path = entry.expect("the project can be read").path();
            if path.is_dir() {
                gather(root, &path, found);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                let inner = path.strip_prefix(root).expect("it is below the root");
                let parts: Vec<_> = inner.iter().map(|part| part.to_string_lossy()).collect();
                found.push(File { path: parts.join("/"), text: fs::read_to_string(&path).expect("sources are UTF-8") });
            }
        }
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut found = Vec::new();
    for directory in directories {
        gather(root, &root.join(directory), &mut found);
    }
    found.sort_by(|a, b| a.path.cmp(&b.path));
    found
}

fn assert_none(violations: &[String]) {
    assert!(violations.is_empty(), "{} violations:\n{}", violations.len(), violations.join("\n"));
}

#[test]
fn layers_point_downwards() {
    let files = files(&["src"]);
    let lib = files.iter().find(|file| file.path == "src/lib.rs").expect("the library has a root");
    let layers = rules::layers(&lib.text);
    assert!(layers.len() > 10, "lib.rs declares the layers: {layers:?}");
    assert_none(&files.iter().flat_map(|file| rules::upward_uses(&layers, file)).collect::<Vec<_>>());
}

#[test]
fn files_and_functions_are_short() {
    let files = files(&["src", "tests", "examples"]);
    let long_files = files.iter().filter_map(|file| rules::long_file(file, FILE_LINES));
    let long_functions = files.iter().flat_map(|file| rules::long_functions(file, FUNCTION_LINES));
    assert_none(&long_files.chain(long_functions).collect::<Vec<_>>());
}

#[test]
fn sql_lives_in_the_store_alone() {
    assert_none(&files(&["src"]).iter().flat_map(rules::sql_outside_store).collect::<Vec<_>>());
}

#[test]
fn status_codes_live_in_http_alone() {
    assert_none(&files(&["src"]).iter().flat_map(rules::status_code_outside_http).collect::<Vec<_>>());
}

#[test]
fn changes_over_http_are_made_in_somebodys_name() {
    assert_none(&files(&["src"]).iter().flat_map(rules::nameless_changes).collect::<Vec<_>>());
}

#[test]
fn no_module_is_a_drawer() {
    assert_none(&files(&["src", "tests"]).iter().flat_map(rules::drawers).collect::<Vec<_>>());
}

#[test]
fn every_file_says_what_it_is() {
    assert_none(&files(&["src"]).iter().filter_map(rules::undocumented).collect::<Vec<_>>());
}

/// Each rule against code that keeps it and code that breaks it.
mod the_rules_can_fail {
    use super::rules::{self, File};
    use super::source::Source;

    fn file(path: &str, text: &str) -> File {
        File { path: path.to_owned(), text: text.to_owned() }
    }

    #[test]
    fn upward_uses_are_found_in_every_spelling() {
        let layers = rules::layers("/// Low.\npub mod low;\n/// High.\npub mod high;\nmod hidden;");
        assert_eq!(layers, ["low", "high"]);
        let breaks = |path: &str, text: &str| rules::upward_uses(&layers, &file(path, text)).len();
        assert_eq!(breaks("src/low/a.rs", "use crate::high::Thing;"), 1);
        assert_eq!(breaks("src/low.rs", "fn f() -> crate::high::Thing { crate::high::thing() }\n"), 1, "one a line");
        assert_eq!(breaks("src/low/mod.rs", "use crate::{low::A, high::{B, C}};"), 1);
        assert_eq!(breaks("src/low/a.rs", "use super::super::high;"), 1);
        assert_eq!(breaks("src/low/mod.rs", "pub use super::high::B;"), 1);
        assert_eq!(breaks("src/low/a.rs", "use super::high;"), 0, "a submodule of low by that name");
        assert_eq!(breaks("src/low/a.rs", "use crate::low::{high, B};"), 0);
        assert_eq!(breaks("src/low/a.rs", "// crate::high\nlet s = \"crate::high\";"), 0);
        assert_eq!(breaks("src/high/a.rs", "use crate::low::A;"), 0);
        assert_eq!(breaks("src/main.rs", "use crate::high::A;"), 0);
    }

    #[test]
    fn long_files_and_functions_are_found() {
        assert!(rules::long_file(&file("src/a.rs", &"x\n".repeat(4)), 3).is_some());
        assert!(rules::long_file(&file("src/a.rs", &"x\n".repeat(3)), 3).is_none());
        let function = "/// }\nfn f(a: [u8; 2]) -> u8\nwhere\n{\n  let brace = '{';\n  a[0]\n}\nfn g() {}\n";
        assert_eq!(rules::long_functions(&file("src/a.rs", function), 5), ["src/a.rs:2: f has 6 lines, more than 5"]);
        assert!(rules::long_functions(&file("src/a.rs", function), 6).is_empty());
        let declared = "trait T {\n  fn f(&self);\n  fn g(&self);\n}\ntype F = fn(u8)\n-> u8;\n";
        assert!(rules::long_functions(&file("src/a.rs", declared), 1).is_empty());
        let nested = "impl T {\n  fn f() {\n    fn g() {\n    }\n  }\n}\n";
        assert_eq!(rules::long_functions(&file("src/a.rs", nested), 1).len(), 2);
    }

    #[test]
    fn sql_and_status_codes_out_of_place_are_found() {
        let sql = |path: &str, text: &str| rules::sql_outside_store(&file(path, text)).len();
        for statement in
            ["select a from b", "insert into b (a) values (?)", "UPDATE b\n SET a = 1", "delete from b", "pragma x = 1"]
        {
            assert_eq!(sql("src/ingest/a.rs", &format!("f(\"{statement}\")")), 1, "{statement}");
            assert_eq!(sql("src/ingest/a.rs", &format!("f(r#\"{statement}\"#)")), 1, "{statement}");
            assert_eq!(sql("src/store/a.rs", &format!("f(\"{statement}\")")), 0);
        }
        assert_eq!(sql("src/ingest/a.rs", "use sqlx::Row;"), 1);
        assert_eq!(sql("src/ingest/a.rs", "// select a from b\nf(\"select one of these; update your client\")"), 0);
        let codes = |path: &str| rules::status_code_outside_http(&file(path, "StatusCode::OK")).len();
        assert_eq!([codes("src/store/a.rs"), codes("src/http/a.rs")], [1, 0]);
        let nameless = |path: &str, text: &str| rules::nameless_changes(&file(path, text)).len();
        assert_eq!(nameless("src/http/a.rs", "app.store.begin().await"), 1);
        assert_eq!(nameless("src/http/a.rs", "app.store.begin_for(&by).await"), 0);
        assert_eq!(nameless("src/scheduler/a.rs", "app.store.begin().await"), 0);
    }

    #[test]
    fn drawers_and_silent_files_are_found() {
        assert_eq!(rules::drawers(&file("src/store/utils.rs", "")).len(), 1);
        assert_eq!(rules::drawers(&file("src/common/a.rs", "mod helpers {}")).len(), 2);
        assert_eq!(rules::drawers(&file("src/store/batches.rs", "mod tests {}")).len(), 0);
        assert!(rules::undocumented(&file("src/store/mod.rs", "mod a;")).is_some());
        assert!(rules::undocumented(&file("src/store/mod.rs", "//! Batches.\nmod a;")).is_none());
    }

    #[test]
    fn literals_and_comments_are_told_from_code() {
        let text = "a /* b /* c */ \" */ 'd' '\\'' 'e r\"f\\\" br#\"g\"h\"# \"i\\\"j\" // k\n\"l\nm\" n";
        let source = Source::scan(text);
        let code: Vec<(usize, &str)> = source.words();
        assert_eq!(code, [(1, "a"), (1, "'"), (1, "e"), (1, "b"), (3, "n")]);
        let strings: Vec<(usize, &str)> = source.strings.iter().map(|(line, text)| (*line, text.as_str())).collect();
        assert_eq!(strings, [(1, "f\\"), (1, "g\"h"), (1, "i\\\"j"), (2, "l\nm")]);
    }
}
