//! What the bands of a run have in common behind their portals: the passes of pixels, and legs of rays.
//!
//! Bands are followed together in groups, [`Passes`] with a weight a band. Each ends by its own weights, so that a
//! band's row does not depend on the others.

use super::extend::{Drawn, Extender, RowPixels, follow_row};
use super::gather::{Column, Ledger};
use super::known::KnownLegs;
use super::pass::{Passes, Taker};
use crate::backend::{BackendError, HemicubeBackend};
use crate::bvh::Tree;
use crate::delta::DeltaTable;
use std::ops::Range;
use std::sync::Arc;

/// Bands followed together at most. A choice: each has a weight in every pixel.
const TOGETHER: usize = 4;
/// Rows followed band by band after one that had to be followed again, at first and at most. Choices.
const ALONE: [u32; 2] = [15, 255];

/// A row's hemicubes and what they see directly.
#[derive(Clone, Copy)]
pub(crate) struct Seen<'r> {
    pub(crate) drawn: Drawn<'r>,
    /// The row's columns.
    pub(crate) columns: &'r [i32],
}

/// A band's row behind its portals, followed with those of others.
#[derive(Debug, Default)]
pub(super) struct Followed {
    pub(super) ledger: Ledger,
    pub(super) legs: u64,
    /// False where the band is to be followed alone.
    pub(super) is_valid: bool,
}

/// Follows bands together; one a thread.
#[derive(Debug, Default)]
pub(crate) struct Common {
    groups: Vec<Group>,
    /// By band.
    followed: Vec<Followed>,
    pub(super) known: KnownLegs,
}

/// Passes of as many bands.
#[derive(Debug)]
enum Together {
    Two(Passes<2>),
    Three(Passes<3>),
    Four(Passes<4>),
}

#[derive(Debug)]
struct Group {
    bands: Range<usize>,
    passes: Together,
    table: Arc<DeltaTable>,
    /// Rows to follow band by band, and how many of them after the next that is followed again: rows nearby are alike,
    /// and a row is the same either way.
    alone: u32,
    next_alone: u32,
}

impl Common {
    /// Of the bands of a run, in their order.
    pub(crate) fn new<'a, 'e: 'a>(bands: impl Iterator<Item = &'a Extender<'e>>) -> Self {
        let bands: Vec<_> = bands.collect();
        if bands.len() < 2 {
            return Self::default();
        }
        let count = bands.len().div_ceil(TOGETHER);
        let group = |number: usize| {
            let range = number * bands.len() / count..(number + 1) * bands.len() / count;
            let of = &bands[range.clone()];
            let table = Arc::clone(of[0].table()?);
            // One end of paths for all pixels.
            let is_one_bound = of.iter().all(|band| band.bound().to_bits() == of[0].bound().to_bits());
            let tree = Tree::of(of[0].model.geometry());
            let optics = |band: usize| of[band].surfaces().optics;
            let passes = match of.len() {
                2 => Together::Two(Passes::new(&tree, std::array::from_fn(optics))),
                3 => Together::Three(Passes::new(&tree, std::array::from_fn(optics))),
                4 => Together::Four(Passes::new(&tree, std::array::from_fn(optics))),
                _ => return None,
            };
            is_one_bound.then_some(Group {
                bands: range,
                passes,
                table,
                alone: 0,
                next_alone: ALONE[0],
            })
        };
        let groups: Vec<Group> = (0..count).filter_map(group).collect();
        Self {
            followed: bands.iter().map(|_| Followed::default()).collect(),
            known: KnownLegs::new(bands.iter().all(|band| band.table().is_none())),
            groups,
        }
    }

    /// Begins a row: follows its pixels for all bands, where pixels are followed. `receives` tells the patches with a
    /// column.
    ///
    /// # Errors
    /// When the backend hands out no item buffers.
    pub(crate) fn begin_row(
        &mut self,
        bands: &[&Extender<'_>],
        seen: Seen<'_>,
        receives: impl Fn(u32) -> bool,
        session: &mut dyn HemicubeBackend,
    ) -> Result<(), BackendError> {
        self.known.begin_row();
        self.followed.iter_mut().for_each(|row| row.is_valid = false);
        for group in &mut self.groups {
            let bands = &bands[group.bands.clone()];
            let followed = &mut self.followed[group.bands.clone()];
            if group.alone > 0 {
                group.alone -= 1;
                continue;
            }
            let table = &group.table;
            let is_whole = match &mut group.passes {
                Together::Two(passes) => follow(passes, bands, followed, table, seen, &receives, session)?,
                Together::Three(passes) => follow(passes, bands, followed, table, seen, &receives, session)?,
                Together::Four(passes) => follow(passes, bands, followed, table, seen, &receives, session)?,
            };
            if is_whole {
                group.next_alone = ALONE[0];
            } else {
                group.alone = group.next_alone;
                group.next_alone = (2 * group.next_alone + 1).min(ALONE[1]);
            }
        }
        Ok(())
    }

    /// The row of a band, if it was followed.
    pub(super) fn take(&mut self, band: usize) -> Option<&mut Followed> {
        let followed = self.followed.get_mut(band)?;
        std::mem::take(&mut followed.is_valid).then_some(followed)
    }
}

/// Follows a row's pixels for N bands. Returns false where each is to be followed alone.
fn follow<const N: usize>(
    passes: &mut Passes<N>,
    bands: &[&Extender<'_>],
    followed: &mut [Followed],
    table: &DeltaTable,
    seen: Seen<'_>,
    receives: impl Fn(u32) -> bool,
    session: &mut dyn HemicubeBackend,
) -> Result<bool, BackendError> {
    let surfaces: [_; N] = std::array::from_fn(|band| bands[band].surfaces());
    let portals: Vec<u32> = seen
        .columns
        .iter()
        .map(|patch| patch.cast_unsigned())
        .filter(|&patch| passes.is_portal(patch))
        .collect();
    if portals.is_empty() {
        return Ok(true);
    }
    let mut ledgers: [Ledger; N] = std::array::from_fn(|band| std::mem::take(&mut followed[band].ledger));
    ledgers.iter_mut().for_each(Ledger::clear);
    let mut taker = Taker {
        ledgers: &mut ledgers,
        column: |patch: u32| -> Column { bands[0].column(patch, &receives) },
        up: None,
    };
    let pixels = RowPixels {
        hemicubes: seen.drawn.hemicubes,
        items: seen.drawn.items,
        table,
        bound: bands[0].bound(),
        cancel: bands[0].cancel,
    };
    let is_valid = follow_row(passes, pixels, &portals, surfaces, &mut taker, session)?;
    for ((followed, ledger), legs) in followed.iter_mut().zip(ledgers).zip(passes.legs) {
        *followed = Followed { ledger, legs, is_valid };
    }
    Ok(is_valid)
}
