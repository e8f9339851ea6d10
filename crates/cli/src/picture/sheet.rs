//! A sheet for a diagram, as SVG or PNG: axes, markers, letters. `tradeoff`, `compare` and `bench` draw on it.
//!
//! Everything is laid out once, in units of [`WIDTH`] × [`HEIGHT`] a sheet; plotters draws the shapes of either format.
//! Letters are text in the SVG. In the PNG they are set from a built-in font (DejaVu Sans) glyph by glyph, because
//! plotters places glyphs at whole pixels and without their bearings.

use ab_glyph::{Font, FontRef, PxScale, ScaleFont};
use anyhow::{Result, anyhow, bail};
use hemicube_spatial::whole;
use plotters::backend::{BitMapBackend, DrawingBackend, SVGBackend};
use plotters::coord::Shift;
use plotters::drawing::{DrawingArea, IntoDrawingArea};
use plotters::element::{Circle, PathElement, Polygon, Text};
pub(crate) use plotters::style::RGBColor;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{Color, FontDesc, FontFamily, FontStyle, ShapeStyle, TextStyle};
use std::path::Path;

pub(crate) const WIDTH: f64 = 1120.0;
pub(crate) const HEIGHT: f64 = 700.0;
/// The axes' corner points.
pub(crate) const LEFT: f64 = 74.0;
pub(crate) const RIGHT: f64 = 1090.0;
pub(crate) const TOP: f64 = 132.0;
pub(crate) const BOTTOM: f64 = 634.0;

/// Pixels of a PNG for a unit, and samples along the edge of one pixel.
const PIXELS: u32 = 2;
const OVERSAMPLING: u32 = 2;
/// Steps of an SVG's whole-numbered coordinates for a unit.
const SVG_STEPS: u32 = 10;

pub(crate) const BLACK: RGBColor = RGBColor(34, 34, 34);
pub(crate) const GREY: RGBColor = RGBColor(105, 105, 105);
pub(crate) const GRID: RGBColor = RGBColor(226, 226, 226);
pub(crate) const GRID_FINE: RGBColor = RGBColor(243, 243, 243);
pub(crate) const RED: RGBColor = RGBColor(190, 30, 45);
pub(crate) const WHITE: RGBColor = RGBColor(255, 255, 255);

/// Colours told apart by people with any colour vision (Okabe & Ito 2008).
pub(crate) const BLUE: RGBColor = RGBColor(0, 114, 178);
pub(crate) const VERMILION: RGBColor = RGBColor(213, 94, 0);
pub(crate) const GREEN: RGBColor = RGBColor(0, 158, 115);
pub(crate) const PURPLE: RGBColor = RGBColor(204, 121, 167);
const ORANGE: RGBColor = RGBColor(230, 159, 0);
const SKY: RGBColor = RGBColor(86, 180, 233);

/// Colour of the `place`-th series: Okabe & Ito's, a grey, and two for the eighth and ninth.
pub(crate) fn color(place: usize) -> RGBColor {
    const COLORS: [RGBColor; 9] = [
        BLUE,
        VERMILION,
        GREEN,
        PURPLE,
        ORANGE,
        SKY,
        RGBColor(90, 90, 90),
        RGBColor(127, 73, 30),
        RGBColor(150, 150, 30),
    ];
    COLORS[place % COLORS.len()]
}

/// The formats, by the names' extensions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Format {
    Svg,
    Png,
}

impl Format {
    /// The format of a file, by its extension.
    ///
    /// # Errors
    /// When it is neither .svg nor .png.
    pub(crate) fn of(path: &Path) -> Result<Self> {
        match path.extension().map(|extension| extension.to_ascii_lowercase()) {
            Some(extension) if extension == "svg" => Ok(Self::Svg),
            Some(extension) if extension == "png" => Ok(Self::Png),
            _ => bail!("`-o {}`: a name that ends in .svg or .png is needed", path.display()),
        }
    }
}

/// Shape of a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Marker {
    Disc,
    Diamond,
    Square,
    Triangle,
    Down,
}

