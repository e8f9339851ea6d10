//! Radiative conductors of a thermal network, each pair once, and a cut-off that keeps the sum of each node.
//!
//! ```text
//! GR_ij = w A_i 𝓕_ij + (1 − w) A_j 𝓕_ji         w = (A_j ε_j)² / ((A_i ε_i)² + (A_j ε_j)²)
//! q_ij = σ GR_ij (T_i⁴ − T_j⁴)
//! S_i = Σ_j GR_ij = A_i ε_i (1 − G_ii)
//! GR_ij < F min(S_i, S_j)      a small pair, for a cut-off F
//! GR_im = d_i                  what node i has in small pairs, as one conductor to the mean node m
//! ```
//!
//! Both directions are one number but for the residual of a column of G, which A_i ε_i multiplies: with these weights a
//! large surface does not spoil the sum of a small one.
//!
//! Nodes are the surfaces, the surroundings, and mean nodes: one for each connected part of the small pairs. A mean node
//! has no heat capacity and takes no heat, so that T_m⁴ = Σ d_i T_i⁴ / Σ d_i. Conductors stay positive and symmetric,
//! S_i is kept within rounding, and nothing flows at one temperature. A part with no more pairs than nodes keeps its
//! pairs, because a mean node would not make the network smaller.
//!
//! No scaling of the other pairs to the sums, because often there is none: small things in a large room, each with one
//! pair left, to a wall, would need more than the wall has. No conductor to the surroundings in place of the pairs,
//! because a closed room would lose heat.

use super::{Exchange, Network};

/// The conductors of a band.
#[derive(Clone, Debug)]
pub struct Conductors<'a> {
    network: &'a Network,
    exchange: &'a Exchange,
    band: usize,
    cut_off: f64,
    /// S_i of each surface and of the surroundings, the last, in the square of the scene's unit.
    pub sums: Vec<f64>,
    /// d_i of each of these, 0 where no pair is left out.
    pub lost: Vec<f64>,
    /// The mean node, from 0, of each node that has lost pairs.
    mean: Vec<Option<usize>>,
    /// Number of mean nodes.
    pub means: usize,
    /// Number of pairs that exchange anything.
    pub all: u64,
    /// Number of pairs left out.
    pub left_out: u64,
}

