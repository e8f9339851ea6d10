//! The unfolded hemicube of a patch: item, depth, delta form factor or depth complexity of each pixel.

use super::live::{self, Live};
use super::unfolded::{BLOCKED, atlas_place, color_of};
use crate::args::{EngineSettings, SceneSettings, Talk};
use crate::exit::Exit;
use crate::picture::canvas::{Anchor, Canvas, Format, NOTHING, Rect, WHITE, scale_color};
use crate::picture::raster::Lens;
use crate::prepare::{Prepared, prepare};
use crate::report::{counted, figures, percent};
use crate::{portals, stored};
use anyhow::{Result, anyhow, bail};
use clap::{Args, ValueEnum};
use glam::DVec3;
use hemicube::backend::{Culling, Hemicube, RESOLUTIONS, RenderSettings, WHOLE};
use hemicube::delta::DeltaTable;
use hemicube::driver::room::Work;
use hemicube::face::{Face, Items};
use hemicube::portal::Specular;
use hemicube::portal::sight::{PathEnd, ThroughPortals};
use hemicube::store::Store;
use hemicube::{Grouping, InputPatch};
use hemicube_spatial::whole;
use std::path::PathBuf;

/// Part of a pixel's colour that is of what is seen in a mirror or through a pane.
const BEHIND: f64 = 0.7;
/// A path ends where no more than this share of it is left.
const BOUND: f64 = 1e-4;

/// `hemicube view hemicube`
#[derive(Args, Debug)]
pub(crate) struct Arguments {
    /// The scene
    #[arg(value_name = "SCENE")]
    pub(crate) scene: PathBuf,
    /// The picture: .png or .svg
    #[arg(short, long, value_name = "FILE", required_unless_present = "live")]
    pub(crate) output: Option<PathBuf>,
    /// Replace what is there
    #[arg(long)]
    pub(crate) overwrite: bool,
    /// The patch on which the hemicube stands; with --live the first one; of several triangles (`--matrix`) the one
    /// nearest the centroid
    #[arg(long, value_name = "I", required_unless_present = "live")]
    pub(crate) patch: Option<u32>,
    /// Show hemicubes in a window as they are computed, in the order of the work: space stops and goes on, Esc ends
    #[arg(long, conflicts_with_all = ["output", "show"])]
    pub(crate) live: bool,
    /// ids: which patch a pixel sees; depth; delta: what it weighs; occlusion: how many patches lie behind it
    #[arg(
        long,
        value_name = "ids|depth|delta|occlusion",
        default_value = "ids",
        hide_possible_values = true
    )]
    pub(crate) show: Show,
    /// Cut the scene as this matrix's was
    #[arg(
        long,
        value_name = "DIR",
        conflicts_with_all = ["split", "patch_size", "two_sided", "flip", "exclude", "scale", "keep_duplicates"]
    )]
    pub(crate) matrix: Option<PathBuf>,
    /// Show what is seen in mirrors and panes, by FILE or the `scene` [default: the matrix's]
    #[arg(long, value_name = "FILE", conflicts_with = "live")]
    pub(crate) specular: Option<PathBuf>,
    /// Pixels along an edge: a multiple of 16 up to 1024
    #[arg(long, value_name = "N", default_value = "256", value_parser = resolution)]
    pub(crate) resolution: u32,
    #[command(flatten)]
    pub(crate) patches: SceneSettings,
    #[command(flatten)]
    pub(crate) engine: EngineSettings,
}

/// Quantity shown by pixels.
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

