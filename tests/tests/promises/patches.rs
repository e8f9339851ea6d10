//! Patches by face, object or material: surfaces of enclosures against closed forms, whatever their triangles;
//! aggregates of the triangles' own matrix; and the same bytes whoever computes them, and however often it is
//! interrupted.

use glam::DVec3;
use hemicube_tests::geometry::{between_polygons, box_inside, circle, flipped, parallel_rectangles};
use hemicube_tests::geometry::{perpendicular_rectangles, polygon_area};
use hemicube_tests::runs::{Place, assert_same, finish, until};
use hemicube_tests::scenes::{say, scenes_or_skip};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::process::Command;

/// An OBJ of polygons, an object each, of one material each.
fn obj(surfaces: &[(&str, Vec<Vec<DVec3>>)]) -> String {
    let (mut text, mut next) = (String::new(), 1);
    for (name, polygons) in surfaces {
        let _ = writeln!(text, "o {name}\nusemtl of_{name}");
        for polygon in polygons {
            for corner in polygon {
                let _ = writeln!(text, "v {} {} {}", corner.x, corner.y, corner.z);
            }
            let corners: Vec<String> = (next..next + polygon.len()).map(|corner| corner.to_string()).collect();
            let _ = writeln!(text, "f {}", corners.join(" "));
            next += polygon.len();
        }
    }
    text
}

/// A table of zones: the numbers of each row, by the names of rows and columns; NaN where no row was computed.
type Table = BTreeMap<String, BTreeMap<String, f64>>;

fn table(place: &Place, store: &str, by: &str) -> Table {
    place
        .line(&format!("export {store} -o {store}-{by}.csv --by {by} --overwrite -q"))
        .is(0);
    let text = std::fs::read_to_string(place.path(format!("{store}-{by}.csv"))).expect("a table");
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().expect("a header").split(',').collect();
    let row = |line: &str| {
        let cells: Vec<&str> = line.split(',').collect();
        let numbers = header.iter().zip(&cells).skip(1);
        let number = |cell: &str| {
            if cell.is_empty() {
                f64::NAN
            } else {
                cell.parse().expect("a number")
            }
        };
        let numbers = numbers.map(|(name, cell)| ((*name).to_owned(), number(cell)));
        (cells[0].to_owned(), numbers.collect())
    };
    lines.map(row).collect()
}

/// Computes `scene.obj` by object to 0.01 % in several ways of cutting it, and holds the form factors against
/// `expected`, by names.
fn holds_however_it_is_cut(scene: &str, cuts: &[&str], expected: &[(&str, &str, f64)]) {
    let place = Place::new();
    place.write("scene.obj", scene);
    for cut in cuts {
        place
            .line(&format!(
                "compute scene.obj -o F --overwrite -q --by object --tolerance 0.01% {cut}"
            ))
            .is(0);
        place.line("check F -q").is(0);
        let found = table(&place, "F", "object");
        let norm: f64 = expected.iter().map(|(_, _, factor)| factor * factor).sum();
        let off = |(from, to, factor): &(&str, &str, f64)| (found[*from][*to] - factor).powi(2);
        let error = (expected.iter().map(off).sum::<f64>() / norm).sqrt();
        assert!(error < 1e-4, "`{cut}`: {error:e}, {found:?}");
        for (from, to, factor) in expected {
            let off = found[*from][*to] - factor;
            assert!(
                off.abs() < 1e-4 * factor.max(0.1),
                "`{cut}`: {from} to {to} is off by {off:e}"
            );
        }
    }
}

const SIDES: [&str; 6] = ["floor", "ceiling", "west", "east", "south", "north"];

