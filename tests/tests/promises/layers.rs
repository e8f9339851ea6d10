//! The layers of `hemicube` and of `hemicube-solve`: each of their top-level modules uses only those above it in
//! ARCHITECTURE.md's lists, so that no two modules use each other, directly or through others. Comments, strings and unit
//! tests are left out. What crates use of each other, Cargo holds.

use hemicube_tests::scenes::workspace;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// The code of a source file: without its unit tests, comments and the texts of strings.
fn code(source: &str) -> String {
    let product = source.split("#[cfg(test)]\nmod tests").next().unwrap_or_default();
    let mut code = String::new();
    for line in product.lines() {
        let mut in_string = false;
        let mut before = ' ';
        let mut characters = line.chars().peekable();
        while let Some(c) = characters.next() {
            match c {
                '/' if !in_string && characters.peek() == Some(&'/') => break,
                '"' if before != '\\' && before != '\'' => in_string = !in_string,
                _ if !in_string => code.push(c),
                _ => {}
            }
            before = if before == '\\' { ' ' } else { c };
        }
        code.push('\n');
    }
    code
}

/// First steps of the paths `crate::…` in some code: `a` and `b` of `use crate::a::C` and `use crate::{b, D}`.
fn uses(code: &str) -> BTreeSet<String> {
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    let word = |text: &str| {
        text.trim_start()
            .chars()
            .take_while(|&c| is_word(c))
            .collect::<String>()
    };
    let mut found = BTreeSet::new();
    for (at, path) in code.match_indices("crate::") {
        // Macros name this crate by `$crate`; `hemicube_scene::crate::` and the like do not occur.
        let rest = &code[at + path.len()..];
        let Some(list) = rest.strip_prefix('{') else {
            found.insert(word(rest));
            continue;
        };
        let (mut depth, mut start) = (0, 0);
        for (place, c) in list.char_indices() {
            match c {
                '{' => depth += 1,
                '}' if depth > 0 => depth -= 1,
                ',' | '}' if depth == 0 => {
                    found.insert(word(&list[start..place]));
                    start = place + 1;
                    if c == '}' {
                        break;
                    }
                }
                _ => {}
            }
        }
    }
    found.remove("");
    found
}

/// All source files beneath a folder.
fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

/// The modules that each top-level module uses, itself left out.
type Uses = BTreeMap<String, BTreeSet<String>>;

/// What the modules beneath `src` use of each other; `names` are items of `lib.rs` and the modules that they are of.
fn uses_of(src: &Path, names: &BTreeMap<&str, &str>) -> Uses {
    let mut files = Vec::new();
    sources(src, &mut files);
    let mut found = Uses::new();
    for file in files {
        let inside = file.strip_prefix(src).expect("beneath it");
        let first = inside.components().next().expect("a file").as_os_str();
        let module = Path::new(first)
            .file_stem()
            .expect("a name")
            .to_string_lossy()
            .into_owned();
        if module == "lib" {
            continue;
        }
        let source = std::fs::read_to_string(&file).expect("a source");
        let used = uses(&code(&source)).into_iter();
        let used = used.map(|name| {
            names
                .get(name.as_str())
                .map_or(name.clone(), |&module| module.to_owned())
        });
        let own = found.entry(module.clone()).or_default();
        own.extend(used.filter(|name| *name != module));
    }
    found
}

/// Uses of modules that do not stand above in `order`.
fn upward(uses: &Uses, order: &[&str]) -> Vec<String> {
    let place = |module: &str| order.iter().position(|&other| other == module);
    let mut found = Vec::new();
    for (module, used) in uses {
        let Some(at) = place(module) else {
            found.push(format!("`{module}` is not in the list"));
            continue;
        };
        for other in used.iter().filter(|other| uses.contains_key(*other)) {
            if place(other).is_none_or(|above| above >= at) {
                found.push(format!("`{module}` uses `{other}`"));
            }
        }
    }
    found
}

/// The modules in ARCHITECTURE.md's list of a crate, in order.
fn listed<'t>(text: &'t str, of: &str) -> Vec<&'t str> {
    let head = format!("`{of}/src`, from the ground up:\n\n```\n");
    let list = text.split(&head).nth(1).expect("the list");
    let list = list.split("```").next().expect("its end");
    // Names stand in the first 30 characters of a line, then what they are.
    list.lines()
        .flat_map(|line| line.get(..30).unwrap_or(line).split_whitespace())
        .map(|name| name.trim_end_matches('/'))
        .collect()
}

#[test]
fn modules_use_only_those_above_them() {
    let text = std::fs::read_to_string(workspace().join("ARCHITECTURE.md")).expect("the architecture");
    let order = listed(&text, "hemicube");
    assert!(order.len() > 10 && order.contains(&"driver"), "{order:?}");
    let names = BTreeMap::from([
        ("Model", "model"),
        ("HierarchyOptions", "model"),
        ("ModelError", "model"),
    ]);
    let mut uses = uses_of(&workspace().join("crates/hemicube/src"), &names);
    assert_eq!(upward(&uses, &order), Vec::<String>::new());
    assert!(
        uses["driver"].contains("accuracy") && uses["sky"].contains("driver"),
        "{uses:?}"
    );
    let solve = uses_of(&workspace().join("crates/solve/src"), &BTreeMap::new());
    assert_eq!(upward(&solve, &listed(&text, "solve")), Vec::<String>::new());
    assert!(solve["analysis"].contains("solve"), "{solve:?}");

    // A circle is noticed, and so is a module that the list does not have.
    uses.get_mut("accuracy")
        .expect("the module")
        .insert("driver".to_owned());
    assert_eq!(upward(&uses, &order), ["`accuracy` uses `driver`"]);
    uses.insert("new".to_owned(), BTreeSet::new());
    assert_eq!(upward(&uses, &order).len(), 2);
}

#[test]
fn uses_are_found_in_code_only() {
    let source = "
//! crate::comment
use crate::{Model, a::{b, c}, d};
use crate::e::F; // crate::g
const TEXT: &str = \"crate::h\";
fn f() { crate::i::j(); }

#[cfg(test)]
mod tests {
    use crate::k;
}
";
    let found: Vec<String> = uses(&code(source)).into_iter().collect();
    assert_eq!(found, ["Model", "a", "d", "e", "i"]);
}

/// Options that the texts of a source name: `--word`, outside comments and unit tests.
fn options(source: &str) -> Vec<String> {
    let product = source.split("#[cfg(test)]\nmod tests").next().unwrap_or_default();
    let lines = product.lines().filter(|line| !line.trim_start().starts_with("//"));
    lines
        .flat_map(|line| {
            line.match_indices("--").filter_map(|(at, _)| {
                let before = line[..at].chars().next_back().unwrap_or('`');
                let word: String = line[at + 2..].chars().take_while(char::is_ascii_lowercase).collect();
                (word.len() > 2 && "`\" (='".contains(before)).then(|| format!("--{word}"))
            })
        })
        .collect()
}

#[test]
fn no_library_names_an_option() {
    for library in ["scene", "spatial", "store", "hemicube", "solve", "export"] {
        let mut files = Vec::new();
        sources(&workspace().join("crates").join(library).join("src"), &mut files);
        assert!(!files.is_empty());
        for file in files {
            let source = std::fs::read_to_string(&file).expect("a source");
            assert_eq!(options(&source), Vec::<String>::new(), "{}", file.display());
        }
    }
    let source = "// `--left`\nlet text = \"cut it by `--split 2`, or --flip\";\nlet less = n--m;\n";
    assert_eq!(options(source), ["--split", "--flip"]);
}
