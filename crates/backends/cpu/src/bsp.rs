//! A scene in an order that can be drawn strictly front to back from any eye: what engine `order` walks.
//!
//! A binary space partition (Fuchs, Kedem & Naylor 1980) in f64. Planes are those of surfaces, or run along an axis
//! where that cuts nothing; surfaces in a plane are packed into blocks of sixteen under a small tree of boxes. Where
//! few surfaces are left, they share one block and a list of planes that gives the order of its lanes, for a block of
//! sixteen is drawn at little more than the price of one surface.
//!
//! A surface that a plane cuts becomes pieces. A piece's outer edges keep the line of the edge they are part of, and
//! both sides of a cut share its two end points, so that pieces are as watertight as whole surfaces are, to the bit.
//!
//! `order.rs` builds the partition: planes of surfaces, or along an axis, that cut few of a sample; what lies in a
//! plane is packed into blocks of sixteen, in layers where surfaces overlap so that the smaller id is drawn first; a
//! handful of surfaces shares one block with a list of planes that gives the lanes' order. Surfaces of a layer hide
//! nothing of each other, so that all boxes of it, eight at a time, are tested before any is drawn, and the blocks to
//! be drawn are known and fetched ahead: in large scenes both engines wait for memory. Pieces of cut surfaces keep the
//! lines of the edges they are part of, and are as watertight as whole ones. A scene that falls into more than 1.4
//! pieces a surface, or whose blocks stay almost empty, gets *depth* or *claims*: real city models do, whose terrain
//! runs under the buildings. Where patches see a third of the scene, which a few are asked when it is loaded, and
//! blocks are not well filled, *depth* draws everything, unless what was cut is ordered and of few triangles.

use crate::kernel::{BOXES, BoxGroup};
use glam::DVec3;
use hemicube_contract::backend::{Geometry, Surface};
use hemicube_contract::bvh::{Block, LANES, sorted_corners};

/// A node of the partition.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct PlaneNode {
    pub(crate) center: DVec3,
    pub(crate) half: DVec3,
    pub(crate) normal: DVec3,
    pub(crate) distance: f64,
    /// What lies in front of the plane and behind it: a node, or `NONE`.
    pub(crate) front: u32,
    pub(crate) back: u32,
    /// What lies in the plane, for an eye in front of it and behind it; in a leaf both are its list of planes.
    pub(crate) here: [LayerRange; 2],
    /// True if this is a leaf.
    pub(crate) is_leaf: bool,
}

/// Some trees of boxes over blocks, drawn one after the other: a range of [`BspTree::layers`]. In a leaf: a range of
/// [`BspTree::planes`].
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
    /// True if those overlap, so that their ids decide which is seen.
    pub(crate) overlap: bool,
    /// The leaf's planes in front and behind, from its first one, or `NO_PLANE`.
    pub(crate) front: u8,
    pub(crate) back: u8,
}

/// No node.
pub(crate) const NONE: u32 = u32::MAX;
/// No plane of a leaf.
pub(crate) const NO_PLANE: u8 = u8::MAX;

/// The lines that edges of a block's pieces lie on, and the surfaces they are part of.
#[derive(Clone, Debug)]
pub(crate) struct PieceLines {
    /// Where the line of edge k begins and ends, as if it were corner k.
    pub(crate) from: Block,
    pub(crate) to: Block,
    /// The surfaces.
    pub(crate) surfaces: Block,
}

/// A node of a layer's tree of boxes: its children.
#[derive(Clone, Debug)]
pub(crate) struct LayerNode {
    pub(crate) boxes: BoxGroup,
    /// What the boxes are around: blocks and nodes.
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
    /// For each block, which of `lines` its pieces have, or `NONE` where all its surfaces are whole.
    pub(crate) lines_of_block: Vec<u32>,
    pub(crate) lines: Vec<PieceLines>,
    /// Bit set of the patches with a surface in pieces.
    cut_patches: Vec<u64>,
    /// Lanes in use.
    fragments: usize,
    surfaces: usize,
}

/// A part of a surface that planes cut.
#[derive(Clone, Copy, Debug)]
struct Piece {
    corners: [DVec3; 3],
    /// The line that the edge opposite each corner lies on.
    lines: [[DVec3; 2]; 3],
    surface: u32,
}

