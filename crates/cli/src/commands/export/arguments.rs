//! Arguments of `hemicube export`.

use crate::args::{Report, UpAxis};
use crate::help::examples;
use crate::outputs::Paths;
use clap::{Args, ValueEnum};
use std::path::PathBuf;

const EXPORT_EXAMPLES: &str = "  \
  hemicube export room.hemicube room.npz                         # SciPy: scipy.sparse.load_npz
  hemicube export room.hemicube room.data --format mtx
  hemicube export city.hemicube city.npz --with-sky              # and what each patch sees of the sky
  hemicube export room.hemicube zones.csv --by object            # form factors between objects
  hemicube export room.hemicube room.vtp --scene room.obj        # ParaView: each patch with its results
  hemicube export room.hemicube room.glb --scene room.obj --up y --show seen
  hemicube export room.hemicube patches.csv                      # a line a patch";

/// Write a matrix (.npz, .mtx, .txt, .npy, .parquet), or what is known of its patches (.vtp, .glb, .ply, .csv)
#[derive(Args, Debug)]
#[command(after_long_help = examples(EXPORT_EXAMPLES, false))]
pub(crate) struct Arguments {
    /// The matrix
    #[arg(value_name = "DIR")]
    pub(crate) store: PathBuf,
    /// The file to write; its extension says what: the matrix as .npz (SciPy), .mtx (Matrix Market), .txt or .dat
    /// (MATLAB's `spconvert`), .npy (dense), .parquet (triplets); a row of results for each patch, on the model, as
    /// .vtp or .vtu (ParaView), .glb (glTF), .ply, or as a table, .csv
    #[arg(value_name = "OUT")]
    pub(crate) output: PathBuf,
    /// The format, where OUT's extension does not say
    #[arg(long, value_name = "FORMAT")]
    pub(crate) format: Option<FormatName>,
    /// Add rows and columns up: one for each object, material or face of the scene's file. OUT is then a table, `.csv`,
    /// or what View3D writes, `.vf`
    #[arg(long, value_name = "WHAT", conflicts_with_all = ["format", "allow_incomplete", "patches", "scene", "show", "range", "solution", "up"])]
    pub(crate) by: Option<ZoneName>,
    /// Add columns after those of the patches: the ground and the patches of the sky, as `hemicube sky --store` found
    /// them. OUT with `.columns.csv` in place of its ending says what each is
    #[arg(long, conflicts_with = "by")]
    pub(crate) with_sky: bool,
    /// Replace a file that is there
    #[arg(long)]
    pub(crate) overwrite: bool,
    /// Accept a matrix of which parts are missing; their rows become empty
    #[arg(long)]
    pub(crate) allow_incomplete: bool,
    /// What is known of each patch, in place of the matrix, where OUT is a .npz, which may be either
    #[arg(long, help_heading = "Patches")]
    pub(crate) patches: bool,
    /// The scene that the matrix is of: it has the corners that .vtp, .vtu, .glb and .ply need
    #[arg(long, value_name = "SCENE", help_heading = "Patches")]
    pub(crate) scene: Option<PathBuf>,
    /// Read a scene of which more would come than a file of its size may become (docs/security.md)
    #[arg(long, requires = "scene", help_heading = "Patches", hide_short_help = true)]
    pub(crate) allow_large: bool,
    /// Which solutions to add (repeatable) [default: all that `hemicube solve` left beside the matrix]
    #[arg(long, value_name = "NAME", help_heading = "Patches")]
    pub(crate) solution: Vec<String>,
    /// What colours .glb and .ply: a column such as flux, radiosity, sky_view_factor, escaped, seen [default: the first
    /// of these that says something]
    #[arg(long, value_name = "COLUMN", help_heading = "Patches")]
    pub(crate) show: Option<String>,
    /// What the first and the last colour stand for [default: the least and the greatest value]
    #[arg(long, value_name = "LOW,HIGH", value_parser = range, allow_hyphen_values = true, help_heading = "Patches")]
    pub(crate) range: Option<[f64; 2]>,
    /// The axis that points up, for .glb, where that is y [default: the scene's, or z where it does not say]
    #[arg(long, value_name = "x|y|z", hide_possible_values = true, help_heading = "Patches")]
    pub(crate) up: Option<UpAxis>,
    #[command(flatten)]
    pub(crate) report: Report,
}
impl Arguments {
    /// Paths that the command reads and writes.
    pub(crate) fn paths(&self) -> Paths {
        let columns = self.with_sky.then(|| self.output.with_extension("columns.csv"));
        Paths::default()
            .store([&self.store])
            .reads(&self.scene)
            .writes("OUT", [&self.output], self.overwrite)
            .writes("--with-sky", &columns, self.overwrite)
            .reports(&self.report)
    }
}

/// The export formats, by the extensions that stand for them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum FormatName {
    /// A sparse matrix for `scipy.sparse.load_npz`
    Npz,
    /// Matrix Market
    Mtx,
    /// `row column value` lines for MATLAB's and Octave's `spconvert`
    Txt,
    /// A dense NumPy array
    Npy,
    /// Apache Parquet: row, col, value, from 0
    Parquet,
    /// VTK's PolyData, for ParaView: patches
    Vtp,
    /// VTK's UnstructuredGrid: patches
    Vtu,
    /// Binary glTF: patches in the colours of a result
    Glb,
    /// PLY: patches
    Ply,
    /// A table: patches
    Csv,
}

/// What makes patches one zone.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ZoneName {
    /// Objects of one name
    Object,
    /// Materials of one name
    Material,
    /// Faces of the scene's file
    Face,
}

fn range(text: &str) -> Result<[f64; 2], String> {
    let ends = text.split_once(',').and_then(|(low, high)| {
        let end = |text: &str| text.trim().parse::<f64>().ok().filter(|end| end.is_finite());
        Some([end(low)?, end(high)?])
    });
    ends.filter(|[low, high]| low < high)
        .ok_or_else(|| "two numbers such as `0,0.5` are needed, the smaller first".to_owned())
}
