//! `api/openapi.yaml`, and whether an answer keeps to it.

use std::collections::BTreeMap;
use std::sync::{LazyLock, Mutex};

use jsonschema::Validator;
use serde_json::{Map, Value, json};

static DOCUMENT: LazyLock<Value> = LazyLock::new(|| {
    let text = include_str!("../../api/openapi.yaml");
    serde_yaml_ng::from_str(text).expect("api/openapi.yaml is YAML that JSON can say")
});

/// Validators by (path, method, status, content type), made once.
static VALIDATORS: LazyLock<Mutex<BTreeMap<String, &'static Validator>>> = LazyLock::new(Mutex::default);

pub(crate) fn document() -> &'static Value {
    &DOCUMENT
}

/// Path, method and description of every operation.
pub(crate) fn operations() -> Vec<(&'static str, String, &'static Value)> {
    let paths = DOCUMENT["paths"].as_object().expect("paths").iter();
    paths
        .flat_map(|(path, item)| {
            let methods = item.as_object().expect("methods").iter().filter(|(name, _)| *name != "parameters");
            methods.map(move |(method, operation)| (path.as_str(), method.to_uppercase(), operation))
        })
        .collect()
}

/// A path that fits the template: of this model, and otherwise of what there may be.
pub(crate) fn filled(template: &str, model: &str) -> String {
    template
        .replace("{model}", model)
        .replace("{batch_id}", "b1")
        .replace("{task_id}", "t1")
        .replace("{version}", "1")
        .replace("{source}", "site")
        .replace("{key_id}", "0123456789abcdef")
        .replace("{file}", "start.js")
        .replace("{code}", "busy")
}

/// Panics unless the contract has this path, method, status and content type, and the body fits the schema.
pub(crate) fn check(method: &str, path: &str, status: u16, content_type: &str, body: &str) {
    let told = || format!("{method} {path} answered {status} {content_type}: {body}");
    let Some((template, item)) = find_path(path) else {
        assert_eq!(status, 404, "the contract has no such path: {}", told());
        return check_refusal(path, content_type, body, &told);
    };
    let Some(operation) = item.get(method.to_lowercase()) else {
        assert_eq!(status, 405, "the contract has no such method: {}", told());
        return check_refusal(path, content_type, body, &told);
    };
    let responses = &operation["responses"];
    let response = responses.get(status.to_string()).or_else(|| {
        assert!(status >= 400, "the contract has no such success: {}", told());
        responses.get("default")
    });
    let response = resolve(response.unwrap_or_else(|| panic!("the contract has no such status: {}", told())));
    let key = format!("{method} {template} {status}");
    check_body(&key, response, content_type, body, &told);
}

/// What is answered where the contract has nothing.
fn check_refusal(path: &str, content_type: &str, body: &str, told: &dyn Fn() -> String) {
    let kind = if path == "/v2" || path.starts_with("/v2/") { "InferenceError" } else { "Problem" };
    check_body(kind, &DOCUMENT["components"]["responses"][kind], content_type, body, told);
}

fn check_body(key: &str, response: &Value, content_type: &str, body: &str, told: &dyn Fn() -> String) {
    let media = content_type.split(';').next().unwrap_or_default();
    let content = response["content"].get(media);
    let schema = &content.unwrap_or_else(|| panic!("the contract has no such type: {}", told()))["schema"];
    if !media.ends_with("json") || media == "application/x-ndjson" {
        return;
    }
    let value: Value = serde_json::from_str(body).unwrap_or_else(|e| panic!("{e}: {}", told()));
    let errors: Vec<_> = validator(&format!("{key} {media}"), schema)
        .iter_errors(&value)
        .map(|e| format!("{}: {e}", e.instance_path()))
        .collect();
    assert!(errors.is_empty(), "{}\nbreaks the contract: {errors:#?}", told());
}

fn validator(key: &str, schema: &Value) -> &'static Validator {
    let mut validators = VALIDATORS.lock().unwrap();
    validators.entry(key.to_owned()).or_insert_with(|| Box::leak(Box::new(compile(schema))))
}

fn compile(schema: &Value) -> Validator {
    let mut whole = schema.as_object().cloned().unwrap_or_else(Map::new);
    whole.insert("$schema".to_owned(), json!("https://json-schema.org/draft/2020-12/schema"));
    whole.insert("components".to_owned(), DOCUMENT["components"].clone());
    jsonschema::options().should_validate_formats(true).build(&Value::Object(whole)).expect("a schema of the contract")
}

/// Panics unless `value` fits the schema of this name.
pub(crate) fn check_schema(name: &str, value: &Value) {
    let schema = json!({"$ref": format!("#/components/schemas/{name}")});
    let errors: Vec<_> = validator(name, &schema).iter_errors(value).map(|e| e.to_string()).collect();
    assert!(errors.is_empty(), "{value} breaks the contract: {errors:#?}");
}

/// Every example of the contract beside its schema.
pub(crate) fn examples() -> Vec<(String, Value, Value)> {
    let mut found = Vec::new();
    collect("", &DOCUMENT, &mut found);
    found
}

fn collect(at: &str, value: &Value, found: &mut Vec<(String, Value, Value)>) {
    match value {
        Value::Object(members) => {
            if let (Some(schema), Some(example)) = (members.get("schema"), members.get("example")) {
                found.push((at.to_owned(), schema.clone(), example.clone()));
            }
            for (name, member) in members {
                collect(&format!("{at}/{name}"), member, found);
            }
        }
        Value::Array(items) => {
            for (i, item) in items.iter().enumerate() {
                collect(&format!("{at}/{i}"), item, found);
            }
        }
        _ => {}
    }
}

/// What is wrong with an example.
pub(crate) fn defects(schema: &Value, example: &Value) -> Vec<String> {
    compile(schema).iter_errors(example).map(|e| e.to_string()).collect()
}

fn resolve(response: &'static Value) -> &'static Value {
    match response.get("$ref").and_then(Value::as_str) {
        Some(reference) => DOCUMENT.pointer(reference.trim_start_matches('#')).expect("a response of the contract"),
        None => response,
    }
}

fn find_path(path: &str) -> Option<(&'static str, &'static Value)> {
    let path = path.split('?').next().unwrap_or_default();
    let paths = DOCUMENT["paths"].as_object().expect("paths");
    paths.iter().find(|(template, _)| fits(template, path)).map(|(template, item)| (template.as_str(), item))
}

fn fits(template: &str, path: &str) -> bool {
    let (template, path): (Vec<_>, Vec<_>) = (template.split('/').collect(), path.split('/').collect());
    template.len() == path.len()
        && template.iter().zip(&path).all(|(part, given)| (part.starts_with('{') && !given.is_empty()) || part == given)
}
