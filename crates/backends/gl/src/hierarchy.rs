//! A hierarchy over the chunks of a scene, and the walk of it by frustum with three outcomes. The other backends cull
//! by shaders alone, so only this one has the file.
//!
//! The hierarchy is the scene's octree down to a level, over the drawn chunks, after Vázquez and Guartes 2017. Chunks
//! of a node's own triangles are leaves beside its children: leaves in order are chunks in order.
//!
//! A face is the intersection of four half-spaces through the eye. The ten sides of the five faces lie in seven planes:
//! x ± y = 0, z ± x = 0, z ± y = 0 and z = 0. A box with centre c and half sides h lies within n·c ± |n|·h of each. The
//! faces share no inner point: a box inside one is outside the others.
//!
//! *Coherence*: consecutive hemicubes see much the same. Nodes seen by the one before on any of its faces are taken for
//! visible at once, the rest is tested behind them. The thesis keeps them apart by the nearest face of the hemicube
//! before. Here hemicubes are turned about their normals at random: faces do not correspond, and the frustum sorts the
//! nodes out.

use glam::DVec3;
use hemicube_contract::backend::Hemicube;
use hemicube_contract::face::Face;
use hemicube_shaders::Upload;
use hemicube_spatial::Octree;
use std::ops::Range;

/// A box: its centre, and half its sides, a hair wider than its contents.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct CullBox {
    pub(crate) center: DVec3,
    pub(crate) half: DVec3,
}

impl CullBox {
    fn union(boxes: impl Iterator<Item = Self>) -> Self {
        let (low, high) = boxes.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), b| {
            (low.min(b.center - b.half), high.max(b.center + b.half))
        });
        Self {
            center: (low + high) * 0.5,
            half: (high - low) * 0.5 + DVec3::splat(1e-15),
        }
    }
}

/// A chunk in the hierarchy: its first item of the octree, its triangles, and its box.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Run {
    pub(crate) first_item: u32,
    pub(crate) triangles: u32,
    pub(crate) bounds: CullBox,
}

/// Makes the runs of a scene's chunks, for [`Hierarchy::new`].
pub(crate) fn runs(upload: &Upload) -> Vec<Run> {
    let mut found: Vec<Run> = upload
        .chunks
        .iter()
        .map(|chunk| Run {
            first_item: u32::MAX,
            triangles: chunk.index_count / 3,
            // Wider than the rounding of positions to two f32 each.
            bounds: CullBox {
                center: chunk.center,
                half: chunk.half_sides * (1.0 + 1e-6) + DVec3::splat(1e-9),
            },
        })
        .collect();
    for (&chunk, &surface) in upload.chunk_of_patch.iter().zip(&upload.surface_of_patch) {
        // The first of equal triangles is drawn: the smallest number is that of a surface in the chunk.
        let first = &mut found[chunk as usize].first_item;
        *first = surface.min(*first);
    }
    found
}

/// A node of the hierarchy.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Node {
    pub(crate) bounds: CullBox,
    /// The chunks beneath it.
    pub(crate) chunks: Range<u32>,
    /// One past the last node beneath it. A node stands before its children, and its descendants follow it at once.
    pub(crate) skip: u32,
    /// Number of triangles beneath it.
    pub(crate) triangles: u32,
    /// The node above it; the root's is itself.
    pub(crate) parent: u32,
}

impl Node {
    /// Returns whether nothing but chunks is beneath it; `place` is its own.
    pub(crate) fn is_leaf(&self, place: u32) -> bool {
        self.skip == place + 1
    }
}

/// The octree over chunks: the root first, then each node before its descendants.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Hierarchy {
    pub(crate) nodes: Vec<Node>,
}

/// The sources of a hierarchy.
struct Making<'a> {
    octree: &'a Octree,
    chunks: &'a [Run],
    max_level: u32,
}

impl Hierarchy {
    /// Puts the nodes of `octree` down to `max_level` over the chunks, in the order of its items. A chunk reaching from
    /// one node into another belongs to the first.
    pub(crate) fn new(octree: &Octree, chunks: &[Run], max_level: u32) -> Self {
        let mut made = Self::default();
        if !octree.nodes().is_empty() {
            made.add(
                &Making {
                    octree,
                    chunks,
                    max_level,
                },
                0,
            );
        }
        for place in 0..made.count() {
            let children: Vec<u32> = made.children(place, made.nodes[place as usize].skip).collect();
            for child in children {
                made.nodes[child as usize].parent = place;
            }
        }
        made
    }

