use reqwest::Method;
use reqwest::header::{HeaderMap, IF_NONE_MATCH};
use safetensors::SafeTensors;
use serde_json::{Value, json};

use crate::lived::execute;
use crate::support::events::events;
use crate::support::server::Server;

const FILE: &str = "/v1/models/default/versions/2/artifact?format=safetensors";

/// Headers and bytes of a file.
pub(crate) async fn download(server: &Server, path: &str) -> (HeaderMap, Vec<u8>) {
    let answer = server.request(Method::GET, path).send().await.unwrap();
    assert_eq!(answer.status(), 200, "{path}");
    let headers = answer.headers().clone();
    (headers, answer.bytes().await.unwrap().to_vec())
}

fn floats(bytes: &[u8]) -> Vec<f32> {
    bytes.as_chunks::<4>().0.iter().map(|x| f32::from_le_bytes(*x)).collect()
}

async fn learned() -> Server {
    let server = Server::start().await;
    server.learn("default", "fast", &events("e", 16, 16.0)).await;
    server.learn("default", "slow", &events("f", 16, 6.0)).await;
    server
}

#[tokio::test]
async fn a_version_is_handed_out_with_everything_that_learning_needs_to_go_on() {
    let server = learned().await;
    let version = server.get("/v1/models/default/versions/2").await.expect(200);
    let (headers, bytes) = download(&server, FILE).await;
    assert_eq!(headers["content-disposition"], "attachment; filename=\"default-v2.safetensors\"");
    let file = SafeTensors::deserialize(&bytes).unwrap();
    let (_, read) = SafeTensors::read_metadata(&bytes).unwrap();
    let keys = read.metadata().clone().unwrap();
    for (key, value) in [("method", "ewc"), ("stage", "2"), ("regime", "slow"), ("format", "pt"), ("tainted", "false")]
    {
        assert_eq!(keys[key], value);
    }
    assert_eq!(json!(keys["weights_sha256"]), version["weights_sha256"]);
    assert_eq!(serde_json::from_str::<Value>(&keys["settings"]).unwrap(), version["settings"]);
    assert_eq!(serde_json::from_str::<Value>(&keys["scaling"]).unwrap(), version["scaling"]);
    let tensor = |name: &str| file.tensor(name).unwrap();
    // Hidden 6; seven inputs with the model's features.
    assert_eq!(tensor("lstm.weight_ih_l0").shape(), [24, 7]);
    assert_eq!(tensor("lstm.weight_hh_l0").shape(), [24, 6]);
    assert_eq!((tensor("head.weight").shape(), tensor("head.bias").shape()), (&[1, 6][..], &[1][..]));
    assert!(floats(tensor("lstm.bias_hh_l0").data()).iter().all(|x| *x == 0.0));
    let regimes: Value = serde_json::from_str(&keys["regimes"]).unwrap();
    assert_eq!((&regimes[0]["regime"], &regimes[1]["stage"]), (&json!("fast"), &json!(2)));
    let layers = ["lstm.weight_ih_l0", "lstm.weight_hh_l0", "lstm.bias_ih_l0", "head.weight", "head.bias"];
    let flat = |prefix: &str| layers.map(|layer| tensor(&format!("{prefix}{layer}")).data().to_vec()).concat();
    let digest = |parts: &[Vec<u8>]| {
        use sha2::{Digest, Sha256};
        hex::encode(Sha256::digest(parts.concat()))
    };
    assert_eq!(json!(digest(&[flat("")])), version["weights_sha256"]);
    for place in 0..2 {
        let kept = ["importance", "anchor"].map(|kind| flat(&format!("regimes.{place}.{kind}.")));
        assert_eq!(json!(digest(&kept)), regimes[place]["anchor_sha256"]);
        assert!(floats(&kept[0]).iter().any(|x| *x > 0.0));
    }
    assert_eq!(flat("regimes.1.anchor."), flat(""), "the last regime is anchored at the version's own weights");
    server.stop().await;
}

#[tokio::test]
async fn a_file_is_the_same_whenever_it_is_asked_for_and_is_not_sent_twice() {
    let server = learned().await;
    for format in ["safetensors", "onnx"] {
        let path = format!("/v1/models/default/versions/2/artifact?format={format}");
        let (first, bytes) = download(&server, &path).await;
        let (second, again) = download(&server, &path).await;
        assert_eq!((&first["etag"], &bytes), (&second["etag"], &again));
        let known = server.request(Method::GET, &path).header(IF_NONE_MATCH, &first["etag"]).send().await.unwrap();
        assert_eq!((known.status().as_u16(), known.bytes().await.unwrap().len()), (304, 0));
        let (other, _) = download(&server, &path.replace("/2/", "/1/")).await;
        assert_ne!(first["etag"], other["etag"]);
    }
    server.stop().await;
}

#[tokio::test]
async fn a_file_is_refused_for_what_is_wrong_with_the_wish_or_the_version() {
    let server = learned().await;
    let path = |rest: &str| format!("/v1/models/default/versions/{rest}");
    for wish in ["1/artifact", "1/artifact?format=pickle"] {
        let refused = server.get(&path(wish)).await.expect_problem(422, "invalid_query");
        assert_eq!(refused["errors"][0]["parameter"], "format");
        assert!(refused["detail"].as_str().unwrap().contains("safetensors, onnx or sumo"));
    }
    server.get(&path("9/artifact?format=onnx")).await.expect_problem(404, "version_not_found");
    let database = server.directory.path().join("headway.db");
    execute(&database, "update anchor set weights = zeroblob(length(weights)) where anchor_id = 2").await;
    server.get(FILE).await.expect_problem(409, "corrupt");
    download(&server, &path("1/artifact?format=safetensors")).await;
    execute(&database, "update weights set weights = zeroblob(length(weights)) where version = 2").await;
    server.get(&path("2/artifact?format=onnx")).await.expect_problem(409, "corrupt");
    execute(&database, "insert into pruned values (1, 1, '2026-01-01T00:00:00Z')").await;
    server.get(&path("1/artifact?format=onnx")).await.expect_problem(410, "version_pruned");
    server.stop().await;
}
