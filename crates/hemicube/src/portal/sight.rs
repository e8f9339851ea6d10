//! What a hemicube or a point sees through mirrors and panes: where rays end that meet a portal first.
//!
//! Pixels of an item buffer that show a portal are followed, each by the ray through its centre with the pixel's
//! weight. A sun is seen in the directions that lead to it: its own, through panes, and those reflected in up to
//! [`MIRRORS`] planes of mirrors, in any order.

use super::motion::{Motions, OTHER};
use super::trace::{Arrival, Ends, Ray, Tally, Tracer};
use super::{Images, Specular};
use crate::Model;
use crate::backend::Hemicube;
use crate::bvh::Tree;
use crate::delta::DeltaTable;
use crate::face::{Face, Items};
use crate::geometry::Plane;
use glam::DVec3;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};

/// Parts of a pixel's unit of weight.
const FINE: u64 = 1 << 10;
/// The weight of a ray to a sun.
const BEAM: u64 = 1 << 40;
/// Mirrors that a beam meets at most, one after the other.
pub const MIRRORS: usize = 3;
/// Directions that may lead to a sun, at most. With more planes of mirrors, fewer reflections are followed.
const DIRECTIONS_MAX: usize = 1024;
/// Directions nearer to each other than this are one: far above rounding, far below the sun's disk.
const SAME: f64 = 1e-9;
/// Legs of a hemicube's rays, and of a point's rays to a sun.
const LEGS: u64 = 1 << 22;

/// The end of a path that went through a portal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PathEnd {
    /// It arrives at a patch of the model, which hands `passed` of the weight on.
    Patch {
        /// The patch.
        patch: u32,
        /// The weight handed on.
        passed: u64,
    },
    /// It leaves the scene in this direction, of length 1.
    Nothing(DVec3),
    /// The back of a one-sided patch.
    Back,
    /// It is not followed further.
    CutOff,
}

/// Rays through the mirrors and panes of a model; one a thread.
#[derive(Debug)]
pub struct ThroughPortals {
    tracer: Tracer,
    motions: Motions,
    bound: f64,
    /// Normals of the planes of mirrors, one of each, the largest first.
    mirrors: Vec<DVec3>,
    /// True if there are more planes of mirrors than that.
    has_more: bool,
}

/// Calls back with the ends of paths.
struct Told<F> {
    act: F,
    /// Weight of first arrivals handed on.
    sent: u64,
}

impl<F: FnMut(PathEnd, u64)> Tally for Told<F> {
    fn arrive(&mut self, ray: &Ray, arrival: &Arrival) {
        if ray.passes == 0 {
            self.sent += arrival.passed;
            return;
        }
        let end = match arrival.patch {
            Some(patch) => PathEnd::Patch {
                patch,
                passed: arrival.passed,
            },
            None => PathEnd::Back,
        };
        (self.act)(end, ray.weight);
    }

    fn escape(&mut self, ray: &Ray) {
        if ray.passes > 0 {
            (self.act)(PathEnd::Nothing(ray.towards), ray.weight);
        }
    }

    fn cut(&mut self, _ray: &Ray, weight: u64) {
        (self.act)(PathEnd::CutOff, weight);
    }
}

/// Calls back with arrivals behind the first portal.
struct Arrived<F>(F);

impl<F: FnMut(u32, DVec3, f64)> Tally for Arrived<F> {
    fn arrive(&mut self, ray: &Ray, arrival: &Arrival) {
        if let (Some(patch), true) = (arrival.patch, ray.passes > 0) {
            (self.0)(patch, arrival.at, ray.weight as f64 / BEAM as f64);
        }
    }

    fn escape(&mut self, _ray: &Ray) {}

    fn cut(&mut self, _ray: &Ray, _weight: u64) {}
}

/// Sums what reaches a sun.
struct Beam {
    sun: DVec3,
    reached: u64,
}

impl Tally for Beam {
    fn arrive(&mut self, _ray: &Ray, _arrival: &Arrival) {}

    fn escape(&mut self, ray: &Ray) {
        if (ray.towards - self.sun).length_squared() < SAME * SAME {
            self.reached += ray.weight;
        }
    }

    fn cut(&mut self, _ray: &Ray, _weight: u64) {}
}

/// Collects the directions in which a ray leaves the scene, and their parts of its weight.
struct Left(Vec<(DVec3, f64)>);

impl Tally for Left {
    fn arrive(&mut self, _ray: &Ray, _arrival: &Arrival) {}

    fn escape(&mut self, ray: &Ray) {
        self.0.push((ray.towards, ray.weight as f64 / BEAM as f64));
    }

    fn cut(&mut self, _ray: &Ray, _weight: u64) {}
}

