//! The upload is the scene: every surface is drawn, once, with its patches on its sides, in a chunk with a box around
//! it.

use glam::DVec3;
use hemicube::{HierarchyOptions, Model};
use hemicube_contract::backend::{Culling, RenderSettings, Surface};
use hemicube_scene::generate::{BlockCityParameters, Generate, Kind, generate};
use hemicube_scene::{InputPatch, Patches, Scene, Subdivision, Triangle};
use hemicube_shaders::chunks::{OF_A_RUN, runs_of_chunks};
use hemicube_shaders::limits::TILES_ASK;
use hemicube_shaders::view::near;
use hemicube_shaders::{Draw, Edges, Limits, OfStage, Plan, Upload};
use std::collections::{BTreeMap, BTreeSet};

fn model(scene: &Scene) -> Model {
    let patches = Patches::new(scene, Subdivision::None).expect("a scene that fits");
    Model::new(patches.into(), HierarchyOptions::default()).expect("a scene with an extent")
}

fn made(kind: Kind) -> Model {
    let spec = Generate {
        kind,
        target_patches: 3000,
        seed: 1,
    };
    model(&generate(spec).expect("a target in range"))
}

fn with_duplicates() -> Model {
    let city = BlockCityParameters {
        blocks: 6,
        ..Default::default()
    };
    let mut scene = city.generate().expect("a small city");
    let again: Vec<_> = scene.triangles.iter().step_by(3).copied().collect();
    for (k, mut triangle) in again.into_iter().enumerate() {
        let [a, b, c] = triangle.corners;
        triangle.corners = if k % 2 == 0 { [b, c, a] } else { [b, a, c] };
        scene.triangles.push(triangle);
    }
    model(&scene)
}

fn point(words: &[u32]) -> DVec3 {
    let at = |k: usize| f64::from(f32::from_bits(words[k])) + f64::from(f32::from_bits(words[k + 3]));
    DVec3::new(at(0), at(1), at(2))
}

fn corners(upload: &Upload, triangle: u32) -> [DVec3; 3] {
    let first = 3 * triangle as usize;
    [0, 1, 2].map(|k| point(&upload.vertices[upload.indices[first + k] as usize]))
}

/// Returns whether two triangles are the same up to a turn of the corners (1), turned over (−1) or different (0).
fn same(a: [DVec3; 3], b: [DVec3; 3]) -> i32 {
    let near = |p: DVec3, q: DVec3| (p - q).length() < 1e-13;
    let turned = |b: [DVec3; 3]| (0..3).any(|t| (0..3).all(|k| near(a[k], b[(k + t) % 3])));
    i32::from(turned(b)) - i32::from(turned([b[0], b[2], b[1]]))
}

#[test]
fn every_surface_is_drawn_with_its_patches() {
    for model in [made(Kind::Room), made(Kind::Soup), made(Kind::City), with_duplicates()] {
        let geometry = model.geometry();
        let upload = Upload::new(geometry).expect("it fits");
        assert_eq!(upload.triangle_count() + upload.merged, geometry.surfaces.len());
        let vertices = upload.vertices.len();
        assert!(vertices <= 3 * upload.triangle_count() && vertices >= upload.triangle_count());
        for Surface {
            corners: own,
            front,
            back,
        } in &geometry.surfaces
        {
            for (patch, side) in [(Some(*front), 1), (*back, -1)] {
                let Some(patch) = patch else { continue };
                let triangle = upload.triangle_of_patch[patch.0 as usize];
                let turn = same(*own, corners(&upload, triangle));
                assert_ne!(turn, 0, "patch {patch:?}");
                // The smallest patch on a side is seen.
                let vertex = &upload.vertices[upload.indices[3 * triangle as usize] as usize];
                let seen = if turn * side == 1 { vertex[6] } else { vertex[7] };
                assert!(seen <= patch.0);
                if upload.merged == 0 {
                    assert_eq!(seen, patch.0);
                }
                let chunk = &upload.chunks[upload.chunk_of_patch[patch.0 as usize] as usize];
                let range = chunk.first_index..chunk.first_index + chunk.index_count;
                assert!(range.contains(&(3 * triangle)));
            }
        }
    }
}

#[test]
fn a_mesh_takes_about_one_vertex_a_triangle() {
    let upload = Upload::new(made(Kind::Room).geometry()).expect("it fits");
    assert!(upload.vertices.len() * 5 < upload.triangle_count() * 6);
}

#[test]
fn duplicates_are_merged_whatever_their_corners_order() {
    let upload = Upload::new(with_duplicates().geometry()).expect("it fits");
    assert_eq!(upload.merged, 6 * 6 * 14 / 3);
}

