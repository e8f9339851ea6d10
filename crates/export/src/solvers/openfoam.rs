//! OpenFOAM's `F`, `globalFaceFaces` and `mapDist`, of the .com line, in a case's `constant`.
//!
//! Read: OpenFOAM v1912, what its `viewFactorsGen` writes for a cube of 2³ cells, and `src/thermophysicalModels/
//! radiation/radiationModels/viewFactor/viewFactor.C` of a later release of that line (the reader: row i of `F` holds
//! the form factors from i to the faces in row i of `globalFaceFaces`; without smoothing they are used as they are).
//!
//! Faces are those of the patches in the group `viewFactorWall`, in the order of `polyMesh/boundary`, from 0, as
//! clusters of `finalAgglom`, which must make each face a cluster of its own. `mapDist` is the map of one process.

use super::{SolverJob, SolverWriter};
use crate::Result;
use crate::faces::{Faces, Found, Grouping, Needs, Sums};
use crate::write::Cancellable;
use hemicube_solve::analysis::zones::GroupBy;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// The files, with their classes.
const FILES: [(&str, &str); 3] = [
    ("F", "scalarListList"),
    ("globalFaceFaces", "labelListList"),
    ("mapDist", "mapDistribute"),
];

pub(crate) struct OpenFoam;

fn head(name: &str, class: &str, location: &str) -> String {
    format!(
        "FoamFile\n{{\n    version     2.0;\n    format      ascii;\n    class       {class};\n    location    \
         \"{location}\";\n    object      {name};\n}}\n\n"
    )
}

impl SolverWriter for OpenFoam {
    fn needs(&self) -> Needs {
        Needs {
            grouping: Grouping::By(GroupBy::Face),
            sums: Sums::AtMostOne,
            reciprocal: false,
        }
    }

    fn paths(&self, faces: &Faces<'_>, path: &Path) -> Result<Vec<PathBuf>> {
        if !path.join("polyMesh").is_dir() {
            return Err(faces.unfit(
                format!("`{}` has no `polyMesh`", path.display()),
                "let OUT be the case's `constant`, or the region's folder in it",
            ));
        }
        Ok(FILES.iter().map(|(name, _)| path.join(name)).collect())
    }

    fn forecast(&self, _: &Faces<'_>, found: &Found, _: &Path) -> Result<Option<u64>> {
        Ok(Some(6 * found.entries))
    }

    fn write(&self, job: &SolverJob<'_>, files: &mut [Cancellable<'_>]) -> Result<()> {
        let count = job.faces.len();
        for (file, (name, class)) in FILES.iter().enumerate() {
            let folder = job.paths[file].parent().and_then(Path::file_name);
            let location = match folder.map(|folder| folder.to_string_lossy()) {
                Some(region) if region != "constant" && !region.is_empty() => format!("constant/{region}"),
                _ => "constant".to_owned(),
            };
            job.put(files, file, head(name, class, &location).as_bytes())?;
        }
        let list = format!("{count}\n(\n");
        job.put(files, 0, list.as_bytes())?;
        job.put(files, 1, list.as_bytes())?;
        for place in 0..count {
            let row = job.faces.row(place)?;
            let words = |each: &dyn Fn(&(u32, f64)) -> String| {
                let words: Vec<String> = row.iter().map(each).collect();
                format!("{}({})\n", row.len(), words.join(" "))
            };
            job.put(files, 0, words(&|(_, factor)| format!("{factor:e}")).as_bytes())?;
            job.put(files, 1, words(&|(column, _)| column.to_string()).as_bytes())?;
        }
        job.put(files, 0, b")\n")?;
        job.put(files, 1, b")\n")?;
        // Size; what is sent to process 0, and where it is put: all, in order; no flips, no transforms.
        let mut identity = format!("1(\n{count}\n(\n");
        for place in 0..count {
            // Writing to a string cannot fail.
            let _ = writeln!(identity, "{place}");
        }
        identity += ")\n)\n";
        let map = format!("{count}\n{identity}{identity}0 0\n\n0()\n0()\n");
        job.put(files, 2, map.as_bytes())
    }

    fn next(&self, faces: &Faces<'_>, _: &Found, _: &[PathBuf]) -> String {
        format!(
            "OpenFOAM: `finalAgglom` must leave the {} faces of `viewFactorWall` as they are; then run the solver \
             without `viewFactorsGen`, and with `smoothing false`",
            faces.len()
        )
    }
}
