//! A scene made ready for hemicubes: normalised coordinates, surfaces in the octree's order, and the order of work.

use crate::backend::{Cut, Geometry, Hemicube, Surface};
use crate::frame;
use glam::DVec3;
use hemicube_scene::{InputPatch, Patches, Side};
use hemicube_spatial::{Aabb, Octree, OctreeError, OctreeOptions, order_by_normal_and_position};
use std::sync::Arc;

/// Division of the octree: the thesis's two parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HierarchyOptions {
    /// Deepest level, at most 21.
    pub max_level: u32,
    /// Number of surfaces up to which a node is not divided.
    pub min_patches: u32,
}

impl Default for HierarchyOptions {
    /// Sixteen surfaces fill one SIMD block; the levels never stop the division of a real scene.
    fn default() -> Self {
        Self {
            max_level: 16,
            min_patches: 16,
        }
    }
}

/// Range of the longest half side of a scene's box, in its own unit. An area is the root of a sum of fourth powers of
/// lengths: the sum must not overflow, nor be 0 for the smallest patch in the resolution of the box's coordinates.
const EXTENTS: std::ops::RangeInclusive<f64> = 1e-60..=1e60;

/// Least length of a triangle's longest edge, in heights up to which corners count as in a plane. A room of triangles
/// just above it has the rows of the room alone (`promises::extremes`); with edges as short as the height itself,
/// nothing sees anything.
const DWARFED: f64 = 16.0;

/// Reason for which there is no model.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ModelError {
    /// The scene has no patch.
    #[error("the scene has no patch left; nothing can be computed")]
    Empty,
    /// f64 cannot hold the scene's extent, or its areas.
    #[error(
        "the scene's extent {extent:e} cannot be worked with; coordinates must be finite and not all alike, and half \
         its box from {least:e} to {most:e} long: give them in another unit",
        least = EXTENTS.start(), most = EXTENTS.end()
    )]
    Extent {
        /// The longest half side of the scene's box.
        extent: f64,
    },
    /// Most triangles are too small beside the scene to be told from the planes of their neighbours: something stands
    /// far off, or the scene lies so far from the origin that coordinates lose their digits.
    #[error(
        "{small} of {surfaces} triangles are less than {least:.1e} of the scene's extent {extent:.3e} long, too small \
         to be told apart; is something far off? the farthest from the middle of all is patch {} at ({:.4e} {:.4e} \
         {:.4e}): delete it, or move the scene to the origin",
        farthest.0, at.x, at.y, at.z
    )]
    Dwarfed {
        /// Number of such triangles.
        small: usize,
        /// Number of all triangles, as cut.
        surfaces: usize,
        /// Least length of the longest edge, in parts of `extent`.
        least: f64,
        /// The longest half side of the scene's box.
        extent: f64,
        /// The patch farthest from the median of all.
        farthest: InputPatch,
        /// Its centroid.
        at: DVec3,
    },
    /// The octree refused the boxes.
    #[error("octree: {0}")]
    Octree(#[from] OctreeError),
}

/// A scene made ready for hemicubes.
///
/// ```
/// use hemicube::{HierarchyOptions, InputPatch, Model};
/// use hemicube_scene::{Patches, Subdivision, generate};
/// use hemicube_spatial::glam::DVec3;
///
/// let patches = Patches::new(&generate::cornell_box(), Subdivision::Split(2))?;
/// let model = Model::new(patches.into(), HierarchyOptions::default())?;
///
/// // The order of work has all patches; neighbours in it see much the same.
/// let mut patches: Vec<InputPatch> = model.order().collect();
/// assert_ne!(patches[0], InputPatch(0));
/// patches.sort();
/// assert!(patches.into_iter().eq(model.patches().iter()));
///
/// // Four hemicubes stand evenly on a patch, and look along its normal.
/// let hemicubes = model.hemicubes(InputPatch(7), 2, true);
/// let middle = hemicubes.iter().map(|hemicube| hemicube.origin).sum::<DVec3>() / 4.0;
/// assert!(middle.distance(model.normalise(model.patches().centroid(InputPatch(7)))) < 1e-12);
/// assert!(hemicubes.iter().all(|h| h.axes[2].distance(model.patches().normal(InputPatch(7))) < 1e-12));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Model {
    patches: Arc<Patches>,
    geometry: Arc<Geometry>,
    order: Vec<u32>,
    center: DVec3,
    scale: f64,
    /// The number by which random numbers are drawn for each patch; empty: its own.
    drawn_by: Arc<[u32]>,
}

