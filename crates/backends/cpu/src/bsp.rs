//! A binary space partition (Fuchs, Kedem & Naylor 1980) in f64: the scene in an order that can be drawn strictly front
//! to back from any eye, walked by engine `order`.
//!
//! ```text
//! piece    surfaces and the pieces that planes cut them into
//! build    nodes: the choice of planes, leaves
//! layers   the surfaces of a plane, packed into blocks under trees of boxes
//! overlap  pairs of overlapping surfaces in a plane
//! ```
//!
//! Planes are those of surfaces, or run along an axis where that cuts nothing, chosen to cut few of a sample. The
//! surfaces of a plane are packed into blocks of sixteen under a small tree of boxes, in layers where they overlap, so
//! that the smaller id is drawn first. Surfaces of a layer do not hide each other: all its boxes, eight at a time, are
//! tested before any is drawn, and the blocks to be drawn are known and prefetched, as large scenes wait for memory. A
//! handful of surfaces shares one block and a list of planes that orders its lanes, because a block of sixteen costs
//! little more than one surface.
//!
//! A surface that a plane cuts becomes pieces. A piece's outer edges keep the line of the edge they are part of, and
//! both sides of a cut share its two end points, so that pieces are as watertight as whole surfaces, to the bit.

mod build;
mod layers;
mod overlap;
mod piece;

use crate::kernel::{BOXES, BoxGroup};
use glam::DVec3;
use hemicube_contract::backend::{Geometry, Surface};
use hemicube_contract::bvh::{Block, LANES};

/// A node of the partition.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct PlaneNode {
    pub(crate) center: DVec3,
    pub(crate) half: DVec3,
    pub(crate) normal: DVec3,
    pub(crate) distance: f64,
    /// The nodes in front of the plane and behind it, or `NONE`. In a leaf, `front` is its block.
    pub(crate) front: u32,
    pub(crate) back: u32,
    /// The layers of the plane for an eye in front of it, and behind it. In a leaf, both are its list of planes.
    pub(crate) here: [LayerRange; 2],
    pub(crate) is_leaf: bool,
}

/// A range of [`BspTree::layers`], drawn one after the other; in a leaf, a range of [`BspTree::planes`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct LayerRange {
    pub(crate) start: u32,
    pub(crate) end: u32,
}

/// One of the planes that order the lanes of a leaf's block.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LeafPlane {
    pub(crate) normal: DVec3,
    pub(crate) distance: f64,
    /// The lanes in the plane.
    pub(crate) here: u16,
    /// True if these overlap: the smaller id is drawn first.
    pub(crate) overlap: bool,
    /// The leaf's planes in front and behind, as places from its first one on, or `NO_PLANE`.
    pub(crate) front: u8,
    pub(crate) back: u8,
}

/// No node.
pub(crate) const NONE: u32 = u32::MAX;
/// No plane of a leaf.
pub(crate) const NO_PLANE: u8 = u8::MAX;

/// Surfaces that the pieces of a block were cut from.
#[derive(Clone, Debug)]
pub(crate) struct PieceLines {
    /// Begin and end of the line of edge k, as if it were corner k.
    pub(crate) from: Block,
    pub(crate) to: Block,
    /// The surfaces.
    pub(crate) surfaces: Block,
}

/// A node of a layer's tree of boxes: its children.
#[derive(Clone, Debug)]
pub(crate) struct LayerNode {
    pub(crate) boxes: BoxGroup,
    /// The block or the node in each box.
    pub(crate) child: [u32; BOXES],
    /// Boxes in use.
    pub(crate) used: u8,
}

/// A scene's surfaces in order.
#[derive(Debug)]
pub(crate) struct BspTree {
    pub(crate) nodes: Vec<PlaneNode>,
    /// Roots of trees of boxes in `layer_nodes`.
    pub(crate) layers: Vec<u32>,
    pub(crate) layer_nodes: Vec<LayerNode>,
    pub(crate) planes: Vec<LeafPlane>,
    pub(crate) blocks: Vec<Block>,
    /// For each block, the entry of `lines` of its pieces, or `NONE` if none of its surfaces is cut.
    pub(crate) lines_of_block: Vec<u32>,
    pub(crate) lines: Vec<PieceLines>,
    /// Bit set of the patches with a surface in pieces.
    cut_patches: Vec<u64>,
    /// Lanes in use.
    fragments: usize,
    surfaces: usize,
}

/// A count or a place in one of the lists, all shorter than 2³²: there are at most 2³¹ surfaces, and pieces are
/// limited.
fn number(count: usize) -> u32 {
    #[allow(clippy::cast_possible_truncation, reason = "below 2³²")]
    let number = count as u32;
    number
}

/// The generator of the planes' samples, and of tests: the same numbers in every run.
pub(crate) struct Lcg(pub(crate) u64);

impl Lcg {
    pub(crate) fn below(&mut self, count: usize) -> usize {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        #[allow(clippy::cast_possible_truncation, reason = "an index below count")]
        let index = ((u128::from(self.0 >> 16) * count as u128) >> 48) as usize;
        index
    }
}

/// Bounds on the size of a partition.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Limits {
    /// Lanes in use for each surface.
    pub(crate) fragments: f64,
}

