//! What sensors see through mirrors and panes: the further passes of their hemicubes ([`super::pass`]), with the
//! kernel of a body in place of a patch's cosine.

use super::gather::{Column, Ledger};
use super::pass::{Passes, PixelView, Taker};
use super::trace::Surfaces;
use super::{Images, Optics, Portals, specular::Laws};
use crate::Model;
use crate::backend::Hemicube;
use crate::bvh::Tree;
use crate::delta::DeltaTable;
use crate::face::Items;
use glam::DVec3;
use std::collections::BTreeMap;

/// Parts of a pixel's unit of weight.
const FINE: u64 = 1 << 10;
/// Pixels drawn of a hemicube's passes, after which paths are cut off. A choice: with fewer, halls of mirrors end
/// early, and the sensor says what was cut off; with more, each of its points takes longer.
const LEGS: u64 = 1 << 22;

/// Weights that arrive through portals, in parts of [`FINE`] of a pixel's unit. Handed on of what arrives first =
/// kept by patches + sky + ground + blocked + cut off.
#[derive(Clone, Debug, Default)]
pub(crate) struct Arrivals {
    /// Weight and the part handed on, by patch of the model.
    pub(crate) patches: BTreeMap<u32, [u64; 2]>,
    /// Likewise of first arrivals at patches whose optics depend on the angle.
    pub(crate) first: BTreeMap<u32, [u64; 2]>,
    /// Handed on of first arrivals.
    pub(crate) sent: u64,
    pub(crate) sky: u64,
    pub(crate) ground: u64,
    pub(crate) blocked: u64,
    pub(crate) cut_off: u64,
}

/// Follows the hemicubes of sensors; one a thread.
#[derive(Debug)]
pub(crate) struct Follower<'a> {
    images: Option<&'a Images>,
    passes: Passes<1>,
    optics: Vec<Optics>,
    laws: Laws,
    bound: f64,
    ledger: Ledger,
    seen: Vec<u32>,
}

impl<'a> Follower<'a> {
    /// `None` without mirrors and panes.
    pub(crate) fn new(portals: &'a Portals, model: &Model) -> Option<Self> {
        let specular = portals.specular.as_ref()?;
        let images = portals.images.as_ref();
        let mut laws = specular.laws(images, model.geometry().patch_count);
        let optics = std::mem::take(&mut laws.means);
        let mut passes = Passes::new(&Tree::of(model.geometry()), [&optics]);
        passes.legs_max = LEGS;
        Some(Self {
            images,
            passes,
            optics,
            laws,
            bound: specular.bound,
            ledger: Ledger::default(),
            seen: Vec::new(),
        })
    }

    /// ρs + τ of a patch, by the mean of its first arrivals where they depend on the angle.
    pub(crate) fn passed(&self, patch: u32, arrivals: &Arrivals) -> f64 {
        match arrivals.first.get(&patch) {
            Some(&[met, passed]) => passed as f64 / met.max(1) as f64,
            None => self.optics.get(patch as usize).map_or(0.0, Optics::passed),
        }
    }

    /// Adds what a hemicube sees through portals. `up` tells sky from ground, `shown` are the patches that the
    /// hemicube sees directly.
    pub(crate) fn follow(
        &mut self,
        hemicube: &Hemicube,
        items: &Items,
        table: &DeltaTable,
        up: DVec3,
        shown: impl Iterator<Item = u32>,
        arrivals: &mut Arrivals,
    ) {
        let optics = &self.optics;
        let is_portal = |patch: &u32| optics.get(*patch as usize).is_some_and(Optics::is_portal);
        self.seen.clear();
        self.seen.extend(shown.filter(is_portal));
        if self.seen.is_empty() {
            return;
        }
        self.ledger.clear();
        self.passes.begin_row();
        let images = self.images;
        let column = |patch: u32| match images {
            Some(images) if images.fold(patch).is_none() => Column::CutOff,
            _ => Column::Of,
        };
        let surfaces = Surfaces {
            optics: &self.optics,
            laws: &self.laws,
        };
        let mut taker = Taker {
            ledgers: std::array::from_mut(&mut self.ledger),
            column,
            up: Some(up),
        };
        let view = PixelView {
            hemicube,
            items,
            table,
            fine: FINE,
            bound: self.bound,
            cancel: None,
        };
        // Without a session there is none to fail.
        let _ = self.passes.follow(&view, &self.seen, [surfaces], &mut taker, None);
        let ledger = &self.ledger;
        for ((_, patch), found) in &ledger.entries {
            add(&mut arrivals.patches, *patch, [found.weight, found.passed]);
        }
        for (&patch, &first) in &ledger.first {
            add(&mut arrivals.first, patch, first);
        }
        arrivals.sent += ledger.sent;
        arrivals.sky += ledger.escaped - ledger.ground;
        arrivals.ground += ledger.ground;
        arrivals.blocked += ledger.blocked;
        arrivals.cut_off += ledger.cut_off + ledger.unselected;
    }
}

fn add(sums: &mut BTreeMap<u32, [u64; 2]>, patch: u32, [weight, passed]: [u64; 2]) {
    let [all, on] = sums.entry(patch).or_default();
    *all += weight;
    *on += passed;
}
