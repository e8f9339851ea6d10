//! Suns and what they leave: shadows to an error, suns from below in space, and heat over moments under loads, held
//! against closed forms.

use crate::heat_cases::Obj;
use hemicube_tests::random::Random;
use hemicube_tests::runs::Place;
use hemicube_tests::scenes::{say, scenes_or_skip};
use hemicube_weather::sky::Perez;

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
    // The same suns by azimuth and altitude.
    let azimuth = 0.5f64.atan2(0.25).to_degrees();
    let altitude = 1.0f64.atan2(0.5f64.hypot(0.25)).to_degrees();
    place.write(
        "suns.txt",
        format!("Altitude (deg);name;azimuth (deg)\n90;noon;0\n{altitude};later;{azimuth}\n-90;night;10\n"),
    );
    for (row, other) in found.iter().zip(ran("--horizon none")) {
        for at in 5..9 {
            assert!((number(row, at) - number(&other, at)).abs() < 1e-5, "{row:?} {other:?}");
        }
    }
    place.write("wrong.txt", "azimuth,altitude\n10,95\n");
    place
        .line("sky shaded.obj --up z --suns wrong.txt")
        .is(2)
        .says(&["wrong.txt:2: the altitude is 95°, beyond 90°"]);
    for (header, said) in [
        (
            "azimuth,altitude,x,y,z",
            "the columns `azimuth` and `x` both say where the sun stands",
        ),
        (
            "azimuth,altitude,azimuth",
            "the columns `azimuth` and `azimuth` are the same",
        ),
        ("azimuth (rad),altitude", "column `azimuth (rad)` is in rad"),
    ] {
        let columns = header.split(',').count();
        place.write("wrong.txt", format!("{header}\n{}\n", vec!["1"; columns].join(",")));
        place.line("sky shaded.obj --up z --suns wrong.txt").is(2).says(&[said]);
    }
    place.write("more.txt", "x,y,z,pressure (kPa)\n0,0,1,101\n");
    place
        .line("sky shaded.obj --up z --suns more.txt -o more --overwrite")
        .is(0)
        .says(&["nothing reads `pressure (kPa)` of `more.txt`"]);
    place.write("suns.txt", "0 0 1\n0.5 0.25 1\n0 0 -2\n");
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

/// Tables of moments are taken line by line: what would pair other moments, or read numbers in another unit, ends.
#[test]
fn tables_of_other_moments_or_units_are_refused() {
    let place = Place::new();
    place.write("shaded.obj", shaded());
    place.write(
        "m.toml",
        "bands = [\"all\"]\n[default]\nreflectance = 0.5\nemissivity = 0.8\nabsorptance = 0.5\nadiabatic = \
         true\n[object.plate]\ntemperature = 300\n",
    );
    place.write("points.txt", "1.5 1.5 0.4\n");
    place.write("load.csv", "surface,06:00,12:00\nunder,0,500\n");
    place.write("one.csv", "surface,noon\nunder,500\n");
    place.write("hours.csv", "surface,12:00,06:00\nfloor,310,300\n");
    let suns = |name: &str, moments: [&str; 2], head: &str, ends: [&str; 2]| {
        let line = |at: usize| format!("{},0,0,1,{},100{}\n", moments[at], 400 * at, ends[at]);
        place.write(name, format!("time,x,y,z,direct,diffuse{head}\n{}{}", line(0), line(1)));
    };
    suns("day.csv", ["06:00", "12:00"], "", ["", ""]);
    suns("turned.csv", ["12:00", "06:00"], "", ["", ""]);
    suns(
        "celsius.csv",
        ["06:00", "12:00"],
        ",sky_temperature (degC)",
        [",5", ",10"],
    );
    suns("gap.csv", ["06:00", "12:00"], ",sky_temperature", [",280", ","]);
    suns("twice.csv", ["06:00", "12:00"], ",direct", [",5", ",10"]);
    suns("more.csv", ["06:00", "12:00"], ",pressure (kPa)", [",101", ",101"]);
    place.line("compute shaded.obj -o f").is(0);
    let heat = "solve f --thermal --materials m.toml --sky-temperature 280";
    let lit = "points shaded.obj --up z --points points.txt --as sphere --solution f:radiosity";
    place.line("solve f --materials m.toml --suns day.csv").is(0);
    for (line, said) in [
        (
            format!("{heat} --load load.csv --schedule hours.csv"),
            "moment 1 is `06:00` in `load.csv` and `12:00` in `hours.csv`",
        ),
        (
            format!("{heat} --schedule hours.csv --suns day.csv"),
            "moment 1 is `12:00` in `hours.csv` and `06:00` in `day.csv`",
        ),
        (
            format!("{lit} --suns turned.csv"),
            "moment 1 is `12:00` in `turned.csv` and `06:00` in the solution of light in `f`",
        ),
        (
            format!("{heat} --suns celsius.csv"),
            "celsius.csv:1: column `sky_temperature (degC)` is in degC, and K is needed",
        ),
        (
            format!("{heat} --suns gap.csv"),
            "gap.csv:3: `12:00` has no `sky_temperature`, and other moments have one",
        ),
        (
            format!("{heat} --suns twice.csv"),
            "twice.csv:1: the columns `direct` and `direct` are the same",
        ),
    ] {
        place.line(&line).is(2).says(&[said]);
    }
    // The same moments, or a single one, which holds for all; and what nothing reads is said.
    place.line(&format!("{lit} --suns day.csv")).is(0);
    place
        .line(&format!("{heat} --load one.csv --suns more.csv"))
        .is(0)
        .says(&["nothing reads `pressure (kPa)` of `more.csv`"]);
}

