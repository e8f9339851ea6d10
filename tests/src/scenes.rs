//! The program and real scenes: their places, unpacking, and the conditions for skipping a test.

use hemicube::{HierarchyOptions, Model};
use hemicube_scene::generate::{self, Kind};
use hemicube_scene::repair::{RepairOptions, repair};
use hemicube_scene::{Error, Patches, ReadOptions, Scene, Subdivision, load};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Says on the terminal, past the capture of test output, that `test` is skipped.
///
/// # Panics
/// When the variable `required` is set to `1`: there the reason is a failure.
pub fn skip(test: &str, reason: &str, required: &str) {
    if std::env::var_os(required).is_some_and(|value| value == "1") {
        panic!("{test} would be skipped: {reason}; `{required}=1` forbids that");
    }
    say(&format!("SKIP {test}: {reason}"));
}

/// Writes a line to the standard error stream itself, which the test harness does not capture.
pub fn say(line: &str) {
    // A closed stream is no reason for a test to fail.
    let _ = std::io::stderr().write_all(format!("{line}\n").as_bytes());
}

/// The program: the one named by Cargo, or the one beside the running test.
///
/// # Panics
/// When it was not built with the test's profile and target directory.
pub fn program() -> PathBuf {
    if let Some(path) = std::env::var_os("CARGO_BIN_EXE_hemicube") {
        return path.into();
    }
    let path = profile_folder().join(format!("hemicube{}", std::env::consts::EXE_SUFFIX));
    assert!(
        path.is_file(),
        "`{}` is missing: run `cargo build --release -p hemicube-cli` first",
        path.display()
    );
    path
}

/// The folder of Cargo's programs and plugins: target/PROFILE, above the running test's target/PROFILE/deps.
///
/// # Panics
/// When the test is somewhere else.
pub fn profile_folder() -> PathBuf {
    let test = std::env::current_exe().expect("the test's own path");
    test.parent().and_then(Path::parent).expect("target/PROFILE").to_owned()
}

/// The folder of real scenes, if there is one: `HEMICUBE_SCENES`, or `../shared/scenes` beside the workspace.
pub fn scenes_dir() -> Option<PathBuf> {
    let folder = match std::env::var_os("HEMICUBE_SCENES") {
        Some(folder) => PathBuf::from(folder),
        None => workspace().join("../shared/scenes"),
    };
    folder.is_dir().then_some(folder)
}

/// The workspace's root.
pub fn workspace() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
}

/// The folder of real scenes, or a skip.
pub fn scenes_or_skip(test: &str) -> Option<PathBuf> {
    let found = scenes_dir();
    if found.is_none() {
        skip(test, "no ../shared/scenes", "HEMICUBE_REQUIRE_SCENES");
    }
    found
}

/// A scene of the folder by its path in the manifest; a compressed file by its unpacked path.
///
/// # Errors
/// The reader's error.
///
/// # Panics
/// When the file is only there compressed, and `zstd` cannot be run or refuses it.
pub fn read(folder: &Path, file: &str) -> Result<Scene, Error> {
    let path = folder.join(file);
    let packed = folder.join(format!("{file}.zst"));
    if path.exists() || !packed.exists() {
        return load(&path, ReadOptions::default());
    }
    let unpacked = unpack(&packed);
    let place = tempfile::tempdir().expect("a temporary directory");
    let path = place
        .path()
        .join(path.file_name().expect("a scene's path ends in a file name"));
    std::fs::write(&path, unpacked).expect("room in the temporary directory");
    load(&path, ReadOptions::default())
}

/// The bytes of a `.zst` file.
///
/// # Panics
/// When `zstd` cannot be run, or refuses the file.
pub fn unpack(packed: &Path) -> Vec<u8> {
    let output = Command::new("zstd")
        .arg("-dc")
        .arg(packed)
        .output()
        .unwrap_or_else(|error| panic!("`zstd` cannot be run: {error}; install the package zstd"));
    assert!(
        output.status.success(),
        "zstd -dc {}: {}",
        packed.display(),
        String::from_utf8_lossy(&output.stderr)
    );
    output.stdout
}

/// A scene repaired like the program does, cut into patches and made ready for hemicubes.
///
/// # Panics
/// When nothing of it is left, or there is too much of it.
pub fn model(mut scene: Scene, subdivision: Subdivision) -> Model {
    repair(&mut scene, RepairOptions::default());
    model_as_it_is(&scene, subdivision)
}

/// A scene cut into patches without any repair.
///
/// # Panics
/// When it has no triangle, or too many.
pub fn model_as_it_is(scene: &Scene, subdivision: Subdivision) -> Model {
    let patches = Patches::new(scene, subdivision).expect("a scene that fits");
    Model::new(patches.into(), HierarchyOptions::default()).expect("a scene with an extent")
}

/// A generated scene made ready.
///
/// # Panics
/// When the generator refuses it.
pub fn generated(kind: hemicube_scene::generate::Kind, target_patches: u64) -> Model {
    let spec = hemicube_scene::generate::Generate {
        kind,
        target_patches,
        seed: 1,
    };
    model(
        hemicube_scene::generate::generate(spec).expect("a target in range"),
        Subdivision::None,
    )
}

/// Scenes of cut triangles, drawn uncut by the CPU backend's engines `depth` and `claims`.
///
/// # Panics
/// When one cannot be generated.
pub fn cut_scenes() -> Vec<(String, Model)> {
    let scene = |kind, target_patches, seed| {
        let spec = generate::Generate {
            kind,
            target_patches,
            seed,
        };
        generate::generate(spec).expect("a target in range")
    };
    let mut two_sided = scene(Kind::Soup, 400, 5);
    for triangle in two_sided.triangles.iter_mut().step_by(3) {
        triangle.two_sided = true;
    }
    let city = generate::BlockCityParameters {
        blocks: 8,
        split: 4,
        ..generate::BlockCityParameters::for_target(1000, 1)
    };
    [
        ("Cornell box", generate::cornell_box(), Subdivision::Levels(4)),
        ("open Cornell box", generate::cornell_box_open(), Subdivision::Split(7)),
        (
            "block city",
            city.generate().expect("a city in range"),
            Subdivision::None,
        ),
        ("city", scene(Kind::City, 2_000, 1), Subdivision::PatchSize(3.0)),
        ("maze", scene(Kind::Maze, 1_000, 1), Subdivision::Split(3)),
        ("spheres", scene(Kind::Spheres, 800, 1), Subdivision::Split(2)),
        ("two-sided soup", two_sided, Subdivision::Split(4)),
        (
            "room with a block",
            crate::extremes::room_with_a_block(2),
            Subdivision::Split(5),
        ),
        ("mote", crate::extremes::mote(), Subdivision::Split(6)),
    ]
    .map(|(name, scene, subdivision)| (format!("{name}, cut"), model(scene, subdivision)))
    .into()
}
