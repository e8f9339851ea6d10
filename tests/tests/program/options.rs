//! Every option of every command changes what comes of it, is refused, or is said to have no effect: `options.txt` has a
//! line for each and for each combination that matters, and the help of the commands, made of their definition, says
//! which there are.

use hemicube_tests::runs::{TIME_LIMIT, command_in, files};
use hemicube_tests::scenes::program;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::fs::File;
use std::path::Path;
use std::process::Stdio;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;
use tempfile::TempDir;

const TABLE: &str = include_str!("options.txt");

/// A line of the table.
#[derive(Clone, Debug)]
struct Row {
    line: usize,
    base: String,
    option: String,
    outcome: String,
}

impl Row {
    fn parse(line: usize, text: &str) -> Self {
        let (words, outcome) = text
            .rsplit_once(" = ")
            .unwrap_or_else(|| panic!("line {line}: no outcome"));
        let (base, option) = words
            .split_once("++")
            .unwrap_or_else(|| panic!("line {line}: no option"));
        Self {
            line,
            base: base.trim().to_owned(),
            option: option.trim().to_owned(),
            outcome: outcome.trim().to_owned(),
        }
    }

    /// The command, of one word or two.
    fn command(&self) -> String {
        command_of(&self.base)
    }

    fn name(&self) -> &str {
        self.option.split_whitespace().next().unwrap_or_default()
    }

    /// The words in quotes of the outcome.
    fn text(&self) -> &str {
        self.outcome
            .split_once('"')
            .map_or("", |(_, text)| text.trim_end_matches('"'))
    }
}

fn command_of(base: &str) -> String {
    let words: Vec<&str> = base.split_whitespace().take(2).collect();
    match words[..] {
        ["view" | "backends", inner] => format!("{} {inner}", words[0]),
        _ => words.first().copied().unwrap_or_default().to_owned(),
    }
}

/// The table, with the lines of `*` written out for every command that has none of its own.
fn rows() -> Vec<Row> {
    let lines = (1..).zip(TABLE.lines().map(str::trim));
    let all: Vec<Row> = lines
        .filter(|(_, text)| !text.is_empty() && !text.starts_with('#'))
        .map(|(line, text)| Row::parse(line, text))
        .collect();
    let mut first: BTreeMap<String, String> = BTreeMap::new();
    for row in all.iter().filter(|row| row.base != "*") {
        first.entry(row.command()).or_insert_with(|| row.base.clone());
    }
    let own: BTreeSet<(String, String)> = all
        .iter()
        .filter(|row| row.base != "*")
        .map(|row| (row.command(), row.name().to_owned()))
        .collect();
    let mut found = Vec::new();
    for row in all {
        if row.base != "*" {
            found.push(row);
            continue;
        }
        for (command, base) in &first {
            if !own.contains(&(command.clone(), row.name().to_owned())) {
                found.push(Row {
                    base: base.clone(),
                    ..row.clone()
                });
            }
        }
    }
    found
}

/// What came of a run: exit code, standard output and error, and the files that are new or others.
#[derive(Clone, Debug, PartialEq)]
struct Ran {
    code: Option<i32>,
    out: String,
    err: String,
    files: BTreeMap<String, Vec<u8>>,
}

impl Ran {
    fn has(&self, text: &str) -> bool {
        let within = |bytes: &Vec<u8>| bytes.windows(text.len()).any(|at| at == text.as_bytes());
        self.out.contains(text) || self.err.contains(text) || self.files.values().any(within)
    }

    /// Standard error has times in it.
    fn is(&self, other: &Self) -> bool {
        (self.code, &self.out, &self.files) == (other.code, &other.out, &other.files)
    }
}

/// Files that the lines of the table are about.
struct Fixture {
    folder: TempDir,
    files: BTreeMap<String, Vec<u8>>,
    /// Folders with these files that no run is in.
    free: Mutex<Vec<TempDir>>,
    /// Runs without options, which many lines share, and whether a second run was the same.
    bases: Mutex<HashMap<String, Ran>>,
    steady: Mutex<HashMap<String, bool>>,
}

