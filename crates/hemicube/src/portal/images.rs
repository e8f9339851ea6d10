//! Images of a cell: planes of symmetry, sectors and periods.
//!
//! The model has the cell's patches first, then those of each image in the cell's order: patch p of image k is
//! k n + p, and its column is folded into p. Only the cell has rows. Rows are thus those of the whole scene, at every
//! accuracy level.
//!
//! A tiling ends after some repeats on either side. Rays into further repeats cross a *curtain* round it, as high as
//! the cell's bounds: all repeats together fill a convex prism or slab, and no ray out of it comes back. The columns of
//! curtains become the cut-off part of *unselected*.

use super::motion::Motion;
use crate::geometry;
use crate::{Grouping, HierarchyOptions, Model, ModelError};
use glam::DVec3;
use hemicube_scene::{Axis, Budget, Patches, Scene, Subdivision, Triangle};
use serde_json::Value;
use std::collections::HashMap;
use std::sync::Arc;

/// A plane of symmetry: `axis` = `at`, in the scene's unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Symmetry {
    /// The axis across the plane.
    pub axis: Axis,
    /// Its place along the axis.
    pub at: f64,
}

/// A sector: one of `count` about the coordinate axis through the origin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sector {
    /// The axis.
    pub axis: Axis,
    /// Number of sectors of the ring, from 2.
    pub count: u32,
}

/// A period: the cell lies from `low` to `high` along `axis`, in the scene's unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Period {
    /// The axis.
    pub axis: Axis,
    /// The cell's beginning.
    pub low: f64,
    /// The cell's end, above `low`.
    pub high: f64,
}

/// Planes of symmetry, a sector and periods. Their axes are different ones.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ImageSettings {
    /// Planes of symmetry.
    pub symmetry: Vec<Symmetry>,
    /// The sector.
    pub sector: Option<Sector>,
    /// Periods.
    pub periods: Vec<Period>,
    /// Repeats of the cell on either side along each period; `None`: by `bound`.
    pub repeats: Option<u32>,
    /// The share of a row that may be cut off, where `repeats` is open.
    pub bound: f64,
    /// Memory that the cell with its images may take.
    pub budget: Budget,
}

/// The images of a cell.
#[derive(Clone, Debug)]
pub struct Images {
    settings: ImageSettings,
    cell: Arc<Patches>,
    /// Patches of the cell, n.
    patches: u32,
    /// The cell and its images.
    count: u32,
    repeats: u32,
}

