//! Pages of the book as text: their fenced blocks and tags, headings, links; and what is wrong with them before
//! anything runs.
//!
//! A block begins with its language and its tags, with commas:
//!
//! | block | is |
//! | --- | --- |
//! | `console` | run by bash, in the page's folder, after the blocks before it |
//! | `console,full` | run by `./test --full`: it takes more than half a minute |
//! | `console,hours` | begun by `./test --full`, and must not fail within the first seconds |
//! | `console,not-run` | for another machine or another test: [`super::NOT_RUN`] says which |
//! | `…,needs:WHAT` | skipped where that is not there, and says so |
//! | `text,output` | what the block before says; `…` is anything, within a line or for lines, and hides no warning |
//! | `LANGUAGE,file:PATH` | written to that file, for the commands that follow |
//! | `python` | run as a program, or by the tests of the Python package where it needs the package |
//! | `rust` | a documentation test of this package; `no_run`: it is compiled |
//! | `text` | to be read |
//!
//! (`:` and not `=`, since rustdoc takes a block with `=` for none of Rust's.)

use hemicube_tests::scenes::workspace;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::read_to_string;
use std::path::{Component, Path, PathBuf};

/// The folder of pages for developers, which are no chapters.
pub(crate) const DEVELOPERS: &str = "docs/dev/";

/// A page: its path from the repository's root, and what stands in it.
#[derive(Clone, Debug)]
pub(crate) struct Page {
    /// `docs/tour.md`.
    pub(crate) name: String,
    /// Its Markdown.
    pub(crate) text: String,
}

/// A fenced block.
#[derive(Clone, Debug)]
pub(crate) struct Block {
    /// The line that it begins at, from 1.
    pub(crate) line: usize,
    /// The first word after the fence.
    pub(crate) language: String,
    /// The words after it.
    pub(crate) tags: Vec<String>,
    /// Its text.
    pub(crate) text: String,
}

impl Block {
    /// Tells if it has a tag.
    pub(crate) fn is(&self, tag: &str) -> bool {
        self.tags.iter().any(|other| other == tag)
    }

    /// The text after `NAME:`.
    pub(crate) fn value(&self, name: &str) -> Option<&str> {
        self.tags
            .iter()
            .find_map(|tag| tag.strip_prefix(name)?.strip_prefix(':'))
    }

    /// The first line.
    pub(crate) fn first_line(&self) -> &str {
        self.text.lines().next().unwrap_or_default()
    }

    /// Python that needs our package.
    pub(crate) fn needs_package(&self) -> bool {
        self.text.contains(">>> ") || self.text.contains("import hemicube")
    }
}

impl Page {
    /// A page of the repository.
    pub(crate) fn read(name: &str) -> Self {
        let path = workspace().join(name);
        let text = read_to_string(&path).unwrap_or_else(|error| panic!("`{}`: {error}", path.display()));
        let name = name.to_owned();
        Self { name, text }
    }

    /// Tells a page for users from one for developers.
    pub(crate) fn is_for_users(&self) -> bool {
        !self.name.starts_with(DEVELOPERS)
    }

    /// The number of its words, code and output with them.
    pub(crate) fn words(&self) -> usize {
        self.text.split_whitespace().count()
    }

    /// Each line, and whether it is outside of blocks.
    fn lines(&self) -> impl Iterator<Item = (usize, &str, bool)> {
        let mut is_inside = false;
        self.text.lines().zip(1..).map(move |(line, number)| {
            let is_fence = line.trim_start().starts_with("```");
            let is_prose = !is_inside && !is_fence;
            is_inside ^= is_fence;
            (number, line, is_prose)
        })
    }

    /// The blocks in their order.
    pub(crate) fn blocks(&self) -> Vec<Block> {
        let mut blocks = Vec::new();
        let mut open: Option<Block> = None;
        for (line, text, is_prose) in self.lines() {
            let fence = text.trim_start().strip_prefix("```");
            match (&mut open, fence) {
                (Some(_), Some(_)) => blocks.extend(open.take()),
                (Some(block), None) => block.text += &format!("{text}\n"),
                (None, Some(words)) => {
                    let mut words = words.trim().split(',').map(|word| word.trim().to_owned());
                    open = Some(Block {
                        line,
                        language: words.next().unwrap_or_default(),
                        tags: words.collect(),
                        text: String::new(),
                    });
                }
                (None, None) => assert!(is_prose, "{}:{line}: neither in a block nor out of it", self.name),
            }
        }
        assert!(open.is_none(), "{}: a block does not end", self.name);
        blocks
    }

