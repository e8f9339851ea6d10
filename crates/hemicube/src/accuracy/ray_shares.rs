//! Non-visible shares of a patch's view by rays: to the outside, to backs of one-sided patches, and to patches without
//! a column.
//!
//! Hemicubes measure them from points. No point stands for a patch reaching out of a solid or for a large one, and form
//! factors of the whole patch do not tell the three shares apart. Rays from all over the patch do: n of them, cosine
//! distributed (Malley's method) at points of a scrambled Sobol sequence, leave the variance X (1 − X) n^(−5/4) of a
//! share X behind large occluders. Behind occluders too small for so many rays to resolve, such as the twigs of a tree,
//! rays err like independent ones, X (1 − X) ÷ n. The spread of [`PARTS`] parts of the rays tells the two from each
//! other (`Spread`).

use crate::accuracy::caster::Caster;
use crate::accuracy::ladder::{self, whole_net};
use crate::accuracy::refine::steps_beside;
use crate::accuracy::row::Emitter;
use crate::accuracy::spread::{PARTS, Spread};
use crate::backend::Rays;
use crate::bvh::{Bounds, LANES, Tree, UNUSED};
use crate::face::Items;
use crate::geometry::{self, Plane};
use crate::sampling::sobol::{BATCH, Sequence, fold};
use crate::sampling::splitmix;
use crate::store::{ERRORS, RowShares};
use crate::visibility::nearest::nearest_of;
use crate::visibility::segments::Segment;
use crate::visibility::spaces::{Spaces, cross_each_other};
use crate::visibility::wide::WideTree;
use glam::DVec3;

/// Number of rays cast first, to look for shares a hemicube did not see.
const FIRST: usize = 64;
/// Number of rays that look for such shares, times the permitted error T: as many as meet a share of 2 T in 93 of 100
/// rows, (1 − 2 T)ⁿ = 0.07. [`FIRST`] are enough for the default, and no more than [`LEAST`] look: 1 / T of them took
/// 18 % of a maze's time at 0.1 %.
const LOOK: f64 = 1.28;
/// Number of rays of a measurement at least: a standard error of 0.016 behind large surfaces. They are the processor's
/// and tell what a ray costs, whoever casts the others. A choice: more leave less to a device, of fewer it would get
/// batches too small to fill it.
const LEAST: usize = 4 * FIRST;
/// Number of rays at most: as many as know any share behind large surfaces to a third of 0.1 %. Entries know sums
/// better that are asked for more.
const MOST: usize = 1 << 17;
/// Blocks of triangles in an emitter's box that are asked whether they cross it: some tenths of a millisecond.
const MOST_CROSSED: usize = 1024;
/// Length of a ray: longer than any way through the scene, which fits a cube of side 2.
const FAR: f64 = 4.0;

/// What a share may be, at 95 %, that none of n rays met, times n: (1 − X)ⁿ = 0.05.
pub(crate) const NONE_MET: f64 = 3.0;

/// The standard error of a share X from so many rays, where `variance` is X (1 − X).
pub(crate) fn error(variance: f64, count: usize) -> f64 {
    // n^(5/8), by roots: they have the same bits everywhere.
    let root = (count as f64).sqrt();
    let eighth = root.sqrt().sqrt();
    known(variance, count).sqrt() / (root * eighth)
}

/// Half the view, of which rays resolve nothing: none errs more.
const SUREST: Spread = Spread::independent(0.25);

/// The shares one by one.
const UNITS: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// The number of rays that leave none of these a standard error above `wanted`.
fn rays_for(spreads: &[Spread], wanted: f64) -> f64 {
    spreads
        .iter()
        .map(|&spread| net_for(spread, wanted))
        .fold(0, usize::max) as f64
}

/// The variance of one ray that so many tell: a few rays that agree do not prove that all would.
fn known(variance: f64, count: usize) -> f64 {
    variance.max(0.25 / count as f64)
}

/// The rays of the smallest net that leaves no standard error above `wanted`; [`MOST`] where none does.
fn net_for(spread: Spread, wanted: f64) -> usize {
    let mut net = FIRST;
    while net < MOST && spread.error(net) > wanted {
        net *= 2;
    }
    net
}

/// Shares measured by rays, which may go on.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct RayShares {
    /// Rays to the outside, to backs, and to patches without a column.
    met: [u32; 3],
    /// The same, of each sixteenth of the rays.
    parts: [[u32; 3]; PARTS],
    /// Number of rays.
    rays: usize,
    /// Blocks of triangles that the first [`LEAST`] of them met.
    blocks: u64,
    /// True once a measurement was asked for and has [`LEAST`] rays.
    is_measurement: bool,
}

