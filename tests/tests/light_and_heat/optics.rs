//! Uses of rows through mirrors and panes: heat, balance, exchange factors, references by rays, Fresnel's
//! weights, bands, and the mirrors and panes of scene files.
//!
//! The binary is the one beside this test: build it with the same profile and target directory before.

#![cfg(unix)]

use hemicube::portal::Law;
use hemicube::solve::STEFAN_BOLTZMANN;
use hemicube_tests::matrices::entries;
use hemicube_tests::rooms::{Quad, both_ways, near, obj, of, place, room, zones};
use hemicube_tests::runs::Place;
use serde_json::Value;
use std::collections::BTreeMap;

const FOUR: &str = "[object.\"x*\"]\nspecular = 1\n[object.\"y*\"]\nspecular = 1\n";

/// Net heat of each surface, and its mean temperature.
fn heat(place: &Place, line: &str) -> BTreeMap<String, (f64, f64)> {
    place
        .line(&format!("{line} --thermal --by object -o by.json --overwrite --quiet"))
        .is(0);
    let text = std::fs::read_to_string(place.path("by.json")).expect("results");
    let json: Value = serde_json::from_str(&text).expect("JSON");
    let surfaces = json["surfaces"].as_array().expect("surfaces").iter();
    surfaces
        .map(|surface| {
            let number = |value: &Value| value.as_f64().expect("a number");
            let name = surface["name"].as_str().expect("a name").to_owned();
            (name, (number(&surface["heat"]), number(&surface["temperature"][0])))
        })
        .collect()
}

/// Perfect mirrors show each end nothing but itself and the other: two endless plates, of any length.
#[test]
fn between_four_mirrors_ends_exchange_as_endless_plates_do() {
    let plates = STEFAN_BOLTZMANN * (400f64.powi(4) - 300f64.powi(4)) / (1.0 / 0.8 + 1.0 / 0.5 - 1.0);
    for length in [1.0, 4.0] {
        let place = place(&room(1., 1., length), FOUR);
        place
            .line("compute scene.obj --specular optics.toml -o room --quiet")
            .is(0);
        place.write(
            "heat.toml",
            "[default]\nemissivity = 0\nadiabatic = true\n[object.bottom]\nemissivity = 0.8\ntemperature = 400\n\
             [object.top]\nemissivity = 0.5\ntemperature = 300\n",
        );
        let found = heat(&place, "solve room --materials heat.toml");
        near(found["bottom"].0, plates, 1e-3 * plates);
        near(found["top"].0, -plates, 1e-3 * plates);
        for mirror in ["x0", "x1", "y0", "y1"] {
            near(found[mirror].0, 0.0, 1e-9 * plates);
        }
        // Diffuse sides that absorb nothing let less through (Siegel & Howell 2002): black ends of a cube 0.59991.
        // As exchange factors: G = 1 − ε_top 𝓕 …, with 𝓕 / ε_bottom of the plates.
        let report = place
            .line("exchange room --materials heat.toml --by object -o factors.csv --overwrite --json")
            .is(0)
            .json();
        assert!(
            report["conservation"][0].as_f64().is_some_and(|off| off < 1e-6),
            "{report}"
        );
        // An emissivity beyond what the mirror leaves is refused, with its name.
        place.write("heat.toml", "[default]\nemissivity = 0.1\ntemperature = 300\n");
        place.line("solve room --thermal --materials heat.toml").is(2).says(&[
            "emissivity 0.1",
            "ρs + τ of 1",
            "at most",
        ]);
        place.write("light.toml", "[default]\nreflectance = 0.5\nemission = 1\n");
        place
            .line("solve room --materials light.toml")
            .is(2)
            .says(&["reflectance 0.5", "ρs + τ of 1"]);
    }
}

/// A room with a half mirror, a mirror that absorbs the rest, a pane of glass, and an open side.
fn glazed() -> Vec<Quad<'static>> {
    let mut quads = room(1., 1., 2.);
    quads.retain(|(name, _)| *name != "y1");
    quads.extend(both_ways((
        "pane",
        [[0., 0., 1.], [1., 0., 1.], [1., 1., 1.], [0., 1., 1.]],
    )));
    quads
}