/// Why a scene cannot be put in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum GivenUp {
    #[error("planes would cut its surfaces into too many pieces")]
    Pieces,
    #[error("too many of its surfaces overlap in one plane")]
    Layers,
}

/// The surfaces to be put in order.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Surfaces<'g> {
    pub(crate) of: &'g [Surface],
    /// All ids of patches are below this.
    pub(crate) patch_count: u32,
    /// Distance from a plane up to which a corner counts as in it.
    pub(crate) plane_tolerance: f64,
}

impl<'g> From<&'g Geometry> for Surfaces<'g> {
    fn from(geometry: &'g Geometry) -> Self {
        Self {
            of: &geometry.surfaces,
            patch_count: geometry.patch_count,
            plane_tolerance: geometry.plane_tolerance,
        }
    }
}

impl BspTree {
    /// Returns true if a patch's surface is in pieces.
    pub(crate) fn is_cut(&self, patch: u32) -> bool {
        self.cut_patches[patch as usize / 64] >> (patch % 64) & 1 != 0
    }

    /// Lanes in use for each surface.
    pub(crate) fn fragments_per_surface(&self) -> f64 {
        self.fragments as f64 / self.surfaces.max(1) as f64
    }

    /// Lanes in use of a block's sixteen, on average.
    pub(crate) fn fill(&self) -> f64 {
        self.fragments as f64 / self.blocks.len().max(1) as f64
    }
}

impl std::fmt::Display for BspTree {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{:.2} pieces a surface, {:.1} of {LANES} lanes in use",
            self.fragments_per_surface(),
            self.fill()
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hemicube::{HierarchyOptions, Model};
    use hemicube_scene::generate::{Generate, Kind, cornell_box, generate};
    use hemicube_scene::{Patches, Scene, Subdivision};

    const ANY: Limits = Limits {
        fragments: f64::INFINITY,
    };

    fn model(scene: &Scene, subdivision: Subdivision) -> Model {
        let patches = Patches::new(scene, subdivision).expect("patches");
        Model::new(patches.into(), HierarchyOptions::default()).expect("a model")
    }

    fn generated(kind: Kind) -> Model {
        let spec = Generate {
            kind,
            target_patches: 2_000,
            seed: 3,
        };
        model(&generate(spec).expect("a target in range"), Subdivision::None)
    }

    fn area([a, b, c]: [DVec3; 3]) -> f64 {
        0.5 * (b - a).cross(c - a).length()
    }

    /// The blocks drawn for an eye in front of all planes, or behind all of them.
    fn blocks_seen(bsp: &BspTree, side: usize) -> Vec<u32> {
        let mut seen = Vec::new();
        for node in &bsp.nodes {
            if node.is_leaf {
                seen.push(node.front);
                continue;
            }
            let mut pending = bsp.layers[node.here[side].start as usize..node.here[side].end as usize].to_vec();
            while let Some(at) = pending.pop() {
                let node = &bsp.layer_nodes[at as usize];
                for l in (0..BOXES).filter(|l| node.used >> l & 1 != 0) {
                    let list = if node.boxes.leaves >> l & 1 != 0 {
                        &mut seen
                    } else {
                        &mut pending
                    };
                    list.push(node.child[l]);
                }
            }
        }
        seen
    }

    #[test]
    fn the_pieces_of_a_surface_make_up_all_of_it() {
        for model in [
            model(&cornell_box(), Subdivision::Levels(2)),
            generated(Kind::Soup),
            generated(Kind::Spheres),
            generated(Kind::BlockCity),
        ] {
            let geometry = model.geometry();
            let bsp = BspTree::new(geometry.as_ref().into(), ANY).expect("no limit");
            for side in 0..2 {
                let mut areas = vec![0.0; geometry.patch_count as usize];
                let mut lanes = vec![0; geometry.patch_count as usize];
                for block in blocks_seen(&bsp, side) {
                    let block = &bsp.blocks[block as usize];
                    for lane in 0..LANES {
                        let patch = block.negative[lane].min(block.positive[lane]);
                        if patch < geometry.patch_count {
                            areas[patch as usize] += area(block.triangle(lane));
                            lanes[patch as usize] += 1;
                        }
                    }
                }
                for surface in &geometry.surfaces {
                    let patch = surface.front.0.min(surface.back.map_or(u32::MAX, |p| p.0));
                    let (whole, pieces) = (area(surface.corners), areas[patch as usize]);
                    assert!(
                        (whole - pieces).abs() < 1e-12,
                        "patch {patch}: {whole}, in pieces {pieces}"
                    );
                    assert_eq!(lanes[patch as usize] > 1, bsp.is_cut(patch), "patch {patch}");
                }
            }
        }
    }

    #[test]
    fn a_scene_that_falls_into_pieces_is_given_up() {
        let soup = generated(Kind::Soup);
        assert_eq!(
            BspTree::new(soup.geometry().as_ref().into(), Limits { fragments: 1.2 }).map(|_| ()),
            Err(GivenUp::Pieces)
        );
        let bsp = BspTree::new(soup.geometry().as_ref().into(), ANY).expect("no limit");
        assert!(bsp.fragments_per_surface() > 1.2, "{bsp}");
    }
}
