//! The page: its sections and their order. Its style is in `page.css`, its viewer in `viewer/`.
//!
//! No template crate, because nearly all of the page is fixed text or the program's own, and [`html`] escapes the few
//! names from files.

use super::blocks::{Blocks, Column};
use super::columns::{Columns, Field};
use super::geometry::Bounds;
use super::plot::histogram;
use super::rows::Packed;
use super::worst::Worst;
use crate::commands::check::{Sentence, facts, groups, name, sentences, word};
use crate::picture::sparsity::Sparsity;
use crate::prepare::axis_name;
use crate::report::{count, counted, figures, percent};
use anyhow::{Context, Result};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use hemicube::analysis::check::CheckReport;
use hemicube::analysis::check::verdict::State;
use hemicube::store::Store;
use hemicube_scene::Axis;
use serde::Serialize;
use serde_json::Value;
use std::fmt::Write;

/// Bundled from `viewer/src` and three.js by `scripts/viewer.sh`, and committed, so that the program is built without
/// Node.
const VIEWER: &str = include_str!("../../../viewer/viewer.js");
const THIRD_PARTY: &str = include_str!("../../../viewer/THIRD_PARTY.txt");
const STYLE: &str = include_str!("page.css");

/// Forbids loading anything, whatever a name contains.
const POLICY: &str = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:";

/// Content of a page.
pub(super) struct Page<'a> {
    pub(super) store: &'a Store,
    pub(super) checked: &'a CheckReport,
    pub(super) worst: Vec<Worst>,
    pub(super) columns: &'a Columns,
    pub(super) sparsity: &'a Sparsity,
    pub(super) bounds: Bounds,
    pub(super) up: Axis,
    pub(super) packed: Option<Packed>,
    /// Number of triangles, where patches are several; block `patch-of` has the patch of each.
    pub(super) elements: Option<usize>,
}

/// Description of the data, for the viewer.
#[derive(Serialize)]
struct Head<'a> {
    patches: u32,
    low: [f64; 3],
    high: [f64; 3],
    up: &'static str,
    objects: &'a [String],
    materials: &'a [String],
    columns: &'a [Column],
    fields: &'a [Field],
    rows: Option<Packed>,
    #[serde(skip_serializing_if = "Option::is_none")]
    elements: Option<usize>,
}

/// Escapes text for HTML, attributes included.
fn html(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

fn definitions<'a>(lines: impl Iterator<Item = (&'a str, &'a str)>) -> String {
    let lines: String = lines
        .map(|(label, value)| format!("<dt>{}</dt><dd>{}</dd>\n", html(label), html(value)))
        .collect();
    format!("<dl>\n{lines}</dl>\n")
}

/// The class of a state in the page's style.
fn class(state: State) -> &'static str {
    match state {
        State::Ok => "ok",
        State::Doubtful | State::Unfinished => "doubtful",
        State::Failed => "failed",
    }
}

/// The settings, one a line; tables within tables by their names with a dot.
fn settings(value: &Value, name: &str, lines: &mut Vec<(String, String)>) {
    match value {
        Value::Object(fields) => {
            for (key, value) in fields {
                let name = if name.is_empty() {
                    key.clone()
                } else {
                    format!("{name}.{key}")
                };
                settings(value, &name, lines);
            }
        }
        Value::Array(values) if values.is_empty() => lines.push((name.to_owned(), "none named".to_owned())),
        Value::Null => {}
        Value::String(text) => lines.push((name.to_owned(), text.clone())),
        other => lines.push((name.to_owned(), other.to_string())),
    }
}

