//! Where a matrix has entries.

use super::canvas::{Anchor, Canvas, INK, NOTHING, WHITE, scale_color};
use crate::args::Talk;
use crate::exit::Exit;
use crate::report::{count, figures, percent};
use anyhow::Result;
use clap::{Args, ValueEnum};
use hemicube::store::{Part, Store};
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
    /// Replace a file that is there
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

/// The order of rows and columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Order {
    /// As in the scene's file.
    Input,
    /// As they were computed.
    Work,
}

/// How much of each cell of a matrix is filled.
pub(crate) struct Sparsity {
    /// Along an edge.
    pub(crate) cells: usize,
    /// Where a patch comes.
    place: Vec<u32>,
    entries: Vec<u64>,
    rows: Vec<u64>,
}

impl Sparsity {
    /// Nothing yet of a matrix that is drawn in `order`, in no more than `size` cells along an edge.
    ///
    /// # Errors
    /// When the head of a part is damaged.
    pub(crate) fn new(store: &Store, order: Order, size: u32) -> Result<Self> {
        let patches = store.patch_count() as usize;
        let mut place: Vec<u32> = (0..store.patch_count()).collect();
        if order == Order::Work {
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
        let cells = patches.min(size as usize);
        Ok(Self {
            cells,
            place,
            entries: vec![0; cells * cells],
            rows: vec![0; cells],
        })
    }

    fn cell(&self, patch: usize) -> usize {
        self.place[patch] as usize * self.cells / self.place.len()
    }

    /// Counts the entries of a part.
    pub(crate) fn add(&mut self, part: &Part) {
        for (row, &patch) in part.rows.iter().enumerate() {
            let y = self.cell(patch as usize);
            self.rows[y] += 1;
            for &column in part.row(row).0 {
                if let Some(column) = usize::try_from(column).ok().filter(|&column| column < self.place.len()) {
                    let x = self.cell(column);
                    self.entries[y * self.cells + x] += 1;
                }
            }
        }
    }

    /// The cells, each `enlarge` pixels wide, and nothing else.
    pub(crate) fn picture(&self, enlarge: usize) -> Canvas {
        let mut width = vec![0u64; self.cells];
        for patch in 0..self.place.len() {
            width[self.cell(patch)] += 1;
        }
        let side = self.cells * enlarge;
        let mut canvas = Canvas::new(side, side, NOTHING);
        for y in 0..side {
            for x in 0..side {
                let (row, column) = (y / enlarge, x / enlarge);
                let (got, whole) = (self.entries[row * self.cells + column], self.rows[row] * width[column]);
                if got > 0 {
                    canvas.set(x, y, scale_color(got as f64 / whole.max(1) as f64));
                }
            }
        }
        canvas
    }
}

pub(crate) fn run(arguments: &Arguments, talk: Talk) -> Result<Exit> {
    super::canvas::Format::of(&arguments.output)?;
    crate::report::require(&arguments.store)?;
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
    canvas.fill((19, 43), (side + 2, side + 2), INK);
    canvas.put((20, 44), &found.picture(enlarge));
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
