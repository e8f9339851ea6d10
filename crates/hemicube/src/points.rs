//! Rows of sensors: view factors of free points to every patch, the sky and the ground, without a row of any patch.
//!
//! A body at a point absorbs ∫ k(ω) L(ω) dω / ∫ k of what arrives, with the kernel k(ω) in proportion to its area
//! projected along ω. Its view factor to a patch is the integral over the directions in which the patch is seen:
//!
//! ```text
//! plane     k = cos⁺(n, ω) / π                          of a normal n: a side of a cube, a façade, a light meter
//! sphere    k = 1 / 4π                                  every direction alike: solid angle over 4π
//! person    k = Σ w_i cos⁺(n_i, ω) / π                  w = 0.22 for four sides, 0.06 up and down (Höppe 1992;
//!                                                       Thorsson, Lindberg, Eliasson & Holmer 2007): standing
//! cylinder  k = 0.88 sin θ / π² + 0.06 |cos θ| / π      the person turned to all sides: an upright cylinder of height
//!                                                       over radius 7.33, mantle 0.88 of its area
//! ```
//!
//! Hemicubes sum the kernel over pixels ([`crate::delta::DeltaTable`]): one about a plane's normal, two back to back
//! about the way up for sphere and cylinder, six for a person or a cube. Weights of a hemicube sum to 2³¹, in integers.
//! The horizon is then the edge of both hemicubes: what escapes above it is sky, below it ground, without a pixel on
//! both.
//!
//! A patch that shows all pixels of its outline has the closed form from the point: Lambert's contour sum, the solid
//! angle (van Oosterom & Strackee 1983), the contour integral of the mantle. Others have it times their visible share
//! of the outline's weight. What then lacks to 1 is shared among the latter, by the lesser of what is seen and what is
//! hidden of each, and sky, ground and backs, so that every row sums to 1.
//!
//! With a tolerance T, hemicubes of twice the resolution follow, up to the finest, then twice as many of them with
//! other turns, up to [`TURNS_MAX`], until a row changes by T of its Euclidean norm at most, and sky, ground and
//! blocked share by T of the whole. That change is about the error of the coarser of the two; it bounds none, as two may
//! agree by chance. Rows that still change keep their last value, and are counted ([`SensorRow::is_settled`]).
//!
//! Through mirrors and panes, hemicubes are followed as those of patches are ([`crate::portal`]), and rows are of what
//! arrives: Σ F − passed + sky + ground + blocked + cut off = 1. What comes through portals is scaled to what the
//! closed forms of what is seen directly say that they hand on. Images of a cell are added into its patches, and what a
//! tiling's end takes is cut off.
//!
//! A row depends on the scene, the settings and its own sensor: not on others, nor on the number of threads.

mod files;
mod kernel;
mod parallel;
mod view;

pub use files::{Table, write_rows};
pub(crate) use parallel::{in_parallel, threads_of};

use crate::Model;
use crate::backend::{BackendError, HemicubeBackend, RESOLUTIONS, RenderSettings};
use crate::driver::compute::ComputeError;
use crate::frame::{self, Horizon};
use crate::portal::sensors::Follower;
use crate::portal::{Images, Portals};
use glam::DVec3;
use hemicube_scene::InputPatch;
pub(crate) use kernel::Kernel;
use kernel::Tables;
use std::sync::{Mutex, PoisonError};
use view::{Scratch, Sum};

/// Most hemicubes of the finest resolution with a turn each, for one direction of a body.
pub const TURNS_MAX: u32 = 16;
/// Share of the area that each of the four sides of a standing person has (Höppe 1992).
pub const PERSON_SIDE: f64 = 0.22;
/// Share of its upper and of its lower side.
pub const PERSON_END: f64 = 0.06;
/// Shares of the area of a seated person: front and back, left and right, up and down (ISO 7726:1998, annex B).
pub const SEATED: [f64; 3] = [0.30 / 1.40, 0.22 / 1.40, 0.18 / 1.40];
/// Euclidean norm of a row below which nothing is refined.
const NEGLIGIBLE: f64 = 1e-5;

/// The form of a sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Body {
    /// A plane element with this normal, of any length but 0.
    Plane(DVec3),
    /// A small sphere.
    Sphere,
    /// The six sides of a small cube: a row each, east, north, west, south, up, down.
    Cube,
    /// A standing person, by six weighted sides.
    Person,
    /// A seated person, by six weighted sides, who faces along the level part of this direction; anywhere where it is
    /// `None`, or points up or down.
    Seated(Option<DVec3>),
    /// An upright cylinder of a person's proportions.
    Cylinder,
}

