//! Suns and what they leave: shadows to an error, suns from below in space, and heat over moments under loads, held
//! against closed forms.

use crate::heat_cases::Obj;
use hemicube_tests::runs::Place;

const SIGMA: f64 = 5.670_374_419e-8;

/// A floor of 4 × 4 facing up, its back facing down, and a plate of 1 × 1 above it that faces down.
fn shaded() -> String {
    let mut obj = Obj::default();
    let square =
        |x: f64, y: f64, z: f64, side: f64| [[x, y, z], [x + side, y, z], [x + side, y + side, z], [x, y + side, z]];
    let turned = |mut corners: [[f64; 3]; 4]| {
        corners.reverse();
        corners
    };
    obj.surface("floor", "m", &square(0.0, 0.0, 0.0, 4.0));
    obj.surface("under", "m", &turned(square(0.0, 0.0, -0.1, 4.0)));
    obj.surface("plate", "m", &turned(square(1.0, 1.0, 1.0, 1.0)));
    obj.text
}

fn cells(text: &str) -> Vec<Vec<String>> {
    let lines = text.lines().skip(1);
    lines.map(|line| line.split(',').map(str::to_owned).collect()).collect()
}

#[test]
fn suns_light_what_no_plate_shades_and_from_below_in_space() {
    let place = Place::new();
    place.write("shaded.obj", shaded());
    // Straight down, slanted, and from below.
    place.write("suns.txt", "0 0 1\n0.5 0.25 1\n0 0 -2\n");
    let line = "sky shaded.obj --up z --suns suns.txt --by object -o suns.csv --overwrite";
    let ran = |extra: &str| {
        place.line(&format!("{line} {extra}")).is(0);
        cells(&std::fs::read_to_string(place.path("suns.csv")).expect("a table"))
    };
    let number = |row: &[String], at: usize| row[at].parse::<f64>().expect("a number");
    let found = ran("--horizon none");
    let row = |sun: &str, name: &str| {
        let is = |row: &&Vec<String>| row[0] == sun && row[4] == name;
        found.iter().find(is).expect("a row").clone()
    };
    // Area, projected, sunlit as seen from the sun, sunlit on the surface.
    let floor = row("0", "floor");
    assert!((number(&floor, 8) - 15.0).abs() < 0.02 * 16.0, "{floor:?}");
    assert!((number(&floor, 6) - 16.0).abs() < 1e-9, "{floor:?}");
    let slanted = row("1", "floor");
    let cosine = 1.0 / (1.0f64 + 0.25 + 0.0625).sqrt();
    assert!((number(&slanted, 8) - 15.0).abs() < 0.02 * 16.0, "{slanted:?}");
    assert!((number(&slanted, 6) - 16.0 * cosine).abs() < 1e-9, "{slanted:?}");
    assert!(
        (number(&slanted, 7) - number(&slanted, 8) * cosine).abs() < 1e-9,
        "{slanted:?}"
    );
    assert_eq!(number(&row("0", "under"), 8), 0.0);
    assert!((number(&row("2", "under"), 8) - 16.0).abs() < 1e-6);
    assert_eq!(number(&row("2", "floor"), 8), 0.0);
    // On the ground nothing comes from below.
    let found = ran("--horizon ground");
    let under = found
        .iter()
        .find(|row| row[0] == "2" && row[4] == "under")
        .expect("a row");
    assert_eq!(number(under, 8), 0.0);
}

/// A plate alone in cold space, black below, grey above.
#[test]
fn loads_over_moments_give_each_its_temperature() {
    let place = Place::new();
    place.write("shaded.obj", shaded());
    place.write(
        "m.toml",
        "[default]\nemissivity = 0.8\nadiabatic = true\n[object.plate]\ntemperature = 0\nemissivity = 1\n",
    );
    place.line("compute shaded.obj -o f --tolerance 0.1%").is(0);
    let surfaces = "surface,night,dawn,noon\nunder,0,100,400\nfloor,50,50,50\n";
    place.write("load.csv", surfaces);
    place.write("turned.csv", "time,under,floor\nnight,0,50\ndawn,100,50\nnoon,400,50\n");
    let solved = |line: &str, file: &str| {
        let line = format!("solve f --thermal --materials m.toml --sky-temperature 0 {line} -o {file} --overwrite");
        place.line(&line).is(0);
        std::fs::read_to_string(place.path(file)).expect("a table")
    };
    let lines = solved("--load load.csv --by object", "a.csv");
    assert_eq!(lines, solved("--load turned.csv --by object", "b.csv"));
    assert!(lines.starts_with("moment,object,patches,area,heat_W"), "{lines}");
    let found = cells(&lines);
    for (moment, load) in [("dawn", 100.0f64), ("noon", 400.0)] {
        let under = found
            .iter()
            .find(|row| row[0] == moment && row[1] == "under")
            .expect("a row");
        let (heat, kelvin) = (under[4].parse::<f64>().expect("W"), under[6].parse::<f64>().expect("K"));
        // All of it leaves for space.
        assert!((heat - 16.0 * load).abs() < 1e-3 * 16.0 * load, "{under:?}");
        assert!((kelvin - (load / (0.8 * SIGMA)).powf(0.25)).abs() < 0.05, "{under:?}");
    }
    let night = found
        .iter()
        .find(|row| row[0] == "night" && row[1] == "under")
        .expect("a row");
    assert!(night[6].parse::<f64>().expect("K") < 1.0, "{night:?}");
    // By patch, the head names quantities and moments.
    let by_patch = solved("--load load.csv", "p.csv");
    let head = by_patch.lines().next().expect("a head");
    assert!(
        head.contains("temperature_noon") && head.contains("flux_night"),
        "{head}"
    );
    // A temperature over moments, and what lies outside.
    place.write(
        "hours.csv",
        "time,plate,(surroundings)\nnight,250,3 K\nnoon,20 °C,300\n",
    );
    let hours = cells(&solved("--schedule hours.csv --by object", "h.csv"));
    let plate: Vec<&str> = hours
        .iter()
        .filter(|row| row[1] == "plate")
        .map(|row| row[6].as_str())
        .collect();
    assert_eq!(plate, ["250", "293.15"]);
    let under: Vec<f64> = (hours.iter().filter(|row| row[1] == "under"))
        .map(|row| row[6].parse().expect("K"))
        .collect();
    // It sees nothing but space, and takes its temperature.
    assert!(
        (under[0] - 3.0).abs() < 0.01 && (under[1] - 300.0).abs() < 0.01,
        "{under:?}"
    );
}

#[test]
fn tables_that_do_not_fit_are_refused_with_the_next_step() {
    let place = Place::new();
    place.write("shaded.obj", shaded());
    place.write("m.toml", "[default]\nemissivity = 0.8\ntemperature = 300\n");
    place.line("compute shaded.obj -o f").is(0);
    for (text, said) in [
        ("surface,noon\nroof,1\n", "matches no object and no material"),
        ("patch,noon\n600,1\n", "the patch `600`"),
        ("floor,1\n", "`patch`, `surface` or `time` says what a line is"),
        ("surface,noon\nfloor,warm\n", "load.csv:2: `warm` is no number of W/m²"),
        (
            "surface,noon\nfloor,1,2\n",
            "load.csv:2: has 3 fields where the header has 2",
        ),
        ("surface,noon\n(surroundings),1\n", "which are no surface"),
    ] {
        place.write("load.csv", text);
        let line = "solve f --thermal --materials m.toml --sky-temperature 0 --load load.csv";
        place.line(line).is(2).says(&[said]);
    }
}
