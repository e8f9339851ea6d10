//! Pixels, letters and scales of colour: a picture as PNG, or as SVG with text.

use crate::report::PendingFile;
use ab_glyph::{Font, FontRef, PxScale, ScaleFont};
use anyhow::{Context, Result, anyhow, bail};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use hemicube_spatial::whole;
use std::io::Write;
use std::path::Path;

pub(crate) use hemicube_export::scale_color;

/// An sRGB colour.
pub(crate) type Color = [u8; 3];

pub(crate) const WHITE: Color = [255; 3];
pub(crate) const INK: Color = [34; 3];
/// Colour of an empty view.
pub(crate) const NOTHING: Color = [245, 245, 242];

/// A colour for an id; neighbouring ids differ.
pub(crate) fn id_color(id: u32) -> Color {
    let mut z = u64::from(id).wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z ^= z >> 27;
    let channel = |shift: u32| {
        60 + u8::try_from((z >> shift) & 127).unwrap_or(0) + u8::try_from((z >> (shift + 8)) & 63).unwrap_or(0)
    };
    [channel(0), channel(16), channel(32)]
}

pub(crate) fn byte(value: f64) -> u8 {
    whole::to_u8(value.round())
}

/// sRGB, from 0 to 255, of linear light from 0 to 1 (IEC 61966-2-1).
pub(crate) fn shown(linear: f64) -> f64 {
    let linear = linear.clamp(0.0, 1.0);
    255.0
        * if linear <= 0.003_130_8 {
            12.92 * linear
        } else {
            1.055 * linear.powf(1.0 / 2.4) - 0.055
        }
}

/// The reverse.
pub(crate) fn linear(shown: u8) -> f64 {
    let value = f64::from(shown) / 255.0;
    if value <= 0.040_45 {
        value / 12.92
    } else {
        ((value + 0.055) / 1.055).powf(2.4)
    }
}

/// The end of a text that stands at its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Anchor {
    Start,
    End,
}

struct Writing {
    text: String,
    at: (f64, f64),
    size: f64,
    anchor: Anchor,
}

/// A rectangle of pixels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rect {
    /// Column of the upper left corner.
    pub(crate) x: usize,
    /// Row of the upper left corner.
    pub(crate) y: usize,
    pub(crate) width: usize,
    pub(crate) height: usize,
}

impl Rect {
    pub(crate) fn square(x: usize, y: usize, side: usize) -> Self {
        Self {
            x,
            y,
            width: side,
            height: side,
        }
    }
}

/// A picture.
pub(crate) struct Canvas {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pixels: Vec<Color>,
    writings: Vec<Writing>,
}

impl Canvas {
    pub(crate) fn new(width: usize, height: usize, color: Color) -> Self {
        Self {
            width,
            height,
            pixels: vec![color; width * height],
            writings: Vec::new(),
        }
    }

    pub(crate) fn set(&mut self, x: usize, y: usize, color: Color) {
        if x < self.width && y < self.height {
            self.pixels[y * self.width + x] = color;
        }
    }

    pub(crate) fn fill(&mut self, area: Rect, color: Color) {
        for row in area.y..area.y + area.height {
            for column in area.x..area.x + area.width {
                self.set(column, row, color);
            }
        }
    }

    /// Copies another picture onto this one, its upper left corner to `at`.
    pub(crate) fn put(&mut self, at: (usize, usize), other: &Self) {
        let (x, y) = at;
        for row in 0..other.height {
            for column in 0..other.width {
                self.set(x + column, y + row, other.pixels[row * other.width + column]);
            }
        }
    }

    /// Writes a line; `at` is its base line.
    pub(crate) fn write(&mut self, text: &str, at: (f64, f64), size: f64, anchor: Anchor) {
        self.writings.push(Writing {
            text: text.to_owned(),
            at,
            size,
            anchor,
        });
    }

    /// Draws a scale of colour from its upper left corner `at`, with the values of its ends and a title.
    pub(crate) fn scale(&mut self, at: (usize, usize), width: usize, labels: [&str; 2], title: &str) {
        const HEIGHT: usize = 12;
        let (x, y) = at;
        for column in 0..width {
            let color = scale_color((column as f64 + 0.5) / width as f64);
            let column = Rect {
                x: x + column,
                y,
                width: 1,
                height: HEIGHT,
            };
            self.fill(column, color);
        }
        let below = (y + HEIGHT) as f64 + 16.0;
        self.write(labels[0], (x as f64, below), 13.0, Anchor::Start);
        self.write(labels[1], ((x + width) as f64, below), 13.0, Anchor::End);
        self.write(title, ((x + width) as f64 + 16.0, y as f64 + 11.0), 13.0, Anchor::Start);
    }

