//! The rules: each takes sources and gives what breaks it, one sentence a violation.

use std::collections::BTreeSet;

use crate::source::Source;

/// A file of the project: its path from the root, with `/`, and its text.
pub(crate) struct File {
    pub(crate) path: String,
    pub(crate) text: String,
}

/// Modules that `lib.rs` declares, lowest layer first.
pub(crate) fn layers(lib: &str) -> Vec<String> {
    let source = Source::scan(lib);
    let words = source.words();
    words.windows(3).filter(|w| w[0].1 == "pub" && w[1].1 == "mod").map(|w| w[2].1.to_owned()).collect()
}

/// Every mention of a module from one below it. `main.rs` and `lib.rs` stand above all layers.
pub(crate) fn upward_uses(layers: &[String], file: &File) -> Vec<String> {
    let Some(inner) = file.path.strip_prefix("src/") else { return Vec::new() };
    let parts: Vec<&str> = inner.trim_end_matches(".rs").split('/').filter(|part| *part != "mod").collect();
    let Some(own) = layers.iter().position(|layer| layer == parts[0]) else { return Vec::new() };
    let mut found = BTreeSet::new();
    for (line, used) in used_modules(&Source::scan(&file.text), parts.len()) {
        if layers.iter().position(|layer| *layer == used).is_some_and(|place| place > own) {
            found.insert(format!("{}:{line}: {} uses {used}, which is above it", file.path, parts[0]));
        }
    }
    found.into_iter().collect()
}

/// Line and name of everything named directly below the crate's root, by `crate::name`, `crate::{name, …}` or as many
/// `super::` as the file is deep.
fn used_modules(source: &Source, depth: usize) -> Vec<(usize, String)> {
    let words = source.words();
    let mut used = Vec::new();
    for at in 0..words.len() {
        let starts_path = at < 1 || words[at - 1].1 != "::";
        let root = match words[at].1 {
            "crate" if starts_path && follows(&words, at, 1, "::") => at + 2,
            "super" if starts_path => {
                let supers = (0..=depth).take_while(|i| follows(&words, at, 2 * i, "super")).count();
                if supers < depth {
                    continue;
                }
                at + 2 * supers
            }
            _ => continue,
        };
        used.extend(names_at(&words, root));
    }
    used
}

fn follows(words: &[(usize, &str)], at: usize, offset: usize, word: &str) -> bool {
    words.get(at + offset).is_some_and(|(_, w)| *w == word)
}

/// The name here, or the first names of the group here.
fn names_at(words: &[(usize, &str)], at: usize) -> Vec<(usize, String)> {
    let Some(&(line, word)) = words.get(at) else { return Vec::new() };
    if word != "{" {
        return vec![(line, word.to_owned())];
    }
    let (mut depth, mut names) = (0, Vec::new());
    for (i, &(line, word)) in words.iter().enumerate().skip(at) {
        match word {
            "{" => depth += 1,
            "}" => depth -= 1,
            _ if depth == 1 && (words[i - 1].1 == "{" || words[i - 1].1 == ",") => names.push((line, word.to_owned())),
            _ => {}
        }
        if depth == 0 {
            break;
        }
    }
    names
}

/// A file with more lines than the limit.
pub(crate) fn long_file(file: &File, limit: usize) -> Option<String> {
    let lines = file.text.lines().count();
    (lines > limit).then(|| format!("{}: {lines} lines, more than {limit}", file.path))
}

/// Functions with more lines than the limit, from `fn` to the closing brace.
pub(crate) fn long_functions(file: &File, limit: usize) -> Vec<String> {
    let source = Source::scan(&file.text);
    let words = source.words();
    let mut found = Vec::new();
    for (at, pair) in words.windows(2).enumerate() {
        let [(first, "fn"), (_, name)] = pair else { continue };
        let Some(last) = end_of_body(&words[at..]) else { continue };
        let lines = last - first + 1;
        if *name != "(" && lines > limit {
            found.push(format!("{}:{first}: {name} has {lines} lines, more than {limit}", file.path));
        }
    }
    found
}

