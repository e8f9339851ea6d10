//! Mirrors, panes, bands, a plane of symmetry and a period in one run, against the whole scene, and beside runs without
//! any of them.

#![cfg(unix)]

use hemicube_tests::matrices::entries;
use hemicube_tests::rooms::{Corner, Quad, both_ways, closed, near, of, place, room, zones};
use hemicube_tests::runs::{Place, assert_same, files, finish, until};

/// Half a street of one metre and a room behind a window of its wall: the plane of symmetry is x = 1, the period from
/// y = 0 to 1. A tilted plate in the room is a mirror.
fn street() -> Vec<Quad<'static>> {
    let wall = |low: [f64; 2], high: [f64; 2]| -> [Corner; 4] {
        [
            [0., low[0], low[1]],
            [0., high[0], low[1]],
            [0., high[0], high[1]],
            [0., low[0], high[1]],
        ]
    };
    let mut quads: Vec<Quad<'static>> = vec![("street", [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]])];
    for (low, high) in [
        ([0., 0.], [1., 0.5]),
        ([0., 1.5], [1., 2.]),
        ([0., 0.5], [0.25, 1.5]),
        ([0.75, 0.5], [1., 1.5]),
    ] {
        let [outside, inside] = both_ways(("wall", wall(low, high)));
        quads.extend([outside, ("inside", inside.1)]);
    }
    quads.extend(both_ways(("glass", wall([0.25, 0.5], [0.75, 1.5]))));
    let plate = [[-0.6, 0.3, 0.6], [-0.4, 0.3, 0.6], [-0.4, 0.7, 1.], [-0.6, 0.7, 1.]];
    quads.extend(both_ways(("plate", plate)));
    let [bottom, top, back, ..] = room(1., 1., 2.)[..] else {
        unreachable!("six faces")
    };
    for (name, (_, corners)) in [("floor", bottom), ("ceiling", top), ("back", back)] {
        quads.push((name, corners.map(|[x, y, z]| [x - 1., y, z])));
    }
    quads
}

const OF_STREET: &str = "bands = [\"light\", \"heat\"]\n[object.\"glass*\"]\nspecular = [0.1, 0.3]\n\
                         transmittance = [0.8, 0]\n[object.\"plate*\"]\nspecular = [0.9, 0]\n\
                         [material.\"back*\"]\nspecular = [0.5, 0]\n";
const SYMMETRIC: &str = "--specular optics.toml --periodic y=0..1 --symmetry x=1 --up z";

/// A box with a pane across it: 16 triangles.
fn two_rooms() -> Vec<Quad<'static>> {
    let mut quads = room(2., 1., 1.);
    quads.extend(both_ways((
        "pane",
        [[1., 0., 0.], [1., 1., 0.], [1., 1., 1.], [1., 0., 1.]],
    )));
    quads
}

/// Optics of [`two_rooms`] for bands: two mirrors and the extinction of the pane for each, and a wall by a table of
/// angles. `list` writes the values of a key.
fn optics_of(values: &[[f64; 3]], list: impl Fn(Vec<f64>) -> String) -> String {
    let of = |key: usize| list(values.iter().map(|band| band[key]).collect());
    format!(
        "[object.x0]\nspecular = {}\n[object.x1]\nspecular = {}\n\
         [object.pane]\nindex = 1.5\nthickness = 0.01\nextinction = {}\n\
         [object.y1]\nangles = [[0, 0, 0.1], [60, 0, 0.3], [90, 0, 0.9]]\n",
        of(0),
        of(1),
        of(2),
    )
}

