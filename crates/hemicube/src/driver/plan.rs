//! Plans: the rows to compute, in the order of work, and the parts that they are written in.

use crate::accuracy::correct::Correction;
use crate::accuracy::grain::Grain;
use crate::backend::BackendInfo;
use crate::driver::update::Taken;
use crate::portal::Portals;
use crate::sampling::splitmix;
use crate::store::Form;
use crate::store::small_entries::Keeping;
use crate::{Grouping, Model};
use hemicube_scene::InputPatch;
use std::sync::Arc;

/// Elements that have rows and columns. All elements occlude, selected or not.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Selection {
    /// True for each patch that has a row; `None`: all have.
    pub emitters: Option<Vec<bool>>,
    /// True for each patch that has a column; `None`: all have. The share of the others is *unselected*.
    pub receivers: Option<Vec<bool>>,
}

impl Selection {
    pub(super) fn emits(&self, patch: InputPatch) -> bool {
        self.emitters.as_ref().is_none_or(|e| e[patch.0 as usize])
    }

    pub(super) fn receives(&self, patch: u32) -> bool {
        self.receivers.as_ref().is_none_or(|r| r[patch as usize])
    }
}

/// Rows of the matrix to compute.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RowChoice {
    /// The rows of all emitting patches.
    All,
    /// The rows of the input patches `start..end`.
    Range {
        /// The first input patch.
        start: u32,
        /// One past the last.
        end: u32,
    },
    /// A random sample, drawn without repetition.
    Sample {
        /// Number of rows; all rows if there are fewer.
        count: u32,
        /// Seed of the draw.
        seed: u64,
    },
}

/// Rows to compute, in the order of work, cut into parts.
///
/// ```
/// use hemicube::driver::compute::{Plan, RowChoice, Selection};
/// use hemicube::accuracy::correct::Correction;
/// # mod room { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/doc/room.rs")); }
/// # let model = room::model()?;
///
/// // All rows of the room's 160 patches, four hemicubes each, corrected for area.
/// let plan = Plan::new(&model, RowChoice::All, Selection::default(), 2, true);
/// assert_eq!((plan.rows.len(), plan.hemicubes_per_row(), plan.part_count()), (160, 4, 3));
///
/// // Ten rows of them: the same ten whenever the seed is the same.
/// let ten = |seed| Plan::new(&model, RowChoice::Sample { count: 10, seed }, Selection::default(), 1, true).rows;
/// assert_eq!(ten(1).len(), 10);
/// assert!(ten(1) == ten(1) && ten(1) != ten(2));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// The emitting element of each row, in the order of work; the elements of a patch stand together.
    pub rows: Vec<InputPatch>,
    /// The patches, where they are several elements; `None`: each element is a patch.
    pub groups: Option<Groups>,
    /// Rows of a part, of patches, at most 1024; the last part may have fewer.
    pub rows_per_part: u32,
    /// n of the n² hemicubes of a row.
    pub samples_per_edge: u32,
    /// True if each hemicube is turned about its normal.
    pub rotate: bool,
    /// Patches that have rows and columns.
    pub selection: Selection,
    /// The correction of weights into form factors.
    pub correction: Correction,
    /// Form factors below this are left out, and their sum is shared by the others of the row; 0: none is.
    pub min_factor: f64,
    /// The store's form, to which form factors are rounded.
    pub form: Form,
    /// Mirrors, panes, and images of the cell.
    pub portals: Arc<Portals>,
    /// Rows that are taken over from the matrix of an earlier state of the scene.
    pub taken: Option<Arc<Taken>>,
    /// The parts to compute, ascending; `None`: all. Parts do not depend on each other: leaving some out changes
    /// nothing in the others.
    pub parts: Option<Vec<u32>>,
}

/// Rows of patches that are several elements.
#[derive(Clone, Debug, PartialEq)]
pub struct Groups {
    /// The patch of each element.
    pub grouping: Arc<Grouping>,
    /// The patch of each row, in the order of work.
    pub patches: Vec<InputPatch>,
    /// Place of each row's first element in [`Plan::rows`], and the number of elements.
    starts: Vec<usize>,
}

