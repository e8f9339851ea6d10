//! The picture of a trade-off: error against time, both logarithmic.

use crate::level::percentage;
use crate::picture::sheet::{
    Anchor, Area, Axis, BLACK, BOTTOM, Format, GREEN, GREY, LEFT, Legend, Letters, Marker, RED, RGBColor, RIGHT, Shape,
    Sheet, Sign, TOP, VERMILION, WHITE, faded, free_place,
};
use anyhow::Result;

/// A rung of the ladder, with its colour and marker.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Family {
    Pixel,
    Tolerance,
}

impl Family {
    const ALL: [Self; 2] = [Self::Pixel, Self::Tolerance];

    fn name(self) -> &'static str {
        match self {
            Self::Pixel => "pixel",
            Self::Tolerance => "tolerance",
        }
    }

    fn color(self) -> RGBColor {
        match self {
            Self::Pixel => VERMILION,
            Self::Tolerance => GREEN,
        }
    }

    fn marker(self) -> Marker {
        match self {
            Self::Pixel => Marker::Disc,
            Self::Tolerance => Marker::Triangle,
        }
    }
}

/// A measured setting.
#[derive(Clone, Debug)]
pub(super) struct Mark {
    pub(super) family: Family,
    pub(super) name: String,
    pub(super) milliseconds: f64,
    /// The error, and its interval by the reference's noise.
    pub(super) error: f64,
    pub(super) low: f64,
    pub(super) high: f64,
    /// True if no cheaper setting is as good.
    pub(super) front: bool,
    pub(super) recommended: bool,
}

impl Mark {
    /// Returns whether noise leaves only an upper bound.
    fn is_bound(&self) -> bool {
        self.error < 0.5 * self.high
    }

    fn shown(&self) -> f64 {
        if self.is_bound() { self.high } else { self.error }
    }
}

/// Content of the picture.
#[derive(Clone, Debug)]
pub(super) struct Picture {
    pub(super) title: String,
    pub(super) subtitle: String,
    pub(super) marks: Vec<Mark>,
    pub(super) tolerance: f64,
    pub(super) noise: f64,
}

/// The picture as the bytes of a file.
///
/// # Errors
/// When it cannot be drawn.
pub(super) fn draw(picture: &Picture, format: Format) -> Result<Vec<u8>> {
    let letters = Letters::new()?;
    lay_out(picture, &letters).bytes(format, &letters)
}

