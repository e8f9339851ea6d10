//! The corners of patches in their parent triangle.

use hemicube_contract::bvh::LANES;

/// The patches of a triangle with edges cut into a number of pieces, sixteen at a time.
#[derive(Debug)]
pub(super) struct Lattice {
    pub(super) blocks: Vec<LatticeBlock>,
}

/// Positions of the three corners along the parent's first and last edge, from its first corner on, as fractions. Lanes
/// without a patch have no area.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(super) struct LatticeBlock {
    pub(super) along: [[f64; LANES]; 3],
    pub(super) across: [[f64; LANES]; 3],
}

impl Lattice {
    /// Rows of patches from the first edge on, as `hemicube_scene::Subdivision` cuts them.
    pub(super) fn new(pieces: usize) -> Self {
        let empty = LatticeBlock {
            along: [[0.0; LANES]; 3],
            across: [[0.0; LANES]; 3],
        };
        let mut blocks = vec![empty; (pieces * pieces).div_ceil(LANES)];
        let mut patch = 0;
        let mut push = |corners: [(usize, usize); 3]| {
            let (block, lane) = (&mut blocks[patch / LANES], patch % LANES);
            for (k, (i, j)) in corners.into_iter().enumerate() {
                block.along[k][lane] = i as f64 / pieces as f64;
                block.across[k][lane] = j as f64 / pieces as f64;
            }
            patch += 1;
        };
        for j in 0..pieces {
            for i in 0..pieces - j {
                push([(i, j), (i + 1, j), (i, j + 1)]);
                if i + j + 1 < pieces {
                    push([(i + 1, j), (i + 1, j + 1), (i, j + 1)]);
                }
            }
        }
        Self { blocks }
    }
}
