//! Heat between surfaces with mixed conditions, against linear systems solved by elimination here, the second law, and
//! Carnot's older sister: what is warm gives to what is cold.

use hemicube::solve::{
    Given, Heat, HeatSolution, InMemory, Method, STEFAN_BOLTZMANN, SolveError, SolveOptions, solve_heat,
};

const METHODS: [Method; 2] = [Method::Jacobi, Method::Gmres { restart: 20 }];

/// A textbook's enclosure: areas, and form factors.
struct Room {
    area: Vec<f64>,
    factors: Vec<Vec<f64>>,
}

/// An endless duct whose sides are a convex polygon: crossed strings (Hottel 1954), per metre of its length.
fn duct(corners: &[[f64; 2]]) -> Room {
    let count = corners.len();
    let far = |a: usize, b: usize| {
        let ([x, y], [u, v]) = (corners[a % count], corners[b % count]);
        (x - u).hypot(y - v)
    };
    let factor = |i: usize, j: usize| {
        if i == j {
            return 0.0;
        }
        let crossed = far(i, j) + far(i + 1, j + 1);
        let straight = far(i, j + 1) + far(i + 1, j);
        (crossed - straight) / (2.0 * far(i, i + 1))
    };
    Room {
        area: (0..count).map(|i| far(i, i + 1)).collect(),
        factors: (0..count).map(|i| (0..count).map(|j| factor(i, j)).collect()).collect(),
    }
}

/// The six sides of a unit cube: 0.199825 to the opposite one (Siegel & Howell 2002, appendix C), the rest to four.
fn cube() -> Room {
    let opposite = 0.199_824_9;
    let side = (1.0 - opposite) / 4.0;
    let factor = |i: usize, j: usize| match (i, j) {
        _ if i == j => 0.0,
        _ if i / 2 == j / 2 => opposite,
        _ => side,
    };
    Room {
        area: vec![1.0; 6],
        factors: (0..6).map(|i| (0..6).map(|j| factor(i, j)).collect()).collect(),
    }
}

/// Rooms of two to six surfaces, some of which see themselves.
fn rooms() -> Vec<(&'static str, Room)> {
    let spheres = Room {
        area: vec![1.0, 4.0],
        factors: vec![vec![0.0, 1.0], vec![0.25, 0.75]],
    };
    // A hemispherical dome of unit radius over a disk and a ring: F₁₃ = F₂₃ = 1, and reciprocity.
    let dome = Room {
        area: vec![0.25, 0.75, 2.0],
        factors: vec![vec![0.0, 0.0, 1.0], vec![0.0, 0.0, 1.0], vec![0.125, 0.375, 0.5]],
    };
    let regular = |count: usize| -> Vec<[f64; 2]> {
        let angle = |at: usize| std::f64::consts::TAU * at as f64 / count as f64;
        (0..count).map(|at| [angle(at).cos(), 0.6 * angle(at).sin()]).collect()
    };
    vec![
        ("concentric spheres", spheres),
        ("a dome", dome),
        ("a duct of 3-4-5", duct(&[[0.0, 0.0], [4.0, 0.0], [0.0, 3.0]])),
        ("a flat duct", duct(&[[0.0, 0.0], [4.0, 0.0], [4.0, 1.0], [0.0, 1.0]])),
        ("a duct of five sides", duct(&regular(5))),
        ("a cube", cube()),
    ]
}

/// Solves A x = b by Gauß's elimination with partial pivoting.
fn eliminate(mut matrix: Vec<Vec<f64>>, mut right: Vec<f64>) -> Vec<f64> {
    let count = right.len();
    for step in 0..count {
        let pivot = (step..count).max_by(|&a, &b| matrix[a][step].abs().total_cmp(&matrix[b][step].abs()));
        let pivot = pivot.expect("a row");
        matrix.swap(step, pivot);
        right.swap(step, pivot);
        for row in step + 1..count {
            let factor = matrix[row][step] / matrix[step][step];
            for column in step..count {
                matrix[row][column] -= factor * matrix[step][column];
            }
            right[row] -= factor * right[step];
        }
    }
    for row in (0..count).rev() {
        let rest: f64 = (row + 1..count).map(|column| matrix[row][column] * right[column]).sum();
        right[row] = (right[row] - rest) / matrix[row][row];
    }
    right
}