impl Body {
    /// Number of rows of a sensor of this form.
    pub fn rows(self) -> usize {
        match self {
            Self::Cube => 6,
            _ => 1,
        }
    }

    /// The parts of each row, by direction, kernel and weight. Weights of a row sum to 1.
    pub(crate) fn parts(self, horizon: &Horizon) -> Vec<Vec<Part>> {
        let plane = |axis: DVec3, weight: f64| Part {
            axis,
            kernel: Kernel::Cosine,
            weight,
        };
        let halves = |kernel: Kernel| {
            vec![horizon.up, -horizon.up]
                .into_iter()
                .map(|axis| Part {
                    axis,
                    kernel,
                    weight: 0.5,
                })
                .collect()
        };
        let sides = sides(horizon);
        match self {
            Self::Plane(normal) => vec![vec![plane(normal, 1.0)]],
            Self::Sphere => vec![halves(Kernel::Solid)],
            Self::Cylinder => vec![halves(Kernel::Upright)],
            Self::Cube => sides.iter().map(|&side| vec![plane(side, 1.0)]).collect(),
            Self::Seated(facing) => {
                let [front, side, end] = SEATED;
                let level = facing.and_then(|facing| level(horizon, facing));
                let around = match level {
                    Some(facing) => {
                        let left = horizon.up.cross(facing);
                        vec![(facing, front), (-facing, front), (left, side), (-left, side)]
                    }
                    None => sides[..4].iter().map(|&axis| (axis, (front + side) / 2.0)).collect(),
                };
                let ends = [(horizon.up, end), (-horizon.up, end)];
                let parts = around.into_iter().chain(ends);
                vec![parts.map(|(axis, weight)| plane(axis, weight)).collect()]
            }
            Self::Person => {
                let weights = [
                    PERSON_SIDE,
                    PERSON_SIDE,
                    PERSON_SIDE,
                    PERSON_SIDE,
                    PERSON_END,
                    PERSON_END,
                ];
                vec![
                    sides
                        .iter()
                        .zip(weights)
                        .map(|(&side, weight)| plane(side, weight))
                        .collect(),
                ]
            }
        }
    }

    /// The kernel k(ω) of each row, per steradian, for a unit vector ω: ∫ k = 1. The horizon counts for both halves of
    /// sphere and cylinder.
    ///
    /// ```
    /// use hemicube::frame::Horizon;
    /// use hemicube::points::Body;
    /// use hemicube_scene::Axis;
    /// use hemicube_spatial::glam::DVec3;
    ///
    /// let horizon = Horizon::new(Axis::Z, 0.0);
    /// let at = |body: Body, direction| body.kernel(&horizon, direction)[0] * std::f64::consts::PI;
    /// assert!((at(Body::Plane(DVec3::Z), DVec3::Z) - 1.0).abs() < 1e-12);
    /// assert!((at(Body::Sphere, DVec3::new(0.6, 0.0, 0.8)) - 0.25).abs() < 1e-12);
    /// // A standing person is broad from the side and narrow from above.
    /// assert!(at(Body::Person, DVec3::X) > 3.0 * at(Body::Person, DVec3::Z));
    /// assert!((at(Body::Cylinder, DVec3::Z) - 0.06).abs() < 1e-12);
    /// ```
    pub fn kernel(self, horizon: &Horizon, direction: DVec3) -> Vec<f64> {
        self.parts(horizon)
            .iter()
            .map(|parts| {
                let of_part = |part: &Part| {
                    let cosine = part.axis.normalize_or_zero().dot(direction);
                    part.weight * part.kernel.density(cosine)
                };
                parts.iter().map(of_part).sum()
            })
            .collect()
    }
}

/// The level part of a direction, of length 1; `None` for one straight up or down.
pub fn level(horizon: &Horizon, direction: DVec3) -> Option<DVec3> {
    let direction = direction.try_normalize()?;
    let level = direction - horizon.up * direction.dot(horizon.up);
    (level.length() > 1e-6).then(|| level.normalize())
}

