//! The model from a camera, in the colours of a result.

use super::canvas::{Anchor, Canvas, NOTHING, WHITE, byte, linear, scale_color, shown};
use super::raster::Lens;
use crate::args::{EngineSettings, Talk, UpAxis};
use crate::exit::{Exit, hinted};
use crate::prepare::Prepared;
use crate::report::{count, figures};
use crate::stored;
use anyhow::{Result, anyhow, bail};
use clap::{Args, ValueEnum};
use glam::DVec3;
use hemicube::InputPatch;
use hemicube::sky::sky_view_factors_beside;
use hemicube::solve::StoredSolution;
use hemicube::store::Store;
use hemicube_scene::{Axis, Side};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Corners that meet at less than this angle are one of a smooth surface: its cosine.
const SMOOTH: f64 = 0.866;
/// Samples along the edge of a pixel.
const SAMPLES: usize = 3;
/// What the average of the picture is shown as (Reinhard et al. 2002, a).
const KEY: f64 = 0.18;
/// What a histogram takes of the picture's height, and a bar of its width.
const BARS: usize = 82;
const BAR: usize = 6;
const EMITTER: [u8; 3] = [214, 40, 40];

/// `hemicube view model`
#[derive(Args, Debug)]
pub(crate) struct Arguments {
    /// The matrix
    #[arg(value_name = "DIR")]
    pub(crate) store: PathBuf,
    /// The scene that it is of
    #[arg(value_name = "SCENE")]
    pub(crate) scene: PathBuf,
    /// The picture: .png or .svg
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,
    /// Replace a file that is there
    #[arg(long)]
    pub(crate) overwrite: bool,
    /// radiosity (or irradiance, flux, temperature of a solution), seen (patches in sight), row, sky, error (expected
    /// of each row), closure (how far each row is from summing to 1)
    #[arg(long, value_name = "WHAT", default_value = "radiosity")]
    pub(crate) show: Show,
    /// The patch whose row is shown
    #[arg(long, value_name = "I", required_if_eq("show", "row"))]
    pub(crate) patch: Option<u32>,
    /// Which solution
    #[arg(long, value_name = "NAME", default_value = "radiosity")]
    pub(crate) solution: String,
    /// Read a scene of which more would come than a file of its size may become (docs/security.md)
    #[arg(long, hide_short_help = true)]
    pub(crate) allow_large: bool,
    #[command(flatten)]
    pub(crate) camera: Camera,
    #[command(flatten)]
    pub(crate) engine: EngineSettings,
}

/// What colours the model.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Show {
    /// A quantity of a solution.
    Quantity(String),
    /// Number of patches that each patch sees.
    Seen,
    /// One row.
    Row,
    /// Sky view factors.
    Sky,
    /// The expected error of each row.
    Error,
    /// Distance of each row's sum from 1.
    Closure,
}

impl FromStr for Show {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "seen" => Ok(Self::Seen),
            "row" => Ok(Self::Row),
            "sky" => Ok(Self::Sky),
            "error" => Ok(Self::Error),
            "closure" => Ok(Self::Closure),
            "radiosity" | "irradiance" | "flux" | "temperature" => Ok(Self::Quantity(text.to_owned())),
            _ => Err(
                "there are `radiosity`, `irradiance`, `flux`, `temperature`, `seen`, `row`, `sky`, `error` and \
                    `closure`"
                    .to_owned(),
            ),
        }
    }
}

/// Where the picture is taken from, and how.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Camera")]
pub(crate) struct Camera {
    /// Where the camera is [default: outside, so that all of the scene is in the picture]
    #[arg(
        long,
        value_name = "X,Y,Z",
        allow_negative_numbers = true,
        allow_hyphen_values = true
    )]
    pub(crate) eye: Option<Point>,
    /// What it looks at [default: the middle of the scene]
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub(crate) look_at: Option<Point>,
    /// The axis that points up in the picture [default: the scene's, or z where it does not say]
    #[arg(long, value_name = "x|y|z", hide_possible_values = true)]
    pub(crate) up: Option<UpAxis>,
    /// Angle of view from the lower to the upper edge, in degrees
    #[arg(long, value_name = "DEGREES", default_value = "40", value_parser = field_of_view)]
    pub(crate) fov: f64,
    /// Width and height of the picture
    #[arg(long, value_name = "WxH", default_value = "800x600")]
    pub(crate) size: Size,
    /// smooth: interpolated between the corners of patches; flat: one colour a patch
    #[arg(
        long,
        value_name = "smooth|flat",
        default_value = "smooth",
        hide_possible_values = true
    )]
    pub(crate) shading: Shading,
    /// Brighter (1: twice) or darker (-1: half)
    #[arg(long, value_name = "STOPS", default_value = "0", allow_hyphen_values = true)]
    pub(crate) exposure: f64,
}

