//! The reference against exact values, its own error against the true one, and estimators that must fail where it does
//! not: a reference that a wrong method passes is none.

#![allow(
    clippy::print_stdout,
    reason = "what was measured, and what was skipped, is for people"
)]

use glam::DVec3;
use hemicube::factor::{FactorRule, exchange, point_to_triangle};
use hemicube::reference::{
    EstimatedRow, Reference, ReferenceError, ReferenceRow, ReferenceSettings, errors_against, noise_of,
};
use hemicube::{HierarchyOptions, InputPatch, Model};
use hemicube_scene::{Material, Patches, Scene, Subdivision, Triangle, generate, load};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

type Quad = [DVec3; 4];

fn model_of(triangles: &[[DVec3; 3]], subdivision: Subdivision) -> Model {
    let scene = Scene {
        triangles: (0..)
            .zip(triangles)
            .map(|(face, &corners)| Triangle {
                corners,
                object: 0,
                material: 0,
                face,
                two_sided: false,
            })
            .collect(),
        objects: vec![String::new()],
        materials: vec![Material::default()],
        ..Scene::default()
    };
    model_of_scene(&scene, subdivision)
}

fn model_of_scene(scene: &Scene, subdivision: Subdivision) -> Model {
    let patches = Patches::new(scene, subdivision).expect("few patches");
    Model::new(Arc::new(patches), HierarchyOptions::default()).expect("a proper scene")
}

fn cut([a, b, c, d]: Quad) -> [[DVec3; 3]; 2] {
    [[a, b, c], [a, c, d]]
}

fn quad(corners: [[f64; 3]; 4]) -> Quad {
    corners.map(DVec3::from_array)
}

fn settings(target: f64) -> ReferenceSettings {
    ReferenceSettings {
        target,
        ..ReferenceSettings::default()
    }
}

fn ids(range: std::ops::Range<u32>) -> Vec<InputPatch> {
    range.map(InputPatch).collect()
}

/// A case with an exact value: the factor from the emitter's quads to the receiver's.
struct Case {
    name: String,
    emitter: Vec<Quad>,
    receiver: Vec<Quad>,
    obstructions: Vec<Quad>,
    exact: f64,
}

impl Case {
    fn model(&self) -> Model {
        let mut triangles: Vec<[DVec3; 3]> = Vec::new();
        for quad in self.emitter.iter().chain(&self.receiver).chain(&self.obstructions) {
            triangles.extend(cut(*quad));
        }
        model_of(&triangles, Subdivision::None)
    }

    fn emitters(&self) -> std::ops::Range<u32> {
        0..2 * u32::try_from(self.emitter.len()).expect("few")
    }

    fn receivers(&self) -> std::ops::Range<u32> {
        let start = self.emitters().end;
        start..start + 2 * u32::try_from(self.receiver.len()).expect("few")
    }

    /// Σ A_i F_ij / Σ A_i over the case's patches, by whatever gives A_i F_ij of two.
    fn sum(&self, model: &Model, mut pair: impl FnMut(InputPatch, InputPatch) -> f64) -> f64 {
        let (mut sum, mut area) = (0.0, 0.0);
        for i in self.emitters() {
            area += model.patches().area(InputPatch(i));
            for j in self.receivers() {
                sum += pair(InputPatch(i), InputPatch(j));
            }
        }
        sum / area
    }

    /// The reference's value and standard error.
    fn measure(&self, target: f64) -> (f64, f64) {
        let model = self.model();
        let reference = Reference::new(&model, settings(target)).expect("good settings");
        let rows = reference
            .rows(&ids(self.emitters()), 2, &mut |_| {})
            .expect("patches of the scene");
        let entry = |i: InputPatch, j: InputPatch| {
            let row = &rows[i.0 as usize];
            let place = row.columns.binary_search(&j.0).ok();
            place.map_or((0.0, 0.0), |place| (row.values[place], row.errors[place]))
        };
        let value = self.sum(&model, |i, j| model.patches().area(i) * entry(i, j).0);
        // Pairs are independent of each other: squares add.
        let area: f64 = self.emitters().map(|i| model.patches().area(InputPatch(i))).sum();
        let squares = self.sum(&model, |i, j| (model.patches().area(i) * entry(i, j).1).powi(2)) * area;
        (value, squares.sqrt() / area)
    }

