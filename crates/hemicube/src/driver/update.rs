//! Rows that a matrix takes over from that of an earlier state of its scene.
//!
//! A row depends on what its patch sees. Where surfaces were added, taken away or moved, a patch that can see none of
//! them, neither as they were nor as they are, has the row that it had. Only what stands still may hide them, so one
//! search serves both states (`visibility::screen`). Patches that stand still have the same corners, to the bit.
//!
//! The other rows are computed at the price that was found for the earlier matrix, and with its random numbers. So what
//! did not change differs by nothing, or by rounding, and the difference of the two matrices is that of the scenes.

use crate::Model;
use crate::accuracy::correct::Refinement;
use crate::driver::compute::Execution;
use crate::driver::settings::RowSettings;
use crate::store::{Error as StoreError, FinishedRow, Header, PROGRAM, Part, PatchTable, Store};
use crate::visibility::screen::{Screen, Search};
use crate::{HierarchyOptions, InputPatch};
use glam::DVec3;
use hemicube_scene::{Patches, Scene, Subdivision, Triangle};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// Why no row can be taken over from a matrix.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum UpdateError {
    /// It is of no kind that rows are taken over from.
    #[error("rows cannot be taken over from `{}`: {reason}", directory.display())]
    Unsuitable {
        /// The matrix.
        directory: PathBuf,
        /// Why not, and the next step.
        reason: String,
    },
    /// It cannot be read.
    #[error(transparent)]
    Store(#[from] StoreError),
}

/// The matrix of an earlier state of a scene, and the patches that the two have in common.
#[derive(Debug)]
pub struct Update {
    store: Store,
    /// By patch of the new scene: its number in the earlier one.
    earlier: Vec<Option<u32>>,
    /// By patch of the earlier scene: its number in the new one.
    later: Vec<Option<u32>>,
    /// The numbers that the new scene's patches are drawn by.
    numbers: Vec<u32>,
    /// Triangles that were taken away, once each.
    removed: Vec<[DVec3; 3]>,
    /// Place of each earlier patch's row: its part among those present, and its row there.
    places: Vec<Option<(u32, u32)>>,
    /// The parts read last.
    read: Mutex<Vec<(u32, Arc<Part>)>>,
}

/// Parts that are kept for the next rows. Rows come in the order of work, which is about that of the earlier matrix.
const PARTS_KEPT: usize = 8;

/// Patches that are searched from one after the other, whatever the threads.
const CHUNK: usize = 64;

/// Settings that two states of a scene may differ in: those of its triangles, which are compared themselves, of the rows,
/// and what was found.
const FREE: [&str; 14] = [
    "subdivision",
    "two_sided",
    "flip",
    "exclude",
    "keep_duplicates",
    "scale",
    "up",
    "rows",
    "emitters",
    "elements",
    "reading",
    "reason",
    "price",
    "update",
];

impl PartialEq for Update {
    fn eq(&self, other: &Self) -> bool {
        self.id() == other.id()
    }
}

