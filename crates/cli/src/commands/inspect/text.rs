//! The report of `inspect` for people.

use super::report::{DiagnosisReport, EdgeReport, EnclosureReport, FindingReport, Report};
use crate::advice;
use crate::enclosure;
use crate::escape::shown;
use crate::report::{self, Listing, about, count, counted, duration, figures, percent, size};
use hemicube::diagnose::{FindingKind, Unit};
use hemicube::driver::storage_policy::StoragePolicy;
use hemicube::store::Form;
use hemicube_spatial::whole;

/// Examples shown of each finding; the JSON report has them all.
const EXAMPLES_SHOWN: usize = 3;

/// Columns of a broken sentence.
const WIDTH: usize = 100;

/// The verdict and the forecast, a line a finding, and the scene; with `is_verbose` the worst of each finding, and what
/// the sampled hemicubes saw.
pub(super) fn text(report: &Report, is_verbose: bool) -> String {
    let mut list = Listing::default();
    list.add("verdict", verdict(report));
    add_cost(&mut list, report);
    let mut text = list.text();
    text.push_str(&enclosure_text(&report.enclosure));
    text.push_str(&findings_text(&report.diagnosis, is_verbose));
    text.push('\n');
    let mut list = Listing::default();
    add_scene(&mut list, report);
    add_size(&mut list, report, is_verbose);
    add_patches(&mut list, report, is_verbose);
    text.push_str(&list.text());
    if !is_verbose {
        return text;
    }
    let forecast = &report.forecast;
    text.push_str(&format!(
        "\nFrom the hemicubes of {} (resolution {}, {} a patch):\n",
        counted(forecast.sampled_rows as u64, "random patch"),
        forecast.resolution,
        forecast.samples
    ));
    let mut list = Listing::default();
    add_views(&mut list, report);
    text.push_str(&list.text());
    text.push_str(&slimmest(report));
    text
}

/// What is wrong with the scene, in a line.
fn verdict(report: &Report) -> String {
    let patches = counted(report.patches.count as u64, "patch");
    let enclosure = &report.enclosure;
    let mut wrong = Vec::new();
    if !enclosure.sentences.is_empty() {
        wrong.push("surfaces wound the wrong way".to_owned());
    }
    if !enclosure.leaks_said.is_empty() {
        wrong.push(counted(
            enclosure.enclosure.leaks.len() as u64 + enclosure.enclosure.leaks_more,
            "leak",
        ));
    }
    match report.diagnosis.findings.len() {
        0 => {}
        1 => wrong.push("1 kind of doubtful patch".to_owned()),
        kinds => wrong.push(format!("{kinds} kinds of doubtful patches")),
    }
    if wrong.is_empty() {
        format!("{patches}; nothing found that would spoil form factors")
    } else {
        format!("{patches}; {}", wrong.join(", "))
    }
}

/// Adds the file, its triangles, and the dropped or odd ones among them.
fn add_scene(list: &mut Listing, report: &Report) {
    let scene = &report.scene;
    if let Some(input) = report.inputs.first() {
        list.add("scene", format!("`{}`, {}", input.path, size(input.bytes)));
    }
    list.add(
        "triangles",
        format!(
            "{}, {} two-sided; {}, {}",
            count(scene.triangles_used as u64),
            if scene.two_sided == 0 {
                "none".to_owned()
            } else {
                count(scene.two_sided as u64)
            },
            counted(scene.objects as u64, "object"),
            counted(scene.materials as u64, "material")
        ),
    );
    if report.repair.reversed_duplicates > 0 {
        list.add(
            "back to back",
            format!("{}, kept", counted(report.repair.reversed_duplicates, "triangle")),
        );
    }
    for (what, number) in &report.noted {
        list.add("in the file", format!("{} × {}", count(*number), shown(what)));
    }
    if let Some(crs) = &report.crs {
        list.add("coordinates", format!("in `{}`", shown(crs)));
    }
}