    fn check(&self) {
        let (value, error) = self.measure(5e-4);
        println!("{}: {value:.8} ± {error:.1e}, exact {:.8}", self.name, self.exact);
        assert!(
            (value - self.exact).abs() <= 3.0 * error + 1e-12,
            "{}: {value} ± {error}, exact {}",
            self.name,
            self.exact
        );
        assert!(
            error <= 2e-3 * self.exact,
            "{}: an error of {error} says nothing",
            self.name
        );
    }
}

/// View3D's example of a square that hides a quarter of the other (Walton 2002; the value by quadrature of the exact
/// point-to-rectangle factor less the shadow's).
fn square_obstruction() -> Case {
    Case {
        name: "View3D's square obstruction".to_owned(),
        emitter: vec![quad([[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]])],
        receiver: vec![quad([[0., 0., 1.], [0., 1., 1.], [1., 1., 1.], [1., 0., 1.]])],
        obstructions: vec![quad([[0., 0., 0.5], [0.5, 0., 0.5], [0.5, 0.5, 0.5], [0., 0.5, 0.5]])],
        exact: 0.149_868_671_773_8,
    }
}

/// A slat across the gap between two squares; the value as above.
fn slat() -> Case {
    Case {
        name: "slat".to_owned(),
        emitter: vec![quad([[0., 0., 0.], [2., 0., 0.], [2., 2., 0.], [0., 2., 0.]])],
        receiver: vec![quad([[0., 0., 2.], [0., 2., 2.], [2., 2., 2.], [2., 0., 2.]])],
        obstructions: vec![quad([[0.5, 0., 1.], [1.5, 0., 1.], [1.5, 2., 1.], [0.5, 2., 1.]])],
        exact: 0.058_326_845_901_8,
    }
}

/// A floor and a wall with a common edge, and a low fence close to the wall, where the kernel is largest.
///
/// From x on the floor beyond the fence, the part of the wall below `height · x / (x − distance)` is hidden over its
/// whole width, so what is left is a rectangle, whose closed form is integrated over the floor.
fn fence(distance: f64, height: f64) -> Case {
    let strip = |from: f64, to: f64, steps: u32, bottom: &dyn Fn(f64) -> f64| {
        let mut sum = 0.0;
        for k in 0..steps {
            // Graded to the strip's start, where the shadow's edge moves fastest.
            let u = (f64::from(k) + 0.5) / f64::from(steps);
            let x = from + (to - from) * u.powi(3);
            let dx = (to - from) * 3.0 * u * u / f64::from(steps);
            let low = bottom(x);
            if low >= 1.0 {
                continue;
            }
            for l in 0..200u32 {
                let y = (f64::from(l) + 0.5) / 200.0;
                let wall = quad([[0., 0., low], [0., 1., low], [0., 1., 1.], [0., 0., 1.]]);
                let factor: f64 = cut(wall)
                    .iter()
                    .map(|t| point_to_triangle(DVec3::new(x, y, 0.0), DVec3::Z, t))
                    .sum();
                sum += factor * dx / 200.0;
            }
        }
        sum
    };
    let before = strip(0.0, distance, 1000, &|_| 0.0);
    let behind = strip(distance, 1.0, 2000, &|x| height * x / (x - distance));
    Case {
        name: format!("fence {distance} from the wall, {height} high"),
        emitter: vec![quad([[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]])],
        receiver: vec![quad([[0., 0., 0.], [0., 1., 0.], [0., 1., 1.], [0., 0., 1.]])],
        obstructions: vec![quad([
            [distance, 0., 0.],
            [distance, 1., 0.],
            [distance, 1., height],
            [distance, 0., height],
        ])],
        exact: before + behind,
    }
}

#[test]
fn exact_occluded_cases() {
    for case in [square_obstruction(), slat(), fence(0.05, 0.1), fence(0.02, 0.2)] {
        case.check();
    }
}

#[test]
fn a_wholly_hidden_receiver_is_not_in_the_row() {
    let case = Case {
        obstructions: vec![quad([[-1., -1., 0.5], [2., -1., 0.5], [2., 2., 0.5], [-1., 2., 0.5]])],
        ..square_obstruction()
    };
    assert_eq!(case.measure(1e-3), (0.0, 0.0));
}

/// Howell C-14: from a rectangle `w` wide to one `h` high at a right angle to it, with a common edge of length 1.
fn common_edge(w: f64, h: f64) -> f64 {
    let (w2, h2) = (w * w, h * h);
    let (sum, all) = (w2 + h2, 1.0 + w2 + h2);
    let logarithm = ((1.0 + w2) * (1.0 + h2) / all).ln()
        + w2 * (w2 * all / ((1.0 + w2) * sum)).ln()
        + h2 * (h2 * all / ((1.0 + h2) * sum)).ln();
    let angles = w * (1.0 / w).atan() + h * (1.0 / h).atan() - sum.sqrt() * (1.0 / sum.sqrt()).atan();
    (angles + 0.25 * logarithm) / (std::f64::consts::PI * w)
}

