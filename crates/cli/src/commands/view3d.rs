//! `hemicube view3d IN.vs3 OUT.vf`: in the place of View3D, with its arguments, control lines, files and exit status.
//!
//! Read: View3D 4.0.0, `src/v3main.c` (arguments, order of the adjustments, what is reported), `src/getdat.c` (control
//! words and their bounds, limits of emittances), `src/viewpp.c` (combined surfaces, normalisation, interchange
//! factors), `src/view3d.c` (masks), `src/misc.c` (errors end it with status 1, and are in `View3D.log`), and its
//! manual.
//!
//! Rows are surfaces: those of kind `S` and `M`, without those that are combined with another. A mask and what it
//! covers see each other alone, and both have its area.
//!
//! In place of an integration that ends by `eps` there is a tolerance of 10 `eps`, relative over the matrix: 0.1 %
//! unless a line says otherwise. That is View3D's own error with `eps=1e-4` in a room of 300 triangles; in a city of
//! 600 View3D is 0.84 % off, and 0.35 % with `eps=1e-6` (docs/dev/peers.md). On View3D's own examples it leaves 10⁻⁸, and
//! View3D's `eps=1e-4` up to 1.4·10⁻⁴ (of the L-shaped room's hidden pairs).
//!
//! No tolerance of 50 `eps`, because it is four times View3D's error in that room, if faster than View3D in the city.

mod adjust;

use crate::args::Talk;
use crate::exit::{self, Exit, hinted};
use crate::help::examples;
use crate::outputs::Paths;
use crate::report::{PendingFile, counted};
use adjust::Exchange;
use anyhow::{Context, Result, anyhow};
use clap::Args;
use hemicube::driver::input::SceneInput;
use hemicube::driver::job::{Job, Sessions};
use hemicube::store::Part;
use hemicube_backend_cpu::CpuBackend;
use hemicube_export::{View3dForm, View3dHead, write_view3d};
use hemicube_scene::vs3::{self, Study};
use hemicube_scene::{ReadOptions, Subdivision};
use std::ffi::OsString;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// View3D's log, in the working directory.
const LOG: &str = "View3D.log";
/// View3D's `eps` unless a control line says otherwise.
const EPS: f64 = 1e-4;
/// The tolerance of `eps`.
const TOLERANCE_OF_EPS: f64 = 10.0;
/// Emittances that View3D takes, the others are replaced.
const EMITTANCES: [f64; 2] = [0.001, 0.999];
/// Surfaces of a dense file: n² numbers of 9 bytes are 39 GB.
const DENSE_MAX: usize = 65_536;
/// Names of obstructions, as the reader gives them.
const OBSTRUCTIONS: &str = "obstruction *";

/// Compute view factors as View3D does: a script that calls `view3d` needs no other change
#[derive(Args, Debug)]
#[command(after_long_help = examples(
    "  hemicube view3d cube.vs3 cube.vf
  ln -s \"$(command -v hemicube)\" view3d && ./view3d cube.vs3 cube.vf",
    false,
))]
pub(crate) struct Arguments {
    /// The `.vs3` file
    #[arg(value_name = "IN.vs3")]
    input: PathBuf,
    /// The view factor file to write; one that is there is replaced
    #[arg(value_name = "OUT.vf")]
    output: PathBuf,
}

impl Arguments {
    /// Paths to read and to write.
    pub(crate) fn paths(&self) -> Paths {
        Paths::default()
            .reads([&self.input])
            .writes("OUT.vf", [&self.output], true)
            .writes(LOG, [&PathBuf::from(LOG)], true)
    }
}

/// What a command line of a program called `view3d` stands for; `None` where that needs its usage. Others are as they
/// are.
pub(crate) fn arguments_of(words: Vec<OsString>) -> Option<Vec<OsString>> {
    let name = words
        .first()
        .map(|word| Path::new(word).file_stem().unwrap_or_default().to_ascii_lowercase());
    if name.as_deref() != Some("view3d".as_ref()) {
        return Some(words);
    }
    match <[OsString; 3]>::try_from(words) {
        Ok([program, input, output]) => Some(vec![program, "view3d".into(), "--".into(), input, output]),
        Err(_) => None,
    }
}

