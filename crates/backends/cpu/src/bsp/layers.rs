//! The surfaces of a plane, packed into blocks under trees of boxes, in layers where they overlap.

use super::build::Builder;
use super::overlap::{Pair, overlaps};
use super::piece::Bounds;
use super::{LayerNode, LayerRange, NONE, number};
use crate::kernel::{BOXES, BoxGroup};
use glam::DVec3;
use hemicube_contract::bvh::LANES;

/// Number of slices that items are sorted into to find where to halve them.
const BINS: usize = 32;

impl Builder<'_> {
    /// The id of a surface in a plane, seen from one side of it.
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

    /// Packs the surfaces of a plane for an eye on either side; `None` if too many overlap.
    pub(super) fn pack_plane(&mut self, items: &[u32], normal: DVec3) -> Option<[LayerRange; 2]> {
        let overlaps = overlaps(items, normal, self.surfaces.plane_tolerance, |i| *self.corners(i))?;
        if items.is_empty() {
            return Some([LayerRange::default(); 2]);
        }
        if overlaps.is_empty() {
            let packs = self.pack_layers(vec![items.to_vec()]);
            return Some([packs; 2]);
        }
        let [front, back] = [true, false].map(|from_front| self.layers_of(items, normal, from_front, &overlaps));
        Some([self.pack_layers(front), self.pack_layers(back)])
    }

    /// Sorts the items of a plane into layers without overlap, the one to be drawn first ahead.
    fn layers_of(&self, items: &[u32], normal: DVec3, from_front: bool, overlaps: &[Pair]) -> Vec<Vec<u32>> {
        // Ascending by visible id: each item above the overlapping ones that win over it.
        let seen: Vec<u32> = items.iter().map(|&i| self.seen(i, normal, from_front)).collect();
        let mut order: Vec<usize> = (0..items.len()).collect();
        order.sort_unstable_by_key(|&k| (seen[k], items[k]));
        let mut rank = vec![0; items.len()];
        for (r, &k) in order.iter().enumerate() {
            rank[k] = r;
        }
        let mut wins_over: Vec<Vec<usize>> = vec![Vec::new(); items.len()];
        for &(p, q) in overlaps {
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
    }

    fn pack_layers(&mut self, layers: Vec<Vec<u32>>) -> LayerRange {
        let roots: Vec<u32> = layers.into_iter().map(|layer| self.pack(layer)).collect();
        let start = number(self.bsp.layers.len());
        self.bsp.layers.extend(roots);
        let end = number(self.bsp.layers.len());
        LayerRange { start, end }
    }

    /// Packs items without overlap into blocks under a tree of boxes; returns its root.
    fn pack(&mut self, mut items: Vec<u32>) -> u32 {
        let root = self.layer_node();
        let len = items.len();
        let mut pending = vec![(root, 0..len)];
        while let Some((node, range)) = pending.pop() {
            // Halve the part with the largest surface as long as the node has room.
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
                    self.bsp.layer_nodes[node as usize].boxes.leaves |= 1 << l;
                    self.push_block(lanes)
                } else {
                    let child = self.layer_node();
                    pending.push((child, range));
                    child
                };
                let (center, half) = (bounds.center(), bounds.half());
                let node = &mut self.bsp.layer_nodes[node as usize];
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

    /// Adds a node without boxes.
    fn layer_node(&mut self) -> u32 {
        self.bsp.layer_nodes.push(LayerNode {
            boxes: BoxGroup {
                center: [[0.0; BOXES]; 3],
                half: [[0.0; BOXES]; 3],
                leaves: 0,
            },
            child: [NONE; BOXES],
            used: 0,
        });
        number(self.bsp.layer_nodes.len()) - 1
    }

    fn bounds_of(&self, items: &[u32]) -> Bounds {
        items
            .iter()
            .fold(Bounds::EMPTY, |b, &i| b.union(Bounds::of(self.corners(i))))
    }

    /// Sorts items so that the two halves lie apart; returns the size of the first.
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

    /// The axis to sort items along, and the size of the first half: minimises the sum of the halves' box surfaces
    /// times their numbers of blocks (MacDonald & Booth 1990), in whole blocks to keep lanes full.
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
            // Sweep up: surface and number of items before each bin. Then sweep down, from each bin on.
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
}
