//! The unfolded hemicube of a patch: what each pixel sees, how far it is, what it weighs, and how much lies behind it.

use super::canvas::{Anchor, Canvas, NOTHING, WHITE, id_color, scale_color};
use super::raster::Lens;
use crate::args::{EngineSettings, SceneSettings, Talk};
use crate::exit::Exit;
use crate::prepare::prepare;
use crate::report::{count, figures};
use crate::stored;
use anyhow::{Result, anyhow, bail};
use clap::{Args, ValueEnum};
use glam::DVec3;
use hemicube::InputPatch;
use hemicube::backend::{Culling, Hemicube, RESOLUTIONS, RenderSettings};
use hemicube::delta::DeltaTable;
use hemicube::face::{Face, Items};
use hemicube::store::Store;
use std::path::PathBuf;

/// Pixels that a blocked view and an escaped one are shown in.
pub(super) const BLOCKED: [u8; 3] = [40, 40, 40];

/// `hemicube view hemicube`
#[derive(Args, Debug)]
pub(crate) struct Arguments {
    /// The scene
    #[arg(value_name = "SCENE")]
    pub(crate) scene: PathBuf,
    /// The picture: .png or .svg
    #[arg(short, long, value_name = "FILE", required_unless_present = "live")]
    pub(crate) output: Option<PathBuf>,
    /// Replace a file that is there
    #[arg(long)]
    pub(crate) overwrite: bool,
    /// The patch on which the hemicube stands; with --live the first one
    #[arg(long, value_name = "I", required_unless_present = "live")]
    pub(crate) patch: Option<u32>,
    /// Show hemicubes in a window as they are computed, in the order of the work: space stops and goes on, Esc ends
    #[arg(long, conflicts_with_all = ["output", "show"])]
    pub(crate) live: bool,
    /// End after so many hemicubes
    #[arg(long, value_name = "N", requires = "live", value_parser = clap::value_parser!(u64).range(1..))]
    pub(crate) count: Option<u64>,
    /// ids: which patch a pixel sees; depth; delta: what it weighs; occlusion: how many patches lie behind it
    #[arg(
        long,
        value_name = "ids|depth|delta|occlusion",
        default_value = "ids",
        hide_possible_values = true
    )]
    pub(crate) show: Show,
    /// Cut the scene as this matrix's was
    #[arg(long, value_name = "DIR", conflicts_with_all = ["subdivide", "split", "patch_size", "two_sided", "flip", "scale", "keep_duplicates"])]
    pub(crate) store: Option<PathBuf>,
    /// Pixels along an edge: a multiple of 16 up to 1024
    #[arg(long, value_name = "N", default_value = "256", value_parser = resolution)]
    pub(crate) resolution: u32,
    #[command(flatten)]
    pub(crate) patches: SceneSettings,
    #[command(flatten)]
    pub(crate) engine: EngineSettings,
}

/// What pixels show.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Show {
    /// The patch seen.
    Ids,
    /// Progress by now.
    Depth,
    /// Delta form factors.
    Delta,
    /// Number of patches that lie behind.
    Occlusion,
}

fn resolution(text: &str) -> Result<u32, String> {
    match text.parse::<u32>() {
        Ok(n) if n % 16 == 0 && RESOLUTIONS.contains(&n) => Ok(n),
        _ => Err("a multiple of 16 from 16 to 1024 is needed".to_owned()),
    }
}

/// The face and the place on it of a pixel of the unfolded hemicube, by its place in −2…2 both ways, to the right and
/// up; `None` in the corners. The top is in the middle, a side's horizon at the outer edge.
fn unfold(x: f64, y: f64) -> Option<(Face, f64, f64)> {
    // A direction in the patch's frame: tangent right, bitangent up, normal towards who looks.
    let direction = match (x.abs() < 1.0, y.abs() < 1.0) {
        (true, true) => return Some((Face::Top, x, y)),
        (false, true) => [x.signum(), y, 2.0 - x.abs()],
        (true, false) => [x, y.signum(), 2.0 - y.abs()],
        (false, false) => return None,
    };
    let face = match (x.abs() < 1.0, x > 0.0, y > 0.0) {
        (false, true, _) => Face::PosX,
        (false, false, _) => Face::NegX,
        (true, _, true) => Face::PosY,
        (true, _, false) => Face::NegY,
    };
    let ([u, v, _], [su, sv, _]) = face.axes();
    Some((face, su * direction[u], sv * direction[v]))
}