fn run_in(folder: &Path, line: &str) -> (Option<i32>, String, String) {
    let words = line.split_whitespace().filter(|word| !word.starts_with('<'));
    let answers = line.split_whitespace().find_map(|word| word.strip_prefix('<'));
    let stdin = answers.map_or_else(Stdio::null, |name| {
        File::open(folder.join(name)).expect("answers").into()
    });
    let mut command = command_in(&program(), folder);
    let output = command.args(words).stdin(stdin).output().expect("the program runs");
    let place = folder.display().to_string();
    let text = |bytes: Vec<u8>| String::from_utf8_lossy(&bytes).replace(&place, "HERE");
    let (out, err) = (text(output.stdout), text(output.stderr));
    assert!(!err.contains("panicked"), "{line}: {err}");
    (output.status.code(), out, err)
}

/// A box of five faces, without a floor.
fn block(name: &str, [x0, y0, x1, y1, h]: [u32; 5], base: usize) -> String {
    let corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)];
    let mut text = format!("o {name}\nusemtl stone\n");
    for z in [0, h] {
        for (x, y) in corners {
            text.push_str(&format!("v {x} {y} {z}\n"));
        }
    }
    for face in [[1, 2, 6, 5], [2, 3, 7, 6], [3, 4, 8, 7], [4, 1, 5, 8], [5, 6, 7, 8]] {
        let words = face.map(|corner| (corner + base).to_string());
        text.push_str(&format!("f {}\n", words.join(" ")));
    }
    text
}

/// An array as NumPy writes it, of a number that grows from column to column.
fn npy(rows: usize, columns: usize, value: f64) -> Vec<u8> {
    let mut header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({rows}, {columns}), }}");
    while !(header.len() + 11).is_multiple_of(64) {
        header.push(' ');
    }
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend(u16::try_from(header.len()).expect("short").to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend((0..rows * columns).flat_map(|at| (value + 0.01 * (at % columns) as f64).to_le_bytes()));
    bytes
}