/// The usage of a program called `view3d`, and View3D's exit status for it.
pub(crate) fn usage() -> Exit {
    let text = "View3D by hemicube - view factors between simple polygons\n\nusage: view3d <input file> <output file>\n\
                Arguments:\n\tinput file     VS3 file to read\n\toutput file    View factor file to write\n";
    // A closed standard error leaves no way to tell.
    let _ = std::io::stderr().write_all(text.as_bytes());
    Exit::NotHeld
}

/// Settings of the control lines.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Controls {
    eps: f64,
    form: View3dForm,
    encl: bool,
    emit: bool,
    /// From 1; 0: all.
    row: usize,
    /// From 1; 0: all.
    column: usize,
    list: i64,
}

impl Controls {
    /// The settings, and what of the lines has no effect here.
    ///
    /// # Errors
    /// When a value is no number or out of bounds; the line is named.
    fn of(study: &Study, path: &Path) -> Result<(Self, Vec<String>)> {
        let mut found = Self {
            eps: EPS,
            form: View3dForm::Text,
            encl: false,
            emit: false,
            row: 0,
            column: 0,
            list: 0,
        };
        let mut notes = Vec::new();
        for (name, value, line) in &study.controls {
            let place = || format!("{}:{line}: ", path.display());
            let whole = || {
                let number = value.parse::<i64>();
                number.map_err(|_| anyhow!("{}`{value}` is no whole number for `{name}`", place()))
            };
            let count = || Ok::<_, anyhow::Error>(usize::try_from(whole()?).unwrap_or(0));
            match name.as_str() {
                "eps" => {
                    let eps = value.parse::<f64>().ok().filter(|eps| *eps > 0.0 && eps.is_finite());
                    found.eps = eps.ok_or_else(|| anyhow!("{}`{value}` is no number above 0 for `eps`", place()))?;
                    if !(0.99e-6..=1e-2).contains(&found.eps) {
                        notes.push(format!(
                            "WARNING {}eps {value} is taken as one of 1e-6 to 1e-2",
                            place()
                        ));
                        found.eps = found.eps.clamp(1e-6, 1e-2);
                    }
                }
                "out" => {
                    let form = u64::try_from(whole()?).ok().and_then(View3dForm::of);
                    found.form =
                        form.ok_or_else(|| anyhow!("{}out={value} is no form of output; 0 to 2 are", place()))?;
                }
                "encl" => found.encl |= whole()? != 0,
                "emit" => found.emit |= whole()? != 0,
                "row" => found.row = count()?,
                "col" => found.column = count()?,
                "list" => found.list = whole()?,
                "maxu" | "maxo" | "mino" | "maxv" | "prjd" => {
                    whole()?;
                    notes.push(format!(
                        "NOTE {}`{name}` has no meaning here: eps alone bounds the error",
                        place()
                    ));
                }
                _ => notes.push(format!("WARNING {}`{name}` is no control word", place())),
            }
        }
        for (name, number) in [("row", found.row), ("col", found.column)] {
            if number > study.surfaces.len() {
                return Err(anyhow!("`{}`: {name} {number} is no surface", path.display()));
            }
        }
        if found.column > 0 && found.row == 0 {
            return Err(anyhow!("`{}`: `col` is set without `row`", path.display()));
        }
        Ok((found, notes))
    }
}

/// The rows of a study: surfaces that radiate and masks, without those combined with another.
struct Rows {
    /// Index into the study's surfaces of each row.
    surfaces: Vec<usize>,
    /// The row of each surface; `None` for obstructions and null surfaces.
    of_surface: Vec<Option<u32>>,
}

impl Rows {
    fn of(study: &Study) -> Self {
        let mut rows = Self {
            surfaces: Vec::new(),
            of_surface: vec![None; study.surfaces.len()],
        };
        for (place, surface) in study
            .surfaces
            .iter()
            .enumerate()
            .filter(|(_, surface)| surface.radiates)
        {
            rows.of_surface[place] = match surface.combined_with {
                // A surface comes after the one that it is combined with.
                Some(whole) => rows.of_surface[whole],
                None => {
                    rows.surfaces.push(place);
                    u32::try_from(rows.surfaces.len() - 1).ok()
                }
            };
        }
        rows
    }
}

