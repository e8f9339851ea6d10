//! Enclosure of a scene: objects that face the wrong way, and leaks of a nearly closed scene. By rays from both sides
//! of a sample of patches.
//!
//! Turning a set S of objects round swaps their backs and fronts. The rays blocked after a turn are counted from the
//! same rays: a ray from object a to object b exists if it leaves a's active side, and is blocked if it meets b's other
//! side. With w the weight of a ray (its patch's area by the rays of a patch),
//!
//! ```text
//! J(S) = Σ w [blocked under S]
//!      + Σ w [escaped under S, of a group that sees no front and is nearly closed on its other side]
//! ```
//!
//! over the weight of all rays. What is turned are units: the surfaces of an object that join in edges which two of
//! them run through in opposite ways, so that a building in a city of one object, or a wall in a room of one, is found
//! alone.
//!
//! Escaping rays count only if every group of the scene sees no front, or only its own, and backs in sight do not tell:
//! among free-standing solids, some see others. The culprit is the set of the largest fall of J among: each object,
//! each group of objects that share corners, the groups that face a closed inside while others see their backs (by
//! those), a ground that faces down, and all; then the next, until no turn is worth it. An object or group must be
//! turned to face a nearly closed space, and all must see more fronts than before, and fewer than backs unless they see
//! nothing: a room turned outwards sees nothing, and so no back. Objects must see more of others' fronts once turned. Two-sided surfaces have no back and are never turned.
//!
//! Where the sample leaves surfaces out, a few patches may see the back of a building and none its front. An object or
//! group to be turned is then examined by rays from both sides of all its surfaces, up to [`CONFIRMED_MAX`]: by
//! reciprocity, what they see of others' fronts is what others see of them.

use super::rays::{Caster, Emitter, Hit, crossed, directions};
use super::sample::{examine, hash, order};
use super::units::{Sets, Unit, Units};
use super::{DiagnoseOptions, WORK_OF_ENCLOSURE};
use crate::Model;
use crate::bvh::Tree;
use crate::frame;
use glam::DVec3;
use hemicube_scene::{Axis, InputPatch, Side};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet, HashMap};

/// Rays from each side of a patch, at least and at most; and from one side of all patches of small scenes, for each
/// patch that may be examined, and at most.
const RAYS: [u32; 2] = [32, 1024];
const RAYS_A_PATCH: usize = 16;
const RAYS_OF_ALL: usize = 1 << 16;
/// A group sees no front when less of its view is.
const BLIND: f64 = 0.02;
/// Likewise for the only group of a scene, with bays that see one another from outside.
const BLIND_ALONE: f64 = 0.1;
/// A side is nearly closed when no more than this escapes from it.
const OPEN: f64 = 0.25;
/// A group sees only itself when so much of its view is its own.
const ITSELF: f64 = 0.9;
/// A group faces a closed inside if at least this share of its view is its own, no more than `BLIND` escapes, and no
/// more than this is backs: the rest may be a floor that it stands on.
const INSIDE: f64 = 0.5;
const INSIDE_BACKS: f64 = 0.1;
/// An inside that others' backs stand in: what it sees of itself and of backs is at least `INSIDE`. Its other side is
/// in the open if at least this share of its view is not backs; zones of a building see the backs of the facade.
const IN_THE_OPEN: f64 = 0.4;
/// A ground that faces down: this share of its area does, on balance; so much of its view escapes; the other side sees
/// at least this share of fronts and sky; and it spans these shares of the scene along the level axes.
const DOWN: f64 = 0.7;
const SEES_NOTHING: f64 = 0.7;
const OPEN_ABOVE: f64 = 0.1;
const SPAN: [f64; 2] = [0.25, 0.5];
/// A roof in an open scene: faces up by this share of its area, and so much of its view is sky.
const UP: f64 = 0.3;
const SKY: f64 = 0.7;
/// Others see an object's back if at least this share of the rays that meet it do.
const BACKS: f64 = 0.8;
/// Weight, and rays, that a turn must save.
const WORTH: f64 = 1e-3;
const WORTH_RAYS: u64 = 8;
/// Most sets turned one after the other.
const TURNS_MAX: usize = 16;
/// Most surfaces of a turn that are examined again.
const CONFIRMED_MAX: usize = 1024;
/// Escaping share of a nearly closed scene.
const ESCAPED_MAX: f64 = 0.3;
/// Most leaks named.
const LEAKS_MAX: usize = 5;
/// Boundary loops tested against escaping rays, the largest first, and rays.
const LOOPS_MAX: usize = 512;
const ESCAPING_MAX: usize = 4096;
/// Positions nearer than this share of the scene are one.
const WELD: f64 = 1e-7;

/// The objects of a turn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Turn {
    /// All: the model is wound outwards.
    All,
    /// Groups that see only their own inside, with backs seen by others.
    InsideOut,
    /// Some objects.
    Objects,
    /// The ground, which faces down.
    Ground,
    /// Everything in an open scene: the ground faces down, and what stands on it inwards.
    Everything,
}

/// Surfaces of an object that join, where other surfaces of it face the right way.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Part {
    /// The object, by index.
    pub object: u32,
    /// The least coordinates.
    pub low: [f64; 3],
    /// The greatest.
    pub high: [f64; 3],
}

/// Objects that face the wrong way.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Winding {
    /// The objects of the turn.
    pub turn: Turn,
    /// The objects to turn, by index, ascending; for [`Turn::All`] all that have a back.
    pub objects: Vec<u32>,
    /// What is to be turned of objects that otherwise face the right way.
    pub parts: Vec<Part>,
    /// Share of all views that ends on their backs, or is lost by their facing out.
    pub lost: f64,
}

/// A hole that rays escape through.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Leak {
    /// The object, by index, with most of the hole's rim.
    pub object: u32,
    /// The least coordinates of the rim.
    pub low: [f64; 3],
    /// The greatest.
    pub high: [f64; 3],
    /// Its area, in the scene's unit squared.
    pub area: f64,
    /// Share of the escaping weight that leaves through it.
    pub share: f64,
}