/// A point of the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Point(DVec3);

impl FromStr for Point {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Vec<f64> = text
            .split(',')
            .filter_map(|number| number.trim().parse().ok())
            .filter(|number: &f64| number.is_finite())
            .collect();
        match numbers[..] {
            [x, y, z] if text.split(',').count() == 3 => Ok(Self(DVec3::new(x, y, z))),
            _ => Err("three numbers such as `278,273,-800` are needed".to_owned()),
        }
    }
}

/// Width and height in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Size(usize, usize);

impl FromStr for Size {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let length = |text: &str| text.parse::<usize>().ok().filter(|length| (16..=4096).contains(length));
        text.split_once('x')
            .and_then(|(width, height)| Some(Self(length(width)?, length(height)?)))
            .ok_or_else(|| "two lengths from 16 to 4096 such as `800x600` are needed".to_owned())
    }
}

/// How colours are spread over patches.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Shading {
    /// Between corners.
    Smooth,
    /// One a patch.
    Flat,
}

fn field_of_view(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(degrees) if (1.0..=150.0).contains(&degrees) => Ok(degrees),
        _ => Err("an angle from 1 to 150 degrees is needed".to_owned()),
    }
}

/// What patches are coloured by.
pub(crate) enum Values {
    /// Light in red, green and blue: shown as an eye would see it.
    Light(Vec<[f64; 3]>),
    /// A number on a scale; NaN where there is none.
    Scale {
        values: Vec<f64>,
        title: String,
        /// True if equal steps of the scale are equal factors.
        logarithmic: bool,
        /// A patch that is shown in a colour of its own.
        marked: Option<u32>,
        /// True if a histogram stands on the scale.
        histogram: bool,
    },
}

impl Camera {
    fn lens(&self, prepared: &Prepared) -> Result<Lens> {
        let surfaces = prepared.patches.surfaces();
        let corners = || surfaces.iter().flatten().copied();
        let low = corners().fold(DVec3::INFINITY, DVec3::min);
        let high = corners().fold(DVec3::NEG_INFINITY, DVec3::max);
        let middle = (low + high) / 2.0;
        let up = match self.up.map(Into::into).or(prepared.scene.up).unwrap_or(Axis::Z) {
            Axis::X => DVec3::X,
            Axis::Y => DVec3::Y,
            Axis::Z => DVec3::Z,
        };
        let target = self.look_at.map_or(middle, |point| point.0);
        let half = (self.fov / 2.0).to_radians();
        let Size(width, height) = self.size;
        let (width, height) = (width * SAMPLES, height * SAMPLES);
        let step = 2.0 * half.tan() / height as f64;
        let eye = self.eye.map_or_else(
            || {
                // From a corner, a little above, and so far away that every corner is in the picture.
                let aside = match up {
                    DVec3::Y => DVec3::new(0.55, 0.0, 0.7),
                    DVec3::X => DVec3::new(0.0, 0.55, -0.7),
                    _ => DVec3::new(0.55, -0.7, 0.0),
                };
                let back = (aside + up * 0.55).normalize_or_zero();
                let right = up.cross(back).normalize_or_zero();
                let above = back.cross(right);
                let (tall, wide) = (half.tan(), half.tan() * width as f64 / height as f64);
                let distance = corners().fold(0.0, |most: f64, corner| {
                    let p = corner - target;
                    let aside = (p.dot(right).abs() / wide).max(p.dot(above).abs() / tall);
                    most.max(aside + p.dot(back))
                });
                target + back * (distance * 1.04)
            },
            |point| point.0,
        );
        let forward = (target - eye)
            .try_normalize()
            .ok_or_else(|| anyhow!("`--eye` and `--look-at` are one point"))?;
        let right = forward
            .cross(up)
            .try_normalize()
            .unwrap_or_else(|| forward.any_orthonormal_vector());
        Ok(Lens {
            origin: eye,
            axes: [right, right.cross(forward), forward],
            width,
            height,
            left: -step * width as f64 / 2.0,
            top: half.tan(),
            step,
        })
    }
}