pub(crate) fn run(arguments: &Arguments, talk: Talk) -> Result<Exit> {
    let mut log = format!(
        "  Program:  view3d by hemicube\n  Version:  {}\nData file:  {}\nOutput file:  {}\n",
        env!("CARGO_PKG_VERSION"),
        arguments.input.display(),
        arguments.output.display()
    );
    let done = work(arguments, &mut log, talk);
    if let Err(error) = &done {
        // As View3D: the log has the error.
        let _ = writeln!(log, "View3D FATAL: {error:#}");
    }
    let logged = keep_log(&log);
    match done.and(logged) {
        Ok(()) => Ok(Exit::Done),
        Err(error) => {
            exit::failed(&error);
            Ok(Exit::NotHeld)
        }
    }
}

fn keep_log(log: &str) -> Result<()> {
    let mut file = PendingFile::create(Path::new(LOG))?;
    file.write_all(log.as_bytes())
        .with_context(|| format!("`{LOG}` cannot be written"))?;
    file.commit()
}

fn work(arguments: &Arguments, log: &mut String, talk: Talk) -> Result<()> {
    let path = &arguments.input;
    let named = || format!("`{}` cannot be read", path.display());
    let bytes = hemicube_scene::read_regular(path).with_context(named)?;
    // Before the work, as View3D does: an output that cannot be written is told at once.
    let mut out = PendingFile::create(&arguments.output)?;
    let study = vs3::study(&bytes).with_context(named)?;
    let (controls, notes) = Controls::of(&study, path)?;
    let rows = Rows::of(&study);
    if rows.surfaces.is_empty() {
        return Err(anyhow!("`{}` has no surface that radiates", path.display()));
    }
    if controls.form != View3dForm::Sparse && rows.surfaces.len() > DENSE_MAX {
        return Err(hinted(
            anyhow!(
                "{} surfaces are more than the {DENSE_MAX} of a file of all pairs",
                rows.surfaces.len()
            ),
            "a control line `C out=2` writes the pairs that see each other",
        ));
    }
    let _ = writeln!(
        log,
        "\nTitle: {}\nControl values for 3-D view factor calculations:",
        study.title
    );
    let _ = writeln!(log, "{:>25}: {}", "adaptive convergence", controls.eps);
    for (word, line) in &study.skipped {
        let _ = writeln!(
            log,
            "View3D WARNING line {line}: `{word}` begins no element, and the line is skipped"
        );
    }
    for note in notes {
        let _ = writeln!(log, "View3D {note}");
    }
    let radiating = rows.of_surface.iter().flatten().count();
    let _ = writeln!(log, " total number of surfaces: {}", study.surfaces.len());
    let _ = writeln!(log, "   heat transfer surfaces: {radiating}");
    talk.say(&format!(
        "Computing view factors for all {}",
        counted(radiating as u64, "surface")
    ));
    let mut exchange = compute(&bytes, path, &study, &rows, controls.eps)?;
    let (first, emittances) = (exchange.clone(), emittances(&study, &rows));
    if controls.row > 0 {
        // View3D tells a row in its log, and leaves the output empty.
        report_row(log, &study, &rows, &first, controls);
        return out.commit();
    }
    let black = vec![1.0; rows.surfaces.len()];
    if controls.encl || controls.emit {
        report(log, &study, &rows, &exchange, &black, controls);
    }
    if controls.encl {
        let sweeps = exchange
            .enclose(&black)
            .map_err(|row| no_enclosure(&study, &rows, row))?;
        let _ = writeln!(log, "{sweeps} normalization iterations.");
    }
    if controls.emit {
        exchange.reflect(&emittances).with_context(named)?;
        if controls.encl {
            exchange
                .enclose(&emittances)
                .map_err(|row| no_enclosure(&study, &rows, row))?;
        }
    }
    let _ = writeln!(log, "\nFinal view factors:");
    report(
        log,
        &study,
        &rows,
        &exchange,
        if controls.emit { &emittances } else { &black },
        controls,
    );
    let head = View3dHead {
        form: controls.form,
        encl: controls.encl,
        emit: controls.emit,
    };
    let mut buffer = std::io::BufWriter::new(&mut out);
    let factors = |row: usize| Ok::<_, std::io::Error>(exchange.factors(row));
    let written = write_view3d(&mut buffer, head, &exchange.areas, &emittances, factors).and_then(|()| buffer.flush());
    drop(buffer);
    written.with_context(|| format!("`{}` cannot be written", arguments.output.display()))?;
    out.commit()?;
    talk.say(&format!(
        "`{}`: {}",
        arguments.output.display(),
        counted(rows.surfaces.len() as u64, "surface")
    ));
    Ok(())
}