impl ThroughPortals {
    /// Mirrors and panes of a model, which has `images` of a cell.
    pub fn new(specular: &Specular, images: Option<&Images>, model: &Model) -> Self {
        let laws = specular.laws(images, model.geometry().patch_count);
        // By their areas: where there are too many, the smallest are left out, whatever their order in the scene.
        let mut planes: BTreeMap<[i64; 3], (DVec3, f64)> = BTreeMap::new();
        for (patch, optics) in (0u32..).zip(&laws.means) {
            if optics.specular <= 0.0 {
                continue;
            }
            let cross = crate::geometry::cross(&model.normalised_corners(patch));
            let Some(normal) = cross.try_normalize() else {
                continue;
            };
            // Planes that rounding sets apart lead to directions that are one again.
            #[allow(clippy::cast_possible_truncation, reason = "parts of a unit vector")]
            let key = (normal / SAME).to_array().map(|part| part.round() as i64);
            let plane = planes
                .entry(key.max(key.map(i64::wrapping_neg)))
                .or_insert((normal, 0.0));
            plane.1 += cross.length();
        }
        let mut planes: Vec<(DVec3, f64)> = planes.into_values().collect();
        planes.sort_by(|(_, area), (_, other)| other.total_cmp(area));
        let has_more = planes.len() > DIRECTIONS_MAX;
        planes.truncate(DIRECTIONS_MAX);
        let mirrors = planes.into_iter().map(|(normal, _)| normal).collect();
        Self {
            tracer: Tracer::new(Tree::of(model.geometry()), laws),
            motions: Motions::default(),
            bound: specular.bound,
            mirrors,
            has_more,
        }
    }

    /// Follows the pixels of a hemicube that show a portal. `act` is told the end of every path behind the first portal
    /// and its weight in 1024ths of a pixel's; ends at patches are told before their paths go on. Returns the weight
    /// that first portals handed on: ends at patches less what these pass on, and the other ends, sum to it. Once `stop`
    /// is true, no further pixels are followed.
    pub fn look(
        &mut self,
        hemicube: &Hemicube,
        items: &Items,
        table: &DeltaTable,
        stop: &AtomicBool,
        act: impl FnMut(PathEnd, u64),
    ) -> u64 {
        self.motions.begin();
        self.tracer.legs = 0;
        self.tracer.legs_max = LEGS;
        let mut told = Told { act, sent: 0 };
        for (_, face, x, y, towards) in self.pixels(hemicube, items) {
            if stop.load(Ordering::Relaxed) {
                break;
            }
            let weight = u64::from(table.weight(face, x, y)) * FINE;
            let ray = first(hemicube.origin, towards, hemicube.axes[2], weight);
            let ends = self.ends(weight);
            self.tracer.follow(ray, ends, &mut self.motions, &mut told);
        }
        told.sent
    }

    /// Pixels that show a portal: place in the item buffer, face, column, row, and the direction of the centre.
    fn pixels(&self, hemicube: &Hemicube, items: &Items) -> Vec<(usize, Face, u32, u32, DVec3)> {
        let resolution = items.resolution;
        let step = 2.0 / f64::from(resolution);
        let mut found = Vec::new();
        let mut seen = items.seen.iter().enumerate();
        for face in Face::ALL {
            let (places, signs) = face.axes();
            let [u, v, w]: [DVec3; 3] = std::array::from_fn(|k| hemicube.axes[places[k]] * signs[k]);
            let up = if face.is_top() { 1.0 } else { 0.0 };
            for y in 0..face.rows(resolution) {
                for x in 0..resolution {
                    let Some((place, &patch)) = seen.next() else { continue };
                    let optics = self.tracer.optics.get(patch as usize);
                    if !optics.is_some_and(super::Optics::is_portal) {
                        continue;
                    }
                    let (a, b) = ((f64::from(x) + 0.5) * step - 1.0, (f64::from(y) + 0.5) * step - up);
                    if let Some(towards) = (w + u * a + v * b).try_normalize() {
                        found.push((place, face, x, y, towards));
                    }
                }
            }
        }
        found
    }

    /// Where paths of this weight end.
    fn ends(&self, weight: u64) -> Ends {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share")]
        let least = (weight as f64 * self.bound) as u64;
        Ends {
            reach: f64::INFINITY,
            least,
            only: None,
        }
    }

    /// The end behind a portal that most of each pixel's weight comes to, of the pixels that show one.
    pub fn brightest(&mut self, hemicube: &Hemicube, items: &Items) -> Vec<Option<PathEnd>> {
        let mut found = vec![None; items.seen.len()];
        self.motions.begin();
        self.tracer.legs_max = LEGS;
        for (place, _, _, _, towards) in self.pixels(hemicube, items) {
            let mut most = 0;
            let act = |end: PathEnd, weight: u64| {
                let kept = match end {
                    PathEnd::Patch { passed, .. } => weight - passed,
                    _ => weight,
                };
                if kept > most {
                    (most, found[place]) = (kept, Some(end));
                }
            };
            let mut told = Told { act, sent: 0 };
            self.tracer.legs = 0;
            let ray = first(hemicube.origin, towards, hemicube.axes[2], BEAM);
            let ends = self.ends(BEAM);
            self.tracer.follow(ray, ends, &mut self.motions, &mut told);
        }
        found
    }

