//! Rows taken over from the matrix of a scene before a change: `compute --update`.

use hemicube::driver::input::SceneInput;
use hemicube::driver::job::{Job, Sessions};
use hemicube::driver::update::{Taken, Update};
use hemicube::store::Part;
use hemicube::{HierarchyOptions, InputPatch, Model};
use hemicube_backend_cpu::CpuBackend;
use hemicube_scene::{Scene, Subdivision, generate};
use hemicube_spatial::glam::DVec3;
use hemicube_tests::random::Random;
use hemicube_tests::runs::{Place, assert_same};
use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::Path;
use std::sync::Arc;

fn input(scene: Scene) -> SceneInput {
    SceneInput::new(scene, "scene.obj", Subdivision::None.into()).expect("a scene")
}

/// Removes an object, moves it, or puts a copy of it beside it.
fn edited(scene: &Scene, random: &mut Random) -> Scene {
    let mut scene = scene.clone();
    let object = u32::try_from(random.below(scene.objects.len())).expect("few objects");
    let is_own = |triangle: &hemicube_scene::Triangle| triangle.object == object;
    let own: Vec<_> = scene
        .triangles
        .iter()
        .filter(|triangle| is_own(triangle))
        .copied()
        .collect();
    let size = own
        .iter()
        .flat_map(|t| t.corners)
        .fold(0.0, |size: f64, p| size.max(p.distance(own[0].corners[0])));
    let along = DVec3::new(random.unit() - 0.5, random.unit() - 0.5, 0.2 * random.unit()) * size;
    let moved = own.into_iter().map(|triangle| hemicube_scene::Triangle {
        corners: triangle.corners.map(|corner| corner + along),
        ..triangle
    });
    match random.below(3) {
        0 => scene.triangles.retain(|triangle| !is_own(triangle)),
        1 => {
            scene.triangles.retain(|triangle| !is_own(triangle));
            scene.triangles.extend(moved);
        }
        _ => scene.triangles.extend(moved),
    }
    scene
}

/// A row's entries, and its standard error of the norm.
type Row = (Vec<(i32, f64)>, f64);

fn rows(parts: &[Part]) -> BTreeMap<u32, Row> {
    let of_part = |part: &Part| -> Vec<(u32, Row)> {
        let row = |at: usize| {
            let (columns, factors) = part.row(at);
            let entries = columns.iter().copied().zip(factors).collect();
            (part.rows[at], (entries, f64::from(part.errors[at].norm)))
        };
        (0..part.rows.len()).map(row).collect()
    };
    parts.iter().flat_map(of_part).collect()
}

/// √Σ (F − G)² of two rows.
fn apart((a, _): &Row, (b, _): &Row) -> f64 {
    let mut differences: BTreeMap<i32, f64> = a.iter().copied().collect();
    for (column, factor) in b {
        *differences.entry(*column).or_default() -= factor;
    }
    differences
        .values()
        .map(|difference| difference * difference)
        .sum::<f64>()
        .sqrt()
}

fn compute(job: &Job, scene: &SceneInput, model: &Model, takes: bool) -> (BTreeMap<u32, Row>, Arc<Taken>) {
    let mut run = job
        .prepare(scene, model, Sessions::new(CpuBackend::new), &())
        .expect("a run");
    let taken = run.plan.taken.clone().expect("rows are looked for");
    if !takes {
        run.plan.taken = None;
    }
    let mut parts: Vec<Part> = Vec::new();
    let summary = run.compute(&mut parts, &()).expect("rows");
    assert_eq!(summary.taken, if takes { taken.count } else { 0 });
    (rows(&parts), taken)
}

/// Whether a segment meets one of some triangles.
fn is_stopped(start: DVec3, end: DVec3, triangles: &[[DVec3; 3]]) -> bool {
    let along = end - start;
    triangles.iter().any(|&[a, b, c]| {
        let (e, f) = (b - a, c - a);
        let normal = e.cross(f);
        let determinant = -along.dot(normal);
        let from = start - a;
        let t = from.dot(normal) / determinant;
        let moment = from.cross(along) / determinant;
        let (u, v) = (f.dot(moment), -e.dot(moment));
        t > 1e-9 && t < 1.0 - 1e-9 && u >= -1e-9 && v >= -1e-9 && u + v <= 1.0 + 1e-9
    })
}

fn point([a, b, c]: [DVec3; 3], random: &mut Random) -> DVec3 {
    let (mut u, mut v) = (random.unit(), random.unit());
    if u + v > 1.0 {
        (u, v) = (1.0 - u, 1.0 - v);
    }
    a + (b - a) * u + (c - a) * v
}

