//! No test file is left out of the test programs, and what documents name of tests is there.

use hemicube_tests::scenes::workspace;
use std::collections::BTreeSet;
use std::path::Path;

/// Entries of a folder, sorted.
fn entries(folder: &Path) -> BTreeSet<String> {
    let found = std::fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    found
        .map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned())
        .collect()
}

/// Modules that a `main.rs` declares, without those that are folded into it.
fn declared(main: &str) -> BTreeSet<String> {
    let name = |line: &str| line.strip_prefix("mod ")?.strip_suffix(';').map(str::to_owned);
    main.lines().filter_map(name).collect()
}

/// Files of tests that no program compiles, and programs without a `[[test]]`: `folder` has a folder a program.
fn left_out(folder: &Path, manifest: &str) -> Vec<String> {
    let mut found = Vec::new();
    for program in entries(folder) {
        let within = folder.join(&program);
        if !within.is_dir() {
            found.push(program);
            continue;
        }
        if !manifest.contains(&format!("path = \"tests/{program}/main.rs\"")) {
            found.push(format!("{program}/"));
        }
        let main = std::fs::read_to_string(within.join("main.rs")).unwrap_or_default();
        let declared = declared(&main);
        let modules = entries(&within)
            .into_iter()
            .filter(|file| file.ends_with(".rs") && file != "main.rs");
        found.extend(
            modules
                .filter(|file| !declared.contains(file.trim_end_matches(".rs")))
                .map(|file| format!("{program}/{file}")),
        );
    }
    found
}

/// Tests that a text names and that are not there: `PROGRAM::MODULE` in backticks, and `--test PROGRAM`.
fn unknown(text: &str, folder: &Path, programs: &BTreeSet<String>) -> Vec<String> {
    let word = |text: &str| -> String { text.chars().take_while(|&c| c.is_alphanumeric() || c == '_').collect() };
    let ours = programs.iter().flat_map(|program| {
        let paths = text.match_indices(&format!("`{program}::")[..]).collect::<Vec<_>>();
        paths.into_iter().filter_map(move |(at, found)| {
            let module = word(&text[at + found.len()..]);
            let is_there = folder.join(program).join(format!("{module}.rs")).is_file();
            (!is_there).then(|| format!("{program}::{module}"))
        })
    });
    let commands = text.split("-p hemicube-tests").skip(1).flat_map(|rest| {
        let line = rest.split(['`', '\n']).next().unwrap_or_default();
        line.split("--test ").skip(1).map(word).collect::<Vec<_>>()
    });
    ours.chain(commands.filter(|name| !programs.contains(name))).collect()
}

#[test]
fn every_file_of_tests_is_compiled() {
    let folder = workspace().join("tests/tests");
    let manifest = std::fs::read_to_string(workspace().join("tests/Cargo.toml")).expect("the manifest");
    assert_eq!(
        left_out(&folder, &manifest),
        Vec::<String>::new(),
        "add `mod NAME;` to the `main.rs` beside it"
    );
}

#[test]
fn a_file_that_no_program_compiles_is_found() {
    let place = tempfile::tempdir().expect("a folder");
    for (file, text) in [
        ("flat.rs", ""),
        ("one/main.rs", "mod first;\n"),
        ("one/first.rs", ""),
        ("one/second.rs", ""),
        ("two/main.rs", ""),
    ] {
        let path = place.path().join(file);
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
        std::fs::write(path, text).expect("a file");
    }
    let found = left_out(place.path(), "[[test]]\npath = \"tests/one/main.rs\"\n");
    assert_eq!(found, ["flat.rs", "one/second.rs", "two/"]);
}

#[test]
fn documents_name_tests_that_are_there() {
    let folder = workspace().join("tests/tests");
    let programs = entries(&folder);
    let mut pages = vec![
        "CONTRIBUTING.md".to_owned(),
        "ARCHITECTURE.md".to_owned(),
        "README.md".to_owned(),
    ];
    for docs in ["docs", "docs/dev"] {
        let names = entries(&workspace().join(docs)).into_iter();
        pages.extend(
            names
                .filter(|name| name.ends_with(".md"))
                .map(|name| format!("{docs}/{name}")),
        );
    }
    for page in pages {
        let text = std::fs::read_to_string(workspace().join(&page)).expect("a page");
        assert_eq!(unknown(&text, &folder, &programs), Vec::<String>::new(), "{page}");
    }
    let wrong = "`promises::nothing_of_that_name`, `promises::layout`, `cargo test -p hemicube-tests --test none`";
    assert_eq!(
        unknown(wrong, &folder, &programs),
        ["promises::nothing_of_that_name", "none"]
    );
}

/// The table *promise → tests* of CONTRIBUTING.md has every module once.
#[test]
fn every_module_has_its_promise() {
    let page = std::fs::read_to_string(workspace().join("CONTRIBUTING.md")).expect("the page");
    let table = page.split("\n## Which test holds what\n").nth(1).expect("the table");
    let table = table.split("\n## ").next().unwrap_or_default();
    let folder = workspace().join("tests/tests");
    for program in entries(&folder) {
        for file in entries(&folder.join(&program)) {
            let Some(module) = file.strip_suffix(".rs").filter(|&name| name != "main") else {
                continue;
            };
            let rows = table
                .lines()
                .filter(|line| line.starts_with('|') && line.contains(&format!("`{program}::{module}`")));
            // The book's modules run it, and hold nothing of their own.
            let wanted = usize::from(program != "book");
            assert_eq!(rows.count(), wanted, "`{program}::{module}`");
        }
    }
}
