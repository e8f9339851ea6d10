//! Rows of the Vulkan backend, with the validation layer on: whatever it says fails the call.

use hemicube::Model;
use hemicube::backend::{BackendError, Counters, Culling, HemicubeBackend, RenderSettings, WHOLE};
use hemicube::delta::DeltaTable;
use hemicube::row::RowBlock;
use hemicube_backend_cpu::CpuBackend;
use hemicube_backend_vulkan::{devices as list, open};
use hemicube_scene::{InputPatch, Subdivision};
use hemicube_tests::devices::{
    self, Apart, Opened, compare_items, compare_rows, is_sum_of, is_there, neighbours, some,
};
use hemicube_tests::rows::{render_with, rolled};
use hemicube_tests::scenes::{model, read, say, scenes_or_skip};
use std::collections::BTreeSet;

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

/// What a scene has in common with the CPU backend: the share of pixels that differ, and how far rows are apart. Of the
/// pixels that differ, most are on an edge: next to one that the CPU backend sees so. (Not where patches are smaller than
/// pixels, and not on shared walls.)
fn against_cpu(name: &str, model: &Model, most_pixels: f64) -> Apart {
    let (resolution, n) = (256, 256usize);
    let hemicubes = some(model, 24);
    let mut gpu = vulkan("cull=off").expect("it was there");
    let mut cpu = CpuBackend::new();
    let (a, _) = render_with(&mut *gpu, model, &hemicubes, settings(resolution, Culling::On, false));
    let (b, _) = render_with(&mut cpu, model, &hemicubes, settings(resolution, Culling::On, false));
    let apart = compare_rows(&a, &b);
    let (mut pixels, mut off_edges) = (0, 0);
    for hemicube in &hemicubes {
        let (a, b) = (gpu.items(hemicube).expect("legal"), cpu.items(hemicube).expect("legal"));
        pixels += compare_items(&a, &b);
        for at in (0..a.seen.len()).filter(|&at| a.seen[at] != b.seen[at]) {
            let (x, y) = (at % n, at / n);
            let near = (y.saturating_sub(1)..=(y + 1).min(3 * n - 1))
                .flat_map(|y| (x.saturating_sub(1)..=(x + 1).min(n - 1)).map(move |x| y * n + x))
                .any(|near| b.seen[near] == a.seen[at]);
            off_edges += usize::from(!near);
        }
    }
    let share = pixels as f64 / (hemicubes.len() * 3 * n * n) as f64;
    say(&format!(
        "{name}: {share:.1e} of the pixels differ, {off_edges} of {pixels} off edges; rows by {:.1e}, {:.1e} at most",
        apart.mean, apart.worst
    ));
    assert!(share <= most_pixels, "{name}: {share} of the pixels differ");
    assert!(apart.mean <= 1e-3, "{name}: {apart:?}");
    assert!(apart.worst <= 5e-3, "{name}: {apart:?}");
    apart
}

/// Vertices are snapped to 1/256 of a pixel, so that some of the pixels on edges differ: of scenes in which a patch has about
/// 20 pixels, like these, 3 in 10,000.
const MOST_PIXELS: f64 = 3e-4;

#[test]
fn rows_agree_with_the_cpu_backend() {
    if !is_there("vulkan", &vulkan("")) {
        return;
    }
    for (name, model) in devices::scenes() {
        against_cpu(name, &model, MOST_PIXELS);
    }
}

#[test]
fn rows_of_a_real_tile_agree_with_the_cpu_backend_and_do_not_depend_on_culling() {
    let name = "rows_of_a_real_tile";
    if !is_there("vulkan", &vulkan("")) {
        return;
    }
    let Some(folder) = scenes_or_skip(name) else { return };
    let scene = read(&folder, "city/denhaag-8897.obj").expect("a scene of the manifest");
    let tile = model(scene.clone(), Subdivision::None);
    // Houses share walls here, some of them but for 10⁻⁵ of their distance: there the pixels of a whole wall may differ.
    against_cpu("denhaag-8897", &tile, MOST_PIXELS);
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

/// The share of a scene's triangles, times five faces, that was drawn; an error where too little was culled as hidden.
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
    "cull=occlusion",
    "cull=occlusion,batch=1",
    "cull=occlusion,group=5,batch=10",
    "cull=frustum,batch=3",
    "cull=off",
];

fn do_not_depend(range: std::ops::Range<usize>) {
    if !is_there("vulkan", &vulkan("")) {
        return;
    }
    let scenes: Vec<_> = devices::scenes().into_iter().chain(devices::extreme_scenes()).collect();
    assert_eq!(scenes.len(), 13);
    for (name, model) in &scenes[range] {
        let hemicubes = some(model, 24);
        for (resolution, covered) in [(64, true), (176, false)] {
            devices::rows_do_not_depend(&vulkan, OPTIONS, name, model, &hemicubes, covered, resolution);
        }
    }
}

