//! The study's pictures. Colours are backends, markers are ways, and every number has its unit on the picture.

use crate::picture::sheet::{
    Anchor, Area, Axis, BLACK, BOTTOM, Format, GREY, GRID, LEFT, Legend, Letters, Marker, RGBColor, RIGHT, Shape,
    Sheet, Sign, TOP, WHITE, color, faded, free_place,
};
use crate::report::{count, figures};
use crate::study::results::{Accuracy, Course};
use anyhow::Result;

/// Points drawn alike.
#[derive(Clone, Debug)]
pub(super) struct Series {
    pub(super) name: String,
    pub(super) color: RGBColor,
    pub(super) marker: Marker,
    /// True if its points are joined.
    pub(super) joined: bool,
    /// x, y, and the label.
    pub(super) points: Vec<(f64, f64, Option<String>)>,
}

/// Points over two logarithmic axes.
#[derive(Clone, Debug)]
pub(super) struct Diagram {
    pub(super) title: String,
    pub(super) subtitle: String,
    /// Beneath the axis, and over the other.
    pub(super) x: &'static str,
    pub(super) y: &'static str,
    pub(super) unit: &'static str,
    /// A level line with its label.
    pub(super) level: Option<(f64, String)>,
    pub(super) series: Vec<Series>,
}

const SMALL: f64 = 13.0;

/// Draws the meaning of colours and markers (two lines fit).
fn legend(sheet: &mut Sheet, entries: &[(&str, Marker, RGBColor)], letters: &Letters) {
    let mut legend = Legend::at(84.0);
    for &(name, marker, color) in entries {
        legend.sign(sheet, name, Sign::filled(marker, color), letters);
    }
}

impl Diagram {
    /// The picture as the bytes of a file.
    ///
    /// # Errors
    /// When it cannot be drawn.
    pub(super) fn draw(&self, format: Format) -> Result<Vec<u8>> {
        let letters = Letters::new()?;
        self.lay_out(&letters).bytes(format, &letters)
    }

    fn lay_out(&self, letters: &Letters) -> Sheet {
        let mut sheet = Sheet::default();
        sheet.heading(&self.title, &self.subtitle, letters);
        let entries: Vec<_> = self
            .series
            .iter()
            .map(|s| (s.name.as_str(), s.marker, s.color))
            .collect();
        legend(&mut sheet, &entries, letters);
        let points = || self.series.iter().flat_map(|series| &series.points);
        let x = Axis::over(points().map(|p| p.0), LEFT, RIGHT);
        let levels = self.level.iter().map(|(level, _)| *level);
        let y = Axis::over(points().map(|p| p.1).chain(levels), BOTTOM, TOP);
        sheet.axes(x, y, self.x, self.y, self.unit);
        let mut taken: Vec<Area> = Vec::new();
        if let Some((level, says)) = &self.level {
            let height = y.place(*level);
            sheet.dashes(height, GREY, 1.2);
            taken.push(sheet.label_of_line(says.clone(), height - 6.0, GREY, letters));
            taken.push(Area::along(height));
        }
        let place = |p: &(f64, f64, Option<String>)| (x.place(p.0), y.place(p.1));
        let covered = sheet.shapes.len();
        let mut lines = Vec::new();
        for series in &self.series {
            let at: Vec<(f64, f64)> = series.points.iter().map(place).collect();
            if series.joined {
                sheet
                    .shapes
                    .push(Shape::Line(at.clone(), faded(series.color, 0.8), 1.8));
                lines.extend(at.clone());
            }
            for at in at {
                sheet.sign(Sign::filled(series.marker, series.color), at, 6.0);
                taken.push(Area::about(at, 8.0));
            }
        }
        let mut labels = Vec::new();
        for point in points() {
            if let Some(label) = &point.2 {
                let area = free_place(place(point), letters.width(label, 12.5), 12.5, &taken, &lines);
                sheet.write(
                    label,
                    (area.left, area.bottom - 0.28 * 12.5),
                    12.5,
                    BLACK,
                    Anchor::Start,
                );
                taken.push(area);
                labels.push(Shape::Fill(area.corners(), WHITE));
            }
        }
        sheet.shapes.splice(covered..covered, labels);
        sheet
    }
}

