//! Reference rows through mirrors, panes and images of a cell: rays go through portals as they meet them.
//!
//! Direct form factors are those of any reference. Further arrivals are counted by walks over the hemisphere: at a
//! portal a walk is reflected with the probability ρs, goes through with τ, and otherwise ends. The mean number of its
//! arrivals at a patch after the first portal is what the row has beyond F:
//!
//! ```text
//! F^s_ij − F_ij = E[n_j]        squared error (E[n_j²] − E[n_j]²) / walks        passed = Σ E[goes on]
//! ```
//!
//! No closed form, no motion, no window and no splitting of weights is taken: nothing of what it judges but the optics.

use super::hemisphere::directions;
use super::visibility::{Met, Sight};
use super::{Reference, ReferenceRow};
use crate::portal::specular::Laws;
use crate::portal::{Images, Optics, Portals};
use crate::reference::random::Random;
use glam::DVec3;
use hemicube_scene::InputPatch;
use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

/// Portals of a walk, at most.
const PASSES_MAX: u32 = 10_000;
/// Part of the squared error aimed at for arrivals through portals.
const SHARE: f64 = 0.5;

/// Share of a sensor's ray at which its branches end.
const LEAST: f64 = 1e-5;

/// An end of a sensor's ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum SightEnd {
    /// A patch of the cell, which hands on a share of the ray.
    Patch {
        /// The patch.
        patch: u32,
        /// The share handed on.
        passed: f64,
    },
    /// It leaves the scene in this direction.
    Nothing(DVec3),
    /// The back of a one-sided patch.
    Back,
    /// It is followed no further, or goes beyond the last image of a cell.
    CutOff,
}

/// Portals of a scene's reference.
#[derive(Clone, Debug)]
pub(super) struct Through {
    portals: Arc<Portals>,
    laws: Laws,
}

/// Arrivals at a patch: their sum over walks, and that of their squares by walk.
#[derive(Clone, Copy, Debug, Default)]
struct Arrivals {
    sum: u64,
    squares: u64,
}

/// Ends of walks after their first portal.
#[derive(Clone, Copy, Debug, Default)]
struct Ends {
    escaped: u64,
    blocked: u64,
    cut_off: u64,
    passed: u64,
}

impl<'m> Reference<'m> {
    /// The reference of rows through `portals`. Where they have images of a cell, the model is of all of them, rows and
    /// columns are the cell's.
    #[must_use]
    pub fn with_portals(mut self, portals: &Arc<Portals>) -> Self {
        let count = self.model.geometry().patch_count;
        let specular = portals.specular.as_ref();
        self.through = (!portals.is_empty()).then(|| Through {
            laws: specular.map_or_else(Laws::default, |specular| specular.laws(portals.images.as_ref(), count)),
            portals: Arc::clone(portals),
        });
        self
    }

    /// All ends of a ray from a free point, in normalised coordinates, and the shares of its weight that come there: a
    /// patch has what arrives, and `passed` what it hands on. Branches end where no more than [`LEAST`] is left.
    pub(super) fn ends(&self, from: DVec3, direction: DVec3, mut act: impl FnMut(SightEnd, f64)) {
        let images = self
            .through
            .as_ref()
            .and_then(|through| through.portals.images.as_ref());
        let laws = self.through.as_ref().map(|through| &through.laws);
        let mut branches = vec![(Sight::free(from, direction), from, direction, 1.0, 0)];
        while let Some((sight, from, towards, share, passes)) = branches.pop() {
            let model_patch = match self.occluders.first(&sight, from, towards) {
                Met::Nothing => {
                    act(SightEnd::Nothing(towards), share);
                    continue;
                }
                Met::Back => {
                    act(SightEnd::Back, share);
                    continue;
                }
                Met::Patch(patch) => patch,
            };
            let Some(patch) = images.map_or(Some(model_patch), |images| images.fold(model_patch)) else {
                act(SightEnd::CutOff, share);
                continue;
            };
            let across = Sight::new(self.model, InputPatch(model_patch)).map(|met| (met.normal.dot(towards), met));
            let optics = match (&across, laws) {
                (Some((across, _)), Some(laws)) => laws.at(model_patch, *across),
                _ => Optics::default(),
            };
            let passed = share * optics.passed();
            act(SightEnd::Patch { patch, passed }, share);
            let Some((across, met)) = across.filter(|_| passed > 0.0) else {
                continue;
            };
            let at = from + towards * (met.height(from) / -across);
            let reflected = (towards - met.normal * (2.0 * across)).normalize();
            for (part, towards, normal) in [
                (optics.specular, reflected, met.normal),
                (optics.transmittance, towards, -met.normal),
            ] {
                let left = share * part;
                if left > LEAST && passes < PASSES_MAX {
                    branches.push((Sight::free(at, normal), at, towards, left, passes + 1));
                } else if left > 0.0 {
                    act(SightEnd::CutOff, left);
                }
            }
        }
    }

    /// Adds what arrives through portals to a finished row.
    pub(super) fn extend(&self, emitter: &Sight, row: &mut ReferenceRow) {
        let Some(through) = &self.through else { return };
        if through.portals.specular.is_some() {
            let is_portal = |patch: &u32| through.laws.means.get(*patch as usize).is_some_and(|o| o.is_portal());
            if row.columns.iter().any(is_portal) {
                self.walk(emitter, &through.laws, row);
            }
        }
        if let Some(images) = &through.portals.images {
            fold(row, images);
        }
    }

