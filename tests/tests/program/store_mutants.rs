//! Matrices, solutions and sky rows as an attacker sends them, to every command: whatever is changed, and sealed again,
//! a command ends with a code of its own, never by a panic or a signal, takes no memory beyond a bound, and makes
//! nothing of what no matrix can hold.
//!
//! A short run each time; the long one:
//! `cargo test --release -p hemicube-tests --test program -- store_mutants:: --ignored`
#![cfg(unix)]

use hemicube_tests::random::Random;
use hemicube_tests::runs::{Place, files};
use std::io::{Cursor, Read, Write};
use std::path::Path;
use std::process::{Command, Stdio};

/// Kilobytes of address space that a command may have: a claim that no file backs is larger.
const ADDRESS_SPACE: u64 = 3_000_000;

/// Commands that read a matrix `m`, and what each leaves.
const COMMANDS: [(&str, &[&str]); 17] = [
    ("check m", &[]),
    ("export m -o o.npz", &["o.npz"]),
    ("export m -o o.mtx", &["o.mtx"]),
    ("export m -o o.npy", &["o.npy"]),
    ("export m -o o.parquet", &["o.parquet"]),
    ("export m -o o.csv", &["o.csv"]),
    ("export m -o o.csv --by object", &["o.csv"]),
    ("export m -o o.npz --with-sky", &["o.npz"]),
    ("export m -o o.ply --scene room.obj", &["o.ply"]),
    ("export m -o o.vtp --scene room.obj", &["o.vtp"]),
    ("solve m --materials lit.toml --solution new -o o.csv", &["o.csv"]),
    ("sky room.obj --up y --matrix m", &["m/sky/sky.npz"]),
    ("view model m room.obj -o o.png --show seen", &["o.png"]),
    ("view sparsity m -o o.png", &["o.png"]),
    ("report m room.obj -o o.html", &["o.html"]),
    ("balance m -o o --reciprocity", &["o/parts/part-00000.npz"]),
    ("compare m whole", &[]),
];

/// A file of a matrix, and what of it no matrix can hold if it is changed to nonsense.
const FILES: [(&str, &[&str]); 6] = [
    ("parts/part-00000.npz", &["data", "indices", "rows"]),
    ("parts/part-00001.npz", &["data", "indices", "rows"]),
    ("patches.npz", &["area", "object", "material", "side"]),
    ("solutions/radiosity/radiosity.npy", &[]),
    ("sky/sky.npz", &[]),
    ("manifest.json", &[]),
];

/// A room of 160 patches in 3 parts, its light and its sky.
fn whole(place: &Place) {
    let room = hemicube_tests::scenes::workspace().join("crates/scene/data/cornell-box.obj");
    std::fs::copy(room, place.path("room.obj")).expect("a scene");
    std::fs::write(
        place.path("lit.toml"),
        "[default]\nreflectance = 0.5\n[material.light]\nemission = 1\n",
    )
    .expect("a file");
    place.line("compute room.obj --split 2 -o whole -q").is(0);
    place.line("sky room.obj --up y --matrix whole -q").is(0);
    place.line("solve whole --materials lit.toml -q").is(0);
}

/// Runs a command in bounded memory: its exit code, the bytes that it left, and whether it warned.
fn made(place: &Place, (line, left): (&str, &[&str])) -> (Option<i32>, Vec<u8>, bool) {
    let program = hemicube_tests::scenes::program();
    let script = format!("ulimit -v {ADDRESS_SPACE}; exec \"$0\" \"$@\"");
    let output = Command::new("bash")
        .args(["-c", &script])
        .arg(program)
        .args(line.split_whitespace())
        .current_dir(place.path(""))
        .env("HOME", place.path("home"))
        .stdin(Stdio::null())
        .output()
        .expect("it starts");
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!text.contains("panicked"), "{line}: {text}");
    let mut bytes = output.stdout;
    for name in left {
        bytes.extend(std::fs::read(place.path(name)).unwrap_or_default());
    }
    (output.status.code(), bytes, text.contains("warning:"))
}

/// Seals a manifest, whatever it says.
fn seal(manifest: &mut serde_json::Value) -> Option<Vec<u8>> {
    let fields = manifest.as_object_mut()?;
    fields.remove("blake3");
    let mut text = serde_json::to_string_pretty(fields).ok()?;
    text.truncate(text.len().checked_sub("\n}".len())?);
    let checksum = blake3::hash(text.as_bytes()).to_hex();
    Some(format!("{text},\n  \"blake3\": \"{checksum}\"\n}}\n").into_bytes())
}

