//! The contract between the driver and a backend: hemicubes in, rows of integer weights out.
//!
//! Rules of a backend, checked by the driver on every row, in release builds, too (see [`crate::row`]):
//!
//! 1. `visible` weights, `escaped` and `blocked` of a hemicube sum to exactly [`WHOLE`].
//! 2. Patches of a row are strictly ascending and below the scene's patch count.
//! 3. A row depends on the scene, the settings and its own hemicube: not on its place in a batch, on earlier calls,
//!    on culling, or on the number of sessions.
//! 4. Of two surfaces at the same depth, the smaller patch id wins; the back of a one-sided patch loses to any
//!    patch.
//! 5. The emitter's own surface is never seen, from either side.
//!
//! A complete backend, for scenes without anything to render: two patches seeing nothing but each other.
//!
//! ```
//! use hemicube_contract::InputPatch;
//! use hemicube_contract::backend::*;
//! use hemicube_contract::row::RowBlock;
//! use hemicube_spatial::{Aabb, Octree, OctreeOptions, glam::DVec3};
//! use std::sync::Arc;
//!
//! struct Vis(BackendInfo, u32);
//!
//! impl HemicubeBackend for Vis {
//!     fn info(&self) -> &BackendInfo {
//!         &self.0
//!     }
//!
//!     fn load(&mut self, geometry: &Arc<Geometry>, _settings: RenderSettings) -> Result<(), BackendError> {
//!         self.1 = geometry.patch_count;
//!         if self.1 == 2 { Ok(()) } else { Err(BackendError::Unsupported(format!("{} patches", self.1))) }
//!     }
//!
//!     fn fork(&self) -> Result<Box<dyn HemicubeBackend>, BackendError> {
//!         Ok(Box::new(Self(self.0.clone(), self.1)))
//!     }
//!
//!     fn rows(&mut self, hemicubes: &[Hemicube], out: &mut RowBlock) -> Result<Counters, BackendError> {
//!         for hemicube in hemicubes {
//!             let Some(InputPatch(emitter @ 0..2)) = hemicube.emitter else {
//!                 return Err(BackendError::InvalidArgument("no such patch".to_owned()));
//!             };
//!             out.push(InputPatch(1 - emitter), WHOLE, 0);
//!             out.end_row(0, 0);
//!         }
//!         Ok(Counters { hemicubes: hemicubes.len() as u64, ..Counters::default() })
//!     }
//! }
//! # let corners = [[DVec3::ZERO, DVec3::X, DVec3::Y], [DVec3::Z, DVec3::Y + DVec3::Z, DVec3::X + DVec3::Z]];
//! # let boxes = corners.map(Aabb::from_points);
//! # let octree = Octree::build(&boxes, OctreeOptions { max_level: 4, min_items: 4 })?;
//! # let surface = |&place: &u32| Surface { corners: corners[place as usize], front: InputPatch(place), back: None };
//! # let surfaces = octree.order().iter().map(surface).collect();
//! # let geometry = Arc::new(Geometry::new(surfaces, octree, 2, 1e-10));
//! # let settings = RenderSettings { resolution: 64, culling: Culling::Off, covered: false };
//! # let (name, version, device) = ("vis".to_owned(), "1".to_owned(), "none".to_owned());
//! # let info = BackendInfo { name, version, device, capabilities: Capabilities::default(), preferred_rows: 1 };
//! # let axes = [DVec3::X, DVec3::Y, DVec3::Z];
//! # let hemicube = |patch| Hemicube { emitter: Some(InputPatch(patch)), origin: DVec3::ZERO, axes };
//!
//! // What the driver does with it:
//! let mut backend = Vis(info, 0);
//! backend.load(&geometry, settings)?;
//! let mut rows = RowBlock::default();
//! backend.rows(&[hemicube(0), hemicube(1)], &mut rows)?;
//! rows.check(2, geometry.patch_count, settings.covered)?;
//! assert_eq!((rows.row(0).patches, rows.row(1).patches), (&[1][..], &[0][..]));
//! assert!(backend.rows(&[hemicube(2)], &mut rows).is_err());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use crate::delta::is_resolution;
use crate::row::RowBlock;
use glam::DVec3;
use hemicube_scene::InputPatch;
use hemicube_spatial::Octree;
use std::any::{Any, TypeId};
use std::collections::HashMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// The weight of a whole hemicube: form factor 1 in fixed point.
pub const WHOLE: u32 = 1 << 31;

