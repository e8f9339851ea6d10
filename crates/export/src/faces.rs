//! The matrix as a solver counts it: rows of patches, or of patches added up over faces, objects or materials of the
//! scene's file, in the solver's order.
//!
//! Rows of faces with one patch each come from the store as they lie; otherwise the added-up matrix is in memory.

use crate::matrix::require_room;
use crate::{Error, Result, UnfitStep};
use hemicube_scene::InputPatch;
use hemicube_solve::analysis::zones::{GroupBy, Zone, zones};
use hemicube_store::Store;
use serde::Serialize;
use std::collections::HashMap;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// Row and column of no face: an occluder's.
const ABSENT: u32 = u32::MAX;

/// Rows and columns of a solver's matrix.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Grouping {
    /// Each patch.
    Patch,
    /// The patches of each face, object or material of the scene's file.
    #[serde(untagged)]
    By(GroupBy),
}

impl Grouping {
    /// The word for people: `face`.
    pub fn word(self) -> &'static str {
        match self {
            Self::Patch => "patch",
            Self::By(GroupBy::Face) => "face",
            Self::By(GroupBy::Object) => "object",
            Self::By(GroupBy::Material) => "material",
        }
    }
}

/// Row sums that a solver takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sums {
    /// Any.
    Free,
    /// Σ_j F_ij ≤ 1; the solver takes the rest for its surroundings.
    AtMostOne,
    /// Σ_j F_ij = 1.
    One,
}

/// Requirements of a solver.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Needs {
    /// Its faces, unless the caller says otherwise.
    pub grouping: Grouping,
    /// Its row sums.
    pub sums: Sums,
    /// True if A_i F_ij = A_j F_ji must hold.
    pub reciprocal: bool,
}

/// Sums, reciprocity and entries of a matrix.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Found {
    /// Least and greatest row sum.
    pub sums: [f64; 2],
    /// √(Σ (A_i F_ij − A_j F_ji)²) / √(Σ (A_i F_ij)²), estimated by [`PROBES`] random probes; `None` if it does not
    /// matter.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reciprocity: Option<f64>,
    /// Entries.
    pub entries: u64,
}

/// Largest distance of a row sum from 1 where it must be 1, and above 1 anywhere.
pub const SUM_ERROR: f64 = 1e-3;
/// Largest reciprocity residual of a matrix that must be reciprocal.
pub const RECIPROCITY_ERROR: f64 = 1e-3;
/// Probes of the reciprocity residual: of M = S − Sᵀ, E (uᵀ M v)² = ‖M‖² for vectors u, v of random signs.
pub const PROBES: usize = 16;

/// A face as a solver knows it.
#[derive(Clone, Debug)]
pub(crate) struct Face {
    pub(crate) name: String,
    pub(crate) area: f64,
    /// Index into the manifest's materials.
    pub(crate) material: u32,
    /// Share that leaves the scene.
    pub(crate) escaped: f64,
    /// Share that ends on backs of one-sided patches.
    pub(crate) blocked: f64,
    /// Its patch, or its zone.
    source: u32,
}

#[derive(Debug)]
enum Rows {
    Stored,
    Zones(Vec<Zone>),
}

/// The faces of a store, and their rows.
#[derive(Debug)]
pub(crate) struct Faces<'a> {
    pub(crate) store: &'a Store,
    /// The solver's name.
    pub(crate) program: &'static str,
    cancel: &'a AtomicBool,
    rows: Rows,
    /// In the order of the file to be written.
    pub(crate) faces: Vec<Face>,
    /// The place in `faces` of each patch or zone.
    place: Vec<u32>,
    pub(crate) grouping: Grouping,
}

impl<'a> Faces<'a> {
    /// The faces of a complete store, in the order of their first patches, or in `order`.
    pub(crate) fn new(
        store: &'a Store,
        program: &'static str,
        grouping: Grouping,
        order: Option<&[String]>,
        cancel: &'a AtomicBool,
    ) -> Result<Self> {
        store.require_complete()?;
        let mut found = match grouping {
            Grouping::Patch => Self::of_patches(store, program, cancel)?,
            Grouping::By(by) => Self::of_zones(store, program, by, cancel)?,
        };
        if let Some(order) = order {
            found.reorder(order)?;
        }
        for (place, face) in (0..).zip(&found.faces) {
            found.place[face.source as usize] = place;
        }
        Ok(found)
    }