impl Fixture {
    /// A yard with a block, a hut and a pane; the matrices, sky rows and solutions of it; and what else options name.
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let write = |name: &str, bytes: &[u8]| {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().expect("a parent")).expect("a folder");
            std::fs::write(path, bytes).expect("a file");
        };
        let yard = format!(
            "mtllib yard.mtl\no ground\nusemtl grass\nv 0 0 0\nv 10 0 0\nv 10 10 0\nv 0 10 0\nf 1 2 3 4\n{}{}o \
             glass\nusemtl pane\nv 5 1 0\nv 5 3 0\nv 5 3 2\nv 5 1 2\nf 21 22 23 24\nf 24 23 22 21\n",
            block("block", [2, 2, 4, 4, 3], 4),
            block("hut", [6, 6, 8, 8, 2], 12)
        );
        let lone = "o inner\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
        for (name, text) in [
            ("yard.obj", yard.as_str()),
            (
                "yard.mtl",
                "newmtl grass\nKd 0.2 0.3 0.1\nnewmtl stone\nKd 0.5 0.5 0.5\nnewmtl pane\nKd 0.1 0.1 0.1\n",
            ),
            (
                "cell.obj",
                "o ground\nv 0 0 0\nv 4 0 0\nv 4 4 0\nv 0 4 0\nf 1 2 3 4\no roof\nv 1 1 2\nv 3 1 2\nv 3 3 2\nv 1 3 2\nf \
                 8 7 6 5\n",
            ),
            (
                "sheet.obj",
                "o sheet\nv 0 0 0\nv 4 0 0\nv 4 4 0\nv 0 4 0\nf 1 2 3 4\no same\nf 1 2 3\no lid\nv 0 0 1\nv 4 0 1\nv 4 4 \
                 1\nf 7 6 5\n",
            ),
            ("scenes/inner.obj", lone),
            (
                "copies.inp",
                "*NODE\n1,0,0,0\n2,1,0,0\n3,0,1,0\n*ELEMENT,TYPE=S3,ELSET=A\n1,1,2,3\n*ELGEN,ELSET=A\n1,1001,0,1,1000,0,\
                 1001\n",
            ),
            (
                "two.vs3",
                "T two\nF 3\nV 1 0 0 0\nV 2 1 0 0\nV 3 1 1 0\nV 4 0 1 0\nV 5 0 0 1\nV 6 1 0 1\nV 7 1 1 1\nV 8 0 1 1\nS 1 \
                 1 2 3 4 0 0 0.9 low\nS 2 8 7 6 5 0 0 0.9 high\nEnd of data\n",
            ),
            ("glass.toml", "[object.glass]\ntransmittance = 0.7\nspecular = 0.1\n"),
            (
                "light.toml",
                "[default]\nreflectance = 0.4\n[object.ground]\nreflectance = 0.5\nemission = 10\n",
            ),
            ("grey.toml", "bands = [\"all\"]\n[default]\nreflectance = 0.5\n"),
            (
                "heat.toml",
                "[default]\ntemperature = 290\nemissivity = 0.8\n[object.ground]\ntemperature = 310\nemissivity = 0.9\n",
            ),
            (
                "adiabatic.toml",
                "[default]\nadiabatic = true\nemissivity = 0.8\n[object.ground]\ntemperature = 300\nemissivity = 0.9\n",
            ),
            ("people.txt", "1 1 1\n5 5 1.5\n"),
            ("one.txt", "1 2 0.5\n"),
            ("low.txt", "30 30 1\n"),
            ("eyes.txt", "1 1 1 0 0 1\n5 5 1.5 1 0 0\n"),
            ("suns.txt", "0.3 0.2 0.9\n-0.5 0 0.8\n"),
            (
                "day.csv",
                "time,x,y,z,direct,diffuse,sky\n9:00,0.5,-0.5,0.5,700,90,overcast\nnoon,0,-0.5,0.9,800,100,clear\n",
            ),
            ("year.epw", &hemicube_tests::weather::epw()),
            ("nadir.txt", "0.3 0.2 0.9\n-0.5 0 -0.8\n"),
            ("load.csv", "surface,night,noon\nground,0,600\nhut,0,200\n"),
            ("hours.csv", "time,ground,(surroundings)\nnight,280,270\nnoon,300,290\n"),
            ("warm.csv", "ground,310\n*,290\n"),
            ("order.txt", "hut\nground\nglass\nblock\n"),
            ("answers.txt", "1\n1\n"),
            ("plugins/libhemicube_backend_broken.so", "no library\n"),
            ("set.toml", "tolerance = 0.05\nseed = 4\n"),
            ("hemicube.toml", "tolerance = 0.03\nseed = 3\n"),
        ] {
            write(name, text.as_bytes());
        }
        for ending in ["csv", "png", "npz", "html", "obj", "svg"] {
            write(&format!("old.{ending}"), b"old\n");
        }
        write("emission.npy", &npy(1, 26, 5.0));
        write("emission3.npy", &npy(3, 26, 5.0));
        write("radiance.npy", &npy(3, 146, 1.0));
        for line in [
            "compute yard.obj -o yard.hc --config=none",
            "compute yard.obj -o glass.hc --specular glass.toml --config=none",
            "compute yard.obj -o tight.hc --tolerance 1% --config=none",
            "compute yard.obj -o balanced.hc --config=none",
            "compute yard.obj -o pixels.hc --correction pixel --config=none",
            "compute yard.obj -o part.hc --shard 1/2 --config=none",
            "sky yard.obj --matrix yard.hc --up z",
            "sky yard.obj -o sky2 --up z --north 90",
            "solve yard.hc --materials light.toml",
            "solve yard.hc --thermal --materials heat.toml --sky-temperature 270",
            "solve yard.hc --thermal --materials heat.toml --sky-temperature 280 --solution cool",
        ] {
            let (code, out, err) = run_in(folder.path(), line);
            assert_eq!(code, Some(0), "{line}: {out}{err}");
        }
        Self {
            files: files(folder.path()),
            folder,
            free: Mutex::default(),
            bases: Mutex::default(),
            steady: Mutex::default(),
        }
    }

    /// Runs a line in a folder of its own with these files, and none but these.
    fn run(&self, line: &str) -> Ran {
        let free = self.free.lock().expect("no panic").pop();
        let folder = free.unwrap_or_else(|| {
            let folder = tempfile::tempdir().expect("a folder");
            copy(self.folder.path(), folder.path());
            folder
        });
        let (code, out, err) = run_in(folder.path(), line);
        let mut files = files(folder.path());
        self.restore(folder.path(), &files);
        self.free.lock().expect("no panic").push(folder);
        files.retain(|name, bytes| self.files.get(name) != Some(bytes));
        Ran { code, out, err, files }
    }

    /// Makes a folder in which these files were found what it was: copying all of them for each line takes longer than
    /// most lines.
    fn restore(&self, folder: &Path, found: &BTreeMap<String, Vec<u8>>) {
        prune(folder, self.folder.path());
        let is_other =
            |(name, bytes): &(&String, &Vec<u8>)| found.get(*name) != Some(bytes) || !folder.join(name).exists();
        for (name, bytes) in self.files.iter().filter(is_other) {
            let path = folder.join(name);
            std::fs::create_dir_all(path.parent().expect("a parent")).expect("a folder");
            std::fs::write(path, bytes).expect("a file");
        }
    }

    fn base(&self, line: &str) -> Ran {
        if let Some(found) = self.bases.lock().expect("no panic").get(line) {
            return found.clone();
        }
        let found = self.run(line);
        self.bases
            .lock()
            .expect("no panic")
            .insert(line.to_owned(), found.clone());
        found
    }

    /// Whether a second run is as `first`. A run that differs from itself would change with any option.
    fn is_steady(&self, line: &str, first: &Ran) -> bool {
        if let Some(&found) = self.steady.lock().expect("no panic").get(line) {
            return found;
        }
        let found = self.run(line).is(first);
        self.steady.lock().expect("no panic").insert(line.to_owned(), found);
        found
    }

    /// What speaks against a line of the table.
    fn fault(&self, row: &Row, helps: &BTreeMap<String, BTreeMap<String, String>>) -> Option<String> {
        let before = self.base(&row.base);
        let after = self.run(&format!("{} {}", row.base, row.option));
        let text = row.text();
        let kind = row.outcome.split_whitespace().next().unwrap_or_default();
        let holds = match kind {
            "changes" => !after.is(&before) && matches!(after.code, Some(0 | 1)) && self.is_steady(&row.base, &before),
            "has" => !text.is_empty() && after.has(text) && !before.has(text),
            "lacks" => !text.is_empty() && before.has(text) && !after.has(text),
            "refused" => {
                let needs = "the following required arguments were not provided";
                after.code == Some(2) && before.code != Some(2) && {
                    after.err.contains(row.name()) || after.err.contains(needs)
                }
            }
            "same" => {
                let help = helps.get(&row.command()).and_then(|help| help.get(row.name()));
                let is_said = match help {
                    Some(help) => !text.is_empty() && help.contains(text),
                    None => text.is_empty(),
                };
                after.is(&before) && is_said
            }
            "quiet" => after.is(&before) && after.err.lines().all(|line| line.starts_with("warning: ")),
            "verbose" => after.err.lines().count() >= before.err.lines().count() && after.code == before.code,
            _ => return Some(format!("line {}: `{kind}` is no outcome", row.line)),
        };
        (!holds).then(|| {
            format!(
                "line {}: {} ++ {} is not `{}`: exit {:?} and {:?}, {}; {}",
                row.line,
                row.base,
                row.option,
                row.outcome,
                before.code,
                after.code,
                if after.is(&before) {
                    "nothing changes"
                } else {
                    "the results are others"
                },
                after.err.chars().take(400).collect::<String>()
            )
        })
    }
}

