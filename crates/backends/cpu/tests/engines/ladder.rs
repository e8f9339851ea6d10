//! The rungs of the accuracy ladder on a closed cube, whose face-to-face factors are known in closed form.

use hemicube::accuracy::correct::{Correction, Refinement};
use hemicube::backend::{Culling, RenderSettings};
use hemicube::driver::compute::{Execution, Plan, RowChoice, Selection, compute};
use hemicube::factor::{Exchanges, FactorRule};
use hemicube::reference::{EstimatedRow, Reference, ReferenceSettings, errors_against};
use hemicube::store::Part;
use hemicube::{HierarchyOptions, InputPatch, Model};
use hemicube_backend_cpu::CpuBackend;
use hemicube_scene::generate::{BlockCityParameters, Generate, Kind, cornell_box, generate};
use hemicube_scene::{Patches, Scene, Subdivision, Triangle};
use hemicube_spatial::glam::DVec3;

/// A unit cube seen from inside; faces 2k and 2k + 1 are opposite.
fn cube() -> Scene {
    let mut scene = Scene {
        objects: vec!["cube".to_owned()],
        materials: vec![Default::default()],
        ..Scene::default()
    };
    for axis in 0..3 {
        for side in [0.0, 1.0] {
            let at = |u: f64, v: f64| {
                let mut p = [0.0; 3];
                p[axis] = side;
                p[(axis + 1) % 3] = u;
                p[(axis + 2) % 3] = v;
                p.into()
            };
            let (a, b, c, d) = (at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0), at(0.0, 1.0));
            let quad = if side == 0.0 {
                [[a, b, c], [a, c, d]]
            } else {
                [[a, c, b], [a, d, c]]
            };
            let face = u32::try_from(scene.triangles.len() / 2).expect("six faces");
            scene.triangles.extend(quad.map(|corners| Triangle {
                corners,
                object: 0,
                material: 0,
                face,
                two_sided: false,
            }));
        }
    }
    scene
}

/// The 6 × 6 face-to-face factors, and the largest deviation of a row's sum from 1.
fn face_factors(correction: Correction, resolution: u32, samples_per_edge: u32) -> ([[f64; 6]; 6], f64) {
    let scene = cube();
    let patches = Patches::new(&scene, Subdivision::Levels(2)).expect("patches");
    let model = Model::new(patches.into(), HierarchyOptions::default()).expect("a model");
    let plan =
        Plan::new(&model, RowChoice::All, Selection::default(), samples_per_edge, true).with_correction(correction);
    let mut parts: Vec<Part> = Vec::new();
    compute(
        &model,
        &plan,
        RenderSettings {
            resolution,
            culling: Culling::On,
            covered: false,
        },
        Box::new(CpuBackend::new()),
        Execution::default(),
        &mut parts,
        &mut |_| {},
    )
    .expect("rows");
    let face = |p: u32| scene.triangles[model.patches().triangle(InputPatch(p))].face as usize;
    let (mut factors, mut worst) = ([[0.0; 6]; 6], 0.0f64);
    for part in &parts {
        for (row, &i) in part.rows.iter().enumerate() {
            let (columns, data) = part.row(row);
            let mut sum = 0.0;
            for (&j, f) in columns.iter().zip(data) {
                factors[face(i)][face(j.cast_unsigned())] += f * model.patches().area(InputPatch(i));
                sum += f;
            }
            worst = worst.max((sum - 1.0).abs());
        }
    }
    (factors, worst)
}

/// The largest error of the face-to-face factors.
fn error(factors: &[[f64; 6]; 6]) -> f64 {
    let mut worst = 0.0f64;
    for (i, row) in factors.iter().enumerate() {
        for (j, &f) in row.iter().enumerate() {
            let exact = match (i, j) {
                (i, j) if i == j => 0.0,
                (i, j) if i / 2 == j / 2 => 0.199_824_895_698_387,
                _ => 0.200_043_776_075_403,
            };
            worst = worst.max((f - exact).abs());
        }
    }
    worst
}