/// Distance of the nearest surface at each pixel, and the number of surfaces on its ray.
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
    if arguments.patches.up.is_some() {
        bail!("`--up` turns no hemicube: it stands on its patch");
    }
    if arguments.specular.is_some() && arguments.show != Show::Ids {
        bail!("`--specular` shows which patches are seen behind, by `--show ids`, and something else is shown");
    }
    if let Some(output) = &arguments.output {
        Format::of(output)?;
    }
    let mut of_store = None;
    let prepared = match &arguments.matrix {
        Some(store) => {
            let store = of_store.insert(Store::open(store)?);
            stored::scene(store, &arguments.scene, &arguments.engine, (&arguments.patches).into())?
        }
        None => prepare(&arguments.scene, &arguments.patches, &arguments.engine, Work::Pixels)?,
    };
    let asked = InputPatch(arguments.patch.unwrap_or(0));
    let patches = prepared.grouping.as_ref().map_or(prepared.patches.len(), Grouping::len);
    if asked.0 as usize >= patches {
        bail!(
            "`--patch {}`: the scene has {}, from 0 on",
            asked.0,
            counted(patches as u64, "patch")
        );
    }
    let patch = standing_of(&prepared, asked);
    let Some(output) = &arguments.output else {
        let live = Live {
            resolution: arguments.resolution,
            first: arguments.patch.map(|_| patch.0),
            engine: &arguments.engine,
        };
        return live::run(live, &prepared, talk);
    };
    let specular = match (&arguments.specular, &of_store) {
        (Some(path), _) => Some(portals::of_one_band(path, &prepared, BOUND)?),
        (None, Some(store)) => stored::specular(store, &prepared)?,
        (None, None) => None,
    };
    let found = render(arguments, &prepared, patch, specular.as_ref(), talk)?;
    let heading = format!(
        "{}: {}, hemicube of {} pixels",
        name_of(&prepared, asked, patch),
        title_of(arguments.show),
        arguments.resolution
    );
    picture(&found, &heading).save(output)?;
    talk.say(&format!("`{}`: {heading}", output.display()));
    Ok(Exit::Done)
}

/// The element under the hemicube of a patch: the patch, or the element with the centroid nearest to the patch's, the
/// first of several.
fn standing_of(prepared: &Prepared, patch: InputPatch) -> InputPatch {
    let Some(grouping) = &prepared.grouping else {
        return patch;
    };
    let elements = grouping.elements_of(&[patch]).pop().unwrap_or_default();
    let of = |element: &InputPatch| (prepared.patches.area(*element), prepared.patches.centroid(*element));
    let (mut area, mut sum) = (0.0, DVec3::ZERO);
    for (own, centroid) in elements.iter().map(of) {
        (area, sum) = (area + own, sum + own * centroid);
    }
    let middle = sum / area;
    let distance = |element: &InputPatch| of(element).1.distance_squared(middle);
    let nearest = elements
        .iter()
        .copied()
        .min_by(|a, b| distance(a).total_cmp(&distance(b)));
    nearest.unwrap_or(patch)
}

/// The patch, and where its hemicube stands.
fn name_of(prepared: &Prepared, patch: InputPatch, element: InputPatch) -> String {
    match &prepared.grouping {
        None => format!("patch {}", patch.0),
        Some(grouping) => format!(
            "patch {}, {} {}, from triangle {} nearest its centroid",
            patch.0,
            grouping.kind().name(),
            grouping.name_of(patch, &prepared.scene, &prepared.patches),
            element.0
        ),
    }
}

/// A rendered hemicube, and the quantity of its picture.
struct Rendered {
    show: Show,
    resolution: u32,
    items: Items,
    /// Views of pixels that show a mirror or a pane behind it; empty without any.
    behind: Vec<Option<PathEnd>>,
    table: DeltaTable,
    /// For depth and occlusion.
    layers: Option<Layers>,
    /// One unit of the scene in normalised coordinates.
    unit: f64,
}

/// Renders the hemicube of a patch, unrotated: the picture's edges are the patch's axes.
fn render(
    arguments: &Arguments,
    prepared: &Prepared,
    patch: InputPatch,
    specular: Option<&Specular>,
    talk: Talk,
) -> Result<Rendered> {
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
    let behind = specular.map_or_else(Vec::new, |specular| {
        ThroughPortals::new(specular, None, &prepared.model).brightest(hemicube, &items)
    });
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
    Ok(Rendered {
        show: arguments.show,
        resolution,
        items,
        behind,
        table: DeltaTable::new(resolution),
        layers,
        unit: (prepared.model.normalise(DVec3::X) - prepared.model.normalise(DVec3::ZERO)).length(),
    })
}

impl Rendered {
    /// The place of a pixel in the atlas.
    fn place(&self, face: Face, x: u32, y: u32) -> usize {
        (face.first_row(self.resolution) + y) as usize * self.resolution as usize + x as usize
    }