/// Adds extent, unit, area and edges.
fn add_size(list: &mut Listing, report: &Report, is_verbose: bool) {
    let scene = &report.scene;
    if let Some([low, high]) = scene.bounds {
        let extent: Vec<String> = low.iter().zip(high).map(|(low, high)| figures(high - low)).collect();
        let shown = |corner: [f64; 3]| {
            corner
                .map(|c| format!("{c:.6}").trim_end_matches('0').trim_end_matches('.').to_owned())
                .join(" ")
        };
        list.add("size", extent.join(" × "));
        list.add("box", format!("({}) to ({})", shown(low), shown(high)));
    }
    list.add("up", format!("{} ({})", scene.up, scene.up_reason));
    list.add(
        "unit",
        match scene.metres_per_unit {
            Some(metres) => format!("{} m", figures(metres)),
            None => "not given".to_owned(),
        },
    );
    list.add(
        "area",
        format!(
            "{}, triangles from {} to {}",
            figures(scene.area),
            figures(scene.area_min),
            figures(scene.area_max)
        ),
    );
    list.add("edges", edges(&scene.edges, scene.closed));
    if is_verbose && scene.welded_edges.boundary < scene.edges.boundary {
        let cracks = scene.edges.boundary - scene.welded_edges.boundary;
        list.add(
            "",
            format!(
                "{} of the boundary edges are cracks narrower than 1e-7 of the scene",
                count(cracks as u64)
            ),
        );
    }
    list.add(
        "closed objects",
        format!(
            "{} of {}",
            count(scene.closed_objects as u64),
            count(scene.objects as u64)
        ),
    );
    for hint in &scene.hints {
        list.add("note", hint.clone());
    }
}

/// Adds patches and octree.
fn add_patches(list: &mut Listing, report: &Report, is_verbose: bool) {
    let patches = &report.patches;
    list.add(
        "patches",
        format!(
            "{}, area {} in the median, from {} to {}",
            count(patches.count as u64),
            figures(patches.area_median),
            figures(patches.area_min),
            figures(patches.area_max)
        ),
    );
    if !is_verbose {
        return;
    }
    let octree = &report.octree;
    list.add(
        "octree",
        format!(
            "{}, {} deep, {} patches a leaf",
            counted(octree.nodes as u64, "node"),
            counted(octree.levels.into(), "level"),
            figures(octree.surfaces_per_leaf)
        ),
    );
}

/// Adds the statistics of the sampled patches' views.
fn add_views(list: &mut Listing, report: &Report) {
    let (forecast, statistics) = (&report.forecast, &report.statistics);
    list.add(
        "a patch sees",
        format!(
            "{} in the median, {} in the 90th percentile",
            counted(forecast.visible_median, "patch"),
            count(forecast.visible_percentile_90)
        ),
    );
    list.add(
        "occlusion",
        format!(
            "{} of the {} that face it on average are hidden",
            percent(statistics.occlusion),
            about(statistics.facing)
        ),
    );
    list.add(
        "escaped",
        format!("{} of the view leaves the scene", percent(statistics.escaped)),
    );
    list.add(
        "blocked",
        format!(
            "{} of the view is backs of one-sided surfaces",
            percent(statistics.blocked)
        ),
    );
    list.add(
        "nearness",
        format!(
            "half of its view is nearer than {} of its radii; {} patches nearer than 1.5 on average",
            if statistics.nearness > 0.0 {
                figures(statistics.nearness.recip())
            } else {
                "any number".to_owned()
            },
            figures(statistics.near)
        ),
    );
    list.add(
        "culling",
        format!("spares {} of the triangles", percent(forecast.culled)),
    );
}

/// Ratio of the ends of an interval of seconds from which on both are said.
const WIDE: f64 = 1.3;

