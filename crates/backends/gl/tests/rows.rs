//! Rows of the OpenGL backend, with a debug context: any error reported by the driver fails the call.

use hemicube::Model;
use hemicube::backend::{BackendError, Counters, Culling, RenderSettings};
use hemicube::row::RowBlock;
use hemicube_abi::Plugin;
use hemicube_backend_gl::{Gl, Session};
use hemicube_scene::Subdivision;
use hemicube_tests::devices::{self, Apart, Opened, compare_rows, is_there, neighbours, some};
use hemicube_tests::rows::render_with;
use hemicube_tests::scenes::{model, read, say, scenes_or_skip};

fn gl(options: &str) -> Opened {
    Ok(Box::new(Session::open(0, &format!("debug=on,{options}"))?))
}

fn settings(resolution: u32, culling: Culling, covered: bool) -> RenderSettings {
    RenderSettings {
        resolution,
        culling,
        covered,
    }
}

#[test]
#[ignore = "drivers that render on the processor take a quarter of a minute; the conformance suite holds each backend: ./test --full"]
fn rows_agree_with_the_cpu_backend() {
    if !is_there("gl", &gl("")) {
        return;
    }
    for (name, model) in devices::scenes() {
        for (options, most) in [
            ("cull=off,edges=driver", devices::DRIVERS_EDGES),
            ("cull=off,edges=exact", devices::EXACT_EDGES),
        ] {
            devices::agrees_with_the_cpu(&gl, options, name, &model, most);
        }
    }
}

#[test]
#[ignore = "a driver that renders on the processor compiles these shaders for half a minute: ./test --full"]
fn rows_drawn_by_compute_are_the_cpu_s() {
    if is_there("gl", &gl("")) {
        for (name, model) in devices::scenes() {
            devices::agrees_with_the_cpu(&gl, "draw=compute", name, &model, devices::EXACT_EDGES);
        }
    }
}

#[test]
#[ignore = "a driver that renders on the processor compiles these shaders for half a minute: ./test --full"]
fn rows_drawn_by_compute_do_not_depend_on_batches_or_the_run() {
    if !is_there("gl", &gl("")) {
        return;
    }
    let options = ["draw=compute", "draw=compute,batch=1", "draw=compute,group=5,batch=10"];
    let (name, model) = devices::scenes().swap_remove(0);
    for (resolution, covered) in [(64, true), (176, false)] {
        devices::rows_do_not_depend(&gl, &options, name, &model, &some(&model, 24), covered, resolution);
    }
}

#[test]
#[ignore = "a minute and a half on a driver that renders on the processor: ./test --full"]
fn rows_of_large_cities_drawn_by_compute_are_the_cpu_s() {
    if is_there("gl", &gl("")) {
        devices::cities_agree_with_the_cpu(&gl, "draw=compute");
    }
}

#[test]
fn exact_edges_are_told_from_the_drivers() {
    if is_there("gl", &gl("")) {
        devices::the_drivers_edges_are_told_from_exact_ones(&gl);
    }
}

#[test]
#[ignore = "drivers that render on the processor take half a minute; the conformance suite holds each backend: ./test --full"]
fn rows_of_a_real_tile_agree_with_the_cpu_backend_and_do_not_depend_on_culling() {
    let name = "rows_of_a_real_tile";
    if !is_there("gl", &gl("")) {
        return;
    }
    let Some(folder) = scenes_or_skip(name) else { return };
    let scene = read(&folder, "city/denhaag-8897.obj").expect("a scene of the manifest");
    let tile = model(scene.clone(), Subdivision::None);
    for options in ["cull=off,edges=driver", "cull=off,edges=exact"] {
        devices::agrees_with_the_cpu(&gl, options, "denhaag-8897", &tile, devices::SHARED_WALLS);
    }
    let options = ["cull=marks", "cull=queries", "cull=depth", "cull=view"];
    devices::rows_do_not_depend(&gl, &options, name, &tile, &neighbours(&tile, 32), true, 128);

    let fine = model(scene, Subdivision::Levels(2));
    let hemicubes = neighbours(&fine, 48);
    let counters = devices::rows_do_not_depend(&gl, &options, "×16", &fine, &hemicubes, true, 128);
    let share = culled(&counters, &fine).expect("most of ×16 is culled");
    say(&format!(
        "denhaag-8897 ×16: {:.1} % of the triangles drawn",
        100.0 * share
    ));
}