/// Error against time of a scene, by families of settings, with peers on the same scene.
pub(super) fn error_against_time(
    title: String,
    subtitle: String,
    accuracy: &Accuracy,
    peers: &[(String, Vec<(f64, f64)>)],
) -> Diagram {
    let families = [
        ("pixel", "sums of pixels", Marker::Disc),
        ("tolerance", "to a tolerance", Marker::Triangle),
    ];
    let mut series: Vec<Series> = Vec::new();
    for (place, (family, name, marker)) in families.into_iter().enumerate() {
        let mut points: Vec<_> = accuracy
            .points
            .iter()
            .filter(|p| p.family == family && p.error.is_finite() && p.milliseconds.is_finite())
            .collect();
        points.sort_by(|a, b| a.milliseconds.total_cmp(&b.milliseconds));
        // Settings outdone by a cheaper one of their family are left out: there are thirty.
        let mut least = f64::INFINITY;
        points.retain(|p| {
            let better = p.high < 0.97 * least;
            least = least.min(p.high);
            better
        });
        let shown = |error: f64, high: f64| 100.0 * if error < 0.5 * high { high } else { error };
        let last = points.len().saturating_sub(1);
        let points = points.iter().enumerate().map(|(k, p)| {
            let label = (k == 0 || k == last).then(|| p.name.clone());
            (p.milliseconds, shown(p.error, p.high), label)
        });
        let points: Vec<_> = points.collect();
        if !points.is_empty() {
            series.push(Series {
                name: name.to_owned(),
                color: color(place),
                marker,
                joined: true,
                points,
            });
        }
    }
    for (place, (name, points)) in peers.iter().enumerate() {
        series.push(Series {
            name: name.clone(),
            color: color(place + families.len()),
            marker: Marker::Down,
            joined: true,
            points: points.iter().map(|&(ms, error)| (ms, 100.0 * error, None)).collect(),
        });
    }
    Diagram {
        title,
        subtitle,
        x: "milliseconds a row, one thread (logarithmic; further left is faster)",
        y: "relative Frobenius error of the rows (logarithmic; further down is better)",
        unit: " %",
        level: (accuracy.noise > 0.0).then(|| {
            (
                100.0 * accuracy.noise,
                format!("the reference's own noise, {} %", figures(100.0 * accuracy.noise)),
            )
        }),
        series,
    }
}

/// A panel of a heat map: times by octree level and least patches.
#[derive(Clone, Debug)]
pub(super) struct Panel {
    pub(super) title: String,
    pub(super) levels: Vec<u32>,
    pub(super) least: Vec<u32>,
    /// By level, then by least patches.
    pub(super) milliseconds: Vec<Option<f64>>,
    /// Time of the backend's finding over the best one's, measured beside it.
    pub(super) found: Option<f64>,
}

/// From dark (best) to pale: blue, in even steps of lightness.
fn heat(share: f64) -> RGBColor {
    faded(RGBColor(0, 90, 150), 1.0 - 0.9 * share.clamp(0.0, 1.0))
}

/// Height of a line of heat maps besides its levels.
const TITLES: f64 = 94.0;

/// The octree's parameters as heat maps side by side: dark is fast, each panel on its own scale.
///
/// # Errors
/// When it cannot be drawn.
pub(super) fn heat_map(title: &str, subtitle: &str, panels: &[Panel], format: Format) -> Result<Vec<u8>> {
    let letters = Letters::new()?;
    let mut sheet = Sheet::default();
    sheet.heading(title, subtitle, &letters);
    let columns = panels.len().clamp(1, 3);
    let wide = (RIGHT - 24.0) / columns as f64;
    // Levels share the rest of the sheet, as many as a line's tallest panel has.
    let levels_of = |line: &[Panel]| line.iter().map(|panel| panel.levels.len()).max().unwrap_or(0).max(1) as f64;
    let lines = panels.chunks(columns);
    let all: f64 = lines.clone().map(levels_of).sum();
    let level = (BOTTOM + 50.0 - 84.0 - TITLES * lines.len() as f64) / all.max(1.0);
    let mut top = 84.0;
    for line in lines {
        let high = TITLES + level * levels_of(line);
        for (column, panel) in line.iter().enumerate() {
            let left = 24.0 + column as f64 * wide;
            let frame = Frame {
                left,
                top,
                wide: wide - 18.0,
                high: high - 16.0,
            };
            draw_panel(&mut sheet, panel, frame, &letters);
        }
        top += high;
    }
    sheet.bytes(format, &letters)
}