    fn of_patches(store: &'a Store, program: &'static str, cancel: &'a AtomicBool) -> Result<Self> {
        let (table, shares) = (store.patches()?, store.row_table()?);
        let share = |of: &[f64], patch: usize| of.get(patch).copied().filter(|v| v.is_finite()).unwrap_or(0.0);
        let faces = (0..store.patch_count())
            .map(|source| {
                let patch = source as usize;
                Face {
                    name: source.to_string(),
                    area: table.area[patch],
                    material: table.material[patch],
                    escaped: share(&shares.escaped, patch),
                    blocked: share(&shares.blocked, patch),
                    source,
                }
            })
            .collect();
        Ok(Self {
            store,
            program,
            cancel,
            rows: Rows::Stored,
            faces,
            place: vec![ABSENT; store.patch_count() as usize],
            grouping: Grouping::Patch,
        })
    }

    fn of_zones(store: &'a Store, program: &'static str, by: GroupBy, cancel: &'a AtomicBool) -> Result<Self> {
        let computed = store.computed_patches()?;
        let mut has_row = vec![false; store.patch_count() as usize];
        for patch in computed {
            has_row[patch.0 as usize] = true;
        }
        if by == GroupBy::Face && is_one_patch_a_face(store)? {
            let mut found = Self::of_patches(store, program, cancel)?;
            let table = store.patches()?;
            found.faces.retain(|face| has_row[face.source as usize]);
            for face in &mut found.faces {
                let patch = face.source as usize;
                let back = if table.side[patch] == 0 { "" } else { " back" };
                face.name = format!("{}{back}", table.face[patch]);
            }
            found.grouping = Grouping::By(by);
            return Ok(found);
        }
        let zones = zones(store, by)?;
        let faces = (0..)
            .zip(&zones)
            .filter(|(_, zone)| zone.has_rows())
            .map(|(source, zone)| Face {
                name: zone.name.clone(),
                area: zone.area,
                material: zone.material,
                escaped: zone.escaped,
                blocked: zone.blocked,
                source,
            })
            .collect();
        let place = vec![ABSENT; zones.len()];
        Ok(Self {
            store,
            program,
            cancel,
            rows: Rows::Zones(zones),
            faces,
            place,
            grouping: Grouping::By(by),
        })
    }

    /// Puts the faces in the order of `names`, which has each once.
    fn reorder(&mut self, names: &[String]) -> Result<()> {
        let by_name: HashMap<&str, usize> = self.faces.iter().map(|face| face.name.as_str()).zip(0..).collect();
        let mut taken = vec![false; self.faces.len()];
        let mut order = Vec::with_capacity(names.len());
        let word = self.grouping.word();
        let next = format!(
            "name each {word} once, a line each, in the order of {}'s rows",
            self.program
        );
        for (line, name) in (1..).zip(names) {
            let place = by_name.get(name.as_str()).copied();
            match place.filter(|&place| !std::mem::replace(&mut taken[place], true)) {
                Some(place) => order.push(place),
                None => {
                    let reason = match place {
                        Some(_) => "comes a second time",
                        None => "is none of those with a row",
                    };
                    return Err(self.unfit(format!("line {line} of the order: {word} `{name}` {reason}"), next));
                }
            }
        }
        if let Some(missing) = taken.iter().position(|taken| !taken) {
            let name = &self.faces[missing].name;
            return Err(self.unfit(format!("the order lacks {word} `{name}`"), next));
        }
        self.faces = order.into_iter().map(|place| self.faces[place].clone()).collect();
        Ok(())
    }

    /// The number of faces.
    pub(crate) fn len(&self) -> usize {
        self.faces.len()
    }