/// The place in the atlas of a pixel of the unfolded picture of 2N × 2N.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "places on a face lie in its pixels"
)]
pub(super) fn atlas_place(column: usize, row: usize, resolution: u32) -> Option<(Face, u32, u32)> {
    let n = f64::from(resolution);
    let (x, y) = (
        2.0 * (column as f64 + 0.5) / n - 2.0,
        2.0 - 2.0 * (row as f64 + 0.5) / n,
    );
    let (face, u, v) = unfold(x, y)?;
    let low = if face.is_top() { -1.0 } else { 0.0 };
    let at = |value: f64, low: f64, most: u32| (((value - low) * n / 2.0) as u32).min(most - 1);
    Some((face, at(u, -1.0, resolution), at(v, low, face.rows(resolution))))
}

/// Distance of the nearest surface at each pixel, and the number of surfaces that it meets.
struct Layers {
    depth: Vec<f64>,
    count: Vec<u32>,
}

fn layers(
    surfaces: &[hemicube::backend::Surface],
    emitter: InputPatch,
    hemicube: &Hemicube,
    resolution: u32,
    tolerance: f64,
) -> Layers {
    let n = resolution as usize;
    let mut found = Layers {
        depth: vec![f64::INFINITY; 3 * n * n],
        count: vec![0; 3 * n * n],
    };
    let step = 2.0 / f64::from(resolution);
    for face in Face::ALL {
        let ([u, v, w], [su, sv, sw]) = face.axes();
        let rows = face.rows(resolution) as usize;
        let lens = Lens {
            origin: hemicube.origin,
            axes: [hemicube.axes[u] * su, hemicube.axes[v] * sv, hemicube.axes[w] * sw],
            width: n,
            height: rows,
            left: -1.0,
            top: 1.0,
            step,
        };
        let first = face.first_row(resolution) as usize;
        for surface in surfaces {
            let below = surface
                .corners
                .iter()
                .all(|&corner| (corner - hemicube.origin).dot(hemicube.axes[2]) <= tolerance);
            if below || surface.front == emitter || surface.back == Some(emitter) {
                continue;
            }
            lens.draw(&surface.corners, |fragment| {
                let (x, y) = (fragment.pixel % n, rows - 1 - fragment.pixel / n);
                let place = (first + y) * n + x;
                let at = |k: usize, low: f64| low + (k as f64 + 0.5) * step;
                let low = if face.is_top() { -1.0 } else { 0.0 };
                let distance = fragment.depth * (1.0 + at(x, -1.0).powi(2) + at(y, low).powi(2)).sqrt();
                found.depth[place] = found.depth[place].min(distance);
                found.count[place] += 1;
            });
        }
    }
    found
}

