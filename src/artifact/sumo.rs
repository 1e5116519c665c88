//! Vehicle types for SUMO: IDM drivers with what they were distilled from and how far they are from it.

use std::fmt::Write;

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
pub fn sumo(model: &str, version: i64, weights_sha256: &str, types: &[VehicleType]) -> String {
    let mut xml = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<additional>\n");
    for VehicleType { regime, idm, told } in types {
        let id = escaped(&format!("{model}-v{version}-{regime}"));
        let Idm { desired_speed_mps, time_headway_s, jam_spacing_m, max_accel_mps2, comfortable_braking_mps2 } = idm;
        let line = format!(
            "    <vType id=\"{id}\" carFollowModel=\"IDM\" accel=\"{max_accel_mps2:.4}\" decel=\"{comfortable_braking_mps2:.4}\" \
             tau=\"{time_headway_s:.4}\" minGap=\"{jam_spacing_m:.4}\" maxSpeed=\"{desired_speed_mps:.4}\" delta=\"4\" \
             speedDev=\"0\">\n"
        );
        xml.push_str(&line);
        let about = [("model", model.to_owned()), ("version", version.to_string()), ("regime", regime.clone())];
        let digest = [("weights_sha256", weights_sha256.to_owned())];
        for (name, value) in about.iter().chain(&digest).chain(told) {
            writeln!(xml, "        <param key=\"headway.{name}\" value=\"{}\"/>", escaped(value)).expect("memory");
        }
        xml.push_str("    </vType>\n");
    }
    xml.push_str("</additional>\n");
    xml
}

/// As text within quotes.
fn escaped(text: &str) -> String {
    quick_xml::escape::escape(text).into_owned()
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
        let xml = sumo("ring", 3, "ab", &[VehicleType { regime: "a \"b\" <c>".to_owned(), idm, told }]);
        let expected = "    <vType id=\"ring-v3-a &quot;b&quot; &lt;c&gt;\" carFollowModel=\"IDM\" accel=\"1.0000\" \
                        decel=\"2.5000\" tau=\"1.5000\" minGap=\"2.0000\" maxSpeed=\"33.2500\" delta=\"4\" speedDev=\"0\">\n";
        assert!(xml.contains(expected), "{xml}");
        assert!(xml.contains("<param key=\"headway.spacing_rmse_from_version_m\" value=\"0.5\"/>"), "{xml}");
        let mut reader = quick_xml::Reader::from_str(&xml);
        while !matches!(reader.read_event().unwrap(), quick_xml::events::Event::Eof) {}
    }
}
