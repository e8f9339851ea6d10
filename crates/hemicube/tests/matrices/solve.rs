//! Radiosity and thermal exchange against closed forms, with matrices written down by hand.

use hemicube::solve::{
    Block, EnergyBalance, Factors, InMemory, Method, Problem, STEFAN_BOLTZMANN, Solution, SolveError, SolveOptions,
    energy_balance, solve,
};
use hemicube::store::{Part, RowTable};

const METHODS: [Method; 3] = [Method::Jacobi, Method::GaussSeidel, Method::Gmres { restart: 5 }];

fn options(method: Method) -> SolveOptions {
    SolveOptions {
        method,
        tolerance: 1e-10,
        max_iterations: 2000,
        threads: 2,
    }
}

fn solved(matrix: &InMemory, problem: &Problem, method: Method) -> Solution {
    let solution = solve(matrix, problem, options(method), &mut |_| true).expect("a sound problem");
    assert!(solution.converged, "{method:?}: {:?}", solution.residuals);
    solution
}

/// One right-hand side: the same number in one column.
fn column(values: &[f64]) -> Block {
    Block::from_fn(values.len(), 1, |patch, _| values[patch])
}

/// An enclosure of surfaces with areas, emissivities and temperatures; an emissivity of 0 is a surface that reradiates.
fn enclosure(emissivity: &[f64], kelvin: &[f64]) -> Problem {
    Problem {
        reflectance: column(&emissivity.iter().map(|e| 1.0 - e).collect::<Vec<_>>()),
        bands: vec![0],
        emission: column(
            &emissivity
                .iter()
                .zip(kelvin)
                .map(|(e, t)| e * STEFAN_BOLTZMANN * t.powi(4))
                .collect::<Vec<_>>(),
        ),
        outside: None,
        returned: None,
    }
}

fn flux(solution: &Solution, surface: usize) -> f64 {
    solution.radiosity.of(surface)[0] - solution.irradiance.of(surface)[0]
}

/// A pseudo-random matrix whose rows sum to 1, in several parts whose rows are not in order.
fn random_room(patches: usize) -> InMemory {
    let mut state = 9u64;
    let mut next = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1u64 << 24) as f32
    };
    let mut parts = Vec::new();
    for (index, first) in (0u32..).zip((0..patches).step_by(7)) {
        let mut part = Part {
            index,
            indptr: vec![0],
            ..Part::default()
        };
        let end = (first + 7).min(patches);
        for patch in (first..end).rev() {
            let row: Vec<f32> = (0..patches)
                .map(|j| if j == patch || next() < 0.5 { 0.0 } else { next() })
                .collect();
            let sum: f32 = row.iter().sum();
            for (j, value) in (0i32..).zip(&row).filter(|(_, value)| **value > 0.0) {
                part.indices.push(j);
                part.data.push(f64::from(value / sum));
            }
            part.rows.push(u32::try_from(patch).expect("few patches"));
            part.indptr.push(i64::try_from(part.data.len()).expect("few entries"));
        }
        parts.push(part);
    }
    InMemory::new(patches, parts)
}

#[test]
fn a_closed_room_of_one_material_is_e_over_one_minus_rho() {
    let room = random_room(50);
    for method in METHODS {
        for rho in [0.0, 0.3, 0.8, 0.95] {
            let problem = Problem {
                reflectance: Block::from_fn(50, 1, |_, _| rho),
                bands: vec![0],
                emission: Block::from_fn(50, 1, |_, _| 2.5),
                outside: None,
                returned: None,
            };
            let solution = solved(&room, &problem, method);
            for patch in 0..50 {
                let b = solution.radiosity.of(patch)[0];
                assert!(
                    (b * (1.0 - rho) / 2.5 - 1.0).abs() < 1e-5,
                    "{method:?} {rho} {patch}: {b}"
                );
            }
        }
    }
}