/// Removes what `like` does not have, or has as something else.
fn prune(folder: &Path, like: &Path) {
    for entry in std::fs::read_dir(folder).expect("a folder").flatten() {
        let (path, wanted) = (entry.path(), like.join(entry.file_name()));
        let kind = entry.file_type().expect("a type");
        let is_same = std::fs::symlink_metadata(&wanted).is_ok_and(|wanted| wanted.file_type() == kind);
        match (kind.is_dir(), is_same) {
            (true, true) => prune(&path, &wanted),
            (true, false) => std::fs::remove_dir_all(&path).expect("a folder that a run made"),
            (false, true) => {}
            (false, false) => std::fs::remove_file(&path).expect("a file that a run wrote"),
        }
    }
}

fn copy(from: &Path, to: &Path) {
    for entry in std::fs::read_dir(from).expect("a folder").flatten() {
        let target = to.join(entry.file_name());
        if entry.file_type().expect("a type").is_dir() {
            std::fs::create_dir_all(&target).expect("a folder");
            copy(&entry.path(), &target);
        } else {
            std::fs::copy(entry.path(), target).expect("a copy");
        }
    }
}

/// The commands and what the help of each says of each option, by clap's own definition.
fn helps() -> BTreeMap<String, BTreeMap<String, String>> {
    let folder = tempfile::tempdir().expect("a folder");
    let mut found = BTreeMap::new();
    let mut due = vec![String::new()];
    while let Some(command) = due.pop() {
        let (code, text, err) = run_in(folder.path(), format!("{command} --help").trim());
        assert_eq!(code, Some(0), "{command}: {err}");
        let mut is_list = false;
        let mut options: BTreeMap<String, String> = BTreeMap::new();
        let mut current = None;
        let mut inner = Vec::new();
        for line in text.lines() {
            let indent = line.len() - line.trim_start().len();
            let first = line.split_whitespace().next().unwrap_or_default();
            if indent == 0 && !line.is_empty() {
                is_list = line == "Commands:";
                current = None;
            } else if is_list && indent == 2 {
                inner.push(format!("{command} {first}").trim().to_owned());
            } else if (indent == 2 || indent == 6) && first.starts_with('-') {
                let name = line
                    .split([' ', ',', '[', '='])
                    .find(|word| word.starts_with("--"))
                    .unwrap_or(first);
                options.insert(name.to_owned(), String::new());
                current = Some(name.to_owned());
            } else if let Some(help) = current.as_ref().and_then(|name| options.get_mut(name)) {
                if !help.is_empty() {
                    help.push(' ');
                }
                help.push_str(line.trim());
            }
        }
        if inner.is_empty() {
            options.retain(|name, _| name != "--help" && name != "--version");
            found.insert(command, options);
        }
        due.extend(inner);
    }
    found
}

