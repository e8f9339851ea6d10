//! Rows through portals against further closed forms: corners of mirrors, mirrors and panes in ducts, strips without
//! end, sectors of a prism, and mirrors of facets, which converge.
//!
//! The binary is the one beside this test: build it with the same profile and target directory before. `--nocapture`
//! shows how far each form factor is off: the tables of docs/dev/portals.md.

#![cfg(unix)]
#![allow(clippy::print_stderr, reason = "figures of the book")]

use glam::DVec3;
use hemicube::solve::STEFAN_BOLTZMANN;
use hemicube_tests::geometry::{parallel_rectangles, parallel_rectangles_apart, slope, sphere};
use hemicube_tests::matrices::entries;
use hemicube_tests::rooms::{Quad, both_ways, near, of, place, room, zones};
use hemicube_tests::runs::Place;
use serde_json::Value;
use std::f64::consts::TAU;
use std::fmt::Write;

const EACH: [(&str, f64); 2] = [("--tolerance 0.1%", 1e-3), ("--tolerance 0.01%", 1e-4)];
const UNIT: [[f64; 2]; 2] = [[0.0, 1.0], [0.0, 1.0]];

/// A scene, its mirrors, its settings, and what form factors between its objects are.
struct Case<'q> {
    name: &'q str,
    quads: Vec<Quad<'q>>,
    optics: String,
    settings: &'q str,
    exact: Vec<(&'q str, &'q str, f64)>,
}

impl Case<'_> {
    /// Holds the rows at both tolerances, and what `check` holds.
    #[track_caller]
    fn hold(&self, each: &[(&str, f64)]) {
        let place = place(&self.quads, &self.optics);
        let optics = if self.optics.is_empty() {
            ""
        } else {
            "--specular optics.toml"
        };
        for (tolerance, most) in each {
            place
                .line(&format!(
                    "compute scene.obj -o store --overwrite {optics} {tolerance} {}",
                    self.settings
                ))
                .is(0);
            let report = place.line("check store --json").is(0).json();
            assert_eq!(report["ok"], true, "{report}");
            let residual = report["reciprocity"]["residual"].as_f64().expect("a number");
            // Relative to the norm of the pairs that are there, of which some rows have few.
            let is_whole = !self.settings.contains("--emitters");
            assert!(!is_whole || residual < 3.0 * most, "reciprocity {residual}");
            let zones = zones(&place, "store");
            for (from, to, exact) in &self.exact {
                let found = of(&zones, from, to);
                eprintln!(
                    "{} {tolerance} {from} {to}: {exact:.6}, {:+.1e} off",
                    self.name,
                    found - exact
                );
                near(found, *exact, *most);
            }
        }
    }
}

fn apart(m: i32, n: i32, distance: f64) -> f64 {
    let (x, y) = (f64::from(m), f64::from(n));
    parallel_rectangles_apart(UNIT, [[x, x + 1.0], [y, y + 1.0]], distance)
}

#[test]
fn a_mirror_under_two_patches() {
    let patch = |x: f64| [[x, 0., 1.], [x, 1., 1.], [x + 1., 1., 1.], [x + 1., 0., 1.]];
    let case = Case {
        name: "a mirror under two patches",
        quads: vec![
            ("p1", patch(0.0)),
            ("p2", patch(1.0)),
            ("m", [[0., 0., 0.], [2., 0., 0.], [2., 1., 0.], [0., 1., 0.]]),
        ],
        optics: "[object.m]\nspecular = 0.8\n".to_owned(),
        settings: "",
        exact: vec![
            ("p1", "p1", 0.8 * apart(0, 0, 2.0)),
            ("p1", "p2", 0.8 * apart(1, 0, 2.0)),
            ("p2", "p1", 0.8 * apart(1, 0, 2.0)),
        ],
    };
    case.hold(&EACH);
}

