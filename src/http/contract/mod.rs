//! What the interface says of itself: the contract, and a viewer of it that needs nothing from elsewhere.

use std::sync::LazyLock;

use axum::body::Bytes;
use axum::http::header::{CACHE_CONTROL, CONTENT_SECURITY_POLICY, CONTENT_TYPE, HeaderName};
use axum::response::{IntoResponse, Response};
use swagger_ui_redist::{SwaggerUi, SwaggerUiStaticFile};

use super::path::FileAt;
use super::problem::{Code, Problem};

const YAML: &str = include_str!("../../../api/openapi.yaml");
const PAGE: &str = include_str!("index.html");
const START: &str = include_str!("start.js");

/// The page runs its own scripts, talks to this server and to nobody else; the library sets styles of its own.
const OWN_ONLY: &str = "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; \
                        connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// Files of the viewer that change with the program alone, s.
const KEPT: &str = "public, max-age=86400";

static JSON: LazyLock<Bytes> = LazyLock::new(|| {
    let document: serde_json::Value = serde_yaml_ng::from_str(YAML).expect("the contract is YAML, as a test sees");
    serde_json::to_vec(&document).expect("and has nothing that JSON has not").into()
});

fn file(media: &'static str, bytes: Bytes) -> Response {
    ([(CONTENT_TYPE, media), (CACHE_CONTROL, KEPT)], bytes).into_response()
}

/// `GET /openapi.yaml`
pub(super) async fn yaml() -> Response {
    file("application/yaml", Bytes::from_static(YAML.as_bytes()))
}

/// `GET /openapi.json`
pub(super) async fn json() -> Response {
    file("application/json", JSON.clone())
}

/// `GET /docs`
pub(super) async fn viewer() -> impl IntoResponse {
    const HEADERS: [(HeaderName, &str); 2] =
        [(CONTENT_TYPE, "text/html; charset=utf-8"), (CONTENT_SECURITY_POLICY, OWN_ONLY)];
    (HEADERS, PAGE)
}

/// `GET /docs/{file}`
pub(super) async fn viewer_file(FileAt(name): FileAt) -> Result<Response, Problem> {
    let own = (name == "start.js").then_some(("text/javascript", START.as_bytes()));
    let part = own.or_else(|| {
        SwaggerUi::static_files().iter().find(|(part, _)| part.file_name() == name).map(|&(part, bytes)| {
            let media = match part {
                SwaggerUiStaticFile::Css | SwaggerUiStaticFile::IndexCss => "text/css",
                SwaggerUiStaticFile::Favicon16 | SwaggerUiStaticFile::Favicon32 => "image/png",
                _ => "text/javascript",
            };
            (media, bytes)
        })
    });
    let (media, bytes) = part.ok_or_else(|| Code::NotFound.because(format!("the viewer has no file {name:?}")))?;
    Ok(file(media, Bytes::from_static(bytes)))
}
