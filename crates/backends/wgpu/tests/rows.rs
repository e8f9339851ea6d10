//! Rows of the wgpu backend, with the validation layer on: whatever it or wgpu says fails the test.

use glam::DVec3;
use hemicube::Model;
use hemicube::backend::{BackendError, Counters, Culling, Hemicube, HemicubeBackend, RenderSettings, StageTimes};
use hemicube::delta::DeltaTable;
use hemicube::row::{RowBlock, RowError};
use hemicube_backend_cpu::CpuBackend;
use hemicube_backend_wgpu::{devices, open, open_with_fault};
use hemicube_scene::{InputPatch, Scene, Triangle};
use hemicube_tests::devices::{
    Apart, DRIVERS_EDGES, EXACT_EDGES, Opened, SHARED_WALLS, agrees_with_the_cpu, city_with_duplicates, compare_rows,
    covered_and_tiny_agree_with_the_cpu, emitters_are_not_seen_from_off_their_planes, extreme_scenes, is_sum_of,
    is_there, neighbours, rows_do_not_depend, rows_with, scenes, some, the_drivers_edges_are_told_from_exact_ones,
    unoccluded,
};
use hemicube_tests::rows::render_with;
use hemicube_tests::scenes::{model, read, say, scenes_or_skip};
use std::sync::{Mutex, PoisonError};

/// Complaints of wgpu and the validation layer.
struct Complaints(Mutex<Vec<String>>);

static COMPLAINTS: Complaints = Complaints(Mutex::new(Vec::new()));

impl log::Log for Complaints {
    fn enabled(&self, metadata: &log::Metadata<'_>) -> bool {
        metadata.level() <= log::Level::Warn && metadata.target().starts_with("wgpu")
    }

    fn log(&self, record: &log::Record<'_>) {
        if self.enabled(record.metadata()) {
            let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            all.push(format!("{}: {}", record.target(), record.args()));
        }
    }

    fn flush(&self) {}
}

impl Complaints {
    fn listen(&'static self) {
        if log::set_logger(self).is_ok() {
            log::set_max_level(log::LevelFilter::Warn);
        }
    }

