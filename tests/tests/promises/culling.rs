//! Culling is lossless, and it culls: rows with culling on and off are the same bits, with and without covered weights,
//! and the counters show that hidden subtrees were left alone.

use hemicube::Model;
use hemicube::backend::{Counters, Culling, Geometry, HemicubeBackend, RenderSettings};
use hemicube::row::RowBlock;
use hemicube_backend_cpu::CpuBackend;
use hemicube_scene::Subdivision;
use hemicube_scene::generate::{self, Kind};
use hemicube_tests::rows::{culled, hemicubes, render, spread};
use hemicube_tests::scenes::{generated, model, read, say, scenes_or_skip};

const ROWS: usize = 40;

/// Rows of a scene are the same bits with culling on and off. Returns what was counted with culling on, at N = 64 and
/// 256, without covered weights.
fn lossless(name: &str, model: &Model) -> [Counters; 2] {
    let hemicubes = hemicubes(model, &spread(model, ROWS));
    [64, 256].map(|resolution| {
        let mut counted = Counters::default();
        for covered in [true, false] {
            let [on, off] = [Culling::On, Culling::Off].map(|culling| {
                render(
                    model,
                    &hemicubes,
                    RenderSettings {
                        resolution,
                        culling,
                        covered,
                    },
                )
            });
            for (k, hemicube) in hemicubes.iter().enumerate() {
                assert_eq!(
                    on.0.row(k),
                    off.0.row(k),
                    "{name}, N = {resolution}, covered {covered}, {hemicube:?}"
                );
            }
            assert!(off.1.nodes_hidden == 0, "{name}: culling is off");
            counted = on.1;
        }
        counted
    })
}

/// [`lossless`], and at most `share` of the surfaces were transformed.
fn holds(name: &str, model: &Model, share: f64) {
    let surfaces = model.geometry().surfaces.len();
    let found = lossless(name, model).map(|counters| {
        culled(&counters, surfaces, share).unwrap_or_else(|why| panic!("{name}, {surfaces} surfaces: {why}"))
    });
    say(&format!(
        "culling, {name}: of {surfaces} surfaces {:.1} % transformed at N = 64, {:.1} % at 256",
        100.0 * found[0],
        100.0 * found[1]
    ));
}

#[test]
fn generated_scenes() {
    for (kind, count, share) in [
        (Kind::City, 20_000, 0.2),
        (Kind::BlockCity, 9_000, 0.3),
        (Kind::BlockCity, 100_000, 0.2),
        (Kind::Maze, 10_000, 0.2),
        (Kind::Soup, 10_000, 0.9),
    ] {
        holds(kind.name(), &generated(kind, count), share);
    }
}

#[test]
fn scenes_with_little_to_cull() {
    lossless(
        "Cornell box ×256",
        &model(generate::cornell_box(), Subdivision::Levels(4)),
    );
    lossless(
        "open Cornell box ×64",
        &model(generate::cornell_box_open(), Subdivision::Levels(3)),
    );
    for kind in [Kind::Spheres, Kind::Field] {
        lossless(kind.name(), &generated(kind, 5_000));
    }
}

#[test]
fn two_sided_scenes() {
    let spec = generate::Generate {
        kind: Kind::Soup,
        target_patches: 5_000,
        seed: 5,
    };
    let mut scene = generate::generate(spec).expect("a target in range");
    for triangle in scene.triangles.iter_mut().step_by(3) {
        triangle.two_sided = true;
    }
    lossless("two-sided soup", &model(scene, Subdivision::None));
}

#[test]
fn real_cities() {
    let Some(folder) = scenes_or_skip("culling::real_cities") else {
        return;
    };
    for (file, levels, share) in [
        ("city/denhaag-8897.obj", 0, 0.3),
        ("city/denhaag-8897.obj", 2, 0.2),
        ("city/denhaag.obj", 1, 0.2),
        ("city/rotterdam-delfshaven.obj", 1, 0.2),
        ("city/3dfier-testarea.obj", 1, 0.3),
        ("city/zurich-lv95-rawcoords.obj", 1, 0.9),
    ] {
        let scene = read(&folder, file).unwrap_or_else(|error| panic!("{error}"));
        let model = model(scene, Subdivision::Levels(levels));
        holds(&format!("{file} ×{}", 4u32.pow(levels)), &model, share);
    }
}

#[test]
fn a_backend_that_never_culls_would_be_noticed() {
    let model = generated(Kind::BlockCity, 9_000);
    let surfaces = model.geometry().surfaces.len();
    let hemicubes = hemicubes(&model, &spread(&model, ROWS));
    let settings = |culling| RenderSettings {
        resolution: 64,
        culling,
        covered: false,
    };
    let (on, counted) = render(&model, &hemicubes, settings(Culling::On));
    let (_, never) = render(&model, &hemicubes, settings(Culling::Off));
    assert!(culled(&counted, surfaces, 0.3).is_ok());
    assert!(culled(&never, surfaces, 1.1).is_err(), "no culling passed for culling");
    assert!(
        culled(
            &Counters {
                nodes_hidden: 0,
                ..counted
            },
            surfaces,
            0.3
        )
        .is_err(),
        "frustum culling alone passed"
    );
    assert!(
        culled(&counted, surfaces / 100, 0.3).is_err(),
        "most of the scene transformed passed"
    );

    // A culling that drops something seen: here the surface that shows most.
    let place = (0..hemicubes.len())
        .find(|&k| !on.row(k).patches.is_empty())
        .expect("some row sees something");
    let row = on.row(place);
    let most = (0..row.patches.len())
        .max_by_key(|&k| row.visible[k])
        .expect("something is seen");
    let whole = model.geometry();
    let mut surfaces = whole.surfaces.clone();
    surfaces
        .iter_mut()
        .filter(|s| s.front.0 == row.patches[most])
        .for_each(|s| s.corners = [s.corners[0]; 3]);
    let geometry = Geometry::new(surfaces, whole.octree.clone(), whole.patch_count, whole.plane_tolerance);
    let mut lossy = CpuBackend::new();
    let mut rows = RowBlock::default();
    lossy
        .load(&geometry.into(), settings(Culling::On))
        .expect("legal settings");
    lossy.rows(&hemicubes, &mut rows).expect("legal hemicubes");
    assert_ne!(rows.row(place), row, "a lost surface was not noticed");
}