/// Sun straight above and an even sky: a floor that reflects half, and the plate's shadow on it.
#[test]
fn suns_and_sky_light_and_heat_patches_with_reflections() {
    let place = Place::new();
    place.write("shaded.obj", format!("mtllib shaded.mtl\n{}", shaded()));
    place.write("shaded.mtl", "newmtl m\nKd 0.5 0.4 0.3\n");
    place.write(
        "suns.csv",
        "time,x,y,z,direct,diffuse\nnoon,0,0,1,800,0\nslanted,1,0,1,800,0\nnight,0,0,-1,0,0\ncloud,0,0,1,0,100\n",
    );
    place.write("m.toml", "bands = [\"all\"]\n[default]\nreflectance = 0.5\n");
    place.line("compute shaded.obj -o f --tolerance 0.1% --split 8").is(0);
    place
        .line("solve f --materials m.toml --suns suns.csv --by object -o light.csv")
        .is(0);
    let text = std::fs::read_to_string(place.path("light.csv")).expect("a table");
    let head: Vec<&str> = text.lines().next().expect("a head").split(',').collect();
    let column = |name: &str| {
        let is = |head: &&str| head.starts_with(name);
        head.iter().position(is).unwrap_or_else(|| panic!("no {name}: {text}"))
    };
    let found = cells(&text);
    let value = |moment: &str, name: &str, what: &str| -> f64 {
        let is = |row: &&Vec<String>| row[0] == moment && row[column("object")] == name;
        let row = found
            .iter()
            .find(is)
            .unwrap_or_else(|| panic!("{moment} {name}: {text}"));
        row[column(what)].parse().expect("a number")
    };
    // A scene that lies elsewhere says where shadows fall, and nothing of bands.
    place
        .line("solve f --materials m.toml --suns suns.csv --scene shaded.obj")
        .is(0);
    // 15 of 16 m² lie in the sun; the plate's dark side gets light from the floor, and gives half of it back.
    let direct = 800.0 * 15.0 / 16.0;
    let floor = value("noon", "floor", "irradiance");
    assert!((floor - direct).abs() < 0.01 * direct, "{floor} {direct}");
    let back = value("noon", "plate", "irradiance");
    assert!(back > 0.0 && back < 0.5 * 800.0, "{back}");
    assert_eq!(value("noon", "under", "irradiance"), 0.0);
    let slanted = value("slanted", "floor", "irradiance");
    let cosine = 0.5f64.sqrt();
    // The shadow has moved, and is as large.
    assert!((slanted - direct * cosine).abs() < 0.015 * direct, "{slanted}");
    assert_eq!(value("night", "floor", "irradiance"), 0.0);
    // The floor sees the plate by F = 1 m² / 16 m² times the plate's F to it; the rest of what it sees is sky.
    let cloud = value("cloud", "floor", "irradiance");
    assert!(cloud < 100.0 && cloud > 100.0 * 15.0 / 16.0, "{cloud}");
    // By patch and in three bands: each column names its band and its moment.
    place.write("bands.toml", "[default]\nreflectance = [0.5, 0.4, 0.3]\n");
    place
        .line("solve f --materials bands.toml --suns suns.csv -o patches.csv")
        .is(0);
    let text = std::fs::read_to_string(place.path("patches.csv")).expect("a table");
    let head = text.lines().next().expect("a head").split(',');
    let found: Vec<&str> = head.filter_map(|head| head.strip_prefix("irradiance_")).collect();
    let each = |moment| ["red", "green", "blue"].map(|band| format!("{band}_{moment}"));
    assert_eq!(found, ["noon", "slanted", "night", "cloud"].map(each).concat());
    // Points take light of one band.
    place.write("points.txt", "1.5 1.5 0.4\n");
    place
        .line("points shaded.obj --up z --points points.txt --as sphere --suns suns.csv --solution f:radiosity")
        .is(2)
        .says(&["12 right-hand sides", "bands = [\"all\"]"]);
}

/// Each side of a satellite in the sun, black to it: what is absorbed is what is sunlit, and an adiabatic side radiates
/// it away.
#[test]
fn a_satellite_absorbs_what_its_sides_see_of_the_sun() {
    let place = Place::new();
    let Some(cases) = scenes_or_skip("suns").map(|scenes| scenes.join("../cases/space-sun")) else {
        return;
    };
    std::fs::copy(cases.join("sat.obj"), place.path("sat.obj")).expect("the satellite");
    let directions = std::fs::read_to_string(cases.join("suns.txt")).expect("24 suns");
    let mut table = "time,x,y,z,direct\n".to_owned();
    for (number, line) in directions.lines().skip(1).enumerate() {
        let cells: Vec<&str> = line.split_whitespace().collect();
        table += &format!("{number},{},1361\n", cells.join(","));
    }
    place.write("suns.csv", &table);
    place.write(
        "m.toml",
        "[default]\nemissivity = 1\nabsorptance = 1\nadiabatic = true\n",
    );
    place.line("compute sat.obj -o sat --tolerance 0.3%").is(0);
    place
        .line("solve sat --thermal --materials m.toml --sky-temperature 0 --suns suns.csv --by object -o heat.csv")
        .is(0);
    let heat = cells(&std::fs::read_to_string(place.path("heat.csv")).expect("a table"));
    assert_eq!(heat.len() % 24, 0);
    let share = |sun: &str, name: &str| -> f64 {
        let is = |row: &&Vec<String>| row[0] == sun && row[1] == name;
        let row = heat.iter().find(is).expect("a row");
        let (area, watts) = (row[3].parse::<f64>().expect("m²"), row[4].parse::<f64>().expect("W"));
        watts / (area * 1361.0)
    };
    // Own rays of the case, 40,000 a side, and the cosine of each side to this sun.
    for (name, sunlit, cosine) in [("wing_l_back", 0.737, 0.208_333), ("py", 0.861, 0.800_138)] {
        let found = share("14", name) / cosine;
        assert!(
            (found - sunlit).abs() < 0.003 + 0.003 * sunlit,
            "{name}: {found} for {sunlit}"
        );
    }
}

/// Suns all round a satellite, half of them from below: the sunlit share of each side by 40,000 rays of the test's own.
#[test]
fn a_satellite_has_the_sunlit_shares_of_rays_under_every_sun() {
    let place = Place::new();
    let Some(cases) = scenes_or_skip("suns").map(|scenes| scenes.join("../cases/space-sun")) else {
        return;
    };
    for name in ["sat.obj", "suns.txt"] {
        std::fs::copy(cases.join(name), place.path(name)).expect("the satellite and its suns");
    }
    place
        .line("sky sat.obj --up z --horizon none --suns suns.txt --by object -o suns.csv")
        .is(0);
    let found = cells(&std::fs::read_to_string(place.path("suns.csv")).expect("a table"));
    let number = |text: &str| text.parse::<f64>().expect("a number");
    // Each side is an object of one quad.
    let (mut corners, mut quads) = (Vec::new(), Vec::new());
    let mut name = String::new();
    for line in std::fs::read_to_string(place.path("sat.obj")).expect("OBJ").lines() {
        let parts: Vec<&str> = line.split_whitespace().collect();
        match parts[..] {
            ["o", of] => of.clone_into(&mut name),
            ["v", x, y, z] => corners.push([x, y, z].map(number)),
            ["f", a, b, c, d] => {
                let at = |index: &str| corners[index.parse::<usize>().expect("a corner") - 1];
                quads.push((name.clone(), [a, b, c, d].map(at)));
            }
            _ => {}
        }
    }
    let triangles: Vec<_> = (quads.iter())
        .flat_map(|(_, [a, b, c, d])| [[*a, *b, *c], [*a, *c, *d]])
        .collect();
    let mut random = Random(11);
    let mut worst = (0.0, String::new());
    let rays = 200;
    for row in &found {
        let along = [1, 2, 3].map(|at| number(&row[at]));
        let (_, [a, b, _, d]) = quads.iter().find(|(name, _)| *name == row[4]).expect("a side");
        let mut open = 0;
        if number(&row[6]) > 0.0 {
            for ray in 0..rays * rays {
                // One in each of 200 × 200 cells.
                let u = (f64::from(ray % rays) + random.unit()) / f64::from(rays);
                let v = (f64::from(ray / rays) + random.unit()) / f64::from(rays);
                let from = [0, 1, 2].map(|k| a[k] + u * (b[k] - a[k]) + v * (d[k] - a[k]));
                open += u32::from(first(&triangles, from, along).is_none());
            }
        }
        let exact = f64::from(open) / f64::from(rays * rays);
        let off = (number(&row[8]) / number(&row[5]) - exact).abs();
        if off > worst.0 {
            worst = (off, format!("sun {}, {}: {exact}", row[0], row[4]));
        }
    }
    say(&format!(
        "sunlit shares of {} sides: at most {worst:?} off",
        found.len()
    ));
    assert!(found.len() == 24 * 10 && worst.0 < 0.003, "{} {worst:?}", found.len());
}

