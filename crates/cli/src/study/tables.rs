//! The study as Markdown: the thesis's tables, each cell with its number of rows.

use crate::report::{about, count, duration, figures, percent, size};
use crate::study::plots::times;
use crate::study::results::{Cell, Course, Rate, Results};
use crate::study::scenes::StudyScene;
use crate::study::ways::{FLAT, FOUND_CULLING, FOUND_PARAMETERS, ORIGINAL, OURS, THESIS, Target, ways};

/// Octree levels and least patches tried.
pub(super) struct Grid {
    pub(super) levels: Vec<u32>,
    pub(super) least: Vec<u32>,
}

/// Input of the tables.
pub(super) struct Study<'a> {
    pub(super) results: &'a Results,
    pub(super) scenes: &'a [StudyScene],
    pub(super) targets: &'a [Target],
    pub(super) grid: &'a dyn Fn(&StudyScene) -> Option<Grid>,
}

/// A table of Markdown.
fn table(headings: &[&str], rows: &[Vec<String>]) -> String {
    let line = |cells: &mut dyn Iterator<Item = &str>| format!("| {} |\n", cells.collect::<Vec<_>>().join(" | "));
    let mut text = line(&mut headings.iter().copied());
    text.push_str(&line(&mut headings.iter().map(|_| "---")));
    for row in rows {
        text.push_str(&line(&mut row.iter().map(String::as_str)));
    }
    text
}

const NOTHING: &str = "—";

fn cell_of(rate: Option<&Rate>) -> String {
    rate.map_or_else(|| NOTHING.to_owned(), |rate| figures(rate.milliseconds))
}

fn gain(before: Option<&Rate>, after: Option<&Rate>) -> String {
    match (before, after) {
        (Some(before), Some(after)) => times(before.milliseconds / after.milliseconds),
        _ => NOTHING.to_owned(),
    }
}

fn measured(rate: &Rate) -> String {
    format!("{} / {}", count(rate.rows), count(rate.patches))
}

