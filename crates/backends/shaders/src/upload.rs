//! A scene in the device's layout.
//!
//! Coordinates are pairs of f32, 48 bits together: a point near the eye keeps its precision when the eye is subtracted.
//! Each triangle owns its first corner, which carries its patches, and shares its others with any triangles of its
//! chunk. That makes about one vertex a triangle instead of three, and vertices are the slow part of a software
//! rasteriser.

use crate::chunks::{self, Chunk, MOST_OF_TILES, MOST_TRIANGLES};
use crate::limits::{Draw, Plan};
use crate::stage::binding;
use crate::view::settings_words;
use glam::DVec3;
use hemicube_contract::backend::{BackendError, Geometry, Surface};
use hemicube_contract::bvh::Bounds;
use hemicube_contract::delta::DeltaTable;
use std::borrow::Cow;
use std::collections::HashMap;
use std::sync::{Arc, OnceLock};

/// Words of a vertex: high x y z, low x y z, front patch, back patch, unit normal x y z of the triangle owning it, 0.
pub const VERTEX_WORDS: usize = 12;
/// Bytes of a vertex: attribute 0 at 0 (three f32), 1 at 12 (three f32), 2 at 24 (two u32), 3 at 32
/// (three f32).
pub const VERTEX_BYTES: u32 = 48;

/// A scene in the device's layout.
#[derive(Debug)]
pub struct Upload {
    /// Corners. See [`VERTEX_WORDS`].
    pub vertices: Vec<[u32; VERTEX_WORDS]>,
    /// Three vertices a triangle, counter-clockwise seen from the front. The first is its own.
    pub indices: Vec<u32>,
    /// Chunks in drawing order.
    pub chunks: Vec<Chunk>,
    /// The triangle of each patch: a third of the place of its first index.
    pub triangle_of_patch: Vec<u32>,
    /// The chunk of each patch.
    pub chunk_of_patch: Vec<u32>,
    /// The surface of each patch in [`Geometry::surfaces`]. Not for the device.
    pub surface_of_patch: Vec<u32>,
    /// Number of patches. It is also the id for blocked; one more is the id for escaped.
    pub patch_count: u32,
    /// Number of surfaces merged into exactly equal ones.
    pub merged: usize,
    /// See [`Upload::sides`].
    sides: OnceLock<Vec<u32>>,
}

/// The upload shared by all sessions on a scene that take chunks of at most so many triangles, or the reason against it.
struct Prepared<const MOST: u32>(Result<Arc<Upload>, String>);

/// A triangle to draw, with the patch visible on either side.
struct Drawn {
    corners: [DVec3; 3],
    front: u32,
    back: u32,
    /// True if sorting its corners turns it over.
    flipped: bool,
}

impl Upload {
    /// Prepares a scene.
    ///
    /// # Errors
    /// [`BackendError::Unsupported`] for more triangles than 32-bit indices can number.
    pub fn new(geometry: &Geometry) -> Result<Self, BackendError> {
        Self::with_chunks_of(geometry, MOST_TRIANGLES)
    }

    /// Returns the upload of a scene, made once for all sessions on it that draw so.
    ///
    /// # Errors
    /// See [`Upload::new`].
    pub fn of(geometry: &Geometry, draw: Draw) -> Result<Arc<Self>, BackendError> {
        match draw {
            Draw::Raster => Self::kept::<MOST_TRIANGLES>(geometry),
            Draw::Compute => Self::kept::<MOST_OF_TILES>(geometry),
        }
    }

    fn kept<const MOST: u32>(geometry: &Geometry) -> Result<Arc<Self>, BackendError> {
        let made = |geometry: &Geometry| Self::with_chunks_of(geometry, MOST);
        let prepared =
            geometry.kept(|geometry| Prepared::<MOST>(made(geometry).map(Arc::new).map_err(|e| e.to_string())));
        prepared.0.clone().map_err(BackendError::Unsupported)
    }