/// Adds disk, time and memory of all rows.
fn add_cost(list: &mut Listing, report: &Report) {
    let forecast = &report.forecast;
    let (bytes, compact) = (whole::to_u64(forecast.bytes), whole::to_u64(forecast.bytes_compact));
    let keep = StoragePolicy::choose(
        None,
        None,
        u32::try_from(report.patches.count).unwrap_or(u32::MAX),
        None,
    );
    let on_disk = match keep.form {
        Form::Plain | Form::Double => format!("{} on disk ({} with `--form compact`)", size(bytes), size(compact)),
        Form::Compact => format!(
            "less than {} on disk without form factors below {:e} ({} with `--form plain --min-factor 0`)",
            size(compact),
            keep.min_factor,
            size(bytes)
        ),
    };
    if let Some(seconds) = forecast.seconds {
        let device = format!(
            "{} with {}",
            report.backend.name,
            counted(forecast.threads as u64, "thread")
        );
        let memory = forecast
            .memory_bytes
            .map_or_else(String::new, |bytes| format!(", in at most {} of memory", size(bytes)));
        let time = match forecast.seconds_range {
            Some([_, most]) if most < 1.0 => "less than a second".to_owned(),
            Some([least, most]) if most > WIDE * least => format!("{} to {}", duration(least), duration(most)),
            _ => format!("about {}", duration(seconds)),
        };
        list.add("compute", format!("takes {time} on {device}{memory}"));
        if forecast.met_bound {
            let rows = counted(forecast.measured_rows as u64, "row");
            list.add("", format!("measured on {rows} only, for rows like these take long"));
        }
    }
    list.add(
        if forecast.seconds.is_some() { "" } else { "compute" },
        format!("about {} entries, {on_disk}", about(forecast.entries)),
    );
}

/// The slimmest triangles, unless they are among the findings.
fn slimmest(report: &Report) -> String {
    let scene = &report.scene;
    let told = |report: &FindingReport| report.finding.kind == FindingKind::Sliver;
    if !scene.worst.iter().any(|worst| worst.aspect > 20.0) || report.diagnosis.findings.iter().any(told) {
        return String::new();
    }
    let lines = scene.worst.iter().map(|worst| {
        [
            worst.face.to_string(),
            figures(worst.aspect),
            figures(worst.area),
            worst.object.clone(),
        ]
    });
    let table = report::table(["face", "longest edge / height", "area", "object"], lines);
    format!("\nThe slimmest triangles:\n{table}")
}

/// Wrongly wound objects, separate groups, and holes; empty without any.
fn enclosure_text(report: &EnclosureReport) -> String {
    let mut text = String::new();
    if !report.sentences.is_empty() {
        text.push_str("\nWound the wrong way:\n");
        for sentence in &report.sentences {
            let lines = wrapped(sentence, WIDTH - 2);
            text.push_str(&format!("  {}\n", lines.join("\n    ")));
        }
    }
    let found = &report.enclosure;
    if let Some(sentence) = enclosure::of_groups(found).filter(|_| !report.is_oriented) {
        text.push_str(&format!(
            "\nApart:\n  {}\n",
            wrapped(&sentence, WIDTH - 2).join("\n    ")
        ));
    }
    if !report.leaks_said.is_empty() {
        text.push_str(&format!(
            "\nLeaks: {} of what escapes leaves through {}:\n",
            percent(found.leaking),
            counted(found.leaks.len() as u64 + found.leaks_more, "hole")
        ));
        for leak in &report.leaks_said {
            text.push_str(&format!("  {leak}\n"));
        }
        if found.leaks_more > 0 {
            text.push_str(&format!("  and {}\n", counted(found.leaks_more, "smaller hole")));
        }
    }
    text
}

/// Defects that spoil form factors; empty without any.
fn findings_text(diagnosis: &DiagnosisReport, is_verbose: bool) -> String {
    if diagnosis.findings.is_empty() {
        return String::new();
    }
    if !is_verbose {
        let mut list = Listing::default();
        for report in &diagnosis.findings {
            list.add(&format!("  {}", report.finding.kind.name()), sentence(report));
        }
        return format!(
            "\nDoubtful patches (`-v` shows the worst of each, and what helps):\n{}",
            list.text()
        );
    }
    let findings: String = diagnosis.findings.iter().map(finding_text).collect();
    format!("\nDoubtful patches:\n{findings}")
}

