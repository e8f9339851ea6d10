//! Bodies: objects of one temperature, held against a dense elimination, and their conductors against their heat.

use hemicube::solve::STEFAN_BOLTZMANN;
use hemicube_tests::rooms::{obj, room};
use hemicube_tests::runs::Place;

/// Ceiling and one wall are one body of two emissivities, which gives off 500 W.
const BODY: &str = "[default]\nemissivity = 0.9\ntemperature = 293\n[object.bottom]\nemissivity = 0.6\ntemperature = \
                    280\n[object.top]\nemissivity = 0.8\nbody = \"radiator\"\nheat = 500\n[object.x0]\nemissivity = \
                    0.3\nbody = \"radiator\"\n[object.y1]\nadiabatic = true\n";
const HEAT: f64 = 500.0;

fn computed() -> Place {
    let place = Place::new();
    place.write("room.obj", obj(&room(4.0, 3.0, 2.5)));
    place.write("m.toml", BODY);
    place.line("compute room.obj -o room --split 2 --quiet").is(0);
    place
}

/// A table's head and rows.
fn table(place: &Place, name: &str) -> (Vec<String>, Vec<Vec<String>>) {
    let text = std::fs::read_to_string(place.path(name)).expect("a table");
    let mut lines = text
        .lines()
        .map(|line| line.split(',').map(str::to_owned).collect::<Vec<_>>());
    (lines.next().expect("a head"), lines.collect())
}

fn column(head: &[String], name: &str) -> usize {
    let is = |head: &String| head.starts_with(name);
    head.iter()
        .position(is)
        .unwrap_or_else(|| panic!("no {name} in {head:?}"))
}

/// The solution of A x = b, by elimination with pivots.
fn solved(mut rows: Vec<Vec<f64>>) -> Vec<f64> {
    let count = rows.len();
    for step in 0..count {
        let pivot = (step..count).max_by(|&a, &b| rows[a][step].abs().total_cmp(&rows[b][step].abs()));
        rows.swap(step, pivot.expect("a row"));
        let (done, left) = rows.split_at_mut(step + 1);
        let top = &done[step];
        for row in left {
            let factor = row[step] / top[step];
            for (value, top) in row.iter_mut().zip(top).skip(step) {
                *value -= factor * top;
            }
        }
    }
    let mut x = vec![0.0; count];
    for row in (0..count).rev() {
        let rest: f64 = (row + 1..count).map(|k| rows[row][k] * x[k]).sum();
        x[row] = (rows[row][count] - rest) / rows[row][row];
    }
    x
}