impl Groups {
    /// The rows of `choice`, of patches, in the order of their first elements in `order`. Returns the elements, in
    /// their order within each patch, as well.
    fn new(grouping: Arc<Grouping>, choice: RowChoice, order: &[InputPatch]) -> (Self, Vec<InputPatch>) {
        let mut place = vec![u32::MAX; grouping.len()];
        let mut patches = Vec::new();
        for &element in order {
            let patch = grouping.patch_of(element);
            if std::mem::replace(&mut place[patch.0 as usize], 0) == u32::MAX {
                patches.push(patch);
            }
        }
        choice.keep(&mut patches);
        place.fill(u32::MAX);
        for (row, patch) in (0..).zip(&patches) {
            place[patch.0 as usize] = row;
        }
        // Sorted by counting: the order of work stays within a patch.
        let mut starts = vec![0; patches.len() + 1];
        let row_of = |element: InputPatch| place[grouping.patch_of(element).0 as usize];
        for &element in order {
            if let Some(end) = starts.get_mut(row_of(element) as usize + 1) {
                *end += 1;
            }
        }
        for row in 0..patches.len() {
            starts[row + 1] += starts[row];
        }
        let mut next = starts.clone();
        let mut rows = vec![InputPatch(0); starts[patches.len()]];
        for &element in order {
            let row = row_of(element) as usize;
            if row < patches.len() {
                rows[next[row]] = element;
                next[row] += 1;
            }
        }
        let groups = Self {
            grouping,
            patches,
            starts,
        };
        (groups, rows)
    }
}

impl RowChoice {
    /// Keeps the rows chosen.
    fn keep(self, rows: &mut Vec<InputPatch>) {
        match self {
            Self::All => {}
            Self::Range { start, end } => rows.retain(|p| (start..end).contains(&p.0)),
            Self::Sample { count, seed } => *rows = sample(rows, count as usize, seed),
        }
    }
}

impl Plan {
    /// Returns whether a backend draws the larger passes through mirrors and panes of this plan.
    pub fn draws_passes(&self, backend: &BackendInfo) -> bool {
        let follows_pixels = self.correction == Correction::Pixel;
        backend.capabilities.passes && follows_pixels && self.portals.specular.is_some()
    }

    /// The version of the arithmetic of this plan's rows: a backend's own, and where it draws passes, that it does.
    pub(crate) fn arithmetic(&self, backend: &BackendInfo) -> String {
        let passes = if self.draws_passes(backend) { "+passes" } else { "" };
        format!("{}{passes}", backend.version)
    }

    /// Plans the rows of `choice`, by the scene and the settings only.
    pub fn new(model: &Model, choice: RowChoice, selection: Selection, samples_per_edge: u32, rotate: bool) -> Self {
        Self::grouped(model, choice, selection, samples_per_edge, rotate, None)
    }

    /// [`Self::new`] for rows of the patches of `grouping`: `choice` is among patches, and each has all of its selected
    /// elements.
    pub fn grouped(
        model: &Model,
        choice: RowChoice,
        selection: Selection,
        samples_per_edge: u32,
        rotate: bool,
        grouping: Option<Arc<Grouping>>,
    ) -> Self {
        let mut rows: Vec<InputPatch> = model.order().filter(|&p| selection.emits(p)).collect();
        let groups = if let Some(grouping) = grouping {
            let (groups, elements) = Groups::new(grouping, choice, &rows);
            rows = elements;
            Some(groups)
        } else {
            choice.keep(&mut rows);
            None
        };
        Self {
            rows_per_part: match &groups {
                // A part may have many elements: a killed run loses no more than one of some dozens.
                Some(groups) => Self::rows_per_part_of(groups.patches.len()).min(least_of(groups.patches.len())),
                None => Self::rows_per_part_of(rows.len()),
            },
            rows,
            groups,
            samples_per_edge,
            rotate,
            selection,
            correction: Correction::Pixel,
            min_factor: 0.0,
            form: Form::Plain,
            portals: Arc::default(),
            taken: None,
            parts: None,
        }
    }

    /// Rows of a part in a plan of `rows` rows: rows / 64 as a power of two, from 64 to 1024.
    #[allow(clippy::cast_possible_truncation, reason = "clamped to 1024")]
    pub fn rows_per_part_of(rows: usize) -> u32 {
        // A killed run loses a part, and a job of a cluster computes some: at most a few seconds and megabytes, and
        // some dozens of them even in a small scene.
        (rows / 64).next_power_of_two().clamp(64, 1024) as u32
    }

    /// The plan for the parts that `wanted` is true of: the missing parts of a store, or a shard.
    #[must_use]
    pub fn with_parts(mut self, wanted: impl Fn(u32) -> bool) -> Self {
        let count = u32::try_from(self.part_count()).unwrap_or(u32::MAX);
        self.parts = Some((0..count).filter(|&part| wanted(part)).collect());
        self
    }

    /// The plan with another correction. A tolerance takes one hemicube a row.
    #[must_use]
    pub fn with_correction(mut self, correction: Correction) -> Self {
        if let Correction::Tolerance(_) = correction {
            self.samples_per_edge = 1;
        }
        self.correction = correction;
        self
    }

    /// The plan without form factors below `min_factor`, from 0 up to 1. The others of their row share their sum in
    /// proportion, as by [`balance`](crate::analysis::balance::balance) afterwards; the effect is in
    /// [`Summary::thinning`](super::compute::Summary::thinning).
    #[must_use]
    pub fn with_min_factor(mut self, min_factor: f64) -> Self {
        self.min_factor = min_factor;
        self
    }