#[test]
fn a_cube_has_six_surfaces_however_it_is_cut() {
    let faces = box_inside(DVec3::ONE);
    let surfaces: Vec<_> = SIDES
        .into_iter()
        .zip(faces)
        .map(|(name, face)| (name, vec![face.to_vec()]))
        .collect();
    let (opposite, beside) = (
        parallel_rectangles(1.0, 1.0, 1.0),
        perpendicular_rectangles(1.0, 1.0, 1.0),
    );
    let mut expected = Vec::new();
    for (i, from) in SIDES.into_iter().enumerate() {
        for (j, to) in SIDES.into_iter().enumerate() {
            let factor = match () {
                () if i == j => 0.0,
                () if i / 2 == j / 2 => opposite,
                () => beside,
            };
            expected.push((from, to, factor));
        }
    }
    let cuts = ["", "--split 2", "--split 3", "--patch-size 0.45"];
    holds_however_it_is_cut(&obj(&surfaces), &cuts, &expected);
}

#[test]
fn hinged_plates_and_a_prism_have_their_closed_forms() {
    // Two unit squares on one edge, at 60 degrees: of an open wedge, and in a closed prism.
    let (root, up) = (3f64.sqrt() / 2.0, DVec3::Z);
    let apex = DVec3::new(0.5, root, 0.0);
    let (a, b) = (DVec3::ZERO, DVec3::X);
    // Seen from inside: along x, back from it, and the two ends.
    let bottom = vec![a, a + up, b + up, b];
    let right = vec![b, b + up, apex + up, apex];
    let left = vec![apex, apex + up, a + up, a];
    let ends = [vec![a, b, apex], vec![apex + up, b + up, a + up]];
    let across = between_polygons(&ends[0], &ends[1]);
    // By closure and reciprocity: what an end does not send across goes to the sides, a third to each, and what a side
    // does not send to the ends goes to the other two.
    let back = polygon_area(&ends[0]) * (1.0 - across) / 3.0;
    let plates = obj(&[("bottom", vec![bottom.clone()]), ("left", vec![left.clone()])]);
    let factor = 0.5 - back;
    let expected = [
        ("bottom", "left", factor),
        ("left", "bottom", factor),
        ("left", "left", 0.0),
    ];
    holds_however_it_is_cut(&plates, &["", "--split 3"], &expected);
    let prism = obj(&[
        ("sides", vec![bottom.clone(), right.clone(), left.clone()]),
        ("near", vec![ends[0].clone()]),
        ("far", vec![ends[1].clone()]),
    ]);
    let expected = [
        ("near", "far", across),
        ("near", "sides", 1.0 - across),
        ("sides", "far", back),
        ("sides", "sides", 1.0 - 2.0 * back),
    ];
    holds_however_it_is_cut(&prism, &["", "--split 2"], &expected);
}

/// A cylinder of n sides, seen from inside.
fn cylinder(sides: u32, height: f64) -> String {
    let (low, high) = (circle(sides, 1.0, 0.0), circle(sides, 1.0, height));
    let around = (0..low.len()).map(|k| {
        let next = (k + 1) % low.len();
        flipped([low[k], low[next], high[next], high[k]]).to_vec()
    });
    let top: Vec<DVec3> = high.iter().rev().copied().collect();
    obj(&[
        ("bottom", vec![low.clone()]),
        ("around", around.collect()),
        ("top", vec![top]),
    ])
}

#[test]
fn a_cylinder_sees_itself() {
    let (sides, height) = (12, 1.5);
    let (low, high) = (circle(sides, 1.0, 0.0), circle(sides, 1.0, height));
    let top: Vec<DVec3> = high.iter().rev().copied().collect();
    let across = between_polygons(&low, &top);
    let around = f64::from(sides) * low[0].distance(low[1]) * height;
    let back = polygon_area(&low) * (1.0 - across) / around;
    let expected = [
        ("bottom", "top", across),
        ("bottom", "around", 1.0 - across),
        ("around", "top", back),
        ("around", "around", 1.0 - 2.0 * back),
        ("top", "top", 0.0),
    ];
    holds_however_it_is_cut(&cylinder(sides, height), &["", "--split 2"], &expected);
}

/// A closed room of n × n quads a side with a box of quads on its floor.
fn quads(n: u32) -> String {
    obj(&surfaces(n))
}