#[test]
fn two_and_three_mirrors_at_right_angles() {
    for reflectance in [0.6, 1.0] {
        // Images of both, in either order one.
        let sum = |more: i32| -> f64 {
            let corners = [(0, 0), (1, 0), (0, 1), (1, 1)];
            let each = corners.map(|(m, n)| f64::powi(reflectance, m + n + more) * apart(-m, -n, f64::from(1 + more)));
            each.iter().sum()
        };
        let optics = format!("[object.x0]\nspecular = {reflectance}\n[object.y0]\nspecular = {reflectance}\n");
        let two = Case {
            name: "two mirrors at right angles",
            quads: room(1., 1., 1.),
            optics: optics.clone(),
            settings: "",
            exact: vec![("bottom", "top", sum(0)), ("top", "bottom", sum(0))],
        };
        two.hold(&EACH);
        let three = Case {
            name: "a corner of three",
            quads: room(1., 1., 1.),
            optics: format!("{optics}[object.bottom]\nspecular = {reflectance}\n"),
            settings: "",
            exact: vec![("top", "top", sum(1)), ("top", "bottom", sum(0))],
        };
        three.hold(&EACH);
    }
}

/// In a duct of perfect mirrors everything comes to the pane, and of that its shares to the ends. The pane's back is
/// its corners the other way round, cut along the other diagonal.
#[test]
fn a_pane_in_a_duct_of_mirrors() {
    let mut quads = room(1., 1., 2.);
    let pane = [[0., 0., 1.], [1., 0., 1.], [1., 1., 1.], [0., 1., 1.]];
    let [a, b, c, d] = pane;
    quads.extend([("pane", pane), ("pane", [d, c, b, a])]);
    let case = Case {
        name: "a pane in a duct of mirrors",
        quads,
        optics: "[object.\"x*\"]\nspecular = 1\n[object.\"y*\"]\nspecular = 1\n[object.pane]\ntransmittance = \
                 0.6\nspecular = 0.3\n"
            .to_owned(),
        settings: "--emitters bottom",
        exact: vec![
            ("bottom", "top", 0.6),
            ("bottom", "bottom", 0.3),
            ("bottom", "pane", 1.0),
        ],
    };
    case.hold(&EACH[..1]);
}

/// With walls of ρs = ½, unfolded: a path passes the pane once to the top, and is thrown back once to the bottom.
#[test]
fn a_pane_in_a_duct_of_half_mirrors() {
    let over = |distance: f64| -> f64 {
        let images = (-40..=40).flat_map(|m: i32| (-40..=40).map(move |n: i32| (m, n)));
        images
            .map(|(m, n)| 0.5f64.powi(m.abs() + n.abs()) * apart(m, n, distance))
            .sum()
    };
    let mut quads = room(1., 1., 2.);
    quads.extend(both_ways((
        "pane",
        [[0., 0., 1.], [1., 0., 1.], [1., 1., 1.], [0., 1., 1.]],
    )));
    let case = Case {
        name: "a pane in a duct of half mirrors",
        quads,
        optics: "[object.\"x*\"]\nspecular = 0.5\n[object.\"y*\"]\nspecular = 0.5\n[object.pane]\ntransmittance = \
                 0.6\nspecular = 0.3\n"
            .to_owned(),
        settings: "--emitters bottom",
        exact: vec![
            ("bottom", "top", 0.6 * over(2.0)),
            ("bottom", "bottom", 0.3 * over(2.0)),
            ("bottom", "pane", over(1.0)),
        ],
    };
    case.hold(&[("--tolerance 0.1%", 2e-4)]);
}

