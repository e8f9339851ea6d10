//! Comparators: found against due. Each returns a summary if content, and the defect if not.

use hemicube::backend::{Counters, WHOLE};
use hemicube::delta::DeltaTable;
use hemicube::face::Items;
use hemicube::row::{RowBlock, RowView};
use std::collections::BTreeMap;

/// A comparator's summary, or the defect.
pub type Verdict = Result<String, String>;

/// Bytes that a call may read back besides entries.
const BYTES_PER_CALL: u64 = 64 << 10;
/// Bytes of an entry at most: patch, visible and covered weight, and room for one more number.
const BYTES_PER_ENTRY: u64 = 16;

/// Compares rows to the bit: those of `found` with those of `wanted` at `places`.
///
/// # Errors
/// The first different row and entry.
///
/// ```
/// use hemicube::InputPatch;
/// use hemicube::backend::WHOLE;
/// use hemicube::row::RowBlock;
/// use hemicube_conformance::compare::same_rows;
///
/// let rows = |weights: &[u32]| {
///     let mut block = RowBlock::default();
///     for &weight in weights {
///         block.push(InputPatch(4), weight, 0);
///         block.end_row(WHOLE - weight, 0);
///     }
///     block
/// };
/// // What one batch gave, against the second and third row of what all together gave.
/// let wanted = rows(&[100, 200, 300]);
/// assert_eq!(same_rows(&rows(&[200, 300]), &wanted, &[1, 2]), Ok("2 rows to the bit".to_owned()));
/// let refused = same_rows(&rows(&[200, 301]), &wanted, &[1, 2]);
/// assert!(refused.is_err_and(|what| what.starts_with("row 2: ")));
/// ```
pub fn same_rows(found: &RowBlock, wanted: &RowBlock, places: &[usize]) -> Verdict {
    if found.len() != places.len() {
        return Err(format!("{} rows where {} were asked for", found.len(), places.len()));
    }
    for (row, &place) in places.iter().enumerate() {
        same_row(found.row(row), wanted.row(place)).map_err(|what| format!("row {place}: {what}"))?;
    }
    Ok(format!("{} rows to the bit", found.len()))
}

fn same_row(found: RowView<'_>, wanted: RowView<'_>) -> Result<(), String> {
    if (found.escaped, found.blocked) != (wanted.escaped, wanted.blocked) {
        return Err(format!(
            "escaped {} and blocked {}, not {} and {}",
            found.escaped, found.blocked, wanted.escaped, wanted.blocked
        ));
    }
    let entries = |row: RowView<'_>| -> Vec<(u32, u32, u32)> {
        let weights = row.visible.iter().zip(row.covered);
        row.patches
            .iter()
            .zip(weights)
            .map(|(&p, (&v, &c))| (p, v, c))
            .collect()
    };
    let (found, wanted) = (entries(found), entries(wanted));
    if let Some((found, wanted)) = found.iter().zip(&wanted).find(|(a, b)| a != b) {
        return Err(format!("(patch, visible, covered) is {found:?}, not {wanted:?}"));
    }
    if found.len() != wanted.len() {
        return Err(format!("{} entries, not {}", found.len(), wanted.len()));
    }
    Ok(())
}

/// Compares a row's visible weights with the sums of its pixels' weights. Sub-pixel patches, without a pixel, are
/// passed over.
///
/// # Errors
/// The difference from [`Items::reduce`].
pub fn same_reduction(row: RowView<'_>, items: &Items, table: &DeltaTable) -> Verdict {
    let (entries, escaped, blocked) = items.reduce(table);
    if (row.escaped, row.blocked) != (escaped, blocked) {
        return Err(format!(
            "escaped {} and blocked {}; the item buffer has {escaped} and {blocked}",
            row.escaped, row.blocked
        ));
    }
    let mut wanted: BTreeMap<u32, u32> = entries.iter().map(|&(patch, weight)| (patch.0, weight)).collect();
    for (&patch, &visible) in row.patches.iter().zip(row.visible) {
        let due = wanted.remove(&patch).unwrap_or(0);
        if visible != due {
            return Err(format!("patch {patch} has weight {visible}; its pixels have {due}"));
        }
    }
    // A pixel near the horizon may weigh nothing, and a patch visible only there may be left out.
    match wanted.into_iter().find(|&(_, weight)| weight > 0) {
        Some((patch, weight)) => Err(format!("patch {patch} is missing; its pixels have weight {weight}")),
        None => Ok(format!("{} entries are their pixels' sums", row.patches.len())),
    }
}