impl Piece {
    /// All of a surface, its corners sorted as in blocks.
    fn whole(surface: u32, corners: [DVec3; 3]) -> Self {
        let ([a, b, c], _) = sorted_corners(corners);
        Self {
            corners: [a, b, c],
            lines: [[b, c], [c, a], [a, b]],
            surface,
        }
    }
}

fn plane(&[a, b, c]: &[DVec3; 3]) -> Option<(DVec3, f64)> {
    let normal = (b - a).cross(c - a);
    let length = normal.length();
    (length > 1e-28).then(|| {
        let normal = normal / length;
        (normal, normal.dot(a))
    })
}

#[derive(Clone, Copy, Debug)]
struct Bounds {
    low: DVec3,
    high: DVec3,
}

impl Bounds {
    fn of(&[a, b, c]: &[DVec3; 3]) -> Self {
        Self {
            low: a.min(b).min(c),
            high: a.max(b).max(c),
        }
    }

    const EMPTY: Self = Self {
        low: DVec3::INFINITY,
        high: DVec3::NEG_INFINITY,
    };

    fn union(self, other: Self) -> Self {
        Self {
            low: self.low.min(other.low),
            high: self.high.max(other.high),
        }
    }

    fn center(self) -> DVec3 {
        (self.low + self.high) * 0.5
    }

    fn twice_center(self) -> DVec3 {
        self.low + self.high
    }

    /// Half the surface; 0 of nothing.
    fn area(self) -> f64 {
        let d = (self.high - self.low).max(DVec3::ZERO);
        d.x * d.y + d.y * d.z + d.z * d.x
    }

    /// Half the sides, a hair wider than what lies in them, as the middle and the halves are rounded.
    fn half(self) -> DVec3 {
        (self.high - self.low) * (0.5 * (1.0 + 1e-12)) + DVec3::splat(1e-15)
    }
}

/// Which side of a plane a piece lies on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Side {
    Here,
    Front,
    Back,
    Both,
}

fn side_of(corners: &[DVec3; 3], (normal, distance): (DVec3, f64), tolerance: f64) -> (Side, [f64; 3]) {
    let heights = corners.map(|p| {
        let height = normal.dot(p) - distance;
        if height.abs() <= tolerance { 0.0 } else { height }
    });
    let above = heights.iter().any(|&h| h > 0.0);
    let below = heights.iter().any(|&h| h < 0.0);
    let side = match (above, below) {
        (false, false) => Side::Here,
        (true, false) => Side::Front,
        (false, true) => Side::Back,
        (true, true) => Side::Both,
    };
    (side, heights)
}

/// The parts of a piece in front of a plane and behind it.
fn cut(piece: &Piece, heights: [f64; 3], front: &mut Vec<Piece>, back: &mut Vec<Piece>) {
    // Corners of the two parts in the piece's winding; beside each, the line of the edge that leaves it.
    let mut parts: [Vec<(DVec3, [DVec3; 2])>; 2] = [Vec::with_capacity(4), Vec::with_capacity(4)];
    let mut crossings = Vec::with_capacity(2);
    for k in 0..3 {
        let next = (k + 1) % 3;
        // The edge from corner k to the next is opposite the third.
        let line = piece.lines[(k + 2) % 3];
        let (p, q) = (piece.corners[k], piece.corners[next]);
        let (hp, hq) = (heights[k], heights[next]);
        if hp >= 0.0 {
            parts[0].push((p, line));
        }
        if hp <= 0.0 {
            parts[1].push((p, line));
        }
        if hp == 0.0 {
            crossings.push(p);
        }
        if hp * hq < 0.0 {
            // From the same end whichever way round, so that two surfaces that share the edge cut it at the same point.
            let (a, b, ha, hb) = if (p.x, p.y, p.z) < (q.x, q.y, q.z) {
                (p, q, hp, hq)
            } else {
                (q, p, hq, hp)
            };
            let at = a + (b - a) * (ha / (ha - hb));
            crossings.push(at);
            parts[0].push((at, line));
            parts[1].push((at, line));
        }
    }
    let &[first, second] = crossings.as_slice() else {
        return;
    };
    for (part, out) in parts.iter_mut().zip([front, back]) {
        // The edge that runs along the cut leaves the first of two neighbours that are both crossings.
        let count = part.len();
        for k in 0..count {
            let (p, q) = (part[k].0, part[(k + 1) % count].0);
            if (p == first && q == second) || (p == second && q == first) {
                // In one direction for both parts: the sign is put right by the caller of the lines' product.
                part[k].1 = [p, q];
            }
        }
        for k in 1..count.saturating_sub(1) {
            let (a, b, c) = (part[0], part[k], part[k + 1]);
            let last = k + 2 == count;
            // The diagonals between the triangles of a fan are lines of their own, shared by both.
            let ab = if k == 1 { a.1 } else { [a.0, b.0] };
            let ca = if last { c.1 } else { [c.0, a.0] };
            out.push(Piece {
                corners: [a.0, b.0, c.0],
                lines: [b.1, ca, ab],
                surface: piece.surface,
            });
        }
    }
}

