//! Arguments of `hemicube compute`.

use crate::args::{
    AutoSwitch, ConfigFiles, RenderSettings, Report, SceneSettings, SelectionSettings, ShardChoice, number, share,
};
use crate::help::{SCENE, examples, scene_help};
use crate::outputs::Paths;
use crate::portals::PortalSettings;
use crate::report::matrix_of;
use clap::{Args, ValueEnum};
use hemicube::PatchKind;
use hemicube::store::Form;
use std::path::PathBuf;

/// Compute the form-factor matrix of a scene, or go on where a run stopped
#[derive(Args, Debug)]
#[command(override_usage = "hemicube compute [OPTIONS] SCENE [-o DIR]", after_long_help = examples(
    "  hemicube compute room.obj -o room.hemicube
  hemicube compute room.obj -o room.hemicube --tolerance 0.5% --verify 32
  hemicube compute city.obj -o sample.hemicube --rows 1% --seed 7
  hemicube compute new.obj -o new.hemicube --update old.hemicube
  hemicube compute city.obj -o city.hemicube --shard 3/16     # then: hemicube merge city.hemicube
  hemicube compute house.obj -o house.hemicube --by object    # form factors between objects
  hemicube compute city.glb -o facades.hemicube --emitters 'facade*' --occluders 'tree*'
  hemicube compute room.obj -o fine.hemicube --split 16 --json > fine.json",
    true,
))]
pub(crate) struct Arguments {
    #[arg(value_name = "SCENE", required_unless_present = "print_config", help = SCENE, long_help = scene_help())]
    pub(crate) scene: Option<PathBuf>,
    /// The directory to write [default: SCENE.hemicube, here]
    #[arg(short, long, value_name = "DIR")]
    pub(crate) output: Option<PathBuf>,
    /// Replace a matrix that is there
    ///
    /// Without it, the same settings resume an unfinished matrix, and others are refused.
    #[arg(long)]
    pub(crate) overwrite: bool,
    /// Take over the rows of DIR, the matrix before a change of the scene, that see nothing of the change
    ///
    /// The other rows are computed with the same random numbers: what did not change does not differ.
    #[arg(long, value_name = "DIR")]
    pub(crate) update: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) patches: SceneSettings,
    #[command(flatten)]
    pub(crate) render: RenderSettings,
    #[command(flatten)]
    pub(crate) process: ProcessSettings,
    /// Measure the error of ROWS random rows by rays
    ///
    /// Exit 1 when it is above the tolerance.
    #[arg(
        long,
        value_name = "ROWS",
        value_parser = clap::value_parser!(u32).range(1..),
        help_heading = "Matrix"
    )]
    pub(crate) verify: Option<u32>,
    /// Skip what cannot be seen; the matrix is the same
    #[arg(long, value_name = "auto|on|off", default_value = "auto", hide = true)]
    pub(crate) culling: AutoSwitch,
    /// Hemicubes a call of the backend; 0: what it likes best. Rows are the same
    #[arg(
        long,
        value_name = "N",
        default_value = "0",
        value_parser = clap::value_parser!(u32).range(0..=1 << 20),
        hide = true
    )]
    pub(crate) batch: u32,
    /// What a row is: triangle, face, object or material
    #[arg(
        long = "by",
        value_name = "KIND",
        default_value = "triangle",
        hide_default_value = true,
        hide_possible_values = true,
        help_heading = "Matrix"
    )]
    pub(crate) by: Kind,
    #[command(flatten)]
    pub(crate) selection: SelectionSettings,
    #[command(flatten)]
    pub(crate) portals: PortalSettings,
    /// Of the files: auto, plain, compact or double
    ///
    /// plain: f32, 8 bytes an entry; compact: 2 to 4 bytes, F within 0.05 %; double: f64, 12 bytes; auto: plain, and
    /// compact from a million patches on.
    #[arg(
        long,
        value_name = "FORM",
        default_value = "auto",
        hide_default_value = true,
        hide_possible_values = true,
        help_heading = "Matrix"
    )]
    pub(crate) form: StoreForm,
    /// Leave out form factors below F and rescale the row [default: 0; 1e-7 from a million patches on]
    #[arg(
        long,
        value_name = "F",
        value_parser = share_or_none,
        allow_negative_numbers = true,
        help_heading = "Matrix",
        hide_short_help = true
    )]
    pub(crate) min_factor: Option<f64>,
    #[command(flatten)]
    pub(crate) config: ConfigFiles,
    #[command(flatten)]
    pub(crate) report: Report,
}

impl Arguments {
    /// Fills in what the user leaves open: the matrix's name, the resolution.
    pub(crate) fn settle(&mut self) {
        self.render.settle();
        if self.output.is_none() {
            self.output = self.scene.as_deref().map(matrix_of);
        }
    }

    /// Paths to read and to write.
    pub(crate) fn paths(&self) -> Paths {
        Paths::default()
            .reads(&self.scene)
            .reads(&self.config.config)
            .store(&self.update)
            .reads(&self.portals.file())
            .makes(&self.output)
            .tells("--progress-file", &self.process.progress_file)
    }
}

/// Distribution, limits and progress of a long run. They do not change the matrix.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Run")]
pub(crate) struct ProcessSettings {
    /// Compute share I of N; auto: as the scheduler says
    ///
    /// By the variables of Slurm, MPI or Kubernetes.
    #[arg(long, value_name = "I/N|auto", conflicts_with_all = ["overwrite", "verify"])]
    pub(crate) shard: Option<ShardChoice>,
    /// Write how far it has come to FILE (JSON), once a second
    #[arg(long, value_name = "FILE", hide_short_help = true)]
    pub(crate) progress_file: Option<PathBuf>,
}

/// The form of a store's parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum StoreForm {
    /// Compact from a million patches on.
    Auto,
    /// As SciPy reads it.
    Plain,
    /// Smaller.
    Compact,
    /// Form factors in f64.
    Double,
}

impl StoreForm {
    /// The form, if one was asked for.
    pub(crate) fn form(self) -> Option<Form> {
        match self {
            Self::Auto => None,
            Self::Plain => Some(Form::Plain),
            Self::Compact => Some(Form::Compact),
            Self::Double => Some(Form::Double),
        }
    }
}

/// Kinds of patches.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Kind {
    /// Triangles, as cut.
    Triangle,
    /// Faces of the file.
    Face,
    /// Objects.
    Object,
    /// Materials.
    Material,
}

impl From<Kind> for PatchKind {
    fn from(kind: Kind) -> Self {
        match kind {
            Kind::Triangle => Self::Triangle,
            Kind::Face => Self::Face,
            Kind::Object => Self::Object,
            Kind::Material => Self::Material,
        }
    }
}

/// A share, or 0 for nothing.
fn share_or_none(text: &str) -> Result<f64, String> {
    if number(text)? == 0.0 { Ok(0.0) } else { share(text) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_least_factor_may_be_none() {
        assert_eq!((share_or_none("0"), share_or_none("1e-5")), (Ok(0.0), Ok(1e-5)));
        assert!(share("0").is_err() && share_or_none("-1e-5").is_err() && share_or_none("1").is_err());
    }
}