#[test]
fn a_tolerance_is_right_where_pixels_are_not() {
    let (pixel, pixel_closure) = face_factors(Correction::Pixel, 256, 1);
    let within = Correction::Tolerance(Refinement::for_tolerance(2e-4));
    let (area, area_closure) = face_factors(within, 128, 1);
    let (pixel, area) = (error(&pixel), error(&area));
    assert!(
        pixel_closure < 1e-6,
        "pixel rows sum to 1 whatever they are worth: {pixel_closure:e}"
    );
    assert!(area < 2e-5, "within: {area:e}");
    assert!(area_closure < 1e-4, "area rows: {area_closure:e}");
    assert!(pixel > 50.0 * area, "a centre is not an area: {pixel:e} {area:e}");
}

#[test]
fn more_hemicubes_help_sums_of_pixels() {
    let (one, _) = face_factors(Correction::Pixel, 128, 1);
    let (four, _) = face_factors(Correction::Pixel, 128, 2);
    assert!(error(&four) < 0.7 * error(&one));
}

/// A floor, a block on it that hides the middle of it, and a wall along one side: what sees the wall is what reaches
/// out from under the block.
fn under_a_block() -> Scene {
    let at = |x: f64, y: f64, z: f64| DVec3::new(x, y, z);
    let quad = |a, b, c, d| [[a, b, c], [a, c, d]];
    let (low, high) = (0.5, 3.5);
    let [a, b, c, d] = [(low, low), (high, low), (high, high), (low, high)].map(|(x, y)| at(x, y, 0.0));
    let up = DVec3::Z;
    let quads = [
        quad(
            at(0.0, 0.0, 0.0),
            at(4.0, 0.0, 0.0),
            at(4.0, 4.0, 0.0),
            at(0.0, 4.0, 0.0),
        ),
        quad(
            at(4.0, 0.0, 0.0),
            at(4.0, 0.0, 2.0),
            at(4.0, 4.0, 2.0),
            at(4.0, 4.0, 0.0),
        ),
        quad(a, b, b + up, a + up),
        quad(b, c, c + up, b + up),
        quad(c, d, d + up, c + up),
        quad(d, a, a + up, d + up),
        quad(a + up, b + up, c + up, d + up),
    ];
    let triangle = |corners| Triangle {
        corners,
        object: 0,
        material: 0,
        face: 0,
        two_sided: false,
    };
    Scene {
        objects: vec!["yard".to_owned()],
        materials: vec![Default::default()],
        triangles: quads.into_iter().flatten().map(triangle).collect(),
        ..Scene::default()
    }
}

#[test]
fn a_floor_whose_middle_is_under_a_block_sees_what_its_border_sees() {
    let patches = Patches::new(&under_a_block(), Subdivision::None).expect("patches");
    let model = Model::new(patches.into(), HierarchyOptions::default()).expect("a model");
    let floor = RowChoice::Range { start: 0, end: 2 };
    let plan = Plan::new(&model, floor, Selection::default(), 1, true);
    let reference = Reference::new(&model, ReferenceSettings::default()).expect("a reference");
    let exact = reference.rows(&plan.rows, 2, &mut |_| {}).expect("rows");
    let rows = |correction| {
        let settings = RenderSettings {
            resolution: 128,
            culling: Culling::On,
            covered: false,
        };
        let mut parts: Vec<Part> = Vec::new();
        let (backend, execution) = (Box::new(CpuBackend::new()), Execution::default());
        let plan = plan.clone().with_correction(correction);
        compute(&model, &plan, settings, backend, execution, &mut parts, &mut |_| {}).expect("rows");
        let estimated: Vec<_> = parts.iter().flat_map(EstimatedRow::of_part).collect();
        errors_against(&exact, &estimated).relative_frobenius
    };
    let pixel = rows(Correction::Pixel);
    let within = rows(Correction::Tolerance(Refinement::for_tolerance(0.02)));
    assert!(pixel > 0.99, "the middle sees nothing: {pixel}");
    assert!(within < 0.05, "{within}");
}