/// Compares the number of hemicubes counted with the number rendered.
///
/// # Errors
/// When they differ.
pub fn counted(counters: &Counters, hemicubes: usize) -> Verdict {
    if counters.hemicubes == hemicubes as u64 {
        Ok(format!("{hemicubes} hemicubes counted"))
    } else {
        Err(format!("{} hemicubes counted of {hemicubes}", counters.hemicubes))
    }
}

/// Fewer triangles were drawn with culling than without, and nodes were dropped.
///
/// # Errors
/// When nothing was culled.
pub fn culled(on: &Counters, off: &Counters) -> Verdict {
    let dropped = on.nodes_outside + on.nodes_hidden;
    if on.triangles_drawn < off.triangles_drawn && dropped > 0 {
        Ok(format!(
            "{} of {} triangles drawn, {dropped} nodes dropped, {} queries",
            on.triangles_drawn, off.triangles_drawn, on.queries
        ))
    } else {
        Err(format!(
            "nothing was culled: {} triangles drawn with culling, {} without, {dropped} nodes dropped",
            on.triangles_drawn, off.triangles_drawn
        ))
    }
}

/// Little more came back from the device than the entries themselves.
///
/// # Errors
/// When more did.
pub fn bytes_bounded(counters: &Counters, entries: usize, calls: u64) -> Verdict {
    let bound = BYTES_PER_ENTRY * entries as u64 + BYTES_PER_CALL * calls;
    if counters.bytes_read_back <= bound {
        Ok(format!("{} bytes for {entries} entries", counters.bytes_read_back))
    } else {
        Err(format!(
            "{} bytes read back for {entries} entries in {calls} calls; {bound} are allowed",
            counters.bytes_read_back
        ))
    }
}

/// Compares covered with visible weights, in scenes without occluders.
///
/// # Errors
/// The first different entry.
pub fn unoccluded(rows: &RowBlock) -> Verdict {
    for row in 0..rows.len() {
        let view = rows.row(row);
        let weights = view.visible.iter().zip(view.covered);
        if let Some((&patch, (v, c))) = view.patches.iter().zip(weights).find(|(_, (v, c))| v != c) {
            return Err(format!(
                "row {row}: patch {patch} shows {v} of the {c} that it covers, and nothing hides it"
            ));
        }
    }
    Ok(format!("{} entries show all that they cover", rows.patches.len()))
}

/// Looks for entries of a row's own emitter.
///
/// # Errors
/// The first such entry.
pub fn emitter_unseen(rows: &RowBlock, emitters: &[Option<u32>]) -> Verdict {
    for (row, emitter) in emitters.iter().enumerate() {
        if let Some(emitter) = emitter
            && rows.row(row).patches.contains(emitter)
        {
            return Err(format!("row {row}: patch {emitter} sees itself"));
        }
    }
    Ok("no patch sees itself".to_owned())
}

/// Item buffers differ in no more than this share of their pixels.
///
/// # Errors
/// When they differ in more.
pub fn pixels_near(found: &[Items], wanted: &[Items], bound: f64) -> Verdict {
    let (mut different, mut pixels) = (0usize, 0usize);
    for (found, wanted) in found.iter().zip(wanted) {
        if found.seen.len() != wanted.seen.len() {
            return Err("item buffers of different sizes".to_owned());
        }
        pixels += found.seen.len();
        different += found.seen.iter().zip(&wanted.seen).filter(|(a, b)| a != b).count();
    }
    let share = different as f64 / pixels.max(1) as f64;
    let text = format!("{share:.1e} of the pixels differ");
    if pixels > 0 && share <= bound {
        Ok(text)
    } else {
        Err(format!("{text}; {bound:.0e} may"))
    }
}

