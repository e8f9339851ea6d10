//! Tests of the kernels on every instruction set of the machine.

use super::coverage::WIDTH;
use super::depth::{DepthPlane, Plane};
use super::isa::{Lanes, Portable};
use super::spans::{EdgeLines, Spans};
use super::*;
use crate::Isa;
use crate::bsp::Lcg;
use hemicube_contract::backend::WHOLE;
use proptest::prelude::*;

fn portable() -> InstructionSet {
    InstructionSet::of(Isa::Portable).expect("any machine has it")
}

#[test]
fn sums_are_handed_out_in_ascending_order_and_forgotten() {
    let mut sums = Sums::new(10_000);
    for (id, pixels, weight) in [
        (9_999, 1, 5),
        (0, 2, 7),
        (64, 1, 0),
        (64, 3, 1),
        (4_096, 1, 2),
        (0, 1, 1),
    ] {
        sums.add(id, pixels, weight);
    }
    let mut seen = Vec::new();
    sums.drain(|id, pixels, weight| seen.push((id, pixels, weight)));
    assert_eq!(seen, [(0, 3, 8), (64, 4, 1), (4_096, 1, 2), (9_999, 1, 5)]);
    sums.drain(|_, _, _| panic!("nothing may be left"));
    assert!(sums.of.iter().all(|&s| s == 0));
}

/// Numbers that have broken rasterisers: huge, tiny, not finite, signed zeros.
fn coefficient() -> impl Strategy<Value = f64> {
    prop_oneof![
        8 => -300.0..300.0f64,
        2 => -1e-3..1e-3f64,
        1 => prop::sample::select(vec![
            0.0, -0.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, -1e300, 5e-324, 0.5, -0.5, 16.0,
        ]),
    ]
}

fn lines() -> impl Strategy<Value = EdgeLines> {
    (
        prop::array::uniform3(coefficient()),
        prop::array::uniform3(coefficient()),
        prop::array::uniform3(prop::sample::select(vec![(0u8, 0u8), (u8::MAX, 0), (0, u8::MAX)])),
    )
        .prop_map(|(slope, offset, sides)| EdgeLines {
            slope,
            offset,
            left: sides.map(|s| s.0),
            right: sides.map(|s| s.1),
            ..EdgeLines::default()
        })
}

/// Runs an operation of one set: kernels are generic over the token.
macro_rules! on_every_set {
    ($isa:ident => $run:expr, $portable:expr) => {
        for isa in Isa::available() {
            match InstructionSet::of(isa).expect("available") {
                #[cfg(target_arch = "x86_64")]
                InstructionSet::Avx512($isa) => prop_assert_eq!(&$run, $portable),
                #[cfg(target_arch = "x86_64")]
                InstructionSet::Avx2($isa) => prop_assert_eq!(&$run, $portable),
                InstructionSet::Portable(_) => {}
            }
        }
    };
}