/// Enclosure of a scene; see [`enclosure`].
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Enclosure {
    /// Rays from fronts.
    pub rays: u64,
    /// Area-weighted shares of the fronts' view: fronts,
    pub visible: f64,
    /// nothing,
    pub escaped: f64,
    /// and backs.
    pub blocked: f64,
    /// Objects that face the wrong way, the worst first.
    pub winding: Vec<Winding>,
    /// Number of groups, if every group of objects that share corners sees only its own inside. Rooms do, and buildings
    /// turned inside out.
    pub apart: u64,
    /// Holes that rays escape through, the largest share first; for nearly closed scenes only.
    pub leaks: Vec<Leak>,
    /// Number of further holes.
    pub leaks_more: u64,
    /// Share of the escaping weight that leaves through the holes named or counted here.
    pub leaking: f64,
}

/// Rays of one kind: from an object's side to an object's side, `NONE` for objects that cannot be turned.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Kind {
    from: u32,
    /// True if they leave backs.
    turned: bool,
    to: To,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum To {
    Nothing,
    Front(u32),
    Back(u32),
}

const NONE: u32 = u32::MAX;

#[derive(Clone, Copy, Debug, Default)]
struct Count {
    weight: f64,
    rays: u64,
}

#[derive(Default)]
struct Sample {
    counts: BTreeMap<Kind, Count>,
    /// Escaping rays from fronts, with their objects.
    escaping: Vec<(u32, DVec3, DVec3, f64)>,
    /// True if surfaces were left out.
    is_partial: bool,
}

/// Examines the enclosure of a scene. `object` is the object of a patch.
///
/// ```
/// use hemicube::diagnose::{DiagnoseOptions, Turn, enclosure};
/// use hemicube::{HierarchyOptions, Model};
/// use hemicube_scene::{Patches, Subdivision, generate};
///
/// // A room with one wall turned round: that wall is named, not those that see its back.
/// let mut room = generate::cornell_box();
/// let wall = room.objects.iter().position(|name| name == "left_wall").ok_or("no such wall")? as u32;
/// for triangle in room.triangles.iter_mut().filter(|triangle| triangle.object == wall) {
///     triangle.corners.swap(1, 2);
/// }
/// let model = Model::new(Patches::new(&room, Subdivision::Split(4))?.into(), HierarchyOptions::default())?;
/// let object = |patch| room.triangles[model.patches().triangle(patch)].object;
/// let found = enclosure(&model, object, DiagnoseOptions::default());
/// assert_eq!(found.winding.len(), 1);
/// assert_eq!((found.winding[0].turn, &found.winding[0].objects[..]), (Turn::Objects, &[wall][..]));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn enclosure(model: &Model, object: impl Fn(InputPatch) -> u32 + Sync, options: DiagnoseOptions) -> Enclosure {
    let units = Units::of(model, &object);
    let unit = |patch| units.of_triangle(model.patches().triangle(patch));
    let sample = sample(model, &unit, options);
    let mut found = Enclosure::default();
    for (kind, count) in sample.counts.iter().filter(|(kind, _)| !kind.turned) {
        found.rays += count.rays;
        *match kind.to {
            To::Nothing => &mut found.escaped,
            To::Front(_) => &mut found.visible,
            To::Back(_) => &mut found.blocked,
        } += count.weight;
    }
    let whole = found.visible + found.escaped + found.blocked;
    if whole <= 0.0 {
        return found;
    }
    let groups = groups(model, &units, &unit);
    let mut turns;
    (turns, found.apart) = windings(&sample.counts, &groups, &units, options.up, whole);
    if sample.is_partial {
        confirm(model, &unit, &mut turns, options);
    }
    let turned: BTreeSet<u32> = turns.iter().flat_map(|turn| turn.units.iter().copied()).collect();
    found.winding = turns.into_iter().map(|turn| turn.of_objects(&units)).collect();
    let escaping: f64 = sample
        .counts
        .iter()
        .filter(|(kind, _)| kind.to == To::Nothing && kind.turned == turned.contains(&kind.from))
        .map(|(_, count)| count.weight)
        .sum();
    if escaping > 0.0 && escaping <= ESCAPED_MAX * whole {
        let rays: Vec<_> = sample
            .escaping
            .into_iter()
            .filter(|(from, ..)| !turned.contains(from))
            .take(ESCAPING_MAX)
            .collect();
        leaks(model, &object, &rays, &mut found);
    }
    for share in [&mut found.visible, &mut found.escaped, &mut found.blocked] {
        *share /= whole;
    }
    found
}

fn is_two_sided(model: &Model, patch: InputPatch) -> bool {
    let index = model.patches().surface(patch);
    let same = |other: u32| {
        let other = InputPatch(other);
        (other.0 as usize) < model.patches().len() && model.patches().surface(other) == index
    };
    model.patches().side(patch) == Side::Back || same(patch.0 + 1)
}

/// Keeps the turns of objects and groups that save as much by rays from all of their own surfaces, and measures what
/// they save.
fn confirm(
    model: &Model,
    unit: &(impl Fn(InputPatch) -> u32 + Sync),
    turns: &mut Vec<Turned>,
    options: DiagnoseOptions,
) {
    let order = order(model, options.seed);
    let surfaces = &model.geometry().surfaces;
    let sides = |index: u32| {
        if surfaces[index as usize].back.is_some() {
            2.0
        } else {
            1.0
        }
    };
    let area = |index: u32| model.patches().area(surfaces[index as usize].front);
    let whole: f64 = order.iter().map(|&index| sides(index) * area(index)).sum();
    let mut turned = BTreeSet::new();
    turns.retain_mut(|turn| {
        if turn.turn == Turn::Objects {
            let of_turn = |index: &u32| turn.units.contains(&unit(surfaces[*index as usize].front));
            let all: Vec<u32> = order.iter().copied().filter(of_turn).collect();
            let some = &all[..all.len().min(CONFIRMED_MAX)];
            let total = |list: &[u32]| list.iter().map(|&index| area(index)).sum::<f64>();
            let sample = sample_of(model, unit, some, options);
            let Some(saved) = saved_by_own_rays(&sample.counts, &turn.units, &turned) else {
                return false;
            };
            turn.lost = saved * total(&all) / total(some) / whole;
            if turn.lost <= WORTH {
                return false;
            }
        }
        turned.extend(turn.units.iter().copied());
        true
    });
}

