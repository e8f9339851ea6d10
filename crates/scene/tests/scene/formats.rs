//! STL, PLY, View3D and CityJSON: damaged files do no harm, and each format brings a scene that another one brought.

#![cfg(all(
    feature = "stl",
    feature = "ply",
    feature = "vs3",
    feature = "cityjson",
    feature = "generate"
))]

use glam::DVec3;
use hemicube_scene::generate::{self, Generate, Kind};
use hemicube_scene::{Error, Patches, ReadOptions, Scene, Subdivision, cityjson, ply, stl, vs3};
use proptest::prelude::*;
use std::fmt::Write;
use std::path::Path;

type Read = fn(&[u8], Option<&Path>, ReadOptions) -> Result<Scene, Error>;

fn open(read: Read, bytes: &[u8]) -> Result<Scene, Error> {
    read(
        bytes,
        None,
        ReadOptions {
            optics: true,
            ..ReadOptions::default()
        },
    )
}

fn stl_text(scene: &Scene) -> Vec<u8> {
    let mut text = String::from("solid scene\n");
    for triangle in &scene.triangles {
        text += "facet normal 0 0 0\n outer loop\n";
        for p in triangle.corners {
            writeln!(text, "  vertex {:e} {:e} {:e}", p.x, p.y, p.z).unwrap();
        }
        text += " endloop\nendfacet\n";
    }
    text += "endsolid scene\n";
    text.into_bytes()
}

fn stl_binary(scene: &Scene) -> Vec<u8> {
    let mut bytes = vec![0; 80];
    bytes.extend(u32::try_from(scene.triangles.len()).unwrap().to_le_bytes());
    for triangle in &scene.triangles {
        bytes.extend([0; 12]);
        #[allow(clippy::cast_possible_truncation, reason = "binary STL has no more")]
        let floats = triangle.corners.iter().flat_map(|p| p.to_array()).map(|x| x as f32);
        bytes.extend(floats.flat_map(f32::to_le_bytes));
        bytes.extend([0; 2]);
    }
    bytes
}

fn ply_text(scene: &Scene) -> Vec<u8> {
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
        3 * scene.triangles.len(),
        scene.triangles.len()
    );
    for p in scene.triangles.iter().flat_map(|t| t.corners) {
        writeln!(text, "{:e} {:e} {:e}", p.x, p.y, p.z).unwrap();
    }
    for i in 0..scene.triangles.len() {
        writeln!(text, "3 {} {} {}", 3 * i, 3 * i + 1, 3 * i + 2).unwrap();
    }
    text.into_bytes()
}

fn ply_binary(scene: &Scene) -> Vec<u8> {
    let mut bytes = format!(
        "ply\nformat binary_big_endian 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
        3 * scene.triangles.len(),
        scene.triangles.len()
    )
    .into_bytes();
    let coordinates = scene
        .triangles
        .iter()
        .flat_map(|t| t.corners)
        .flat_map(|p| p.to_array());
    bytes.extend(coordinates.flat_map(f64::to_be_bytes));
    for i in 0..u32::try_from(scene.triangles.len()).unwrap() {
        bytes.push(3);
        bytes.extend([3 * i, 3 * i + 1, 3 * i + 2].into_iter().flat_map(u32::to_be_bytes));
    }
    bytes
}

fn city_json(scene: &Scene) -> Vec<u8> {
    let vertices: Vec<[f64; 3]> = scene
        .triangles
        .iter()
        .flat_map(|t| t.corners)
        .map(|p| p.to_array())
        .collect();
    let faces: Vec<_> = (0..scene.triangles.len())
        .map(|i| vec![vec![3 * i, 3 * i + 1, 3 * i + 2]])
        .collect();
    serde_json::json!({
        "type": "CityJSON", "version": "2.0",
        "transform": {"scale": [1.0, 1.0, 1.0], "translate": [0.0, 0.0, 0.0]},
        "CityObjects": {"tile": {"type": "Building", "geometry": [
            {"type": "MultiSurface", "lod": "2.2", "boundaries": faces}
        ]}},
        "vertices": vertices
    })
    .to_string()
    .into_bytes()
}

