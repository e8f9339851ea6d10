//! Rows through portals against closed forms: mirrors and panes by unfolding, with images summed by the factor of
//! parallel rectangles; planes of symmetry, sectors and periods against the whole scene. And the laws: what is sent is
//! conserved to the last unit, A_i F^s_ij = A_j F^s_ji, what is cut off is said, other scenes keep their bytes.

#![cfg(unix)]

use hemicube::HierarchyOptions;
use hemicube::analysis::check::{Check, CheckOptions, check};
use hemicube::driver::input::SceneInput;
use hemicube::driver::job::{Job, Sessions};
use hemicube::portal::{Optics, Portals, Specular};
use hemicube::store::{Part, PatchTable, Store, StoreWriter};
use hemicube_backend_cpu::CpuBackend;
use hemicube_scene::Subdivision;
use hemicube_tests::geometry::{parallel_rectangles, parallel_rectangles_apart};
use hemicube_tests::rooms::{self, Quad, near, obj, room};
use hemicube_tests::runs::{Place, assert_same};
use std::fmt::Write;

fn without<'q>(quads: Vec<Quad<'q>>, names: &[&str]) -> Vec<Quad<'q>> {
    quads.into_iter().filter(|(name, _)| !names.contains(name)).collect()
}

/// Form factors between objects, and their shares by `escaped`, `blocked`, `unselected`.
struct Zones(rooms::Zones);

impl Zones {
    fn of(&self, from: &str, to: &str) -> f64 {
        rooms::of(&self.0, from, to)
    }
}

/// A folder with a scene.
struct Folder(Place);