const GLAZED: &str = "[object.x1]\nspecular = 0.6\n[object.x0]\nspecular = 0.3\n[object.pane]\nspecular = 0.1\n\
                      transmittance = 0.6\n";

#[test]
fn at_one_temperature_nothing_flows_through_mirrors_and_panes() {
    let place = place(&glazed(), GLAZED);
    for settings in ["", "--correction pixel --samples 4 --resolution 64"] {
        place
            .line(&format!(
                "compute scene.obj --specular optics.toml --split 2 -o room --overwrite --quiet {settings}"
            ))
            .is(0);
        place.write(
            "heat.toml",
            "[default]\nemissivity = 0.7\ntemperature = 300\n[object.x1]\nemissivity = 0.2\n[object.x0]\n\
             emissivity = 0.7\n[object.pane]\nemissivity = 0.3\n",
        );
        let found = heat(
            &place,
            "solve room --materials heat.toml --sky-temperature 300 --residual 1e-10",
        );
        let black = STEFAN_BOLTZMANN * 300f64.powi(4);
        for (name, (heat, _)) in &found {
            assert!(heat.abs() < 1e-6 * black, "{name} gives off {heat} W");
        }
        // Adiabatic mirrors and panes take the temperature of what is around them.
        place.write(
            "heat.toml",
            "[default]\nemissivity = 0.7\ntemperature = 300\n[object.x1]\nemissivity = 0.2\nadiabatic = true\n\
             [object.x0]\nemissivity = 0.7\n[object.pane]\nemissivity = 0.3\nadiabatic = true\n",
        );
        let found = heat(
            &place,
            "solve room --materials heat.toml --sky-temperature 300 --residual 1e-10",
        );
        near(found["pane"].1, 300.0, 1e-4);
        near(found["x1"].1, 300.0, 1e-4);
        // And what one gives off, others and the sky receive.
        place.write(
            "heat.toml",
            "[default]\nemissivity = 0.7\ntemperature = 300\n[object.x1]\nemissivity = 0.2\n[object.x0]\n\
             emissivity = 0.7\n[object.pane]\nemissivity = 0.3\n[object.bottom]\ntemperature = 400\n",
        );
        let report = place
            .line("solve room --thermal --materials heat.toml --json --quiet")
            .is(0)
            .json();
        let balance = &report["balance"][0];
        let of = |name: &str| balance[name].as_f64().expect("a number");
        let gone = of("absorbed") + of("escaped") + of("closure") + of("reciprocity") + of("residual");
        near(gone, of("emitted") + of("from_outside"), 1e-9 * gone);
        assert!((of("reciprocity") / gone).abs() < 0.02, "{balance}");
    }
}

#[test]
fn a_balanced_matrix_with_mirrors_closes_and_is_reciprocal() {
    let place = place(&glazed(), GLAZED);
    place
        .line("compute scene.obj --specular optics.toml --split 2 -o room --tolerance 5% --quiet")
        .is(0);
    let before = place.line("check room --json").is(0).json();
    assert!(before["reciprocity"]["residual"].as_f64().is_some_and(|off| off > 1e-4));
    place.line("balance room -o balanced --closure --quiet").is(0);
    let after = place
        .line("check balanced --json --max-closure 1e-5 --max-reciprocity 1e-5")
        .is(0)
        .json();
    assert_eq!(after["ok"], true, "{after}");
    let apart = place.line("balance room -o thinned --min-factor 1e-4").is(2);
    apart.says(&["small entries"]);
}

/// The reference goes through portals by walks of its own: it agrees with the rows, and notices paths cut short.
#[test]
fn rows_are_verified_by_rays_that_go_through_portals() {
    let place = place(&glazed(), GLAZED);
    let report = place
        .line("compute scene.obj --specular optics.toml -o room --tolerance 1% --verify 99 --json --quiet")
        .is(0)
        .json();
    let measured = &report["verification"]["measured"];
    let error = measured["relative_frobenius"].as_f64().expect("a number");
    assert!(error < 0.01, "{measured}");
    near(
        report["verification"]["closure"]["reference_mean"]
            .as_f64()
            .expect("a number"),
        0.0,
        3e-3,
    );
    let cut = place
        .line("compute scene.obj --specular optics.toml -o cut --tolerance 1% --verify 99 --json --specular-bound 0.5")
        .is(1)
        .json();
    assert_eq!(cut["verification"]["verdict"], "broken", "{cut}");
    // Half of a room with its plane of symmetry.
    let mut half = room(1., 1., 1.);
    half.retain(|(name, _)| *name != "x1");
    place.write("half.obj", obj(&half));
    place
        .line("compute half.obj --symmetry x=1 -o half --tolerance 1% --verify 99 --quiet")
        .is(0);
}