/// A lawn and a wall that looks south, far apart: nothing but sun and sky.
fn lawn_and_wall() -> String {
    let mut obj = Obj::default();
    obj.surface("lawn", "m", &[[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]]);
    obj.surface(
        "wall",
        "m",
        &[[1e3, 0., 0.], [1001., 0., 0.], [1001., 0., 1.], [1e3, 0., 1.]],
    );
    obj.text
}

/// Ratio of the irradiance of a wall to that of a lawn under the overcast sky of the CIE, L ∝ 1 + 2 sin γ: in closed
/// form (π/6 + 4/9) / (7π/9).
fn overcast_on_a_wall() -> f64 {
    use std::f64::consts::PI;
    (PI / 6.0 + 4.0 / 9.0) / (7.0 * PI / 9.0)
}

#[test]
fn a_weather_file_lights_lawn_and_wall_by_its_sun_and_sky() {
    let place = Place::new();
    place.write("open.obj", lawn_and_wall());
    place.write("year.epw", hemicube_tests::weather::epw());
    place.write("m.toml", "bands = [\"all\"]\n[default]\nreflectance = 0.2\n");
    place.line("compute open.obj -o f").is(0);
    let suns = |sky: &str| {
        place
            .line(&format!(
                "suns year.epw --times 06-21 --sky {sky} -o day.csv --overwrite"
            ))
            .is(0);
        cells(&std::fs::read_to_string(place.path("day.csv")).expect("a table"))
    };
    let solved = || {
        place
            .line("solve f --materials m.toml --suns day.csv --by object -o light.csv --overwrite")
            .is(0);
        cells(&std::fs::read_to_string(place.path("light.csv")).expect("a table"))
    };
    let day = suns("overcast");
    assert_eq!(day.len(), 24);
    place
        .line("suns year.epw --times 06-21 --times 02-29")
        .is(2)
        .says(&["`year.epw` has no day of `02-29`: its days go from 01-01 to 12-31"]);
    // At noon the sun stands in the south, 60.9° high on this day at 52.5° N.
    let number = |row: &[String], at: usize| row[at].parse::<f64>().expect("a number");
    let noon = &day[11];
    assert!(noon[0].starts_with("2023-06-21T11:30"), "{noon:?}");
    assert!(
        (number(noon, 3) - 60.9f64.to_radians().sin()).abs() < 0.01 && number(noon, 2) < -0.4,
        "{noon:?}"
    );
    // A sky that is not even needs to know which part of it each patch sees.
    place
        .line("solve f --materials m.toml --suns day.csv")
        .is(2)
        .says(&["a sky such as `overcast`", "hemicube sky SCENE --matrix f"]);
    place.line("sky open.obj --matrix f --up z --division reinhart:2").is(0);
    let irradiance = |found: &[Vec<String>], moment: usize, name: &str| {
        let row = found.iter().find(|row| row[0] == day[moment][0] && row[1] == name);
        number(row.expect("a row"), 5)
    };
    for sky in ["overcast", "perez", "uniform"] {
        suns(sky);
        let found = solved();
        for moment in [7, 11, 15] {
            let (direct, diffuse) = (number(&day[moment], 4), number(&day[moment], 5));
            let level = direct * number(&day[moment], 3) + diffuse;
            let lawn = irradiance(&found, moment, "lawn");
            assert!((lawn - level).abs() < 5e-3 * level, "{sky} {moment}: {lawn} {level}");
            let beam = direct * (-number(&day[moment], 2)).max(0.0);
            let of_sky = match sky {
                "overcast" => overcast_on_a_wall() * diffuse,
                "uniform" => 0.5 * diffuse,
                _ => continue,
            };
            let wall = irradiance(&found, moment, "wall");
            assert!(
                (wall - beam - of_sky).abs() < 0.01 * of_sky + 5e-3 * beam,
                "{sky}: {wall} {beam} {of_sky}"
            );
        }
    }
}

#[test]
fn hours_of_clear_days_are_those_of_a_place() {
    let place = Place::new();
    place.write("no.epw", "time,x,y,z\n");
    let line = "suns --location 52.52,13.405,34 --times 2026-06-21T12:00+02:00/2026-06-21T14:00+02:00/1h";
    let made = place.line(line).is(0);
    assert_eq!(
        place.line(&format!("{line} -o -")).is(0).out,
        made.out,
        "`-` is standard output"
    );
    let found = cells(&made.out);
    assert_eq!(found.len(), 3, "{}", made.out);
    // 58.15° high, 149.36° from north (pvlib); Ineichen's clear sky at turbidity 3.
    let number = |at: usize| found[0][at].parse::<f64>().expect("a number");
    let (altitude, azimuth) = (58.15f64.to_radians(), 149.36f64.to_radians());
    for (at, expected) in [
        (1, altitude.cos() * azimuth.sin()),
        (2, altitude.cos() * azimuth.cos()),
        (3, altitude.sin()),
    ] {
        assert!((number(at) - expected).abs() < 3e-4, "{}", made.out);
    }
    assert!(
        (number(4) - 860.0).abs() < 40.0 && (number(5) - 105.0).abs() < 25.0,
        "{}",
        made.out
    );
    for (line, words) in [
        ("suns --location 91,0 --times 2026-06-21T12:00Z", "degrees north"),
        ("suns --location 52,13 --times 2026-06-21T12:00", "has no UTC offset"),
        ("suns --times 2026-06-21T12:00Z", "required"),
        ("suns none.epw", "none.epw` cannot be read"),
        ("suns no.epw", "no.epw:1: a line that begins with `LOCATION`"),
    ] {
        place.line(line).is(2).says(&[words]);
    }
}