/// Howell C-13: between unit squares in parallel planes `gap` apart, one shifted by (`x`, `y`).
fn parallel(x: f64, y: f64, gap: f64) -> f64 {
    let corner = |x: f64, y: f64| {
        let (p, q) = (x.hypot(gap), y.hypot(gap));
        y * p * (y / p).atan() + x * q * (x / q).atan() - 0.5 * gap * gap * (x * x + y * y + gap * gap).ln()
    };
    // Second differences in each direction.
    let mut sum = 0.0;
    for (k, a) in [(1.0, -1.0), (-2.0, 0.0), (1.0, 1.0)] {
        for (l, b) in [(1.0, -1.0), (-2.0, 0.0), (1.0, 1.0)] {
            sum += k * l * corner(x + a, y + b);
        }
    }
    sum / (2.0 * std::f64::consts::PI)
}

#[test]
fn closed_forms_of_the_tests() {
    assert!((common_edge(1.0, 1.0) - 0.200_043_776_075_403).abs() < 1e-12);
    assert!((parallel(0.0, 0.0, 1.0) - 0.199_824_895_698_387).abs() < 1e-12);
    assert!((parallel(1.0, 0.0, 1.0) - 0.086_050_489_152_327_3).abs() < 1e-12);
}

/// A plate that radiates and receives on both sides above a floor: the floor sees its lower side only.
#[test]
fn two_sided_patches_are_seen_by_side() {
    let floor = cut(quad([[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]]));
    let plate = cut(quad([[0., 0., 1.], [1., 0., 1.], [1., 1., 1.], [0., 1., 1.]]));
    let mut scene = Scene {
        objects: vec![String::new()],
        materials: vec![Material::default()],
        ..Scene::default()
    };
    for (corners, two_sided) in floor.map(|t| (t, false)).into_iter().chain(plate.map(|t| (t, true))) {
        scene.triangles.push(Triangle {
            corners,
            object: 0,
            material: 0,
            face: 0,
            two_sided,
        });
    }
    let model = model_of_scene(&scene, Subdivision::None);
    let reference = Reference::new(&model, settings(1e-3)).expect("good settings");
    let rows = reference
        .rows(&ids(0..6), 2, &mut |_| {})
        .expect("patches of the scene");
    // Fronts are 2 and 4, backs 3 and 5.
    for row in &rows[..2] {
        assert_eq!(row.columns, [3, 5]);
        assert_eq!(row.blocked, 0.0);
    }
    let mean = |rows: &[&ReferenceRow]| {
        let sum: f64 = rows.iter().flat_map(|row| &row.values).sum();
        sum / rows.len() as f64
    };
    assert!((mean(&[&rows[0], &rows[1]]) - 0.199_824_9).abs() < 1e-6);
    assert!((mean(&[&rows[3], &rows[5]]) - 0.199_824_9).abs() < 1e-6);
    assert!(rows[2].columns.is_empty() && rows[4].columns.is_empty());
    assert_eq!((rows[2].escaped, rows[4].escaped), (1.0, 1.0));
}

#[test]
fn unoccluded_cases() {
    let emitter = vec![quad([[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]])];
    for (name, receiver, exact) in [
        // Howell C-11, C-14, and C-14's family with a point in common.
        (
            "parallel",
            quad([[0., 0., 1.], [0., 1., 1.], [1., 1., 1.], [1., 0., 1.]]),
            0.199_824_895_698_387,
        ),
        (
            "common edge",
            quad([[0., 0., 0.], [0., 1., 0.], [0., 1., 1.], [0., 0., 1.]]),
            0.200_043_776_075_403,
        ),
        (
            "common corner",
            quad([[0., 1., 0.], [0., 2., 0.], [0., 2., 1.], [0., 1., 1.]]),
            0.040_592_230_101_558_5,
        ),
        // The wall x = 1 goes through the middle of a floor twice as long; its lower half is out of sight. Half of the
        // floor sees it, as at a common edge.
        (
            "crossing",
            quad([[0.5, 0., -1.], [0.5, 0., 1.], [0.5, 1., 1.], [0.5, 1., -1.]]),
            0.5 * common_edge(0.5, 1.0),
        ),
        // So near that the factor from a point is a step at the other's edge.
        (
            "a hair apart",
            quad([[0.3, 0.2, 1e-3], [0.3, 1.2, 1e-3], [1.3, 1.2, 1e-3], [1.3, 0.2, 1e-3]]),
            parallel(0.3, 0.2, 1e-3),
        ),
    ] {
        let case = Case {
            name: name.to_owned(),
            emitter: emitter.clone(),
            receiver: vec![receiver],
            obstructions: Vec::new(),
            exact,
        };
        case.check();
    }
}

