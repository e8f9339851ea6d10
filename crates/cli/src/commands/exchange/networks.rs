//! Radiative conductors in the text of thermal solvers: `exchange --for`.
//!
//! ```text
//! pairs    node_i,node_j,name_i,name_j,gr_m2
//! esatan   GR(i,j) = value; # name - name          lines of a $CONDUCTORS block; the solver multiplies by STEFAN
//! sinda    -number, i, j, value $ name - name      HEADER CONDUCTOR DATA; a number below 0: radiation, times SIGMA
//! ```
//!
//! Nodes count from 1: surfaces in their order, then the surroundings, then the mean nodes of a cut-off.

use super::files::{SURROUNDINGS, ends_in, names_of_factors};
use crate::escape::shown;
use crate::exit::hinted;
use crate::report::{PendingFile, five};
use crate::table::field;
use anyhow::{Context, Result, anyhow};
use clap::ValueEnum;
use hemicube::analysis::exchange::{Conductors, Network};
use serde::Serialize;
use std::borrow::Cow;
use std::io::{BufWriter, Write};
use std::path::Path;

/// Characters of a line for ESATAN-TMS and SINDA/FLUINT: a longer comment is cut.
const LINE_MAX: usize = 132;
/// The submodel of SINDA/FLUINT.
const SUBMODEL: &str = "MAIN";

/// A reader of conductors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Program {
    /// A table: numbers and names of both nodes, and GR
    Pairs,
    /// ESATAN-TMS: lines `GR(i,j) = value;` of a `$CONDUCTORS` block
    Esatan,
    /// SINDA/FLUINT: radiation conductors, `HEADER CONDUCTOR DATA`
    Sinda,
}

impl Program {
    /// What `--for` takes.
    fn name(self) -> &'static str {
        match self {
            Self::Pairs => "pairs",
            Self::Esatan => "esatan",
            Self::Sinda => "sinda",
        }
    }

    /// Refuses a name that says another format.
    pub(super) fn fits(self, path: &Path) -> Result<()> {
        let is_table = self == Self::Pairs && ends_in(path, "csv");
        let Some(format) = names_of_factors()
            .find(|format| ends_in(path, format))
            .filter(|_| !is_table)
        else {
            return Ok(());
        };
        let ending = if self == Self::Pairs { ".csv" } else { ".txt" };
        Err(hinted(
            anyhow!(
                "`--for {}` writes text, and `{}` ends in .{format}",
                self.name(),
                path.display()
            ),
            format!("end it in {ending}, or leave out `--for` for all factors as .{format}"),
        ))
    }
}

/// A network to write, and its origin.
pub(super) struct Deck<'a> {
    pub(super) program: Program,
    pub(super) network: &'a Network,
    pub(super) emissivity: &'a [f64],
    pub(super) conductors: &'a Conductors<'a>,
    /// The matrix.
    pub(super) store: &'a Path,
    pub(super) cut_off: Option<f64>,
}