#[test]
fn points_get_sun_and_sky_and_feel_them() {
    let place = Place::new();
    place.write("open.obj", lawn_and_wall());
    place.write(
        "day.csv",
        "time,x,y,z,direct,diffuse,sky,sky_temperature,air_temperature,humidity,wind\n\
         noon,0,-0.6,0.8,800,100,overcast,280,25,50,2\nnight,0,-0.6,-0.8,0,0,perez,270,15,70,0.1\n",
    );
    let table = |line: &str| {
        place
            .line(&format!(
                "points open.obj --up z --suns day.csv -o felt.csv --overwrite {line}"
            ))
            .is(0);
        let text = std::fs::read_to_string(place.path("felt.csv")).expect("a table");
        let head: Vec<String> = text
            .lines()
            .next()
            .expect("a head")
            .split(',')
            .map(str::to_owned)
            .collect();
        let rows = cells(&text);
        move |row: usize, name: &str| -> f64 {
            let at = head.iter().position(|head| head.starts_with(name)).expect("a column");
            rows[row][at].parse().expect("a number")
        }
    };
    // A plane that looks up, and one that looks south, where no one else is.
    place.write("planes.txt", "0 0 500 0 0 1\n0 0 500 0 -1 0\n");
    let planes = table("--points planes.txt");
    assert!((planes(0, "direct") - 640.0).abs() < 0.01 && (planes(1, "direct") - 480.0).abs() < 0.01);
    assert!((planes(0, "diffuse") - 100.0).abs() < 0.1, "{}", planes(0, "diffuse"));
    let wall = 100.0 * overcast_on_a_wall();
    assert!(
        (planes(1, "diffuse") - wall).abs() < 5e-3 * wall,
        "{} {wall}",
        planes(1, "diffuse")
    );
    assert_eq!((planes(2, "direct"), planes(2, "diffuse")), (0.0, 0.0));
    // A sphere between sky and ground: a quarter of the beam, half of each.
    place.write("high.txt", "0 0 500\n");
    place.write("m.toml", "[default]\nemissivity = 1\ntemperature = 300\n");
    place.line("compute open.obj -o f").is(0);
    place
        .line("solve f --thermal --materials m.toml --sky-temperature 280")
        .is(0);
    let sphere = table("--points high.txt --as sphere --solution f --ground-temperature 300");
    let (light, dark) = (sphere(0, "irradiance"), sphere(1, "irradiance"));
    // Half of an overcast sky, as a sphere sees it: ∫ (1 + 2 sin γ) / ∫ (1 + 2 sin γ) sin γ, times π over 4π.
    let of_sky = 100.0 * 0.25 * 2.0 / (7.0 / 9.0 * 1.5);
    assert!((light - 200.0 - of_sky).abs() < 0.01 * of_sky, "{light} {of_sky}");
    assert_eq!(dark, 0.0);
    for (row, sky, short) in [(0, 280.0f64, light), (1, 270.0, 0.0)] {
        let long = SIGMA * 0.5 * (sky.powi(4) + 300f64.powi(4));
        let radiant = ((0.7 * short + 0.97 * long) / (0.97 * SIGMA)).powf(0.25);
        let found = sphere(row, "mean_radiant_temperature");
        assert!((found - radiant).abs() < 0.05, "{row}: {found} {radiant}");
        let [air, humidity, wind] = [[25.0, 50.0, 2.0], [15.0, 70.0, 0.5]][row];
        let utci = hemicube_weather::comfort::utci(air, found - 273.15, wind, humidity).expect("in range");
        assert!(
            (sphere(row, "utci") - utci).abs() < 0.01,
            "{row}: {} {utci}",
            sphere(row, "utci")
        );
    }
    // A person gets f_p of the beam: 0.308 cos(γ (1 − γ² / 48402)) at 53.13°.
    let person = table("--points high.txt --as person");
    let angle = 53.130_102f64;
    let factor = 0.308 * (angle * (1.0 - angle * angle / 48_402.0)).to_radians().cos();
    assert!(
        (person(0, "direct") - 800.0 * factor).abs() < 0.1,
        "{}",
        person(0, "direct")
    );
    for (line, words) in [
        (
            "--points planes.txt --solution f",
            "is of `--as person`, `seated`, `sphere` or `cylinder`",
        ),
        (
            "--points high.txt --solution f --solution f",
            "two of `--solution` are of heat",
        ),
    ] {
        let line = format!("points open.obj --up z --suns day.csv {line}");
        place.line(&line).is(2).says(&[words]);
    }
}

/// A shaded point has no beam; a lawn in the sun lights what looks down at it by its reflection.
#[test]
fn points_have_shadows_and_reflected_light() {
    let place = Place::new();
    place.write("shaded.obj", shaded());
    place.write("noon.csv", "time,x,y,z,direct,diffuse\nnoon,0,0,1,800,0\n");
    place.write("m.toml", "bands = [\"all\"]\n[default]\nreflectance = 0.5\n");
    place.write(
        "points.txt",
        "1.5 1.5 0.5 0 0 1\n3.5 3.5 0.5 0 0 1\n3.5 3.5 0.001 0 0 -1\n",
    );
    place.line("compute shaded.obj -o f --split 8 --tolerance 1%").is(0);
    place.line("solve f --materials m.toml --suns noon.csv").is(0);
    place
        .line("points shaded.obj --up z --points points.txt --suns noon.csv --solution f:radiosity -o felt.csv")
        .is(0);
    let rows = cells(&std::fs::read_to_string(place.path("felt.csv")).expect("a table"));
    let value = |row: usize, at: usize| rows[row][at].parse::<f64>().expect("a number");
    // moment, point, x, y, z, direct, diffuse, reflected, irradiance
    assert_eq!(value(0, 5), 0.0);
    assert!((value(1, 5) - 800.0).abs() < 1e-6);
    // A millimetre above the floor, which reflects half of 800 W/m² there, and a little from the plate.
    assert!((value(2, 7) - 400.0).abs() < 0.02 * 400.0, "{rows:?}");
    assert!((value(2, 8) - value(2, 7)).abs() < 2e-3);
}