impl Page<'_> {
    /// The whole page.
    ///
    /// # Errors
    /// When the picture of the matrix cannot be encoded.
    pub(super) fn html(&self, blocks: &Blocks) -> Result<String> {
        let manifest = self.store.manifest();
        let title = format!("Form factors of {}", html(&manifest.scene.file));
        let mut page = String::with_capacity(blocks.html.len() + VIEWER.len() + (1 << 20));
        let _ = write!(
            page,
            "<!doctype html>\n<html lang=\"en\" data-theme=\"light\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <meta name=\"generator\" content=\"hemicube {}\">\n<title>{title}</title>\n\
             <link rel=\"icon\" href=\"data:,\">\n<style>\n{STYLE}</style>\n</head>\n<body>\n\
             <header><h1>{title}</h1><button type=\"button\" id=\"theme\" aria-label=\"light or dark \
             page\">Dark</button></header>\n\
             <main>\n",
            env!("CARGO_PKG_VERSION"),
        );
        page.push_str(&self.summary());
        page.push_str(&self.view());
        page.push_str(&self.checks());
        page.push_str(&self.plots()?);
        page.push_str(&self.worst_rows());
        page.push_str(&self.meaning());
        page.push_str(&self.settings());
        page.push_str(&self.about());
        page.push_str("</main>\n");
        let head = Head {
            patches: manifest.patch_count,
            low: self.bounds.low.to_array(),
            high: self.bounds.high.to_array(),
            up: axis_name(self.up),
            objects: &manifest.objects,
            materials: &manifest.materials,
            columns: &blocks.columns,
            fields: &self.columns.fields,
            rows: self.packed,
            elements: self.elements,
        };
        // The end of a script in a name must not end this one.
        let head = serde_json::to_string(&head)
            .context("the page's head is no JSON")?
            .replace('<', "\\u003c");
        let _ = writeln!(page, "<script type=\"application/json\" id=\"head\">{head}</script>");
        page.push_str(&blocks.html);
        let _ = write!(page, "<script type=\"module\">{VIEWER}</script>\n</body>\n</html>\n");
        Ok(page)
    }

    fn summary(&self) -> String {
        let (manifest, found) = (self.store.manifest(), self.checked);
        let mut cards = vec![
            (count(manifest.patch_count.into()), "patches".to_owned()),
            (count(found.entries), {
                let cells = f64::from(manifest.patch_count).powi(2);
                format!("entries, {} of a full matrix's", percent(found.entries as f64 / cells))
            }),
            (
                count(found.entries_per_row.median),
                "patches seen, in the median".to_owned(),
            ),
            (percent(found.escaped), "escapes, on average".to_owned()),
        ];
        if found.blocked > 0.0 {
            cards.push((percent(found.blocked), "is blocked by backs".to_owned()));
        }
        let mut text = "<section aria-label=\"Summary\" class=\"cards\">\n".to_owned();
        for Sentence { subject, state, what } in sentences(found) {
            let _ = writeln!(
                text,
                "<div class=\"card {}\"><b>{subject}: {}</b><span>{}; <a href=\"#checks\">checks</a></span></div>",
                class(state),
                word(state),
                html(&what)
            );
        }
        for (number, what) in cards {
            let _ = writeln!(text, "<div class=\"card\"><b>{number}</b><span>{what}</span></div>");
        }
        text.push_str("</section>\n");
        text
    }

    fn view(&self) -> String {
        let rows = match self.packed {
            Some(packed) => {
                let entries = packed.entries as u64;
                let which = if entries >= self.checked.entries_per_row.max {
                    "all entries".to_owned()
                } else {
                    format!("the largest {} (the matrix has all)", counted(entries, "entry"))
                };
                format!(
                    "Of each row the page has {which} and the sums to the {} objects that most of it goes to.",
                    packed.objects
                )
            }
            None => "The page has no rows: the matrix has too many patches for one page.".to_owned(),
        };
        format!(
            include_str!("view.html"),
            rows = rows,
            last = self.store.patch_count().saturating_sub(1),
            step = figures(self.bounds.step() / 2.0),
        )
    }

    fn checks(&self) -> String {
        let mut rows = String::new();
        for group in groups(self.checked) {
            let class = match group.state {
                "ok" => "ok",
                "FAILED" => "failed",
                "DOUBT" => "doubtful",
                _ => "measured",
            };
            let state = if group.state == "-" { "measured" } else { group.state };
            let _ = writeln!(
                rows,
                "<tr><th scope=\"row\">{}</th><td><span class=\"state {class}\">{state}</span></td><td>{}</td></tr>",
                group.name,
                html(&group.what)
            );
        }
        let mut text = format!(
            "<section aria-labelledby=\"checks\">\n<h2 id=\"checks\">Checks</h2>\n<div class=\"scroll\"><table>\n\
             <thead><tr><th scope=\"col\">check</th><th scope=\"col\">state</th><th scope=\"col\">what holds, and its \
             bound</th></tr></thead>\n\
             <tbody>\n{rows}</tbody></table></div>\n"
        );
        // Files by their names in the store: the directory is nobody else's business.
        let directory = format!("{}{}", self.checked.store.display(), std::path::MAIN_SEPARATOR);
        for failure in &self.checked.failures {
            let _ = writeln!(
                text,
                "<p class=\"failed\"><b>{} failed</b> in {}, the first: {}</p>",
                name(failure.check),
                counted(failure.count, "case"),
                html(&failure.first.replace(&directory, ""))
            );
        }
        text.push_str("</section>\n");
        text
    }

    fn plots(&self) -> Result<String> {
        let mut text =
            "<section aria-labelledby=\"plots\">\n<h2 id=\"plots\">How rows are spread</h2>\n<div class=\"plots\">\n"
                .to_owned();
        let of = |key: &str| {
            let found = self.columns.numbers.iter().find(|(name, _)| name == key);
            found.map_or(&[][..], |(_, numbers)| numbers)
        };
        for (key, what, logarithmic) in [
            ("row_sum", "Sum of the form factors of a row", false),
            ("seen", "Entries of a row", false),
            ("escaped", "Escaped fraction", false),
            ("sky", "Sky view factor", false),
            ("closure", "Closure error", true),
            ("error", "Expected error", true),
        ] {
            if let Some(plot) = histogram(of(key), what, logarithmic) {
                text.push_str(&plot);
            }
        }
        let picture = self.sparsity.picture((400 / self.sparsity.cells.max(1)).max(1));
        let patches = f64::from(self.store.patch_count());
        let _ = write!(
            text,
            "<figure>\n<figcaption><b>Where the matrix has entries</b><br>rows down, columns across, in the order of \
             the work (neighbours side by side), {} patches a cell; from few (dark) to all (yellow)</figcaption>\n\
             <img alt=\"The filled cells of the matrix\" \
             src=\"data:image/png;base64,{}\">\n</figure>\n</div>\n</section>\n",
            figures(patches / self.sparsity.cells as f64),
            BASE64.encode(picture.png(false)?)
        );
        Ok(text)
    }

    fn worst_rows(&self) -> String {
        if self.worst.is_empty() {
            return String::new();
        }
        let mut text =
            "<section aria-labelledby=\"worst\">\n<h2 id=\"worst\">The worst rows</h2>\n<div class=\"tables\">\n"
                .to_owned();
        for table in &self.worst {
            let _ = write!(
                text,
                "<div><h3>{}</h3>\n<div class=\"scroll\"><table><thead><tr>",
                table.heading
            );
            for column in &table.columns {
                let _ = write!(text, "<th scope=\"col\">{column}</th>");
            }
            text.push_str("</tr></thead>\n<tbody>\n");
            for (patch, facts) in &table.rows {
                let _ = write!(
                    text,
                    "<tr><td><button type=\"button\" class=\"patch\" data-patch=\"{patch}\" \
                     aria-label=\"select patch {patch}\">{}</button></td>",
                    count((*patch).into())
                );
                for fact in facts {
                    let _ = write!(text, "<td>{}</td>", html(fact));
                }
                text.push_str("</tr>\n");
            }
            text.push_str("</tbody></table></div></div>\n");
        }
        text.push_str("</div>\n</section>\n");
        text
    }

    fn meaning(&self) -> String {
        let lines = [
            (
                "form factor F_ij",
                "of what leaves patch i evenly in all directions, the fraction that reaches patch j directly",
            ),
            (
                "row",
                "the form factors from one patch; with what escapes and what is blocked they sum to 1",
            ),
            ("escaped", "what leaves the scene: it meets no surface"),
            (
                "blocked",
                "what ends on the back of a one-sided surface: a wrong winding, an open model, or a patch within a \
                 solid",
            ),
            (
                "sky view factor",
                "what of the escaped part goes up to the sky; the rest goes below the horizon",
            ),
            (
                "closure error",
                "how far a row's sum and losses are from 1: where form factors are sums of pixels it is rounding; \
                 where they are closed forms it is a measure of their error",
            ),
            (
                "reciprocity",
                "A_i F_ij and A_j F_ji are the same quantity, found from either side; how far they differ is a second, \
                 independent measure",
            ),
            (
                "expected error",
                "the square root of the expected sum of squared errors of a row's form factors, by rays drawn while \
                 it was computed",
            ),
        ];
        format!(
            "<section aria-labelledby=\"meaning\">\n<h2 id=\"meaning\">What the numbers mean</h2>\n{}</section>\n",
            definitions(lines.into_iter())
        )
    }

    fn settings(&self) -> String {
        let manifest = self.store.manifest();
        let mut lines = Vec::new();
        settings(&manifest.settings, "", &mut lines);
        lines.push((
            "engine".to_owned(),
            format!("{} ({})", manifest.backend.name, manifest.backend.version),
        ));
        lines.push(("computed by".to_owned(), format!("hemicube {}", manifest.program)));
        lines.push(("hash of the settings".to_owned(), manifest.settings_hash.clone()));
        lines.push(("hash of the scene".to_owned(), manifest.scene.blake3.clone()));
        format!(
            "<section aria-labelledby=\"settings\">\n<h2 id=\"settings\">The matrix and how it was \
             computed</h2>\n<div class=\"tables\">\n<div>{}</div>\n<div>{}</div>\n</div>\n</section>\n",
            definitions(facts(self.checked, self.store, false).lines()),
            definitions(lines.iter().map(|(label, value)| (label.as_str(), value.as_str())))
        )
    }

    fn about(&self) -> String {
        format!(
            "<section aria-labelledby=\"about\">\n<h2 id=\"about\">This page</h2>\n<p>Written by <code>hemicube \
             report</code> {}. Everything is in this one file; it loads nothing and sends nothing.</p>\n\
             <details><summary>Licence of what it is shown with</summary><pre>{}</pre></details>\n</section>\n",
            env!("CARGO_PKG_VERSION"),
            html(THIRD_PARTY)
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_end_no_element() {
        assert_eq!(html("<b>&\"</b>"), "&lt;b&gt;&amp;&quot;&lt;/b&gt;");
        assert!(!VIEWER.contains("</script"), "the bundle would end its own element");
    }

    #[test]
    fn settings_are_one_a_line() {
        let value = serde_json::json!({ "a": { "b": 1 }, "c": "x", "d": [], "e": null });
        let mut lines = Vec::new();
        settings(&value, "", &mut lines);
        let lines: Vec<String> = lines.iter().map(|(key, value)| format!("{key}={value}")).collect();
        assert_eq!(lines, ["a.b=1", "c=x", "d=none named"]);
    }
}
