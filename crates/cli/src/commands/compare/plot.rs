//! The picture of a comparison: cumulative distribution of the rows' relative errors, measured and expected.

use crate::picture::sheet::{
    Anchor, Area, Axis, BLACK, BLUE, BOTTOM, Format, GREY, GRID, LEFT, Legend, Letters, Marker, RED, RIGHT, Shape,
    Sheet, Sign, TOP, VERMILION, WHITE,
};
use anyhow::Result;

const SMALL: f64 = 13.0;

/// Content of the picture. Errors are relative, one a row, in any order.
#[derive(Clone, Debug)]
pub(super) struct Picture {
    pub(super) title: String,
    pub(super) subtitle: String,
    pub(super) measured: Vec<f64>,
    /// Empty if the matrix has none.
    pub(super) expected: Vec<f64>,
    /// Error of the whole matrix.
    pub(super) matrix: f64,
    /// Its bound, if any.
    pub(super) bound: Option<f64>,
}

/// The picture as the bytes of a file.
///
/// # Errors
/// When it cannot be drawn.
pub(super) fn draw(picture: &Picture, format: Format) -> Result<Vec<u8>> {
    let letters = Letters::new()?;
    lay_out(picture, &letters).bytes(format, &letters)
}

fn height(share: f64) -> f64 {
    BOTTOM + share * (TOP - BOTTOM)
}

fn lay_out(picture: &Picture, letters: &Letters) -> Sheet {
    let mut sheet = Sheet::default();
    sheet.heading(&picture.title, &picture.subtitle, letters);
    let curves = [
        ("measured against the reference", Marker::Disc, BLUE, &picture.measured),
        (
            "expected by `compute --tolerance`",
            Marker::Triangle,
            VERMILION,
            &picture.expected,
        ),
    ];
    let lines = picture.bound.iter().chain([&picture.matrix]);
    // Smaller and larger errors are put at the edge: a few nearly empty rows would take half of the sheet.
    let errors = curves.iter().flat_map(|curve| curve.3).chain(lines);
    let x = Axis::over(errors.map(|error| 100.0 * error.clamp(1e-5, 10.0)), LEFT, RIGHT);
    for (value, label) in x.ticks() {
        if let Some(label) = label {
            let at = x.place(value);
            sheet.shapes.push(Shape::Line(vec![(at, TOP), (at, BOTTOM)], GRID, 1.0));
            let label = format!("{label} %");
            sheet.write(&label, (at, BOTTOM + 20.0), SMALL, BLACK, Anchor::Middle);
        }
    }
    for tenth in (0..=10).step_by(2) {
        let at = height(f64::from(tenth) / 10.0);
        sheet.shapes.push(Shape::Line(vec![(LEFT, at), (RIGHT, at)], GRID, 1.0));
        let label = format!("{} %", 10 * tenth);
        sheet.write(&label, (LEFT - 8.0, at + 0.36 * SMALL), SMALL, BLACK, Anchor::End);
    }
    sheet.frame(
        "relative error of a row (logarithmic; further left is better)",
        "rows with no more",
    );

    let mut legend = Legend::at(92.0);
    for (name, marker, color, errors) in curves {
        if errors.is_empty() {
            continue;
        }
        legend.sign(&mut sheet, name, Sign::filled(marker, color), letters);
        let mut sorted = errors.clone();
        sorted.sort_unstable_by(f64::total_cmp);
        let curve = cumulative(&sorted);
        let at: Vec<(f64, f64)> = curve
            .iter()
            .map(|&(error, share)| (x.place(100.0 * error), height(share)))
            .collect();
        sheet.shapes.push(Shape::Line(at, color, 2.2));
        for percent in [50, 90, 100] {
            let rank = (sorted.len() * percent).div_ceil(100).max(1) - 1;
            let share = (rank + 1) as f64 / sorted.len() as f64;
            sheet.sign(
                Sign::filled(marker, color),
                (x.place(100.0 * sorted[rank]), height(share)),
                5.5,
            );
        }
    }

    let uprights: Vec<_> = [(picture.matrix, "the whole matrix", GREY, BOTTOM - 34.0)]
        .into_iter()
        .chain(picture.bound.map(|bound| (bound, "allowed", RED, BOTTOM - 12.0)))
        .map(|(error, says, color, line)| (x.place(100.0 * error), says, color, line))
        .collect();
    for &(at, _, color, _) in &uprights {
        let mut y = TOP;
        while y < BOTTOM {
            let dash = vec![(at, y), (at, (y + 7.0).min(BOTTOM))];
            sheet.shapes.push(Shape::Line(dash, color, 1.4));
            y += 14.0;
        }
    }
    for (at, says, color, line) in uprights {
        let width = letters.width(says, SMALL);
        // On the side with room.
        let left = if at + 8.0 + width < RIGHT {
            at + 6.0
        } else {
            at - 6.0 - width
        };
        let area = Area {
            left: left - 2.0,
            right: left + width + 2.0,
            top: line - SMALL,
            bottom: line + 4.0,
        };
        sheet.shapes.push(Shape::Fill(area.corners(), WHITE));
        sheet.write(says, (left, line), SMALL, color, Anchor::Start);
    }
    sheet
}

/// The curve from errors to the share of rows with at most that error, at as many points as can be told apart.
fn cumulative(sorted: &[f64]) -> Vec<(f64, f64)> {
    const POINTS: usize = 800;
    let count = sorted.len();
    let mut ranks: Vec<usize> = (0..=POINTS).map(|k| k * (count - 1) / POINTS).collect();
    ranks.dedup();
    let mut curve = vec![(sorted[0], 0.0)];
    curve.extend(
        ranks
            .into_iter()
            .map(|rank| (sorted[rank], (rank + 1) as f64 / count as f64)),
    );
    curve
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture() -> Picture {
        Picture {
            title: "a against b".to_owned(),
            subtitle: "100 rows".to_owned(),
            measured: (1..=100).map(|k| 1e-4 * f64::from(k)).collect(),
            expected: vec![0.004; 100],
            matrix: 0.005,
            bound: Some(0.01),
        }
    }

    #[test]
    fn the_curve_is_that_of_the_shares() {
        let curve = cumulative(&[0.1, 0.2, 0.2, 0.4]);
        assert_eq!(curve.first(), Some(&(0.1, 0.0)));
        assert!(curve.contains(&(0.2, 0.75)) && curve.last() == Some(&(0.4, 1.0)));
        assert_eq!(cumulative(&[0.5]), [(0.5, 0.0), (0.5, 1.0)]);
        assert!(cumulative(&vec![0.0; 1_000_000]).len() < 900);
    }

    #[test]
    fn what_is_there_is_drawn_and_said() {
        let says = |picture: &Picture| String::from_utf8(draw(picture, Format::Svg).unwrap()).unwrap();
        let whole = says(&picture());
        for word in [
            "a against b",
            "measured",
            "expected",
            "the whole matrix",
            "allowed",
            "100 %",
        ] {
            assert!(whole.contains(word), "{word}");
        }
        let mut less = picture();
        (less.expected, less.bound) = (Vec::new(), None);
        let text = says(&less);
        assert!(!text.contains("expected") && !text.contains("allowed"));
        // Equal matrices, and none to compare.
        less.measured = vec![0.0; 3];
        less.matrix = 0.0;
        says(&less);
        less.measured = Vec::new();
        says(&less);
    }
}