impl RayShares {
    pub(crate) fn shares(&self) -> RowShares {
        RowShares::from_array(self.met.map(|met| f64::from(met) / self.rays.max(1) as f64))
    }

    /// How the mean of a quantity errs that is a sum of parts of the shares, where a ray has this variance.
    fn spread(&self, ray: f64, parts: [f64; 3]) -> Spread {
        let rays = (self.rays / PARTS) as f64;
        let mean = |met: &[u32; 3]| -> f64 {
            let sum: f64 = met.iter().zip(parts).map(|(&met, part)| part * f64::from(met)).sum();
            sum / rays.max(1.0)
        };
        Spread::of(
            &self.parts.each_ref().map(mean),
            rays,
            known(ray, self.rays.max(1)),
            1.0,
        )
    }

    fn spreads(&self) -> [Spread; 3] {
        let shares = self.shares().to_array();
        [0, 1, 2].map(|k| self.spread(shares[k] * (1.0 - shares[k]), UNITS[k]))
    }

    /// The standard errors of the shares.
    pub(crate) fn errors(&self) -> [f64; 3] {
        self.spreads().map(|spread| spread.error(self.rays))
    }

    /// How shares err where the form factors tell the sum L of all three: of a share X, the variance X (1 − X ÷ L)
    /// remains.
    fn divided(&self) -> [Spread; 3] {
        let lost = self.shares().lost().max(f64::MIN_POSITIVE);
        let shares = self.shares().to_array();
        [0, 1, 2].map(|k| {
            let part = shares[k] / lost;
            self.spread(shares[k] * (1.0 - part), UNITS[k].map(|own| own - part))
        })
    }

    /// The standard error of *escaped*, where the form factors tell the sum of all three.
    pub(crate) fn escaped_error(&self) -> f64 {
        self.divided()[0].error(self.rays)
    }

    fn summed(&self) -> Spread {
        let sum = self.shares().lost().min(1.0);
        self.spread(sum * (1.0 - sum), [1.0; 3])
    }

    /// The standard error of the sum of all three.
    pub(crate) fn error(&self) -> f64 {
        self.summed().error(self.rays)
    }

    /// What may be lost, at 95 %, where no ray was; 0 where one was. The standard error says too little of it: rays
    /// that leave a narrow gap start within its width of the rim, and their places do not fill so small a part evenly.
    pub(crate) fn none_leaves(&self) -> f64 {
        let is_none = self.met == [0; 3];
        if is_none {
            NONE_MET / self.rays.max(1) as f64
        } else {
            0.0
        }
    }

    /// Number of rays cast.
    pub(crate) fn rays(&self) -> usize {
        self.rays
    }

    /// The number of rays that leave no share a standard error above `wanted`.
    pub(crate) fn for_shares(&self, wanted: f64) -> f64 {
        rays_for(&self.spreads(), wanted)
    }

    /// The number of rays that leave no share a standard error above `wanted` where the form factors tell the sum of
    /// all three.
    pub(crate) fn for_division(&self, wanted: f64) -> f64 {
        rays_for(&self.divided(), wanted)
    }

    /// The number of rays that leave the sum of all three no standard error above `wanted`.
    pub(crate) fn for_sum(&self, wanted: f64) -> f64 {
        rays_for(&[self.summed()], wanted)
    }

    /// Returns whether they are a measurement, not only a look at what a hemicube did not see.
    pub(crate) fn is_measurement(&self) -> bool {
        self.is_measurement
    }

    /// The number of rays that meet so many blocks of triangles, by the first [`LEAST`]: others may be cast by who counts
    /// none.
    fn rays_of_blocks(&self, blocks: u64) -> f64 {
        let counted = self.rays.clamp(1, LEAST) as f64;
        blocks as f64 * counted / self.blocks.max(1) as f64
    }

