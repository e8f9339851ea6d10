//! Heat in scenes of the field, held against closed forms and the second law: a flat with furniture and a door, a
//! furnace with a billet, a tank of several materials, a satellite with panels.

use hemicube_tests::runs::Place;
use std::fmt::Write as _;

type Point = [f64; 3];

/// An OBJ file in the making.
#[derive(Default)]
pub(crate) struct Obj {
    pub(crate) text: String,
    corners: usize,
}

impl Obj {
    pub(crate) fn polygon(&mut self, corners: &[Point]) {
        for [x, y, z] in corners {
            writeln!(self.text, "v {x} {y} {z}").expect("a string");
        }
        let numbers: Vec<String> = (1..=corners.len()).map(|at| (self.corners + at).to_string()).collect();
        writeln!(self.text, "f {}", numbers.join(" ")).expect("a string");
        self.corners += corners.len();
    }

    pub(crate) fn object(&mut self, name: &str, material: &str) -> &mut Self {
        writeln!(self.text, "o {name}\nusemtl {material}").expect("a string");
        self
    }

    pub(crate) fn surface(&mut self, name: &str, material: &str, corners: &[Point]) {
        self.object(name, material).polygon(corners);
    }

    /// The six sides of a box, seen from outside.
    pub(crate) fn block(&mut self, [x, y, z]: Point, [a, b, c]: Point) {
        for side in [
            [[x, y, z], [x, b, z], [a, b, z], [a, y, z]],
            [[x, y, c], [a, y, c], [a, b, c], [x, b, c]],
            [[x, y, z], [a, y, z], [a, y, c], [x, y, c]],
            [[a, b, z], [x, b, z], [x, b, c], [a, b, c]],
            [[x, b, z], [x, y, z], [x, y, c], [x, b, c]],
            [[a, y, z], [a, b, z], [a, b, c], [a, y, c]],
        ] {
            self.polygon(&side);
        }
    }

    /// The six sides of a box, seen from inside.
    fn hollow(&mut self, low: Point, high: Point) {
        let mut outside = Self::default();
        outside.block(low, high);
        for line in outside.text.lines() {
            match line.strip_prefix("f ") {
                None => writeln!(self.text, "{line}").expect("a string"),
                Some(_) => {
                    let at = self.corners;
                    writeln!(self.text, "f {} {} {} {}", at + 4, at + 3, at + 2, at + 1).expect("a string");
                    self.corners += 4;
                }
            }
        }
    }
}

/// An L-shaped flat of 36 m² with a table, a radiator, a door leaf of one sheet, and a cupboard that stands on the
/// floor without a bottom.
fn flat() -> String {
    let mut obj = Obj::default();
    let plan = [[0.0, 0.0], [8.0, 0.0], [8.0, 3.0], [4.0, 3.0], [4.0, 6.0], [0.0, 6.0]];
    let level = |z: f64| plan.map(|[x, y]| [x, y, z]);
    obj.surface("floor", "wood", &level(0.0));
    let mut ceiling = level(2.7);
    ceiling.reverse();
    obj.surface("ceiling", "plaster", &ceiling);
    for (at, name) in ["south", "east", "inner_north", "inner_east", "north", "west"]
        .iter()
        .enumerate()
    {
        let ([a, b], [c, d]) = (plan[at], plan[(at + 1) % 6]);
        let wall = [[c, d, 0.0], [a, b, 0.0], [a, b, 2.7], [c, d, 2.7]];
        obj.surface(&format!("wall_{name}"), "plaster", &wall);
    }
    obj.object("table", "wood").block([1.0, 1.0, 0.7], [2.6, 1.8, 0.74]);
    obj.object("radiator", "metal")
        .block([0.05, 4.0, 0.1], [0.15, 5.5, 0.7]);
    let mut cupboard = Obj {
        text: String::new(),
        corners: obj.corners,
    };
    cupboard.block([6.5, 2.3, 0.0], [7.5, 2.95, 2.0]);
    let mut lines: Vec<&str> = cupboard.text.lines().collect();
    // The bottom's face.
    lines.remove(4);
    writeln!(obj.text, "o cupboard\nusemtl wood\n{}", lines.join("\n")).expect("a string");
    obj.corners = cupboard.corners;
    let door = [[4.0, 3.0, 0.0], [3.4, 2.4, 0.0], [3.4, 2.4, 2.0], [4.0, 3.0, 2.0]];
    obj.surface("door", "wood", &door);
    obj.text
}

/// The last column's number in the line of `name`.
fn heat_of(table: &str, name: &str) -> f64 {
    let line = table
        .lines()
        .find(|line| line.starts_with(name))
        .unwrap_or_else(|| panic!("{name}: {table}"));
    let word = line.split_whitespace().nth(3).expect("the heat");
    word.parse().expect("a number")
}