/// Bands that end at other depths, of other portals, in one group and in two, are each the matrix that it is alone, on
/// one thread and on two.
#[test]
fn bands_are_what_they_are_alone() {
    let values = [
        [0.5, 0.0, 1.0],
        [0.0, 0.2, 200.0],
        [0.8, 0.3, 0.0],
        [0.0, 0.0, 30.0],
        [0.1, 0.6, 1e4],
    ];
    let names = ["a", "b", "c", "d", "e"];
    let place = place(&two_rooms(), "");
    for count in [3, 5] {
        let optics = optics_of(&values[..count], |values| format!("{values:?}"));
        place.write(
            format!("of-{count}.toml"),
            format!("bands = {:?}\n{optics}", &names[..count]),
        );
    }
    for (name, values) in names.iter().zip(&values) {
        let optics = optics_of(std::slice::from_ref(values), |values| values[0].to_string());
        place.write(format!("alone-{name}.toml"), optics);
    }
    let parts = |store: String| files(&place.path(store).join("parts"));
    for level in ["--correction pixel --resolution 64", "", "--tolerance 1%"] {
        let line = |optics: String, rest: &str| {
            place
                .line(&format!(
                    "compute scene.obj --specular {optics}.toml {level} --overwrite {rest}"
                ))
                .is(0);
        };
        for name in names {
            line(format!("alone-{name}"), &format!("-o alone-{name} --threads 1"));
        }
        for (count, threads) in [(3, 1), (3, 2), (5, 2)] {
            line(format!("of-{count}"), &format!("-o of-{count} --threads {threads}"));
            for name in &names[..count] {
                let [together, alone] = [format!("of-{count}-{name}"), format!("alone-{name}")].map(parts);
                assert!(!alone.is_empty() && together == alone, "{level}, {count} bands, {name}");
            }
        }
    }
}

#[test]
fn everything_at_once_has_the_rows_of_the_whole() {
    let part = place(&street(), OF_STREET);
    let settings = "--by object --tolerance 1% --repeats 3";
    part.line(&format!("compute scene.obj {SYMMETRIC} {settings} -o part"))
        .is(0);
    let names: Vec<String> = street().iter().map(|(name, _)| format!("{name}_other")).collect();
    let mut whole: Vec<Quad<'_>> = Vec::new();
    for shift in [0, 1, -1, 2, -2, 3, -3].map(f64::from) {
        for ((name, corners), other) in street().into_iter().zip(names.iter().map(String::as_str)) {
            let corners = corners.map(|[x, y, z]| [x, y + shift, z]);
            let [a, b, c, d] = corners.map(|[x, y, z]| [2. - x, y, z]);
            let own = if shift.abs() < 0.5 { name } else { other };
            whole.extend([(own, corners), (other, [a, d, c, b])]);
        }
    }
    let whole = place(&whole, OF_STREET);
    let rows: String = ["street", "wall", "glass", "plate", "back", "inside"]
        .map(|name| format!(" --emitters {name}"))
        .concat();
    whole
        .line(&format!(
            "compute scene.obj --specular optics.toml --up z --by object --tolerance 1% {rows} -o whole"
        ))
        .is(0);
    for band in ["light", "heat"] {
        let report = part.line(&format!("check part-{band} --json")).is(0).json();
        assert_eq!(report["ok"], true, "{report}");
        let (one, all) = (
            zones(&part, &format!("part-{band}")),
            zones(&whole, &format!("whole-{band}")),
        );
        for from in ["street", "wall", "glass", "plate", "back", "inside"] {
            for to in ["street", "wall", "glass", "plate", "back", "inside", "ceiling"] {
                let sum = of(&all, from, to) + of(&all, from, &format!("{to}_other"));
                near(of(&one, from, to), sum, 0.01 * sum.max(1.0));
            }
        }
    }
}

/// A run through all of it that is killed, and goes on with other threads, ends in the stores of one that was not.
#[test]
#[ignore = "half a minute of processor time and more: ./test --full"]
fn everything_at_once_goes_on_after_a_kill() {
    let place = place(&street(), OF_STREET);
    for level in ["--correction pixel", "--tolerance 1%"] {
        let line = format!("compute scene.obj {SYMMETRIC} --split 3 --repeats 2 {level}");
        place.line(&format!("{line} -o whole --overwrite --threads 2")).is(0);
        let mut child = place.spawn(place.command(&format!("{line} -o killed --threads 1")));
        let parts = place.path("killed-light/parts");
        let is_written = || std::fs::read_dir(&parts).is_ok_and(|found| found.count() > 0);
        until("a part is written", || {
            is_written() || child.try_wait().expect("a child").is_some()
        });
        child.kill().expect("killed");
        finish(child);
        place.line(&format!("{line} -o killed --threads 2")).is(0);
        for band in ["light", "heat"] {
            let [whole, killed] = ["whole", "killed"].map(|store| place.path(format!("{store}-{band}")));
            assert_same(&whole, &killed);
            std::fs::remove_dir_all(killed).expect("removed");
        }
    }
}