impl Update {
    /// Opens the matrix of an earlier state of the scene of `patches`.
    ///
    /// # Errors
    /// When it is no complete matrix of triangles by this version of the program, or has mirrors, panes, symmetry or
    /// chosen columns.
    pub fn open(directory: &Path, patches: &Patches) -> Result<Self, UpdateError> {
        let store = Store::open(directory)?;
        store.require_complete()?;
        let refused = |reason: String| UpdateError::Unsuitable {
            directory: directory.to_owned(),
            reason,
        };
        let manifest = store.manifest();
        if manifest.program != PROGRAM {
            return Err(refused(format!(
                "it was computed by version {}, and this is {PROGRAM}; compute it again",
                manifest.program
            )));
        }
        if !manifest.patch_kind().is_triangle() {
            return Err(refused(
                "its patches are several triangles each; give a matrix of triangles".to_owned(),
            ));
        }
        if manifest.balance.is_some() {
            return Err(refused("it was balanced; give the matrix that was balanced".to_owned()));
        }
        if manifest.has_portals() {
            return Err(refused("it has mirrors, panes, symmetry or periods".to_owned()));
        }
        for list in ["receivers", "occluders"] {
            let chosen = manifest.settings.get(list).and_then(|globs| globs.as_array());
            if chosen.is_some_and(|globs| !globs.is_empty()) {
                return Err(refused(format!("it has columns of some patches only, by its {list}")));
            }
        }
        let table = store.patches()?;
        if table.corners.is_empty() {
            return Err(refused(
                "it does not have the corners of its patches; compute it again".to_owned(),
            ));
        }
        let mut places = vec![None; table.len()];
        let parts = (0u32..).zip(&manifest.parts);
        let rows = parts.flat_map(|(place, part)| (0..part.rows).map(move |row| (place, row)));
        for (patch, place) in store.processing_order()?.into_iter().zip(rows) {
            places[patch.0 as usize] = Some(place);
        }
        let (earlier, later) = in_common(&table, patches);
        if earlier.iter().all(Option::is_none) {
            return Err(refused(
                "none of its patches is where one of this scene is, to the last digit; cut both in the same way, and \
                 leave coordinates as they are"
                    .to_owned(),
            ));
        }
        let number = |patch: u32| table.drawn_by.get(patch as usize).copied().unwrap_or(patch);
        let mut next = (0..manifest.patch_count)
            .map(|patch| number(patch).wrapping_add(1))
            .max()
            .unwrap_or(0);
        let mut numbers = Vec::with_capacity(earlier.len());
        for patch in &earlier {
            numbers.push(patch.map_or(next, number));
            next = next.wrapping_add(u32::from(patch.is_none()));
        }
        let removed = (0..).zip(&later).filter(|(_, later)| later.is_none());
        let removed = removed
            .map(|(patch, _): (usize, _)| table.corners[patch].map(DVec3::from_array))
            .collect();
        Ok(Self {
            store,
            earlier,
            later,
            numbers,
            removed,
            places,
            read: Mutex::default(),
        })
    }

    /// The earlier matrix, as manifests name it.
    pub(crate) fn id(&self) -> String {
        self.store.manifest().run()
    }

    /// Name and version of the backend of the earlier matrix.
    pub fn backend(&self) -> [&str; 2] {
        let backend = &self.store.manifest().backend;
        [&backend.name, &backend.version]
    }

    /// The new scene's model with the random numbers of the earlier matrix.
    #[must_use]
    pub fn number(&self, model: Model) -> Model {
        model.drawn_by(self.numbers.clone())
    }

    /// Number of patches that were taken away, and that were added.
    pub fn changed(&self) -> [u64; 2] {
        [&self.later, &self.earlier].map(|of| of.iter().filter(|other| other.is_none()).count() as u64)
    }

    /// The refinement for a tolerance at the price of the earlier matrix.
    ///
    /// # Errors
    /// When it has none, as one that was computed without a tolerance, or one that is damaged.
    pub(crate) fn refinement(&self, tolerance: f64) -> Result<Refinement, UpdateError> {
        let price = self
            .store
            .manifest()
            .settings
            .get("price")
            .and_then(|price| price.as_str());
        let refinement = price.and_then(|price| Refinement::of_price(tolerance, price));
        refinement.ok_or_else(|| UpdateError::Unsuitable {
            directory: self.store.directory().to_owned(),
            reason: "it was computed without a tolerance; ask for what it was computed with".to_owned(),
        })
    }

