//! Builds the partition: the choice of planes, the cutting of surfaces, and leaves.

use super::overlap::overlaps;
use super::piece::{Bounds, Piece, Plane, Side};
use super::{
    BspTree, GivenUp, LayerRange, Lcg, LeafPlane, Limits, NO_PLANE, NONE, PieceLines, PlaneNode, Surfaces, number,
};
use glam::DVec3;
use hemicube_contract::bvh::{Block, LANES};

/// Largest number of surfaces in a leaf's block.
pub(super) const LEAF: usize = 12;
/// Largest number of planes of a leaf.
const LEAF_PLANES: usize = 40;
/// Cost of cutting an item, where an item in the plane gains ½: pieces multiply from plane to plane.
const CUT: f64 = 8.0;
/// Number of pieces that a plane is judged by.
const JUDGED: usize = 200;

/// A partition being built.
pub(super) struct Builder<'g> {
    pub(super) surfaces: Surfaces<'g>,
    /// The surfaces by their patches: the order must not depend on how the geometry was put together.
    by_patch: Vec<u32>,
    pub(super) bsp: BspTree,
    /// The pieces. An item below the number of surfaces is a whole surface, one above is a piece.
    pieces: Vec<Piece>,
    draw: Lcg,
    /// The largest number of pieces.
    limit: usize,
}

/// Items waiting for their node, with its parent and side.
struct Task {
    items: Vec<u32>,
    parent: u32,
    in_front: bool,
}

/// A plane, and the item that it is of.
type Chosen = (Plane, Option<u32>);

impl BspTree {
    /// Puts a scene in order, or gives up if surfaces fall into too many pieces or lie in too many layers.
    pub(crate) fn new(surfaces: Surfaces<'_>, limits: Limits) -> Result<Self, GivenUp> {
        let count = surfaces.of.len();
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a count of surfaces, times a small factor"
        )]
        let limit = (count as f64 * (limits.fragments - 1.0)) as usize;
        let limit = limit.saturating_add(64);
        let mut by_patch: Vec<u32> = (0..number(count)).collect();
        by_patch.sort_unstable_by_key(|&s| surfaces.of[s as usize].front.0);
        let mut builder = Builder {
            surfaces,
            by_patch,
            bsp: Self {
                nodes: Vec::new(),
                layers: Vec::new(),
                layer_nodes: Vec::new(),
                planes: Vec::new(),
                blocks: Vec::new(),
                lines_of_block: Vec::new(),
                lines: Vec::new(),
                cut_patches: vec![0; (surfaces.patch_count as usize).div_ceil(64)],
                fragments: 0,
                surfaces: count,
            },
            pieces: Vec::new(),
            draw: Lcg(1),
            limit,
        };
        builder.build()?;
        Ok(builder.bsp)
    }
}