/// Weight that turning these units saves, once others are `turned`, by rays from both of their sides; `None` where
/// others see their fronts, or see nothing of them and they see others' backs.
fn saved_by_own_rays(counts: &BTreeMap<Kind, Count>, units: &BTreeSet<u32>, turned: &BTreeSet<u32>) -> Option<f64> {
    // From either side: backs, others' and their own; fronts of others; their own fronts.
    let (mut backs, mut own_backs, mut fronts, mut own_fronts) = ([0.0; 2], [0.0; 2], [0.0; 2], [0.0; 2]);
    for (kind, Count { weight, .. }) in counts.iter().filter(|(kind, _)| units.contains(&kind.from)) {
        let is_own = matches!(kind.to, To::Front(to) | To::Back(to) if units.contains(&to));
        let sum = match kind.to {
            To::Nothing => continue,
            _ if Rays::meets_back(*kind, turned) && is_own => &mut own_backs,
            _ if Rays::meets_back(*kind, turned) => &mut backs,
            _ if is_own => &mut own_fronts,
            _ => &mut fronts,
        };
        sum[usize::from(kind.turned)] += weight;
    }
    // Others' fronts in sight are the rays of others that meet this side.
    let is_seen = fronts[0] + fronts[1] > 0.0;
    let faces_away = if is_seen {
        fronts[1] >= BACKS * (fronts[0] + fronts[1])
    } else {
        own_backs[0] >= backs[0]
    };
    let saved = backs[0] + own_backs[0] + fronts[1] - backs[1] - own_fronts[1] - fronts[0];
    faces_away.then_some(saved)
}

fn sample(model: &Model, object: &(impl Fn(InputPatch) -> u32 + Sync), options: DiagnoseOptions) -> Sample {
    let order = order(model, options.seed);
    let some = &order[..order.len().min(options.surfaces_max)];
    let mut sample = sample_of(model, object, some, options);
    sample.is_partial |= some.len() < order.len();
    sample
}

/// Casts rays from both sides of the surfaces `order`, from its beginning, as far as the work allows.
fn sample_of(
    model: &Model,
    object: &(impl Fn(InputPatch) -> u32 + Sync),
    order: &[u32],
    options: DiagnoseOptions,
) -> Sample {
    let tree = &*Tree::of(model.geometry());
    let of_all = options.surfaces_max.saturating_mul(RAYS_A_PATCH).min(RAYS_OF_ALL);
    #[allow(clippy::cast_possible_truncation, reason = "at most 65536")]
    let rays = ((of_all / order.len().max(1)) as u32).clamp(RAYS[0], RAYS[1]);
    let directions = directions(rays);
    let turnable = |patch: u32| {
        let patch = InputPatch(patch);
        if is_two_sided(model, patch) {
            NONE
        } else {
            object(patch)
        }
    };
    let (samples, examined) = examine(order, options.threads, WORK_OF_ENCLOSURE, |surfaces, work| {
        let mut caster = Caster::new(tree);
        let mut sample = Sample::default();
        for &index in surfaces {
            let surface = &model.geometry().surfaces[index as usize];
            let sides = match surface.back {
                Some(back) => [(surface.front, 1.0, NONE), (back, 1.0, NONE)],
                None => [
                    (surface.front, 1.0, object(surface.front)),
                    (surface.front, -1.0, object(surface.front)),
                ],
            };
            for (patch, side, from) in sides {
                let Some(emitter) = Emitter::new(model, tree, patch) else {
                    continue;
                };
                let points = frame::sample_points(emitter.corners, 4);
                let weight = model.patches().area(patch) / f64::from(rays);
                for (k, &direction) in (0u64..).zip(&directions) {
                    #[allow(clippy::cast_possible_truncation, reason = "below the number of points")]
                    let origin = points[(hash(patch.0.into(), k) % points.len() as u64) as usize];
                    let direction = side * emitter.turned(direction);
                    let to = match caster.first_of_side(&emitter, side, origin, direction) {
                        Hit::Nothing => To::Nothing,
                        Hit::Patch(patch) => To::Front(turnable(patch)),
                        Hit::Back(patch) => To::Back(object(InputPatch(patch))),
                    };
                    let turned = side < 0.0;
                    if to == To::Nothing && !turned && sample.escaping.len() < ESCAPING_MAX {
                        sample.escaping.push((from, origin, direction, weight));
                    }
                    let count = sample.counts.entry(Kind { from, turned, to }).or_default();
                    count.weight += weight;
                    count.rays += 1;
                }
            }
        }
        *work += caster.work + 64 * surfaces.len() as u64;
        sample
    });
    let mut all = Sample {
        is_partial: examined < order.len(),
        ..Sample::default()
    };
    for sample in samples {
        for (kind, count) in sample.counts {
            let sum = all.counts.entry(kind).or_default();
            sum.weight += count.weight;
            sum.rays += count.rays;
        }
        let room = (4 * ESCAPING_MAX).saturating_sub(all.escaping.len());
        all.escaping.extend(sample.escaping.into_iter().take(room));
    }
    all
}

/// A position, in steps of [`WELD`].
pub(super) fn welded(model: &Model, corner: DVec3) -> [i64; 3] {
    #[allow(clippy::cast_possible_truncation, reason = "normalised coordinates are about 1")]
    (model.normalise(corner) / WELD).round().to_array().map(|c| c as i64)
}