impl<'a> Study<'a> {
    pub(super) fn rate(&self, scene: &StudyScene, target: &Target, way: &str) -> Option<&'a Rate> {
        self.results.rate(&scene.key, &target.name, way)
    }

    /// Every scene and backend with results.
    fn pairs(&self) -> impl Iterator<Item = (&'a StudyScene, &'a Target, &'a Rate)> + '_ {
        let of_scene = move |scene: &'a StudyScene| {
            let rate = move |target: &'a Target| Some((scene, target, self.rate(scene, target, ORIGINAL)?));
            self.targets.iter().filter_map(rate)
        };
        self.scenes.iter().flat_map(of_scene)
    }

    /// Parameters tried with the thesis's way, and their times.
    pub(super) fn tried(&self, scene: &StudyScene, target: &Target) -> Vec<(u32, u32, &'a Rate)> {
        let Some(grid) = (self.grid)(scene) else {
            return Vec::new();
        };
        let pairs = grid
            .levels
            .iter()
            .flat_map(|&l| grid.least.iter().map(move |&m| (l, m)));
        pairs
            .filter_map(|(l, m)| Some((l, m, self.rate(scene, target, &format!("{THESIS} {l}/{m}"))?)))
            .collect()
    }

    /// Table 4.6, the first that a newcomer looks at.
    pub(super) fn algorithms(&self) -> String {
        let rows: Vec<Vec<String>> = self
            .pairs()
            .map(|(scene, target, original)| {
                let (thesis, ours) = (self.rate(scene, target, THESIS), self.rate(scene, target, OURS));
                let all = ours.map_or_else(
                    || NOTHING.to_owned(),
                    |ours| duration(1e-3 * ours.milliseconds * ours.patches as f64),
                );
                vec![
                    scene.title.clone(),
                    count(original.patches),
                    figures(original.patches as f64 / original.seen.max(1e-9)),
                    target.name.clone(),
                    cell_of(Some(original)),
                    cell_of(thesis),
                    gain(Some(original), thesis),
                    cell_of(ours),
                    gain(Some(original), ours),
                    all,
                    measured(original),
                ]
            })
            .collect();
        let headings = [
            "scene",
            "patches",
            "occlusion",
            "backend",
            "original, ms a row",
            "thesis",
            "gain",
            "ours",
            "gain",
            "ours, all rows",
            "rows measured / in all",
        ];
        table(&headings, &rows)
    }

    /// Tables 4.3 to 4.5: levels of the octree and least patches of a query.
    pub(super) fn parameters(&self) -> String {
        let mut text = String::new();
        for (scene, target, original) in self.pairs() {
            let tried = self.tried(scene, target);
            let Some(grid) = (self.grid)(scene).filter(|_| !tried.is_empty()) else {
                continue;
            };
            let best = tried
                .iter()
                .map(|(_, _, rate)| rate.milliseconds)
                .fold(f64::INFINITY, f64::min);
            let mut headings = vec!["levels \\ least patches".to_owned()];
            headings.extend(grid.least.iter().map(|&m| count(u64::from(m))));
            let rows: Vec<Vec<String>> = grid
                .levels
                .iter()
                .map(|&l| {
                    let cell = |m: u32| match tried.iter().find(|(level, least, _)| (*level, *least) == (l, m)) {
                        None => NOTHING.to_owned(),
                        Some((_, _, rate)) => {
                            let text = format!(
                                "{} ({})",
                                figures(rate.milliseconds),
                                times(original.milliseconds / rate.milliseconds)
                            );
                            if rate.milliseconds <= best {
                                format!("**{text}**")
                            } else {
                                text
                            }
                        }
                    };
                    std::iter::once(l.to_string())
                        .chain(grid.least.iter().map(|&m| cell(m)))
                        .collect()
                })
                .collect();
            text.push_str(&format!(
                "\n{}, `{}`: ms a row and gain over *original* ({} ms); rows {}\n\n",
                scene.title,
                target.name,
                figures(original.milliseconds),
                measured(original)
            ));
            text.push_str(&table(&headings.iter().map(String::as_str).collect::<Vec<_>>(), &rows));
        }
        text
    }

    /// Findings of each backend, beside the best way tried.
    pub(super) fn found(&self) -> String {
        let mut rows = Vec::new();
        for (scene, target, _) in self.pairs() {
            for finding in [FOUND_PARAMETERS, FOUND_CULLING] {
                let Some(choice) = self.results.choice(&scene.key, &target.name, finding) else {
                    continue;
                };
                let Some((name, best)) = choice.best() else { continue };
                rows.push(vec![
                    scene.title.clone(),
                    target.name.clone(),
                    choice.what.clone(),
                    format!("{} ({name})", figures(best)),
                    figures(choice.found_milliseconds),
                    times(choice.found_milliseconds / best),
                    choice.others.len().to_string(),
                    format!("{} by {}", count(choice.rows), count(choice.neighbours)),
                ]);
            }
        }
        if rows.is_empty() {
            return String::new();
        }
        table(
            &[
                "scene",
                "backend",
                "what is found",
                "best of table, ms",
                "found, ms",
                "found / best",
                "of table, measured anew",
                "rows, neighbours",
            ],
            &rows,
        )
    }

    /// Tables 4.7 and 4.8: without the octree, and its speedup.
    pub(super) fn octree(&self) -> String {
        let rows: Vec<Vec<String>> = self
            .pairs()
            .map(|(scene, target, original)| {
                // The built-in backend has nothing to bring over: without its tree it is the original.
                let flat = if target.is_built_in() {
                    Some(original)
                } else {
                    self.rate(scene, target, FLAT)
                };
                let thesis = self
                    .tried(scene, target)
                    .into_iter()
                    .map(|(_, _, rate)| rate)
                    .chain(self.rate(scene, target, THESIS))
                    .min_by(|a, b| a.milliseconds.total_cmp(&b.milliseconds));
                let ours = self.rate(scene, target, OURS);
                vec![
                    scene.title.clone(),
                    target.name.clone(),
                    cell_of(Some(original)),
                    cell_of(flat),
                    gain(Some(original), flat),
                    cell_of(thesis),
                    gain(flat, thesis),
                    cell_of(ours),
                    gain(flat, ours),
                    measured(original),
                ]
            })
            .collect();
        let headings = [
            "scene",
            "backend",
            "original, ms a row",
            "without octree",
            "gain (4.7)",
            "octree, best parameters",
            "gain of the octree (4.8)",
            "ours",
            "gain over without",
            "rows measured / in all",
        ];
        table(&headings, &rows)
    }

    /// Section 4.3.1: load of processors, and traffic over the bus.
    pub(super) fn processors(&self) -> String {
        let mut rows = Vec::new();
        for (scene, target, _) in self.pairs() {
            for way in [ORIGINAL, THESIS, OURS] {
                let Some(rate) = self.rate(scene, target, way) else {
                    continue;
                };
                rows.push(vec![
                    scene.title.clone(),
                    target.name.clone(),
                    way.to_owned(),
                    figures(rate.processors),
                    figures(rate.wall_milliseconds),
                    about(rate.triangles),
                    figures(rate.nodes_tested),
                    figures(rate.nodes_hidden),
                    figures(rate.queries),
                    about(rate.bytes_read_back),
                    duration(rate.load_seconds),
                ]);
            }
        }
        let headings = [
            "scene",
            "backend",
            "way",
            "processors busy",
            "wall, ms a row",
            "triangles drawn",
            "nodes tested",
            "hidden",
            "queries",
            "bytes back",
            "loading",
        ];
        table(&headings, &rows)
    }

    /// Watched whole runs.
    pub(super) fn runs(&self) -> Vec<(String, &'a StudyScene, &'a Course)> {
        let mut runs = Vec::new();
        for scene in self.scenes {
            for target in self.targets {
                for way in [ORIGINAL, THESIS, OURS] {
                    if let Some(Cell::Course(course)) =
                        self.results.get(&[&scene.key, &target.name, &format!("run {way}")])
                    {
                        runs.push((format!("{}: {way} on {}", scene.title, target.name), scene, course));
                    }
                }
            }
        }
        runs
    }

    /// Figures 4.7 and 4.8 in numbers.
    pub(super) fn memory(&self) -> String {
        let rows: Vec<Vec<String>> = self
            .runs()
            .iter()
            .map(|(name, _, run)| {
                vec![
                    name.clone(),
                    size(run.peak_bytes),
                    size(run.matrix_bytes),
                    duration(run.seconds),
                    figures(run.processor_seconds / run.seconds.max(1e-9)),
                    format!("{} / {}", count(run.rows), count(run.patches)),
                ]
            })
            .collect();
        let headings = [
            "run",
            "most memory",
            "matrix on disk",
            "wall",
            "processors busy",
            "rows computed / in all",
        ];
        table(&headings, &rows)
    }

    /// Table 4.9: distances. Between two algorithms of one backend they must be 0.
    pub(super) fn distances(&self) -> String {
        let share = |value: f64| if value == 0.0 { "0".to_owned() } else { figures(value) };
        let mut rows = Vec::new();
        for (scene, target, original) in self.pairs() {
            let of = |way: &str| {
                self.rate(scene, target, way)
                    .map_or_else(|| NOTHING.to_owned(), |r| share(r.from_original))
            };
            rows.push(vec![
                scene.title.clone(),
                target.name.clone(),
                of(THESIS),
                of(OURS),
                share(original.from_built_in),
                measured(original),
            ]);
        }
        let headings = [
            "scene",
            "backend",
            "thesis from original",
            "ours from original",
            "original from the built-in backend",
            "rows measured / in all",
        ];
        table(&headings, &rows)
    }

    /// Error against rays: comparing hemicubes of one kind with each other never shows it.
    pub(super) fn errors(&self) -> String {
        let mut rows = Vec::new();
        for scene in self.scenes {
            let Some(Cell::Accuracy(accuracy)) = self.results.get(&[&scene.key, "cpu", "error"]) else {
                continue;
            };
            let show = |name: &str| {
                let point = accuracy.points.iter().find(|point| point.name == name);
                point.map_or_else(
                    || NOTHING.to_owned(),
                    |p| {
                        let bound = if p.error < 0.5 * p.high { "< " } else { "" };
                        let error = if p.error < 0.5 * p.high { p.high } else { p.error };
                        format!("{bound}{} at {} ms", percent(error), figures(p.milliseconds))
                    },
                )
            };
            rows.push(vec![
                scene.title.clone(),
                show("pixel K=1 N=128"),
                show("pixel K=1 N=512"),
                show("pixel K=16 N=128"),
                show("tolerance 2%"),
                show("tolerance 1%"),
                show("tolerance 0.1%"),
                percent(accuracy.noise),
                format!("{} / {}", count(accuracy.rows), count(accuracy.patches)),
            ]);
        }
        let headings = [
            "scene",
            "pixels N = 128 (original, thesis)",
            "pixels N = 512",
            "pixels, 16 hemicubes a patch",
            "ours: tolerance 2 %, the default",
            "ours: tolerance 1 %",
            "ours: tolerance 0.1 %",
            "noise of the reference",
            "rows measured / in all",
        ];
        table(&headings, &rows)
    }

    /// Failed ways, and the reasons.
    pub(super) fn failures(&self) -> Vec<String> {
        let mut lines = Vec::new();
        for scene in self.scenes {
            for target in self.targets {
                let plain = ways(target, true).into_iter().map(|way| way.key());
                let runs = [ORIGINAL, THESIS, OURS].map(|way| format!("run {way}"));
                let found = [FOUND_PARAMETERS, FOUND_CULLING].map(str::to_owned);
                for way in plain.chain(runs).chain(found) {
                    if let Some(Cell::None(reason)) = self.results.get(&[&scene.key, &target.name, &way]) {
                        lines.push(format!("{}, `{}`, {way}: {reason}", scene.title, target.name));
                    }
                }
            }
        }
        lines
    }
}
