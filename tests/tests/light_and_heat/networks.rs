//! Networks of `exchange --for`: conductors are those of the factors, give the heat of `solve --thermal`, and keep the
//! sum of each node under a cut-off.
//!
//! The binary is the one beside this test: build it with the same profile and target directory before.

use hemicube::solve::STEFAN_BOLTZMANN;
use hemicube_tests::rooms::{obj, room};
use hemicube_tests::runs::Place;
use serde_json::Value;
use std::collections::BTreeMap;

/// Conductors of the pairs i < j, from 1.
type Network = BTreeMap<(usize, usize), f64>;

const SURFACES: usize = 6;
const MIXED: &str = "[default]\nemissivity = 0.9\ntemperature = 293\n[object.bottom]\nemissivity = 0.4\ntemperature = \
                     310\n[object.x0]\nemissivity = 0.1\nadiabatic = true\n[object.top]\nemissivity = 0.7\ntemperature \
                     = 280\n";

/// A room of 4 × 3 × 2.5 m as `room`, and without its back, y1, as `open`; each face in 32 patches.
fn rooms() -> Place {
    let place = Place::new();
    let faces = room(4.0, 3.0, 2.5);
    let open: Vec<_> = faces.iter().filter(|(name, _)| *name != "y1").copied().collect();
    for (name, faces) in [("room", &faces), ("open", &open)] {
        place.write(format!("{name}.obj"), obj(faces));
        place
            .line(&format!("compute {name}.obj -o {name} --split 4 --quiet"))
            .is(0);
    }
    place.write("m.toml", MIXED);
    place
}

fn text(place: &Place, name: &str) -> String {
    std::fs::read_to_string(place.path(name)).expect("a file")
}

fn json(place: &Place, name: &str) -> Value {
    serde_json::from_str(&text(place, name)).expect("JSON")
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

/// The conductors of a line each: two nodes and a value.
fn network<'t>(lines: impl Iterator<Item = [&'t str; 3]>) -> Network {
    let mut network = Network::new();
    for [i, j, value] in lines {
        let node = |text: &str| text.trim().parse::<usize>().unwrap_or_else(|_| panic!("{text}"));
        let value: f64 = value.trim().parse().unwrap_or_else(|_| panic!("{value}"));
        let (i, j) = (node(i), node(j));
        assert!(0 < i && i < j && value > 0.0, "{i} {j} {value}");
        assert!(network.insert((i, j), value).is_none(), "{i} {j} twice");
    }
    network
}

fn of_pairs(text: &str) -> Network {
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some("node_i,node_j,name_i,name_j,gr_m2"));
    network(lines.map(|line| {
        let fields: Vec<&str> = line.split(',').collect();
        assert_eq!(fields.len(), 5, "{line}");
        [fields[0], fields[1], fields[4]]
    }))
}

fn of_esatan(text: &str) -> Network {
    let statements = text.lines().filter(|line| !line.starts_with('#'));
    network(statements.map(|line| {
        let (statement, comment) = line.split_once("; # ").expect("a statement and a comment");
        assert!(comment.contains(" - "), "{comment}");
        let (nodes, value) = statement.split_once(") = ").expect("a value");
        let (i, j) = nodes
            .strip_prefix("GR(")
            .expect("GR")
            .split_once(',')
            .expect("two nodes");
        [i, j, value]
    }))
}

fn of_sinda(text: &str) -> Network {
    let mut lines = text.lines().filter(|line| !line.starts_with("C "));
    assert_eq!(lines.next(), Some("HEADER CONDUCTOR DATA, MAIN"));
    network(lines.enumerate().map(|(at, line)| {
        let (statement, comment) = line.split_once(" $ ").expect("a statement and a comment");
        assert!(comment.contains(" - ") && statement.starts_with("      -"), "{line}");
        let fields: Vec<&str> = statement.split(',').map(str::trim).collect();
        assert_eq!(
            (fields.len(), fields[0]),
            (4, format!("-{}", at + 1).as_str()),
            "{line}"
        );
        [fields[1], fields[2], fields[3]]
    }))
}