    /// The plan for a store of another form, whose rounding rows then have.
    #[must_use]
    pub fn with_form(mut self, form: Form) -> Self {
        self.form = form;
        self
    }

    /// The plan with portals. Where they have images of a cell, rows and columns chosen are those of the model with
    /// images.
    #[must_use]
    pub fn with_portals(mut self, portals: Arc<Portals>) -> Self {
        self.portals = portals;
        self
    }

    /// By column of the matrix, whether it is a mirror or a pane; empty without any.
    pub(crate) fn portal_columns(&self) -> Vec<bool> {
        let Some(specular) = &self.portals.specular else {
            return Vec::new();
        };
        let grouping = self.groups.as_ref().map(|groups| groups.grouping.as_ref());
        let mut columns = vec![false; grouping.map_or(specular.patch_count(), Grouping::len)];
        for element in specular.portals() {
            let patch = grouping.map_or(element, |grouping| grouping.patch_of(InputPatch(element)).0);
            if let Some(is_portal) = columns.get_mut(patch as usize) {
                *is_portal = true;
            }
        }
        columns
    }

    /// The rule by which entries are stored; `portals` as by [`Self::portal_columns`].
    pub(crate) fn keeping<'p>(&self, portals: &'p [bool]) -> Keeping<'p> {
        Keeping {
            min_factor: self.min_factor,
            form: self.form,
            portals,
        }
    }

    /// n of the n² hemicubes of a patch: as planned, or more for a patch much larger than the surfaces on it. Pixel
    /// sums are the method as published, and keep to the plan.
    pub(super) fn per_edge(&self, model: &Model, patch: InputPatch) -> u32 {
        match self.correction {
            Correction::Pixel => self.samples_per_edge,
            _ => Grain::of(model.geometry())
                .per_edge(model, patch)
                .max(self.samples_per_edge),
        }
    }

    /// Hemicubes of a row, n²; a patch much larger than the surfaces on it has more.
    pub fn hemicubes_per_row(&self) -> usize {
        self.samples_per_edge as usize * self.samples_per_edge as usize
    }

    /// Number of rows: of patches.
    pub fn row_count(&self) -> usize {
        self.groups
            .as_ref()
            .map_or(self.rows.len(), |groups| groups.patches.len())
    }

    /// Number of parts.
    pub fn part_count(&self) -> usize {
        self.row_count().div_ceil(self.rows_per_part as usize)
    }

    /// Places of a part's rows, of patches; empty beyond the last part.
    fn patches_of_part(&self, part: u32) -> std::ops::Range<usize> {
        let start = (part as usize * self.rows_per_part as usize).min(self.row_count());
        start..(start + self.rows_per_part as usize).min(self.row_count())
    }

    /// Places of a part's elements in [`Self::rows`]; empty beyond the last part.
    pub(super) fn rows_of_part(&self, part: u32) -> std::ops::Range<usize> {
        let rows = self.patches_of_part(part);
        match &self.groups {
            Some(groups) => groups.starts[rows.start]..groups.starts[rows.end],
            None => rows,
        }
    }

    /// Number of rows of the parts to compute, of patches.
    pub fn wanted_rows(&self) -> u64 {
        let rows = |&part: &u32| self.patches_of_part(part).len() as u64;
        self.wanted().iter().map(rows).sum()
    }

    /// Number of elements with rows in some parts.
    pub fn elements_of(&self, parts: impl IntoIterator<Item = u32>) -> u64 {
        parts.into_iter().map(|part| self.rows_of_part(part).len() as u64).sum()
    }

    /// The parts to compute, ascending.
    pub fn wanted(&self) -> Vec<u32> {
        let count = u32::try_from(self.part_count()).unwrap_or(u32::MAX);
        match &self.parts {
            Some(parts) => parts.iter().copied().filter(|&part| part < count).collect(),
            None => (0..count).collect(),
        }
    }
}

/// A power of two from 1 on, near rows / 64.
fn least_of(rows: usize) -> u32 {
    u32::try_from((rows / 64).next_power_of_two()).unwrap_or(u32::MAX)
}

/// Draws `count` of `rows`, keeping their order (Knuth 1969, algorithm 3.4.2 S).
pub(crate) fn sample(rows: &[InputPatch], count: usize, seed: u64) -> Vec<InputPatch> {
    let mut state = seed;
    let mut chosen = Vec::with_capacity(count.min(rows.len()));
    for (i, &row) in rows.iter().enumerate() {
        let z = splitmix::next(&mut state);
        let (left, wanted) = ((rows.len() - i) as u128, count.saturating_sub(chosen.len()) as u128);
        if (u128::from(z) * left) >> 64 < wanted {
            chosen.push(row);
        }
    }
    chosen
}