fn lay_out(picture: &Picture, letters: &Letters) -> Sheet {
    let mut sheet = Sheet::default();
    let marks: Vec<&Mark> = picture
        .marks
        .iter()
        .filter(|mark| mark.shown().is_finite() && mark.milliseconds.is_finite())
        .collect();
    let x = Axis::over(marks.iter().map(|mark| mark.milliseconds), LEFT, RIGHT);
    let errors = marks.iter().map(|mark| 100.0 * mark.shown());
    let y = Axis::over(errors.chain([100.0 * picture.tolerance]), BOTTOM, TOP);

    sheet.heading(&picture.title, &picture.subtitle, letters);
    legend(&mut sheet, picture, letters);
    sheet.axes(x, y, "milliseconds a row, one thread", "relative Frobenius error", " %");

    let mut taken = Vec::new();
    let mut labels = Vec::new();
    if picture.noise > 0.0 && (100.0 * picture.noise).log10() > y.low {
        let height = y.place(100.0 * picture.noise);
        sheet.dashes(height, GREY, 1.0);
        let text = format!("the reference's own noise, {}", short(picture.noise));
        labels.push(sheet.label_of_line(text, height + 15.0, GREY, letters));
        taken.push(Area::along(height));
    }
    let height = y.place(100.0 * picture.tolerance);
    sheet.dashes(height, RED, 1.6);
    let text = format!("tolerance {}", percentage(picture.tolerance));
    labels.push(sheet.label_of_line(text, height - 6.0, RED, letters));
    taken.push(Area::along(height));
    taken.extend(&labels);

    let place = |mark: &Mark| (x.place(mark.milliseconds), y.place(100.0 * mark.shown()));
    let front: Vec<(f64, f64)> = marks.iter().filter(|mark| mark.front).map(|mark| place(mark)).collect();
    // Labels have paper under them, over grid and dashes and beneath everything else.
    let covered = sheet.shapes.len();
    sheet.shapes.push(Shape::Line(front.clone(), GREY, 1.2));
    for mark in &marks {
        let at = place(mark);
        if mark.high > 1.08 * mark.low {
            let ends = [mark.high, mark.low].map(|error| (at.0, y.place(100.0 * error)));
            let color = faded(mark.family.color(), if mark.front { 1.0 } else { 0.45 });
            sheet.shapes.push(Shape::Line(ends.to_vec(), color, 1.2));
        }
    }
    // The front over the rest.
    for (front, strength) in [(false, 0.42), (true, 1.0)] {
        for mark in marks.iter().filter(|mark| mark.front == front) {
            let at = place(mark);
            let sign = Sign {
                marker: mark.family.marker(),
                color: faded(mark.family.color(), strength),
                hollow: mark.is_bound(),
            };
            sheet.sign(sign, at, if front { 6.5 } else { 5.0 });
            taken.push(Area::about(at, 8.0));
            if mark.recommended {
                sheet.shapes.push(Shape::Ring(at, 12.5, BLACK, 1.8));
                taken.push(Area::about(at, 13.0));
            }
        }
    }
    for mark in marks.iter().filter(|mark| mark.front) {
        let size = if mark.recommended { 14.5 } else { 13.0 };
        let label = free_place(place(mark), letters.width(&mark.name, size), size, &taken, &front);
        sheet.write(
            &mark.name,
            (label.left, label.bottom - 0.28 * size),
            size,
            BLACK,
            Anchor::Start,
        );
        taken.push(label);
        labels.push(label);
    }
    let paper = labels.iter().map(|label| Shape::Fill(label.corners(), WHITE));
    sheet.shapes.splice(covered..covered, paper);
    sheet
}

/// Draws the meaning of the markers.
fn legend(sheet: &mut Sheet, picture: &Picture, letters: &Letters) {
    let mut legend = Legend::large(92.0);
    for family in Family::ALL {
        if picture.marks.iter().any(|mark| mark.family == family) {
            let sign = Sign::filled(family.marker(), family.color());
            legend.sign(sheet, family.name(), sign, letters);
        }
    }
    let (x, y) = legend.says(sheet, "no cheaper one is as good", letters);
    sheet
        .shapes
        .push(Shape::Line(vec![(x - 12.0, y), (x + 8.0, y)], GREY, 1.4));
    if picture.marks.iter().any(|mark| mark.recommended) {
        let at = legend.says(sheet, "recommended", letters);
        sheet.shapes.push(Shape::Ring(at, 8.0, BLACK, 1.8));
    }
    if picture.marks.iter().any(Mark::is_bound) {
        let sign = Sign {
            marker: Marker::Square,
            color: GREY,
            hollow: true,
        };
        legend.sign(sheet, "hollow: at most", sign, letters);
    }
}

