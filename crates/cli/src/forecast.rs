//! Memory and disk of a run, estimated before it begins.
//!
//! ```text
//! memory ≤ max(reading the scene, scene + (T − 1) · session + 8 T · batch + 5 · part + 16 MB)
//!   scene    resident after reading, cutting and loading the scene into a backend, before the first row
//!   session  of each further thread: its copy of the backend's mutable state
//!   batch    rows a call of the backend × entries a row × 20 bytes
//!   part     rows of a part × entries a row × 8 bytes: one being filled, two waiting, one being written and encoded
//! ```
//!
//! `docs/dev/store.md` compares this with measured runs.

use crate::exit::hinted;
use crate::report::size;
use anyhow::{Result, anyhow};
use hemicube::driver::compute::Summary;
use hemicube::store::Form;
use hemicube_scene::{Budget, NoRoom};
use hemicube_spatial::whole;
use std::path::Path;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

/// Bytes of each further thread of the CPU backend: buffers of pixels, lists, and the allocator's reserve.
const SESSION: f64 = 12e6;
/// Bytes not counted elsewhere.
const REST: f64 = 16e6;
/// Parts in memory at once: one being filled, two waiting, one being written, and its bytes.
const PARTS: f64 = 5.0;
/// Batches in progress, a thread.
const BATCHES: f64 = 8.0;
/// Bytes of an entry in progress: in the backend's rows, and as column and factor.
const ENTRY: f64 = 20.0;

/// Steps of a hemicube, of a triangle transformed into its frame, and of a triangle drawn on a face. Measured.
const STEPS_A_HEMICUBE: u64 = 100_000;
const STEPS_A_TRANSFORMED: u64 = 40;
const STEPS_A_DRAWN: u64 = 60;
/// Size of rows, for a forecast.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rows {
    pub(crate) entries_per_row: f64,
    pub(crate) rows_per_part: u32,
    pub(crate) rows_per_batch: u32,
}

/// Work of computed rows in steps of about a nanosecond, counted and not timed: that of their closed forms and visible
/// fractions, and of their hemicubes' triangles.
pub(crate) fn steps(found: &Summary) -> u64 {
    let counters = &found.counters;
    found.steps
        + counters.hemicubes * STEPS_A_HEMICUBE
        + counters.triangles_transformed * STEPS_A_TRANSFORMED
        + counters.triangles_drawn * STEPS_A_DRAWN
}

/// Upper bound of a run's bytes, from those resident before its first row.
pub(crate) fn memory(resident: u64, threads: usize, rows: Rows) -> u64 {
    let threads = threads.max(1) as f64;
    let batch = f64::from(rows.rows_per_batch.min(rows.rows_per_part)) * rows.entries_per_row * ENTRY;
    let part = f64::from(rows.rows_per_part) * rows.entries_per_row * 8.0;
    whole::to_u64(resident as f64 + (threads - 1.0) * SESSION + BATCHES * threads * batch + PARTS * part + REST)
}

/// The most threads, up to `threads`, that keep a run within `limit` bytes; `None` if one is too many.
pub(crate) fn threads_within(limit: u64, resident: u64, threads: usize, rows: Rows) -> Option<usize> {
    (1..=threads)
        .rev()
        .find(|&threads| memory(resident, threads, rows) <= limit)
}

/// Asks for memory before it is taken: `what` takes `bytes`, and `next` takes less.
///
/// # Errors
/// When less is left ([`Budget`]).
pub(crate) fn require(budget: Budget, bytes: u64, what: &str, next: &str) -> Result<()> {
    budget
        .require(bytes, what)
        .map_err(|refused| hinted(anyhow!(refused), next))
}

/// Bytes asked for at a time.
const PIECE: u64 = 1 << 26;

/// Memory of what is kept while a run goes on, asked for in advance a piece at a time. Shared by threads.
pub(crate) struct Meter {
    budget: Budget,
    taken: AtomicU64,
    asked: AtomicU64,
    refused: OnceLock<NoRoom>,
}

impl Meter {
    /// Nothing is taken yet.
    pub(crate) fn new(budget: Budget) -> Self {
        Self {
            budget,
            taken: AtomicU64::new(0),
            asked: AtomicU64::new(0),
            refused: OnceLock::new(),
        }
    }

