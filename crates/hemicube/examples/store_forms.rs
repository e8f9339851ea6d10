//! What the forms of a store cost on the rows of a real one: bytes, time to write and to read an entry, and error.
//!
//! ```sh
//! cargo run --release -p hemicube --example store_forms -- STORE...
//! ```
//!
//! Beside the two forms: the members of plain and of compact parts deflated, which is what they were chosen against.
//! Times are processor time of the one thread that does it, the least of three turns; the disk is not in them.
//! *Reading* is a whole part into memory; *rows* is one row after the other in input order.
#![allow(clippy::print_stdout, reason = "an example talks")]

use hemicube::store::{Form, Header, Part, Store, StoreWriter};
use std::error::Error;
use std::io::{Cursor, Read, Write};
use std::path::Path;

const TURNS: usize = 3;

/// No more entries than this are taken of a store: enough to see what they cost.
const ENTRIES_MAX: usize = 40_000_000;

/// Entries that are read before the clock is looked at again.
const READ_AT_LEAST: usize = 100_000_000;

fn main() -> Result<(), Box<dyn Error>> {
    println!(
        "{:24} {:10} {:>8} {:>9} {:>9} {:>9} {:>10} {:>10} {:>10}",
        "store", "form", "B/entry", "write", "read", "rows", "worst F", "rms F", "worst sum"
    );
    println!(
        "{:24} {:10} {:>8} {:>29} {:>10} {:>21}",
        "", "", "", "million entries/s", "relative", ""
    );
    for path in std::env::args_os().skip(1) {
        let store = Store::open(Path::new(&path))?;
        let name = Path::new(&path)
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        let parts = parts(&store)?;
        for form in [Form::Plain, Form::Compact] {
            let place = tempfile::tempdir()?;
            let measured = measure(&store, &parts, form, &place.path().join("F"))?;
            println!("{name:24} {:10} {measured}", format!("{form:?}").to_lowercase());
            let (bytes, write, read) = deflated(&place.path().join("F"), parts.len())?;
            let entries = entries(&parts) as f64;
            println!(
                "{:24} {:10} {:8.2} {:9.1} {:9.1}",
                "",
                "  deflated",
                bytes as f64 / entries,
                entries / write / 1e6,
                entries / read / 1e6
            );
        }
    }
    Ok(())
}

/// The first parts of a store.
fn parts(store: &Store) -> Result<Vec<Part>, Box<dyn Error>> {
    let mut parts = Vec::new();
    for place in 0..store.manifest().parts.len() {
        if entries(&parts) >= ENTRIES_MAX {
            break;
        }
        parts.extend(store.part(place)?);
    }
    Ok(parts)
}

fn entries(parts: &[Part]) -> usize {
    parts.iter().map(|part| part.data.len()).sum()
}