/// The normals of a cube's sides: east, north, west, south, up, down.
pub fn sides(horizon: &Horizon) -> [DVec3; 6] {
    [
        horizon.east,
        horizon.north,
        -horizon.east,
        -horizon.north,
        horizon.up,
        -horizon.up,
    ]
}

/// A hemicube's share of a body.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Part {
    pub(crate) axis: DVec3,
    pub(crate) kernel: Kernel,
    pub(crate) weight: f64,
}

/// A sensor in the scene's coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sensor {
    /// Its place.
    pub position: DVec3,
    /// Its form.
    pub body: Body,
}

/// Fineness of sensors' rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointOptions {
    /// Settings of the first hemicubes.
    pub render: RenderSettings,
    /// Refine each row until it changes by no more than this share.
    pub tolerance: Option<f64>,
    /// Threads; 0: one a core.
    pub threads: usize,
    /// Rows with patches. Without, they have sky, ground and blocked share alone, by the weights of pixels: outlines and
    /// closed forms of patches are most of the work. Through portals rows have their patches in any case.
    pub patches: bool,
}

impl PointOptions {
    /// The resolutions of the levels: one without a tolerance, otherwise doubled as far as backends go. As many
    /// sessions of a backend are needed.
    ///
    /// ```
    /// use hemicube::backend::{Culling, RenderSettings};
    /// use hemicube::points::PointOptions;
    /// let render = RenderSettings { resolution: 256, culling: Culling::On, covered: false };
    /// let options = PointOptions { render, tolerance: Some(0.01), threads: 0, patches: true };
    /// assert_eq!(options.resolutions(), [256, 512, 1024]);
    /// ```
    pub fn resolutions(&self) -> Vec<u32> {
        let first = self.render.resolution;
        let finer = (1..8).map(|level| first << level);
        let finer = finer.filter(|n| self.tolerance.is_some() && RESOLUTIONS.contains(n));
        std::iter::once(first).chain(finer).collect()
    }
}

/// Pixels along an edge to begin with where no patch is told apart: enough for what a map shows. The book's page on
/// points has the error.
pub const SHARES_RESOLUTION: u32 = 64;

/// The resolution to begin with for rows with patches: 256, or 128 for tolerances that the next level mostly keeps.
pub fn first_resolution(tolerance: Option<f64>) -> u32 {
    match tolerance {
        Some(tolerance) if tolerance >= 0.005 => 128,
        _ => 256,
    }
}

/// A row: Σ `patches` + `sky` + `ground` + `blocked` = 1, within rounding, unless patches are left out
/// ([`PointOptions::patches`]); through portals Σ `patches` − Σ `passed` + `sky` + `ground` + `blocked` + `cut_off`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SensorRow {
    /// Visible patches, ascending, and their view factors.
    pub patches: Vec<(InputPatch, f64)>,
    /// The share that escapes above the horizon.
    pub sky: f64,
    /// The share that escapes below the horizon.
    pub ground: f64,
    /// The share on backs of one-sided patches.
    pub blocked: f64,
    /// The share that each mirror and pane in sight reflects or lets through, ascending by patch; empty without any.
    pub passed: Vec<(InputPatch, f64)>,
    /// The share that is followed no further: after the last portal, or beyond the last repeat of a period.
    pub cut_off: f64,
    /// Change by the last refinement: the larger of that of the row, over its Euclidean norm, and of sky, ground and
    /// blocked share. NaN without a tolerance.
    pub change: f64,
    /// False if it still changed by more than the tolerance at the last refinement.
    pub is_settled: bool,
    /// Hemicubes rendered for it; of a cube, for all six rows.
    pub hemicubes: u32,
}

impl SensorRow {
    /// Σ F² over the patches.
    pub fn squared_norm(&self) -> f64 {
        self.patches.iter().map(|(_, factor)| factor * factor).sum()
    }

    /// ΣF − passed + sky + ground + blocked + cut off.
    pub fn sum(&self) -> f64 {
        let all = |factors: &[(InputPatch, f64)]| factors.iter().map(|(_, factor)| factor).sum::<f64>();
        all(&self.patches) - all(&self.passed) + self.sky + self.ground + self.blocked + self.cut_off
    }

    /// Σ of what mirrors and panes hand on of what arrives there.
    pub fn handed_on(&self) -> f64 {
        self.passed.iter().fold(0.0, |sum, (_, passed)| sum + passed)
    }