/// Has the manifest of `m` agree with its files.
fn agree(place: &Place) {
    let path = place.path("m/manifest.json");
    let mut manifest: serde_json::Value =
        serde_json::from_slice(&std::fs::read(&path).expect("a file")).expect("a manifest");
    let sum = |name: &str| {
        blake3::hash(&std::fs::read(place.path(format!("m/{name}"))).expect("a file"))
            .to_hex()
            .to_string()
    };
    manifest["patches"]["blake3"] = sum("patches.npz").into();
    for part in manifest["parts"].as_array_mut().expect("parts") {
        let name = part["file"].as_str().expect("a name").to_owned();
        part["blake3"] = sum(&name).into();
    }
    std::fs::write(&path, seal(&mut manifest).expect("a manifest")).expect("written");
}

/// Replaces an element of a NumPy array by nonsense: what no index and no share is.
fn nonsense(array: &mut [u8], random: &mut Random) {
    let head = 10 + usize::from(u16::from_le_bytes([array[8], array[9]]));
    let header = String::from_utf8_lossy(&array[10..head]).into_owned();
    let word = |kind: &str| header.contains(&format!("'{kind}'"));
    let pick = |random: &mut Random, of: &[Vec<u8>]| of[random.below(of.len())].clone();
    let floats = [f64::NAN, f64::INFINITY, -1.0, -1e300];
    let bytes = if word("<f8") {
        pick(random, &floats.map(|x| x.to_le_bytes().to_vec()))
    } else if word("<f4") {
        #[allow(clippy::cast_possible_truncation, reason = "infinite then, as wanted")]
        let floats = floats.map(|x| (x as f32).to_le_bytes().to_vec());
        pick(random, &floats)
    } else if word("<i4") || word("<u4") {
        pick(random, &[u32::MAX, 1 << 31, 1 << 24].map(|x| x.to_le_bytes().to_vec()))
    } else if word("<i8") || word("<u8") {
        pick(random, &[u64::MAX, 1 << 63, 1 << 40].map(|x| x.to_le_bytes().to_vec()))
    } else {
        vec![0xFE]
    };
    let count = (array.len() - head) / bytes.len();
    if count > 0 {
        let at = head + random.below(count) * bytes.len();
        array[at..at + bytes.len()].copy_from_slice(&bytes);
    }
}

/// Flips, cuts or repeats bytes.
fn scramble(bytes: &mut Vec<u8>, random: &mut Random) {
    for _ in 0..1 + random.below(3) {
        let at = random.below(bytes.len().max(1));
        match random.below(4) {
            0 if at < bytes.len() => bytes[at] ^= 1 << random.below(8),
            1 => bytes.truncate(at),
            2 => {
                let end = (at + 1 + random.below(16)).min(bytes.len());
                let copy = bytes[at..end].to_vec();
                bytes.splice(at..at, copy);
            }
            _ => bytes[at..].iter_mut().take(8).for_each(|byte| *byte = 0xFF),
        }
    }
}

/// Changes one member of an archive and writes it whole again.
fn change_member(path: &Path, wanted: Option<&[&str]>, random: &mut Random) {
    let bytes = std::fs::read(path).expect("a file");
    let mut archive = zip::ZipArchive::new(Cursor::new(&bytes)).expect("an archive");
    let mut members = Vec::new();
    for place in 0..archive.len() {
        let mut member = archive.by_index(place).expect("a member");
        let mut content = Vec::new();
        member.read_to_end(&mut content).expect("its bytes");
        members.push((member.name().expect("a name").into_owned(), content));
    }
    let among: Vec<usize> = (0..members.len())
        .filter(|&at| wanted.is_none_or(|wanted| wanted.iter().any(|name| members[at].0 == format!("{name}.npy"))))
        .collect();
    let (_, content) = &mut members[among[random.below(among.len())]];
    if wanted.is_some() || random.below(2) == 0 {
        nonsense(content, random);
    } else {
        scramble(content, random);
    }
    let mut out = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let stored = zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
    for (name, content) in members {
        out.start_file(name, stored).expect("a member");
        out.write_all(&content).expect("its bytes");
    }
    std::fs::write(path, out.finish().expect("an archive").into_inner()).expect("written");
}

