use std::sync::LazyLock;

use axum::http::{HeaderMap, HeaderName, HeaderValue};
use headway::access::{Issued, KeyId, Scope, Token};
use headway::config::Config;
use headway::http::reading::{Asked, headers, id, query};
use headway::http::{Code, ServerSettings};
use headway::lineage::{ModelName, RegimeName, Split};
use headway::reference::ReferenceKind;

static SETTINGS: LazyLock<ServerSettings> =
    LazyLock::new(|| Config::resolve([]).expect("the defaults are usable").server);

/// What a request says beside its body.
pub(super) fn run(data: &[u8]) {
    let Some((choice, rest)) = super::chosen(data, Asked::ALL.len() + 2) else { return };
    let settings = &*SETTINGS;
    let most = 64 * data.len() as u64 + (64 << 10);
    super::within(most, || match Asked::ALL.get(choice) {
        Some(&asked) => queried(asked, rest, settings),
        None if choice == Asked::ALL.len() => head(rest),
        None => named(rest),
    });
}

/// A query is refused by its own code, and says the same a second time.
fn queried(asked: Asked, text: &[u8], settings: &ServerSettings) {
    let Ok(text) = std::str::from_utf8(text) else { return };
    match query(asked, text, settings) {
        Ok(said) => {
            // Outside of texts, which may say what they like.
            let plain = said.replace(r"\\", "").replace(r#"\""#, "");
            assert!(
                !plain.split('"').step_by(2).any(|part| ["NaN", "inf,", "inf)"].iter().any(|no| part.contains(no))),
                "{said}"
            );
            assert_eq!(query(asked, text, settings), Ok(said));
        }
        Err(code) => assert_eq!(code, Code::InvalidQuery),
    }
}

/// Headers, one a line.
fn head(lines: &[u8]) {
    let mut given = HeaderMap::new();
    for line in lines.split(|&byte| byte == b'\n').take(32) {
        let Some(colon) = line.iter().position(|&byte| byte == b':') else { continue };
        let (name, value) = (HeaderName::from_bytes(&line[..colon]), HeaderValue::from_bytes(&line[colon + 1..]));
        if let (Ok(name), Ok(value)) = (name, value) {
            given.append(name, value);
        }
    }
    match headers(&given, "\"1-4\"", 1 << 20) {
        Ok(said) => assert_eq!(headers(&given, "\"1-4\"", 1 << 20), Ok(said)),
        Err(code) => {
            let known = matches!(
                code,
                Code::NotAcceptable | Code::MalformedHeader | Code::UnsupportedMediaType | Code::BodyTooLarge
            );
            assert!(known, "{code:?}");
        }
    }
}

/// Names and ids have one spelling.
fn named(text: &[u8]) {
    if let Some(token) = Token::parse(text) {
        let text = std::str::from_utf8(text).expect("a key is ASCII");
        assert!(text.contains(&token.key_id.to_string()));
        assert!(!format!("{token:?}").contains(&text[20..]));
        let issued = Issued::read(text).expect("it is a key");
        assert_eq!((issued.reveal(), issued.secret_sha256), (text, token.secret_sha256()));
    }
    let Ok(text) = std::str::from_utf8(text) else { return };
    for letter in ["", "b", "t"] {
        if let Some(row) = id(letter, text) {
            assert!(row > 0 && format!("{letter}{row}") == text, "{text:?}");
        }
    }
    if let Some(key_id) = KeyId::parse(text) {
        assert_eq!(key_id.to_string(), text);
    }
    for name in [ModelName::parse(text).map(String::from), RegimeName::parse(text).map(String::from)] {
        match name {
            Ok(name) => assert!(name == text && (1..=64).contains(&name.len()) && !name.starts_with('.')),
            Err(error) => assert!(error.to_string().len() < 1024),
        }
    }
    if let Some(split) = Split::parse(text) {
        assert_eq!(split.as_str(), text);
    }
    if let Some(reference) = ReferenceKind::parse(text) {
        assert_eq!(reference.as_str(), text);
    }
    if let Ok(scope) = text.parse::<Scope>() {
        assert_eq!(scope.as_str(), text);
    }
}