fn sums(network: &Network) -> BTreeMap<usize, f64> {
    let mut sums = BTreeMap::new();
    for (&(i, j), value) in network {
        for node in [i, j] {
            *sums.entry(node).or_insert(0.0) += value;
        }
    }
    sums
}

/// σT⁴ of each node whose temperature is not given takes no heat; the heat that each node gives off, in W.
fn heats(network: &Network, nodes: usize, given: &dyn Fn(usize) -> Option<f64>) -> Vec<f64> {
    let mut rows = vec![vec![0.0; nodes + 1]; nodes];
    for (&(i, j), value) in network {
        for (of, to) in [(i - 1, j - 1), (j - 1, i - 1)] {
            rows[of][of] += value;
            rows[of][to] -= value;
        }
    }
    let matrix = rows.clone();
    for (node, row) in rows.iter_mut().enumerate() {
        if let Some(kelvin) = given(node + 1) {
            row.fill(0.0);
            row[node] = 1.0;
            row[nodes] = STEFAN_BOLTZMANN * kelvin.powi(4);
        } else if row[node] == 0.0 {
            // A node without conductors has no temperature.
            row[node] = 1.0;
        }
    }
    // Gauss and Jordan, without exchange of rows: each row is dominated by its diagonal.
    for at in 0..nodes {
        let pivot = rows[at].clone();
        assert!(pivot[at].abs() > 1e-12, "node {}", at + 1);
        for (_, row) in rows.iter_mut().enumerate().filter(|(of, _)| *of != at) {
            let times = row[at] / pivot[at];
            row.iter_mut().zip(&pivot).for_each(|(value, of)| *value -= times * of);
        }
    }
    let emitted: Vec<f64> = (0..nodes).map(|at| rows[at][nodes] / rows[at][at]).collect();
    matrix
        .iter()
        .map(|row| row.iter().zip(&emitted).map(|(a, e)| a * e).sum())
        .collect()
}

/// Heat of each object by `solve --thermal`, in W.
fn solved(place: &Place, line: &str) -> BTreeMap<String, f64> {
    place
        .line(&format!("solve {line} --residual 1e-10 -o by.json --overwrite --quiet"))
        .is(0);
    let surfaces = json(place, "by.json");
    let surfaces = surfaces["surfaces"].as_array().expect("surfaces").iter();
    surfaces
        .map(|of| (of["name"].as_str().expect("a name").to_owned(), number(&of["heat"])))
        .collect()
}

/// The temperature that `MIXED` gives an object.
fn kelvin(object: &str) -> Option<f64> {
    match object {
        "bottom" => Some(310.0),
        "top" => Some(280.0),
        "x0" => None,
        _ => Some(293.0),
    }
}

#[test]
fn each_pair_has_the_exchange_area_of_its_factors_in_every_format() {
    let place = rooms();
    for matrix in ["room", "open"] {
        place
            .line(&format!("exchange {matrix} --materials m.toml -o {matrix}.json -q"))
            .is(0);
        let factors = json(&place, &format!("{matrix}.json"));
        let surfaces = factors["surfaces"].as_array().expect("surfaces");
        let report = place
            .line(&format!(
                "exchange {matrix} --materials m.toml --for pairs -o {matrix}.csv --json"
            ))
            .is(0)
            .json();
        let pairs = of_pairs(&text(&place, &format!("{matrix}.csv")));
        assert_eq!(report["network"]["conductors"], pairs.len());
        assert_eq!(report["network"]["surroundings"], surfaces.len() + 1);
        let sums = sums(&pairs);
        for (at, surface) in surfaces.iter().enumerate() {
            let own = number(&factors["bands"][0]["gebhart"][at][at]);
            let wanted = number(&surface["area"]) * number(&surface["emissivity"][0]) * (1.0 - own);
            assert!((sums[&(at + 1)] / wanted - 1.0).abs() < 1e-6, "{surface} {sums:?}");
            for to in at + 1..=surfaces.len() {
                let area = number(&factors["bands"][0]["exchange_area"][at][to]);
                let found = pairs.get(&(at + 1, to + 1)).copied().unwrap_or(0.0);
                assert!((found - area).abs() <= 1e-6 * wanted, "{at} {to}: {found} {area}");
            }
        }
        for (program, read) in [("esatan", of_esatan as fn(&str) -> Network), ("sinda", of_sinda)] {
            let line = format!("exchange {matrix} --materials m.toml --for {program} -o {matrix}.{program}");
            place.line(&line).is(0).says(&["no pair left out"]);
            let deck = text(&place, &format!("{matrix}.{program}"));
            assert!(
                deck.contains("hemicube ") && deck.contains("(surroundings)") && deck.contains("m2"),
                "{deck}"
            );
            assert!(deck.lines().all(|line| line.chars().count() <= 132));
            let found = read(&deck);
            assert!(found.keys().eq(pairs.keys()));
            for (pair, value) in &found {
                assert!((value / pairs[pair] - 1.0).abs() < 1e-8, "{pair:?}");
            }
        }
    }
    let table = text(&place, "open.csv");
    assert!(table.contains(",6,bottom,(surroundings),"), "{table}");
}