/// Cases of a file of exact values, where there is one beside the repository.
#[test]
fn exact_cases_of_the_file() {
    let path = shared().join("reference_cases.json");
    let Ok(text) = std::fs::read_to_string(&path) else {
        println!("SKIP exact_cases_of_the_file: no ../shared/reference_cases.json");
        return;
    };
    let file: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    let quads = |value: &serde_json::Value| -> Option<Vec<Quad>> {
        let quads: Vec<[[f64; 3]; 4]> = serde_json::from_value(value.clone()).ok()?;
        Some(quads.into_iter().map(quad).collect())
    };
    let mut checked = 0;
    for case in file["cases"].as_array().expect("a list of cases") {
        // Disks and enclosures are other shapes; a factor of exactly 0 has its own test.
        let (Some(emitter), Some(receiver), Some(obstructions), Some(exact)) = (
            quads(&case["emitter"]),
            quads(&case["receiver"]),
            quads(&case["obstructions"]),
            case["F_emitter_to_receiver"].as_f64(),
        ) else {
            continue;
        };
        if exact > 0.0 {
            Case {
                name: case["id"].to_string(),
                emitter,
                receiver,
                obstructions,
                exact,
            }
            .check();
            checked += 1;
        }
    }
    assert!(checked >= 10, "only {checked} cases of {}", path.display());
}

/// Visibility of one segment between the centroids: what a lazy reference would do.
#[test]
fn a_ray_between_centroids_must_fail() {
    let rule = FactorRule::for_tolerance(1e-4);
    for case in [square_obstruction(), slat(), fence(0.05, 0.1)] {
        let model = case.model();
        let reference = Reference::new(&model, settings(1e-3)).expect("good settings");
        let patches = model.patches();
        let lazy = case.sum(&model, |i, j| {
            let sees = reference
                .sees(i, patches.centroid(i), j, patches.centroid(j))
                .expect("patches of the scene");
            if sees {
                exchange(&patches.corners(i), &patches.corners(j), &rule)
            } else {
                0.0
            }
        });
        let (value, error) = case.measure(1e-3);
        assert!((value - case.exact).abs() <= 3.0 * error);
        assert!(
            (lazy / case.exact - 1.0).abs() > 0.02,
            "{}: centroids give {lazy}, which is right",
            case.name
        );
    }
}

/// The mean visibility of evenly drawn segments times the closed form: without a kernel in the mean.
#[test]
fn even_visibility_must_fail_near_contact() {
    let rule = FactorRule::for_tolerance(1e-4);
    let case = fence(0.02, 0.2);
    let model = case.model();
    let reference = Reference::new(&model, settings(1e-3)).expect("good settings");
    let patches = model.patches();
    let count = 20_000u32;
    let point = |[a, b, c]: [DVec3; 3], u: f64, v: f64| {
        let s = u.sqrt();
        a * (1.0 - s) + b * (s * (1.0 - v)) + c * (s * v)
    };
    let even = case.sum(&model, |i, j| {
        let seen = (0..count)
            .filter(|&k| {
                let u = |step: f64| (0.5 + f64::from(k) * step).fract();
                let from = point(patches.corners(i), u(0.856_674_883_854_503), u(0.733_891_856_627_126));
                let to = point(patches.corners(j), u(0.628_706_721_037_809), u(0.538_597_257_223_610));
                reference.sees(i, from, j, to).expect("patches of the scene")
            })
            .count();
        seen as f64 / f64::from(count) * exchange(&patches.corners(i), &patches.corners(j), &rule)
    });
    let (value, error) = case.measure(1e-3);
    println!(
        "even {even:.5}, reference {value:.5} ± {error:.1e}, exact {:.5}",
        case.exact
    );
    assert!((value - case.exact).abs() <= 3.0 * error);
    assert!((even / case.exact - 1.0).abs() > 0.05, "{even} is right");
}

