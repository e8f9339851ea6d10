//! Rows through portals in all uses: patches of several triangles, sensors, compact stores, small entries left out.
//!
//! The binary is the one beside this test: build it with the same profile and target directory before.

#![cfg(unix)]

use hemicube_tests::geometry::{parallel_rectangles, parallel_rectangles_apart};
use hemicube_tests::random::Random;
use hemicube_tests::rooms::{self, Quad, Zones, both_ways, near, obj, of, place, room};
use hemicube_tests::runs::{Place, assert_same};
use serde_json::Value;
use std::collections::BTreeMap;
use std::f64::consts::PI;

const HALF: &str = "[object.x1]\nspecular = 0.5\n";
const MIRROR: &str = "[object.x1]\nspecular = 1\n";
const FOUR: &str = "[object.\"x*\"]\nspecular = 1\n[object.\"y*\"]\nspecular = 1\n";

/// A table by name: its first column, then by head.
fn table(place: &Place, name: &str) -> Vec<BTreeMap<String, String>> {
    let text = std::fs::read_to_string(place.path(name)).expect("the table");
    let mut lines = text.lines().map(|line| line.split(',').map(str::to_owned));
    let head: Vec<String> = lines.next().expect("a head").collect();
    lines.map(|line| head.iter().cloned().zip(line).collect()).collect()
}

fn number(row: &BTreeMap<String, String>, column: &str) -> f64 {
    row[column].parse().expect("a number")
}

/// Form factors by object of a store, which is sound.
#[track_caller]
fn zones(place: &Place, store: &str) -> Zones {
    let report = place.line(&format!("check {store} --json")).is(0).json();
    assert_eq!(report["ok"], true, "{report}");
    rooms::zones(place, store)
}

#[test]
fn objects_have_the_rows_of_their_triangles_through_portals() {
    let place = place(&room(1., 1., 1.), HALF);
    let line = "compute scene.obj --specular optics.toml --tolerance 0.1% --split 2";
    place.line(&format!("{line} -o triangles")).is(0);
    place.line(&format!("{line} -o objects --by object")).is(0);
    let (triangles, objects) = (zones(&place, "triangles"), zones(&place, "objects"));
    near(of(&objects, "bottom", "top"), 0.242_850_140_274_55, 1e-3);
    near(of(&objects, "x0", "x0"), 0.034_294_794_409_28, 1e-3);
    for (pair, factor) in &objects {
        near(*factor, triangles[pair], 1e-4);
    }
    // Whatever threads, shards and interruptions.
    place
        .line(&format!("{line} -o again --by object --threads 1 --batch 3"))
        .is(0);
    assert_same(&place.path("objects"), &place.path("again"));
    for shard in ["2/2", "1/2"] {
        place
            .line(&format!("{line} -o shards --by object --shard {shard}"))
            .is(0);
    }
    place.line("merge shards").is(0);
    assert_same(&place.path("objects"), &place.path("shards"));
    // At one temperature nothing flows.
    place.write("grey.toml", "[material.\"*\"]\nemissivity = 0.5\ntemperature = 300\n");
    place
        .line("solve objects --thermal --scene scene.obj --materials grey.toml --by object -o by.json --quiet")
        .is(0);
    let text = std::fs::read_to_string(place.path("by.json")).expect("results");
    let json: Value = serde_json::from_str(&text).expect("JSON");
    for surface in json["surfaces"].as_array().expect("surfaces") {
        near(surface["heat"].as_f64().expect("a number"), 0.0, 1e-3);
    }
}

