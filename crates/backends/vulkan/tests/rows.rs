//! Rows of the Vulkan backend, with the validation layer on: whatever it says fails the call.

use hemicube::Model;
use hemicube::backend::{BackendError, Counters, Culling, HemicubeBackend, RenderSettings};
use hemicube_backend_vulkan::{devices as list, open};
use hemicube_scene::Subdivision;
use hemicube_tests::devices::{self, Opened, is_there, neighbours, some};
use hemicube_tests::rows::render_with;
use hemicube_tests::scenes::{model, read, say, scenes_or_skip};

fn vulkan(options: &str) -> Opened {
    Ok(Box::new(open(0, &format!("validation=on,{options}"))?))
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
    if !is_there("vulkan", &vulkan("")) {
        return;
    }
    for (name, model) in devices::scenes() {
        for (options, most) in [
            ("cull=off,edges=driver", devices::DRIVERS_EDGES),
            ("cull=off,edges=exact", devices::EXACT_EDGES),
        ] {
            devices::agrees_with_the_cpu(&vulkan, options, name, &model, most);
        }
    }
}

#[test]
#[ignore = "a driver that renders on the processor compiles these shaders for half a minute: ./test --full"]
fn rows_drawn_by_compute_are_the_cpu_s() {
    if is_there("vulkan", &vulkan("")) {
        for (name, model) in devices::scenes() {
            devices::agrees_with_the_cpu(&vulkan, "draw=compute", name, &model, devices::EXACT_EDGES);
        }
    }
}

#[test]
#[ignore = "a driver that renders on the processor compiles these shaders for half a minute: ./test --full"]
fn rows_drawn_by_compute_do_not_depend_on_batches_or_the_run() {
    if !is_there("vulkan", &vulkan("")) {
        return;
    }
    let options = ["draw=compute", "draw=compute,batch=1", "draw=compute,group=5,batch=10"];
    let (name, model) = devices::scenes().swap_remove(0);
    for (resolution, covered) in [(64, true), (176, false)] {
        devices::rows_do_not_depend(&vulkan, &options, name, &model, &some(&model, 24), covered, resolution);
    }
}

#[test]
#[ignore = "a minute and a half on a driver that renders on the processor: ./test --full"]
fn rows_of_large_cities_drawn_by_compute_are_the_cpu_s() {
    if is_there("vulkan", &vulkan("")) {
        devices::cities_agree_with_the_cpu(&vulkan, "draw=compute");
    }
}

#[test]
fn exact_edges_are_told_from_the_drivers() {
    if is_there("vulkan", &vulkan("")) {
        devices::the_drivers_edges_are_told_from_exact_ones(&vulkan);
    }
}

#[test]
#[ignore = "drivers that render on the processor take half a minute; the conformance suite holds each backend: ./test --full"]
fn rows_of_a_real_tile_agree_with_the_cpu_backend_and_do_not_depend_on_culling() {
    let name = "rows_of_a_real_tile";
    if !is_there("vulkan", &vulkan("")) {
        return;
    }
    let Some(folder) = scenes_or_skip(name) else { return };
    let scene = read(&folder, "city/denhaag-8897.obj").expect("a scene of the manifest");
    let tile = model(scene.clone(), Subdivision::None);
    for options in ["cull=off,edges=driver", "cull=off,edges=exact"] {
        devices::agrees_with_the_cpu(&vulkan, options, "denhaag-8897", &tile, devices::SHARED_WALLS);
    }
    let options = ["cull=occlusion", "cull=frustum", "cull=off"];
    devices::rows_do_not_depend(&vulkan, &options, name, &tile, &neighbours(&tile, 32), true, 128);

    let fine = model(scene, Subdivision::Levels(2));
    let hemicubes = neighbours(&fine, 48);
    let counters = devices::rows_do_not_depend(&vulkan, &options, "×16", &fine, &hemicubes, true, 128);
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
    if counters.nodes_hidden * 4 < counters.nodes_tested - counters.nodes_outside {
        return Err(format!("{} chunks hidden of {counters:?}", counters.nodes_hidden));
    }
    if share > 0.15 {
        return Err(format!("{share} of the triangles drawn"));
    }
    Ok(share)
}

#[test]
fn a_scene_that_was_not_culled_is_found_out() {
    if !is_there("vulkan", &vulkan("")) {
        return;
    }
    let city = devices::city_with_duplicates(12);
    let (_, counters) = devices::rows_with(
        &vulkan,
        "cull=frustum",
        &city,
        &neighbours(&city, 32),
        settings(64, Culling::On, false),
    );
    culled(&counters, &city).expect_err("nothing hidden was left out");
}

const OPTIONS: &[&str] = &[
    "edges=driver,cull=occlusion",
    "edges=driver,cull=occlusion,batch=1",
    "edges=driver,cull=occlusion,group=5,batch=10",
    "edges=driver,cull=frustum,batch=3",
    "edges=driver,cull=off",
];

const EXACT: &[&str] = &[
    "edges=exact,cull=occlusion",
    "edges=exact,cull=occlusion,group=5,batch=10",
    "edges=exact,cull=frustum,batch=1",
    "edges=exact,cull=off",
];