fn surfaces(n: u32) -> Vec<(&'static str, Vec<Vec<DVec3>>)> {
    let grid = |[a, b, _, d]: [DVec3; 4]| {
        let at =
            move |i: u32, j: u32| a + (b - a) * (f64::from(i) / f64::from(n)) + (d - a) * (f64::from(j) / f64::from(n));
        let cell = move |k: u32| {
            let (i, j) = (k / n, k % n);
            vec![at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]
        };
        (0..n * n).map(cell).collect::<Vec<_>>()
    };
    let mut surfaces: Vec<(&str, Vec<Vec<DVec3>>)> = Vec::new();
    for (name, face) in SIDES.into_iter().zip(box_inside(DVec3::new(3.0, 2.0, 1.0))) {
        surfaces.push((name, grid(face)));
    }
    let shift = DVec3::new(1.1, 0.6, 0.2);
    let block = box_inside(DVec3::new(0.7, 0.9, 0.5)).map(|face| flipped(face.map(|corner| corner + shift)));
    surfaces.push(("block", block.into_iter().flat_map(grid).collect()));
    surfaces
}

/// Largest relative difference of the factors, areas and shares of two tables; both have the same zeros.
fn difference(one: &Table, other: &Table) -> f64 {
    assert!(one.keys().eq(other.keys()));
    let mut worst: f64 = 0.0;
    for (a, b) in one.values().zip(other.values()) {
        assert!(a.keys().eq(b.keys()));
        for ((name, &a), &b) in a.iter().zip(b.values()) {
            if name != "patches" {
                assert_eq!(a == 0.0, b == 0.0, "{name}: {a} and {b}");
                worst = worst.max(if b == 0.0 { 0.0 } else { (a / b - 1.0).abs() });
            }
        }
    }
    worst
}

/// Half a unit in the last place of single precision, and the rounding of sums in double precision.
const ROUNDING: f64 = 6e-8;

#[test]
fn quads_are_the_aggregate_of_their_triangles() {
    let place = Place::new();
    place.write("room.obj", quads(4));
    let compute = |name: &str, kind: &str| {
        let line = format!("compute room.obj -o {name} --by {kind} --correction pixel --json --threads 2");
        place.line(&line).is(0).json()
    };
    let (triangles, faces) = (compute("triangles", "triangle"), compute("faces", "face"));
    let count = |report: &serde_json::Value, key: &str| report[key].as_f64().expect("a number");
    assert_eq!(count(&faces, "rows") * 2.0, count(&triangles, "rows"));
    let entries = count(&faces, "entries") / count(&triangles, "entries");
    assert!((entries - 0.25).abs() < 0.02, "{entries} of the entries");
    let worst = difference(&table(&place, "faces", "face"), &table(&place, "triangles", "face"));
    assert!(worst < ROUNDING, "{worst:e}");
    // Faces are of one object each: their matrix is added up as the triangles' is.
    let worst = difference(&table(&place, "faces", "object"), &table(&place, "triangles", "object"));
    assert!(worst < ROUNDING, "{worst:e}");
    place.line("check faces -q").is(0);
    // The comparison does find a difference.
    compute("other", "face --resolution 64");
    let other = difference(&table(&place, "other", "object"), &table(&place, "triangles", "object"));
    assert!(other > 1e-5, "{other:e}");
}

#[test]
fn a_city_by_object_and_by_material_is_the_aggregate_of_its_triangles() {
    let Some(scenes) = scenes_or_skip("patches") else {
        return;
    };
    let place = Place::new();
    let city = scenes.join("city/denhaag-8897.obj").display().to_string();
    let settings = "--correction pixel --resolution 64 -q";
    place.line(&format!("compute {city} -o triangles {settings}")).is(0);
    for kind in ["object", "material"] {
        place
            .line(&format!("compute {city} -o by-{kind} --by {kind} {settings}"))
            .is(0);
        let by = format!("by-{kind}");
        let worst = difference(&table(&place, &by, kind), &table(&place, "triangles", kind));
        say(&format!("denhaag-8897 by {kind}: {worst:e} off the aggregate"));
        assert!(worst < ROUNDING, "{kind}: {worst:e}");
        place.line(&format!("check {by} -q")).is(0);
    }
}

const CITY: &str = "compute city.obj --by object --correction pixel --resolution 32 -q";