/// Which patch each sample sees and where on it.
struct Seen {
    patch: u32,
    barycentric: [f64; 3],
    depth: f64,
}

fn trace(prepared: &Prepared, lens: &Lens) -> Vec<Seen> {
    let mut seen: Vec<Seen> = (0..lens.width * lens.height)
        .map(|_| Seen {
            patch: u32::MAX,
            barycentric: [0.0; 3],
            depth: f64::INFINITY,
        })
        .collect();
    for patch in prepared.patches.iter() {
        lens.draw(&prepared.patches.corners(patch), |fragment| {
            let sample = &mut seen[fragment.pixel];
            // Backs are the business of the patch on the back, where there is one.
            if fragment.front && fragment.depth < sample.depth {
                *sample = Seen {
                    patch: patch.0,
                    barycentric: fragment.barycentric,
                    depth: fragment.depth,
                };
            }
        });
    }
    seen
}

/// Values at the corners of patches: averages, by area, over the patches that share the corner and turn the same way.
fn at_corners<const N: usize>(prepared: &Prepared, values: &[[f64; N]]) -> Vec<[[f64; N]; 3]> {
    let patches = &prepared.patches;
    let mut around: HashMap<[u64; 3], Vec<u32>> = HashMap::new();
    // −0 and 0 are one place.
    let key = |corner: DVec3| (corner + 0.0).to_array().map(f64::to_bits);
    for patch in patches.iter() {
        for corner in patches.corners(patch) {
            around.entry(key(corner)).or_default().push(patch.0);
        }
    }
    patches
        .iter()
        .map(|patch| {
            let normal = patches.normal(patch);
            let object = prepared.scene.triangles[patches.triangle(patch)].material;
            patches.corners(patch).map(|corner| {
                let (mut sum, mut weight) = ([0.0; N], 0.0);
                for &other in around.get(&key(corner)).into_iter().flatten() {
                    let other = InputPatch(other);
                    let material = prepared.scene.triangles[patches.triangle(other)].material;
                    let known = values[other.0 as usize].iter().all(|value| !value.is_nan());
                    if known && material == object && normal.dot(patches.normal(other)) > SMOOTH {
                        let area = patches.area(other);
                        weight += area;
                        for (sum, value) in sum.iter_mut().zip(values[other.0 as usize]) {
                            *sum += area * value;
                        }
                    }
                }
                if weight > 0.0 {
                    sum.map(|sum| sum / weight)
                } else {
                    values[patch.0 as usize]
                }
            })
        })
        .collect()
}

fn luminance([r, g, b]: [f64; 3]) -> f64 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// How light becomes what a screen can show: Reinhard et al. 2002, eq. 1, 2 and 4. The average is shown as middle grey,
/// and only what is far brighter than the rest burns out.
pub(crate) struct Tone {
    exposure: f64,
    white: f64,
}

impl Tone {
    /// For light with weights: pixels of a picture, areas of a model. `stops` brighter than that.
    pub(crate) fn of(light: impl Iterator<Item = ([f64; 3], f64)>, stops: f64) -> Self {
        let (mut logs, mut total) = (0.0, 0.0);
        let mut all = Vec::new();
        for (light, weight) in light {
            let luminance = luminance(light);
            if luminance > 0.0 {
                logs += weight * luminance.ln();
                total += weight;
                all.push((luminance, weight));
            }
        }
        let average = if total > 0.0 { f64::exp(logs / total) } else { 1.0 };
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut below = 0.0;
        let bright = all.iter().find(|&&(_, weight)| {
            below += weight;
            below > total * 97.0 / 100.0
        });
        let exposure = KEY / average * stops.exp2();
        let white = (bright.map_or(1.0, |&(luminance, _)| luminance) * exposure * 1.2).max(1e-9);
        Self { exposure, white }
    }