/// The group of each unit: units that share corners, by the least of their indices. A closed one is a group alone.
fn groups(model: &Model, units: &Units, unit: &impl Fn(InputPatch) -> u32) -> BTreeMap<u32, u32> {
    let mut sets = Sets::of(units.iter().count());
    let mut owner: HashMap<[i64; 3], u32> = HashMap::new();
    for surface in &model.geometry().surfaces {
        let own = unit(surface.front);
        if units.get(own).is_closed {
            continue;
        }
        for corner in model.patches().corners(surface.front) {
            let first = *owner.entry(welded(model, corner)).or_insert(own);
            if first != own {
                sets.join(first, own);
            }
        }
    }
    units.iter().map(|(unit, _)| (unit, sets.least(unit))).collect()
}

/// The view of a group of objects from its active side, and the views of it.
#[derive(Clone, Debug, Default)]
struct Sight {
    own: f64,
    others: f64,
    backs: f64,
    escaped: f64,
    /// From the other side.
    hidden: f64,
    hidden_escaped: f64,
    /// Fronts of others that see its backs.
    hidden_met: f64,
    /// Backs that its other side sees, by group.
    hidden_backs: BTreeMap<u32, f64>,
    /// By others, front and back.
    met: [f64; 2],
}

impl Sight {
    fn view(&self) -> f64 {
        self.own + self.others + self.backs + self.escaped
    }

    fn is_blind(&self, alone: bool) -> bool {
        let bound = if alone { BLIND_ALONE } else { BLIND };
        self.hidden > 0.0 && self.own + self.others <= bound * self.view() && self.hidden_escaped <= OPEN * self.hidden
    }

    /// Returns whether it faces a closed inside, and others see its backs.
    fn is_inside_out(&self) -> bool {
        let is_inside = self.met[1] + self.hidden_met > 0.0
            && self.own >= INSIDE * self.view()
            && self.backs <= INSIDE_BACKS * self.view();
        // Where things stand in it, it sees their backs.
        let is_around = self.met[1] > BACKS * (self.met[0] + self.met[1])
            && self.own > 0.0
            && self.own + self.backs >= INSIDE * self.view();
        self.escaped <= BLIND * self.view() && (is_inside || is_around)
    }

    /// Returns whether its other side sees fronts, sky, and the backs of `others` rather than further backs.
    fn is_in_the_open(&self, others: &BTreeSet<u32>) -> bool {
        let backs: f64 = self
            .hidden_backs
            .iter()
            .filter(|(group, _)| others.contains(group))
            .map(|(_, weight)| weight)
            .sum();
        self.hidden_escaped + self.hidden_met + backs >= IN_THE_OPEN * self.hidden
    }
}

struct Rays<'a> {
    list: Vec<(Kind, Count)>,
    /// Entries with an object.
    of: BTreeMap<u32, Vec<usize>>,
    groups: &'a BTreeMap<u32, u32>,
    units: &'a Units,
    up: Option<DVec3>,
    whole: f64,
}

