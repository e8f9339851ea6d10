//! How much of a triangle another one sees: the shaft between the two lists what may come in between, and rays at those
//! few occluders measure the visible fraction.
//!
//! The shaft (Haines & Wallace 1991) is the convex hull of the two triangles. What lies outside one of its planes cannot
//! come in between; an empty shaft proves that all is visible. The planes of the two triangles themselves are among its
//! planes, so that neighbours, coplanar triangles and the two themselves are left out with no offset along the rays.
//!
//! The visible fraction is Σ k V / Σ k over points drawn on both triangles, with the same points above and below and the
//! kernel k = cos φ_i cos φ_j / r² as weight: times the closed form it gives F_ij without the bias of uniform visibility.
#![allow(
    unsafe_code,
    reason = "functions compiled for an instruction set are called after it was found"
)]

use crate::factor::point_to_triangle;
use crate::tree::{INNER, LANES, Tree, UNUSED};
use glam::DVec3;

/// Rays cast together.
pub(crate) const RAYS: usize = 16;

/// What lies within this part of the pair's extent of a shaft's plane counts as outside.
const OUTSIDE: f64 = 4e-6;

/// A triangle that may come in between, relative to the shaft's origin.
#[derive(Clone, Copy, Debug)]
struct Occluder {
    corner: [f32; 3],
    edges: [[f32; 3]; 2],
    normal: [f32; 3],
}

/// The shaft between two triangles, and what may come in between. Reused from pair to pair.
#[derive(Debug, Default)]
pub(crate) struct Shaft {
    /// n · p ≥ d inside.
    planes: Vec<([f64; 3], f64)>,
    occluders: Vec<Occluder>,
    pending: Vec<u32>,
    low: [f64; 3],
    high: [f64; 3],
    pair: Pair,
}

/// Two triangles relative to a corner of the first.
#[derive(Clone, Copy, Debug, Default)]
struct Pair {
    from: [DVec3; 3],
    to: [DVec3; 3],
    /// Nearer than 0.6 times their radii: a few rays carry most of the weight.
    near: bool,
}

impl Shaft {
    /// Builds the shaft between two patches of a scene and lists what may come in between; returns how many.
    pub(crate) fn build(&mut self, tree: &Tree, (i, from): (u32, &[DVec3; 3]), (j, to): (u32, &[DVec3; 3])) -> usize {
        let origin = from[0];
        let local = |t: &[DVec3; 3]| t.map(|p| p - origin);
        let (from, to) = (local(from), local(to));
        let points = [from[0], from[1], from[2], to[0], to[1], to[2]];
        let size = points.iter().map(|p| p.length_squared()).fold(0.0, f64::max).sqrt();
        let sphere = |t: &[DVec3; 3]| {
            let center = (t[0] + t[1] + t[2]) / 3.0;
            (center, t.iter().map(|p| p.distance(center)).fold(0.0, f64::max))
        };
        let ((c0, r0), (c1, r1)) = (sphere(&from), sphere(&to));
        self.pair = Pair {
            from,
            to,
            near: c0.distance(c1) < 0.6 * (r0 + r1),
        };
        let (mut low, mut high) = (DVec3::ZERO, DVec3::ZERO);
        for p in points {
            low = low.min(p);
            high = high.max(p);
        }
        let slack = DVec3::splat(OUTSIDE * size);
        (self.low, self.high) = ((low - slack).to_array(), (high + slack).to_array());
        self.make_planes(&points, size);
        self.list_occluders(tree, origin, OUTSIDE * size, [i, j]);
        self.occluders.len()
    }