    /// Writes the picture in the format of the name's extension.
    ///
    /// # Errors
    /// When it cannot be written.
    pub(crate) fn save(&self, path: &Path) -> Result<()> {
        let bytes = match Format::of(path)? {
            Format::Png => self.png(true)?,
            Format::Svg => self.svg()?.into_bytes(),
        };
        let mut file = PendingFile::create(path)?;
        file.write_all(&bytes)
            .with_context(|| format!("`{}` cannot be written", path.display()))?;
        file.commit()
    }

    /// The picture as PNG, with or without its letters.
    pub(crate) fn png(&self, letters: bool) -> Result<Vec<u8>> {
        let mut pixels = self.pixels.clone();
        if letters {
            let font = FontRef::try_from_slice(dejavu::sans::regular()).map_err(|_| {
                anyhow!("the built-in font cannot be read; this is a defect of hemicube, please report it")
            })?;
            for writing in &self.writings {
                set_text(&font, writing, &mut pixels, self.width);
            }
        }
        let mut bytes = Vec::new();
        let size = |length: usize| u32::try_from(length).context("the picture is too large");
        let mut encoder = png::Encoder::new(&mut bytes, size(self.width)?, size(self.height)?);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(pixels.as_flattened())?;
        writer.finish()?;
        Ok(bytes)
    }

    /// The pixels as an embedded PNG, the letters as text.
    fn svg(&self) -> Result<String> {
        let (width, height) = (self.width, self.height);
        let mut text = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} \
             {height}\">\n\
             <image width=\"{width}\" height=\"{height}\" href=\"data:image/png;base64,{}\"/>\n",
            BASE64.encode(self.png(false)?)
        );
        for writing in &self.writings {
            let anchor = match writing.anchor {
                Anchor::Start => "start",
                Anchor::End => "end",
            };
            let escaped = writing.text.replace('&', "&amp;").replace('<', "&lt;");
            text.push_str(&format!(
                "<text x=\"{:.1}\" y=\"{:.1}\" font-family=\"DejaVu Sans, Verdana, sans-serif\" font-size=\"{}\" \
                 text-anchor=\"{anchor}\" fill=\"#222\">{escaped}</text>\n",
                writing.at.0, writing.at.1, writing.size
            ));
        }
        text.push_str("</svg>\n");
        Ok(text)
    }
}

/// The formats, by the names' extensions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Format {
    Png,
    Svg,
}

impl Format {
    /// The format of a file, by its extension.
    ///
    /// # Errors
    /// When it is neither .png nor .svg.
    pub(crate) fn of(path: &Path) -> Result<Self> {
        match path.extension().map(std::ffi::OsStr::to_ascii_lowercase) {
            Some(extension) if extension == "png" => Ok(Self::Png),
            Some(extension) if extension == "svg" => Ok(Self::Svg),
            _ => bail!("`{}`: the name of a picture ends in .png or .svg", path.display()),
        }
    }
}

/// Sets a line of text, glyph by glyph, with the font's own bearings.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "pixels of a picture"
)]
fn set_text(font: &FontRef<'_>, writing: &Writing, pixels: &mut [Color], width: usize) {
    let height = pixels.len() / width;
    let units = font.units_per_em().unwrap_or(2048.0);
    let scale = PxScale::from(writing.size as f32 * font.height_unscaled() / units);
    let scaled = font.as_scaled(scale);
    let length: f32 = writing.text.chars().map(|c| scaled.h_advance(font.glyph_id(c))).sum();
    let mut x = writing.at.0 as f32
        - match writing.anchor {
            Anchor::Start => 0.0,
            Anchor::End => length,
        };
    for letter in writing.text.chars() {
        let id = font.glyph_id(letter);
        let glyph = id.with_scale_and_position(scale, ab_glyph::point(x, writing.at.1 as f32));
        x += scaled.h_advance(id);
        let Some(outlined) = font.outline_glyph(glyph) else {
            continue;
        };
        let bounds = outlined.px_bounds();
        outlined.draw(|column, row, cover| {
            let (px, py) = (bounds.min.x + column as f32, bounds.min.y + row as f32);
            if px < 0.0 || py < 0.0 || px as usize >= width || py as usize >= height {
                return;
            }
            let pixel = &mut pixels[py as usize * width + px as usize];
            for (channel, ink) in pixel.iter_mut().zip(INK) {
                let share = f64::from(cover.clamp(0.0, 1.0));
                *channel = byte(f64::from(*channel) * (1.0 - share) + f64::from(ink) * share);
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_of_light_and_back() {
        for value in 0..=255u8 {
            assert_eq!(byte(shown(linear(value))), value);
        }
    }

    #[test]
    fn letters_are_ink_and_svg_has_them_as_text() {
        let mut canvas = Canvas::new(120, 30, WHITE);
        canvas.write("a < b", (10.0, 20.0), 16.0, Anchor::Start);
        let png = canvas.png(true).expect("a picture");
        assert!(png.len() > canvas.png(false).expect("a picture").len());
        assert!(canvas.svg().expect("a picture").contains("a &lt; b</text>"));
    }
}