/// Net fluxes and black radiosities from the equations as a textbook has them, in B and e = σ T⁴ of every surface:
/// B − (1 − ε) F B − ε e = 0, and e = σ T⁴, or B − F B = q, or Σ A (B − F B) = Q with one e.
fn by_hand(room: &Room, heat: &Heat) -> (Vec<f64>, Vec<f64>) {
    let count = room.area.len();
    let (mut matrix, mut right) = (Vec::new(), Vec::new());
    let net = |i: usize, row: &mut Vec<f64>, weight: f64| {
        row[i] += weight;
        for j in 0..count {
            row[j] -= weight * room.factors[i][j];
        }
    };
    for i in 0..count {
        let mut row = vec![0.0; 2 * count];
        row[i] += 1.0;
        for j in 0..count {
            row[j] -= (1.0 - heat.emissivity[i]) * room.factors[i][j];
        }
        row[count + i] -= heat.emissivity[i];
        matrix.push(row);
        right.push(0.0);
    }
    for i in 0..count {
        let mut row = vec![0.0; 2 * count];
        right.push(match heat.given[i] {
            Given::Temperature(kelvin) => {
                row[count + i] = 1.0;
                STEFAN_BOLTZMANN * kelvin.powi(4)
            }
            Given::Flux(flux) => {
                net(i, &mut row, 1.0);
                flux
            }
            Given::Node(node) => {
                let members: Vec<usize> = (0..count).filter(|&j| heat.given[j] == Given::Node(node)).collect();
                match members.iter().position(|&j| j == i) {
                    Some(0) => {
                        for &j in &members {
                            net(j, &mut row, room.area[j]);
                        }
                        heat.nodes[node as usize]
                    }
                    _ => {
                        row[count + i] = 1.0;
                        row[count + members[0]] = -1.0;
                        0.0
                    }
                }
            }
        });
        matrix.push(row);
    }
    let solved = eliminate(matrix, right);
    let flux = |i: usize| solved[i] - (0..count).map(|j| room.factors[i][j] * solved[j]).sum::<f64>();
    ((0..count).map(flux).collect(), solved[count..].to_vec())
}

fn conditions(count: usize, of: impl Fn(usize) -> Given, nodes: &[f64], room: &Room) -> Heat {
    Heat {
        area: room.area.clone(),
        emissivity: (0..count).map(|i| 0.9 - 0.13 * i as f64).collect(),
        given: (0..count).map(of).collect(),
        nodes: nodes.to_vec(),
        outside: None,
        returned: vec![0.0; count],
        handed_on: Vec::new(),
    }
}

fn solved(room: &Room, heat: &Heat, method: Method) -> HeatSolution {
    let options = SolveOptions {
        method,
        tolerance: 1e-9,
        max_iterations: 5000,
        threads: 2,
    };
    let found = solve_heat(&InMemory::dense(&room.factors), heat, options, &mut |_| true).expect("a sound problem");
    assert!(found.solution.converged);
    found
}

fn flux(found: &HeatSolution, surface: usize) -> f64 {
    found.solution.radiosity.of(surface)[0] - found.solution.irradiance.of(surface)[0]
}