/// The drawn share of a scene's triangles, times five faces; an error if too little was culled.
fn culled(counters: &Counters, model: &Model) -> Result<f64, String> {
    let all = counters.hemicubes * 5 * model.geometry().surfaces.len() as u64;
    let share = counters.triangles_drawn as f64 / all as f64;
    // The frustum alone leaves some 17 % of a city; a hidden node may stand for any number of chunks.
    if counters.nodes_hidden == 0 || share > 0.1 {
        return Err(format!("{share} of the triangles drawn, {counters:?}"));
    }
    Ok(share)
}

#[test]
fn a_scene_that_was_not_culled_is_found_out() {
    if !is_there("gl", &gl("")) {
        return;
    }
    let city = devices::city_with_duplicates(12);
    let (_, counters) = devices::rows_with(
        &gl,
        "cull=frustum",
        &city,
        &neighbours(&city, 32),
        settings(64, Culling::On, false),
    );
    culled(&counters, &city).expect_err("nothing hidden was left out");
}

const OPTIONS: &[&str] = &[
    "edges=driver,cull=marks",
    "edges=driver,cull=marks,batch=1,min_patches=0",
    "edges=driver,cull=queries,min_patches=0",
    "edges=driver,cull=queries,min_patches=600,max_level=3,group=3,batch=6",
    "edges=driver,cull=depth,group=5,batch=10",
    "edges=driver,cull=frustum,batch=3",
    "edges=driver,cull=view",
    "edges=driver,cull=off",
    "edges=driver",
];

const EXACT: &[&str] = &[
    "edges=exact,cull=marks",
    "edges=exact,cull=queries,min_patches=0,batch=1",
    "edges=exact,cull=depth,group=5,batch=10",
    "edges=exact,cull=off",
];

fn do_not_depend(options: &[&str], range: std::ops::Range<usize>) {
    if !is_there("gl", &gl("")) {
        return;
    }
    let scenes: Vec<_> = devices::scenes().into_iter().chain(devices::extreme_scenes()).collect();
    assert_eq!(scenes.len(), 13);
    for (name, model) in &scenes[range] {
        let hemicubes = some(model, 24);
        for (resolution, covered) in [(64, true), (176, false)] {
            devices::rows_do_not_depend(&gl, options, name, model, &hemicubes, covered, resolution);
        }
    }
}

#[test]
#[ignore = "drivers that render on the processor take some ten seconds; the conformance suite holds each backend: ./test --full"]
fn rows_do_not_depend_on_culling_batches_or_the_run() {
    do_not_depend(OPTIONS, 0..1);
}

#[test]
#[ignore = "drivers that render on the processor take half a minute; the conformance suite holds each backend: ./test --full"]
fn rows_of_more_scenes_do_not_depend_on_culling_batches_or_the_run() {
    do_not_depend(OPTIONS, 1..6);
}

#[test]
#[ignore = "drivers that render on the processor take half a minute; the conformance suite holds each backend: ./test --full"]
fn rows_of_extreme_scenes_do_not_depend_on_culling_batches_or_the_run() {
    do_not_depend(OPTIONS, 6..13);
}

#[test]
#[ignore = "drivers that render on the processor take half a minute; the conformance suite holds each backend: ./test --full"]
fn rows_with_exact_edges_do_not_depend_on_culling_batches_or_the_run() {
    do_not_depend(EXACT, 0..13);
}

#[test]
#[ignore = "drivers that render on the processor take some ten seconds; the conformance suite holds each backend: ./test --full"]
fn rows_are_the_sums_of_item_buffers_and_little_comes_back() {
    if is_there("gl", &gl("")) {
        devices::rows_are_sums_and_little_comes_back(&gl, "edges=driver,cull=marks");
        devices::rows_are_sums_and_little_comes_back(&gl, "edges=exact");
    }
}

#[test]
fn where_nothing_hides_anything_all_that_is_covered_is_seen() {
    if is_there("gl", &gl("")) {
        devices::all_that_nothing_hides_is_seen(&gl, "edges=driver");
        devices::all_that_nothing_hides_is_seen(&gl, "edges=exact");
    }
}

#[test]
#[ignore = "drivers that render on the processor take some ten seconds; the conformance suite holds each backend: ./test --full"]
fn covered_and_tiny_patches_agree_with_the_cpu_backend() {
    if is_there("gl", &gl("")) {
        devices::covered_and_tiny_agree_with_the_cpu(&gl, "edges=driver");
        devices::covered_and_tiny_agree_with_the_cpu(&gl, "edges=exact");
    }
}

#[test]
fn a_hemicube_off_its_emitter_does_not_see_it() {
    if is_there("gl", &gl("")) {
        devices::emitters_are_not_seen_from_off_their_planes(&gl, "edges=driver,cull=marks");
        devices::emitters_are_not_seen_from_off_their_planes(&gl, "edges=exact");
    }
}