#[test]
fn objects_of_a_cell_have_the_rows_of_the_whole() {
    let canyon = |length: f64| {
        let mut quads = room(1., length, 1.);
        quads.retain(|(name, _)| !["top", "y0", "y1"].contains(name));
        quads
    };
    for settings in ["--tolerance 0.1%", "--tolerance 0.1% --split 3"] {
        let place = place(&canyon(1.0), HALF);
        place
            .line(&format!(
                "compute scene.obj -o store --by object --periodic y=0..1 {settings}"
            ))
            .is(0);
        let zones = zones(&place, "store");
        near(of(&zones, "bottom", "x0"), 1.0 - 0.5f64.sqrt(), 1e-3);
        near(of(&zones, "x1", "x0"), 2f64.sqrt() - 1.0, 1e-3);
        near(of(&zones, "bottom", "escaped"), 2f64.sqrt() - 1.0, 1e-3);
    }
    // Calibrated on patches of images: more than the few patches whose pairs are all measured.
    let place = place(&canyon(1.0), HALF);
    place
        .line("compute scene.obj -o store --by object --periodic y=0..1 --repeats 2 --split 12 --tolerance 1%")
        .is(0);
    assert_eq!(place.line("check store --json").json()["ok"], true);
}

#[test]
fn patches_of_several_optics_are_refused_by_name() {
    let place = Place::new();
    let quads = room(1., 1., 1.);
    // One object of a mirror and a wall.
    let text = obj(&quads).replace("o x1\nusemtl x1", "o x0\nusemtl x1");
    place.write("scene.obj", text);
    place.write("optics.toml", "[material.x1]\nspecular = 0.5\n");
    let line = "compute scene.obj --specular optics.toml -o store --overwrite";
    place
        .line(&format!("{line} --by object"))
        .is(2)
        .says(&["object `x0`", "different optics", "--by face"]);
    for kind in ["face", "material"] {
        place.line(&format!("{line} --by {kind}")).is(0);
        assert_eq!(place.line("check store --json").json()["ok"], true);
    }
}

/// Solvers that read rows of what stays are not sent to `balance`, which leaves arrivals as they are.
#[test]
fn solvers_of_closed_rows_are_refused_arrivals() {
    let place = place(&room(1., 1., 1.), MIRROR);
    place.line("compute scene.obj --specular optics.toml -o store").is(0);
    for solver in ["elmer", "calculix"] {
        place
            .line(&format!("export store -o ViewFactors.dat --for {solver}"))
            .is(2)
            .says(&["arrives through mirrors and panes", "hint: `hemicube exchange`"]);
    }
    place.line("compute scene.obj -o closed").is(0);
    place
        .line("export closed -o ViewFactors.dat --for elmer --overwrite")
        .is(0);
}

#[test]
fn compact_stores_hold_what_mirrors_get_again_and_again() {
    let place = place(&room(1., 1., 3.), FOUR);
    let line = "compute scene.obj --specular optics.toml --specular-bound 1e-3";
    place.line(&format!("{line} -o plain")).is(0);
    place.line(&format!("{line} -o compact --form compact")).is(0);
    let (plain, compact) = (zones(&place, "plain"), zones(&place, "compact"));
    let largest = plain
        .iter()
        .filter(|((_, to), _)| to.starts_with(['x', 'y']))
        .map(|(_, &factor)| factor)
        .fold(0.0, f64::max);
    assert!(largest > 2.0, "{largest}");
    for (pair, &factor) in &plain {
        near(compact[pair], factor, factor / 2000.0 + 1e-9);
    }
    // Products from the file's bytes.
    let black = "emissivity = 0\ntemperature = 300\n";
    let grey = format!(
        "[material.\"*\"]\nemissivity = 0.8\ntemperature = 300\n[material.top]\nemissivity = 0.8\ntemperature = 400\n\
         [material.\"x*\"]\n{black}[material.\"y*\"]\n{black}"
    );
    place.write("grey.toml", grey);
    let heat = |store: &str| {
        place
            .line(&format!(
                "solve {store} --thermal --scene scene.obj --materials grey.toml --by object -o by.json \
                 --overwrite --quiet"
            ))
            .is(0);
        let text = std::fs::read_to_string(place.path("by.json")).expect("results");
        let json: Value = serde_json::from_str(&text).expect("JSON");
        let surfaces = json["surfaces"].as_array().expect("surfaces");
        surfaces
            .iter()
            .map(|surface| surface["heat"].as_f64().expect("a number"))
            .collect::<Vec<f64>>()
    };
    let (a, b) = (heat("plain"), heat("compact"));
    let most = a.iter().fold(0.0f64, |most, heat| most.max(heat.abs()));
    assert!(most > 100.0);
    for (a, b) in a.iter().zip(&b) {
        near(*a, *b, 2e-3 * most);
    }
}

