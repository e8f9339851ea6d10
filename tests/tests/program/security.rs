//! What somebody who sends a folder, a scene or a name may not do: each promise of `docs/security.md` that the command
//! line keeps. Two runs on one output are in `side_by_side.rs`, stores that lie in `crates/hemicube/tests`, mutated scenes
//! in `readers/mutants.rs`.
//!
//! The binary is the one beside this test: build it with the same profile and target directory before.

#![cfg(unix)]

use glam::DVec3;
use hemicube_tests::geometry::box_inside;
use hemicube_tests::runs::{Place, Ran, files, finish};
use hemicube_tests::scenes::program;
use serde_json::json;
use std::os::unix::fs::symlink;
use std::process::Command;
use std::time::{Duration, Instant};

/// The time that a person calls *at once*, on a machine that others use too.
const AT_ONCE: Duration = Duration::from_secs(20);

pub(crate) const COMPUTE: &str = "compute room.obj --resolution 32 --correction pixel -q";

/// A room, its matrix and materials.
pub(crate) fn room() -> Place {
    let place = Place::new();
    place.line("generate room --patches 40 -o room.obj -q").is(0);
    place.line(&format!("{COMPUTE} -o m")).is(0);
    let materials = "[default]\nreflectance = 0.5\nemission = 1\n";
    std::fs::write(place.path("mat.toml"), materials).expect("a file");
    place
}

fn write(place: &Place, name: &str, text: impl AsRef<[u8]>) {
    let path = place.path(name);
    std::fs::create_dir_all(path.parent().expect("a parent")).expect("a folder");
    std::fs::write(path, text).expect("a file");
}

