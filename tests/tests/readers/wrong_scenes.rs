//! Scenes that are wrong are told why: what is wound the wrong way, where they leak, what lies in solids or below the
//! horizon, and texts as editors and spreadsheets write them.

use hemicube_tests::runs::Place;
use hemicube_tests::scenes::{scenes_or_skip, skip, workspace};
use serde_json::Value;
use std::fmt::Write;
use std::path::PathBuf;

type Quad = [[f64; 3]; 4];

/// The six sides of a box, wound outwards: bottom, top, south, north, west, east.
fn sides([x, y, z]: [f64; 3], [a, b, c]: [f64; 3]) -> [(&'static str, Quad); 6] {
    [
        ("bottom", [[x, y, z], [x, b, z], [a, b, z], [a, y, z]]),
        ("top", [[x, y, c], [a, y, c], [a, b, c], [x, b, c]]),
        ("south", [[x, y, z], [a, y, z], [a, y, c], [x, y, c]]),
        ("north", [[x, b, z], [x, b, c], [a, b, c], [a, b, z]]),
        ("west", [[x, y, z], [x, y, c], [x, b, c], [x, b, z]]),
        ("east", [[a, y, z], [a, b, z], [a, b, c], [a, y, c]]),
    ]
}

fn turned(quad: Quad) -> Quad {
    let [a, b, c, d] = quad;
    [d, c, b, a]
}

fn obj(quads: &[(String, Quad)]) -> String {
    let mut text = String::new();
    for (number, (name, quad)) in quads.iter().enumerate() {
        for [x, y, z] in quad {
            writeln!(text, "v {x} {y} {z}").expect("a string");
        }
        let first = 4 * number + 1;
        writeln!(text, "o {name}\nf {first} {} {} {}", first + 1, first + 2, first + 3).expect("a string");
    }
    text
}

const ROOM: [[f64; 3]; 2] = [[0.0; 3], [6.0, 5.0, 3.0]];
const TABLE: [[f64; 3]; 2] = [[2.0, 2.0, 0.5], [3.0, 3.0, 1.2]];

/// A room with a table in it, of which the objects that are named face the wrong way.
fn room(wrong: &[&str]) -> String {
    let is_wrong = |name: &str| wrong.contains(&name);
    let mut quads = Vec::new();
    for (name, quad) in sides(ROOM[0], ROOM[1]) {
        quads.push((name.to_owned(), if is_wrong(name) { quad } else { turned(quad) }));
    }
    for (_, quad) in sides(TABLE[0], TABLE[1]) {
        quads.push(("table".to_owned(), if is_wrong("table") { turned(quad) } else { quad }));
    }
    obj(&quads)
}

/// Sixteen buildings on a ground, or above none.
fn city(inside_out: bool, ground: bool) -> String {
    let mut quads = Vec::new();
    if ground {
        let [low, high] = [-60.0, 140.0];
        let quad = [[low, low, 0.0], [high, low, 0.0], [high, high, 0.0], [low, high, 0.0]];
        quads.push(("ground".to_owned(), quad));
    }
    for number in 0..16 {
        let (x, y) = (20.0 * f64::from(number / 4), 20.0 * f64::from(number % 4));
        for (_, quad) in sides([x, y, 0.0], [x + 10.0, y + 10.0, 12.0 + f64::from(3 * (number % 5))]) {
            quads.push((
                format!("building {number}"),
                if inside_out { turned(quad) } else { quad },
            ));
        }
    }
    obj(&quads)
}

fn inspected(place: &Place, line: &str) -> Value {
    place.line(&format!("inspect {line} --json --config=none")).is(0).json()["enclosure"].clone()
}

fn sentences(enclosure: &Value) -> Vec<String> {
    let list = enclosure["sentences"].as_array().expect("a list");
    list.iter()
        .map(|text| text.as_str().expect("a text").to_owned())
        .collect()
}

/// A folder of the cases, or a loud skip.
fn case(test: &str, name: &str) -> Option<PathBuf> {
    let folder = workspace().join("../shared/cases").join(name);
    if folder.is_dir() {
        return Some(folder);
    }
    skip(test, &format!("no ../shared/cases/{name}"), "HEMICUBE_REQUIRE_CASES");
    None
}

/// A number of bytes is written to a file, for texts that are not UTF-8.
fn write(place: &Place, name: &str, bytes: &[u8]) {
    std::fs::write(place.path(name), bytes).expect("a file");
}

#[test]
fn the_object_that_faces_the_wrong_way_is_named_and_not_those_that_see_it() {
    let place = Place::new();
    write(&place, "right.obj", room(&[]).as_bytes());
    assert_eq!(
        sentences(&inspected(&place, "right.obj --split 3")),
        Vec::<String>::new()
    );
    for wrong in [vec!["west"], vec!["table"], vec!["top", "west"]] {
        write(&place, "wrong.obj", room(&wrong).as_bytes());
        let found = inspected(&place, "wrong.obj --split 3");
        let said = sentences(&found);
        assert_eq!(said.len(), wrong.len(), "{said:?}");
        for name in &wrong {
            let named = |text: &String| {
                text.starts_with(&format!("`{name}` faces")) && text.contains(&format!("--flip {name}"))
            };
            assert!(said.iter().any(named), "{name}: {said:?}");
        }
        let run = place
            .line("compute wrong.obj --split 3 -o W --overwrite --config=none")
            .is(0);
        run.says(&[&format!("`{}` faces the wrong way", wrong[0])]);

        // The option that it names rights it, and is in the store, so that readers of the scene turn it too.
        let flips: String = wrong.iter().map(|name| format!(" --flip {name}")).collect();
        assert!(sentences(&inspected(&place, &format!("wrong.obj --split 3{flips}"))).is_empty());
        place
            .line(&format!(
                "compute wrong.obj --split 3{flips} -o R --overwrite --config=none"
            ))
            .is(0);
        let manifest: Value =
            serde_json::from_slice(&std::fs::read(place.path("R/manifest.json")).expect("a manifest")).expect("JSON");
        let recorded = manifest["settings"]["flip"].as_array().expect("a list");
        assert!(
            recorded
                .iter()
                .map(|glob| glob.as_str())
                .eq(wrong.iter().map(|name| Some(*name)))
        );
        assert!(manifest["sums"].is_object() || manifest["parts"].is_array());
        place.line("sky wrong.obj --matrix R --up z").is(0);
        place.line("check R").is(0);
        // Another way round is another scene: a run does not go on with it.
        let other = place.line("compute wrong.obj --split 3 -o R --resume --config=none");
        assert_ne!(other.code, Some(0), "{}", other.err);
    }
    let refused = place.line("inspect wrong.obj --flip nothing --config=none");
    refused
        .is(2)
        .says(&["`--flip nothing` matches no object", "`bottom`, `east`"]);
}

#[test]
fn a_model_wound_outwards_is_named_and_an_empty_matrix_never_holds() {
    let place = Place::new();
    let all = ["bottom", "top", "south", "north", "west", "east", "table"];
    write(&place, "out.obj", room(&all).as_bytes());
    let said = sentences(&inspected(&place, "out.obj"));
    assert!(
        said.len() == 1 && said[0].contains("wound outwards throughout"),
        "{said:?}"
    );
    assert!(said[0].contains("`--flip all`"), "{said:?}");
    assert!(sentences(&inspected(&place, "out.obj --flip all")).is_empty());
    // The closed table sees its own inside: the matrix has entries, and fails all the same.
    let of = "--split 4 --config=none --overwrite -o G";
    place.line(&format!("compute out.obj {of}")).is(0);
    let checked = place.line("check G").is(1).out;
    assert!(
        checked.contains("winding: 1 case") && checked.contains("`compute --flip all`"),
        "{checked}"
    );
    let report = place.line("check G --json").is(1).json();
    assert_eq!(report["verdicts"]["quality"]["failed"], serde_json::json!(["winding"]));
    assert!(report["entries"].as_u64().is_some_and(|entries| entries > 0));
    place.line(&format!("compute out.obj {of} --flip all")).is(0);
    place.line("check G").is(0);
    // Objects in it may face the right way.
    write(&place, "shell.obj", room(&all[..6]).as_bytes());
    let said = sentences(&inspected(&place, "shell.obj"));
    assert!(
        said.len() == 1 && said[0].starts_with("`bottom`, `east`, `north`, `south` and 2 more face"),
        "{said:?}"
    );

    let quads: Vec<_> = sides(ROOM[0], ROOM[1])
        .map(|(name, quad)| (name.to_owned(), quad))
        .into();
    write(&place, "box.obj", obj(&quads).as_bytes());
    place
        .line("compute box.obj --split 4 -o E --config=none")
        .is(0)
        .says(&["wound outwards throughout", "`--flip all`"]);
    let checked = place.line("check E").is(1);
    assert!(
        checked.out.contains("entries: 1 case") && !checked.out.contains("Everything holds"),
        "{}",
        checked.out
    );
    place
        .line("compute box.obj --split 4 -o F --flip all --config=none")
        .is(0);
    let checked = place.line("check F").is(0);
    assert!(checked.out.contains("Everything holds"), "{}", checked.out);
    // Both sides of everything radiate: there is nothing to turn, which is said.
    place
        .line("inspect box.obj --two-sided on --flip all --config=none")
        .is(2)
        .says(&["two-sided"]);
}

#[test]
fn an_inside_out_city_is_named_and_a_city_is_not() {
    let place = Place::new();
    write(&place, "city.obj", city(false, true).as_bytes());
    write(&place, "apart.obj", city(false, false).as_bytes());
    write(&place, "wrong.obj", city(true, true).as_bytes());
    write(&place, "inside.obj", city(true, false).as_bytes());
    for right in ["city.obj", "apart.obj"] {
        let found = inspected(&place, right);
        assert!(sentences(&found).is_empty() && found["apart"] == 0, "{right}: {found}");
    }
    let found = inspected(&place, "wrong.obj");
    let said = sentences(&found);
    assert!(
        said.len() == 1 && said[0].starts_with("16 objects face inwards"),
        "{said:?}"
    );
    assert!(said[0].contains("`--flip 'building *'`"), "{said:?}");
    let found = place.line("inspect wrong.obj --config=none").is(0);
    assert!(found.out.contains("Wound the wrong way"), "{}", found.out);
    // Where there is no ground, nobody sees the backs.
    let found = inspected(&place, "inside.obj");
    assert_eq!((sentences(&found).len(), &found["apart"]), (0, &Value::from(16)));
    place
        .line("compute inside.obj -o I --config=none")
        .is(0)
        .says(&["16 groups of surfaces each see only their own insides", "`--flip all`"]);
    place
        .line("compute wrong.obj -o W --config=none")
        .is(0)
        .says(&["16 objects face inwards", "`--flip 'building *'`"]);
}

/// `compute` looks at a sample of the surfaces: of right cities it named buildings of which that had few.
#[test]
fn compute_names_no_building_of_real_cities() {
    let Some(folder) = scenes_or_skip("compute_names_no_building_of_real_cities") else {
        return;
    };
    let place = Place::new();
    for city in ["denhaag-8897", "rotterdam-delfshaven", "denhaag"] {
        let scene = folder.join("city").join(city).with_extension("obj");
        let computed = |rest: &str| {
            let line = format!(
                "compute {} -o m --overwrite --config=none --rows 40 --correction pixel --resolution 64{rest}",
                scene.display()
            );
            place.line(&line).is(0).err
        };
        let said = computed("");
        assert!(!said.contains("the wrong way"), "{city}: {said}");
    }
}

/// A room of 7,500 triangles with a chair in it, of which `compute` looks at 1,500: the wall that is turned round is
/// confirmed by 1,024 of its own, and `inspect` finds by all of them that it loses as much.
#[test]
fn compute_names_a_wall_of_many_surfaces_by_its_own_rays() {
    const PIECES: u32 = 25;
    let place = Place::new();
    let mut quads: Vec<(String, Quad)> = Vec::new();
    for (name, [a, b, c, d]) in sides([0.0; 3], [5.0, 4.0, 3.0]) {
        let at = |u: u32, v: u32| {
            let [u, v] = [u, v].map(|of| f64::from(of) / f64::from(PIECES));
            std::array::from_fn(|axis| {
                let [low, high] = [a[axis] * (1.0 - u) + b[axis] * u, d[axis] * (1.0 - u) + c[axis] * u];
                low * (1.0 - v) + high * v
            })
        };
        for (u, v) in (0..PIECES).flat_map(|u| (0..PIECES).map(move |v| (u, v))) {
            let piece = [at(u, v), at(u + 1, v), at(u + 1, v + 1), at(u, v + 1)];
            let faces_out = name == "west";
            quads.push((name.to_owned(), if faces_out { piece } else { turned(piece) }));
        }
    }
    quads.extend(sides([2.0, 1.0, 0.5], [3.0, 2.0, 1.0]).map(|(_, quad)| ("chair".to_owned(), quad)));
    write(&place, "room.obj", obj(&quads).as_bytes());
    let computed = place
        .line("compute room.obj -o m --config=none --rows 100 --correction pixel --resolution 64")
        .is(0)
        .err;
    let said: Vec<&str> = computed.lines().filter(|line| line.contains("the wrong way")).collect();
    assert!(said.len() == 1 && said[0].contains("`--flip west`"), "{computed}");
    let percent = |text: &str| -> f64 {
        let (before, _) = text.split_once(" % of all views").expect("a share");
        before
            .rsplit(' ')
            .next()
            .and_then(|word| word.parse().ok())
            .expect("a number")
    };
    let all = sentences(&inspected(&place, "room.obj"));
    assert!(all.len() == 1, "{all:?}");
    let (some, all) = (percent(said[0]), percent(&all[0]));
    assert!((some / all - 1.0).abs() < 0.1, "{some} % and {all} %");
}

/// A city with some of its objects turned round, or all of it.
fn turned_city(is_turned: impl Fn(&str) -> bool, name: impl Fn(&str) -> String) -> String {
    let [low, high] = [-60.0, 140.0];
    let ground = [[low, low, 0.0], [high, low, 0.0], [high, high, 0.0], [low, high, 0.0]];
    let mut quads = vec![("ground".to_owned(), ground)];
    for number in 0..16 {
        let (x, y) = (20.0 * f64::from(number / 4), 20.0 * f64::from(number % 4));
        for (_, quad) in sides([x, y, 0.0], [x + 10.0, y + 10.0, 12.0 + f64::from(3 * (number % 5))]) {
            quads.push((format!("building {number}"), quad));
        }
    }
    let of = |(own, quad): (String, Quad)| (name(&own), if is_turned(&own) { turned(quad) } else { quad });
    obj(&quads.into_iter().map(of).collect::<Vec<_>>())
}

#[test]
fn a_ground_that_faces_down_and_a_city_turned_over_are_named() {
    let place = Place::new();
    let named = |name: &str| name.to_owned();
    write(
        &place,
        "ground.obj",
        turned_city(|name| name == "ground", named).as_bytes(),
    );
    let said = sentences(&inspected(&place, "ground.obj --split 2"));
    assert!(
        said.len() == 1 && said[0].starts_with("`ground` faces down and sees nothing"),
        "{said:?}"
    );
    assert!(said[0].contains("`--flip ground`"), "{said:?}");
    assert!(sentences(&inspected(&place, "ground.obj --split 2 --flip ground")).is_empty());
    place
        .line("compute ground.obj -o G --config=none")
        .is(0)
        .says(&["`ground` faces down"]);
    // Whatever its objects are called, and as one object.
    for (file, name) in [
        ("all.obj", &named as &dyn Fn(&str) -> String),
        ("one.obj", &|_: &str| "all".to_owned()),
    ] {
        write(&place, file, turned_city(|_| true, name).as_bytes());
        let said = sentences(&inspected(&place, &format!("{file} --split 2")));
        assert!(
            said.len() == 1 && said[0].starts_with("everything faces the wrong way"),
            "{file}: {said:?}"
        );
        assert!(sentences(&inspected(&place, &format!("{file} --split 2 --flip all"))).is_empty());
        place
            .line(&format!("compute {file} -o A --overwrite --config=none"))
            .is(0)
            .says(&["everything faces the wrong way", "`--flip all`"]);
    }
}

/// Files of CAD programs have one object, or a name for all furniture.
#[test]
fn a_part_of_an_object_that_faces_the_wrong_way_is_placed() {
    let place = Place::new();
    let one = |_: &str| "all".to_owned();
    write(&place, "city.obj", turned_city(|_| false, one).as_bytes());
    assert!(sentences(&inspected(&place, "city.obj --split 2")).is_empty());
    write(
        &place,
        "one.obj",
        turned_city(|name| name == "building 6", one).as_bytes(),
    );
    let said = sentences(&inspected(&place, "one.obj --split 2"));
    assert!(
        said.len() == 1 && said[0].starts_with("1 part of objects faces inwards (`all` at x 20–30, y 40–50, z 0–15)"),
        "{said:?}"
    );
    let room = |wrong: &[&str]| {
        let mut text = room(wrong);
        for name in ["bottom", "top", "south", "north", "west", "east", "table"] {
            text = text.replace(&format!("o {name}\n"), "o all\n");
        }
        text
    };
    write(&place, "room.obj", room(&[]).as_bytes());
    assert!(sentences(&inspected(&place, "room.obj --split 3")).is_empty());
    for (wrong, at) in [("west", "x 0, y 0–5, z 0–3"), ("table", "x 2–3, y 2–3, z 0.5–1.2")] {
        write(&place, "wrong.obj", room(&[wrong]).as_bytes());
        let said = sentences(&inspected(&place, "wrong.obj --split 3"));
        assert!(
            said.len() == 1 && said[0].contains(&format!("`all` at {at}")),
            "{wrong}: {said:?}"
        );
    }
    write(
        &place,
        "out.obj",
        room(&["bottom", "top", "south", "north", "west", "east", "table"]).as_bytes(),
    );
    let said = sentences(&inspected(&place, "out.obj --split 3"));
    assert!(
        said.len() == 1 && said[0].contains("wound outwards throughout"),
        "{said:?}"
    );
}

/// One-sided surfaces that face the sky over an open scene, and what stands in a house, face the right way.
#[test]
fn canopies_panels_and_zones_are_no_false_alarm() {
    let place = Place::new();
    let flat = |[x, y, a, b]: [f64; 4], low: f64, high: f64| [[x, y, low], [a, y, low], [a, b, high], [x, b, high]];
    let ground = ("ground".to_owned(), flat([-20.0, -20.0, 40.0, 40.0], 0.0, 0.0));
    let mut panels = vec![ground.clone()];
    for number in 0..20 {
        let (x, y) = (5.0 * f64::from(number / 5), 4.0 * f64::from(number % 5));
        panels.push(("panel".to_owned(), flat([x, y, x + 3.0, y + 1.6], 0.6, 1.8)));
    }
    let mut canopy = vec![
        ground.clone(),
        ("canopy".to_owned(), flat([0.0, 0.0, 12.0, 8.0], 3.0, 3.0)),
    ];
    for (x, y) in [(0.0, 0.0), (11.8, 0.0), (0.0, 7.8), (11.8, 7.8)] {
        let post = sides([x, y, 0.0], [x + 0.2, y + 0.2, 3.0]);
        canopy.extend(post.map(|(_, quad)| ("post".to_owned(), quad)));
    }
    let mut house = vec![ground];
    house.extend(
        sides([0.0; 3], [10.0, 6.0, 4.0])
            .into_iter()
            .skip(1)
            .map(|(_, quad)| ("facade".to_owned(), quad)),
    );
    for (name, low, high) in [("zone 1", 0.3, 4.8), ("zone 2", 5.1, 9.7)] {
        let zone = sides([low, 0.3, 0.2], [high, 5.7, 3.0]);
        house.extend(zone.map(|(_, quad)| (name.to_owned(), turned(quad))));
    }
    house.push(("roof".to_owned(), flat([0.0, 0.0, 10.0, 3.0], 4.0, 6.0)));
    house.push((
        "roof".to_owned(),
        [[10.0, 6.0, 4.0], [0.0, 6.0, 4.0], [0.0, 3.0, 6.0], [10.0, 3.0, 6.0]],
    ));
    for (name, quads) in [("panels.obj", panels), ("canopy.obj", canopy), ("house.obj", house)] {
        write(&place, name, obj(&quads).as_bytes());
        let found = inspected(&place, &format!("{name} --split 3"));
        assert!(sentences(&found).is_empty(), "{name}: {found}");
    }
    // A thick-walled room with a chair turned round in it: the chair, not the walls.
    let mut thick: Vec<(String, Quad)> = sides([-3.0; 3], [3.0; 3])
        .map(|(_, quad)| ("walls".to_owned(), quad))
        .into();
    thick.extend(sides([-2.5; 3], [2.5; 3]).map(|(_, quad)| ("walls".to_owned(), turned(quad))));
    thick.extend(sides([-0.5; 3], [0.5; 3]).map(|(_, quad)| ("chair".to_owned(), turned(quad))));
    write(&place, "thick.obj", obj(&thick).as_bytes());
    let said = sentences(&inspected(&place, "thick.obj --split 3"));
    assert!(said.len() == 1 && said[0].contains("`--flip chair`"), "{said:?}");
}

/// A housing without a lid that faces out, around parts that are right: nobody sees the parts, and turned round they
/// would see themselves. `--flip` of a part was recommended, or of everything.
#[test]
fn an_open_housing_is_named_and_not_what_is_in_it() {
    let place = Place::new();
    let housing = |faces_in: bool| -> Vec<(String, Quad)> {
        let open = sides([0.0; 3], [100.0, 80.0, 40.0]).into_iter();
        let open = open.filter(|(_, quad)| quad.iter().any(|corner| corner[2] < 40.0));
        let turn = |quad| if faces_in { turned(quad) } else { quad };
        open.map(|(_, quad)| ("housing".to_owned(), turn(quad))).collect()
    };
    let chip = |name: &str, low: f64, high: f64| {
        let quads = sides([20.0, 20.0, low], [60.0, 50.0, high]);
        quads.map(|(_, quad)| (name.to_owned(), quad))
    };
    let contents: [Vec<(String, Quad)>; 3] = [
        chip("chip", 5.0, 20.0).into(),
        chip("chip", 5.0, 20.0)
            .into_iter()
            .chain(chip("cooler", 22.0, 35.0))
            .collect(),
        chip("chip", 1.0, 4.0).into(),
    ];
    for inside in contents {
        for faces_in in [false, true] {
            let quads: Vec<_> = housing(faces_in).into_iter().chain(inside.clone()).collect();
            write(&place, "housing.obj", obj(&quads).as_bytes());
            let said = sentences(&inspected(&place, "housing.obj"));
            let named = said.len() == 1 && said[0].contains("`--flip housing`") && !said[0].contains("chip");
            assert!(if faces_in { said.is_empty() } else { named }, "{faces_in}: {said:?}");
        }
    }
}

/// Solids that stand on each other, all in one object: each sees backs where they touch, and turned round they would
/// see themselves. Nothing is wrong with them.
#[test]
fn solids_of_one_object_that_touch_are_not_wound_the_wrong_way() {
    let place = Place::new();
    let all = |solids: &[[[f64; 3]; 2]], room: Option<[[f64; 3]; 2]>| {
        let outwards = solids
            .iter()
            .flat_map(|&[low, high]| sides(low, high))
            .map(|(_, quad)| quad);
        let inwards = room
            .into_iter()
            .flat_map(|[low, high]| sides(low, high))
            .map(|(_, quad)| turned(quad));
        let quads: Vec<(String, Quad)> = outwards.chain(inwards).map(|quad| ("all".to_owned(), quad)).collect();
        obj(&quads)
    };
    let fins = (0..20)
        .map(|k| f64::from(k) * 0.5)
        .map(|x| [[x, 0.0, 0.5], [x + 0.1, 10.0, 4.5]]);
    let sink: Vec<_> = std::iter::once([[0.0; 3], [10.0, 10.0, 0.5]]).chain(fins).collect();
    let columns = (0..36).map(|k| (f64::from(k / 6), f64::from(k % 6)));
    let columns: Vec<_> = columns.map(|(x, y)| [[x, y, 0.0], [x + 0.7, y + 0.7, 3.0]]).collect();
    write(&place, "sink.obj", all(&sink, None).as_bytes());
    write(
        &place,
        "hall.obj",
        all(&columns, Some([[-1.0, -1.0, 0.0], [7.0, 7.0, 3.0]])).as_bytes(),
    );
    for scene in ["sink.obj", "hall.obj"] {
        let found = inspected(&place, scene);
        assert!(sentences(&found).is_empty(), "{scene}: {found}");
        assert!(
            found["blocked"].as_f64().is_some_and(|blocked| blocked > 0.003),
            "{scene}: {found}"
        );
    }
}

#[test]
fn a_leak_is_named_and_bounded() {
    let place = Place::new();
    // The north wall but for 0.75 x 0.3375, in strips about the hole.
    let (x, z) = ([0.0, 2.25, 3.0, 6.0], [0.0, 1.0125, 1.35, 3.0]);
    let mut quads: Vec<(String, Quad)> = Vec::new();
    for (name, quad) in sides(ROOM[0], ROOM[1]) {
        if name != "north" {
            quads.push((name.to_owned(), turned(quad)));
        }
    }
    for i in 0..3 {
        for k in 0..3 {
            if (i, k) != (1, 1) {
                let [a, b, c, d] = [x[i], x[i + 1], z[k], z[k + 1]];
                quads.push(("north".to_owned(), [[a, 5.0, c], [b, 5.0, c], [b, 5.0, d], [a, 5.0, d]]));
            }
        }
    }
    write(&place, "hole.obj", obj(&quads).as_bytes());
    let found = inspected(&place, "hole.obj");
    let leaks = found["leaks"].as_array().expect("a list");
    assert_eq!(leaks.len(), 1, "{found}");
    assert_eq!(leaks[0]["low"], serde_json::json!([2.25, 5.0, 1.0125]));
    assert_eq!(leaks[0]["high"], serde_json::json!([3.0, 5.0, 1.35]));
    let area = leaks[0]["area"].as_f64().expect("a number");
    assert!((area - 0.75 * 0.3375).abs() < 1e-9, "{area}");
    let said = place.line("inspect hole.obj --config=none").is(0).out;
    assert!(
        said.contains("`north` at x 2.25–3, y 5, z 1.012–1.35: area 0.25"),
        "{said}"
    );

    place.line("compute hole.obj -o H --config=none").is(0);
    let checked = place.line("check H").is(0).out;
    assert!(checked.contains("nearly closed"), "{checked}");
    // A closed room has none.
    write(&place, "closed.obj", room(&[]).as_bytes());
    assert_eq!(inspected(&place, "closed.obj")["leaks"], serde_json::json!([]));
}

#[test]
fn points_in_solids_and_suns_that_have_set_are_told() {
    let place = Place::new();
    write(&place, "city.obj", city(false, true).as_bytes());
    // In the street, in a building, below the ground, on a wall, and on the ground.
    write(
        &place,
        "points.csv",
        "\u{FEFF}name,nx,ny,nz,x (m),y (m),z (m)\nstreet,0,0,1,15,5,1.5\nin,0,0,1,5,5,1.5\nunder,0,0,1,15,5,-0.5\n\
         wall,1,0,0,10,5,2\nground,0,0,1,15,5,0\ndown,0,0,-1,5,5,1.5\n"
            .as_bytes(),
    );
    write(
        &place,
        "suns.txt",
        "0 -1 1\n0 0 1\n0 0 -1\n0 -1 0\n0 -1 -0.2\n".as_bytes(),
    );
    let run = place
        .line("sky city.obj --up z --points points.csv --suns suns.txt -o S --json")
        .is(0)
        .says(&[
            "2 of 6 points in `points.csv` are in solids, surrounded by backs of one-sided surfaces: lines 3 and 7",
            "1 of 6 points in `points.csv` is below the ground, with its back above them: line 4",
            "2 of 5 suns in `suns.txt` are below the horizon and light nothing: lines 3 and 5",
        ]);
    let report = run.json();
    let expected = serde_json::json!([
        { "point": 1, "place": "in-solid" }, { "point": 2, "place": "below-ground" }, { "point": 5, "place": "in-solid" }
    ]);
    assert_eq!(report["points_not_in_the_open"], expected);
    assert_eq!(report["suns_below_horizon"], serde_json::json!([2, 4]));
    // A sun that has set lights a wall that faces it as little as one that shines from below a floor.
    write(&place, "set.txt", b"0 -1 -0.2\n");
    write(&place, "low.txt", b"0 -1 0.2\n");
    let sunlit = |file: &str| {
        place
            .line(&format!("sky city.obj --up z --suns {file} -o L --overwrite"))
            .is(0);
        let archive = std::fs::read(place.path("L/sky.npz")).expect("an archive");
        let at = archive.windows(8).position(|bytes| bytes == b"suns.npy").expect("suns");
        let magic = archive[at..]
            .windows(6)
            .position(|bytes| bytes == b"\x93NUMPY")
            .expect("an array")
            + at;
        let begin = magic + 10 + usize::from(u16::from_le_bytes([archive[magic + 8], archive[magic + 9]]));
        let patches = 2 * (1 + 16 * 6);
        archive[begin..begin + 4 * patches]
            .chunks_exact(4)
            .filter(|lit| **lit != [0; 4])
            .count()
    };
    assert_eq!(sunlit("set.txt"), 0);
    assert!(sunlit("low.txt") >= 32, "the south walls");

    write(&place, "spherical.txt", b"15 5 1.1\n");
    place
        .line("sky city.obj --up z --points spherical.txt -o N")
        .is(2)
        .says(&["spherical.txt:1: `15 5 1.1` has 3 numbers", "normal `nx ny nz`"]);
    let utf_16: Vec<u8> = "\u{FEFF}0 0 1 0 0 1\n"
        .encode_utf16()
        .flat_map(u16::to_le_bytes)
        .collect();
    write(&place, "wide.txt", &utf_16);
    place
        .line("sky city.obj --up z --points wide.txt -o N")
        .is(2)
        .says(&["is UTF-16 text; save it as UTF-8"]);
}

#[test]
fn marks_of_byte_order_are_taken_by_every_text_format() {
    let place = Place::new();
    let ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
               element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    let stl = "solid s\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid s\n";
    let vs3 = "F 3\nV 1 0 0 0\nV 2 1 0 0\nV 3 0 1 0\nS 1 1 2 3 0 0 0 0.9 wall\nE\n";
    let obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    let json = "{\"type\":\"CityJSON\",\"version\":\"2.0\",\"transform\":{\"scale\":[1,1,1],\"translate\":[0,0,0]},\
                \"vertices\":[[0,0,0],[1,0,0],[0,1,0]],\"CityObjects\":{\"a\":{\"type\":\"Building\",\"geometry\":\
                [{\"type\":\"MultiSurface\",\"lod\":\"2\",\"boundaries\":[[[0,1,2]]]}]}}}";
    for (name, text) in [
        ("s.ply", ply),
        ("s.stl", stl),
        ("s.vs3", vs3),
        ("s.obj", obj),
        ("s.json", json),
    ] {
        write(&place, name, text.as_bytes());
        let plain = place.line(&format!("inspect {name} --json --config=none")).is(0).json();
        write(&place, name, format!("\u{FEFF}{text}").as_bytes());
        let marked = place.line(&format!("inspect {name} --json --config=none")).is(0).json();
        assert_eq!(plain["scene"], marked["scene"], "{name}");
        for to_bytes in [u16::to_le_bytes, u16::to_be_bytes] {
            let wide: Vec<u8> = format!("\u{FEFF}{text}").encode_utf16().flat_map(to_bytes).collect();
            write(&place, name, &wide);
            place
                .line(&format!("inspect {name} --config=none"))
                .is(2)
                .says(&[name, "is UTF-16 text; save it as UTF-8"]);
        }
    }
}

#[test]
fn cold_temperatures_and_an_open_scene_are_questioned_once() {
    let place = Place::new();
    let open: Vec<_> = sides(ROOM[0], ROOM[1])
        .into_iter()
        .filter(|(name, _)| *name != "top")
        .map(|(name, quad)| (name.to_owned(), turned(quad)))
        .collect();
    write(&place, "open.obj", obj(&open).as_bytes());
    write(&place, "closed.obj", room(&[]).as_bytes());
    write(
        &place,
        "celsius.toml",
        b"[default]\nemissivity = 0.9\ntemperature = 20\n",
    );
    write(
        &place,
        "kelvin.toml",
        b"[default]\nemissivity = 0.9\ntemperature = 293.15\n",
    );
    for scene in ["open", "closed"] {
        place
            .line(&format!("compute {scene}.obj -o {scene} --config=none"))
            .is(0);
    }
    let solve = |line: &str| place.line(&format!("solve {line} --thermal")).is(0).err;
    let questions = |text: &str| {
        [
            text.matches("degrees Celsius").count(),
            text.matches("(0: cold space)").count(),
        ]
    };
    assert_eq!(questions(&solve("closed --materials kelvin.toml")), [0, 0]);
    assert_eq!(questions(&solve("closed --materials celsius.toml")), [1, 0]);
    assert_eq!(questions(&solve("open --materials kelvin.toml")), [0, 1]);
    assert_eq!(
        questions(&solve("open --materials kelvin.toml --sky-temperature 0")),
        [0, 0]
    );
    assert_eq!(
        questions(&solve("open --materials kelvin.toml --sky-temperature 290")),
        [0, 0]
    );
    let both = solve("open --materials celsius.toml --sky-temperature 15");
    assert_eq!(questions(&both), [1, 0]);
    assert!(
        both.contains("20 K of faces without a material") && both.contains("15 K of `--sky-temperature`"),
        "{both}"
    );
}

/// A material library that is not read, or a table in another coding, is named with the line to take.
#[test]
fn libraries_tables_and_conditions_in_utf_16_are_named() {
    let place = Place::new();
    let wide = |text: &str, mark: &str| -> Vec<u8> {
        format!("{mark}{text}")
            .encode_utf16()
            .flat_map(u16::to_le_bytes)
            .collect()
    };
    write(&place, "s.mtl", &wide("newmtl red\nKd 0.5 0.1 0.1\n", "\u{FEFF}"));
    write(
        &place,
        "s.obj",
        b"mtllib s.mtl\nusemtl red\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 0 1 1\nf 1 2 3\nf 4 6 5\n",
    );
    place.line("compute s.obj -o S --config=none").is(0);
    let said = place.line("solve S --scene s.obj").is(2).err;
    assert!(
        said.contains("s.mtl") && said.contains("is UTF-16 text; save it as UTF-8"),
        "{said}"
    );
    place
        .line("compute s.obj -o M --config=none --specular scene")
        .is(2)
        .says(&[
            "the mirrors and panes of `s.obj`",
            "s.mtl",
            "is UTF-16 text; save it as UTF-8",
        ]);
    let conditions = "[default]\nemissivity = 0.9\ntemperature = 300\n";
    for mark in ["\u{FEFF}", ""] {
        write(&place, "m.toml", &wide(conditions, mark));
        write(&place, "t.csv", &wide("*,300\n", mark));
        write(&place, "p.txt", b"0.2 0.2 0.5\n");
        place
            .line("solve S --thermal --materials m.toml --sky-temperature 300")
            .is(2)
            .says(&["m.toml", "is UTF-16 text; save it as UTF-8"]);
        place
            .line("points s.obj --up z --points p.txt --temperatures t.csv --sky-temperature 300")
            .is(2)
            .says(&["t.csv", "is UTF-16 text; save it as UTF-8"]);
    }
    // Degrees Celsius without their sign.
    write(&place, "t.csv", b"*,20\n");
    let asked = place
        .line("points s.obj --up z --points p.txt --temperatures t.csv --sky-temperature 10")
        .is(0)
        .err;
    assert_eq!(asked.matches("degrees Celsius").count(), 1, "{asked}");
    assert!(
        asked.contains("20 K of `*`") && asked.contains("10 K of `--sky-temperature`"),
        "{asked}"
    );
    write(&place, "t.csv", "*,20 °C\n".as_bytes());
    let asked = place
        .line("points s.obj --up z --points p.txt --temperatures t.csv --sky-temperature 283")
        .is(0)
        .err;
    assert_eq!(asked.matches("degrees Celsius").count(), 0, "{asked}");
}

#[test]
fn cases_from_the_field() {
    let test = "cases_from_the_field";
    let place = Place::new();
    let of = |file: PathBuf| file.display().to_string();
    if let Some(folder) = case(test, "winding") {
        let wall = sentences(&inspected(&place, &of(folder.join("onewall.obj"))));
        assert!(
            wall.len() == 1 && wall[0].starts_with("`west` faces the wrong way"),
            "{wall:?}"
        );
        let all = sentences(&inspected(&place, &of(folder.join("allflip.obj"))));
        assert!(
            all.len() == 1 && all[0].contains("wound outwards throughout"),
            "{all:?}"
        );
        assert!(sentences(&inspected(&place, &of(folder.join("good.obj")))).is_empty());
    }
    if let Some(folder) = case(test, "leak") {
        let said = place
            .line(&format!("inspect {} --config=none", of(folder.join("hole.obj"))))
            .is(0)
            .out;
        assert!(said.contains("`north` at x 2.25–3, y 5, z 1.012–1.35"), "{said}");
    }
    if let Some(folder) = case(test, "sensor-points") {
        let line = format!("sky {} --up z -o P --overwrite --points ", of(folder.join("two.obj")));
        place
            .line(&format!("{line}{}", of(folder.join("pts.txt"))))
            .is(0)
            .says(&["lines 2 and 6", "line 4"]);
        place.line(&format!("{line}{}", of(folder.join("header.csv")))).is(0);
        place
            .line(&format!("{line}{}", of(folder.join("spherical.txt"))))
            .is(2)
            .says(&[":1: ", "`nx ny nz`"]);
    }
    if let Some(folder) = case(test, "bom") {
        for name in ["bom.ply", "bom.stl", "bom.vs3"] {
            place
                .line(&format!("inspect {} --config=none", of(folder.join(name))))
                .is(0);
        }
    }
    if let Some(folder) = case(test, "sun-below-horizon") {
        let (scene, suns) = (of(folder.join("shade.obj")), of(folder.join("suns_ok.txt")));
        place
            .line(&format!("sky {scene} --up z --suns {suns} -o P --overwrite"))
            .is(0)
            .says(&["2 of 6 suns", "lines 4 and 6"]);
    }
}

#[test]
fn a_file_without_triangles_says_what_it_has_instead() {
    let place = Place::new();
    let strip = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                 element face 0\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n";
    place.write("none.ply", strip);
    place
        .line("inspect none.ply")
        .is(2)
        .says(&["none.ply: holds no triangle"]);
    let cell = "# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 float\n\
                0 0 0 1 0 0 0 1 0 0 0 1\n\
                CELLS 1 5\n4 0 1 2 3\nCELL_TYPES 1\n42\n";
    place.write("poly.vtk", cell);
    place
        .line("inspect poly.vtk")
        .is(2)
        .says(&["poly.vtk: holds no triangle that is read", "1 × polyhedron, not read"]);
    let text = "# exported by a tool that puts its name first, and then some more words to fill a header\n\
                solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n\
                endsolid a\n";
    place.write("named.stl", text);
    place
        .line("inspect named.stl")
        .is(2)
        .says(&["named.stl:1: is text that does not begin with `solid`"]);
}