/// Three climates: where the sun stands at noon, from either side of the equator, and that no light of a file is lost
/// but what comes while the sun is down.
#[test]
fn weather_files_of_three_climates_have_their_suns() {
    for climate in hemicube_tests::weather::CLIMATES {
        let place = Place::new();
        place.write("year.epw", climate.epw());
        for (times, declination) in [("06-21", 23.44f64), ("12-21", -23.44)] {
            place
                .line(&format!("suns year.epw --times {times} -o day.csv --overwrite"))
                .is(0);
            let text = std::fs::read_to_string(place.path("day.csv")).expect("a table");
            assert!(text.lines().next().expect("a head").ends_with("wind (m/s)"), "{text}");
            let day = cells(&text);
            assert_eq!(day.len(), 24);
            let number = |row: &[String], at: usize| row[at].parse::<f64>().expect("a number");
            let noon = (day.iter())
                .max_by(|a, b| number(a, 3).total_cmp(&number(b, 3)))
                .expect("hours");
            let highest = 90.0 - (climate.latitude - declination).abs();
            let found = number(noon, 3).asin().to_degrees();
            // The middle of an hour is at most half of one from noon: 7.5° of the sun's way, less of its height.
            assert!(
                found < highest + 0.2 && found > highest - 3.0,
                "{} {times}: {found} {highest}",
                climate.name
            );
            // Where the sun is not near the zenith, it stands over the equator.
            if highest < 80.0 {
                assert_eq!(
                    number(noon, 2) < 0.0,
                    climate.latitude > declination,
                    "{}",
                    climate.name
                );
            }
            for row in &day {
                let level = number(row, 1).hypot(number(row, 2)).hypot(number(row, 3));
                assert!((level - 1.0).abs() < 1e-6, "{row:?}");
                // The file's infrared is 300 W/m² and 20 more or less by day: a sky of 265 to 275 K.
                assert!((264.0..276.0).contains(&number(row, 8)), "{row:?}");
            }
        }
        let ran = place.line("suns year.epw -o year.csv").is(0);
        let year = cells(&std::fs::read_to_string(place.path("year.csv")).expect("a table"));
        assert_eq!(year.len(), 8760);
        let direct: f64 = year.iter().map(|row| row[4].parse::<f64>().expect("W/m²")).sum();
        let lost: f64 = (ran.err.split("the hour: ").nth(1))
            .and_then(|words| words.split_whitespace().next())
            .map_or(0.0, |number| number.replace(',', "").parse().expect("Wh/m²"));
        let of_file: f64 = (climate.epw().lines().skip(8))
            .map(|line| line.split(',').nth(14).expect("a field").parse::<f64>().expect("W/m²"))
            .sum();
        assert!(
            (direct + lost - of_file).abs() < 1.0,
            "{}: {direct} {lost} {of_file}",
            climate.name
        );
        // The far north has hours of this file's light without a sun, the tropics have none.
        assert_eq!(lost > 1e5, climate.name == "north", "{}: {lost}", climate.name);
    }
}

/// Diffuse irradiance of a tilted plane by Perez, Ineichen, Seals, Michalsky & Stewart (1990), *Solar Energy* 44, 271,
/// equations 9 to 13 with the coefficients of table 6; the air mass is Kasten & Young's (1989).
fn perez_on_a_plane(direct: f64, diffuse: f64, above: f64, cosines: [f64; 2], tilt: f64) -> f64 {
    const BINS: [f64; 7] = [1.065, 1.23, 1.5, 1.95, 2.8, 4.5, 6.2];
    const F: [[f64; 6]; 8] = [
        [-0.008, 0.588, -0.062, -0.060, 0.072, -0.022],
        [0.130, 0.683, -0.151, -0.019, 0.066, -0.029],
        [0.330, 0.487, -0.221, 0.055, -0.064, -0.026],
        [0.568, 0.187, -0.295, 0.109, -0.152, -0.014],
        [0.873, -0.392, -0.362, 0.226, -0.462, 0.001],
        [1.132, -1.237, -0.412, 0.288, -0.823, 0.056],
        [1.060, -1.600, -0.359, 0.264, -1.127, 0.131],
        [0.678, -0.327, -0.250, 0.156, -1.377, 0.251],
    ];
    let [of_plane, of_zenith] = cosines;
    let zenith = of_zenith.clamp(-1.0, 1.0).acos();
    let cube = 1.041 * zenith.powi(3);
    let clearness = ((diffuse + direct) / diffuse + cube) / (1.0 + cube);
    let bin = BINS.iter().filter(|bin| clearness >= **bin).count();
    let degrees = zenith.to_degrees();
    let mass = 1.0 / (of_zenith + 0.50572 * (96.07995 - degrees).powf(-1.6364));
    let brightness = diffuse * mass / above;
    let [f11, f12, f13, f21, f22, f23] = F[bin];
    let around = (f11 + f12 * brightness + f13 * zenith).max(0.0);
    let horizon = f21 + f22 * brightness + f23 * zenith;
    let [a, b] = [of_plane.max(0.0), of_zenith.max(85f64.to_radians().cos())];
    diffuse * ((1.0 - around) * (1.0 + tilt.cos()) / 2.0 + around * a / b + horizon * tilt.sin())
}

/// Diffuse irradiance of a south wall by the integral of the radiances of Perez, Seals & Michalsky (1993), equation 1,
/// scaled to the horizontal's; north is +y.
fn radiances_on_a_south_wall(direct: f64, diffuse: f64, above: f64, sun: [f64; 3]) -> f64 {
    const STEPS: u32 = 200;
    let sky = Perez::new(direct, diffuse, above).expect("a sky");
    let [a, b, c, d, e] = sky.parameters(sun[2].clamp(-1.0, 1.0).acos());
    let (mut level, mut wall) = (0.0, 0.0);
    for ring in 0..STEPS {
        let altitude = (f64::from(ring) + 0.5) / f64::from(STEPS) * std::f64::consts::FRAC_PI_2;
        let (sine, cosine) = altitude.sin_cos();
        for turn in 0..4 * STEPS {
            let (east, north) = ((f64::from(turn) + 0.5) / f64::from(4 * STEPS) * std::f64::consts::TAU).sin_cos();
            let cos_gamma = cosine * (east * sun[0] + north * sun[1]) + sine * sun[2];
            let gamma = cos_gamma.clamp(-1.0, 1.0).acos();
            let gradation = 1.0 + a * (b / sine.max(0.01)).exp();
            let radiance = (gradation * (1.0 + c * (d * gamma).exp() + e * cos_gamma * cos_gamma)).max(0.0);
            level += radiance * sine * cosine;
            wall += radiance * (-north * cosine).max(0.0) * cosine;
        }
    }
    diffuse * wall / level
}