impl Rays<'_> {
    fn is_active(kind: Kind, turned: &BTreeSet<u32>) -> bool {
        kind.turned == turned.contains(&kind.from)
    }

    fn meets_back(kind: Kind, turned: &BTreeSet<u32>) -> bool {
        match kind.to {
            To::Nothing => false,
            To::Front(object) => turned.contains(&object),
            To::Back(object) => !turned.contains(&object),
        }
    }

    fn sights(&self, turned: &BTreeSet<u32>) -> BTreeMap<u32, Sight> {
        self.sights_by(turned, |unit| self.groups.get(&unit).copied().unwrap_or(NONE))
    }

    fn sights_by(&self, turned: &BTreeSet<u32>, group: impl Fn(u32) -> u32) -> BTreeMap<u32, Sight> {
        let mut sights: BTreeMap<u32, Sight> = BTreeMap::new();
        for &(kind, Count { weight, .. }) in &self.list {
            let from = group(kind.from);
            let to = match kind.to {
                To::Nothing => None,
                To::Front(object) | To::Back(object) => Some(group(object)),
            };
            let active = Self::is_active(kind, turned);
            let back = Self::meets_back(kind, turned);
            let sight = sights.entry(from).or_default();
            if active {
                *match to {
                    None => &mut sight.escaped,
                    Some(_) if back => &mut sight.backs,
                    Some(to) if to == from => &mut sight.own,
                    Some(_) => &mut sight.others,
                } += weight;
                if let Some(to) = to.filter(|&to| to != from) {
                    sights.entry(to).or_default().met[usize::from(back)] += weight;
                }
            } else {
                sight.hidden += weight;
                match to {
                    None => sight.hidden_escaped += weight,
                    Some(to) if to != from && !back => sight.hidden_met += weight,
                    Some(to) if back => *sight.hidden_backs.entry(to).or_default() += weight,
                    Some(_) => {}
                }
            }
        }
        sights.remove(&NONE);
        sights
    }

    /// J of the entries with `objects`, and the rays that count in it. `blind` are the groups with escaping rays that
    /// count.
    fn lost(&self, objects: &BTreeSet<u32>, turned: &BTreeSet<u32>, blind: &BTreeSet<u32>) -> (f64, u64) {
        let mut entries: Vec<usize> = objects
            .iter()
            .filter_map(|o| self.of.get(o))
            .flatten()
            .copied()
            .collect();
        entries.sort_unstable();
        entries.dedup();
        let (mut weight, mut rays) = (0.0, 0);
        for entry in entries {
            let (kind, count) = self.list[entry];
            let blind = || self.groups.get(&kind.from).is_some_and(|group| blind.contains(group));
            // Turned blind groups may at most leak on their other side.
            let counts =
                Self::meets_back(kind, turned) || (kind.to == To::Nothing && blind() && !turned.contains(&kind.from));
            if Self::is_active(kind, turned) && counts {
                weight += count.weight;
                rays += count.rays;
            }
        }
        (weight, rays)
    }

    /// Weight of the rays from active sides that meet a front.
    fn fronts(&self, turned: &BTreeSet<u32>) -> f64 {
        let meets_front =
            |kind: Kind| kind.to != To::Nothing && Self::is_active(kind, turned) && !Self::meets_back(kind, turned);
        let rays = self.list.iter().filter(|(kind, _)| meets_front(*kind));
        rays.map(|(_, count)| count.weight).sum()
    }

    /// Returns whether everything may be turned, `after` in place of `turned`: it must see more fronts then and, unless
    /// it is wound outwards throughout, more backs than fronts now. Solids that stand on each other see backs where
    /// they touch, and fronts within themselves if they are turned.
    fn is_better_turned(&self, turned: &BTreeSet<u32>, after: &BTreeSet<u32>, blind: &BTreeSet<u32>) -> bool {
        let fronts = self.fronts(turned);
        let meets_back = |kind: Kind| Self::is_active(kind, turned) && Self::meets_back(kind, turned);
        let seen = self.list.iter().filter(|(kind, _)| meets_back(*kind));
        let backs: f64 = seen.map(|(_, count)| count.weight).sum();
        self.fronts(after) > fronts && (!blind.is_empty() || backs > fronts)
    }

    /// Returns whether others see only backs of these objects, or nobody sees them, and their other side faces a nearly
    /// closed space, or is a hollow that sees itself. Where nobody sees them, and most backs that they see are others',
    /// those are to be turned: a part in a housing that faces out.
    fn faces_away(&self, objects: &BTreeSet<u32>, turned: &BTreeSet<u32>) -> bool {
        let (mut met, mut hidden, mut hidden_own) = ([0.0; 2], [0.0; 2], 0.0);
        // Their own backs, and others'.
        let mut backs = [0.0; 2];
        for &entry in objects.iter().filter_map(|o| self.of.get(o)).flatten() {
            let (kind, count) = self.list[entry];
            let active = Self::is_active(kind, turned);
            let is_own = matches!(kind.to, To::Front(to) | To::Back(to) if objects.contains(&to));
            if objects.contains(&kind.from) && !active {
                hidden[usize::from(kind.to == To::Nothing)] += count.weight;
                hidden_own += if is_own { count.weight } else { 0.0 };
            }
            if objects.contains(&kind.from) && active && Self::meets_back(kind, turned) {
                backs[usize::from(!is_own)] += count.weight;
            }
            if let To::Front(to) | To::Back(to) = kind.to
                && objects.contains(&to)
                && !objects.contains(&kind.from)
                && active
            {
                met[usize::from(Self::meets_back(kind, turned))] += count.weight;
            }
        }
        let [fronts, seen] = met;
        let is_unseen = fronts + seen == 0.0 && backs[1] > backs[0];
        let all = hidden[0] + hidden[1];
        let is_hollow = hidden_own >= INSIDE * all && fronts == 0.0;
        !is_unseen && seen >= BACKS * (fronts + seen) && (hidden[1] <= OPEN * all || is_hollow)
    }

    /// Returns whether these and others see more of each other's fronts `after` than with `turned`: tubes in a furnace
    /// whose walls face out lose as few views by being turned as the walls do, but see nothing then but their insides.
    fn meets_more_fronts(&self, objects: &BTreeSet<u32>, turned: &BTreeSet<u32>, after: &BTreeSet<u32>) -> bool {
        let mut entries: Vec<usize> = objects
            .iter()
            .filter_map(|o| self.of.get(o))
            .flatten()
            .copied()
            .collect();
        entries.sort_unstable();
        entries.dedup();
        let fronts = |turned: &BTreeSet<u32>| -> f64 {
            let of = entries.iter().map(|&entry| self.list[entry]).filter(|(kind, _)| {
                let is_apart = match kind.to {
                    To::Nothing => false,
                    To::Front(to) | To::Back(to) => objects.contains(&to) != objects.contains(&kind.from),
                };
                is_apart && Self::is_active(*kind, turned) && !Self::meets_back(*kind, turned)
            });
            of.map(|(_, count)| count.weight).sum()
        };
        fronts(after) > fronts(turned)
    }

    /// Returns whether these face up and see nothing but sky, in a scene that is open anyway: a roof on posts, a
    /// canopy, a solar panel. Their undersides see what they shade, and a roof's its attic.
    fn is_roof(&self, objects: &BTreeSet<u32>, turned: &BTreeSet<u32>, after: &BTreeSet<u32>) -> bool {
        let Some(up) = self.up else { return false };
        let (mut net, mut area) = (0.0, 0.0);
        for &unit in objects {
            net += self.units.get(unit).net.dot(up);
            area += self.units.get(unit).area;
        }
        if net < UP * area {
            return false;
        }
        // All of a view, and what escapes of it: theirs, and everyone's.
        let (mut own, mut whole) = ([0.0; 2], [0.0; 2]);
        for &(kind, Count { weight, .. }) in &self.list {
            let sky = if kind.to == To::Nothing { weight } else { 0.0 };
            if objects.contains(&kind.from) && Self::is_active(kind, turned) {
                own[0] += weight;
                own[1] += sky;
            }
            if Self::is_active(kind, after) {
                whole[0] += weight;
                whole[1] += sky;
            }
        }
        own[1] >= SKY * own[0] && whole[1] > ESCAPED_MAX * whole[0]
    }

    /// Units that are the ground and face down: they see nothing, lie below all else, and span the scene.
    fn ground(&self, turned: &BTreeSet<u32>) -> BTreeSet<u32> {
        let Some(up) = self.up else { return BTreeSet::new() };
        let sights = self.sights_by(turned, |unit| unit);
        let faces_down = |unit: &Unit| !unit.is_closed && unit.net.dot(up) <= -DOWN * unit.area;
        let found: BTreeSet<u32> = sights
            .iter()
            .filter(|(unit, sight)| {
                !turned.contains(unit)
                    && faces_down(self.units.get(**unit))
                    && sight.escaped >= SEES_NOTHING * sight.view()
                    && sight.hidden > 0.0
                    && sight.hidden_escaped + sight.hidden_met >= OPEN_ABOVE * sight.hidden
            })
            .map(|(&unit, _)| unit)
            .collect();
        // The boxes, areas and moments of these and of the others.
        let mut sums = [(DVec3::INFINITY, DVec3::NEG_INFINITY, 0.0, 0.0); 2];
        for (number, unit) in self.units.iter() {
            let (low, high, area, height) = &mut sums[usize::from(found.contains(&number))];
            *low = low.min(unit.low);
            *high = high.max(unit.high);
            *area += unit.area;
            *height += unit.moment.dot(up);
        }
        let [others, own] = sums;
        let extent = own.1 - own.0;
        let all = own.1.max(others.1) - own.0.min(others.0);
        let level = || (0..3).filter(|&axis| up[axis].abs() < 0.5);
        let spans = level().all(|axis| extent[axis] >= SPAN[0] * all[axis])
            && level().any(|axis| extent[axis] >= SPAN[1] * all[axis]);
        let is_below = others.2 == 0.0 || own.3 * others.2 <= others.3 * own.2;
        if !found.is_empty() && spans && is_below {
            found
        } else {
            BTreeSet::new()
        }
    }

    /// Share of all views that would meet others, if everything is to be turned round: the ground faces down, and what
    /// stands on it faces its own inside or nothing.
    fn everything(&self, all: &BTreeSet<u32>) -> Option<f64> {
        let none = BTreeSet::new();
        let ground = self.ground(&none);
        if ground.is_empty() || self.list.iter().any(|(kind, _)| kind.from == NONE) {
            return None;
        }
        let sights = self.sights(&none);
        // What faces up and sees the sky is right.
        let mut net: BTreeMap<u32, f64> = BTreeMap::new();
        for (number, unit) in self.units.iter().filter(|(number, _)| !ground.contains(number)) {
            let group = self.groups.get(&number).copied().unwrap_or(NONE);
            *net.entry(group).or_default() += unit.net.dot(self.up.unwrap_or_default());
        }
        let sees_no_other = |(group, sight): (&u32, &Sight)| {
            let is_inside = sight.own >= INSIDE * sight.view() && sight.escaped <= OPEN * sight.view();
            let is_up = net.get(group).is_some_and(|&net| net > 0.0);
            is_inside || (sight.escaped >= SEES_NOTHING * sight.view() && !is_up)
        };
        if !sights.iter().all(sees_no_other) {
            return None;
        }
        let others = |turned| self.sights(turned).values().map(|sight| sight.others).sum::<f64>();
        let (before, after) = (others(&none), others(all));
        let loss = self.lost(all, all, &none).0 - self.lost(all, &none, &none).0;
        // Where solids stand, the ground sees their backs once all is turned. A sheet alone tells nothing.
        (after - before > loss.max(0.0) + WORTH * self.whole).then_some((after - before) / self.whole)
    }

    /// Groups that show their insides.
    fn inside_out(&self, turned: &BTreeSet<u32>, members: &BTreeMap<u32, BTreeSet<u32>>) -> InsideOut {
        let sights = self.sights(turned);
        let mut groups: BTreeSet<u32> = sights
            .iter()
            .filter(|(group, sight)| {
                sight.is_inside_out() && members.get(group).is_some_and(|units| units.is_disjoint(turned))
            })
            .map(|(&group, _)| group)
            .collect();
        loop {
            let kept: BTreeSet<u32> = groups
                .iter()
                .copied()
                .filter(|group| sights[group].is_in_the_open(&groups))
                .collect();
            if kept.len() == groups.len() {
                break;
            }
            groups = kept;
        }
        InsideOut {
            units: groups
                .iter()
                .filter_map(|group| members.get(group))
                .flatten()
                .copied()
                .collect(),
            backs: groups.iter().map(|group| sights[group].met[1]).sum(),
        }
    }

    /// The turns that save most, one after the other; `blind` are the groups with escaping rays that count.
    fn turns(&self, all: &BTreeSet<u32>, members: &BTreeMap<u32, BTreeSet<u32>>, blind: &BTreeSet<u32>) -> Vec<Turned> {
        let mut candidates = candidates(self, all, members);
        let fixed = candidates.len();
        let mut found: Vec<Turned> = Vec::new();
        let mut turned = BTreeSet::new();
        while found.len() < TURNS_MAX {
            let inside_out = self.inside_out(&turned, members);
            candidates.truncate(fixed);
            candidates.push((Turn::InsideOut, inside_out.units));
            candidates.push((Turn::Ground, self.ground(&turned)));
            candidates.push((Turn::All, all.clone()));
            let Some((saved, turn, units)) = self.best_turn(&candidates, &turned, blind, inside_out.backs) else {
                break;
            };
            found.push(Turned {
                turn: match turn {
                    _ if units.len() == all.len() && !blind.is_empty() => Turn::All,
                    Turn::All => Turn::Objects,
                    turn => turn,
                },
                units: units.clone(),
                lost: saved / self.whole,
            });
            turned.extend(units.iter().copied());
        }
        found
    }

    /// The candidate that saves most weight once `turned` are turned, with that weight; `backs` is saved by those
    /// inside out.
    fn best_turn<'c>(
        &self,
        candidates: &'c [(Turn, BTreeSet<u32>)],
        turned: &BTreeSet<u32>,
        blind: &BTreeSet<u32>,
        backs: f64,
    ) -> Option<(f64, Turn, &'c BTreeSet<u32>)> {
        let mut best: Option<(f64, Turn, &BTreeSet<u32>)> = None;
        for (turn, objects) in candidates {
            if objects.is_empty() || !objects.is_disjoint(turned) {
                continue;
            }
            // No turn saves more than is lost. Few candidates lose so much, and unions of large sets take long.
            let (before, rays_before) = self.lost(objects, turned, blind);
            if *turn != Turn::InsideOut && before <= WORTH * self.whole {
                continue;
            }
            let after: BTreeSet<u32> = turned.union(objects).copied().collect();
            let (rest, rays_rest) = self.lost(objects, &after, blind);
            // For objects inside out: the backs seen by others. A floor's view of their insides from below proves
            // nothing.
            let (saved, rays_saved) = if *turn == Turn::InsideOut {
                (backs, WORTH_RAYS)
            } else {
                (before - rest, rays_before.saturating_sub(rays_rest))
            };
            let worth = saved > WORTH * self.whole && rays_saved >= WORTH_RAYS;
            let turns_to_others = |turn| match turn {
                Turn::Objects => {
                    self.faces_away(objects, turned)
                        && !self.is_roof(objects, turned, &after)
                        && self.meets_more_fronts(objects, turned, &after)
                }
                Turn::All if blind.is_empty() && self.is_roof(objects, turned, &after) => false,
                Turn::All => self.is_better_turned(turned, &after, blind),
                _ => true,
            };
            if worth && best.is_none_or(|(most, ..)| saved > most * (1.0 + 1e-9)) && turns_to_others(*turn) {
                best = Some((saved, *turn, objects));
            }
        }
        best
    }
}