/// Commands that stand for another program, with no options of their own, or take minutes; each has tests of its own.
const WITHOUT_LINES: [&str; 4] = ["completions", "manual", "view3d", "backends header"];

#[test]
fn every_option_of_every_command_has_a_line() {
    let helps = helps();
    assert!(helps.len() > 20 && helps["compute"].len() > 30, "the help is read");
    let known: BTreeSet<(String, String)> = rows()
        .iter()
        .map(|row| (row.command(), row.name().to_owned()))
        .collect();
    let mut missing = Vec::new();
    for (command, options) in &helps {
        for option in options.keys().filter(|_| !WITHOUT_LINES.contains(&command.as_str())) {
            if !known.contains(&(command.clone(), option.clone())) {
                missing.push(format!("{command} {option}"));
            }
        }
    }
    assert!(
        missing.is_empty(),
        "`options.txt` has no line that says what these do: {missing:?}"
    );
    for (command, option) in known {
        let hidden = [("compute", "--batch")].contains(&(command.as_str(), option.as_str()));
        assert!(
            hidden || helps.get(&command).is_some_and(|options| options.contains_key(&option)),
            "`options.txt` has `{option}` of `{command}`, and the command has none"
        );
    }
}

#[test]
fn every_option_has_an_effect_is_refused_or_says_that_it_has_none() {
    let (fixture, helps, rows) = (Fixture::new(), helps(), rows());
    let (next, faults, started) = (AtomicUsize::new(0), Mutex::new(Vec::new()), Instant::now());
    std::thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| {
                while let Some(row) = rows.get(next.fetch_add(1, Ordering::Relaxed)) {
                    if let Some(fault) = fixture.fault(row, &helps) {
                        faults.lock().expect("no panic").push(fault);
                    }
                    assert!(started.elapsed() < 4 * TIME_LIMIT, "the lines take too long");
                }
            });
        }
    });
    let mut faults = faults.into_inner().expect("no panic");
    faults.sort();
    assert!(
        faults.is_empty(),
        "{} of {}:\n{}",
        faults.len(),
        rows.len(),
        faults.join("\n")
    );
}

#[test]
fn a_line_that_does_not_hold_is_found() {
    let (fixture, helps) = (Fixture::new(), helps());
    for wrong in [
        "compute yard.obj -o out ++ --threads 1 = changes",
        "compute yard.obj -o out --correction pixel ++ --resolution 64 = same \"Pixels along an edge\"",
        "compute yard.obj -o out ++ --threads 1 = same \"no such words\"",
        "compute yard.obj -o out ++ --split 2 = refused",
        "compute yard.obj -o out ++ --split 2 = has \"no such words\"",
        "compute yard.obj -o out ++ --split 2 = lacks \"no such words\"",
        "compute yard.obj -o out ++ --verbose = quiet",
        "compute yard.obj -o out ++ --quiet = verbose",
        // It says its times, and so differs from itself.
        "compute yard.obj -o out --verbose ++ --seed 5 = changes",
    ] {
        assert!(fixture.fault(&Row::parse(1, wrong), &helps).is_some(), "{wrong}");
    }
}