#[test]
fn rows_do_not_depend_on_culling_batches_or_the_run() {
    do_not_depend(0..5);
}

#[test]
fn rows_of_a_city_with_duplicates_do_not_depend_on_culling_batches_or_the_run() {
    do_not_depend(5..6);
}

#[test]
fn rows_of_extreme_scenes_do_not_depend_on_culling_batches_or_the_run() {
    do_not_depend(6..13);
}

#[test]
fn rows_are_the_sums_of_item_buffers_and_little_comes_back() {
    if !is_there("vulkan", &vulkan("")) {
        return;
    }
    for (name, model) in devices::scenes() {
        let hemicubes = some(&model, 12);
        let table = DeltaTable::new(208);
        let mut session = vulkan("cull=occlusion").expect("it was there");
        let (rows, counters) = render_with(&mut *session, &model, &hemicubes, settings(208, Culling::On, true));
        for (k, hemicube) in hemicubes.iter().enumerate() {
            let items = session.items(hemicube).expect("legal");
            assert!(is_sum_of(rows.row(k), &items, &table), "{name}, row {k}");
            let mut doctored = items.clone();
            let at = doctored.seen.len() / 3;
            doctored.seen[at] = if doctored.seen[at] == 0 { 1 } else { 0 };
            assert!(
                !is_sum_of(rows.row(k), &doctored, &table),
                "one pixel more or less shows"
            );
        }
        // Some entries are dropped after they came back: tiny patches that cover a pixel after all.
        let entries = rows.patches.len() as u64;
        let bound = 16 * entries + 64 * hemicubes.len() as u64;
        assert!(
            counters.bytes_read_back <= bound && counters.bytes_read_back >= 12 * entries,
            "{name}: {} bytes for {entries} entries",
            counters.bytes_read_back
        );
    }
}

#[test]
fn where_nothing_hides_anything_all_that_is_covered_is_seen() {
    if !is_there("vulkan", &vulkan("")) {
        return;
    }
    for (name, model) in devices::unoccluded() {
        let hemicubes = some(&model, 40);
        let (rows, _) = devices::rows_with(&vulkan, "", &model, &hemicubes, settings(128, Culling::On, true));
        assert_eq!(rows.covered, rows.visible, "{name}");
    }
    // And where something does, it is not so.
    let (name, model) = devices::scenes().swap_remove(3);
    let (rows, _) = devices::rows_with(&vulkan, "", &model, &some(&model, 40), settings(128, Culling::On, true));
    assert_ne!(rows.covered, rows.visible, "{name}");
}

#[test]
fn covered_and_tiny_patches_agree_with_the_cpu_backend() {
    if !is_there("vulkan", &vulkan("")) {
        return;
    }
    for (name, model) in devices::scenes() {
        let hemicubes = some(&model, 24);
        let settings = settings(64, Culling::On, true);
        let (a, _) = devices::rows_with(&vulkan, "", &model, &hemicubes, settings);
        let (b, _) = render_with(&mut CpuBackend::new(), &model, &hemicubes, settings);
        let (mut both, mut only) = (0, [0, 0]);
        let (mut apart, mut all) = (0u64, 0u64);
        for k in 0..hemicubes.len() {
            let tiny = |rows: &RowBlock| -> BTreeSet<u32> {
                let row = rows.row(k);
                let tiny = (0..row.patches.len()).filter(|&e| row.visible[e] == 0);
                tiny.map(|e| row.patches[e]).collect()
            };
            let (c, d) = (tiny(&a), tiny(&b));
            both += c.intersection(&d).count();
            only[0] += c.difference(&d).count();
            only[1] += d.difference(&c).count();
            let (a, b) = (a.row(k), b.row(k));
            for (e, patch) in a.patches.iter().enumerate() {
                if let Ok(f) = b.patches.binary_search(patch) {
                    apart += u64::from(a.covered[e].abs_diff(b.covered[f]));
                    all += u64::from(b.covered[f]);
                }
            }
        }
        let apart = apart as f64 / all as f64;
        say(&format!(
            "{name}: {both} tiny patches of both, {only:?} of one; covered weights {apart:.1e} apart"
        ));
        assert!(apart < 1e-2, "{name}: covered weights are {apart} apart");
        // Where surfaces lie on one another, as houses on the ground, it is chance which of them is in front.
        assert!(
            (only[0] + only[1]) * 3 <= both.max(40),
            "{name}: {both} of both, {only:?} of one"
        );
    }
}

