//! Properties of a scene's surfaces for `hemicube solve` and `exchange`: those from the scene's file, and those that a
//! TOML file gives objects and materials by name, which take precedence.
//!
//! ```toml
//! bands = ["red", "green", "blue"]        # or any others; one number stands for all bands
//!
//! [default]                               # surfaces without a value of their own
//! reflectance = 0.5
//!
//! [material.white]
//! reflectance = [0.725, 0.71, 0.68]
//! emission = 0                            # emitted radiosity
//!
//! [material."facade*"]                    # a pattern, for names without an exact entry
//! emissivity = 0.9
//! absorptance = 0.6                       # of sunlight
//! temperature = 293.15                    # kelvin; or `adiabatic = true`: no net flux
//!
//! [object."Zone 3*"]                      # goes before materials
//! temperature = "20 °C"
//! ```
//!
//! `hemicube::solve::Properties` has the rule of precedence.

use crate::advice;
use crate::args::Talk;
use crate::exit::hinted;
use crate::toml_file;
use anyhow::{Result, anyhow, bail};
use hemicube::driver::settings::ReadingRecord;
use hemicube::groups::spread;
use hemicube::solve::{Entry, Named, PrintedTable, Properties, PropertyError, Spectrum, Tables};
use hemicube::store::{Manifest, PatchTable};
use hemicube_scene::{Material, ReadOptions};
use std::fmt::Write as _;
use std::path::Path;

/// The table of defaults in a file to begin with: all keys, commented out.
const BEGINNING: &str = "\
[default]
# reflectance = 0.5       # from 0 to 1, one number or one a band; emission: from 0 on, likewise
# emissivity = 0.9        # from 0 to 1
# absorptance = 0.6       # of sunlight, from 0 to 1
# temperature = \"20 °C\"   # or kelvin: 293.15; or one of these:
# flux = 100              # net flux, W/m²
# heat = 100              # net heat of the whole surface, W
# adiabatic = true        # no net flux on any patch
# isothermal = true       # one unknown temperature; with flux or heat, otherwise with none in all
# body = \"radiator\"       # likewise, of all surfaces of this body together
";

/// Reads the properties of a matrix's patches from `scene` and from the TOML file `path`.
///
/// # Errors
/// When a file cannot be read, the scene is another than the matrix's, or the TOML names nothing of it.
pub(crate) fn read(
    manifest: &Manifest,
    table: &PatchTable,
    scene: Option<&Path>,
    path: Option<&Path>,
    allow_large: bool,
    talk: Talk,
) -> Result<Properties> {
    let optics = scene
        .map(|scene| of_scene(&manifest.materials, scene, allow_large, talk))
        .transpose()?;
    let tables: Tables = match path {
        Some(path) => toml_file::read(path, "materials")?,
        None => Tables::default(),
    };
    let shown = path.map_or_else(String::new, |path| format!("`{}`: ", path.display()));
    let named = Named {
        objects: &manifest.objects,
        materials: &manifest.materials,
        object: &table.object,
        material: &table.material,
    };
    let further = ReadingRecord::of_settings(&manifest.settings).further_names;
    let mut tables = tables;
    spread(&mut tables, named.objects, named.materials, &further)
        .map_err(|tie| anyhow!("{tie}").context(format!("{shown}the materials do not fit")))?;
    Properties::new(named, optics, tables)
        .map_err(|error| told(error).context(format!("{shown}the materials do not fit")))
}

/// An error of properties, with its next step.
pub(crate) fn told(error: PropertyError) -> anyhow::Error {
    match &error.step {
        Some(step) => hinted(anyhow!(error.reason.clone()), advice::of_properties(step)),
        None => anyhow!(error.reason),
    }
}

/// Warns of libraries that were not read: what they describe is taken from elsewhere, or missing.
fn of_scene(names: &[String], path: &Path, allow_large: bool, talk: Talk) -> Result<Vec<[Option<[f64; 3]>; 2]>> {
    let scene = hemicube_scene::load(
        path,
        ReadOptions {
            optics: true,
            allow_large,
            ..ReadOptions::default()
        },
    )?;
    if !scene.materials.iter().map(|material| &material.name).eq(names) {
        bail!(
            "`{}` is not the scene that the matrix is of: its materials are others",
            path.display()
        );
    }
    for warning in scene.ledger.unread_libraries() {
        talk.warn(warning);
    }
    let values = |material: &Material| [material.diffuse, material.emission];
    Ok(scene.materials.iter().map(values).collect())
}