/// A south wall over a clear day in March, June and December: direct and diffuse light by the formulas for tilted planes
/// (Perez et al. 1990), another fit than the radiances that `perez` spreads (1993). Under December's sun, below 14°, the
/// older one gives the wall half as much diffuse light again; so each day is also held to the integral of the radiances.
#[test]
fn a_south_wall_has_the_day_that_perez_gives_it() {
    let place = Place::new();
    place.write("open.obj", lawn_and_wall());
    place.write("m.toml", "bands = [\"all\"]\n[default]\nreflectance = 0.2\n");
    place.line("compute open.obj -o f").is(0);
    place.line("sky open.obj --matrix f --up z --division reinhart:4").is(0);
    let (mut off, mut off_integral): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
    for day in ["2026-03-21", "2026-06-21", "2026-12-21"] {
        place
            .line(&format!(
                "suns --location 52.52,13.40 --times {day}T03:30+01:00/{day}T20:30+01:00/30m -o day.csv --overwrite"
            ))
            .is(0);
        place
            .line("solve f --materials m.toml --suns day.csv --by object -o light.csv --overwrite")
            .is(0);
        let read = |name: &str| cells(&std::fs::read_to_string(place.path(name)).expect("a table"));
        let number = |row: &[String], at: usize| row[at].parse::<f64>().expect("a number");
        let found: f64 = (read("light.csv").iter().filter(|row| row[1] == "wall"))
            .map(|row| number(row, 5))
            .sum();
        let (mut wanted, mut integral) = (0.0, 0.0);
        for row in read("day.csv") {
            let [direct, diffuse, above] = [number(&row, 4), number(&row, 5), number(&row, 7)];
            if diffuse <= 0.0 {
                continue;
            }
            let cosines = [-number(&row, 2), number(&row, 3)];
            let beam = direct * cosines[0].max(0.0);
            wanted += beam + perez_on_a_plane(direct, diffuse, above, cosines, std::f64::consts::FRAC_PI_2);
            let sun = [1, 2, 3].map(|at| number(&row, at));
            integral += beam + radiances_on_a_south_wall(direct, diffuse, above, sun);
        }
        assert!(wanted > 1000.0);
        off.push(found / wanted - 1.0);
        off_integral.push(found / integral - 1.0);
    }
    say(&format!(
        "south wall, by day: {off:?}, and by the integral: {off_integral:?}"
    ));
    assert!(off_integral.iter().all(|off| off.abs() < 0.01), "{off_integral:?}");
    let permitted = [0.01, 0.01, 0.07];
    assert!(off.iter().zip(permitted).all(|(off, most)| off.abs() < most), "{off:?}");
}