    /// The row of what stays where it arrives: of black surfaces, mirrors and panes apart, by what they absorb.
    #[must_use]
    pub fn kept(&self) -> Self {
        let mut kept = self.clone();
        for (patch, passed) in std::mem::take(&mut kept.passed) {
            if let Ok(at) = kept.patches.binary_search_by_key(&patch, |(patch, _)| *patch) {
                let factor = &mut kept.patches[at].1;
                *factor = (*factor - passed).max(0.0);
            }
        }
        kept
    }

    /// Mean radiant temperature in kelvin, T⁴ (1 − cut off) = Σ F_j B_j / σ + sky T_sky⁴ + ground T_ground⁴ + blocked
    /// T_backs⁴, of radiosities B in W/m², one a patch, and `[sky, ground, backs]` in kelvin. The body's absorptance is
    /// its emissivity, and cancels. What is cut off is taken for the mean of the rest. With NaN for backs, they are
    /// left out, too: T⁴ (1 − cut off − blocked) is what the others add up to. So does `solve`, whose patches exchange
    /// nothing with backs.
    ///
    /// ```
    /// use hemicube::InputPatch;
    /// use hemicube::points::SensorRow;
    /// use hemicube::solve::STEFAN_BOLTZMANN;
    ///
    /// // Half of the view is a wall at 320 K, half the sky at 260 K.
    /// let row = SensorRow { patches: vec![(InputPatch(0), 0.5)], sky: 0.5, ..SensorRow::default() };
    /// let t = row.mean_radiant_temperature(&[STEFAN_BOLTZMANN * 320f64.powi(4)], [260.0, 290.0, 290.0]);
    /// assert!((t.powi(4) - 0.5 * (320f64.powi(4) + 260f64.powi(4))).abs() < 1.0);
    ///
    /// // All that is seen at one temperature: so is the body, beside the back of a sheet too.
    /// let row = SensorRow { patches: vec![(InputPatch(0), 0.7)], blocked: 0.3, ..SensorRow::default() };
    /// let t = row.mean_radiant_temperature(&[STEFAN_BOLTZMANN * 291f64.powi(4)], [f64::NAN; 3]);
    /// assert!((t - 291.0).abs() < 1e-9);
    /// ```
    pub fn mean_radiant_temperature(&self, radiosity: &[f64], [sky, ground, backs]: [f64; 3]) -> f64 {
        let of_patch = |&(patch, factor): &(InputPatch, f64)| {
            factor * radiosity.get(patch.0 as usize).copied().unwrap_or(f64::NAN)
        };
        let patches: f64 = self.patches.iter().map(of_patch).sum();
        // Nothing is asked of what is not seen: its temperature may be NaN.
        let of = |share: f64, kelvin: f64| if share > 0.0 { share * kelvin.powi(4) } else { 0.0 };
        let (blocked, left_out) = if backs.is_nan() {
            (0.0, self.blocked)
        } else {
            (of(self.blocked, backs), 0.0)
        };
        let outside = of(self.sky, sky) + of(self.ground, ground) + blocked;
        let seen = 1.0 - self.cut_off.min(0.5) - left_out;
        let fourth = (patches / crate::solve::STEFAN_BOLTZMANN + outside) / seen;
        // NaN must show.
        if fourth < 0.0 { 0.0 } else { fourth.sqrt().sqrt() }
    }
}

/// Change from one row to another, over the norm of the latter.
fn change(before: &SensorRow, after: &SensorRow) -> f64 {
    let mut squared = 0.0;
    let (mut old, mut new) = (before.patches.iter().peekable(), after.patches.iter().peekable());
    loop {
        let difference = match (old.peek(), new.peek()) {
            (Some((p, a)), Some((q, b))) if p == q => {
                old.next();
                new.next();
                b - a
            }
            (Some((p, a)), other) if other.is_none_or(|(q, _)| p < q) => {
                old.next();
                *a
            }
            (_, Some((_, b))) => {
                new.next();
                *b
            }
            _ => break,
        };
        squared += difference * difference;
    }
    let norm = after.squared_norm().sqrt();
    let of_patches = if norm > NEGLIGIBLE { squared.sqrt() / norm } else { 0.0 };
    [
        after.sky - before.sky,
        after.ground - before.ground,
        after.blocked - before.blocked,
    ]
    .into_iter()
    .fold(of_patches, |most, share| most.max(share.abs()))
}