fn city(patches: u32) -> Place {
    let place = Place::new();
    place
        .line(&format!("generate city --patches {patches} --seed 3 -o city.obj"))
        .is(0);
    place
}

#[test]
fn threads_batches_shards_and_kills_change_no_byte() {
    let place = city(4_000);
    for form in ["", "--form compact --min-factor 1e-4", "--rows 50% --seed 4"] {
        let run = |more: &str| place.line(&format!("{CITY} {form} {more}")).is(0);
        run("-o whole --overwrite --threads 2");
        run("-o other --overwrite --threads 1 --batch 7");
        assert_same(&place.path("whole"), &place.path("other"));
        for shard in 1..=3 {
            run(&format!("-o shards --shard {shard}/3"));
        }
        place.line("merge shards -q").is(0);
        assert_same(&place.path("whole"), &place.path("shards"));
        std::fs::remove_dir_all(place.path("shards")).expect("removed");

        let mut child = place.spawn(place.command(&format!("{CITY} {form} -o killed --threads 1")));
        let parts = place.path("killed/parts");
        let has_parts = || std::fs::read_dir(&parts).is_ok_and(|found| found.count() > 2);
        until("a part is written", || {
            has_parts() || child.try_wait().expect("a child").is_some()
        });
        let _ = Command::new("kill").args(["-KILL", &child.id().to_string()]).status();
        finish(child);
        let resumed = run("-o killed --threads 2");
        assert!(!resumed.err.contains("computed again"), "{}", resumed.err);
        assert_same(&place.path("whole"), &place.path("killed"));
        std::fs::remove_dir_all(place.path("killed")).expect("removed");
    }
    // The manifests of triangles know nothing of it.
    place
        .line("compute city.obj --by triangle --rows 0..9 -q -o plain")
        .is(0);
    let manifest = std::fs::read_to_string(place.path("plain/manifest.json")).expect("a manifest");
    assert!(
        !manifest.contains("elements") && manifest.contains("\"version\": 5"),
        "{manifest}"
    );
}

#[test]
fn rows_of_patches_are_chosen_by_patch() {
    let place = Place::new();
    place.write("room.obj", quads(2));
    let compute = |line: &str| place.line(&format!("compute room.obj --overwrite {line}"));
    let of = |name: &str| table(&place, name, "object");
    compute("-o all --by object -q").is(0);
    compute("-o some --by object -q --rows 1..3").is(0);
    assert_eq!(of("some")["ceiling"], of("all")["ceiling"]);
    assert!(of("some")["floor"]["west"].is_nan(), "no row, no factors");
    // Objects without a column are unselected as wholes.
    compute("-o few --by object -q --receivers b*").is(0);
    let (few, all) = (of("few"), of("all"));
    let floor = &few["floor"];
    // Rows are refined by their columns: near, not equal. Each may be off by 2 % of its norm.
    let walls = ["block", "ceiling", "floor", "east", "north", "south", "west"];
    let norm = walls.map(|name| all["floor"][name].powi(2)).iter().sum::<f64>().sqrt();
    let off = (floor["block"] - all["floor"]["block"]) / norm;
    assert!(off.abs() < 0.04 && floor["west"] == 0.0, "{off:e}, {few:?}");
    assert!((floor["block"] + floor["unselected"] + floor["blocked"] + floor["escaped"] - 1.0).abs() < 0.01);
    compute("-o no --by object -q --rows 3..8")
        .is(2)
        .says(&["the scene has 7 patches"]);
    compute("-o no --by material -q --emitters of_west").is(0);
    compute("-o no --by material -q --emitters block --occluders wes*").is(0);
    compute("-o no --by object --rows 0..1 -q --emitters nothing").is(2);
    compute("-o no --by surface -q").is(2).says(&["surface"]);
}

