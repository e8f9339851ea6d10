//! The output of a submission, and its rows.
//!
//! ```text
//! header of slot 0 │ header of slot 1 │ … │ entries of slot 0 │ entries of slot 1 │ …
//! ```

use crate::limits::Plan;
use crate::upload::Upload;
use crate::view::FACES;
use hemicube_contract::InputPatch;
use hemicube_contract::backend::{BackendError, Counters};
use hemicube_contract::face::Items;
use hemicube_contract::row::RowBlock;

/// Words of a header: entries, escaped, blocked, chunks tested on faces, outside, hidden, triangles drawn for ids,
/// triangles drawn for depths alone.
pub const HEADER_WORDS: u32 = 8;
/// Words of an entry: patch, visible weight, weight hidden behind others.
pub const ENTRY_WORDS: u32 = 3;

/// Number of words to read of the entries, once the headers are there.
///
/// # Errors
/// [`BackendError::Internal`] when a header cannot be.
pub fn entry_words(plan: &Plan, headers: &[u32], slots: u32) -> Result<usize, BackendError> {
    let mut all = 0;
    for (slot, header) in headers
        .chunks_exact(HEADER_WORDS as usize)
        .take(slots as usize)
        .enumerate()
    {
        if header[0] > plan.capacity {
            return Err(BackendError::Internal(format!(
                "the device counted {} entries in row {slot} of a submission; at most {} fit",
                header[0], plan.capacity
            )));
        }
        all += (header[0] * ENTRY_WORDS) as usize;
    }
    Ok(all)
}

/// Appends the rows of a submission.
///
/// `headers` holds those of `slots` slots, `entries` the words counted by [`entry_words`].
pub fn append_rows(headers: &[u32], entries: &[u32], slots: u32, covered: bool, out: &mut RowBlock) -> Counters {
    let mut counters = Counters::default();
    let mut entries = entries.chunks_exact(ENTRY_WORDS as usize);
    for header in headers.chunks_exact(HEADER_WORDS as usize).take(slots as usize) {
        for entry in entries.by_ref().take(header[0] as usize) {
            let (patch, visible, hidden) = (entry[0], entry[1], entry[2]);
            if covered {
                // A sub-pixel patch covering a pixel centre after all, hidden there by another.
                if visible == 0 && hidden > 0 {
                    continue;
                }
                out.push(InputPatch(patch), visible, visible.saturating_add(hidden));
            } else {
                out.push(InputPatch(patch), visible, 0);
            }
        }
        out.end_row(header[1], header[2]);
        counters += Counters {
            hemicubes: 1,
            nodes_tested: u64::from(header[3]),
            nodes_outside: u64::from(header[4]),
            nodes_hidden: u64::from(header[5]),
            triangles_transformed: u64::from(header[6]) + u64::from(header[7]),
            triangles_drawn: u64::from(header[6]),
            queries: 0,
            bytes_read_back: 4 * u64::from(HEADER_WORDS + header[0] * ENTRY_WORDS),
        };
    }
    counters
}

/// Counts the triangles of hemicubes without culling, once a face. No stage of such a submission counts them.
pub fn unculled_triangles(upload: &Upload, hemicubes: u64) -> u64 {
    hemicubes * u64::from(FACES) * upload.triangle_count() as u64
}

/// An item buffer of the device's ids, 3 N² of them.
pub fn items(ids: impl IntoIterator<Item = u32>, patch_count: u32, resolution: u32) -> Items {
    let seen = ids.into_iter().map(|id| match id {
        id if id < patch_count => id,
        id if id == patch_count + 1 => Items::ESCAPED,
        _ => Items::BLOCKED,
    });
    Items {
        resolution,
        seen: seen.collect(),
    }
}
