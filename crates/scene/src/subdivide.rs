//! Cuts triangles into smaller ones, watertight: points on a shared edge are computed from the same two corners in the
//! same order, so both triangles get equal bits.

use glam::DVec3;

/// Fineness of the patches cut from triangles.
///
/// ```
/// use glam::DVec3;
/// use hemicube_scene::Subdivision;
///
/// let triangle = [DVec3::ZERO, DVec3::X * 4.0, DVec3::Y * 3.0]; // its longest edge is 5
/// assert_eq!(Subdivision::Levels(2).count(&triangle), 16);
/// assert_eq!(Subdivision::Split(3).count(&triangle), 9);
/// assert_eq!(Subdivision::PatchSize(2.0).pieces(&triangle), 3);
///
/// let mut pieces = Vec::new();
/// Subdivision::PatchSize(2.0).cut(&triangle, &mut pieces);
/// assert!(pieces.iter().all(|[a, b, c]| a.distance(*b).max(b.distance(*c)).max(c.distance(*a)) <= 2.0));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Subdivision {
    /// One patch a triangle.
    #[default]
    None,
    /// `L` levels of halved edges: each triangle becomes 4^L.
    Levels(u32),
    /// Each edge in `K` equal pieces: each triangle becomes K².
    Split(u32),
    /// Each triangle's edges in equal pieces, the fewest that are no longer than this, in the file's unit.
    PatchSize(f64),
}

impl Subdivision {
    /// Into how many pieces each edge of a triangle is cut. Saturates at `u32::MAX`.
    pub fn pieces(self, corners: &[DVec3; 3]) -> u32 {
        match self {
            Self::None => 1,
            Self::Levels(levels) => 1u32.checked_shl(levels).unwrap_or(u32::MAX),
            Self::Split(pieces) => pieces.max(1),
            Self::PatchSize(length) => {
                let [a, b, c] = *corners;
                let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
                let pieces = (longest / length).ceil();
                // NaN and a length of zero saturate and are refused by the count; `as` saturates by definition.
                #[allow(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    reason = "saturation is wanted"
                )]
                if pieces >= 1.0 {
                    pieces as u32
                } else if length > 0.0 {
                    1
                } else {
                    u32::MAX
                }
            }
        }
    }

    /// Into how many patches a triangle is cut.
    pub fn count(self, corners: &[DVec3; 3]) -> u64 {
        let pieces = u64::from(self.pieces(corners));
        pieces.saturating_mul(pieces)
    }

    /// Appends the pieces of a triangle to `out`, row by row from its first edge, with its winding.
    pub fn cut(self, corners: &[DVec3; 3], out: &mut Vec<[DVec3; 3]>) {
        let pieces = self.pieces(corners);
        if pieces == 1 {
            out.push(*corners);
            return;
        }
        let at = |i: u32, j: u32| lattice_point(corners, pieces, i, j);
        for j in 0..pieces {
            for i in 0..pieces - j {
                out.push([at(i, j), at(i + 1, j), at(i, j + 1)]);
                if i + j + 1 < pieces {
                    out.push([at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
                }
            }
        }
    }
}

/// The lattice point `i` pieces from corner 0 towards corner 1 and `j` towards corner 2.
fn lattice_point([a, b, c]: &[DVec3; 3], pieces: u32, i: u32, j: u32) -> DVec3 {
    let k = pieces - i - j;
    match (i, j, k) {
        (_, 0, _) => edge_point(*a, *b, k, i),
        (0, _, _) => edge_point(*a, *c, k, j),
        (_, _, 0) => edge_point(*b, *c, i, j),
        _ => (*a * f64::from(k) + *b * f64::from(i) + *c * f64::from(j)) / f64::from(pieces),
    }
}

/// (p·m + q·n) / (m + n), the same bits whichever end is named first.
fn edge_point(p: DVec3, q: DVec3, m: u32, n: u32) -> DVec3 {
    if m == 0 {
        return q;
    }
    if n == 0 {
        return p;
    }
    // Two-term sums commute exactly in IEEE arithmetic, so naming the ends the other way gives the same bits.
    (p * f64::from(m) + q * f64::from(n)) / f64::from(m + n)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_keep_area_and_winding_and_share_edges() {
        let t = [
            DVec3::new(1e7, 0.1, 0.3),
            DVec3::new(1e7 + 3.0, 0.7, 0.1),
            DVec3::new(1e7 + 1.0, 5.1, 0.9),
        ];
        for subdivision in [
            Subdivision::Levels(3),
            Subdivision::Split(7),
            Subdivision::PatchSize(0.4),
        ] {
            let mut out = Vec::new();
            subdivision.cut(&t, &mut out);
            assert_eq!(out.len() as u64, subdivision.count(&t));
            let n = (t[1] - t[0]).cross(t[2] - t[0]);
            let mut area = 0.0;
            for p in &out {
                let m = (p[1] - p[0]).cross(p[2] - p[0]);
                assert!(m.dot(n) > 0.0);
                area += m.length();
            }
            assert!((area / n.length() - 1.0).abs() < 1e-7);
        }
    }

    #[test]
    fn a_shared_edge_is_cut_at_the_same_points_from_both_sides() {
        let (p, q) = (DVec3::new(0.1, 0.2, 0.3), DVec3::new(7.7, -3.1, 2.9));
        for n in 1..9 {
            assert_eq!(edge_point(p, q, 9 - n, n), edge_point(q, p, n, 9 - n));
        }
    }

    #[test]
    fn sizes_that_cut_nothing_or_never_end() {
        let t = [DVec3::ZERO, DVec3::X, DVec3::Y];
        assert_eq!(Subdivision::PatchSize(10.0).pieces(&t), 1);
        assert_eq!(Subdivision::PatchSize(0.0).pieces(&t), u32::MAX);
        assert_eq!(Subdivision::PatchSize(f64::NAN).pieces(&t), u32::MAX);
        assert_eq!(Subdivision::Levels(40).pieces(&t), u32::MAX);
    }
}