fn short(share: f64) -> String {
    crate::report::percent(share)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::sheet::{HEIGHT, WIDTH};

    fn picture() -> Picture {
        let mark = |family, name: &str, milliseconds, error: f64, front| Mark {
            family,
            name: name.to_owned(),
            milliseconds,
            error,
            low: 0.98 * error,
            high: 1.02 * error,
            front,
            recommended: false,
        };
        let mut marks = vec![
            mark(Family::Pixel, "pixel K=1 N=64", 0.1, 0.2, true),
            mark(Family::Pixel, "pixel K=4 N=64", 0.4, 0.21, false),
            mark(Family::Tolerance, "tolerance 5%", 0.13, 0.04, true),
            mark(Family::Pixel, "pixel K=1 N=128", 0.2, 0.1, false),
            mark(Family::Tolerance, "tolerance 1%", 0.9, 0.008, true),
            mark(Family::Tolerance, "tolerance 0.1%", 9.0, 0.0005, true),
        ];
        marks[4].recommended = true;
        marks[5].low = 0.0;
        marks[5].error = 0.0;
        Picture {
            title: "a <scene> & \"more\"\u{7}".to_owned(),
            subtitle: "10 patches".to_owned(),
            marks,
            tolerance: 0.01,
            noise: 0.0006,
        }
    }

    #[test]
    fn labels_stay_off_each_other_and_on_the_sheet() {
        let letters = Letters::new().unwrap();
        let sheet = lay_out(&picture(), &letters);
        let areas: Vec<(&str, Area)> = sheet
            .writings
            .iter()
            .map(|writing| {
                let width = letters.width(&writing.text, writing.size);
                let left = match writing.anchor {
                    Anchor::Start => writing.x,
                    Anchor::Middle => writing.x - width / 2.0,
                    Anchor::End => writing.x - width,
                };
                let area = Area {
                    left,
                    right: left + width,
                    top: writing.y - 0.75 * writing.size,
                    bottom: writing.y,
                };
                (writing.text.as_str(), area)
            })
            .collect();
        assert!(areas.iter().any(|(text, _)| *text == "tolerance 0.1%"));
        for (place, (text, area)) in areas.iter().enumerate() {
            assert!(
                area.left >= 0.0 && area.right <= WIDTH && area.top >= 0.0 && area.bottom <= HEIGHT,
                "{text}"
            );
            for (other_text, other) in &areas[..place] {
                assert_eq!(area.overlap(other), 0.0, "{text} is on {other_text}");
            }
        }
        // The check above can fail.
        assert!(areas[0].1.overlap(&areas[0].1) > 0.0);
    }

    #[test]
    fn an_svg_is_well_formed_and_says_everything() {
        let text = String::from_utf8(draw(&picture(), Format::Svg).unwrap()).unwrap();
        assert!(
            text.starts_with("<svg width=\"1120\" height=\"700\" viewBox=\"0 0 11200 7000\""),
            "{}",
            &text[..200]
        );
        assert!(text.trim_end().ends_with("</svg>"));
        for word in [
            "a &lt;scene&gt; &amp; &quot;more&quot;?",
            "tolerance 1%",
            "pixel K=1 N=64",
            "milliseconds",
        ] {
            assert!(text.contains(word), "{word}");
        }
        assert!(!text.contains("pixel K=4 N=64"), "only the front has labels");
    }

    #[test]
    fn a_png_has_its_size_and_ink() {
        let bytes = draw(&picture(), Format::Png).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        assert_eq!((info.width, info.height), (2240, 1400));
        let share =
            |of: fn(&[u8]) -> bool| pixels.chunks_exact(3).filter(|pixel| of(pixel)).count() as f64 / (2240.0 * 1400.0);
        assert!(share(|pixel| pixel == [255; 3]) > 0.8);
        assert!(
            share(|pixel| pixel.iter().all(|&channel| channel < 100)) > 0.002,
            "text is dark"
        );
        // The tolerance's line and the colour of the pixel rung.
        assert!(share(|pixel| pixel == [190, 30, 45]) > 1e-4 && share(|pixel| pixel == [213, 94, 0]) > 1e-4);
    }

    #[test]
    fn nothing_to_draw_is_drawn_all_the_same() {
        let mut empty = picture();
        empty.marks.clear();
        assert!(draw(&empty, Format::Svg).is_ok());
        let mut odd = picture();
        odd.marks[0].error = f64::NAN;
        odd.marks[0].high = f64::NAN;
        odd.marks[1].error = 0.0;
        odd.marks[1].high = 0.0;
        odd.tolerance = 1e-5;
        odd.noise = f64::NAN;
        assert!(draw(&odd, Format::Png).is_ok());
    }
}