/// Two grey surfaces, the inner one convex (Siegel & Howell 2002, chapter 7):
/// Q = σ (T₂⁴ − T₁⁴) / ((1 − ε₁)/(A₁ ε₁) + 1/A₁ + (1 − ε₂)/(A₂ ε₂)).
#[test]
fn a_billet_in_a_furnace_has_the_heat_of_two_grey_surfaces_and_no_factor_above_one() {
    let place = Place::new();
    let mut obj = Obj::default();
    obj.object("lining", "brick").hollow([0.0; 3], [4.0, 2.0, 1.5]);
    obj.object("billet", "steel").block([0.5, 0.8, 0.2], [3.5, 1.2, 0.5]);
    place.write("furnace.obj", obj.text);
    place.write(
        "furnace.toml",
        "[material.brick]\nemissivity = 0.6\ntemperature = \"1000 °C\"\n\n\
         [material.steel]\nemissivity = 0.8\ntemperature = \"20 °C\"\n",
    );
    place
        .line("compute furnace.obj --by material --split 3 -o m --config=none -q")
        .is(0);
    // Sums of the elements' closed forms come to 1.0000056.
    let checked = place.line("check m").is(0);
    assert!(checked.out.contains("range        ok"), "{}", checked.out);
    let solved = place
        .line("solve m --thermal --materials furnace.toml --by material")
        .is(0);
    let (inner, outer) = (4.44, 34.0);
    let resistance = 0.2 / (inner * 0.8) + 1.0 / inner + 0.4 / (outer * 0.6);
    let exact = 5.670_374_419e-8 * (1273.15f64.powi(4) - 293.15f64.powi(4)) / resistance;
    let found = -heat_of(&solved.out, "steel");
    assert!((found / exact - 1.0).abs() < 1e-3, "{found} {exact}");
}

#[test]
fn a_flat_at_one_temperature_is_at_rest_and_its_doors_are_not_cold() {
    let place = Place::new();
    place.write("flat.obj", flat());
    place.write("rest.toml", "[default]\nemissivity = 0.9\ntemperature = \"18 °C\"\n");
    let computed = place.line("compute flat.obj --patch-size 0.8 -o m --config=none").is(0);
    // The door's back and the cupboard's inside are backs, and no reason to turn the room round.
    assert!(!computed.err.contains("--flip"), "{}", computed.err);
    let solved = place.line("solve m --thermal --materials rest.toml --by object").is(0);
    assert!(solved.out.contains("heat  none flows: "), "{}", solved.out);
    assert_eq!(heat_of(&solved.out, "radiator"), 0.0, "{}", solved.out);
    place
        .line("points flat.obj --up z --grid 1 --height 1.1 --solution m -o seats.csv")
        .is(0);
    let text = std::fs::read_to_string(place.path("seats.csv")).expect("a table");
    let mut lines = text.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let header = lines.next().expect("a header");
    let column = |name: &str| header.iter().position(|of| *of == name).expect("the column");
    let (mrt, blocked) = (column("mrt"), column("blocked"));
    let (mut count, mut behind) = (0, 0.0f64);
    for line in lines {
        let kelvin: f64 = line[mrt].parse().expect("kelvin");
        assert!((kelvin - 291.15).abs() < 0.01, "{line:?}");
        behind = behind.max(line[blocked].parse().expect("a share"));
        count += 1;
    }
    assert!(count > 30 && behind > 0.05, "{count} points, {behind} on backs at most");
}