    pub(crate) fn unfit(&self, reason: impl Into<String>, next: impl Into<UnfitStep>) -> Error {
        Error::Unfit {
            store: self.store.directory().to_owned(),
            program: self.program,
            reason: reason.into(),
            next: next.into(),
        }
    }

    /// The face for people: ``face `12` ``.
    pub(crate) fn named(&self, place: usize) -> String {
        format!("{} `{}`", self.grouping.word(), self.faces[place].name)
    }

    /// The row of a face: places of columns, ascending, and form factors above 0.
    pub(crate) fn row(&self, place: usize) -> Result<Vec<(u32, f64)>> {
        if self.cancel.load(Ordering::Relaxed) {
            return Err(Error::Interrupted {
                path: self.store.directory().to_owned(),
            });
        }
        let source = self.faces[place].source;
        let mut row: Vec<(u32, f64)> = match &self.rows {
            Rows::Stored => match self.store.row(InputPatch(source))? {
                Some(row) => row.indices.iter().copied().zip(&row.data).collect(),
                None => Vec::new(),
            },
            Rows::Zones(zones) => zones[source as usize].factors.clone(),
        };
        row.retain(|&(_, factor)| factor > 0.0);
        for (column, _) in &mut row {
            let to = self.place[*column as usize];
            if to == ABSENT {
                return Err(self.unfit(
                    format!("{} has a column of something without a row", self.named(place)),
                    UnfitStep::SameRowsAndColumns,
                ));
            }
            *column = to;
        }
        row.sort_unstable_by_key(|&(column, _)| column);
        Ok(row)
    }

    /// Looks whether the matrix has what is needed.
    pub(crate) fn check(&self, needs: Needs) -> Result<Found> {
        if self.faces.is_empty() {
            return Err(self.unfit("it has no rows", UnfitStep::Check));
        }
        let mut probe = needs.reciprocal.then(|| Probe::new(self.len()));
        let mut found = Found {
            sums: [f64::INFINITY, f64::NEG_INFINITY],
            reciprocity: None,
            entries: 0,
        };
        let (mut least, mut most) = (0, 0);
        for place in 0..self.len() {
            let row = self.row(place)?;
            // A sum of nothing is −0.
            let sum = 0.0 + row.iter().map(|&(_, factor)| factor).sum::<f64>();
            if sum < found.sums[0] {
                (found.sums[0], least) = (sum, place);
            }
            if sum > found.sums[1] {
                (found.sums[1], most) = (sum, place);
            }
            found.entries += row.len() as u64;
            if let Some(probe) = &mut probe {
                probe.add(place, self.faces[place].area, &row);
            }
        }
        found.reciprocity = probe.map(|probe| probe.residual());
        if needs.sums != Sums::Free && self.goes_through_mirrors() {
            return Err(self.unfit(
                "its rows are of what arrives through mirrors and panes, which hand on a part of it, and here rows of what \
                 stays are read",
                UnfitStep::WithoutMirrors,
            ));
        }
        if needs.sums != Sums::Free && found.sums[1] > 1.0 + SUM_ERROR {
            return Err(self.unfit(
                format!("{} sums to {:.6}, above 1", self.named(most), found.sums[1]),
                UnfitStep::Close,
            ));
        }
        if needs.sums == Sums::One && found.sums[0] < 1.0 - SUM_ERROR {
            return Err(self.not_closed(least, found.sums[0]));
        }
        if let Some(residual) = found.reciprocity
            && residual > RECIPROCITY_ERROR
        {
            return Err(self.unfit(
                format!("A[i] F[i, j] and A[j] F[j, i] differ by {residual:.1e} of their norm"),
                UnfitStep::Reciprocate,
            ));
        }
        Ok(found)
    }

    fn goes_through_mirrors(&self) -> bool {
        !self.store.manifest().settings["portals"]["specular"].is_null()
    }