    /// Walks until the squared error of what they find is small, or as many rays were traced as a row may have.
    fn walk(&self, emitter: &Sight, laws: &Laws, row: &mut ReferenceRow) {
        let mut found: BTreeMap<u32, Arrivals> = BTreeMap::new();
        let mut ends = Ends::default();
        let (mut walks, mut rays) = (0u64, 0u64);
        let mut of_walk: HashMap<u32, u64> = HashMap::new();
        let mut round = 0;
        loop {
            directions(
                emitter,
                [self.settings.seed, u64::MAX - 1, round],
                |origin, direction| {
                    walks += 1;
                    let mut random = Random::of(&[self.settings.seed, u64::from(emitter.patch), walks, 0xB07]);
                    of_walk.clear();
                    let mut sight = emitter.clone();
                    let (mut from, mut towards) = (origin, direction);
                    for passes in 0..=PASSES_MAX {
                        rays += 1;
                        let patch = match self.occluders.first(&sight, from, towards) {
                            Met::Nothing => {
                                ends.escaped += u64::from(passes > 0);
                                break;
                            }
                            Met::Back => {
                                ends.blocked += u64::from(passes > 0);
                                break;
                            }
                            Met::Patch(patch) => patch,
                        };
                        if passes > 0 {
                            *of_walk.entry(patch).or_default() += 1;
                        }
                        let Some(met) = Sight::new(self.model, InputPatch(patch)) else {
                            break;
                        };
                        let across = met.normal.dot(towards);
                        let optics = laws.at(patch, across);
                        let choice = random.unit();
                        let is_mirrored = choice < optics.specular;
                        if !is_mirrored && choice >= optics.passed() {
                            break;
                        }
                        ends.passed += 1;
                        if passes == PASSES_MAX {
                            ends.cut_off += 1;
                            break;
                        }
                        from += towards * (met.height(from) / -across);
                        if is_mirrored {
                            towards = (towards - met.normal * (2.0 * across)).normalize();
                            sight = Sight::free(from, met.normal);
                        } else {
                            sight = Sight::free(from, -met.normal);
                        }
                    }
                    for (&patch, &count) in &of_walk {
                        let arrivals = found.entry(patch).or_default();
                        arrivals.sum += count;
                        arrivals.squares += count * count;
                    }
                },
            );
            round += 1;
            let whole = walks as f64;
            let variance = |arrivals: &Arrivals| {
                let mean = arrivals.sum as f64 / whole;
                (arrivals.squares as f64 / whole - mean * mean).max(0.0) / whole
            };
            let norm = row.squared_norm() + found.values().map(|a| (a.sum as f64 / whole).powi(2)).sum::<f64>();
            let error: f64 = found.values().map(variance).sum();
            let is_done = error <= SHARE * self.settings.target.powi(2) * norm;
            if is_done || rays >= self.settings.max_rays {
                break;
            }
        }
        row.rays += rays;
        ends.add_to(row, walks);
        add_arrivals(found, walks, row);
    }
}

impl Ends {
    /// Adds the shares of `walks` to a row.
    fn add_to(&self, row: &mut ReferenceRow, walks: u64) {
        let whole = walks as f64;
        let share = |count: u64| count as f64 / whole;
        row.escaped += share(self.escaped);
        row.blocked += share(self.blocked);
        row.cut_off += share(self.cut_off);
        row.passed += share(self.passed);
        let each = |count: u64| (share(count) * (1.0 - share(count)).max(0.0) / whole).sqrt();
        row.error_of_shares = row.error_of_shares.hypot(each(self.escaped).max(each(self.blocked)));
    }
}

/// Adds the mean arrivals of `walks` at each patch to a row, with their errors.
fn add_arrivals(found: BTreeMap<u32, Arrivals>, walks: u64, row: &mut ReferenceRow) {
    let whole = walks as f64;
    for (patch, arrivals) in found {
        let mean = arrivals.sum as f64 / whole;
        let variance = (arrivals.squares as f64 / whole - mean * mean).max(0.0) / whole;
        match row.columns.binary_search(&patch) {
            Ok(place) => {
                row.values[place] += mean;
                row.errors[place] = row.errors[place].hypot(variance.sqrt());
            }
            Err(place) => {
                row.columns.insert(place, patch);
                row.values.insert(place, mean);
                row.errors.insert(place, variance.sqrt());
            }
        }
    }
}

/// Adds the columns of images to the cell's; those of curtains are cut off.
fn fold(row: &mut ReferenceRow, images: &Images) {
    let mut folded: BTreeMap<u32, (f64, f64)> = BTreeMap::new();
    for ((&patch, &value), &error) in row.columns.iter().zip(&row.values).zip(&row.errors) {
        match images.fold(patch) {
            Some(patch) => {
                let entry = folded.entry(patch).or_default();
                entry.0 += value;
                entry.1 = entry.1.hypot(error);
            }
            None => row.cut_off += value,
        }
    }
    row.columns = folded.keys().copied().collect();
    row.values = folded.values().map(|&(value, _)| value).collect();
    row.errors = folded.values().map(|&(_, error)| error).collect();
}
