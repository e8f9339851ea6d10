//! The model from a camera, in the colours of a result.

use super::canvas::{Anchor, Canvas, NOTHING, Rect, WHITE, byte, linear, scale_color, shown};
use super::raster::Lens;
use crate::args::UpAxis;
use crate::exit::hinted;
use crate::prepare::Prepared;
use crate::report::{count, figures};
use anyhow::{Result, anyhow};
use clap::Args;
use glam::DVec3;
use hemicube::InputPatch;
use hemicube::portal::Specular;
use hemicube::portal::sight::ThroughPortals;
use hemicube::solve::StoredSolution;
use hemicube_scene::Axis;
use hemicube_spatial::whole;
use std::collections::HashMap;
use std::path::Path;
use std::str::FromStr;

/// Cosine of the largest angle between patches of a smooth surface.
const SMOOTH: f64 = 0.866;
/// Samples along the edge of a pixel.
const SAMPLES: usize = 3;
/// Brightness of the picture's average (Reinhard et al. 2002, a).
const KEY: f64 = 0.18;
/// Pixels: height of a histogram, and width of a bar.
const BARS: usize = 82;
const BAR: usize = 6;
const EMITTER: [u8; 3] = [214, 40, 40];

/// Place, direction and lens of a picture.
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
    /// The axis that points up in the picture [default: the scene's, or as `inspect` finds it]
    #[arg(long, value_name = "x|y|z", hide_possible_values = true)]
    pub(crate) up: Option<UpAxis>,
    /// Angle of view from the lower to the upper edge, in degrees
    #[arg(long, value_name = "DEGREES", default_value = "40", value_parser = field_of_view)]
    pub(crate) fov: f64,
    /// Width and height of the picture
    #[arg(long, value_name = "WxH", default_value = "800x600")]
    pub(crate) size: Size,
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

fn field_of_view(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(degrees) if (1.0..=150.0).contains(&degrees) => Ok(degrees),
        _ => Err("an angle from 1 to 150 degrees is needed".to_owned()),
    }
}

/// Values that colour patches.
pub(crate) enum Values {
    /// Light in red, green and blue, mapped to tones.
    Light(Vec<[f64; 3]>),
    /// A number on a scale.
    Scale(Scale),
}

/// Numbers of patches, and the scale that they are shown on.
pub(crate) struct Scale {
    /// NaN without a value.
    pub(crate) values: Vec<f64>,
    pub(crate) title: String,
    /// True if equal steps of the scale are equal factors.
    pub(crate) logarithmic: bool,
    /// A patch in a colour of its own.
    pub(crate) marked: Option<u32>,
    /// True if a histogram stands on the scale.
    pub(crate) histogram: bool,
}

impl Scale {
    /// A linear scale.
    pub(crate) fn linear(title: impl Into<String>, values: Vec<f64>) -> Self {
        Self {
            values,
            title: title.into(),
            logarithmic: false,
            marked: None,
            histogram: false,
        }
    }

    fn is_on(&self, value: f64) -> bool {
        !(value.is_nan() || self.logarithmic && value <= 0.0)
    }

    /// The ends: the least and the greatest number, on a logarithmic scale no more than four decades apart.
    fn range(&self) -> (f64, f64) {
        let known = || self.values.iter().copied().filter(|&value| self.is_on(value));
        let high = known().fold(f64::NEG_INFINITY, f64::max);
        let low = known().fold(f64::INFINITY, f64::min);
        // Below a ten-thousandth, colours do not differ.
        let low = if self.logarithmic { low.max(high * 1e-4) } else { low };
        (low, high)
    }

    /// Places on the scale from 0 to 1; NaN for values off it.
    fn scaled(&self, low: f64, high: f64) -> Vec<[f64; 1]> {
        let of = |value: f64| if self.logarithmic { value.ln() } else { value };
        let place = |value: f64| {
            if self.is_on(value) {
                ((of(value) - of(low)) / (of(high) - of(low)).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0)
            } else {
                f64::NAN
            }
        };
        self.values.iter().map(|&value| [place(value)]).collect()
    }
}