    fn not_closed(&self, place: usize, sum: f64) -> Error {
        let face = &self.faces[place];
        let lost = face.escaped + face.blocked;
        let named = self.named(place);
        if lost > SUM_ERROR {
            return self.unfit(
                format!(
                    "{named} sums to {sum:.6}: {:.4} of what leaves it escapes and {:.4} ends on backs, and rows \
                     must sum to 1",
                    face.escaped, face.blocked
                ),
                UnfitStep::CloseScene,
            );
        }
        self.unfit(
            format!("{named} sums to {sum:.6}, and rows must sum to 1"),
            UnfitStep::Close,
        )
    }

    /// Refuses what the disk has no room for.
    pub(crate) fn require_room(&self, path: &Path, bytes: u64) -> Result<()> {
        let forecast = crate::formats::Forecast { bytes, least: bytes };
        require_room(path, &forecast)
    }
}

/// Returns whether every face has one patch, so that rows of faces are rows of the store.
fn is_one_patch_a_face(store: &Store) -> Result<bool> {
    let table = store.patches()?;
    let mut seen = std::collections::HashSet::new();
    Ok(table.face.iter().zip(&table.side).all(|face| seen.insert(face)))
}

/// An estimate of ‖S − Sᵀ‖ / ‖S‖ with S_ij = A_i F_ij, from one pass over the rows.
struct Probe {
    /// uᵀ S v − vᵀ S u of each pair of sign vectors.
    sums: [f64; PROBES],
    norm: f64,
    signs: Vec<u32>,
}

impl Probe {
    /// Signs from a fixed sequence (SplitMix64, Steele et al. 2014): equal matrices give equal estimates. Bits 0 to 15
    /// are u's, 16 to 31 v's.
    fn new(count: usize) -> Self {
        let mut state = 0x9e37_79b9_7f4a_7c15_u64;
        let signs = std::iter::repeat_with(|| {
            state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let mut z = state;
            z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            ((z ^ (z >> 31)) >> 32) as u32
        });
        Self {
            sums: [0.0; PROBES],
            norm: 0.0,
            signs: signs.take(count).collect(),
        }
    }

    fn add(&mut self, place: usize, area: f64, row: &[(u32, f64)]) {
        let sign = |bits: u32, bit: usize| if bits >> bit & 1 == 0 { 1.0 } else { -1.0 };
        let own = self.signs[place];
        for &(column, factor) in row {
            let (other, exchange) = (self.signs[column as usize], area * factor);
            self.norm += exchange * exchange;
            for (probe, sum) in self.sums.iter_mut().enumerate() {
                let (u, v) = (probe, probe + PROBES);
                *sum += exchange * (sign(own, u) * sign(other, v) - sign(own, v) * sign(other, u));
            }
        }
    }

    fn residual(&self) -> f64 {
        let square = self.sums.iter().map(|sum| sum * sum).sum::<f64>() / PROBES as f64;
        if self.norm > 0.0 {
            (square / self.norm).sqrt()
        } else {
            0.0
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn residual(matrix: &[Vec<f64>]) -> f64 {
        let mut probe = Probe::new(matrix.len());
        for (place, row) in matrix.iter().enumerate() {
            let row: Vec<(u32, f64)> = (0..).zip(row.iter().copied()).collect();
            probe.add(place, 2.0, &row);
        }
        probe.residual()
    }

    #[test]
    fn the_probe_finds_the_residual() {
        let count = 200;
        let value = |i: usize, j: usize| ((i * 31 + j * 17) % 23) as f64 / 23.0;
        let symmetric: Vec<Vec<f64>> = (0..count)
            .map(|i| (0..count).map(|j| value(i.min(j), i.max(j))).collect())
            .collect();
        assert!(residual(&symmetric) < 1e-12);
        let mut skew = symmetric.clone();
        let (mut error, mut norm) = (0.0, 0.0);
        for (i, row) in skew.iter_mut().enumerate() {
            for (j, entry) in row.iter_mut().enumerate() {
                if i < j {
                    *entry *= 1.05;
                    error += 2.0 * (0.05 * symmetric[i][j]).powi(2);
                }
                norm += *entry * *entry;
            }
        }
        let (found, wanted) = (residual(&skew), f64::sqrt(error / norm));
        assert!((found / wanted - 1.0).abs() < 0.5, "{found} of {wanted}");
    }
}
