//! The package that `./dist` makes: what is in it, that it works wherever it is put, and that its pages and completions
//! are what their readers take.

use hemicube_tests::scenes::{profile_folder, say, workspace};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use tempfile::TempDir;

/// `./dist`, from what is built already, into a folder of its own: the tree, and the files made of it.
fn laid_out(place: &Path) -> (PathBuf, Vec<PathBuf>) {
    let output = Command::new("bash")
        .arg(workspace().join("dist"))
        .args(["--as-built", "-o"])
        .arg(place)
        .env("CARGO_TARGET_DIR", profile_folder().parent().expect("target"))
        .output()
        .expect("bash runs");
    let said = said(&output);
    assert!(output.status.success(), "{said}");
    let mut lines = said.lines().map(PathBuf::from);
    let tree = lines.next().expect("the tree");
    let made: Vec<PathBuf> = lines.collect();
    let checked = Command::new("sha256sum")
        .args(["--check", "--quiet", "SHA256SUMS"])
        .current_dir(place)
        .status();
    assert!(!made.is_empty() && checked.expect("sha256sum runs").success());
    (tree, made)
}

fn said(output: &Output) -> String {
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    text(&output.stdout) + &text(&output.stderr)
}

/// Runs the program of a tree as somebody would who has nothing else of it: no variable of ours, no folder of theirs.
fn run(tree: &Path, home: &Path, arguments: &[&str]) -> String {
    let output = Command::new(tree.join("bin/hemicube"))
        .args(arguments)
        .env_clear()
        .env("PATH", "/usr/bin:/bin")
        .env("HOME", home)
        .env("XDG_RUNTIME_DIR", home)
        .current_dir(home)
        .output()
        .expect("the program runs");
    assert!(output.status.success(), "{arguments:?}: {}", said(&output));
    said(&output)
}

fn files(of: &Path) -> Vec<String> {
    let mut found = Vec::new();
    let mut folders = vec![of.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                folders.push(path);
            } else {
                found.push(path.strip_prefix(of).expect("beneath").display().to_string());
            }
        }
    }
    found.sort();
    found
}

#[test]
fn the_tree_works_from_wherever_it_is_put() {
    let place = TempDir::new().expect("a folder");
    let (tree, made) = laid_out(&place.path().join("made"));
    let version = env!("CARGO_PKG_VERSION");
    assert!(tree.ends_with(format!("hemicube-{version}")), "{}", tree.display());
    let there = files(&tree);
    for wanted in [
        "bin/hemicube",
        "include/hemicube_backend.h",
        "lib/hemicube/backends/libhemicube_backend_gl.so",
        "lib/hemicube/backends/libhemicube_backend_vulkan.so",
        "lib/hemicube/backends/libhemicube_backend_wgpu.so",
        "share/bash-completion/completions/hemicube",
        "share/doc/hemicube/LICENSE-APACHE",
        "share/doc/hemicube/docs/plugins.md",
        "share/doc/hemicube/examples/cornell-box.obj",
        "share/fish/vendor_completions.d/hemicube.fish",
        "share/man/man1/hemicube.1",
        "share/man/man1/hemicube-compute.1",
        "share/zsh/site-functions/_hemicube",
    ] {
        assert!(there.iter().any(|file| file == wanted), "no `{wanted}` in {there:?}");
    }
    // The tree unpacked elsewhere works once its source is gone.
    let elsewhere = place.path().join("some where/else");
    std::fs::create_dir_all(&elsewhere).expect("a folder");
    let unpacked = Command::new("tar")
        .arg("-xf")
        .arg(&made[0])
        .arg("-C")
        .arg(&elsewhere)
        .status();
    assert!(unpacked.expect("tar runs").success());
    let moved = elsewhere.join(format!("hemicube-{version}"));
    assert_eq!(files(&moved), there);
    std::fs::remove_dir_all(&tree).expect("removed");

    let home = place.path().join("home");
    std::fs::create_dir(&home).expect("a folder");
    assert_eq!(run(&moved, &home, &["--version"]).trim(), format!("hemicube {version}"));
    let listed = run(&moved, &home, &["backends", "list", "--json"]);
    let listed: serde_json::Value = serde_json::from_str(&listed[listed.find('{').expect("JSON")..]).expect("JSON");
    let text = listed.to_string();
    for backend in ["gl", "vulkan", "wgpu"] {
        let path = moved.join(format!("lib/hemicube/backends/libhemicube_backend_{backend}.so"));
        let path = path.canonicalize().expect("there");
        assert!(text.contains(path.to_str().expect("UTF-8")), "`{backend}`: {text}");
    }
    let scene = moved.join("share/doc/hemicube/examples/cornell-box.obj");
    let scene = scene.to_str().expect("UTF-8");
    run(
        &moved,
        &home,
        &["compute", scene, "--split", "2", "-o", "box", "--backend", "cpu"],
    );
    run(&moved, &home, &["check", "box"]);

    let Some(package) = made.get(1) else {
        say("SKIP distribution::the_tree_works_from_wherever_it_is_put: no dpkg-deb here to make a package");
        return;
    };
    let tell = |what: &str| {
        let output = Command::new("dpkg-deb").args([what, "--"]).arg(package).output();
        said(&output.expect("dpkg-deb runs"))
    };
    let control = tell("--field");
    for line in [
        "Package: hemicube",
        &format!("Version: {version}"),
        "Depends: libc6 (>= 2.",
    ] {
        assert!(control.contains(line), "no `{line}` in {control}");
    }
    let root = place.path().join("root");
    let unpacked = Command::new("dpkg-deb")
        .arg("--extract")
        .arg(package)
        .arg(&root)
        .status();
    assert!(unpacked.expect("dpkg-deb runs").success());
    let usr = root.join("usr");
    assert!(files(&usr).iter().any(|file| file == "share/doc/hemicube/copyright"));
    let listed = run(&usr, &home, &["backends", "list"]);
    assert!(listed.contains("root/usr/lib/hemicube/backends"), "{listed}");
    run(&usr, &home, &["check", "box"]);
}