fn do_not_depend(options: &[&str], range: std::ops::Range<usize>) {
    if !is_there("vulkan", &vulkan("")) {
        return;
    }
    let scenes: Vec<_> = devices::scenes().into_iter().chain(devices::extreme_scenes()).collect();
    assert_eq!(scenes.len(), 13);
    for (name, model) in &scenes[range] {
        let hemicubes = some(model, 24);
        for (resolution, covered) in [(64, true), (176, false)] {
            devices::rows_do_not_depend(&vulkan, options, name, model, &hemicubes, covered, resolution);
        }
    }
}

#[test]
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
    if is_there("vulkan", &vulkan("")) {
        devices::rows_are_sums_and_little_comes_back(&vulkan, "edges=driver,cull=occlusion");
        devices::rows_are_sums_and_little_comes_back(&vulkan, "edges=exact");
    }
}

#[test]
fn where_nothing_hides_anything_all_that_is_covered_is_seen() {
    if is_there("vulkan", &vulkan("")) {
        devices::all_that_nothing_hides_is_seen(&vulkan, "edges=driver");
        devices::all_that_nothing_hides_is_seen(&vulkan, "edges=exact");
    }
}

#[test]
#[ignore = "drivers that render on the processor take some ten seconds; the conformance suite holds each backend: ./test --full"]
fn covered_and_tiny_patches_agree_with_the_cpu_backend() {
    if is_there("vulkan", &vulkan("")) {
        devices::covered_and_tiny_agree_with_the_cpu(&vulkan, "edges=driver");
        devices::covered_and_tiny_agree_with_the_cpu(&vulkan, "edges=exact");
    }
}

#[test]
fn a_hemicube_off_its_emitter_does_not_see_it() {
    if is_there("vulkan", &vulkan("")) {
        devices::emitters_are_not_seen_from_off_their_planes(&vulkan, "edges=driver,cull=occlusion");
        devices::emitters_are_not_seen_from_off_their_planes(&vulkan, "edges=exact");
    }
}

#[test]
fn what_cannot_be_is_refused_and_the_session_lives() {
    if !is_there("vulkan", &vulkan("")) {
        return;
    }
    let found = list().expect("it was there");
    assert!(!found.is_empty() && found[0].capabilities.covered);
    for (options, word) in [
        ("edges=sharp", "driver"),
        ("cull=perhaps", "occlusion"),
        ("speed=11", "speed"),
        ("batch=0", "1024"),
        ("timing", "key=value"),
    ] {
        let error = open(0, options).expect_err(options);
        assert!(
            matches!(&error, BackendError::InvalidArgument(text) if text.contains(word)),
            "{error}"
        );
    }
    assert!(matches!(open(99, ""), Err(BackendError::Unsupported(_))));
    devices::refusals_leave_the_session_alive(&vulkan, "memory=3000000");
}

/// On the processor the rasteriser is several times as fast; a GPU may take either.
#[test]
fn a_probe_chooses_how_to_draw_once_for_all_sessions() {
    if !is_there("vulkan", &vulkan("")) {
        return;
    }
    let (_, room) = devices::scenes().swap_remove(0);
    let drawn = |options: &str| {
        let mut session = open(0, options).expect("it was there");
        let (rows, _) = render_with(&mut session, &room, &some(&room, 4), settings(64, Culling::On, false));
        (rows, session.info().version.clone(), session.choices())
    };
    let (rows, version, choices) = drawn("draw=auto");
    let line = choices.last().expect("a line of the probe");
    let word = if line.contains("takes raster") {
        "raster"
    } else {
        "compute"
    };
    assert!(line.starts_with(&format!("draw=auto takes {word}: ")), "{line}");
    let (named, version_of_named, _) = drawn(&format!("draw={word}"));
    assert_eq!(
        (&rows, &version),
        (&named, &version_of_named),
        "as if it had been named"
    );
    assert_eq!(drawn("draw=auto").2.last(), Some(line), "a device is probed once");
    for options in ["draw=auto,edges=driver", "draw=auto,cull=off"] {
        let refused = open(0, options).expect_err("compute has neither").to_string();
        assert!(refused.contains("draw=raster"), "{refused}");
    }
}

#[test]
fn time_is_told_where_it_is_asked_for_and_culling_stops_where_it_does_not_pay() {
    if !is_there("vulkan", &vulkan("")) {
        return;
    }
    devices::every_stage_takes_time(&vulkan, "timing=on,cull=occlusion");
    let (_, room) = devices::scenes().swap_remove(0);
    let mut open_session = vulkan("").expect("it was there");
    let (_, counters) = render_with(
        &mut *open_session,
        &room,
        &some(&room, 24),
        settings(64, Culling::On, false),
    );
    assert_eq!(
        counters.nodes_hidden, 0,
        "in a small room nothing is looked for behind anything"
    );
    assert!(
        open_session.choices()[0].contains("triangles"),
        "{:?}",
        open_session.choices()
    );
    // Culling tried in vain is given up: every wall of this room is visible.
    let mut fine = vulkan("").expect("it was there");
    let walls = model(hemicube_scene::generate::cornell_box(), Subdivision::Levels(5));
    let (_, _) = render_with(
        &mut *fine,
        &walls,
        &neighbours(&walls, 64),
        settings(64, Culling::On, false),
    );
    assert!(fine.choices()[0].contains("hidden: only"), "{:?}", fine.choices());
}