/// How many there are of a finding, and what is wrong with them.
fn sentence(report: &FindingReport) -> String {
    let finding = &report.finding;
    let number = whole::to_u64(finding.estimate.round());
    format!(
        "{}{} {}",
        if finding.is_estimate() { "about " } else { "" },
        pairs(finding.kind, number, finding.is_estimate()),
        report.meaning,
    )
}

/// A finding: how many, the worst examples, and the next step.
fn finding_text(report: &FindingReport) -> String {
    let finding = &report.finding;
    let kind = finding.kind;
    let mut list = Listing::default();
    if finding.is_estimate() {
        list.add(
            "    from",
            format!(
                "{} found at {} of {} {}, sampled",
                count(finding.count),
                count(finding.examined),
                count(finding.population),
                kind.population()
            ),
        );
    }
    if let (Some(total), Some(measure)) = (finding.total, kind.total()) {
        let total = match measure.unit {
            Unit::Fraction => percent(total),
            _ => figures(total),
        };
        list.add("    in all", format!("{total} {}", measure.name));
    }
    let examples = finding.examples.iter().zip(&report.objects).take(EXAMPLES_SHOWN);
    for (number, (example, places)) in examples.enumerate() {
        let mut who = format!("patch {}", example.patch.0);
        if let Some(other) = example.other {
            who.push_str(&format!(" with {}", other.0));
        }
        let mut names: Vec<&str> = places.iter().map(|place| place.object.as_str()).collect();
        names.dedup();
        names.retain(|name| !name.is_empty());
        if !names.is_empty() {
            who.push_str(&format!(" (`{}`)", names.join("`, `")));
        }
        let at: Vec<String> = example.at.to_array().iter().map(|&c| coordinate(c)).collect();
        list.add(
            if number == 0 { "    worst" } else { "" },
            format!("{who} at ({}): {}", at.join(" "), measured(example.value, report)),
        );
    }
    let next = match advice::of_finding(&finding.helps) {
        options if options.is_empty() => finding.next.clone(),
        options => format!("{} ({options})", finding.next),
    };
    for (number, line) in wrapped(&next, WIDTH - 11).into_iter().enumerate() {
        list.add(if number == 0 { "    try" } else { "" }, line);
    }
    format!("\n  {}: {}\n{}", kind.name(), sentence(report), list.text())
}

/// Breaks a sentence into lines of at most `width` characters, except for longer words.
fn wrapped(sentence: &str, width: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in sentence.split(' ') {
        match lines.last_mut() {
            Some(line) if line.chars().count() + 1 + word.chars().count() <= width => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

/// Number of findings with their noun, the number rounded if it is an estimate.
fn pairs(kind: FindingKind, number: u64, is_estimate: bool) -> String {
    let shown = if is_estimate {
        about(number as f64)
    } else {
        count(number)
    };
    // `counted` knows the plurals of single words.
    let (first, rest) = kind.counted().split_once(' ').unwrap_or((kind.counted(), ""));
    let plural = counted(number, first);
    let word = plural.rsplit(' ').next().unwrap_or(first);
    format!("{shown} {word} {rest}").trim_end().to_owned()
}

fn measured(value: f64, report: &FindingReport) -> String {
    match report.unit {
        Unit::Fraction => format!("{} {}", percent(value), report.measure),
        Unit::Degrees => format!("{} by {}°", report.measure, figures(value)),
        _ => format!("{} {}", report.measure, figures(value)),
    }
}

fn coordinate(value: f64) -> String {
    let text = format!("{value:.3}");
    if value != 0.0 && value.abs() < 0.1 {
        figures(value)
    } else {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    }
}

fn edges(edges: &EdgeReport, closed: bool) -> String {
    if closed {
        return format!("{}: the surface is closed", count(edges.count as u64));
    }
    format!(
        "{}: {} boundary, {} non-manifold, {} inconsistently wound",
        count(edges.count as u64),
        count(edges.boundary as u64),
        count(edges.non_manifold as u64),
        count(edges.inconsistent as u64)
    )
}