#[test]
fn mirrors_of_two_kinds_face_each_other() {
    let [left, right] = [0.5f64, 0.9];
    // m mirrors, beginning on the right for m > 0.
    let sum = (-60..=60).map(|m: i32| {
        let once = if m > 0 { right } else { left };
        let rest = if m % 2 == 0 { 1.0 } else { once };
        (left * right).powi(m.abs() / 2) * rest * apart(m, 0, 1.0)
    });
    let case = Case {
        name: "mirrors of two kinds",
        quads: room(1., 1., 1.),
        optics: "[object.x0]\nspecular = 0.5\n[object.x1]\nspecular = 0.9\n".to_owned(),
        settings: "--emitters bottom",
        exact: vec![("bottom", "top", sum.sum())],
    };
    case.hold(&EACH);
}

/// Hottel's strings of strips without end.
#[test]
fn strips_without_end() {
    let floor = [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]];
    let apart = 0.5 * (2f64.sqrt() + 10f64.sqrt() - 2.0 * 5f64.sqrt());
    let strips = Case {
        name: "strips without end",
        quads: vec![
            ("floor", floor),
            ("ceiling", [[2., 0., 1.], [2., 1., 1.], [3., 1., 1.], [3., 0., 1.]]),
        ],
        optics: String::new(),
        settings: "--periodic y=0..1",
        exact: vec![("floor", "ceiling", apart), ("ceiling", "floor", apart)],
    };
    strips.hold(&EACH);
    // The same with a wall beside both that is half a mirror: the image of the ceiling is one further.
    let over = 2f64.sqrt() - 1.0 + 0.5 * 0.5 * (1.0 + 5f64.sqrt() - 2.0 * 2f64.sqrt());
    let mirrored = Case {
        name: "strips beside half a mirror",
        quads: vec![
            ("floor", floor),
            ("m", [[1., 0., 0.], [1., 0., 1.], [1., 1., 1.], [1., 1., 0.]]),
            ("ceiling", [[0., 0., 1.], [0., 1., 1.], [1., 1., 1.], [1., 0., 1.]]),
        ],
        optics: "[object.m]\nspecular = 0.5\n".to_owned(),
        settings: "--periodic y=0..1",
        exact: vec![("floor", "ceiling", over), ("ceiling", "floor", over)],
    };
    mirrored.hold(&EACH);
}

/// A prism of n sides, of which one sector is given: its floor sees the ceiling as the whole floor does.
#[test]
fn sectors_of_prisms_have_the_rows_of_the_prism() {
    let side = 2f64.sqrt();
    for count in [3u32, 4, 6, 8] {
        let corner = |k: u32, z: f64| {
            let (sin, cos) = (TAU * f64::from(k) / f64::from(count)).sin_cos();
            [cos, sin, z]
        };
        let mut text = String::new();
        let mut part = String::new();
        for k in 0..count {
            let corners = [
                [0., 0., 0.],
                corner(k, 0.),
                corner(k + 1, 0.),
                [0., 0., 1.],
                corner(k, 1.),
                corner(k + 1, 1.),
            ];
            for [x, y, z] in corners {
                writeln!(text, "v {x} {y} {z}").expect("a string");
            }
            let [a, b, c, d, e, f] = [1, 2, 3, 4, 5, 6].map(|place| 6 * k + place);
            writeln!(
                text,
                "o floor\nf {a} {b} {c}\no ceiling\nf {d} {f} {e}\no wall\nf {b} {e} {f} {c}"
            )
            .expect("a string");
            if k == 0 {
                part.clone_from(&text);
            }
        }
        let place = Place::new();
        place.write("prism.obj", text);
        place.write("sector.obj", part);
        let of = |line: &str| {
            place
                .line(&format!(
                    "compute {line} -o store --overwrite --by object --tolerance 0.01%"
                ))
                .is(0);
            assert_eq!(place.line("check store --json").is(0).json()["ok"], true);
            entries(&place.path("store"), 0..3, |patch| patch)
        };
        let (whole, sector) = (of("prism.obj"), of(&format!("sector.obj --sector z,{count}")));
        for (pair, factor) in &whole {
            near(sector[pair], *factor, 1e-4);
        }
        if count == 4 {
            near(sector[&(0, 1)], parallel_rectangles(side, side, 1.), 1e-4);
        }
    }
}

