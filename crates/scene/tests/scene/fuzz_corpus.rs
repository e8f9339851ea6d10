//! Replays the fuzz corpus (`fuzz/corpus`, one folder a reader) as an ordinary test. A file's name says what must
//! become of it: `ok-…` is read, `bad-…` is refused, any other must only not panic.

#![cfg(all(
    feature = "obj",
    feature = "gltf",
    feature = "ac3d",
    feature = "gmsh",
    feature = "vtk",
    feature = "abaqus",
    feature = "energyplus",
    feature = "gbxml",
    feature = "raster"
))]

use hemicube_scene::{Error, ReadOptions, Scene, abaqus, ac3d, energyplus, gbxml, gltf, gmsh, obj, raster, vtk};
use std::path::Path;
use std::time::{Duration, Instant};

type Read = fn(&[u8], Option<&Path>, ReadOptions) -> Result<Scene, Error>;

/// Complaints about what the reader makes of each file, and how many files there were that must be read, must be
/// refused, and in all.
fn replay(folder: &Path, read: Read) -> (Vec<String>, [usize; 3]) {
    let mut complaints = Vec::new();
    let mut counts = [0; 3];
    let mut files: Vec<_> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    files.sort();
    for file in files {
        let name = file.file_name().unwrap().to_string_lossy().into_owned();
        let bytes = std::fs::read(&file).unwrap();
        counts[2] += 1;
        for optics in [false, true] {
            let start = Instant::now();
            let result = read(
                &bytes,
                None,
                ReadOptions {
                    optics,
                    ..ReadOptions::default()
                },
            );
            if start.elapsed() > Duration::from_secs(5) {
                complaints.push(format!("{name} took {:?}", start.elapsed()));
            }
            if let Ok(scene) = &result {
                for t in &scene.triangles {
                    if t.object as usize >= scene.objects.len() || t.material as usize >= scene.materials.len() {
                        complaints.push(format!("{name}: {t:?} refers to what is not there"));
                    }
                }
                if !scene.triangles.is_sorted_by_key(|t| t.face) {
                    complaints.push(format!("{name}: triangles are not in face order"));
                }
            }
            if name.starts_with("ok-") {
                counts[0] += usize::from(optics);
                match result {
                    Ok(scene) if scene.triangles.is_empty() => complaints.push(format!("{name}: no triangle")),
                    Ok(_) => {}
                    Err(error) => complaints.push(format!("{name} was refused: {error}")),
                }
            } else if name.starts_with("bad-") {
                counts[1] += usize::from(optics);
                match result {
                    Ok(scene) => complaints.push(format!("{name} was read: {} triangles", scene.triangles.len())),
                    Err(error) if error.to_string().is_empty() => complaints.push(format!("{name}: empty message")),
                    Err(_) => {}
                }
            }
        }
    }
    (complaints, counts)
}

fn replay_corpus(reader: &str, read: Read, at_least: [usize; 3]) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus").join(reader);
    let (complaints, counts) = replay(&folder, read);
    assert!(complaints.is_empty(), "{}", complaints.join("\n"));
    for (count, least) in counts.into_iter().zip(at_least) {
        assert!(
            count >= least,
            "replayed {counts:?} files of {}, at least {at_least:?} belong there",
            folder.display()
        );
    }
}

#[test]
fn obj_corpus() {
    replay_corpus("obj", obj::read, [15, 5, 24]);
}

#[test]
fn gltf_corpus() {
    replay_corpus("gltf", gltf::read, [15, 10, 30]);
}

#[test]
fn ac3d_corpus() {
    replay_corpus("ac3d", ac3d::read, [20, 10, 36]);
}

#[test]
fn gmsh_corpus() {
    replay_corpus("gmsh", gmsh::read, [15, 11, 26]);
}

#[test]
fn vtk_corpus() {
    replay_corpus("vtk", vtk::read, [8, 20, 28]);
}

#[test]
fn abaqus_corpus() {
    replay_corpus("abaqus", abaqus::read, [16, 21, 40]);
}

#[test]
fn energyplus_corpus() {
    replay_corpus("energyplus", energyplus::read, [17, 28, 45]);
}

#[test]
fn gbxml_corpus() {
    replay_corpus("gbxml", gbxml::read, [13, 15, 30]);
}

#[test]
fn raster_corpus() {
    replay_corpus("raster", raster::read, [9, 10, 20]);
}

#[test]
fn a_wrong_reader_is_complained_about() {
    // The replay itself must be able to fail: readers that take or refuse everything.
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus/ac3d");
    let (complaints, counts) = replay(&folder, |_, _, _| Err(Error::malformed("no")));
    assert_eq!(complaints.len(), 2 * counts[0]);
    let (complaints, counts) = replay(&folder, |_, _, _| Ok(Scene::default()));
    assert_eq!(complaints.len(), 2 * (counts[0] + counts[1]));
}