/// The triangle that a ray meets first, and how far.
fn first(triangles: &[[[f64; 3]; 3]], from: [f64; 3], along: [f64; 3]) -> Option<usize> {
    let minus = |a: [f64; 3], b: [f64; 3]| [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    let cross = |a: [f64; 3], b: [f64; 3]| {
        [
            a[1] * b[2] - a[2] * b[1],
            a[2] * b[0] - a[0] * b[2],
            a[0] * b[1] - a[1] * b[0],
        ]
    };
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let mut nearest = (f64::INFINITY, None);
    for (at, &[a, b, c]) in triangles.iter().enumerate() {
        let (e, f) = (minus(b, a), minus(c, a));
        let p = cross(along, f);
        let determinant = dot(e, p);
        let s = minus(from, a);
        let u = dot(s, p) / determinant;
        let q = cross(s, e);
        let v = dot(along, q) / determinant;
        let t = dot(f, q) / determinant;
        if determinant != 0.0 && u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 1e-9 && t < nearest.0 {
            nearest = (t, Some(at));
        }
    }
    nearest.1
}

/// Two points under and beside a plate above a sunlit floor, at noon and under a low sun, by 400,000 rays of the test's
/// own.
#[test]
fn mean_radiant_temperatures_by_day_are_those_of_rays() {
    let place = Place::new();
    place.write("shaded.obj", shaded());
    place.write(
        "day.csv",
        "time,x,y,z,direct,diffuse,sky_temperature\nnoon,0,0.2,1,800,100,270\nlow,1,0,0.4,500,60,265\n",
    );
    place.write(
        "m.toml",
        "bands = [\"all\"]\n[default]\nreflectance = 0.4\nemissivity = 0.9\nabsorptance = 0.6\ntemperature = \
         300\n[object.floor]\ntemperature = 315\n",
    );
    let points = [[1.5, 1.5, 0.4], [3.0, 1.5, 0.8]];
    place.write("points.txt", "1.5 1.5 0.4\n3 1.5 0.8\n");
    place.line("compute shaded.obj -o f --tolerance 0.2%").is(0);
    place
        .line("solve f --materials m.toml --suns day.csv --solution light -o light.csv")
        .is(0);
    place
        .line("solve f --thermal --materials m.toml --suns day.csv --solution heat -o heat.csv")
        .is(0);
    place
        .line(
            "points shaded.obj --up z --points points.txt --as sphere --suns day.csv --solution f:light --solution f:heat \
             --ground-temperature 290 --tolerance 0.2% -o felt.csv -o felt.npz",
        )
        .is(0);
    // Its local header and the directory at the end name each array.
    let bytes = std::fs::read(place.path("felt.npz")).expect("arrays");
    let name = b"mean_radiant_temperature.npy";
    assert_eq!(bytes.windows(name.len()).filter(|window| window == name).count(), 2);
    let read = |name: &str| {
        let text = std::fs::read_to_string(place.path(name)).expect("a table");
        let head: Vec<String> = text
            .lines()
            .next()
            .expect("a head")
            .split(',')
            .map(str::to_owned)
            .collect();
        (head, cells(&text))
    };
    let [light, heat, felt] = ["light.csv", "heat.csv", "felt.csv"].map(read);
    let number = |text: &str| text.parse::<f64>().expect("a number");
    let column = |(head, _): &(Vec<String>, Vec<Vec<String>>), name: &str| {
        let is = |head: &String| head.starts_with(name);
        head.iter()
            .position(is)
            .unwrap_or_else(|| panic!("no {name} in {head:?}"))
    };
    // The triangles in the order of the table's patches, found by their centroids.
    let quads = shaded();
    let corners: Vec<[f64; 3]> = (quads.lines().filter_map(|line| line.strip_prefix("v ")))
        .map(|line| {
            let parts: Vec<f64> = line.split_whitespace().map(number).collect();
            [parts[0], parts[1], parts[2]]
        })
        .collect();
    let all: Vec<[[f64; 3]; 3]> = (corners.chunks(4))
        .flat_map(|quad| [[quad[0], quad[1], quad[2]], [quad[0], quad[2], quad[3]]])
        .collect();
    let triangles: Vec<[[f64; 3]; 3]> = (light.1.iter())
        .map(|row| {
            let at = column(&light, "x");
            let is_it = |triangle: &&[[f64; 3]; 3]| {
                (0..3).all(|axis| {
                    let middle = triangle.iter().map(|corner| corner[axis]).sum::<f64>() / 3.0;
                    (middle - number(&row[at + axis])).abs() < 1e-9
                })
            };
            *all.iter().find(is_it).expect("a triangle")
        })
        .collect();
    for (moment, (name, sun, direct, diffuse, sky)) in [
        ("noon", [0.0, 0.2, 1.0], 800.0, 100.0, 270.0f64),
        ("low", [1.0, 0.0, 0.4], 500.0, 60.0, 265.0),
    ]
    .into_iter()
    .enumerate()
    {
        let of = |table: &(Vec<String>, Vec<Vec<String>>)| -> Vec<f64> {
            let at = table
                .0
                .iter()
                .position(|head| head == &format!("radiosity_{name}"))
                .expect("a column");
            table.1.iter().map(|row| number(&row[at])).collect()
        };
        let (bright, warm) = (of(&light), of(&heat));
        for (point, from) in points.into_iter().enumerate() {
            const RAYS: u32 = 400_000;
            let (mut short, mut long) = (0.0, 0.0);
            for ray in 0..RAYS {
                let z = 1.0 - 2.0 * (f64::from(ray) + 0.5) / f64::from(RAYS);
                let (sine, cosine) = (f64::from(ray) * 2.399_963_229_728_653).sin_cos();
                let across = (1.0 - z * z).sqrt();
                let (seen, felt) = match first(&triangles, from, [across * cosine, across * sine, z]) {
                    Some(patch) => (bright[patch], warm[patch]),
                    None if z > 0.0 => (diffuse, SIGMA * sky.powi(4)),
                    None => (0.0, SIGMA * 290f64.powi(4)),
                };
                (short, long) = (short + seen, long + felt);
            }
            let (short, long) = (short / f64::from(RAYS), long / f64::from(RAYS));
            let beam = if first(&triangles, from, sun).is_none() {
                direct / 4.0
            } else {
                0.0
            };
            let wanted = ((0.7 * (short + beam) + 0.97 * long) / (0.97 * SIGMA)).powf(0.25);
            let row = &felt.1[moment * points.len() + point];
            let found = number(&row[column(&felt, "mean_radiant_temperature")]);
            assert_eq!(beam > 0.0, (point, name) != (0, "noon"), "{name} {point}");
            assert!((found - wanted).abs() < 0.1, "{name} {point}: {found} {wanted}");
        }
    }
}

/// A planet in front of plates turned away from it by more and more: F = sin² α cos θ where a plate sees all of the disc,
/// and where its horizon cuts the disc, the closed form for a sphere (for a plate edge-on, (α − sin α cos α) / π).
#[test]
fn a_planet_lights_and_warms_plates_by_the_view_factor_of_a_sphere() {
    let place = Place::new();
    let mut obj = Obj::default();
    let tilts = [0.0f64, 25.0, 50.0, 90.0, 130.0];
    for (at, tilt) in tilts.iter().enumerate() {
        // Normals turn from −z, where the planet is, by the tilt about y; each plate far from the others.
        let x = 1000.0 * at as f64;
        let (sine, cosine) = tilt.to_radians().sin_cos();
        let corner = |u: f64, v: f64| [x + u * cosine, v, u * sine];
        obj.surface(
            &format!("t{tilt}"),
            "m",
            &[corner(0., 0.), corner(0., 1.), corner(1., 1.), corner(1., 0.)],
        );
    }
    place.write("plates.obj", obj.text);
    place.write(
        "orbit.csv",
        "time,x,y,z,direct,planet_x,planet_y,planet_z,half_angle,albedo,infrared\nnear,0,0,1,0,0,0,-1,40,400,240\nfar,0,\
         0,1,0,0,0,-1,12,400,240\naway,0,0,1,0,0,0,-1,,,\n",
    );
    place.write(
        "m.toml",
        "bands = [\"all\"]\n[default]\nreflectance = 0\nemissivity = 0.5\nabsorptance = 0.25\nadiabatic = true\n",
    );
    place.line("compute plates.obj -o f").is(0);
    place
        .line("solve f --materials m.toml --suns orbit.csv --by object -o light.csv")
        .is(0);
    place
        .line("solve f --thermal --materials m.toml --suns orbit.csv --sky-temperature 0 --by object -o heat.csv")
        .is(0);
    let read = |name: &str| cells(&std::fs::read_to_string(place.path(name)).expect("a table"));
    let (light, heat) = (read("light.csv"), read("heat.csv"));
    for (moment, alpha) in [("near", 40f64), ("far", 12.0)] {
        let alpha = alpha.to_radians();
        for tilt in tilts {
            let theta = tilt.to_radians();
            let is_cut = tilt + alpha.to_degrees() > 90.0;
            let wanted = match tilt {
                90.0 => Some((alpha - alpha.sin() * alpha.cos()) / std::f64::consts::PI),
                _ if tilt - 90.0 > alpha.to_degrees() => Some(0.0),
                _ if !is_cut => Some(alpha.sin().powi(2) * theta.cos()),
                _ => None,
            };
            let name = format!("t{tilt}");
            let value = |rows: &[Vec<String>], at: usize| -> f64 {
                let row = rows
                    .iter()
                    .find(|row| row[0] == moment && row[1] == name)
                    .expect("a row");
                row[at].parse().expect("a number")
            };
            let found = value(&light, 5) / 400.0;
            let Some(wanted) = wanted else { continue };
            let error = if is_cut { 0.002 * alpha.sin().powi(2) } else { 1e-5 };
            assert!((found - wanted).abs() < error, "{moment} {tilt}: {found} {wanted}");
            // 2 ε σ T⁴ has no second side here: what one side absorbs of both, it radiates.
            let taken = wanted * (0.25 * 400.0 + 0.5 * 240.0);
            let kelvin = (taken / (0.5 * SIGMA)).powf(0.25);
            if !is_cut {
                assert!(
                    (value(&heat, 6) - kelvin).abs() < 0.02,
                    "{moment} {tilt}: {} {kelvin}",
                    value(&heat, 6)
                );
            }
        }
    }
    // The disc stands before a sky of 200 K, which the plate sees beside it.
    place
        .line("solve f --thermal --materials m.toml --suns orbit.csv --sky-temperature 200K --by object -o warm.csv")
        .is(0);
    let warm = read("warm.csv");
    let row = (warm.iter().find(|row| row[0] == "near" && row[1] == "t0")).expect("a row");
    let factor = 40f64.to_radians().sin().powi(2);
    let sky = SIGMA * 200f64.powi(4);
    let taken = factor * (0.25 * 400.0 + 0.5 * 240.0) + 0.5 * (1.0 - factor) * sky;
    let (kelvin, found) = ((taken / (0.5 * SIGMA)).powf(0.25), row[6].parse::<f64>().expect("K"));
    assert!((found - kelvin).abs() < 0.02, "{found} {kelvin}");
    let dark = light.iter().filter(|row| row[0] == "away");
    assert!(
        dark.map(|row| row[5].parse::<f64>().expect("a number"))
            .all(|light| light == 0.0)
    );
    place.write("p.txt", "0 0 5\n");
    place
        .line("points plates.obj --up z --points p.txt --suns orbit.csv")
        .is(2)
        .says(&["has a planet"]);
}

/// A seated person gets Fanger's share of the beam by where the sun stands from where the person faces, and the sky by
/// its six sides; a table that lacks a column for UTCI says so.
#[test]
fn a_seated_person_faces_the_sun_or_not() {
    use hemicube_weather::comfort::{Posture, projected_area};
    let place = Place::new();
    place.write("open.obj", lawn_and_wall());
    place.write("m.toml", "[default]\nemissivity = 1\ntemperature = 300\n");
    place.write(
        "noon.csv",
        "time,x,y,z,direct,diffuse,air_temperature,wind\nnoon,0,-0.8,0.6,800,100,25,2\n",
    );
    place.line("compute open.obj -o f").is(0);
    place
        .line("solve f --thermal --materials m.toml --sky-temperature 280")
        .is(0);
    let altitude = 0.6f64.asin().to_degrees();
    for (facing, azimuth) in [
        ("", None),
        (" 0 -1 0", Some(0.0)),
        (" 1 0 0.3", Some(90.0)),
        (" 0 1 0", Some(180.0)),
    ] {
        place.write("seat.txt", format!("0 0 500{facing}\n"));
        place
            .line(
                "points open.obj --up z --points seat.txt --as seated --suns noon.csv --solution f -o felt.csv --overwrite",
            )
            .is(0)
            .says(&["`air_temperature` and `wind`, and no `humidity`"]);
        let rows = cells(&std::fs::read_to_string(place.path("felt.csv")).expect("a table"));
        let number = |at: usize| rows[0][at].parse::<f64>().expect("a number");
        let factor = projected_area(altitude, azimuth, Posture::Seated).expect("in range");
        assert!((number(5) - 800.0 * factor).abs() < 0.01, "{facing}: {rows:?}");
        // Half of an even sky from the sides, all of it from above.
        let of_sky = 100.0 * (0.18 + 0.5 * (2.0 * 0.22 + 2.0 * 0.30)) / 1.40;
        assert!((number(6) - of_sky).abs() < 0.1, "{facing}: {rows:?} {of_sky}");
    }
}

/// A wall and the underside of a plate, alone under an even sky: half of what the wall sees is ground, and all of what the
/// underside sees. The ground sends its part of sun and sky, 0.2 (500 × 0.8 + 100) W/m².
#[test]
fn the_ground_below_the_horizon_lights_what_sees_it() {
    let place = Place::new();
    let mut obj = Obj::default();
    obj.surface(
        "wall",
        "m",
        &[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 1.0], [0.0, 0.0, 1.0]],
    );
    let [x, y, z] = [300.0, 300.0, 5.0];
    obj.surface(
        "under",
        "m",
        &[[x, y, z], [x, y + 1.0, z], [x + 1.0, y + 1.0, z], [x + 1.0, y, z]],
    );
    place.write("two.obj", obj.text);
    place.write("m.toml", "bands = [\"solar\"]\n[default]\nreflectance = 0\n");
    place.write("points.txt", "0.5 -0.001 0.5 0 -1 0\n300.5 300.5 4.999 0 0 -1\n");
    let suns = |sky: &str, ground: &str| {
        let text = format!("time,x,y,z,direct,diffuse,sky,ground\nnoon,0,-0.6,0.8,500,100,{sky},{ground}\n");
        place.write("suns.csv", text);
    };
    place.line("compute two.obj -o m --tolerance 0.1%").is(0);
    suns("uniform", "0.2");
    let solve = "solve m --materials m.toml --suns suns.csv --by object -o light.csv --overwrite";
    // What of the view is ground is not known yet.
    place
        .line(solve)
        .is(2)
        .says(&["`ground`", "below the horizon", "hemicube sky"]);
    place.line("sky two.obj --matrix m --up z --division reinhart:2").is(0);
    let column = |file: &str, head: &str| -> Vec<f64> {
        let text = std::fs::read_to_string(place.path(file)).expect("a table");
        let heads: Vec<&str> = text.lines().next().expect("a head").split(',').collect();
        let at = heads.iter().position(|found| found.starts_with(head)).expect(head);
        cells(&text)
            .iter()
            .map(|row| row[at].parse().expect("a number"))
            .collect()
    };
    for (sky, ground, wanted) in [
        ("uniform", "0.2", [400.0, 100.0]),
        ("uniform", "", [350.0, 0.0]),
        ("perez", "0.2", [400.0, 100.0]),
    ] {
        suns(sky, ground);
        place.line(solve).is(0);
        place
            .line("points two.obj --up z --points points.txt --suns suns.csv -o felt.csv --overwrite")
            .is(0);
        let solved = column("light.csv", "irradiance");
        let felt = column("felt.csv", "irradiance");
        for found in [&solved, &felt] {
            assert_eq!(found.len(), 2);
            // An uneven sky is brighter or darker where the wall looks.
            let bound = if sky == "uniform" { 1.0 } else { 60.0 };
            assert!(
                (found[0] - wanted[0]).abs() < bound && (found[1] - wanted[1]).abs() < 0.5,
                "{sky}, {ground}: {found:?}"
            );
        }
        assert!((solved[0] - felt[0]).abs() < 2.0, "{sky}: {solved:?} {felt:?}");
    }
    suns("uniform", "1.2");
    place.line(solve).is(2).says(&["suns.csv:2", "above 1"]);
}