#[test]
fn a_network_gives_the_heat_of_the_solution() {
    let place = rooms();
    let near = |found: f64, wanted: f64, what: &str| {
        assert!(
            (found - wanted).abs() <= 1e-3 * wanted.abs().max(1.0),
            "{what}: {found} {wanted}"
        );
    };
    for (matrix, sky) in [("room", ""), ("open", " --sky-temperature 270")] {
        let names: Vec<&str> = room(4.0, 3.0, 2.5).iter().map(|(name, _)| *name).collect();
        let names: Vec<&str> = names
            .into_iter()
            .filter(|name| matrix == "room" || *name != "y1")
            .collect();
        // One node an object.
        let line = format!("{matrix} --thermal --materials m.toml{sky}");
        let wanted = solved(&place, &format!("{line} --network --by object"));
        place
            .line(&format!(
                "exchange {matrix} --materials m.toml --for esatan -o {matrix}.txt -q"
            ))
            .is(0);
        let found = heats(
            &of_esatan(&text(&place, &format!("{matrix}.txt"))),
            names.len() + 1,
            &|node| names.get(node - 1).map_or(Some(270.0), |name| kelvin(name)),
        );
        for (name, found) in names.iter().zip(&found) {
            near(*found, wanted[*name], name);
        }
        // One node a patch: patches of a face follow each other.
        let wanted = solved(&place, &line);
        place
            .line(&format!(
                "exchange {matrix} --by patch --materials m.toml --for sinda -o {matrix}.inc -q"
            ))
            .is(0);
        let each = 32;
        let found = heats(
            &of_sinda(&text(&place, &format!("{matrix}.inc"))),
            each * names.len() + 1,
            &|node| names.get((node - 1) / each).map_or(Some(270.0), |name| kelvin(name)),
        );
        for (name, found) in names.iter().zip(found.chunks(each)) {
            near(found.iter().sum(), wanted[*name], name);
        }
    }
}