/// Units that show their insides, and the weight of rays of others that meet their backs.
struct InsideOut {
    units: BTreeSet<u32>,
    backs: f64,
}

/// Units to turn.
struct Turned {
    turn: Turn,
    units: BTreeSet<u32>,
    lost: f64,
}

impl Turned {
    /// Whole objects, and parts of the others.
    fn of_objects(self, units: &Units) -> Winding {
        let kept: BTreeSet<u32> = units
            .iter()
            .filter(|(unit, _)| !self.units.contains(unit))
            .map(|(_, unit)| unit.object)
            .collect();
        let of = self.units.iter().map(|&unit| units.get(unit));
        let (parts, whole): (Vec<&Unit>, Vec<&Unit>) = of.partition(|unit| kept.contains(&unit.object));
        let objects: BTreeSet<u32> = whole.iter().map(|unit| unit.object).collect();
        Winding {
            turn: self.turn,
            objects: objects.into_iter().collect(),
            parts: parts
                .into_iter()
                .map(|unit| Part {
                    object: unit.object,
                    low: unit.low.to_array(),
                    high: unit.high.to_array(),
                })
                .collect(),
            lost: self.lost,
        }
    }
}

/// Sets of units that may be turned, whatever was turned before: each unit, object and group.
fn candidates(
    rays: &Rays<'_>,
    all: &BTreeSet<u32>,
    members: &BTreeMap<u32, BTreeSet<u32>>,
) -> Vec<(Turn, BTreeSet<u32>)> {
    let mut objects: BTreeMap<u32, BTreeSet<u32>> = BTreeMap::new();
    for &unit in all {
        objects.entry(rays.units.get(unit).object).or_default().insert(unit);
    }
    let single = all.iter().map(|&unit| BTreeSet::from([unit]));
    let several = objects
        .values()
        .chain(members.values())
        .filter(|of| of.len() > 1)
        .cloned();
    // All that can be turned are one candidate, whatever they are called.
    single
        .chain(several)
        .filter(|units| units != all)
        .map(|units| (Turn::Objects, units))
        .collect()
}

