//! Elmer's `ViewFactors.dat`, text.
//!
//! Read: ElmerSolver, `fem/src/RadiationFactors.F90` in three states, the oldest without and the others with the
//! keyword `Viewfactor Binary Output` (the reader, list-directed: for each radiating element the number of its entries,
//! then a line `i j F` an entry; `i` is not used).
//!
//! Row i is the i-th boundary element whose boundary condition says `Radiation = Diffuse Gray`, in the order of
//! `mesh.boundary`; all are of one `Radiation Boundary`. The Gebhart factors solve (I − ρ F) G = F ε: F is from row to
//! column.

use super::{SolverJob, SolverWriter};
use crate::Result;
use crate::faces::{Faces, Found, Grouping, Needs, Sums};
use crate::write::Cancellable;
use hemicube_solve::analysis::zones::GroupBy;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

pub(crate) struct Elmer;

impl SolverWriter for Elmer {
    fn needs(&self) -> Needs {
        Needs {
            grouping: Grouping::By(GroupBy::Face),
            sums: Sums::AtMostOne,
            reciprocal: false,
        }
    }

    fn paths(&self, _: &Faces<'_>, path: &Path) -> Result<Vec<PathBuf>> {
        Ok(vec![path.to_owned()])
    }

    fn forecast(&self, _: &Faces<'_>, found: &Found, _: &Path) -> Result<Option<u64>> {
        // At least: two numbers of a digit and a value of three characters.
        Ok(Some(8 * found.entries))
    }

    fn write(&self, job: &SolverJob<'_>, files: &mut [Cancellable<'_>]) -> Result<()> {
        let mut text = String::new();
        for place in 0..job.faces.len() {
            let row = job.faces.row(place)?;
            text.clear();
            // Writing to a string cannot fail.
            let _ = writeln!(text, "{}", row.len());
            for (column, factor) in row {
                let _ = writeln!(text, "{} {} {factor:e}", place + 1, column + 1);
            }
            job.put(files, 0, text.as_bytes())?;
        }
        Ok(())
    }

    fn next(&self, faces: &Faces<'_>, _: &Found, paths: &[PathBuf]) -> String {
        format!(
            "Elmer: put `{}` beside `mesh.boundary`, whose {} radiating elements are its rows in order; leave \
             `Viewfactor Binary Output` and `Update View Factors` out",
            paths[0].display(),
            faces.len()
        )
    }
}