#[test]
fn small_entries_are_left_out_and_mirrors_hand_on_what_they_did() {
    let place = place(&room(1., 1., 1.), HALF);
    let line = "compute scene.obj --specular optics.toml --split 4";
    place.line(&format!("{line} -o all")).is(0);
    place.line(&format!("{line} -o few --min-factor 0.004")).is(0);
    let [all, few] = ["all", "few"].map(|store| place.line(&format!("check {store} --json")).is(0).json());
    assert_eq!((&all["ok"], &few["ok"]), (&Value::Bool(true), &Value::Bool(true)));
    let entries = |report: &Value| report["entries"].as_u64().expect("a number");
    assert!(
        entries(&few) < entries(&all) * 9 / 10,
        "{} {}",
        entries(&few),
        entries(&all)
    );
    let closure = |report: &Value| report["closure"]["max"].as_f64().expect("a number");
    near(closure(&few), closure(&all), 1e-6);
    let (all, few) = (zones(&place, "all"), zones(&place, "few"));
    for from in ["bottom", "top", "x0"] {
        // f32 sums of other entries; the mirror's own are as they were.
        near(of(&few, from, "x1"), of(&all, from, "x1"), 1e-7);
    }
    // Patches of several triangles, too.
    let line = format!("{line} --by object -o objects --min-factor 0.1 --form compact");
    place.line(&line).is(0);
    assert_eq!(place.line("check objects --json").json()["ok"], true);
}

/// The part of a sphere of directions that a square of side 1 takes, seen from above its middle.
fn square(distance: f64) -> f64 {
    4.0 * (0.25 / (distance * (distance * distance + 0.5).sqrt())).atan() / (4.0 * PI)
}

/// Rows of points by `line`, by object.
#[track_caller]
fn points(place: &Place, line: &str) -> Vec<BTreeMap<String, String>> {
    place
        .line(&format!("points scene.obj --up z -o points.csv --overwrite {line}"))
        .is(0);
    table(place, "points.csv")
}

#[test]
fn points_see_through_mirrors() {
    let place = place(&room(1., 1., 1.), MIRROR);
    place.write("middle.txt", "0.5 0.5 0.5\n");
    let rows = points(
        &place,
        "--points middle.txt --as sphere --specular optics.toml --tolerance 0.2% --verify 1",
    );
    let row = &rows[0];
    // The image of the room: its far wall is 1.5 away, the rest of the mirror's sixth is its sides'.
    let far = square(1.5);
    near(number(row, "x0"), 1.0 / 6.0 + far, 1e-4);
    near(number(row, "x1"), 1.0 / 6.0, 1e-4);
    near(number(row, "passed"), 1.0 / 6.0, 1e-4);
    for side in ["bottom", "top", "y0", "y1"] {
        near(number(row, side), 1.0 / 6.0 + 0.25 * (1.0 / 6.0 - far), 2e-4);
    }
    // All bodies, held against rays; half of the mirror absorbs.
    place.write("optics.toml", HALF);
    place.write("looking.txt", "0.5 0.5 0.5 1 0 0\n0.3 0.6 0.2 0.6 0 0.8\n");
    for body in ["plane", "cube", "person", "cylinder"] {
        let line = format!("--points looking.txt --as {body} --specular optics.toml --tolerance 0.5% --verify 2");
        for row in points(&place, &line) {
            let of = |columns: &[&str]| columns.iter().map(|column| number(&row, column)).sum::<f64>();
            let seen: f64 = ["bottom", "top", "x0", "x1", "y0", "y1"]
                .into_iter()
                .filter(|side| row.contains_key(*side))
                .map(|side| number(&row, side))
                .sum();
            near(
                seen + of(&["sky", "ground", "blocked", "cut_off"]) - number(&row, "passed"),
                1.0,
                1e-9,
            );
        }
    }
}