fn failed(backend: &dyn HemicubeBackend, source: BackendError) -> ComputeError {
    ComputeError::Backend {
        backend: backend.info().name.clone(),
        source,
    }
}

/// A level's backend, loaded when first needed, and forked for each thread.
struct Level {
    render: RenderSettings,
    backend: Mutex<(Box<dyn HemicubeBackend>, bool)>,
    tables: Tables,
}

impl Level {
    fn session(&self, model: &Model) -> Result<Box<dyn HemicubeBackend>, ComputeError> {
        let mut loaded = self.backend.lock().unwrap_or_else(PoisonError::into_inner);
        let (backend, is_loaded) = &mut *loaded;
        if !*is_loaded {
            backend
                .load(model.geometry(), self.render)
                .map_err(|error| failed(backend.as_ref(), error))?;
            *is_loaded = true;
        }
        backend.fork().map_err(|error| failed(backend.as_ref(), error))
    }
}

/// The surroundings of sensors: the horizon, and the portals that they see through.
#[derive(Clone, Copy, Debug)]
pub struct Surroundings<'a> {
    /// The way up and north.
    pub horizon: Horizon,
    /// Mirrors, panes, and images of the cell; with images, the model has them, too ([`Images::model`]).
    pub portals: Option<&'a Portals>,
}

impl From<Horizon> for Surroundings<'_> {
    /// Without portals.
    fn from(horizon: Horizon) -> Self {
        Self { horizon, portals: None }
    }
}

/// A thread's state.
struct Worker<'a> {
    model: &'a Model,
    horizon: Horizon,
    images: Option<&'a Images>,
    follower: Option<Follower<'a>>,
    levels: &'a [Level],
    sessions: Vec<Option<Box<dyn HemicubeBackend>>>,
    scratch: Scratch,
    tolerance: Option<f64>,
}

impl Worker<'_> {
    /// The rows of a sensor.
    fn rows(&mut self, sensor: &Sensor) -> Result<Vec<SensorRow>, ComputeError> {
        let parts = sensor.body.parts(&self.horizon);
        let origin = self.model.normalise(sensor.position);
        let mut hemicubes = 0;
        let mut rows: Vec<SensorRow> = Vec::new();
        let finest = self.levels.len() - 1;
        // The levels, then more turns of the finest.
        let mut stages: Vec<(usize, std::ops::Range<u32>)> = (0..=finest).map(|level| (level, 0..1)).collect();
        let mut turns = 1;
        while turns < TURNS_MAX && self.tolerance.is_some() {
            stages.push((finest, turns..2 * turns));
            turns *= 2;
        }
        let mut sums: Vec<Vec<Sum>> = Vec::new();
        for (level, turns) in stages {
            if turns.start == 0 {
                sums = parts.iter().map(|parts| vec![Sum::default(); parts.len()]).collect();
            }
            for (parts, sums) in parts.iter().zip(&mut sums) {
                for (part, sum) in parts.iter().zip(sums) {
                    for turn in turns.clone() {
                        self.add(level, origin, part, turn, sum)?;
                        hemicubes += 1;
                    }
                }
            }
            let mut next = Vec::new();
            for (parts, sums) in parts.iter().zip(&sums) {
                next.push(self.row(origin, parts, sums));
            }
            let is_first = rows.is_empty();
            for (at, row) in next.iter_mut().enumerate() {
                row.change = rows.get(at).map_or(f64::NAN, |before| change(before, row));
                row.is_settled = self.tolerance.is_none_or(|tolerance| row.change <= tolerance);
            }
            rows = next;
            if self.tolerance.is_none() || !is_first && rows.iter().all(|row| row.is_settled) {
                break;
            }
        }
        rows.iter_mut().for_each(|row| row.hemicubes = hemicubes);
        Ok(rows)
    }

    /// Renders a hemicube of a part and adds what it shows.
    fn add(&mut self, level: usize, origin: DVec3, part: &Part, turn: u32, sum: &mut Sum) -> Result<(), ComputeError> {
        if self.sessions[level].is_none() {
            self.sessions[level] = Some(self.levels[level].session(self.model)?);
        }
        let Some(backend) = self.sessions[level].as_mut() else {
            return Ok(());
        };
        // Another turn for each level and each hemicube: other pixels then meet the edges.
        let level_number = u32::try_from(level).unwrap_or(0);
        let turned = frame::turn(InputPatch(level_number * TURNS_MAX + turn));
        let Some(axes) = frame::axes_of(part.axis, turned) else {
            return Err(failed(
                backend.as_ref(),
                BackendError::InvalidArgument("a sensor has a normal without length".to_owned()),
            ));
        };
        let hemicube = crate::backend::Hemicube {
            emitter: None,
            origin,
            axes,
        };
        let items = backend
            .items(&hemicube)
            .map_err(|error| failed(backend.as_ref(), error))?;
        let table = self.levels[level].tables.get(part.kernel);
        let up = self.horizon.up;
        self.scratch
            .add(self.model, &items, table, &hemicube, up, sum)
            .map_err(|error| failed(backend.as_ref(), error))?;
        if let Some(follower) = &mut self.follower {
            let Sum { seen, through, .. } = sum;
            follower.follow(&hemicube, &items, table, up, seen.keys().copied(), through);
        }
        Ok(())
    }

    /// The row of some parts.
    fn row(&mut self, origin: DVec3, parts: &[Part], sums: &[Sum]) -> SensorRow {
        let mut row = SensorRow::default();
        let (mut patches, mut passed) = (Vec::new(), Vec::new());
        for (part, sum) in parts.iter().zip(sums) {
            let seen = self.scratch.factors(self.model, origin, part, sum);
            let weight = part.weight;
            let weighted = |&(patch, factor): &(InputPatch, f64)| (patch, weight * factor);
            patches.extend(seen.patches.iter().map(weighted));
            row.sky += weight * seen.sky;
            row.ground += weight * seen.ground;
            row.blocked += weight * seen.blocked;
            if let Some(follower) = &self.follower {
                let through = Through::new(follower, weight, sum, &seen.patches);
                patches.extend(through.patches);
                passed.extend(through.passed);
                row.sky += through.sky;
                row.ground += through.ground;
                row.blocked += through.blocked;
                row.cut_off += through.cut_off;
            }
        }
        if let Some(images) = self.images {
            row.cut_off += fold(images, &mut patches);
            fold(images, &mut passed);
        }
        if parts.len() > 1 || self.images.is_some() || self.follower.is_some() {
            add_up(&mut patches);
            add_up(&mut passed);
        }
        (row.patches, row.passed) = (patches, passed);
        row
    }
}

