//! Parts of cities with planes of symmetry, sectors and periods against the whole: the part first in its file, then its
//! images, in the order in which the program makes them.

#![cfg(unix)]

use hemicube_scene::generate::{Generate, Kind, generate};
use hemicube_tests::matrices::{apart, entries};
use hemicube_tests::runs::Place;
use std::fmt::Write;

type Corner = [f64; 3];
type Triangles = Vec<[Corner; 3]>;

fn city(target_patches: u64) -> Triangles {
    let spec = Generate {
        kind: Kind::BlockCity,
        target_patches,
        seed: 1,
    };
    let scene = generate(spec).expect("a city");
    scene
        .triangles
        .iter()
        .map(|t| t.corners.map(|p| p.to_array()))
        .collect()
}

fn extent(city: &Triangles, axis: usize) -> [f64; 2] {
    let places = city.iter().flatten().map(|corner| corner[axis]);
    [
        places.clone().fold(f64::INFINITY, f64::min),
        places.fold(f64::NEG_INFINITY, f64::max),
    ]
}

fn moved(part: &Triangles, motion: impl Fn(Corner) -> Corner) -> Triangles {
    part.iter().map(|corners| corners.map(&motion)).collect()
}

fn obj(triangles: &Triangles) -> String {
    let mut text = String::new();
    for corner in triangles.iter().flatten() {
        let [x, y, z] = corner;
        writeln!(text, "v {x} {y} {z}").expect("a string");
    }
    for first in (1..=3 * triangles.len()).step_by(3) {
        writeln!(text, "f {first} {} {}", first + 1, first + 2).expect("a string");
    }
    text
}

/// A part and the whole, computed.
struct Both {
    place: Place,
    part: u32,
}

impl Both {
    fn new(part: &Triangles, whole: &Triangles) -> Self {
        let place = Place::new();
        place.write("part.obj", obj(part));
        place.write("whole.obj", obj(whole));
        Self {
            place,
            part: u32::try_from(part.len()).expect("few"),
        }
    }

    /// The relative Frobenius distance of the part's rows from the whole's, columns of images added up; and what the
    /// part's report says of what was cut off, and of the sky.
    fn apart(&self, portals: &str, settings: &str) -> (f64, [f64; 2], f64) {
        let Self { place, part } = self;
        place
            .line(&format!("compute part.obj -o part --overwrite {portals} {settings}"))
            .is(0);
        place
            .line(&format!(
                "compute whole.obj -o whole --overwrite {settings} --rows 0..{part}"
            ))
            .is(0);
        let report = place.line("check part --json").is(0).json();
        assert_eq!(report["ok"], true, "{report}");
        let whole = place.line("check whole --json").is(0).json();
        let fold = |column: u32| column % part;
        let [one, other] = ["part", "whole"].map(|store| entries(&place.path(store), 0..*part, fold));
        let number = |value: &serde_json::Value| value.as_f64().unwrap_or(0.0);
        (
            apart(&one, &other),
            [number(&report["escaped"]), number(&whole["escaped"])],
            number(&report["cut_off"]),
        )
    }
}

/// Rounding of columns to f32 before they are added up, of some images.
const ROUNDED: f64 = 1e-6;

#[test]
fn half_a_city_has_the_rows_of_the_whole() {
    let half = city(126);
    let [_, high] = extent(&half, 0);
    let mirrored = half.iter().map(|&[a, b, c]| [a, c, b]).collect();
    let mirrored = moved(&mirrored, |[x, y, z]| [2.0 * high - x, y, z]);
    let both = Both::new(&half, &[half.clone(), mirrored].concat());
    let (apart, escaped, _) = both.apart(&format!("--symmetry x={high}"), "--correction pixel --resolution 64");
    assert!(apart < ROUNDED, "{apart}");
    assert!((escaped[0] - escaped[1]).abs() < ROUNDED, "{escaped:?}");
    for (settings, tolerance) in [("", 0.02), ("--tolerance 1%", 0.01)] {
        let (apart, _, _) = both.apart(&format!("--symmetry x={high}"), settings);
        assert!(apart < tolerance, "{settings}: {apart}");
    }
    // The comparator sees the other half.
    let (apart, _, _) = both.apart("", "--tolerance 2%");
    assert!(apart > 0.01, "{apart}");
}

#[test]
fn one_of_twelve_sectors_has_the_rows_of_the_ring() {
    let turn = |k: u32| {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / 12.0).sin_cos();
        move |[x, y, z]: Corner| [x * cos - y * sin, x * sin + y * cos, z]
    };
    let at = |r: f64, part: f64, z: f64| {
        let (sin, cos) = (std::f64::consts::TAU / 12.0 * part).sin_cos();
        [r * cos, r * sin, z]
    };
    let mut sector = Triangles::new();
    let mut quad = |[a, b, c, d]: [Corner; 4]| sector.extend([[a, b, c], [a, c, d]]);
    for near in 1..4 {
        let (near, far) = (f64::from(near), f64::from(near) + 1.0);
        quad([at(near, 0., 0.), at(far, 0., 0.), at(far, 1., 0.), at(near, 1., 0.)]);
    }
    for [near, far, a, b, height] in [[1.3, 1.7, 0.2, 0.5, 0.6], [2.3, 2.8, 0.3, 0.8, 1.1]] {
        let ring = |z: f64| [at(near, a, z), at(far, a, z), at(far, b, z), at(near, b, z)];
        let (low, high) = (ring(0.0), ring(height));
        quad(high);
        for k in 0..4 {
            quad([low[k], low[(k + 1) % 4], high[(k + 1) % 4], high[k]]);
        }
    }
    let ring: Triangles = (0..12).flat_map(|k| moved(&sector, turn(k))).collect();
    let both = Both::new(&sector, &ring);
    let (apart, escaped, _) = both.apart("--sector z,12", "--tolerance 1%");
    assert!(apart < 0.01, "{apart}");
    assert!((escaped[0] - escaped[1]).abs() < 0.002, "{escaped:?}");
}

#[test]
fn a_periodic_cell_is_the_middle_of_its_tiling() {
    let cell = city(14);
    let ([x0, x1], [y0, y1]) = (extent(&cell, 0), extent(&cell, 1));
    let steps = [0, 1, -1, 2, -2, 3, -3].map(f64::from);
    let mut tiling = Triangles::new();
    for j in steps {
        for i in steps {
            let shift = |[x, y, z]: Corner| [x + i * (x1 - x0), y + j * (y1 - y0), z];
            tiling.extend(moved(&cell, shift));
        }
    }
    let both = Both::new(&cell, &tiling);
    let portals = format!("--periodic x={x0}..{x1},y={y0}..{y1} --repeats 3");
    let (apart, escaped, cut_off) = both.apart(&portals, "--tolerance 1%");
    assert!(apart < 0.01, "{apart}");
    // A ray out of the tiling's sides counts as sky there, and as cut off in the cell.
    assert!(
        (escaped[0] + cut_off - escaped[1]).abs() < 0.002,
        "{escaped:?} {cut_off}"
    );
    assert!(cut_off > 1e-3, "{cut_off}");
}