fn windings(
    counts: &BTreeMap<Kind, Count>,
    groups: &BTreeMap<u32, u32>,
    units: &Units,
    up: Option<Axis>,
    whole: f64,
) -> (Vec<Turned>, u64) {
    let list: Vec<(Kind, Count)> = counts.iter().map(|(&kind, &count)| (kind, count)).collect();
    let mut of: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
    for (entry, (kind, _)) in list.iter().enumerate() {
        let to = match kind.to {
            To::Front(unit) | To::Back(unit) => unit,
            To::Nothing => NONE,
        };
        for unit in [kind.from, to] {
            if unit != NONE && of.get(&unit).is_none_or(|entries| entries.last() != Some(&entry)) {
                of.entry(unit).or_default().push(entry);
            }
        }
    }
    let rays = Rays {
        list,
        of,
        groups,
        units,
        up: up.map(|axis| match axis {
            Axis::X => DVec3::X,
            Axis::Y => DVec3::Y,
            Axis::Z => DVec3::Z,
        }),
        whole,
    };
    // Units with a back.
    let all: BTreeSet<u32> = rays
        .list
        .iter()
        .filter(|(kind, _)| kind.turned)
        .map(|(kind, _)| kind.from)
        .collect();
    if let Some(lost) = rays.everything(&all) {
        let turn = Turn::Everything;
        return (vec![Turned { turn, units: all, lost }], 0);
    }
    let mut members: BTreeMap<u32, BTreeSet<u32>> = BTreeMap::new();
    for &unit in &all {
        members
            .entry(groups.get(&unit).copied().unwrap_or(unit))
            .or_default()
            .insert(unit);
    }
    let sights = rays.sights(&BTreeSet::new());
    let alone = members.len() == 1 && sights.len() == 1;
    // In a model turned throughout, shells face nothing, and the things in them see themselves and their backs.
    let blind: BTreeSet<u32> = sights
        .iter()
        .filter(|(_, sight)| sight.is_blind(alone))
        .map(|(&group, _)| group)
        .collect();
    let all_outward = !blind.is_empty()
        && sights
            .values()
            .all(|sight| sight.is_blind(alone) || sight.own + sight.backs >= ITSELF * sight.view());
    let blind = if all_outward { blind } else { BTreeSet::new() };
    // Where a room sees itself, what backs in sight tell comes first: a thick-walled room with a chair turned round in
    // it is no model wound outwards, though its facade sees nothing.
    let is_room = |sight: &Sight| sight.own >= INSIDE * sight.view() && sight.backs > WORTH * whole;
    let mut found = rays.turns(&all, &members, &BTreeSet::new());
    if all_outward && !sights.values().any(is_room) {
        found = rays.turns(&all, &members, &blind);
    } else if all_outward {
        let turned: BTreeSet<u32> = found.iter().flat_map(|of| of.units.iter().copied()).collect();
        if found.is_empty() || rays.lost(&all, &turned, &BTreeSet::new()).0 > WORTH * whole {
            found = rays.turns(&all, &members, &blind);
        }
    }
    let is_apart = |sight: &Sight| sight.view() > 0.0 && sight.own >= ITSELF * sight.view() && sight.met == [0.0; 2];
    let apart = if sights.len() > 1 && sights.values().all(is_apart) {
        sights.len() as u64
    } else {
        0
    };
    (found, apart)
}