/// Replaces a number anywhere in a JSON value.
fn change_number(value: &mut serde_json::Value, random: &mut Random) {
    match value {
        serde_json::Value::Object(fields) if !fields.is_empty() => {
            let at = random.below(fields.len());
            if let Some((_, field)) = fields.iter_mut().nth(at) {
                change_number(field, random);
            }
        }
        serde_json::Value::Array(list) if !list.is_empty() => {
            let at = random.below(list.len());
            change_number(&mut list[at], random);
        }
        _ => {
            let wild = [0, 1, 41, 1 << 31, u64::from(u32::MAX), 1 << 40, u64::MAX];
            *value = wild[random.below(wild.len())].into();
        }
    }
}

/// Changes `m`; whether what was done is what no matrix can hold, or was not sealed.
fn mutate(place: &Place, random: &mut Random) -> (String, bool) {
    let (name, never) = FILES[random.below(FILES.len())];
    let path = place.path(format!("m/{name}"));
    if random.below(5) == 0 && never.len() > 1 {
        let mut bytes = std::fs::read(&path).expect("a file");
        scramble(&mut bytes, random);
        std::fs::write(&path, bytes).expect("written");
        return (format!("{name}, not sealed"), true);
    }
    if name.ends_with(".json") {
        let bytes = std::fs::read(&path).expect("a file");
        let mut manifest: serde_json::Value = serde_json::from_slice(&bytes).expect("JSON");
        change_number(&mut manifest, random);
        if let Some(bytes) = seal(&mut manifest) {
            std::fs::write(&path, bytes).expect("written");
        }
        return (name.to_owned(), false);
    }
    if name.ends_with(".npy") {
        let mut bytes = std::fs::read(&path).expect("a file");
        if random.below(2) == 0 {
            nonsense(&mut bytes, random);
        } else {
            scramble(&mut bytes, random);
        }
        std::fs::write(&path, bytes).expect("written");
        return (name.to_owned(), false);
    }
    let is_never = !never.is_empty() && random.below(3) > 0;
    change_member(&path, is_never.then_some(never), random);
    if !never.is_empty() {
        agree(place);
    }
    (format!("{name}{}", if is_never { ", nonsense" } else { "" }), is_never)
}

fn mutants(count: usize, seed: u64) {
    let place = Place::new();
    whole(&place);
    let originals = files(&place.path("whole"));
    let restore = || {
        let _ = std::fs::remove_dir_all(place.path("m"));
        let _ = std::fs::remove_dir_all(place.path("o"));
        for name in [
            "o.npz",
            "o.mtx",
            "o.npy",
            "o.parquet",
            "o.csv",
            "o.ply",
            "o.vtp",
            "o.png",
            "o.html",
        ] {
            let _ = std::fs::remove_file(place.path(name));
        }
        let _ = std::fs::remove_file(place.path("o.columns.csv"));
        for (name, bytes) in &originals {
            let path = place.path(format!("m/{name}"));
            std::fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
            std::fs::write(path, bytes).expect("written");
        }
    };
    let wanted: Vec<_> = COMMANDS
        .iter()
        .map(|&command| {
            restore();
            let (code, bytes, _) = made(&place, command);
            assert_eq!(code, Some(0), "{}", command.0);
            bytes
        })
        .collect();
    let mut random = Random(seed);
    let mut refused = 0;
    for number in 0..count {
        restore();
        let (change, is_never) = mutate(&place, &mut random);
        let at = random.below(COMMANDS.len());
        let (code, bytes, warned) = made(&place, COMMANDS[at]);
        let of = || format!("mutant {number} of seed {seed} ({change}): {}", COMMANDS[at].0);
        // 0, 1 where a check fails, 2 for what is refused; nothing by a signal.
        assert!(matches!(code, Some(0..=2)), "{}: {code:?}", of());
        // A solution of a matrix that was another is left out, with a warning.
        if is_never && code == Some(0) && !warned {
            assert!(bytes == wanted[at], "{} ends with 0 and other bytes", of());
        }
        refused += usize::from(code != Some(0));
    }
    assert!(refused * 2 > count, "{refused} of {count}: most mutants are none");
}

#[test]
fn mutants_of_matrices_are_refused_by_every_command() {
    mutants(300, 1);
}

#[test]
#[ignore = "minutes; `./test --full` runs it"]
fn very_many_mutants_of_matrices_are_refused_by_every_command() {
    mutants(20_000, 2);
}