/// Numbers that the choice of planes, and tests, are drawn with: the same in every run.
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

/// Into how many slices items are sorted to find where to halve them.
const BINS: usize = 32;
/// Number of surfaces that share a leaf's block at most.
const LEAF: usize = 12;
/// Number of planes that a leaf has at most.
const LEAF_PLANES: usize = 40;
/// What cutting one item costs, where having it in the plane gains ½: pieces multiply from plane to plane.
const CUT: f64 = 8.0;
/// Number of pieces that a plane is judged by.
const JUDGED: usize = 200;

/// What an order may cost at most.
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

/// What is put in order.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Surfaces<'g> {
    pub(crate) of: &'g [Surface],
    /// The patches that they may be: their ids are below this.
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

struct Builder<'g> {
    surfaces: Surfaces<'g>,
    /// The surfaces by their patches, so that the order does not depend on how the geometry was put together.
    by_patch: Vec<u32>,
    order: BspTree,
    /// What was cut. An item below the number of surfaces is a whole surface, one above is a piece.
    pieces: Vec<Piece>,
    draw: Lcg,
    /// Number of pieces at most.
    limit: usize,
}

/// Items waiting for their node, and where that is to be noted: the parent, and whether it lies in front.
struct Task {
    items: Vec<u32>,
    parent: u32,
    in_front: bool,
}

