//! `hemicube generate`: scenes by rule, as OBJ.

use crate::args::Talk;
use crate::exit::{Exit, hinted};
use crate::help::examples;
use crate::outputs::Paths;
use crate::report::{PendingFile, counted, output_error};
use anyhow::{Context, Result, anyhow, bail};
use clap::Args;
use hemicube_scene::generate::{Generate, Kind, generate};
use hemicube_scene::{Scene, write};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// Generate a scene: room, city, block-city, maze, spheres, field or soup
#[derive(Args, Debug)]
#[command(after_long_help = examples("  hemicube generate city --patches 100000 --seed 3 -o city.obj", false))]
pub(crate) struct Arguments {
    /// The kind of scene: room, city, block-city, maze, spheres, field or soup
    #[arg(value_name = "KIND")]
    pub(crate) kind: Kind,
    /// The OBJ file to write; `-` for standard output
    #[arg(short, long, value_name = "OUT.obj")]
    pub(crate) output: PathBuf,
    /// About how many patches it is to have
    #[arg(long, value_name = "N", default_value = "10000", value_parser = clap::value_parser!(u64).range(1..))]
    pub(crate) patches: u64,
    /// Which of the scenes of this kind; there is one room alone [default: 1]
    #[arg(long, value_name = "S")]
    pub(crate) seed: Option<u64>,
    /// Replace what is there
    #[arg(long)]
    pub(crate) overwrite: bool,
}
impl Arguments {
    /// Paths to read and to write.
    pub(crate) fn paths(&self) -> Paths {
        Paths::default().writes("-o", [&self.output], self.overwrite)
    }
}

pub(crate) fn run(arguments: &Arguments, talk: Talk) -> Result<Exit> {
    if arguments.seed.is_some() && arguments.kind == Kind::Room {
        bail!("`--seed` chooses among scenes of a kind, and there is one room alone");
    }
    let to_stdout = arguments.output.as_os_str() == "-";
    if !to_stdout {
        check_place(&arguments.output, arguments.overwrite)?;
    }
    let scene = generate(Generate {
        kind: arguments.kind,
        target_patches: arguments.patches,
        seed: arguments.seed.unwrap_or(1),
    })?;
    if to_stdout {
        let mut out = BufWriter::new(io::stdout().lock());
        write::obj(&scene, &mut out)
            .and_then(|_| out.flush())
            .map_err(output_error)?;
    } else {
        write_files(&scene, &arguments.output, arguments.overwrite)?;
    }
    let place = if to_stdout {
        String::new()
    } else {
        format!("`{}`: ", arguments.output.display())
    };
    talk.say(&format!(
        "{place}{} ({})",
        counted(scene.triangles.len() as u64, "patch"),
        arguments.kind
    ));
    Ok(Exit::Done)
}

fn check_place(path: &Path, overwrite: bool) -> Result<()> {
    if path.is_dir() {
        bail!(
            "`{}` is a directory; give the name of a file that ends in `.obj`",
            path.display()
        );
    }
    if !path
        .extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case("obj"))
    {
        bail!(
            "`{}` does not end in `.obj`, which is the format that is written",
            path.display()
        );
    }
    if path.exists() && !overwrite {
        return Err(exists(path));
    }
    Ok(())
}

fn exists(path: &Path) -> anyhow::Error {
    hinted(anyhow!("`{}` exists", path.display()), "`--overwrite` replaces it")
}

/// Writes the scene, and its materials beside it if they have more than names.
fn write_files(scene: &Scene, path: &Path, overwrite: bool) -> Result<()> {
    let cannot = || format!("`{}` cannot be written", path.display());
    let has_optics = scene
        .materials
        .iter()
        .any(|m| m.diffuse.is_some() || m.emission.is_some());
    let library = path.with_extension("mtl");
    let library_name = library
        .file_name()
        .and_then(|name| name.to_str())
        .filter(|_| has_optics);
    if library_name.is_some() && library.exists() && !overwrite {
        return Err(exists(&library));
    }
    let mut file = PendingFile::create(path)?;
    let mut out = BufWriter::with_capacity(1 << 20, &mut file);
    match library_name {
        Some(name) => write::obj_with_library(scene, name, &mut out),
        None => write::obj(scene, &mut out),
    }
    .and_then(|_| out.flush())
    .with_context(cannot)?;
    drop(out);
    if library_name.is_some() {
        let mut materials = PendingFile::create(&library)?;
        write::mtl(scene, &mut materials).with_context(|| format!("`{}` cannot be written", library.display()))?;
        materials.commit()?;
    }
    file.commit()
}
