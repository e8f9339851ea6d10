//! Heat by surface by the program: properties by the names of objects, mixed conditions, networks and exchange, against
//! closed forms, the field's cases and the second law.
//!
//! The binary is the one beside this test: build it with the same profile and target directory before.

use hemicube::solve::STEFAN_BOLTZMANN;
use hemicube_tests::runs::{Place, Ran};
use hemicube_tests::scenes::scenes_or_skip;
use serde_json::Value;
use std::collections::BTreeMap;

/// A room of 6 × 5 × 2.7 m, its walls named solids of an STL.
fn stl() -> String {
    let [x, y, z] = [6.0, 5.0, 2.7];
    let walls = [
        ("floor", [[0.0, 0.0, 0.0], [x, 0.0, 0.0], [x, y, 0.0], [0.0, y, 0.0]]),
        ("ceiling", [[0.0, 0.0, z], [0.0, y, z], [x, y, z], [x, 0.0, z]]),
        ("south", [[0.0, 0.0, 0.0], [0.0, 0.0, z], [x, 0.0, z], [x, 0.0, 0.0]]),
        ("north", [[0.0, y, 0.0], [x, y, 0.0], [x, y, z], [0.0, y, z]]),
        ("west", [[0.0, 0.0, 0.0], [0.0, y, 0.0], [0.0, y, z], [0.0, 0.0, z]]),
        ("east", [[x, 0.0, 0.0], [x, 0.0, z], [x, y, z], [x, y, 0.0]]),
    ];
    let mut text = String::new();
    for (name, [a, b, c, d]) in walls {
        text += &format!("solid {name}\n");
        for corners in [[a, b, c], [a, c, d]] {
            text += "facet normal 0 0 0\nouter loop\n";
            for [x, y, z] in corners {
                text += &format!("vertex {x} {y} {z}\n");
            }
            text += "endloop\nendfacet\n";
        }
        text += &format!("endsolid {name}\n");
    }
    text
}

/// A room of that STL, each wall cut into 32 patches, as `room`.
fn room() -> Place {
    let place = Place::new();
    place.write("room.stl", stl());
    place.line("compute room.stl --split 4 -o room --quiet").is(0);
    place
}

/// Results by surface: heat in W, mean, least and greatest temperature in kelvin.
type Surfaces = BTreeMap<String, (f64, [f64; 3])>;

fn surfaces(place: &Place, line: &str) -> (Surfaces, Value) {
    place.line(&format!("{line} -o by.json --overwrite --quiet")).is(0);
    let text = std::fs::read_to_string(place.path("by.json")).expect("results");
    let json: Value = serde_json::from_str(&text).expect("JSON");
    let number = |value: &Value| value.as_f64().expect("a number");
    let found = json["surfaces"].as_array().expect("surfaces").iter().map(|surface| {
        let kelvin = [0, 1, 2].map(|at| number(&surface["temperature"][at]));
        let name = surface["name"].as_str().expect("a name").to_owned();
        (name, (number(&surface["heat"]), kelvin))
    });
    (found.collect(), json)
}

#[track_caller]
fn refused(place: &Place, line: &str, words: &[&str]) {
    let Ran { code, err, .. } = place.line(line).says(words);
    assert_eq!(code, Some(2), "{line}: {err}");
}