    fn make_planes(&mut self, points: &[DVec3; 6], size: f64) {
        self.planes.clear();
        // Only what rises above the emitter and lies in front of the receiver can be in the way.
        for [a, b, c] in [[0, 1, 2], [3, 4, 5]] {
            if let Some(n) = (points[b] - points[a]).cross(points[c] - points[a]).try_normalize() {
                self.planes.push((n.to_array(), n.dot(points[a])));
            }
        }
        let flat = 2e-6 * size;
        let mut add = |a: usize, b: usize, c: usize| {
            let n = (points[b] - points[a]).cross(points[c] - points[a]);
            if n.length() <= 1e-9 * size * size {
                return;
            }
            let n = n.normalize();
            let d = n.dot(points[a]);
            let (mut least, mut most) = (0.0f64, 0.0f64);
            for p in points {
                let s = n.dot(*p) - d;
                least = least.min(s);
                most = most.max(s);
            }
            if least >= -flat && most > flat {
                self.planes.push((n.to_array(), d));
            } else if most <= flat && least < -flat {
                self.planes.push(((-n).to_array(), -d));
            }
        };
        for k in 0..3 {
            let next = (k + 1) % 3;
            for e in 0..3 {
                add(k, next, 3 + e);
                add(3 + k, 3 + next, e);
            }
        }
    }

    fn list_occluders(&mut self, tree: &Tree, origin: DVec3, outside: f64, own: [u32; 2]) {
        self.occluders.clear();
        self.pending.clear();
        self.pending.push(0);
        let own_slots = own.map(|p| tree.slot_of_patch[p as usize]);
        'nodes: while let Some(index) = self.pending.pop() {
            let node = &tree.nodes[index as usize];
            let c = (node.center - origin).to_array();
            let h = node.half.to_array();
            for a in 0..3 {
                if c[a] + h[a] < self.low[a] || c[a] - h[a] > self.high[a] {
                    continue 'nodes;
                }
            }
            for (n, d) in &self.planes {
                let most = n[0] * c[0] + n[1] * c[1] + n[2] * c[2] - d
                    + n[0].abs() * h[0]
                    + n[1].abs() * h[1]
                    + n[2].abs() * h[2];
                if most <= outside {
                    continue 'nodes;
                }
            }
            if node.block == INNER {
                self.pending.extend([node.child, node.child + 1]);
                continue;
            }
            let block = &tree.blocks[node.block as usize];
            let mut kept = dispatch_inside(&block.corners, origin.to_array(), &self.planes, outside);
            while kept != 0 {
                let l = kept.trailing_zeros() as usize;
                kept &= kept - 1;
                #[allow(clippy::cast_possible_truncation, reason = "slots are u32")]
                let slot = (node.block as usize * LANES + l) as u32;
                if block.negative[l] == UNUSED || own_slots.contains(&slot) {
                    continue;
                }
                let corner = |k: usize| {
                    DVec3::new(
                        block.corners[3 * k][l],
                        block.corners[3 * k + 1][l],
                        block.corners[3 * k + 2][l],
                    ) - origin
                };
                let (a, b, c) = (corner(0), corner(1), corner(2));
                let (least, most) = (a.min(b).min(c).to_array(), a.max(b).max(c).to_array());
                if (0..3).any(|x| most[x] < self.low[x] || least[x] > self.high[x]) {
                    continue;
                }
                #[allow(
                    clippy::cast_possible_truncation,
                    reason = "relative to the pair, f32 is enough for rays"
                )]
                let single = |p: DVec3| p.to_array().map(|x| x as f32);
                let (e, f) = (b - a, c - a);
                self.occluders.push(Occluder {
                    corner: single(a),
                    edges: [single(e), single(f)],
                    normal: single(e.cross(f)),
                });
            }
        }
    }

    /// Casts the rays `start..end` of a sequence (multiples of 16) and adds (Σ k V, Σ k) to `sums`.
    pub(crate) fn cast(&self, start: usize, end: usize, seed: u64, sums: &mut (f64, f64)) {
        // With few rays, weighting each emitter point by its closed form costs more than it gives.
        let stratified = self.pair.near && end >= 512;
        let shift = shifts(seed);
        let mut group = Group::new();
        let mut at = start;
        while at < end {
            let x = group.draw(&self.pair, at, &shift, stratified);
            dispatch_hits(&self.occluders, &mut group);
            let (mut seen, mut whole) = (0.0, 0.0);
            for l in 0..RAYS {
                let weight = f64::from(group.weight[l]);
                whole += weight;
                seen += if group.hit[l] == 0 { weight } else { 0.0 };
            }
            if let Some(x) = x {
                let [a, b, c] = self.pair.from;
                let normal = (b - a).cross(c - a).normalize_or_zero();
                let factor = point_to_triangle(x, normal, &self.pair.to);
                if whole > 0.0 && factor > 0.0 {
                    sums.0 += factor * seen / whole;
                    sums.1 += factor;
                }
            } else {
                sums.0 += seen;
                sums.1 += whole;
            }
            at += RAYS;
        }
    }
}