    /// Casts the first rays from a patch: the whole net of [`LOOK`] ÷ `permitted`, at most [`LEAST`] and what is
    /// [paid](Self::paid). `None` for a patch without area.
    pub(crate) fn look(
        emitter: &Emitter<'_>,
        permitted: f64,
        caster: &mut Caster<'_>,
        mut receives: impl FnMut(u32) -> bool,
    ) -> Option<Self> {
        let mut found = Self::default();
        found.cast(emitter, FIRST, caster, &mut receives);
        if found.rays == 0 {
            return None;
        }
        let wanted = (LOOK / permitted).min(found.paid(permitted));
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most LEAST")]
        let wanted = whole_net(wanted, FIRST, LEAST) as usize;
        if wanted > FIRST {
            found.cast(emitter, wanted, caster, receives);
        }
        Some(found)
    }

    /// The number of rays that meet the steps of a search beside a row.
    fn paid(&self, permitted: f64) -> f64 {
        self.rays_of_blocks(steps_beside(permitted))
    }

    /// Goes on until there are as many rays as `wanted` says, or as [`Self::go_on`] casts.
    pub(crate) fn refine(
        &mut self,
        emitter: &Emitter<'_>,
        permitted: f64,
        wanted: impl Fn(&Self) -> f64,
        caster: &mut Caster<'_>,
        mut receives: impl FnMut(u32) -> bool,
    ) {
        while self.go_on(emitter, permitted, wanted(self), caster, &mut receives) {}
    }

    /// Casts rays up the [`ladder`] to the whole net of `wanted`; returns false where there are as many. There are 256 at
    /// least, and at most as many as know any share to a third of the permitted error, 131,072, or about as many as meet
    /// the steps of a search beside a row in blocks of triangles, by those counted so far: thousands of triangles in one
    /// place are met by every ray to it.
    pub(crate) fn go_on(
        &mut self,
        emitter: &Emitter<'_>,
        permitted: f64,
        wanted: f64,
        caster: &mut Caster<'_>,
        receives: impl FnMut(u32) -> bool,
    ) -> bool {
        let sure = net_for(SUREST, permitted / ERRORS) as f64;
        let paid = self.paid(permitted);
        let wanted = whole_net(wanted.min(sure).min(paid), LEAST, MOST);
        let next = ladder::next(self.rays, wanted, MOST, BATCH).filter(|_| paid > self.rays as f64);
        if let Some(next) = next {
            self.cast(emitter, next, caster, receives);
        }
        self.is_measurement = self.rays >= LEAST;
        next.is_some()
    }

    /// Casts rays until there are `wanted`. `receives` is asked of each patch met and tells the patches with a column.
    /// None from a patch without area. Those after the first [`LEAST`] are the caster's where there is one, and the
    /// processor's where it has no certain answer.
    fn cast(
        &mut self,
        emitter: &Emitter<'_>,
        wanted: usize,
        caster: &mut Caster<'_>,
        mut receives: impl FnMut(u32) -> bool,
    ) {
        let geometry = emitter.model.geometry();
        let (tree, wide) = (
            Tree::of(geometry),
            geometry.kept(|geometry| WideTree::of(&Tree::of(geometry))),
        );
        let [a, b, c] = emitter.corners;
        let Some(normal) = geometry::cross(&emitter.corners).try_normalize() else {
            return;
        };
        let (x, y) = normal.any_orthonormal_pair();
        let horizon = Plane {
            normal,
            offset: normal.dot(a),
        };
        let sequence = Sequence::new(u64::from(emitter.number()).wrapping_mul(splitmix::STEP));
        // The ends of the rays from this number on.
        let ends_of = |at: usize| -> [[DVec3; 2]; BATCH] {
            let u = sequence.points(at);
            std::array::from_fn(|l| {
                let (s, t) = fold(u[0][l], u[1][l]);
                let from = a + (b - a) * s + (c - a) * t;
                let (sin, cos) = (std::f64::consts::TAU * u[3][l]).sin_cos();
                let radius = u[2][l].sqrt();
                let towards = (x * cos + y * sin) * radius + normal * (1.0 - u[2][l]).sqrt();
                [from, from + towards * FAR]
            })
        };
        let first_given = LEAST.max(self.rays);
        let mut given = Vec::new();
        if caster.is_there() && wanted > first_given {
            let ends: Vec<_> = (first_given..wanted).step_by(BATCH).flat_map(ends_of).collect();
            given = caster.cast(&Rays {
                emitter: emitter.patch,
                normal,
                offset: horizon.offset,
                ends: &ends,
            });
        }
        self.merge_parts(wanted);
        let spaces = Spaces::of(emitter.model);
        let is_closed = spaces.is_closed(emitter.patch.0);
        let is_apart = |id| id >= tree.patch_count || spaces.separate(emitter.patch.0, id);
        let mut pending = Vec::new();
        for at in (self.rays..wanted).step_by(BATCH) {
            let mut ends = None;
            for l in 0..BATCH {
                let answer = (at + l).checked_sub(first_given).and_then(|place| given.get(place));
                let id = match answer.copied().unwrap_or(Rays::DOUBTFUL) {
                    Items::ESCAPED => None,
                    Items::BLOCKED => Some(tree.patch_count),
                    Rays::DOUBTFUL => {
                        let ends = ends.get_or_insert_with(|| ends_of(at))[l];
                        WideTree::begin(&mut pending);
                        let segment = Segment::new(ends[0], ends[1], tree.plane_tolerance);
                        let next = |until: f64| wide.next(&segment, until, &mut pending);
                        let mut blocks = 0;
                        let met = nearest_of(&tree, ends, &horizon, is_apart, next, &mut blocks);
                        self.blocks += if at < LEAST { blocks } else { 0 };
                        met.map(|met| met.id)
                    }
                    id => Some(id),
                };
                let share = match id {
                    // A ray that leaves a closed space went through a seam of its walls, to their backs.
                    None => Some(usize::from(is_closed)),
                    Some(id) if is_apart(id) => Some(1),
                    Some(id) => (!receives(id)).then_some(2),
                };
                if let Some(share) = share {
                    self.met[share] += 1;
                    self.parts[(at + l) * PARTS / wanted][share] += 1;
                }
            }
        }
        self.rays = wanted;
    }