/// Resolutions rendered by every backend: multiples of 16 in this range.
pub const RESOLUTIONS: std::ops::RangeInclusive<u32> = 16..=1024;

/// An occluding triangle, with the patch on either side of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Corners in normalised coordinates, counter-clockwise seen from the front.
    pub corners: [DVec3; 3],
    /// The patch on the front.
    pub front: InputPatch,
    /// The patch on the back; `None` for a one-sided surface: its back blocks.
    pub back: Option<InputPatch>,
}

/// A triangle cut into `pieces`² surfaces with consecutive patches, row by row from its first edge
/// (`hemicube_scene::Subdivision::cut`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cut {
    /// The first of its patches.
    pub first: InputPatch,
    /// Pieces of an edge, from 2 on.
    pub pieces: u32,
}

/// A scene for backends to render: surfaces in the octree's order.
///
/// Coordinates are normalised: the middle of the scene's box is the origin, and the longest half side lies in (½, 1],
/// scaled by a power of two, so that thresholds can be constants whatever the scene's unit.
#[derive(Debug)]
pub struct Geometry {
    /// The surfaces, in the octree's order.
    pub surfaces: Vec<Surface>,
    /// The hierarchy over `surfaces`; its nodes are ranges of them.
    pub octree: Octree,
    /// Number of patches: ids run from 0 to one below.
    pub patch_count: u32,
    /// A corner nearer than this to the emitter's plane counts as lying in it, in normalised units.
    pub plane_tolerance: f64,
    /// Triangles that the scene was cut from, as far as known: by the first patch of each, ascending.
    cuts: Vec<Cut>,
    /// Values made of it, see [`Geometry::kept`].
    kept: Mutex<HashMap<TypeId, Kept>>,
}

/// A value that is made once; the map of them is not locked meanwhile, so that making one may ask for another.
type Kept = Arc<OnceLock<Arc<dyn Any + Send + Sync>>>;

impl Clone for Geometry {
    /// Without [`Geometry::cuts`] and what is kept of it, so that a clone can be changed.
    fn clone(&self) -> Self {
        Self::new(
            self.surfaces.clone(),
            self.octree.clone(),
            self.patch_count,
            self.plane_tolerance,
        )
    }
}

impl Geometry {
    /// A scene as backends are given it.
    pub fn new(surfaces: Vec<Surface>, octree: Octree, patch_count: u32, plane_tolerance: f64) -> Self {
        Self {
            surfaces,
            octree,
            patch_count,
            plane_tolerance,
            cuts: Vec::new(),
            kept: Mutex::default(),
        }
    }

    /// Says which triangles the surfaces were cut from, by the first patch of each, ascending. Backends take it as it
    /// is.
    #[must_use]
    pub fn with_cuts(mut self, cuts: Vec<Cut>) -> Self {
        self.cuts = cuts;
        self
    }

    /// Triangles that the scene was cut from, as far as known: surfaces of none may be whole, or pieces of a triangle
    /// that was cut before.
    pub fn cuts(&self) -> &[Cut] {
        &self.cuts
    }

    /// Makes a value of the scene once for all sessions: one of each type, made when first asked for, and shared from
    /// then on.
    ///
    /// Found by its type, because backends and `hemicube` each keep values of their own, which this crate cannot name.
    ///
    /// ```
    /// # use hemicube_contract::backend::Geometry;
    /// # use hemicube_spatial::{Octree, OctreeOptions};
    /// # let octree = Octree::build(&[], OctreeOptions { max_level: 4, min_items: 4 })?;
    /// # let geometry = Geometry::new(Vec::new(), octree, 7, 1e-10);
    /// struct Colors(Vec<u32>);
    ///
    /// let mut made = 0;
    /// let mut session = || geometry.kept(|geometry| { made += 1; Colors((0..geometry.patch_count).collect()) });
    /// let (one, other) = (session(), session());
    /// assert!(std::sync::Arc::ptr_eq(&one, &other) && one.0.len() == 7);
    /// assert_eq!(made, 1);
    /// # Ok::<(), hemicube_spatial::OctreeError>(())
    /// ```
    pub fn kept<T: Any + Send + Sync>(&self, make: impl FnOnce(&Self) -> T) -> Arc<T> {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let cell = Arc::clone(kept.entry(TypeId::of::<T>()).or_default());
        drop(kept);
        let value = Arc::clone(cell.get_or_init(|| Arc::new(make(self))));
        value.downcast().unwrap_or_else(|_| unreachable!("kept by its type"))
    }
}