    /// Counts bytes that are taken, and asks for the next piece where they reach the end of the last.
    pub(crate) fn take(&self, bytes: u64, what: &str) {
        let taken = bytes + self.taken.fetch_add(bytes, Ordering::Relaxed);
        // Threads that come here at once each ask for a piece: more than is needed, never less.
        if taken > self.asked.load(Ordering::Relaxed) {
            self.asked.fetch_add(PIECE.max(bytes), Ordering::Relaxed);
            if let Err(refused) = self.budget.require(PIECE.max(bytes), what) {
                let _ = self.refused.set(refused);
            }
        }
    }

    /// Returns whether all could be taken.
    pub(crate) fn fits(&self) -> bool {
        self.refused.get().is_none()
    }

    /// Ends the run that could not take all; `next` takes less.
    ///
    /// # Errors
    /// When it could not.
    pub(crate) fn require(self, next: &str) -> Result<()> {
        match self.refused.into_inner() {
            Some(refused) => Err(hinted(anyhow!(refused), next)),
            None => Ok(()),
        }
    }
}

/// Refuses a file that its disk has no room for, before what it holds is computed.
///
/// # Errors
/// When fewer than `bytes` are left there.
pub(crate) fn require_disk(output: &Path, bytes: u64) -> Result<()> {
    let folder = output.parent().filter(|folder| !folder.as_os_str().is_empty());
    match available(folder.unwrap_or(Path::new("."))) {
        Some(left) if left < bytes => Err(hinted(
            anyhow!(
                "`{}` takes {} or more, and its disk has {} left",
                output.display(),
                size(bytes),
                size(left)
            ),
            "make room, or choose another disk",
        )),
        _ => Ok(()),
    }
}

/// Bytes of rows on the disk, within some percent.
pub(crate) fn disk(rows: u64, entries_per_row: f64, form: Form) -> u64 {
    let entry = match form {
        Form::Plain => 8.0,
        Form::Double => 12.0,
        // From `docs/dev/store.md`: between 2.1 and 2.6 in large scenes.
        Form::Compact => 2.6,
    };
    whole::to_u64(rows as f64 * (entries_per_row * entry + 60.0))
}

/// Bytes left on the disk of an existing directory, where the system tells.
pub(crate) fn available(directory: &Path) -> Option<u64> {
    fs4::available_space(directory).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROWS: Rows = Rows {
        entries_per_row: 4_500.0,
        rows_per_part: 1024,
        rows_per_batch: 64,
    };

    #[test]
    fn threads_are_as_many_as_fit() {
        let of = |threads| memory(500_000_000, threads, ROWS);
        assert!(of(1) < of(2) && of(2) < of(16));
        assert_eq!(threads_within(of(7), 500_000_000, 16, ROWS), Some(7));
        assert_eq!(threads_within(of(7) - 1, 500_000_000, 16, ROWS), Some(6));
        assert_eq!(threads_within(u64::MAX, 500_000_000, 16, ROWS), Some(16));
        assert_eq!(threads_within(of(1) - 1, 500_000_000, 16, ROWS), None);
    }

    #[test]
    fn what_is_kept_is_asked_for_before_it_is_there() {
        let meter = Meter::new(Budget::new(None));
        (0..1000).for_each(|_| meter.take(1000, "rows"));
        assert_eq!(meter.asked.load(Ordering::Relaxed), PIECE);
        assert!(meter.fits() && meter.require("").is_ok());
        let none = Meter::new(Budget::new(Some(0)));
        none.take(1, "rows");
        let refused = none.require("fewer rows").expect_err("nothing is allowed").to_string();
        assert!(
            refused.starts_with("rows takes 67.1 MB, and 0.0 MB of the 0.0 MB allowed are left"),
            "{refused}"
        );
    }

    #[test]
    fn the_compact_form_takes_a_third() {
        let [plain, compact] = [Form::Plain, Form::Compact].map(|form| disk(1_000_000, 4_000.0, form) as f64);
        assert!((0.3..0.4).contains(&(compact / plain)));
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn the_system_tells_what_the_disk_has_left() {
        assert!(available(Path::new("/")).is_some());
    }
}