    /// The colour of what a pixel sees: of a mirror or a pane, mostly of what is seen behind it.
    fn color(&self, place: usize) -> [u8; 3] {
        let own = color_of(self.items.seen[place]);
        let behind = match self.behind.get(place).copied().flatten() {
            None | Some(PathEnd::CutOff) => return own,
            Some(PathEnd::Patch { patch, .. }) => color_of(patch),
            Some(PathEnd::Nothing(_)) => NOTHING,
            Some(PathEnd::Back) => BLOCKED,
        };
        std::array::from_fn(|k| {
            let mixed = (1.0 - BEHIND) * f64::from(own[k]) + BEHIND * f64::from(behind[k]);
            whole::to_u8(mixed.round())
        })
    }

    /// The number at a pixel; `None` for an empty view.
    fn value(&self, face: Face, x: u32, y: u32) -> Option<f64> {
        let place = self.place(face, x, y);
        match (self.show, &self.layers) {
            (Show::Depth, Some(layers)) => Some(layers.depth[place] / self.unit).filter(|depth| depth.is_finite()),
            (Show::Occlusion, Some(layers)) => Some(f64::from(layers.count[place])),
            _ => Some(f64::from(self.table.weight(face, x, y)) / f64::from(WHOLE)),
        }
    }

    /// The least and the greatest number shown.
    fn range(&self) -> (f64, f64) {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for face in Face::ALL {
            for y in 0..face.rows(self.resolution) {
                for x in 0..self.resolution {
                    if let Some(value) = self.value(face, x, y) {
                        low = low.min(value);
                        high = high.max(value);
                    }
                }
            }
        }
        (low, high)
    }
}

/// Draws the unfolded hemicube with its heading, and below it the scale, or the shares of the view.
fn picture(found: &Rendered, heading: &str) -> Canvas {
    let n = found.resolution as usize;
    let (low, high) = found.range();
    let enlarge = 512_usize.div_ceil(2 * n).max(1);
    let side = 2 * n * enlarge;
    // Headings are wider than small hemicubes.
    let left = 20 + (side.max(600) - side) / 2;
    let mut canvas = Canvas::new(side.max(600) + 40, side + 110, WHITE);
    for row in 0..side {
        for column in 0..side {
            let Some((face, x, y)) = atlas_place(column / enlarge, row / enlarge, found.resolution) else {
                continue;
            };
            let color = if found.show == Show::Ids {
                found.color(found.place(face, x, y))
            } else {
                found.value(face, x, y).map_or(NOTHING, |value| {
                    scale_color((value - low) / (high - low).max(f64::MIN_POSITIVE))
                })
            };
            canvas.set(left + column, 44 + row, color);
        }
    }
    canvas.write(heading, (20.0, 28.0), 15.0, Anchor::Start);
    let y = side + 62;
    if found.show == Show::Ids {
        write_shares(&mut canvas, found, side.max(600) + 20, y);
    } else {
        let labels = [figures(low), figures(high)];
        canvas.scale(
            (20, y - 8),
            side.min(240),
            [&labels[0], &labels[1]],
            unit_of(found.show),
        );
    }
    canvas
}

/// Writes the escaped and blocked shares, and the number of patches in sight.
fn write_shares(canvas: &mut Canvas, found: &Rendered, right: usize, y: usize) {
    let (visible, escaped, blocked) = found.items.reduce(&found.table);
    let shares = [("escaped", escaped, NOTHING), ("blocked by backs", blocked, BLOCKED)];
    for (line, (name, weight, color)) in shares.into_iter().enumerate() {
        let y = y + 22 * line;
        canvas.fill(Rect::square(20, y - 10, 12), color);
        let share = percent(f64::from(weight) / f64::from(WHOLE));
        canvas.write(&format!("{name} {share}"), (38.0, y as f64), 13.0, Anchor::Start);
    }
    let seen = format!("{} in sight", counted(visible.len() as u64, "patch"));
    canvas.write(&seen, (right as f64, y as f64), 13.0, Anchor::End);
}

fn title_of(show: Show) -> &'static str {
    match show {
        Show::Ids => "what each pixel sees",
        Show::Depth => "distance to what each pixel sees",
        Show::Delta => "delta form factors",
        Show::Occlusion => "surfaces that each pixel's ray meets",
    }
}

fn unit_of(show: Show) -> &'static str {
    match show {
        Show::Ids => "",
        Show::Depth => "in the scene's unit",
        Show::Delta => "of the hemisphere, a pixel",
        Show::Occlusion => "surfaces in line",
    }
}