fn view3d() -> Vec<u8> {
    include_bytes!("formats/l-room.vs3").to_vec()
}

fn block_city(target_patches: u64) -> Scene {
    generate::generate(Generate {
        kind: Kind::BlockCity,
        target_patches,
        seed: 5,
    })
    .expect("a city")
}

#[test]
fn every_format_brings_the_same_triangles() {
    let scene = block_city(400);
    let corners = |scene: &Scene| -> Vec<[DVec3; 3]> { scene.triangles.iter().map(|t| t.corners).collect() };
    let expected = corners(&scene);
    for (name, read, bytes) in [
        ("text STL", stl::read as Read, stl_text(&scene)),
        ("text PLY", ply::read, ply_text(&scene)),
        ("binary PLY", ply::read, ply_binary(&scene)),
        ("CityJSON", cityjson::read, city_json(&scene)),
    ] {
        let brought = open(read, &bytes).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!(corners(&brought), expected, "{name}");
        assert!(
            brought
                .triangles
                .iter()
                .map(|t| t.face)
                .eq(0..u32::try_from(expected.len()).unwrap()),
            "{name}"
        );
    }
    let brought = corners(&open(stl::read, &stl_binary(&scene)).unwrap());
    let off = brought
        .iter()
        .flatten()
        .zip(expected.iter().flatten())
        .map(|(p, q)| (*p - *q).length());
    assert_eq!(brought.len(), expected.len());
    assert!(off.fold(0.0, f64::max) < 1e-4);
}

#[test]
fn a_room_of_view3d_is_closed() {
    let scene = open(vs3::read, &view3d()).unwrap();
    let patches = Patches::new(&scene, Subdivision::None).unwrap();
    let area: f64 = patches.iter().map(|patch| patches.area(patch)).sum();
    // Two floors of 5 m² and 12 m of walls 3 m high.
    assert!((area - (2.0 * 5.0 + 12.0 * 3.0)).abs() < 1e-12, "{area}");
    // Over a closed surface the vector areas sum to nothing.
    let vector: DVec3 = patches
        .iter()
        .map(|patch| patches.normal(patch) * patches.area(patch))
        .sum();
    assert!(vector.length() < 1e-12, "{vector}");
    assert!(scene.objects.iter().any(|name| name == "window"));
    assert!(
        !scene.objects.iter().any(|name| name == "floor-b"),
        "combined surfaces are one object"
    );
}

/// A file with some bytes replaced, cut out or doubled.
fn damaged(mut bytes: Vec<u8>, damages: &[(u8, prop::sample::Index, u8, usize)]) -> Vec<u8> {
    for (kind, place, byte, length) in damages {
        if bytes.is_empty() {
            break;
        }
        let at = place.index(bytes.len());
        let end = (at + length).min(bytes.len());
        match kind % 5 {
            0 => bytes[at] = *byte,
            1 => bytes.truncate(at),
            2 => drop(bytes.drain(at..end)),
            3 => {
                let again = bytes[at..end].to_vec();
                bytes.splice(at..at, again);
            }
            // Digits are where counts and indices are.
            _ => bytes[at] = b'0' + byte % 10,
        }
    }
    bytes
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn damaged_files_are_read_or_refused_and_nothing_else(
        damages in prop::collection::vec((any::<u8>(), any::<prop::sample::Index>(), any::<u8>(), 1_usize..40), 1..6),
    ) {
        let scene = block_city(100);
        for (read, bytes) in [
            (stl::read as Read, stl_text(&scene)),
            (stl::read, stl_binary(&scene)),
            (ply::read, ply_text(&scene)),
            (ply::read, ply_binary(&scene)),
            (vs3::read, view3d()),
            (cityjson::read, city_json(&scene)),
        ] {
            if let Ok(scene) = open(read, &damaged(bytes, &damages)) {
                for triangle in &scene.triangles {
                    prop_assert!((triangle.object as usize) < scene.objects.len());
                    prop_assert!((triangle.material as usize) < scene.materials.len());
                }
                prop_assert!(scene.triangles.is_sorted_by_key(|t| t.face));
            }
        }
    }
}