/// Triangles of one list that the other does not have.
fn only_in(one: &Scene, other: &Scene) -> Vec<[DVec3; 3]> {
    let key = |corners: &[DVec3; 3]| corners.map(|corner| corner.to_array().map(f64::to_bits));
    let there: HashSet<_> = other.triangles.iter().map(|triangle| key(&triangle.corners)).collect();
    let own = one.triangles.iter().map(|triangle| triangle.corners);
    own.filter(|corners| !there.contains(&key(corners))).collect()
}

/// Rows of patches from which rays reach something that changed: of those taken over, and of the others.
fn rows_that_see_the_change(
    old: &Scene,
    new: &SceneInput,
    model: &Model,
    taken: &Taken,
    random: &mut Random,
) -> [usize; 2] {
    let changed: Vec<_> = only_in(old, new).into_iter().chain(only_in(new, old)).collect();
    let added = only_in(new, old);
    let of_new = new.triangles.iter().map(|triangle| triangle.corners);
    let still: Vec<[DVec3; 3]> = of_new.filter(|corners| !added.contains(corners)).collect();
    let mut seeing = [0, 0];
    for patch in model.patches().iter().step_by(3) {
        let (corners, normal) = (model.patches().corners(patch), model.patches().normal(patch));
        let sees = (0..48).any(|_| {
            let (from, to) = (
                point(corners, random),
                point(changed[random.below(changed.len())], random),
            );
            let height = normal.dot(to - from);
            height > 1e-6 * (to - from).length() && !is_stopped(from, to, &still)
        });
        seeing[usize::from(!taken.is_taken(patch))] += usize::from(sees);
    }
    seeing
}

/// Edits scenes at random, and holds each row taken over against the one computed, and against rays.
fn rows_taken_over_are_right(edits: u64) {
    let scenes = [
        (
            "block city",
            generate::BlockCityParameters::for_target(900, 3)
                .generate()
                .expect("a city"),
        ),
        (
            "city",
            generate::CityParameters {
                target: Some(900),
                ..generate::CityParameters::default()
            }
            .generate()
            .expect("a city"),
        ),
        (
            "maze",
            generate::MazeParameters::for_target(900, 1).generate().expect("a maze"),
        ),
        (
            "spheres",
            generate::SpheresParameters::for_target(900, 1)
                .generate()
                .expect("spheres"),
        ),
    ];
    let (mut all, mut kept, mut equal, mut other, mut seeing) = (0, 0, 0, 0, 0);
    for (name, scene) in scenes {
        let place = Place::new();
        let old = input(scene);
        let old_model = old.model(HierarchyOptions::default()).expect("a model");
        let directory = place.path("old");
        Job::default()
            .store(&old, &old_model, Sessions::new(CpuBackend::new), &directory)
            .expect("a store");
        for edit in 0..edits {
            let mut random = Random(1 + edit);
            let new = input(edited(&old, &mut random));
            let model = new.model(HierarchyOptions::default()).expect("a model");
            let update = Arc::new(Update::open(&directory, model.patches()).expect("an update"));
            let model = update.number(model);
            let job = Job {
                update: Some(update),
                ..Job::default()
            };
            let (updated, taken) = compute(&job, &new, &model, true);
            let (fresh, _) = compute(&job, &new, &model, false);
            assert_eq!(updated.len(), fresh.len());
            let norm =
                (fresh.values().flat_map(|(row, _)| row).map(|(_, f)| f * f).sum::<f64>() / fresh.len() as f64).sqrt();
            for (&patch, row) in &updated {
                all += 1;
                if !taken.is_taken(InputPatch(patch)) {
                    assert_eq!(row, &fresh[&patch], "{name}, edit {edit}: row {patch} is computed");
                    continue;
                }
                kept += 1;
                equal += usize::from(row == &fresh[&patch]);
                let (apart, expected) = (apart(row, &fresh[&patch]), row.1.hypot(fresh[&patch].1));
                assert!(
                    apart <= 3.0 * expected + 0.02 * norm,
                    "{name}, edit {edit}: row {patch} taken over is {apart} off, {expected} expected"
                );
                other += usize::from(apart > 1e-3 * norm);
            }
            let found = rows_that_see_the_change(&old, &new, &model, &taken, &mut random);
            assert_eq!(found[0], 0, "{name}, edit {edit}: rows taken over see the change");
            seeing += found[1];
        }
    }
    hemicube_tests::scenes::say(&format!(
        "{kept} of {all} rows taken over, {equal} of them equal to the bit, {other} off by a thousandth; {seeing} of a third of \
         the others see the change"
    ));
    assert!(seeing > 100, "rays find rows that see the change");
    // Which pairs are measured, and with how many rays, depends on what stands between patches that do not see it, too.
    assert!(4 * kept > all && 2 * equal > kept && 50 * other < kept);
}

