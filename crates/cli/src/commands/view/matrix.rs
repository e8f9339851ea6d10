//! Where a matrix has entries.

use super::canvas::{Anchor, Canvas, INK, NOTHING, WHITE, scale_color};
use crate::args::Talk;
use crate::exit::Exit;
use crate::report::{count, figures, percent};
use anyhow::Result;
use clap::{Args, ValueEnum};
use hemicube::store::Store;
use std::path::PathBuf;

/// `hemicube view sparsity`
#[derive(Args, Debug)]
pub(crate) struct Arguments {
    /// The matrix
    #[arg(value_name = "DIR")]
    pub(crate) store: PathBuf,
    /// The picture: .png or .svg
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,
    /// In which order rows and columns are: of the file, or of the work (neighbours side by side)
    #[arg(
        long,
        value_name = "input|work",
        default_value = "input",
        hide_possible_values = true
    )]
    pub(crate) order: Order,
    /// Cells along an edge, at most
    #[arg(long, value_name = "N", default_value = "640", value_parser = clap::value_parser!(u32).range(16..=4096))]
    pub(crate) size: u32,
}

/// The order of rows and columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Order {
    /// As in the scene's file.
    Input,
    /// As they were computed.
    Work,
}

pub(crate) fn run(arguments: &Arguments, talk: Talk) -> Result<Exit> {
    super::canvas::Format::of(&arguments.output)?;
    crate::report::require(&arguments.store)?;
    let store = Store::open(&arguments.store)?;
    let patches = store.patch_count() as usize;
    let cells = patches.min(arguments.size as usize);
    let mut place: Vec<u32> = (0..store.patch_count()).collect();
    if arguments.order == Order::Work {
        // What has no row comes last.
        let mut next = 0;
        let mut known = vec![false; patches];
        for patch in store.processing_order()? {
            place[patch.0 as usize] = next;
            known[patch.0 as usize] = true;
            next += 1;
        }
        for (place, _) in place.iter_mut().zip(&known).filter(|(_, known)| !**known) {
            *place = next;
            next += 1;
        }
    }
    let cell = |patch: usize| place[patch] as usize * cells / patches;
    let mut entries = vec![0u64; cells * cells];
    let mut rows = vec![0u64; cells];
    for index in 0..store.manifest().parts.len() {
        let Some(part) = store.part(index)? else { continue };
        for (row, &patch) in part.rows.iter().enumerate() {
            let y = cell(patch as usize);
            rows[y] += 1;
            for &column in part.row(row).0 {
                if let Some(column) = usize::try_from(column).ok().filter(|&column| column < patches) {
                    entries[y * cells + cell(column)] += 1;
                }
            }
        }
    }
    let mut width = vec![0u64; cells];
    for patch in 0..patches {
        width[cell(patch)] += 1;
    }
    let enlarge = (480 / cells).max(1);
    let side = cells * enlarge;
    let mut canvas = Canvas::new(side.max(420) + 40, side + 110, WHITE);
    canvas.fill((19, 43), (side + 2, side + 2), INK);
    for y in 0..side {
        for x in 0..side {
            let (row, column) = (y / enlarge, x / enlarge);
            let (got, whole) = (entries[row * cells + column], rows[row] * width[column]);
            let color = if got == 0 {
                NOTHING
            } else {
                scale_color(got as f64 / whole.max(1) as f64)
            };
            canvas.set(20 + x, 44 + y, color);
        }
    }
    let total = store.manifest().entries;
    let full = percent(total as f64 / (patches as f64 * patches as f64));
    let order = if arguments.order == Order::Work {
        "order of work"
    } else {
        "order of the file"
    };
    let heading = format!(
        "{} entries, {full} of {} × {}",
        count(total),
        count(patches as u64),
        count(patches as u64)
    );
    canvas.write(&heading, (20.0, 28.0), 15.0, Anchor::Start);
    let title = format!(
        "of each cell is filled ({order}; {} patches a cell)",
        figures(patches as f64 / cells as f64)
    );
    canvas.scale((20, side + 54), 160, ["> 0", "all"], &title);
    canvas.save(&arguments.output)?;
    talk.say(&format!("`{}`: {heading}", arguments.output.display()));
    Ok(Exit::Done)
}