    /// The lines from the last empty one to a block.
    fn paragraph_before(&self, line: usize) -> String {
        let lines: Vec<&str> = self.text.lines().take(line - 1).collect();
        let lines = lines.iter().rev().skip_while(|line| line.is_empty());
        lines.take_while(|line| !line.is_empty()).copied().collect()
    }

    /// The names of its headings in addresses, as mdBook and GitHub make them.
    fn anchors(&self) -> BTreeSet<String> {
        let headings = self
            .lines()
            .filter(|&(_, line, is_prose)| is_prose && line.starts_with('#'));
        headings
            .map(|(_, line, _)| anchor(line.trim_start_matches('#').trim()))
            .collect()
    }

    /// Each link: its line, where it points, and whether it is a picture.
    pub(crate) fn links(&self) -> Vec<(usize, String, bool)> {
        let mut links = Vec::new();
        for (number, line, _) in self.lines().filter(|&(.., is_prose)| is_prose) {
            // Text between backticks is code.
            let prose: String = line.split('`').step_by(2).collect::<Vec<_>>().join("``");
            for (place, _) in prose.match_indices("](") {
                let target = prose[place + 2..].split(')').next().unwrap_or_default();
                let opening = prose[..place].rfind('[').unwrap_or(0);
                let is_picture = prose[..opening].ends_with('!');
                links.push((number, target.to_owned(), is_picture));
            }
        }
        links
    }

    /// The pictures that its own commands make: those beneath `pictures/NAME OF THE PAGE/`.
    pub(crate) fn own_pictures(&self) -> Vec<String> {
        let stem = Path::new(&self.name)
            .file_stem()
            .map(|stem| stem.to_string_lossy().into_owned());
        let folder = format!("pictures/{}/", stem.unwrap_or_default());
        let links = self.links().into_iter().filter(|(.., is_picture)| *is_picture);
        links
            .filter_map(|(_, target, _)| Some(target.strip_prefix(&folder)?.to_owned()))
            .collect()
    }
}

/// The name of a heading in an address.
fn anchor(heading: &str) -> String {
    let kept = heading.chars().filter_map(|c| match c {
        c if c.is_alphanumeric() || c == '_' || c == '-' => Some(c.to_lowercase().next().unwrap_or(c)),
        c if c.is_whitespace() => Some('-'),
        _ => None,
    });
    kept.collect()
}

/// The Markdown files beneath `docs`, from the repository's root.
pub(crate) fn files() -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    let mut folders = vec![workspace().join("docs")];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "md") {
                let name = path.strip_prefix(workspace()).expect("beneath it");
                found.insert(name.to_string_lossy().into_owned());
            }
        }
    }
    found
}

/// The chapters that a table of contents names, from the repository's root.
pub(crate) fn chapters(summary: &Page) -> Vec<String> {
    let links = summary.links().into_iter();
    links.map(|(_, target, _)| format!("docs/{target}")).collect()
}

/// A path without `.` and `..`.
fn plain(path: &Path) -> PathBuf {
    let mut plain = PathBuf::new();
    for part in path.components() {
        match part {
            Component::ParentDir => {
                plain.pop();
            }
            Component::CurDir => {}
            part => plain.push(part),
        }
    }
    plain
}

/// Finds the faults of a table of contents: chapters that are not there, pages that are not in it, and chapters that the
/// first page, `index`, does not link.
pub(crate) fn faults_of_contents(summary: &Page, index: &Page, files: &BTreeSet<String>) -> Vec<String> {
    let chapters = chapters(summary);
    let linked: BTreeSet<String> = index
        .links()
        .into_iter()
        .map(|(_, target, _)| format!("docs/{target}"))
        .collect();
    let missing = chapters.iter().filter(|chapter| !files.contains(*chapter));
    let left_out = files
        .iter()
        .filter(|file| **file != summary.name && !file.starts_with(DEVELOPERS) && !chapters.contains(file));
    let unlinked = chapters
        .iter()
        .filter(|chapter| **chapter != index.name && !linked.contains(*chapter));
    let mut faults: Vec<String> = missing.map(|name| format!("chapter `{name}` is not there")).collect();
    faults.extend(left_out.map(|name| format!("`{name}` is in no chapter")));
    faults.extend(unlinked.map(|name| format!("`{}` does not link `{name}`", index.name)));
    faults
}

