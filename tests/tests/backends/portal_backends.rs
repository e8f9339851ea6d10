//! Mirrors over backends on a device: the plugin draws the first pass and hands out item buffers; large passes through
//! portals are drawn by plugins that can, all else is followed on the processor. Rows are those of the CPU backend
//! within the noise of pixels.

#![cfg(unix)]

use hemicube::backend::{BackendError, HemicubeBackend};
use hemicube_tests::devices::is_there;
use hemicube_tests::matrices::{Entries, apart, entries};
use hemicube_tests::plugins::{rust, try_session};
use hemicube_tests::runs::Place;
use std::path::Path;

/// A room off all symmetry, seen from within; its wall `m` is a mirror, and `pane` stands in it.
const ROOM: &str = "\
v 0.013 0.007 0.003
v 1.113 0.107 0.011
v 1.013 1.207 0.023
v -0.087 1.007 0.017
v 0.033 0.017 0.903
v 1.133 0.087 0.911
v 1.043 1.227 0.923
v -0.067 1.037 0.917
v 0.213 0.317 0.051
v 0.713 0.357 0.047
v 0.743 0.387 0.513
v 0.223 0.347 0.507
o floor
f 1 2 3 4
o ceiling
f 5 8 7 6
o wall
f 1 4 8 5
f 2 6 7 3
f 1 5 6 2
o m
f 4 3 7 8
o pane
f 9 10 11
f 9 11 12
f 9 11 10
f 9 12 11
";
const OPTICS: &str = "[object.m]\nspecular = 0.8\n[object.pane]\nspecular = 0.1\ntransmittance = 0.7\n";

const FOLLOWED: &str = "through mirrors and panes is followed on the processor";

fn all(place: &Place, store: &str) -> Entries {
    entries(&place.path(store), 0..u32::MAX, |column| column)
}

fn follows_mirrors(name: &str) {
    let plugin = rust(name);
    let opened = try_session(&plugin, &[]);
    let opened = opened.map(|session| Box::new(session) as Box<dyn HemicubeBackend>);
    if !is_there(
        name,
        &opened.map_err(|error| BackendError::Unsupported(error.to_string())),
    ) {
        return;
    }
    let place = Place::new();
    place.write("room.obj", ROOM);
    place.write("optics.toml", OPTICS);
    let folder = plugin
        .parent()
        .and_then(Path::to_str)
        .expect("a folder in UTF-8")
        .to_owned();
    let by_pixels = "through mirrors and panes where passes are large";
    let fine = "--correction pixel --resolution 128";
    for (settings, option, most, said) in [
        (fine, "--backend-option passes=on", 0.01, by_pixels),
        (fine, "", 0.01, FOLLOWED),
        ("--tolerance 2%", "", 2e-3, FOLLOWED),
    ] {
        let line = format!("compute room.obj --overwrite --split 2 --specular optics.toml {settings}");
        place.line(&format!("{line} -o cpu")).is(0);
        place
            .line(&format!(
                "HEMICUBE_BACKEND_PATH={folder} {line} -o device --backend {name} --threads 1 -v {option}"
            ))
            .is(0)
            .says(&[said]);
        let report = place.line("check device --json").is(0).json();
        assert_eq!(report["ok"], true, "{report}");
        let [device, cpu] = ["device", "cpu"].map(|store| all(&place, store));
        let apart_by = apart(&device, &cpu);
        assert!(apart_by < most, "{name} {settings}: {apart_by}");
    }
    // The comparator sees a mirror: rows without it are far off.
    place.line("compute room.obj --overwrite --split 2 -o plain").is(0);
    let [plain, cpu] = ["plain", "cpu"].map(|store| all(&place, store));
    assert!(apart(&plain, &cpu) > 0.1);
}

#[test]
fn gl_follows_mirrors() {
    follows_mirrors("gl");
}

#[test]
fn vulkan_follows_mirrors() {
    follows_mirrors("vulkan");
}

#[test]
fn wgpu_follows_mirrors() {
    follows_mirrors("wgpu");
}