/// The file of materials to begin with: every object and material with patches, and the values that hold. It reads
/// back as what it was made from.
pub(crate) fn file_of(properties: &Properties, of: &Path) -> String {
    let mut text = format!(
        "# Properties of `{}`, for `--materials`. An object's table goes before its material's, a name before a \
         pattern\n# (`*`: any characters, `?`: one), `[default]` comes last.\n",
        of.display().to_string().replace(['\n', '\r'], " ")
    );
    let bands: Vec<String> = properties.bands().iter().map(|band| quoted(band)).collect();
    let _ = writeln!(text, "bands = [{}]\n", bands.join(", "));
    text.push_str(BEGINNING);
    for table in properties.tables() {
        table_of(&table, &mut text);
    }
    text
}

fn table_of(table: &PrintedTable, text: &mut String) {
    let kind = if table.is_object { "object" } else { "material" };
    let _ = writeln!(text, "\n[{kind}.{}]", quoted(&table.name));
    let entry: &Entry = &table.entry;
    for (key, value) in [
        ("reflectance", &entry.reflectance),
        ("emission", &entry.emission),
        ("emissivity", &entry.emissivity),
    ] {
        match value {
            Some(Spectrum::Grey(value)) => {
                let _ = writeln!(text, "{key} = {value}");
            }
            Some(Spectrum::Bands(values)) => {
                let values: Vec<String> = values.iter().map(f64::to_string).collect();
                let _ = writeln!(text, "{key} = [{}]", values.join(", "));
            }
            None => {}
        }
    }
    let temperature = entry.temperature.map(hemicube::solve::Temperature::kelvin);
    for (key, value) in [
        ("absorptance", entry.absorptance),
        ("temperature", temperature),
        ("flux", entry.flux),
        ("heat", entry.heat),
    ] {
        if let Some(value) = value {
            let _ = writeln!(text, "{key} = {value}");
        }
    }
    for (key, value) in [("adiabatic", entry.adiabatic), ("isothermal", entry.isothermal)] {
        if let Some(value) = value {
            let _ = writeln!(text, "{key} = {value}");
        }
    }
    if let Some(body) = &entry.body {
        let _ = writeln!(text, "body = {}", quoted(body));
    }
}

/// A string of TOML.
fn quoted(text: &str) -> String {
    let mut quoted = String::from("\"");
    for c in text.chars() {
        match c {
            '"' | '\\' => {
                quoted.push('\\');
                quoted.push(c);
            }
            c if hemicube_scene::is_unseen(c) => {
                let _ = write!(quoted, "\\u{:04X}", u32::from(c));
            }
            c => quoted.push(c),
        }
    }
    quoted.push('"');
    quoted
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_printed_file_reads_back_as_what_it_was_made_from() {
        let objects = ["a \"b\"", "c*", ""].map(str::to_owned);
        let materials = ["m\u{7}", "emissivity 0.8"].map(str::to_owned);
        let named = Named {
            objects: &objects,
            materials: &materials,
            object: &[0, 1, 1, 2],
            material: &[0, 0, 1, 1],
        };
        let given = "[default]\nreflectance = 0.5\ntemperature = 3\n[material.\"m*\"]\nemissivity = 0.25\n\
                     [object.\"c*\"]\nheat = 5\nisothermal = true\nbody = \"a b\"\n[object.\"\"]\nemission = [1, 2, 3.5]\n";
        let made = |text: &str| {
            Properties::new(named, None, toml::from_str(text).expect("good TOML")).expect("properties that fit")
        };
        let first = made(given);
        let printed = file_of(&first, Path::new("x.hemicube"));
        let again = made(&printed);
        assert_eq!(printed, file_of(&again, Path::new("x.hemicube")));
        assert_eq!(first.optics().expect("known"), again.optics().expect("known"));
        for (ours, theirs) in first
            .thermal()
            .expect("known")
            .iter()
            .zip(again.thermal().expect("known"))
        {
            assert_eq!((ours.emissivity, ours.condition), (theirs.emissivity, theirs.condition));
        }
        assert!(printed.contains("[object.\"a \\\"b\\\"\"]") && printed.contains("[material.\"m\\u0007\"]"));
    }
}
