//! Vehicle types for SUMO: IDM drivers with what they were distilled from and how far they are from it.

use std::io;

use quick_xml::Writer;
use quick_xml::events::{BytesDecl, Event};

use crate::car_following::Idm;

/// A vehicle type.
#[derive(Debug, Clone, PartialEq)]
pub struct VehicleType {
    /// The traffic that it drives in.
    pub regime: String,
    /// Its parameters.
    pub idm: Idm,
    /// What is told of it besides, by name: counts and errors.
    pub told: Vec<(&'static str, String)>,
}

/// The file: an `additional` of SUMO with a `vType` for each regime, called `MODEL-vVERSION-REGIME`.
///
/// What SUMO calls them: `accel` and `decel` are a and b, `tau` is T, `minGap` s₀ and `maxSpeed` v₀, with the exponent δ = 4
/// and accelerations as the formula gives them at every step; a lane's limit bounds the desired speed besides
/// (<https://sumo.dlr.de/docs/Definition_of_Vehicles%2C_Vehicle_Types%2C_and_Routes.html>). What is told is in `param`s, which
/// SUMO keeps and does not read.
#[must_use]
pub fn sumo(model: &str, version: i64, weights_sha256: &str, types: &[VehicleType]) -> Vec<u8> {
    let mut writer = Writer::new_with_indent(Vec::new(), b' ', 4);
    write(&mut writer, model, version, weights_sha256, types).expect("memory takes it");
    writer.into_inner()
}

fn write(
    writer: &mut Writer<Vec<u8>>,
    model: &str,
    version: i64,
    weights_sha256: &str,
    types: &[VehicleType],
) -> io::Result<()> {
    writer.write_event(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None)))?;
    let version = version.to_string();
    writer.create_element("additional").write_inner_content(|writer| {
        for VehicleType { regime, idm, told } in types {
            let id = format!("{model}-v{version}-{regime}");
            let about =
                [("model", model), ("version", &version), ("regime", regime), ("weights_sha256", weights_sha256)];
            let told = about.into_iter().chain(told.iter().map(|(name, value)| (*name, value.as_str())));
            let parameters = parameters(idm);
            let parameters = parameters.iter().map(|(name, value)| (*name, value.as_str()));
            let named = [("id", id.as_str()), ("carFollowModel", "IDM")].into_iter().chain(parameters);
            writer.create_element("vType").with_attributes(named).write_inner_content(|writer| {
                for (name, value) in told {
                    let key = format!("headway.{name}");
                    writer
                        .create_element("param")
                        .with_attributes([("key", key.as_str()), ("value", value)])
                        .write_empty()?;
                }
                Ok(())
            })?;
        }
        Ok(())
    })?;
    Ok(())
}

/// Under SUMO's names.
fn parameters(idm: &Idm) -> [(&'static str, String); 7] {
    let number = |value: f64| format!("{value:.4}");
    [
        ("accel", number(idm.max_accel_mps2)),
        ("decel", number(idm.comfortable_braking_mps2)),
        ("tau", number(idm.time_headway_s)),
        ("minGap", number(idm.jam_spacing_m)),
        ("maxSpeed", number(idm.desired_speed_mps)),
        ("delta", "4".to_owned()),
        // Every vehicle is this driver.
        ("speedDev", "0".to_owned()),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_type_has_sumos_names_and_says_where_it_is_from() {
        let idm = Idm {
            desired_speed_mps: 33.25,
            time_headway_s: 1.5,
            jam_spacing_m: 2.0,
            max_accel_mps2: 1.0,
            comfortable_braking_mps2: 2.5,
        };
        let told = vec![("spacing_rmse_from_version_m", "0.5".to_owned())];
        let xml =
            String::from_utf8(sumo("ring", 3, "ab", &[VehicleType { regime: "a \"b\" <c>".to_owned(), idm, told }]))
                .unwrap();
        let expected = "    <vType id=\"ring-v3-a &quot;b&quot; &lt;c&gt;\" carFollowModel=\"IDM\" accel=\"1.0000\" \
                        decel=\"2.5000\" tau=\"1.5000\" minGap=\"2.0000\" maxSpeed=\"33.2500\" delta=\"4\" speedDev=\"0\">\n";
        assert!(xml.contains(expected), "{xml}");
        assert!(xml.contains("<param key=\"headway.spacing_rmse_from_version_m\" value=\"0.5\"/>"), "{xml}");
        let mut reader = quick_xml::Reader::from_str(&xml);
        while !matches!(reader.read_event().unwrap(), Event::Eof) {}
    }
}