impl Folder {
    fn new(quads: &[Quad<'_>], optics: &str) -> Self {
        let place = Place::new();
        place.write("scene.obj", obj(quads));
        place.write("optics.toml", optics);
        Self(place)
    }

    /// Computes and checks a store; its rows keep the laws.
    #[track_caller]
    fn compute(&self, settings: &str) -> Zones {
        self.0
            .line(&format!("compute scene.obj -o store --overwrite {settings}"))
            .is(0);
        let report = self.0.line("check store --json").is(0).json();
        assert_eq!(report["ok"], true, "{report}");
        Zones(rooms::zones(&self.0, "store"))
    }

    /// The report of a check.
    fn check(&self) -> serde_json::Value {
        self.0.line("check store --json").json()
    }
}

const MIRROR: &str = "[object.x1]\nspecular = 1\n";
const HALF: &str = "[material.x1]\nspecular = 0.5\n";
const EACH: [(&str, f64); 2] = [("--tolerance 0.1%", 1e-3), ("--tolerance 0.01%", 1e-4)];

#[test]
fn a_cube_with_a_mirror_has_the_rows_of_its_unfolding() {
    let place = Folder::new(&room(1., 1., 1.), MIRROR);
    for (settings, most) in EACH {
        let zones = place.compute(&format!("--specular optics.toml {settings}"));
        near(zones.of("bottom", "top"), 0.285_875_384_850_71, most);
        near(zones.of("bottom", "x0"), 0.232_852_602_795_36, most);
        near(zones.of("bottom", "y0"), 0.240_636_006_176_96, most);
        near(zones.of("bottom", "y1"), 0.240_636_006_176_96, most);
        near(zones.of("x0", "x0"), 0.068_589_588_818_55, most);
        near(zones.of("x0", "y1"), 0.232_852_602_795_36, most);
        near(zones.of("bottom", "x1"), 0.200_043_776_075_40, most);
        let reciprocity = place.check()["reciprocity"]["residual"].as_f64().expect("a number");
        assert!(reciprocity < 3.0 * most, "{reciprocity}");
    }
}

#[test]
fn half_a_mirror_keeps_the_other_half() {
    let place = Folder::new(&room(1., 1., 1.), HALF);
    for (settings, most) in EACH {
        let zones = place.compute(&format!("--specular optics.toml {settings}"));
        near(zones.of("bottom", "top"), 0.242_850_140_274_55, most);
        near(zones.of("bottom", "x0"), 0.216_448_189_435_38, most);
        near(zones.of("bottom", "y0"), 0.220_339_891_126_18, most);
        near(zones.of("x0", "x0"), 0.034_294_794_409_28, most);
        near(zones.of("bottom", "x1"), 0.200_043_776_075_40, most);
    }
}

/// Σ ρ^(|m| + |n|) F(offset m, n) between the ends of a square duct of that length.
fn duct(reflectance: f64, length: f64) -> f64 {
    let mut sum = 0.0;
    for m in -60i32..=60 {
        for n in -60i32..=60 {
            let weight = reflectance.powi(m.abs() + n.abs());
            if weight > 1e-12 {
                let (x, y) = (f64::from(m), f64::from(n));
                let to = [[x, x + 1.0], [y, y + 1.0]];
                sum += weight * parallel_rectangles_apart([[0.0, 1.0], [0.0, 1.0]], to, length);
            }
        }
    }
    sum
}

#[test]
fn a_duct_of_mirrors_is_the_sum_of_its_images() {
    let all = |reflectance: f64| {
        format!("[object.\"x*\"]\nspecular = {reflectance}\n[object.\"y*\"]\nspecular = {reflectance}\n")
    };
    near(duct(0.5, 1.0), 0.446_823_136_135, 1e-9);
    for (reflectance, exact) in [(0.5, duct(0.5, 1.0)), (0.9, 0.836_492_494_494)] {
        let place = Folder::new(&room(1., 1., 1.), &all(reflectance));
        let zones = place.compute("--specular optics.toml --tolerance 0.1% --emitters bottom");
        near(zones.of("bottom", "top"), exact, 1e-3);
    }
    for length in [1.0, 5.0] {
        let place = Folder::new(&room(1., 1., length), &all(1.0));
        let zones = place.compute("--specular optics.toml --emitters bottom --tolerance 0.1%");
        let report = place.check();
        let (mean, most) = (
            report["cut_off"].as_f64().expect("said"),
            report["cut_off_max"].as_f64().expect("said"),
        );
        // Nothing else takes anything: what does not arrive was cut off, and that is what the report says.
        near(zones.of("bottom", "top") + mean, 1.0, 1e-5);
        assert!(mean <= most && most < 1e-3, "{mean} {most}");
    }
    // Cut early, the report is as true.
    let place = Folder::new(&room(1., 1., 1.), &all(0.9));
    let zones = place.compute("--specular optics.toml --emitters bottom --specular-bound 0.5");
    let cut = place.check()["cut_off"].as_f64().expect("said");
    assert!(cut > 0.01, "{cut}");
    let kept = zones.of("bottom", "top")
        + 0.1
            * ["x0", "x1", "y0", "y1"]
                .iter()
                .map(|to| zones.of("bottom", to))
                .sum::<f64>();
    near(kept + cut, 1.0, 1e-3);
}

#[test]
fn two_facing_mirrors() {
    for (reflectance, ceiling, wall) in [
        (0.5, 0.294_595_182_671_41, 0.243_075_028_102_48),
        (0.9, 0.387_353_316_398_76, 0.282_144_275_005_37),
        (1.0, 2f64.sqrt() - 1.0, 1.0 - 0.5f64.sqrt()),
    ] {
        let place = Folder::new(
            &room(1., 1., 1.),
            &format!("[object.\"x*\"]\nspecular = {reflectance}\n"),
        );
        let zones = place.compute("--specular optics.toml --tolerance 0.1% --emitters bottom");
        near(zones.of("bottom", "top"), ceiling, 1e-3);
        near(zones.of("bottom", "y0"), wall, 1e-3);
    }
}

#[test]
fn a_mirror_of_half_the_height_shows_half_of_the_image() {
    let mut quads = without(room(1., 1., 1.), &["x0", "x1", "y0", "y1"]);
    quads.push(("x1", [[1., 0., 0.], [1., 0., 0.5], [1., 1., 0.5], [1., 1., 0.]]));
    let place = Folder::new(&quads, MIRROR);
    for (settings, most) in EACH {
        let zones = place.compute(&format!("--specular optics.toml {settings}"));
        near(zones.of("bottom", "top"), 0.242_850_140_274_55, most);
        near(zones.of("top", "bottom"), 0.242_850_140_274_55, most);
    }
}

#[test]
fn a_pane_lets_its_share_through_and_one_sided_panes_are_refused() {
    let mut quads = room(1., 1., 2.);
    quads.push(("pane", [[0., 0., 1.], [1., 0., 1.], [1., 1., 1.], [0., 1., 1.]]));
    let optics = "[object.pane]\ntransmittance = 0.5\nspecular = 0.1\n";
    let one_sided = Folder::new(&quads, optics);
    let refused = one_sided
        .0
        .line("compute scene.obj -o store --specular optics.toml")
        .is(2);
    refused.says(&["pane pane is one-sided"]);
    quads.push(("pane", [[0., 0., 1.], [0., 1., 1.], [1., 1., 1.], [1., 0., 1.]]));
    let place = Folder::new(&quads, optics);
    let zones = place.compute("--specular optics.toml --tolerance 0.1% --emitters bottom");
    near(zones.of("bottom", "top"), 0.5 * parallel_rectangles(1., 1., 2.), 1e-3);
    near(
        zones.of("bottom", "bottom"),
        0.1 * parallel_rectangles(1., 1., 2.),
        1e-3,
    );
    near(zones.of("bottom", "pane"), parallel_rectangles(1., 1., 1.), 1e-3);
}

#[test]
fn a_street_canyon_is_endless() {
    let canyon = |length: f64| without(room(1., length, 1.), &["top", "y0", "y1"]);
    for length in [1.0, 4.0] {
        let place = Folder::new(&canyon(length), "");
        for (settings, most) in EACH {
            let zones = place.compute(&format!("--periodic y=0..{length} {settings}"));
            let (across, along) = (2f64.sqrt() - 1.0, 1.0 - 0.5f64.sqrt());
            near(zones.of("bottom", "escaped"), across, most);
            near(zones.of("bottom", "x0"), along, most);
            near(zones.of("x0", "x1"), across, most);
            near(zones.of("x1", "bottom"), along, most);
            near(zones.of("x1", "escaped"), along, most);
            assert!(place.check()["cut_off_max"].as_f64().expect("said") < most);
        }
    }
}

#[test]
fn a_half_with_its_plane_of_symmetry_has_the_rows_of_the_whole() {
    // A box with a table in it that stands across the plane x = 1.
    let whole = |x: f64| {
        let mut quads = room(x, 1., 1.);
        let (low, high) = (0.7, x.min(1.3));
        quads.push((
            "table",
            [[low, 0.2, 0.4], [high, 0.2, 0.4], [high, 0.6, 0.4], [low, 0.6, 0.4]],
        ));
        quads.push((
            "under",
            [[low, 0.2, 0.4], [low, 0.6, 0.4], [high, 0.6, 0.4], [high, 0.2, 0.4]],
        ));
        quads
    };
    let place = Folder::new(&whole(2.0), "");
    let all = place.compute("--tolerance 0.1%");
    let half = Folder::new(&without(whole(1.0), &["x1"]), "");
    let zones = half.compute("--tolerance 0.1% --symmetry x=1");
    for (from, to) in [
        ("bottom", "top"),
        ("bottom", "y0"),
        ("table", "top"),
        ("under", "bottom"),
        ("top", "table"),
    ] {
        near(zones.of(from, to), all.of(from, to), 1e-3);
    }
    near(
        zones.of("x0", "x0"),
        0.5 * (all.of("x0", "x1") + all.of("x1", "x0")),
        1e-3,
    );
    half.0
        .line("compute scene.obj -o no --symmetry x=0.5")
        .is(2)
        .says(&["x = 0.5 is crossed", "cut it at the plane"]);
    half.0
        .line("compute scene.obj -o no --symmetry x=1,x=0")
        .is(2)
        .says(&["more than one of symmetry"]);
    half.0
        .line("compute scene.obj -o no --periodic x=0..1,y=0..1 --repeats 1000")
        .is(2)
        .says(&["give fewer repeats"]);
    half.0
        .line("compute scene.obj -o no --periodic x=0..0.5")
        .is(2)
        .says(&["out of its period"]);
}

#[test]
fn a_sector_has_the_rows_of_the_ring() {
    // Twelve walls of a prism, seen from within; the sector has one of them, and its part of the floor.
    let corner = |k: u32, z: f64| {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / 12.0).sin_cos();
        [cos, sin, z]
    };
    let mut text = String::from("o wall\n");
    for k in 0..12 {
        for [x, y, z] in [corner(k, 0.), corner(k, 1.), corner(k + 1, 1.), corner(k + 1, 0.)] {
            writeln!(text, "v {x} {y} {z}").expect("a string");
        }
    }
    let whole = |count: usize| {
        let faces: Vec<String> = (0..count)
            .map(|k| format!("f {} {} {} {}\n", 4 * k + 1, 4 * k + 2, 4 * k + 3, 4 * k + 4))
            .collect();
        text.clone() + &faces.concat()
    };
    let place = Place::new();
    place.write("ring.obj", whole(12));
    place.write("sector.obj", whole(1));
    let value = |line: &str, store: &str| {
        place.line(line).is(0);
        let found = place.line(&format!("check {store} --json")).is(0).json();
        assert_eq!(found["ok"], true, "{found}");
        found["escaped"].as_f64().expect("a number")
    };
    let ring = value("compute ring.obj -o ring --tolerance 0.1%", "ring");
    let sector = value("compute sector.obj -o sector --tolerance 0.1% --sector z,12", "sector");
    near(sector, ring, 1e-3);
    place
        .line("compute ring.obj -o no --sector z,12")
        .is(2)
        .says(&["of 12 sectors has 30"]);
}