impl Camera {
    fn lens(&self, prepared: &Prepared) -> Result<Lens> {
        let surfaces = prepared.patches.surfaces();
        let corners = || surfaces.iter().flatten().copied();
        let low = corners().fold(DVec3::INFINITY, DVec3::min);
        let high = corners().fold(DVec3::NEG_INFINITY, DVec3::max);
        let middle = (low + high) / 2.0;
        let up = match prepared.up(self.up)? {
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
                // From a corner, a little above, far enough away for every corner to be in the picture.
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

/// The patch at a sample, and the place on it.
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
            // Backs are shown by the patch on the back, if there is one.
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

/// Values at the corners of patches: averages, by area, over the patches sharing the corner and turned alike.
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

/// Mapping of light to a screen: Reinhard et al. 2002, eq. 1, 2 and 4. The average becomes middle grey; only light far
/// brighter than the rest burns out.
pub(crate) struct Tone {
    exposure: f64,
    white: f64,
}

impl Tone {
    /// Adapts to light with weights: pixels of a picture, or areas of a model.
    pub(crate) fn of(light: impl Iterator<Item = ([f64; 3], f64)>) -> Self {
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
        let exposure = KEY / average;
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
/// When the camera looks at its own place, or the picture cannot be written.
pub(crate) fn draw(
    prepared: &Prepared,
    values: &Values,
    camera: &Camera,
    specular: Option<&Specular>,
    output: &Path,
) -> Result<()> {
    let lens = camera.lens(prepared)?;
    // What each sample sees, its colour, and the picture.
    let samples = (lens.width * lens.height) as u64;
    let bytes = samples * (size_of::<Seen>() + size_of::<[f64; 3]>()) as u64;
    crate::forecast::require(
        prepared.budget,
        bytes,
        "a picture of this size",
        "`--size` makes a smaller one",
    )?;
    let seen = trace(prepared, &lens);
    // A patch hit away from all pixels of the frame: nothing is in sight.
    if seen.iter().all(|sample| sample.patch == u32::MAX) {
        return Err(hinted(
            anyhow!("the camera sees nothing of the scene"),
            "`--eye` and `--look-at` place it; backs of one-sided surfaces are not drawn",
        ));
    }
    let view = Shot {
        prepared,
        camera,
        through: match (specular, values) {
            (Some(specular), Values::Light(_)) => behind(prepared, specular, &lens, &seen),
            _ => HashMap::new(),
        },
        lens,
        seen,
    };
    let canvas = match values {
        Values::Light(light) => view.lit(light),
        Values::Scale(scale) => view.scaled(scale),
    };
    canvas.save(output)
}

/// The model through a camera: the patch at each sample.
struct Shot<'a> {
    prepared: &'a Prepared,
    camera: &'a Camera,
    lens: Lens,
    seen: Vec<Seen>,
    /// Patches seen in mirrors and through panes, and their shares, by sample.
    through: HashMap<usize, Vec<(Seen, f64)>>,
}

/// Views of samples that show a mirror or a pane behind it.
fn behind(prepared: &Prepared, specular: &Specular, lens: &Lens, seen: &[Seen]) -> HashMap<usize, Vec<(Seen, f64)>> {
    let mut through = ThroughPortals::new(specular, None, &prepared.model);
    let mut found = HashMap::new();
    for (place, sample) in seen.iter().enumerate() {
        if sample.patch == u32::MAX || !specular.of(sample.patch).is_portal() {
            continue;
        }
        let (x, y) = (place % lens.width, place / lens.width);
        let (u, v) = (
            lens.left + (x as f64 + 0.5) * lens.step,
            lens.top - (y as f64 + 0.5) * lens.step,
        );
        let towards = lens.axes[0] * u + lens.axes[1] * v + lens.axes[2];
        // From just before the surface: the eye may be farther away than rays go.
        let at = prepared.model.normalise(lens.origin + towards * sample.depth);
        let towards = towards.normalize_or_zero();
        let before = (at - prepared.model.normalise(lens.origin)).length().min(BEFORE);
        let mut ends = Vec::new();
        through.ray(at - towards * before, towards, |patch, at, share| {
            let corners = prepared.patches.corners(InputPatch(patch));
            let barycentric = barycentric(&corners.map(|corner| prepared.model.normalise(corner)), at);
            let depth = 0.0;
            ends.push((
                Seen {
                    patch,
                    barycentric,
                    depth,
                },
                share,
            ));
        });
        found.insert(place, ends);
    }
    found
}

/// Distance before a mirror from which its rays begin, in normalised coordinates.
const BEFORE: f64 = 1e-3;

/// The weights of a triangle's corners at a point of its plane.
fn barycentric([a, b, c]: &[DVec3; 3], at: DVec3) -> [f64; 3] {
    let normal = (*b - *a).cross(*c - *a);
    let whole = normal.length_squared();
    if whole == 0.0 {
        return [1.0, 0.0, 0.0];
    }
    let of = |from: DVec3, to: DVec3| (to - from).cross(at - from).dot(normal) / whole;
    let (first, second) = (of(*b, *c), of(*c, *a));
    [first, second, 1.0 - first - second]
}

impl Shot<'_> {
    /// Patches that are several triangles have one value each, up to their edges.
    fn is_smooth(&self) -> bool {
        self.prepared.grouping.is_none()
    }

    /// The patch of a sample, in the matrix.
    fn patch_of(&self, sample: &Seen) -> u32 {
        match &self.prepared.grouping {
            Some(grouping) if sample.patch != u32::MAX => grouping.patch_of(InputPatch(sample.patch)).0,
            _ => sample.patch,
        }
    }

    /// Averages `color` over the samples of each pixel, as light.
    fn average(&self, color: impl Fn(&Seen) -> Option<[f64; 3]>) -> Canvas {
        let Size(width, height) = self.camera.size;
        let mut canvas = Canvas::new(width, height, NOTHING);
        average_pixels(&mut canvas, |x, y| color(&self.seen[y * self.lens.width + x]));
        canvas
    }

    /// Draws light in red, green and blue, mapped to tones.
    fn lit(&self, light: &[[f64; 3]]) -> Canvas {
        let corners = self.is_smooth().then(|| at_corners(self.prepared, light));
        let radiance = |sample: &Seen| -> Option<[f64; 3]> {
            let patch = self.patch_of(sample) as usize;
            let flat = light.get(patch)?;
            Some(match &corners {
                Some(corners) => mix(&corners[patch], sample.barycentric),
                None => *flat,
            })
        };
        let all = |place: usize| -> Option<[f64; 3]> {
            let mut light = radiance(&self.seen[place])?;
            for (sample, share) in self.through.get(&place).into_iter().flatten() {
                let behind = radiance(sample).unwrap_or_default();
                light = std::array::from_fn(|band| light[band] + share * behind[band]);
            }
            Some(light)
        };
        let seen_light = (0..self.seen.len()).filter_map(&all).map(|light| (light, 1.0));
        let tone = Tone::of(seen_light);
        let Size(width, height) = self.camera.size;
        let mut canvas = Canvas::new(width, height, NOTHING);
        average_pixels(&mut canvas, |x, y| {
            all(y * self.lens.width + x).map(|light| tone.map(light))
        });
        canvas
    }

    /// Draws numbers in the colours of a scale, with the scale and its histogram below.
    fn scaled(&self, scale: &Scale) -> Canvas {
        let (low, high) = scale.range();
        let scaled = scale.scaled(low, high);
        // A row jumps from patch to patch, and an unseen patch must not look seen.
        let is_smooth = self.is_smooth() && scale.marked.is_none();
        let corners = is_smooth.then(|| at_corners(self.prepared, &scaled));
        let canvas = self.average(|sample| {
            let patch = self.patch_of(sample) as usize;
            let [flat] = *scaled.get(patch)?;
            let value = match &corners {
                Some(corners) => mix(&corners[patch], sample.barycentric)[0],
                None => flat,
            };
            let color = if scale.marked == Some(self.patch_of(sample)) {
                EMITTER
            } else if value.is_nan() {
                // Without a value a patch is lit from above, to be recognised.
                let normal = self.prepared.patches.normal(InputPatch(sample.patch));
                [byte(150.0 + 60.0 * normal.dot(-self.lens.axes[2]).abs()); 3]
            } else {
                scale_color(value)
            };
            Some(color.map(linear))
        });
        framed(&canvas, scale, &scaled, [figures(low), figures(high)])
    }
}

/// Puts the scale below a picture, and the histogram onto the scale.
fn framed(picture: &Canvas, scale: &Scale, scaled: &[[f64; 1]], labels: [String; 2]) -> Canvas {
    let (width, height) = (picture.width, picture.height);
    let bars = if scale.histogram { BARS } else { 0 };
    let mut framed = Canvas::new(width, height + bars + 56, WHITE);
    framed.put((0, 0), picture);
    let wide = (width / 3).max(120);
    if scale.histogram {
        let area = Rect {
            x: 16,
            y: height + 12,
            width: wide,
            height: bars - 12,
        };
        let most = draw_histogram(&mut framed, area, scaled);
        let note = format!("patches; the tallest bar is {}", count(most));
        framed.write(
            &note,
            ((16 + wide + 16) as f64, (height + 28) as f64),
            13.0,
            Anchor::Start,
        );
    }
    framed.scale((16, height + bars + 12), wide, [&labels[0], &labels[1]], &scale.title);
    framed
}

/// Draws the numbers of patches along the scale, in its colours; returns the number in the tallest bar.
fn draw_histogram(canvas: &mut Canvas, area: Rect, scaled: &[[f64; 1]]) -> u64 {
    let count = area.width / BAR;
    let mut bins = vec![0u64; count];
    for [value] in scaled.iter().filter(|[value]| !value.is_nan()) {
        let bin = whole::to_usize(value * count as f64).min(count - 1);
        bins[bin] += 1;
    }
    let most = bins.iter().copied().max().unwrap_or(0);
    for (bin, &patches) in bins.iter().enumerate().filter(|(_, patches)| **patches > 0) {
        let tall = whole::to_usize(area.height as f64 * patches as f64 / most as f64).max(1);
        let color = scale_color((bin as f64 + 0.5) / count as f64);
        let bar = Rect {
            x: area.x + bin * BAR,
            y: area.y + area.height - tall,
            width: BAR - 1,
            height: tall,
        };
        canvas.fill(bar, color);
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

/// Averages the samples of each pixel, as light.
fn average_pixels(canvas: &mut Canvas, sample: impl Fn(usize, usize) -> Option<[f64; 3]>) {
    let nothing = NOTHING.map(linear);
    for y in 0..canvas.height {
        for x in 0..canvas.width {
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
    let title = if array.rows() > 1 {
        format!("{title}, the first of {}", array.rows())
    } else {
        title.to_owned()
    };
    Ok(Values::Scale(Scale::linear(title, array.row(0)?)))
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