#[test]
fn what_cannot_be_is_refused_and_the_session_lives() {
    if !is_there("gl", &gl("")) {
        return;
    }
    assert!(!Gl::devices().expect("it was there").is_empty());
    for (options, word) in [
        ("edges=sharp", "driver"),
        ("cull=perhaps", "queries"),
        ("speed=11", "speed"),
        ("batch=0", "batch"),
        ("timing", "key=value"),
    ] {
        let error = Session::open(0, options).expect_err(options);
        assert!(
            matches!(&error, BackendError::InvalidArgument(text) if text.contains(word)),
            "{error}"
        );
    }
    assert!(matches!(Session::open(99, ""), Err(BackendError::InvalidArgument(_))));
    devices::refusals_leave_the_session_alive(&gl, "memory=3000000");
}

#[test]
fn time_is_told_where_it_is_asked_for_and_culling_stops_where_it_does_not_pay() {
    if !is_there("gl", &gl("")) {
        return;
    }
    let city = devices::city_with_duplicates(12);
    devices::every_stage_takes_time(&gl, "timing=on,cull=marks");
    let (_, plates) = devices::scenes().swap_remove(3);
    let mut open_session = gl("").expect("it was there");
    let few = some(&plates, 24);
    let (_, counters) = render_with(&mut *open_session, &plates, &few, settings(64, Culling::On, false));
    assert_eq!(
        counters.nodes_hidden, 0,
        "among few chunks nothing is looked for behind anything"
    );
    // Culling tried in vain is given up in this room, with every wall visible. And not in a city.
    let walls = model(hemicube_scene::generate::cornell_box(), Subdivision::Levels(5));
    for (scene, gives_up) in [(&walls, true), (&city, false)] {
        let mut session = gl("").expect("it was there");
        let hemicubes = neighbours(scene, 64);
        let (_, counters) = render_with(&mut *session, scene, &hemicubes, settings(64, Culling::On, false));
        assert!(counters.nodes_hidden > 0, "it is tried");
        let choices = session.choices();
        assert!(choices[0].contains("triangles"), "{choices:?}");
        assert_eq!(choices[1].contains("too little is hidden"), gives_up, "{choices:?}");
    }
}

#[test]
fn baselines_give_the_same_rows_and_read_them_whole() {
    if !is_there("gl", &gl("")) {
        return;
    }
    let (_, room) = devices::scenes().swap_remove(0);
    for model in [room, devices::city_with_duplicates(12)] {
        let hemicubes = neighbours(&model, 32);
        let plain = settings(96, Culling::On, false);
        let (best, counted) = devices::rows_with(&gl, "edges=driver", &model, &hemicubes, plain);
        let whole = hemicubes.len() as u64 * 4 * (u64::from(model.geometry().patch_count) + 2);
        for (baseline, queries) in [
            ("original", false),
            ("thesis", true),
            ("thesis,min_patches=300,max_level=5", true),
        ] {
            let options = format!("baseline={baseline}");
            let (rows, counters) = devices::rows_with(&gl, &options, &model, &hemicubes, plain);
            assert_eq!(compare_rows(&rows, &best), Apart::default(), "{baseline}");
            assert_eq!(counters.bytes_read_back, whole, "{baseline}");
            assert_eq!(counters.queries > 0, queries, "{baseline}");
            // On a GPU, the best way may draw what is hidden sooner than the thesis's finds it.
            assert!(
                queries || counters.triangles_transformed >= counted.triangles_transformed,
                "{baseline}: {counters:?} and {counted:?}"
            );
        }
        let mut session = gl("baseline=thesis").expect("it was there");
        let error = session.load(model.geometry(), settings(96, Culling::On, true));
        assert!(
            matches!(error, Err(BackendError::Unsupported(_))),
            "baselines have pixel sums: {error:?}"
        );
    }
}

#[test]
fn sessions_go_from_thread_to_thread_and_side_by_side() {
    if !is_there("gl", &gl("")) {
        return;
    }
    let city = devices::city_with_duplicates(6);
    let hemicubes = neighbours(&city, 32);
    let plain = settings(64, Culling::On, true);
    let mut one = gl("").expect("it was there");
    let (expected, _) = render_with(&mut *one, &city, &hemicubes, plain);
    let sessions: Vec<_> = (0..3).map(|_| one.fork().expect("another context")).collect();
    std::thread::scope(|scope| {
        for mut session in sessions.into_iter().chain([one]) {
            let (hemicubes, expected) = (&hemicubes, &expected);
            scope.spawn(move || {
                for _ in 0..3 {
                    let mut rows = RowBlock::default();
                    session.rows(hemicubes, &mut rows).expect("legal hemicubes");
                    assert_eq!(rows, *expected);
                }
            });
        }
    });
}