    /// Refuses other settings than those of the earlier matrix.
    ///
    /// # Errors
    /// [`UpdateError::Unsuitable`], which names the first setting that differs.
    pub(crate) fn require_same(&self, settings: &RowSettings, header: &Header) -> Result<(), UpdateError> {
        let manifest = self.store.manifest();
        let refused = |what: &str, earlier: &dyn std::fmt::Display, now: &dyn std::fmt::Display| {
            Err(UpdateError::Unsuitable {
                directory: self.store.directory().to_owned(),
                reason: format!("its `{what}` is {earlier}, and {now} is asked for here; ask for the same"),
            })
        };
        let is_plain = |value: &serde_json::Value| !value.is_object() && !value.is_array() && !value.is_null();
        let now = serde_json::to_value(settings).unwrap_or_default();
        let keys = |value: &serde_json::Value| -> Vec<String> {
            value
                .as_object()
                .map_or_else(Vec::new, |map| map.keys().cloned().collect())
        };
        let mut names = keys(&now);
        names.extend(keys(&manifest.settings));
        let none = serde_json::Value::Null;
        for name in names.iter().filter(|name| !FREE.contains(&name.as_str())) {
            let [earlier, now] = [&manifest.settings, &now].map(|of| of.get(name).unwrap_or(&none));
            if earlier != now && is_plain(earlier) && is_plain(now) {
                return refused(name, earlier, now);
            }
            if earlier != now {
                return Err(UpdateError::Unsuitable {
                    directory: self.store.directory().to_owned(),
                    reason: format!("its `{name}` differs from what is asked for here; ask for the same"),
                });
            }
        }
        if manifest.form != header.form {
            return refused("form", &manifest.form.name(), &header.form.name());
        }
        if manifest.min_factor != header.min_factor {
            return refused("min_factor", &manifest.min_factor, &header.min_factor);
        }
        if manifest.backend != header.backend {
            let name = |of: &crate::store::BackendEntry| format!("{} {}", of.name, of.version);
            return refused("backend", &name(&manifest.backend), &name(&header.backend));
        }
        Ok(())
    }

    /// Finds the rows to take over, of the new scene's model. Threads do not change them.
    ///
    /// O(patches · changed triangles), at most 64 of these, or the faces of 8 boxes.
    pub(crate) fn taken(self: Arc<Self>, model: &Model, execution: Execution<'_>) -> Taken {
        let is_taken = self.untouched(model, execution);
        let count = is_taken.iter().filter(|&&is_taken| is_taken).count() as u64;
        Taken {
            update: self,
            is_taken,
            count,
        }
    }

    /// By patch, whether it stands still, has an earlier row, and sees nothing of what changed.
    fn untouched(&self, model: &Model, execution: Execution<'_>) -> Vec<bool> {
        let patches = model.patches();
        let has_row = |patch: InputPatch| {
            let earlier = self.earlier[patch.0 as usize];
            earlier.is_some_and(|earlier| self.places[earlier as usize].is_some())
        };
        let stands = |patch: &InputPatch| self.earlier[patch.0 as usize].is_some();
        let mut changed = self.removed.clone();
        changed.extend(
            patches
                .iter()
                .filter(|patch| !stands(patch))
                .map(|patch| patches.corners(patch)),
        );
        if changed.is_empty() {
            return patches.iter().map(has_row).collect();
        }
        let still = of_triangles(patches.iter().filter(stands).map(|patch| patches.corners(patch)));
        let Some(screen) = still.map(Screen::of) else {
            return vec![false; patches.len()];
        };
        let targets = screen.targets(once_each(changed));
        let threads = match execution.threads {
            0 => std::thread::available_parallelism().map_or(1, usize::from),
            threads => threads,
        };
        let mut found = vec![false; patches.len()];
        let chunks = Mutex::new((0..patches.len()).step_by(CHUNK).zip(found.chunks_mut(CHUNK)));
        let look = || {
            while !execution.is_cancelled() {
                let next = chunks.lock().unwrap_or_else(PoisonError::into_inner).next();
                let Some((start, found)) = next else { break };
                let mut search = Search::default();
                for (patch, found) in (start..).zip(found) {
                    let patch = InputPatch(u32::try_from(patch).unwrap_or(u32::MAX));
                    *found = has_row(patch) && screen.hides_all(patches.corners(patch), &targets, &mut search);
                }
            }
        };
        std::thread::scope(|scope| {
            for _ in 1..threads {
                scope.spawn(look);
            }
            look();
        });
        found
    }

    /// A part, by its place.
    fn part(&self, place: u32) -> Result<Arc<Part>, StoreError> {
        let kept = || self.read.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, part)) = kept().iter().find(|(of, _)| *of == place) {
            return Ok(Arc::clone(part));
        }
        let part = self.store.part(place as usize)?.ok_or_else(|| {
            StoreError::unsupported(self.store.directory(), "lost a part while it was read".to_owned())
        })?;
        let part = Arc::new(part);
        let mut kept = kept();
        if kept.len() >= PARTS_KEPT {
            kept.remove(0);
        }
        kept.push((place, Arc::clone(&part)));
        Ok(part)
    }
}

