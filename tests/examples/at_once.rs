//! Whether two sessions at once are sound on a device: opened at once, with the rows of one alone, time after time.
//!
//! `at_once BACKEND [ROUNDS]`: rounds over a city at N = 64 and the tile `denhaag-8897` in 16 at N = 128. What an
//! unsound driver does wrong it does seldom, and mostly where sessions begin: run this many times, each a process of
//! its own.
#![allow(clippy::print_stdout, reason = "an example prints")]

use hemicube::Model;
use hemicube::backend::{Culling, Hemicube, HemicubeBackend, RenderSettings};
use hemicube::row::RowBlock;
use hemicube_scene::Subdivision;
use hemicube_tests::devices::{city_with_duplicates, neighbours};
use hemicube_tests::plugins::{self, try_session};
use hemicube_tests::scenes::{model, read, scenes_dir};
use std::error::Error;
use std::sync::Barrier;

type Failure = Box<dyn Error + Send + Sync>;

/// The rows of so many rounds, by each of two sessions at once.
fn at_once(
    backend: &str,
    model: &Model,
    settings: RenderSettings,
    hemicubes: &[Hemicube],
    rounds: usize,
) -> Result<(), Failure> {
    let open = || -> Result<Box<dyn HemicubeBackend>, Failure> {
        let mut session = try_session(&plugins::rust(backend), &[])?;
        session.load(model.geometry(), settings)?;
        Ok(Box::new(session))
    };
    let rows = |session: &mut dyn HemicubeBackend| -> Result<RowBlock, Failure> {
        let mut rows = RowBlock::default();
        session.rows(hemicubes, &mut rows)?;
        Ok(rows)
    };
    let barrier = Barrier::new(2);
    let both = || -> Result<Vec<RowBlock>, Failure> {
        barrier.wait();
        let mut session = open()?;
        let mut made = vec![rows(&mut *session)?];
        let mut fork = session.fork()?;
        for round in 0..rounds {
            let session = if round % 2 == 0 { &mut fork } else { &mut session };
            made.push(rows(&mut **session)?);
        }
        Ok(made)
    };
    let [first, second] = std::thread::scope(|scope| {
        let threads = [scope.spawn(both), scope.spawn(both)];
        threads.map(|thread| thread.join().map_err(|_| "a thread panicked"))
    });
    let alone = rows(&mut *open()?)?;
    let different = first??
        .into_iter()
        .chain(second??)
        .filter(|made| *made != alone)
        .count();
    if different > 0 {
        return Err(format!("{different} blocks of rows are not those of a session alone").into());
    }
    Ok(())
}

fn main() -> Result<(), Failure> {
    let mut args = std::env::args().skip(1);
    let backend = args.next().ok_or("which backend?")?;
    let rounds = args.next().map_or(Ok(4), |word| word.parse())?;
    let settings = |resolution, covered| RenderSettings {
        resolution,
        culling: Culling::On,
        covered,
    };
    let city = city_with_duplicates(6);
    at_once(&backend, &city, settings(64, true), &neighbours(&city, 32), rounds)?;
    let folder = scenes_dir().ok_or("no ../shared/scenes; HEMICUBE_SCENES names another folder")?;
    let tile = model(read(&folder, "city/denhaag-8897.obj")?, Subdivision::Levels(2));
    at_once(&backend, &tile, settings(128, false), &neighbours(&tile, 64), rounds)?;
    println!("{backend}: the same rows");
    Ok(())
}
