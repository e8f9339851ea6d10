//! Rows of patches that are several elements, added up while the rows of their elements stream.
//!
//! ```text
//! F_IJ = Σ_{i∈I} A_i Σ_{j∈J} F_ij / Σ_{i∈I} A_i        X_I = Σ_{i∈I} A_i X_i / Σ_{i∈I} A_i
//! e_I = Σ_{i∈I} A_i e_i / Σ_{i∈I} A_i
//! ```
//!
//! X are the shares *escaped*, *blocked* and *unselected*, and what portals *passed* on and *cut off*; e the expected
//! errors of rows, √Σ (F − true F)². Errors of
//! the columns of one patch are taken for independent, those of its elements for equal: neighbours see the same
//! penumbrae (`docs/dev/accuracy.md` has measurements). Workers add up the columns of an element's row, in the order of
//! columns; the collector adds up elements, in the order of work. Both are in f64 and do not depend on threads or
//! batches. Weights, hemicubes and rays are added up in integers. Memory: the open row, and one element's row a worker,
//! 8 bytes a patch each.

use crate::Grouping;
use crate::driver::plan::Plan;
use crate::store::{FactorVec, FinishedRow, Passage, RowErrors, RowShares, RowSums, small_entries};
use hemicube_scene::InputPatch;

/// Adds up the columns of elements' rows, one row after the other.
#[derive(Debug, Default)]
pub(super) struct ColumnSums {
    /// By patch; 0 between rows.
    sums: Vec<f64>,
    /// The row's patches.
    touched: Vec<u32>,
}

impl ColumnSums {
    /// Replaces the entries of an element's row by those of the patches, ascending, in f64.
    pub(super) fn add_up(&mut self, grouping: &Grouping, row: &mut FinishedRow) {
        self.sums.resize(grouping.len(), 0.0);
        for (column, factor) in row.entries() {
            let patch = grouping.patch_of(InputPatch(column)).0;
            let sum = &mut self.sums[patch as usize];
            if *sum == 0.0 {
                self.touched.push(patch);
            }
            *sum += factor;
        }
        row.columns.clear();
        self.touched.sort_unstable();
        self.touched.dedup();
        let mut sums = Vec::with_capacity(self.touched.len());
        for patch in self.touched.drain(..) {
            row.columns.push(patch.cast_signed());
            sums.push(std::mem::take(&mut self.sums[patch as usize]));
        }
        row.factors = FactorVec::Double(sums);
    }
}

/// The row of a patch, some of whose elements have come.
#[derive(Debug)]
pub(super) struct OpenRow<'a> {
    plan: &'a Plan,
    grouping: &'a Grouping,
    /// The patches that are mirrors or panes.
    portals: Vec<bool>,
    patch: Option<InputPatch>,
    /// Σ A_i Σ_j F_ij by patch; 0 between rows.
    exchange: Vec<f64>,
    touched: Vec<u32>,
    /// The area of the elements with hemicubes, and of all elements.
    area: f64,
    whole_area: f64,
    shares: [f64; 3],
    passage: Passage,
    errors: [f64; 3],
    sums: RowSums,
    hemicubes: u64,
    rays: u64,
}

/// A row of a patch, the patch's area, and the change by leaving out small entries.
pub(super) type Closed = (FinishedRow, f64, small_entries::RowChange);

impl<'a> OpenRow<'a> {
    /// `None` where elements are patches.
    pub(super) fn new(plan: &'a Plan) -> Option<Self> {
        let grouping = plan.groups.as_ref()?.grouping.as_ref();
        Some(Self {
            plan,
            grouping,
            portals: plan.portal_columns(),
            patch: None,
            exchange: vec![0.0; grouping.len()],
            touched: Vec::new(),
            area: 0.0,
            whole_area: 0.0,
            shares: [0.0; 3],
            passage: Passage::default(),
            errors: [0.0; 3],
            sums: RowSums::default(),
            hemicubes: 0,
            rays: 0,
        })
    }

    /// Returns whether an element is of another patch than the row.
    pub(super) fn ends_before(&self, element: u32) -> bool {
        self.patch
            .is_some_and(|patch| patch != self.grouping.patch_of(InputPatch(element)))
    }

    /// Adds an element's row, with added up columns.
    pub(super) fn add(&mut self, row: &FinishedRow, area: f64) {
        self.patch = Some(self.grouping.patch_of(InputPatch(row.patch)));
        self.whole_area += area;
        // An element without a hemicube has no area to speak of, and neither form factors nor shares.
        if row.hemicubes == 0 {
            return;
        }
        self.area += area;
        for (patch, factor) in row.entries() {
            let sum = &mut self.exchange[patch as usize];
            if *sum == 0.0 {
                self.touched.push(patch);
            }
            *sum += area * factor;
        }
        for (sum, share) in self.shares.iter_mut().zip(row.shares.to_array()) {
            *sum += area * share;
        }
        if let Some(passage) = &row.passage {
            self.passage.passed += area * passage.passed;
            self.passage.cut_off += area * passage.cut_off;
        }
        for (sum, error) in self.errors.iter_mut().zip(row.errors.to_array()) {
            *sum += area * f64::from(error);
        }
        let of_row = &row.sums;
        self.sums.visible += of_row.visible;
        self.sums.escaped += of_row.escaped;
        self.sums.blocked += of_row.blocked;
        self.sums.unselected += of_row.unselected;
        self.hemicubes += u64::from(row.hemicubes);
        self.rays += row.rays;
    }

    /// The row, without small entries and rounded as planned. `None` without an element.
    pub(super) fn close(&mut self) -> Option<Closed> {
        let patch = self.patch.take()?;
        let mut row = FinishedRow::new(patch.0, self.plan.form.precision());
        // Of a patch that fills the view, the errors of closed forms may add up to more than 1. By mirrors, F^s may.
        let most = if self.plan.portals.is_empty() {
            1.0
        } else {
            f64::INFINITY
        };
        self.touched.sort_unstable();
        self.touched.dedup();
        for patch in self.touched.drain(..) {
            let exchange = std::mem::take(&mut self.exchange[patch as usize]);
            row.columns.push(patch.cast_signed());
            row.factors.push((exchange / self.area).min(most));
        }
        let errors = std::mem::take(&mut self.errors).map(|sum| crate::store::closure::narrow(sum / self.area));
        row.errors = RowErrors::from_array(errors);
        let keeping = self.plan.keeping(&self.portals);
        let change = small_entries::keep(&mut row, keeping);
        let is_known = self.hemicubes > 0;
        if !self.plan.portals.is_empty() {
            let Passage { passed, cut_off } = std::mem::take(&mut self.passage);
            let of = |sum: f64| if is_known { sum / self.area } else { 0.0 };
            row.passage = Some(Passage {
                passed: of(passed),
                cut_off: of(cut_off),
            });
        }
        row.sums = std::mem::take(&mut self.sums);
        // A mean of ones may round to above 1.
        let shares = std::mem::take(&mut self.shares).map(|sum| (sum / self.area).min(1.0));
        if is_known {
            row.shares = RowShares::from_array(shares);
        } else {
            row.shares = RowShares::UNKNOWN;
            row.errors = RowErrors::UNKNOWN;
        }
        // More than fit are refused by the store: the weights then do not sum to the hemicubes'.
        row.hemicubes = u32::try_from(std::mem::take(&mut self.hemicubes)).unwrap_or(u32::MAX);
        row.rays = std::mem::take(&mut self.rays);
        self.area = 0.0;
        Some((row, std::mem::take(&mut self.whole_area), change))
    }
}
