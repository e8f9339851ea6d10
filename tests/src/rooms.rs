//! Rooms of quads, as OBJ files: an object and a material each; and form factors between their objects.

use crate::runs::Place;
use std::collections::BTreeMap;
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

/// The faces of the box between two corners, seen from outside.
#[must_use]
pub fn closed(low: Corner, high: Corner) -> [[Corner; 4]; 6] {
    let faces = room(high[0] - low[0], high[1] - low[1], high[2] - low[2]);
    let mut outwards = faces
        .into_iter()
        .map(|(_, [a, b, c, d])| [a, d, c, b].map(|[x, y, z]| [x + low[0], y + low[1], z + low[2]]));
    std::array::from_fn(|_| outwards.next().unwrap_or_default())
}

/// A quad and its back, of one name: a pane, or a plate.
#[must_use]
pub fn both_ways<'q>((name, [a, b, c, d]): Quad<'q>) -> [Quad<'q>; 2] {
    [(name, [a, b, c, d]), (name, [a, d, c, b])]
}

/// A folder with the quads as `scene.obj`, and `optics.toml`.
#[must_use]
pub fn place(quads: &[Quad<'_>], optics: &str) -> Place {
    let place = Place::new();
    place.write("scene.obj", obj(quads));
    place.write("optics.toml", optics);
    place
}

/// Form factors between objects, by their names; `escaped`, `blocked`, `unselected` and the like are columns, too.
pub type Zones = BTreeMap<(String, String), f64>;

/// Exports a store by object.
///
/// # Panics
/// When the program refuses it, or the table holds anything but numbers.
#[must_use]
#[track_caller]
pub fn zones(place: &Place, store: &str) -> Zones {
    place
        .line(&format!("export {store} -o zones.csv --by object --overwrite"))
        .is(0);
    let text = std::fs::read_to_string(place.path("zones.csv")).expect("the table");
    let mut lines = text.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let head = lines.next().expect("a head");
    let mut zones = Zones::new();
    for line in lines {
        for (name, value) in head.iter().zip(&line).skip(1) {
            // Empty: no row was computed.
            if !["patches", "area"].contains(name) && !value.is_empty() {
                let pair = (line[0].to_owned(), (*name).to_owned());
                zones.insert(pair, value.parse().expect("a number"));
            }
        }
    }
    zones
}

/// The form factor from an object to an object.
///
/// # Panics
/// When there is none.
#[must_use]
#[track_caller]
pub fn of(zones: &Zones, from: &str, to: &str) -> f64 {
    zones[&(from.to_owned(), to.to_owned())]
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