#[test]
fn a_cut_off_keeps_the_sum_of_each_node() {
    let place = rooms();
    for (matrix, surfaces, sky) in [("room", SURFACES, ""), ("open", SURFACES - 1, " --sky-temperature 270")] {
        let patches = 32 * surfaces;
        let line = format!("exchange {matrix} --by patch --materials m.toml --for pairs");
        place.line(&format!("{line} -o {matrix}-all.csv -q")).is(0);
        let report = place
            .line(&format!("{line} -o {matrix}-cut.csv --min-factor 0.004 --json"))
            .is(0)
            .json();
        let all = of_pairs(&text(&place, &format!("{matrix}-all.csv")));
        let cut = of_pairs(&text(&place, &format!("{matrix}-cut.csv")));
        let (left_out, share) = (
            number(&report["network"]["left_out"]),
            number(&report["network"]["left_out_share"]),
        );
        assert!(left_out > 100.0 && 0.001 < share && share < 0.5, "{report}");
        assert!(cut.len() < all.len(), "{} {}", cut.len(), all.len());
        let (before, after) = (sums(&all), sums(&cut));
        for (node, sum) in &before {
            assert!((after[node] / sum - 1.0).abs() < 1e-9, "{node}: {} {sum}", after[node]);
        }
        // What is kept is as it was, and what is not is below the cut-off.
        for (&(i, j), value) in &all {
            let small = *value < 0.004 * before[&i].min(before[&j]);
            assert!(cut.get(&(i, j)).map_or(small, |kept| kept == value), "{i} {j}");
        }
        // The mean node takes no heat, and none flows at one temperature.
        let means = report["network"]["mean_nodes"].as_u64().expect("a number");
        let nodes = patches + 1 + usize::try_from(means).expect("few");
        let objects = if matrix == "room" {
            vec!["bottom", "top", "x0", "x1", "y0", "y1"]
        } else {
            vec!["bottom", "top", "x0", "x1", "y0"]
        };
        let still = heats(&cut, nodes, &|node| (node <= patches + 1).then_some(300.0));
        assert!(still.iter().all(|heat| heat.abs() < 1e-9), "{still:?}");
        let found = heats(&cut, nodes, &|node| match objects.get((node - 1) / 32) {
            Some(name) => kelvin(name),
            None => (node == patches + 1).then_some(270.0),
        });
        assert!(found.iter().sum::<f64>().abs() < 1e-6 && found[patches + 1..].iter().all(|heat| heat.abs() < 1e-6));
        let wanted = solved(&place, &format!("{matrix} --thermal --materials m.toml{sky}"));
        let most = wanted.values().fold(0.0, |most: f64, heat| most.max(heat.abs()));
        for (name, found) in objects.iter().zip(found.chunks(32)) {
            let found: f64 = found.iter().sum();
            assert!(
                (found - wanted[*name]).abs() < 0.05 * most,
                "{name}: {found} {}",
                wanted[*name]
            );
        }
    }
    place
        .line("exchange room --by patch --materials m.toml --for esatan -o cut.txt --min-factor 0.004")
        .is(0)
        .says(&["left out, with", "mean node"]);
    assert!(text(&place, "cut.txt").contains("(mean 1)"));
}

#[test]
fn what_is_no_network_is_refused() {
    let place = rooms();
    place.write(
        "bands.toml",
        "bands = [\"thermal\", \"solar\"]\n[default]\nemissivity = [0.9, 0.3]\n",
    );
    for (options, words) in [
        ("--materials m.toml --for esatan", ["`--for`", "-o FILE"]),
        ("--materials m.toml --for esatan -o x.npz", ["ends in .npz", ".txt"]),
        ("--materials m.toml --for pairs -o x.json", ["ends in .json", ".csv"]),
        ("--materials m.toml --for sinda -o x.CSV", ["ends in .csv", ".txt"]),
        (
            "--materials m.toml --for pairs -o x.csv -o y.csv",
            ["`y.csv`", "once for each file"],
        ),
        (
            "--materials m.toml --for pairs -o x.csv --as-stored",
            ["--as-stored", "leave out one"],
        ),
        (
            "--materials m.toml -o x.csv --min-factor 0.01",
            ["--min-factor", "--for"],
        ),
        (
            "--materials m.toml --for pairs -o x.csv --min-factor 2",
            ["--min-factor", "below 1"],
        ),
        ("--materials m.toml --for thermica -o x.txt", ["--for", "esatan"]),
        (
            "--materials bands.toml --for pairs -o x.csv",
            ["2 bands: thermal, solar", "one number"],
        ),
    ] {
        let ran = place.line(&format!("exchange room {options}"));
        assert_eq!(ran.code, Some(2), "{options}: {}{}", ran.out, ran.err);
        ran.says(&words);
        for name in ["x.npz", "x.json", "x.CSV", "x.csv", "y.csv", "x.txt"] {
            assert!(!place.path(name).exists(), "{options}: {name}");
        }
    }
    // One emissivity for all bands is one network.
    place.write("one.toml", "bands = [\"a\", \"b\"]\n[default]\nemissivity = 0.8\n");
    place
        .line("exchange room --materials one.toml --for pairs -o x.csv")
        .is(0);
    place
        .line("exchange room --materials m.toml --for pairs -o x.csv")
        .is(2)
        .says(&["--overwrite"]);
}