impl Deck<'_> {
    /// Writes a file; it appears whole or not at all.
    pub(super) fn write(&self, path: &Path) -> Result<()> {
        let mut file = PendingFile::create(path)?;
        let mut out = BufWriter::with_capacity(1 << 20, &mut file);
        match self.program {
            Program::Pairs => self.pairs(&mut out),
            Program::Esatan => self.esatan(&mut out),
            Program::Sinda => self.sinda(&mut out),
        }
        .and_then(|()| out.flush())
        .with_context(|| format!("`{}` cannot be written", path.display()))?;
        drop(out);
        file.commit()
    }

    /// The name of a node, from 0.
    fn name(&self, node: usize) -> Cow<'_, str> {
        let surroundings = self.conductors.surroundings();
        match self.network.names.get(node) {
            Some(name) => Cow::Borrowed(name),
            None if node == surroundings => Cow::Borrowed(SURROUNDINGS),
            None => Cow::Owned(format!("(mean {})", node - surroundings)),
        }
    }

    fn pairs(&self, out: &mut impl Write) -> std::io::Result<()> {
        writeln!(out, "node_i,node_j,name_i,name_j,gr_m2")?;
        for (a, b, conductor) in self.conductors.pairs() {
            let (of, to) = (field(&self.name(a)), field(&self.name(b)));
            writeln!(out, "{},{},{of},{to},{conductor}", a + 1, b + 1)?;
        }
        Ok(())
    }

    fn esatan(&self, out: &mut impl Write) -> std::io::Result<()> {
        self.head(
            out,
            "#",
            &[
                "Include these lines in the $CONDUCTORS block of the submodel that has the nodes.",
                "GR is without the Stefan-Boltzmann constant: q = STEFAN * GR * (T_i^4 - T_j^4).",
            ],
        )?;
        for (a, b, conductor) in self.conductors.pairs() {
            let (of, to) = (self.name(a), self.name(b));
            let text = format!("GR({},{}) = {conductor:.9E}; # {of} - {to}", a + 1, b + 1);
            line(out, &text)?;
        }
        Ok(())
    }

    fn sinda(&self, out: &mut impl Write) -> std::io::Result<()> {
        self.head(
            out,
            "C",
            &[
                "Put the name of the submodel that has the nodes in place of MAIN.",
                "GR is without the Stefan-Boltzmann constant: set SIGMA in CONTROL DATA, 5.670374E-8 W/(m2 K4).",
            ],
        )?;
        writeln!(out, "HEADER CONDUCTOR DATA, {SUBMODEL}")?;
        for (number, (a, b, conductor)) in (1_u64..).zip(self.conductors.pairs()) {
            let (of, to) = (self.name(a), self.name(b));
            let text = format!("      -{number}, {}, {}, {conductor:.9E} $ {of} - {to}", a + 1, b + 1);
            line(out, &text)?;
        }
        Ok(())
    }

    /// The head: origin, units, what `notes` say, and the nodes.
    fn head(&self, out: &mut impl Write, comment: &str, notes: &[&str]) -> std::io::Result<()> {
        let surroundings = self.conductors.surroundings();
        let mut say = |text: &str| line(out, &format!("{comment} {text}"));
        say(concat!("hemicube ", env!("CARGO_PKG_VERSION"), " exchange"))?;
        say(&format!("matrix: {}", self.store.display()))?;
        say("Radiative conductors GR, each pair once, in m2 where the scene's unit is the metre.")?;
        for note in notes {
            say(note)?;
        }
        say(&format!(
            "Nodes: surfaces from 1 to {surroundings} in their order, {} is what lies outside.",
            surroundings + 1
        ))?;
        if let Some(cut_off) = self.cut_off {
            say(&format!(
                "Pairs left out, below {cut_off} of the sums of both nodes: {}. In place of them,",
                self.conductors.left_out
            ))?;
            say("nodes (mean ...) without heat capacity keep the sum of each node.")?;
        }
        say("node  name  area  emissivity")?;
        let alone = |node: usize| match self.conductors.sums.get(node) {
            Some(sum) if *sum == 0.0 => "  without a conductor",
            _ => "",
        };
        for (node, (area, emissivity)) in self.network.area.iter().zip(self.emissivity).enumerate() {
            let (name, area) = (self.name(node), five(*area));
            say(&format!("{}  {name}  {area}  {emissivity}{}", node + 1, alone(node)))?;
        }
        for node in surroundings..=surroundings + self.conductors.means {
            say(&format!("{}  {}{}", node + 1, self.name(node), alone(node)))?;
        }
        Ok(())
    }
}

/// A line, cut to its length; characters of names that would end it are escaped.
fn line(out: &mut impl Write, text: &str) -> std::io::Result<()> {
    let text = shown(text);
    let end = text.char_indices().nth(LINE_MAX).map_or(text.len(), |(end, _)| end);
    writeln!(out, "{}", text[..end].trim_end())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_ends_no_line_and_makes_none_too_long() {
        let mut out = Vec::new();
        line(&mut out, "GR(1,2) = 1.0E0; # a\nGR(1,3) = 9.0E0; - b").expect("memory");
        line(&mut out, &"é".repeat(200)).expect("memory");
        let text = String::from_utf8(out).expect("UTF-8");
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 2);
        assert_eq!(lines[1].chars().count(), LINE_MAX);
    }

    #[test]
    fn a_name_of_another_format_is_refused() {
        for (program, path, fits) in [
            (Program::Pairs, "x.csv", true),
            (Program::Pairs, "x.txt", true),
            (Program::Pairs, "x.NPZ", false),
            (Program::Esatan, "x", true),
            (Program::Esatan, "x.csv", false),
            (Program::Sinda, "x.json", false),
        ] {
            assert_eq!(program.fits(Path::new(path)).is_ok(), fits, "{program:?} {path}");
        }
    }
}
