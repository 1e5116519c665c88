//! `/problems`: every kind of problem, and what to do about it.

use serde_json::{Value, json};

use super::answer::Answer;
use super::path::CodeAt;
use super::problem::Code;

fn body(code: Code) -> Value {
    let (name, status, title) = code.row();
    json!({
        "type": format!("/problems/{name}"),
        "code": name,
        "status": status.as_u16(),
        "title": title,
        "remedy": code.remedy(),
    })
}

/// `GET /problems`
pub(super) async fn list() -> Answer {
    let problems: Vec<_> = Code::ALL.iter().copied().map(body).collect();
    Answer::ok(&json!({"problems": problems, "next_page_token": null}))
}

/// `GET /problems/{code}`
pub(super) async fn read(CodeAt(code): CodeAt) -> Answer {
    Answer::ok(&body(code))
}