    /// Follows a ray from a free point that meets a portal first. `act` is told the patches at which it arrives behind
    /// that, where, and with what share of its weight; all in normalised coordinates.
    pub fn ray(&mut self, from: DVec3, towards: DVec3, act: impl FnMut(u32, DVec3, f64)) {
        self.begin();
        let ray = first(from, towards, towards, BEAM);
        let ends = self.ends(BEAM);
        self.tracer.follow(ray, ends, &mut self.motions, &mut Arrived(act));
    }

    /// The irradiance at a point of a surface from a sun of 1 on a plane across its beam: Σ w cos θ over the directions
    /// in which the sun is seen, w what panes let through and mirrors reflect. `from` is in normalised coordinates,
    /// `normal` the surface's and `sun` the direction towards the sun, both of length 1.
    pub fn sunlight(&mut self, from: DVec3, normal: DVec3, sun: DVec3) -> f64 {
        self.begin();
        let mut sum = 0.0;
        for towards in self.directions(sun) {
            let cosine = normal.dot(towards);
            if cosine > 0.0 {
                sum += cosine * self.reached(from, towards, normal, sun);
            }
        }
        sum
    }

    /// The directions in which a sun is seen from a free point, and the share of its light that comes from each:
    /// through panes, and off mirrors. `from` is in normalised coordinates, `sun` the direction towards the sun, of
    /// length 1.
    pub fn suns(&mut self, from: DVec3, sun: DVec3) -> Vec<(DVec3, f64)> {
        self.begin();
        let mut found = Vec::new();
        for towards in self.directions(sun) {
            let share = self.reached(from, towards, towards, sun);
            if share > 0.0 {
                found.push((towards, share));
            }
        }
        found
    }

    /// The directions in which a ray from a free point leaves the scene, and the parts of its weight that do. `from` is
    /// in normalised coordinates, `towards` of length 1.
    pub fn leaving(&mut self, from: DVec3, towards: DVec3) -> Vec<(DVec3, f64)> {
        self.begin();
        let mut left = Left(Vec::new());
        let ends = self.ends(BEAM);
        let ray = first(from, towards, towards, BEAM);
        self.tracer.follow(ray, ends, &mut self.motions, &mut left);
        left.0
    }

    fn begin(&mut self) {
        (self.tracer.legs, self.tracer.legs_max) = (0, LEGS);
        self.motions.begin();
    }

    /// The share of a ray that leaves a point of a surface with this normal and reaches the sun.
    fn reached(&mut self, from: DVec3, towards: DVec3, normal: DVec3, sun: DVec3) -> f64 {
        let mut beam = Beam { sun, reached: 0 };
        let ends = self.ends(BEAM);
        let ray = first(from, towards, normal, BEAM);
        self.tracer.follow(ray, ends, &mut self.motions, &mut beam);
        beam.reached as f64 / BEAM as f64
    }

    /// Returns whether a sun is reflected in more directions than are followed: off so many planes of mirrors.
    pub fn leaves_out_reflections(&self) -> bool {
        self.has_more || self.directions_and_rest(DVec3::new(0.36, 0.48, 0.8)).1
    }

    /// The directions that may lead to a sun: its own, and those reflected in up to [`MIRRORS`] planes.
    fn directions(&self, sun: DVec3) -> Vec<DVec3> {
        self.directions_and_rest(sun).0
    }

    /// The directions, and whether there are others.
    fn directions_and_rest(&self, sun: DVec3) -> (Vec<DVec3>, bool) {
        let mut found = vec![sun];
        let (mut begin, mut leaves_out) = (0, false);
        for _ in 0..MIRRORS {
            let end = found.len();
            if (end - begin).saturating_mul(self.mirrors.len()) > DIRECTIONS_MAX * MIRRORS {
                leaves_out = true;
                break;
            }
            for at in begin..end {
                for &normal in &self.mirrors {
                    let towards = found[at];
                    let reflected = (towards - 2.0 * normal.dot(towards) * normal).normalize();
                    let is_known = |other: &DVec3| (*other - reflected).length_squared() < SAME * SAME;
                    if found.iter().any(is_known) {
                        continue;
                    }
                    if found.len() < DIRECTIONS_MAX {
                        found.push(reflected);
                    } else {
                        leaves_out = true;
                    }
                }
            }
            begin = end;
        }
        (found, leaves_out)
    }
}

/// A ray that leaves a surface.
fn first(from: DVec3, towards: DVec3, normal: DVec3, weight: u64) -> Ray {
    Ray {
        from,
        towards,
        horizon: Plane {
            normal,
            offset: normal.dot(from),
        },
        weight,
        passes: 0,
        motion: OTHER,
        length: 0.0,
    }
}
