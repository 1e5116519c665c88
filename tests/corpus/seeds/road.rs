//! Seeds that are recordings of a whole road.

use std::fmt::Write;

fn document(timesteps: &str) -> String {
    format!("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<!-- made -->\n<fcd-export>\n{timesteps}</fcd-export>\n")
}

/// `steps` times at which one vehicle follows another.
fn pair(steps: usize, leader: impl Fn(usize) -> &'static str) -> String {
    let mut text = String::new();
    for step in 0..steps {
        let leader = leader(step);
        writeln!(text, "<timestep time=\"{:.2}\">", step as f64 * 0.1).unwrap();
        writeln!(text, "<vehicle id=\"a\" speed=\"9.5\" leaderID=\"\" leaderSpeed=\"-1\" leaderGap=\"-1\"/>").unwrap();
        writeln!(text, "<vehicle id=\"b\" speed=\"9\" pos=\"1.5\" {leader}/>\n</timestep>").unwrap();
    }
    text
}

pub(super) fn documents() -> Vec<(&'static str, String)> {
    let behind = "leaderID=\"a\" leaderSpeed=\"9.5\" leaderGap=\"20.5\"";
    let other = "leaderID=\"c\" leaderSpeed=\"9\" leaderGap=\"30\"";
    let far = "leaderID=\"a\" leaderSpeed=\"9.5\" leaderGap=\"120.5\"";
    let unknown = "leaderID=\"a\" leaderGap=\"20\"";
    let good = document(&pair(4, |_| behind));
    vec![
        ("pair", good.clone()),
        ("long", document(&pair(45, |_| behind))),
        ("leader-changes", document(&pair(8, |step| if step < 4 { behind } else { other }))),
        ("far", document(&pair(8, |step| if step == 3 { far } else { behind }))),
        ("unknown", document(&pair(5, |step| if step == 1 { unknown } else { behind }))),
        ("vanishes", document(&(pair(4, |_| behind) + "<timestep time=\"0.5\"/><timestep time=\"7\"></timestep>"))),
        ("person", document("<timestep time=\"0\"><person id=\"p\" speed=\"1\"><x y=\"z\"/></person></timestep>")),
        ("empty", document("")),
        ("no-leaders", document("<timestep time=\"0\"><vehicle id=\"a\" speed=\"1\"/></timestep>")),
        ("no-id", document("<timestep time=\"0\"><vehicle speed=\"1\"/></timestep>")),
        ("no-number", document("<timestep time=\"0\"><vehicle id=\"a\" speed=\"NaN\"/></timestep>")),
        ("time", document("<timestep time=\"1\"/><timestep time=\"0.5\"/>")),
        ("twice", document(&format!("<timestep time=\"1\">{0}{0}</timestep>", "<vehicle id=\"a\" speed=\"1\"/>"))),
        ("other", "<tripinfos><tripinfo id=\"a\"/></tripinfos>".to_owned()),
        ("entities", document("<timestep time=\"&#48;\"><vehicle id=\"&lt;&amp;&quot;\" speed=\"1\"/></timestep>")),
        ("unknown-entity", document("<timestep time=\"&a;\"/>")),
        ("document-type", format!("<!DOCTYPE a [<!ENTITY b \"c\">]>{good}")),
        ("text", document("<timestep time=\"1\">text &amp; more<![CDATA[x]]></timestep>")),
        ("reference", document("&lol;")),
        ("encoding", good.replace("UTF-8", "UTF-16")),
        ("two", format!("{good}<fcd-export/>")),
        ("deep", document(&"<a>".repeat(20))),
        (
            "attributes",
            document(&format!("<a {}/>", (0..70).map(|i| format!("a{i}=\"\" ")).collect::<Vec<_>>().concat())),
        ),
        (
            "long-id",
            document(&format!("<timestep time=\"0\"><vehicle id=\"{}\" speed=\"1\"/></timestep>", "x".repeat(65))),
        ),
        ("tag", document(&format!("<a b=\"{}\"/>", "x".repeat(20_000)))),
        ("cut", good[..good.len() - 30].to_owned()),
        ("cut-in-a-tag", good[..good.len() / 2].to_owned()),
        ("mismatched", document("<timestep time=\"0\"></vehicle>")),
    ]
}

/// Behind a byte that says the preset.
pub(super) fn tables() -> Vec<(&'static str, String)> {
    const NGSIM: &str = "Vehicle_ID,Frame_ID,Global_Time,v_Length,v_Vel,Lane_ID,Preceding,Space_Headway,Location";
    let mut ngsim = format!("\u{1}{NGSIM}\n");
    for (vehicle, leader, headway) in [(1, 0, 0), (2, 1, 80), (3, 2, 500)] {
        for frame in 10..15 {
            let time = 1_118_846_980_000_i64 + 100 * frame;
            writeln!(ngsim, "{vehicle},{frame},{time},15.5,30.2,2,{leader},{headway},us-101").unwrap();
        }
    }
    let contradicting = ngsim.replace("3,14,", "3,13,").replace("00,15.5,30.2,2,2", "00,15.5,31,2,2");
    let rows: Vec<_> = ngsim.lines().skip(1).collect();
    let repeated = format!("{ngsim}{}\n", rows[3]);
    let least = "Vehicle_ID,Frame_ID,v_length,v_Vel,Preceding,Space_Hdwy";
    let fcd = "\u{2}timestep_time;vehicle_id;vehicle_speed;vehicle_leaderID;vehicle_leaderSpeed;vehicle_leaderGap;run";
    vec![
        ("ngsim", ngsim.clone()),
        ("ngsim-repeated", repeated),
        ("ngsim-contradicting", contradicting),
        ("ngsim-cut", ngsim[..ngsim.len() - 20].to_owned()),
        ("ngsim-ragged", ngsim.replace(",2,1,80,us-101\n2,12", ",2\n2,12")),
        ("ngsim-least", format!("\u{1}{least}\n1,1,15,30,0,\n2,1,15,30,1,60\n2,2,15,30,1,\n2,3,15,30,2,9\n")),
        ("ngsim-wrong", format!("\u{1}{least}\n1,1.5,15,30,0,0\n")),
        ("ngsim-no-number", format!("\u{1}{least}\n1,1,15,inf,0,0\n")),
        ("ngsim-missing", "\u{1}Vehicle_ID,Frame_ID\n".to_owned()),
        ("fcd", format!("{fcd}\n0;b;9;a;9;20;r\n0.1;b;9;a;9;20;r\n0.2;b;9;a;9;20;r\n0.3;b;9;a;9;20;s\n0.4;;;;;;\n")),
        ("fcd-none", format!("{fcd}\n0;b;9;;-1;-1;\n0;b;9;;;;\n")),
        ("fcd-time", format!("{fcd}\n1;b;9;;-1;-1;\n0;b;9;;;;\n")),
    ]
}