#[test]
fn pixels_are_conserved_and_threads_and_shards_change_no_byte() {
    let place = Folder::new(
        &room(1., 1., 1.),
        "[object.\"x*\"]\nspecular = 0.7\ntransmittance = 0\n",
    );
    for settings in [
        "--correction pixel --samples 4 --resolution 32",
        "--tolerance 2%",
        "--tolerance 1%",
    ] {
        let line = format!("compute scene.obj --specular optics.toml --split 2 {settings}");
        place.0.line(&format!("{line} -o one --threads 1 --overwrite")).is(0);
        place
            .0
            .line(&format!("{line} -o two --threads 2 --batch 3 --overwrite"))
            .is(0);
        assert_same(&place.0.path("one"), &place.0.path("two"));
        // `check` adds up the weights of every row, in whole numbers.
        let report = place.0.line("check one --json").is(0).json();
        assert_eq!(report["ok"], true, "{report}");
        let sums = &report["sums"];
        let total: u64 = ["visible", "escaped", "blocked", "unselected"]
            .iter()
            .map(|of| sums[of].as_u64().expect("whole"))
            .sum();
        assert_eq!(total % (1 << 31), 0);
        std::fs::remove_dir_all(place.0.path("two")).expect("a store");
        for shard in ["1/2", "2/2"] {
            place.0.line(&format!("{line} -o two --shard {shard}")).is(0);
        }
        place.0.line("merge two").is(0);
        assert_same(&place.0.path("one"), &place.0.path("two"));
        std::fs::remove_dir_all(place.0.path("two")).expect("a store");
    }
}

