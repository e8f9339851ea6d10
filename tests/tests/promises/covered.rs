//! Covered weights and tiny patches: a patch's covered weight is, to the bit, what it shows where nothing else is; and
//! a patch that covers no pixel's centre is reported where a ray to its centroid meets it first.

use hemicube::Model;
use hemicube::backend::{Geometry, HemicubeBackend, RenderSettings};
use hemicube::row::RowBlock;
use hemicube_backend_cpu::{CpuBackend, EngineChoice, Isa};
use hemicube_scene::InputPatch;
use hemicube_scene::generate::Kind;
use hemicube_tests::rays::RayScene;
use hemicube_tests::rows::{hemicubes, render_with, rolled, settings, spread};
use hemicube_tests::scenes::{generated, say};
use std::sync::Arc;

/// The geometry of one patch's surface alone, with the whole scene's ids.
fn alone(model: &Model, patch: u32) -> Arc<Geometry> {
    let geometry = model.geometry();
    let is_own = |id: InputPatch| id.0 == patch;
    let surfaces = geometry
        .surfaces
        .iter()
        .filter(|s| is_own(s.front) || s.back.is_some_and(is_own));
    Arc::new(Geometry::new(
        surfaces.copied().collect(),
        geometry.octree.clone(),
        geometry.patch_count,
        geometry.plane_tolerance,
    ))
}

fn holds(name: &str, model: &Model, engine: EngineChoice) -> usize {
    let resolution = 48;
    let settings = RenderSettings {
        covered: true,
        ..settings(resolution)
    };
    let hemicubes: Vec<_> = hemicubes(model, &spread(model, 10))
        .into_iter()
        .map(|hemicube| rolled(hemicube, 0.7))
        .collect();
    let rays = RayScene::new(model.geometry());
    let isas = Isa::available();
    let mut backends: Vec<CpuBackend> = isas
        .iter()
        .map(|&isa| CpuBackend::with_isa(isa).expect("it is available").with_engine(engine))
        .collect();
    let rows: Vec<RowBlock> = backends
        .iter_mut()
        .map(|backend| render_with(backend, model, &hemicubes, settings).0)
        .collect();
    assert!(rows.iter().all(|r| *r == rows[0]), "{name}: instruction sets differ");
    let rows = &rows[0];

    let mut lone = CpuBackend::new();
    let mut shows = |hemicube, patch: u32| {
        lone.load(
            &alone(model, patch),
            RenderSettings {
                covered: false,
                ..settings
            },
        )
        .expect("legal settings");
        let mut row = RowBlock::default();
        lone.rows(&[hemicube], &mut row).expect("a legal hemicube");
        row.row(0).patches.first().map(|_| row.visible[0])
    };
    let (mut partly, mut tiny, mut false_tiny, mut missed) = (0, 0, 0, 0);
    for (k, &hemicube) in hemicubes.iter().enumerate() {
        let row = rows.row(k);
        for (entry, &patch) in row.patches.iter().enumerate() {
            let (visible, covered) = (row.visible[entry], row.covered[entry]);
            let lone = shows(hemicube, patch);
            assert_eq!(covered, lone.unwrap_or(0), "{name}: patch {patch}, {hemicube:?}");
            partly += usize::from(covered > visible);
            if visible == 0 && lone.is_none() {
                tiny += 1;
                let to_it = model.normalise(model.patches().centroid(InputPatch(patch))) - hemicube.origin;
                false_tiny += usize::from(rays.cast(&hemicube, to_it).is_none_or(|hit| hit.seen != patch));
            }
        }
        // Whatever a ray to its centroid meets, and is not in the row, must cover some pixel's centre.
        for patch in model
            .patches()
            .iter()
            .filter(|p| row.patches.binary_search(&p.0).is_err())
        {
            let to_it = model.normalise(model.patches().centroid(patch)) - hemicube.origin;
            let above = to_it.dot(hemicube.axes[2]) > 1e-6;
            if above && rays.cast(&hemicube, to_it).is_some_and(|hit| hit.seen == patch.0) {
                missed += usize::from(shows(hemicube, patch.0).is_none());
            }
        }
    }
    say(&format!(
        "covered, {name}, {engine:?}: {} entries, {partly} partly hidden, {tiny} tiny, of which {false_tiny} are hidden at their \
         centroids; {missed} tiny patches missed",
        rows.patches.len()
    ));
    assert!(partly > 50 && tiny > 50, "{name}: nothing was tested");
    // Where the patch seen at the nearest pixel's centre reaches the centroid, its depth there decides. Elsewhere being
    // about as near as the pixel does: in a soup of crossing triangles that lets some through that are hidden (the
    // price of finding those behind silhouettes, of which 501 of 835 were once missed on the spheres); near the
    // horizon, where depth changes fast, patches on the ground are missed, up to twice as many as are found. In order,
    // what is nearer at the pixel's centre hides them, which misses some more; and those of one block are let through
    // together, which in a soup, whose blocks hold what crosses each other, lets more through.
    let let_through = if engine == EngineChoice::Order { 3 } else { 4 };
    assert!(false_tiny * let_through <= tiny, "{name}: {false_tiny} of {tiny}");
    if engine == EngineChoice::Depth {
        assert!(missed <= 2 * tiny, "{name}: {missed} beside {tiny}");
    }
    missed
}

/// Both engines find tiny patches, and engine `order` misses at most half as many again as engine `depth`; in a soup,
/// which it is not for, at most twice as many.
fn both_hold(name: &str, model: &Model) {
    let [depth, order] = [EngineChoice::Depth, EngineChoice::Order].map(|engine| holds(name, model, engine));
    let most = if name == "soup" { 2 * depth } else { 3 * depth / 2 };
    assert!(order <= most + 10, "{name}: {order} where {depth} are missed by depth");
}

#[test]
fn city() {
    both_hold("city", &generated(Kind::City, 4_000));
}

#[test]
fn spheres() {
    // On curved surfaces, which do not get it, engine `order` misses patches that a neighbour covers at the pixel's
    // centre: 250 where engine `depth`, which compares depths, misses 10.
    holds("spheres", &generated(Kind::Spheres, 4_000), EngineChoice::Depth);
}

#[test]
#[ignore = "half a minute of processor time and more: ./test --full"]
fn soup() {
    both_hold("soup", &generated(Kind::Soup, 3_000));
}