#[test]
#[ignore = "half a minute of processor time and more: ./test --full"]
fn the_same_files_make_the_same_archive() {
    let place = TempDir::new().expect("a folder");
    let [first, second] = ["a", "b"].map(|name| laid_out(&place.path().join(name)).1);
    assert_eq!(first.len(), second.len());
    for (first, second) in first.iter().zip(&second) {
        assert!(first != second && std::fs::read(first).expect("there") == std::fs::read(second).expect("there"));
    }
    // A folder that is there and is no tree of ours is left alone.
    let other = place
        .path()
        .join("c")
        .join(format!("hemicube-{}", env!("CARGO_PKG_VERSION")));
    std::fs::create_dir_all(&other).expect("a folder");
    let output = Command::new("bash")
        .arg(workspace().join("dist"))
        .args(["--as-built", "-o"])
        .arg(place.path().join("c"))
        .env("CARGO_TARGET_DIR", profile_folder().parent().expect("target"))
        .output()
        .expect("bash runs");
    assert!(
        !output.status.success() && said(&output).contains("no earlier tree of this"),
        "{}",
        said(&output)
    );
}

/// The pages of every command, in a folder of their own.
fn manual() -> (TempDir, Vec<PathBuf>) {
    let place = TempDir::new().expect("a folder");
    let status = Command::new(hemicube_tests::scenes::program())
        .arg("manual")
        .arg(place.path())
        .status();
    assert!(status.expect("the program runs").success());
    let pages = files(place.path()).iter().map(|file| place.path().join(file)).collect();
    (place, pages)
}