fn cube() -> Vec<[DVec3; 3]> {
    let p = |x: f64, y: f64, z: f64| DVec3::new(x, y, z);
    [
        [p(0., 0., 0.), p(1., 0., 0.), p(1., 1., 0.), p(0., 1., 0.)],
        [p(0., 0., 1.), p(0., 1., 1.), p(1., 1., 1.), p(1., 0., 1.)],
        [p(0., 0., 0.), p(0., 1., 0.), p(0., 1., 1.), p(0., 0., 1.)],
        [p(1., 0., 0.), p(1., 0., 1.), p(1., 1., 1.), p(1., 1., 0.)],
        [p(0., 0., 0.), p(0., 0., 1.), p(1., 0., 1.), p(1., 0., 0.)],
        [p(0., 1., 0.), p(1., 1., 0.), p(1., 1., 1.), p(0., 1., 1.)],
    ]
    .into_iter()
    .flat_map(cut)
    .collect()
}

#[test]
fn rows_of_a_closed_cube_sum_to_one() {
    // Turned and moved: no plane of it lies along an axis.
    let turn = glam::DQuat::from_euler(glam::EulerRot::XYZ, 0.4, 0.7, 1.1);
    let triangles: Vec<_> = cube()
        .into_iter()
        .map(|t| t.map(|p| turn * p * 37.0 + DVec3::new(900.0, -40.0, 7.0)))
        .collect();
    let model = model_of(&triangles, Subdivision::Split(3));
    let reference = Reference::new(&model, settings(1e-3)).expect("good settings");
    for row in reference
        .rows(&ids(0..12), 2, &mut |_| {})
        .expect("patches of the scene")
    {
        assert_eq!((row.escaped, row.blocked), (0.0, 0.0));
        let error = row.errors.iter().map(|e| e * e).sum::<f64>().sqrt();
        let sum: f64 = row.values.iter().sum();
        assert!((sum - 1.0).abs() <= 3.0 * error + row.missed + 2e-5, "{sum} ± {error}");
        assert!(row.agreement < 2.0, "{}", row.agreement);
        assert!(row.columns.binary_search(&row.emitter).is_err());
    }
}

/// The inside of a box, its sides cut into quads as nearly as may be of the sizes asked for; `open` sides are left out.
fn flat_box(size: [f64; 3], cuts: [u32; 3], open: &[usize]) -> Vec<[DVec3; 3]> {
    let mut triangles = Vec::new();
    for side in (0..6).filter(|side| !open.contains(side)) {
        let (axis, far) = (side / 2, side % 2 == 1);
        let (p, q) = ((axis + 1) % 3, (axis + 2) % 3);
        let at = |k: u32, l: u32| {
            let mut point = [0.0; 3];
            point[axis] = if far { size[axis] } else { 0.0 };
            point[p] = size[p] * f64::from(k) / f64::from(cuts[p]);
            point[q] = size[q] * f64::from(l) / f64::from(cuts[q]);
            DVec3::from_array(point)
        };
        for k in 0..cuts[p] {
            for l in 0..cuts[q] {
                let [a, b, c, d] = [at(k, l), at(k + 1, l), at(k + 1, l + 1), at(k, l + 1)];
                triangles.extend(cut(if far { [a, d, c, b] } else { [a, b, c, d] }));
            }
        }
    }
    triangles
}

/// Thin, finely cut spaces, closed and with a side open: rays meet few of the patches that are in view, and what they
/// do not meet adds up.
#[test]
fn rows_of_flat_spaces_close() {
    for (size, cuts, open) in [
        ([1.2, 1.5, 0.016], [12, 12, 12], &[][..]),
        ([1.0, 1.0, 0.05], [24, 24, 2], &[]),
        ([4.0, 0.4, 0.01], [40, 8, 3], &[]),
        ([1.0, 1.0, 0.02], [16, 16, 4], &[1]),
        ([2.0, 1.0, 0.1], [20, 10, 3], &[5]),
    ] {
        let model = model_of(&flat_box(size, cuts, open), Subdivision::None);
        let count = model.geometry().patch_count;
        let emitters: Vec<_> = (0..12).map(|k| InputPatch(k * (count / 12) + 3 * k)).collect();
        let reference = Reference::new(&model, settings(1e-3)).expect("good settings");
        let rows = reference.rows(&emitters, 2, &mut |_| {}).expect("patches of the scene");
        let (mut squares, mut lacking) = (0.0, 0.0f64);
        for row in &rows {
            let (off, noise) = (row.closure() - 1.0, row.closure_noise());
            assert!(
                off.abs() <= 4.0 * noise + 2e-5,
                "{size:?} {open:?}, patch {}: {off:e} ± {noise:e}, missed {:e}",
                row.emitter,
                row.missed
            );
            assert!(
                noise < 2e-3 && row.missed <= 1e-3,
                "{size:?} {open:?}: {noise:e} {:e}",
                row.missed
            );
            assert!(row.agreement < 2.0, "{}", row.agreement);
            squares += (off / noise).powi(2);
            let met = row.values.iter().filter(|&&f| f > 3.0 / 65_536.0).sum::<f64>();
            lacking = lacking.max(row.sum() - met);
        }
        let spread = (squares / rows.len() as f64).sqrt();
        println!(
            "{size:?} {open:?}: off by {spread:.2} of the stated noise; {lacking:.4} is in patches of 3 rays or fewer"
        );
        // The test is of what it says: without the smallest patches, rows would not close.
        assert!(lacking > 2e-3, "{size:?}: {lacking}");
    }
}