#[test]
fn chunks_hold_their_triangles_and_are_all_there_is() {
    for model in [made(Kind::Room), made(Kind::Soup), made(Kind::City)] {
        for most in [16, 256] {
            let upload = Upload::with_chunks_of(model.geometry(), most).expect("it fits");
            let mut next = 0;
            for chunk in &upload.chunks {
                assert_eq!(chunk.first_index, next);
                next += chunk.index_count;
                assert!((3..=3 * most).contains(&chunk.index_count));
                let words = chunk.words();
                let center = DVec3::new(0.0, 1.0, 2.0).to_array().map(|k| {
                    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 2")]
                    let k = k as usize;
                    f64::from(f32::from_bits(words[k])) + f64::from(f32::from_bits(words[k + 4]))
                });
                for index in chunk.first_index / 3..(chunk.first_index + chunk.index_count) / 3 {
                    for corner in corners(&upload, index) {
                        for k in 0..3 {
                            let half = f64::from(f32::from_bits(words[8 + k]));
                            assert!((corner[k] - center[k]).abs() <= half, "outside of its chunk's box");
                        }
                    }
                }
            }
            assert_eq!(next as usize, upload.indices.len());
        }
    }
}

#[test]
fn runs_hold_every_chunk_once_and_as_many_as_tiles_look_through() {
    let upload = Upload::with_chunks_of(made(Kind::City).geometry(), 16).expect("it fits");
    let runs = runs_of_chunks(&upload.chunks);
    assert!(runs.len() > 2, "{} runs", runs.len());
    let mut next = 0;
    for run in &runs {
        assert_eq!(run.first_index, next);
        assert!((1..=OF_A_RUN).contains(&(run.index_count as usize)));
        next += run.index_count;
        for chunk in &upload.chunks[run.first_index as usize..next as usize] {
            let off = (chunk.center - run.center).abs() + chunk.half_sides;
            assert!(off.cmple(run.half_sides + 1e-12).all(), "outside of its run's box");
        }
    }
    assert_eq!(next as usize, upload.chunks.len());
    let shader = include_str!("../../wgsl/tiles.wgsl");
    assert!(shader.contains(&format!("const OF_A_RUN: u32 = {OF_A_RUN}u;")));
}

#[test]
fn centroids_are_those_of_the_triangles() {
    for model in [made(Kind::Room), with_duplicates()] {
        let upload = Upload::new(model.geometry()).expect("it fits");
        let words = upload.centroids(model.geometry());
        for (triangle, words) in (0..).zip(words.chunks_exact(6)) {
            let middle = corners(&upload, triangle).iter().sum::<DVec3>() / 3.0;
            assert!((point(words) - middle).length() < 1e-13, "triangle {triangle}");
        }
    }
}

#[test]
fn what_does_not_fit_is_refused_and_named() {
    let model = made(Kind::City);
    let mut upload = Upload::new(model.geometry()).expect("it fits");
    let settings = RenderSettings {
        resolution: 256,
        culling: Culling::On,
        covered: true,
    };
    let limits = Limits {
        storage_range: 128 << 20,
        memory: 1 << 30,
        layers: 2048,
        image_edge: 16384,
        group: 4,
        batch: 32,
        tile_groups: 16,
        tiles_each: u32::MAX,
        copies_depths: true,
        edges: Edges::Driver,
        draw: Draw::Raster,
    };
    let plan = Plan::new(&upload, settings, limits).expect("plenty");
    assert_eq!((plan.group, plan.batch), (4, 32));
    let less = Plan::new(
        &upload,
        settings,
        Limits {
            memory: 8 << 20,
            ..limits
        },
    )
    .expect("less at once");
    assert!(less.batch < plan.batch && less.bytes(&upload) <= 8 << 20);
    let refused = |limits| {
        Plan::new(&upload, settings, limits)
            .expect_err("too little")
            .to_string()
    };
    assert!(
        refused(Limits {
            memory: 1 << 20,
            ..limits
        })
        .contains("out of memory")
    );
    assert!(
        refused(Limits {
            storage_range: 4096,
            ..limits
        })
        .contains("4096")
    );
    assert!(
        refused(Limits {
            image_edge: 512,
            ..limits
        })
        .contains("768 rows")
    );
    // Backs need their own ids with exact edges.
    let exact = Limits {
        edges: Edges::Exact,
        ..limits
    };
    assert!(Plan::new(&upload, settings, exact).expect("plenty").bytes(&upload) > plan.bytes(&upload));
    // Tiles need no lists of pixels, but depths in a buffer.
    let tiles = Limits {
        draw: Draw::Compute,
        ..exact
    };
    // A submission ends soon, at any resolution.
    for resolution in [128, 256, 1024] {
        let many = Limits {
            group: 128,
            batch: 128,
            memory: 1 << 40,
            storage_range: 1 << 40,
            ..tiles
        };
        let plan = Plan::new(&upload, RenderSettings { resolution, ..settings }, many).expect("plenty");
        assert_eq!(
            (plan.batch, plan.batch * plan.tiles()),
            (plan.group, 12_288),
            "{resolution}"
        );
    }
    let tiles = Plan::new(&upload, settings, tiles).expect("plenty").bytes(&upload);
    assert!(tiles < Plan::new(&upload, settings, exact).expect("plenty").bytes(&upload));
    upload.patch_count = u32::MAX / 2;
    let refused = Plan::new(&upload, settings, exact)
        .expect_err("too many ids")
        .to_string();
    assert!(refused.contains("edges=exact"), "{refused}");
}