/// Sixteen rays from points of one triangle to points of the other; the other point at parameter 1.
#[repr(C, align(64))]
struct Group {
    origin: [[f32; RAYS]; 3],
    direction: [[f32; RAYS]; 3],
    weight: [f32; RAYS],
    hit: [u32; RAYS],
}

/// Steps of additive sequences in four and in two dimensions: powers of the roots of x^(d+1) = x + 1 (Roberts 2018).
const STEPS_4: [f64; 4] = [
    0.856_674_883_854_502_9,
    0.733_891_856_627_126,
    0.628_706_721_037_808_7,
    0.538_597_257_223_610_1,
];
const STEPS_2: [f64; 2] = [0.754_877_666_246_692_7, 0.569_840_290_998_053_2];

fn shifts(seed: u64) -> [f64; 4] {
    let mut state = seed;
    std::array::from_fn(|_| {
        // SplitMix64 (Steele, Lea & Flood 2014).
        state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^= z >> 31;
        f64::from((z >> 32) as u32) / 4_294_967_296.0
    })
}

impl Group {
    fn new() -> Self {
        Self {
            origin: [[0.0; RAYS]; 3],
            direction: [[0.0; RAYS]; 3],
            weight: [0.0; RAYS],
            hit: [0; RAYS],
        }
    }

    /// Draws the rays `at..at + 16`. When `stratified`, all start at one point, which is returned.
    fn draw(&mut self, pair: &Pair, at: usize, shift: &[f64; 4], stratified: bool) -> Option<DVec3> {
        let fold = |u: f64, v: f64| if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
        let wrapped = |x: f64| x - x.floor();
        let point = |t: &[DVec3; 3], (u, v): (f64, f64)| t[0] + (t[1] - t[0]) * u + (t[2] - t[0]) * v;
        let n_from = (pair.from[1] - pair.from[0]).cross(pair.from[2] - pair.from[0]);
        let n_to = (pair.to[1] - pair.to[0]).cross(pair.to[2] - pair.to[0]);
        let group = (at / RAYS + 1) as f64;
        let common = stratified.then(|| {
            point(
                &pair.from,
                fold(
                    wrapped(shift[0] + STEPS_2[0] * group),
                    wrapped(shift[1] + STEPS_2[1] * group),
                ),
            )
        });
        for l in 0..RAYS {
            let k = (at + l + 1) as f64;
            let (x, y) = if let Some(x) = common {
                let k = (l + 1) as f64;
                let u = wrapped(shift[2] + STEPS_2[0] * k + 0.618_033_988_749_895 * group);
                let v = wrapped(shift[3] + STEPS_2[1] * k + 0.414_213_562_373_095 * group);
                (x, point(&pair.to, fold(u, v)))
            } else {
                let u: [f64; 4] = std::array::from_fn(|a| wrapped(shift[a] + STEPS_4[a] * k));
                (point(&pair.from, fold(u[0], u[1])), point(&pair.to, fold(u[2], u[3])))
            };
            let d = y - x;
            let r2 = d.length_squared();
            // In front of both, or no weight.
            let kernel = n_from.dot(d).max(0.0) * (-n_to.dot(d)).max(0.0) / (r2 * r2);
            #[allow(clippy::cast_possible_truncation, reason = "weights and rays relative to the pair")]
            {
                self.weight[l] = if kernel.is_finite() { kernel as f32 } else { 0.0 };
                for a in 0..3 {
                    self.origin[a][l] = x[a] as f32;
                    self.direction[a][l] = d[a] as f32;
                }
            }
        }
        common
    }
}