#[test]
fn a_body_has_the_temperature_of_a_dense_solution() {
    let place = computed();
    place
        .line("solve room --thermal --materials m.toml --sky-temperature 0 --as-stored --residual 1e-12 -o heat.csv")
        .is(0);
    place.line("export room -o F.npy --quiet").is(0);
    let (head, rows) = table(&place, "heat.csv");
    let count = rows.len();
    let [object, area, kelvin, flux] = ["object", "area", "temperature", "flux"].map(|name| column(&head, name));
    let number = |row: usize, at: usize| rows[row][at].parse::<f64>().expect("a number");
    let bytes = std::fs::read(place.path("F.npy")).expect("a matrix");
    let values = &bytes[bytes.len() - 4 * count * count..];
    let factor = |i: usize, j: usize| {
        let at = 4 * (i * count + j);
        f64::from(f32::from_le_bytes(values[at..at + 4].try_into().expect("four bytes")))
    };
    // Unknown are radiosities and, at the end, the body's black radiosity e: G = F B + S B.
    let view = |i: usize| -> Vec<f64> {
        let mut row: Vec<f64> = (0..count).map(|j| factor(i, j)).collect();
        row[i] += 1.0 - row.iter().sum::<f64>();
        row
    };
    let mut equations = Vec::new();
    let mut balance = vec![0.0; count + 2];
    for i in 0..count {
        let (emissivity, given) = match &*rows[i][object] {
            "bottom" => (0.6, Some(280.0f64)),
            "top" => (0.8, None),
            "x0" => (0.3, None),
            "y1" => (0.0, None),
            _ => (0.9, Some(293.0)),
        };
        let is_body = ["top", "x0"].contains(&&*rows[i][object]);
        let mut row = vec![0.0; count + 2];
        for (j, seen) in view(i).into_iter().enumerate() {
            row[j] = f64::from(u8::from(i == j)) - (1.0 - emissivity) * seen;
            if is_body {
                // Σ A ε (e − G) = Q.
                balance[j] -= number(i, area) * emissivity * seen;
            }
        }
        if is_body {
            row[count] = -emissivity;
            balance[count] += number(i, area) * emissivity;
        }
        row[count + 1] = given.map_or(0.0, |given| emissivity * STEFAN_BOLTZMANN * given.powi(4));
        equations.push(row);
    }
    balance[count + 1] = HEAT;
    equations.push(balance);
    let found = solved(equations);
    let wanted = (found[count] / STEFAN_BOLTZMANN).powf(0.25);
    let mut heat = 0.0;
    for i in 0..count {
        if ["top", "x0"].contains(&&*rows[i][object]) {
            assert!(
                (number(i, kelvin) - wanted).abs() < 1e-4,
                "{} {wanted}",
                number(i, kelvin)
            );
            heat += number(i, area) * number(i, flux);
        }
    }
    assert!((heat - HEAT).abs() < 1e-4 * HEAT, "{heat}");
    // Alone, the wall would give off nothing, and have another temperature.
    place.write("alone.toml", BODY.replace("body = \"radiator\"", "isothermal = true"));
    place
        .line("solve room --thermal --materials alone.toml --sky-temperature 0 --by object -o alone.csv")
        .is(0);
    let (head, rows) = table(&place, "alone.csv");
    let of = |name: &str| -> f64 {
        let row = rows
            .iter()
            .find(|row| row[column(&head, "object")] == name)
            .expect("a row");
        row[column(&head, "mean_K")].parse().expect("K")
    };
    assert!((of("top") - of("x0")).abs() > 1.0);
}

#[test]
fn a_body_is_one_node_of_a_network() {
    let place = computed();
    place
        .line("solve room --thermal --materials m.toml --sky-temperature 0 --network --by object -o heat.csv")
        .is(0);
    let (head, rows) = table(&place, "heat.csv");
    let kelvin = |name: &str| -> f64 {
        let name = if name == "radiator" { "top" } else { name };
        let row = rows.iter().find(|row| row[column(&head, "object")] == name);
        row.expect(name)[column(&head, "mean_K")].parse().expect("K")
    };
    assert!((kelvin("top") - kelvin("x0")).abs() < 1e-6);
    // In a network, an adiabatic wall reflects all.
    place.write("e.toml", BODY.replace("[object.y1]\n", "[object.y1]\nemissivity = 0\n"));
    place
        .line("exchange room --materials e.toml --for pairs -o gr.csv")
        .is(0)
        .says(&["radiator"]);
    let (head, pairs) = table(&place, "gr.csv");
    let mut heat = 0.0;
    for pair in &pairs {
        let names = ["name_i", "name_j"].map(|name| pair[column(&head, name)].as_str());
        let Some(at) = names.iter().position(|name| *name == "radiator") else {
            continue;
        };
        let gr: f64 = pair[column(&head, "gr_m2")].parse().expect("m²");
        if names[1 - at] == "(surroundings)" {
            heat += STEFAN_BOLTZMANN * gr * kelvin("radiator").powi(4);
            continue;
        }
        heat += STEFAN_BOLTZMANN * gr * (kelvin("radiator").powi(4) - kelvin(names[1 - at]).powi(4));
    }
    assert!((heat - HEAT).abs() < 1e-3 * HEAT, "{heat}: {pairs:?}");
}

#[test]
fn a_body_of_two_heats_is_refused_with_the_next_step() {
    let place = computed();
    let two = BODY.replace("0.3\nbody = \"radiator\"", "0.3\nbody = \"radiator\"\nheat = 5");
    place.write("two.toml", two);
    place
        .line("solve room --thermal --materials two.toml --sky-temperature 0")
        .is(2)
        .says(&[
            "of the body `radiator`, and have several conditions",
            "give the body one",
        ]);
}
