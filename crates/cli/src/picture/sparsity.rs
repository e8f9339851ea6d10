//! The pattern of a matrix: how full each cell of a grid over its rows and columns is.

use super::canvas::{Canvas, NOTHING, scale_color};
use anyhow::Result;
use clap::ValueEnum;
use hemicube::store::{Part, Store};

/// The order of rows and columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Order {
    /// As in the scene's file.
    Input,
    /// As they were computed.
    Work,
}

/// Fill of each cell of a matrix.
pub(crate) struct Sparsity {
    /// Along an edge.
    pub(crate) cells: usize,
    /// Rank of each patch.
    place: Vec<u32>,
    entries: Vec<u64>,
    rows: Vec<u64>,
}

impl Sparsity {
    /// An empty grid over a matrix in `order`, at most `size` cells along an edge.
    ///
    /// # Errors
    /// When the head of a part is damaged.
    pub(crate) fn new(store: &Store, order: Order, size: u32) -> Result<Self> {
        let patches = store.patch_count() as usize;
        let mut place: Vec<u32> = (0..store.patch_count()).collect();
        if order == Order::Work {
            // Patches without a row come last.
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
