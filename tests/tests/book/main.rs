//! The book, `docs/SUMMARY.md` and its chapters, the README, and the pages for developers in `docs/dev`: every command
//! and every piece of code is run, output that stands beside a command is all that it says but for `…`, links lead
//! somewhere, and pictures of a page are those that its commands make.
//!
//! Each page has a test, which runs what takes seconds, and one more for `./test --full`. `BLESS=1` writes outputs and
//! pictures as they are now into the pages, and the page of commands.

#![cfg(unix)]

mod page;
mod run;

use hemicube_tests::scenes::{program, skip, workspace};
use page::{
    DEVELOPERS, Page, chapters, faults_of_blocks, faults_of_contents, faults_of_links, faults_of_options,
    faults_of_words, files, options, stale,
};
use run::{Extent, Folder, same_picture, says, updated};
use std::fs::read_to_string;
use std::path::Path;
use std::process::{Command, Output};

/// Blocks that are not run here: page, first line, and who runs it instead or why nobody can.
const NOT_RUN: &[(&str, &str, &str)] = &[
    ("README.md", "./test", "it is what runs this"),
    (
        "README.md",
        "sudo apt install ./hemicube_0.1.0_amd64.deb",
        "program::distribution unpacks the package and runs the program",
    ),
    (
        "README.md",
        "pip install ./hemicube-0.1.0-*.whl",
        "scripts/try-wheel installs it into an environment",
    ),
    (
        "docs/install.md",
        "tar -xf hemicube-0.1.0-x86_64-unknown-linux-musl.tar.gz",
        "scripts/try-static runs the program of that tree",
    ),
    (
        "README.md",
        "Expand-Archive hemicube-0.1.0-x86_64-pc-windows-gnu.zip .",
        "scripts/try-windows runs the program under Wine",
    ),
    (
        "README.md",
        "cargo install --locked --path crates/cli",
        "it makes what this test is run from",
    ),
    (
        "docs/install.md",
        "Expand-Archive hemicube-0.1.0-x86_64-pc-windows-gnu.zip .",
        "scripts/try-windows runs the program under Wine",
    ),
    (
        "docs/install.md",
        "sudo apt install ./hemicube_0.1.0_amd64.deb",
        "program::distribution unpacks the package and runs the program",
    ),
    (
        "docs/install.md",
        "git clone ADDRESS hemicube",
        "it makes what this test is run from",
    ),
    (
        "docs/pictures.md",
        "hemicube",
        "wants a terminal: program::interactive gives it one",
    ),
    (
        "docs/pictures.md",
        "hemicube view hemicube city.obj --live",
        "needs a display: outside::live shows it on one that is made for it",
    ),
    (
        "docs/python.md",
        "python3 -m venv venv",
        "`./test` builds the wheel, installs it into an environment and runs the page there",
    ),
    (
        "docs/scaling-out.md",
        "sbatch --array=0-15 hemicube/examples/cluster/slurm-array.sh city.obj slurm.hemicube",
        "wants a cluster: outside::cluster runs the script in a Slurm of its own",
    ),
    (
        "docs/scaling-out.md",
        "kubectl apply -f hemicube/examples/cluster/kubernetes.yaml",
        "wants a cluster: outside::cluster gives the program the variables that a pod has",
    ),
    (
        "docs/dev/engines.md",
        "cargo bench -p hemicube-backend-cpu --bench engine",
        "`./test` runs every bench once, `./test --full` in earnest",
    ),
    (
        "docs/dev/study.md",
        "scripts/peers peers.json",
        "hours of a machine: program::bench runs small studies",
    ),
];

/// Pages that programs make from their own definitions, whose length is theirs.
const GENERATED: [&str; 2] = ["docs/commands.md", "docs/python-api.md"];

/// Words at most: of the README, of the book with it but for what is generated, of pages for developers, of the changelog.
const WORDS_MAX: [usize; 4] = [700, 25_000, 12_000, 400];

fn summary() -> Page {
    Page::read("docs/SUMMARY.md")
}