#[test]
fn points_see_through_panes_and_out_of_them() {
    let mut quads = room(1., 1., 1.);
    quads.retain(|(name, _)| *name != "top");
    quads.extend(both_ways((
        "pane",
        [[0., 0., 1.], [1., 0., 1.], [1., 1., 1.], [0., 1., 1.]],
    )));
    let place = place(&quads, "[object.pane]\ntransmittance = 0.7\nspecular = 0.1\n");
    place.write("up.txt", "0.5 0.5 0.5 0 0 1\n");
    let row = &points(&place, "--points up.txt --specular optics.toml --tolerance 0.2%")[0];
    // A plane that looks up at the pane, half a side above: F of a square, 0.7 of it sky.
    let pane = parallel_rectangles_apart([[0.4999, 0.5001], [0.4999, 0.5001]], [[0., 1.], [0., 1.]], 0.5);
    near(number(row, "pane"), pane, 1e-4);
    near(number(row, "sky"), 0.7 * pane, 2e-4);
    near(number(row, "passed"), 0.8 * pane, 2e-4);
    assert!(number(row, "bottom") > 0.0, "the floor in the pane");
}

/// Beer and Lambert: a layer of leaves of all directions, of leaf area index L, lets exp(−L / 2 / cos θ) through, and of
/// an even sky 2 E₃(L / 2). With L = 2 that is E₁(1) (Abramowitz & Stegun 1964, 5.1.14).
#[test]
fn under_a_canopy_is_what_beer_and_lambert_let_through() {
    const E1_OF_1: f64 = 0.219_383_934_395_520_3;
    let rows: Vec<String> = (0..=90)
        .step_by(2)
        .map(|degrees| {
            let through = (-1.0 / f64::from(degrees).to_radians().cos().max(1e-9)).exp();
            format!("[{degrees}, {through}, 0]")
        })
        .collect();
    let canopy = [[-1e3, -1e3, 5.], [1e3, -1e3, 5.], [1e3, 1e3, 5.], [-1e3, 1e3, 5.]];
    let mut quads: Vec<Quad<'_>> = both_ways(("canopy", canopy)).into();
    quads.push(("floor", [[-5., -5., 0.], [5., -5., 0.], [5., 5., 0.], [-5., 5., 0.]]));
    let optics = format!("[object.canopy]\nangles = [{}]\n", rows.join(", "));
    let place = place(&quads, &optics);
    place.write("up.txt", "0 0 0.01 0 0 1\n");
    let row = &points(&place, "--points up.txt --specular optics.toml --tolerance 0.2%")[0];
    near(number(row, "sky"), E1_OF_1, 1e-3);
    near(number(row, "canopy"), 1.0, 1e-4);
    place
        .line("compute scene.obj --specular optics.toml --tolerance 0.5% -o F")
        .is(0);
    near(of(&zones(&place, "F"), "floor", "escaped"), E1_OF_1, 2e-3);
}