/// A hemicube to render: its position and axes. Normalised coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hemicube {
    /// Its own patch, never seen; `None` for a free sensor point.
    pub emitter: Option<InputPatch>,
    /// The centre.
    pub origin: DVec3,
    /// Tangent, bitangent, normal: orthonormal and right-handed; the top face looks along the normal.
    pub axes: [DVec3; 3],
}

impl Hemicube {
    /// Refuses a patch beyond a scene of `patch_count` patches, and a frame that is not finite. Every backend asks this
    /// before it renders.
    ///
    /// # Errors
    /// [`BackendError::InvalidArgument`], naming the patch.
    pub fn check(&self, patch_count: u32) -> Result<(), BackendError> {
        if let Some(patch) = self.emitter
            && patch.0 >= patch_count
        {
            return Err(BackendError::InvalidArgument(format!(
                "a hemicube names patch {} of a scene of {patch_count} patches",
                patch.0
            )));
        }
        if self.origin.is_finite() && self.axes.iter().all(|axis| axis.is_finite()) {
            Ok(())
        } else {
            Err(BackendError::InvalidArgument(
                "a hemicube's frame is not finite".to_owned(),
            ))
        }
    }
}

/// Height over a portal's plane that a backend may take for none, in parts of the distance from the eye: besides the
/// geometry's `plane_tolerance`, and above the rounding of f32.
pub const HEIGHT_SLACK: f64 = 2e-6;

/// A pass: the view through a portal, in the pixels that show the portal. Normalised coordinates.
///
/// Behind a mirror the eye and the axes are a hemicube's, reflected; behind a pane they are the hemicube's own. Of a
/// surface with no corner more than the geometry's `plane_tolerance` above the portal's plane nothing is seen: the
/// portal itself is one. All others are cut by the plane, where heights up to [`HEIGHT_SLACK`] may count as none.
#[derive(Clone, Copy, Debug)]
pub struct Pass<'a> {
    /// The eye.
    pub origin: DVec3,
    /// Tangent, bitangent, normal: orthonormal, of either hand.
    pub axes: [DVec3; 3],
    /// The portal's plane, of unit length, looking where the view goes on: only points p with `normal` · p > `offset`
    /// are seen.
    pub normal: DVec3,
    /// See `normal`.
    pub offset: f64,
    /// A bit for each pixel of the atlas ([`crate::face`]), from the lowest of the first word on: set where it is open.
    pub open: &'a [u32],
}

impl Pass<'_> {
    /// Refuses a mask of another length, and what is not finite, of unit length or at right angles. Every backend asks
    /// this before it renders.
    ///
    /// # Errors
    /// [`BackendError::InvalidArgument`], saying what is wrong.
    pub fn check(&self, resolution: u32) -> Result<(), BackendError> {
        let [x, y, z] = self.axes;
        let lengths = [x, y, z, self.normal].map(|v| v.length_squared() - 1.0);
        let products = [x.dot(y), y.dot(z), z.dot(x)];
        let is_off = |value: &f64| value.is_nan() || value.abs() > 1e-6;
        let wanted = crate::face::pixel_count(resolution) / 32;
        let wrong = if lengths.iter().chain(&products).any(is_off) {
            "the axes of a pass are not orthonormal, or its plane's normal is not of unit length".to_owned()
        } else if !(self.origin.is_finite() && self.offset.is_finite()) {
            "the eye of a pass or its plane is not finite".to_owned()
        } else if self.open.len() != wanted {
            let found = self.open.len();
            format!("the mask of a pass has {found} words where {wanted} are due at resolution {resolution}")
        } else {
            return Ok(());
        };
        Err(BackendError::InvalidArgument(wrong))
    }

    /// Returns whether a pixel is open, by its place in the atlas.
    pub fn is_open(&self, pixel: usize) -> bool {
        self.open[pixel / 32] >> (pixel % 32) & 1 == 1
    }
}

