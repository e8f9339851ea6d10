//! The five faces of a hemicube and their atlas.
//!
//! The top face has N × N pixels, each side N × N/2: its upper half, because nothing below the emitter's plane counts.
//! The atlas is N wide and 3N tall: N rows of the top, then N/2 rows of each side. Source: Cohen & Greenberg 1985, "The
//! hemi-cube: a radiosity solution for complex environments".

use crate::backend::WHOLE;
use crate::delta::DeltaTable;
use hemicube_scene::InputPatch;

/// A face of a hemicube, named by its axis in the patch frame (x tangent, y bitangent, z normal).
///
/// ```
/// use hemicube_contract::face::{Face, pixel_count};
///
/// // The atlas of a hemicube of 64 pixels: the top's 64 rows, then 32 of each side.
/// let rows = Face::ALL.map(|face| (face.first_row(64), face.rows(64)));
/// assert_eq!(rows, [(0, 64), (64, 32), (96, 32), (128, 32), (160, 32)]);
/// assert_eq!(pixel_count(64), 64 * (160 + 32));
///
/// // Every face looks along its third axis: here −bitangent.
/// let ([_u, v, w], [_su, sv, sw]) = Face::NegY.axes();
/// assert_eq!((w, sw, v, sv), (1, -1.0, 2, 1.0));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Face {
    /// Looks along the normal.
    Top,
    /// Looks along +tangent.
    PosX,
    /// Looks along −tangent.
    NegX,
    /// Looks along +bitangent.
    PosY,
    /// Looks along −bitangent.
    NegY,
}

impl Face {
    /// All faces, in atlas order.
    pub const ALL: [Self; 5] = [Self::Top, Self::PosX, Self::NegX, Self::PosY, Self::NegY];

    /// Returns the component of the patch frame for each face axis (u to the right, v up, w forward), and its sign.
    ///
    /// A direction (x, y, z) of the frame meets the face at u/w, v/w: in −1…1 on the top, and in −1…1 by 0…1 on a side,
    /// with v along the normal.
    pub const fn axes(self) -> ([usize; 3], [f64; 3]) {
        match self {
            Self::Top => ([0, 1, 2], [1.0, 1.0, 1.0]),
            Self::PosX => ([1, 2, 0], [1.0, 1.0, 1.0]),
            Self::NegX => ([1, 2, 0], [-1.0, 1.0, -1.0]),
            Self::PosY => ([0, 2, 1], [-1.0, 1.0, 1.0]),
            Self::NegY => ([0, 2, 1], [1.0, 1.0, -1.0]),
        }
    }

    /// Returns whether this is the top.
    pub const fn is_top(self) -> bool {
        matches!(self, Self::Top)
    }

    /// Rows of pixels of this face.
    pub const fn rows(self, resolution: u32) -> u32 {
        if self.is_top() { resolution } else { resolution / 2 }
    }

    /// The first atlas row of this face.
    pub const fn first_row(self, resolution: u32) -> u32 {
        match self {
            Self::Top => 0,
            Self::PosX => resolution,
            Self::NegX => resolution + resolution / 2,
            Self::PosY => 2 * resolution,
            Self::NegY => 2 * resolution + resolution / 2,
        }
    }
}

/// Number of pixels of a hemicube: 3N².
pub const fn pixel_count(resolution: u32) -> usize {
    3 * resolution as usize * resolution as usize
}

/// The item buffer of a hemicube: the visible patch of each pixel of the atlas, row by row.
///
/// ```
/// use hemicube_contract::InputPatch;
/// use hemicube_contract::delta::DeltaTable;
/// use hemicube_contract::face::{Face, Items, pixel_count};
///
/// // Patch 3 fills the top, and nothing is at the sides.
/// let mut items = Items { resolution: 32, seen: vec![Items::ESCAPED; pixel_count(32)] };
/// items.seen[..32 * Face::Top.rows(32) as usize].fill(3);
/// let (entries, escaped, blocked) = items.reduce(&DeltaTable::new(32));
/// let [(InputPatch(3), top)] = entries[..] else { panic!("{entries:?}") };
/// assert_eq!((top + escaped, blocked), (hemicube_contract::backend::WHOLE, 0));
/// assert!(top > escaped);
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Items {
    /// Pixels along the edge of the top face.
    pub resolution: u32,
    /// 3N² entries: a patch id, [`Items::BLOCKED`] or [`Items::ESCAPED`].
    pub seen: Vec<u32>,
}

impl Items {
    /// The pixel hit the back of a one-sided patch.
    pub const BLOCKED: u32 = u32::MAX - 1;
    /// The pixel hit nothing.
    pub const ESCAPED: u32 = u32::MAX;

    /// The reference reduction: adds up weights pixel by pixel, with nothing clever about it, for tests to compare the
    /// backends' own reductions with. Returns (patch, visible weight) ascending, escaped, blocked.
    pub fn reduce(&self, table: &DeltaTable) -> (Vec<(InputPatch, u32)>, u32, u32) {
        assert_eq!(
            self.resolution,
            table.resolution(),
            "item buffer and table are of different resolutions"
        );
        let (mut escaped, mut blocked) = (0, 0);
        let mut weights = std::collections::BTreeMap::new();
        let mut seen = self.seen.iter();
        for face in Face::ALL {
            for y in 0..face.rows(self.resolution) {
                for x in 0..self.resolution {
                    let weight = table.weight(face, x, y);
                    match *seen.next().expect("3N² items") {
                        Self::ESCAPED => escaped += weight,
                        Self::BLOCKED => blocked += weight,
                        patch => *weights.entry(InputPatch(patch)).or_insert(0) += weight,
                    }
                }
            }
        }
        let total: u32 = weights.values().sum::<u32>() + escaped + blocked;
        assert_eq!(total, WHOLE, "the weights of a hemicube sum to the whole");
        (weights.into_iter().collect(), escaped, blocked)
    }
}