/// The addition of portals to a row: patches' factors, the parts reflected or let through, and shares.
#[derive(Default)]
struct Through {
    patches: Vec<(InputPatch, f64)>,
    passed: Vec<(InputPatch, f64)>,
    sky: f64,
    ground: f64,
    blocked: f64,
    cut_off: f64,
}

impl Through {
    /// Scales the view of a body's part through portals to the share that they reflect or let through of `seen`, the
    /// view without portals.
    fn new(follower: &Follower<'_>, weight: f64, sum: &Sum, seen: &[(InputPatch, f64)]) -> Self {
        let arrivals = &sum.through;
        let mut found = Self::default();
        let mut sent = 0.0;
        for &(patch, factor) in seen {
            let of_patch = weight * factor * follower.passed(patch.0, arrivals);
            if of_patch > 0.0 {
                sent += of_patch;
                found.passed.push((patch, of_patch));
            }
        }
        if sent == 0.0 {
            return found;
        }
        if arrivals.sent == 0 {
            // No pixel shows a portal that the closed form sees.
            found.cut_off = sent;
            return found;
        }
        let share = |weight: u64| sent * (weight as f64 / arrivals.sent as f64);
        for (&patch, &[weight, on]) in &arrivals.patches {
            found.patches.push((InputPatch(patch), share(weight)));
            if on > 0 {
                found.passed.push((InputPatch(patch), share(on)));
            }
        }
        let shares = [arrivals.sky, arrivals.ground, arrivals.blocked, arrivals.cut_off];
        [found.sky, found.ground, found.blocked, found.cut_off] = shares.map(share);
        found
    }
}

/// Turns patches of images into the cell's. Returns the sum of those that are curtains, which are left out.
fn fold(images: &Images, factors: &mut Vec<(InputPatch, f64)>) -> f64 {
    let mut cut_off = 0.0;
    factors.retain_mut(|(patch, factor)| {
        let folded = images.fold(patch.0);
        cut_off += if folded.is_some() { 0.0 } else { *factor };
        patch.0 = folded.unwrap_or(patch.0);
        folded.is_some()
    });
    cut_off
}