fn measure(source: &Store, parts: &[Part], form: Form, directory: &Path) -> Result<String, Box<dyn Error>> {
    let manifest = source.manifest();
    let (mut write, mut read, mut rows) = (f64::INFINITY, f64::INFINITY, f64::INFINITY);
    let table = source.patches()?;
    for _ in 0..TURNS {
        let header = Header {
            program: manifest.program.clone(),
            scene: manifest.scene.clone(),
            settings: manifest.settings.clone(),
            correction: manifest.correction.clone(),
            patch_count: manifest.patch_count,
            row_count: manifest.row_count,
            rows_per_part: manifest.rows_per_part,
            form,
            min_factor: manifest.min_factor,
            backend: manifest.backend.clone(),
            objects: manifest.objects.clone(),
            materials: manifest.materials.clone(),
        };
        let mut writer = StoreWriter::create(directory, header, &table, true)?;
        let before = thread_seconds()?;
        for part in parts {
            writer.write_part(part)?;
        }
        write = f64::min(write, thread_seconds()? - before);
        writer.interrupt()?;

        let store = Store::open(directory)?;
        // The system counts a thread's time in milliseconds.
        let times = READ_AT_LEAST / entries(parts).max(1) + 1;
        let before = thread_seconds()?;
        for place in (0..times).flat_map(|_| 0..parts.len()) {
            std::hint::black_box(store.part(place)?);
        }
        read = f64::min(read, (thread_seconds()? - before) / times as f64);
        let before = thread_seconds()?;
        for _ in 0..times {
            for row in store.rows()? {
                std::hint::black_box(row?);
            }
        }
        rows = f64::min(rows, (thread_seconds()? - before) / times as f64);
    }
    let store = Store::open(directory)?;
    let (mut worst, mut squares, mut norm, mut sum_off) = (0f64, 0f64, 0f64, 0f64);
    for (place, part) in parts.iter().enumerate() {
        let stored = store.part(place)?.ok_or("a part is gone")?;
        if (&stored.indices, &stored.indptr) != (&part.indices, &part.indptr) {
            return Err("a column changed".into());
        }
        for row in 0..part.rows.len() {
            let (computed, kept) = (part.row(row).1, stored.row(row).1);
            let (mut sum, mut sum_kept) = (0.0, 0.0);
            for (computed, kept) in computed.iter().zip(kept) {
                // What is smaller keeps its place, not its value.
                if computed >= f64::powi(2.0, -62) {
                    worst = worst.max((kept - computed).abs() / computed);
                }
                squares += (kept - computed).powi(2);
                norm += computed.powi(2);
                sum += computed;
                sum_kept += kept;
            }
            if sum > 0.0 {
                sum_off = sum_off.max((sum_kept - sum).abs() / sum);
            }
        }
    }
    let count = entries(parts) as f64;
    let bytes: u64 = files(directory, parts.len())?
        .iter()
        .map(|bytes| bytes.len() as u64)
        .sum();
    Ok(format!(
        "{:8.2} {:9.1} {:9.1} {:9.1} {worst:10.1e} {:10.1e} {sum_off:10.1e}",
        bytes as f64 / count,
        count / write / 1e6,
        count / read / 1e6,
        count / rows / 1e6,
        (squares / norm).sqrt(),
    ))
}

fn files(directory: &Path, parts: usize) -> std::io::Result<Vec<Vec<u8>>> {
    let path = |part: usize| directory.join(format!("parts/part-{part:05}.npz"));
    (0..parts).map(|part| std::fs::read(path(part))).collect()
}

/// Bytes of the parts with every member deflated at the fastest level, and the seconds to deflate and to inflate them.
fn deflated(directory: &Path, parts: usize) -> Result<(u64, f64, f64), Box<dyn Error>> {
    let (mut size, mut write, mut read) = (0, 0.0, 0.0);
    for bytes in files(directory, parts)? {
        let mut archive = zip::ZipArchive::new(Cursor::new(bytes))?;
        let mut members = Vec::new();
        for index in 0..archive.len() {
            let mut bytes = Vec::new();
            archive.by_index(index)?.read_to_end(&mut bytes)?;
            members.push(bytes);
        }
        let options = zip::write::SimpleFileOptions::default()
            .compression_method(zip::CompressionMethod::Deflated)
            .compression_level(Some(1));
        let before = thread_seconds()?;
        let mut out = zip::ZipWriter::new(Cursor::new(Vec::new()));
        for (index, bytes) in members.iter().enumerate() {
            out.start_file(index.to_string(), options)?;
            out.write_all(bytes)?;
        }
        let packed = out.finish()?;
        write += thread_seconds()? - before;
        size += packed.get_ref().len() as u64;
        let before = thread_seconds()?;
        let mut archive = zip::ZipArchive::new(packed)?;
        for index in 0..archive.len() {
            std::io::copy(&mut archive.by_index(index)?, &mut std::io::sink())?;
        }
        read += thread_seconds()? - before;
    }
    Ok((size, write, read))
}

/// Processor time of this thread, in seconds, as Linux tells it.
fn thread_seconds() -> Result<f64, Box<dyn Error>> {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat")?;
    let nanoseconds: f64 = text.split_whitespace().next().ok_or("an empty schedstat")?.parse()?;
    Ok(nanoseconds * 1e-9)
}