#[test]
fn methods_agree_on_many_right_hand_sides_and_bands() {
    let room = random_room(40);
    let columns = 11;
    let problem = Problem {
        reflectance: Block::from_fn(40, 2, |patch, band| {
            0.1 + 0.02 * patch as f64 * (1.0 - 0.5 * band as f64)
        }),
        bands: (0..columns).map(|c| c % 2).collect(),
        // Column 3 has nothing to solve, columns 1 and 9 are alike.
        emission: Block::from_fn(40, columns, |patch, c| match c {
            3 => 0.0,
            9 => f64::from(u8::from(patch % 8 == 1)),
            _ => f64::from(u8::from(patch % 8 == c % 8)),
        }),
        outside: Some(Block::from_fn(40, columns, |patch, c| {
            if c == 3 { 0.0 } else { 0.01 * (patch % 3) as f64 }
        })),
        returned: None,
    };
    let solutions = METHODS.map(|method| solved(&room, &problem, method));
    for solution in &solutions[1..] {
        for (a, b) in solution.radiosity.values().iter().zip(solutions[0].radiosity.values()) {
            assert!((a - b).abs() < 1e-8, "{a} {b}");
        }
    }
    // One after another they come to the same as together.
    let alone = Problem {
        emission: Block::from_fn(40, 1, |patch, _| problem.emission.of(patch)[5]),
        outside: problem
            .outside
            .as_ref()
            .map(|outside| Block::from_fn(40, 1, |patch, _| outside.of(patch)[5])),
        bands: vec![1],
        ..problem.clone()
    };
    let alone = solved(&room, &alone, METHODS[2]);
    for patch in 0..40 {
        assert!((alone.radiosity.of(patch)[0] - solutions[2].radiosity.of(patch)[5]).abs() < 1e-9);
    }
    assert!(solutions.iter().all(|s| s.radiosity.column(3).all(|b| b == 0.0)));
}

#[test]
fn the_threads_change_nothing() {
    let room = random_room(60);
    let problem = Problem {
        reflectance: Block::from_fn(60, 1, |_, _| 0.6),
        bands: vec![0; 3],
        emission: Block::from_fn(60, 3, |patch, c| ((patch * 7 + c) % 5) as f64),
        outside: None,
        returned: None,
    };
    for method in METHODS {
        let of = |threads| {
            let options = SolveOptions {
                threads,
                ..options(method)
            };
            solve(&room, &problem, options, &mut |_| true).expect("a sound problem")
        };
        assert_eq!(of(1), of(5));
    }
}

/// Modest 2013, eq. 5.36: large parallel plates, q = σ(T₁⁴ − T₂⁴) / (1/ε₁ + 1/ε₂ − 1).
#[test]
fn two_parallel_plates() {
    let plates = InMemory::dense(&[vec![0.0, 1.0], vec![1.0, 0.0]]);
    let (e1, e2, t1, t2) = (0.8, 0.4, 800.0_f64, 500.0_f64);
    let expected = STEFAN_BOLTZMANN * (t1.powi(4) - t2.powi(4)) / (1.0 / e1 + 1.0 / e2 - 1.0);
    for method in METHODS {
        let solution = solved(&plates, &enclosure(&[e1, e2], &[t1, t2]), method);
        assert!((flux(&solution, 0) / expected - 1.0).abs() < 1e-6);
        assert!((flux(&solution, 1) / expected + 1.0).abs() < 1e-6);
    }
}

/// Concentric spheres: Q = A₁σ(T₁⁴ − T₂⁴) / (1/ε₁ + (A₁/A₂)(1/ε₂ − 1)), with an inner sphere of a quarter of the area.
/// The outer one sees itself, which no planar patch does; solvers do not mind.
#[test]
fn concentric_spheres() {
    let spheres = InMemory::dense(&[vec![0.0, 1.0], vec![0.25, 0.75]]);
    let (e1, e2, t1, t2) = (0.3_f64, 0.7, 1000.0_f64, 300.0_f64);
    let expected = STEFAN_BOLTZMANN * (t1.powi(4) - t2.powi(4)) / (1.0 / e1 + 0.25 * (1.0 / e2 - 1.0));
    for method in METHODS {
        let solution = solved(&spheres, &enclosure(&[e1, e2], &[t1, t2]), method);
        assert!((flux(&solution, 0) / expected - 1.0).abs() < 1e-6);
    }
}

/// A long duct of equal width with one wall that reradiates (Incropera, example 13.5's kind): F = ½ between any two
/// walls, Q₁ = σ(T₁⁴ − T₂⁴) / ((1−ε₁)/ε₁ + 1/(F₁₂ + 1/(1/F₁ᵣ + 1/F₂ᵣ)) + (1−ε₂)/ε₂) for a unit of area.
#[test]
fn a_duct_of_three_surfaces() {
    let duct = InMemory::dense(&[vec![0.0, 0.5, 0.5], vec![0.5, 0.0, 0.5], vec![0.5, 0.5, 0.0]]);
    let (e1, e2, t1, t2) = (0.8, 0.4, 1200.0_f64, 500.0_f64);
    let exchange = 0.5 + 1.0 / (1.0 / 0.5 + 1.0 / 0.5);
    let expected = STEFAN_BOLTZMANN * (t1.powi(4) - t2.powi(4)) / ((1.0 - e1) / e1 + 1.0 / exchange + (1.0 - e2) / e2);
    for method in METHODS {
        let solution = solved(&duct, &enclosure(&[e1, e2, 0.0], &[t1, t2, 0.0]), method);
        assert!((flux(&solution, 0) / expected - 1.0).abs() < 1e-6);
        assert!((flux(&solution, 1) / expected + 1.0).abs() < 1e-6);
        assert!(flux(&solution, 2).abs() < 1e-6 * expected);
    }
}

