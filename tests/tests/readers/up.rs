//! Which axis points up is one rule in every command: `--up`, the file's word, what names and normals leave no doubt
//! of; otherwise it is asked for.
//!
//! The binary is the one beside this test: build it with the same profile and target directory before.

use hemicube_tests::runs::Place;
use hemicube_tests::scenes::{scenes_or_skip, workspace};
use serde_json::Value;

/// A closed cube without names: nothing tells where up is.
const CUBE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n\
                    f 1 2 3 4\nf 8 7 6 5\nf 1 5 6 2\nf 3 7 8 4\nf 2 6 7 3\nf 1 4 8 5\n";

/// The axis by `inspect`, and whether it is a guess.
fn inspected(place: &Place, scene: &str) -> (String, bool) {
    let report = place
        .line(&format!("inspect {scene} --json --config=none"))
        .is(0)
        .json();
    let scene = &report["scene"];
    (
        scene["up"].as_str().expect("an axis").to_owned(),
        scene["up_guessed"].as_bool().expect("known or not"),
    )
}

/// The axis in the head of a page.
fn of_page(place: &Place, page: &str) -> String {
    let text = std::fs::read_to_string(place.path(page)).expect("a page");
    let head = text.split_once("id=\"head\">").expect("a head").1;
    let head: Value = serde_json::from_str(head.split_once("</script>").expect("its end").0).expect("JSON");
    head["up"].as_str().expect("an axis").to_owned()
}

#[test]
fn every_command_asks_where_nothing_tells() {
    let place = Place::new();
    place.write("cube.obj", CUBE);
    assert!(inspected(&place, "cube.obj").1);
    place.line("compute cube.obj -o F -q --config=none").is(0);
    for line in [
        "sky cube.obj -o sky",
        "report F cube.obj -o F.html",
        "view model F cube.obj --show seen -o F.png",
        "export F -o F.glb --scene cube.obj",
    ] {
        place
            .line(line)
            .is(2)
            .says(&["does not say which axis points up", "`--up x`, `--up y` or `--up z`"]);
        for axis in ["x", "y", "z"] {
            place.line(&format!("{line} --up {axis} --overwrite -q")).is(0);
        }
    }
    assert_eq!(of_page(&place, "F.html"), "z");
    // A matrix that was told knows it.
    place.line("compute cube.obj --up x -o G -q --config=none").is(0);
    place.line("report G cube.obj -o G.html").is(0);
    assert_eq!(of_page(&place, "G.html"), "x");
}

#[test]
fn what_inspect_finds_is_what_the_others_use() {
    let place = Place::new();
    let cornell = workspace().join("crates/scene/data/cornell-box.obj");
    std::fs::copy(cornell, place.path("cornell.obj")).expect("a copy");
    let mut scenes = vec![("cornell.obj".to_owned(), "y")];
    for kind in ["room", "city", "block-city", "maze", "field"] {
        let file = format!("{kind}.obj");
        place.line(&format!("generate {kind} --patches 400 -o {file} -q")).is(0);
        // The same, turned so that z is up.
        let text = std::fs::read_to_string(place.path(&file)).expect("a scene");
        let turned: String = text
            .lines()
            .map(|line| match line.split_whitespace().collect::<Vec<_>>()[..] {
                ["v", x, y, z] => format!("v {z} {x} {y}\n"),
                _ => format!("{line}\n"),
            })
            .collect();
        let other = format!("{kind}-z.obj");
        place.write(&other, turned);
        scenes.extend([(file, "y"), (other, "z")]);
    }
    for (scene, axis) in scenes {
        assert_eq!(inspected(&place, &scene), (axis.to_owned(), false), "{scene}");
        place
            .line(&format!("compute {scene} -o F -q --overwrite --config=none"))
            .is(0);
        place
            .line(&format!("report F {scene} -o F.html --overwrite"))
            .is(0)
            .says(&[&format!("up is {axis} (found: ")]);
        assert_eq!(of_page(&place, "F.html"), axis, "{scene}");
        place
            .line(&format!(
                "view model F {scene} --show seen -o F.png --overwrite --size 64x64"
            ))
            .is(0)
            .says(&[&format!("up is {axis} (found: ")]);
    }
}

#[test]
fn cities_of_the_world_stand() {
    let Some(scenes) = scenes_or_skip("up::cities_of_the_world_stand") else {
        return;
    };
    let place = Place::new();
    for file in [
        "3dfier-testarea.obj",
        "denhaag-8897.obj",
        "rotterdam-delfshaven.obj",
        "zurich-lv95-rawcoords.obj",
    ] {
        let scene = scenes.join("city").join(file).display().to_string();
        assert_eq!(inspected(&place, &scene), ("z".to_owned(), false), "{file}");
    }
}