/// The README, every chapter, and the pages for developers.
fn pages() -> Vec<Page> {
    let chapters = chapters(&summary());
    assert!(chapters.len() > 15, "{chapters:?}");
    std::iter::once("README.md".to_owned())
        .chain(chapters)
        .chain(files().into_iter().filter(|name| name.starts_with(DEVELOPERS)))
        .map(|name| Page::read(&name))
        .collect()
}

/// The files in which documentation tests of Rust and of Python name their pages.
fn tested_elsewhere() -> [String; 2] {
    ["tests/src/lib.rs", "crates/python/tests/test_types_and_documents.py"].map(|name| Page::read(name).text)
}

/// Tells if pages and pictures are to be written.
fn is_blessing() -> bool {
    std::env::var_os("BLESS").is_some()
}

/// Runs a page of the repository, and holds the pictures in it against what its commands made.
fn holds(name: &str, extent: Extent) {
    let page = Page::read(name);
    let folder = Folder::new(&format!("book::{name}"), &page);
    if is_blessing() {
        let text = folder.blessed(&page, extent).unwrap_or_else(|what| panic!("{what}"));
        std::fs::write(workspace().join(name), text).expect("a page is written");
    } else {
        folder.page(&page, extent).unwrap_or_else(|what| panic!("{what}"));
    }
    for picture in page.own_pictures() {
        let stem = name.trim_start_matches("docs/").trim_end_matches(".md");
        let kept = workspace().join("docs/pictures").join(stem).join(&picture);
        let made = folder.path(&picture);
        if is_blessing() {
            std::fs::copy(&made, &kept).expect("a picture is taken over");
        }
        same_picture(&made, &kept).unwrap_or_else(|what| panic!("{what}; BLESS=1 takes over what they make"));
    }
}