impl Model {
    /// Prepares `patches`.
    ///
    /// # Errors
    /// If there is no patch, coordinates are not finite or all alike, half the scene's box is not from 10⁻⁶⁰ to 10⁶⁰
    /// long, or most triangles have no edge of 1.6·10⁻⁹ of it.
    pub fn new(patches: Arc<Patches>, hierarchy: HierarchyOptions) -> Result<Self, ModelError> {
        if patches.is_empty() {
            return Err(ModelError::Empty);
        }
        let bounds = Aabb::from_points(patches.surfaces().iter().flatten().copied());
        let center = bounds.center();
        let half = bounds.half_extent();
        let extent = half.max_element();
        if !(EXTENTS.contains(&extent) && center.is_finite()) {
            return Err(ModelError::Extent { extent });
        }
        let scale = power_of_two_not_above(1.0 / extent);
        let normalise = |p: DVec3| (p - center) * scale;

        let mut patches_of: Vec<(InputPatch, Option<InputPatch>)> =
            vec![(InputPatch(u32::MAX), None); patches.surfaces().len()];
        for patch in patches.iter() {
            let sides = &mut patches_of[patches.surface(patch)];
            match patches.side(patch) {
                Side::Front => sides.0 = patch,
                Side::Back => sides.1 = Some(patch),
            }
        }
        let boxes: Vec<Aabb> = patches
            .surfaces()
            .iter()
            .map(|s| Aabb::from_points(s.map(normalise)))
            .collect();
        // Neither the order of work nor the octree needs the other: each on a thread of its own.
        let work_order = || {
            let (normals, centroids): (Vec<DVec3>, Vec<DVec3>) = patches
                .iter()
                .map(|p| (patches.normal(p), normalise(patches.centroid(p))))
                .unzip();
            let bounds = Aabb {
                min: normalise(bounds.min),
                max: normalise(bounds.max),
            };
            order_by_normal_and_position(&normals, &centroids, bounds)
        };
        let options = OctreeOptions {
            max_level: hierarchy.max_level,
            min_items: hierarchy.min_patches,
        };
        let (octree, order) = std::thread::scope(|scope| {
            let order = scope.spawn(work_order);
            let octree = Octree::build_loose(&boxes, options);
            (octree, order.join())
        });
        let octree = octree?;
        let order = order.unwrap_or_else(|payload| std::panic::resume_unwind(payload));
        drop(boxes);
        let surfaces: Vec<Surface> = octree
            .order()
            .iter()
            .map(|&index| {
                let (front, back) = patches_of[index as usize];
                Surface {
                    corners: patches.surfaces()[index as usize].map(normalise),
                    front,
                    back,
                }
            })
            .collect();

        // Corners carry the rounding of their file's coordinates: far from the origin, much more than that of the
        // scene's own extent.
        let largest = bounds.min.abs().max(bounds.max.abs()).max_element();
        let plane_tolerance = 1e-10 + 16.0 * f64::EPSILON * largest * scale;
        let least = DWARFED * plane_tolerance;
        let small = surfaces.iter().filter(|s| longest_edge(&s.corners) < least).count();
        if 2 * small > surfaces.len() {
            let (farthest, at) = farthest_from_median(&patches);
            return Err(ModelError::Dwarfed {
                small,
                surfaces: surfaces.len(),
                least,
                extent,
                farthest,
                at,
            });
        }
        #[allow(clippy::cast_possible_truncation, reason = "at most 2³¹ patches")]
        let patch_count = patches.len() as u32;
        let cuts = patches.cut_triangles().map(|(first, pieces)| Cut { first, pieces });
        let geometry = Geometry::new(surfaces, octree, patch_count, plane_tolerance).with_cuts(cuts.collect());
        let geometry = Arc::new(geometry);
        Ok(Self {
            patches,
            geometry,
            order,
            center,
            scale,
            drawn_by: Arc::default(),
        })
    }

