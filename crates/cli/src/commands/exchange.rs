//! `hemicube exchange`: Gebhart factors, total exchange areas, conductances and resistances between surfaces; and their
//! network in the files of thermal solvers.

mod files;
mod networks;

use crate::args::{Report as ReportArguments, StoredMatrix, Talk, share};
use crate::exit::{self, Exit, hinted};
use crate::forecast;
use crate::help::examples;
use crate::materials;
use crate::outputs::Paths;
use crate::progress::Bar;
use crate::report::{self, JsonReport, Listing, SCHEMA, count, counted, figures, five, percent, small_percent, table};
use anyhow::{Context, Result, anyhow, bail};
use clap::{Args, ValueEnum};
use files::{Format, Found};
use hemicube::analysis::exchange::{Conductors, Exchange, Network, joined};
use hemicube::analysis::zones::GroupBy;
use hemicube::solve::{Enclosures, Properties, Reading, SolveError, enclosures};
use hemicube::store::Store;
use hemicube_scene::Budget;
use networks::{Deck, Program};
use serde::Serialize;
use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::atomic::Ordering;

/// Pairs in the table on the terminal: all of eight surfaces and their surroundings.
const PAIRS_SHOWN: usize = 44;
/// Rows of G that add up to 1 within this are conserved.
const CONSERVED: f64 = 1e-6;
/// Enclosures named.
const ENCLOSURES_SHOWN: usize = 6;
/// Names of an enclosure.
const NAMES_SHOWN: usize = 3;

const EXAMPLES: &str = "  \
  hemicube exchange oven.hemicube --materials oven.toml -o oven.csv
  hemicube exchange room.hemicube --materials room.toml --by material -o room.npz -o room.json
  hemicube exchange sat.hemicube --materials sat.toml --for esatan -o sat.txt";

/// Find what surfaces exchange: Gebhart factors, total exchange areas (script F), conductances, resistances
#[derive(Args, Debug)]
#[command(after_long_help = examples(EXAMPLES, false))]
#[command(mut_arg("overwrite", |overwrite| overwrite.requires("output")))]
pub(crate) struct Arguments {
    #[command(flatten)]
    pub(crate) matrix: StoredMatrix,
    /// Properties of objects and materials by name (TOML): emissivity, one number or one a band
    #[arg(long, value_name = "FILE")]
    pub(crate) materials: Option<PathBuf>,
    /// What a surface is: patches of one name, faces of the scene's file, or each patch
    #[arg(
        long,
        value_name = "object|material|face|patch",
        default_value = "object",
        hide_possible_values = true
    )]
    pub(crate) by: By,
    /// Take each row as it is stored, instead of one A_i F_ij of both rows for both directions of a pair
    #[arg(long)]
    pub(crate) as_stored: bool,
    /// Write the factors to FILE: .csv (a line a pair), .json or .npz (repeatable); with `--for`, the network
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: Vec<PathBuf>,
    /// Write the network as a thermal solver reads it, instead of the factors: a radiative conductor GR = A_i script-F_ij
    /// for each pair of surfaces, once, so that q = σ GR (T_i⁴ − T_j⁴). Nodes count from 1, the one after the last
    /// surface is what lies outside
    #[arg(long = "for", value_name = "PROGRAM", help_heading = "Solvers")]
    program: Option<Program>,
    /// With `--for`: leave out pairs below F of what each of the two surfaces exchanges in all. A node without heat
    /// capacity, the mean of what they are with, keeps the sum of each surface [default: all pairs]
    #[arg(long, value_name = "F", value_parser = share, allow_negative_numbers = true, help_heading = "Solvers")]
    min_factor: Option<f64>,
    #[command(flatten)]
    pub(crate) report: ReportArguments,
}

impl Arguments {
    /// Paths to read and to write.
    pub(crate) fn paths(&self) -> Paths {
        Paths::default()
            .store([&self.matrix.store])
            .reads(&self.materials)
            .writes("-o", &self.output, self.matrix.overwrite)
    }
}