fn table(rows: usize, escaped: f64, sum: f64) -> RowTable {
    RowTable {
        escaped: vec![escaped; rows],
        blocked: vec![0.0; rows],
        unselected: vec![0.0; rows],
        row_sum: vec![sum; rows],
        error: vec![f64::NAN; rows],
        ..RowTable::unknown(rows)
    }
}

#[test]
fn energy_is_accounted_for() {
    let close = |a: f64, b: f64| (a - b).abs() < 1e-9 * b.abs().max(1.0);
    let total =
        |b: &EnergyBalance| b.absorbed + b.escaped + b.blocked + b.unselected + b.closure + b.reciprocity + b.residual;
    // Two plates that lose half: 1 = absorbed + escaped.
    let plates = InMemory::dense(&[vec![0.0, 0.5], vec![0.5, 0.0]]);
    let problem = Problem {
        reflectance: column(&[0.5, 0.25]),
        bands: vec![0],
        emission: column(&[1.0, 0.0]),
        outside: Some(column(&[0.0, 2.0])),
        returned: None,
    };
    let solution = solved(&plates, &problem, Method::Jacobi);
    let balance = energy_balance(&problem, &solution, &[1.0, 1.0], &table(2, 0.5, 0.5))[0];
    assert!(close(balance.emitted, 1.0) && close(balance.from_outside, 2.0));
    assert!(close(total(&balance), balance.input()), "{balance:?}");
    assert!(balance.unaccounted().abs() < 1e-9, "{balance:?}");

    // The same matrix under areas that make it unreciprocal, and rows that claim to lose less: named, not hidden.
    let balance = energy_balance(&problem, &solution, &[1.0, 3.0], &table(2, 0.4, 0.5))[0];
    assert!(close(total(&balance), balance.input()), "{balance:?}");
    assert!(
        balance.reciprocity.abs() > 0.01 && balance.closure > 0.01,
        "{balance:?}"
    );
    assert!(balance.unaccounted().abs() > 0.01);
}

#[test]
fn what_does_not_converge_says_so() {
    let room = random_room(30);
    let problem = Problem {
        reflectance: Block::from_fn(30, 1, |_, _| 0.95),
        bands: vec![0],
        emission: Block::from_fn(30, 1, |patch, _| f64::from(u8::from(patch == 3))),
        outside: None,
        returned: None,
    };
    for method in METHODS {
        let options = SolveOptions {
            max_iterations: 3,
            ..options(method)
        };
        let solution = solve(&room, &problem, options, &mut |_| true).expect("it runs");
        assert!(!solution.converged && solution.residuals[0] > 1e-6, "{method:?}");
        assert!(solution.iterations <= 4);
    }
}

#[test]
fn an_unsound_problem_is_refused() {
    let room = random_room(4);
    let sound = Problem {
        reflectance: Block::from_fn(4, 1, |_, _| 0.5),
        bands: vec![0],
        emission: Block::from_fn(4, 1, |_, _| 1.0),
        outside: None,
        returned: None,
    };
    let refused = |problem: &Problem| match solve(&room, problem, SolveOptions::default(), &mut |_| true) {
        Err(SolveError::Problem(reason)) => reason,
        other => panic!("{other:?}"),
    };
    let with = |change: fn(&mut Problem)| {
        let mut problem = sound.clone();
        change(&mut problem);
        refused(&problem)
    };
    assert!(with(|p| p.reflectance = Block::from_fn(4, 1, |_, _| 1.5)).contains("1.5"));
    assert!(with(|p| p.emission = Block::from_fn(4, 1, |_, _| f64::NAN)).contains("NaN"));
    assert!(with(|p| p.emission = Block::zeros(3, 1)).contains("4 patches"));
    assert!(with(|p| p.bands = vec![1]).contains("band"));
    let stopped = solve(&room, &sound, SolveOptions::default(), &mut |_| false);
    assert!(matches!(stopped, Err(SolveError::Interrupted)));
}