#[test]
fn enclosures_of_two_to_six_surfaces_are_as_solved_by_hand() {
    let mut compared = 0;
    for (name, room) in rooms() {
        let count = room.area.len();
        let mixes: Vec<Heat> = vec![
            conditions(count, |i| Given::Temperature(300.0 + 150.0 * i as f64), &[], &room),
            // One temperature, everything else with a flux or adiabatic.
            conditions(
                count,
                |i| {
                    [
                        Given::Temperature(400.0),
                        Given::Flux(2000.0),
                        Given::Flux(0.0),
                        Given::Flux(-300.0),
                    ][i % 4]
                },
                &[],
                &room,
            ),
            // All but one surface conduct well together.
            conditions(
                count,
                |i| {
                    if i == 0 {
                        Given::Temperature(350.0)
                    } else {
                        Given::Node(0)
                    }
                },
                &[1234.0],
                &room,
            ),
            // Two bodies, one of which floats, with an adiabatic wall between where there are walls enough.
            conditions(
                count,
                |i| {
                    [
                        Given::Node(0),
                        Given::Temperature(600.0),
                        Given::Flux(0.0),
                        Given::Node(1),
                        Given::Node(1),
                        Given::Flux(50.0),
                    ][i]
                },
                &[500.0, 0.0][..if count > 3 { 2 } else { 1 }],
                &room,
            ),
        ];
        for (mix, heat) in mixes.iter().enumerate() {
            let (fluxes, blacks) = by_hand(&room, heat);
            let scale = fluxes.iter().fold(0.0_f64, |most, flux| most.max(flux.abs()));
            for method in METHODS {
                let found = solved(&room, heat, method);
                for surface in 0..count {
                    let kelvin = (blacks[surface] / STEFAN_BOLTZMANN).powf(0.25);
                    assert!(
                        (found.temperature[surface] / kelvin - 1.0).abs() < 1e-5
                            && (flux(&found, surface) - fluxes[surface]).abs() < 1e-4 * scale,
                        "{name}, mix {mix}, {method:?}, surface {surface}: {} K, {kelvin} K; {} and {} W/m²",
                        found.temperature[surface],
                        flux(&found, surface),
                        fluxes[surface],
                    );
                    compared += 1;
                }
            }
        }
    }
    assert_eq!(compared, 4 * 2 * (2 + 3 + 3 + 4 + 5 + 6));
}

#[test]
fn at_equilibrium_nothing_flows_and_floating_bodies_take_the_temperature_around_them() {
    for (name, room) in rooms() {
        let count = room.area.len();
        let heat = conditions(
            count,
            |i| {
                [
                    Given::Temperature(321.0),
                    Given::Node(0),
                    Given::Flux(0.0),
                    Given::Node(0),
                ][i % 4]
            },
            &[0.0],
            &room,
        );
        let black = STEFAN_BOLTZMANN * 321.0_f64.powi(4);
        for method in METHODS {
            let found = solved(&room, &heat, method);
            for surface in 0..count {
                assert!(
                    flux(&found, surface).abs() < 1e-6 * black && (found.temperature[surface] - 321.0).abs() < 1e-4,
                    "{name}: {} W/m², {} K",
                    flux(&found, surface),
                    found.temperature[surface]
                );
            }
        }
    }
}

#[test]
fn heat_flows_from_warm_to_cold_and_what_floats_lies_between() {
    for (name, room) in rooms() {
        let count = room.area.len();
        let heat = conditions(
            count,
            |i| match i {
                0 => Given::Temperature(700.0),
                1 => Given::Temperature(300.0),
                _ if i % 2 == 0 => Given::Flux(0.0),
                _ => Given::Node(0),
            },
            &[0.0][..usize::from(count > 3)],
            &room,
        );
        let found = solved(&room, &heat, METHODS[1]);
        assert!(flux(&found, 0) > 0.0 && flux(&found, 1) < 0.0, "{name}");
        let between = |kelvin: &f64| (300.0..=700.0).contains(kelvin);
        assert!(found.temperature.iter().all(between), "{name}: {:?}", found.temperature);
        let sum: f64 = (0..count).map(|i| room.area[i] * flux(&found, i)).sum();
        assert!(sum.abs() < 1e-5 * flux(&found, 0), "{name}: {sum}");
    }
}