/// The place of a panel on the sheet.
#[derive(Clone, Copy)]
struct Frame {
    left: f64,
    top: f64,
    wide: f64,
    high: f64,
}

fn draw_panel(sheet: &mut Sheet, panel: &Panel, frame: Frame, letters: &Letters) {
    let Frame { left, top, wide, high } = frame;
    const GUTTER: f64 = 62.0;
    let size = 13.5_f64.min(13.5 * wide / letters.width(&panel.title, 13.5).max(1.0));
    sheet.write(&panel.title, (left, top + 14.0), size, BLACK, Anchor::Start);
    let known: Vec<f64> = panel.milliseconds.iter().flatten().copied().collect();
    let best = known.iter().copied().fold(f64::INFINITY, f64::min);
    let worst = known.iter().copied().fold(0.0, f64::max);
    let (x0, y0) = (left + GUTTER, top + 46.0);
    let cell = (
        (wide - GUTTER) / panel.least.len() as f64,
        (high - 78.0) / panel.levels.len() as f64,
    );
    sheet.write(
        "least patches of a query →",
        (x0, top + 31.0),
        10.5,
        GREY,
        Anchor::Start,
    );
    for (row, level) in panel.levels.iter().enumerate() {
        let y = y0 + row as f64 * cell.1;
        let text = format!("{level} levels");
        sheet.write(&text, (x0 - 6.0, y + 0.5 * cell.1 + 4.0), 11.5, BLACK, Anchor::End);
        for column in 0..panel.least.len() {
            let x = x0 + column as f64 * cell.0;
            let corners = vec![
                (x, y),
                (x + cell.0 - 2.0, y),
                (x + cell.0 - 2.0, y + cell.1 - 2.0),
                (x, y + cell.1 - 2.0),
            ];
            let Some(ms) = panel
                .milliseconds
                .get(row * panel.least.len() + column)
                .copied()
                .flatten()
            else {
                sheet.shapes.push(Shape::Fill(corners, GRID));
                continue;
            };
            let share = (ms / best.max(1e-12)).ln() / (worst / best.max(1e-12)).max(1.05).ln();
            sheet.shapes.push(Shape::Fill(corners, heat(share)));
            let ink = if share < 0.45 { WHITE } else { BLACK };
            let text = if ms <= best {
                format!("{} best", figures(ms))
            } else {
                figures(ms)
            };
            let middle = (x + 0.5 * cell.0 - 1.0, y + 0.5 * cell.1 + 4.0);
            sheet.write(&text, middle, 12.0, ink, Anchor::Middle);
        }
    }
    let below = y0 + panel.levels.len() as f64 * cell.1 + 13.0;
    for (column, least) in panel.least.iter().enumerate() {
        let middle = x0 + (column as f64 + 0.5) * cell.0 - 1.0;
        sheet.write(&count(u64::from(*least)), (middle, below), 11.5, BLACK, Anchor::Middle);
    }
    if let Some(found) = panel.found {
        let text = format!("found by itself: {} of the best, measured beside it", times(found));
        sheet.write(&text, (x0, below + 16.0), 11.5, BLACK, Anchor::Start);
    }
}

/// Formats 1.234 as `1.23×`.
pub(super) fn times(ratio: f64) -> String {
    if ratio.is_finite() {
        format!("{}×", figures(ratio))
    } else {
        "—".to_owned()
    }
}