    /// Merges the parts of the rays so far into those of `wanted` rays, which are a power of two times as many.
    fn merge_parts(&mut self, wanted: usize) {
        let before = std::mem::take(&mut self.parts);
        let each = self.rays / PARTS;
        for (part, met) in before.iter().enumerate() {
            let into = &mut self.parts[part * each * PARTS / wanted];
            (0..3).for_each(|share| into[share] += met[share]);
        }
    }
}

/// Returns whether a one-sided surface crosses the emitter: a part of it lies behind, then, and sees backs that its
/// centroid may not see. Of more than [`MOST_CROSSED`] blocks of triangles in the emitter's box, no more are looked at.
pub(crate) fn is_crossed(emitter: &Emitter<'_>) -> bool {
    let tree = Tree::of(emitter.model.geometry());
    let mut pending = Vec::new();
    let own = tree.blocks_in(Bounds::of(emitter.corners), &mut pending);
    own.take(MOST_CROSSED).any(|block| {
        let block = &tree.blocks[block as usize];
        let is_one_sided = |l: &usize| block.positive[*l].max(block.negative[*l]) == tree.patch_count;
        let mut triangles = (0..LANES)
            .filter(|&l| block.negative[l] != UNUSED)
            .filter(is_one_sided)
            .map(|l| block.triangle(l));
        triangles.any(|triangle| cross_each_other(&emitter.corners, &triangle, tree.plane_tolerance))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Model;
    use crate::model::tests::of_triangles;
    use hemicube_scene::InputPatch;

    const PERMITTED: f64 = 0.01;

    fn measure(emitter: &Emitter<'_>, permitted: f64, receives: impl Fn(u32) -> bool) -> Option<RayShares> {
        let caster = &mut Caster::none();
        let mut found = RayShares::look(emitter, permitted, caster, &receives)?;
        found.refine(
            emitter,
            permitted,
            |found| found.for_shares(0.8 * permitted),
            caster,
            receives,
        );
        Some(found)
    }

    /// Two unit squares face each other at distance 1: F = 0.199825 (Howell C-11).
    const PLATES: f64 = 0.199_824_895_698_387;

    fn plates(above: [bool; 2], two_sided: bool) -> Model {
        let p = DVec3::new;
        let low = [
            [p(0., 0., 0.), p(1., 0., 0.), p(1., 1., 0.)],
            [p(0., 0., 0.), p(1., 1., 0.), p(0., 1., 0.)],
        ];
        let high = low.map(|corners| corners.map(|corner| corner + DVec3::Z));
        let faces = |[a, b, c]: [DVec3; 3], down: bool| if down { [a, c, b] } else { [a, b, c] };
        let high = [0, 1].map(|k| (faces(high[k], above[k]), two_sided));
        of_triangles(&[(low[0], false), (low[1], false), high[0], high[1]])
    }

    /// Both halves of the lower square together.
    fn of_lower(model: &Model, receives: impl Fn(u32) -> bool + Copy) -> RowShares {
        let [a, b] = [0, 1].map(|patch| {
            measure(&Emitter::new(model, InputPatch(patch)), PERMITTED, receives)
                .expect("it has area")
                .shares()
                .to_array()
        });
        RowShares::from_array([0, 1, 2].map(|k| 0.5 * (a[k] + b[k])))
    }

    #[test]
    fn what_no_plate_takes_escapes() {
        let shares = of_lower(&plates([true, true], false), |_| true);
        let most = 4.0 * error(PLATES * (1.0 - PLATES), 1024);
        assert!((shares.escaped + PLATES - 1.0).abs() < most, "{shares:?}, {most}");
        assert_eq!((shares.blocked, shares.unselected), (0.0, 0.0));
        assert!(most < 0.03, "{most}");
    }

    #[test]
    fn backs_block_and_two_sided_patches_do_not() {
        let shares = of_lower(&plates([false, false], false), |_| true);
        assert!((shares.blocked - PLATES).abs() < 0.02, "{shares:?}");
        let shares = of_lower(&plates([false, false], true), |_| true);
        assert_eq!(shares.blocked, 0.0);
        let shares = of_lower(&plates([true, false], false), |_| true);
        assert!((shares.blocked - 0.5 * PLATES).abs() < 0.02, "{shares:?}");
    }

    #[test]
    fn walls_that_reach_into_the_ground_are_crossed_and_walls_that_stand_on_it_are_not() {
        let p = DVec3::new;
        let ground = |two_sided| ([p(-9., -9., 0.), p(9., -9., 0.), p(0., 9., 0.)], two_sided);
        let wall = |foot: f64| ([p(0., 0., foot), p(1., 0., foot), p(0., 0., foot + 2.)], false);
        let is_crossed = |triangles: &[_]| is_crossed(&Emitter::new(&of_triangles(triangles), InputPatch(0)));
        for (foot, expected) in [(-0.1, true), (0.0, false), (0.1, false), (-2.0, false)] {
            assert_eq!(is_crossed(&[wall(foot), ground(false)]), expected, "{foot}");
            assert_eq!(
                is_crossed(&[ground(false), wall(foot)]),
                expected,
                "from the ground, {foot}"
            );
        }
        assert!(!is_crossed(&[wall(-0.1), ground(true)]), "it has no back");
        let beside = wall(-0.1).0.map(|corner| corner + DVec3::X * 30.0);
        assert!(
            !is_crossed(&[(beside, false), ground(false)]),
            "not where the ground is"
        );
    }

    #[test]
    fn patches_without_a_column_are_unselected() {
        let shares = of_lower(&plates([true, true], false), |patch| patch != 3);
        assert!((shares.unselected - 0.5 * PLATES).abs() < 0.02, "{shares:?}");
        assert_eq!(shares.blocked, 0.0);
    }

    #[test]
    fn the_nearest_counts() {
        let p = DVec3::new;
        let wide = |z: f64, down: bool| {
            let corners = [p(-99., -99., z), p(99., -99., z), p(0., 150., z)];
            (
                if down {
                    [corners[0], corners[2], corners[1]]
                } else {
                    corners
                },
                false,
            )
        };
        let small = ([p(-1., -1., 0.), p(1., -1., 0.), p(0., 1., 0.)], false);
        let seen = of_triangles(&[small, wide(1.0, true), wide(2.0, false)]);
        let shares = measure(&Emitter::new(&seen, InputPatch(0)), PERMITTED, |_| true)
            .expect("it has area")
            .shares();
        assert!(shares.lost() < 0.01, "{shares:?}");
        let hidden = of_triangles(&[small, wide(2.0, true), wide(1.0, false)]);
        let shares = measure(&Emitter::new(&hidden, InputPatch(0)), PERMITTED, |_| true)
            .expect("it has area")
            .shares();
        assert!(shares.blocked > 0.99, "{shares:?}");
    }

    /// Draws from 0 to 1.
    fn draws(seed: u64) -> impl FnMut() -> f64 {
        let mut state = seed;
        move || (splitmix::next(&mut state) >> 11) as f64 / (1u64 << 53) as f64
    }

    #[test]
    fn nets_leave_what_is_wanted() {
        let spread = Spread::resolved(0.25, 1.0);
        assert_eq!(net_for(spread, spread.error(1024)), 1024);
        assert_eq!(net_for(spread, 0.99 * spread.error(1024)), 2048);
        assert_eq!(net_for(SUREST, 0.0), MOST);
    }

    /// Patches below thousands of twigs, which 1,024 rays do not resolve, and below a roof of two triangles.
    #[test]
    fn standard_errors_hold_below_twigs_and_below_a_roof() {
        let mut draw = draws(1);
        let mut point = |low: DVec3, size: DVec3| low + size * DVec3::new(draw(), draw(), draw());
        let mut twigs: Vec<_> = (0..3000)
            .map(|_| {
                let root = point(DVec3::new(-3., -3., 0.1), DVec3::new(6., 6., 2.));
                let along = point(DVec3::splat(-0.5), DVec3::ONE).normalize();
                let side = along.any_orthonormal_vector() * 0.006;
                ([root - side, root + side, root + along * 0.6], true)
            })
            .collect();
        let p = DVec3::new;
        let mut roof = vec![([p(-9., 0.3, 1.), p(0., -9., 1.), p(9., 0.2, 1.)], true)];
        let squared = |scene: &mut Vec<_>| -> (f64, f64) {
            let first = u32::try_from(scene.len()).expect("few triangles");
            for k in 0..24 {
                let at = p(f64::from(k % 6) - 2.5, f64::from(k / 6) - 1.5, 0.);
                scene.push(([at, at + DVec3::X * 0.5, at + DVec3::Y * 0.5], false));
            }
            let model = of_triangles(scene);
            let caster = &mut Caster::none();
            let mut sums = [0.0; 2];
            for patch in first..first + 24 {
                let emitter = Emitter::new(&model, InputPatch(patch));
                let mut found = RayShares::look(&emitter, 1.0, caster, |_| true).expect("it has area");
                found.cast(&emitter, 1024, caster, |_| true);
                let (share, stated) = (found.shares().escaped, found.errors()[0]);
                let law = error(share * (1.0 - share), 1024);
                found.cast(&emitter, MOST, caster, |_| true);
                let off = found.shares().escaped - share;
                sums[0] += (off / stated).powi(2) / 24.0;
                sums[1] += (off / law).powi(2) / 24.0;
            }
            (sums[0].sqrt(), sums[1].sqrt())
        };
        let (by_spread, by_law) = squared(&mut twigs);
        assert!(by_law > 1.5, "twigs are not resolved: {by_law}");
        assert!((0.6..1.4).contains(&by_spread), "{by_spread}");
        let (by_spread, by_law) = squared(&mut roof);
        assert!(by_law < 1.2 && (0.5..1.2).contains(&by_spread), "{by_spread}, {by_law}");
    }

    #[test]
    fn finer_errors_take_more_rays_and_certainty_takes_few() {
        let model = plates([true, true], false);
        let rays = |permitted| {
            measure(&Emitter::new(&model, InputPatch(0)), permitted, |_| true)
                .expect("it has area")
                .rays
        };
        assert_eq!((rays(1.0), rays(1e-3), rays(1e-6)), (256, 32_768, 1 << 17));
        assert!(rays(0.01) > 256 && rays(0.01) <= 1024);
        // Nothing is lost below a plane without end.
        let p = DVec3::new;
        let small = ([p(-1., -1., 0.), p(1., -1., 0.), p(0., 1., 0.)], false);
        let wide = ([p(-999., -999., 1.), p(0., 1500., 1.), p(999., -999., 1.)], false);
        let found = measure(
            &Emitter::new(&of_triangles(&[small, wide]), InputPatch(0)),
            0.001,
            |_| true,
        )
        .expect("it has area");
        assert!(found.rays <= 1024, "{found:?}");
    }

    /// Walls of neighbouring buildings, a rounding apart: each is seen from its own side, whichever is nearer by
    /// rounding.
    #[test]
    fn of_coincident_walls_the_front_is_seen() {
        let p = DVec3::new;
        for gap in [-1e-12, 0.0, 1e-12] {
            let wall = |z: f64| [p(-99., -99., z), p(99., -99., z), p(0., 150., z)];
            let [a, b, c] = wall(1.0 + gap);
            let small = ([p(-1., -1., 0.), p(1., -1., 0.), p(0., 1., 0.)], false);
            let seen = of_triangles(&[small, (wall(1.0), false), ([a, c, b], false)]);
            let shares = measure(&Emitter::new(&seen, InputPatch(0)), PERMITTED, |_| true)
                .expect("it has area")
                .shares();
            assert!(shares.lost() < 0.01, "{gap}: {shares:?}");
        }
    }
}