macro_rules! page_tests {
    ($($test:ident: $page:literal,)*) => {
        /// The pages that have tests.
        const TESTED: &[&str] = &[$($page),*];

        mod quick {
            use super::{Extent, holds};
            $(#[test] fn $test() { holds($page, Extent::Quick); })*
        }

        mod full {
            use super::{Extent, holds};
            $(#[test] #[ignore = "for ./test --full"] fn $test() { holds($page, Extent::Full); })*
        }
    };
}

page_tests! {
    readme: "README.md",
    tour: "docs/tour.md",
    room: "docs/room.md",
    city: "docs/city.md",
    satellite: "docs/satellite.md",
    choosing_accuracy: "docs/choosing-accuracy.md",
    wrong_scenes: "docs/wrong-scenes.md",
    surfaces: "docs/surfaces.md",
    heat: "docs/heat.md",
    light: "docs/light.md",
    points: "docs/points.md",
    portals: "docs/portals.md",
    recipes: "docs/recipes.md",
    scaling_out: "docs/scaling-out.md",
    pictures: "docs/pictures.md",
    embedding: "docs/embedding.md",
    plugins: "docs/plugins.md",
    formats: "docs/formats.md",
    store: "docs/store.md",
    settings: "docs/settings.md",
    limits: "docs/limits.md",
    peers: "docs/peers.md",
    developers_accuracy: "docs/dev/accuracy.md",
    developers_gpu: "docs/dev/gpu.md",
    developers_extremes: "docs/dev/extremes.md",
}

/// What the program says of its commands, as a page.
fn commands() -> String {
    let output = Command::new(program())
        .args(["manual", "--markdown"])
        .output()
        .expect("the program runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("text")
}

#[test]
fn the_page_of_commands_is_the_program_s() {
    let path = workspace().join("docs/commands.md");
    let made = commands();
    if is_blessing() {
        std::fs::write(&path, &made).expect("a page is written");
    }
    let page = read_to_string(path).expect("a page");
    let other = page.lines().zip(made.lines()).find(|(line, made)| line != made);
    assert!(
        page == made,
        "docs/commands.md is not what `hemicube manual --markdown` prints, at {other:?}: BLESS=1 writes it"
    );
}

#[test]
fn every_option_that_a_page_names_is_one_of_a_command() {
    let page = Page::read("docs/commands.md");
    let known = options(&page.text);
    assert!(known.len() > 50, "{known:?}");
    for page in pages().iter().filter(|page| page.is_for_users()) {
        assert_eq!(faults_of_options(page, &known), Vec::<String>::new());
    }
    let faults = faults_of_options(&doctored("`--tolerance 1%`, `--tolerence`, `cargo --x`"), &known);
    assert_eq!(faults, ["docs/doctored.md:1: no command has `--tolerence`"]);
}

#[test]
fn every_text_keeps_its_length() {
    let pages = pages();
    let written = pages.iter().filter(|page| !GENERATED.contains(&page.name.as_str()));
    let (users, developers): (Vec<&Page>, Vec<&Page>) = written.partition(|page| page.is_for_users());
    let sum = |pages: &[&Page]| pages.iter().map(|page| page.words()).sum::<usize>();
    let lengths = [
        pages[0].words(),
        sum(&users),
        sum(&developers),
        Page::read("CHANGELOG.md").words(),
    ];
    assert!(
        lengths.iter().zip(WORDS_MAX).all(|(&words, most)| words <= most),
        "{lengths:?} words, {WORDS_MAX:?} at most"
    );
}

#[test]
fn no_page_for_users_names_commits_or_tests() {
    for page in pages().iter().filter(|page| page.is_for_users()) {
        assert_eq!(faults_of_words(page), Vec::<String>::new());
    }
    for (line, wanted) in [
        ("since 4036b44a", "a commit"),
        ("(`promises::sealed`)", "a test"),
        ("cargo run -p hemicube-tests", "the package of the tests"),
    ] {
        let faults = faults_of_words(&doctored(line));
        assert!(faults.len() == 1 && faults[0].contains(wanted), "{line}: {faults:?}");
    }
    assert!(faults_of_words(&doctored("1506176 patches, 5.670374419e-08, decade, `hemicube::solve`")).is_empty());
}

#[test]
fn every_page_is_a_chapter_and_every_link_leads_somewhere() {
    let contents = faults_of_contents(&summary(), &Page::read("docs/index.md"), &files());
    assert!(contents.is_empty(), "{contents:#?}");
    let pages = pages();
    let links = faults_of_links(&pages);
    assert!(links.is_empty(), "{links:#?}");
    let count: usize = pages.iter().map(|page| page.links().len()).sum();
    let pictures = pages
        .iter()
        .flat_map(Page::links)
        .filter(|(.., is_picture)| *is_picture)
        .count();
    assert!(count > 60 && pictures > 10, "{count} links, {pictures} pictures");
}

#[test]
fn every_block_is_run_or_said_not_to_be() {
    let pages = pages();
    let [doctested, packaged] = tested_elsewhere();
    let mut faults = stale(&pages, NOT_RUN);
    for page in &pages {
        faults.extend(faults_of_blocks(page, NOT_RUN, &doctested, &packaged));
        let is_run = page.blocks().iter().any(|block| {
            let is_console = block.language == "console" && !block.is("not-run");
            is_console || block.language == "python" && !block.needs_package()
        });
        if is_run != TESTED.contains(&page.name.as_str()) {
            faults.push(format!(
                "{}: has blocks to run: {is_run}; and in `page_tests!` the opposite",
                page.name
            ));
        }
    }
    assert!(faults.is_empty(), "{faults:#?}");
}

/// Makes web pages of a folder by mdbook.
fn made_of(docs: &Path, book: &Path) -> Option<Output> {
    let Some(mdbook) = std::env::var_os("HEMICUBE_MDBOOK").filter(|path| !path.is_empty()) else {
        skip("book", "no mdbook in `HEMICUBE_MDBOOK`", "HEMICUBE_REQUIRE_MDBOOK");
        return None;
    };
    let mut command = Command::new(mdbook);
    command.arg("build").arg(docs).arg("--dest-dir").arg(book);
    Some(command.output().expect("`HEMICUBE_MDBOOK` runs"))
}

/// Links and pictures of a web page that lead nowhere: in the book, or, as if it were `book` beside `docs`, out of it.
fn dead(page: &Path, book: &Path) -> Vec<String> {
    let text = read_to_string(page).unwrap_or_else(|error| panic!("`{}`: {error}", page.display()));
    let folder = page.parent().expect("a folder");
    let targets = ["href=\"", "src=\""]
        .into_iter()
        .flat_map(|start| text.split(start).skip(1));
    let targets = targets.filter_map(|rest| Some(rest.split_once('"')?.0));
    let leads_somewhere = |target: &&str| {
        let (path, part) = target.split_once('#').unwrap_or((target, ""));
        let is_elsewhere = ["https://", "http://", "data:", "mailto:"]
            .iter()
            .any(|start| path.starts_with(start));
        let place = if path.is_empty() {
            page.to_owned()
        } else {
            folder.join(path)
        };
        let there = match path.strip_prefix("../").map(|rest| (rest, workspace().join(rest))) {
            Some((_, outside)) if folder == book => outside.exists(),
            _ => place.exists(),
        };
        let has_part = |text: &str| part.is_empty() || text.contains(&format!("id=\"{part}\""));
        is_elsewhere || there && (part.is_empty() || read_to_string(place).is_ok_and(|text| has_part(&text)))
    };
    targets
        .filter(|target| !leads_somewhere(target))
        .map(str::to_owned)
        .collect()
}

#[test]
fn mdbook_makes_web_pages_of_it_whose_links_hold() {
    let place = tempfile::tempdir().expect("a folder");
    let book = place.path().join("book");
    let Some(output) = made_of(&workspace().join("docs"), &book) else {
        return;
    };
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        output.status.success() && !said.contains("WARN") && !said.contains("ERROR"),
        "{said}"
    );
    for chapter in chapters(&summary()) {
        let chapter = chapter.trim_start_matches("docs/").replace(".md", ".html");
        let dead = dead(&book.join(&chapter), &book);
        assert!(dead.is_empty(), "{chapter}: {dead:?}");
    }
    let tour = read_to_string(book.join("tour.html")).expect("a page");
    let pictures = Page::read("docs/tour.md").own_pictures();
    assert!(
        pictures.len() == 3
            && pictures
                .iter()
                .all(|name| tour.contains(&format!("src=\"pictures/tour/{name}\"")))
    );

    // A link that leads nowhere is found, as is a chapter that is not there.
    let doctored = book.join("doctored.html");
    std::fs::write(
        &doctored,
        "<a href=\"tour.html#light\"></a><a href=\"tour.html#dark\"></a><img src=\"no.png\">",
    )
    .expect("a page");
    assert_eq!(dead(&doctored, &book), ["tour.html#dark", "no.png"]);
    let docs = place.path().join("docs");
    std::fs::create_dir(&docs).expect("a folder");
    std::fs::copy(workspace().join("docs/book.toml"), docs.join("book.toml")).expect("copied");
    std::fs::write(docs.join("SUMMARY.md"), "- [x](nowhere.md)\n").expect("a table of contents");
    let output = made_of(&docs, &place.path().join("other")).expect("mdbook is there");
    assert!(!output.status.success(), "a chapter that is not there was not noticed");
}

/// A page of these lines.
fn doctored(text: &str) -> Page {
    Page {
        name: "docs/doctored.md".to_owned(),
        text: text.to_owned(),
    }
}

/// The tour with one thing changed.
fn tour_with(from: &str, to: &str) -> Page {
    let tour = Page::read("docs/tour.md");
    assert!(tour.text.contains(from), "the tour has no `{from}`");
    let text = tour.text.replacen(from, to, 1);
    Page { text, ..tour }
}

#[test]
fn must_fail_a_wrong_command_or_other_output() {
    let run = |page: &Page| Folder::new("book::must_fail", page).page(page, Extent::Quick);
    let generate = "```console\nhemicube generate room --patches 200 -o room.obj\n```\n";
    run(&doctored(generate)).expect("a page that is right");
    let right = format!("{generate}\n```text,output\n`room.obj`: … patches (room)\n```\n");
    run(&doctored(&right)).expect("output as it stands there");
    for (change, wanted) in [
        (generate.replace("generate", "genarate"), "docs/doctored.md:1: "),
        (
            generate.replace("-o room.obj", "-o room.obj; false; true"),
            "this failed: false",
        ),
        (right.replace("(room)", "(city)"), "says something else"),
        (right.replace("room.obj`:", "room.obj`"), "says something else"),
        ("```python\nassert 1 + 1 == 3\n```\n".to_owned(), "AssertionError"),
        (
            "```console\ncargo run --release -p hemicube-tests --example nowhere\n```\n".to_owned(),
            "this failed",
        ),
    ] {
        let is_python = change.contains("python");
        match run(&doctored(&change)) {
            Err(what) => assert!(what.contains(wanted), "{what}"),
            // Without Python there is nothing to fail; a test that requires it fails before.
            Ok(()) => assert!(
                is_python && hemicube_tests::readers::python("book::must_fail", &["numpy"]).is_none(),
                "{change}"
            ),
        }
    }
    // And in a page of the book.
    let wrong = tour_with("hemicube inspect cornell", "hemicube inspekt cornell");
    let what = run(&wrong).expect_err("a wrong command in the tour");
    assert!(what.starts_with("docs/tour.md:") && what.contains("inspekt"), "{what}");
}

#[test]
fn must_fail_lines_out_of_order_left_out_or_not_adjacent() {
    let said = "one\ntwo 2.0 s\nthree\nfour\n";
    for right in [
        said,
        "one\ntwo … s\n…",
        "one\n…\nfour",
        "…\nthree\nfour",
        "…\nt…o 2.0 s\n…",
        "…\nthree\n…\nfour",
        "…",
    ] {
        says(said, right).unwrap_or_else(|what| panic!("{right}: {what}"));
    }
    for wrong in [
        "one\ntwo 2.0 s\nthree",
        "two 2.0 s\nthree\nfour",
        "three",
        "…\ntwo",
        "…\ntwo … m\n…",
        "…\nthree\n…\none",
        "one\nthree\n…",
        "one\n…\none",
        "…o 2.1…\n…",
        "…\nfour\n…\nfour",
    ] {
        assert!(says(said, wrong).is_err(), "{wrong}");
    }
}

#[test]
fn must_fail_output_that_hides_a_warning() {
    let said = "made\nwarning: 23 patches are inside solids\nnext\n";
    for right in [
        "made\nwarning: 23 patches are inside solids\n…",
        "…\nwarning: …\nnext",
        said,
    ] {
        says(said, right).unwrap_or_else(|what| panic!("{right}: {what}"));
    }
    for wrong in ["made\n…", "made\n…\nnext", "…"] {
        let what = says(said, wrong).expect_err(wrong);
        assert!(what.contains("hides `warning: 23 patches are inside solids`"), "{what}");
    }
    // And in a page that runs.
    let page = "```console\necho made; echo 'warning: look' >&2; echo next\n```\n```text,output\nmade\n…\n```\n";
    let page = doctored(page);
    let what = Folder::new("book::must_fail", &page).page(&page, Extent::Quick);
    assert!(what.is_err_and(|what| what.contains("hides `warning: look`")));
}

#[test]
fn blessing_keeps_what_fits_and_shows_warnings() {
    let said = "rows 5\nerror 0.6 %\nwarning: look\ntime 3.1 s\nnext\n";
    for (wanted, text) in [
        ("…", said),
        ("rows 5\n…", "rows 5\n…\nwarning: look\n…\n"),
        (
            "…\nerror 0.7 %\nwarning: old\ntime … s\n…",
            "…\nerror 0.6 %\nwarning: look\ntime … s\n…\n",
        ),
        ("rows 4\n…\nnext", "rows 5\n…\nwarning: look\n…\nnext\n"),
    ] {
        let made = updated(said, wanted);
        assert_eq!(made, text);
        says(said, &made).unwrap_or_else(|what| panic!("{what}"));
    }
}

#[test]
fn must_fail_links_pictures_and_chapters_that_are_not_there() {
    let mut pages = pages();
    pages.push(doctored(
        "# A heading, or two\n[a](tour.md) [b](#a-heading-or-two) [c](https://example.org) `[code](x.md)`\n[d](../tests/src/lib.rs)\n",
    ));
    assert!(faults_of_links(&pages).is_empty(), "{:?}", faults_of_links(&pages));
    for (line, wanted) in [
        ("[a](nowhere.md)", "no such file"),
        ("![a](pictures/nowhere.png)", "no such file"),
        ("[a](tour.md#nowhere)", "no heading"),
        ("[a](#nowhere)", "no heading"),
        ("[a](../CHANGELOG.md)", "no chapter"),
        ("[a](dev/accuracy.md)", "no chapter"),
    ] {
        *pages.last_mut().expect("a page") = doctored(line);
        let faults = faults_of_links(&pages);
        assert!(faults.len() == 1 && faults[0].contains(wanted), "{line}: {faults:?}");
    }
    let (mut summary, mut there) = (summary(), files());
    summary.text += "- [x](nowhere.md)\n";
    there.insert("docs/forgotten.md".to_owned());
    let mut index = Page::read("docs/index.md");
    index.text = index.text.replace("tour.md", "room.md");
    let faults = faults_of_contents(&summary, &index, &there);
    assert_eq!(
        faults,
        [
            "chapter `docs/nowhere.md` is not there",
            "`docs/forgotten.md` is in no chapter",
            "`docs/index.md` does not link `docs/tour.md`",
            "`docs/index.md` does not link `docs/nowhere.md`"
        ]
    );
}

#[test]
fn must_fail_blocks_of_unknown_kinds_and_stale_reasons() {
    let listed = [("docs/doctored.md", "sleep forever", "it does not end")];
    let faults = |text: &str| faults_of_blocks(&doctored(text), &listed, "", "");
    for right in [
        "```console,full,needs:scenes\ntrue\n```\n```text,output\nx\n```",
        "```console,not-run\nsleep forever\n```",
        "As `a.toml`:\n\n```toml,file:a.toml\n```\n```console\ncat a.toml\n```",
        "```python\nprint(1)\n```\n```text\nanything\n```",
        "```console\ncargo run --release -p hemicube-tests --example accuracy\n```",
    ] {
        assert!(faults(right).is_empty(), "{right}: {:?}", faults(right));
    }
    for (wrong, wanted) in [
        ("```\nls\n```", "without a language"),
        ("```fortran\nend\n```", "nothing runs this language"),
        ("```console,fulll\ntrue\n```", "unknown tag `fulll`"),
        ("```console,needs:\ntrue\n```", "unknown tag `needs:`"),
        ("```console,not-run\ntrue\n```", "do not agree"),
        ("```console\nsleep forever\n```", "do not agree"),
        ("```text,output\nx\n```", "output of no command"),
        ("```console\ntrue\n```\n```text,output\n…\n```", "claims nothing"),
        ("```c\nint x;\n```", "no command reads it"),
        (
            "`a.c`:\n```c,file:a.c\nint x;\n```\n```console\ncc b.c\n```",
            "no command after it",
        ),
        (
            "```c,file:a.c\nint x;\n```\n```console\ncc a.c\n```",
            "does not name its file",
        ),
        ("```rust\nfn main() {}\n```", "no documentation test"),
        ("```python\nimport hemicube\n```", "no test of the Python package"),
        (
            "```console\ncargo run -p hemicube-tests --example nowhere\n```",
            "has no `examples/nowhere.rs`",
        ),
        (
            "```console\ncargo build -p hemicube-nowhere\n```",
            "no package `hemicube-nowhere`",
        ),
    ] {
        let found = faults(wrong);
        assert!(found.len() == 1 && found[0].contains(wanted), "{wrong}: {found:?}");
    }
    assert_eq!(stale(&[doctored("")], &listed).len(), 1);
    assert!(stale(&[doctored("```console,not-run\nsleep forever\n```")], &listed).is_empty());
}

#[test]
fn must_fail_another_picture() {
    let of = |name: &str| workspace().join("docs/pictures").join(name);
    let (light, row) = (of("tour/light.png"), of("tour/row.png"));
    assert!(same_picture(&light, &light).is_ok());
    assert!(same_picture(&light, &row).is_err() && same_picture(&light, &of("nowhere.png")).is_err());
    // Another picture of equal size.
    let (ids, occlusion) = (of("hemicube-ids.png"), of("hemicube-occlusion.png"));
    assert!(same_picture(&ids, &occlusion).is_err());
}