#[test]
fn what_needs_one_material_says_so() {
    let place = Place::new();
    // An object of two materials, and a material of two objects.
    let text = quads(1).replacen("usemtl of_ceiling", "usemtl of_floor", 1);
    let (before, after) = text.split_once("o block\n").expect("a block");
    let (first, rest) = after.split_once("\nf ").expect("a face");
    let mixed = format!(
        "{before}o block\n{first}\nf {}",
        rest.replacen("\nv ", "\nusemtl other\nv ", 1)
    );
    place.write("room.obj", &mixed);
    place.line("compute room.obj -o objects --by object -q").is(0);
    place
        .line("compute room.obj -o no --by object --emitters other -q")
        .is(2)
        .says(&["`--emitters`", "of the object `block`", "--by face"]);
    place
        .line("export objects -o x.csv --by material")
        .is(2)
        .says(&["matrix of patches by object", "by material"]);
    place.write(
        "other.toml",
        "[default]\nreflectance = 0.5\n\n[material.other]\nreflectance = 0.9\n",
    );
    place.line("solve objects --materials other.toml").is(2).says(&[
        "`block`",
        "several materials",
        "a reflectance",
        "--by face",
    ]);
    // Another scene, and another kind.
    place.write("other.obj", quads(2));
    place
        .line("export objects -o x.vtp --scene other.obj")
        .is(2)
        .says(&["is not the scene"]);
    place
        .line("compute room.obj -o objects -q")
        .is(2)
        .says(&["it was computed with rows by object, and here it is with rows by triangle"]);
    // By material everything has one.
    place.line("compute room.obj -o materials --by material -q").is(0);
    place
        .line("compare objects materials")
        .is(2)
        .says(&["by object and by material"]);
    place.write(
        "m.toml",
        "[default]\nreflectance = 0.5\n[material.other]\nemission = 1\n",
    );
    let solved = place.line("solve materials --materials m.toml -o light.csv");
    assert_eq!(solved.code, Some(0), "{}", solved.err);
    let light = std::fs::read_to_string(place.path("light.csv")).expect("a table");
    assert_eq!(light.lines().count(), 1 + 7, "{light}");
}

/// Columns of a table of patches, by their names.
fn columns(place: &Place, file: &str) -> BTreeMap<String, Vec<f64>> {
    let text = std::fs::read_to_string(place.path(file)).expect("a table");
    let mut lines = text.lines();
    let names: Vec<String> = lines.next().expect("a header").split(',').map(str::to_owned).collect();
    let mut found: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    for line in lines {
        for (name, cell) in names.iter().zip(line.split(',')) {
            found
                .entry(name.clone())
                .or_default()
                .push(cell.parse().unwrap_or(f64::NAN));
        }
    }
    found
}

#[test]
fn the_sky_of_a_patch_is_the_mean_of_its_triangles() {
    let place = Place::new();
    // Without its ceiling the room sees the sky, by parts that differ from triangle to triangle.
    let mut open = surfaces(2);
    open.retain(|(name, _)| *name != "ceiling");
    place.write("room.obj", obj(&open));
    for (name, more) in [("triangles", ""), ("objects", "--by object")] {
        place
            .line(&format!(
                "compute room.obj -o {name} --correction pixel --split 2 -q {more}"
            ))
            .is(0);
        place
            .line(&format!("sky room.obj --matrix {name} --up z -q -o {name}-sky.csv"))
            .is(0);
        place.line(&format!("check {name} -q")).is(0);
    }
    let (triangles, objects) = (columns(&place, "triangles-sky.csv"), columns(&place, "objects-sky.csv"));
    let names = std::fs::read_to_string(place.path("triangles-sky.csv")).expect("a table");
    let object_of: Vec<&str> = names
        .lines()
        .skip(1)
        .filter_map(|line| line.split(',').nth(1))
        .collect();
    let text = std::fs::read_to_string(place.path("objects-sky.csv")).expect("a table");
    let mut spread = 0.0_f64;
    for (row, line) in text.lines().skip(1).enumerate() {
        let object = line.split(',').nth(1).expect("a name");
        let (mut area, mut sum) = (0.0, 0.0);
        for (k, _) in object_of.iter().enumerate().filter(|(_, name)| **name == object) {
            area += triangles["area"][k];
            sum += triangles["area"][k] * triangles["sky_view_factor"][k];
            spread = spread.max((triangles["sky_view_factor"][k] - objects["sky_view_factor"][row]).abs());
        }
        let off = objects["sky_view_factor"][row] - sum / area;
        assert!((objects["area"][row] / area - 1.0).abs() < 1e-12);
        // Columns are scaled to what the matrix says a patch loses, which is in f64 from f32 shares of triangles.
        assert!(off.abs() < 1e-6, "{object}: {off:e}");
    }
    assert!(spread > 0.05, "triangles of one object see alike: {spread}");

    // Suns and points are of the patches, too, and light from the sky is that of the surfaces' means.
    place.write("suns.txt", "0 0 1\n1 0 1\n");
    place.write("points.txt", "0.5 0.5 0.4 0 0 1\n");
    place
        .line("sky room.obj --matrix objects --up z -q --suns suns.txt --points points.txt")
        .is(0);
    let sky = hemicube::sky::StoredSky::open(&place.path("objects/sky/sky.npz")).expect("sky rows");
    assert_eq!(sky.rows(), objects["area"].len());
    place.line("check objects -q").is(0);
    place.write(
        "m.toml",
        "[default]\nreflectance = 0.5\n[material.of_floor]\nemission = 1\n",
    );
    place.line("solve objects --materials m.toml -o light.csv -q").is(0);
    place.write("heat.toml", "[default]\nemissivity = 0.9\ntemperature = 293\n");
    place
        .line("solve objects --materials heat.toml --thermal --sky-temperature 260 --ground-temperature 280 -q")
        .is(0);
}