/// Grouping of patches into surfaces.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum By {
    /// Objects of one name
    Object,
    /// Materials of one name
    Material,
    /// Faces of the scene's file
    Face,
    /// The matrix's patches
    Patch,
}

impl By {
    fn group(self) -> Option<GroupBy> {
        match self {
            Self::Object => Some(GroupBy::Object),
            Self::Material => Some(GroupBy::Material),
            Self::Face => Some(GroupBy::Face),
            Self::Patch => None,
        }
    }
}

#[derive(Serialize)]
struct Report<'a> {
    schema: u32,
    version: &'static str,
    store: String,
    by: By,
    surfaces: usize,
    bands: &'a [String],
    /// Largest |Σ G − 1| of a row, band by band.
    conservation: Vec<f64>,
    /// Relative difference of A_i 𝓕_ij and A_j 𝓕_ji, band by band.
    reciprocity: Vec<f64>,
    /// Number of surfaces of each enclosure of two or more.
    enclosures: Vec<usize>,
    products: u32,
    #[serde(skip_serializing_if = "Option::is_none")]
    network: Option<NetworkReport>,
}

/// What was written for a thermal solver.
#[derive(Clone, Copy, Debug, Serialize)]
struct NetworkReport {
    #[serde(rename = "for")]
    program: Program,
    /// The number of the surroundings; numbers of mean nodes follow.
    surroundings: usize,
    mean_nodes: usize,
    /// Lines written: pairs that are not left out, and those of mean nodes.
    conductors: usize,
    /// Pairs left out.
    left_out: u64,
    /// Part of the sum of all GR that pairs left out have.
    left_out_share: f64,
}

/// Refuses options that do not go together.
fn refuse_unfit(arguments: &Arguments) -> Result<()> {
    let Some(program) = arguments.program else {
        if arguments.min_factor.is_some() {
            return Err(hinted(
                anyhow!("`--min-factor` is for networks, and `exchange` without `--for` writes all factors"),
                "name a solver by `--for`, or leave it out",
            ));
        }
        return arguments
            .output
            .iter()
            .try_for_each(|output| Format::of(output).map(drop));
    };
    if arguments.as_stored {
        return Err(hinted(
            anyhow!("`--for` writes one conductor for both directions of a pair, and `--as-stored` keeps two"),
            "leave out one of them",
        ));
    }
    match &arguments.output[..] {
        [output] => program.fits(output),
        [] => Err(hinted(anyhow!("`--for` has no file to write"), "name one by `-o FILE`")),
        [_, more @ ..] => Err(hinted(
            anyhow!("`--for` writes one file, and `{}` is another", more[0].display()),
            "run `exchange` once for each file",
        )),
    }
}