/// The L1 distance of two rows' visible, escaped and blocked weights, relative to a hemicube.
pub fn row_distance(found: RowView<'_>, wanted: RowView<'_>) -> f64 {
    let mut sums: BTreeMap<u32, [u32; 2]> = BTreeMap::new();
    for (side, row) in [found, wanted].into_iter().enumerate() {
        for (&patch, &weight) in row.patches.iter().zip(row.visible) {
            sums.entry(patch).or_default()[side] = weight;
        }
    }
    let lost = [(found.escaped, wanted.escaped), (found.blocked, wanted.blocked)];
    let lost: u64 = lost.iter().map(|&(a, b)| u64::from(a.abs_diff(b))).sum();
    let seen: u64 = sums.values().map(|&[a, b]| u64::from(a.abs_diff(b))).sum();
    (seen + lost) as f64 / f64::from(WHOLE)
}

/// No row is farther from the reference's than this, by [`row_distance`].
///
/// # Errors
/// The farthest one.
pub fn rows_near(found: &RowBlock, wanted: &RowBlock, bound: f64) -> Verdict {
    if found.len() != wanted.len() || found.is_empty() {
        return Err(format!("{} rows where {} are due", found.len(), wanted.len()));
    }
    let farthest = (0..found.len())
        .map(|row| (row_distance(found.row(row), wanted.row(row)), row))
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .unwrap_or_default();
    let text = format!(
        "row {} is {:.1e} off in L1, the most of {}",
        farthest.1,
        farthest.0,
        found.len()
    );
    if farthest.0 <= bound {
        Ok(text)
    } else {
        Err(format!("{text}; {bound:.0e} is allowed"))
    }
}

/// Lists by row the entries without any weight: sub-pixel patches.
fn tiny(rows: &RowBlock) -> Vec<(usize, u32)> {
    let of_row = |row| {
        let view = rows.row(row);
        let all = view.patches.iter().zip(view.visible.iter().zip(view.covered));
        all.filter(|(_, (v, c))| **v == 0 && **c == 0)
            .map(move |(&patch, _)| (row, patch))
            .collect::<Vec<_>>()
    };
    (0..rows.len()).flat_map(of_row).collect()
}

/// Counts the sub-pixel patches reported in a block of rows.
pub fn tiny_count(rows: &RowBlock) -> usize {
    tiny(rows).len()
}