impl BspTree {
    /// Puts a scene in order, or gives up where surfaces would fall into too many pieces or lie in too many layers.
    pub(crate) fn new(surfaces: Surfaces<'_>, limits: Limits) -> Result<Self, GivenUp> {
        let count = surfaces.of.len();
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a count of surfaces, times a small factor"
        )]
        let limit = (count as f64 * (limits.fragments - 1.0)) as usize;
        let limit = limit.saturating_add(64);
        #[allow(clippy::cast_possible_truncation, reason = "at most 2³¹ surfaces")]
        let mut by_patch: Vec<u32> = (0..count as u32).collect();
        by_patch.sort_unstable_by_key(|&s| surfaces.of[s as usize].front.0);
        let mut builder = Builder {
            surfaces,
            by_patch,
            order: Self {
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
        Ok(builder.order)
    }

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

impl Builder<'_> {
    fn corners(&self, item: u32) -> &[DVec3; 3] {
        let item = item as usize;
        let count = self.surfaces.of.len();
        if item < count {
            &self.surfaces.of[self.by_patch[item] as usize].corners
        } else {
            &self.pieces[item - count].corners
        }
    }

    fn surface_of(&self, item: u32) -> u32 {
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

    /// The plane of an item's surface: pieces can be too thin to tell.
    fn plane(&self, item: u32) -> Option<(DVec3, f64)> {
        plane(&self.surfaces.of[self.surface_of(item) as usize].corners)
    }

    fn side(&self, item: u32, plane: (DVec3, f64)) -> Side {
        side_of(self.corners(item), plane, self.surfaces.plane_tolerance).0
    }

    fn build(&mut self) -> Result<(), GivenUp> {
        #[allow(clippy::cast_possible_truncation, reason = "at most 2³¹ surfaces")]
        let items: Vec<u32> = (0..self.surfaces.of.len() as u32).collect();
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
            #[allow(clippy::cast_possible_truncation, reason = "fewer nodes than fragments")]
            let index = self.order.nodes.len() as u32;
            let leaf = if items.len() <= LEAF { self.leaf(&items) } else { None };
            if let Some(leaf) = leaf {
                node.is_leaf = true;
                node.here = [leaf; 2];
                #[allow(clippy::cast_possible_truncation, reason = "fewer blocks than fragments")]
                let block = self.order.blocks.len() as u32 - 1;
                node.front = block;
            } else {
                let Some((plane, of)) = self.choose(&items) else {
                    // Nothing that has an area.
                    continue;
                };
                (node.normal, node.distance) = plane;
                let (here, front, back) = self.part(&items, plane, of);
                if self.pieces.len() > self.limit {
                    return Err(GivenUp::Pieces);
                }
                node.here = self.pack_plane(&here, plane.0).ok_or(GivenUp::Layers)?;
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
            self.order.nodes.push(node);
            if let Some(parent) = self.order.nodes.get_mut(parent as usize) {
                if in_front {
                    parent.front = index;
                } else {
                    parent.back = index;
                }
            }
        }
        Ok(())
    }

    /// Parts items by a plane; those it cuts become pieces on both sides.
    ///
    /// The item that the plane is of always lies in it: of a sliver, rounding could say otherwise, for ever.
    fn part(&mut self, items: &[u32], plane: (DVec3, f64), of: Option<u32>) -> (Vec<u32>, Vec<u32>, Vec<u32>) {
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
                    let (_, heights) = side_of(&piece.corners, plane, self.surfaces.plane_tolerance);
                    front_pieces.clear();
                    back_pieces.clear();
                    cut(&piece, heights, &mut front_pieces, &mut back_pieces);
                    for (pieces, side) in [(&front_pieces, &mut front), (&back_pieces, &mut back)] {
                        for &piece in pieces {
                            #[allow(clippy::cast_possible_truncation, reason = "limited")]
                            side.push((self.surfaces.of.len() + self.pieces.len()) as u32);
                            self.pieces.push(piece);
                        }
                    }
                }
            }
        }
        (here, front, back)
    }

    /// A plane that cuts few items and parts the others evenly, judged by a sample.
    fn choose(&mut self, items: &[u32]) -> Option<((DVec3, f64), Option<u32>)> {
        let count = items.len();
        let tries = match count {
            0..=50 => 24,
            51..=2000 => 48,
            _ => 72,
        };
        let mut best: Option<(f64, (DVec3, f64), Option<u32>)> = None;
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
                    let plane = (normal, corner[axis]);
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
        // Where no sample has an area, look for any item that has.
        best.map(|(_, plane, of)| (plane, of))
            .or_else(|| items.iter().find_map(|&i| Some((self.plane(i)?, Some(i)))))
    }

    /// Numbers of a sample that lie here, in front, behind, and on both sides.
    fn judge(&mut self, items: &[u32], plane: (DVec3, f64)) -> [f64; 4] {
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

    /// The id that an eye on one side of a plane sees of a surface in it.
    fn seen(&self, item: u32, normal: DVec3, from_front: bool) -> u32 {
        let surface = &self.surfaces.of[self.surface_of(item) as usize];
        let [a, b, c] = surface.corners;
        let along = (b - a).cross(c - a).dot(normal) > 0.0;
        if along == from_front {
            surface.front.0
        } else {
            surface.back.map_or(self.surfaces.patch_count, |p| p.0)
        }
    }

    /// LayerRange what lies in a plane, for an eye on either side of it.
    ///
    /// `None` where too many overlap.
    fn pack_plane(&mut self, items: &[u32], normal: DVec3) -> Option<[LayerRange; 2]> {
        let overlaps = overlaps(items, normal, self.surfaces.plane_tolerance, |i| *self.corners(i))?;
        let layers_of = |from_front: bool| {
            // In ascending order of what is seen: each above the overlapping ones that win over it.
            let seen: Vec<u32> = items.iter().map(|&i| self.seen(i, normal, from_front)).collect();
            let mut order: Vec<usize> = (0..items.len()).collect();
            order.sort_unstable_by_key(|&k| (seen[k], items[k]));
            let mut rank = vec![0; items.len()];
            for (r, &k) in order.iter().enumerate() {
                rank[k] = r;
            }
            let mut wins_over: Vec<Vec<usize>> = vec![Vec::new(); items.len()];
            for &(p, q) in &overlaps {
                let (first, second) = if rank[p] < rank[q] { (p, q) } else { (q, p) };
                wins_over[first].push(second);
            }
            let mut level = vec![0usize; items.len()];
            for &k in &order {
                for &over in &wins_over[k] {
                    level[over] = level[over].max(level[k] + 1);
                }
            }
            let mut layers = vec![Vec::new(); level.iter().max().map_or(0, |m| m + 1)];
            for (k, &level) in level.iter().enumerate() {
                layers[level].push(items[k]);
            }
            layers
        };
        if items.is_empty() {
            return Some([LayerRange::default(); 2]);
        }
        if overlaps.is_empty() {
            let packs = self.pack_layers(vec![items.to_vec()]);
            return Some([packs; 2]);
        }
        let (front, back) = (layers_of(true), layers_of(false));
        Some([self.pack_layers(front), self.pack_layers(back)])
    }

    fn pack_layers(&mut self, layers: Vec<Vec<u32>>) -> LayerRange {
        let roots: Vec<u32> = layers.into_iter().map(|layer| self.pack(layer)).collect();
        #[allow(clippy::cast_possible_truncation, reason = "fewer layers than fragments")]
        let start = self.order.layers.len() as u32;
        self.order.layers.extend(roots);
        #[allow(clippy::cast_possible_truncation, reason = "fewer layers than fragments")]
        let end = self.order.layers.len() as u32;
        LayerRange { start, end }
    }

    /// LayerRange items that do not overlap into blocks under a tree of boxes; returns its root.
    fn pack(&mut self, mut items: Vec<u32>) -> u32 {
        let root = self.layer_node();
        let len = items.len();
        let mut pending = vec![(root, 0..len)];
        while let Some((node, range)) = pending.pop() {
            // Parts of what the node is around, each with its box; the one of the largest surface is halved as long as
            // there is room.
            let mut parts = vec![(self.bounds_of(&items[range.clone()]), range)];
            while parts.len() < BOXES {
                let halved = parts
                    .iter()
                    .enumerate()
                    .filter(|(_, (_, range))| range.len() > LANES)
                    .max_by(|(p, (a, _)), (q, (b, _))| a.area().total_cmp(&b.area()).then(q.cmp(p)));
                let Some((place, (_, range))) = halved else {
                    break;
                };
                let range = range.clone();
                let middle = range.start + self.halve(&mut items[range.clone()]);
                parts[place] = (self.bounds_of(&items[range.start..middle]), range.start..middle);
                parts.push((self.bounds_of(&items[middle..range.end]), middle..range.end));
            }
            for (l, (bounds, range)) in parts.into_iter().enumerate() {
                let child = if range.len() <= LANES {
                    let lanes = &mut items[range];
                    lanes.sort_unstable_by_key(|&i| (self.surfaces.of[self.surface_of(i) as usize].front.0, i));
                    self.order.layer_nodes[node as usize].boxes.leaves |= 1 << l;
                    self.push_block(lanes)
                } else {
                    let child = self.layer_node();
                    pending.push((child, range));
                    child
                };
                let (center, half) = (bounds.center(), bounds.half());
                let node = &mut self.order.layer_nodes[node as usize];
                node.used |= 1 << l;
                node.child[l] = child;
                for axis in 0..3 {
                    node.boxes.center[axis][l] = center[axis];
                    node.boxes.half[axis][l] = half[axis];
                }
            }
        }
        root
    }

    /// A new node without boxes.
    fn layer_node(&mut self) -> u32 {
        self.order.layer_nodes.push(LayerNode {
            boxes: BoxGroup {
                center: [[0.0; BOXES]; 3],
                half: [[0.0; BOXES]; 3],
                leaves: 0,
            },
            child: [NONE; BOXES],
            used: 0,
        });
        #[allow(clippy::cast_possible_truncation, reason = "fewer nodes than fragments")]
        {
            self.order.layer_nodes.len() as u32 - 1
        }
    }

    fn bounds_of(&self, items: &[u32]) -> Bounds {
        items
            .iter()
            .fold(Bounds::EMPTY, |b, &i| b.union(Bounds::of(self.corners(i))))
    }

    /// Sorts items so that the two halves lie apart; returns how many the first has.
    fn halve(&self, items: &mut [u32]) -> usize {
        let centers = items.iter().fold(Bounds::EMPTY, |b, &i| {
            let c = Bounds::of(self.corners(i)).twice_center();
            b.union(Bounds { low: c, high: c })
        });
        let (axis, first) = self.halves(items, centers);
        let center = |i: u32| Bounds::of(self.corners(i)).twice_center()[axis];
        items.select_nth_unstable_by(first, |&p, &q| center(p).total_cmp(&center(q)).then(p.cmp(&q)));
        first
    }

    /// Along which axis to sort items, and how many of them make up the first half: so that the two halves' boxes, each
    /// as often as it has blocks, have the least surface (MacDonald & Booth 1990), in whole blocks, which keeps lanes
    /// full.
    fn halves(&self, items: &[u32], centers: Bounds) -> (usize, usize) {
        let len = items.len();
        let extent = centers.high - centers.low;
        let widest = (0..3).fold(0, |best, a| if extent[a] > extent[best] { a } else { best });
        let whole_blocks = |first: usize| ((first + LANES / 2) / LANES * LANES).clamp(LANES, (len - 1) / LANES * LANES);
        let mut best = (f64::INFINITY, widest, whole_blocks(len / 2));
        for axis in 0..3 {
            if extent[axis] <= 0.0 {
                continue;
            }
            let scale = BINS as f64 / extent[axis];
            let mut bins = [(Bounds::EMPTY, 0usize); BINS];
            for &item in items {
                let b = Bounds::of(self.corners(item));
                #[allow(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    reason = "a place below BINS"
                )]
                let at = ((b.twice_center()[axis] - centers.low[axis]) * scale) as usize;
                let bin = &mut bins[at.min(BINS - 1)];
                *bin = (bin.0.union(b), bin.1 + 1);
            }
            // What lies before each bin, and then what lies from it on.
            let mut before = [(0.0, 0usize); BINS];
            let mut around = (Bounds::EMPTY, 0);
            for (bin, before) in bins.iter().zip(&mut before) {
                *before = (around.0.area(), around.1);
                around = (around.0.union(bin.0), around.1 + bin.1);
            }
            around = (Bounds::EMPTY, 0);
            for (bin, &(area, first)) in bins.iter().zip(&before).skip(1).rev() {
                around = (around.0.union(bin.0), around.1 + bin.1);
                if first == 0 || around.1 == 0 {
                    continue;
                }
                let blocks = |count: usize| count.div_ceil(LANES) as f64;
                let cost = area * blocks(first) + around.0.area() * blocks(around.1);
                if cost < best.0 {
                    best = (cost, axis, whole_blocks(first));
                }
            }
        }
        (best.1, best.2)
    }

    fn push_block(&mut self, lanes: &[u32]) -> u32 {
        let count = self.surfaces.of.len();
        let surfaces: Vec<u32> = lanes.iter().map(|&i| self.surface_of(i)).collect();
        let whole = Block::of(self.surfaces.of, &surfaces, self.surfaces.patch_count);
        self.order.fragments += lanes.len();
        if lanes.iter().all(|&i| (i as usize) < count) {
            self.order.lines_of_block.push(NONE);
            self.order.blocks.push(whole);
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
                        self.order.cut_patches[patch.0 as usize / 64] |= 1 << (patch.0 % 64);
                    }
                }
            }
            #[allow(clippy::cast_possible_truncation, reason = "fewer blocks than fragments")]
            self.order.lines_of_block.push(self.order.lines.len() as u32);
            self.order.lines.push(PieceLines {
                from,
                to,
                surfaces: whole,
            });
            self.order.blocks.push(block);
        }
        #[allow(clippy::cast_possible_truncation, reason = "fewer blocks than fragments")]
        {
            self.order.blocks.len() as u32 - 1
        }
    }

    /// Puts a few items into one block with the planes that order them, if they fit.
    fn leaf(&mut self, items: &[u32]) -> Option<LayerRange> {
        let before = self.pieces.len();
        let mut planes = Vec::new();
        let mut lanes = Vec::new();
        if self.leaf_plane(items.to_vec(), &mut planes, &mut lanes).is_none() || lanes.is_empty() {
            self.pieces.truncate(before);
            return None;
        }
        self.push_block(&lanes);
        #[allow(clippy::cast_possible_truncation, reason = "fewer planes than fragments")]
        let start = self.order.planes.len() as u32;
        self.order.planes.extend(planes);
        #[allow(clippy::cast_possible_truncation, reason = "fewer planes than fragments")]
        let end = self.order.planes.len() as u32;
        Some(LayerRange { start, end })
    }

    /// The plane for some items of a leaf, with what lies on either side; `None` where they do not fit.
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
            normal: plane.0,
            distance: plane.1,
            here: 0,
            overlap: false,
            front: NO_PLANE,
            back: NO_PLANE,
        });
        let (here, front, back) = self.part(&items, plane, Some(of));
        if lanes.len() + here.len() > LANES {
            return None;
        }
        let overlapping = overlaps(&here, plane.0, self.surfaces.plane_tolerance, |i| *self.corners(i))?;
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