/// A boundary loop: its corners in the scene's coordinates, and how much of its length each object has.
struct Loop {
    corners: Vec<DVec3>,
    object: u32,
    area: f64,
}

fn loops(model: &Model, object: &impl Fn(InputPatch) -> u32) -> Vec<Loop> {
    type Vertex = [i64; 3];
    let mut position: HashMap<Vertex, DVec3> = HashMap::new();
    let mut uses: HashMap<[Vertex; 2], (u32, u32)> = HashMap::new();
    for surface in &model.geometry().surfaces {
        let corners = model.patches().corners(surface.front);
        let keys = corners.map(|corner| welded(model, corner));
        for (&key, &corner) in keys.iter().zip(&corners) {
            position.entry(key).or_insert(corner);
        }
        for (a, b) in [(keys[0], keys[1]), (keys[1], keys[2]), (keys[2], keys[0])] {
            if a != b {
                let of = uses.entry([a.min(b), a.max(b)]).or_insert((0, object(surface.front)));
                of.0 += 1;
            }
        }
    }
    let edges: BTreeMap<[Vertex; 2], u32> = uses
        .into_iter()
        .filter(|(_, (count, _))| *count == 1)
        .map(|(edge, (_, object))| (edge, object))
        .collect();
    let mut left: BTreeMap<Vertex, BTreeSet<Vertex>> = BTreeMap::new();
    for &[a, b] in edges.keys() {
        left.entry(a).or_default().insert(b);
        left.entry(b).or_default().insert(a);
    }
    let mut found = Vec::new();
    // From each vertex along unwalked edges; where the walk meets itself, a loop is cut off.
    let starts: Vec<Vertex> = left.keys().copied().collect();
    for start in starts {
        let mut path = vec![start];
        let mut place: HashMap<Vertex, usize> = HashMap::from([(start, 0)]);
        while let Some(&at) = path.last() {
            let Some(next) = left.get(&at).and_then(|next| next.first().copied()) else {
                // A dead end: its edges are no loop.
                left.remove(&at);
                place.remove(&at);
                path.pop();
                continue;
            };
            for (from, to) in [(at, next), (next, at)] {
                if let Some(ends) = left.get_mut(&from) {
                    ends.remove(&to);
                }
            }
            match place.get(&next) {
                Some(&first) => {
                    found.extend(of_walk(&path[first..], &position, &edges));
                    for gone in path.drain(first + 1..) {
                        place.remove(&gone);
                    }
                }
                None => {
                    place.insert(next, path.len());
                    path.push(next);
                }
            }
        }
    }
    found.sort_by(|a: &Loop, b| b.area.total_cmp(&a.area));
    found
}

fn of_walk(
    walk: &[[i64; 3]],
    position: &HashMap<[i64; 3], DVec3>,
    edges: &BTreeMap<[[i64; 3]; 2], u32>,
) -> Option<Loop> {
    let corners: Vec<DVec3> = walk.iter().filter_map(|key| position.get(key).copied()).collect();
    let first = *corners.first()?;
    let area = 0.5
        * corners
            .windows(2)
            .map(|edge| (edge[0] - first).cross(edge[1] - first))
            .sum::<DVec3>()
            .length();
    let mut lengths: BTreeMap<u32, f64> = BTreeMap::new();
    for (at, &a) in walk.iter().enumerate() {
        let b = walk[(at + 1) % walk.len()];
        if let (Some(&object), Some(p), Some(q)) =
            (edges.get(&[a.min(b), a.max(b)]), position.get(&a), position.get(&b))
        {
            *lengths.entry(object).or_default() += p.distance(*q);
        }
    }
    let object = lengths
        .iter()
        .max_by(|a, b| a.1.total_cmp(b.1).then(b.0.cmp(a.0)))
        .map(|(&object, _)| object)?;
    (corners.len() > 2).then_some(Loop { corners, object, area })
}

fn leaks(model: &Model, object: &impl Fn(InputPatch) -> u32, rays: &[(u32, DVec3, DVec3, f64)], found: &mut Enclosure) {
    let mut loops = loops(model, object);
    loops.truncate(LOOPS_MAX);
    // Fans about the loops' middles, in normalised coordinates.
    let fans: Vec<(DVec3, Vec<DVec3>)> = loops
        .iter()
        .map(|of| {
            let rim: Vec<DVec3> = of.corners.iter().map(|&corner| model.normalise(corner)).collect();
            (rim.iter().sum::<DVec3>() / rim.len().max(1) as f64, rim)
        })
        .collect();
    let mut through = vec![0.0; loops.len()];
    let mut escaped = 0.0;
    for &(_, origin, direction, weight) in rays {
        escaped += weight;
        let mut nearest: Option<(f64, usize)> = None;
        for (index, (middle, rim)) in fans.iter().enumerate() {
            for at in 0..rim.len() {
                let triangle = [*middle, rim[at], rim[(at + 1) % rim.len()]];
                let (t, _) = crossed(triangle, origin, direction);
                if t > 0.0 && nearest.is_none_or(|(least, _)| t < least) {
                    nearest = Some((t, index));
                }
            }
        }
        if let Some((_, index)) = nearest {
            through[index] += weight;
        }
    }
    let mut leaks: Vec<Leak> = loops
        .iter()
        .zip(&through)
        .filter(|(_, weight)| **weight > 0.0)
        .map(|(of, weight)| Leak {
            object: of.object,
            low: of.corners.iter().fold(DVec3::INFINITY, |low, p| low.min(*p)).to_array(),
            high: of
                .corners
                .iter()
                .fold(DVec3::NEG_INFINITY, |high, p| high.max(*p))
                .to_array(),
            area: of.area,
            share: weight / escaped,
        })
        .collect();
    leaks.sort_by(|a, b| b.share.total_cmp(&a.share));
    found.leaking = leaks.iter().fold(0.0, |sum, leak| sum + leak.share);
    found.leaks_more = leaks.len().saturating_sub(LEAKS_MAX) as u64;
    leaks.truncate(LEAKS_MAX);
    found.leaks = leaks;
}