#[test]
fn objects_have_properties_and_heat_adds_up() {
    let place = room();
    place.write(
        "m.toml",
        "[default]\nemissivity = 0.9\ntemperature = \"20 °C\"\n[object.floor]\ntemperature = \"30 °C\"\n",
    );
    let solve = "solve room --thermal --materials m.toml";
    let (found, json) = surfaces(&place, solve);
    // Two surfaces in one enclosure, lumped: the floor is flat, all else together sees it and itself.
    let (floor, rest) = (30.0, 30.0 + 2.0 * 2.7 * 11.0);
    let black = |kelvin: f64| STEFAN_BOLTZMANN * kelvin.powi(4);
    let resistance = (1.0 - 0.9) / (0.9 * floor) + 1.0 / floor + (1.0 - 0.9) / (0.9 * rest);
    let lumped = (black(303.15) - black(293.15)) / resistance;
    assert!(
        (found["floor"].0 / lumped - 1.0).abs() < 0.01,
        "{} {lumped}",
        found["floor"].0
    );
    assert_eq!(found["floor"].1, [303.15; 3]);
    let sum: f64 = found.values().map(|(heat, _)| heat).sum();
    let error = json["balance"]["error"].as_f64().expect("a number");
    assert!(
        (sum - error).abs() < 1e-9 * lumped && error.abs() < 1e-3 * lumped,
        "{sum} {error}"
    );
    assert_eq!(json["enclosures"].as_array().map(Vec::len), Some(1));
    assert_eq!(json["enclosures"][0]["escaped"], 0.0);

    // The same of materials' names that only objects have, with a warning; a table and a CSV show it.
    place.write(
        "old.toml",
        "[default]\nemissivity = 0.9\ntemperature = 293.15\n[material.floor]\ntemperature = 303.15\n",
    );
    let ran = place
        .line("solve room --thermal --materials old.toml --by object -o by.csv -v")
        .is(0)
        .says(&["no material is called `floor`"]);
    assert!(
        ran.out.contains("\nfloor    32       30.000") && ran.out.contains("closed"),
        "{}",
        ran.out
    );
    let csv = std::fs::read_to_string(place.path("by.csv")).expect("a table");
    let heat: f64 = csv
        .lines()
        .skip(1)
        .map(|line| {
            line.split(',')
                .nth(3)
                .and_then(|field| field.parse::<f64>().ok())
                .expect("heat")
        })
        .sum();
    assert!((heat - error).abs() < 1e-6 * lumped, "{csv}");

    // A file without anything new says what it said before.
    place.write("plain.toml", "[default]\nemissivity = 0.9\ntemperature = 300\n");
    let ran = place.line("solve room --thermal --materials plain.toml").is(0);
    assert!(
        ran.out.contains("heat, W") && !ran.err.contains("heat, W"),
        "{}",
        ran.out
    );
    let record = std::fs::read_to_string(place.path("room/solutions/thermal/solution.json")).expect("a report");
    assert!(!record.contains("isothermal"), "{record}");
}

#[test]
fn names_that_nothing_has_and_contradictions_are_refused() {
    let place = room();
    let with = |text: &str, words: &[&str]| {
        place.write(
            "m.toml",
            format!("[default]\nemissivity = 0.9\ntemperature = 293\n{text}"),
        );
        refused(&place, "solve room --thermal --materials m.toml", words);
    };
    with(
        "[object.flor]\ntemperature = 303\n",
        &["`flor` matches no object", "`floor`, `ceiling`"],
    );
    with(
        "[material.flor]\ntemperature = 303\n",
        &["`flor` matches no material", "the objects `floor`"],
    );
    with(
        "[object.floor]\ntemperature = 303\nflux = 3\n",
        &["`temperature` and `flux`"],
    );
    with(
        "[object.\"*th\"]\n[object.\"*or\"]\n[object.\"s*\"]\n[object.\"so*\"]\n",
        &["fits both"],
    );
    with("[object.floor]\ntemperature = \"30 F\"\n", &["m.toml:5:", "30 F"]);
    with(
        "[object.\"*\"]\nflux = -9000\n[object.floor]\ntemperature = 300\n",
        &["object `ceiling` cannot be", "0 K"],
    );
    with(
        "[object.\"*\"]\nflux = 10\n",
        &["adds up to", "closed", "give one surface a `temperature`"],
    );
    with(
        "[object.\"*\"]\nadiabatic = true\n",
        &["level of all its temperatures open"],
    );
    with(
        "[object.floor]\nisothermal = true\nemissivity = 0\n",
        &["exchanges nothing"],
    );
    place.write(
        "m.toml",
        "[object.floor]\nisothermal = true\n[default]\nemissivity = 0.9\ntemperature = 293\n",
    );
    let line = "solve room --thermal --materials m.toml";
    refused(
        &place,
        &format!("{line} --ground-temperature 5C"),
        &["--ground-temperature", "hemicube sky SCENE --matrix room"],
    );
    refused(&place, &format!("{line} --sky-temperature 20F"), &["20 °C"]);
    refused(
        &place,
        &format!("{line} --by object -o x.txt"),
        &[".npz, .csv, .json or .parquet"],
    );
    refused(
        &place,
        "solve room --materials m.toml --by object",
        &["no reflectance is known of `floor`", "--materials"],
    );
    let ran = place.line(&format!("{line} --max-iterations 1 --residual 1e-12"));
    assert_eq!(ran.code, Some(1));
    assert!(ran.err.contains("most is left of object `"), "{}", ran.err);
}