    /// Linear red, green and blue from 0 to 1.
    pub(crate) fn map(&self, light: [f64; 3]) -> [f64; 3] {
        let Self { exposure, white } = self;
        let level = luminance(light) * exposure;
        let scaled = level * (1.0 + level / (white * white)) / (1.0 + level);
        let factor = if level > 0.0 { exposure * scaled / level } else { 0.0 };
        light.map(|channel| (channel * factor).clamp(0.0, 1.0))
    }
}

/// Draws the model.
///
/// # Errors
/// When the camera sees from where it looks, or the picture cannot be written.
pub(crate) fn draw(prepared: &Prepared, values: &Values, camera: &Camera, output: &Path) -> Result<()> {
    let lens = camera.lens(prepared)?;
    let seen = trace(prepared, &lens);
    let Size(width, height) = camera.size;
    let mut canvas = Canvas::new(width, height, NOTHING);
    let smooth = camera.shading == Shading::Smooth;
    // A patch hit away from all pixels of the frame: nothing is in sight.
    if seen.iter().all(|sample| sample.patch == u32::MAX) {
        return Err(hinted(
            anyhow!("the camera sees nothing of the scene"),
            "`--eye` and `--look-at` place it; backs of one-sided surfaces are not drawn",
        ));
    }
    match values {
        Values::Light(light) => {
            let corners = if smooth {
                at_corners(prepared, light)
            } else {
                Vec::new()
            };
            let radiance = |sample: &Seen| -> Option<[f64; 3]> {
                let patch = sample.patch as usize;
                if patch >= light.len() {
                    return None;
                }
                Some(if smooth {
                    mix(&corners[patch], sample.barycentric)
                } else {
                    light[patch]
                })
            };
            let seen_light = seen.iter().filter_map(&radiance).map(|light| (light, 1.0));
            let tone = Tone::of(seen_light, camera.exposure);
            average_pixels(&mut canvas, (width, height), |x, y| {
                radiance(&seen[y * lens.width + x]).map(|light| tone.map(light))
            });
        }
        Values::Scale {
            values,
            title,
            logarithmic,
            marked,
            histogram,
        } => {
            let of = |value: f64| if *logarithmic { value.ln() } else { value };
            let known = || {
                values
                    .iter()
                    .copied()
                    .filter(|value| !(value.is_nan() || *logarithmic && *value <= 0.0))
            };
            let high = known().fold(f64::NEG_INFINITY, f64::max);
            let mut low = known().fold(f64::INFINITY, f64::min);
            if *logarithmic {
                // Four decades: what is less is hardly there.
                low = low.max(high * 1e-4);
            }
            let scaled: Vec<[f64; 1]> = values
                .iter()
                .map(|&value| {
                    if value.is_nan() || (*logarithmic && value <= 0.0) {
                        return [f64::NAN];
                    }
                    [((of(value) - of(low)) / (of(high) - of(low)).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0)]
                })
                .collect();
            // A row jumps from patch to patch, and what is not seen must not look seen.
            let smooth = smooth && marked.is_none();
            let corners = if smooth {
                at_corners(prepared, &scaled)
            } else {
                Vec::new()
            };
            average_pixels(&mut canvas, (width, height), |x, y| {
                let sample = &seen[y * lens.width + x];
                let patch = sample.patch as usize;
                if patch >= scaled.len() {
                    return None;
                }
                let value = if smooth {
                    mix(&corners[patch], sample.barycentric)[0]
                } else {
                    scaled[patch][0]
                };
                let color = if *marked == Some(sample.patch) {
                    EMITTER
                } else if value.is_nan() {
                    // What has no value is still there: lit from above, to be recognised.
                    let normal = prepared.patches.normal(InputPatch(sample.patch));
                    [byte(150.0 + 60.0 * normal.dot(-lens.axes[2]).abs()); 3]
                } else {
                    scale_color(value)
                };
                Some(color.map(linear))
            });
            let bars = if *histogram { BARS } else { 0 };
            let mut framed = Canvas::new(width, height + bars + 56, WHITE);
            framed.put((0, 0), &canvas);
            let wide = (width / 3).max(120);
            if *histogram {
                let most = draw_histogram(&mut framed, (16, height + 12), (wide, bars - 12), &scaled);
                let note = format!("patches; the tallest bar is {}", count(most));
                framed.write(
                    &note,
                    ((16 + wide + 16) as f64, (height + 28) as f64),
                    13.0,
                    Anchor::Start,
                );
            }
            let labels = [figures(low), figures(high)];
            framed.scale((16, height + bars + 12), wide, [&labels[0], &labels[1]], title);
            canvas = framed;
        }
    }
    canvas.save(output)
}

