//! The engines: a walk over the scene, front to back, then the row of a hemicube.
//!
//! - `depth` (`walk.rs` over a `DepthBuffer`) walks a tree of boxes roughly front to back, draws into a buffer of
//!   depths and ids, and drops hidden boxes. It takes any scene.
//! - `claims` (`walk.rs` over an `OwnershipBuffer`) is the same walk over coverage bits with an owner for each pixel.
//!   Its rows are those of `depth`, to the last bit, so that a session may take either: it takes `claims` where a
//!   hemicube has 350 pixels or more for each triangle that eight hemicubes at N = 128 drew.
//! - `order` (`order.rs`) walks a binary space partition strictly front to back over coverage bits: no depth, no ids,
//!   no reduction; a box is hidden if its bits are set.
//!
//! All rasterise with the same code, so that their pixel sums are the same bits wherever f32 depths can tell surfaces
//! apart (`backends::engines`). All draw parent triangles and distribute their visible weights over the patches
//! (`distribute.rs`).
//!
//! No visible sets shared by neighbours, because even an oracle that finds them for nothing gains 1.2 times once they
//! are put into a tree, 1.8 on a real city; a conservative set is larger and must be found (`docs/dev/study.md`).
//!
//! No coherence between hemicubes in the CPU backend, because with front-to-back order, drawing first the patches that
//! the last hemicube saw loses 5–13 % (measured on prototypes). The order of work serves the caches.

mod buffer;
mod covered;
mod distribute;
mod order;
mod walk;

pub(crate) use order::BspEngine;
pub(crate) use walk::TreeEngine;

use crate::SharedScene;
use crate::kernel::{AtlasBox, Count, Frame, OnFaces, Transformed};
use hemicube_contract::backend::Hemicube;
use hemicube_contract::bvh::{LANES, UNUSED};
use hemicube_contract::face::Face;

pub(crate) const ALL_FACES: u8 = 0b1_1111;

/// A scene seen from a hemicube.
#[derive(Clone, Copy, Debug)]
pub(crate) struct View<'a> {
    pub(crate) scene: &'a SharedScene,
    pub(crate) frame: &'a Frame,
}

impl View<'_> {
    /// Sorts the faces that a box is on into visible and hidden ones.
    #[inline]
    fn faces_of(on: &OnFaces, resolution: usize, mut is_hidden: impl FnMut(usize, AtlasBox) -> bool) -> Faces {
        let mut faces = Faces {
            visible: on.at_eye,
            hidden: 0,
        };
        let mut boxed = on.boxed;
        while boxed != 0 {
            let face = boxed.trailing_zeros() as usize;
            boxed &= boxed - 1;
            if is_hidden(face, on.in_atlas(face, resolution)) {
                faces.hidden |= 1 << face;
            } else {
                faces.visible |= 1 << face;
            }
        }
        faces
    }

    /// Removes from `lanes` those with a pixel on `faces`; only the lanes in `unproved` can have one.
    fn without_pixels(self, t: &Transformed, lanes: u16, unproved: u16, faces: u8) -> u16 {
        let mut without = lanes;
        if lanes & unproved != 0 {
            let mut counts = [Count::default(); LANES];
            let scene = self.scene;
            scene
                .isa
                .cover_lanes(t, lanes & unproved, faces, &scene.table, &mut counts);
            for (lane, count) in counts.iter().enumerate() {
                without &= !(u16::from(count.pixels != 0) << lane);
            }
        }
        without
    }
}

/// Masks of faces: a box or a block may be visible on the first, and is hidden on the second, with unknown covered
/// pixels.
#[derive(Clone, Copy, Debug)]
struct Faces {
    visible: u8,
    hidden: u8,
}

/// Weights of a row that belong to no patch.
#[derive(Clone, Copy, Debug, Default)]
struct Remainder {
    escaped: u32,
    blocked: u32,
}

/// The frame of a hemicube; its emitter is the id that the emitting triangle is drawn with.
pub(crate) fn frame(scene: &SharedScene, hemicube: &Hemicube) -> Frame {
    let emitter = hemicube.emitter.map_or(UNUSED, |p| p.0);
    Frame::new(
        hemicube.origin.to_array(),
        hemicube.axes.map(|a| a.to_array()),
        scene.tree.plane_tolerance,
        match &scene.parents {
            Some(parents) if emitter != UNUSED => parents.drawn_as(emitter),
            _ => emitter,
        },
        scene.settings.resolution as usize,
    )
}

/// The ids of some lanes.
fn ids_of(t: &Transformed, lanes: u16) -> impl Iterator<Item = u32> + use<'_> {
    crate::kernel::bits(u32::from(lanes)).map(|lane| t.seen[lane])
}

/// Calls `each(face)` for the faces in a mask.
fn each_face(faces: u8, each: impl FnMut(Face)) {
    Face::ALL
        .into_iter()
        .filter(|&face| faces >> face as u8 & 1 != 0)
        .for_each(each);
}