pub(crate) fn run(arguments: &Arguments, talk: Talk) -> Result<Exit> {
    arguments.patches.require_one_cut()?;
    if let Some(output) = &arguments.output {
        super::canvas::Format::of(output)?;
    }
    let prepared = match &arguments.store {
        Some(store) => stored::scene(
            &Store::open(store)?,
            &arguments.scene,
            &arguments.engine,
            arguments.patches.allow_large,
        )?,
        None => prepare(&arguments.scene, &arguments.patches, &arguments.engine, None)?,
    };
    let patch = InputPatch(arguments.patch.unwrap_or(0));
    if patch.0 as usize >= prepared.patches.len() {
        bail!(
            "`--patch {}`: the scene has {} patches, from 0 on",
            patch.0,
            count(prepared.patches.len() as u64)
        );
    }
    let Some(output) = &arguments.output else {
        return super::live::run(arguments, &prepared, talk);
    };
    // Not turned, so that the picture's edges are the patch's axes.
    let hemicubes = prepared.model.hemicubes(patch, 1, false);
    let hemicube = hemicubes
        .first()
        .ok_or_else(|| anyhow!("patch {} has no area, and so no hemicube", patch.0))?;
    let resolution = arguments.resolution;
    let geometry = prepared.model.geometry();
    let mut backend = arguments.engine.open_backend(talk)?;
    backend.load(
        geometry,
        RenderSettings {
            resolution,
            culling: Culling::On,
            covered: false,
        },
    )?;
    let items = backend.items(hemicube)?;
    let table = DeltaTable::new(resolution);
    let n = resolution as usize;
    let layers = match arguments.show {
        Show::Depth | Show::Occlusion => Some(layers(
            &geometry.surfaces,
            patch,
            hemicube,
            resolution,
            geometry.plane_tolerance,
        )),
        Show::Ids | Show::Delta => None,
    };
    // One unit of the scene in normalised coordinates.
    let unit = (prepared.model.normalise(DVec3::X) - prepared.model.normalise(DVec3::ZERO)).length();
    let value = |face: Face, x: u32, y: u32| -> Option<f64> {
        let place = (face.first_row(resolution) + y) as usize * n + x as usize;
        match (arguments.show, &layers) {
            (Show::Depth, Some(layers)) => Some(layers.depth[place] / unit).filter(|depth| depth.is_finite()),
            (Show::Occlusion, Some(layers)) => Some(f64::from(layers.count[place])),
            _ => Some(f64::from(table.weight(face, x, y)) / f64::from(hemicube::backend::WHOLE)),
        }
    };
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for face in Face::ALL {
        for y in 0..face.rows(resolution) {
            for x in 0..resolution {
                if let Some(value) = value(face, x, y) {
                    low = low.min(value);
                    high = high.max(value);
                }
            }
        }
    }
    let enlarge = 512_usize.div_ceil(2 * n).max(1);
    let side = 2 * n * enlarge;
    // Headings are wider than small hemicubes.
    let left = 20 + (side.max(600) - side) / 2;
    let mut canvas = Canvas::new(side.max(600) + 40, side + 110, WHITE);
    for row in 0..side {
        for column in 0..side {
            let Some((face, x, y)) = atlas_place(column / enlarge, row / enlarge, resolution) else {
                continue;
            };
            let color = if arguments.show == Show::Ids {
                match items.seen[(face.first_row(resolution) + y) as usize * n + x as usize] {
                    Items::ESCAPED => NOTHING,
                    Items::BLOCKED => BLOCKED,
                    id => id_color(id),
                }
            } else {
                value(face, x, y).map_or(NOTHING, |value| {
                    scale_color((value - low) / (high - low).max(f64::MIN_POSITIVE))
                })
            };
            canvas.set(left + column, 44 + row, color);
        }
    }
    let title = match arguments.show {
        Show::Ids => "what each pixel sees",
        Show::Depth => "distance to what each pixel sees",
        Show::Delta => "delta form factors",
        Show::Occlusion => "surfaces that each pixel's ray meets",
    };
    let heading = format!("patch {}: {title}, hemicube of {n} pixels", patch.0);
    canvas.write(&heading, (20.0, 28.0), 15.0, Anchor::Start);
    let y = side + 62;
    if arguments.show == Show::Ids {
        let (visible, escaped, blocked) = items.reduce(&table);
        let share = |weight: u32| crate::report::percent(f64::from(weight) / f64::from(hemicube::backend::WHOLE));
        canvas.fill((20, y - 10), (12, 12), NOTHING);
        canvas.fill((20, y + 12), (12, 12), BLOCKED);
        canvas.write(
            &format!("escaped {}", share(escaped)),
            (38.0, y as f64),
            13.0,
            Anchor::Start,
        );
        canvas.write(
            &format!("blocked by backs {}", share(blocked)),
            (38.0, y as f64 + 22.0),
            13.0,
            Anchor::Start,
        );
        let seen = format!("{} patches in sight", count(visible.len() as u64));
        canvas.write(&seen, ((side.max(600) + 20) as f64, y as f64), 13.0, Anchor::End);
    } else {
        canvas.scale(
            (20, y - 8),
            side.min(240),
            [&figures(low), &figures(high)],
            unit_of(arguments.show),
        );
    }
    canvas.save(output)?;
    talk.say(&format!("`{}`: {heading}", output.display()));
    Ok(Exit::Done)
}

fn unit_of(show: Show) -> &'static str {
    match show {
        Show::Ids => "",
        Show::Depth => "in the scene's unit",
        Show::Delta => "of the hemisphere, a pixel",
        Show::Occlusion => "surfaces in line",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pixel_of_the_atlas_is_shown_once() {
        let resolution = 16;
        let mut seen = vec![0; 3 * 16 * 16];
        for row in 0..32 {
            for column in 0..32 {
                if let Some((face, x, y)) = atlas_place(column, row, resolution) {
                    seen[((face.first_row(resolution) + y) * resolution + x) as usize] += 1;
                }
            }
        }
        assert!(seen.iter().all(|&times| times == 1));
    }

    #[test]
    fn sides_join_the_top_at_their_upper_edge() {
        // Just beyond the top's right edge is the side's highest row, at the same height of the picture.
        assert_eq!(
            atlas_place(24, 20, 16).map(|(face, _, y)| (face, y)),
            Some((Face::PosX, 7))
        );
        assert_eq!(
            atlas_place(31, 20, 16).map(|(face, _, y)| (face, y)),
            Some((Face::PosX, 0))
        );
        assert_eq!(
            atlas_place(20, 0, 16).map(|(face, _, y)| (face, y)),
            Some((Face::PosY, 0))
        );
        assert_eq!(atlas_place(0, 0, 16), None);
    }
}
