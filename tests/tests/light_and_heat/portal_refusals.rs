//! What no portal can be: surfaces that would count twice, mirrors and glass without values.

#![cfg(unix)]

use hemicube_tests::rooms::{Quad, both_ways, obj, place, room};

#[test]
fn values_that_cannot_be_are_named() {
    let place = place(&room(1., 1., 1.), "");
    for (text, words) in [
        (
            "specular = \"much\"",
            "a number is needed here, or a list of numbers, one a band",
        ),
        ("", "is empty"),
        ("index = 1.5\nthickness = -1", "has the thickness -1"),
        ("index = 1.5\nthickness = -1\nextinction = -2", "has the thickness -1"),
        (
            "index = 1.5\nthickness = 1\nextinction = [-2, 1]",
            "has the extinction -2",
        ),
        ("index = 1.5\nthickness = nan", "has the thickness NaN"),
    ] {
        place.write("optics.toml", format!("[object.x1]\n{text}\n"));
        place
            .line("compute scene.obj --specular optics.toml -o no")
            .is(2)
            .says(&[words]);
    }
}

/// What lies in a plane of symmetry and looks away from the part is an image, as is one of two fins on the two ends of
/// a sector or a period.
#[test]
fn what_would_count_twice_is_refused() {
    let plate: Quad<'_> = (
        "plate",
        [[1., 0.2, 0.2], [1., 0.2, 0.8], [1., 0.8, 0.8], [1., 0.8, 0.2]],
    );
    let floor: Quad<'_> = ("floor", [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]]);
    let cases: [(Vec<Quad<'_>>, &str, &str); 3] = [
        (
            [vec![floor], both_ways(plate).to_vec()].concat(),
            "--symmetry x=1",
            "`plate` lies in the plane",
        ),
        (
            vec![floor, plate, ("copy", plate.1.map(|[_, y, z]| [0., y, z]))],
            "--periodic x=0..1",
            "there at both ends of the period along x",
        ),
        (
            vec![
                floor,
                ("fin", [[0.2, 0., 0.], [0.8, 0., 0.], [0.8, 0., 1.], [0.2, 0., 1.]]),
                ("fin", [[0., 0.2, 0.], [0., 0.8, 0.], [0., 0.8, 1.], [0., 0.2, 1.]]),
            ],
            "--sector z,4",
            "`fin` is there at both ends of the sector about z",
        ),
    ];
    for (quads, settings, words) in cases {
        let refused = place(&quads, "");
        refused
            .line(&format!("compute scene.obj {settings} -o no"))
            .is(2)
            .says(&[words]);
        // One of them is enough.
        refused.write("scene.obj", obj(&quads[..2]));
        refused.line(&format!("compute scene.obj {settings} -o yes")).is(0);
    }
}
