//! Buildings of EnergyPlus and gbXML: windows cut out of walls, winding, places of zones, what is left open.

#![cfg(all(feature = "energyplus", feature = "gbxml"))]

use glam::DVec3;
use hemicube_scene::{Axis, Error, ErrorKind, ReadOptions, Scene, Triangle, energyplus, load};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

fn corpus(name: &str) -> PathBuf {
    let reader = if name.ends_with("xml") { "gbxml" } else { "energyplus" };
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fuzz/corpus")
        .join(reader)
        .join(name)
}

fn open(name: &str) -> Scene {
    load(&corpus(name), ReadOptions::default()).unwrap_or_else(|error| panic!("{error}"))
}

/// The sum of the vector areas of an object's triangles.
fn vector(scene: &Scene, object: &str) -> DVec3 {
    let is = |t: &&Triangle| scene.objects[t.object as usize] == object;
    let area = |t: &Triangle| 0.5 * (t.corners[1] - t.corners[0]).cross(t.corners[2] - t.corners[0]);
    scene.triangles.iter().filter(is).map(area).sum()
}

fn near(a: DVec3, b: DVec3) -> bool {
    (a - b).length() < 1e-12
}

/// Corners of an object, in the file's order, each once.
fn corners(scene: &Scene, object: &str) -> Vec<DVec3> {
    let is = |t: &&Triangle| scene.objects[t.object as usize] == object;
    let mut corners: Vec<DVec3> = Vec::new();
    for corner in scene.triangles.iter().filter(is).flat_map(|t| t.corners) {
        if !corners.contains(&corner) {
            corners.push(corner);
        }
    }
    corners
}

#[test]
fn windows_are_cut_out_of_walls_and_face_into_the_zone() {
    for name in [
        "ok-window.idf",
        "ok-window-first.idf",
        "ok-window-89.idf",
        "ok-95.idf",
        "ok-all.epJSON",
        "ok-window.gbxml",
        "ok-rectangle.gbxml",
        "ok-interior.gbxml",
    ] {
        let scene = open(name);
        let windows = if name == "ok-95.idf" { 0.0 } else { 1.0 };
        assert!(
            near(vector(&scene, "wall"), (12.0 - windows) * DVec3::Y),
            "{name}: {}",
            vector(&scene, "wall")
        );
        assert!(near(vector(&scene, "window"), windows * DVec3::Y), "{name}");
        assert_eq!(scene.up, Some(Axis::Z), "{name}");
        if windows > 0.0 && !name.contains("rectangle") {
            // To the bit, so that nothing passes between them.
            let (wall, window) = (corners(&scene, "wall"), corners(&scene, "window"));
            assert!(window.iter().all(|corner| wall.contains(corner)), "{name}: {wall:?}");
        }
        let walls = scene.triangles.iter().filter(|t| t.face == 0);
        assert!(
            walls.clone().count() >= 2 && walls.clone().all(|t| t.object == 0),
            "{name}: the wall is first"
        );
    }
    // A door at the wall's foot.
    let door = open("ok-door.idf");
    assert!(near(vector(&door, "wall"), 10.0 * DVec3::Y) && near(vector(&door, "door"), 2.0 * DVec3::Y));
    // A wall that is all glass.
    let glass = open("ok-all-glass.idf");
    assert!(near(vector(&glass, "window"), 12.0 * DVec3::Y) && glass.triangles.len() == 2);
    assert_eq!(glass.ledger.get("surface without area"), 0);
    assert!(near(vector(&open("ok-short-words.idf"), "floor"), 12.0 * DVec3::Z));
    let wall = |scene: &Scene| {
        let t = scene.triangles[0];
        (scene.materials[t.material as usize].name.clone(), t.two_sided)
    };
    assert_eq!(wall(&open("ok-window.idf")), ("brick".to_owned(), false));
    assert_eq!(wall(&open("ok-interior.gbxml")), ("InteriorWall".to_owned(), true));
    assert_eq!(wall(&open("ok-shade.gbxml")), ("Shade".to_owned(), true));
    let window = open("ok-window.gbxml");
    assert!(window.materials.iter().any(|material| material.name == "glass"));
    assert_eq!(
        open("ok-window-89.idf")
            .ledger
            .get("window with a multiplier, taken once"),
        1
    );
}

