//! Rooms of quads, as OBJ files: an object and a material each.

use std::fmt::Write;

/// A point.
pub type Corner = [f64; 3];
/// A quad, its front where corners run counter-clockwise, and its name.
pub type Quad<'q> = (&'q str, [Corner; 4]);

/// An OBJ file of quads.
///
/// # Panics
/// Never: a string takes all.
#[must_use]
pub fn obj(quads: &[Quad<'_>]) -> String {
    let mut text = String::new();
    for (number, (name, corners)) in quads.iter().enumerate() {
        for [x, y, z] in corners {
            writeln!(text, "v {x} {y} {z}").expect("a string");
        }
        let first = 4 * number + 1;
        let (b, c, d) = (first + 1, first + 2, first + 3);
        writeln!(text, "o {name}\nusemtl {name}\nf {first} {b} {c} {d}").expect("a string");
    }
    text
}

/// The faces of the box from the origin to (x, y, z), seen from within.
#[must_use]
pub fn room(x: f64, y: f64, z: f64) -> Vec<Quad<'static>> {
    vec![
        ("bottom", [[0., 0., 0.], [x, 0., 0.], [x, y, 0.], [0., y, 0.]]),
        ("top", [[0., 0., z], [0., y, z], [x, y, z], [x, 0., z]]),
        ("x0", [[0., 0., 0.], [0., y, 0.], [0., y, z], [0., 0., z]]),
        ("x1", [[x, 0., 0.], [x, 0., z], [x, y, z], [x, y, 0.]]),
        ("y0", [[0., 0., 0.], [0., 0., z], [x, 0., z], [x, 0., 0.]]),
        ("y1", [[0., y, 0.], [x, y, 0.], [x, y, z], [0., y, z]]),
    ]
}

/// A quad and its back, of one name: a pane, or a plate.
#[must_use]
pub fn both_ways<'q>((name, [a, b, c, d]): Quad<'q>) -> [Quad<'q>; 2] {
    [(name, [a, b, c, d]), (name, [a, d, c, b])]
}

/// Asserts |found − exact| ≤ most.
///
/// # Panics
/// When it is more, or NaN.
#[track_caller]
pub fn near(found: f64, exact: f64, most: f64) {
    assert!(
        (found - exact).abs() <= most,
        "{found} is {:e} off {exact}",
        found - exact
    );
}

#[cfg(test)]
mod tests {
    use super::near;
    use std::panic::catch_unwind;

    #[test]
    fn what_is_too_far_or_no_number_is_not_near() {
        near(1.0, 1.5, 0.5);
        for found in [0.9, 2.1, f64::NAN] {
            assert!(catch_unwind(|| near(found, 1.5, 0.5)).is_err(), "{found}");
        }
    }
}