/// Rays from one patch. Normalised coordinates.
///
/// The answer to a ray is the side of the first surface on it, strictly between its ends: the patch there, or
/// [`Items::BLOCKED`](crate::face::Items::BLOCKED) for a back, or [`Items::ESCAPED`](crate::face::Items::ESCAPED) where
/// there is none. Of a surface of the emitter, and of one with no corner more than the geometry's `plane_tolerance`
/// above the emitter's plane, nothing is met. An answer that is not certain is [`Rays::DOUBTFUL`]: whoever asked decides
/// that ray in f64. Uncertain is whatever rounding might decide: an edge, an end, the plane, and two surfaces within
/// [`Rays::TIE`] of each other. Within a hundred `plane_tolerance` of an edge, across the ray, no answer is certain: who
/// asked may take pieces of a wall for one polygon.
///
/// A ray that goes on beyond another patch asks whether that is seen: it is, where it is the first surface.
#[derive(Clone, Copy, Debug)]
pub struct Rays<'a> {
    /// Their own patch.
    pub emitter: InputPatch,
    /// Normal of the emitter's plane, of unit length, on the side that the rays leave to.
    pub normal: DVec3,
    /// The plane: `normal` · p = `offset`.
    pub offset: f64,
    /// Start and end of each.
    pub ends: &'a [[DVec3; 2]],
}

impl Rays<'_> {
    /// The answer to a ray that has no certain one.
    pub const DOUBTFUL: u32 = u32::MAX - 2;
    /// Distance along a ray within which another rule than the nearer place may decide, in parts of the geometry's
    /// `plane_tolerance`: that of surfaces in one plane, seen at the flattest angle that is told from none.
    pub const TIE: f64 = 4e4;

    /// Refuses a missing patch, and what is not finite or of unit length. Every backend asks this before it casts.
    ///
    /// # Errors
    /// [`BackendError::InvalidArgument`], saying what is wrong.
    pub fn check(&self, patch_count: u32) -> Result<(), BackendError> {
        let off = self.normal.length_squared() - 1.0;
        let wrong = if self.emitter.0 >= patch_count {
            let emitter = self.emitter.0;
            format!("rays name patch {emitter} of a scene of {patch_count} patches")
        } else if off.is_nan() || off.abs() > 1e-6 || !self.offset.is_finite() {
            "the plane of rays is not finite, or its normal is not of unit length".to_owned()
        } else if !self.ends.as_flattened().iter().all(|end| end.is_finite()) {
            "an end of a ray is not finite".to_owned()
        } else {
            return Ok(());
        };
        Err(BackendError::InvalidArgument(wrong))
    }
}

/// The choice to skip invisible subtrees. Rows are equal to the bit either way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Culling {
    /// Frustum and occlusion culling.
    On,
    /// Every surface is rasterised: the baseline.
    Off,
}

/// The settings of hemicubes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RenderSettings {
    /// Pixels along the edge of the top face: a multiple of 16 in [`RESOLUTIONS`].
    pub resolution: u32,
    /// The choice to skip invisible subtrees.
    pub culling: Culling,
    /// True if rows carry covered weights and tiny patches (see [`RowBlock`]).
    pub covered: bool,
}

impl RenderSettings {
    /// Refuses a resolution beyond every backend. Every backend asks this when it loads a scene.
    ///
    /// # Errors
    /// [`BackendError::InvalidArgument`], naming the resolution.
    pub fn check(&self) -> Result<(), BackendError> {
        if is_resolution(self.resolution) {
            Ok(())
        } else {
            Err(BackendError::InvalidArgument(format!(
                "resolution {}: a multiple of 16 from {} to {} is needed",
                self.resolution,
                RESOLUTIONS.start(),
                RESOLUTIONS.end()
            )))
        }
    }
}