impl Marker {
    /// The outline about its centre; none for a disc.
    fn outline(self, radius: f64) -> Option<Vec<(f64, f64)>> {
        let around = |points: &[(f64, f64)]| Some(points.iter().map(|(x, y)| (x * radius, y * radius)).collect());
        match self {
            Self::Disc => None,
            Self::Diamond => around(&[(0.0, -1.25), (1.25, 0.0), (0.0, 1.25), (-1.25, 0.0)]),
            Self::Square => around(&[(-0.9, -0.9), (0.9, -0.9), (0.9, 0.9), (-0.9, 0.9)]),
            Self::Triangle => around(&[(0.0, -1.2), (1.1, 0.8), (-1.1, 0.8)]),
            Self::Down => around(&[(0.0, 1.2), (1.1, -0.8), (-1.1, -0.8)]),
        }
    }
}

/// A marker in its colour.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sign {
    pub(crate) marker: Marker,
    pub(crate) color: RGBColor,
    pub(crate) hollow: bool,
}

impl Sign {
    pub(crate) fn filled(marker: Marker, color: RGBColor) -> Self {
        Self {
            marker,
            color,
            hollow: false,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Anchor {
    Start,
    Middle,
    End,
}

#[derive(Debug)]
pub(crate) enum Shape {
    Line(Vec<(f64, f64)>, RGBColor, f64),
    Fill(Vec<(f64, f64)>, RGBColor),
    Disc((f64, f64), f64, RGBColor),
    Ring((f64, f64), f64, RGBColor, f64),
}

/// A line of text; `y` is its base line.
#[derive(Debug)]
pub(crate) struct Writing {
    pub(crate) text: String,
    pub(crate) x: f64,
    pub(crate) y: f64,
    pub(crate) size: f64,
    pub(crate) color: RGBColor,
    pub(crate) anchor: Anchor,
}

/// Shapes and letters, in units of the sheet.
#[derive(Debug, Default)]
pub(crate) struct Sheet {
    pub(crate) shapes: Vec<Shape>,
    pub(crate) writings: Vec<Writing>,
}

/// The built-in font.
pub(crate) struct Letters(FontRef<'static>);

impl Letters {
    pub(crate) fn new() -> Result<Self> {
        FontRef::try_from_slice(dejavu::sans::regular())
            .map(Self)
            .map_err(|_| anyhow!("the built-in font cannot be read; this is a defect of hemicube, please report it"))
    }

    /// The font's own scale counts from ascender to descender; sizes here are of the em.
    pub(crate) fn scale(&self, em: f64) -> PxScale {
        let units = self.0.units_per_em().unwrap_or(2048.0);
        #[allow(clippy::cast_possible_truncation, reason = "rounding to f32 is wanted")]
        let em = em as f32;
        PxScale::from(em * self.0.height_unscaled() / units)
    }

    pub(crate) fn width(&self, text: &str, em: f64) -> f64 {
        let font = self.0.as_scaled(self.scale(em));
        let mut width = 0.0;
        let mut before = None;
        for letter in text.chars() {
            let glyph = font.glyph_id(letter);
            width += before.map_or(0.0, |before| font.kern(before, glyph)) + font.h_advance(glyph);
            before = Some(glyph);
        }
        width.into()
    }
}

/// A logarithmic axis.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Axis {
    /// Decimal logarithms of the ends.
    pub(crate) low: f64,
    pub(crate) high: f64,
    /// Places of the ends on the sheet.
    pub(crate) from: f64,
    pub(crate) to: f64,
}

/// Below this everything is nothing: logarithms end somewhere.
const NOTHING: f64 = 1e-7;

impl Axis {
    /// An axis over `values` with a margin, at least two thirds of a decade long.
    pub(crate) fn over(values: impl Iterator<Item = f64>, from: f64, to: f64) -> Self {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for value in values.filter(|value| value.is_finite()) {
            let logarithm = value.max(NOTHING).log10();
            (low, high) = (low.min(logarithm), high.max(logarithm));
        }
        if low > high {
            (low, high) = (0.0, 0.0);
        }
        let room = (0.07 * (high - low)).max((0.67 - (high - low)) / 2.0).max(0.06);
        Self {
            low: low - room,
            high: high + room,
            from,
            to,
        }
    }

    pub(crate) fn place(&self, value: f64) -> f64 {
        let share = (value.max(NOTHING).log10() - self.low) / (self.high - self.low);
        self.from + share.clamp(0.0, 1.0) * (self.to - self.from)
    }

    /// Values of the grid lines, with the labels of some.
    pub(crate) fn ticks(&self) -> Vec<(f64, Option<String>)> {
        let labelled: &[u32] = match self.high - self.low {
            span if span <= 1.2 => &[1, 2, 3, 5, 7],
            span if span <= 3.2 => &[1, 2, 5],
            _ => &[1],
        };
        #[allow(clippy::cast_possible_truncation, reason = "some decades about 1")]
        let decades = self.low.floor() as i32..=self.high.ceil() as i32;
        let mut ticks = Vec::new();
        for decade in decades {
            for digit in 1..10u32 {
                let value = f64::from(digit) * 10f64.powi(decade);
                if (self.low..=self.high).contains(&value.log10()) {
                    let places = usize::try_from(-decade).unwrap_or(0);
                    ticks.push((value, labelled.contains(&digit).then(|| format!("{value:.places$}"))));
                }
            }
        }
        ticks
    }
}

impl Sheet {
    pub(crate) fn write(&mut self, text: &str, at: (f64, f64), size: f64, color: RGBColor, anchor: Anchor) {
        // A file's name may hold characters that are allowed neither in XML nor in a line of text.
        let text = text.chars().map(|c| if c.is_control() { '?' } else { c }).collect();
        let (x, y) = at;
        self.writings.push(Writing {
            text,
            x,
            y,
            size,
            color,
            anchor,
        });
    }

    /// Writes title and subtitle, shrunk to the sheet's width.
    pub(crate) fn heading(&mut self, title: &str, subtitle: &str, letters: &Letters) {
        let room = RIGHT - 24.0;
        let fitting = |text: &str, size: f64| {
            let width = letters.width(text, size);
            size * (room / width.max(1.0)).min(1.0)
        };
        self.write(title, (24.0, 36.0), fitting(title, 21.0), BLACK, Anchor::Start);
        self.write(subtitle, (24.0, 60.0), fitting(subtitle, 13.5), GREY, Anchor::Start);
    }

    /// Draws two logarithmic axes: `beneath` names the one, `over` the other, and `unit` follows the other's numbers.
    pub(crate) fn axes(&mut self, x: Axis, y: Axis, beneath: &str, over: &str, unit: &str) {
        const SIZE: f64 = 13.0;
        for (value, label) in x.ticks() {
            let at = x.place(value);
            let color = if label.is_some() { GRID } else { GRID_FINE };
            self.shapes.push(Shape::Line(vec![(at, TOP), (at, BOTTOM)], color, 1.0));
            if let Some(label) = label {
                self.write(&label, (at, BOTTOM + 20.0), SIZE, BLACK, Anchor::Middle);
            }
        }
        for (value, label) in y.ticks() {
            let at = y.place(value);
            let color = if label.is_some() { GRID } else { GRID_FINE };
            self.shapes.push(Shape::Line(vec![(LEFT, at), (RIGHT, at)], color, 1.0));
            if let Some(label) = label {
                let label = format!("{label}{unit}");
                self.write(&label, (LEFT - 8.0, at + 0.36 * SIZE), SIZE, BLACK, Anchor::End);
            }
        }
        self.frame(beneath, over);
    }

    /// Draws the lines of the axes with their names.
    pub(crate) fn frame(&mut self, beneath: &str, over: &str) {
        let frame = vec![(LEFT, TOP), (LEFT, BOTTOM), (RIGHT, BOTTOM)];
        self.shapes.push(Shape::Line(frame, BLACK, 1.2));
        self.write(over, (24.0, TOP - 12.0), 13.5, BLACK, Anchor::Start);
        let middle = (LEFT + RIGHT) / 2.0;
        self.write(beneath, (middle, BOTTOM + 48.0), 13.5, BLACK, Anchor::Middle);
    }

    /// Draws a level line of dashes, from end to end.
    pub(crate) fn dashes(&mut self, y: f64, color: RGBColor, width: f64) {
        const DASH: f64 = 7.0;
        let mut x = LEFT;
        while x < RIGHT {
            let line = vec![(x, y), ((x + DASH).min(RIGHT), y)];
            self.shapes.push(Shape::Line(line, color, width));
            x += 2.0 * DASH;
        }
    }

    /// Writes at the right end of a level line, and returns the place taken.
    pub(crate) fn label_of_line(&mut self, text: String, y: f64, color: RGBColor, letters: &Letters) -> Area {
        const SIZE: f64 = 13.0;
        let width = letters.width(&text, SIZE);
        self.write(&text, (RIGHT - 4.0, y), SIZE, color, Anchor::End);
        Area {
            left: RIGHT - 4.0 - width,
            right: RIGHT - 4.0,
            top: y - SIZE,
            bottom: y + 0.3 * SIZE,
        }
    }

    /// Draws a sign about `at`.
    pub(crate) fn sign(&mut self, sign: Sign, at: (f64, f64), radius: f64) {
        let (x, y) = at;
        let outline = |radius: f64| -> Option<Vec<(f64, f64)>> {
            let points = sign.marker.outline(radius)?;
            Some(points.into_iter().map(|(dx, dy)| (x + dx, y + dy)).collect())
        };
        let mut filled = |radius: f64, color: RGBColor| {
            self.shapes.push(match outline(radius) {
                Some(points) => Shape::Fill(points, color),
                None => Shape::Disc((x, y), radius, color),
            });
        };
        // A rim of paper, for markers on each other to be counted.
        filled(radius + 1.4, WHITE);
        filled(radius, sign.color);
        if sign.hollow {
            filled(radius - 2.2, WHITE);
        }
    }
}

/// A legend from left to right, in as many lines as needed.
#[derive(Debug)]
pub(crate) struct Legend {
    size: f64,
    /// The radius of a marker, from its middle to the letters, and from their end to the next.
    radius: f64,
    before: f64,
    after: f64,
    x: f64,
    /// Base line of the text.
    line: f64,
}

impl Legend {
    const LEFT: f64 = 32.0;

    /// A legend with its first line at `line`.
    pub(crate) fn at(line: f64) -> Self {
        Self {
            size: 13.0,
            radius: 5.5,
            before: 13.0,
            after: 29.0,
            x: Self::LEFT,
            line,
        }
    }

    /// A legend with larger letters and markers.
    pub(crate) fn large(line: f64) -> Self {
        Self {
            size: 13.5,
            radius: 6.0,
            before: 14.0,
            after: 34.0,
            ..Self::at(line)
        }
    }

    /// Writes the meaning of the next sign, and returns the sign's place.
    pub(crate) fn says(&mut self, sheet: &mut Sheet, text: &str, letters: &Letters) -> (f64, f64) {
        let width = letters.width(text, self.size);
        if self.x + 14.0 + width > RIGHT {
            (self.x, self.line) = (Self::LEFT, self.line + 19.0);
        }
        let at = (self.x, self.line - 0.36 * self.size);
        sheet.write(text, (self.x + self.before, self.line), self.size, BLACK, Anchor::Start);
        self.x += self.before + width + self.after;
        at
    }

    /// Draws a sign with its meaning.
    pub(crate) fn sign(&mut self, sheet: &mut Sheet, text: &str, sign: Sign, letters: &Letters) {
        let at = self.says(sheet, text, letters);
        sheet.sign(sign, at, self.radius);
    }
}

/// `color` on white paper at less than full strength.
pub(crate) fn faded(color: RGBColor, strength: f64) -> RGBColor {
    let fade = |channel: u8| whole::to_u8((255.0 - strength * (255.0 - f64::from(channel))).round());
    RGBColor(fade(color.0), fade(color.1), fade(color.2))
}

/// A rectangle of the sheet.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Area {
    pub(crate) left: f64,
    pub(crate) right: f64,
    pub(crate) top: f64,
    pub(crate) bottom: f64,
}

impl Area {
    /// The square about a point, of edges 2 × `half`.
    pub(crate) fn about(at: (f64, f64), half: f64) -> Self {
        let (x, y) = at;
        Self {
            left: x - half,
            right: x + half,
            top: y - half,
            bottom: y + half,
        }
    }

    /// A level line from end to end, thick enough to keep letters off.
    pub(crate) fn along(y: f64) -> Self {
        Self {
            left: LEFT,
            right: RIGHT,
            top: y - 2.0,
            bottom: y + 2.0,
        }
    }

    pub(crate) fn corners(&self) -> Vec<(f64, f64)> {
        vec![
            (self.left, self.top),
            (self.right, self.top),
            (self.right, self.bottom),
            (self.left, self.bottom),
        ]
    }

    pub(crate) fn overlap(&self, other: &Self) -> f64 {
        let across = self.right.min(other.right) - self.left.max(other.left);
        let down = self.bottom.min(other.bottom) - self.top.max(other.top);
        across.max(0.0) * down.max(0.0)
    }

    pub(crate) fn contains(&self, point: (f64, f64)) -> bool {
        let (x, y) = point;
        (self.left..=self.right).contains(&x) && (self.top..=self.bottom).contains(&y)
    }
}

/// The best place for a label: near its mark, off other labels and marks, and off the line of the front.
pub(crate) fn free_place(at: (f64, f64), width: f64, size: f64, taken: &[Area], line: &[(f64, f64)]) -> Area {
    let (x, y) = at;
    let height = 1.15 * size;
    let mut best: Option<(f64, Area)> = None;
    for (ring, gap) in [12.0, 22.0, 36.0, 54.0].into_iter().enumerate() {
        let (beside, middle) = (0.75 * gap, -width / 2.0);
        let places = [
            (gap, -height / 2.0),
            (beside, -height - beside),
            (-gap - width, -height / 2.0),
            (-beside - width, beside),
            (beside, beside),
            (-beside - width, -height - beside),
            (middle, -height - gap),
            (middle, gap),
        ];
        for (preference, (dx, dy)) in places.into_iter().enumerate() {
            let area = Area {
                left: x + dx,
                right: x + dx + width,
                top: y + dy,
                bottom: y + dy + height,
            };
            let outside = (LEFT + 4.0 - area.left)
                .max(area.right - RIGHT)
                .max(TOP - 8.0 - area.top)
                .max(area.bottom - BOTTOM)
                .max(0.0);
            let covered: f64 = taken.iter().map(|other| area.overlap(other)).sum();
            let crossed = crossings(&area, line);
            let cost =
                1000.0 * outside + 10.0 * covered + 40.0 * crossed as f64 + 60.0 * ring as f64 + preference as f64;
            if best.as_ref().is_none_or(|(least, _)| cost < *least) {
                best = Some((cost, area));
            }
        }
    }
    best.map_or(Area::about(at, height), |(_, area)| area)
}

/// Number of points in an area, along a densely sampled line.
fn crossings(area: &Area, line: &[(f64, f64)]) -> usize {
    const STEPS: u32 = 60;
    let within = |a: (f64, f64), b: (f64, f64)| {
        (0..=STEPS)
            .map(|step| f64::from(step) / f64::from(STEPS))
            .filter(|t| area.contains((a.0 + t * (b.0 - a.0), a.1 + t * (b.1 - a.1))))
            .count()
    };
    line.windows(2)
        .map(|pair| match pair {
            &[a, b] => within(a, b),
            _ => 0,
        })
        .sum()
}

/// Rounds a place to a grid of `steps` a unit.
fn step(steps: u32) -> impl Fn(f64) -> i32 + Copy {
    #[allow(clippy::cast_possible_truncation, reason = "on the sheet")]
    move |value: f64| (value * f64::from(steps)).round() as i32
}

fn paint<B: DrawingBackend>(area: &DrawingArea<B, Shift>, shapes: &[Shape], steps: u32) -> Result<()>
where
    B::ErrorType: 'static,
{
    let step = step(steps);
    let place = |&(x, y): &(f64, f64)| (step(x), step(y));
    let size = |value: f64| step(value).unsigned_abs().max(1);
    area.fill(&WHITE)?;
    for shape in shapes {
        match shape {
            Shape::Line(points, color, width) => {
                let style = color.stroke_width(size(*width));
                area.draw(&PathElement::new(points.iter().map(place).collect::<Vec<_>>(), style))?;
            }
            Shape::Fill(points, color) => {
                area.draw(&Polygon::new(
                    points.iter().map(place).collect::<Vec<_>>(),
                    color.filled(),
                ))?;
            }
            Shape::Disc(center, radius, color) => {
                area.draw(&Circle::new(place(center), step(*radius), color.filled()))?;
            }
            Shape::Ring(center, radius, color, width) => {
                let style: ShapeStyle = color.stroke_width(size(*width));
                area.draw(&Circle::new(place(center), step(*radius), style))?;
            }
        }
    }
    Ok(())
}

fn svg(sheet: &Sheet) -> Result<Vec<u8>> {
    let step = step(SVG_STEPS);
    let size = (step(WIDTH).unsigned_abs(), step(HEIGHT).unsigned_abs());
    let mut text = String::new();
    {
        let area = SVGBackend::with_string(&mut text, size).into_drawing_area();
        paint(&area, &sheet.shapes, SVG_STEPS)?;
        for writing in &sheet.writings {
            // The backend divides the size by 1.24, and puts the line half an x-height above the place.
            let size = 1.24 * writing.size * f64::from(SVG_STEPS);
            let family = FontFamily::Name("DejaVu Sans, Verdana, Helvetica, Arial, sans-serif");
            let font = FontDesc::new(family, size, FontStyle::Normal);
            let horizontal = match writing.anchor {
                Anchor::Start => HPos::Left,
                Anchor::Middle => HPos::Center,
                Anchor::End => HPos::Right,
            };
            let style = TextStyle::from(font)
                .color(&writing.color)
                .pos(Pos::new(horizontal, VPos::Bottom));
            let place = (step(writing.x), step(writing.y));
            area.draw(&Text::new(writing.text.as_str(), place, style))?;
        }
        area.present()?;
    }
    // Coordinates are whole numbers: a fine grid, shown at its size in units.
    let grid = format!("width=\"{}\" height=\"{}\"", size.0, size.1);
    let units = format!("width=\"{WIDTH}\" height=\"{HEIGHT}\"");
    if !text.contains(&grid) {
        bail!("the picture has no size; this is a defect of hemicube, please report it");
    }
    Ok(text
        .replacen(&grid, &units, 1)
        .replace("dy=\"-0.5ex\"", "dy=\"0\"")
        .into_bytes())
}

fn png(sheet: &Sheet, letters: &Letters) -> Result<Vec<u8>> {
    let steps = PIXELS * OVERSAMPLING;
    let fine = (step(steps)(WIDTH).unsigned_abs(), step(steps)(HEIGHT).unsigned_abs());
    let mut samples = vec![0u8; 3 * fine.0 as usize * fine.1 as usize];
    {
        let area = BitMapBackend::with_buffer(&mut samples, fine).into_drawing_area();
        paint(&area, &sheet.shapes, steps)?;
        area.present()?;
    }
    let (width, height) = (fine.0 / OVERSAMPLING, fine.1 / OVERSAMPLING);
    let mut pixels = shrink(&samples, fine.0 as usize, OVERSAMPLING as usize);
    for writing in &sheet.writings {
        set(&mut pixels, width, writing, letters);
    }
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&pixels)?;
    writer.finish()?;
    Ok(bytes)
}

/// Averages squares of `by` × `by` samples.
fn shrink(samples: &[u8], width: usize, by: usize) -> Vec<u8> {
    let mut pixels = Vec::with_capacity(samples.len() / (by * by));
    for lines in samples.chunks_exact(3 * width * by) {
        for column in 0..width / by {
            for channel in 0..3 {
                let sum: usize = (0..by * by)
                    .map(|place| 3 * (place / by * width + column * by + place % by) + channel)
                    .map(|place| usize::from(lines.get(place).copied().unwrap_or(255)))
                    .sum();
                pixels.push(u8::try_from((sum + by * by / 2) / (by * by)).unwrap_or(255));
            }
        }
    }
    pixels
}

/// Sets a line of text, glyph by glyph.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_possible_wrap,
    reason = "places on the sheet, held against its edges"
)]
fn set(pixels: &mut [u8], width: u32, writing: &Writing, letters: &Letters) {
    let height = pixels.len() / (3 * width as usize);
    let pixel = f64::from(PIXELS);
    let font = letters.0.as_scaled(letters.scale(writing.size * pixel));
    let length = letters.width(&writing.text, writing.size);
    let start = match writing.anchor {
        Anchor::Start => writing.x,
        Anchor::Middle => writing.x - length / 2.0,
        Anchor::End => writing.x - length,
    };
    let mut x = (start * pixel) as f32;
    let y = (writing.y * pixel) as f32;
    let color = [writing.color.0, writing.color.1, writing.color.2];
    let mut before = None;
    for letter in writing.text.chars() {
        let id = font.glyph_id(letter);
        x += before.map_or(0.0, |before| font.kern(before, id));
        before = Some(id);
        let glyph = id.with_scale_and_position(font.scale(), ab_glyph::point(x, y));
        x += font.h_advance(id);
        let Some(outlined) = font.outline_glyph(glyph) else {
            continue;
        };
        let (left, top) = (outlined.px_bounds().min.x as i64, outlined.px_bounds().min.y as i64);
        outlined.draw(|dx, dy, coverage| {
            let (column, line) = (left + i64::from(dx), top + i64::from(dy));
            if !(0..i64::from(width)).contains(&column) || !(0..height as i64).contains(&line) {
                return;
            }
            let place = 3 * (line as usize * width as usize + column as usize);
            let Some(under) = pixels.get_mut(place..place + 3) else {
                return;
            };
            let coverage = coverage.clamp(0.0, 1.0);
            for (under, over) in under.iter_mut().zip(color) {
                *under = (f32::from(*under) + coverage * (f32::from(over) - f32::from(*under))).round() as u8;
            }
        });
    }
}
impl Sheet {
    /// The sheet as the bytes of a file.
    ///
    /// # Errors
    /// When it cannot be drawn.
    pub(crate) fn bytes(&self, format: Format, letters: &Letters) -> Result<Vec<u8>> {
        match format {
            Format::Svg => svg(self),
            Format::Png => png(self, letters),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round() {
        let axis = Axis::over([0.08, 9.0].into_iter(), 0.0, 1.0);
        let labels: Vec<String> = axis.ticks().into_iter().filter_map(|(_, label)| label).collect();
        assert_eq!(labels, ["0.1", "0.2", "0.5", "1", "2", "5", "10"]);
        assert_eq!((axis.place(1e-9), axis.place(1e9)), (0.0, 1.0));
    }

    #[test]
    fn formats_go_by_the_name() {
        assert_eq!(Format::of("a/B.SVG".as_ref()).unwrap(), Format::Svg);
        assert_eq!(Format::of("x.png".as_ref()).unwrap(), Format::Png);
        assert!(Format::of("x.pdf".as_ref()).is_err_and(|error| error.to_string().contains(".svg or .png")));
        assert!(Format::of("svg".as_ref()).is_err());
    }
}