#[test]
fn a_row_taken_over_sees_nothing_of_the_change_and_is_as_if_computed() {
    rows_taken_over_are_right(4);
}

#[test]
#[ignore = "200 edits take minutes"]
fn two_hundred_edits_take_over_what_rows_would_be() {
    rows_taken_over_are_right(50);
}

/// A city, and the same without one of its blocks.
fn city(place: &Place) {
    place.line("generate block-city --patches 1500 -o old.obj -q").is(0);
    let text = std::fs::read_to_string(place.path("old.obj")).expect("a scene");
    let is_other = |object: &&str| !object.starts_with("block_2_2\n");
    let (head, objects) = text.split_once("\no ").expect("objects");
    let kept: Vec<&str> = objects.split("\no ").filter(is_other).collect();
    // Corners are numbered through the file: only the faces go.
    let gone = objects
        .split("\no ")
        .find(|object| !is_other(object))
        .expect("the block");
    let corners: Vec<&str> = gone.lines().filter(|line| line.starts_with("v ")).collect();
    let at = objects
        .split("\no ")
        .position(|object| !is_other(&object))
        .expect("the block");
    let mut parts: Vec<String> = kept.iter().map(|object| format!("o {object}")).collect();
    parts.insert(at, corners.join("\n"));
    place.write("new.obj", format!("{head}\n{}\n", parts.join("\n")));
}

#[test]
fn an_update_is_the_same_whatever_the_threads_and_goes_on_where_it_stopped() {
    let place = Place::new();
    city(&place);
    place.line("compute old.obj -o old --config=none -q").is(0);
    let ran = place
        .line("compute new.obj -o one --update old --threads 1 --config=none")
        .is(0);
    assert!(ran.err.contains("rows taken over from `old`"), "{}", ran.err);
    place
        .line("compute new.obj -o two --update old --threads 2 --config=none -q")
        .is(0);
    assert_same(&place.path("one"), &place.path("two"));
    place.line("check one").is(0);
    // Some parts of it, and then the rest.
    place
        .line("compute new.obj -o shards --update old --shard 1/3 --config=none -q")
        .is(0);
    place
        .line("compute new.obj -o shards --update old --config=none -q")
        .is(0);
    assert_same(&place.path("one"), &place.path("shards"));
    // A second change begins with the first one's numbers, and takes all rows where nothing changed.
    let again = place.line("compute new.obj -o again --update one --config=none").is(0);
    assert!(again.err.contains("0 patches gone, 0 new"), "{}", again.err);
    assert_parts_equal(&place.path("one"), &place.path("again"));
    // Its sky is by the hemicubes of its rows.
    let sky = place.line("sky new.obj --matrix one --up z").is(0);
    let rows = place.line("check one --json").is(0).json()["rows"]
        .as_u64()
        .expect("a number");
    let agrees = format!("agrees with the matrix in {rows} of {rows} rows");
    assert!(sky.out.replace(',', "").contains(&agrees), "{}", sky.out);
}

/// A floor under a closed box; with a twin of the box in the same place, that comes first.
fn floor_under(first: &[&str]) -> String {
    let corners = "v 0 0 0\nv 4 0 0\nv 4 4 0\nv 0 4 0\nv -1 -1 .1\nv 5 -1 .1\nv 5 5 .1\nv -1 5 .1\nv -1 -1 2.1\n\
                   v 5 -1 2.1\nv 5 5 2.1\nv -1 5 2.1\n";
    let faces = [
        "5 7 6", "5 8 7", "9 10 11", "9 11 12", "5 6 10", "5 10 9", "6 7 11", "6 11 10", "7 8 12", "7 12 11", "8 5 9",
        "8 9 12",
    ];
    let of = |name: &str| {
        let lines: Vec<String> = faces.iter().map(|face| format!("f {face}\n")).collect();
        format!("o {name}\n{}", lines.concat())
    };
    let first: Vec<String> = first.iter().map(|name| of(name)).collect();
    format!("{corners}{}o floor\nf 1 2 3\nf 1 3 4\n{}", first.concat(), of("box"))
}