    /// Adds an octree node with its descendants. Recursion is no deeper than the octree.
    fn add(&mut self, making: &Making<'_>, index: u32) {
        let node = &making.octree.nodes()[index as usize];
        let within = |items: Range<u32>| {
            let place =
                |item: u32| u32::try_from(making.chunks.partition_point(|c| c.first_item < item)).unwrap_or(u32::MAX);
            place(items.start)..place(items.end)
        };
        let all = within(node.all());
        if all.len() <= 1 || node.is_leaf() || node.level >= making.max_level {
            self.add_run(making, all);
            return;
        }
        let place = self.begin();
        for chunk in within(node.own()) {
            self.add_run(making, chunk..chunk + 1);
        }
        for child in node.children() {
            self.add(making, child);
        }
        self.end(place);
    }

    /// Adds a node with nothing beneath it but chunks; nothing for none.
    fn add_run(&mut self, making: &Making<'_>, run: Range<u32>) {
        let chunks = &making.chunks[run.start as usize..run.end as usize];
        if chunks.is_empty() {
            return;
        }
        let bounds = CullBox::union(chunks.iter().map(|c| c.bounds));
        let triangles = chunks.iter().map(|c| c.triangles).sum();
        self.nodes.push(Node {
            bounds,
            chunks: run,
            skip: self.count() + 1,
            triangles,
            parent: 0,
        });
    }

    /// Begins a node; its children follow.
    fn begin(&mut self) -> u32 {
        let place = self.count();
        let bounds = CullBox {
            center: DVec3::ZERO,
            half: DVec3::ZERO,
        };
        self.nodes.push(Node {
            bounds,
            chunks: 0..0,
            skip: 0,
            triangles: 0,
            parent: 0,
        });
        place
    }

    fn end(&mut self, place: u32) {
        let skip = self.count();
        if self.nodes.get(place as usize + 1).is_none_or(|only| only.skip == skip) {
            // A node with a single child says no more than the child, and one without any nothing at all.
            self.nodes.remove(place as usize);
            for node in &mut self.nodes[place as usize..] {
                node.skip -= 1;
            }
            return;
        }
        let children: Vec<&Node> = self.children(place, skip).map(|c| &self.nodes[c as usize]).collect();
        let bounds = CullBox::union(children.iter().map(|c| c.bounds));
        let triangles = children.iter().map(|c| c.triangles).sum();
        let chunks = children[0].chunks.start..children[children.len() - 1].chunks.end;
        self.nodes[place as usize] = Node {
            bounds,
            chunks,
            skip,
            triangles,
            parent: 0,
        };
    }

    /// The children of a node ending before `skip`.
    fn children(&self, place: u32, skip: u32) -> impl Iterator<Item = u32> + '_ {
        let first = place + 1;
        std::iter::successors((first < skip).then_some(first), move |&child| {
            let next = self.nodes[child as usize].skip;
            (next < skip).then_some(next)
        })
    }

    fn count(&self) -> u32 {
        u32::try_from(self.nodes.len()).unwrap_or(u32::MAX)
    }
}

/// All five faces.
pub(crate) const ALL_FACES: u8 = 0b1_1111;

/// The planes between the faces of one hemicube.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FacePlanes {
    eye: DVec3,
    /// z, x + y, x − y, z + x, z − x, z + y, z − y.
    normals: [DVec3; 7],
    /// The normals with all components positive.
    reach: [DVec3; 7],
    tolerance: f64,
}

impl FacePlanes {
    pub(crate) fn new(hemicube: &Hemicube, plane_tolerance: f64) -> Self {
        let [x, y, z] = hemicube.axes;
        let normals = [z, x + y, x - y, z + x, z - x, z + y, z - y];
        Self {
            eye: hemicube.origin,
            normals,
            reach: normals.map(DVec3::abs),
            tolerance: plane_tolerance,
        }
    }