#[test]
fn a_tolerance_brings_a_city_nearer_to_the_reference() {
    let city = BlockCityParameters {
        blocks: 5,
        split: 1,
        ..BlockCityParameters::for_target(1000, 1)
    };
    let patches = Patches::new(&city.generate().expect("a city"), Subdivision::None).expect("patches");
    let model = Model::new(patches.into(), HierarchyOptions::default()).expect("a model");
    let plan = Plan::new(
        &model,
        RowChoice::Sample { count: 24, seed: 3 },
        Selection::default(),
        1,
        true,
    );
    let reference = Reference::new(&model, ReferenceSettings::default()).expect("a reference");
    let exact = reference.rows(&plan.rows, 2, &mut |_| {}).expect("rows");
    let error = |correction| {
        let plan = plan.clone().with_correction(correction);
        let settings = RenderSettings {
            resolution: 128,
            culling: Culling::On,
            covered: false,
        };
        let mut parts: Vec<Part> = Vec::new();
        let backend = Box::new(CpuBackend::new());
        compute(
            &model,
            &plan,
            settings,
            backend,
            Execution::default(),
            &mut parts,
            &mut |_| {},
        )
        .expect("rows");
        let estimated: Vec<_> = parts.iter().flat_map(EstimatedRow::of_part).collect();
        errors_against(&exact, &estimated).relative_frobenius
    };
    let [coarse, middle, fine] =
        [2e-2, 5e-3, 1e-3].map(|tolerance| error(Correction::Tolerance(Refinement::for_tolerance(tolerance))));
    assert!(middle < 0.6 * coarse, "{middle} {coarse}");
    assert!(fine < 0.6 * middle, "{fine} {middle}");
}

/// √(Σ (F − exact F)² / Σ exact F²) of a rule for closed forms over sampled rows of a scene, all with the same
/// visibility.
fn error_of_rule(scene: &Scene, subdivision: Subdivision, tolerance: f64) -> f64 {
    let patches = Patches::new(scene, subdivision).expect("patches");
    let model = Model::new(patches.into(), HierarchyOptions::default()).expect("a model");
    let choice = RowChoice::Sample { count: 64, seed: 5 };
    let exact = FactorRule::for_tolerance(1e-4);
    let plan =
        Plan::new(&model, choice, Selection::default(), 1, true).with_correction(Correction::Tolerance(Refinement {
            rule: exact,
            ..Refinement::for_tolerance(0.1)
        }));
    let settings = RenderSettings {
        resolution: 64,
        culling: Culling::On,
        covered: false,
    };
    let mut parts: Vec<Part> = Vec::new();
    let (backend, execution) = (Box::new(CpuBackend::new()), Execution::default());
    compute(&model, &plan, settings, backend, execution, &mut parts, &mut |_| {}).expect("rows");
    let corners = |patch: InputPatch| model.patches().corners(patch).map(|corner| model.normalise(corner));
    let (mut squared, mut norm) = (0.0, 0.0);
    for row in parts.iter().flat_map(EstimatedRow::of_part) {
        let own = corners(row.emitter);
        let open = |rule: FactorRule| {
            let mut exchanges = Exchanges::new(rule);
            let mut out = vec![0.0; row.columns.len()];
            exchanges.begin(&own);
            for (place, &column) in row.columns.iter().enumerate() {
                exchanges.add(place, &corners(InputPatch(column)), &mut out);
            }
            exchanges.finish(&mut out);
            out
        };
        let (found, exact) = (open(FactorRule::for_tolerance(tolerance)), open(exact));
        for ((f, e), value) in found.iter().zip(exact).zip(&row.values) {
            squared += (value * (f / e - 1.0)).powi(2);
            norm += value * value;
        }
    }
    (squared / norm).sqrt()
}

#[test]
fn the_first_rung_s_closed_form_is_much_better_than_its_visibility() {
    let city = BlockCityParameters {
        blocks: 25,
        split: 2,
        ..BlockCityParameters::for_target(1000, 1)
    };
    let spheres = Generate {
        kind: Kind::Spheres,
        target_patches: 4000,
        seed: 1,
    };
    for (name, scene, subdivision) in [
        ("room", cornell_box(), Subdivision::Levels(3)),
        ("city", city.generate().expect("a city"), Subdivision::None),
        ("spheres", generate(spheres).expect("spheres"), Subdivision::None),
    ] {
        let (coarse, middle) = (
            error_of_rule(&scene, subdivision, 1e-2),
            error_of_rule(&scene, subdivision, 1e-3),
        );
        assert!(coarse < 6e-4, "{name}: {coarse:e}");
        assert!(middle < 4e-5, "{name}: {middle:e}");
    }
}