/// A cube of 2 m with the objects `lower`, `upper` and `shell`: all of paint, but for one side of the shell, of steel.
pub(crate) fn tank() -> String {
    let corner = |x: f64, y: f64, z: f64| [2.0 * x, 2.0 * y, 2.0 * z];
    let side = |at: fn([f64; 2]) -> [f64; 3]| {
        [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(|uv| {
            let [x, y, z] = at(uv);
            corner(x, y, z)
        })
    };
    let mut obj = Obj::default();
    obj.surface("lower", "paint", &side(|[u, v]| [u, v, 0.0]));
    obj.surface("upper", "paint", &side(|[u, v]| [v, u, 1.0]));
    obj.surface("shell", "paint", &side(|[u, v]| [v, 0.0, u]));
    obj.polygon(&side(|[u, v]| [0.0, u, v]));
    obj.polygon(&side(|[u, v]| [1.0, v, u]));
    obj.text.push_str("usemtl steel\n");
    obj.polygon(&side(|[u, v]| [u, 1.0, v]));
    obj.text
}

/// Black sides of a cube: F = 0.2 to each other, and the lower one's heat is A σ Σ F (T⁴ − T_j⁴).
#[test]
fn a_patch_of_several_materials_or_objects_has_the_values_on_which_their_tables_agree() {
    let place = Place::new();
    place.write("tank.obj", tank());
    for kind in ["object", "material"] {
        let line = format!("compute tank.obj --by {kind} --split 4 -o {kind} --config=none -q");
        place.line(&line).is(0);
    }
    let solved = |store: &str, tables: &str, rest: &str| {
        place.write(
            "tank.toml",
            format!("[default]\nemissivity = 1\ntemperature = 300\n\n{tables}"),
        );
        place.line(&format!(
            "solve {store} --thermal --materials tank.toml --sky-temperature 300{rest}"
        ))
    };
    let exact = 5.670_374_419e-8 * 4.0 * (400.0f64.powi(4) - 300.0f64.powi(4));
    let hot = "[object.lower]\ntemperature = 400\n";
    // Nothing is said of materials, they say the same, or the object says it.
    for (store, tables) in [
        ("object", hot.to_owned()),
        ("object", format!("{hot}[material.\"*\"]\nemissivity = 1\n")),
        (
            "object",
            format!("{hot}[material.steel]\nemissivity = 0.3\n[object.shell]\nemissivity = 1\n"),
        ),
    ] {
        let found = solved(store, &tables, "").is(0);
        let heat = heat_of(&found.out, "lower");
        assert!((heat / exact - 1.0).abs() < 1e-3, "{tables}: {heat} {exact}");
    }
    let all = solved("material", "[object.\"*\"]\ntemperature = 400\n", "").is(0);
    assert!(all.out.contains("paint     1        20.000"), "{}", all.out);
    // What they say differently is nobody's, and was the default's without a word.
    for (store, tables, words) in [
        (
            "object",
            "[material.steel]\nemissivity = 0.3\n",
            ["`shell` has patches of several materials", "an emissivity"],
        ),
        (
            "material",
            hot,
            ["`paint` has patches of several objects", "--by object"],
        ),
    ] {
        solved(store, tables, "").is(2).says(&words);
    }
    solved("material", "", " --by object")
        .is(2)
        .says(&["cannot be added up by object"]);
    place.write(
        "steel.toml",
        "[default]\nemissivity = 1\n\n[material.steel]\nemissivity = 0.3\n",
    );
    place
        .line("exchange object --materials steel.toml")
        .is(2)
        .says(&["`shell` has patches of several materials"]);
    let printed = place.line("solve object --print-materials").is(0);
    assert!(printed.out.contains("[object.\"shell\"]"), "{}", printed.out);
}

/// Front and back of a sheet are one node by their material: T = (P / (σ Σ A ε))^¼ before the body's share.
#[test]
fn panels_of_a_satellite_are_nodes_of_two_sides() {
    let place = Place::new();
    let mut obj = Obj::default();
    obj.object("body", "mli").block([-0.5; 3], [0.5; 3]);
    for (side, a, b) in [("p", 0.6, 2.6), ("m", -2.6, -0.6)] {
        let front = [[a, -0.5, 0.0], [b, -0.5, 0.0], [b, 0.5, 0.0], [a, 0.5, 0.0]];
        let mut back = front;
        back.reverse();
        obj.surface(&format!("cells_{side}"), "panel", &front);
        obj.surface(&format!("back_{side}"), "panel", &back);
    }
    place.write("satellite.obj", obj.text);
    place.write(
        "satellite.toml",
        "[material.mli]\nemissivity = 0.05\nadiabatic = true\n\n[material.panel]\nisothermal = true\nheat = 2000\n\n\
         [object.\"cells*\"]\nemissivity = 0.85\n\n[object.\"back*\"]\nemissivity = 0.7\n",
    );
    place
        .line("compute satellite.obj --split 3 --tolerance 0.5% -o m --config=none -q")
        .is(0);
    let solved = place
        .line("solve m --thermal --materials satellite.toml --sky-temperature 0 --by object")
        .is(0);
    let kelvin = |name: &str| -> f64 {
        let line = solved
            .out
            .lines()
            .find(|line| line.starts_with(name))
            .expect("the line");
        line.split_whitespace()
            .nth(5)
            .expect("the mean")
            .parse()
            .expect("kelvin")
    };
    let alone = (2000.0_f64 / (5.670_374_419e-8 * 4.0 * (0.85 + 0.7))).powf(0.25);
    assert_eq!(kelvin("cells_p"), kelvin("back_m"));
    // The body sends back a part of the 6 % that it sees.
    assert!(
        (0.0..3.0).contains(&(kelvin("cells_p") - alone)),
        "{} {alone}",
        kelvin("cells_p")
    );
    let sum = heat_of(&solved.out, "cells_p") + heat_of(&solved.out, "back_p");
    assert!((sum - 1000.0).abs() < 5.0, "{sum}");
}