/// Rows that a run takes over.
#[derive(Debug)]
pub struct Taken {
    update: Arc<Update>,
    /// By patch.
    is_taken: Vec<bool>,
    /// Number of rows to take over.
    pub count: u64,
}

impl PartialEq for Taken {
    fn eq(&self, other: &Self) -> bool {
        self.update == other.update && self.is_taken == other.is_taken
    }
}

impl Taken {
    /// The numbers that the scene's patches are drawn by.
    pub fn numbers(&self) -> &[u32] {
        &self.update.numbers
    }

    /// Returns whether rows are taken over from the matrix in a directory, by whatever name.
    pub(crate) fn is_from(&self, directory: &Path) -> bool {
        let own = self.update.store.directory();
        match (own.canonicalize(), directory.canonicalize()) {
            (Ok(own), Ok(other)) => own == other,
            _ => own == directory,
        }
    }

    /// Returns whether the row of a patch is taken over.
    pub fn is_taken(&self, patch: InputPatch) -> bool {
        self.is_taken[patch.0 as usize]
    }

    /// The row of a patch with the columns of the new scene. `None` where it has to be computed: it is not taken over,
    /// or has an entry for a patch that is gone.
    pub(crate) fn row(&self, patch: InputPatch) -> Result<Option<FinishedRow>, StoreError> {
        let update = &*self.update;
        let earlier = update.earlier[patch.0 as usize].filter(|_| self.is_taken(patch));
        let Some((place, at)) = earlier.and_then(|earlier| update.places[earlier as usize]) else {
            return Ok(None);
        };
        let (part, at) = (update.part(place)?, at as usize);
        let (columns, factors) = part.row(at);
        let later = |column: &i32| update.later[column.cast_unsigned() as usize];
        let Some(columns) = columns.iter().map(later).collect::<Option<Vec<u32>>>() else {
            return Ok(None);
        };
        let mut entries: Vec<(u32, f64)> = columns.into_iter().zip(factors).collect();
        entries.sort_unstable_by_key(|&(column, _)| column);
        let mut row = FinishedRow::new(patch.0, update.store.manifest().form.precision());
        for (column, factor) in entries {
            row.push(column, factor);
        }
        row.sums = part.sums[at];
        row.shares = part.shares[at];
        row.hemicubes = part.hemicubes[at];
        row.errors = part.errors[at];
        row.rays = part.rays[at].into();
        Ok(Some(row))
    }
}

/// By patch of `patches`, its number in `table`, and the other way round: patches with the same corners to the bit.
fn in_common(table: &PatchTable, patches: &Patches) -> (Vec<Option<u32>>, Vec<Option<u32>>) {
    let corners = |patch| patches.corners(patch).map(|corner| corner.to_array());
    let earlier = table.partners(patches.iter().map(corners));
    let mut later = vec![None; table.len()];
    for (patch, earlier) in (0..).zip(&earlier) {
        if let Some(earlier) = earlier {
            later[*earlier as usize] = Some(patch);
        }
    }
    (earlier, later)
}

/// Triangles without those that lie exactly on others, however they are turned: backs of two-sided ones.
fn once_each(mut triangles: Vec<[DVec3; 3]>) -> Vec<[DVec3; 3]> {
    let key = |triangle: &[DVec3; 3]| {
        let mut corners = triangle.map(|corner| corner.to_array().map(f64::to_bits));
        corners.sort_unstable();
        corners
    };
    triangles.sort_unstable_by_key(key);
    triangles.dedup_by_key(|triangle| key(triangle));
    triangles
}

/// A model of triangles; `None` where there can be none of them.
fn of_triangles(triangles: impl Iterator<Item = [DVec3; 3]>) -> Option<Model> {
    let triangle = |corners: [DVec3; 3]| Triangle {
        corners,
        object: 0,
        material: 0,
        face: 0,
        two_sided: false,
    };
    let scene = Scene {
        triangles: once_each(triangles.collect()).into_iter().map(triangle).collect(),
        ..Scene::default()
    };
    let patches = Patches::new(&scene, Subdivision::None).ok()?;
    Model::new(patches.into(), HierarchyOptions::default()).ok()
}