/// Which of 16 triangles reach inside all planes, one bit each.
#[inline(always)]
fn inside(corners: &[[f64; LANES]; 9], origin: [f64; 3], planes: &[([f64; 3], f64)], outside: f64) -> u16 {
    let mut kept = [1u64; LANES];
    for (n, d) in planes {
        for l in 0..LANES {
            let height = |k: usize| {
                n[0] * (corners[3 * k][l] - origin[0])
                    + n[1] * (corners[3 * k + 1][l] - origin[1])
                    + n[2] * (corners[3 * k + 2][l] - origin[2])
            };
            let (a, b, c) = (height(0), height(1), height(2));
            let most = if a > b { a } else { b };
            let most = if most > c { most } else { c };
            kept[l] &= u64::from(most - d > outside);
        }
    }
    let mut mask = 0;
    for (l, &k) in kept.iter().enumerate() {
        mask |= u16::from(k != 0) << l;
    }
    mask
}

/// Marks the rays of a group that an occluder stops strictly between their ends (Möller & Trumbore 1997).
#[inline(always)]
fn hits(occluders: &[Occluder], group: &mut Group) {
    let mut hit = [0u32; RAYS];
    for (count, t) in occluders.iter().enumerate() {
        let ([e, f], n) = (t.edges, t.normal);
        for l in 0..RAYS {
            let d = [group.direction[0][l], group.direction[1][l], group.direction[2][l]];
            let s = [
                group.origin[0][l] - t.corner[0],
                group.origin[1][l] - t.corner[1],
                group.origin[2][l] - t.corner[2],
            ];
            let inverse = -1.0 / (d[0] * n[0] + d[1] * n[1] + d[2] * n[2]);
            let at = (s[0] * n[0] + s[1] * n[1] + s[2] * n[2]) * inverse;
            let q = [
                s[1] * d[2] - s[2] * d[1],
                s[2] * d[0] - s[0] * d[2],
                s[0] * d[1] - s[1] * d[0],
            ];
            let u = (f[0] * q[0] + f[1] * q[1] + f[2] * q[2]) * inverse;
            let v = -(e[0] * q[0] + e[1] * q[1] + e[2] * q[2]) * inverse;
            hit[l] |= u32::from((at > 1e-6) & (at < 1.0 - 1e-6) & (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0));
        }
        // When every ray is stopped, the rest cannot change anything.
        if count % 8 == 7 && hit.iter().all(|&h| h != 0) {
            break;
        }
    }
    group.hit = hit;
}

macro_rules! dispatch {
    ($name:ident, $body:ident, ($($arg:ident: $type:ty),*) $(-> $out:ty)?) => {
        fn $name($($arg: $type),*) $(-> $out)? {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl")]
                fn avx512($($arg: $type),*) $(-> $out)? {
                    $body($($arg),*)
                }
                #[target_feature(enable = "avx2")]
                fn avx2($($arg: $type),*) $(-> $out)? {
                    $body($($arg),*)
                }
                if is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512bw")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512vl")
                {
                    // SAFETY: the processor has the instruction set.
                    return unsafe { avx512($($arg),*) };
                }
                if is_x86_feature_detected!("avx2") {
                    // SAFETY: the processor has AVX2.
                    return unsafe { avx2($($arg),*) };
                }
            }
            $body($($arg),*)
        }
    };
}

