use proptest::prelude::*;

use super::encode::{encode, gzip, zstd};
use super::*;
use crate::car_following::Recording;
use crate::lineage::Split;

const FORMATS: [Format; 4] = [Format::Json, Format::Ndjson, Format::Csv, Format::Parquet];
const ENCODINGS: [Encoding; 3] = [Encoding::Identity, Encoding::Gzip, Encoding::Zstd];

fn squeeze(body: &[u8], encoding: Encoding) -> Vec<u8> {
    match encoding {
        Encoding::Identity => body.to_vec(),
        Encoding::Gzip => gzip(body),
        Encoding::Zstd => zstd(body),
    }
}

fn numbers(steps: usize) -> impl Strategy<Value = Vec<f64>> {
    let number = prop_oneof![any::<f64>().prop_filter("JSON has no others", |x| x.is_finite()), -100.0..100.0_f64];
    proptest::collection::vec(number, steps)
}

fn event() -> impl Strategy<Value = RawEvent> {
    let text = || proptest::option::of("[a-zA-Z0-9:_,\"é-]{1,12}");
    let split = prop_oneof![Just(None), Just(Some(Split::Train)), Just(Some(Split::Test))];
    (1_usize..20).prop_flat_map(move |steps| {
        let arrays = (numbers(steps), numbers(steps), numbers(steps), numbers(steps));
        ("[a-z\"]{1,3}", text(), text(), split.clone(), proptest::option::of(0.01..1.0_f64), arrays).prop_map(
            |(event_id, source, run, split, dt_s, (spacing_m, follower, leader, rel))| RawEvent {
                index: 0,
                event_id,
                source,
                run,
                split,
                recording: Recording {
                    dt_s,
                    t_s: None,
                    spacing_m,
                    follower_speed_mps: follower,
                    leader_speed_mps: leader,
                    rel_speed_mps: Some(rel),
                },
                origin: Origin::Row(1),
            },
        )
    })
}

fn bodies() -> impl Strategy<Value = Vec<RawEvent>> {
    proptest::collection::vec(event(), 1..20).prop_map(|mut events| {
        for (index, event) in events.iter_mut().enumerate() {
            event.index = index as u64;
            event.event_id = format!("{}{index}", event.event_id);
        }
        events
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn every_event_comes_back_bit_by_bit_from_every_format(events in bodies()) {
        for format in FORMATS {
            let body = encode(&events, format);
            for encoding in ENCODINGS {
                let kind = BodyKind { format, encoding, preset: Preset::Headway };
                let (mut back, rejections) =
                    decode_file(file(&squeeze(&body, encoding)), kind, &FormatLimits::default()).unwrap();
                prop_assert!(rejections.is_empty(), "{:?}", rejections);
                for event in &mut back {
                    event.origin = Origin::Row(1);
                }
                prop_assert_eq!(&back, &events);
            }
        }
    }

    #[test]
    fn any_bytes_are_decoded_or_refused(body in proptest::collection::vec(any::<u8>(), 0..300)) {
        for format in FORMATS {
            for encoding in ENCODINGS {
                let kind = BodyKind { format, encoding, preset: Preset::Headway };
                let _ = decode_file(file(&body), kind, &FormatLimits::default());
                let _ = decode_file(file(&squeeze(&body, encoding)), kind, &FormatLimits::default());
            }
        }
    }

    #[test]
    fn a_damaged_body_is_decoded_or_refused(
        events in bodies(),
        damage in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
    ) {
        for format in FORMATS {
            for encoding in ENCODINGS {
                let mut body = squeeze(&encode(&events, format), encoding);
                for (index, byte) in &damage {
                    let at = index.index(body.len());
                    body[at] = *byte;
                }
                let kind = BodyKind { format, encoding, preset: Preset::Headway };
                let _ = decode_file(file(&body), kind, &FormatLimits::default());
            }
        }
    }

    #[test]
    fn a_cut_compressed_body_is_truncated(events in bodies(), at in any::<prop::sample::Index>()) {
        for format in FORMATS {
            for encoding in [Encoding::Gzip, Encoding::Zstd] {
                let body = squeeze(&encode(&events, format), encoding);
                let cut = &body[..at.index(body.len() - 1)];
                let kind = BodyKind { format, encoding, preset: Preset::Headway };
                let error = decode_file(file(cut), kind, &FormatLimits::default()).unwrap_err();
                prop_assert_eq!(error.code(), "truncated_body", "{}", error);
            }
        }
    }
}