/// Runs a line that must end at once.
#[track_caller]
fn at_once(place: &Place, line: &str) -> Ran {
    let mut child = place.spawn(place.command(line));
    let started = Instant::now();
    while child.try_wait().expect("a child").is_none() {
        if started.elapsed() > AT_ONCE {
            child.kill().expect("a child");
            panic!("`{line}` waits");
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    finish(child)
}

#[test]
fn code_of_a_folder_is_not_run() {
    let place = room();
    write(&place, "x.so", "no library, and never opened");
    for (text, words) in [
        ("backend = \"./x.so\"\n", "hemicube.toml:1: `backend = \"./x.so\"`"),
        ("\nbackend = \"x.so\"\n", "hemicube.toml:2: "),
    ] {
        write(&place, "hemicube.toml", text);
        for command in [
            "inspect room.obj",
            "compute room.obj -o n",
            "tradeoff room.obj",
            "compute --print-config",
        ] {
            let ran = place.line(command).is(2).says(&[words, "hint: ", "`--config none`"]);
            assert!(!ran.err.contains("x.so`: "), "it was looked at: {}", ran.err);
        }
        place.line(&format!("{COMPUTE} --config=none -o n --overwrite")).is(0);
    }
    // Who says so on the command line is taken at their word: then the file is looked at.
    write(&place, "hemicube.toml", "backend = \"./x.so\"\n");
    for command in [
        "inspect room.obj --config hemicube.toml",
        "inspect room.obj --config=none --backend ./x.so",
    ] {
        place.line(command).is(2).says(&["backend `./x.so`: not loaded"]);
    }
    // Names of what is installed may stand there.
    write(&place, "hemicube.toml", "backend = \"cpu\"\n");
    place.line(&format!("{COMPUTE} -o n --overwrite")).is(0);
    // In the user's own file a path that hangs on where the program is run is no better.
    std::fs::remove_file(place.path("hemicube.toml")).expect("a file");
    write(&place, "home/.config/hemicube/hemicube.toml", "backend = \"./x.so\"\n");
    place.line("inspect room.obj").is(2).says(&["give its whole path"]);
    let whole = place.path("x.so");
    write(
        &place,
        "home/.config/hemicube/hemicube.toml",
        format!("backend = \"{}\"\n", whole.display()),
    );
    place.line("inspect room.obj").is(2).says(&["x.so`: not loaded"]);
}

#[cfg(target_os = "linux")]
#[test]
fn a_plugin_that_is_cut_short_is_refused_before_it_is_opened() {
    let place = room();
    let program = std::fs::read(hemicube_tests::scenes::program()).expect("the program");
    // The loader maps the cut file, and dies of it.
    for length in [100, 100_000, program.len() / 2, program.len() - 1] {
        for name in ["vulkan", "mine"] {
            write(&place, &format!("b/libhemicube_backend_{name}.so"), &program[..length]);
        }
        let listed = place.line("HEMICUBE_BACKEND_PATH=b backends list").is(0);
        assert!(listed.out.contains("cut short"), "{}", listed.out);
        place
            .line(&format!("HEMICUBE_BACKEND_PATH=b {COMPUTE} --backend mine -o n"))
            .is(2)
            .says(&["cut short"]);
        place
            .line(&format!(
                "HEMICUBE_BACKEND_PATH=b {COMPUTE} --backend auto -o a --overwrite"
            ))
            .is(0);
    }
    let mut other = program[..].to_vec();
    other[18..20].copy_from_slice(&[243, 0]);
    write(&place, "b/libhemicube_backend_mine.so", other);
    if !cfg!(target_arch = "riscv64") {
        place
            .line(&format!("HEMICUBE_BACKEND_PATH=b {COMPUTE} --backend mine -o n"))
            .is(2)
            .says(&["built for riscv64"]);
    }
}

#[test]
fn links_at_foreseeable_names_are_left_alone() {
    let place = room();
    let precious = place.path("precious");
    std::fs::create_dir(place.path("b")).expect("a folder");
    let lines = [
        ("m/.lock.hemicube-tmp", format!("{COMPUTE} -o m"), 2),
        ("m/.probe.hemicube-tmp", format!("{COMPUTE} -o m"), 0),
        ("m/.manifest.json.hemicube-tmp", format!("{COMPUTE} -o m"), 0),
        ("b/.symmetric.hemicube-tmp", "balance m -o b --reciprocity".into(), 0),
        ("b/.shards-2.hemicube-tmp", format!("{COMPUTE} -o b --overwrite"), 0),
        (".r.html.hemicube-tmp", "report m room.obj -o r.html".into(), 0),
        (".p.png.hemicube-tmp", "view sparsity m -o p.png".into(), 0),
        (".g.obj.hemicube-tmp", "generate maze --patches 100 -o g.obj".into(), 0),
        (".q.csv.hemicube-tmp", "solve m --materials mat.toml -o q.csv".into(), 0),
        (".c.svg.hemicube-tmp", "compare m m -o c.svg".into(), 0),
        (".e.npz.hemicube-tmp", "export m -o e.npz".into(), 0),
        (
            "progress.json.hemicube-tmp",
            format!("{COMPUTE} -o o --progress-file progress.json"),
            0,
        ),
    ];
    for (name, line, code) in &lines {
        for hard in [false, true] {
            std::fs::write(&precious, "precious").expect("a file");
            let link = place.path(name);
            let _ = std::fs::remove_file(&link);
            if hard {
                std::fs::hard_link(&precious, &link).expect("a link");
            } else {
                symlink(&precious, &link).expect("a link");
            }
            let line = if hard && !line.starts_with("compute") && !line.contains("check") {
                format!("{line} --overwrite").replace("solve m", "solve m --solution again")
            } else {
                line.clone()
            };
            place.line(&line).is(*code);
            assert_eq!(std::fs::read(&precious).expect("a file"), b"precious", "{name}: {line}");
            let _ = std::fs::remove_file(&link);
        }
    }
    // Nothing is left of temporary files, and what a killed run left goes with the next.
    let left = |place: &Place| {
        files(&place.path(""))
            .into_keys()
            .filter(|name| name.contains("hemicube-tmp"))
            .count()
    };
    assert_eq!(left(&place), 0);
    write(&place, ".e.npz.aaaaaaaaaa.hemicube-tmp", "left by a killed run");
    write(&place, ".e.npz.mine.hemicube-tmp", "not of our kind");
    place.line("export m -o e.npz --overwrite").is(0);
    assert_eq!(left(&place), 1);
}

#[test]
fn outputs_are_no_inputs_lie_in_no_matrix_and_replace_nothing_unasked() {
    let place = room();
    std::fs::hard_link(place.path("room.obj"), place.path("same.json")).expect("a link");
    std::fs::hard_link(place.path("m/patches.npz"), place.path("part.csv")).expect("a link");
    symlink(place.path("m"), place.path("linked")).expect("a link");
    write(&place, "mine.png", "mine");
    write(&place, "mine.json", "mine");
    write(&place, "mine.svg", "mine");
    write(&place, "mine.csv", "mine");
    write(&place, "mine.html", "mine");
    write(&place, "f/parts/part-00000.npz", "mine");
    let compute = "compute room.obj -o n --config=none";
    let before = files(&place.path(""));
    for (line, words) in [
        ("solve m --materials mat.toml -o x.csv -o x.csv", "and so would"),
        (&format!("{compute} --progress-file room.obj"), "is to be read"),
        (&format!("{compute} --progress-file ./m/../room.obj"), "is to be read"),
        (&format!("{compute} --progress-file same.json"), "is to be read"),
        (
            &format!("{compute} --progress-file mine.json"),
            "is no progress file of hemicube's",
        ),
        (
            &format!("{compute} --progress-file n/manifest.json"),
            "lies in the directory of the matrix `n`",
        ),
        ("compute room.obj -o f --config=none", "is no part of a matrix"),
        (
            "solve m --materials mat.toml -o m/patches.npz",
            "lies in the directory of the matrix",
        ),
        (
            "solve m --materials mat.toml -o m/patches.npz --overwrite",
            "lies in the directory of the matrix",
        ),
        (
            "solve m --materials mat.toml -o part.csv --overwrite",
            "lies in the directory of the matrix",
        ),
        ("solve m --materials mat.toml -o mine.csv", "exists"),
        ("export m -o linked/new.csv", "lies in the directory of the matrix"),
        (
            "export m -o m/patches.npz --overwrite",
            "lies in the directory of the matrix",
        ),
        ("export m -o mine.csv", "exists"),
        ("export m -o room.glb --scene room.glb --overwrite", "is to be read"),
        ("report m room.obj -o mine.html", "exists"),
        (
            "report m room.obj -o m/page.html",
            "lies in the directory of the matrix",
        ),
        ("view sparsity m -o mine.png", "exists"),
        ("view model m room.obj --show seen -o mine.png", "exists"),
        ("view hemicube room.obj --patch 1 -o mine.png", "exists"),
        ("compare m m -o mine.svg", "exists"),
        (
            "compare m m -o m/x.svg --overwrite",
            "lies in the directory of the matrix",
        ),
        ("tradeoff room.obj -o mine.svg", "exists"),
        ("balance m -o m/b --closure", "lies in the directory of the matrix"),
        (
            "balance m -o m --closure --overwrite",
            "lies in the directory of the matrix",
        ),
        ("generate maze -o room.obj", "exists"),
    ] {
        let ran = place.line(line).is(2).says(&[words]);
        assert_eq!(ran.err.matches("error: ").count(), 1, "{line}: {}", ran.err);
        assert!(before == files(&place.path("")), "`{line}` changed something");
    }
    // With leave they are written.
    for line in [
        "report m room.obj -o mine.html --overwrite",
        "view sparsity m -o mine.png --overwrite",
        "compare m m -o mine.svg --overwrite",
        "solve m --materials mat.toml -o mine.csv --overwrite",
        "sky room.obj --up z -o s --resolution 32",
        "sky room.obj --up z -o s --resolution 32 --overwrite",
    ] {
        place.line(line).is(0);
    }
    place
        .line("sky room.obj --up z -o s --resolution 32")
        .is(2)
        .says(&["s/sky.npz` exists"]);
    place.line("check m").is(0);
}

#[test]
fn what_is_no_regular_file_is_refused_at_once() {
    let place = room();
    let fifo = |name: &str| {
        let path = place.path(name);
        let _ = std::fs::remove_file(&path);
        let made = Command::new("mkfifo").arg(&path).status().expect("mkfifo");
        assert!(made.success());
    };
    for name in [
        "s.obj", "s.gltf", "s.ac", "s.stl", "s.ply", "s.vs3", "s.json", "m.mtx", "m.npz", "m.npy", "c.toml",
    ] {
        fifo(name);
    }
    symlink("/dev/zero", place.path("zero.obj")).expect("a link");
    symlink("/dev/zero", place.path("zero.toml")).expect("a link");
    let copied = |name: &str, file: &str| {
        place.line(&format!("{COMPUTE} -o {name}")).is(0);
        place.line(&format!("solve {name} --materials mat.toml -q")).is(0);
        fifo(&format!("{name}/{file}"));
    };
    copied("a", "manifest.json");
    copied("b", "parts/part-00000.npz");
    copied("d", "patches.npz");
    copied("e", "solutions/radiosity/solution.json");
    copied("g", "solutions/radiosity/radiosity.npy");
    let mut lines: Vec<String> = ["obj", "gltf", "ac", "stl", "ply", "vs3", "json"]
        .map(|extension| format!("inspect s.{extension}"))
        .to_vec();
    for store in ["a", "b", "d"] {
        lines.extend([
            format!("check {store}"),
            format!("export {store} -o x.npz --overwrite"),
            format!("compare {store} m"),
            format!("solve {store} --materials mat.toml"),
            format!("report {store} room.obj -o x.html --overwrite"),
            format!("view sparsity {store} -o x.png --overwrite"),
            format!("balance {store} -o x --closure"),
            format!("merge x2-{store} {store}"),
        ]);
    }
    lines.extend(
        [
            "inspect zero.obj",
            "compute s.obj -o x3",
            "compare m.mtx m",
            "compare m.npz m",
            "compare m m.npy",
            "compute room.obj -o x4 --config c.toml",
            "compute room.obj -o x4 --config zero.toml",
            "solve m --materials c.toml",
            "solve m --materials zero.toml",
            "solve m --scene s.obj",
            "solve m --materials mat.toml --emission m.npy",
            "sky room.obj --up z -o x5 --points c.toml",
            "sky room.obj --up z -o x5 --suns zero.toml",
            "view model e room.obj --show radiosity -o x.png --overwrite",
            "view model g room.obj --show radiosity -o x.png --overwrite",
            "view3d s.vs3 x.vf",
            "view3d /dev/zero x.vf",
        ]
        .map(str::to_owned),
    );
    for line in &lines {
        let ran = at_once(&place, line);
        assert!(matches!(ran.code, Some(1 | 2)), "`{line}`: {:?} {}", ran.code, ran.err);
    }
    // The folder's own settings, too.
    fifo("hemicube.toml");
    at_once(&place, "inspect room.obj")
        .is(2)
        .says(&["hemicube.toml", "pipe"]);
}

/// A scene with nodes that place a mesh of `count` corners; of three those in `uri`, of more the first again and again.
fn gltf(uri: &str, nodes: usize, count: usize) -> String {
    let nodes: Vec<_> = (0..nodes).map(|_| json!({ "mesh": 0 })).collect();
    let primitive = match count {
        3 => json!({ "attributes": { "POSITION": 0 } }),
        _ => json!({ "attributes": { "POSITION": 0 }, "indices": 1 }),
    };
    json!({
        "asset": { "version": "2.0" }, "nodes": nodes,
        "meshes": [{ "primitives": [primitive] }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3" },
            { "componentType": 5121, "count": count, "type": "SCALAR" },
        ],
        "bufferViews": [{ "buffer": 0, "byteLength": 36 }],
        "buffers": [{ "byteLength": 36, "uri": uri }],
    })
    .to_string()
}

/// A buffer of one triangle's corners.
fn corners() -> Vec<u8> {
    let coordinates = [0f32, 0., 0., 1., 0., 0., 0., 1., 0.];
    coordinates.iter().flat_map(|x| x.to_le_bytes()).collect()
}

#[test]
fn a_scene_names_files_of_its_own_folder_only() {
    let place = Place::new();
    let corners = corners();
    write(&place, "secret", [&corners[..], b"secret"].concat());
    write(&place, "scene/sub/own.bin", &corners);
    symlink(place.path("secret"), place.path("scene/out.bin")).expect("a link");
    symlink("sub/own.bin", place.path("scene/in.bin")).expect("a link");
    let whole = place.path("secret").display().to_string();
    let percent = whole.replace('/', "%2F");
    for (uri, words) in [
        (percent.as_str(), "absolute address"),
        (whole.as_str(), "absolute address"),
        (&format!("file://{whole}"), "absolute address"),
        (&format!("%66ile:%2F%2F{whole}"), "absolute address"),
        ("../secret", "leads out of the scene's folder"),
        ("%2E%2E%2Fsecret", "leads out of the scene's folder"),
        ("sub/..%2f../secret", "leads out of the scene's folder"),
        ("out.bin", "leads out of the scene's folder"),
    ] {
        write(&place, "scene/s.gltf", gltf(uri, 1, 3));
        place.line("inspect scene/s.gltf").is(2).says(&[words, "put"]);
    }
    for uri in ["sub/own.bin", "sub%2Fown.bin", "./sub/../sub/own.bin", "in.bin"] {
        write(&place, "scene/s.gltf", gltf(uri, 1, 3));
        place
            .line("compute scene/s.gltf -o m --overwrite --two-sided on -q")
            .is(0);
    }
    // Files that an input file of CalculiX includes.
    let shell = "1,0,0,0\n2,4,0,0\n3,4,3,0\n";
    write(&place, "outside.inp", shell);
    write(&place, "scene/sub/nodes.inp", shell);
    symlink(place.path("outside.inp"), place.path("scene/link.inp")).expect("a link");
    let whole = place.path("outside.inp").display().to_string();
    for (name, is_read) in [
        (whole.as_str(), false),
        ("../outside.inp", false),
        ("..\\outside.inp", false),
        ("link.inp", false),
        ("sub/../../outside.inp", false),
        ("sub/nodes.inp", true),
        ("sub\\nodes.inp", true),
    ] {
        for include in ["*NODE\n*INCLUDE, INPUT=", "*NODE, INPUT="] {
            let text = format!("{include}{name}\n*ELEMENT, TYPE=S3\n1, 1, 2, 3\n");
            write(&place, "scene/s.inp", text);
            let ran = at_once(&place, "inspect scene/s.inp");
            if is_read {
                ran.is(0);
            } else {
                ran.is(2).says(&["scene/s.inp:", "leads out of the scene's folder"]);
            }
        }
    }
    // A library of materials is not worth an error: it is left out, and said.
    write(&place, "library.mtl", "newmtl a\nKd 0.25 0.25 0.25\n");
    for (name, is_read) in [("../library.mtl", false), ("own.mtl", true)] {
        write(&place, "scene/own.mtl", "newmtl a\nKd 0.25 0.25 0.25\n");
        let text = format!("mtllib {name}\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 1\nf 1 2 3\nf 2 1 4\n");
        write(&place, "scene/s.obj", text);
        place
            .line("compute scene/s.obj -o m --overwrite --two-sided on -q")
            .is(0);
        let ran = place.line("solve m --scene scene/s.obj");
        assert_eq!(
            !ran.err.contains("no reflectance is known"),
            is_read,
            "{name}: {}",
            ran.err
        );
    }
}

#[test]
fn copies_and_cuts_are_bounded_by_what_the_files_and_the_memory_are() {
    let place = Place::new();
    let corners = corners();
    write(&place, "own.bin", &corners);
    write(&place, "copies.gltf", gltf("own.bin", 200, 300_000));
    place
        .line("inspect copies.gltf")
        .is(2)
        .says(&["20000000 triangles", "may become 1000000", "--allow-large"]);
    let instance =
        json!({ "type": "X", "geometry": [{ "type": "GeometryInstance", "template": 0, "boundaries": [0] }] });
    let objects: serde_json::Map<_, _> = (0..1500).map(|n| (format!("o{n}"), instance.clone())).collect();
    let ring = json!([[0, 1, 2]]);
    let city = json!({
        "type": "CityJSON", "version": "2.0", "CityObjects": objects, "vertices": [[0, 0, 0]],
        "geometry-templates": {
            "templates": [{ "type": "MultiSurface", "lod": "2", "boundaries": vec![ring; 1000] }],
            "vertices-templates": [[0, 0, 0], [1, 0, 0], [0, 1, 0]],
        },
    });
    write(&place, "copies.json", city.to_string());
    place
        .line("inspect copies.json")
        .is(2)
        .says(&["may become 1000000", "--allow-large"]);
    // Holes that cross: earcut takes time by the cube of them.
    let mut rings = vec![json!([0, 1, 2, 3])];
    let mut vertices = vec![
        json!([0, 0, 0]),
        json!([9999, 0, 0]),
        json!([9999, 9999, 0]),
        json!([0, 9999, 0]),
    ];
    for k in 0..20_000_usize {
        let (x, y) = (k * 7919 % 9900 + 1, k * 104_729 % 9900 + 1);
        rings.push(json!([vertices.len(), vertices.len() + 1, vertices.len() + 2]));
        vertices.extend([json!([x, y, 0]), json!([x + 60, y, 0]), json!([x, y + 60, 0])]);
    }
    let city = json!({
        "type": "CityJSON", "version": "2.0", "vertices": vertices,
        "CityObjects": { "o": { "type": "X", "geometry": [{ "type": "MultiSurface", "lod": "2", "boundaries": [rings] }] } },
    });
    write(&place, "holes.json", city.to_string());
    at_once(&place, "inspect holes.json")
        .is(2)
        .says(&["with holes has 60004 corners", "--allow-large"]);

    copies_of_instances_and_sets(&place);

    place.line("generate room --patches 40 -o room.obj -q").is(0);
    let (over, finest) = (
        "`--memory` of 300 MB: `room.obj` would be",
        "is the finest that surely fits",
    );
    for (cut, within) in [("--split 300", "--split"), ("--patch-size 1", "--patch-size")] {
        let ran = at_once(&place, &format!("{COMPUTE} {cut} --memory 300M -o n"));
        let ran = ran.is(2).says(&[over, finest]);
        // The setting that the error names does fit.
        let hint = ran
            .err
            .lines()
            .find_map(|line| line.strip_prefix("hint: `"))
            .expect("a hint");
        let named = hint.split('`').next().expect("a setting");
        assert!(named.starts_with(within), "{hint}");
        assert!(!place.path("n").exists(), "nothing is left of it");
    }
    // Every command counts first, by what it does with the patches.
    for command in [
        "compute room.obj -o n",
        "inspect room.obj",
        "tradeoff room.obj",
        "sky room.obj --up y -o n",
        "view hemicube room.obj --patch 0 -o n.png",
    ] {
        for cut in ["--split 256", "--split 300", "--patch-size 1"] {
            at_once(&place, &format!("{command} {cut} --memory 60M")).is(2).says(&[
                "`--memory` of 60",
                "may take",
                "hint: `--",
                "allows it",
            ]);
        }
    }
    let ran = place.line(&format!("{COMPUTE} --split 256 --memory 100M -o n")).is(2);
    let hint = ran
        .err
        .lines()
        .find_map(|line| line.strip_prefix("hint: `"))
        .expect("a hint");
    let named = hint.split('`').next().expect("a setting");
    place
        .line(&format!(
            "{COMPUTE} {named} --rows 0..16 --threads 1 --memory 100M -o n"
        ))
        .is(0);
}

/// Readers, images, pictures, sky and tables ask one budget, whatever the command.
#[cfg(target_os = "linux")]
#[test]
fn memory_is_asked_for_before_it_is_taken() {
    let place = Place::new();
    place.line("generate soup --patches 60000 -o soup.obj -q").is(0);
    place.write("points.txt", "0 0 1 0 0 1\n");
    for command in [
        "compute soup.obj -o n",
        "inspect soup.obj",
        "tradeoff soup.obj",
        "sky soup.obj --up z -o n",
        "points soup.obj --up z --points points.txt",
        "view hemicube soup.obj --patch 0 -o n.png",
    ] {
        let ran = at_once(&place, &format!("{command} --memory 40M")).is(2);
        ran.says(&[
            "soup.obj: reading it takes ",
            " of the 40.0 MB allowed are left",
            "allows it",
        ]);
        if command.starts_with("view") {
            continue;
        }
        // It is read, and its patches take more than a picture of one.
        let ran = at_once(&place, &format!("{command} --memory 90M")).is(2);
        match command.starts_with("points") {
            true => ran.says(&[
                "keeping more rows takes ",
                " of the 90.0 MB allowed are left",
                "fewer points",
            ]),
            false => ran.says(&["`--memory` of 90.0 MB: `soup.obj` would be 60,0", "allows it"]),
        };
    }
    // What the error names is enough.
    let ran = place
        .line(&format!("{COMPUTE} -o n --memory 14M").replace("room", "soup"))
        .is(2);
    let named = ran
        .err
        .split('`')
        .find(|part| part.starts_with("--memory ") && part.ends_with('M'));
    let named = named.expect("the memory that allows it").to_owned();
    assert!(
        !at_once(&place, &format!("inspect soup.obj {named}"))
            .err
            .contains("reading it")
    );

    place.line("generate room --patches 40 -o room.obj -q").is(0);
    place
        .line("compute room.obj -o n --symmetry x=0 --periodic y=0..600 --repeats 1000 --memory 60M")
        .is(2)
        .says(&["images of", "takes", "give fewer repeats"]);
    place.write("suns.txt", "0 0 1\n".repeat(300_000));
    place
        .line("sky room.obj --up y -o n --suns suns.txt --memory 90M")
        .is(2)
        .says(&["of the sky takes", "fewer suns"]);
    // Where nothing is said, the limit of addresses holds.
    place.line(&format!("{COMPUTE} -o m")).is(0);
    place.write("mat.toml", "[default]\nreflectance = 0.5\nemission = 1\n");
    place.line("solve m --materials mat.toml -q").is(0);
    let script = "ulimit -v 500000; exec \"$0\" view model m room.obj --size 4096x4096 -o n.png";
    let mut command = Command::new("bash");
    command.args(["-c", script]).arg(program()).current_dir(place.path("."));
    let ran = Ran::from(command.output().expect("bash runs")).is(2);
    ran.says(&[
        "a picture of this size takes",
        "of memory are free",
        "`--size` makes a smaller one",
    ]);
    assert!(
        !place.path("n").exists() && !place.path("n.png").exists(),
        "nothing is left of it"
    );
}

/// Two walls with a hundred panes between them, a box all of panes, and a room whose floor and ceiling are mirrors.
fn portal_scenes() -> [(&'static str, String, &'static str); 3] {
    let quad = |name: &str, corners: [[f64; 3]; 4]| {
        let vertices = corners.map(|[x, y, z]| format!("v {x} {y} {z}\n")).concat();
        format!("o {name}\n{vertices}f -4 -3 -2 -1\n")
    };
    let across = |x: f64| [[x, 0.0, 0.0], [x, 1.0, 0.0], [x, 1.0, 1.0], [x, 0.0, 1.0]];
    let back = "f -1 -2 -3 -4\n";
    let panes = (1..=100).map(|at| quad(&format!("pane{at}"), across(0.1 * f64::from(at))) + back);
    let mut far = across(10.1);
    far.reverse();
    let row = quad("near", across(0.0)) + &quad("far", far) + &panes.collect::<String>();
    let sides = box_inside(DVec3::splat(4.0)).map(|side| side.map(|corner| corner.to_array()));
    let low = [[1.0, 1.0, 1.0], [2.0, 1.0, 1.0], [2.0, 2.0, 1.0], [1.0, 2.0, 1.0]];
    let table = quad("table", low);
    let walls = (0..).zip(sides);
    let all = walls
        .clone()
        .map(|(at, side)| quad(&format!("pane{at}"), side) + back)
        .collect::<String>();
    let mirrors = walls.map(|(at, side)| {
        let is_level = side.iter().all(|corner| corner[2] == side[0][2]);
        quad(&format!("{}{at}", if is_level { "mirror" } else { "wall" }), side)
    });
    let pane = "[object.\"pane*\"]\ntransmittance = 0.8\nspecular = 0.1\n";
    [
        ("row", row, pane),
        ("box", all + &table, pane),
        (
            "facing",
            mirrors.collect::<String>() + &table,
            "[object.\"mirror*\"]\nspecular = 0.9999\n",
        ),
    ]
}

/// The work of a row has a bound with portals too, and what is cut off there is said.
#[test]
fn rows_through_a_hundred_panes_end_at_their_bound() {
    /// Three times the steps that the dearest takes: the row of panes at 1 %, with its calibration. A choice; without the
    /// bound no row ends within a minute.
    const MOST: u64 = 2_000_000_000;
    let place = Place::new();
    for (name, scene, optics) in portal_scenes() {
        write(&place, &format!("{name}.obj"), scene);
        write(&place, &format!("{name}.toml"), optics);
        for level in ["--correction pixel", "", "--tolerance 1%"] {
            let line =
                format!("compute {name}.obj --specular {name}.toml -o m --overwrite --config none --rows 4 {level}");
            let ran = place.line(&format!("{line} --json")).is(0);
            let found = ran.json();
            let steps = found["steps"].as_u64().expect("a number");
            assert!(steps < MOST, "{name} {level}: {steps} steps");
            // What is cut off is a share of its own, so that rows close.
            let closure = found["closure"].as_f64().expect("a number");
            assert!(closure < 0.02, "{name} {level}: {closure}");
            if name == "row" {
                let cut = found["cut_off"][0].as_f64().expect("a share");
                assert!((0.001..0.1).contains(&cut), "{name} {level}: {cut}");
                let said = place.line(&line).is(0);
                assert!(said.out.contains("cut off behind mirrors and panes"), "{}", said.out);
            }
        }
    }
}

/// Files of kilobytes that would take gigabytes or minutes are refused by what they say, in seconds and little memory.
#[cfg(target_os = "linux")]
#[test]
fn what_copies_hold_and_cost_is_bounded_before_it_is_taken() {
    are_refused(&[
        ("long.inp", "bytes by copies"),
        ("nodes.inp", "bytes by copies"),
        ("surfaces.inp", "place fewer copies"),
        ("fill.inp", "a step from 1 on is needed"),
        ("attributes.gbxml", "more than 1000 attributes"),
        ("shared.vtu", "bytes by copies"),
        ("sections.inp", "take too long"),
    ]);
}

#[cfg(target_os = "linux")]
#[test]
#[ignore = "each takes as long as it may, some ten seconds: ./test --full"]
fn what_copies_take_is_bounded() {
    are_refused(&[
        ("generated.inp", "take too long"),
        ("template.city.json", "would take too long"),
    ]);
}

/// Inspects files that hold little and make much, in bounded memory and time, and finds these words in what is said.
#[cfg(target_os = "linux")]
fn are_refused(files: &[(&str, &str)]) {
    let place = Place::new();
    let part = |inside: &str| {
        format!(
            "*PART,NAME=P\n*NODE\n1,0,0,0\n2,1,0,0\n3,0,1,0\n*ELEMENT,TYPE=S3,ELSET=S\n1,1,2,3\n{inside}*END PART\n"
        )
    };
    let instances: String = (0..20_000)
        .map(|n| format!("*INSTANCE,NAME=I{n},PART=P\n*END INSTANCE\n"))
        .collect();
    let assembly = |part: String| format!("{part}*ASSEMBLY,NAME=A\n{instances}*END ASSEMBLY\n");
    let nodes: String = (4..50_004).map(|n| format!("{n},{},0,0\n", n % 7)).collect();
    let many = |of: &dyn Fn(usize) -> String| (0..20_000).map(of).collect::<String>();
    write(
        &place,
        "long.inp",
        assembly(part("").replace("ELSET=S", &format!("ELSET={}", "N".repeat(70_000)))),
    );
    write(
        &place,
        "nodes.inp",
        assembly(part("").replace("*ELEMENT", &format!("{nodes}*ELEMENT"))),
    );
    write(
        &place,
        "surfaces.inp",
        assembly(part(&many(&|n| format!("*SURFACE,NAME=F{n}\nS,SPOS\n")))),
    );
    write(
        &place,
        "sections.inp",
        assembly(part(&many(&|n| format!("*SHELL SECTION,ELSET=S,MATERIAL=M{n}\n1.\n")))),
    );
    write(
        &place,
        "fill.inp",
        "*NODE,NSET=A\n1,0,0,0\n*NODE,NSET=B\n2,1,0,0\n*NFILL\nA,B,4000000000,0\n*ELEMENT,TYPE=S3\n1,1,2,2\n",
    );
    let generated = "*NGEN\n1,900001,1\n".repeat(100);
    write(
        &place,
        "generated.inp",
        format!("*NODE\n1,0,0,0\n900001,1,0,0\n{generated}"),
    );
    let attributes: String = (0..100_000).map(|n| format!(" a{n}='1'")).collect();
    write(&place, "attributes.gbxml", format!("<gbXML{attributes}></gbXML>"));
    let template = json!({ "type": "MultiSurface", "lod": "1", "boundaries": vec![json!([]); 200_000] });
    let instance =
        json!({ "type": "X", "geometry": [{ "type": "GeometryInstance", "template": 0, "boundaries": [0] }] });
    let objects: serde_json::Map<_, _> = (0..20_000).map(|n| (format!("o{n}"), instance.clone())).collect();
    let city = json!({
        "type": "CityJSON", "version": "2.0", "CityObjects": objects, "vertices": [[0, 0, 0]],
        "geometry-templates": { "templates": [template], "vertices-templates": [[0, 0, 0]] },
    });
    write(&place, "template.city.json", city.to_string());
    write(&place, "shared.vtu", shared_arrays(2000, 20_000));
    for (name, says) in files {
        // Kilobytes of address space, and seconds of the processor.
        let script = format!("ulimit -v 2500000; ulimit -t 40; exec \"$0\" inspect {name}",);
        let mut command = Command::new("bash");
        command
            .args(["-c", &script])
            .arg(program())
            .current_dir(place.path("."));
        let ran = Ran::from(command.output().expect("bash runs"));
        assert_eq!(ran.code, Some(2), "{name}: {}", ran.err);
        assert!(ran.err.contains(says), "{name}: {}", ran.err);
    }
}

/// A file of pieces that share one array each of points, corners, ends and kinds, of `triangles`.
fn shared_arrays(pieces: usize, triangles: u32) -> Vec<u8> {
    let mut points = Vec::new();
    for k in 0..triangles {
        let x = f32::from(u16::try_from(k % 1000).expect("less than a thousand"));
        points.extend(
            [[x, 0.0, 0.0], [x + 1.0, 0.0, 0.0], [x, 1.0, 0.0f32]]
                .as_flattened()
                .iter()
                .flat_map(|c| c.to_le_bytes()),
        );
    }
    let corners: Vec<u8> = (0..3 * triangles).flat_map(u32::to_le_bytes).collect();
    let ends: Vec<u8> = (1..=triangles).flat_map(|k| (3 * k).to_le_bytes()).collect();
    let kinds = vec![5; triangles as usize];
    let (mut data, mut at) = (Vec::new(), Vec::new());
    for array in [points, corners, ends, kinds] {
        at.push(data.len());
        data.extend(u32::try_from(array.len()).expect("short").to_le_bytes());
        data.extend(array);
    }
    let array = |rest: &str, offset: usize| format!("<DataArray {rest} format='appended' offset='{offset}'/>");
    let piece = format!(
        "<Piece NumberOfPoints='{}' NumberOfCells='{triangles}'><Points>{}</Points><Cells>{}{}{}</Cells></Piece>",
        3 * triangles,
        array("type='Float32' NumberOfComponents='3'", at[0]),
        array("type='Int32' Name='connectivity'", at[1]),
        array("type='Int32' Name='offsets'", at[2]),
        array("type='UInt8' Name='types'", at[3]),
    );
    let mut file =
        b"<VTKFile type='UnstructuredGrid' version='0.1' byte_order='LittleEndian'><UnstructuredGrid>".to_vec();
    file.extend(piece.repeat(pieces).into_bytes());
    file.extend(b"</UnstructuredGrid><AppendedData encoding='raw'>_");
    file.extend(data);
    file.extend(b"</AppendedData></VTKFile>");
    file
}

/// Instances of a part, and very many sets of very many elements.
fn copies_of_instances_and_sets(place: &Place) {
    let mut text = "*PART, NAME=P\n*NODE\n1,0,0,0\n2,1,0,0\n3,0,1,0\n*ELEMENT, TYPE=S3\n".to_owned();
    (1..=3000).for_each(|at| text += &format!("{at},1,2,3\n"));
    text += "*END PART\n";
    (0..1000).for_each(|at| text += &format!("*INSTANCE,NAME={at},PART=P\n*END INSTANCE\n"));
    write(place, "copies.inp", text);
    at_once(place, "inspect copies.inp")
        .is(2)
        .says(&["3000000 triangles", "may become 1000000"]);

    let mut text = "*NODE\n1,0,0,0\n2,1,0,0\n3,0,1,0\n*ELEMENT, TYPE=S3\n".to_owned();
    (1..=20_000).for_each(|at| text += &format!("{at},1,2,3\n"));
    (0..20_000).for_each(|at| text += &format!("*ELSET, ELSET=s{at}, GENERATE\n1,19999\n"));
    write(place, "sets.inp", text);
    let ran = at_once(place, "inspect sets.inp");
    assert!(
        ran.code == Some(0) || ran.err.contains("take too long to be resolved"),
        "{}",
        ran.err
    );
}

#[test]
fn names_move_no_cursor_make_no_line_and_run_nothing() {
    let place = Place::new();
    let bad = "a\u{1b}]0;t\u{7}\u{9b}2J\u{202e}\nerror: made up";
    let unseen = |text: &str| text.chars().any(|c| c != '\n' && (c.is_control() || c == '\u{202e}'));
    let node = |name: &str, z: f64| json!({ "name": name, "mesh": 0, "translation": [0.0, 0.0, z] });
    let corners = corners();
    write(&place, "own.bin", corners);
    let names = [
        bad,
        "=cmd|' /C calc'!A0",
        "@SUM(1)",
        "+1+1",
        "-1+1",
        "-1.5",
        "plain",
        "\t=1",
        " =1",
    ];
    let mut scene: serde_json::Value = serde_json::from_str(&gltf("own.bin", 0, 3)).expect("JSON");
    scene["nodes"] = (0..).zip(names).map(|(z, name)| node(name, f64::from(z))).collect();
    scene["materials"] = json!([{ "name": bad }]);
    scene["meshes"][0]["primitives"][0]["material"] = json!(0);
    write(&place, "names.gltf", scene.to_string());
    place.line("compute names.gltf -o m --two-sided on -q").is(0);
    for line in [
        "inspect names.gltf",
        "inspect names.gltf --json",
        "solve m",
        "solve m --materials none.toml",
        "check m",
        "export m -o p.csv",
        "export m -o z.csv --by object",
        "compute names.gltf -o other --emitters nothing",
        "sky names.gltf --matrix m",
        "solve m --materials default.toml -o s.csv",
    ] {
        write(
            &place,
            "none.toml",
            "[\"x\\nerror: made up\\u001b\"]\nreflectance = 0.5\n",
        );
        write(&place, "default.toml", "[default]\nreflectance = 0.5\nemission = 1\n");
        let ran = place.line(line);
        for text in [&ran.out, &ran.err] {
            assert!(!unseen(text), "`{line}`: {text:?}");
            assert!(
                !text.lines().any(|line| line.starts_with("error: made up")),
                "`{line}`: {text}"
            );
        }
    }
    for file in ["p.csv", "z.csv", "s.csv"] {
        let text = std::fs::read_to_string(place.path(file)).expect("a table");
        assert!(!unseen(&text), "{file}: {text:?}");
        for cell in text.lines().flat_map(|line| line.split(',')) {
            let cell = cell.trim_matches('"').trim_start();
            let is_formula = cell.starts_with(['=', '+', '-', '@']) && cell.parse::<f64>().is_err();
            assert!(!is_formula, "{file}: {cell}");
        }
        assert!(
            text.contains("'=cmd|") && text.contains("-1.5") && !text.contains("'-1.5"),
            "{file}"
        );
    }
    // An error names what the file requires, in one line.
    write(
        &place,
        "e.gltf",
        json!({ "asset": { "version": "2.0" }, "extensionsRequired": [bad] }).to_string(),
    );
    let ran = place.line("inspect e.gltf").is(2);
    assert_eq!(ran.err.lines().count(), 1, "{}", ran.err);
    assert!(
        ran.err.contains("\\u{1b}]0;t\\u{7}\\u{9b}2J\\u{202e}\\nerror: made up"),
        "{}",
        ran.err
    );
}

#[test]
fn pages_name_no_folder_and_equal_matrices_give_equal_pages() {
    let place = room();
    place.line("solve m --materials mat.toml -q").is(0);
    place
        .line(&format!("{COMPUTE} -o deep/secret/n").replace("room.obj", "./room.obj"))
        .is(0);
    place.line("solve deep/secret/n --materials mat.toml -q").is(0);
    let whole = |name: &str| place.path(name).display().to_string();
    place
        .line(&format!("report {} {} -o a.html", whole("m"), whole("room.obj")))
        .is(0);
    place.line("report deep/secret/n room.obj -o b.html").is(0);
    let page = |name: &str| std::fs::read_to_string(place.path(name)).expect("a page");
    assert!(page("a.html") == page("b.html"), "equal matrices, other pages");
    assert!(!page("a.html").contains(&whole("")) && !page("b.html").contains("secret"));
}