impl Builder<'_> {
    pub(super) fn corners(&self, item: u32) -> &[DVec3; 3] {
        let item = item as usize;
        let count = self.surfaces.of.len();
        if item < count {
            &self.surfaces.of[self.by_patch[item] as usize].corners
        } else {
            &self.pieces[item - count].corners
        }
    }

    pub(super) fn surface_of(&self, item: u32) -> u32 {
        match (item as usize).checked_sub(self.surfaces.of.len()) {
            None => self.by_patch[item as usize],
            Some(piece) => self.pieces[piece].surface,
        }
    }

    fn piece(&self, item: u32) -> Piece {
        match (item as usize).checked_sub(self.surfaces.of.len()) {
            None => {
                let surface = self.surface_of(item);
                Piece::whole(surface, self.surfaces.of[surface as usize].corners)
            }
            Some(piece) => self.pieces[piece],
        }
    }

    /// The plane of an item's surface: a piece may be too thin to have one.
    fn plane(&self, item: u32) -> Option<Plane> {
        Plane::of(&self.surfaces.of[self.surface_of(item) as usize].corners)
    }

    fn side(&self, item: u32, plane: Plane) -> Side {
        plane.side_of(self.corners(item), self.surfaces.plane_tolerance).0
    }

    /// Builds the nodes: the plane's surfaces here, the others as tasks on either side; a few items become a leaf.
    fn build(&mut self) -> Result<(), GivenUp> {
        let items: Vec<u32> = (0..number(self.surfaces.of.len())).collect();
        let mut tasks = vec![Task {
            items,
            parent: NONE,
            in_front: false,
        }];
        while let Some(Task {
            items,
            parent,
            in_front,
        }) = tasks.pop()
        {
            let bounds = items
                .iter()
                .fold(Bounds::EMPTY, |b, &i| b.union(Bounds::of(self.corners(i))));
            let mut node = PlaneNode {
                center: bounds.center(),
                half: bounds.half(),
                normal: DVec3::ZERO,
                distance: 0.0,
                front: NONE,
                back: NONE,
                here: [LayerRange::default(); 2],
                is_leaf: false,
            };
            let index = number(self.bsp.nodes.len());
            let leaf = if items.len() <= LEAF { self.leaf(&items) } else { None };
            if let Some(leaf) = leaf {
                node.is_leaf = true;
                node.here = [leaf; 2];
                let block = number(self.bsp.blocks.len()) - 1;
                node.front = block;
            } else {
                let Some((plane, of)) = self.choose(&items) else {
                    // Nothing has an area.
                    continue;
                };
                (node.normal, node.distance) = (plane.normal, plane.distance);
                let (here, front, back) = self.part(&items, plane, of);
                if self.pieces.len() > self.limit {
                    return Err(GivenUp::Pieces);
                }
                node.here = self.pack_plane(&here, plane.normal).ok_or(GivenUp::Layers)?;
                for (items, in_front) in [(front, true), (back, false)] {
                    if !items.is_empty() {
                        tasks.push(Task {
                            items,
                            parent: index,
                            in_front,
                        });
                    }
                }
            }
            self.bsp.nodes.push(node);
            if let Some(parent) = self.bsp.nodes.get_mut(parent as usize) {
                if in_front {
                    parent.front = index;
                } else {
                    parent.back = index;
                }
            }
        }
        Ok(())
    }

    /// Sorts items by side of a plane and cuts those on both; `of` is the item with the plane.
    ///
    /// That item always lies in the plane: rounding could put a sliver beside it, for ever.
    fn part(&mut self, items: &[u32], plane: Plane, of: Option<u32>) -> (Vec<u32>, Vec<u32>, Vec<u32>) {
        let (mut here, mut front, mut back) = (Vec::new(), Vec::new(), Vec::new());
        let (mut front_pieces, mut back_pieces) = (Vec::new(), Vec::new());
        for &item in items {
            let side = if of == Some(item) {
                Side::Here
            } else {
                self.side(item, plane)
            };
            match side {
                Side::Here => here.push(item),
                Side::Front => front.push(item),
                Side::Back => back.push(item),
                Side::Both => {
                    let piece = self.piece(item);
                    let (_, heights) = plane.side_of(&piece.corners, self.surfaces.plane_tolerance);
                    front_pieces.clear();
                    back_pieces.clear();
                    piece.cut(heights, &mut front_pieces, &mut back_pieces);
                    for (pieces, side) in [(&front_pieces, &mut front), (&back_pieces, &mut back)] {
                        for &piece in pieces {
                            side.push(number(self.surfaces.of.len() + self.pieces.len()));
                            self.pieces.push(piece);
                        }
                    }
                }
            }
        }
        (here, front, back)
    }

    /// Chooses a plane that cuts few items and divides the others evenly, judged by a sample.
    fn choose(&mut self, items: &[u32]) -> Option<Chosen> {
        let count = items.len();
        let tries = match count {
            0..=50 => 24,
            51..=2000 => 48,
            _ => 72,
        };
        let mut best: Option<(f64, Plane, Option<u32>)> = None;
        for k in 0..tries.min(2 * count) {
            let at = if count <= 8 { k % count } else { self.draw.below(count) };
            let Some(plane) = self.plane(items[at]) else {
                continue;
            };
            let [here, front, back, both] = self.judge(items, plane);
            let cost = CUT * both + 0.3 * (front - back).abs() - 0.5 * here;
            if best.is_none_or(|(c, _, _)| cost < c) {
                best = Some((cost, plane, Some(items[at])));
            }
        }
        if count > LEAF {
            for axis in 0..3 {
                for k in 0..4 {
                    let at = self.draw.below(count);
                    let corner = self.corners(items[at])[k % 3];
                    let mut normal = DVec3::ZERO;
                    normal[axis] = 1.0;
                    let plane = Plane {
                        normal,
                        distance: corner[axis],
                    };
                    let [here, front, back, both] = self.judge(items, plane);
                    if front + both == 0.0 || back + both == 0.0 {
                        continue;
                    }
                    let cost = CUT * both + 0.3 * (front - back).abs() - 0.5 * here;
                    if best.is_none_or(|(c, _, _)| cost < c) {
                        best = Some((cost, plane, None));
                    }
                }
            }
        }
        // If no sample has an area, take any item with one.
        best.map(|(_, plane, of)| (plane, of))
            .or_else(|| items.iter().find_map(|&i| Some((self.plane(i)?, Some(i)))))
    }

    /// Counts a sample by side: here, front, back, both.
    fn judge(&mut self, items: &[u32], plane: Plane) -> [f64; 4] {
        let mut counts = [0.0; 4];
        let sample = items.len().min(JUDGED);
        for k in 0..sample {
            let at = if sample == items.len() {
                k
            } else {
                self.draw.below(items.len())
            };
            counts[self.side(items[at], plane) as usize] += 1.0;
        }
        counts
    }

    /// Packs items into a block; returns its place.
    pub(super) fn push_block(&mut self, lanes: &[u32]) -> u32 {
        let count = self.surfaces.of.len();
        let surfaces: Vec<u32> = lanes.iter().map(|&i| self.surface_of(i)).collect();
        let whole = Block::of(self.surfaces.of, &surfaces, self.surfaces.patch_count);
        self.bsp.fragments += lanes.len();
        if lanes.iter().all(|&i| (i as usize) < count) {
            self.bsp.lines_of_block.push(NONE);
            self.bsp.blocks.push(whole);
        } else {
            let (mut block, mut from, mut to) = (whole.clone(), whole.clone(), whole.clone());
            for (lane, &item) in lanes.iter().enumerate() {
                let piece = self.piece(item);
                for k in 0..3 {
                    for c in 0..3 {
                        block.corners[3 * k + c][lane] = piece.corners[k][c];
                        from.corners[3 * k + c][lane] = piece.lines[k][0][c];
                        to.corners[3 * k + c][lane] = piece.lines[k][1][c];
                    }
                }
                if (item as usize) >= count {
                    let surface = &self.surfaces.of[piece.surface as usize];
                    for patch in [Some(surface.front), surface.back].into_iter().flatten() {
                        self.bsp.cut_patches[patch.0 as usize / 64] |= 1 << (patch.0 % 64);
                    }
                }
            }
            self.bsp.lines_of_block.push(number(self.bsp.lines.len()));
            self.bsp.lines.push(PieceLines {
                from,
                to,
                surfaces: whole,
            });
            self.bsp.blocks.push(block);
        }
        number(self.bsp.blocks.len()) - 1
    }

    /// Packs a few items into one block with the planes that order them, if they fit.
    fn leaf(&mut self, items: &[u32]) -> Option<LayerRange> {
        let before = self.pieces.len();
        let mut planes = Vec::new();
        let mut lanes = Vec::new();
        if self.leaf_plane(items.to_vec(), &mut planes, &mut lanes).is_none() || lanes.is_empty() {
            self.pieces.truncate(before);
            return None;
        }
        self.push_block(&lanes);
        let start = number(self.bsp.planes.len());
        self.bsp.planes.extend(planes);
        let end = number(self.bsp.planes.len());
        Some(LayerRange { start, end })
    }

    /// Adds the plane of some items of a leaf, then those of either side. Returns its place; `None` if they do not fit.
    fn leaf_plane(&mut self, items: Vec<u32>, planes: &mut Vec<LeafPlane>, lanes: &mut Vec<u32>) -> Option<u8> {
        let best = items
            .iter()
            .filter_map(|&i| Some((self.plane(i)?, i)))
            .map(|(plane, of)| {
                let mut counts = [0i32; 4];
                for &i in &items {
                    counts[self.side(i, plane) as usize] += 1;
                }
                let [_, front, back, both] = counts;
                (8 * both + (front - back).abs(), plane, of)
            })
            .min_by_key(|&(cost, _, _)| cost);
        let Some((_, plane, of)) = best else {
            return Some(NO_PLANE);
        };
        if planes.len() >= LEAF_PLANES {
            return None;
        }
        let index = planes.len();
        planes.push(LeafPlane {
            normal: plane.normal,
            distance: plane.distance,
            here: 0,
            overlap: false,
            front: NO_PLANE,
            back: NO_PLANE,
        });
        let (here, front, back) = self.part(&items, plane, Some(of));
        if lanes.len() + here.len() > LANES {
            return None;
        }
        let overlapping = overlaps(&here, plane.normal, self.surfaces.plane_tolerance, |i| *self.corners(i))?;
        planes[index].overlap = !overlapping.is_empty();
        for item in here {
            planes[index].here |= 1 << lanes.len();
            lanes.push(item);
        }
        let front = self.leaf_plane(front, planes, lanes)?;
        let back = self.leaf_plane(back, planes, lanes)?;
        (planes[index].front, planes[index].back) = (front, back);
        #[allow(clippy::cast_possible_truncation, reason = "at most LEAF_PLANES")]
        Some(index as u8)
    }
}