impl<'a> Conductors<'a> {
    /// The conductors of `band`; pairs below `cut_off` of the sums of both nodes are left out. 0 leaves out none.
    ///
    /// ```
    /// use hemicube_solve::analysis::exchange::{Conductors, Exchange, Network};
    /// use hemicube_solve::analysis::zones::GroupBy;
    /// use hemicube_solve::solve::Reading;
    /// # mod room { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/../store/doc/room.rs")); }
    /// # let folder = tempfile::tempdir()?;
    /// # let store = room::stored(&folder.path().join("room.hemicube"), 0.05)?;
    ///
    /// let network = Network::new(&store, Some(GroupBy::Object), Reading::Pairs)?;
    /// let exchange = Exchange::new(&network, &[vec![0.8; network.len()]], 0, &mut |_, _| true)?;
    /// let conductors = Conductors::new(&network, &exchange, 0, 0.0);
    /// let of_first: f64 = conductors.pairs().filter(|pair| pair.0 == 0).map(|pair| pair.2).sum();
    /// assert!((of_first / conductors.sums[0] - 1.0).abs() < 1e-12);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn new(network: &'a Network, exchange: &'a Exchange, band: usize, cut_off: f64) -> Self {
        let nodes = network.len() + 1;
        let mut found = Self {
            network,
            exchange,
            band,
            cut_off,
            sums: vec![0.0; nodes],
            lost: vec![0.0; nodes],
            mean: vec![None; nodes],
            means: 0,
            all: 0,
            left_out: 0,
        };
        for (a, b, conductor) in areas(network, exchange, band) {
            found.all += 1;
            found.sums[a] += conductor;
            found.sums[b] += conductor;
        }
        if cut_off > 0.0 {
            found.leave_out();
        }
        found
    }

    /// Finds the connected parts of the small pairs, and gives a mean node to each that is smaller by it.
    fn leave_out(&mut self) {
        let nodes = self.sums.len();
        let mut above: Vec<usize> = (0..nodes).collect();
        let all = || areas(self.network, self.exchange, self.band);
        for (a, b, _) in all().filter(|&pair| self.is_small(pair)) {
            let (a, b) = (root(&mut above, a), root(&mut above, b));
            above[a.max(b)] = a.min(b);
        }
        let parts: Vec<usize> = (0..nodes).map(|node| root(&mut above, node)).collect();
        let (mut pairs_of, mut nodes_of) = (vec![0_u64; nodes], vec![0_u64; nodes]);
        for (a, ..) in all().filter(|&pair| self.is_small(pair)) {
            pairs_of[parts[a]] += 1;
        }
        for &part in &parts {
            nodes_of[part] += 1;
        }
        let (mut means, mut mean_of) = (0, vec![None; nodes]);
        for part in 0..nodes {
            if pairs_of[part] > nodes_of[part] {
                mean_of[part] = Some(means);
                means += 1;
            }
        }
        let (mut lost, mut left_out) = (vec![0.0; nodes], 0);
        for (a, b, conductor) in all().filter(|&pair| self.is_small(pair) && mean_of[parts[pair.0]].is_some()) {
            left_out += 1;
            lost[a] += conductor;
            lost[b] += conductor;
        }
        self.mean = parts.iter().map(|&part| mean_of[part]).collect();
        (self.means, self.lost, self.left_out) = (means, lost, left_out);
    }

    fn is_small(&self, (a, b, conductor): (usize, usize, f64)) -> bool {
        conductor < self.cut_off * self.sums[a].min(self.sums[b])
    }

    /// Number of surfaces: that of the surroundings, from 0. Mean nodes come behind it.
    pub fn surroundings(&self) -> usize {
        self.network.len()
    }

    /// The pairs of nodes, from 0, and their conductors: each pair once, the lower node first, then those of mean nodes.
    pub fn pairs(&self) -> impl Iterator<Item = (usize, usize, f64)> + '_ {
        let kept = areas(self.network, self.exchange, self.band)
            .filter(|&pair| self.mean[pair.0].is_none() || !self.is_small(pair));
        let first = self.surroundings() + 1;
        let of_means = (0..first)
            .filter_map(move |node| self.mean[node].map(|mean| (node, first + mean, self.lost[node])))
            .filter(|&(.., conductor)| conductor > 0.0);
        kept.chain(of_means)
    }

    /// Part of the sum of all conductors that pairs left out have.
    pub fn left_out_share(&self) -> f64 {
        let (lost, all) = (self.lost.iter().sum::<f64>(), self.sums.iter().sum::<f64>());
        if all > 0.0 { lost / all } else { 0.0 }
    }
}

/// The pairs with a conductor, the lower node first; what is not above 0 is rounding of no exchange.
fn areas<'a>(
    network: &'a Network,
    exchange: &'a Exchange,
    band: usize,
) -> impl Iterator<Item = (usize, usize, f64)> + 'a {
    let count = network.len();
    let square = move |surface: usize| (network.area[surface] * exchange.emissivity[band][surface]).powi(2);
    let of = move |a: usize, b: usize| {
        let there = exchange.area(network, band, a, b);
        if b == count {
            return there;
        }
        let (of_a, of_b) = (square(a), square(b));
        if of_a > 0.0 && of_b > 0.0 {
            let weight = of_b / (of_a + of_b);
            weight * there + (1.0 - weight) * exchange.area(network, band, b, a)
        } else {
            0.0
        }
    };
    (0..count)
        .flat_map(move |a| (a + 1..=count).map(move |b| (a, b, of(a, b))))
        .filter(|&(.., conductor)| conductor > 0.0)
}

/// The least node of a node's part.
fn root(above: &mut [usize], mut node: usize) -> usize {
    while above[node] != node {
        above[node] = above[above[node]];
        node = above[node];
    }
    node
}