fn spans_of(isa: impl Lanes, lines: &EdgeLines, y: f64, x0: f64, x1: f64) -> Spans {
    let mut spans = Spans::default();
    isa.spans(lines, y, x0, x1, &mut spans);
    spans
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn spans_lie_within_their_box_whatever_the_edges(
        lines in lines(), group in 0u32..32, x0 in 0u32..255, width in 1u32..256,
    ) {
        let (x0, x1) = (f64::from(x0), f64::from((x0 + width).min(256)));
        let spans = spans_of(Portable, &lines, f64::from(group * 8), x0, x1);
        for x in spans.starts.into_iter().chain(spans.ends) {
            prop_assert!((x0..=x1).contains(&f64::from(x)));
        }
    }

    #[cfg(target_arch = "x86_64")]
    #[test]
    fn spans_are_the_same_bits_on_every_path(
        lines in lines(), group in 0u32..32, x0 in 0u32..255, width in 1u32..256,
    ) {
        let (y, x0, x1) = (f64::from(group * 8), f64::from(x0), f64::from((x0 + width).min(256)));
        let portable = spans_of(Portable, &lines, y, x0, x1);
        on_every_set!(isa => spans_of(isa, &lines, y, x0, x1), &portable);
    }

    #[cfg(target_arch = "x86_64")]
    #[test]
    fn depth_tests_are_the_same_bits_on_every_path(
        old in prop::array::uniform16(prop::sample::select(vec![0.0f32, 0.5, 1.0, 1.5, 2.0])),
        old_ids in prop::array::uniform16(0u32..4),
        mask in any::<u16>(),
        base in prop::sample::select(vec![0.0f64, 0.5, 1.0, -7.3, 1e300, f64::NAN, f64::INFINITY]),
        step in prop::sample::select(vec![0.0f64, 0.1, 0.5, -0.25, f64::NAN]),
        id in 0u32..4,
    ) {
        let mut steps = [0.0; LANES];
        for (i, s) in steps.iter_mut().enumerate() {
            *s = step * i as f64;
        }
        let depths = DepthPlane { steps, id, plane: Plane { low: 0.25, high: 1.75, x: 0.0, y: 0.0, constant: 0.0 } };
        let run = |test: &dyn Fn(&mut Chunk<f32>, &mut Chunk<u32>) -> bool| {
            let (mut depth, mut items) = (Chunk(old), Chunk(old_ids));
            let any = test(&mut depth, &mut items);
            (depth.0.map(f32::to_bits), items.0, any)
        };
        let portable = run(&|depth, items| Portable.test(depth, items, mask, base, &depths));
        on_every_set!(isa => run(&|depth, items| isa.test(depth, items, mask, base, &depths)), &portable);
    }

    #[cfg(target_arch = "x86_64")]
    #[test]
    fn changes_are_the_same_bits_on_every_path(items in prop::array::uniform16(0u32..3), before in 0u32..3) {
        let chunk = Chunk(items);
        let portable = Portable.changes(&chunk, before);
        on_every_set!(isa => isa.changes(&chunk, before), &portable);
    }
}

/// From 0 to 1.
fn share(draw: &mut Lcg) -> f64 {
    draw.below(1 << 24) as f64 / f64::from(1 << 24)
}

/// Triangles of many sizes, near and far, some of which reach below the horizon.
fn block(draw: &mut Lcg) -> Block {
    let mut block = Block::empty();
    for lane in 0..LANES {
        let size = 2.0 * share(draw).powi(6);
        let at = [share(draw) * 4.0 - 2.0, share(draw) * 4.0 - 2.0, share(draw) * 2.0];
        for k in 0..3 {
            for (c, &at) in at.iter().enumerate() {
                block.corners[3 * k + c][lane] = at + size * (share(draw) - 0.5);
            }
        }
        #[allow(clippy::cast_possible_truncation, reason = "at most 16")]
        let id = lane as u32;
        (block.negative[lane], block.positive[lane]) = (id, id);
    }
    block
}

#[test]
fn whatever_centroid_is_open_its_triangle_may_touch_the_open() {
    let mut draw = Lcg(3);
    let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let frame = Frame::new([0.0; 3], axes, 1e-9, u32::MAX, 64);
    let isa = portable();
    let (mut open, mut none) = (0, 0);
    for resolution in [16, 48, 128, 256] {
        for _ in 0..100 {
            let mut coverage = Coverage::new(resolution);
            for _ in 0..draw.below(40) {
                let (y0, x0) = (draw.below(3 * coverage.resolution), draw.below(coverage.resolution));
                let y1 = (y0 + draw.below(coverage.resolution)).min(3 * coverage.resolution - 1);
                let x1 = (x0 + draw.below(coverage.resolution)).min(coverage.resolution - 1);
                coverage.cover([x0, x1, y0, y1]);
            }
            let mut t = Transformed::new();
            isa.transform(&block(&mut draw), &frame, &mut t);
            let faces = 0b1_1111;
            let centroids = isa.uncovered_centroids(&t, t.live, faces, &coverage);
            let touching = isa.may_touch_uncovered(&t, t.live, faces, &coverage);
            assert_eq!(centroids & !touching, 0, "N = {resolution}");
            open += centroids.count_ones();
            none += (t.live & !touching).count_ones();
        }
    }
    assert!(open > 500 && none > 200, "{open} open, {none} that touch nothing open");
}