/// Why a cell has no images.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImageError {
    /// An axis is used twice.
    #[error(
        "the {axis} axis has more than one of symmetry, sector and period: two planes of symmetry are a period of \
         twice their distance, with the scene's half and its image as the cell"
    )]
    Twice {
        /// The axis.
        axis: &'static str,
    },
    /// A sector and something across its axis.
    #[error("a sector about {axis} goes with symmetry and period along {axis} alone")]
    AcrossSector {
        /// The sector's axis.
        axis: &'static str,
    },
    /// A number out of range.
    #[error("{what}")]
    Range {
        /// The fault.
        what: String,
    },
    /// Triangles on both sides of a plane.
    #[error(
        "the plane of symmetry {axis} = {at} is crossed: the scene goes from {low} to {high} there; cut it at the \
         plane, and keep one half"
    )]
    Crossed {
        /// The axis across it.
        axis: &'static str,
        /// Its place.
        at: f64,
        /// The scene's least coordinate.
        low: f64,
        /// The scene's largest coordinate.
        high: f64,
    },
    /// A surface in a plane of symmetry that looks away from the scene.
    #[error(
        "a surface of {object} lies in the plane of symmetry {axis} = {at} and looks away from the scene: it is the \
         image of what looks into it there, and would count twice; leave it out (a pane in the plane is a mirror of \
         ρs + τ)"
    )]
    LooksAway {
        /// Its object.
        object: String,
        /// The axis across the plane.
        axis: &'static str,
        /// Its place.
        at: f64,
    },
    /// A surface that is there on both ends of a period or a sector.
    #[error(
        "a surface of {object} is there at both ends of the {what} {axis}: the image of one lies in the place of the \
         other, and would count twice; leave one of them out"
    )]
    Twofold {
        /// Its object.
        object: String,
        /// `period along`, or `sector about`.
        what: &'static str,
        /// The axis.
        axis: &'static str,
    },
    /// Triangles outside the cell.
    #[error(
        "the scene goes from {low} to {high} along {axis}, out of its period of {from} to {to}; cut it there, or give \
         the period that it fills"
    )]
    OutOfCell {
        /// The period's axis.
        axis: &'static str,
        /// The scene's least coordinate.
        low: f64,
        /// The scene's largest coordinate.
        high: f64,
        /// The period's beginning.
        from: f64,
        /// The period's end.
        to: f64,
    },
    /// Triangles outside a sector.
    #[error("the scene takes {degrees:.3} degrees about {axis}, and one of {count} sectors has {most:.3}")]
    OutOfSector {
        /// The sector's axis.
        axis: &'static str,
        /// The scene's angle.
        degrees: f64,
        /// Number of sectors.
        count: u32,
        /// The sector's angle.
        most: f64,
    },
    /// Too many patches.
    #[error(transparent)]
    Patches(#[from] hemicube_scene::Error),
    /// No model.
    #[error(transparent)]
    Model(#[from] ModelError),
}

/// Name and number of an axis.
fn of(axis: Axis) -> (&'static str, usize) {
    match axis {
        Axis::X => ("x", 0),
        Axis::Y => ("y", 1),
        Axis::Z => ("z", 2),
    }
}

/// The axis of a name.
fn named(name: &str) -> Option<Axis> {
    [Axis::X, Axis::Y, Axis::Z].into_iter().find(|&axis| of(axis).0 == name)
}

fn unit(axis: Axis) -> DVec3 {
    DVec3::AXES[of(axis).1]
}

/// Distance of a corner beyond a plane that rounding in files may leave, in parts of the scene's extent.
const BEYOND: f64 = 1e-7;
/// Most sectors of a ring.
const SECTORS_MAX: u32 = 3600;
/// Most repeats on either side.
const REPEATS_MAX: u32 = 1000;
/// Surfaces of a cell with its images at most.
const IMAGES_MAX: u64 = 1 << 23;
/// Bytes of a surface of a cell's images with its tree: 9 GB for the most there may be.
const IMAGE_BYTES: u64 = 1_070;
/// Surfaces up to which repeats are added to keep a bound.
const SURFACES: u64 = 1 << 18;

impl ImageSettings {
    /// Returns whether there is nothing to repeat.
    pub fn is_empty(&self) -> bool {
        self.symmetry.is_empty() && self.sector.is_none() && self.periods.is_empty()
    }

    /// What a matrix's settings record ([`super::PortalRecord`]); `None` where they record no images.
    pub fn of_settings(settings: &Value) -> Option<Self> {
        let record = &settings["portals"];
        let texts = |key: &str| record[key].as_array().into_iter().flatten().filter_map(Value::as_str);
        let symmetry = texts("symmetry").map(|text| {
            let (axis, at) = text.split_once('=')?;
            Some(Symmetry {
                axis: named(axis)?,
                at: at.parse().ok()?,
            })
        });
        let periods = texts("periodic").map(|text| {
            let (axis, range) = text.split_once('=')?;
            let (low, high) = range.split_once("..")?;
            Some(Period {
                axis: named(axis)?,
                low: low.parse().ok()?,
                high: high.parse().ok()?,
            })
        });
        let sector = record["sector"].as_str().map(|text| {
            let (axis, count) = text.split_once(',')?;
            Some(Sector {
                axis: named(axis)?,
                count: count.parse().ok()?,
            })
        });
        let found = Self {
            symmetry: symmetry.collect::<Option<_>>()?,
            sector: sector.flatten(),
            periods: periods.collect::<Option<_>>()?,
            repeats: record["repeats"]
                .as_u64()
                .and_then(|repeats| u32::try_from(repeats).ok()),
            bound: 0.0,
            budget: Budget::default(),
        };
        (!found.is_empty()).then_some(found)
    }

    fn check(&self, low: DVec3, high: DVec3) -> Result<(), ImageError> {
        let range = |what: String| Err(ImageError::Range { what });
        let slack = BEYOND * (high - low).max_element();
        let mut used = [false; 3];
        let sector = self.sector.map(|sector| sector.axis);
        let axes = self.symmetry.iter().map(|plane| plane.axis);
        for axis in axes.chain(self.periods.iter().map(|period| period.axis)) {
            let (name, place) = of(axis);
            if std::mem::replace(&mut used[place], true) {
                return Err(ImageError::Twice { axis: name });
            }
            if let Some(about) = sector.filter(|&about| about != axis) {
                return Err(ImageError::AcrossSector { axis: of(about).0 });
            }
        }
        for &Symmetry { axis, at } in &self.symmetry {
            let (name, k) = of(axis);
            if !at.is_finite() || low[k] < at - slack && high[k] > at + slack {
                return Err(ImageError::Crossed {
                    axis: name,
                    at,
                    low: low[k],
                    high: high[k],
                });
            }
        }
        for period in &self.periods {
            let (axis, k) = of(period.axis);
            let (from, to) = (period.low, period.high);
            if !(from.is_finite() && to.is_finite() && from < to) {
                return range(format!("a period from {from} to {to} along {axis} has no length"));
            }
            if low[k] < from - slack || high[k] > to + slack {
                return Err(ImageError::OutOfCell {
                    axis,
                    low: low[k],
                    high: high[k],
                    from,
                    to,
                });
            }
        }
        match (self.sector, self.repeats) {
            (Some(Sector { count, .. }), _) if !(2..=SECTORS_MAX).contains(&count) => {
                range(format!("{count} sectors are no ring: give 2 to {SECTORS_MAX}"))
            }
            (_, Some(repeats)) if repeats > REPEATS_MAX => {
                range(format!("{repeats} repeats are too many: give up to {REPEATS_MAX}"))
            }
            _ => Ok(()),
        }
    }

    /// Refuses surfaces of which an image lies in the place of a surface of the cell and looks where that does: they
    /// would count twice. Those that are `two_sided` look both ways. `name` gives a surface's object.
    fn check_twice(
        &self,
        surfaces: &[[DVec3; 3]],
        two_sided: &[bool],
        name: impl Fn(usize) -> String,
    ) -> Result<(), ImageError> {
        let corners = || surfaces.iter().flatten();
        let low = corners().fold(DVec3::INFINITY, |low, &p| low.min(p));
        let high = corners().fold(DVec3::NEG_INFINITY, |high, &p| high.max(p));
        let slack = BEYOND * (high - low).max_element();
        for &Symmetry { axis, at } in &self.symmetry {
            let (axis, k) = of(axis);
            // The sign of what looks at the scene; 0 if all of it lies in the plane.
            let inwards = (high[k] + low[k] - 2.0 * at).signum() * f64::from(u8::from(high[k] - low[k] > slack));
            let looks_away = |(corners, &two_sided): (&[DVec3; 3], &bool)| {
                let lies_in = corners.iter().all(|p| (p[k] - at).abs() <= slack);
                lies_in && inwards != 0.0 && (two_sided || geometry::cross(corners)[k] * inwards < 0.0)
            };
            if let Some(surface) = surfaces.iter().zip(two_sided).position(looks_away) {
                let object = name(surface);
                return Err(ImageError::LooksAway { object, axis, at });
            }
        }
        let ends = self.periods.iter().map(|period| {
            let step = (period.high - period.low) * unit(period.axis);
            (Motion::translation(step), "period along", of(period.axis).0)
        });
        let turn = self.sector.map(|Sector { axis, count }| {
            let (sine, cosine) = (std::f64::consts::TAU / f64::from(count)).sin_cos();
            (Motion::rotation(unit(axis), cosine, sine), "sector about", of(axis).0)
        });
        for (motion, what, axis) in ends.chain(turn) {
            if let Some(surface) = image_in_place(surfaces, two_sided, &motion, slack) {
                let object = name(surface);
                return Err(ImageError::Twofold { object, what, axis });
            }
        }
        Ok(())
    }

    /// Holds the corners against a sector.
    fn check_sector(&self, surfaces: &[[DVec3; 3]]) -> Result<(), ImageError> {
        let Some(Sector { axis, count }) = self.sector else {
            return Ok(());
        };
        let k = of(axis).1;
        let (u, v) = ((k + 1) % 3, (k + 2) % 3);
        let corners = surfaces.iter().flatten();
        let largest = corners.clone().map(|p| p[u].hypot(p[v])).fold(0.0, f64::max);
        let off_axis = corners.filter(|p| p[u].hypot(p[v]) > BEYOND * largest);
        let mut angles: Vec<f64> = off_axis.map(|p| p[v].atan2(p[u])).collect();
        angles.sort_unstable_by(f64::total_cmp);
        let around = angles.first().map(|first| first + std::f64::consts::TAU);
        let next = angles.iter().skip(1).copied().chain(around);
        let gap = angles.iter().zip(next).map(|(a, b)| b - a).fold(0.0, f64::max);
        let (angle, most) = (std::f64::consts::TAU - gap, std::f64::consts::TAU / f64::from(count));
        if angles.is_empty() || angle <= most + 10.0 * BEYOND {
            return Ok(());
        }
        Err(ImageError::OutOfSector {
            axis: of(axis).0,
            degrees: angle.to_degrees(),
            count,
            most: most.to_degrees(),
        })
    }

    /// The repeats on either side: as asked for, or the least to keep the bound, within [`SURFACES`].
    ///
    /// The bound is on what the middle of the cell sees of the curtains with nothing in between. Along one period with
    /// sides w and h, a curtain at distance D takes at most w h max(w, h) / (2 π D³) of what leaves the cell's sides or
    /// its floor; along two, ring-like curtains take h / D of what leaves a wall.
    fn repeats(&self, low: DVec3, high: DVec3, surfaces: u64) -> u32 {
        if self.periods.is_empty() {
            return 0;
        }
        if let Some(repeats) = self.repeats {
            return repeats;
        }
        let is_period = |k: usize| self.periods.iter().any(|period| of(period.axis).1 == k);
        let sides: Vec<f64> = (0..3).filter(|&k| !is_period(k)).map(|k| high[k] - low[k]).collect();
        let bound = self.bound.max(1e-9);
        let distance = match *sides {
            [w, h] => (w * h * w.max(h) / (std::f64::consts::PI * bound)).cbrt(),
            [h] => h / bound,
            _ => f64::INFINITY,
        };
        let shortest = self
            .periods
            .iter()
            .map(|period| period.high - period.low)
            .fold(f64::INFINITY, f64::min);
        let wanted = (distance / shortest).ceil().clamp(1.0, f64::from(REPEATS_MAX));
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
        let wanted = wanted as u32;
        let fits = |repeats: &u32| self.count(*repeats).saturating_mul(surfaces) <= SURFACES;
        (1..=wanted).rev().find(fits).unwrap_or(1)
    }

    /// The number of motions.
    fn count(&self, repeats: u32) -> u64 {
        let tiles = u64::from(2 * repeats + 1).saturating_pow(u32::try_from(self.periods.len()).unwrap_or(3));
        let sectors = self.sector.map_or(1, |sector| u64::from(sector.count));
        tiles.saturating_mul(sectors) << self.symmetry.len()
    }

    /// The motions of the cell's images; the identity first.
    fn motions(&self, repeats: u32) -> Vec<Motion> {
        let mut motions = vec![Motion::IDENTITY];
        let times = |motions: &mut Vec<Motion>, others: &[Motion]| {
            let further: Vec<Motion> = others
                .iter()
                .flat_map(|other| motions.iter().map(|motion| other.after(motion)))
                .collect();
            motions.extend(further);
        };
        for &Symmetry { axis, at } in &self.symmetry {
            times(&mut motions, &[Motion::reflection(unit(axis), at)]);
        }
        if let Some(Sector { axis, count }) = self.sector {
            let turns: Vec<Motion> = (1..count)
                .map(|k| {
                    let (sine, cosine) = (std::f64::consts::TAU * f64::from(k) / f64::from(count)).sin_cos();
                    Motion::rotation(unit(axis), cosine, sine)
                })
                .collect();
            times(&mut motions, &turns);
        }
        for period in &self.periods {
            let step = (period.high - period.low) * unit(period.axis);
            let shifts: Vec<Motion> = (1..=repeats)
                .flat_map(|k| [f64::from(k), -f64::from(k)])
                .map(|k| Motion::translation(step * k))
                .collect();
            times(&mut motions, &shifts);
        }
        motions
    }

    /// The curtains of a tiling, seen from within.
    fn curtains(&self, low: DVec3, high: DVec3, repeats: u32) -> Vec<[DVec3; 3]> {
        let (mut low, mut high) = (low, high);
        for &Symmetry { axis, at } in &self.symmetry {
            let k = of(axis).1;
            (low[k], high[k]) = (low[k].min(2.0 * at - high[k]), high[k].max(2.0 * at - low[k]));
        }
        if let Some(Sector { axis, .. }) = self.sector {
            let k = of(axis).1;
            let (u, v) = ((k + 1) % 3, (k + 2) % 3);
            let radius = low[u].abs().max(high[u].abs()).hypot(low[v].abs().max(high[v].abs()));
            for side in [u, v] {
                (low[side], high[side]) = (-radius, radius);
            }
        }
        for period in &self.periods {
            let k = of(period.axis).1;
            let reach = f64::from(repeats) * (period.high - period.low);
            (low[k], high[k]) = (period.low - reach, period.high + reach);
        }
        let mut curtains = Vec::new();
        for period in &self.periods {
            let k = of(period.axis).1;
            let (u, v) = ((k + 1) % 3, (k + 2) % 3);
            if !(high[u] > low[u] && high[v] > low[v]) {
                continue;
            }
            for (at, is_low) in [(low[k], true), (high[k], false)] {
                let corner = |a: f64, b: f64| {
                    let mut p = DVec3::ZERO;
                    (p[k], p[u], p[v]) = (at, a, b);
                    p
                };
                let (a, b) = (corner(low[u], low[v]), corner(high[u], low[v]));
                let (c, d) = (corner(high[u], high[v]), corner(low[u], high[v]));
                // u × v looks along the axis: inwards at the low end.
                curtains.extend(if is_low {
                    [[a, b, c], [a, c, d]]
                } else {
                    [[a, c, b], [a, d, c]]
                });
            }
        }
        curtains
    }
}

/// The first surface whose image lies where a surface is that looks the same way, corner by corner.
fn image_in_place(surfaces: &[[DVec3; 3]], two_sided: &[bool], motion: &Motion, slack: f64) -> Option<usize> {
    // Corners rounded and sorted: a pair that rounds apart is not found, and counts twice as it would without a search.
    let key = |corners: &[DVec3; 3]| {
        #[allow(clippy::cast_possible_truncation, reason = "extents over 10⁻⁵ of an extent")]
        let mut key = corners.map(|p| (p / (100.0 * slack)).round().to_array().map(|x| x as i64));
        key.sort_unstable();
        key
    };
    let mut places: HashMap<[[i64; 3]; 3], Vec<usize>> = HashMap::new();
    for (place, corners) in surfaces.iter().enumerate() {
        places.entry(key(corners)).or_default().push(place);
    }
    (0..surfaces.len()).find(|&surface| {
        let image = motion.triangle(surfaces[surface]);
        let across = geometry::cross(&image);
        let others = places.get(&key(&image)).into_iter().flatten();
        let mut alike = others.filter(|&&other| {
            two_sided[surface] || two_sided[other] || geometry::cross(&surfaces[other]).dot(across) > 0.0
        });
        alike.next().is_some()
    })
}

impl PartialEq for Images {
    /// One cell's.
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.cell, &other.cell) && self.settings == other.settings && self.repeats == other.repeats
    }
}