    /// Prepares a scene with at most `most` triangles a chunk. For measurements.
    ///
    /// # Errors
    /// See [`Upload::new`].
    ///
    /// # Panics
    /// When `most` is 0.
    pub fn with_chunks_of(geometry: &Geometry, most: u32) -> Result<Self, BackendError> {
        let surfaces = &geometry.surfaces;
        if surfaces.len() > (u32::MAX / 3) as usize || geometry.patch_count > u32::MAX - 4 {
            return Err(BackendError::Unsupported(format!(
                "{} surfaces are more than the {} that the corners' 32-bit numbers allow; split the scene",
                surfaces.len(),
                u32::MAX / 3
            )));
        }
        let patch_count = geometry.patch_count;
        let mut upload = Self {
            vertices: Vec::with_capacity(surfaces.len() + surfaces.len() / 4),
            indices: Vec::with_capacity(surfaces.len() * 3),
            chunks: Vec::new(),
            triangle_of_patch: vec![0; patch_count as usize],
            chunk_of_patch: vec![0; patch_count as usize],
            surface_of_patch: vec![0; patch_count as usize],
            patch_count,
            merged: 0,
            sides: OnceLock::new(),
        };
        let (drawn, drawn_of) = merge(surfaces, patch_count);
        upload.merged = surfaces.len() - drawn.iter().flatten().count();
        let mut triangle_of_surface = vec![0; surfaces.len()];
        let mut chunk_of_surface = vec![0; surfaces.len()];
        for run in chunks::runs(&geometry.octree, surfaces, most) {
            let mut order: Vec<u32> = run.filter(|&s| drawn[s as usize].is_some()).collect();
            // The first drawn of equal depths stays: draw the smaller id first.
            order.sort_by_key(|&s| drawn[s as usize].as_ref().map(|d| (d.front.min(d.back), s)));
            if order.is_empty() {
                continue;
            }
            let chunk = as_u32(upload.chunks.len());
            let mut bounds = Bounds::EMPTY;
            let first_index = as_u32(upload.indices.len());
            let mut corners = Corners::default();
            for surface in order {
                let Some(triangle) = &drawn[surface as usize] else {
                    continue;
                };
                triangle_of_surface[surface as usize] = as_u32((upload.indices.len() + corners.indices.len()) / 3);
                chunk_of_surface[surface as usize] = chunk;
                bounds = bounds.union(Bounds::of(triangle.corners));
                corners.add(triangle);
            }
            let base = as_u32(upload.vertices.len());
            upload.vertices.append(&mut corners.vertices);
            upload.indices.extend(corners.indices.iter().map(|i| base + i));
            upload.chunks.push(Chunk {
                first_index,
                index_count: as_u32(upload.indices.len()) - first_index,
                center: (bounds.low + bounds.high) * 0.5,
                half_sides: (bounds.high - bounds.low) * 0.5,
            });
        }
        for (surface, (s, &drawn)) in (0u32..).zip(surfaces.iter().zip(&drawn_of)) {
            for patch in [Some(s.front), s.back].into_iter().flatten() {
                let patch = patch.0 as usize;
                upload.surface_of_patch[patch] = surface;
                upload.triangle_of_patch[patch] = triangle_of_surface[drawn as usize];
                upload.chunk_of_patch[patch] = chunk_of_surface[drawn as usize];
            }
        }
        Ok(upload)
    }

    /// Number of triangles drawn.
    pub fn triangle_count(&self) -> usize {
        self.indices.len() / 3
    }

    /// For each side of a triangle, three times the triangle and its place: the next one between the same two corners,
    /// as in a ring. A side of one triangle alone is its own next. Only exact edges need it. O(n log n).
    pub fn sides(&self) -> &[u32] {
        self.sides.get_or_init(|| {
            let mut numbers: HashMap<[u32; 6], u32> = HashMap::with_capacity(self.vertices.len());
            let mut number = |vertex: &[u32; VERTEX_WORDS]| {
                // -0 is 0.
                let place = [0, 1, 2, 3, 4, 5].map(|k| (f32::from_bits(vertex[k]) + 0.0).to_bits());
                let next = as_u32(numbers.len());
                *numbers.entry(place).or_insert(next)
            };
            let places: Vec<u32> = self.vertices.iter().map(&mut number).collect();
            let corner = |at: usize| places[self.indices[at] as usize];
            let mut between: Vec<[u32; 3]> = (0..self.indices.len())
                .map(|side| {
                    let (a, b) = (corner(side), corner(if side % 3 == 2 { side - 2 } else { side + 1 }));
                    [a.min(b), a.max(b), as_u32(side)]
                })
                .collect();
            between.sort_unstable();
            let mut sides = vec![0; self.indices.len()];
            for ring in between.chunk_by(|p, q| p[..2] == q[..2]) {
                for (side, next) in ring.iter().zip(ring.iter().cycle().skip(1)) {
                    sides[side[2] as usize] = next[2];
                }
            }
            sides
        })
    }