    /// Returns the faces possibly showing a box, and true if it lies wholly inside a single one.
    pub(crate) fn faces_of(&self, bounds: &CullBox, faces: u8) -> (u8, bool) {
        let offset = bounds.center - self.eye;
        let mut high = [false; 7];
        let mut low = [false; 7];
        for k in 0..7 {
            let (middle, reach) = (self.normals[k].dot(offset), self.reach[k].dot(bounds.half));
            high[k] = middle + reach >= 0.0;
            low[k] = middle - reach <= 0.0;
        }
        let z = self.normals[0].dot(offset) + self.reach[0].dot(bounds.half) > self.tolerance;
        if !z {
            return (0, false);
        }
        let [_, sum, difference, z_and_x, z_less_x, z_and_y, z_less_y] = [0, 1, 2, 3, 4, 5, 6];
        // `high`: some of the box has the value positive or 0; `low`: some of it negative or 0.
        let touches = [
            high[z_and_x] && high[z_less_x] && high[z_and_y] && high[z_less_y],
            high[sum] && high[difference] && low[z_less_x],
            low[sum] && low[difference] && low[z_and_x],
            high[sum] && low[difference] && low[z_less_y],
            low[sum] && high[difference] && low[z_and_y],
        ];
        let mut touched = 0;
        for face in Face::ALL {
            touched |= u8::from(touches[face as usize]) << face as u8;
        }
        touched &= faces;
        // Above the horizon the faces have no gap between them: a box touching one of them, and not the horizon, lies
        // in that one.
        (touched, touched.count_ones() == 1 && !low[0])
    }
}

/// The counters of a walk.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct WalkCounters {
    pub(crate) tested: u64,
    pub(crate) outside: u64,
}

/// The step below a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Descend {
    Yes,
    No,
}