fn no_enclosure(study: &Study, rows: &Rows, row: usize) -> anyhow::Error {
    let name = &study.surfaces[rows.surfaces[row]].name;
    hinted(
        anyhow!(
            "surface {} (`{name}`) sees nothing, and encl=1 says that the surfaces form an enclosure",
            rows.surfaces[row] + 1
        ),
        "turn it round (its vertices run counter-clockwise where it radiates to), or leave `encl` out",
    )
}

/// Emittances of rows, within View3D's limits.
fn emittances(study: &Study, rows: &Rows) -> Vec<f64> {
    let emittance = |&place: &usize| study.surfaces[place].emittance.clamp(EMITTANCES[0], EMITTANCES[1]);
    rows.surfaces.iter().map(emittance).collect()
}

/// A_i F_ij between surfaces.
fn compute(bytes: &[u8], path: &Path, study: &Study, rows: &Rows, eps: f64) -> Result<Exchange> {
    let scene = vs3::read(bytes, None, ReadOptions::default())?;
    let scene = SceneInput::new(scene, path, Subdivision::default().into())?;
    let model = scene.model(Default::default())?;
    let mut job = Job::default().with_tolerance(TOLERANCE_OF_EPS * eps);
    if rows
        .of_surface
        .iter()
        .zip(&study.surfaces)
        .any(|(row, _)| row.is_none())
        && scene.objects.iter().any(|name| name.starts_with("obstruction "))
    {
        job.occluders = vec![OBSTRUCTIONS.to_owned()];
    }
    let patches = model.patches();
    let row_of: Vec<Option<u32>> = patches
        .iter()
        .map(|patch| rows.of_surface[scene.triangles[patches.triangle(patch)].face as usize])
        .collect();
    let mut exchange = Exchange::new(rows.surfaces.len());
    for patch in patches.iter() {
        if let Some(row) = row_of[patch.0 as usize] {
            exchange.areas[row as usize] += patches.area(patch);
        }
    }
    // A masked surface sees its mask alone.
    for (surface, mask) in study.surfaces.iter().enumerate() {
        let Some((mask, cover)) = mask.mask.zip(rows.of_surface[surface]) else {
            continue;
        };
        let Some(base) = rows.of_surface[mask.base] else {
            continue;
        };
        for (row, other) in [(cover, base), (base, cover)] {
            exchange.areas[row as usize] += mask.area;
            exchange.add(row, other, mask.area);
        }
    }
    if let Some(row) = exchange.areas.iter().position(|&area| area.is_nan() || area <= 0.0) {
        let name = &study.surfaces[rows.surfaces[row]].name;
        return Err(anyhow!("surface {} (`{name}`) has no area", rows.surfaces[row] + 1));
    }
    let parts: Vec<Part> = job.rows(&scene, &model, Sessions::new(CpuBackend::new))?;
    for part in &parts {
        for (place, &patch) in part.rows.iter().enumerate() {
            let (columns, factors) = part.row(place);
            let Some(row) = row_of[patch as usize] else { continue };
            let area = patches.area(hemicube::InputPatch(patch));
            for (&column, factor) in columns.iter().zip(factors) {
                if let Some(column) = row_of[column as usize] {
                    exchange.add(row, column, area * factor);
                }
            }
        }
    }
    exchange.symmetrise();
    Ok(exchange)
}

/// Row sums, and with `list` the factors, as View3D lists them.
fn report(log: &mut String, study: &Study, rows: &Rows, exchange: &Exchange, wanted: &[f64], controls: Controls) {
    let (mut largest, mut square) = (0.0_f64, 0.0);
    for (row, &surface) in rows.surfaces.iter().enumerate() {
        let factors = exchange.factors(row);
        let sum: f64 = factors.iter().map(|&(_, factor)| factor).sum();
        let error = (sum - wanted[row]).abs();
        largest = largest.max(error);
        square += error * error;
        if controls.list <= 0 {
            continue;
        }
        let _ = write!(
            log,
            " Row:  {:6}, Name: {}, sum of view factors: {sum:9.6}",
            row + 1,
            study.surfaces[surface].name
        );
        let _ = match controls.encl {
            true => writeln!(log, " ({error:.6})"),
            false => writeln!(log),
        };
        let mut next = factors.iter().peekable();
        for column in 0..exchange.areas.len() {
            let factor = next
                .next_if(|&&(at, _)| at as usize == column)
                .map_or(0.0, |&(_, factor)| factor);
            let end = if (column + 1) % 10 == 0 { '\n' } else { ' ' };
            let _ = write!(log, "{factor:.6}{end}");
        }
        let _ = writeln!(log);
    }
    if controls.encl {
        let mean = (square / rows.surfaces.len() as f64).sqrt();
        let _ = writeln!(
            log,
            "Summary:\nMax row sumF error:  {largest:.2e}\nRMS row sumF error:  {mean:.2e}\n"
        );
    }
}