/// ∫ τ(θ) cos θ cos θ' / (π r²) between the ends of a box of height 2, by midpoints; r₁ sees r₂ through its middle.
fn through_pane(law: &Law, n: usize) -> f64 {
    let step = 1.0 / n as f64;
    let at = |k: usize| (k as f64 + 0.5) * step;
    let mut sum = 0.0;
    // Of the offsets of two points of unit squares: a triangle's weight along each edge.
    for i in 0..2 * n {
        for j in 0..2 * n {
            let (x, y) = (at(i) - 1.0, at(j) - 1.0);
            let squared = x * x + y * y + 4.0;
            let cosine = 2.0 / squared.sqrt();
            let kernel = cosine * cosine / (std::f64::consts::PI * squared);
            sum += (1.0 - x.abs()) * (1.0 - y.abs()) * kernel * law.at(cosine).transmittance;
        }
    }
    sum * step * step
}

#[test]
fn a_pane_of_glass_follows_fresnel() {
    let mut quads = room(1., 1., 2.);
    quads.extend(both_ways((
        "pane",
        [[0., 0., 1.], [1., 0., 1.], [1., 1., 1.], [0., 1., 1.]],
    )));
    let pane = Law::Pane {
        index: 1.52,
        depth: 0.006 * 20.0,
    };
    let exact = through_pane(&pane, 400);
    // At normal incidence 0.811: glass absorbs 11 %, its faces reflect 8 %.
    let clear = through_pane(&Law::Pane { index: 1.0, depth: 0.0 }, 400);
    near(clear, 0.068_589_588_818_552, 1e-6);
    let place = place(
        &quads,
        "[object.pane]\nindex = 1.52\nthickness = 0.006\nextinction = 20\n",
    );
    for (settings, most) in [
        ("--tolerance 0.1%", 1e-3 * exact.max(0.05)),
        ("--correction pixel --resolution 512 --samples 4", 0.02 * exact),
    ] {
        place
            .line(&format!(
                "compute scene.obj --specular optics.toml -o room --overwrite --emitters bottom --quiet {settings}"
            ))
            .is(0);
        assert_eq!(place.line("check room --json").is(0).json()["ok"], true);
        near(of(&zones(&place, "room"), "bottom", "top"), exact, most);
    }
    // A table of angles gives equal rows.
    let rows: Vec<String> = (0..=90)
        .map(|degrees| {
            let at = pane.at(f64::from(degrees).to_radians().cos());
            format!("[{degrees}, {}, {}]", at.transmittance, at.specular)
        })
        .collect();
    place.write(
        "optics.toml",
        format!("[material.pane]\nangles = [{}]\n", rows.join(", ")),
    );
    place
        .line("compute scene.obj --specular optics.toml -o table --emitters bottom --quiet --tolerance 0.1%")
        .is(0);
    near(of(&zones(&place, "table"), "bottom", "top"), exact, 1e-4);
    place
        .line("balance room -o no --closure")
        .is(2)
        .says(&["depend on the angle"]);
    for (text, words) in [
        ("index = 0.5", "index of refraction"),
        ("thickness = 1", "without an `index`"),
        ("index = 1.5\nspecular = 0.1", "give one of them"),
        ("index = 1.5\nextinction = 1", "no `thickness`"),
        ("angles = [[0, 0.5], [0, 0.4]]", "do not ascend"),
        ("angles = [[0]]", "a row of 1 numbers"),
        ("angles = [[0, 0.5, 0.6]]", "from 0 to 1"),
        ("specular = [0.1, 0.2]\ntransmittance = [0.1]", "has 2 bands"),
        ("specular = \"much\"", "optics.toml:2"),
    ] {
        place.write("optics.toml", format!("[object.pane]\n{text}\n"));
        place
            .line("compute scene.obj --specular optics.toml -o no")
            .is(2)
            .says(&[words]);
    }
}

