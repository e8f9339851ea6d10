//! Bounding boxes of nodes on the five faces: asked by every engine of every node it meets.

use super::coverage::{OrderedCoverage, all_covered, in_atlas};
use super::isa::Lanes;
use super::projection::at;
use super::{AtlasBox, FaceGrid, Frame, three};
use hemicube_contract::face::Face;

/// A lane for each face, and three unused ones.
pub(super) const FACES: usize = 8;

/// A node is not tested against the pixels if its nearest point is closer than this part of its farthest.
pub(super) const NEAREST: f64 = 1e-6;

/// Widening of projected boxes, in pixels.
const SLACK: f64 = 1e-6;

/// An axis-aligned box of the scene.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SceneBox {
    pub(crate) center: [f64; 3],
    /// Half the sides.
    pub(crate) half: [f64; 3],
}

/// The pixels of a box, by face.
#[derive(Clone, Debug, PartialEq)]
#[repr(C, align(64))]
pub(crate) struct OnFaces {
    /// 1/w of the nearest point.
    pub(crate) near: [f64; FACES],
    /// First and last column, inclusive.
    pub(crate) x0: [i32; FACES],
    pub(crate) x1: [i32; FACES],
    /// First and last row of the face, inclusive.
    pub(crate) y0: [i32; FACES],
    pub(crate) y1: [i32; FACES],
    /// Faces with valid entries above.
    pub(crate) boxed: u8,
    /// Faces with a box too near to have a pixel box.
    pub(crate) at_eye: u8,
}

impl OnFaces {
    pub(crate) fn new() -> Self {
        Self {
            near: [0.0; FACES],
            x0: [0; FACES],
            x1: [0; FACES],
            y0: [0; FACES],
            y1: [0; FACES],
            boxed: 0,
            at_eye: 0,
        }
    }

    /// The atlas box on a face in `boxed`.
    #[inline(always)]
    pub(crate) fn in_atlas(&self, face: usize, resolution: usize) -> AtlasBox {
        let [x0, x1, y0, y1] = [self.x0, self.x1, self.y0, self.y1].map(|of| at(of[face]));
        in_atlas(FaceGrid::new(Face::ALL[face], resolution), x0, x1, y0, y1)
    }
}

/// Distance from a box's edge to the centre of the first pixel it counts for: sub-pixel patches make a box stand for
/// all pixels it touches, otherwise only covered centres count.
#[inline(always)]
pub(super) fn inset(touched: bool) -> f64 {
    if touched { 0.0 - SLACK } else { 0.5 - SLACK }
}

/// Projects a box with the version of the instruction set.
#[inline(always)]
pub(super) fn project<L: Lanes>(isa: L, of: &SceneBox, frame: &Frame, faces: u8, touched: bool, out: &mut OnFaces) {
    isa.on_faces(of, frame, faces, touched, out);
}

/// Projects a box onto faces.
#[inline(always)]
pub(super) fn on_faces(of: &SceneBox, frame: &Frame, faces: u8, touched: bool, out: &mut OnFaces) {
    (out.boxed, out.at_eye) = (0, 0);
    let d = three(|c| of.center[c] - frame.origin[c]);
    let (mut low, mut high) = ([0.0; 3], [0.0; 3]);
    for a in 0..3 {
        let m = &frame.axes[a];
        let center = m[0] * d[0] + m[1] * d[1] + m[2] * d[2];
        let half = m[0].abs() * of.half[0] + m[1].abs() * of.half[1] + m[2].abs() * of.half[2];
        // Above the rounding of the sums, and far below a pixel.
        let half = half + 1e-14;
        low[a] = center - half;
        high[a] = center + half;
    }
    if high[2] <= frame.tolerance {
        return;
    }
    for face in Face::ALL {
        if faces >> face as u8 & 1 != 0 {
            on_face(&low, &high, FaceGrid::new(face, frame.resolution), touched, out);
        }
    }
}