/// A body of one temperature gives off its heat whatever its patches see, and is as warm as one surface of its area.
#[test]
fn a_node_is_one_temperature_and_its_heat_adds_up() {
    let room = cube();
    let heat = conditions(
        6,
        |i| {
            if i < 4 {
                Given::Node(0)
            } else {
                Given::Temperature(290.0 + 5.0 * i as f64)
            }
        },
        &[-77.0],
        &room,
    );
    let found = solved(&room, &heat, METHODS[1]);
    assert!(
        found.temperature[..4]
            .iter()
            .all(|kelvin| *kelvin == found.temperature[0])
    );
    let sum: f64 = (0..4).map(|i| flux(&found, i)).sum();
    assert!((sum + 77.0).abs() < 1e-3, "{sum}");
    let fluxes: Vec<f64> = (0..4).map(|i| flux(&found, i)).collect();
    assert!((fluxes[0] - fluxes[3]).abs() > 1.0, "its patches differ: {fluxes:?}");
}

/// A long row of rooms, of which only the first has a temperature: what reaches the last goes through all others.
#[test]
fn a_long_way_to_the_only_temperature_converges() {
    let count = 60;
    let mut factors = vec![vec![0.0; count]; count];
    for i in 0..count {
        if i > 0 {
            factors[i][i - 1] = 0.5;
        }
        if i + 1 < count {
            factors[i][i + 1] = 0.5;
        }
    }
    factors[count - 1][count - 1] = 0.5;
    factors[0][0] = 0.5;
    let room = Room {
        area: vec![1.0; count],
        factors,
    };
    let heat = Heat {
        emissivity: vec![0.8; count],
        ..conditions(
            count,
            |i| {
                if i == 0 {
                    Given::Temperature(300.0)
                } else {
                    Given::Flux(if i + 1 == count { 10.0 } else { 0.0 })
                }
            },
            &[],
            &room,
        )
    };
    let heat = Heat {
        emissivity: vec![0.8; count],
        ..heat
    };
    let options = SolveOptions::default();
    let found = solve_heat(&InMemory::dense(&room.factors), &heat, options, &mut |_| true).expect("a sound problem");
    let (fluxes, blacks) = by_hand(&room, &heat);
    assert!(found.solution.converged, "{:?}", found.solution.residuals);
    let kelvin = (blacks[count - 1] / STEFAN_BOLTZMANN).powf(0.25);
    assert!((found.temperature[count - 1] / kelvin - 1.0).abs() < 1e-4);
    assert!(
        (flux(&found, 0) / fluxes[0] - 1.0).abs() < 1e-3,
        "{} {}",
        flux(&found, 0),
        fluxes[0]
    );
}

#[test]
fn what_is_wrong_is_refused_by_name() {
    let room = cube();
    let sound = conditions(6, |_| Given::Temperature(300.0), &[], &room);
    let refused = |heat: &Heat, method| {
        let options = SolveOptions {
            method,
            ..SolveOptions::default()
        };
        match solve_heat(&InMemory::dense(&room.factors), heat, options, &mut |_| true) {
            Err(SolveError::Problem(reason)) => reason,
            other => panic!("{other:?}"),
        }
    };
    let with = |change: fn(&mut Heat)| {
        let mut heat = sound.clone();
        change(&mut heat);
        refused(&heat, METHODS[1])
    };
    assert!(with(|heat| heat.emissivity[2] = 1.5).contains("1.5"));
    assert!(with(|heat| heat.area.truncate(3)).contains("6 patches"));
    assert!(with(|heat| heat.given[1] = Given::Node(0)).contains("has no heat"));
    assert!(with(|heat| heat.nodes = vec![1.0]).contains("no patch"));
    assert!(with(|heat| heat.given[1] = Given::Temperature(-1.0)).contains("-1"));
    assert!(with(|heat| (heat.given[1], heat.emissivity[1]) = (Given::Flux(3.0), 0.0)).contains("an emissivity of 0"));
    let mut node = sound.clone();
    (node.given[0], node.nodes) = (Given::Node(0), vec![1.0]);
    assert!(refused(&node, Method::GaussSeidel).contains("GMRES or Jacobi"));
}