/// What only developers know, in a page for users: hashes of commits, tests, packages of the tests.
pub(crate) fn faults_of_words(page: &Page) -> Vec<String> {
    let programs = [
        "promises",
        "program",
        "readers",
        "light_and_heat",
        "backends",
        "outside",
    ];
    let is_hash = |word: &str| {
        let is_hex = word.chars().all(|c| matches!(c, '0'..='9' | 'a'..='f'));
        (7..=12).contains(&word.len())
            && is_hex
            && word.contains(|c: char| c.is_ascii_digit())
            && word.contains(|c: char| c.is_ascii_alphabetic())
    };
    let mut faults = Vec::new();
    for (line, number) in page.text.lines().zip(1..) {
        let words = line
            .split(|c: char| !c.is_alphanumeric() && !"_.".contains(c))
            .map(|word| word.trim_matches('.'));
        let has_test = programs.iter().any(|program| line.contains(&format!("{program}::")));
        let what = match words.into_iter().find(|word| is_hash(word)) {
            Some(hash) => format!("`{hash}`, a commit"),
            None if has_test => "a test".to_owned(),
            None if line.contains("hemicube-tests") => "the package of the tests".to_owned(),
            None => continue,
        };
        faults.push(format!("{}:{number}: names {what}", page.name));
    }
    faults
}

/// The options in a text: words that begin with two dashes.
pub(crate) fn options(text: &str) -> BTreeSet<&str> {
    let words = text.split(|c: char| !c.is_ascii_alphanumeric() && c != '-');
    words.filter(|word| word.len() > 2 && word.starts_with("--")).collect()
}

/// Options in the prose of a page, as code, that no command has.
pub(crate) fn faults_of_options(page: &Page, known: &BTreeSet<&str>) -> Vec<String> {
    let mut faults = Vec::new();
    for (number, line, _) in page.lines().filter(|&(.., is_prose)| is_prose) {
        for code in line.split('`').skip(1).step_by(2).filter(|code| code.starts_with("--")) {
            let unknown = options(code).into_iter().filter(|option| !known.contains(option));
            faults.extend(unknown.map(|option| format!("{}:{number}: no command has `{option}`", page.name)));
        }
    }
    faults
}

/// Links that lead nowhere, in the repository or in the book.
pub(crate) fn faults_of_links(pages: &[Page]) -> Vec<String> {
    let anchors: BTreeMap<&str, BTreeSet<String>> =
        pages.iter().map(|page| (page.name.as_str(), page.anchors())).collect();
    let mut faults = Vec::new();
    for page in pages {
        let folder = Path::new(&page.name).parent().unwrap_or(Path::new(""));
        for (line, target, _) in page.links() {
            if target.starts_with("https://") {
                continue;
            }
            let mut fault = |what: String| faults.push(format!("{}:{line}: `{target}`: {what}", page.name));
            let (path, part) = target.split_once('#').unwrap_or((&target, ""));
            let name = if path.is_empty() {
                page.name.clone()
            } else {
                plain(&folder.join(path)).to_string_lossy().into_owned()
            };
            let of_page = anchors.get(name.as_str());
            if of_page.is_none() && !workspace().join(&name).exists() {
                fault("there is no such file".to_owned());
                continue;
            }
            // mdBook makes `.html` of it, and there is none outside of the book.
            let is_chapter = of_page.is_some() && name.starts_with("docs") && !name.starts_with(DEVELOPERS);
            if name.ends_with(".md") && !is_chapter && folder.starts_with("docs") && page.is_for_users() {
                fault("is no chapter, and the book has no such page".to_owned());
            }
            if !part.is_empty() && !of_page.is_some_and(|anchors| anchors.contains(part)) {
                fault("no heading of that name".to_owned());
            }
        }
    }
    faults
}

/// Packages of the workspace, by the name that Cargo knows them by.
fn packages() -> BTreeMap<String, PathBuf> {
    let mut found = BTreeMap::new();
    let folders = ["", "crates", "crates/backends", "tests/plugins"].map(|folder| workspace().join(folder));
    for folder in folders {
        for entry in std::fs::read_dir(folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            let Ok(manifest) = read_to_string(path.join("Cargo.toml")) else {
                continue;
            };
            let name = manifest
                .lines()
                .find_map(|line| line.strip_prefix("name = \"")?.strip_suffix('"'));
            found.extend(name.map(|name| (name.to_owned(), path.clone())));
        }
    }
    found
}