/// Projects a box, given in the hemicube's frame, onto a face.
#[inline(always)]
pub(super) fn on_face(low: &[f64; 3], high: &[f64; 3], grid: FaceGrid, touched: bool, out: &mut OnFaces) {
    let face = grid.face;
    let resolution = grid.resolution as f64;
    let half = resolution * 0.5;
    let inset = inset(touched);
    let lane = face as usize;
    let (axis, sign) = face.axes();
    let range = |c: usize| {
        if sign[c] > 0.0 {
            (low[axis[c]], high[axis[c]])
        } else {
            (-high[axis[c]], -low[axis[c]])
        }
    };
    let ((u0, u1), (v0, v1), (w0, w1)) = (range(0), range(1), range(2));
    let bottom = if face.is_top() { -w1 } else { 0.0 };
    if w1 <= 0.0 || u0 > w1 || u1 < -w1 || v0 > w1 || v1 < bottom {
        return;
    }
    if w0 <= NEAREST * w1 {
        out.at_eye |= 1 << lane;
        return;
    }
    let (near, far) = (1.0 / w0, 1.0 / w1);
    let x0 = u0 * if u0 > 0.0 { far } else { near } * half + half;
    let x1 = u1 * if u1 > 0.0 { near } else { far } * half + half;
    let shift = if face.is_top() { half } else { 0.0 };
    let y0 = v0 * if v0 > 0.0 { far } else { near } * half + shift;
    let y1 = v1 * if v1 > 0.0 { near } else { far } * half + shift;
    let rows = if face.is_top() { resolution } else { half };
    // A box that only touches the right or upper edge belongs to the last pixel, as a centroid on the edge does.
    let x0 = (x0 + inset).min(resolution - 1.0).max(0.0);
    let x1 = (x1 - inset).min(resolution - 1.0);
    let y0 = (y0 + inset).min(rows - 1.0).max(0.0);
    let y1 = (y1 - inset).min(rows - 1.0);
    if x0.trunc() > x1 || y0.trunc() > y1 {
        return;
    }
    out.near[lane] = near;
    #[allow(clippy::cast_possible_truncation, reason = "within the face")]
    {
        out.x0[lane] = x0 as i32;
        out.x1[lane] = x1 as i32;
        out.y0[lane] = y0 as i32;
        out.y1[lane] = y1 as i32;
    }
    out.boxed |= 1 << lane;
}

/// Number of boxes that are tested at once.
pub(crate) const BOXES: usize = 8;

/// Boxes that are tested at once: the children of a node.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(crate) struct BoxGroup {
    /// Centres, by axis.
    pub(crate) center: [[f64; BOXES]; 3],
    /// Half the sides.
    pub(crate) half: [[f64; BOXES]; 3],
    /// Boxes around blocks, not around other boxes: these are added to the snapshot.
    pub(crate) leaves: u8,
}

/// For each box of a group, the faces on which it may be visible, and the faces on which it is hidden.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct GroupOnFaces {
    pub(crate) visible: [u8; BOXES],
    pub(crate) hidden: [u8; BOXES],
}

impl GroupOnFaces {
    #[inline(always)]
    pub(super) fn add(&mut self, l: usize, face: Face, is_hidden: bool) {
        let faces = if is_hidden { &mut self.hidden } else { &mut self.visible };
        faces[l] |= 1 << face as u8;
    }
}

/// Tests boxes with the version of the instruction set.
#[inline(always)]
pub(super) fn test<L: Lanes, const COVERED: bool>(
    isa: L,
    group: &BoxGroup,
    used: u8,
    frame: &Frame,
    canvas: &mut OrderedCoverage,
    faces: u8,
) -> GroupOnFaces {
    isa.test_group::<COVERED>(group, used, frame, canvas, faces)
}

