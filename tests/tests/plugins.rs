//! Backends loaded at run time: the smallest ones in Rust and in C do what the built-in one does, alone and side by side.

use hemicube::Model;
use hemicube::backend::{BackendError, Counters, HemicubeBackend};
use hemicube::delta::DeltaTable;
use hemicube::row::RowBlock;
use hemicube_backend_cpu::CpuBackend;
use hemicube_scene::Subdivision;
use hemicube_scene::generate::Kind;
use hemicube_tests::plugins::{c_minimal, rust, session};
use hemicube_tests::rows::{hemicubes, settings, spread};
use hemicube_tests::scenes::{generated, model};

const RESOLUTION: u32 = 16;

/// A closed room: what a row should be is known.
fn room() -> Model {
    model(hemicube_scene::generate::cornell_box(), Subdivision::Levels(1))
}

fn rows_of(backend: &mut dyn HemicubeBackend, model: &Model) -> (RowBlock, Counters) {
    let all = hemicubes(model, &spread(model, 12));
    let mut rows = RowBlock::default();
    let counters = backend.rows(&all, &mut rows).expect("legal hemicubes");
    rows.check(all.len(), model.geometry().patch_count, false)
        .expect("rows that keep the contract");
    (rows, counters)
}

fn loaded(mut backend: impl HemicubeBackend + 'static, model: &Model) -> Box<dyn HemicubeBackend> {
    backend
        .load(model.geometry(), settings(RESOLUTION))
        .expect("a small scene");
    Box::new(backend)
}

#[test]
fn the_smallest_backends_render_as_the_built_in_one() {
    let (_place, c) = c_minimal();
    let (room, city) = (room(), generated(Kind::City, 400));
    for model in [&room, &city] {
        let reference = rows_of(loaded(CpuBackend::new(), model).as_mut(), model).0;
        for path in [&rust("rust-minimal"), &c] {
            let mut plugin = loaded(session(path, &[]), model);
            let (rows, counters) = rows_of(plugin.as_mut(), model);
            assert_eq!(counters.hemicubes, rows.len() as u64);
            // Rays in f64 against edges in f32 of the built-in one: a pixel centre on an edge falls to either side.
            let different = distance(&rows, &reference, model.geometry().patch_count);
            assert!(different < 0.02, "{}: {different}", path.display());
            // And the reduction is exact.
            let hemicube = hemicubes(model, &spread(model, 12))[5];
            let items = plugin.items(&hemicube).expect("item buffers are claimed");
            let (entries, escaped, blocked) = items.reduce(&DeltaTable::new(RESOLUTION));
            let row = rows.row(5);
            let found: Vec<_> = row.patches.iter().zip(row.visible).map(|(&p, &w)| (p, w)).collect();
            assert_eq!(found, entries.iter().map(|&(p, w)| (p.0, w)).collect::<Vec<_>>());
            assert_eq!((row.escaped, row.blocked), (escaped, blocked));
        }
    }
}

/// The largest L1 distance of two rows, as a share of a hemicube.
fn distance(found: &RowBlock, wanted: &RowBlock, patch_count: u32) -> f64 {
    let dense = |rows: &RowBlock, row: usize| {
        let row = rows.row(row);
        let mut dense = vec![0u32; patch_count as usize + 2];
        for (&patch, &weight) in row.patches.iter().zip(row.visible) {
            dense[patch as usize] = weight;
        }
        (dense[patch_count as usize], dense[patch_count as usize + 1]) = (row.escaped, row.blocked);
        dense
    };
    let of_row = |row| {
        let (a, b) = (dense(found, row), dense(wanted, row));
        a.iter().zip(&b).map(|(&a, &b)| f64::from(a.abs_diff(b))).sum::<f64>() / f64::from(hemicube::backend::WHOLE)
    };
    (0..found.len()).map(of_row).fold(0.0, f64::max)
}

#[test]
fn a_fork_renders_the_same() {
    let (_place, c) = c_minimal();
    let room = room();
    for path in [&rust("rust-minimal"), &c] {
        let mut plugin = loaded(session(path, &[]), &room);
        let mut fork = plugin.fork().expect("another session");
        assert_eq!(rows_of(plugin.as_mut(), &room), rows_of(fork.as_mut(), &room));
    }
}

#[test]
fn alternately_and_from_two_threads_the_rows_are_those_of_each_alone() {
    let (_place, c) = c_minimal();
    let (room, city) = (room(), generated(Kind::City, 200));
    let open: [&(dyn Fn(&Model) -> Box<dyn HemicubeBackend> + Sync); 3] = [
        &|model| loaded(CpuBackend::new(), model),
        &|model| loaded(session(&rust("rust-minimal"), &[]), model),
        &|model| loaded(session(&c, &[]), model),
    ];
    let alone: Vec<_> = open
        .iter()
        .flat_map(|open| [&room, &city].map(|model| rows_of(open(model).as_mut(), model)))
        .collect();

    // All of them open at once, a row of each in turn.
    let mut sessions: Vec<_> = open
        .iter()
        .flat_map(|open| [&room, &city].map(|model| (open(model), model, RowBlock::default())))
        .collect();
    for k in 0..12 {
        for (session, model, rows) in &mut sessions {
            let one = hemicubes(model, &spread(model, 12))[k];
            session.rows(&[one], rows).expect("a legal hemicube");
        }
    }
    for ((_, _, rows), (wanted, _)) in sessions.iter().zip(&alone) {
        assert_eq!(rows, wanted);
    }

    // Two threads, each with sessions of its own, in opposite order; and sessions that move from one to the other.
    std::thread::scope(|scope| {
        let run = |backwards: bool| {
            let mut all: Vec<_> = (0..6).collect();
            if backwards {
                all.reverse();
            }
            for k in all {
                let model = [&room, &city][k % 2];
                assert_eq!(rows_of(open[k / 2](model).as_mut(), model), alone[k]);
            }
        };
        let threads = [scope.spawn(move || run(false)), scope.spawn(move || run(true))];
        threads.into_iter().for_each(|thread| thread.join().expect("no panic"));
    });
    std::thread::scope(|scope| {
        for ((mut session, model, _), wanted) in sessions.into_iter().zip(&alone) {
            scope.spawn(move || assert_eq!(&rows_of(session.as_mut(), model), wanted));
        }
    });
}

#[test]
fn what_is_not_claimed_is_refused_by_name() {
    let room = room();
    let mut plugin = session(&rust("rust-minimal"), &[]);
    let mut covered = settings(RESOLUTION);
    covered.covered = true;
    let error = plugin.load(room.geometry(), covered).expect_err("no covered weights");
    assert!(matches!(error, BackendError::Unsupported(_)), "{error}");
    assert!(error.to_string().contains("--correction pixel"), "{error}");
    // It is not the session's fault.
    assert!(plugin.load(room.geometry(), settings(RESOLUTION)).is_ok());
}
