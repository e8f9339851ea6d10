//! One face of one hemicube in the shaders' layout.

use crate::chunks::OF_A_RUN;
use crate::limits::Plan;
use crate::upload::{Upload, split};
use hemicube_contract::backend::{Geometry, Hemicube, Pass};
use hemicube_contract::close::{CLOSE, distance_before};
use hemicube_contract::face::Face;
use std::ops::RangeInclusive;

/// Words of a view: 256 bytes, the largest alignment of a dynamic offset that a device may ask.
pub const VIEW_WORDS: usize = 64;
/// Bytes of a view.
pub const VIEW_BYTES: u32 = 256;
/// The words of the near plane's distance, and of a portal's plane.
const NEAR_WORD: usize = 32;
/// The word that is 1 where `clip_y` is negated.
pub const UPSIDE_DOWN_WORD: usize = NEAR_WORD + 2;
const PORTAL: usize = 36;
/// Faces of a hemicube, and views of a slot.
pub const FACES: u32 = 5;

/// The place of a hemicube.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct View {
    /// Its place in the submission.
    pub slot: u32,
    /// Its layer of the images.
    pub layer: u32,
    /// The number of its group, rising from [`FIRST_STAMP`]. Chunks seen by the groups shortly before are drawn first.
    pub stamp: u32,
}

/// The number of earlier hemicubes whose visible chunks are drawn first. Neighbours are turned and see past different
/// edges: with one, a fifth more triangles are left to draw in `denhaag-8897` ×16.
const HEMICUBES_BACK: u32 = 8;

/// The first [`View::stamp`]. An unseen chunk has stamp 0, further back than the shaders look.
pub const FIRST_STAMP: u32 = HEMICUBES_BACK + 1;

/// Logarithms to base 2 of the near plane's distance, in half sides of the scene: its range. A GPU clips a triangle
/// that passes the eye in f32, and its new corners are off by some 2⁻²³ of the triangle. With a nearer plane they may
/// end behind the eye, and the triangle is lost: any triangle below the upper end, the smaller ones further down
/// (measured on an NVIDIA H100, driver 580: docs/dev/gpu.md). Mesa's drivers on the processor take any distance.
const NEAR: RangeInclusive<i32> = -30..=-20;

/// The distance of a hemicube's near plane, in half sides of the scene: 2⁻²⁰, or a power of two of at most a quarter of
/// the distance to the nearest surface above the hemicube's plane, if that is less, and at least 2⁻³⁰. Houses may share
/// walls 10⁻⁷ apart. Looks at the surfaces of nodes within 2⁻¹⁸ of the eye: few, and each once at most, as drawing does.
pub fn near(geometry: &Geometry, hemicube: &Hemicube) -> f64 {
    let nearest = distance_before(geometry, hemicube, CLOSE);
    #[allow(clippy::cast_possible_truncation, reason = "the exponent of a double")]
    let exponent = (nearest / 4.0).log2().floor().max(f64::from(*NEAR.start())) as i32;
    f64::from(exponent.min(*NEAR.end())).exp2()
}

/// The five views of a hemicube, in the order of [`Face::ALL`].
pub fn views(geometry: &Geometry, hemicube: &Hemicube, resolution: u32, at: View) -> [[u32; VIEW_WORDS]; 5] {
    #[allow(clippy::cast_possible_truncation, reason = "rounding is allowed for")]
    let narrow = |x: f64| (x as f32).to_bits();
    let near = near(geometry, hemicube);
    let (high, low) = split(hemicube.origin);
    let emitter = hemicube.emitter.map_or(u32::MAX, |p| p.0);
    Face::ALL.map(|face| {
        let (axis, sign) = face.axes();
        let mut clip = [[0.0; 3]; 3];
        for (row, clip) in clip.iter_mut().enumerate() {
            clip[axis[row]] = sign[row];
        }
        if !face.is_top() {
            // v from 0 to 1 is the whole height of a side.
            clip[1] = std::array::from_fn(|k| 2.0 * clip[1][k] - clip[2][k]);
        }
        let rows = [
            (high.map(f32::to_bits), narrow(geometry.plane_tolerance)),
            (low.map(f32::to_bits), at.slot),
            (hemicube.axes[0].to_array().map(narrow), at.layer),
            (hemicube.axes[1].to_array().map(narrow), face as u32),
            (hemicube.axes[2].to_array().map(narrow), emitter),
            (clip[0].map(narrow), face.first_row(resolution)),
            (clip[1].map(narrow), face.rows(resolution)),
            (clip[2].map(narrow), at.stamp),
        ];
        let mut words = [0; VIEW_WORDS];
        for (words, (three, last)) in words.chunks_exact_mut(4).zip(&rows) {
            words[..3].copy_from_slice(three);
            words[3] = *last;
        }
        words[NEAR_WORD] = narrow(near);
        words
    })
}