#[test]
fn what_comes_into_the_place_of_a_surface_is_seen_in_its_stead() {
    let place = Place::new();
    place.write("old.obj", floor_under(&[]));
    place.write("new.obj", floor_under(&["twin"]));
    let compute = "--tolerance 1% --keep-duplicates --config=none -q";
    place.line(&format!("compute old.obj -o old {compute}")).is(0);
    // Another engine suits the new scene: rows taken over and the others have that of the earlier matrix.
    place
        .line(&format!("compute new.obj -o updated --update old {compute}"))
        .is(0);
    let engine = hemicube::store::Store::open(&place.path("old"))
        .expect("a store")
        .manifest()
        .backend
        .version
        .clone();
    let engine = engine.split_once('-').expect("its engine").0;
    place
        .line(&format!("compute new.obj -o fresh --engine {engine} {compute}"))
        .is(0);
    place.line("compare updated fresh --max-error 1e-3").is(0);
}

/// A modeller may write -0 for 0.
#[test]
fn the_sign_of_0_is_no_change() {
    let place = Place::new();
    place.write("old.obj", floor_under(&[]));
    place.write(
        "new.obj",
        floor_under(&[])
            .replace("v 0 0 0", "v -0 -0 -0")
            .replace("v 4 0 0", "v 4 -0 -0"),
    );
    place.line("compute old.obj -o old --config=none -q").is(0);
    let ran = place.line("compute new.obj -o new --update old --config=none").is(0);
    assert!(ran.err.contains("0 patches gone, 0 new"), "{}", ran.err);
}

/// Form factors of a store by the corners of both patches.
fn by_corners(directory: &Path) -> HashMap<[String; 2], f64> {
    let store = hemicube::store::Store::open(directory).expect("a store");
    let name: Vec<String> = store
        .patches()
        .expect("patches")
        .corners
        .iter()
        .map(|of| format!("{of:?}"))
        .collect();
    let entries = |row: hemicube::store::Result<(InputPatch, hemicube::store::Row)>| {
        let (patch, row) = row.expect("a row");
        let of =
            |(&column, factor): (&u32, f64)| ([name[patch.0 as usize].clone(), name[column as usize].clone()], factor);
        row.indices.iter().zip(&row.data).map(of).collect::<Vec<_>>()
    };
    store.rows().expect("rows").flat_map(entries).collect()
}