#[test]
fn man_pages_are_clean_and_hold_the_examples() {
    let (_place, pages) = manual();
    assert!(pages.len() > 15, "{pages:?}");
    let read = |name: &str| {
        let page = pages
            .iter()
            .find(|page| page.ends_with(name))
            .unwrap_or_else(|| panic!("no `{name}` in {pages:?}"));
        std::fs::read_to_string(page).expect("there")
    };
    let compute = read("hemicube-compute.1");
    for part in [
        ".SH OPTIONS",
        ".SH EXAMPLES\n.nf\n  hemicube compute room.obj \\-o room.hemicube\n",
        ".SH EXIT STATUS",
    ] {
        assert!(compute.contains(part), "{part}: {compute}");
    }
    // Options that `-h` leaves out are in the manual all the same.
    assert!(compute.contains("Visibility algorithm of the CPU backend"));
    assert!(read("hemicube.1").contains("hemicube\\-compute(1)"));
    assert!(read("hemicube-backends-check.1").contains("backend\\-option"));
    // Hidden ones are for packagers, who read this.
    assert!(!pages.iter().any(|page| page.ends_with("hemicube-manual.1")));

    let has = |program: &str| Command::new(program).arg("--version").output().is_ok();
    for page in &pages {
        let mut command = if has("mandoc") {
            let mut command = Command::new("mandoc");
            // Lines of examples are as long as they are typed.
            command.args(["-Tlint", "-Wwarning"]);
            command
        } else if has("groff") {
            let mut command = Command::new("groff");
            command.args(["-man", "-ww", "-z", "-Kutf8", "-Tutf8"]);
            command
        } else {
            say("SKIP distribution::man_pages_are_clean_and_hold_the_examples: neither mandoc nor groff is here");
            return;
        };
        let output = command.arg(page).output().expect("a typesetter runs");
        // Equal programs have equal pages, so that there is no date to give.
        let said = said(&output);
        let complaints: Vec<&str> = said.lines().filter(|line| !line.contains("missing date")).collect();
        assert!(complaints.is_empty(), "{complaints:?}");
    }
}

fn completions(shell: &str) -> String {
    let output = Command::new(hemicube_tests::scenes::program())
        .args(["completions", shell])
        .output()
        .expect("the program runs");
    assert!(output.status.success());
    String::from_utf8(output.stdout).expect("UTF-8")
}

#[test]
fn bash_completes_commands_and_options() {
    let place = TempDir::new().expect("a folder");
    let script = place.path().join("hemicube");
    std::fs::write(&script, completions("bash")).expect("written");
    let checked = Command::new("bash").arg("-n").arg(&script).output().expect("bash runs");
    assert!(
        checked.status.success() && said(&checked).is_empty(),
        "{}",
        said(&checked)
    );
    // As Readline does it: the words so far, the place of the cursor, and the function that is registered.
    let completed = |words: &[&str]| -> Vec<String> {
        let asked = r#"
            source "$1"; shift
            registered=$(complete -p hemicube)
            [[ $registered =~ -F\ ([^ ]+) ]] || exit 3
            COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); COMPREPLY=()
            "${BASH_REMATCH[1]}" hemicube "${COMP_WORDS[COMP_CWORD]}" "${COMP_WORDS[COMP_CWORD - 1]}"
            printf '%s\n' "${COMPREPLY[@]}"
        "#;
        let output = Command::new("bash")
            .args(["-c", asked, "completing"])
            .arg(&script)
            .args(words)
            .output()
            .expect("bash runs");
        assert!(output.status.success(), "{words:?}: {}", said(&output));
        said(&output).split_whitespace().map(str::to_owned).collect()
    };
    assert_eq!(completed(&["hemicube", "comp"]), ["compute", "compare", "completions"]);
    assert_eq!(completed(&["hemicube", "compute", "--toler"]), ["--tolerance"]);
    assert_eq!(completed(&["hemicube", "backends", "l"]), ["list"]);
    assert!(completed(&["hemicube", "completions", "z"]).contains(&"zsh".to_owned()));
}

#[test]
fn other_shells_take_their_completions() {
    for (shell, parts) in [
        ("zsh", ["#compdef hemicube", "--tolerance"]),
        ("fish", ["complete -c hemicube", "-l tolerance"]),
        ("elvish", ["edit:completion:arg-completer[hemicube]", "--tolerance"]),
    ] {
        let script = completions(shell);
        for part in parts {
            assert!(script.contains(part), "{shell}: no `{part}`");
        }
        let place = TempDir::new().expect("a folder");
        let path = place.path().join("script");
        std::fs::write(&path, &script).expect("written");
        let checked = match shell {
            "zsh" | "fish" => Command::new(shell).arg("-n").arg(&path).output(),
            _ => continue,
        };
        match checked {
            Ok(checked) => assert!(checked.status.success(), "{shell}: {}", said(&checked)),
            Err(_) => say(&format!(
                "SKIP distribution: {shell} is not here to read its completions"
            )),
        }
    }
}