/// Rows that lack and have too much, that are blocked in part, and that see nothing at all.
fn poor_rows() -> (InMemory, RowTable) {
    // Numbers that f32 holds: the table's sums are the rows'.
    let rows = [
        vec![0.0, 0.375, 0.3125, 0.0],
        vec![0.5, 0.0, 0.625, 0.0],
        vec![0.125, 0.0625, 0.0, 0.0],
        vec![0.0; 4],
    ];
    let mut table = table(4, 0.0, 0.0);
    table.row_sum = rows.iter().map(|row| row.iter().sum()).collect();
    table.escaped = vec![0.25, 0.0, 0.3, 0.0];
    table.blocked = vec![0.0, 0.0, 0.5, 1.0];
    (InMemory::dense(&rows), table)
}

#[test]
fn at_one_temperature_nothing_flows_whatever_rows_lack() {
    let (factors, table) = poor_rows();
    let black = STEFAN_BOLTZMANN * 300.0f64.powi(4);
    for method in METHODS {
        let problem = Problem {
            outside: Some(Block::from_fn(4, 1, |patch, _| table.escaped[patch] * black)),
            returned: Some(table.returned()),
            ..enclosure(&[0.9, 0.3, 0.05, 0.5], &[300.0; 4])
        };
        let solution = solved(&factors, &problem, method);
        for patch in 0..4 {
            assert!(flux(&solution, patch).abs() < 1e-6 * black, "{method:?} {patch}");
        }
        let balance = energy_balance(&problem, &solution, &[1.0; 4], &table)[0];
        assert!(balance.closure.abs() + balance.blocked < 1e-9 * black && balance.returned > 0.1 * black);
        // Without what returns, backs and what rows lack are black and cold.
        let cold = Problem {
            returned: None,
            ..problem
        };
        let solution = solved(&factors, &cold, method);
        assert!(flux(&solution, 2) > 0.01 * black && flux(&solution, 3) > 0.4 * black);
    }
}

#[test]
fn a_white_furnace_is_white_everywhere() {
    let (factors, table) = poor_rows();
    for (method, rho) in METHODS.into_iter().flat_map(|method| [(method, 0.3), (method, 0.8)]) {
        let problem = Problem {
            reflectance: column(&[rho; 4]),
            bands: vec![0],
            emission: column(&[1.0 - rho; 4]),
            outside: Some(column(&table.escaped)),
            returned: Some(table.returned()),
        };
        let solution = solved(&factors, &problem, method);
        assert!(
            solution.radiosity.values().iter().all(|b| (b - 1.0).abs() < 1e-5),
            "{method:?} {rho}"
        );
    }
}

#[test]
fn residuals_that_are_no_numbers_never_converge_and_the_unit_changes_no_bit() {
    let matrix = random_room(30);
    let problem = |scale: f64| Problem {
        reflectance: Block::from_fn(30, 1, |_, _| 0.5),
        bands: vec![0],
        emission: Block::from_fn(30, 1, |patch, _| scale * (1.0 + patch as f64)),
        outside: None,
        returned: None,
    };
    for method in METHODS {
        let wanted = solved(&matrix, &problem(1.0), method);
        for exponent in [500, -500] {
            let scale = 2.0_f64.powi(exponent);
            let found = solved(&matrix, &problem(scale), method);
            assert_eq!(found.residuals, wanted.residuals);
            for (found, wanted) in found.radiosity.values().iter().zip(wanted.radiosity.values()) {
                assert_eq!(*found, wanted * scale);
            }
        }
        for scale in [1e250, 1e-250] {
            let refused = solve(&matrix, &problem(scale), options(method), &mut |_| true);
            assert!(matches!(refused, Err(SolveError::Problem(_))), "{refused:?}");
        }
        let mut rows = vec![vec![0.0, 0.5], vec![0.5, 0.0]];
        let small = Problem {
            reflectance: Block::from_fn(2, 1, |_, _| 0.5),
            bands: vec![0],
            emission: column(&[1.0, 0.0]),
            outside: None,
            returned: None,
        };
        rows[1][0] = f64::NAN;
        let refused = solve(&InMemory::dense(&rows), &small, options(method), &mut |_| true);
        assert!(matches!(refused, Err(SolveError::Diverged { .. })), "{refused:?}");
        let part = InMemory::dense(&[vec![0.0, 0.5]]).run(0).unwrap();
        let twice = InMemory::new(2, vec![Part::clone(&part), Part::clone(&part)]);
        let refused = solve(&twice, &small, options(method), &mut |_| true);
        assert!(matches!(refused, Err(SolveError::Store(_))), "{refused:?}");
    }
}