/// A person beneath a crown, and one beside it: leaves take 1 − τ of what comes at each face of the crown, and send out as
/// a black body of their temperature would.
#[test]
fn under_a_crown_is_the_radiant_temperature_of_rays_that_attenuate() {
    const THROUGH: f64 = 0.4;
    const GROUND: f64 = 323.15;
    const CROWN: f64 = 300.0;
    const SKY: f64 = 280.0;
    let (low, high) = ([-2., -2., 2.5], [2., 2., 5.5]);
    let side = |axis: usize, at: f64| {
        let [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
        [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(first, second)| {
            let mut corner = [at; 3];
            corner[u] = [low[u], high[u]][first];
            corner[v] = [low[v], high[v]][second];
            corner
        })
    };
    let mut quads: Vec<Quad<'_>> = Vec::new();
    for axis in 0..3 {
        for at in [low[axis], high[axis]] {
            quads.extend(both_ways(("crown", side(axis, at))));
        }
    }
    quads.push((
        "ground",
        [[-30., -30., 0.], [30., -30., 0.], [30., 30., 0.], [-30., 30., 0.]],
    ));
    let place = place(&quads, &format!("[object.crown]\ntransmittance = {THROUGH}\n"));
    let people = [[0.5, 0.3, 1.1], [4.0, -1.0, 1.1]];
    let lines: Vec<String> = people.iter().map(|[x, y, z]| format!("{x} {y} {z}\n")).collect();
    place.write("people.txt", lines.concat());
    place.write("warm.csv", format!("ground,{GROUND}\ncrown,{CROWN}\n"));
    let rows = points(
        &place,
        &format!(
            "--points people.txt --as sphere --specular optics.toml --temperatures warm.csv --sky-temperature {SKY} \
             --tolerance 0.2%"
        ),
    );
    let mut random = Random(1);
    for (person, row) in people.into_iter().zip(rows) {
        let rays = 400_000;
        let mut sum = 0.0;
        for _ in 0..rays {
            let (z, turn) = (2.0 * random.unit() - 1.0, 2.0 * PI * random.unit());
            let round = (1.0 - z * z).sqrt();
            let along = [round * turn.cos(), round * turn.sin(), z];
            // Where the ray enters the crown's box, and leaves it.
            let (mut from, mut to) = (0.0_f64, f64::INFINITY);
            for axis in 0..3 {
                let ends = [low[axis], high[axis]].map(|at| (at - person[axis]) / along[axis]);
                from = from.max(ends[0].min(ends[1]));
                to = to.min(ends[0].max(ends[1]));
            }
            let faces = if from < to { 2 } else { 0 };
            let reached = [0, 1].map(|axis| person[axis] - along[axis] / z * person[2]);
            let meets_ground = z < 0.0 && reached.iter().all(|x: &f64| x.abs() < 30.0);
            let behind: f64 = if meets_ground { GROUND } else { SKY };
            let passed = THROUGH.powi(faces);
            sum += (1.0 - passed) * CROWN.powi(4) + passed * behind.powi(4);
        }
        near(number(&row, "mrt"), (sum / f64::from(rays)).sqrt().sqrt(), 0.1);
    }
}

#[test]
fn points_see_images_of_a_cell() {
    let mut quads = room(1., 1., 1.);
    quads.retain(|(name, _)| !["top", "y0", "y1"].contains(name));
    let place = place(&quads, HALF);
    place.write("floor.txt", "0.5 0.5 0 0 0 1\n");
    let line = "--points floor.txt --tolerance 0.2% --periodic y=0..1 --repeats 60";
    let row = &points(&place, line)[0];
    // Endless on both sides: crossed strings from a point.
    near(number(row, "sky"), 1.0 / 5f64.sqrt(), 1e-3);
    near(number(row, "x0"), 0.5 - 0.5 / 5f64.sqrt(), 1e-3);
    place.write("outside.txt", "0.5 1.5 0 0 0 1\n");
    place
        .line(&format!("points scene.obj --up z {}", line.replace("floor", "outside")))
        .is(2)
        .says(&["line 1", "outside the period"]);
    // Half of the street, with its other half behind a plane of symmetry, and one wall half a mirror.
    let half: Vec<Quad<'_>> = vec![
        ("bottom", [[0., 0., 0.], [0.5, 0., 0.], [0.5, 1., 0.], [0., 1., 0.]]),
        ("x0", [[0., 0., 0.], [0., 1., 0.], [0., 1., 1.], [0., 0., 1.]]),
    ];
    place.write("half.obj", obj(&half));
    place.write("both.toml", "[object.\"x*\"]\nspecular = 0.5\n");
    place.write("aside.txt", "0.25 0.5 0.1 0.6 0 0.8\n");
    let sees = |scene: &str, more: &str| {
        place
            .line(&format!(
                "points {scene} --up z -o points.csv --overwrite --points aside.txt --tolerance 0.5% --periodic y=0..1 \
                 --repeats 20 --specular both.toml {more}"
            ))
            .is(0);
        table(&place, "points.csv").remove(0)
    };
    let (whole, part) = (sees("scene.obj", ""), sees("half.obj", "--symmetry x=0.5"));
    near(number(&part, "sky"), number(&whole, "sky"), 3e-3);
    near(number(&part, "bottom"), number(&whole, "bottom"), 3e-3);
    near(number(&part, "x0"), number(&whole, "x0") + number(&whole, "x1"), 5e-3);
}