/// What rows lack in pairs that no ray would have met is told, by the sums and by the missed mass.
#[test]
fn rows_that_lack_pairs_in_view_are_told_so() {
    let model = model_of(&flat_box([1.2, 1.5, 0.016], [12, 12, 12], &[]), Subdivision::None);
    let reference = Reference::new(&model, settings(1e-3)).expect("good settings");
    let emitters: Vec<_> = (0..8).map(|k| InputPatch(k * 211 + 5)).collect();
    let rows = reference.rows(&emitters, 2, &mut |_| {}).expect("patches of the scene");
    let mut estimated = estimates(&rows);
    let right = errors_against(&rows, &estimated);
    assert!(right.row_sum_error.max <= 1e-3 && right.missed_mass == 0.0, "{right:?}");
    // What fewer than one ray in 65,536 would meet.
    for row in &mut estimated {
        let kept = |place: &usize| row.values[*place] >= 1.0 / 65_536.0;
        let places: Vec<usize> = (0..row.columns.len()).filter(kept).collect();
        row.columns = places.iter().map(|&place| row.columns[place]).collect();
        row.values = places.iter().map(|&place| row.values[place]).collect();
    }
    let lacking = errors_against(&rows, &estimated);
    println!(
        "rows without small pairs: sums off by {:.5} on average, {:.5} at most; noise {:.5}",
        lacking.row_sum_error.mean, lacking.row_sum_error.max, lacking.row_sum_noise.mean
    );
    assert!(
        lacking.row_sum_error.mean > 5.0 * lacking.row_sum_noise.max && lacking.missed_mass > 1e-3,
        "{lacking:?}"
    );
}

/// Where the rays do not suffice for all patches in view, what is left is in `missed`, with an error that holds.
#[test]
fn what_the_budget_leaves_is_estimated() {
    let model = model_of(&flat_box([2.0, 2.0, 0.05], [48, 48, 4], &[]), Subdivision::None);
    let scarce = ReferenceSettings {
        max_rays: 140_000,
        ..settings(1e-3)
    };
    let reference = Reference::new(&model, scarce).expect("good settings");
    let mut most = 0.0f64;
    for k in 0..6 {
        let row = reference.row(InputPatch(k * 1_571 + 40)).expect("a patch of the scene");
        let (off, noise) = (row.closure() - 1.0, row.closure_noise());
        println!(
            "{:>5}: {off:+.1e} ± {noise:.1e}, missed {:.1e} ± {:.1e}",
            row.emitter, row.missed, row.error_of_missed
        );
        assert!(off.abs() <= 4.0 * noise, "{off:e} ± {noise:e}");
        assert!(row.rays <= 140_000 + 140_000 / 8, "{}", row.rays);
        most = most.max(row.missed);
    }
    assert!(most > 1e-3, "nothing is missed: {most:e}");
}

#[test]
fn rows_do_not_depend_on_threads_but_on_the_seed() {
    let model = model_of_scene(&generate::room(3).expect("a small room"), Subdivision::None);
    let emitters = ids(5..9);
    let reference = Reference::new(&model, settings(2e-2)).expect("good settings");
    let mut calls = 0;
    let one = reference
        .rows(&emitters, 1, &mut |_| calls += 1)
        .expect("patches of the scene");
    let two = reference.rows(&emitters, 2, &mut |_| {}).expect("patches of the scene");
    assert_eq!(calls, 4);
    assert_eq!(one, two);
    assert_eq!(one[2], reference.row(InputPatch(7)).expect("a patch of the scene"));
    let other = Reference::new(
        &model,
        ReferenceSettings {
            seed: 2,
            ..settings(2e-2)
        },
    )
    .expect("good settings");
    assert_ne!(
        one,
        other.rows(&emitters, 2, &mut |_| {}).expect("patches of the scene")
    );
}