/// Memory over the time of whole runs, on even axes that begin at 0.
///
/// # Errors
/// When it cannot be drawn.
pub(super) fn memory_over_time(
    title: &str,
    subtitle: &str,
    runs: &[(String, &Course)],
    format: Format,
) -> Result<Vec<u8>> {
    let letters = Letters::new()?;
    let mut sheet = Sheet::default();
    sheet.heading(title, subtitle, &letters);
    let entries: Vec<_> = runs
        .iter()
        .enumerate()
        .map(|(k, (name, _))| (name.as_str(), Marker::Square, color(k)))
        .collect();
    legend(&mut sheet, &entries, &letters);
    let longest = runs.iter().map(|(_, run)| run.seconds).fold(1e-3, f64::max);
    let most = runs
        .iter()
        .map(|(_, run)| run.peak_bytes as f64 * 1e-6)
        .fold(1.0, f64::max);
    let (end, top) = (round_up(longest), round_up(1.02 * most));
    let place = |seconds: f64, megabytes: f64| {
        (
            LEFT + (RIGHT - LEFT) * seconds / end,
            BOTTOM - (BOTTOM - TOP) * megabytes / top,
        )
    };
    for step in 0..=5 {
        let share = f64::from(step) / 5.0;
        let (x, y) = place(share * end, share * top);
        sheet.shapes.push(Shape::Line(vec![(x, TOP), (x, BOTTOM)], GRID, 1.0));
        sheet.shapes.push(Shape::Line(vec![(LEFT, y), (RIGHT, y)], GRID, 1.0));
        sheet.write(&figures(share * end), (x, BOTTOM + 20.0), SMALL, BLACK, Anchor::Middle);
        sheet.write(&figures(share * top), (LEFT - 8.0, y + 4.7), SMALL, BLACK, Anchor::End);
    }
    sheet.frame(
        "seconds since the program was started (one thread computes)",
        "resident memory in MB",
    );
    for (k, (_, run)) in runs.iter().enumerate() {
        let line = run
            .moments
            .iter()
            .map(|&(seconds, bytes, _)| place(seconds, bytes as f64 * 1e-6));
        let line: Vec<_> = line.collect();
        let last = line.last().copied();
        sheet.shapes.push(Shape::Line(line, color(k), 2.2));
        if let Some(last) = last {
            sheet.sign(Sign::filled(Marker::Square, color(k)), last, 5.0);
        }
    }
    sheet.bytes(format, &letters)
}

/// The next of 1, 2, 2.5, 5 × 10ᵏ.
fn round_up(value: f64) -> f64 {
    let decade = 10f64.powf(value.max(1e-9).log10().floor());
    let steps = [1.0, 2.0, 2.5, 5.0, 10.0];
    steps
        .into_iter()
        .map(|s| s * decade)
        .find(|&s| s >= value)
        .unwrap_or(10.0 * decade)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_end_on_round_numbers() {
        assert_eq!([0.7, 1.0, 1.2, 23.0, 26.0].map(round_up), [1.0, 1.0, 2.0, 25.0, 50.0]);
    }

    #[test]
    fn best_is_darkest() {
        let light = |c: RGBColor| u32::from(c.0) + u32::from(c.1) + u32::from(c.2);
        assert!(light(heat(0.0)) < light(heat(0.5)) && light(heat(0.5)) < light(heat(1.0)));
    }

    #[test]
    fn pictures_are_drawn_even_of_nothing() {
        let panel = Panel {
            title: "city".to_owned(),
            levels: vec![3, 5],
            least: vec![300, 600],
            milliseconds: vec![Some(1.0), None, Some(2.0), Some(1.5)],
            found: Some(1.05),
        };
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
        let map = text(heat_map("title", "subtitle", &[panel], Format::Svg).unwrap());
        assert!(
            map.contains("1.00 best") && map.contains("found by itself: 1.05× of the best"),
            "{map}"
        );
        assert!(heat_map("title", "subtitle", &[], Format::Svg).is_ok());
        assert!(memory_over_time("title", "subtitle", &[], Format::Svg).is_ok());
        let nothing = Accuracy {
            patches: 1,
            rows: 0,
            noise: 0.0,
            points: Vec::new(),
        };
        let peers = [("a peer".to_owned(), vec![(1.0, 0.1), (2.0, 0.05)])];
        let drawn = error_against_time(String::new(), String::new(), &nothing, &peers).draw(Format::Svg);
        assert!(text(drawn.unwrap()).contains("a peer"));
    }
}
