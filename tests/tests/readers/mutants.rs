//! Scenes as an attacker sends them: files of every format, changed by a seeded mutator. A reader refuses one or makes
//! of it a scene that can be repaired and cut; it never panics, never hangs, and never makes more than
//! `docs/security.md` allows.
//!
//! A short run each time; the long one: `cargo test --release -p hemicube-tests --test readers -- mutants:: --ignored`

use hemicube_scene::repair::{RepairOptions, repair};
use hemicube_scene::{
    Error, Patches, ReadOptions, Scene, Subdivision, abaqus, ac3d, cityjson, energyplus, gbxml, gltf, gmsh, obj, ply,
    raster, stl, vs3, vtk,
};
use hemicube_tests::random::Random;
use hemicube_tests::scenes::workspace;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

type Read = fn(&[u8], Option<&Path>, ReadOptions) -> Result<Scene, Error>;

/// Triangles that any file may become; above, one a byte.
const TRIANGLES: usize = 1_000_000;
/// A mutant of a few kilobytes that takes longer hangs.
const TIME_LIMIT: Duration = Duration::from_secs(20);
/// No seed is larger: most of a mutant should be what a reader looks at.
const SEED_BYTES_MAX: u64 = 20_000;

/// The reader of a file, by its extension.
fn reader(path: &Path) -> Option<Read> {
    Some(match path.extension()?.to_str()? {
        "obj" => obj::read,
        "gltf" | "glb" => gltf::read,
        "ac" => ac3d::read,
        "ply" => ply::read,
        "stl" => stl::read,
        "vs3" => vs3::read,
        "json" | "jsonl" => cityjson::read,
        "msh" => gmsh::read,
        "vtu" | "vtp" | "vtk" => vtk::read,
        "inp" => abaqus::read,
        "idf" | "epJSON" => energyplus::read,
        "gbxml" | "xml" => gbxml::read,
        "tif" | "asc" => raster::read,
        _ => return None,
    })
}

/// Files of the repository that mutants are made of, by name, so that a seed says which.
fn seeds() -> Vec<(PathBuf, Vec<u8>, Read)> {
    let mut folders = vec![
        workspace().join("crates/scene/fuzz/corpus"),
        workspace().join("crates/scene/tests"),
        workspace().join("tests/tests/outside/formats"),
    ];
    let mut found = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
            let path = entry.path();
            if path.is_dir() {
                folders.push(path);
            } else if let Some(read) = reader(&path)
                // Mutants of what is refused are refused.
                && !entry.file_name().to_string_lossy().starts_with("bad-")
                && entry.metadata().is_ok_and(|metadata| metadata.len() <= SEED_BYTES_MAX)
            {
                found.push((path.clone(), std::fs::read(&path).expect("a file"), read));
            }
        }
    }
    found.push((PathBuf::from("copies.json"), COPIES.to_vec(), cityjson::read));
    found.push((PathBuf::from("base.vs3"), BASE.to_vec(), vs3::read));
    found.push((PathBuf::from("quad.ply"), QUAD.to_vec(), ply::read));
    found.push((PathBuf::from("solid.stl"), SOLID.to_vec(), stl::read));
    found.sort_by(|a, b| a.0.cmp(&b.0));
    found
}

const COPIES: &[u8] = br#"{"type":"CityJSON","version":"2.0","transform":{"scale":[0.5,0.5,0.5],"translate":[1,2,3]},
"CityObjects":{"a":{"type":"Building","geometry":[{"type":"MultiSurface","lod":"2","boundaries":[[[0,1,2,3],[4,5,6]]],
"semantics":{"surfaces":[{"type":"RoofSurface"}],"values":[0]}}]},"t":{"type":"X","geometry":[{"type":"GeometryInstance",
"template":0,"boundaries":[0],"transformationMatrix":[2,0,0,0,0,2,0,0,0,0,2,5,0,0,0,1]}]}},
"geometry-templates":{"templates":[{"type":"MultiSurface","lod":"2","boundaries":[[[0,1,2]]]}],
"vertices-templates":[[0,0,0],[1,0,0],[0,1,0]]},
"vertices":[[0,0,0],[9,0,0],[9,9,0],[0,9,0],[1,1,0],[2,1,0],[1,2,0]]}"#;
const BASE: &[u8] =
    b"T t\nF 3\nV 1 0 0 0\nV 2 9 0 0\nV 3 9 9 0\nV 4 0 9 0\nV 5 1 1 0\nV 6 2 1 0\nV 7 2 2 0\nV 8 1 2 0\n\
S 1 1 2 3 4 0 0 0.9 wall\nS 2 5 6 7 8 1 0 0.9 window\nO 3 1 2 3 4\nN 4 5 6 7 8 0 1 0.5 none\nEnd of data\n";
const QUAD: &[u8] =
    b"ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\nproperty double y\nproperty double z\n\
element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n";
const SOLID: &[u8] =
    b"solid s\nfacet normal 0 0 1\nouter loop\nvertex 0. 0. 0.\nvertex 1. 0. 0.\nvertex 0. 1. 0.\nendloop\n\
endfacet\nendsolid s\n";