fn estimates(rows: &[ReferenceRow]) -> Vec<EstimatedRow> {
    rows.iter()
        .map(|row| EstimatedRow {
            emitter: InputPatch(row.emitter),
            columns: row.columns.clone(),
            values: row.values.clone(),
        })
        .collect()
}

/// Two seeds differ by what their errors say: neither much more (errors too small) nor much less (too large).
#[test]
fn the_stated_noise_is_the_noise() {
    let model = model_of_scene(&generate::room(5).expect("a small room"), Subdivision::None);
    let emitters: Vec<_> = (0..12).map(|k| InputPatch(k * 83)).collect();
    let rows = |seed| {
        let settings = ReferenceSettings { seed, ..settings(5e-3) };
        let reference = Reference::new(&model, settings).expect("good settings");
        reference.rows(&emitters, 2, &mut |_| {}).expect("patches of the scene")
    };
    let (a, b) = (rows(1), rows(2));
    let found = errors_against(&a, &estimates(&b)).relative_frobenius_with_noise;
    let stated = noise_of(&a).hypot(noise_of(&b));
    println!("two seeds differ by {found:.2e}; stated {stated:.2e}");
    assert!((0.4..1.8).contains(&(found / stated)), "{found} stated {stated}");
    assert!(noise_of(&a) < 7e-3);
}

/// Of two patches in one place the smaller id is seen; the back of a one-sided patch in the same plane loses to it.
#[test]
fn coplanar_duplicates() {
    let floor = cut(quad([[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]]));
    let lid = quad([[0., 0., 1.], [0., 1., 1.], [1., 1., 1.], [1., 0., 1.]]);
    let [a, b, c, d] = lid;
    let mut triangles = cut([a, d, c, b]).to_vec();
    triangles.extend(floor);
    triangles.extend(cut(lid));
    triangles.extend(cut([b, c, d, a]));
    let model = model_of(&triangles, Subdivision::None);
    let reference = Reference::new(&model, settings(1e-3)).expect("good settings");
    for emitter in 2..4 {
        let row = reference.row(InputPatch(emitter)).expect("a patch of the scene");
        assert_eq!(
            row.columns,
            [4, 5],
            "of the lid and its double the lid, never the back before it"
        );
        assert_eq!(row.blocked, 0.0);
        let sum: f64 = row.values.iter().sum();
        assert!((sum - 0.199_824_9).abs() < 1e-3, "{sum}");
    }
}

/// A back that crosses a lid at a small angle is in no plane with it, however near the two are where they cross: half
/// of the lid is hidden, for rays over the hemisphere as for segments.
#[test]
fn surfaces_that_cross_at_a_small_angle_are_not_in_one_plane() {
    let floor = cut(quad([[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]]));
    let lid = cut(quad([[0., 0., 1.], [0., 1., 1.], [1., 1., 1.], [1., 0., 1.]]));
    let (low, high) = (1.0 - 1e-8, 1.0 + 1e-8);
    let back = cut(quad([[0., 0., low], [1., 0., high], [1., 1., high], [0., 1., low]]));
    let triangles: Vec<_> = floor.into_iter().chain(lid).chain(back).collect();
    let model = model_of(&triangles, Subdivision::None);
    let reference = Reference::new(&model, settings(1e-3)).expect("good settings");
    for emitter in 0..2 {
        let row = reference.row(InputPatch(emitter)).expect("a patch of the scene");
        let (off, noise) = (row.closure() - 1.0, row.closure_noise());
        assert!(off.abs() <= 4.0 * noise && noise < 1e-3, "{off:e} ± {noise:e}");
        assert!(row.blocked > 0.05 && row.agreement < 3.0, "{row:?}");
    }
}

#[test]
fn settings_that_mean_nothing_are_refused() {
    let model = model_of(&cube(), Subdivision::None);
    for target in [0.0, -1.0, f64::NAN, 2.0] {
        assert!(matches!(
            Reference::new(&model, settings(target)),
            Err(ReferenceError::Target { .. })
        ));
    }
    let few = ReferenceSettings {
        max_rays: 10,
        ..settings(0.1)
    };
    assert!(matches!(
        Reference::new(&model, few),
        Err(ReferenceError::TooFewRays { .. })
    ));
    let reference = Reference::new(&model, settings(0.1)).expect("good settings");
    let none = ReferenceError::NoSuchPatch { patch: 12, count: 12 };
    assert_eq!(reference.row(InputPatch(12)).expect_err("no such patch"), none);
    assert!(
        reference
            .rows(&[], 0, &mut |_| {})
            .expect("nothing asked for")
            .is_empty()
    );
}