dispatch!(
    dispatch_inside,
    inside,
    (corners: &[[f64; LANES]; 9], origin: [f64; 3], planes: &[([f64; 3], f64)], outside: f64) -> u16
);
dispatch!(dispatch_hits, hits, (occluders: &[Occluder], group: &mut Group));

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{HierarchyOptions, Model};
    use hemicube_scene::{InputPatch, Patches, Scene, Subdivision, Triangle};

    /// A unit square at z = 0 facing up, one at z = 1 facing down, and whatever else.
    fn scene(more: &[[DVec3; 3]]) -> Model {
        let p = DVec3::new;
        let mut triangles = vec![
            [p(0., 0., 0.), p(1., 0., 0.), p(1., 1., 0.)],
            [p(0., 0., 0.), p(1., 1., 0.), p(0., 1., 0.)],
            [p(0., 0., 1.), p(1., 1., 1.), p(1., 0., 1.)],
            [p(0., 0., 1.), p(0., 1., 1.), p(1., 1., 1.)],
        ];
        triangles.extend_from_slice(more);
        let scene = Scene {
            triangles: triangles
                .into_iter()
                .map(|corners| Triangle {
                    corners,
                    object: 0,
                    material: 0,
                    face: 0,
                    two_sided: false,
                })
                .collect(),
            ..Scene::default()
        };
        let patches = Patches::new(&scene, Subdivision::None).expect("patches");
        Model::new(patches.into(), HierarchyOptions::default()).expect("a model")
    }

    fn fraction(model: &Model, i: u32, j: u32, rays: usize) -> (usize, f64) {
        let corners = |p: u32| model.patches().corners(InputPatch(p)).map(|c| model.normalise(c));
        let mut shaft = Shaft::default();
        let count = shaft.build(model.geometry().tree(), (i, &corners(i)), (j, &corners(j)));
        let mut sums = (0.0, 0.0);
        shaft.cast(0, rays, 1, &mut sums);
        (count, sums.0 / sums.1)
    }

    #[test]
    fn nothing_between_is_proved() {
        let model = scene(&[]);
        assert_eq!(fraction(&model, 0, 2, 16), (0, 1.0));
    }

    #[test]
    fn what_is_beside_above_or_below_is_not_between() {
        let p = DVec3::new;
        let model = scene(&[
            [p(2., 0., 0.5), p(3., 0., 0.5), p(2., 1., 0.5)],
            [p(0., 0., 1.5), p(1., 0., 1.5), p(0., 1., 1.5)],
            [p(0., 0., -0.5), p(1., 0., -0.5), p(0., 1., -0.5)],
        ]);
        assert_eq!(fraction(&model, 0, 2, 16).0, 0);
    }

    #[test]
    fn half_an_obstruction_hides_half() {
        let p = DVec3::new;
        // The View3D square obstruction: a quarter of the middle plane; F falls from 0.199825 to 0.149869.
        let (a, b, c, d) = (p(0., 0., 0.5), p(0.5, 0., 0.5), p(0.5, 0.5, 0.5), p(0., 0.5, 0.5));
        let model = scene(&[[a, b, c], [a, c, d]]);
        let rule = crate::factor::FactorRule::for_tolerance(1e-4);
        let corners = |p: u32| model.patches().corners(InputPatch(p)).map(|c| model.normalise(c));
        let (mut open, mut seen) = (0.0, 0.0);
        for i in 0..2 {
            for j in 2..4 {
                let (_, v) = fraction(&model, i, j, 1 << 14);
                let exchange = crate::factor::exchange(&corners(i), &corners(j), &rule);
                open += exchange;
                seen += v * exchange;
            }
        }
        let ratio = 0.149_868_671_773_8 / 0.199_824_895_698_387;
        assert!((seen / open / ratio - 1.0).abs() < 2e-3, "{} {ratio}", seen / open);
    }

    #[test]
    fn a_wall_hides_everything() {
        let p = DVec3::new;
        let model = scene(&[[p(-9., -9., 0.5), p(9., -9., 0.5), p(0., 20., 0.5)]]);
        assert_eq!(fraction(&model, 0, 2, 64), (1, 0.0));
    }

    #[test]
    fn every_path_gives_the_same_hits() {
        let p = DVec3::new;
        let model = scene(&[[p(0.2, 0.1, 0.5), p(0.9, 0.3, 0.4), p(0.4, 0.8, 0.6)]]);
        let corners = |k: u32| model.patches().corners(InputPatch(k)).map(|c| model.normalise(c));
        let mut shaft = Shaft::default();
        assert_eq!(
            shaft.build(model.geometry().tree(), (0, &corners(0)), (2, &corners(2))),
            1
        );
        for at in (0..512).step_by(RAYS) {
            let (mut a, mut b) = (Group::new(), Group::new());
            a.draw(&shaft.pair, at, &shifts(7), false);
            b.draw(&shaft.pair, at, &shifts(7), false);
            hits(&shaft.occluders, &mut a);
            dispatch_hits(&shaft.occluders, &mut b);
            assert_eq!(a.hit, b.hit);
        }
    }
}