/// Tests the boxes in `used` against the coverage. With `COVERED`, a box stands for all pixels that it touches, and the
/// coverage of leaves that may be visible is added to the snapshot.
#[inline(always)]
pub(super) fn test_group<L: Lanes, const COVERED: bool>(
    isa: L,
    group: &BoxGroup,
    mut used: u8,
    frame: &Frame,
    canvas: &mut OrderedCoverage,
    faces: u8,
) -> GroupOnFaces {
    let mut out = GroupOnFaces::default();
    let mut one = OnFaces::new();
    while used != 0 {
        let l = used.trailing_zeros() as usize;
        used &= used - 1;
        let of = SceneBox {
            center: three(|c| group.center[c][l]),
            half: three(|c| group.half[c][l]),
        };
        isa.on_faces(&of, frame, faces, COVERED, &mut one);
        out.visible[l] = one.at_eye;
        let snapshot = COVERED && group.leaves >> l & 1 != 0;
        if snapshot && one.at_eye != 0 {
            // Too near to have pixels to ask for.
            canvas.snapshot_all();
        }
        let mut boxed = one.boxed;
        while boxed != 0 {
            let face = boxed.trailing_zeros() as usize;
            boxed &= boxed - 1;
            let pixels = [one.x0[face], one.x1[face], one.y0[face], one.y1[face]];
            let is_hidden = is_hidden(isa, pixels, Face::ALL[face], canvas, snapshot);
            out.add(l, Face::ALL[face], is_hidden);
        }
    }
    out
}

