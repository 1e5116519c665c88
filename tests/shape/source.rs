//! Reading Rust source just well enough to judge its shape, without a parser.
//!
//! Limits: macros are not expanded, raw identifiers are not known, and a `{` in a function's signature (a const generic
//! argument in braces) is taken for the start of its body.

/// Source in which comments and literals are told from code.
pub(crate) struct Source {
    /// The code; comments and the insides of literals are blanks, lines stay where they were.
    pub(crate) code: String,
    /// Line (from 1) and content of every string literal.
    pub(crate) strings: Vec<(usize, String)>,
}

/// What the scanner is inside of.
#[derive(Clone, Copy, PartialEq)]
enum Inside {
    Code,
    LineComment,
    BlockComment { depth: usize },
    Text,
    RawText { hashes: usize },
}

impl Source {
    pub(crate) fn scan(text: &str) -> Self {
        let chars: Vec<char> = text.chars().collect();
        let mut source = Self { code: String::with_capacity(text.len()), strings: Vec::new() };
        let (mut inside, mut at, mut line) = (Inside::Code, 0, 1);
        while at < chars.len() {
            let (next, taken) = step(inside, &chars, at);
            let began = inside == Inside::Code && matches!(next, Inside::Text | Inside::RawText { .. });
            if began {
                source.strings.push((line, String::new()));
            }
            let literal = matches!(inside, Inside::Text | Inside::RawText { .. }) && next == inside;
            for &c in &chars[at..at + taken] {
                if literal && let Some((_, content)) = source.strings.last_mut() {
                    content.push(c);
                }
                let keep = c == '\n' || (inside == Inside::Code && next == Inside::Code && !is_char_literal(taken, c));
                source.code.push(if keep { c } else { ' ' });
                line += usize::from(c == '\n');
            }
            (inside, at) = (next, at + taken);
        }
        source
    }

    /// Words of the code with the line (from 1) of each, in order: identifiers, `::`, and single signs.
    pub(crate) fn words(&self) -> Vec<(usize, &str)> {
        let mut words = Vec::new();
        for (number, line) in self.code.lines().enumerate() {
            let mut rest = line.trim_start();
            while !rest.is_empty() {
                let ident = rest.find(|c: char| !(c.is_alphanumeric() || c == '_')).unwrap_or(rest.len());
                let sign = rest.chars().next().map_or(0, char::len_utf8);
                let length = if ident > 0 { ident } else { sign.max(2 * usize::from(rest.starts_with("::"))) };
                words.push((number + 1, &rest[..length]));
                rest = rest[length..].trim_start();
            }
        }
        words
    }
}

/// A char literal is taken whole, and is the only code taken in more than one piece.
fn is_char_literal(taken: usize, c: char) -> bool {
    taken > 1 && c != '\n'
}

/// What comes after the next piece, and how many characters the piece has.
fn step(inside: Inside, chars: &[char], at: usize) -> (Inside, usize) {
    let starts = |pattern: &str| pattern.chars().enumerate().all(|(i, p)| chars.get(at + i) == Some(&p));
    match inside {
        Inside::Code if starts("//") => (Inside::LineComment, 2),
        Inside::Code if starts("/*") => (Inside::BlockComment { depth: 1 }, 2),
        Inside::Code if starts("\"") => (Inside::Text, 1),
        Inside::Code if starts("'") => (Inside::Code, char_literal(chars, at)),
        Inside::Code => match raw_text(chars, at) {
            Some(hashes) => (Inside::RawText { hashes }, 2 + hashes),
            None => (Inside::Code, 1),
        },
        Inside::LineComment if starts("\n") => (Inside::Code, 1),
        Inside::BlockComment { depth } if starts("/*") => (Inside::BlockComment { depth: depth + 1 }, 2),
        Inside::BlockComment { depth: 1 } if starts("*/") => (Inside::Code, 2),
        Inside::BlockComment { depth } if starts("*/") => (Inside::BlockComment { depth: depth - 1 }, 2),
        Inside::Text if starts("\\") && at + 1 < chars.len() => (Inside::Text, 2),
        Inside::Text if starts("\"") => (Inside::Code, 1),
        Inside::RawText { hashes } if starts(&format!("\"{}", "#".repeat(hashes))) => (Inside::Code, 1 + hashes),
        other => (other, 1),
    }
}

/// Characters of the char literal that starts here; 1 for the tick of a lifetime.
fn char_literal(chars: &[char], at: usize) -> usize {
    if chars.get(at + 1) == Some(&'\\') {
        let end = chars[at + 3..].iter().position(|&c| c == '\'').unwrap_or(0);
        return end + 4;
    }
    if chars.get(at + 2) == Some(&'\'') { 3 } else { 1 }
}

/// Hashes of the raw string that starts here.
fn raw_text(chars: &[char], at: usize) -> Option<usize> {
    let part_of_word = at > 0 && (chars[at - 1].is_alphanumeric() && chars[at - 1] != 'b' || chars[at - 1] == '_');
    if chars[at] != 'r' || part_of_word {
        return None;
    }
    let hashes = chars[at + 1..].iter().take_while(|&&c| c == '#').count();
    (chars.get(at + 1 + hashes) == Some(&'"')).then_some(hashes)
}