#[test]
fn what_is_not_there_yet_is_refused_by_name() {
    let place = Folder::new(&room(1., 1., 1.), MIRROR);
    let refused = |line: &str, words: &[&str]| {
        place
            .0
            .line(&format!(
                "compute scene.obj -o no --overwrite --specular optics.toml {line}"
            ))
            .is(2)
            .says(words);
    };
    refused("--receivers top", &["mirrors and panes need columns"]);
    place
        .0
        .write("optics.toml", "[object.x1]\nspecular = 0.7\ntransmittance = 0.7\n");
    refused("", &["object x1 has ρs 0.7 and τ 0.7"]);
    place
        .0
        .write("optics.toml", "[object.x1]\nspecular = 0.7\nroughness = 1\n");
    refused("", &["optics.toml:3", "roughness"]);
    place.0.write("optics.toml", "[object.x9]\nspecular = 0.7\n");
    refused("", &["`[object.\"x9\"]` matches no object"]);
    place.0.write("optics.toml", "bands = [\"light\"]\n");
    refused("", &["no patch of the scene is a mirror or a pane"]);
}

/// A checker that cannot fail holds nothing: rows that say that their mirrors handed on something else fail.
#[test]
fn a_row_that_hands_on_another_share_is_noticed() {
    let folder = Folder::new(&room(1., 1., 1.), HALF);
    let scene =
        hemicube_scene::load(&folder.0.path("scene.obj"), hemicube_scene::ReadOptions::default()).expect("a scene");
    let scene = SceneInput::new(scene, "scene.obj", Subdivision::None.into()).expect("a scene");
    let model = scene.model(HierarchyOptions::default()).expect("a model");
    let mirror = |name: &String| {
        (name == "x1").then_some(Optics {
            specular: 0.5,
            transmittance: 0.0,
        })
    };
    let objects: Vec<Option<Optics>> = scene.objects.iter().map(mirror).collect();
    let specular = Specular::new(&scene, model.patches(), &[], &objects, 1e-4).expect("a mirror");
    let portals = Portals {
        images: None,
        specular: Some(specular),
    };
    let job = Job {
        portals: portals.into(),
        ..Job::default()
    };
    let check_with = |change: f64| {
        let directory = folder.0.path(format!("store{change}"));
        let run = job
            .prepare(&scene, &model, Sessions::new(CpuBackend::new), &())
            .expect("a run");
        let header = run.settings.header(
            &scene,
            model.patches(),
            "scene.obj".as_ref(),
            &run.plan,
            run.backend().info(),
        );
        let mut writer = StoreWriter::create(
            &directory,
            header.expect("a header"),
            &PatchTable::new(&scene, model.patches()),
            false,
        )
        .expect("a store");
        let mut parts: Vec<Part> = Vec::new();
        run.compute(&mut parts, &()).expect("rows");
        for mut part in parts {
            part.passages[3].passed += change;
            writer.write_part(&part).expect("written");
        }
        writer.finish().expect("finished");
        check(&Store::open(&directory).expect("a store"), &CheckOptions::default()).expect("checked")
    };
    assert!(check_with(0.0).ok);
    let failures = check_with(0.01).failures;
    assert!(
        failures.iter().any(|failure| failure.check == Check::Passed),
        "{failures:?}"
    );
}