/// The distance of a pass's near plane, for an eye at a height over the portal's plane: a power of two of at most half
/// the distance, along the axis of any face, at which something may be seen beyond the portal; at least 2⁻³⁰. From a
/// nearer one, triangles that pass the eye would be clipped to corners whose heights round too coarsely.
fn near_of_pass(height: f64) -> f64 {
    // A place beyond the portal is as far as its plane, and at most √3 times as far as along the axis of its face.
    let nearest = (-height).max(0.0) / 3f64.sqrt();
    let exponent = (nearest / 2.0).log2().floor();
    exponent.max(f64::from(*NEAR.start())).exp2()
}

/// The five views of a pass, in slot and layer 0.
pub fn pass_views(geometry: &Geometry, pass: &Pass<'_>, resolution: u32) -> [[u32; VIEW_WORDS]; 5] {
    let hemicube = Hemicube {
        emitter: None,
        origin: pass.origin,
        axes: pass.axes,
    };
    let at = View {
        slot: 0,
        layer: 0,
        stamp: FIRST_STAMP,
    };
    let mut views = views(geometry, &hemicube, resolution, at);
    let [x, y, z] = pass.axes;
    let height = pass.normal.dot(pass.origin) - pass.offset;
    #[allow(clippy::cast_possible_truncation, reason = "rounding is allowed for")]
    let narrow = |x: f64| (x as f32).to_bits();
    for words in &mut views {
        words[NEAR_WORD] = narrow(near_of_pass(height));
        words[NEAR_WORD + 1] = u32::from(x.cross(y).dot(z) < 0.0);
        let plane = pass.normal.to_array().into_iter().chain([height]);
        for (word, x) in words[PORTAL..].iter_mut().zip(plane) {
            *word = narrow(x);
        }
    }
    views
}

/// The views of a submission, five a slot. The groups' stamps begin at `first_stamp`.
pub fn submission_views(
    geometry: &Geometry,
    plan: &Plan,
    hemicubes: &[Hemicube],
    first_stamp: u32,
) -> Vec<[u32; VIEW_WORDS]> {
    let slots = (0u32..).zip(hemicubes);
    slots
        .flat_map(|(slot, hemicube)| {
            let at = View {
                slot,
                layer: slot % plan.group,
                stamp: first_stamp.wrapping_add(slot / plan.group),
            };
            views(geometry, hemicube, plan.resolution, at)
        })
        .collect()
}

/// Returns true for a hemicube in its emitter's plane: the shaders then put the emitter on the horizon and need not
/// leave it out by its id. False only for origins or axes moved off the patch.
pub fn stands_on_emitter(geometry: &Geometry, upload: &Upload, hemicube: &Hemicube) -> bool {
    let Some(emitter) = hemicube.emitter else {
        return true;
    };
    let surface = &geometry.surfaces[upload.surface_of_patch[emitter.0 as usize] as usize];
    surface.corners.iter().all(|&corner| {
        let r = corner - hemicube.origin;
        let [x, y, z] = hemicube.axes.map(|axis| axis.dot(r).abs());
        // A quarter of the shaders' snapping distance (`in_frame`): the rest is for their rounding.
        z <= 0.25 * (geometry.plane_tolerance + (x + y) * 2f64.powi(-20))
    })
}

/// `Settings` of `wgsl/shared.wgsl`, in whole vectors.
pub fn settings_words(plan: &Plan, upload: &Upload) -> [u32; 16] {
    let n = plan.resolution;
    #[allow(clippy::cast_precision_loss, reason = "at most 1024")]
    let tiny_slack = 16.0 / n as f32;
    // A 512th is far above the rounding of depths. Sub-pixel patches may be seen although they are a little behind.
    let slack = (1.0 + if plan.covered { tiny_slack } else { 0.0 }) * (1.0 + 1.0 / 512.0);
    let count = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
    [
        n,
        upload.patch_count,
        count(upload.chunks.len()),
        plan.word_count,
        plan.capacity,
        count(upload.triangle_count()),
        plan.pyramid_stride(),
        slack.to_bits(),
        tiny_slack.to_bits(),
        plan.output_entries(),
        (HEMICUBES_BACK / plan.group).max(1),
        count(upload.chunks.len().div_ceil(OF_A_RUN)),
        plan.group * (upload.patch_count.max(1) + 2),
        plan.tiles_each,
        0,
        0,
    ]
}