#[test]
fn at_one_temperature_points_have_it_through_mirrors_and_glass() {
    let mut quads = room(1., 1., 1.);
    quads.extend(both_ways((
        "pane",
        [[0.3, 0., 0.2], [0.3, 1., 0.2], [0.3, 1., 0.9], [0.3, 0., 0.9]],
    )));
    let optics = "[object.x1]\nspecular = 0.8\n[object.pane]\nindex = 1.5\nthickness = 0.01\nextinction = 30\n";
    let place = place(&quads, optics);
    place.write("points.txt", "0.5 0.5 0.5\n0.2 0.7 0.4\n");
    place.write("temperatures.csv", "*,300\n");
    let line = "--points points.txt --specular optics.toml --temperatures temperatures.csv --sky-temperature 300";
    for body in ["sphere", "person"] {
        for row in points(&place, &format!("{line} --as {body}")) {
            near(number(&row, "mrt"), 300.0, 1e-3);
        }
    }
    // A mirror at another temperature emits what it absorbs.
    place.write("temperatures.csv", "*,300\nx1,400\n");
    place.write("optics.toml", MIRROR);
    quads_of_room(&place);
    let row = &points(&place, &format!("{line} --as sphere"))[0];
    near(number(row, "mrt"), 300.0, 1e-3);
    // By a solution: its radiosities, and the mirrors of its matrix.
    place
        .line("compute scene.obj -o store --specular optics.toml --tolerance 1%")
        .is(0);
    place.write(
        "grey.toml",
        "[material.\"*\"]\nemissivity = 0.5\ntemperature = 310\n[material.x1]\nemissivity = 0\ntemperature = 310\n",
    );
    place
        .line("solve store --thermal --scene scene.obj --materials grey.toml --quiet")
        .is(0);
    let row = &points(&place, "--points points.txt --solution store --sky-temperature 310")[0];
    near(number(row, "mrt"), 310.0, 0.05);
    assert!(number(row, "passed") > 0.05);
}

/// Light of the lowest band of the sky: it comes in over nothing but the ends of the street, which images close.
#[test]
fn the_sky_of_a_cell_is_that_of_the_whole() {
    let mut quads = room(1., 1., 1.);
    quads.retain(|(name, _)| !["top", "y0", "y1"].contains(name));
    let whole = place(&quads, "");
    let half = place(
        &[
            ("bottom", [[0., 0., 0.], [0.5, 0., 0.], [0.5, 1., 0.], [0., 1., 0.]]),
            ("x0", [[0., 0., 0.], [0., 1., 0.], [0., 1., 1.], [0., 0., 1.]]),
        ],
        "",
    );
    let light = |place: &Place, more: &str| {
        place
            .line(&format!(
                "compute scene.obj -o store --periodic y=0..1 --repeats 6 {more}"
            ))
            .is(0);
        place.line("sky scene.obj --matrix store --up z").is(0);
        assert_eq!(place.line("check store --json").is(0).json()["ok"], true);
        // Column 0 is the ground. Tregenza's lowest band has 30 patches, the next one 30, of 145.
        let bands = [1..31, 31..61, 101..146].map(|band: std::ops::Range<usize>| {
            (0..146)
                .map(|column| f64::from(u8::from(band.contains(&column))))
                .collect::<Vec<f64>>()
        });
        let file = place.path("store/sky/sky.npz");
        hemicube::sky::sky_product(&file, &bands).expect("a product")
    };
    let (all, part) = (light(&whole, ""), light(&half, "--symmetry x=0.5"));
    // The triangles of the wall x = 0 are 2 and 3 of both scenes.
    for band in 0..3 {
        for triangle in [2, 3] {
            near(part.of(triangle)[band], all.of(triangle)[band], 0.02);
        }
    }
    let low = all.of(2)[0].max(all.of(3)[0]);
    assert!(low < 0.05, "{low}");
}

/// The room without its pane.
fn quads_of_room(place: &Place) {
    place.write("scene.obj", obj(&room(1., 1., 1.)));
}

#[test]
fn a_unit_square_is_a_sixth_from_the_middle() {
    near(square(0.5), 1.0 / 6.0, 1e-12);
    near(parallel_rectangles(1., 1., 1.), 0.199_824_895_698_387, 1e-9);
}
