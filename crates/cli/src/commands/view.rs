//! `hemicube view`: pictures of a scene, a matrix, and their results.

mod hemicube;
mod live;
mod model;
mod sparsity;
mod unfolded;

use crate::args::Talk;
use crate::exit::Exit;
use crate::outputs::Paths;
use anyhow::Result;
use clap::Subcommand;

/// Pictures to draw.
#[derive(Debug, Subcommand)]
pub(crate) enum View {
    /// The unfolded hemicube of a patch: what it sees, how far that is, delta form factors, what lies behind
    #[command(
        after_long_help = "Examples:\n  hemicube view hemicube room.obj --split 8 --patch 100 --show depth -o \
                           depth.png\n  hemicube view hemicube room.obj --live"
    )]
    Hemicube(Box<hemicube::Arguments>),
    /// The model from a camera, in the colours of a solution, a row, the sky, or what is in sight
    #[command(
        after_long_help = "Example:\n  hemicube view model room.hemicube --show row --patch 100 --eye \
                           278,273,-800 -o row.png"
    )]
    Model(Box<model::Arguments>),
    /// Where the matrix has entries
    #[command(after_long_help = "Example:\n  hemicube view sparsity room.hemicube --order work -o sparsity.png")]
    Sparsity(sparsity::Arguments),
}

impl View {
    /// Paths to read and to write.
    pub(crate) fn paths(&self) -> Paths {
        match self {
            Self::Hemicube(a) => Paths::default()
                .reads([&a.scene])
                .store(&a.matrix)
                .reads(&crate::portals::file_of(a.specular.as_ref()))
                .writes("-o", &a.output, a.overwrite),
            Self::Model(a) => Paths::default()
                .reads(&a.scene)
                .store([&a.store])
                .writes("-o", [&a.output], a.overwrite),
            Self::Sparsity(a) => Paths::default()
                .store([&a.store])
                .writes("-o", [&a.output], a.overwrite),
        }
    }
}

pub(crate) fn run(command: &View, talk: Talk) -> Result<Exit> {
    match command {
        View::Hemicube(arguments) => hemicube::run(arguments, talk),
        View::Model(arguments) => model::run(arguments, talk),
        View::Sparsity(arguments) => sparsity::run(arguments, talk),
    }
}
