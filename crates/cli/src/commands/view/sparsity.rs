//! `hemicube view sparsity`: the pattern of a matrix.

use crate::args::Talk;
use crate::exit::Exit;
use crate::picture::canvas::{Anchor, Canvas, Format, INK, Rect, WHITE};
use crate::picture::sparsity::{Order, Sparsity};
use crate::report::{count, counted, figures, percent};
use anyhow::Result;
use clap::Args;
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
    /// Replace what is there
    #[arg(long)]
    pub(crate) overwrite: bool,
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

pub(crate) fn run(arguments: &Arguments, talk: Talk) -> Result<Exit> {
    Format::of(&arguments.output)?;
    crate::report::require_matrix(&arguments.store)?;
    let store = Store::open(&arguments.store)?;
    let patches = store.patch_count() as usize;
    let mut found = Sparsity::new(&store, arguments.order, arguments.size)?;
    for index in 0..store.manifest().parts.len() {
        if let Some(part) = store.part(index)? {
            found.add(&part);
        }
    }
    let cells = found.cells;
    let enlarge = (480 / cells).max(1);
    let side = cells * enlarge;
    let mut canvas = Canvas::new(side.max(420) + 40, side + 110, WHITE);
    canvas.fill(Rect::square(19, 43, side + 2), INK);
    canvas.put((20, 44), &found.picture(enlarge));
    let total = store.manifest().entries;
    let full = percent(total as f64 / (patches as f64 * patches as f64));
    let order = if arguments.order == Order::Work {
        "order of work"
    } else {
        "order of the file"
    };
    let heading = format!(
        "{}, {full} of {} × {}",
        counted(total, "entry"),
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
