//! uDALES' `vfsparse.inp.NNN` and, beside it, `svf.inp.NNN`.
//!
//! Read: uDALES 2 (repository u-dales, 2026), `src/initfac.f90` (the reader: `nnz` lines `i j F`, list-directed; a
//! header line, then a sky view factor a line), `src/modEB.f90` (`calclw`: the longwave that arrives at i is svf_i
//! times the sky's and Σ_j F_ij σ ε_j T_j⁴), and `tools/python/udgeom/view3d.py` (its own writer and its check: rows
//! and sky sum to 1, reciprocity).
//!
//! Facets are the triangles of the STL file in order, from 1. svf_i = 1 − Σ_j F_ij of what is written. A facet that sees
//! no other's front and mostly backs is covered by another house, or lies under one: no air is on it, svf_i = 0, and it
//! keeps its number. What it sees besides backs is where the house is open below.

use super::{SolverJob, SolverWriter};
use crate::faces::{Face, Faces, Found, Grouping, Needs, Sums};
use crate::write::Cancellable;
use crate::{Result, UnfitStep};
use hemicube_solve::analysis::zones::GroupBy;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Share of a row on backs that may count as sky. A choice: more errs by more, less refuses scenes for their seams.
const BLOCKED: f64 = 0.01;
/// Share of a row on backs from which a facet that sees no other's front is inside a house. A choice: with less, a roof
/// below a chimney that is wound the wrong way counts as covered; with more, a wall over an open floor is refused.
const INSIDE: f64 = 0.5;
const PREFIX: &str = "vfsparse.inp.";

pub(crate) struct Udales;

impl SolverWriter for Udales {
    fn needs(&self) -> Needs {
        Needs {
            grouping: Grouping::By(GroupBy::Face),
            sums: Sums::AtMostOne,
            reciprocal: true,
        }
    }

    fn paths(&self, faces: &Faces<'_>, path: &Path) -> Result<Vec<PathBuf>> {
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned());
        let number = name.as_deref().and_then(|name| name.strip_prefix(PREFIX));
        let is_number = |text: &str| text.len() == 3 && text.bytes().all(|digit| digit.is_ascii_digit());
        match number.filter(|number| is_number(number)) {
            Some(number) => Ok(vec![path.to_owned(), path.with_file_name(format!("svf.inp.{number}"))]),
            None => Err(faces.unfit(
                format!("`{}` has no number of an experiment", path.display()),
                "end OUT in `vfsparse.inp.NNN` with three digits",
            )),
        }
    }

    fn forecast(&self, _: &Faces<'_>, found: &Found, _: &Path) -> Result<Option<u64>> {
        Ok(Some(8 * found.entries))
    }

    fn write(&self, job: &SolverJob<'_>, files: &mut [Cancellable<'_>]) -> Result<()> {
        job.put(files, 1, b"# sky view factors\n")?;
        let (mut text, mut sky) = (String::new(), String::new());
        for place in 0..job.faces.len() {
            let face = &job.faces.faces[place];
            let is_covered = is_covered(face);
            if face.blocked > BLOCKED && !is_covered {
                return Err(job.faces.unfit(
                    format!(
                        "{:.4} of what leaves {} ends on backs, which would count as sky",
                        face.blocked,
                        job.faces.named(place)
                    ),
                    UnfitStep::CutOrExclude,
                ));
            }
            let row = job.faces.row(place)?;
            let sum: f64 = row.iter().map(|&(_, factor)| factor).sum();
            text.clear();
            for (column, factor) in row {
                // Writing to a string cannot fail.
                let _ = writeln!(text, "{} {} {factor:e}", place + 1, column + 1);
            }
            sky.clear();
            let seen = if is_covered { 0.0 } else { (1.0 - sum).max(0.0) };
            let _ = writeln!(sky, "{seen:.9}");
            job.put(files, 0, text.as_bytes())?;
            job.put(files, 1, sky.as_bytes())?;
        }
        Ok(())
    }

    fn next(&self, faces: &Faces<'_>, found: &Found, _: &[PathBuf]) -> String {
        let set = format!(
            "uDALES: `lvfsparse = .true.` and `nnz = {}` in &ENERGYBALANCE",
            found.entries
        );
        let mut covered = (0..faces.len()).filter(|&place| is_covered(&faces.faces[place]));
        let Some(first) = covered.next() else { return set };
        format!(
            "{set}; facets that see backs and no other's front, as where joined houses touch: {}, the first {}; their \
             sky view factor is 0",
            1 + covered.count(),
            faces.named(first)
        )
    }
}

/// Returns whether a facet lies against another, or under a house.
fn is_covered(face: &Face) -> bool {
    let fronts = 1.0 - face.escaped - face.blocked;
    face.blocked >= INSIDE && fronts < BLOCKED
}