/// The replacements for numbers and words.
const WORDS: [&str; 22] = [
    "0",
    "-1",
    "1",
    "2147483647",
    "4294967295",
    "4294967296",
    "18446744073709551616",
    "1e308",
    "-1e308",
    "1e-320",
    "nan",
    "inf",
    "0.1",
    "\"\"",
    "null",
    "[]",
    "{}",
    "\u{1b}[2J",
    "\n",
    "\\",
    "/",
    "=1+1",
];

/// Changes a file in one to four places.
fn mutate(bytes: &[u8], random: &mut Random) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    for _ in 0..1 + random.below(4) {
        let at = random.below(bytes.len() + 1);
        let length = 1 + random.below(40);
        let end = (at + length).min(bytes.len());
        match random.below(7) {
            0 => drop(bytes.drain(at..end)),
            1 if at < bytes.len() => bytes[at] ^= 1 << random.below(8),
            2 => bytes.truncate(at),
            3 => {
                let copy = bytes[at..end].to_vec();
                let to = random.below(bytes.len() + 1);
                bytes.splice(to..to, copy);
            }
            // A run of the same, up to some kilobytes.
            4 => {
                let copy = bytes[at..end].repeat(1 + random.below(200));
                bytes.splice(at..at, copy);
            }
            // A number or word where one stands.
            5 | 6 => {
                let word = WORDS[random.below(WORDS.len())].as_bytes().to_vec();
                let is_word = |b: &u8| b.is_ascii_alphanumeric() || b".-+".contains(b);
                let end = at + bytes[at..].iter().take_while(|b| is_word(b)).count();
                bytes.splice(at..end, word);
            }
            _ => {}
        }
    }
    bytes
}

/// Reads mutants, and says how many became scenes.
fn run(count: usize, seed: u64) -> usize {
    let seeds = seeds();
    assert!(seeds.len() > 20, "{} seeds are few", seeds.len());
    let mut random = Random(seed);
    let mut read_count = 0;
    for mutant in 0..count {
        let (path, bytes, read) = &seeds[random.below(seeds.len())];
        let mutated = mutate(bytes, &mut random);
        let started = Instant::now();
        let optics = random.below(2) == 0;
        let options = ReadOptions {
            optics,
            ..ReadOptions::default()
        };
        // A panic prints the mutant's name.
        let of = || format!("mutant {mutant} of seed {seed}, of {}", path.display());
        let result = std::panic::catch_unwind(|| read(&mutated, None, options));
        let result = result.unwrap_or_else(|_| panic!("{} panicked", of()));
        match result {
            Err(error) => assert!(!error.to_string().is_empty(), "{}", of()),
            Ok(mut scene) => {
                let triangles = scene.triangles.len();
                assert!(triangles <= TRIANGLES.max(mutated.len()), "{}: {triangles}", of());
                for triangle in &scene.triangles {
                    assert!((triangle.object as usize) < scene.objects.len().max(1), "{}", of());
                    assert!((triangle.material as usize) < scene.materials.len().max(1), "{}", of());
                }
                repair(&mut scene, RepairOptions::default());
                assert!(
                    scene.triangles.iter().all(|t| t.corners.iter().all(|c| c.is_finite())),
                    "{}",
                    of()
                );
                let patches = Patches::new(&scene, Subdivision::None).expect("no more than were read");
                let sides = scene.triangles.iter().map(|t| if t.two_sided { 2 } else { 1 });
                assert_eq!(patches.len(), sides.sum::<usize>(), "{}", of());
                read_count += usize::from(triangles > 0);
            }
        }
        assert!(started.elapsed() < TIME_LIMIT, "{} took {:?}", of(), started.elapsed());
    }
    read_count
}

#[test]
fn mutated_scenes_are_refused_or_are_scenes() {
    let read = run(30_000, 1);
    // Otherwise the mutator only makes what the first line refuses.
    assert!(read > 3_000, "of 30,000 mutants {read} became scenes");
}

#[test]
#[ignore = "minutes; `./test --full` runs it"]
fn very_many_mutated_scenes_are_refused_or_are_scenes() {
    for seed in 2..62 {
        assert!(run(300_000, seed) > 30_000);
    }
}
