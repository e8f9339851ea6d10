//! Readers of the solvers' files, as small as they can be, by what the solvers' own readers take.

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "numbers of rows and columns are small and whole"
)]

use serde_json::Value;

/// A matrix by rows.
pub(crate) type Dense = Vec<Vec<f64>>;

fn numbers(text: &str) -> impl Iterator<Item = f64> {
    text.split_whitespace().map(|word| word.parse().expect("a number"))
}

/// Elmer: for each row its number of entries, then `i j F` from 1; `i` is skipped there, held against the row here.
pub(crate) fn elmer(text: &str, rows: usize) -> Dense {
    let mut words = numbers(text);
    let mut next = || words.next().expect("the file goes on");
    let mut matrix = vec![vec![0.0; rows]; rows];
    for (number, row) in matrix.iter_mut().enumerate() {
        for _ in 0..next() as usize {
            assert_eq!(next() as usize, number + 1);
            let column = next() as usize - 1;
            row[column] = next();
        }
    }
    assert!(words.next().is_none(), "the file ends");
    matrix
}

/// uDALES: lines `i j F` from 1, and a header line before a sky view factor a line; the matrix, these, the lines.
pub(crate) fn udales(factors: &str, sky: &str) -> (Dense, Vec<f64>, u64) {
    let sky: Vec<f64> = sky
        .lines()
        .skip(1)
        .map(|line| line.trim().parse().expect("a number"))
        .collect();
    let mut matrix = vec![vec![0.0; sky.len()]; sky.len()];
    let mut lines = 0;
    for line in factors.lines() {
        let words: Vec<f64> = numbers(line).collect();
        let [i, j, factor] = words[..] else {
            panic!("three words: {line}")
        };
        matrix[i as usize - 1][j as usize - 1] = factor;
        lines += 1;
    }
    (matrix, sky, lines)
}

/// Tokens of an OpenFOAM file after its header.
fn foam(text: &str, name: &str, class: &str) -> Vec<String> {
    let (head, body) = text.split_once('}').expect("a header");
    let entry = |word: &str| {
        let line = head
            .lines()
            .find(|line| line.trim_start().starts_with(word))
            .expect("an entry");
        line.trim()
            .trim_end_matches(';')
            .rsplit(' ')
            .next()
            .expect("a value")
            .to_owned()
    };
    assert_eq!(
        (
            entry("object").as_str(),
            entry("class").as_str(),
            entry("format").as_str()
        ),
        (name, class, "ascii")
    );
    body.replace('(', " ( ")
        .replace(')', " ) ")
        .split_whitespace()
        .map(str::to_owned)
        .collect()
}