#[test]
fn both_sides_of_a_party_wall_face_their_zones_and_air_is_open() {
    let scene = open("ok-party-wall.idf");
    assert!(near(vector(&scene, "party w"), 12.0 * DVec3::Y));
    assert!(near(vector(&scene, "party e"), -12.0 * DVec3::Y));
    let open_plan = open("ok-air-boundary.idf");
    assert_eq!(open_plan.objects, ["floor"]);
    assert_eq!(open_plan.ledger.get("surface of an air boundary, left out"), 2);
    let air = open("ok-air.gbxml");
    assert_eq!(air.objects, ["Floor", "wall"]);
    assert!(
        (vector(&air, "wall").length() - 11.0).abs() < 1e-12,
        "{}",
        vector(&air, "wall")
    );
    assert_eq!(air.ledger.get("surface or opening of air, left open"), 2);
    assert_eq!(open("ok-names-twice.gbxml").objects, ["floor", "b"]);
    assert_eq!(open("ok-feet.xml").metres_per_unit, Some(0.3048));
}

#[test]
fn zones_and_shading_stand_where_energyplus_puts_them() {
    let scene = open("ok-relative.idf");
    // By EnergyPlus's formula, for a building turned by 30° and a zone turned by 45° at (1, 2, 3).
    let turn = |p: DVec3, degrees: f64| {
        let (sin, cos) = (-degrees.to_radians()).sin_cos();
        DVec3::new(p.x * cos - p.y * sin, p.x * sin + p.y * cos, p.z)
    };
    let in_zone = |p: DVec3| turn(turn(p, 45.0) + DVec3::new(1.0, 2.0, 3.0), 30.0);
    let point = DVec3::new;
    let expected = [
        ("floor", in_zone(point(4.0, 3.0, 0.0))),
        ("awning", in_zone(point(1.0, 1.0, 1.0))),
        ("shed", turn(point(1.0, 1.0, 1.0), 30.0)),
        ("hill", point(1.0, 1.0, 1.0)),
    ];
    for (object, expected) in expected {
        let found = corners(&scene, object);
        assert!(
            found.iter().any(|&corner| near(corner, expected)),
            "{object}: {found:?}, not {expected}"
        );
        let two_sided = scene
            .triangles
            .iter()
            .find(|t| scene.objects[t.object as usize] == object)
            .unwrap()
            .two_sided;
        assert_eq!(two_sided, object != "floor", "{object}");
    }
    // The floor faces up although it is clockwise in this file.
    assert!(near(vector(&scene, "floor"), 12.0 * DVec3::Z));
    assert!(near(vector(&open("ok-clockwise.idf"), "floor"), -12.0 * DVec3::Z));
    assert_eq!(scene.ledger.get("shading without corners, not read"), 1);
    assert!(open("ok-no-rules.idf").ledger.warnings[0].contains("GlobalGeometryRules"));
    let json = open("ok-relative.epJSON");
    // A wall from (0, 0) to (4, 0), in a zone at x = 5 turned by 90° to (0, -4).
    let expected = turn(point(5.0, -4.0, 0.0), 30.0);
    assert!(
        corners(&json, "wall").iter().any(|&corner| near(corner, expected)),
        "{:?}",
        corners(&json, "wall")
    );
}

#[test]
fn errors_name_the_line_the_surface_and_the_way_out() {
    let error = |name: &str| -> Error { load(&corpus(name), ReadOptions::default()).unwrap_err() };
    for (name, line, words) in [
        (
            "bad-zone.idf",
            Some(3),
            "surface `floor`: its zone `office` is not there",
        ),
        (
            "bad-wall.idf",
            Some(3),
            "surface `window`: its wall `Wall` is not there",
        ),
        ("bad-number.idf", Some(3), "`x` where a number is due"),
        ("bad-corners.idf", Some(3), "surface `floor`: has 4 corners, and says 5"),
        ("bad-simple.idf", Some(4), "save its surfaces in detail"),
        ("bad-macro.idf", Some(1), "expand its macros"),
        ("bad-cut.idf", Some(3), "before its semicolon; it is cut short"),
        (
            "bad-corners.epJSON",
            Some(45),
            "surface `wall`: has 4 corners, and says 3",
        ),
        (
            "bad-zone.epJSON",
            None,
            "surface `wall`: its zone `office` is not there",
        ),
        ("bad-city.epJSON", None, "without a class of EnergyPlus"),
        ("bad-number.gbxml", Some(9), "`four` where a number is due"),
        (
            "bad-no-shape.gbxml",
            Some(4),
            "`wall`: its `PlanarGeometry` has no loop",
        ),
        ("bad-root.xml", Some(1), "the root is not `gbXML`"),
    ] {
        let error = error(name);
        assert!(error.to_string().contains(words), "{name}: {error}");
        assert_eq!(error.line, line, "{name}: {error}");
    }
}