impl Hierarchy {
    /// Visits the nodes possibly in view beneath `from`, known to touch `faces`: each before its children, by its place
    /// and the faces possibly showing it.
    pub(crate) fn walk(
        &self,
        from: u32,
        faces: u8,
        planes: &FacePlanes,
        counters: &mut WalkCounters,
        mut visit: impl FnMut(u32, u8) -> Descend,
    ) {
        let Some(root) = self.nodes.get(from as usize) else {
            return;
        };
        let end = root.skip;
        let mut place = from;
        // Faces of the nodes on the way down, each until its end; the last is the nearest above.
        let mut above: Vec<(u32, u8, bool)> = vec![(end, faces, false)];
        while place < end {
            while above.last().is_some_and(|&(until, ..)| until <= place) && above.len() > 1 {
                above.pop();
            }
            let Some(&(_, faces, inside)) = above.last() else {
                return;
            };
            let node = &self.nodes[place as usize];
            let (faces, inside) = if inside {
                (faces, true)
            } else {
                counters.tested += 1;
                planes.faces_of(&node.bounds, faces)
            };
            if faces == 0 {
                counters.outside += 1;
                place = node.skip;
                continue;
            }
            if visit(place, faces) == Descend::No {
                place = node.skip;
                continue;
            }
            if node.skip > place + 1 {
                above.push((node.skip, faces, inside));
            }
            place += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hemicube_spatial::{Aabb, OctreeOptions};

    /// Small triangles in a cube, in some fixed disorder, in the order of an octree over them.
    fn scattered(count: u32) -> (Octree, Vec<[DVec3; 3]>) {
        let mut state = 12_345_u64;
        let mut next = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as f64 / f64::from(1u32 << 30) - 1.0
        };
        let triangles: Vec<[DVec3; 3]> = (0..count)
            .map(|_| {
                let at = DVec3::new(next(), next(), next());
                [(); 3].map(|()| at + 0.1 * DVec3::new(next(), next(), next()))
            })
            .collect();
        let boxes: Vec<Aabb> = triangles.iter().map(|t| Aabb::from_points(*t)).collect();
        let octree = Octree::build_loose(
            &boxes,
            OctreeOptions {
                max_level: 16,
                min_items: 16,
            },
        )
        .expect("finite boxes");
        let ordered = octree.order().iter().map(|&k| triangles[k as usize]).collect();
        (octree, ordered)
    }

    fn hemicube() -> Hemicube {
        let z = DVec3::new(0.3, -0.5, 0.8).normalize();
        let x = z.any_orthonormal_vector();
        Hemicube {
            emitter: None,
            origin: DVec3::new(0.1, 0.2, -0.3),
            axes: [x, z.cross(x), z],
        }
    }

    /// Chunks of twenty triangles each.
    fn in_twenties(triangles: &[[DVec3; 3]]) -> Vec<Run> {
        let runs = triangles.chunks(20).zip((0u32..).step_by(20));
        runs.map(|(run, first_item)| {
            let b = Aabb::from_points(run.iter().flatten().copied());
            let bounds = CullBox {
                center: b.center(),
                half: b.half_extent() + 1e-12,
            };
            Run {
                first_item,
                triangles: u32::try_from(run.len()).expect("twenty"),
                bounds,
            }
        })
        .collect()
    }

    #[test]
    fn nodes_hold_the_chunks_beneath_them_in_order() {
        let (octree, triangles) = scattered(3000);
        let chunks = in_twenties(&triangles);
        for max_level in [16, 3, 1, 0] {
            let hierarchy = Hierarchy::new(&octree, &chunks, max_level);
            let mut next = 0;
            for (place, node) in (0u32..).zip(&hierarchy.nodes) {
                assert!(node.skip > place && node.skip as usize <= hierarchy.nodes.len());
                if node.is_leaf(place) {
                    assert_eq!(node.chunks.start, next, "leaves follow on each other");
                    next = node.chunks.end;
                }
                let chunks = &chunks[node.chunks.start as usize..node.chunks.end as usize];
                assert_eq!(chunks.iter().map(|c| c.triangles).sum::<u32>(), node.triangles);
                for chunk in chunks {
                    let away = (chunk.bounds.center - node.bounds.center).abs() + chunk.bounds.half;
                    assert!(
                        away.cmple(node.bounds.half + 1e-12).all(),
                        "a chunk is outside its node"
                    );
                }
            }
            assert_eq!(next as usize, chunks.len(), "every chunk is in a leaf");
            assert_eq!(hierarchy.nodes.len() == 1, max_level == 0);
        }
    }

    #[test]
    fn no_corner_in_view_is_culled_and_much_else_is() {
        let (octree, triangles) = scattered(3000);
        let chunks = in_twenties(&triangles);
        let hierarchy = Hierarchy::new(&octree, &chunks, 16);
        let hemicube = hemicube();
        let planes = FacePlanes::new(&hemicube, 1e-10);
        let mut found = vec![0u8; chunks.len()];
        let mut counters = WalkCounters::default();
        hierarchy.walk(0, ALL_FACES, &planes, &mut counters, |place, faces| {
            let node = &hierarchy.nodes[place as usize];
            if node.is_leaf(place) {
                for chunk in node.chunks.clone() {
                    found[chunk as usize] |= faces;
                }
            }
            Descend::Yes
        });
        let mut on = [0; 5];
        for (run, faces) in triangles.chunks(20).zip(&found) {
            for &corner in run.iter().flatten() {
                let d = hemicube.axes.map(|a| a.dot(corner - hemicube.origin));
                for face in Face::ALL {
                    let (axis, sign) = face.axes();
                    let [u, v, w] = [0, 1, 2].map(|c| sign[c] * d[axis[c]]);
                    let bottom = if face.is_top() { -w } else { 0.0 };
                    if w > 0.0 && u.abs() < w && v < w && v > bottom {
                        assert!(
                            faces >> face as u8 & 1 == 1,
                            "{corner} is seen on {face:?}, its chunk not"
                        );
                        on[face as usize] += 1;
                    }
                }
            }
        }
        assert!(on.iter().all(|&n| n > 100), "every face sees some: {on:?}");
        let seen: u32 = found.iter().map(|f| f.count_ones()).sum();
        assert!(
            counters.outside > 4 && (seen as usize) < 3 * found.len(),
            "{counters:?}, {seen} of {}",
            found.len()
        );
        assert!(found.contains(&0), "what lies below the horizon is culled");
    }

    #[test]
    fn a_walk_from_a_node_finds_what_the_walk_from_the_root_finds_there() {
        let (octree, triangles) = scattered(2000);
        let hierarchy = Hierarchy::new(&octree, &in_twenties(&triangles), 16);
        let planes = FacePlanes::new(&hemicube(), 1e-10);
        let leaves_from = |from: u32, faces: u8| {
            let mut found = Vec::new();
            hierarchy.walk(from, faces, &planes, &mut WalkCounters::default(), |place, faces| {
                if hierarchy.nodes[place as usize].is_leaf(place) {
                    found.push((place, faces));
                }
                Descend::Yes
            });
            found
        };
        let whole = leaves_from(0, ALL_FACES);
        let mut from = 1;
        while from < hierarchy.nodes[0].skip {
            let skip = hierarchy.nodes[from as usize].skip;
            let expected: Vec<_> = whole
                .iter()
                .filter(|(place, _)| (from..skip).contains(place))
                .copied()
                .collect();
            assert_eq!(leaves_from(from, ALL_FACES), expected);
            from = skip;
        }
        assert!(!whole.is_empty());
    }
}