/// A list of OpenFOAM: its number, `(`, its elements, `)`.
fn list<T>(
    words: &mut std::slice::Iter<'_, String>,
    element: &dyn Fn(&mut std::slice::Iter<'_, String>) -> T,
) -> Vec<T> {
    let count: usize = words
        .next()
        .expect("a number of elements")
        .parse()
        .expect("a number of elements");
    assert_eq!(words.next().map(String::as_str), Some("("));
    let elements = (0..count).map(|_| element(words)).collect();
    assert_eq!(words.next().map(String::as_str), Some(")"));
    elements
}

/// OpenFOAM: `F`, `globalFaceFaces`, `mapDist`; the last must be the map of one process.
pub(crate) fn openfoam([factors, faces, map]: &[String; 3]) -> Dense {
    let number =
        |words: &mut std::slice::Iter<'_, String>| words.next().expect("a word").parse::<f64>().expect("a number");
    let rows = |text: &str, name: &str, class: &str| {
        let words = foam(text, name, class);
        let mut words = words.iter();
        let rows = list(&mut words, &|words| list(words, &number));
        assert!(words.next().is_none());
        rows
    };
    let (factors, faces) = (
        rows(factors, "F", "scalarListList"),
        rows(faces, "globalFaceFaces", "labelListList"),
    );
    let count = factors.len();
    let words = foam(map, "mapDist", "mapDistribute");
    let mut words = words.iter();
    assert_eq!(words.next(), Some(&count.to_string()));
    for _ in 0..2 {
        let lists = list(&mut words, &|words| list(words, &number));
        assert_eq!(lists, [(0..count).map(|face| face as f64).collect::<Vec<_>>()]);
    }
    assert_eq!(
        words.cloned().collect::<Vec<_>>(),
        ["0", "0", "0", "(", ")", "0", "(", ")"]
    );
    let mut matrix = vec![vec![0.0; count]; count];
    for ((row, factors), faces) in matrix.iter_mut().zip(factors).zip(faces) {
        assert_eq!(factors.len(), faces.len());
        for (face, factor) in faces.into_iter().zip(factors) {
            row[face as usize] = factor;
        }
    }
    matrix
}

/// Records of GNU Fortran's unformatted sequential files.
fn records(mut bytes: &[u8]) -> Vec<Vec<u8>> {
    let mut records: Vec<Vec<u8>> = Vec::new();
    let mut goes_on = false;
    while !bytes.is_empty() {
        let mark = |bytes: &[u8]| i32::from_le_bytes(bytes[..4].try_into().expect("four bytes"));
        let before = mark(bytes);
        let length = before.unsigned_abs() as usize;
        let (piece, rest) = bytes[4..].split_at(length);
        assert_eq!(mark(rest).unsigned_abs() as usize, length);
        assert_eq!(
            mark(rest) < 0,
            goes_on,
            "a negative length after a piece that has one before it"
        );
        match records.last_mut() {
            Some(record) if goes_on => record.extend(piece),
            _ => records.push(piece.to_vec()),
        }
        goes_on = before < 0;
        bytes = &rest[4..];
    }
    assert!(!goes_on, "the last record ends");
    records
}

fn doubles(bytes: &[u8]) -> Vec<f64> {
    bytes
        .chunks(8)
        .map(|bytes| f64::from_le_bytes(bytes.try_into().expect("eight bytes")))
        .collect()
}

/// CalculiX: version, matrix, shares of the environment.
pub(crate) fn calculix(bytes: &[u8]) -> (String, Dense, Vec<f64>) {
    let records = records(bytes);
    let [version, diagonal, others, outside] = &records[..] else {
        panic!("four records")
    };
    assert_eq!(version.len(), 80);
    let (diagonal, others) = (doubles(diagonal), doubles(others));
    let count = diagonal.len();
    let half = count * (count - 1) / 2;
    assert_eq!(others.len(), 2 * half);
    let mut matrix = vec![vec![0.0; count]; count];
    let mut place = 0;
    for column in 0..count {
        matrix[column][column] = diagonal[column];
        for row in column + 1..count {
            matrix[row][column] = others[place];
            matrix[column][row] = others[half + place];
            place += 1;
        }
    }
    let version = String::from_utf8(version.clone()).expect("text").trim_end().to_owned();
    (version, matrix, doubles(outside))
}

/// The matrix of `from`, `to`, factor; names in the order of their first `from`.
fn by_name(triples: &[(String, String, f64)]) -> (Vec<String>, Dense) {
    let mut names: Vec<String> = Vec::new();
    for (from, _, _) in triples {
        if !names.contains(from) {
            names.push(from.clone());
        }
    }
    assert_eq!(triples.len(), names.len() * names.len(), "all pairs");
    let place = |name: &str| names.iter().position(|known| known == name).expect("a surface");
    let mut matrix = vec![vec![f64::NAN; names.len()]; names.len()];
    for (from, to, factor) in triples {
        matrix[place(from)][place(to)] = *factor;
    }
    assert!(matrix.iter().flatten().all(|factor| !factor.is_nan()), "each pair once");
    (names, matrix)
}

/// EnergyPlus, IDF: fields by commas up to a semicolon, comments after `!`.
pub(crate) fn energyplus(text: &str) -> (String, Vec<String>, Dense) {
    let code: String = text
        .lines()
        .map(|line| line.split('!').next().unwrap_or_default())
        .collect();
    let (object, rest) = code.split_once(';').expect("an object");
    assert!(rest.trim().is_empty(), "one object");
    let fields: Vec<&str> = object.split(',').map(str::trim).collect();
    assert_eq!(fields[0], "ZoneProperty:UserViewFactors:BySurfaceName");
    let triples: Vec<_> = fields[2..]
        .chunks(3)
        .map(|triple| {
            (
                triple[0].to_owned(),
                triple[1].to_owned(),
                triple[2].parse().expect("a number"),
            )
        })
        .collect();
    let (names, matrix) = by_name(&triples);
    (fields[1].to_owned(), names, matrix)
}

/// EnergyPlus, epJSON, with the zone in a field of this name.
pub(crate) fn epjson(text: &str, zone: &str) -> (String, Vec<String>, Dense) {
    let model: Value = serde_json::from_str(text).expect("JSON");
    let objects = model["ZoneProperty:UserViewFactors:BySurfaceName"]
        .as_object()
        .expect("objects");
    assert_eq!((model.as_object().expect("a model").len(), objects.len()), (1, 1));
    let object = objects.values().next().expect("one");
    let word = |value: &Value| value.as_str().expect("text").to_owned();
    let triples: Vec<_> = object["view_factors"]
        .as_array()
        .expect("pairs")
        .iter()
        .map(|pair| {
            (
                word(&pair["from_surface"]),
                word(&pair["to_surface"]),
                pair["view_factor"].as_f64().expect("a number"),
            )
        })
        .collect();
    let (names, matrix) = by_name(&triples);
    (word(&object[zone]), names, matrix)
}

/// PETSc: big-endian, `MatLoad`'s order.
pub(crate) fn petsc(bytes: &[u8]) -> Dense {
    let mut at = 0;
    let mut whole = || {
        at += 4;
        i32::from_be_bytes(bytes[at - 4..at].try_into().expect("four bytes")) as usize
    };
    assert_eq!(whole(), 1_211_216);
    let (rows, columns, entries) = (whole(), whole(), whole());
    let lengths: Vec<usize> = (0..rows).map(|_| whole()).collect();
    let places: Vec<usize> = (0..entries).map(|_| whole()).collect();
    assert_eq!(lengths.iter().sum::<usize>(), entries);
    assert_eq!(bytes.len() - at, 8 * entries);
    let mut values = bytes[at..]
        .chunks(8)
        .map(|b| f64::from_be_bytes(b.try_into().expect("eight bytes")));
    let mut places = places.into_iter();
    let mut matrix = vec![vec![0.0; columns]; rows];
    for (row, length) in matrix.iter_mut().zip(lengths) {
        let mut last = None;
        for _ in 0..length {
            let place = places.next().expect("a column");
            assert!(last.is_none_or(|last| last < place), "columns ascend");
            (row[place], last) = (values.next().expect("a value"), Some(place));
        }
    }
    matrix
}

/// A view factor file of View3D.
#[derive(Debug)]
pub(crate) struct ViewFactors {
    pub(crate) form: u32,
    pub(crate) encl: u32,
    pub(crate) emit: u32,
    pub(crate) areas: Vec<f64>,
    pub(crate) factors: Dense,
    pub(crate) emittances: Vec<f64>,
}

impl ViewFactors {
    /// The header by View3D's `"%s %s %d %d %d %d"`, then n areas, n² factors, n emittances.
    fn of(head: &str, mut numbers: impl Iterator<Item = f64>) -> Self {
        let words: Vec<&str> = head.split_whitespace().collect();
        let ["View3D", _, form, encl, emit, count] = words[..] else {
            panic!("a header: {head}")
        };
        let number = |word: &str| word.parse::<u32>().expect("a number");
        let count = number(count) as usize;
        let mut take = || numbers.by_ref().take(count).collect::<Vec<f64>>();
        let found = Self {
            form: number(form),
            encl: number(encl),
            emit: number(emit),
            areas: take(),
            factors: (0..count).map(|_| take()).collect(),
            emittances: take(),
        };
        assert!(found.emittances.len() == count && numbers.next().is_none());
        found
    }
}

pub(crate) fn view3d(text: &str) -> ViewFactors {
    let (head, rest) = text.split_at(31);
    assert!(head.ends_with('\n'), "30 characters and a line end");
    ViewFactors::of(head, numbers(rest))
}

pub(crate) fn view3d_binary(bytes: &[u8]) -> ViewFactors {
    let (head, rest) = bytes.split_at(32);
    let head = std::str::from_utf8(head).expect("text");
    assert!(head.ends_with("\r\n"));
    let single = |bytes: &[u8]| f64::from(f32::from_le_bytes(bytes.try_into().expect("four bytes")));
    ViewFactors::of(head, rest.chunks(4).map(single))
}