    /// Computes the middle of each triangle, pairs of f32, six words each. Only covered rows need it.
    pub fn centroids(&self, geometry: &Geometry) -> Vec<u32> {
        let mut words = vec![0; 6 * self.triangle_count().max(1)];
        for (surface, s) in geometry.surfaces.iter().enumerate() {
            let patch = s.front.0 as usize;
            // A merged surface's triangle is another's, with an equal middle.
            if self.surface_of_patch[patch] as usize != surface {
                continue;
            }
            let (high, low) = split((s.corners[0] + s.corners[1] + s.corners[2]) / 3.0);
            let at = 6 * self.triangle_of_patch[patch] as usize;
            words[at..at + 3].copy_from_slice(&high.map(f32::to_bits));
            words[at + 3..at + 6].copy_from_slice(&low.map(f32::to_bits));
        }
        words
    }

    /// The words of [`Upload::chunks`], and of their runs.
    pub fn chunk_words(&self) -> Vec<u32> {
        let runs = chunks::runs_of_chunks(&self.chunks);
        self.chunks.iter().chain(&runs).flat_map(Chunk::words).collect()
    }
}

/// Lists the words written once by the host, by binding. All other buffers begin at 0.
pub fn contents<'a>(upload: &'a Upload, geometry: &Geometry, plan: &Plan) -> Vec<(u32, Cow<'a, [u32]>)> {
    let indices: Cow<'a, [u32]> = if plan.settles() {
        [upload.indices.as_slice(), upload.sides()].concat().into()
    } else {
        upload.indices.as_slice().into()
    };
    let mut contents: Vec<(u32, Cow<'a, [u32]>)> = vec![
        (binding::SETTINGS, settings_words(plan, upload).to_vec().into()),
        (binding::CHUNKS, upload.chunk_words().into()),
        (binding::VERTICES, upload.vertices.as_flattened().into()),
        (binding::INDICES, indices),
        (binding::TRIANGLE_OF_PATCH, upload.triangle_of_patch.as_slice().into()),
        (binding::CHUNK_OF_PATCH, upload.chunk_of_patch.as_slice().into()),
        (binding::WEIGHTS, DeltaTable::new(plan.resolution).weights().into()),
    ];
    if plan.covered {
        contents.push((binding::CENTROIDS, upload.centroids(geometry).into()));
    }
    contents
}

/// Merges equal triangles into the first of them; of the patches on one side, the smallest id is seen. Returns the
/// triangle drawn for each surface, if any, and the surface drawn in its place.
fn merge(surfaces: &[Surface], blocked: u32) -> (Vec<Option<Drawn>>, Vec<u32>) {
    let mut first: HashMap<[u64; 9], u32> = HashMap::with_capacity(surfaces.len());
    let mut drawn: Vec<Option<Drawn>> = Vec::with_capacity(surfaces.len());
    let mut drawn_of = Vec::with_capacity(surfaces.len());
    for (index, surface) in (0u32..).zip(surfaces) {
        let (key, flipped) = key(surface.corners);
        let (front, back) = (surface.front.0, surface.back.map_or(blocked, |p| p.0));
        let found = *first.entry(key).or_insert(index);
        drawn_of.push(found);
        let Some(Some(other)) = drawn.get_mut(found as usize) else {
            drawn.push(Some(Drawn {
                corners: surface.corners,
                front,
                back,
                flipped,
            }));
            continue;
        };
        let (front, back) = if flipped == other.flipped {
            (front, back)
        } else {
            (back, front)
        };
        other.front = other.front.min(front);
        other.back = other.back.min(back);
        drawn.push(None);
    }
    (drawn, drawn_of)
}