#[test]
fn mixed_conditions_keep_what_is_given_and_the_second_law() {
    let place = room();
    place.write(
        "m.toml",
        "[default]\nemissivity = 0.9\n[object.floor]\nflux = 40\n[object.ceiling]\nadiabatic = true\n[object.east]\n\
         temperature = \"5 °C\"\n[object.\"*st\"]\nisothermal = true\n\
         [object.\"*th\"]\nheat = -50\nisothermal = true\n",
    );
    for extra in ["", "--network --by object"] {
        let (found, json) = surfaces(&place, &format!("solve room --thermal --materials m.toml {extra}"));
        for (name, heat) in [
            ("floor", 1200.0),
            ("ceiling", 0.0),
            ("south", -50.0),
            ("north", -50.0),
            ("west", 0.0),
            ("east", -1100.0),
        ] {
            assert!((found[name].0 - heat).abs() < 0.5, "{extra} {name}: {}", found[name].0);
        }
        let error = json["relative_error"].as_f64().expect("a number");
        assert!(error < 5e-4, "{error}");
        for name in ["west", "south", "north"] {
            let [mean, least, most] = found[name].1;
            assert!(
                least == most && mean == least && mean > 278.15,
                "{extra} {name}: {:?}",
                found[name].1
            );
        }
        let [_, least, most] = found["floor"].1;
        assert_eq!(
            extra == "--network --by object",
            least == most,
            "{extra}: {least} to {most}"
        );
    }
    // Everything with one temperature, the rest floating: nothing flows.
    place.write(
        "same.toml",
        "[default]\nemissivity = 0.7\ntemperature = 300\n[object.east]\nisothermal = true\n[object.floor]\nadiabatic = \
         true\n[object.west]\nheat = 0\n",
    );
    let (found, _) = surfaces(&place, "solve room --thermal --materials same.toml --residual 1e-10");
    let black = STEFAN_BOLTZMANN * 300.0_f64.powi(4);
    for (name, (heat, kelvin)) in found {
        assert!(heat.abs() < 1e-6 * black, "{name}: {heat} W");
        assert!(
            kelvin.iter().all(|kelvin| (kelvin - 300.0).abs() < 1e-4),
            "{name}: {kelvin:?}"
        );
    }
}

#[test]
fn a_printed_file_is_what_holds() {
    let place = room();
    place.write(
        "m.toml",
        "[default]\nemissivity = 0.9\ntemperature = \"20 °C\"\n[object.\"*th\"]\nheat = 30\nisothermal = true\n",
    );
    let printed = place.line("solve room --materials m.toml --print-materials").is(0).out;
    assert!(
        printed.contains("[object.\"north\"]\nemissivity = 0.9\nheat = 30\nisothermal = true\n"),
        "{printed}"
    );
    place.write("again.toml", &printed);
    let solved = |file: &str| surfaces(&place, &format!("solve room --thermal --by object --materials {file}")).0;
    assert_eq!(solved("m.toml"), solved("again.toml"));
    // A solution without a surface has a file, too.
    assert!(
        place
            .line("solve room --print-materials")
            .is(0)
            .out
            .contains("[object.\"floor\"]")
    );
}