/// From disk to disk of a tube of radius 1 and length 2 that is a mirror of ρs = ½, of so many facets; the exact tube
/// has 0.446882. The row of one sector is that of all.
fn tube(facets: u32, tolerance: &str) -> f64 {
    let mut text = String::from("v 0 0 0\nv 0 0 2\n");
    for z in [0, 2] {
        for k in 0..facets {
            let (sin, cos) = (TAU * f64::from(k) / f64::from(facets)).sin_cos();
            writeln!(text, "v {cos} {sin} {z}").expect("a string");
        }
    }
    let (low, high) = (|k: u32| 3 + k % facets, |k: u32| 3 + facets + k % facets);
    let face = |name: &str, k: u32| match name {
        "bottom" => format!("1 {} {}", low(k), low(k + 1)),
        "top" => format!("2 {} {}", high(k + 1), high(k)),
        _ => format!("{} {} {} {}", low(k), high(k), high(k + 1), low(k + 1)),
    };
    for name in ["bottom", "top", "wall"] {
        writeln!(text, "o {name}").expect("a string");
        for k in 0..facets {
            writeln!(text, "f {}", face(name, k)).expect("a string");
        }
    }
    let place = Place::new();
    place.write("tube.obj", text);
    place.write("optics.toml", "[object.wall]\nspecular = 0.5\n");
    place
        .line(&format!(
            "compute tube.obj -o store --specular optics.toml --rows 0..1 {tolerance}"
        ))
        .is(0);
    let row = entries(&place.path("store"), 0..1, |patch| patch);
    let of_top = row.iter().filter(|((_, to), _)| (facets..2 * facets).contains(to));
    of_top.map(|(_, factor)| factor).sum()
}

#[track_caller]
fn converges(facets: &[u32], tolerance: &str) {
    const EXACT: f64 = 0.446_882_304_852_22;
    let found: Vec<(f64, f64)> = facets
        .iter()
        .map(|&facets| (f64::from(facets), EXACT - tube(facets, tolerance)))
        .collect();
    let order = -slope(&found);
    eprintln!("{tolerance}: of facets the error {found:?}, slope {order:.2}");
    assert!((1.8..2.2).contains(&order), "{order}: {found:?}");
    assert!(
        found.iter().all(|&(facets, off)| off < 2.5 / (facets * facets)),
        "{found:?}"
    );
}

#[test]
fn a_tube_of_facets_converges_by_the_square_of_their_number() {
    converges(&[6, 12, 24], "--tolerance 0.1%");
}

#[test]
#[ignore = "13 seconds of processor time"]
fn a_tube_of_more_facets_converges_likewise() {
    converges(&[12, 24, 48, 96], "--tolerance 0.02%");
}

/// A sphere of radius ½, `inner`, within one of radius 1, `outer`: so many triangles to an edge of an octahedron, and the
/// spheres' areas.
fn spheres(inner: u32, outer: u32) -> Place {
    let mut text = String::new();
    let mut corners = 0;
    let mut add = |name: &str, triangles: Vec<[DVec3; 3]>, radius: f64| {
        let of_facets: f64 = triangles
            .iter()
            .map(|[a, b, c]| 0.5 * (b - a).cross(c - a).length())
            .sum();
        let scale = radius * (2.0 * TAU / of_facets).sqrt();
        writeln!(text, "o {name}").expect("a string");
        for triangle in triangles {
            for corner in triangle {
                let DVec3 { x, y, z } = corner * scale;
                writeln!(text, "v {x} {y} {z}").expect("a string");
            }
            writeln!(text, "f {} {} {}", corners + 1, corners + 2, corners + 3).expect("a string");
            corners += 3;
        }
    };
    add("inner", sphere(inner, 1.0, false, true), 0.5);
    add("outer", sphere(outer, 1.0, true, true), 1.0);
    let place = Place::new();
    place.write("spheres.obj", text);
    place.write("optics.toml", "[object.outer]\nspecular = 0.5\n");
    place
}