/// Looks for the reference's sub-pixel patches, reported likewise or with a pixel of their own. The nearest patch at a
/// centroid depends on the arithmetic of depths: the two engines of the CPU backend agree on six of seven.
///
/// # Errors
/// When fewer than half are found.
pub fn tiny_found(found: &RowBlock, wanted: &RowBlock) -> Verdict {
    let due = tiny(wanted);
    let there = due
        .iter()
        .filter(|&&(row, patch)| found.row(row).patches.contains(&patch))
        .count();
    let text = format!("{there} of {} tiny patches found", due.len());
    if !due.is_empty() && there * 2 >= due.len() {
        Ok(text)
    } else {
        Err(text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hemicube::face::pixel_count;
    use hemicube_scene::InputPatch;

    fn rows() -> RowBlock {
        let mut rows = RowBlock::default();
        rows.push(InputPatch(2), 500, 500);
        rows.push(InputPatch(5), 1000, 1000);
        rows.end_row(WHOLE - 1600, 100);
        rows.push(InputPatch(1), 7, 7);
        rows.push(InputPatch(3), 0, 0);
        rows.end_row(WHOLE - 7, 0);
        rows
    }

    fn doctored(mend: fn(&mut RowBlock)) -> RowBlock {
        let mut rows = rows();
        mend(&mut rows);
        rows
    }

    #[test]
    fn same_rows_refuses_any_other_bit() {
        assert!(same_rows(&rows(), &rows(), &[0, 1]).is_ok());
        for (mend, word) in [
            ((|r| r.visible[0] += 1) as fn(&mut RowBlock), "(2, 501, 500)"),
            (|r| r.covered[2] += 1, "row 1"),
            (|r| r.patches[1] = 6, "(6, 1000, 1000)"),
            (|r| r.escaped[1] -= 1, "escaped"),
            (|r| r.blocked[0] += 1, "blocked"),
            (|r| r.row_end[0] = 1, "row 0"),
        ] {
            let wrong = same_rows(&doctored(mend), &rows(), &[0, 1]).expect_err(word);
            assert!(wrong.contains(word), "{wrong}");
        }
        assert!(same_rows(&rows(), &rows(), &[1, 0]).is_err());
        assert!(same_rows(&rows(), &rows(), &[0]).is_err());
    }

    fn items() -> Items {
        let mut seen = vec![Items::ESCAPED; pixel_count(16)];
        seen[40..60].fill(3);
        seen[60] = Items::BLOCKED;
        Items { resolution: 16, seen }
    }

    #[test]
    fn same_reduction_refuses_a_pixel_too_many() {
        let table = DeltaTable::new(16);
        let (entries, escaped, blocked) = items().reduce(&table);
        let mut rows = RowBlock::default();
        entries
            .iter()
            .for_each(|&(patch, weight)| rows.push(patch, weight, weight));
        rows.push(InputPatch(9), 0, 0);
        rows.end_row(escaped, blocked);
        assert!(same_reduction(rows.row(0), &items(), &table).is_ok());
        for pixel in [40, 60, 100] {
            let mut doctored = items();
            doctored.seen[pixel] = 4;
            assert!(same_reduction(rows.row(0), &doctored, &table).is_err(), "{pixel}");
        }
        rows.visible[0] += 1;
        assert!(same_reduction(rows.row(0), &items(), &table).is_err());
        rows.visible[0] -= 1;
        rows.visible[1] = 1;
        assert!(same_reduction(rows.row(0), &items(), &table).is_err());
    }

    #[test]
    fn counters_are_not_taken_on_trust() {
        let on = Counters {
            hemicubes: 3,
            triangles_drawn: 10,
            nodes_hidden: 4,
            bytes_read_back: 1000,
            ..Counters::default()
        };
        let off = Counters {
            triangles_drawn: 100,
            ..on
        };
        assert!(counted(&on, 3).is_ok() && counted(&on, 4).is_err());
        assert!(culled(&on, &off).is_ok());
        assert!(culled(&off, &off).is_err(), "nothing culled");
        let silent = Counters { nodes_hidden: 0, ..on };
        assert!(culled(&silent, &off).is_err(), "no node dropped");
        assert!(culled(&Counters::default(), &Counters::default()).is_err());
        assert!(bytes_bounded(&on, 1, 1).is_ok());
        let dense = Counters {
            bytes_read_back: BYTES_PER_CALL + BYTES_PER_ENTRY + 1,
            ..on
        };
        assert!(bytes_bounded(&dense, 1, 1).is_err());
    }

    #[test]
    fn something_hidden_is_noticed() {
        assert!(unoccluded(&rows()).is_ok());
        assert!(unoccluded(&doctored(|r| r.covered[1] += 1)).is_err());
        assert!(emitter_unseen(&rows(), &[Some(1), Some(2)]).is_ok());
        assert!(emitter_unseen(&rows(), &[Some(1), Some(3)]).is_err());
        assert!(emitter_unseen(&rows(), &[None, None]).is_ok());
    }

    #[test]
    fn near_has_a_bound() {
        let one_off = {
            let mut items = items();
            items.seen[0] = 1;
            items
        };
        let share = 1.0 / pixel_count(16) as f64;
        let one_off = [one_off];
        assert!(pixels_near(&one_off, &[items()], share).is_ok());
        assert!(pixels_near(&one_off, &[items()], share * 0.99).is_err());
        assert!(pixels_near(&[], &[], 1.0).is_err(), "nothing was compared");

        let off = doctored(|r| {
            r.visible[1] -= 1000;
            r.blocked[0] += 1000;
        });
        let distance = 2000.0 / f64::from(WHOLE);
        assert_eq!(row_distance(off.row(0), rows().row(0)), distance);
        assert!(rows_near(&off, &rows(), distance).is_ok());
        assert!(rows_near(&off, &rows(), distance * 0.99).is_err());
        assert!(rows_near(&RowBlock::default(), &RowBlock::default(), 1.0).is_err());
    }

    #[test]
    fn tiny_patches_that_vanish_are_noticed() {
        assert_eq!(tiny_count(&rows()), 1);
        assert!(tiny_found(&rows(), &rows()).is_ok());
        assert!(tiny_found(&doctored(|r| r.patches[3] = 4), &rows()).is_err());
        let none = doctored(|r| r.visible[3] = 1);
        assert!(tiny_found(&rows(), &none).is_err(), "nothing was compared");
    }
}
