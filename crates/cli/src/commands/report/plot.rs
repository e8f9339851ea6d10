//! Histograms as SVG in the page's colours, light and dark.

use crate::report::{count, figures};
use hemicube_spatial::whole;
use std::fmt::Write;

const BINS: usize = 40;
const WIDTH: f64 = 400.0;
const HEIGHT: f64 = 170.0;
const TOP: f64 = 18.0;
const BOTTOM: f64 = 28.0;

/// Histogram of `values` without NaN. On a logarithmic axis, values up to 0 are counted beside it. `None` if no value
/// is left.
pub(super) fn histogram(values: &[f64], what: &str, logarithmic: bool) -> Option<String> {
    let known: Vec<f64> = values.iter().copied().filter(|value| value.is_finite()).collect();
    let shown: Vec<f64> = known
        .iter()
        .copied()
        .filter(|&value| !logarithmic || value > 0.0)
        .map(|value| if logarithmic { value.log10() } else { value })
        .collect();
    let low = shown.iter().copied().fold(f64::INFINITY, f64::min);
    let high = shown.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if shown.is_empty() {
        return None;
    }
    // All equal: one bar in the middle, over their value alone.
    let is_spread = high > low;
    let (from, to) = if is_spread { (low, high) } else { (low - 0.5, low + 0.5) };
    let mut bins = [0u64; BINS];
    for value in &shown {
        let place = (value - from) / (to - from) * BINS as f64;
        let bin = whole::to_usize(place).min(BINS - 1);
        bins[bin] += 1;
    }
    let most = bins.iter().copied().max().unwrap_or(1).max(1);
    let axis = if logarithmic { ", logarithmic axis" } else { "" };
    let number = |value: f64| figures(if logarithmic { 10f64.powf(value) } else { value });
    let mut svg = format!(
        "<svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"histogram of {what}{axis}\" class=\"plot\">\n"
    );
    let base = HEIGHT - BOTTOM;
    let wide = WIDTH / BINS as f64;
    for (bin, &rows) in bins.iter().enumerate() {
        if rows == 0 {
            continue;
        }
        // A bar of one row is still seen.
        let tall = ((base - TOP) * rows as f64 / most as f64).max(1.0);
        let at = |bin: usize| number(from + (to - from) * bin as f64 / BINS as f64);
        let range = if is_spread {
            format!("{} to {}", at(bin), at(bin + 1))
        } else {
            number(low)
        };
        let _ = writeln!(
            svg,
            "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{tall:.1}\"><title>{range}: {}</title></rect>",
            wide * bin as f64,
            base - tall,
            wide - 1.0,
            count(rows)
        );
    }
    let _ = writeln!(svg, "<path d=\"M0 {base}H{WIDTH}\"/>");
    let _ = writeln!(svg, "<text x=\"0\" y=\"12\">{} rows</text>", count(most));
    for (share, anchor) in [(0.0, "start"), (0.5, "middle"), (1.0, "end")] {
        if !is_spread && share != 0.5 {
            continue;
        }
        let _ = writeln!(
            svg,
            "<text x=\"{}\" y=\"{}\" text-anchor=\"{anchor}\">{}</text>",
            WIDTH * share,
            HEIGHT - 10.0,
            number(from + (to - from) * share)
        );
    }
    svg.push_str("</svg>\n");
    let mut order = known.clone();
    order.sort_by(f64::total_cmp);
    let at = |share: usize| figures(order[(order.len() - 1) * share / 100]);
    let mut caption = if is_spread || shown.len() < known.len() {
        format!("median {}, a tenth above {}, at most {}", at(50), at(90), at(100))
    } else {
        format!("{} in each of {} rows", at(50), count(known.len() as u64))
    };
    if shown.len() < known.len() {
        let _ = write!(caption, "; {} rows are at 0", count((known.len() - shown.len()) as u64));
    }
    if logarithmic {
        caption.push_str("; logarithmic axis");
    }
    Some(format!(
        "<figure>\n<figcaption><b>{what}</b><br>{caption}</figcaption>\n{svg}</figure>\n"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_number_is_in_one_bar() {
        let svg = histogram(&[0.0, 0.5, 1.0, f64::NAN], "x", false).expect("a plot");
        assert_eq!(svg.matches("<rect").count(), 3);
        assert!(svg.contains("median 0.5"));
        let svg = histogram(&[3.0; 7], "x", false).expect("a plot");
        assert!(
            svg.contains("<title>3.00: 7</title>") && svg.contains("3.00 in each of 7 rows"),
            "{svg}"
        );
        let zeros = histogram(&[0.0; 7], "x", false).expect("a plot");
        assert!(!zeros.contains("0.5") && zeros.contains(">0</text>"), "{zeros}");
        let svg = histogram(&[0.0, 1e-6, 1e-2], "x", true).expect("a plot");
        assert!(svg.contains("1 rows are at 0") && svg.contains("logarithmic"));
        assert_eq!(histogram(&[f64::NAN], "x", false), None);
    }
}