#[test]
fn two_states_are_compared_over_the_patches_that_stand_in_both() {
    let place = Place::new();
    city(&place);
    place.line("compute old.obj -o old --config=none -q").is(0);
    let ran = place
        .line("compute new.obj -o new --update old --config=none --json")
        .is(0)
        .json();
    let number = |json: &serde_json::Value, name: &str| json[name].as_u64().expect("a number");
    let update = &ran["update"];
    assert!(
        number(update, "rows_taken_over") > 100 && number(update, "rows_computed") > 100,
        "{update}"
    );
    assert_eq!(
        number(update, "rows_taken_over") + number(update, "rows_computed"),
        number(&ran, "rows")
    );
    let said = place.line("compute new.obj -o again --update old --config=none").is(0);
    assert!(
        said.out.contains("taken over from `old`") && said.out.contains(" computed"),
        "{}",
        said.out
    );

    // The other state, by hand.
    let (new, old) = (by_corners(&place.path("new")), by_corners(&place.path("old")));
    let patches: HashSet<&String> = new.keys().flatten().collect();
    let (mut squared, mut squared_old) = (0.0, 0.0);
    for (pair, factor) in old
        .iter()
        .filter(|(pair, _)| pair.iter().all(|patch| patches.contains(patch)))
    {
        squared += (factor - new.get(pair).unwrap_or(&0.0)).powi(2);
        squared_old += factor.powi(2);
    }
    squared += new
        .iter()
        .filter(|(pair, _)| !old.contains_key(*pair))
        .map(|(_, factor)| factor.powi(2))
        .sum::<f64>();
    let found = place.line("compare new old --json").is(0).json();
    let error = found["relative_frobenius"].as_f64().expect("a number");
    assert!(
        (error - (squared / squared_old).sqrt()).abs() < 1e-9 && error > 1e-3,
        "{error}"
    );
    assert_eq!(found["by_corners"], true);
    assert_eq!(number(&found, "patches_only_in_matrix"), number(update, "patches_new"));
    assert_eq!(
        number(&found, "patches_only_in_reference"),
        number(update, "patches_gone")
    );
    place
        .line("compare new old --max-error 1e-6")
        .is(1)
        .says(&["by their corners", "only in the reference", "FAILED"]);
    assert!(place.line("compare new again").is(0).out.contains("are equal"));

    // As a map: what was taken over does not differ, and rows that saw the block do.
    place.line("compare new old -o change.csv -o change.ply").is(2);
    place.line("compare new old -o change.csv").is(0);
    let text = std::fs::read_to_string(place.path("change.csv")).expect("a table");
    let mut lines = text.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let head = lines.next().expect("a head");
    let column = |name: &str| head.iter().position(|of| *of == name).expect(name);
    let [difference, sum, escaped] = ["difference", "sum_difference", "escaped_difference"].map(column);
    let rows: Vec<[f64; 3]> = lines
        .map(|line| [difference, sum, escaped].map(|column| line[column].parse().expect("a number")))
        .collect();
    let same = rows.iter().filter(|row| row[0] == 0.0).count() as u64;
    assert!(
        same >= number(update, "rows_taken_over") && same < number(&ran, "rows"),
        "{same}"
    );
    assert!(
        rows.iter().any(|row| row[2] > 0.01),
        "where a block stood, some see more of the sky"
    );
    place.line("compare new old -o change.ply").is(0);
    assert!(place.path("change.ply").exists());
    place.line("compare old new -o gone.csv").is(0);
    let text = std::fs::read_to_string(place.path("gone.csv")).expect("a table");
    let unknown = text
        .lines()
        .filter(|line| line.ends_with(",nan,nan,nan,nan") || line.ends_with(",,,,"));
    assert_eq!(unknown.count() as u64, number(update, "patches_gone"), "{text}");

    place
        .line("compute old.obj -o cut --split 2 --correction pixel --config=none -q")
        .is(0);
    place
        .line("compare cut old")
        .is(2)
        .says(&["none of one is where", "leave coordinates as they are"]);
    place.line("export old -o old.mtx -q").is(0);
    place
        .line("compare new old.mtx")
        .is(2)
        .says(&["patches; compute both from the same patches"]);
    place
        .line("compare old.mtx old -o unknown.csv")
        .is(2)
        .says(&["does not say what its patches are"]);
}

fn assert_parts_equal(one: &Path, other: &Path) {
    let rows = |directory: &Path| {
        let store = hemicube::store::Store::open(directory).expect("a store");
        let parts =
            (0..store.manifest().parts.len()).map(|place| store.part(place).expect("a part").expect("it is there"));
        rows(&parts.collect::<Vec<_>>())
    };
    assert_eq!(rows(one), rows(other));
}

#[test]
fn what_rows_cannot_be_taken_over_from_is_refused() {
    let place = Place::new();
    city(&place);
    place.line("compute old.obj -o old --config=none -q").is(0);
    let refused = |line: &str, words: &[&str]| {
        let ran = place
            .line(&format!("compute new.obj -o new --config=none {line}"))
            .is(2);
        for word in words {
            assert!(ran.err.contains(word), "{line}: {}", ran.err);
        }
        assert!(!place.path("new").exists(), "{line}");
    };
    refused("--update nothing", &["nothing"]);
    refused(
        "--update old --tolerance 1%",
        &["tolerance", "0.02", "0.01", "ask for the same"],
    );
    refused(
        "--update old --split 2",
        &["none of its patches", "cut both in the same way"],
    );
    refused("--update old --form compact", &["form", "plain", "compact"]);
    refused("--update old --by object", &["patches"]);
    // Not even with `--overwrite` is the matrix replaced that it reads.
    place
        .line("compute new.obj -o ./old --update old --overwrite --config=none")
        .is(2)
        .says(&["old"]);
    place.line("check old").is(0);
    place
        .line("compute old.obj -o objects --by object --config=none -q")
        .is(0);
    refused("--update objects --by object", &["several triangles"]);
    place
        .line("compute old.obj -o columns --receivers block_1_1 --config=none -q")
        .is(0);
    refused("--update columns --receivers block_1_1", &["receivers"]);
    place.line("compute old.obj -o part --shard 1/2 --config=none -q").is(0);
    refused("--update part", &["part"]);
    place.line("balance old -o balanced --closure -q").is(0);
    refused("--update balanced", &["balanced"]);
    place
        .line("compute old.obj -o pixels --correction pixel --config=none -q")
        .is(0);
    refused("--update pixels", &["without a tolerance"]);
    place
        .line("compute new.obj -o sums --update pixels --correction pixel --config=none -q")
        .is(0);
}