#[test]
fn sky_and_ground_have_temperatures_of_their_own() {
    let place = Place::new();
    // Two level plates that look away from each other, one metre wide.
    place.write(
        "plate.obj",
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 -1\nv 1 0 -1\nv 1 1 -1\nv 0 1 -1\no top\nf 1 2 3 4\no bottom\nf 8 7 6 5\n",
    );
    place.line("compute plate.obj -o plate --quiet").is(0);
    place.line("sky plate.obj --up z --matrix plate --quiet");
    place.write(
        "m.toml",
        "[default]\nemissivity = 0.8\ntemperature = 300\n[object.bottom]\nadiabatic = true\n",
    );
    let line = "solve plate --thermal --materials m.toml --sky-temperature -20C --ground-temperature 310";
    let (found, json) = surfaces(&place, line);
    let black = |kelvin: f64| STEFAN_BOLTZMANN * kelvin.powi(4);
    let top = 0.8 * (black(300.0) - black(253.15));
    assert!((found["top"].0 / top - 1.0).abs() < 1e-3, "{} {top}", found["top"].0);
    assert!((found["bottom"].1[0] - 310.0).abs() < 0.1, "{:?}", found["bottom"]);
    let lost = json["balance"]["surroundings"].as_f64().expect("a number");
    assert!((lost / top - 1.0).abs() < 1e-3, "{lost}");
}

#[test]
fn the_fields_cases_are_right() {
    let Some(scenes) = scenes_or_skip("the_fields_cases_are_right") else {
        return;
    };
    let place = Place::new();
    let cases = scenes.join("../cases").display().to_string();
    let properties = format!("{cases}/object-properties");
    place
        .line(&format!("compute {properties}/room.stl -o room --quiet"))
        .is(0);
    let (found, _) = surfaces(&place, &format!("solve room --thermal --materials {properties}/m.toml"));
    assert!((found["floor"].0 / 1565.0 - 1.0).abs() < 0.005, "{}", found["floor"].0);

    place
        .line(&format!("compute {properties}/zone.vs3 -o zone --quiet"))
        .is(0);
    let (found, _) = surfaces(
        &place,
        &format!("solve zone --thermal --materials {properties}/zone.toml"),
    );
    let black = |kelvin: f64| STEFAN_BOLTZMANN * kelvin.powi(4);
    let (floor, rest) = (1200.0, 1200.0 + 840.0);
    let resistance = 0.05 / (0.95 * floor) + 1.0 / floor + 0.05 / (0.95 * rest);
    let lumped = (black(303.0) - black(293.0)) / resistance;
    assert!(
        (found["Floor"].0 / lumped - 1.0).abs() < 0.005,
        "{} {lumped}",
        found["Floor"].0
    );
    // Emissivities are the file's where no table has them, and that is said.
    place.write(
        "t.toml",
        "[default]\ntemperature = 293\n[object.Floor]\ntemperature = 303\n",
    );
    let ran = place.line("solve zone --thermal --materials t.toml").is(0);
    assert!(
        ran.out.contains("of 6 surfaces as the scene's file has it: 0.95"),
        "{}",
        ran.out
    );
    let (own, _) = surfaces(&place, "solve zone --thermal --materials t.toml");
    assert!((own["Floor"].0 / found["Floor"].0 - 1.0).abs() < 1e-9);

    prism(&place, &format!("{cases}/prescribed-flux"));
}

/// A long prism of sides 4, 3 and 5 m with given fluxes: crossed strings and dense systems in two dimensions, and ends
/// that reradiate, 60 m apart.
fn prism(place: &Place, case: &str) {
    place
        .line(&format!("compute {case}/prism.obj -o prism --tolerance 0.5% --quiet"))
        .is(0);
    let text = std::fs::read_to_string(std::path::Path::new(case).join("mat.toml")).expect("a case");
    place.write("free.toml", &text);
    place.write("iso.toml", text.replace("flux =", "isothermal = true\nflux ="));
    let solved = |line: &str| {
        let (found, _) = surfaces(place, &format!("solve prism --thermal {line}"));
        [found["wall"].1[0], found["ramp"].1[0]]
    };
    let near = |found: [f64; 2], wanted: [f64; 2], by: f64, what: &str| {
        for (found, wanted) in found.iter().zip(wanted) {
            assert!((found - wanted).abs() < by, "{what}: {found} K, {wanted} K");
        }
    };
    // One radiosity a side: 640.68 and 598.77 K, for which a 3 × 3 system is enough.
    near(
        solved("--materials free.toml --network --by material"),
        [640.68, 598.77],
        0.5,
        "a network",
    );
    // One temperature a side, radiosities of strips of 0.5 m.
    near(
        solved("--materials iso.toml --by material"),
        [642.6, 599.6],
        0.5,
        "isothermal",
    );
    // Faces of 1 m, all of one area: 120 of the floor, 90 of the wall, 150 of the ramp, in this order.
    let (faces, _) = surfaces(place, "solve prism --thermal --materials free.toml --network --by face");
    let of_faces = |range: std::ops::Range<u32>| {
        let count = f64::from(range.end - range.start);
        let powers: f64 = range.map(|face| faces[&face.to_string()].1[0].powi(4)).sum();
        (powers / count).powf(0.25)
    };
    near([of_faces(120..210), of_faces(210..360)], [652.62, 604.64], 0.5, "free");
    // Strips of 1 m, of 0.5 m and in the limit have 652.6, 653.7 and 654.2, and 604.6, 605.2 and 605.6 K; triangles of
    // half a face lie between.
    near(
        solved("--materials free.toml --by material"),
        [653.4, 605.1],
        0.8,
        "triangles",
    );
}