#[test]
fn a_hemicube_of_a_patch_stands_on_its_middle_triangle() {
    let place = Place::new();
    place.write("room.obj", quads(3));
    place.line("compute room.obj -o objects --by object -q").is(0);
    // The floor is 3 × 3 quads of two triangles: the middle one's are 8 and 9.
    let found = place.line("view hemicube room.obj --matrix objects --patch 0 -o x.svg");
    let found = found.is(0);
    let said = format!("{}{}", found.out, found.err);
    let name = said.split("object ").nth(1).and_then(|rest| rest.split(',').next());
    let triangle = said
        .split("from triangle ")
        .nth(1)
        .and_then(|rest| rest.split(' ').next());
    assert!(matches!(triangle, Some("8" | "9")), "{said}");
    assert!(name.is_some_and(|name| SIDES.contains(&name)), "{said}");
    place
        .line("view hemicube room.obj --matrix objects --patch 7 -o y.svg")
        .is(2)
        .says(&["the scene has 7 patches"]);
}

#[test]
fn values_of_patches_are_on_all_of_their_triangles() {
    let place = Place::new();
    place.write("room.obj", quads(2));
    place.line("compute room.obj -o objects --by object --split 2 -q").is(0);
    place.line("export objects -o patches.csv -q --results").is(0);
    place
        .line("export objects -o triangles.csv --scene room.obj -q --results")
        .is(0);
    let read = |name: &str| std::fs::read_to_string(place.path(name)).expect("a table");
    let (patches, triangles) = (read("patches.csv"), read("triangles.csv"));
    assert_eq!(patches.lines().count(), 1 + 7);
    // 48 quads, two triangles each, cut into four.
    assert_eq!(triangles.lines().count(), 1 + 48 * 2 * 4);
    let column = |text: &str, name: &str| -> Vec<String> {
        let header: Vec<&str> = text.lines().next().expect("a header").split(',').collect();
        let at = header.iter().position(|found| *found == name).expect("a column");
        text.lines()
            .skip(1)
            .map(|line| line.split(',').nth(at).expect("a cell").to_owned())
            .collect()
    };
    let sums = column(&patches, "row_sum");
    for (patch, sum) in column(&triangles, "patch").iter().zip(column(&triangles, "row_sum")) {
        assert_eq!(sum, sums[patch.parse::<usize>().expect("a patch")]);
    }
    for file in ["x.vtp", "x.vtu", "x.ply", "x.glb --up z"] {
        place
            .line(&format!("export objects -o {file} --scene room.obj -q"))
            .is(0);
    }
    let view = "view model objects room.obj --show row --patch 6 -o x.png --up z --eye 0.3,0.3,0.8 --look-at 1.5,1,0.3";
    place.line(view).is(0);
    place.line("view sparsity objects -o s.png").is(0);
    place
        .line("balance objects -o balanced --closure --reciprocity -q")
        .is(0);
    place
        .line("check balanced -q --max-closure 1e-5 --max-reciprocity 1e-5")
        .is(0);
    place.line("compare balanced objects -q").is(0);
}