pub(crate) fn run(arguments: &Arguments, talk: Talk) -> Result<Exit> {
    let json = JsonReport::asked(&arguments.report);
    refuse_unfit(arguments)?;
    report::require_matrix(&arguments.matrix.store)?;
    let store = Store::open(&arguments.matrix.store)?;
    let cancel = exit::watch_interrupts().context("Ctrl-C cannot be watched")?;
    let patches = store.patches()?;
    let file = arguments.materials.as_deref();
    let properties = materials::read(store.manifest(), &patches, None, file, false, talk)?;
    for note in properties.notes() {
        talk.warn(note);
    }
    let reading = if arguments.as_stored {
        Reading::AsStored
    } else {
        Reading::Pairs
    };
    let network = Network::new(&store, arguments.by.group(), reading)?;
    let emissivity = emissivities(&network, &properties)?;
    let bands = match emissivity.len() {
        1 => vec!["total".to_owned()],
        _ => properties.bands().to_vec(),
    };
    if arguments.program.is_some() && bands.len() > 1 {
        return Err(hinted(
            anyhow!(
                "`--for` writes one network, and emissivities are of {} bands: {}",
                bands.len(),
                bands.join(", ")
            ),
            "give one number for each `emissivity` in the file of `--materials`, that of thermal radiation",
        ));
    }
    // Each band has a dense matrix, and another while its columns are found.
    let surfaces = network.len() as u64;
    let bytes = (8 * (bands.len() as u64 + 1)).saturating_mul(surfaces * (surfaces + 1));
    let next = "`--by object` or `--by material` have fewer surfaces, and a file of materials fewer `bands`";
    let what = format!(
        "the exchange of {} in {}",
        counted(surfaces, "surface"),
        counted(bands.len() as u64, "band")
    );
    forecast::require(Budget::default(), bytes, &what, next)?;
    let bar = Bar::spinner(talk, "solving");
    let guard = exit::InterruptGuard::new();
    let found = Exchange::new(
        &network,
        &emissivity,
        arguments.matrix.threads as usize,
        &mut |done, all| {
            bar.message(&format!("{} of {} columns", count(done as u64), count(all as u64)));
            !cancel.load(Ordering::SeqCst)
        },
    );
    let exchange = match found {
        Ok(exchange) => exchange,
        Err(SolveError::Interrupted) => return Ok(Exit::Interrupted),
        Err(error) => return Err(error.into()),
    };
    drop((bar, guard));
    let (network, exchange) = match nodes_of_bodies(&network, &properties)? {
        Some((nodes, names)) => joined(&network, &exchange, &nodes, names)?,
        None => (network, exchange),
    };
    let enclosures = enclosures(&network.factors)?;
    let found = Found {
        network: &network,
        exchange: &exchange,
        bands: &bands,
        enclosure: enclosures.of_patch(),
    };
    let mut written = None;
    if let Some(program) = arguments.program {
        written = Some(write_network(arguments, program, &found)?);
    } else {
        for output in &arguments.output {
            found.write(output)?;
        }
    }
    let of_scene = properties.emissivities_of_scene();
    if !arguments.report.json {
        report::print(&text(&found, &enclosures, of_scene, written)?)?;
    }
    for output in &arguments.output {
        talk.say(&format!("written: `{}`", output.display()));
    }
    let conservation: Vec<f64> = (0..bands.len()).map(|band| exchange.conservation(band)).collect();
    let is_conserved = conservation.iter().all(|off| *off <= CONSERVED);
    if !is_conserved {
        let off = conservation.iter().copied().fold(0.0, f64::max);
        talk.warn(&format!(
            "Gebhart factors add up to 1 within {} only: what is absorbed nowhere is exchanged with nothing; a surface of \
             each enclosure needs an emissivity above 0",
            figures(off)
        ));
    }
    if let Some(json) = json {
        let sizes = enclosures.patches().into_iter().map(|surfaces| surfaces.len());
        json.write(&Report {
            schema: SCHEMA,
            version: env!("CARGO_PKG_VERSION"),
            store: arguments.matrix.store.display().to_string(),
            by: arguments.by,
            surfaces: network.len(),
            bands: &bands,
            reciprocity: (0..bands.len())
                .map(|band| exchange.reciprocity(&network, band))
                .collect(),
            conservation,
            enclosures: sizes.filter(|size| *size > 1).collect(),
            products: exchange.products,
            network: written,
        })?;
    }
    Ok(if is_conserved { Exit::Done } else { Exit::NotHeld })
}

/// Writes the conductors of the only band.
fn write_network(arguments: &Arguments, program: Program, found: &Found<'_>) -> Result<NetworkReport> {
    let cut_off = arguments.min_factor;
    let conductors = Conductors::new(found.network, found.exchange, 0, cut_off.unwrap_or(0.0));
    let deck = Deck {
        program,
        network: found.network,
        emissivity: &found.exchange.emissivity[0],
        conductors: &conductors,
        store: &arguments.matrix.store,
        cut_off,
    };
    for output in &arguments.output {
        deck.write(output)?;
    }
    Ok(NetworkReport {
        program,
        surroundings: conductors.surroundings() + 1,
        mean_nodes: conductors.means,
        conductors: conductors.pairs().count(),
        left_out: conductors.left_out,
        left_out_share: conductors.left_out_share(),
    })
}