/// The capabilities of a backend.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Capabilities {
    /// Fills in covered weights when asked. For a plugin without this, the host counts them ([`crate::outline`]).
    pub covered: bool,
    /// Reports patches without a pixel centre but nearest at their centroid.
    pub tiny_patches: bool,
    /// [`HemicubeBackend::items`] works.
    pub items: bool,
    /// Rows with culling on and off are the same bits.
    pub lossless_culling: bool,
    /// [`HemicubeBackend::pass`] works.
    pub passes: bool,
    /// [`HemicubeBackend::rays`] works.
    pub rays: bool,
    /// [`crate::close`] hemicubes may be wrong; a processor is to draw them.
    pub leaves_close: bool,
}

/// The identity of a backend.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BackendInfo {
    /// Name, `[a-z0-9-]{1,32}`.
    pub name: String,
    /// Version of the arithmetic: stores of different versions are not mixed. A backend choosing an engine by the scene
    /// reports the chosen one's version, from `load` on.
    pub version: String,
    /// The device, in words (an instruction set, a GPU and its driver).
    pub device: String,
    /// Its capabilities.
    pub capabilities: Capabilities,
    /// Its preferred number of hemicubes a call.
    pub preferred_rows: usize,
}

/// Counters of some rows. Sums; equal for equal rows in any batches and threads, but for backends that begin with the
/// chunks seen by the hemicube before: their nodes, triangles and queries depend on the order of hemicubes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Counters {
    /// Hemicubes rendered.
    pub hemicubes: u64,
    /// Nodes of the hierarchy tested.
    pub nodes_tested: u64,
    /// Nodes found outside every face.
    pub nodes_outside: u64,
    /// Nodes found hidden behind earlier surfaces.
    pub nodes_hidden: u64,
    /// Triangles transformed into a hemicube's frame.
    pub triangles_transformed: u64,
    /// Triangles rasterised, counted once a face.
    pub triangles_drawn: u64,
    /// Hardware occlusion queries issued; 0 without such.
    pub queries: u64,
    /// Bytes read back from a device; 0 without one.
    pub bytes_read_back: u64,
}

impl std::ops::AddAssign for Counters {
    fn add_assign(&mut self, other: Self) {
        self.hemicubes += other.hemicubes;
        self.nodes_tested += other.nodes_tested;
        self.nodes_outside += other.nodes_outside;
        self.nodes_hidden += other.nodes_hidden;
        self.triangles_transformed += other.triangles_transformed;
        self.triangles_drawn += other.triangles_drawn;
        self.queries += other.queries;
        self.bytes_read_back += other.bytes_read_back;
    }
}

/// Times of a device, in nanoseconds, summed since [`HemicubeBackend::load`]. All 0 if not measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct StageTimes {
    /// Choosing the surfaces to draw.
    pub cull: u64,
    /// Drawing depths and ids.
    pub render: u64,
    /// Drawing visible patches alone, for covered weights.
    pub cover: u64,
    /// Adding up weights and picking nonzero entries.
    pub reduce: u64,
    /// Bringing rows back.
    pub read_back: u64,
}

/// A backend's refusal or failure.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BackendError {
    /// A request against the contract; the session stays usable.
    #[error("{0}")]
    InvalidArgument(String),
    /// A legal request beyond this backend; the session stays usable.
    #[error("{0}")]
    Unsupported(String),
    /// Host or device memory ran out; the session stays usable.
    #[error("out of memory: {0}")]
    OutOfMemory(String),
    /// The device is gone; the session is not usable any more.
    #[error("device lost: {0}")]
    DeviceLost(String),
    /// A defect of the backend; the session is not usable any more.
    #[error("internal error of the backend: {0}")]
    Internal(String),
}

/// A session of a backend: renders hemicubes of one scene, one call at a time.
pub trait HemicubeBackend: Send {
    /// Identifies this backend.
    fn info(&self) -> &BackendInfo;

    /// Takes a scene and its settings, in place of the one before.
    ///
    /// # Errors
    /// When the settings are out of range or unsupported, or memory runs out.
    fn load(&mut self, geometry: &Arc<Geometry>, settings: RenderSettings) -> Result<(), BackendError>;

    /// Takes a scene like [`Self::load`], with covered weights, for a caller that needs visible fractions and the sums
    /// of weights only. A wholly visible patch may then have any two equal weights, 0 too, if it shares its parent
    /// triangle with other patches and their weights keep their sum. For a backend without gain from this, it is
    /// `load`.
    ///
    /// # Errors
    /// See [`Self::load`].
    fn load_for_fractions(&mut self, geometry: &Arc<Geometry>, settings: RenderSettings) -> Result<(), BackendError> {
        self.load(geometry, settings)
    }