#[test]
fn the_table_of_platforms_is_the_scripts() {
    let output = Command::new("bash")
        .arg(workspace().join("scripts/platforms"))
        .arg("--table")
        .output()
        .expect("bash runs");
    assert!(output.status.success(), "{}", said(&output));
    let table = String::from_utf8(output.stdout).expect("UTF-8");
    assert!(table.lines().count() > 5, "{table}");
    let page = std::fs::read_to_string(workspace().join("docs/install.md")).expect("a page");
    assert!(
        page.ends_with(&table),
        "docs/install.md does not end with what `scripts/platforms --table` prints:\n{table}"
    );
}

/// A table of a file of this repository.
fn table(path: &str) -> toml::Table {
    let text = std::fs::read_to_string(workspace().join(path)).expect("a file");
    text.parse()
        .unwrap_or_else(|error| panic!("`{path}` is no TOML: {error}"))
}

#[test]
fn the_recipe_for_conda_says_what_the_packages_say() {
    let recipe = std::fs::read_to_string(workspace().join("recipes/conda/recipe.yaml")).expect("a recipe");
    let (workspace, python) = (table("Cargo.toml"), table("crates/python/pyproject.toml"));
    let text = |value: &toml::Value| value.as_str().expect("text").to_owned();
    let package = &workspace["workspace"]["package"];
    let (project, built_by) = (&python["project"], &python["build-system"]["requires"]);
    // `maturin>=1.9,<2` is `maturin >=1.9,<2` there.
    let apart = |list: &toml::Value| text(&list.as_array().expect("a list")[0]).replacen(">=", " >=", 1);
    let runs_with = project["dependencies"].as_array().expect("a list").len();
    let build_needs = built_by.as_array().expect("a list").len();
    assert_eq!((runs_with, build_needs), (1, 1), "the recipe has a line for each");
    let needs_python = format!("    - python {}", text(&project["requires-python"]));
    for line in [
        format!("  version: \"{}\"", text(&package["version"])),
        format!("  license: {}", text(&package["license"])),
        format!("    - rust >={}", text(&package["rust-version"])),
        format!("  name: {}", text(&project["name"])),
        format!("    - {}", apart(&project["dependencies"])),
        format!("    - {}", apart(built_by)),
    ] {
        assert_eq!(
            recipe.lines().filter(|said| *said == line).count(),
            1,
            "no line `{line}`"
        );
    }
    // To build and to run.
    assert_eq!(recipe.lines().filter(|said| *said == needs_python).count(), 2);
    let summary = recipe
        .lines()
        .find_map(|line| line.strip_prefix("  summary: "))
        .expect("a summary");
    assert!(text(&project["description"]).starts_with(summary), "{summary}");
}

#[test]
fn each_package_of_a_crate_has_its_readme_and_its_licences() {
    let packaged = |crate_name: &str| {
        let output = Command::new(env!("CARGO"))
            .args(["package", "--list", "--allow-dirty", "--offline", "-p", crate_name])
            .current_dir(workspace())
            .output()
            .expect("cargo runs");
        assert!(output.status.success(), "{}", said(&output));
        String::from_utf8(output.stdout).expect("UTF-8")
    };
    let mut names = Vec::new();
    for group in ["crates", "crates/backends"] {
        for entry in std::fs::read_dir(workspace().join(group)).expect("a folder") {
            let manifest = entry.expect("an entry").path().join("Cargo.toml");
            let Ok(text) = std::fs::read_to_string(&manifest) else {
                continue;
            };
            let package = text.parse::<toml::Table>().expect("TOML")["package"].clone();
            let has = |key: &str| package.get(key).is_some();
            if package.get("publish").and_then(toml::Value::as_bool) == Some(false) {
                continue;
            }
            let name = package["name"].as_str().expect("a name").to_owned();
            for key in ["description", "license", "keywords", "categories", "rust-version"] {
                assert!(has(key), "{name} has no `{key}`");
            }
            let listed = packaged(&name);
            for file in ["README.md", "LICENSE-APACHE", "LICENSE-MIT"] {
                assert!(
                    listed.lines().any(|line| line == file),
                    "{name} has no `{file}`: {listed}"
                );
            }
            names.push(name);
        }
    }
    assert!(names.len() > 15, "{names:?}");
}