/// The node of each surface and the nodes' names, where surfaces are of bodies: a body is one node.
fn nodes_of_bodies(network: &Network, properties: &Properties) -> Result<Option<(Vec<usize>, Vec<String>)>> {
    let bodies = properties.bodies();
    let of_patch = |patch: usize| bodies[properties.kind_of_patch()[patch] as usize];
    let of_surfaces = network.of_surfaces(of_patch).map_err(|name| {
        hinted(
            anyhow!("the patches of `{name}` are of several bodies, and a surface is of one"),
            "name the body in a table of its object, or take smaller surfaces: `--by face`, `--by patch`",
        )
    })?;
    if of_surfaces.iter().all(Option::is_none) {
        return Ok(None);
    }
    let mut names: Vec<String> = Vec::new();
    let mut known: HashMap<&str, usize> = HashMap::new();
    let mut nodes = Vec::with_capacity(of_surfaces.len());
    for (body, name) in of_surfaces.into_iter().zip(&network.names) {
        let node = match body {
            Some(body) => *known.entry(body).or_insert(names.len()),
            None => names.len(),
        };
        if node == names.len() {
            names.push(body.map_or_else(|| name.clone(), str::to_owned));
        }
        nodes.push(node);
    }
    Ok(Some((nodes, names)))
}

/// Emissivity of each surface, band by band.
fn emissivities(network: &Network, properties: &Properties) -> Result<Vec<Vec<f64>>> {
    let kinds = properties.emissivities().map_err(materials::told)?;
    let of_patch = |patch: usize| &kinds[properties.kind_of_patch()[patch] as usize];
    let surfaces = network.of_surfaces(|patch| of_patch(patch).clone()).map_err(|name| {
        hinted(
            anyhow!("the patches of `{name}` have several emissivities, and a surface has one"),
            "give its object one in a table `[object.\"…\"]`, or take smaller surfaces: `--by face`, `--by patch`",
        )
    })?;
    let bands = surfaces.first().map_or(1, Vec::len);
    if surfaces.is_empty() {
        bail!("the matrix has no surfaces");
    }
    Ok((0..bands)
        .map(|band| surfaces.iter().map(|values| values[band]).collect())
        .collect())
}

fn text(
    found: &Found<'_>,
    enclosures: &Enclosures,
    of_scene: Option<(usize, f64, f64)>,
    written: Option<NetworkReport>,
) -> Result<String> {
    let (network, exchange) = (found.network, found.exchange);
    let mut list = Listing::default();
    list.add(
        "surfaces",
        format!(
            "{} of {}, {}",
            count(network.len() as u64),
            counted(network.of_patch.len() as u64, "patch"),
            counted(network.pairs()?.len() as u64, "pair")
        ),
    );
    if let Some((number, least, most)) = of_scene {
        let range = if least == most {
            format!("{least}")
        } else {
            format!("{least} to {most}")
        };
        let surfaces = counted(number as u64, "surface");
        list.add(
            "emissivity",
            format!("of {surfaces} as the scene's file has it: {range}"),
        );
    }
    for (band, name) in found.bands.iter().enumerate() {
        list.add(
            &if found.bands.len() > 1 {
                format!("check of {name}")
            } else {
                "check".to_owned()
            },
            format!(
                "each row of Gebhart factors adds up to 1 within {}; A[i] script-F[i, j] and A[j] script-F[j, i] \
                 differ by {}",
                figures(exchange.conservation(band)),
                percent(exchange.reciprocity(network, band))
            ),
        );
    }
    let mut all = enclosures.patches();
    let alone = all.iter().filter(|surfaces| surfaces.len() < 2).count();
    all.retain(|surfaces| surfaces.len() > 1);
    all.sort_by_key(|surfaces| std::cmp::Reverse(surfaces.len()));
    for (at, surfaces) in all.iter().enumerate().take(ENCLOSURES_SHOWN) {
        list.add(&format!("enclosure {}", at + 1), enclosure(network, surfaces));
    }
    if all.len() > ENCLOSURES_SHOWN {
        let more = count((all.len() - ENCLOSURES_SHOWN) as u64);
        list.add("enclosures", format!("{more} more"));
    }
    if alone > 0 {
        list.add(
            "alone",
            format!("{} without another in sight", counted(alone as u64, "surface")),
        );
    }
    if let Some(written) = written {
        list.add("network", network_written(written));
    }
    Ok(format!("{}\n{}", pairs(found), list.text()))
}