/// Numbers of patches along the scale, in its colours; how many are in the tallest bar.
fn draw_histogram(
    canvas: &mut Canvas,
    (x, y): (usize, usize),
    (width, height): (usize, usize),
    scaled: &[[f64; 1]],
) -> u64 {
    let count = width / BAR;
    let mut bins = vec![0u64; count];
    for [value] in scaled.iter().filter(|[value]| !value.is_nan()) {
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "from 0 to the number of bars"
        )]
        let bin = ((value * count as f64) as usize).min(count - 1);
        bins[bin] += 1;
    }
    let most = bins.iter().copied().max().unwrap_or(0);
    for (bin, &patches) in bins.iter().enumerate().filter(|(_, patches)| **patches > 0) {
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "from 0 to the height"
        )]
        let tall = ((height as f64 * patches as f64 / most as f64) as usize).max(1);
        let color = scale_color((bin as f64 + 0.5) / count as f64);
        canvas.fill((x + bin * BAR, y + height - tall), (BAR - 1, tall), color);
    }
    most
}

fn mix<const N: usize>(corners: &[[f64; N]; 3], barycentric: [f64; 3]) -> [f64; N] {
    let mut mixed = [0.0; N];
    for (corner, weight) in corners.iter().zip(barycentric) {
        for (mixed, value) in mixed.iter_mut().zip(corner) {
            *mixed += weight * value;
        }
    }
    mixed
}

/// Averages the samples of each pixel as light.
fn average_pixels(
    canvas: &mut Canvas,
    (width, height): (usize, usize),
    sample: impl Fn(usize, usize) -> Option<[f64; 3]>,
) {
    let nothing = NOTHING.map(linear);
    for y in 0..height {
        for x in 0..width {
            let mut sum = [0.0; 3];
            for place in 0..SAMPLES * SAMPLES {
                let light = sample(x * SAMPLES + place % SAMPLES, y * SAMPLES + place / SAMPLES).unwrap_or(nothing);
                for (sum, light) in sum.iter_mut().zip(light) {
                    *sum += light;
                }
            }
            canvas.set(x, y, sum.map(|sum| byte(shown(sum / (SAMPLES * SAMPLES) as f64))));
        }
    }
}

/// A quantity of a solution, to be drawn.
///
/// # Errors
/// When it cannot be read.
pub(crate) fn of_solution(stored: &StoredSolution, quantity: &str) -> Result<Values> {
    let array = stored.quantity(quantity)?;
    let report = stored.report();
    if report["quantity"] == "light" && array.rows() == 3 {
        let bands = [array.row(0)?, array.row(1)?, array.row(2)?];
        return Ok(Values::Light(
            (0..bands[0].len())
                .map(|patch| [0, 1, 2].map(|band: usize| bands[band][patch].max(0.0)))
                .collect(),
        ));
    }
    let title = match quantity {
        "flux" => "net flux, W/m²",
        "temperature" => "temperature, K",
        other => other,
    };
    Ok(Values::Scale {
        values: array.row(0)?,
        title: if array.rows() > 1 {
            format!("{title}, the first of {}", array.rows())
        } else {
            title.to_owned()
        },
        logarithmic: false,
        marked: None,
        histogram: false,
    })
}