#[test]
fn a_hemicube_off_its_emitter_does_not_see_it() {
    if !is_there("vulkan", &vulkan("")) {
        return;
    }
    let (_, model) = devices::scenes().swap_remove(0);
    let mut hemicubes = some(&model, 12);
    for (k, hemicube) in hemicubes.iter_mut().enumerate() {
        if k % 2 == 0 {
            // Behind its patch, which would be in front of everything.
            hemicube.origin -= hemicube.axes[2] * 1e-3;
        }
        *hemicube = rolled(*hemicube, 0.3);
    }
    let (a, _) = devices::rows_with(
        &vulkan,
        "cull=occlusion",
        &model,
        &hemicubes,
        settings(64, Culling::On, false),
    );
    let (b, _) = render_with(
        &mut CpuBackend::new(),
        &model,
        &hemicubes,
        settings(64, Culling::On, false),
    );
    for (k, hemicube) in hemicubes.iter().enumerate() {
        let emitter = hemicube.emitter.expect("a patch's").0;
        assert!(
            a.row(k).patches.binary_search(&emitter).is_err(),
            "row {k} sees its emitter"
        );
    }
    assert!(compare_rows(&a, &b).worst < 2e-2, "{:?}", compare_rows(&a, &b));
}

#[test]
fn comparators_find_what_is_doctored() {
    let mut a = RowBlock::default();
    a.push(InputPatch(3), WHOLE / 2, 0);
    a.end_row(WHOLE / 2, 0);
    let mut b = a.clone();
    assert_eq!(compare_rows(&a, &b), Apart::default());
    b.visible[0] -= 1 << 21;
    b.escaped[0] += 1 << 21;
    let apart = compare_rows(&a, &b);
    assert_eq!(apart.rows, 1);
    assert!((apart.worst - 2.0 / 1024.0).abs() < 1e-12);
    let required = "a required backend that is not there";
    let missing: Opened = Err(BackendError::Unsupported(required.to_owned()));
    assert!(!is_there("a backend nobody requires", &missing));
}

#[test]
fn what_cannot_be_is_refused_and_the_session_lives() {
    if !is_there("vulkan", &vulkan("")) {
        return;
    }
    let found = list().expect("it was there");
    assert!(!found.is_empty() && found[0].capabilities.covered);
    for (options, word) in [
        ("cull=perhaps", "occlusion"),
        ("speed=11", "speed"),
        ("batch=0", "1024"),
        ("timing", "on or off"),
    ] {
        let error = open(0, options).expect_err(options);
        assert!(
            matches!(&error, BackendError::InvalidArgument(text) if text.contains(word)),
            "{error}"
        );
    }
    assert!(matches!(open(99, ""), Err(BackendError::Unsupported(_))));

    let (_, model) = devices::scenes().swap_remove(3);
    let hemicubes = some(&model, 4);
    let mut session = vulkan("memory=3000000").expect("it was there");
    let mut rows = RowBlock::default();
    assert!(matches!(
        session.rows(&hemicubes, &mut rows),
        Err(BackendError::InvalidArgument(_))
    ));
    assert!(session.fork().is_err());
    let error = session.load(model.geometry(), settings(512, Culling::On, false));
    assert!(matches!(error, Err(BackendError::OutOfMemory(_))), "{error:?}");
    let error = session.load(model.geometry(), settings(100, Culling::On, false));
    assert!(matches!(error, Err(BackendError::InvalidArgument(_))));
    session
        .load(model.geometry(), settings(64, Culling::On, false))
        .expect("that fits");
    let mut wrong = hemicubes.clone();
    wrong[1].emitter = Some(InputPatch(u32::MAX - 7));
    assert!(matches!(
        session.rows(&wrong, &mut rows),
        Err(BackendError::InvalidArgument(_))
    ));
    session.rows(&hemicubes, &mut rows).expect("it lives");
    rows.check(4, model.geometry().patch_count, false).expect("four rows");
}

#[test]
fn time_is_told_where_it_is_asked_for_and_culling_stops_where_it_does_not_pay() {
    if !is_there("vulkan", &vulkan("")) {
        return;
    }
    let city = devices::city_with_duplicates(12);
    let hemicubes = neighbours(&city, 64);
    let covered = settings(64, Culling::On, true);
    let mut timed = vulkan("timing=on,cull=occlusion").expect("it was there");
    render_with(&mut *timed, &city, &hemicubes, covered);
    let times = timed.stage_times();
    for (stage, time) in [
        ("cull", times.cull),
        ("render", times.render),
        ("cover", times.cover),
        ("reduce", times.reduce),
        ("read back", times.read_back),
    ] {
        assert!(time > 0, "{stage} takes time");
    }
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
    // Where it is tried and does not pay, it is given up: every wall of this room is seen.
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