/// The network of a file in words.
fn network_written(written: NetworkReport) -> String {
    let conductors = counted(written.conductors as u64, "conductor");
    if written.left_out == 0 {
        return format!("{conductors} written, no pair left out");
    }
    let means = counted(written.mean_nodes as u64, "mean node");
    format!(
        "{conductors} written; {} left out, with {} of all GR, which {means} {}",
        counted(written.left_out, "pair"),
        small_percent(written.left_out_share),
        if written.mean_nodes == 1 { "has" } else { "have" }
    )
}

/// An enclosure in words.
fn enclosure(network: &Network, surfaces: &[u32]) -> String {
    let names: Vec<&str> = surfaces
        .iter()
        .take(NAMES_SHOWN)
        .map(|&surface| network.names[surface as usize].as_str())
        .collect();
    let more = match surfaces.len().saturating_sub(NAMES_SHOWN) {
        0 => String::new(),
        more => format!(" and {} more", count(more as u64)),
    };
    let (mut area, mut escaped) = (0.0, 0.0);
    for &surface in surfaces {
        area += network.area[surface as usize];
        escaped += network.area[surface as usize] * network.escaped[surface as usize];
    }
    let lost = if escaped > 0.0 {
        format!("{} of its view leaves the scene", percent(escaped / area))
    } else {
        "closed".to_owned()
    };
    let size = counted(surfaces.len() as u64, "surface");
    format!("{size}: {}{more}; {lost}", names.join(", "))
}

/// The pairs that exchange most in the first band, as a table, and how many are not shown.
fn pairs(found: &Found<'_>) -> String {
    let (network, exchange) = (found.network, found.exchange);
    let surfaces = network.len();
    let pairs = (0..surfaces).flat_map(|from| (from..=surfaces).map(move |to| (from, to)));
    let mut pairs: Vec<(f64, usize, usize)> = pairs
        .map(|(from, to)| (exchange.area(network, 0, from, to), from, to))
        .filter(|(area, ..)| *area > 0.0)
        .collect();
    let all = pairs.len();
    if all > PAIRS_SHOWN {
        pairs.sort_by(|a, b| b.0.total_cmp(&a.0));
        pairs.truncate(PAIRS_SHOWN);
    }
    let shown = pairs.len();
    let rows = pairs.into_iter().map(|(area, from, to)| {
        [
            network.names[from].clone(),
            network
                .names
                .get(to)
                .map_or("(surroundings)", String::as_str)
                .to_owned(),
            format!("{:.6}", exchange.gebhart(0, from, to)),
            five(area),
            format!("{:.5e}", exchange.conductance(network, 0, from, to)),
        ]
    });
    let mut text = table(
        ["from", "to", "Gebhart factor", "exchange area, unit²", "σ A F, W/K⁴"],
        rows,
    );
    let bands = found.bands.len();
    if bands > 1 {
        text.push_str(&format!("of band {}; -o FILE.csv has all {bands}\n", found.bands[0]));
    }
    if shown < all {
        text.push_str(&format!(
            "{} of {}, those with the largest exchange areas; `-o FILE.csv` has all\n",
            count(shown as u64),
            counted(all as u64, "pair")
        ));
    }
    text
}
