//! Bodies: surfaces of one temperature, as one node of a network.
//!
//! ```text
//! A_I = Σ A_i      A_I ε_I = Σ A_i ε_i      A_I 𝓕_IJ = Σ_i Σ_j A_i 𝓕_ij      G_IJ = A_I 𝓕_IJ / (A_I ε_I)
//! ```
//!
//! over the surfaces i of body I and j of body J: what I and J exchange is σ A_I 𝓕_IJ (T_I⁴ − T_J⁴), exactly. Surfaces of
//! a body keep radiosities of their own: its resistances, (1 − ε_I) / (A_I ε_I) and 1 / (A_I F_IJ), are means.

use super::{Exchange, Network};
use crate::solve::{Factors, InMemory, SolveError};
use hemicube_store::{Form, Part};
use std::collections::HashMap;

/// A network and its exchange with the surfaces of each body as one. `node` is that of each surface, from 0 without a
/// gap, and `names` are the nodes'.
///
/// # Errors
/// [`SolveError::Problem`] for nodes of other surfaces, and errors of reading.
pub fn joined(
    network: &Network,
    exchange: &Exchange,
    node: &[usize],
    names: Vec<String>,
) -> Result<(Network, Exchange), SolveError> {
    let nodes = names.len();
    if node.len() != network.len() || node.iter().any(|&node| node >= nodes) {
        return Err(SolveError::Problem(format!(
            "bodies are not of the {} surfaces",
            network.len()
        )));
    }
    let mut area = vec![0.0; nodes];
    let mut patches = vec![0; nodes];
    let mut hands_on_all = vec![true; nodes];
    for (surface, &node) in node.iter().enumerate() {
        area[node] += network.area[surface];
        patches[node] += network.patches[surface];
        hands_on_all[node] &= exchange.hands_on_all[surface];
    }
    let per = |sum: f64, whole: f64| if whole > 0.0 { sum / whole } else { 0.0 };
    let mean = |values: &[f64]| {
        let mut sums = vec![0.0; nodes];
        for ((&node, value), area) in node.iter().zip(values).zip(&network.area) {
            sums[node] += area * value;
        }
        let pairs = sums.into_iter().zip(&area);
        pairs.map(|(sum, &area)| per(sum, area)).collect::<Vec<f64>>()
    };
    let mut sums: Vec<HashMap<usize, f64>> = vec![HashMap::new(); nodes];
    for run in 0..network.factors.run_count() {
        let part = network.factors.run(run)?;
        for (row, &surface) in part.rows.iter().enumerate() {
            let surface = surface as usize;
            let (columns, data) = part.row(row);
            for (&column, factor) in columns.iter().zip(data) {
                let to = node[column.cast_unsigned() as usize];
                *sums[node[surface]].entry(to).or_insert(0.0) += network.area[surface] * factor;
            }
        }
    }
    let mut part = Part {
        indptr: vec![0],
        ..Part::new(Form::Double)
    };
    for ((row, sums), &area) in (0u32..).zip(sums).zip(&area) {
        let mut entries: Vec<(usize, f64)> = sums.into_iter().collect();
        entries.sort_unstable_by_key(|&(to, _)| to);
        for (to, sum) in entries {
            part.indices.push(i32::try_from(to).unwrap_or(i32::MAX));
            part.data.push(per(sum, area));
        }
        part.rows.push(row);
        part.indptr.push(i64::try_from(part.data.len()).unwrap_or(i64::MAX));
    }
    let width = network.len() + 1;
    let mut gebhart = Vec::with_capacity(exchange.gebhart.len());
    for (emissivity, factors) in exchange.emissivity.iter().zip(&exchange.gebhart) {
        // What surfaces that emit nothing would send counts by their area.
        let mut emitting = vec![0.0; nodes];
        for (surface, &node) in node.iter().enumerate() {
            emitting[node] += network.area[surface] * emissivity[surface];
        }
        let mut joined = vec![0.0; nodes * (nodes + 1)];
        for (surface, row) in factors.chunks_exact(width).enumerate() {
            let from = node[surface];
            let weight = if emitting[from] > 0.0 {
                network.area[surface] * emissivity[surface] / emitting[from]
            } else {
                per(network.area[surface], area[from])
            };
            for (to, factor) in row.iter().enumerate() {
                let to = node.get(to).copied().unwrap_or(nodes);
                joined[from * (nodes + 1) + to] += weight * factor;
            }
        }
        gebhart.push(joined);
    }
    let found = Exchange {
        emissivity: exchange.emissivity.iter().map(|band| mean(band)).collect(),
        gebhart,
        hands_on_all,
        products: exchange.products,
    };
    let of_nodes = Network {
        names,
        patches,
        of_patch: network
            .of_patch
            .iter()
            .map(|&surface| u32::try_from(node[surface as usize]).unwrap_or(u32::MAX))
            .collect(),
        escaped: mean(&network.escaped),
        returned: mean(&network.returned),
        error: mean(&network.error),
        handed_on: if network.handed_on.is_empty() {
            Vec::new()
        } else {
            mean(&network.handed_on)
        },
        factors: InMemory::new(nodes, vec![part]),
        area,
    };
    Ok((of_nodes, found))
}

#[cfg(test)]
mod tests {
    use super::super::tests::{exchange, network};
    use super::*;

    /// Two halves of a ball within a sphere are the ball, whatever each of them emits.
    #[test]
    fn a_body_exchanges_what_its_surfaces_do() {
        let spheres = network(
            &[1.0, 1.0, 8.0],
            &[0.0, 0.0, 0.125],
            &[vec![0.0, 0.0, 1.0], vec![0.0, 0.0, 1.0], vec![0.125, 0.125, 0.625]],
        );
        let found = exchange(&spheres, &[0.3, 0.9, 0.7]);
        let names = ["ball", "sphere"].map(str::to_owned).to_vec();
        let (bodies, of_bodies) = joined(&spheres, &found, &[0, 0, 1], names).expect("nodes");
        assert_eq!(
            (bodies.area[0], bodies.patches[0], of_bodies.emissivity[0][0]),
            (2.0, 2, 0.6)
        );
        // The sphere, and what lies outside.
        for (node, surface) in [(1, 2), (2, 3)] {
            let of_halves: f64 = (0..2).map(|half| found.area(&spheres, 0, half, surface)).sum();
            let area = of_bodies.area(&bodies, 0, 0, node);
            assert!((area - of_halves).abs() < 1e-12, "{node}: {area} {of_halves}");
        }
        assert!(of_bodies.conservation(0) < 1e-8 && of_bodies.reciprocity(&bodies, 0) < 1e-7);
        assert!(joined(&spheres, &found, &[0, 0], vec![String::new()]).is_err());
    }
}