/// What a sphere within a mirror of ρs = ½ sees of itself, ½ of smooth spheres, and of the mirror, 1.
fn within_a_mirror(inner: u32, outer: u32) -> [f64; 2] {
    let place = spheres(inner, outer);
    place
        .line("compute spheres.obj -o store --specular optics.toml --rows 0..4")
        .is(0);
    let row = entries(&place.path("store"), 0..4, |patch| {
        u32::from(patch >= 8 * inner * inner)
    });
    let of = |column: u32| {
        row.iter()
            .filter(|((_, to), _)| *to == column)
            .map(|(_, factor)| factor / 4.0)
            .sum()
    };
    [of(0), of(1)]
}

/// Heat that leaves the inner of two grey spheres of ε = ½, in parts of A₁ σ (T₁⁴ − T₂⁴).
fn heat_between_spheres(pieces: u32, optics: &str) -> f64 {
    let place = spheres(2, pieces);
    place
        .line(&format!("compute spheres.obj -o store {optics} --quiet"))
        .is(0);
    place.write(
        "heat.toml",
        "[default]\nemissivity = 0.5\n[object.inner]\ntemperature = 400\n[object.outer]\ntemperature = 300\n",
    );
    place
        .line("solve store --materials heat.toml --thermal --by object -o by.json --quiet")
        .is(0);
    let text = std::fs::read_to_string(place.path("by.json")).expect("results");
    let json: Value = serde_json::from_str(&text).expect("JSON");
    let surfaces = json["surfaces"].as_array().expect("surfaces");
    let inner = surfaces.iter().find(|surface| surface["name"] == "inner");
    let heat = inner.and_then(|inner| inner["heat"].as_f64()).expect("its heat");
    let black = STEFAN_BOLTZMANN * (400f64.powi(4) - 300f64.powi(4));
    heat / (black * 0.5 * TAU)
}

/// An outer sphere that reflects diffusely lets 1 / (1/ε₁ + A₁/A₂ (1/ε₂ − 1)) = 4/9 through, a mirror
/// 1 / (1/ε₁ + 1/ε₂ − 1) = 1/3 (Siegel & Howell 2002): facets converge to it.
#[test]
#[ignore = "half a minute of processor time and more: ./test --full"]
fn heat_between_spheres_is_that_of_diffuse_and_of_specular_ones() {
    near(heat_between_spheres(4, ""), 4.0 / 9.0, 0.01);
    let off: Vec<f64> = [2, 4, 8]
        .iter()
        .map(|&pieces| heat_between_spheres(pieces, "--specular optics.toml") - 1.0 / 3.0)
        .collect();
    eprintln!("heat to a mirror of facets is {off:?} off");
    assert!(
        off[0] > 1.5 * off[1] && off[1] > 1.5 * off[2] && off[2].abs() < 0.03,
        "{off:?}"
    );
}

/// Facets shift the image of a radius against itself: the error falls as their edges, not as the square.
#[test]
fn a_mirror_round_a_sphere_converges_by_its_edges() {
    let off: Vec<[f64; 2]> = [3, 6, 12]
        .iter()
        .map(|&pieces| {
            let [own, mirror] = within_a_mirror(3, pieces);
            [0.5 - own, mirror - 1.0]
        })
        .collect();
    for which in 0..2 {
        let points: Vec<(f64, f64)> = [3.0, 6.0, 12.0]
            .into_iter()
            .zip(off.iter().map(|off| off[which]))
            .collect();
        let order = -slope(&points);
        eprintln!("of pieces of an edge the error {points:?}, slope {order:.2}");
        assert!((0.75..1.3).contains(&order), "{order}: {points:?}");
    }
    // Two arrivals at the mirror are one at the sphere.
    assert!((off[2][1] - 2.0 * off[2][0]).abs() < 0.02, "{off:?}");
}