    /// Describes the choices made for the loaded scene and their reasons: a line each, for the log.
    fn choices(&self) -> Vec<String> {
        Vec::new()
    }

    /// Returns the times, if this backend was asked to measure them.
    fn stage_times(&self) -> StageTimes {
        StageTimes::default()
    }

    /// Opens another session over the loaded scene, for another thread; they share the scene.
    ///
    /// # Errors
    /// When nothing is loaded, or the device takes no further session.
    fn fork(&self) -> Result<Box<dyn HemicubeBackend>, BackendError>;

    /// Renders and reduces `hemicubes` and appends one row each to `out`.
    ///
    /// # Errors
    /// When nothing is loaded, a hemicube names a missing patch, or the device fails.
    fn rows(&mut self, hemicubes: &[Hemicube], out: &mut RowBlock) -> Result<Counters, BackendError>;

    /// Renders the item buffer of one hemicube: for each pixel of the atlas ([`crate::face`]) the visible patch, or
    /// [`Items::BLOCKED`](crate::face::Items::BLOCKED) or [`Items::ESCAPED`](crate::face::Items::ESCAPED).
    ///
    /// # Errors
    /// See [`HemicubeBackend::rows`]; [`BackendError::Unsupported`] without the capability.
    fn items(&mut self, hemicube: &Hemicube) -> Result<crate::face::Items, BackendError> {
        let _ = hemicube;
        Err(BackendError::Unsupported(format!(
            "backend `{}` does not hand out item buffers",
            self.info().name
        )))
    }

    /// Renders a pass: for each open pixel what it shows, as [`Self::items`] does, and
    /// [`Items::ESCAPED`](crate::face::Items::ESCAPED) for all others.
    ///
    /// # Errors
    /// When nothing is loaded, the pass is against the contract ([`Pass::check`]), or the device fails;
    /// [`BackendError::Unsupported`] without the capability.
    fn pass(&mut self, pass: &Pass<'_>) -> Result<crate::face::Items, BackendError> {
        let _ = pass;
        Err(BackendError::Unsupported(format!(
            "backend `{}` does not draw what is seen through portals",
            self.info().name
        )))
    }

    /// Casts rays: the answer to each, see [`Rays`].
    ///
    /// # Errors
    /// When nothing is loaded, the rays are against the contract ([`Rays::check`]), or the device fails;
    /// [`BackendError::Unsupported`] without the capability.
    fn rays(&mut self, rays: &Rays<'_>) -> Result<Vec<u32>, BackendError> {
        let _ = rays;
        Err(BackendError::Unsupported(format!(
            "backend `{}` does not cast rays",
            self.info().name
        )))
    }

    /// Returns whether [`Self::rows_and_items`] draws a hemicube once for both.
    fn draws_once(&self) -> bool {
        false
    }

    /// Appends a row and an item buffer for each hemicube. A backend that has both from one drawing
    /// ([`Self::draws_once`]) may take the row from the item buffer. Without covered weights. By default both are
    /// drawn.
    ///
    /// # Errors
    /// As for [`HemicubeBackend::items`].
    fn rows_and_items(
        &mut self,
        hemicubes: &[Hemicube],
        out: &mut RowBlock,
        items: &mut Vec<crate::face::Items>,
    ) -> Result<Counters, BackendError> {
        let counters = self.rows(hemicubes, out)?;
        for hemicube in hemicubes {
            items.push(self.items(hemicube)?);
        }
        Ok(counters)
    }

    /// The pixels of one hemicube that show nothing of the scene, and the weight of those that show backs of one-sided
    /// patches. `table` is of the loaded resolution. By default from the item buffer.
    ///
    /// # Errors
    /// As for [`HemicubeBackend::items`].
    fn escaped(
        &mut self,
        hemicube: &Hemicube,
        table: &crate::delta::DeltaTable,
        out: &mut crate::escaped::EscapedPixels,
    ) -> Result<(), BackendError> {
        out.take(&self.items(hemicube)?, table);
        Ok(())
    }
}