/// Lists packages, examples and benches that a line which runs Cargo names and the workspace lacks.
fn faults_of_cargo(line: &str) -> Vec<String> {
    let packages = packages();
    let words: Vec<&str> = line.split_whitespace().collect();
    let after = |option: &'static str| {
        let pairs = words.windows(2).filter(move |pair| pair[0] == option);
        pairs.map(|pair| pair[1])
    };
    let mut faults = Vec::new();
    for package in after("-p") {
        let Some(folder) = packages.get(package) else {
            faults.push(format!("there is no package `{package}`"));
            continue;
        };
        for (option, place) in [("--example", "examples"), ("--bench", "benches")] {
            for name in after(option).filter(|name| !folder.join(place).join(format!("{name}.rs")).is_file()) {
                faults.push(format!("package `{package}` has no `{place}/{name}.rs`"));
            }
        }
    }
    faults
}

/// Finds the faults of a page's blocks before any is run: none may be of a kind that nothing runs.
///
/// `not_run` are page, first line and reason of the blocks that are run elsewhere or nowhere; `doctested` and
/// `packaged` the texts in which Rust's and Python's documentation tests name their pages.
pub(crate) fn faults_of_blocks(
    page: &Page,
    not_run: &[(&str, &str, &str)],
    doctested: &str,
    packaged: &str,
) -> Vec<String> {
    let blocks = page.blocks();
    let mut faults = Vec::new();
    for (k, block) in blocks.iter().enumerate() {
        let mut fault = |what: &str| faults.push(format!("{}:{}: {what}", page.name, block.line));
        let allowed: &[&str] = match block.language.as_str() {
            "console" => &["full", "hours", "not-run", "needs:"],
            "text" => &["output", "file:"],
            "rust" => &["no_run", "file:"],
            "c" | "toml" | "json" => &["file:"],
            "python" => &[],
            "" => {
                fault("a block without a language: is it run, or read?");
                continue;
            }
            _ => {
                fault("nothing runs this language");
                continue;
            }
        };
        for tag in &block.tags {
            let is_known = allowed.iter().any(|known| match known.strip_suffix(':') {
                Some(name) => tag
                    .strip_prefix(name)
                    .is_some_and(|value| value.len() > 1 && value.starts_with(':')),
                None => tag == known,
            });
            if !is_known {
                fault(&format!("unknown tag `{tag}`"));
            }
        }
        let is_listed = not_run
            .iter()
            .any(|&(name, line, _)| name == page.name && line == block.first_line());
        if block.language == "console" && block.is("not-run") != is_listed {
            fault("`not-run` and the list of such blocks do not agree");
        }
        let said_before = k.checked_sub(1).and_then(|before| blocks.get(before));
        if block.is("output") && said_before.is_none_or(|before| before.language != "console") {
            fault("output of no command: no `console` block is before it");
        }
        if block.is("output") && block.text.lines().all(|line| line.replace('…', "").trim().is_empty()) {
            fault("output that claims nothing");
        }
        let file = block.value("file");
        let is_used = |name: &str| {
            let stem = Path::new(name)
                .components()
                .next()
                .map(|first| first.as_os_str().to_string_lossy());
            let stem = stem.unwrap_or_default();
            blocks[k..]
                .iter()
                .any(|later| later.language == "console" && later.text.contains(&*stem))
        };
        match (block.language.as_str(), file) {
            ("c" | "toml" | "json", None) => fault("no `file:`: no command reads it"),
            (_, Some(name)) if !is_used(name) => fault("no command after it reads its file"),
            (_, Some(name)) if !page.paragraph_before(block.line).contains(name) => {
                fault("the paragraph before it does not name its file");
            }
            _ => {}
        }
        let named = format!("{}\"", page.name);
        if block.language == "rust" && !doctested.contains(&named) {
            fault("no documentation test includes the page: tests/src/lib.rs");
        }
        if block.language == "python" && block.needs_package() && !packaged.contains(&named) {
            fault("no test of the Python package runs the page: crates/python/tests");
        }
        if block.language == "console" {
            for line in block.text.lines().filter(|line| line.contains("cargo ")) {
                faults_of_cargo(line).iter().for_each(|what| fault(what));
            }
        }
    }
    faults
}

/// Rows of the list of blocks that are not run which no page has.
pub(crate) fn stale(pages: &[Page], not_run: &[(&str, &str, &str)]) -> Vec<String> {
    let has = |&&(name, line, _): &&(&str, &str, &str)| {
        let page = pages.iter().find(|page| page.name == name);
        page.is_some_and(|page| {
            page.blocks()
                .iter()
                .any(|block| block.is("not-run") && block.first_line() == line)
        })
    };
    let stale = not_run.iter().filter(|row| !has(row));
    stale
        .map(|(name, line, _)| format!("{name} has no block `{line}` that is not run"))
        .collect()
}