/// Pairs of overlapping surfaces in a plane that an order may have for each of them, and how many beside. A scene with
/// more is a heap of copies, whose layers would be as many.
const OVERLAPS: (usize, usize) = (16, 10_000);

/// A surface in its plane, seen along the axis that the plane faces most.
#[derive(Clone, Copy)]
struct Flat {
    place: usize,
    low: [f64; 2],
    high: [f64; 2],
}

impl Flat {
    fn meets(&self, other: &Self) -> bool {
        (0..2).all(|a| self.low[a] < other.high[a] && other.low[a] < self.high[a])
    }

    fn around(items: &[Self]) -> Self {
        let mut around = Self {
            place: 0,
            low: [f64::INFINITY; 2],
            high: [f64::NEG_INFINITY; 2],
        };
        for item in items {
            for a in 0..2 {
                around.low[a] = around.low[a].min(item.low[a]);
                around.high[a] = around.high[a].max(item.high[a]);
            }
        }
        around
    }
}

/// Sorts items so that halves of halves lie apart.
fn halve(items: &mut [Flat]) {
    if items.len() <= FEW {
        return;
    }
    let around = Flat::around(items);
    let axis = usize::from(around.high[1] - around.low[1] > around.high[0] - around.low[0]);
    let middle = items.len() / 2;
    items.select_nth_unstable_by(middle, |p, q| {
        (p.low[axis] + p.high[axis])
            .total_cmp(&(q.low[axis] + q.high[axis]))
            .then(p.place.cmp(&q.place))
    });
    let (first, second) = items.split_at_mut(middle);
    halve(first);
    halve(second);
}