    fn take(&self) -> Vec<String> {
        std::mem::take(&mut *self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// A session under the validation layer.
fn wgpu(options: &str) -> Opened {
    COMPLAINTS.listen();
    Ok(Box::new(open(0, &format!("validation=on,{options}"))?))
}

/// Runs a test if there is a device, and fails it for any complaint.
fn on_a_device(test: impl FnOnce()) {
    if is_there("wgpu", &wgpu("")) {
        test();
        let said = COMPLAINTS.take();
        assert!(said.is_empty(), "{}", said.join("\n"));
    }
}

fn settings(resolution: u32, covered: bool) -> RenderSettings {
    RenderSettings {
        resolution,
        culling: Culling::On,
        covered,
    }
}

/// Returns whether no more was read back than the entries and a constant for each submission of 16 hemicubes.
fn few_bytes(counters: Counters, entries: usize, hemicubes: usize) -> bool {
    counters.bytes_read_back <= 16 * entries as u64 + 512 * hemicubes.div_ceil(16) as u64
}

#[test]
fn complaints_are_noticed() {
    use log::Log;
    let complaints = Complaints(Mutex::default());
    for (target, level) in [
        ("wgpu_hal::vulkan::instance", log::Level::Error),
        ("wgpu_hal::vulkan::instance", log::Level::Info),
        ("something_else", log::Level::Error),
    ] {
        let record = log::Record::builder()
            .target(target)
            .level(level)
            .args(format_args!("VUID-1"))
            .build();
        complaints.log(&record);
    }
    assert_eq!(complaints.take(), ["wgpu_hal::vulkan::instance: VUID-1"]);
}

const OPTIONS: [&str; 7] = [
    "edges=driver,cull=occlusion",
    "edges=driver,cull=occlusion,batch=1",
    "edges=driver,cull=occlusion,group=5,batch=10",
    "edges=driver,cull=occlusion,counts=off",
    "edges=driver,cull=frustum,batch=3,group=3",
    "edges=driver,cull=auto",
    "edges=driver,cull=off",
];

const EXACT: [&str; 4] = [
    "edges=exact,cull=occlusion",
    "edges=exact,cull=occlusion,group=5,batch=10",
    "edges=exact,cull=frustum,batch=1",
    "edges=exact,cull=off",
];

fn do_not_depend(range: std::ops::Range<usize>) {
    on_a_device(|| {
        for (name, model) in &scenes()[range] {
            let counters = rows_do_not_depend(&wgpu, &OPTIONS, name, model, &some(model, 20), false, 128);
            say(&format!("{name}: {counters:?}"));
        }
    });
}

#[test]
#[ignore = "drivers that render on the processor take some ten seconds; the conformance suite holds each backend: ./test --full"]
fn rows_do_not_depend_on_culling_batches_or_the_run() {
    do_not_depend(0..1);
}

#[test]
#[ignore = "drivers that render on the processor take half a minute; the conformance suite holds each backend: ./test --full"]
fn rows_of_more_scenes_do_not_depend_on_culling_batches_or_the_run() {
    do_not_depend(1..scenes().len());
}

/// 48 pixels: depths are then not copied before they are read.
fn covered_rows_do_not_depend(at_48: &[&str], at_64: &[&str], exact_at_48: &[&str]) {
    on_a_device(|| {
        for (name, model) in scenes().into_iter().chain(extreme_scenes()) {
            for (options, resolution) in [(at_48, 48), (at_64, 64), (exact_at_48, 48)] {
                rows_do_not_depend(&wgpu, options, name, &model, &some(&model, 15), true, resolution);
            }
        }
    });
}

#[test]
#[ignore = "drivers that render on the processor take half a minute; the conformance suite holds each backend: ./test --full"]
fn covered_rows_do_not_depend_on_culling_batches_or_the_run() {
    // Every way of culling and an odd batch, once each; rows that are not covered have the other options, too.
    let [occlusion, _, odd, .., off] = OPTIONS;
    let [_, exact_odd, _, exact_off] = EXACT;
    covered_rows_do_not_depend(
        &[occlusion, odd, off],
        &[occlusion, OPTIONS[4]],
        &[exact_odd, exact_off],
    );
}

#[test]
#[ignore = "two minutes on a driver that renders on the processor: ./test --full"]
fn covered_rows_do_not_depend_on_any_option() {
    covered_rows_do_not_depend(&OPTIONS, &OPTIONS, &EXACT);
}

/// Drawn by compute. The second has odd groups: tiles of several layers at once.
const TILES: [&str; 2] = ["draw=compute", "draw=compute,group=5,batch=10"];

#[test]
#[ignore = "half a minute and more on a driver that renders on the processor: ./test --full"]
fn rows_drawn_by_compute_do_not_depend_on_batches_or_the_run() {
    on_a_device(|| {
        for (name, model) in scenes() {
            // 48 and 80 pixels are no whole number of tiles.
            for (covered, resolution) in [(false, 48), (true, 80)] {
                rows_do_not_depend(&wgpu, &TILES, name, &model, &some(&model, 15), covered, resolution);
            }
        }
    });
}

#[test]
#[ignore = "half a minute and more on a driver that renders on the processor: ./test --full"]
fn rows_drawn_by_compute_are_the_cpu_s() {
    on_a_device(|| {
        for (name, model) in scenes() {
            agrees_with_the_cpu(&wgpu, TILES[0], name, &model, EXACT_EDGES);
        }
        covered_and_tiny_agree_with_the_cpu(&wgpu, TILES[0]);
        emitters_are_not_seen_from_off_their_planes(&wgpu, TILES[0]);
        if let Some(folder) = scenes_or_skip("drawing a real tile by compute") {
            let tile = read(&folder, "city/denhaag-8897.obj").expect("a readable scene");
            let tile = model(tile, hemicube_scene::Subdivision::None);
            agrees_with_the_cpu(&wgpu, TILES[0], "denhaag", &tile, SHARED_WALLS);
        }
    });
}

/// Faults of the tiles' shader that keep the sum of a row: the farthest seen in place of the nearest, small triangles seen
/// around themselves, triangles left out by a wrong test, and pixel centres half a pixel off.
#[test]
fn a_wrong_shader_makes_other_rows() {
    on_a_device(|| {
        let (_, room) = scenes().swap_remove(0);
        let hemicubes = some(&room, 6);
        let (cpu, _) = render_with(&mut CpuBackend::new(), &room, &hemicubes, settings(64, false));
        let apart = |from, to| {
            let mut session = open_with_fault(0, TILES[0], from, to).expect("it was there");
            let (rows, _) = render_with(&mut session, &room, &hemicubes, settings(64, false));
            compare_rows(&rows, &cpu)
        };
        let right = apart("", "");
        assert!(right.worst <= EXACT_EDGES.row, "{right:?}");
        for (from, to) in [
            ("(depth > best)", "(depth < best)"),
            ("if (!inside)", "if (inside)"),
            ("dot_fused(side, greatest_in(tile, side, n)) < 0.0", "side.x < 0.0"),
            ("fma(side.y, y, side.z * n)", "fma(side.y, y + 1.0, side.z * n)"),
        ] {
            let wrong = apart(from, to);
            assert!(wrong.worst > EXACT_EDGES.row, "`{to}`: {wrong:?}");
        }
    });
}

/// Mesa's drivers on the processor end the loops of a thread after 65,535 rounds together. A work group that takes tiles
/// without an end runs into that; what it was drawing is not added up, and the row's sum says so.
#[test]
fn a_tile_that_a_driver_cuts_short_is_an_error() {
    on_a_device(|| {
        // Of 6,144 tiles each of 16 processors has too many; of more, none may.
        let processors = std::thread::available_parallelism().map_or(1, usize::from);
        if devices().expect("devices")[0].kind != hemicube_abi::DeviceKind::Software || processors > 16 {
            say("SKIP a_tile_that_a_driver_cuts_short: a GPU ends no loops, nor do more than 16 processors");
            return;
        }
        let (_, room) = scenes().swap_remove(0);
        let all = some(&room, 2);
        let sum_of = |to| {
            let mut session = open_with_fault(0, TILES[0], "drawn < settings.tiles_each", to).expect("it was there");
            let mut rows = RowBlock::default();
            session.load(room.geometry(), settings(1024, false)).expect("it fits");
            session.rows(&all, &mut rows).expect("rows");
            rows.check(all.len(), room.geometry().patch_count, false)
        };
        assert_eq!(sum_of("drawn < settings.tiles_each"), Ok(()));
        assert!(matches!(sum_of("true"), Err(RowError::Sum { .. })));
    });
}

/// Behind a wall that hides it, more runs of chunks than a tile lists at once; before the wall a triangle that comes
/// after them in the octree's order.
fn more_than_a_list() -> (Model, Hemicube) {
    const DENSE: u32 = 560;
    let of = |corners: [DVec3; 3]| Triangle {
        corners,
        object: 0,
        material: 0,
        face: 0,
        two_sided: false,
    };
    let quad = |[a, b, c, d]: [DVec3; 4]| [of([a, b, c]), of([a, c, d])];
    let p = DVec3::new;
    let mut triangles = vec![of([p(-0.01, -0.01, 1.0), p(0.0, 0.02, 1.0), p(0.01, -0.01, 1.0)])];
    triangles.extend(quad([
        p(-1.0, 0.01, 0.2),
        p(1.0, 0.01, 0.2),
        p(1.0, 1.0, 0.2),
        p(-1.0, 1.0, 0.2),
    ]));
    triangles.push(of([p(0.1, 0.2, 0.6), p(0.2, 0.2, 0.6), p(0.1, 0.3, 0.6)]));
    let at = |i: u32, j: u32| {
        p(
            f64::from(i) / f64::from(DENSE) - 1.0,
            f64::from(j) / f64::from(DENSE),
            -1.0,
        )
    };
    for j in 0..DENSE {
        for i in 0..DENSE {
            triangles.extend(quad([at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]));
        }
    }
    let scene = Scene {
        triangles,
        ..Scene::default()
    };
    let model = model(scene, hemicube_scene::Subdivision::None);
    let hemicube = Hemicube {
        axes: [DVec3::X, DVec3::NEG_Y, DVec3::NEG_Z],
        ..model.hemicubes(InputPatch(0), 1, false)[0]
    };
    (model, hemicube)
}

#[test]
#[ignore = "600,000 triangles on a driver that renders on the processor: ./test --full"]
fn a_tile_sees_what_comes_after_its_first_list_of_runs() {
    on_a_device(|| {
        let (model, hemicube) = more_than_a_list();
        let one = std::slice::from_ref(&hemicube);
        let (cpu, _) = render_with(&mut CpuBackend::new(), &model, one, settings(32, false));
        assert!(cpu.row(0).patches.contains(&3), "the small triangle is seen");
        let apart = |from, to| {
            let mut session = open_with_fault(0, TILES[0], from, to).expect("it was there");
            let (rows, _) = render_with(&mut session, &model, one, settings(32, false));
            compare_rows(&rows, &cpu)
        };
        let right = apart("", "");
        assert!(right.worst <= EXACT_EDGES.row, "{right:?}");
        let wrong = apart(
            "return vec2<u32>(first, count);",
            "return vec2<u32>(settings.run_count, count);",
        );
        assert!(wrong.worst > EXACT_EDGES.row, "one list alone: {wrong:?}");
    });
}

#[test]
fn culling_leaves_out_most_of_a_city() {
    on_a_device(|| {
        let model = city_with_duplicates(12);
        let hemicubes = neighbours(&model, 64);
        let render = |options| {
            let mut session = wgpu(options).expect("it was there");
            render_with(&mut *session, &model, &hemicubes, settings(256, false))
        };
        let (rows, without) = render("cull=off");
        let (culled_rows, with) = render("cull=occlusion");
        assert_eq!(compare_rows(&rows, &culled_rows), Apart::default());
        assert!(with.nodes_hidden > with.nodes_tested / 20, "{with:?}");
        assert!(with.nodes_outside > with.nodes_tested / 3, "{with:?}");
        assert_eq!((without.nodes_hidden, without.nodes_outside), (0, 0));
        let all = model.geometry().surfaces.len() as u64 * 5 * hemicubes.len() as u64;
        assert!(with.triangles_drawn < all / 4, "{with:?} of {all} triangles");
    });
}

#[test]
#[ignore = "drivers that render on the processor take some ten seconds; the conformance suite holds each backend: ./test --full"]
fn rows_are_the_sums_of_item_buffers_and_little_is_read_back() {
    on_a_device(|| {
        for (name, model) in scenes() {
            let n = 128;
            let table = DeltaTable::new(n);
            let hemicubes = some(&model, 17);
            for options in ["cull=occlusion,edges=driver", "cull=off,batch=4", "edges=exact"] {
                let mut session = wgpu(options).expect("it was there");
                let (rows, counters) = render_with(&mut *session, &model, &hemicubes, settings(n, false));
                for (k, hemicube) in hemicubes.iter().enumerate() {
                    let mut items = session.items(hemicube).expect("a legal hemicube");
                    assert!(is_sum_of(rows.row(k), &items, &table), "{name}, `{options}`: row {k}");
                    if k == 0 {
                        let center = (n / 2 * n + n / 2) as usize;
                        items.seen[center] = if items.seen[center] == 0 { 1 } else { 0 };
                        assert!(
                            !is_sum_of(rows.row(k), &items, &table),
                            "a doctored pixel was not noticed"
                        );
                    }
                }
                let (_, again) = render_with(&mut *session, &model, &hemicubes, settings(n, false));
                assert_eq!(counters.nodes_tested, again.nodes_tested, "{name}: items were counted");
                let entries = rows.patches.len();
                assert!(
                    few_bytes(counters, entries, hemicubes.len()),
                    "{name}: {counters:?} for {entries} entries"
                );
                let dense = Counters {
                    bytes_read_back: 4 * u64::from(model.geometry().patch_count) * hemicubes.len() as u64,
                    ..counters
                };
                // In the soup and in the room, a row has almost all patches.
                if entries < model.geometry().patch_count as usize * hemicubes.len() / 8 {
                    assert!(
                        !few_bytes(dense, entries, hemicubes.len()),
                        "{name}: dense rows were not noticed"
                    );
                }
            }
        }
    });
}

#[test]
fn what_nothing_hides_is_covered_exactly() {
    on_a_device(|| {
        for (name, model) in unoccluded() {
            for (resolution, options) in [
                (16, "edges=driver"),
                (64, "edges=driver"),
                (256, "edges=driver"),
                (64, "edges=exact"),
                (256, "edges=exact"),
            ] {
                let hemicubes = some(&model, 24);
                let mut session = wgpu(options).expect("it was there");
                let (rows, _) = render_with(&mut *session, &model, &hemicubes, settings(resolution, true));
                assert_eq!(rows.visible, rows.covered, "{name}, N = {resolution}, `{options}`");
                assert!(rows.visible.iter().any(|&v| v > 0), "{name}: something is seen");
            }
        }
        let (_, city) = scenes().pop().expect("a city");
        let mut session = wgpu("").expect("it was there");
        let (rows, _) = render_with(&mut *session, &city, &some(&city, 24), settings(64, true));
        assert_ne!(rows.visible, rows.covered, "in a city much is hidden");
        let tiny = rows.covered.iter().filter(|&&c| c == 0).count();
        assert!(tiny > 0, "patches smaller than a pixel are in the rows");
    });
}

#[test]
#[ignore = "drivers that render on the processor take a quarter of a minute; the conformance suite holds each backend: ./test --full"]
fn rows_agree_with_the_cpu_backend() {
    on_a_device(|| {
        let mut all = scenes();
        if let Some(folder) = scenes_or_skip("the wgpu backend on a real tile") {
            let tile = read(&folder, "city/denhaag-8897.obj").expect("a readable scene");
            all.push(("denhaag", model(tile, hemicube_scene::Subdivision::None)));
        }
        for (name, model) in all {
            let (drivers, exact) = if name == "denhaag" {
                (SHARED_WALLS, SHARED_WALLS)
            } else {
                (DRIVERS_EDGES, EXACT_EDGES)
            };
            agrees_with_the_cpu(&wgpu, "edges=driver", name, &model, drivers);
            agrees_with_the_cpu(&wgpu, "edges=exact", name, &model, exact);
            if name == "room" {
                let (a, _) = rows_with(&wgpu, "", &model, &some(&model, 24), settings(256, false));
                let others = &some(&model, 48)[24..];
                let (b, _) = render_with(&mut CpuBackend::new(), &model, others, settings(256, false));
                assert!(
                    compare_rows(&a, &b).worst > 5e-3,
                    "rows of other hemicubes were not noticed"
                );
            }
        }
    });
}

#[test]
fn exact_edges_are_told_from_the_drivers() {
    on_a_device(|| the_drivers_edges_are_told_from_exact_ones(&wgpu));
}

#[test]
fn two_sessions_at_once_give_the_same_rows() {
    on_a_device(|| {
        let model = city_with_duplicates(12);
        let hemicubes = neighbours(&model, 48);
        let mut session = wgpu("").expect("it was there");
        let (rows, _) = render_with(&mut *session, &model, &hemicubes, settings(128, true));
        let mut fork = session.fork().expect("another session");
        let render = |session: &mut dyn HemicubeBackend| {
            let mut rows = RowBlock::default();
            session.rows(&hemicubes, &mut rows).expect("legal hemicubes");
            rows
        };
        let (a, b) = std::thread::scope(|scope| {
            let other = scope.spawn(|| render(&mut *fork));
            (render(&mut *session), other.join().expect("no panic"))
        });
        assert_eq!(a, rows);
        assert_eq!(b, rows);
    });
}

fn small() -> (Model, Vec<Hemicube>) {
    let (_, model) = unoccluded().remove(0);
    let hemicubes = some(&model, 9);
    (model, hemicubes)
}

#[test]
fn a_lost_device_is_reported_and_another_goes_on() {
    on_a_device(|| {
        let (model, hemicubes) = small();
        let mut session = open(0, "").expect("it was there");
        let (rows, _) = render_with(&mut session, &model, &hemicubes, settings(64, true));
        session.lose_device();
        let lost = |error: BackendError| assert!(matches!(error, BackendError::DeviceLost(_)), "{error:?}");
        lost(
            session
                .rows(&hemicubes, &mut RowBlock::default())
                .expect_err("the device is lost"),
        );
        lost(session.items(&hemicubes[0]).expect_err("still"));
        lost(session.load(model.geometry(), settings(64, true)).expect_err("still"));
        let mut other = session.fork().expect("another device");
        let mut again = RowBlock::default();
        other.rows(&hemicubes, &mut again).expect("legal hemicubes");
        assert_eq!(again, rows);
    });
}

#[test]
fn what_does_not_fit_is_refused_and_the_session_goes_on() {
    on_a_device(|| {
        let (model, hemicubes) = small();
        let mut session = open(0, "memory=1048576").expect("it was there");
        let refused = session
            .load(model.geometry(), settings(1024, false))
            .expect_err("1 MiB");
        assert!(
            matches!(&refused, BackendError::OutOfMemory(text) if text.contains("1048576")),
            "{refused:?}"
        );
        let (rows, _) = render_with(&mut session, &model, &hemicubes, settings(64, false));
        assert_eq!(rows.len(), hemicubes.len());
        let mut fitting = open(0, "").expect("it was there");
        render_with(&mut fitting, &model, &hemicubes[..1], settings(1024, false));
    });
}

#[test]
fn illegal_requests_are_refused_by_name() {
    on_a_device(|| {
        for (options, named) in [
            ("cull=sometimes", "`sometimes`"),
            ("edges=sharp", "`sharp`"),
            ("draw=pencil", "`pencil`"),
            ("draw=compute,edges=driver", "`edges=driver`"),
            ("draw=compute,cull=off", "`cull`"),
            ("batch=0", "`batch`"),
            ("group=many", "`group`"),
            ("colour=red", "`colour`"),
        ] {
            let error = open(0, options).expect_err(options);
            assert!(
                matches!(&error, BackendError::InvalidArgument(text) if text.contains(named)),
                "{error:?}"
            );
        }
        let devices = devices().expect("a list");
        let beyond = open(u32::try_from(devices.len()).expect("few"), "").expect_err("beyond the last device");
        assert!(matches!(&beyond, BackendError::Unsupported(text) if text.contains("numbered from 0")));
        let (model, hemicubes) = small();
        let mut session = open(0, "").expect("it was there");
        let nothing = |error: BackendError| assert!(error.to_string().contains("no scene is loaded"), "{error}");
        nothing(
            session
                .rows(&hemicubes, &mut RowBlock::default())
                .expect_err("nothing is loaded"),
        );
        nothing(session.fork().err().expect("nothing is loaded"));
        let odd = session
            .load(model.geometry(), settings(40, false))
            .expect_err("40 is no multiple of 16");
        assert!(odd.to_string().contains("40"), "{odd}");
        session.load(model.geometry(), settings(48, false)).expect("48 is");
        let mut foreign = hemicubes[0];
        foreign.emitter = Some(hemicube_scene::InputPatch(model.geometry().patch_count));
        let error = session
            .rows(&[foreign], &mut RowBlock::default())
            .expect_err("no such patch");
        assert!(matches!(error, BackendError::InvalidArgument(_)), "{error:?}");
        let mut rows = RowBlock::default();
        session.rows(&hemicubes, &mut rows).expect("the session goes on");
        rows.check(hemicubes.len(), model.geometry().patch_count, false)
            .expect("good rows");
    });
}

#[test]
fn times_are_measured_when_asked_for() {
    on_a_device(|| {
        let (_, model) = scenes().pop().expect("a city");
        let hemicubes = neighbours(&model, 32);
        let render = |options| {
            let mut session = wgpu(options).expect("it was there");
            let (rows, _) = render_with(&mut *session, &model, &hemicubes, settings(64, true));
            (rows, session.stage_times())
        };
        let (rows, none) = render("cull=occlusion");
        assert_eq!(none, StageTimes::default());
        let (timed, times) = render("cull=occlusion,timing=on");
        assert_eq!(compare_rows(&rows, &timed), Apart::default());
        let StageTimes {
            cull,
            render,
            cover,
            reduce,
            read_back,
        } = times;
        assert!(
            [cull, render, cover, reduce, read_back].iter().all(|&t| t > 0),
            "{times:?}"
        );
    });
}
