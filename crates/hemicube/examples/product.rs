//! How fast F·x and Fᵀ·x go through a store that stays on the disk, beside how fast its files can be read at all.
//!
//! ```text
//! cargo run --release -p hemicube --example product -- STORE [THREADS]
//! ```
//!
//! Each figure is the best of five, taken in turns, in gigabytes of the parts' files a second: of the thread's
//! processor time where there is one thread, so that a busy machine measures the same as an idle one, else of wall
//! time. What is read comes from the page cache as far as it has room there; `first` is the product that also verifies
//! every checksum.
//!
//! With `COLD=1` in the environment the store is put out of the page cache before each (by `dd` of GNU coreutils), and
//! each is done once, by the clock on the wall: what a disk gives that holds more than memory does.

#![allow(clippy::print_stdout, reason = "it is what it is for")]

use hemicube::store::Store;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

/// Reads all files to the end, on several threads, into a buffer that stays in a cache.
fn read(files: &[PathBuf], threads: usize) -> std::io::Result<u64> {
    let next = AtomicUsize::new(0);
    let work = || -> std::io::Result<u64> {
        let mut buffer = vec![0; 1 << 18];
        let mut sum = 0;
        while let Some(path) = files.get(next.fetch_add(1, Ordering::Relaxed)) {
            let mut file = File::open(path)?;
            loop {
                match file.read(&mut buffer)? {
                    0 => break,
                    count => sum += count as u64,
                }
            }
        }
        Ok(sum)
    };
    std::thread::scope(|scope| {
        let workers: Vec<_> = (1..threads).map(|_| scope.spawn(work)).collect();
        let mut sum = work()?;
        for worker in workers {
            sum += worker
                .join()
                .unwrap_or_else(|_| Err(std::io::ErrorKind::Other.into()))?;
        }
        Ok(sum)
    })
}

/// Nanoseconds of processor time that this thread has had, where the system tells.
fn processor_time() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    text.split_whitespace().next()?.parse().ok()
}

/// Puts files out of the page cache.
fn evict(files: &[PathBuf]) -> std::io::Result<()> {
    for file in files {
        let mut input = std::ffi::OsString::from("if=");
        input.push(file);
        let status = std::process::Command::new("dd")
            .arg(input)
            .args(["iflag=nocache", "count=0", "status=none"])
            .status()?;
        if !status.success() {
            return Err(std::io::Error::other("`dd` could not put a file out of the page cache"));
        }
    }
    Ok(())
}

fn seconds<T, E>(threads: usize, work: impl FnOnce() -> Result<T, E>) -> Result<(f64, T), E> {
    let (started, before) = (Instant::now(), processor_time());
    let done = work()?;
    let spent = match (threads, before, processor_time()) {
        (1, Some(before), Some(after)) => (after - before) as f64 * 1e-9,
        _ => started.elapsed().as_secs_f64(),
    };
    Ok((spent, done))
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args_os().skip(1);
    let directory = arguments.next().ok_or("a store is needed")?;
    let threads: usize = match arguments.next() {
        Some(word) => word.to_string_lossy().parse()?,
        None => std::thread::available_parallelism()?.get(),
    };
    let directory = Path::new(&directory);
    let store = Store::open(directory)?;
    let files: Vec<PathBuf> = store
        .manifest()
        .parts
        .iter()
        .map(|part| directory.join(&part.file))
        .collect();
    let x = vec![1.0; store.patch_count() as usize];
    let bytes = read(&files, threads)? as f64;
    let cold = std::env::var_os("COLD").is_some();
    // Processor time does not wait for a disk.
    let clock = if cold { 0 } else { threads };
    let prepare = || if cold { evict(&files) } else { Ok(()) };
    prepare()?;
    let first = seconds(clock, || store.multiply(&x, threads))?.0;
    let mut best = [f64::INFINITY; 3];
    let mut row_sums = Vec::new();
    for _ in 0..if cold { 1 } else { 5 } {
        prepare()?;
        best[0] = best[0].min(seconds(clock, || read(&files, threads))?.0);
        prepare()?;
        let (spent, y) = seconds(clock, || store.multiply(&x, threads))?;
        best[1] = best[1].min(spent);
        prepare()?;
        best[2] = best[2].min(seconds(clock, || store.multiply_transposed(&x, threads))?.0);
        row_sums = y;
    }
    // With ones, F·x are the row sums that the store has in its patch table.
    let table = store.row_table()?.row_sum;
    let off = row_sums
        .iter()
        .zip(&table)
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f64::max);
    println!(
        "{} patches, {} entries, {:.2} GB, {threads} threads, row sums off by {off:.1e}",
        store.patch_count(),
        store.manifest().entries,
        bytes / 1e9
    );
    for (what, spent) in [
        ("read", best[0]),
        ("F x, first", first),
        ("F x", best[1]),
        ("F' x", best[2]),
    ] {
        println!(
            "{what:12}{:6.2} GB/s  {:5.2} of reading  {:7.0} million entries/s",
            bytes / spent / 1e9,
            best[0] / spent,
            store.manifest().entries as f64 / spent / 1e6
        );
    }
    Ok(())
}