/// The row that a control line asks for: numbers are of surfaces in the file.
fn report_row(log: &mut String, study: &Study, rows: &Rows, exchange: &Exchange, controls: Controls) {
    let of = |number: usize| {
        rows.of_surface
            .get(number - 1)
            .copied()
            .flatten()
            .map(|row| row as usize)
    };
    let Some(row) = of(controls.row) else {
        let _ = writeln!(log, "surface {} has no row", controls.row);
        return;
    };
    let factors = exchange.factors(row);
    if controls.column > 0 {
        let to = of(controls.column);
        let factor = factors
            .iter()
            .find(|&&(at, _)| Some(at as usize) == to)
            .map_or(0.0, |&(_, factor)| factor);
        let _ = writeln!(log, "\nF[{}][{}] = {factor:.5e}\n", controls.row, controls.column);
        return;
    }
    let name = |row: usize| &study.surfaces[rows.surfaces[row]].name;
    let _ = writeln!(
        log,
        "View factors from surface n ({} = {}) to combined surface m:",
        controls.row,
        name(row)
    );
    let _ = writeln!(log, "srf m   A(n)*F(n,m)    F(n,m)        F(m,n)      name");
    let mut sum = 0.0;
    for (column, factor) in factors {
        let to = column as usize;
        sum += factor;
        let exchanged = factor * exchange.areas[row];
        let _ = writeln!(
            log,
            "{:5} {exchanged:13.5e} {factor:13.5e} {:13.5e}  {}",
            rows.surfaces[to] + 1,
            exchanged / exchange.areas[to],
            name(to)
        );
    }
    let _ = writeln!(log, "\n    sum[F(n,m)] = {sum:.8}\n");
}

#[cfg(test)]
mod tests {
    use super::*;

    fn study(controls: &str) -> Study {
        let text = format!("{controls}\nF 3\nV 1 0 0 0\nV 2 1 0 0\nV 3 1 0 1\nS 1 1 2 3 0 0 0 .9 wall\n");
        vs3::study(text.as_bytes()).expect("a good file")
    }

    #[test]
    fn control_lines() {
        let of = |text: &str| Controls::of(&study(text), Path::new("a.vs3"));
        let (found, notes) = of("C encl=1 list=2 eps = 1.e-5, out=1\nc EMIT=1 maxu=8").expect("good lines");
        assert_eq!(
            (found.encl, found.emit, found.list, found.form),
            (true, true, 2, View3dForm::Binary)
        );
        assert!((found.eps - 1e-5).abs() < 1e-12 && notes.len() == 1, "{notes:?}");
        for (text, expected) in [
            ("C eps=x", "a.vs3:1: `x` is no number above 0 for `eps`"),
            ("C out=3", "a.vs3:1: out=3 is no form of output; 0 to 2 are"),
            ("C encl=maybe", "a.vs3:1: `maybe` is no whole number for `encl`"),
            ("C row=2", "`a.vs3`: row 2 is no surface"),
            ("C col=1", "`a.vs3`: `col` is set without `row`"),
        ] {
            assert_eq!(of(text).expect_err(text).to_string(), expected);
        }
    }

    #[test]
    fn a_program_called_view3d() {
        let words = |words: &[&str]| words.iter().map(OsString::from).collect::<Vec<_>>();
        for name in ["view3d", "/usr/bin/View3D", "VIEW3D.exe"] {
            assert_eq!(
                arguments_of(words(&[name, "-in", "out"])),
                Some(words(&[name, "view3d", "--", "-in", "out"]))
            );
            assert_eq!(arguments_of(words(&[name, "?"])), None);
            assert_eq!(arguments_of(words(&[name])), None);
        }
        let other = words(&["hemicube", "compute", "a.vs3"]);
        assert_eq!(arguments_of(other.clone()), Some(other));
    }
}