impl Images {
    /// The model of a cell and its images. `patches` are the cell's, of `scene`.
    ///
    /// # Errors
    /// When the scene does not lie within the planes, the sector or the period, or the images are too many.
    pub fn model(
        settings: ImageSettings,
        scene: &Scene,
        patches: &Arc<Patches>,
        hierarchy: HierarchyOptions,
    ) -> Result<(Model, Self), ImageError> {
        let surfaces = patches.surfaces();
        let corners = || surfaces.iter().flatten();
        let low = corners().fold(DVec3::INFINITY, |low, &p| low.min(p));
        let high = corners().fold(DVec3::NEG_INFINITY, |high, &p| high.max(p));
        settings.check(low, high)?;
        settings.check_sector(surfaces)?;
        let repeats = settings.repeats(low, high, surfaces.len() as u64);
        let mut two_sided = vec![false; surfaces.len()];
        for patch in patches.iter() {
            two_sided[patches.surface(patch)] = scene.triangles[patches.triangle(patch)].two_sided;
        }
        settings.check_twice(surfaces, &two_sided, |surface| {
            let patch = patches.iter().find(|&patch| patches.surface(patch) == surface);
            let object = patch.map(|patch| scene.triangles[patches.triangle(patch)].object as usize);
            let name = object.and_then(|object| scene.objects.get(object));
            let name = name.filter(|name| !name.is_empty());
            name.map_or_else(|| "the scene".to_owned(), |name| format!("`{name}`"))
        })?;
        let of = |corners: [DVec3; 3], two_sided: bool| Triangle {
            corners,
            object: 0,
            material: 0,
            face: 0,
            two_sided,
        };
        let images = settings.count(repeats);
        let triangles = images.saturating_mul(surfaces.len() as u64);
        if triangles > IMAGES_MAX {
            return Err(ImageError::Range {
                what: format!(
                    "{images} images of {} triangles are more than the {IMAGES_MAX} triangles that a scene with images \
                     may have: give fewer repeats",
                    surfaces.len()
                ),
            });
        }
        let room = settings.budget.require(
            triangles.saturating_mul(IMAGE_BYTES),
            format!("a scene of {images} images of {} triangles", surfaces.len()),
        );
        room.map_err(|refused| ImageError::Range {
            what: format!(
                "{refused}: give fewer repeats, or allow {} MB of memory",
                refused.megabytes()
            ),
        })?;
        let motions = settings.motions(repeats);
        let mut triangles = Vec::with_capacity(surfaces.len() * motions.len() + 12);
        for motion in &motions {
            let image = surfaces.iter().zip(&two_sided);
            triangles.extend(image.map(|(&corners, &two_sided)| of(motion.triangle(corners), two_sided)));
        }
        triangles.extend(
            settings
                .curtains(low, high, repeats)
                .into_iter()
                .map(|corners| of(corners, false)),
        );
        let whole = Scene {
            triangles,
            ..Scene::default()
        };
        let all = Patches::new(&whole, Subdivision::None)?;
        let model = Model::new(all.into(), hierarchy)?;
        let number = |count: usize| u32::try_from(count).unwrap_or(u32::MAX);
        let images = Self {
            settings,
            patches: number(patches.len()),
            count: number(motions.len()),
            cell: Arc::clone(patches),
            repeats,
        };
        Ok((model, images))
    }