/// The first number of a name, anywhere in a report.
fn found(report: &serde_json::Value, name: &str) -> Option<f64> {
    if let Some(number) = report.get(name).and_then(serde_json::Value::as_f64) {
        return Some(number);
    }
    let inner: Vec<&serde_json::Value> = match report {
        serde_json::Value::Object(fields) => fields.values().collect(),
        serde_json::Value::Array(items) => items.iter().collect(),
        _ => Vec::new(),
    };
    inner.into_iter().find_map(|value| found(value, name))
}

#[test]
fn a_tolerance_is_of_the_matrix_of_surfaces() {
    let place = Place::new();
    place.line("generate room --patches 1000 -o room.obj -q").is(0);
    place.write("quads.obj", quads(5));
    for (scene, kind) in [("room.obj", "object"), ("quads.obj", "object"), ("quads.obj", "face")] {
        let compute = |name: &str, accuracy: &str| {
            let line = format!("compute {scene} -o {name} --overwrite --by {kind} {accuracy} -q --json");
            place.line(&line).is(0).json()
        };
        let off = |name: &str| {
            let compared = place.line(&format!("compare {name} fine --json"));
            found(&compared.json(), "relative_frobenius").expect("an error")
        };
        compute("fine", "--tolerance 0.05%");
        let report = compute("asked", "--tolerance 1%");
        let reason = report["settings"]["reason"].as_str().unwrap_or_default().to_owned();
        assert!(reason.contains(&format!("added up by {kind}")), "{report}");
        let error = off("asked");
        say(&format!("{scene} by {kind}: {error:.5} off at 1 %; {reason}"));
        assert!(error <= 0.01, "{scene} by {kind}: {error}");
        // Rows still sum to 1 within the tolerance.
        place.line("check asked -q --max-closure 0.01").is(0);
        compute("coarse", "--correction pixel --resolution 16");
        let coarse = off("coarse");
        assert!(coarse > 2.0 * error, "a coarse one is found out: {coarse}");
    }
}

#[test]
fn verification_draws_from_large_patches_and_says_how_sure_it_is() {
    let place = Place::new();
    place.write("quads.obj", quads(6));
    let run = |more: &str| {
        let line = format!("compute quads.obj -o F --overwrite --by object --tolerance 2% --verify 3 --json -v {more}");
        place.line(&line)
    };
    // Each side has 72 triangles, 32 of which are drawn.
    let ran = run("").is(0);
    let said = ran.err.clone();
    assert!(said.contains("32 drawn of each of 3 large patches"), "{said}");
    let report = ran.json();
    let drawn = &report["verification"]["elements"];
    assert!(
        drawn["rows"].as_u64().is_some_and(|rows| (60..=96).contains(&rows)),
        "{report}"
    );
    let measured = &report["verification"]["measured"];
    let number = |value: &serde_json::Value| value.as_f64().expect("a number");
    let interval = &measured["interval_of_rows"];
    assert!(
        number(&interval["low"]) <= 0.02 && number(&interval["high"]) < 0.05,
        "{measured}"
    );
    assert!(
        number(&measured["reference_noise"]) > 0.0,
        "what the draw leaves open is told"
    );
    // A wrong aggregate is found: sums of coarse pixels.
    let coarse = place
        .line("compute quads.obj -o G --by object --correction pixel --resolution 16 --verify 3 --json")
        .is(0)
        .json();
    let coarse = number(&coarse["verification"]["measured"]["relative_frobenius"]);
    assert!(
        coarse > 2.0 * number(&measured["relative_frobenius"]),
        "{coarse} {measured}"
    );
}
