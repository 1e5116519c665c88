//! Versions as vehicle types of SUMO.

use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};
use reqwest::Method;
use reqwest::header::IF_NONE_MATCH;
use serde_json::json;

use crate::artifact::download;
use crate::support::events::events;
use crate::support::server::Server;

const FILE: &str = "/v1/models/default/versions/2/artifact?format=sumo";

/// Quick, and enough to come close.
const SETTINGS: &str = "[evaluate]\ncalibration = { evaluations = 300 }";

/// A vehicle type: its attributes, and what is told of it.
type Told = (Vec<(String, String)>, Vec<(String, String)>);

fn types(xml: &[u8]) -> Vec<Told> {
    let mut reader = Reader::from_reader(xml);
    let mut types: Vec<Told> = Vec::new();
    let attributes = |tag: &BytesStart<'_>| -> Vec<(String, String)> {
        let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).unwrap();
        tag.attributes().map(Result::unwrap).map(|a| (text(a.key.as_ref()), text(&a.value))).collect()
    };
    loop {
        match reader.read_event().unwrap() {
            Event::Start(tag) if tag.name().as_ref() == b"vType" => types.push((attributes(&tag), Vec::new())),
            Event::Empty(tag) if tag.name().as_ref() == b"param" => {
                let told = attributes(&tag);
                types.last_mut().unwrap().1.push((told[0].1.clone(), told[1].1.clone()));
            }
            Event::Eof => return types,
            _ => {}
        }
    }
}

fn value<'a>(values: &'a [(String, String)], name: &str) -> &'a str {
    &values.iter().find(|(known, _)| known == name).unwrap_or_else(|| panic!("no {name} in {values:?}")).1
}

fn number(values: &[(String, String)], name: &str) -> f64 {
    value(values, name).parse().unwrap()
}

#[tokio::test]
async fn every_regime_is_a_type_that_says_how_far_it_is_from_the_version() {
    let server = Server::start_with(SETTINGS).await;
    server.learn("default", "fast", &events("e", 16, 16.0)).await;
    server.learn("default", "slow", &events("f", 16, 6.0)).await;
    let (headers, xml) = download(&server, FILE).await;
    assert_eq!(headers["content-type"], "application/xml");
    assert_eq!(headers["content-disposition"], "attachment; filename=\"default-v2.add.xml\"");
    let types = types(&xml);
    let ids: Vec<_> = types.iter().map(|(type_, _)| value(type_, "id")).collect();
    assert_eq!(ids, ["default-v2-fast", "default-v2-slow"]);
    let version = server.get("/v1/models/default/versions/2").await.expect(200);
    for (type_, told) in &types {
        assert_eq!(value(type_, "carFollowModel"), "IDM");
        for name in ["accel", "decel", "tau", "minGap", "maxSpeed"] {
            assert!(number(type_, name) > 0.0, "{name}");
        }
        assert_eq!(version["weights_sha256"], value(told, "headway.weights_sha256"));
        // Twelve of a batch are to train on; every fourth of these is held back.
        assert_eq!((value(told, "headway.fitted_events"), value(told, "headway.held_events")), ("9", "3"));
        let [distilled, version] = ["spacing_rmse_from_version_m", "version_spacing_rmse_m"]
            .map(|name| number(told, &format!("headway.{name}")));
        assert!(0.0 < distilled && distilled < 5.0 && 0.0 < version, "{told:?}");
    }
    // Both regimes have a driver of their own, and it is the same whenever it is asked for.
    assert_ne!(types[0].0[2..], types[1].0[2..]);
    let known = server.request(Method::GET, FILE).header(IF_NONE_MATCH, &headers["etag"]).send().await.unwrap();
    assert_eq!(known.status(), 304);
    server.stop().await;
}

#[tokio::test]
async fn without_events_there_is_nothing_to_distil_by() {
    let server = Server::start_with(SETTINGS).await;
    server.learn("default", "fast", &events("e", 16, 16.0)).await;
    server.post("/v1/models/default/pause", &json!({})).await.expect(200);
    let retracted = server.request(Method::DELETE, "/v1/models/default/batches/b1");
    assert!(server.send(retracted).await.status < 300);
    let first = FILE.replace("/2/", "/1/");
    server.get(&first).await.expect_problem(409, "nothing_to_distil");
    server.stop().await;
}