    /// The model with other numbers by which random numbers are drawn for its patches: those of another scene with the
    /// same patches, whose rows these are to equal.
    ///
    /// # Panics
    /// When numbers are not as many as patches.
    #[must_use]
    pub fn drawn_by(self, numbers: Vec<u32>) -> Self {
        assert_eq!(numbers.len(), self.patches.len(), "a number for each patch");
        Self {
            drawn_by: numbers.into(),
            ..self
        }
    }

    /// The number by which random numbers are drawn for a patch.
    pub(crate) fn number_of(&self, patch: u32) -> u32 {
        self.drawn_by.get(patch as usize).copied().unwrap_or(patch)
    }

    /// The patches, in input order.
    pub fn patches(&self) -> &Arc<Patches> {
        &self.patches
    }

    /// The scene for backends.
    pub fn geometry(&self) -> &Arc<Geometry> {
        &self.geometry
    }

    /// The order of work: patches by normal, then by position, along a Morton curve. Consecutive hemicubes see much the
    /// same.
    pub fn order(&self) -> impl Iterator<Item = InputPatch> + '_ {
        self.order.iter().map(|&p| InputPatch(p))
    }

    /// A world point in the normalised coordinates of [`Geometry`].
    pub fn normalise(&self, point: DVec3) -> DVec3 {
        (point - self.center) * self.scale
    }

    /// The corners of a patch in normalised coordinates.
    pub(crate) fn normalised_corners(&self, patch: u32) -> [DVec3; 3] {
        self.patches.corners(InputPatch(patch)).map(|p| self.normalise(p))
    }

    /// The `n`² hemicubes of a patch, at the centroids of its equal sub-triangles; none for a patch without area.
    ///
    /// They stand along the scene's axes within the limits of the normal ([`frame::axes_of`]). With `rotate`, a hash of
    /// the patch turns them a little about the normal ([`frame::turn`]).
    pub fn hemicubes(&self, patch: InputPatch, n: u32, rotate: bool) -> Vec<Hemicube> {
        let corners = self.normalised_corners(patch.0);
        let turn = if rotate {
            frame::turn(InputPatch(self.number_of(patch.0)))
        } else {
            0.0
        };
        let Some(axes) = frame::axes(corners, 0.0).and_then(|[_, _, normal]| frame::axes_of(normal, turn)) else {
            return Vec::new();
        };
        let hemicube = |origin| Hemicube {
            emitter: Some(patch),
            origin,
            axes,
        };
        frame::sample_points(corners, n).into_iter().map(hemicube).collect()
    }
}

fn longest_edge([a, b, c]: &[DVec3; 3]) -> f64 {
    a.distance(*b).max(b.distance(*c)).max(c.distance(*a))
}

/// The patch with the centroid farthest from the median of all, and that centroid. Expects a patch.
fn farthest_from_median(patches: &Patches) -> (InputPatch, DVec3) {
    let median = DVec3::from_array([0, 1, 2].map(|axis| {
        let mut along: Vec<f64> = patches.iter().map(|p| patches.centroid(p)[axis]).collect();
        let middle = along.len() / 2;
        *along.select_nth_unstable_by(middle, f64::total_cmp).1
    }));
    let away = |&p: &InputPatch| patches.centroid(p).distance(median);
    let farthest = patches.iter().max_by(|a, b| away(a).total_cmp(&away(b)));
    let farthest = farthest.unwrap_or(InputPatch(0));
    (farthest, patches.centroid(farthest))
}