/// Returns true if a box of a face's pixels is covered; otherwise adds it to the snapshot if asked.
#[inline(always)]
pub(super) fn is_hidden<L: Lanes>(
    isa: L,
    pixels: [i32; 4],
    face: Face,
    canvas: &mut OrderedCoverage,
    snapshot: bool,
) -> bool {
    let [x0, x1, y0, y1] = pixels.map(at);
    let pixels = in_atlas(FaceGrid::new(face, canvas.now.resolution), x0, x1, y0, y1);
    let is_hidden = all_covered(isa, &canvas.now, pixels);
    if !is_hidden && snapshot {
        canvas.snapshot_box(pixels);
    }
    is_hidden
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Isa;
    use crate::kernel::InstructionSet;
    use hemicube_contract::delta::DeltaTable;
    use proptest::prelude::*;
    use std::collections::BTreeMap;
    use std::sync::LazyLock;

    /// The weights of a resolution: a table of 256 pixels takes longer than a case.
    fn table(resolution: u32) -> &'static DeltaTable {
        static TABLES: LazyLock<BTreeMap<u32, DeltaTable>> =
            LazyLock::new(|| [16, 128, 256].map(|side| (side, DeltaTable::new(side))).into());
        &TABLES[&resolution]
    }

    /// A frame that looks along a direction and is turned about it.
    fn frame() -> impl Strategy<Value = Frame> {
        let angle = prop_oneof![4 => -7.0..7.0f64, 1 => Just(0.0)];
        (prop::array::uniform3(-1.0..1.0f64), angle.clone(), angle.clone(), angle).prop_map(|(origin, a, b, c)| {
            let turn = glam::DMat3::from_euler(glam::EulerRot::ZYX, a, b, c);
            Frame::new(origin, turn.to_cols_array_2d(), 1e-9, 0, 16)
        })
    }

    /// Boxes beside, around and far from the eye, some of them flat.
    fn scene_box() -> impl Strategy<Value = SceneBox> {
        let side = prop_oneof![1 => Just(0.0), 2 => 0.0..1e-3f64, 4 => 0.0..2.0f64];
        (prop::array::uniform3(-2.0..2.0f64), prop::array::uniform3(side))
            .prop_map(|(center, half)| SceneBox { center, half })
    }

    fn same_on_every_path<const COVERED: bool>(
        group: &BoxGroup,
        used: u8,
        frame: &Frame,
        canvas: &mut OrderedCoverage,
        faces: u8,
    ) -> Result<(), TestCaseError> {
        let mut test = |isa: Isa| {
            let set = InstructionSet::of(isa).expect("available");
            set.test_group::<COVERED>(group, used, frame, canvas, faces)
        };
        let portable = test(Isa::Portable);
        let mut both = portable.hidden.iter().zip(&portable.visible);
        prop_assert!(both.all(|(hidden, visible)| hidden & visible == 0));
        for isa in Isa::available() {
            prop_assert_eq!(portable, test(isa));
        }
        Ok(())
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(4000))]

        #[test]
        fn boxes_are_the_same_on_every_path(
            frame in frame(),
            of in scene_box(),
            resolution in prop::sample::select(vec![16usize, 128, 256, 1024]),
            faces in 0u8..32,
            touched in any::<bool>(),
        ) {
            let frame = Frame { resolution, ..frame };
            let (mut portable, mut wide) = (OnFaces::new(), OnFaces::new());
            on_faces(&of, &frame, faces, touched, &mut portable);
            for isa in Isa::available() {
                let set = InstructionSet::of(isa).expect("available");
                set.on_faces(&of, &frame, faces, touched, &mut wide);
                prop_assert_eq!((portable.boxed, portable.at_eye), (wide.boxed, wide.at_eye));
                for f in (0..FACES).filter(|f| portable.boxed >> f & 1 != 0) {
                    let of = |b: &OnFaces| (b.near[f].to_bits(), b.x0[f], b.x1[f], b.y0[f], b.y1[f]);
                    prop_assert_eq!(of(&portable), of(&wide));
                }
            }
        }

        #[test]
        fn a_group_of_boxes_is_tested_as_each_of_them(
            frame in frame(),
            boxes in prop::collection::vec(scene_box(), BOXES),
            covered in prop::collection::vec(
                (any::<prop::sample::Index>(), any::<prop::sample::Index>(), 0usize..40), 0..60,
            ),
            resolution in prop::sample::select(vec![16u32, 128, 256]),
            (faces, used) in (0u8..32, any::<u8>()),
            touched in any::<bool>(),
        ) {
            let mut group = BoxGroup { center: [[0.0; BOXES]; 3], half: [[0.0; BOXES]; 3], leaves: 0b1010_0110 };
            for (l, SceneBox { center, half }) in boxes.iter().enumerate() {
                for c in 0..3 {
                    (group.center[c][l], group.half[c][l]) = (center[c], half[c]);
                }
            }
            let side = resolution as usize;
            let frame = Frame { resolution: side, ..frame };
            let mut canvas = OrderedCoverage::new(table(resolution), true);
            for (x, y, size) in covered {
                let (x, y) = (x.index(side), y.index(3 * side));
                canvas.now.cover([x, (x + size).min(side - 1), y, (y + size).min(3 * side - 1)]);
            }
            if touched {
                same_on_every_path::<true>(&group, used, &frame, &mut canvas, faces)?;
            } else {
                same_on_every_path::<false>(&group, used, &frame, &mut canvas, faces)?;
            }
        }

        #[test]
        fn what_lies_in_a_box_lies_in_its_pixels(
            frame in frame(),
            of in scene_box(),
            place in prop::array::uniform3(-1.0..=1.0f64),
            resolution in prop::sample::select(vec![16usize, 128, 256, 1024]),
        ) {
            let frame = Frame { resolution, ..frame };
            let mut boxes = OnFaces::new();
            on_faces(&of, &frame, 0b1_1111, true, &mut boxes);
            let d = three(|c| of.center[c] + of.half[c] * place[c] - frame.origin[c]);
            let [x, y, z] = three(|a| frame.axes[a][0] * d[0] + frame.axes[a][1] * d[1] + frame.axes[a][2] * d[2]);
            if z <= 1e-6 {
                return Ok(());
            }
            for face in Face::ALL {
                let (axis, sign) = face.axes();
                let [u, v, w] = three(|c| sign[c] * [x, y, z][axis[c]]);
                let lowest = if face.is_top() { -w } else { 0.0 };
                if w <= 0.0 || u.abs() > w || v > w || v < lowest {
                    continue;
                }
                let lane = face as usize;
                if boxes.at_eye >> lane & 1 != 0 {
                    continue;
                }
                prop_assert!(boxes.boxed >> lane & 1 != 0, "{:?}", face);
                prop_assert!(1.0 / w <= boxes.near[lane] * (1.0 + 1e-12));
                let half = resolution as f64 * 0.5;
                let rows = if face.is_top() { resolution as f64 } else { half };
                let shift = if face.is_top() { half } else { 0.0 };
                let column = (u / w * half + half).min(resolution as f64 - 1.0).floor();
                let row = (v / w * half + shift).min(rows - 1.0).floor();
                prop_assert!((f64::from(boxes.x0[lane])..=f64::from(boxes.x1[lane])).contains(&column));
                prop_assert!((f64::from(boxes.y0[lane])..=f64::from(boxes.y1[lane])).contains(&row));
            }
        }
    }
}