/// Returns a triangle's corners in ascending order, and true for an odd permutation.
fn key(corners: [DVec3; 3]) -> ([u64; 9], bool) {
    // −0 is 0.
    let mut sorted = corners.map(|p| (p + DVec3::ZERO).to_array());
    let mut flipped = false;
    for (i, j) in [(0, 1), (1, 2), (0, 1)] {
        if sorted[i].partial_cmp(&sorted[j]) == Some(std::cmp::Ordering::Greater) {
            sorted.swap(i, j);
            flipped = !flipped;
        }
    }
    let mut bits = [0; 9];
    for (bits, value) in bits.iter_mut().zip(sorted.as_flattened()) {
        *bits = value.to_bits();
    }
    (bits, flipped)
}

/// The vertices of a chunk.
#[derive(Default)]
struct Corners {
    vertices: Vec<[u32; VERTEX_WORDS]>,
    indices: Vec<u32>,
    /// True if a vertex is some triangle's first corner.
    owned: Vec<bool>,
    /// By position: any vertex there, and an unowned one, if any.
    at: HashMap<[u64; 3], (u32, Option<u32>)>,
}

impl Corners {
    fn add(&mut self, triangle: &Drawn) {
        let keys = triangle.corners.map(|p| (p + DVec3::ZERO).to_array().map(f64::to_bits));
        // Prefer for the first corner an unowned vertex, then a position without a vertex, then a further vertex.
        let free = (0..3).find(|&k| self.at.get(&keys[k]).is_some_and(|(_, free)| free.is_some()));
        let first = free
            .or_else(|| (0..3).find(|&k| !self.at.contains_key(&keys[k])))
            .unwrap_or(0);
        let turned = [first, (first + 1) % 3, (first + 2) % 3];
        for (place, k) in turned.into_iter().enumerate() {
            let own = place == 0;
            let found = self.at.get(&keys[k]).copied();
            let vertex = match found {
                Some((_, Some(free))) if own => free,
                Some((any, _)) if !own => any,
                _ => {
                    let (high, low) = split(triangle.corners[k]);
                    let [hx, hy, hz] = high.map(f32::to_bits);
                    let [lx, ly, lz] = low.map(f32::to_bits);
                    self.vertices
                        .push([hx, hy, hz, lx, ly, lz, u32::MAX, u32::MAX, 0, 0, 0, 0]);
                    self.owned.push(false);
                    as_u32(self.vertices.len() - 1)
                }
            };
            if own {
                self.owned[vertex as usize] = true;
                self.vertices[vertex as usize][6] = triangle.front;
                self.vertices[vertex as usize][7] = triangle.back;
                self.vertices[vertex as usize][8..11].copy_from_slice(&normal(&triangle.corners));
            }
            let free = (!self.owned[vertex as usize]).then_some(vertex);
            let entry = self.at.entry(keys[k]).or_insert((vertex, free));
            if own {
                entry.1 = None;
            }
            self.indices.push(vertex);
        }
    }
}

/// The words of a triangle's unit normal; 0 without an area.
fn normal(&[a, b, c]: &[DVec3; 3]) -> [u32; 3] {
    let normal = (b - a).cross(c - a).normalize_or_zero();
    #[allow(clippy::cast_possible_truncation, reason = "the shaders know the rounding")]
    normal.to_array().map(|x| (x as f32).to_bits())
}

/// Splits a point into the nearest f32s and their remainders: 48 bits together.
pub fn split(p: DVec3) -> ([f32; 3], [f32; 3]) {
    #[allow(clippy::cast_possible_truncation, reason = "the rest is kept")]
    let high = p.to_array().map(|x| x as f32);
    #[allow(clippy::cast_possible_truncation, reason = "48 bits are enough")]
    let low = [0, 1, 2].map(|k| (p[k] - f64::from(high[k])) as f32);
    (high, low)
}

#[allow(clippy::cast_possible_truncation, reason = "checked in `Upload::with_chunks_of`")]
fn as_u32(n: usize) -> u32 {
    n as u32
}