/// Around each side is a ring of all triangles that have one between the same corners.
#[test]
fn sides_lead_around_to_every_triangle_beside() {
    for kind in [Kind::Room, Kind::Spheres, Kind::BlockCity] {
        let upload = Upload::new(made(kind).geometry()).expect("few triangles");
        let sides = upload.sides();
        assert_eq!(sides.len(), upload.indices.len());
        let ends = |side: u32| {
            let corners = corners(&upload, side / 3).map(|p| (p + DVec3::ZERO).to_array().map(f64::to_bits));
            let (a, b) = (corners[side as usize % 3], corners[(side as usize + 1) % 3]);
            [a.min(b), a.max(b)]
        };
        let mut by_ends: BTreeMap<[[u64; 3]; 2], BTreeSet<u32>> = BTreeMap::new();
        let all = 0..u32::try_from(sides.len()).expect("few");
        for side in all.clone() {
            by_ends.entry(ends(side)).or_default().insert(side);
        }
        for side in all {
            let mut ring = BTreeSet::from([side]);
            let mut next = sides[side as usize];
            while next != side {
                assert!(ring.insert(next), "side {side} is in its own ring");
                next = sides[next as usize];
            }
            assert_eq!(ring, by_ends[&ends(side)], "side {side}");
        }
        assert!(by_ends.values().any(|ring| ring.len() == 2), "triangles share sides");
    }
}

#[test]
fn a_device_that_cannot_draw_by_compute_is_told_from_one_that_can() {
    assert!(Draw::Compute.check("a device", TILES_ASK).is_ok());
    let less = OfStage {
        shared_bytes: TILES_ASK.shared_bytes - 1,
        ..TILES_ASK
    };
    let refused = Draw::Compute
        .check("a small device", less)
        .expect_err("too little")
        .to_string();
    for word in ["draw=compute", "16384 bytes", "a small device", "16383", "draw=raster"] {
        assert!(refused.contains(word), "{refused}");
    }
    assert!(Draw::Raster.check("a small device", less).is_ok());
}

/// The near plane's distance of the first hemicube on each patch, in half sides of the scene.
fn near_planes(triangles: &[[DVec3; 3]]) -> Vec<f64> {
    let triangle = |&corners: &[DVec3; 3]| Triangle {
        corners,
        object: 0,
        material: 0,
        face: 0,
        two_sided: false,
    };
    let model = model(&Scene {
        triangles: triangles.iter().map(triangle).collect(),
        ..Scene::default()
    });
    let patches = 0..u32::try_from(triangles.len()).expect("few");
    patches
        .map(|p| near(model.geometry(), &model.hemicubes(InputPatch(p), 1, false)[0]))
        .collect()
}

#[test]
fn the_near_plane_is_before_all_that_an_emitter_sees() {
    let facing = |side: f64, height: f64| [DVec3::ZERO, DVec3::X, DVec3::Y].map(|p| p * side + DVec3::Z * height);
    let turned = |[a, b, c]: [DVec3; 3]| [a, c, b];
    let far = facing(1.0, 2.0);
    // A mote below the large triangle alone, and one with another just above it.
    let alone = near_planes(&[turned(far), facing(1e-6, 0.0)]);
    assert_eq!(alone, [2f64.powi(-20); 2]);
    let beside = near_planes(&[turned(far), facing(1e-6, 0.0), turned(facing(1e-6, 4e-7))]);
    // Half a side of this scene's cube is 1, as high as it is: the distance is 4e-7.
    assert!(beside[1] <= 1e-7 && beside[1] > 4e-8, "{beside:?}");
    assert_eq!(beside[0], 2f64.powi(-20));
    // Walls of two houses, 10⁻⁷ apart.
    let walls = near_planes(&[facing(1.0, 0.0), turned(facing(1.0, 1e-7)), turned(facing(1.0, 1.0))]);
    assert!(walls[0] <= 5e-8 && walls[0] > 1e-8, "{walls:?}");
}