pub(crate) fn run(arguments: &Arguments, talk: Talk) -> Result<Exit> {
    super::canvas::Format::of(&arguments.output)?;
    crate::report::require(&arguments.store)?;
    let store = Store::open(&arguments.store)?;
    let patches = store.patch_count() as usize;
    let values = match &arguments.show {
        Show::Quantity(quantity) => of_solution(&StoredSolution::open(&store, &arguments.solution)?, quantity)?,
        Show::Seen => {
            let mut values = vec![f64::NAN; patches];
            for index in 0..store.manifest().parts.len() {
                let Some(part) = store.part(index)? else { continue };
                for (row, &patch) in part.rows.iter().enumerate() {
                    values[patch as usize] = part.row(row).0.len() as f64;
                }
            }
            Values::Scale {
                values,
                title: "patches in sight".to_owned(),
                logarithmic: false,
                marked: None,
                histogram: false,
            }
        }
        Show::Row => {
            let patch = arguments.patch.unwrap_or(0);
            if patch as usize >= patches {
                bail!(
                    "`--patch {patch}`: the matrix has {} patches, from 0 on",
                    count(patches as u64)
                );
            }
            let row = store
                .row(InputPatch(patch))?
                .ok_or_else(|| anyhow!("the row of patch {patch} was not computed"))?;
            let mut values = vec![f64::NAN; patches];
            for (&column, &factor) in row.indices.iter().zip(&row.data) {
                values[column as usize] = f64::from(factor);
            }
            Values::Scale {
                values,
                title: format!("form factor from patch {patch} (red)"),
                logarithmic: true,
                marked: Some(patch),
                histogram: false,
            }
        }
        Show::Error | Show::Closure => {
            let rows = store.row_table()?;
            let (values, title) = if arguments.show == Show::Error {
                (rows.error, "expected √Σ (F − true F)² of each row")
            } else {
                let losses = rows.escaped.iter().zip(&rows.blocked).zip(&rows.unselected);
                let closure = rows
                    .row_sum
                    .iter()
                    .zip(losses)
                    .map(|(sum, ((escaped, blocked), unselected))| (sum + escaped + blocked + unselected - 1.0).abs());
                (closure.collect(), "|sum of F + escaped + blocked − 1| of each row")
            };
            // All 0 is as good as none: nothing to put on a scale.
            if !values.iter().any(|&value| value > 0.0) {
                bail!(
                    "`{}` says no {}",
                    store.directory().display(),
                    if arguments.show == Show::Error {
                        "expected errors: a matrix of `compute --tolerance` does"
                    } else {
                        "closure errors: every row sums to 1, or the matrix is not complete"
                    }
                );
            }
            Values::Scale {
                values,
                title: title.to_owned(),
                logarithmic: true,
                marked: None,
                histogram: true,
            }
        }
        Show::Sky => {
            stored::sky(&store)?;
            Values::Scale {
                values: sky_view_factors_beside(&store)?,
                title: "sky view factor".to_owned(),
                logarithmic: false,
                marked: None,
                histogram: false,
            }
        }
    };
    let prepared = stored::scene(&store, &arguments.scene, &arguments.engine, arguments.allow_large)?;
    draw(&prepared, &values, &arguments.camera, &arguments.output)?;
    let backs = prepared
        .patches
        .iter()
        .filter(|&p| prepared.patches.side(p) == Side::Back)
        .count();
    talk.detail(&format!("{} of the patches are backs", count(backs as u64)));
    talk.say(&format!(
        "`{}`: {} patches",
        arguments.output.display(),
        count(patches as u64)
    ));
    Ok(Exit::Done)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_and_sizes() {
        assert_eq!("278, 273,-800".parse(), Ok(Point(DVec3::new(278.0, 273.0, -800.0))));
        for wrong in ["1,2", "1,2,3,4", "1,2,x", ""] {
            assert!(wrong.parse::<Point>().is_err(), "{wrong}");
        }
        assert_eq!("800x600".parse(), Ok(Size(800, 600)));
        for wrong in ["800", "0x9", "800x", "9000x16"] {
            assert!(wrong.parse::<Size>().is_err(), "{wrong}");
        }
    }
}