#[test]
fn each_band_has_a_matrix() {
    let place = place(
        &room(1., 1., 1.),
        "bands = [\"light\", \"heat\"]\n[object.x1]\nspecular = [1, 0.5]\n",
    );
    let line = "compute scene.obj --specular optics.toml --tolerance 1% --emitters bottom";
    place
        .line(&format!("{line} -o room.hemicube"))
        .is(0)
        .says(&["band heat, 2 of 2"]);
    near(
        of(&zones(&place, "room-light.hemicube"), "bottom", "top"),
        0.285_875_384_850_71,
        3e-3,
    );
    near(
        of(&zones(&place, "room-heat.hemicube"), "bottom", "top"),
        0.242_850_140_274_55,
        3e-3,
    );
    // What rows see directly is computed once for both, and rows are those of a band alone, to the bit.
    place.write("optics.toml", "[object.x1]\nspecular = 0.5\n");
    place.line(&format!("{line} -o alone")).is(0);
    let rows = |store: &str| entries(&place.path(store), 0..2, |patch| patch);
    assert_eq!(rows("room-heat.hemicube"), rows("alone"));
    place.write(
        "optics.toml",
        "bands = [\"light\", \"heat\"]\n[object.x1]\nspecular = [1, 0.5]\n",
    );
    place
        .line(&format!("{line} -o room.hemicube --overwrite --json"))
        .is(2)
        .says(&["one matrix"]);
    place.write("optics.toml", "bands = [\"a/b\", \"c\"]\n[object.x1]\nspecular = 1\n");
    place.line(&format!("{line} -o no")).is(2).says(&["a/b"]);
}

/// A band whose matrix lacks parts is gone on with, and the other, which is complete, is left as it is.
#[test]
fn bands_are_resumed_each_by_what_it_lacks() {
    let place = place(
        &room(1., 1., 1.),
        "bands = [\"light\", \"heat\"]\n[object.x1]\nspecular = [1, 0.5]\n",
    );
    for correction in ["pixel", "tolerance"] {
        let line = format!("compute scene.obj --specular optics.toml --split 5 --correction {correction} -o room");
        place.line(&format!("{line} --overwrite")).is(0);
        let bytes = |band: &str| {
            let parts = place.path(format!("room-{band}/parts"));
            let mut found: Vec<(std::path::PathBuf, Vec<u8>)> = std::fs::read_dir(parts)
                .expect("parts")
                .map(|entry| entry.expect("a part").path())
                .map(|path| (path.clone(), std::fs::read(path).expect("read")))
                .collect();
            found.sort();
            found
        };
        let whole = [bytes("light"), bytes("heat")];
        assert!(whole[0].len() > 1, "{}", whole[0].len());
        std::fs::remove_file(&whole[1][1].0).expect("removed");
        place
            .line(&line)
            .is(0)
            .says(&["it was complete, and nothing was computed", "going on with `room-heat`"]);
        assert_eq!([bytes("light"), bytes("heat")], whole);
    }
}

#[test]
fn scene_files_have_their_own_mirrors_and_panes() {
    let place = Place::new();
    place.write("scene.obj", format!("mtllib scene.mtl\n{}", obj(&room(1., 1., 1.))));
    place.write(
        "scene.mtl",
        "newmtl x1\nKd 0 0 0\nKs 0.5 0.5 0.5\nillum 3\nnewmtl top\nKd 0.5 0.5 0.5\nKs 0.5 0.5 0.5\nillum 2\n",
    );
    let line = "compute scene.obj --tolerance 1% --emitters bottom -o";
    place.line(&format!("{line} own --specular scene --quiet")).is(0);
    near(of(&zones(&place, "own"), "bottom", "top"), 0.242_850_140_274_55, 3e-3);
    // Nothing without the option.
    place.line(&format!("{line} none --quiet")).is(0);
    near(of(&zones(&place, "none"), "bottom", "top"), 0.199_824_895_698_39, 1e-3);
    place.write("scene.mtl", "newmtl x1\nKs 0.5 0.5 0.5\nillum 2\n");
    place
        .line(&format!("{line} no --specular scene"))
        .is(2)
        .says(&["no patch of the scene is a mirror or a pane"]);
}