#[test]
fn exchange_is_conserved_and_reproduces_the_solution() {
    let place = room();
    place.write(
        "m.toml",
        "[default]\nemissivity = 0.9\ntemperature = 293\n[object.floor]\nemissivity = 0.4\ntemperature = 303\n",
    );
    place
        .line("exchange room --materials m.toml -o x.json -o x.csv -o x.npz")
        .is(0);
    let json: Value =
        serde_json::from_str(&std::fs::read_to_string(place.path("x.json")).expect("a file")).expect("JSON");
    let rows = |key: &str| -> Vec<Vec<f64>> {
        let rows = json["bands"][0][key].as_array().expect("rows").iter();
        rows.map(|row| {
            row.as_array()
                .expect("a row")
                .iter()
                .map(|x| x.as_f64().expect("a number"))
                .collect()
        })
        .collect()
    };
    let (gebhart, conductance) = (rows("gebhart"), rows("conductance"));
    for row in &gebhart {
        assert!(
            (row.iter().sum::<f64>() - 1.0).abs() < 1e-6 && row.len() == 7,
            "{row:?}"
        );
    }
    // Q = Σ σ A F (T⁴ − T⁴) is what the network gives off.
    let kelvin: Vec<f64> = (0..6).map(|at| if at == 0 { 303.0 } else { 293.0 }).collect();
    let heat: f64 = (1..6)
        .map(|to| conductance[0][to] * (kelvin[0].powi(4) - kelvin[to].powi(4)))
        .sum();
    let (found, _) = surfaces(
        &place,
        "solve room --thermal --materials m.toml --network --by object --residual 1e-10",
    );
    assert!(
        (heat / found["floor"].0 - 1.0).abs() < 1e-5,
        "{heat} {}",
        found["floor"].0
    );
    assert!((conductance[0][1] / conductance[1][0] - 1.0).abs() < 1e-3);
    let csv = std::fs::read_to_string(place.path("x.csv")).expect("a file");
    assert_eq!(csv.lines().count(), 1 + 36);
    assert!(csv.starts_with("band,from,to,gebhart_factor,"));
    assert!(place.path("x.npz").is_file());
    // Patches as surfaces, and bands.
    place.write(
        "bands.toml",
        "bands = [\"thermal\", \"solar\"]\n[default]\nemissivity = [0.9, 0.3]\n[object.floor]\nemissivity = 0.5\n",
    );
    let report = place
        .line("exchange room --materials bands.toml --by patch --json")
        .is(0)
        .json();
    assert_eq!(
        (report["surfaces"].as_u64(), report["bands"][1].as_str()),
        (Some(192), Some("solar"))
    );
    for band in 0..2 {
        assert!(report["conservation"][band].as_f64().is_some_and(|off| off < 1e-6));
        assert!(
            report["reciprocity"][band].as_f64().is_some_and(|off| off < 0.02),
            "{report}"
        );
    }
    // Other threads write equal bytes.
    place
        .line("exchange room --materials m.toml -o y.npz --threads 1 --quiet")
        .is(0);
    let bytes = |name: &str| std::fs::read(place.path(name)).expect("a file");
    assert!(bytes("x.npz") == bytes("y.npz"));
    place.write("none.toml", "[object.floor]\nemissivity = 0.4\n");
    refused(
        &place,
        "exchange room --materials none.toml",
        &["no emissivity is known of `ceiling`"],
    );
    refused(
        &place,
        "exchange room --materials m.toml -o x.txt",
        &[".csv, .json or .npz"],
    );
    refused(&place, "exchange room --materials m.toml -o x.csv", &["--overwrite"]);
}