    /// The cell's patches.
    pub fn cell(&self) -> &Arc<Patches> {
        &self.cell
    }

    /// Returns whether a point lies in the cell's period along every period's axis: beyond it a tiling is not as far on
    /// one side as on the other.
    pub fn holds(&self, point: DVec3) -> bool {
        let is_within = |period: &Period| (period.low..=period.high).contains(&point[of(period.axis).1]);
        self.settings.periods.iter().all(is_within)
    }

    /// The cell and its images together.
    pub fn count(&self) -> u32 {
        self.count
    }

    /// The patch of the cell that a patch of the model is an image of; `None` for a curtain.
    pub fn fold(&self, patch: u32) -> Option<u32> {
        (u64::from(patch) < u64::from(self.patches) * u64::from(self.count)).then(|| patch % self.patches)
    }

    /// The grouping of a model's elements by that of the cell's; each curtain is a patch of its own.
    pub(crate) fn grouping(&self, of_cell: &Grouping, elements: u32) -> Grouping {
        of_cell.of_images(elements, |element| self.fold(element))
    }

    /// Returns whether something is cut off.
    pub fn has_curtains(&self) -> bool {
        !self.settings.periods.is_empty()
    }

    /// Repeats of the cell on either side, with periods.
    pub fn repeats(&self) -> Option<u32> {
        self.has_curtains().then_some(self.repeats)
    }

    pub(super) fn symmetry_text(&self) -> Vec<String> {
        let text = |plane: &Symmetry| format!("{}={}", of(plane.axis).0, plane.at);
        self.settings.symmetry.iter().map(text).collect()
    }

    pub(super) fn sector_text(&self) -> Option<String> {
        self.settings
            .sector
            .map(|sector| format!("{},{}", of(sector.axis).0, sector.count))
    }

    pub(super) fn periods_text(&self) -> Vec<String> {
        let text = |period: &Period| format!("{}={}..{}", of(period.axis).0, period.low, period.high);
        self.settings.periods.iter().map(text).collect()
    }
}