/// So few items are compared each with each.
const FEW: usize = 8;

/// Which pairs of items in a plane have a common inside, by their places; `None` where there are too many.
fn overlaps(
    items: &[u32],
    normal: DVec3,
    touch: f64,
    corners: impl Fn(u32) -> [DVec3; 3],
) -> Option<Vec<(usize, usize)>> {
    if items.len() < 2 {
        return Some(Vec::new());
    }
    let size = normal.abs();
    let (u, v) = if size.x >= size.y && size.x >= size.z {
        (1, 2)
    } else if size.y >= size.z {
        (0, 2)
    } else {
        (0, 1)
    };
    let flat = items.iter().enumerate().map(|(place, &item)| {
        let b = Bounds::of(&corners(item));
        Flat {
            place,
            low: [b.low[u] + touch, b.low[v] + touch],
            high: [b.high[u] - touch, b.high[v] - touch],
        }
    });
    let mut flat: Vec<Flat> = flat.collect();
    halve(&mut flat);
    let most = OVERLAPS.0 * items.len() + OVERLAPS.1;
    let mut found = Vec::new();
    // Two sets whose boxes meet, or one set with itself: halved until few are left.
    let mut pending = vec![(0..flat.len(), 0..flat.len())];
    while let Some((first, second)) = pending.pop() {
        let with_itself = first == second;
        if !with_itself && !Flat::around(&flat[first.clone()]).meets(&Flat::around(&flat[second.clone()])) {
            continue;
        }
        let halves = |range: &std::ops::Range<usize>| {
            let middle = range.start + range.len() / 2;
            if range.len() > FEW {
                [range.start..middle, middle..range.end]
            } else {
                [range.clone(), range.end..range.end]
            }
        };
        if first.len() > FEW || second.len() > FEW {
            let ([a, b], [c, d]) = (halves(&first), halves(&second));
            let pairs = if with_itself {
                vec![(a.clone(), a), (b.clone(), b.clone()), (c, b)]
            } else {
                vec![(a.clone(), c.clone()), (a, d.clone()), (b.clone(), c), (b, d)]
            };
            pending.extend(pairs.into_iter().filter(|(p, q)| !p.is_empty() && !q.is_empty()));
            continue;
        }
        for p in first.clone() {
            for q in if with_itself { p + 1..first.end } else { second.clone() } {
                let (p, q) = (&flat[p], &flat[q]);
                let overlap = p.meets(q)
                    && hemicube_contract::bvh::overlap(
                        &corners(items[p.place]),
                        &corners(items[q.place]),
                        normal,
                        touch,
                    );
                if overlap {
                    found.push((p.place.min(q.place), p.place.max(q.place)));
                }
            }
        }
        if found.len() > most {
            return None;
        }
    }
    // In the order of the items, whatever way they were found.
    found.sort_unstable();
    Some(found)
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

    /// The blocks that an eye in front of all planes, or behind all of them, is shown.
    fn blocks_seen(order: &BspTree, side: usize) -> Vec<u32> {
        let mut seen = Vec::new();
        for node in &order.nodes {
            if node.is_leaf {
                seen.push(node.front);
                continue;
            }
            let mut pending = order.layers[node.here[side].start as usize..node.here[side].end as usize].to_vec();
            while let Some(at) = pending.pop() {
                let node = &order.layer_nodes[at as usize];
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
            let order = BspTree::new(geometry.as_ref().into(), ANY).expect("no limit");
            for side in 0..2 {
                let mut areas = vec![0.0; geometry.patch_count as usize];
                let mut lanes = vec![0; geometry.patch_count as usize];
                for block in blocks_seen(&order, side) {
                    let block = &order.blocks[block as usize];
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
                    assert_eq!(lanes[patch as usize] > 1, order.is_cut(patch), "patch {patch}");
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
        let order = BspTree::new(soup.geometry().as_ref().into(), ANY).expect("no limit");
        assert!(order.fragments_per_surface() > 1.2, "{order}");
    }

    #[test]
    fn overlaps_are_those_of_all_pairs() {
        let mut draw = Lcg(5);
        let mut coordinate = |most: f64| draw.below(1 << 20) as f64 / f64::from(1 << 20) * most;
        let triangles: Vec<[DVec3; 3]> = (0..300)
            .map(|_| {
                let at = DVec3::new(coordinate(8.0), coordinate(8.0), 0.0);
                [0, 1, 2].map(|_| at + DVec3::new(coordinate(0.7), coordinate(0.7), 0.0))
            })
            .collect();
        let items: Vec<u32> = (0..300).collect();
        let of = |i: u32| triangles[i as usize];
        let mut each: Vec<(usize, usize)> = Vec::new();
        for p in 0..300usize {
            for q in p + 1..300 {
                if hemicube_contract::bvh::overlap(&triangles[p], &triangles[q], DVec3::Z, 1e-10) {
                    each.push((p, q));
                }
            }
        }
        assert!(each.len() > 100, "{}", each.len());
        assert_eq!(overlaps(&items, DVec3::Z, 1e-10, of), Some(each));
    }

    #[test]
    fn a_heap_of_copies_is_given_up() {
        let triangle = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let items: Vec<u32> = (0..4000).collect();
        assert_eq!(overlaps(&items, DVec3::Z, 1e-10, |_| triangle), None);
    }

    #[test]
    fn overlapping_surfaces_in_a_plane_lie_in_layers() {
        let square = |x: f64, z: f64| {
            [
                DVec3::new(x, 0.0, z),
                DVec3::new(x + 1.0, 0.0, z),
                DVec3::new(x, 1.0, z),
            ]
        };
        let triangles = [square(0.0, 0.0), square(0.5, 0.0), square(2.0, 0.0)];
        let of = |i: u32| triangles[i as usize];
        assert_eq!(overlaps(&[0, 1, 2], DVec3::Z, 1e-10, of), Some(vec![(0, 1)]));
        assert_eq!(overlaps(&[0, 2], DVec3::Z, 1e-10, of), Some(Vec::new()));
    }
}