#[cfg(test)]
mod tests {
    use super::super::tests::{exchange, network};
    use super::*;

    /// A box with `things` small things in it, which see a part `between` of their view of each other; what is left of
    /// all views is the wall's, surface 0, or its own. The wall loses a part `open`.
    fn room(things: usize, between: f64, open: f64) -> (Network, Exchange) {
        let count = things + 1;
        let mut area = vec![1.0; count];
        area[0] = 100.0;
        let each = if things > 1 { between / (things - 1) as f64 } else { 0.0 };
        let to_wall = 1.0 - each * (things as f64 - 1.0);
        let mut rows = vec![vec![each; count]; count];
        let mut escaped = vec![0.0; count];
        for thing in 1..count {
            rows[thing][thing] = 0.0;
            rows[thing][0] = to_wall;
            rows[0][thing] = to_wall / area[0];
        }
        escaped[0] = open;
        rows[0][0] = 1.0 - open - to_wall * things as f64 / area[0];
        let network = network(&area, &escaped, &rows);
        let exchange = exchange(&network, &vec![0.7; count]);
        (network, exchange)
    }

    fn sums(conductors: &Conductors<'_>) -> Vec<f64> {
        let mut sums = vec![0.0; conductors.sums.len() + conductors.means];
        for (a, b, conductor) in conductors.pairs() {
            assert!(a < b && conductor > 0.0, "{a} {b} {conductor}");
            sums[a] += conductor;
            sums[b] += conductor;
        }
        sums
    }

    /// S_i = A_i ε_i (1 − G_ii): a row of G adds up to 1.
    #[test]
    fn a_node_has_all_that_its_surface_exchanges() {
        let (network, exchange) = room(5, 0.2, 0.25);
        let conductors = Conductors::new(&network, &exchange, 0, 0.0);
        let found = sums(&conductors);
        for surface in 0..network.len() {
            let wanted = network.area[surface] * 0.7 * (1.0 - exchange.gebhart(0, surface, surface));
            assert!((found[surface] / wanted - 1.0).abs() < 1e-8, "{surface}");
        }
        assert_eq!((conductors.means, conductors.left_out, conductors.all), (0, 0, 21));
    }

    /// No scaling of what is left can keep these sums: each thing has a pair with the wall alone.
    #[test]
    fn a_cut_off_keeps_the_sum_of_each_node() {
        for open in [0.0, 0.25] {
            let (network, exchange) = room(30, 0.2, open);
            let conductors = Conductors::new(&network, &exchange, 0, 0.05);
            assert_eq!((conductors.means, conductors.surroundings()), (1, 31));
            assert!(conductors.left_out >= 30 * 29 / 2 && conductors.left_out_share() > 0.01);
            let found = sums(&conductors);
            for (node, sum) in conductors.sums.iter().enumerate() {
                assert!(
                    (found[node] - sum).abs() <= 1e-12 * sum,
                    "{node}: {} {sum}",
                    found[node]
                );
            }
            let pairs = conductors.pairs().count() as u64;
            assert!(pairs < conductors.all - conductors.left_out + 32 && pairs < 100);
        }
    }

    #[test]
    fn few_small_pairs_stay() {
        let (network, exchange) = room(3, 0.01, 0.0);
        let conductors = Conductors::new(&network, &exchange, 0, 0.1);
        assert_eq!((conductors.means, conductors.left_out), (0, 0));
        assert_eq!(conductors.pairs().count() as u64, conductors.all);
    }

    #[test]
    fn what_exchanges_nothing_has_no_conductor() {
        let (network, _) = room(3, 0.2, 0.0);
        let white = exchange(&network, &[0.5, 0.0, 0.5, 0.5]);
        let conductors = Conductors::new(&network, &white, 0, 0.5);
        assert!(conductors.pairs().all(|(a, b, _)| a != 1 && b != 1 && b != 4));
        assert_eq!(conductors.sums[1], 0.0);
    }
}