fn shared() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared")
}

fn scenes() -> PathBuf {
    std::env::var_os("HEMICUBE_SCENES").map_or_else(|| shared().join("scenes"), PathBuf::from)
}

/// Seconds a row and own noise on real scenes:
/// `cargo test --release -p hemicube --test matrices -- reference:: --ignored --nocapture`.
#[test]
#[ignore = "a measurement, of minutes"]
fn cost_of_a_row() {
    let mut models = vec![(
        "room of 10,240".to_owned(),
        model_of_scene(&generate::room(16).expect("a room"), Subdivision::None),
    )];
    models.push((
        "block city of 142,352".to_owned(),
        model_of_scene(
            &generate::BlockCityParameters::for_target(142_352, 1)
                .generate()
                .expect("a city"),
            Subdivision::None,
        ),
    ));
    for name in ["city/denhaag-8897.obj"] {
        match load(&scenes().join(name), hemicube_scene::ReadOptions::default()) {
            Ok(scene) => models.push((name.to_owned(), model_of_scene(&scene, Subdivision::None))),
            Err(error) => println!("SKIP {name}: no ../shared/scenes ({error})"),
        }
    }
    for (name, model) in &models {
        let count = model.geometry().patch_count;
        let emitters: Vec<_> = (0..64).map(|k| InputPatch(k * (count / 64) + 7)).collect();
        let started = Instant::now();
        let reference = Reference::new(model, settings(3e-3)).expect("good settings");
        let built = started.elapsed();
        let started = Instant::now();
        let rows = reference.rows(&emitters, 1, &mut |_| {}).expect("patches of the scene");
        let seconds = started.elapsed().as_secs_f64() / rows.len() as f64;
        let rays: u64 = rows.iter().map(|row| row.rays).sum();
        println!(
            "{name}: built in {built:.2?}, {seconds:.2} s a row, {} rays a row, noise {:.2e}",
            rays / rows.len() as u64,
            noise_of(&rows)
        );
        let other = ReferenceSettings {
            seed: 2,
            ..settings(3e-3)
        };
        let other = Reference::new(model, other).expect("good settings");
        let other = other.rows(&emitters, 1, &mut |_| {}).expect("patches of the scene");
        let stated = noise_of(&rows).hypot(noise_of(&other));
        let found = errors_against(&rows, &estimates(&other));
        println!(
            "  another seed differs by {:.2e}; stated {stated:.2e}",
            found.relative_frobenius_with_noise
        );
        for row in &rows {
            let ReferenceRow { emitter, rays, .. } = row;
            println!(
                "  {emitter:>6}: {:>5} patches, norm {:.4}, noise {:.1e}, closure {:+.1e}, missed {:.1e}, blocked {:.3}, agreement {:.2} over {}, {rays} rays",
                row.columns.len(),
                row.squared_norm().sqrt(),
                row.noise(),
                row.closure() - 1.0,
                row.missed,
                row.blocked,
                row.agreement,
                row.agreement_count,
            );
        }
    }
}

/// Thousands of triangles in one place: each ray to them is held against all. Rows end after fewer rays, and say so.
#[test]
fn rows_that_see_thousands_of_triangles_in_one_place_end() {
    let p = DVec3::new;
    let mut triangles = cut(quad([[0., 0., 0.], [4., 0., 0.], [4., 4., 0.], [0., 4., 0.]])).to_vec();
    for k in 0..4000 {
        let turned = |x: f64| {
            let angle = x + f64::from(k) * 0.001_7;
            p(2.0 + angle.cos(), 2.0 + angle.sin(), 1.0)
        };
        triangles.push([turned(0.0), turned(4.2), turned(2.1)]);
    }
    let model = model_of(&triangles, Subdivision::None);
    let bounded = ReferenceSettings {
        max_rays: 1_000_000,
        ..settings(3e-4)
    };
    let reference = Reference::new(&model, bounded).expect("good settings");
    let row = reference.row(InputPatch(0)).expect("a row");
    assert!(row.cut_short && row.rays < bounded.max_rays / 4, "{} rays", row.rays);
    assert!(row.noise() > 3e-4, "{}", row.noise());
    // Of two triangles in sight, a row has all that it needs.
    let plain = model_of(&triangles[..3], Subdivision::None);
    let row = Reference::new(&plain, settings(3e-3))
        .expect("good settings")
        .row(InputPatch(0))
        .expect("a row");
    assert!(!row.cut_short && row.noise() < 4e-3, "{}", row.noise());
}