/// Line of the brace that closes the first body; none for a declaration without one.
fn end_of_body(words: &[(usize, &str)]) -> Option<usize> {
    let (mut braces, mut brackets) = (0, 0);
    for &(line, word) in words {
        match word {
            "{" => braces += 1,
            "}" => {
                braces -= 1;
                if braces == 0 {
                    return Some(line);
                }
            }
            "(" | "[" => brackets += 1,
            ")" | "]" => brackets -= 1,
            ";" if braces == 0 && brackets == 0 => return None,
            _ => {}
        }
    }
    None
}

/// Whether a file holds tests alone.
fn is_test(file: &File) -> bool {
    file.path.contains("/tests/") || file.path.ends_with("tests.rs")
}

/// SQL outside the store: statements in string literals, and the database crate's name in code.
/// Files of tests may look at the database to see that nothing else is in it.
pub(crate) fn sql_outside_store(file: &File) -> Vec<String> {
    if file.path.starts_with("src/store/") || is_test(file) {
        return Vec::new();
    }
    let source = Source::scan(&file.text);
    let statements = source.strings.iter().filter(|(_, text)| is_sql(text)).map(|(line, _)| (*line, "a statement"));
    let names = source.words().into_iter().filter(|(_, word)| *word == "sqlx").map(|(line, _)| (line, "sqlx"));
    statements.chain(names).map(|(line, what)| format!("{}:{line}: {what} outside src/store", file.path)).collect()
}

/// Whether a text reads as an SQL statement: it opens with a verb and has the word that belongs to it.
fn is_sql(text: &str) -> bool {
    let lower = text.to_lowercase();
    let words: Vec<&str> = lower.split_whitespace().collect();
    let has = |word: &str| words.contains(&word);
    match words.as_slice() {
        ["select", _, ..] => has("from"),
        ["with", _, "as", ..] => has("select"),
        ["insert" | "replace", _, ..] => has("into"),
        ["update", _, ..] => has("set"),
        ["delete", "from", ..]
        | ["begin", "immediate" | "deferred" | "exclusive", ..]
        | ["create" | "drop" | "alter", "table" | "index" | "trigger" | "view", ..]
        | ["pragma", _, ..] => true,
        _ => false,
    }
}

/// Changes over HTTP that are made in nobody's name: the audit log would say that the server made them by itself.
pub(crate) fn nameless_changes(file: &File) -> Vec<String> {
    if !file.path.starts_with("src/http/") {
        return Vec::new();
    }
    let source = Source::scan(&file.text);
    let words = source.words();
    let begins = words.windows(3).filter(|w| w[0].1 == "store" && w[1].1 == "." && w[2].1 == "begin");
    begins.map(|w| format!("{}:{}: begin_for says in whose name", file.path, w[2].0)).collect()
}

/// HTTP status codes outside the HTTP layer.
pub(crate) fn status_code_outside_http(file: &File) -> Vec<String> {
    if file.path.starts_with("src/http/") {
        return Vec::new();
    }
    let source = Source::scan(&file.text);
    let named = source.words().into_iter().filter(|(_, word)| *word == "StatusCode");
    named.map(|(line, _)| format!("{}:{line}: StatusCode outside src/http", file.path)).collect()
}

/// Names that become drawers, as a file, a directory or an inline module.
pub(crate) fn drawers(file: &File) -> Vec<String> {
    const DRAWERS: [&str; 7] = ["core", "utils", "common", "types", "domain", "helpers", "misc"];
    let source = Source::scan(&file.text);
    let words = source.words();
    let inline = words.windows(2).filter(|w| w[0].1 == "mod").map(|w| w[1].1);
    let names: BTreeSet<&str> = file.path.trim_end_matches(".rs").split('/').chain(inline).collect();
    let bad = DRAWERS.iter().filter(|drawer| names.contains(*drawer));
    bad.map(|drawer| format!("{}: {drawer} would become a drawer; name what it holds", file.path)).collect()
}

/// A file of the library that does not begin by saying what it is.
pub(crate) fn undocumented(file: &File) -> Option<String> {
    let silent = file.path.starts_with("src/") && !is_test(file) && !file.text.starts_with("//! ");
    silent.then(|| format!("{}: does not begin with //! and what it is", file.path))
}