/// The largest power of two up to a positive, normal, finite `x`.
fn power_of_two_not_above(x: f64) -> f64 {
    let exponent = x.to_bits() >> 52;
    f64::from_bits(exponent << 52)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use hemicube_scene::generate::cornell_box;
    use hemicube_scene::{Scene, Subdivision, Triangle};

    /// A model of triangles in this order, each with whether it has two sides.
    pub(crate) fn of_triangles(triangles: &[([DVec3; 3], bool)]) -> Model {
        let triangle = |&(corners, two_sided): &([DVec3; 3], bool)| Triangle {
            corners,
            object: 0,
            material: 0,
            face: 0,
            two_sided,
        };
        let scene = Scene {
            triangles: triangles.iter().map(triangle).collect(),
            ..Scene::default()
        };
        let patches = Patches::new(&scene, Subdivision::None).expect("patches");
        Model::new(patches.into(), HierarchyOptions::default()).expect("a model")
    }

    /// A model of one-sided triangles in this order.
    pub(crate) fn one_sided(triangles: &[[DVec3; 3]]) -> Model {
        let triangles: Vec<_> = triangles.iter().map(|&corners| (corners, false)).collect();
        of_triangles(&triangles)
    }

    /// The Cornell box with its largest half side this long, and a triangle in it that is 10⁻¹⁵ as large.
    fn box_of(half: f64) -> Scene {
        let mut scene = cornell_box();
        let bounds = Aabb::from_points(scene.triangles.iter().flat_map(|t| t.corners));
        let scale = half / bounds.half_extent().max_element();
        for triangle in &mut scene.triangles {
            triangle.corners = triangle.corners.map(|p| p * scale);
        }
        let least = 1e-15 * half;
        let corners = [DVec3::ZERO, DVec3::X * least, DVec3::Z * least];
        scene.triangles.push(Triangle {
            corners,
            ..scene.triangles[0]
        });
        scene
    }

    #[test]
    fn where_a_model_is_made_areas_and_normals_are_numbers() {
        let make = |half: f64| {
            let patches = Arc::new(Patches::new(&box_of(half), Subdivision::None).unwrap());
            Model::new(patches.clone(), HierarchyOptions::default()).map(|_| patches)
        };
        for half in [1.1e-60, 1.0, 0.9e60] {
            let patches = make(half).unwrap();
            for patch in patches.iter() {
                assert!(patches.area(patch) / half / half > 1e-31, "{half:e}");
                assert!((patches.normal(patch).length() - 1.0).abs() < 1e-9, "{half:e}");
            }
        }
        for half in [0.9e-60, 1.1e60, 1e160] {
            let refused = make(half).unwrap_err().to_string();
            assert!(refused.contains("from 1e-60 to 1e60 long"), "{refused}");
        }
    }

    /// The Cornell box, and a triangle a tenth as large as it is far.
    fn with_one_at(distance: f64) -> Result<Model, ModelError> {
        let mut scene = cornell_box();
        let corners = [DVec3::ZERO, DVec3::Y, DVec3::Z].map(|p| (DVec3::X + 0.1 * p) * distance);
        scene.triangles.push(Triangle {
            corners,
            ..scene.triangles[0]
        });
        let patches = Patches::new(&scene, Subdivision::None).unwrap();
        Model::new(patches.into(), HierarchyOptions::default())
    }

    #[test]
    fn a_scene_that_something_far_off_dwarfs_is_refused_by_where_that_is() {
        with_one_at(1e11).unwrap();
        for distance in [1e13, 1e17, 1e40] {
            let refused = with_one_at(distance).unwrap_err();
            let ModelError::Dwarfed { small, farthest, .. } = refused else {
                panic!("{refused}");
            };
            assert_eq!((small, farthest), (cornell_box().triangles.len(), InputPatch(40)));
            assert!(refused.to_string().contains("patch 40 at ("), "{refused}");
        }
    }

    #[test]
    fn powers_of_two() {
        assert_eq!(power_of_two_not_above(1.0), 1.0);
        assert_eq!(power_of_two_not_above(0.99), 0.5);
        assert_eq!(power_of_two_not_above(1e-9), 2f64.powi(-30));
        assert_eq!(power_of_two_not_above(1e9), 2f64.powi(29));
    }
}