#[test]
fn surfaces_and_zones_of_one_name_are_said() {
    let text = "GlobalGeometryRules,, Counterclockwise, Relative;\nZone, a, 0, 0, 0, 0;\nZone, A, 0, 5, 0, 0;\n\
        Wall:Detailed, w, , a, , , , , , , , 0,0,0, 4,0,0, 4,0,3, 0,0,3;\n\
        Floor:Detailed, floor, , a, , , , , , , , 0,0,0, 0,3,0, 4,3,0, 4,0,0;\n\
        Wall:Detailed, W, , a, , , , , , , , 0,9,0, 4,9,0, 4,9,3, 0,9,3;\n\
        FenestrationSurface:Detailed, pane, , , w, , , , , , 1,0,1, 2,0,1, 2,0,2, 1,0,2;\n";
    let read = |text: &str| energyplus::read(text.as_bytes(), None, ReadOptions::default()).expect("a building");
    let scene = read(text);
    // The first wall has the window, the first zone the surfaces.
    assert_eq!(scene.objects, ["w 1", "pane", "floor", "W 2"]);
    assert!(
        near(vector(&scene, "w 1"), 11.0 * DVec3::Y),
        "{}",
        vector(&scene, "w 1")
    );
    assert!(scene.triangles.iter().all(|t| t.corners.iter().all(|p| p.x <= 4.0)));
    let losses: Vec<String> = scene.ledger.losses().map(|(what, loss)| loss.sentence(what)).collect();
    assert_eq!(
        losses,
        [
            "doubtful: 2 × surface without a name of its own, numbered as the file has them (the first: `w`, line 4); \
             give the surfaces names where properties are to tell them apart",
            "merged: 1 × zone of a name that another has, taken as the first (line 3); give each zone a name of its \
             own, and its surfaces that name",
        ]
    );
    let alone = read(&text.replace("Zone, A, 0, 5, 0, 0;\n", "").replace(", W, ", ", v, "));
    assert_eq!(alone.ledger.losses().count(), 0, "{}", alone.ledger);
    assert_eq!(alone.objects, ["w", "pane", "floor", "v"]);
}

#[test]
fn windows_that_cross_are_cut_in_time_or_refused() {
    for (windows, size) in [(4000_usize, 90), (4000, 2000), (6000, 90)] {
        let mut text = "GlobalGeometryRules,, Counterclockwise, World;\nZone, z;\n\
            Wall:Detailed, w, , z, , , , , , , , 0,0,0, 9999,0,0, 9999,0,9999, 0,0,9999;\n"
            .to_owned();
        for k in 0..windows {
            let (x, y) = (k * 7919 % 7900 + 1, k * 104_729 % 7900 + 1);
            let (right, top) = (x + size, y + size);
            text += &format!("FenestrationSurface:Detailed, {k}, , , w, , , , , , ");
            text += &format!("{x},0,{y}, {right},0,{y}, {right},0,{top}, {x},0,{top};\n");
        }
        let begun = Instant::now();
        let read = energyplus::read(text.as_bytes(), None, ReadOptions::default());
        assert!(
            begun.elapsed() < Duration::from_secs(60),
            "{windows} of {size}: {:?}",
            begun.elapsed()
        );
        match read {
            Ok(scene) => assert_eq!(scene.objects.len(), windows + 1),
            Err(error) => assert!(matches!(error.kind, ErrorKind::OverLimit(_)), "{error}"),
        }
    }
}