/// Adds up the factors of equal patches, in their order: ascending patches, once each.
fn add_up(factors: &mut Vec<(InputPatch, f64)>) {
    // Stable: factors of one patch are added in the order of the parts.
    factors.sort_by_key(|(patch, _)| *patch);
    factors.dedup_by(|next, kept| {
        let is_same = next.0 == kept.0;
        kept.1 += if is_same { next.1 } else { 0.0 };
        is_same
    });
}

/// The rows of sensors, [`Body::rows`] each, in order. `keep` turns each row, by its sensor's number, into what is
/// kept: a row of a city has thousands of entries. `sessions` are of one backend, one for each of
/// [`PointOptions::resolutions`]. `progress` is called with the number of sensors done and returns whether to go on;
/// `None` when it returned false.
///
/// # Errors
/// When the backend hands out no item buffers, or fails, or a normal has no length.
///
/// Without portals, a [`Horizon`] is all that is round them.
///
/// ```
/// use hemicube::frame::Horizon;
/// use hemicube::points::{Body, PointOptions, Sensor, rows_of_sensors};
/// use hemicube_backend_cpu::CpuBackend;
/// use hemicube_scene::Axis;
/// use hemicube_spatial::glam::DVec3;
/// # mod room { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/doc/room.rs")); }
/// # let model = room::model_of(&room::squares())?;
///
/// // In the middle between two unit squares at unit distance, each is the face of a cube: a sixth of the sphere.
/// let sensors = [Sensor { position: DVec3::splat(0.5), body: Body::Sphere }];
/// let options = PointOptions { render: room::RENDER, tolerance: None, threads: 0, patches: true };
/// let (horizon, sessions) = (Horizon::new(Axis::Z, 0.0), vec![Box::new(CpuBackend::new()) as _]);
/// let rows = rows_of_sensors(&model, &sensors, horizon, options, sessions, &|_, row| row, &mut |_| true)?;
/// let row = &rows.ok_or("told to stop")?[0];
/// let seen: f64 = row.patches.iter().map(|(_patch, factor)| factor).sum();
/// assert!((seen - 1.0 / 3.0).abs() < 1e-12 && (row.sky - 1.0 / 3.0).abs() < 1e-9 && (row.sum() - 1.0).abs() < 1e-12);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn rows_of_sensors<'a, R: Send>(
    model: &Model,
    sensors: &[Sensor],
    surroundings: impl Into<Surroundings<'a>>,
    options: PointOptions,
    sessions: Vec<Box<dyn HemicubeBackend>>,
    keep: &(impl Fn(usize, SensorRow) -> R + Sync),
    progress: &mut dyn FnMut(usize) -> bool,
) -> Result<Option<Vec<R>>, ComputeError> {
    let levels: Vec<Level> = options
        .resolutions()
        .into_iter()
        .zip(sessions)
        .map(|(resolution, backend)| Level {
            render: RenderSettings {
                resolution,
                covered: false,
                ..options.render
            },
            backend: Mutex::new((backend, false)),
            tables: Tables::new(resolution),
        })
        .collect();
    if levels.is_empty() {
        return Err(ComputeError::Panic {
            message: "rows of sensors without a session of a backend".to_owned(),
        });
    }
    let Surroundings { horizon, portals } = surroundings.into();
    let has_patches = options.patches || portals.is_some_and(|portals| !portals.is_empty());
    let worker = || Worker {
        model,
        horizon,
        images: portals.and_then(|portals| portals.images.as_ref()),
        follower: portals.and_then(|portals| Follower::new(portals, model)),
        levels: &levels,
        sessions: (0..levels.len()).map(|_| None).collect(),
        scratch: Scratch::new(model, has_patches),
        tolerance: options.tolerance,
    };
    let threads = threads_of(options.threads).clamp(1, sensors.len().max(1));
    let workers: Vec<Worker<'_>> = (0..threads).map(|_| worker()).collect();
    let rows = in_parallel(
        sensors.len(),
        workers,
        |worker, index| {
            let rows = worker.rows(&sensors[index])?;
            Ok(rows.into_iter().map(|row| keep(index, row)).collect::<Vec<R>>())
        },
        progress,
    )?;
    Ok(rows.map(|rows| rows.into_iter().flatten().collect()))
}