/// Where all has one temperature nothing flows, points see what surfaces do, and shares of pairs are shares.
#[test]
fn what_stands_on_the_rows_stands_on_all_at_once() {
    let optics = "[object.glass]\nspecular = 0.1\ntransmittance = 0.8\n[object.plate]\nspecular = 0.9\n";
    let place = place(&street(), optics);
    let ran = place
        .line(&format!("compute scene.obj {SYMMETRIC} --tolerance 1% -o rows -v"))
        .is(0);
    ran.clone().says(&["pairs are partly hidden", "expected (asked: 1 %)"]);
    assert!(!ran.err.contains(" 0 pairs are partly hidden"), "{}", ran.err);
    place.write(
        "heat.toml",
        "[object.\"*\"]\ntemperature = 300\nemissivity = 0.9\n[object.glass]\ntemperature = 300\nemissivity = \
         0.1\n[object.plate]\ntemperature = 300\nemissivity = 0.1\n",
    );
    place
        .line("solve rows --scene scene.obj --materials heat.toml --thermal --sky-temperature 300 --by object")
        .is(0)
        .says(&["none flows"]);
    place.line("balance rows --closure --reciprocity -o balanced").is(0);
    place.line("check balanced").is(0);
    let sky = place.line("sky scene.obj --matrix rows").is(0);
    assert!(!format!("{sky:?}").contains("-0.00"), "{sky:?}");
    // Rays of the reference branch at glass: pieces are cut for what the branches carry, not for each of them.
    place.write("at.txt", "0.5 0.5 1 -1 0 0\n");
    let verified = place
        .line(&format!(
            "points scene.obj {SYMMETRIC} --points at.txt --tolerance 1% --verify 1 --json -o points.csv"
        ))
        .is(0)
        .json();
    let rays = verified["verified"]["rays"].as_u64().expect("a number");
    assert!(rays < 6_000_000, "{verified}");
}

#[test]
fn a_band_in_which_nothing_is_a_mirror_has_the_rows_without_any() {
    let place = place(&room(1., 1., 1.), "[object.x1]\nspecular = [0.5, 0]\n");
    let settings = "compute scene.obj --emitters bottom";
    for level in ["--correction pixel --resolution 64", "", "--tolerance 1%"] {
        place
            .line(&format!(
                "{settings} {level} --specular optics.toml -o banded --overwrite"
            ))
            .is(0);
        place.line(&format!("{settings} {level} -o plain --overwrite")).is(0);
        let rows = |store: &str| entries(&place.path(store), 0..2, |patch| patch);
        assert_eq!(rows("banded-2"), rows("plain"), "{level}");
        assert_ne!(rows("banded-1"), rows("plain"), "{level}");
        assert_eq!(place.line("check banded-2 --json").is(0).json()["ok"], true);
    }
}

/// From within two boxes of glass the paths of a pixel double at each pane. Light ones merge, and nearly nothing is cut
/// off: rows are those by rays.
#[test]
fn pixels_merge_where_panes_double_them() {
    let mut quads: Vec<Quad<'_>> = room(2., 2., 2.);
    for (name, near, far) in [("outer", 0.3, 1.7), ("inner", 0.55, 1.45)] {
        let faces = closed([near; 3], [far; 3]);
        quads.extend(faces.into_iter().flat_map(|corners| both_ways((name, corners))));
    }
    quads.extend(both_ways((
        "plate",
        [[0.9, 0.9, 1.05], [1.1, 0.9, 0.95], [1.1, 1.1, 0.95], [0.9, 1.1, 1.05]],
    )));
    let optics = "[object.outer]\nspecular = 0.1\ntransmittance = 0.8\n[object.inner]\nspecular = \
                  0.2\ntransmittance = 0.5\n[object.plate]\nspecular = 0.9\n";
    let place: Place = place(&quads, optics);
    let row = |settings: &str| {
        place
            .line(&format!(
                "compute scene.obj --specular optics.toml --emitters plate -o store --overwrite {settings}"
            ))
            .is(0);
        let report = place.line("check store --json").is(0).json();
        assert_eq!(report["ok"], true, "{report}");
        (
            zones(&place, "store"),
            report["cut_off_max"].as_f64().expect("a number"),
        )
    };
    let (by_pixels, cut_off) = row("--correction pixel");
    assert!(cut_off < 0.01, "{cut_off}");
    let (by_rays, _) = row("--tolerance 1%");
    for to in ["bottom", "top", "x0", "y1", "inner", "outer", "plate"] {
        near(of(&by_pixels, "plate", to), of(&by_rays, "plate", to), 0.01);
    }
}