#[test]
fn what_is_recorded_of_a_lane_is_what_it_covers_and_nothing_did_before() {
    for isa in Isa::available() {
        assert_recorded(InstructionSet::of(isa).expect("available"));
    }
}

fn assert_recorded(isa: InstructionSet) {
    let mut draw = Lcg(5);
    let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let frame = Frame::new([0.0; 3], axes, 1e-9, u32::MAX, 144);
    let resolution = 144;
    let table = DeltaTable::new(resolution);
    let mut recorded = 0;
    for _ in 0..40 {
        let mut t = Transformed::new();
        let mut canvas = OrderedCoverage::new(&table, true).recording(true);
        canvas.begin_plane();
        canvas.snapshot_all();
        isa.transform(&block(&mut draw), &frame, &mut t);
        let pass = Pass {
            faces: 0b1_1111,
            turns: Turns::Together,
            cut: None,
        };
        let shown = isa.draw_ordered::<true>(&mut t, pass, &mut canvas, &table);
        let record = canvas.record.as_ref().expect("it records");
        let mut open = OrderedCoverage::new(&table, true);
        open.now = Coverage::full(resolution);
        let weight = |open: &OrderedCoverage| open.uncovered_weight(&table);
        for lane in 0..LANES {
            let of_lane = || record.lanes.iter().filter(|(l, _)| *l == lane).map(|(_, of)| of);
            of_lane().for_each(|of| record.uncover_shown(of, &mut open.now));
            assert_eq!(weight(&open), shown.visible[lane], "lane {lane}");
            of_lane().for_each(|of| record.cover_shown(of, &mut open.now));
            assert_eq!(weight(&open), 0);
            // All was open before.
            of_lane().for_each(|of| record.uncover_box(of, &mut open.now));
            assert!(weight(&open) >= shown.visible[lane], "lane {lane}");
            of_lane().for_each(|of| record.cover_box(of, &mut open.now));
            assert_eq!(weight(&open), 0);
            recorded += of_lane().count();
        }
    }
    assert!(recorded > 100, "{recorded}");
}

#[test]
fn what_is_open_weighs_what_its_pixels_do() {
    let mut draw = Lcg(6);
    let mut between = 0;
    for resolution in [16, 48, 64, 144, 256] {
        let table = DeltaTable::new(resolution);
        let mut canvas = OrderedCoverage::new(&table, true);
        let size = canvas.now.resolution;
        assert_eq!(canvas.uncovered_weight(&table), WHOLE);
        for _ in 0..20 {
            let (y0, x0) = (draw.below(3 * size), draw.below(size));
            let (y1, x1) = (
                (y0 + draw.below(size)).min(3 * size - 1),
                (x0 + draw.below(size)).min(size - 1),
            );
            canvas.now.cover([x0, x1, y0, y1]);
            let pixels = (0..3 * size).flat_map(|row| (0..size).map(move |x| (row, x)));
            let open = pixels.filter(|&(row, x)| !canvas.now.is_covered(row, x));
            let weight = open.map(|(row, x)| {
                let sides = (row.saturating_sub(size)) / (size / 2);
                let (face, row) = if row < size {
                    (Face::Top, row)
                } else {
                    (Face::PosX, row - size - sides * (size / 2))
                };
                let running = table.running(face);
                running[row * size + x + 1] - running[row * size + x]
            });
            let weight: u32 = weight.sum();
            assert_eq!(canvas.uncovered_weight(&table), weight, "N = {resolution}");
            between += u32::from(weight != 0 && weight != WHOLE);
        }
    }
    assert!(between > 50, "{between}");
}

#[test]
fn eight_rows_from_the_last_row_on_lie_within_the_coverage() {
    for resolution in (16..=1024).step_by(16) {
        let mut canvas = OrderedCoverage::new(&DeltaTable::new(resolution), true);
        let coverage = &mut canvas.now;
        let last = coverage.resolution.div_ceil(WIDTH) * coverage.groups * GROUP - 1;
        assert_eq!(coverage.words_mut()[last..].len(), GROUP + 1, "N = {resolution}");
        assert_eq!(canvas.snapshot.words().len(), last + GROUP + 1, "N = {resolution}");
    }
}