#[test]
fn light_is_given_by_objects_too() {
    let place = room();
    place.write(
        "l.toml",
        "bands = [\"all\"]\n[default]\nreflectance = 0.5\n[object.floor]\nemission = 2\nreflectance = 0.2\n",
    );
    let report = place.line("solve room --materials l.toml --json").is(0).json();
    let emitted = report["balance"][0]["emitted"].as_f64().expect("a number");
    assert!((emitted - 60.0).abs() < 1e-9, "2 W/m² of 30 m²: {emitted}");
    assert_eq!(report["surfaces"]["light"][0]["object"], "floor");
    assert_eq!(report["surfaces"]["light"][1]["reflectance"][0], 0.5);
}

/// A black floor below an open sky that is 290 K by a schedule of one moment, and by an option.
#[test]
fn the_surroundings_of_a_moment_are_those_of_its_balance_and_of_points() {
    let place = Place::new();
    place.write(
        "g.obj",
        "o ground\nv 0 0 0\nv 100 0 0\nv 100 100 0\nv 0 100 0\nf 1 2 3 4\n",
    );
    place.write("m.toml", "[default]\nemissivity = 1\ntemperature = 300\n");
    place.write("warm.csv", "surface,a\n(surroundings),290\n");
    place.write("p.csv", "x,y,z\n50,50,1\n");
    place.line("compute g.obj -o g --up z").is(0);
    let found = |line: &str, name: &str| {
        let solved =
            format!("solve g --thermal --materials m.toml --solution {name} --by object -o {name}.json {line}");
        place.line(&solved).is(0);
        let text = std::fs::read_to_string(place.path(format!("{name}.json"))).expect("results");
        let json: Value = serde_json::from_str(&text).expect("JSON");
        // A list where there are moments.
        let balance = json.get(0).unwrap_or(&json)["balance"].clone();
        let points = format!("points g.obj --up z --points p.csv --as sphere --solution g:{name} -o {name}.csv");
        place.line(&points).is(0);
        let felt = std::fs::read_to_string(place.path(format!("{name}.csv"))).expect("points");
        (balance, felt)
    };
    let (by_schedule, felt_by_schedule) = found("--schedule warm.csv", "scheduled");
    let (by_option, felt_by_option) = found("--sky-temperature 290", "given");
    let heat = 1e4 * STEFAN_BOLTZMANN * (300f64.powi(4) - 290f64.powi(4));
    for balance in [&by_schedule, &by_option] {
        let found = balance["surroundings"].as_f64().expect("a heat");
        assert!((found - heat).abs() < 1e-6 * heat, "{balance}");
    }
    assert_eq!(felt_by_schedule, felt_by_option);
}

#[test]
fn a_solution_stays_where_the_next_one_is_refused() {
    let place = room();
    place.write("m.toml", "[default]\nemissivity = 0.9\ntemperature = 293\n");
    place.write(
        "bad.toml",
        "[default]\nemissivity = 0.9\ntemperature = 293\n[object.floor]\nheat = -1e6\n",
    );
    let folder = place.path("room/solutions");
    place.line("solve room --thermal --materials bad.toml").is(2);
    assert!(!folder.exists(), "nothing is left of a solution that is none");
    place.line("solve room --thermal --materials m.toml").is(0);
    let before = std::fs::read(folder.join("thermal/solution.json")).expect("a report");
    place
        .line("solve room --thermal --materials bad.toml")
        .is(2)
        .says(&["cannot be"]);
    assert_eq!(
        std::fs::read(folder.join("thermal/solution.json")).expect("a report"),
        before
    );
}
