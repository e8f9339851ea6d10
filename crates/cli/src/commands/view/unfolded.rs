//! The unfolded hemicube, as a picture of 2N × 2N pixels: the top in the middle, the sides around it.

use crate::picture::canvas::{Color, NOTHING, id_color};
use hemicube::face::{Face, Items};
use hemicube_spatial::whole;

/// Colour of a view blocked by the back of a one-sided patch.
pub(super) const BLOCKED: Color = [40, 40, 40];

/// The colour of an item: a patch's own, [`NOTHING`] where the view escapes, [`BLOCKED`] on backs.
pub(super) fn color_of(item: u32) -> Color {
    match item {
        Items::ESCAPED => NOTHING,
        Items::BLOCKED => BLOCKED,
        id => id_color(id),
    }
}

/// The face and the place on it of a pixel of the unfolded hemicube, by its place in −2…2 both ways, to the right and
/// up; `None` in the corners. The top is in the middle, a side's horizon at the outer edge.
fn unfold(x: f64, y: f64) -> Option<(Face, f64, f64)> {
    // A direction in the patch's frame: tangent right, bitangent up, normal towards the viewer.
    let direction = match (x.abs() < 1.0, y.abs() < 1.0) {
        (true, true) => return Some((Face::Top, x, y)),
        (false, true) => [x.signum(), y, 2.0 - x.abs()],
        (true, false) => [x, y.signum(), 2.0 - y.abs()],
        (false, false) => return None,
    };
    let face = match (x.abs() < 1.0, x > 0.0, y > 0.0) {
        (false, true, _) => Face::PosX,
        (false, false, _) => Face::NegX,
        (true, _, true) => Face::PosY,
        (true, _, false) => Face::NegY,
    };
    let ([u, v, _], [su, sv, _]) = face.axes();
    Some((face, su * direction[u], sv * direction[v]))
}

/// The place in the atlas of a pixel of the unfolded picture of 2N × 2N.
pub(super) fn atlas_place(column: usize, row: usize, resolution: u32) -> Option<(Face, u32, u32)> {
    let n = f64::from(resolution);
    let (x, y) = (
        2.0 * (column as f64 + 0.5) / n - 2.0,
        2.0 - 2.0 * (row as f64 + 0.5) / n,
    );
    let (face, u, v) = unfold(x, y)?;
    let low = if face.is_top() { -1.0 } else { 0.0 };
    let at = |value: f64, low: f64, most: u32| whole::to_u32((value - low) * n / 2.0).min(most - 1);
    Some((face, at(u, -1.0, resolution), at(v, low, face.rows(resolution))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pixel_of_the_atlas_is_shown_once() {
        let resolution = 16;
        let mut seen = vec![0; 3 * 16 * 16];
        for row in 0..32 {
            for column in 0..32 {
                if let Some((face, x, y)) = atlas_place(column, row, resolution) {
                    seen[((face.first_row(resolution) + y) * resolution + x) as usize] += 1;
                }
            }
        }
        assert!(seen.iter().all(|&times| times == 1));
    }

    #[test]
    fn sides_join_the_top_at_their_upper_edge() {
        // Just beyond the top's right edge is the side's highest row, at the same height of the picture.
        assert_eq!(
            atlas_place(24, 20, 16).map(|(face, _, y)| (face, y)),
            Some((Face::PosX, 7))
        );
        assert_eq!(
            atlas_place(31, 20, 16).map(|(face, _, y)| (face, y)),
            Some((Face::PosX, 0))
        );
        assert_eq!(
            atlas_place(20, 0, 16).map(|(face, _, y)| (face, y)),
            Some((Face::PosY, 0))
        );
        assert_eq!(atlas_place(0, 0, 16), None);
    }
}
