//! Stores for tests: random matrices whose weights are exact, and parts and manifests doctored by another zip and NumPy
//! writer than the library's.
#![allow(dead_code, reason = "each test program uses its share")]

use hemicube_store::{
    BackendEntry, FactorVec, Form, HEMICUBE_WEIGHT, Header, Part, PatchTable, RowErrors, RowShares, RowSums,
    SceneEntry, Store, StoreWriter,
};
use npyz::WriterBuilder;
use serde_json::json;
use std::collections::BTreeMap;
use std::io::{Cursor, Read, Write};
use std::path::Path;

/// Numbers that look random and are the same every time (Steele, Lea & Flood 2014, SplitMix64).
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut bits = self.0;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        bits ^ (bits >> 31)
    }

    pub(crate) fn below(&mut self, end: u64) -> u64 {
        self.next() % end
    }
}

/// What a store is made of.
pub(crate) struct Sample {
    pub(crate) header: Header,
    pub(crate) patches: PatchTable,
    pub(crate) parts: Vec<Part>,
}

/// A matrix of `patch_count` patches of which `row_count` rows are computed, in an order that is not the input's.
pub(crate) fn sample(patch_count: u32, row_count: u32, rows_per_part: u32, seed: u64) -> Sample {
    let mut random = Random(seed);
    let mut order: Vec<u32> = (0..patch_count).collect();
    for place in (1..order.len()).rev() {
        order.swap(place, random.below(place as u64 + 1) as usize);
    }
    order.truncate(row_count as usize);
    let mut parts = Vec::new();
    for (index, rows) in (0..).zip(order.chunks(rows_per_part as usize)) {
        let mut part = Part {
            index,
            indptr: vec![0],
            ..Part::default()
        };
        for &patch in rows {
            push_row(&mut part, patch, patch_count, &mut random);
        }
        parts.push(part);
    }
    let header = Header {
        program: "0.1.0".into(),
        scene: SceneEntry {
            file: "room.obj".into(),
            blake3: "0".repeat(64),
        },
        settings: json!({"resolution": 256, "samples": 1, "nested": {"b": 0.1, "a": [1, 2]}}),
        correction: "pixel".into(),
        patch_count,
        row_count,
        rows_per_part,
        form: Form::Plain,
        min_factor: 0.0,
        backend: BackendEntry {
            name: "cpu".into(),
            version: "1".into(),
        },
        objects: vec!["wall \"north\"".into(), "Boden".into()],
        materials: vec![String::new()],
    };
    let count = patch_count as usize;
    let patches = PatchTable {
        face: (0..patch_count).collect(),
        object: (0..patch_count).map(|patch| patch % 2).collect(),
        material: vec![0; count],
        side: (0..count).map(|patch| u8::from(patch % 3 == 1)).collect(),
        area: (0..count).map(|patch| 1.0 + patch as f64).collect(),
        centroid: (0..count).map(|patch| [patch as f64, 0.5, -1.0]).collect(),
        normal: vec![[0.0, 0.0, 1.0]; count],
        ..PatchTable::default()
    };
    Sample { header, patches, parts }
}

fn push_row(part: &mut Part, patch: u32, patch_count: u32, random: &mut Random) {
    let hemicubes = if patch % 7 == 3 { 4 } else { 1 };
    let whole = u64::from(hemicubes) * HEMICUBE_WEIGHT;
    let mut left = whole;
    // Every eleventh patch sees nothing.
    if patch % 11 != 5 {
        for column in 0..patch_count {
            if column != patch && random.below(3) == 0 {
                let weight = random.below(left / 8 + 1);
                left -= weight;
                part.indices.push(column as i32);
                part.data.push(weight as f64 / whole as f64);
            }
        }
    }
    let visible = whole - left;
    let escaped = random.below(left + 1);
    let blocked = random.below(left - escaped + 1);
    part.rows.push(patch);
    part.indptr.push(part.data.len() as i64);
    part.sums.push(RowSums {
        visible,
        escaped,
        blocked,
        unselected: left - escaped - blocked,
    });
    part.shares
        .push(RowShares::of_hemicubes(&part.sums[part.sums.len() - 1], hemicubes));
    part.hemicubes.push(hemicubes);
    let error = patch as f32 * 1e-3;
    part.errors
        .push(RowErrors::from_array([error, 2.0 * error, 3.0 * error]));
    part.rays.push(16 * patch);
}

impl Sample {
    /// The same matrix as a store of another form keeps it.
    pub(crate) fn in_form(mut self, form: Form) -> Self {
        self.header.form = form;
        for part in &mut self.parts {
            let mut data = FactorVec::new(form.precision());
            // Where f64 is kept, what f32 does not hold.
            let finer = if form == Form::Double { 1.0 - 1e-12 } else { 1.0 };
            part.data
                .iter()
                .for_each(|factor| data.push(form.round(factor * finer)));
            part.data = data;
        }
        self
    }

    pub(crate) fn writer(&self, directory: &Path) -> StoreWriter {
        StoreWriter::create(directory, self.header.clone(), &self.patches, false).unwrap()
    }

    pub(crate) fn write(&self, directory: &Path) -> Store {
        let mut writer = self.writer(directory);
        for part in &self.parts {
            writer.write_part(part).unwrap();
        }
        writer.finish().unwrap();
        Store::open(directory).unwrap()
    }

    /// The whole matrix: rows that were not computed are `None`.
    pub(crate) fn dense(&self) -> Vec<Option<Vec<f64>>> {
        let count = self.header.patch_count as usize;
        let mut rows = vec![None; count];
        for part in &self.parts {
            for (row, &patch) in part.rows.iter().enumerate() {
                let mut dense = vec![0.0; count];
                let (columns, factors) = part.row(row);
                for (&column, factor) in columns.iter().zip(factors) {
                    dense[column as usize] = factor;
                }
                rows[patch as usize] = Some(dense);
            }
        }
        rows
    }
}

/// Every file of a directory and its bytes, by path.
pub(crate) fn files(directory: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in std::fs::read_dir(directory).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() {
            found.extend(
                files(&path)
                    .into_iter()
                    .map(|(inner, bytes)| (format!("{name}/{inner}"), bytes)),
            );
        } else {
            found.insert(name, std::fs::read(&path).unwrap());
        }
    }
    found
}

/// The bytes of a member of an archive, read by the reference crates.
fn member(bytes: &[u8], name: &str) -> Vec<u8> {
    let mut archive = zip::ZipArchive::new(Cursor::new(bytes)).unwrap();
    let mut out = Vec::new();
    archive
        .by_name(&format!("{name}.npy"))
        .unwrap()
        .read_to_end(&mut out)
        .unwrap();
    out
}

/// An array of an archive, read by the reference crates.
pub(crate) fn array<T: npyz::Deserialize>(path: &Path, name: &str) -> Vec<T> {
    let bytes = member(&std::fs::read(path).unwrap(), name);
    npyz::NpyFile::new(bytes.as_slice()).unwrap().into_vec().unwrap()
}

/// A `.npy` written by the reference crate.
pub(crate) fn npy<T: npyz::AutoSerialize>(shape: &[u64], elements: &[T]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut writer = npyz::WriteOptions::new()
        .default_dtype()
        .shape(shape)
        .writer(&mut bytes)
        .begin_nd()
        .unwrap();
    for element in elements {
        writer.push(element).unwrap();
    }
    writer.finish().unwrap();
    bytes
}

/// Replaces members of an archive, and leaves the others.
pub(crate) fn replace_members(path: &Path, members: &[(&str, Vec<u8>)], method: zip::CompressionMethod) {
    let bytes = std::fs::read(path).unwrap();
    let names: Vec<String> = {
        let archive = zip::ZipArchive::new(Cursor::new(&bytes)).unwrap();
        archive.file_names().map(|name| name.unwrap().into_owned()).collect()
    };
    let mut out = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let options = zip::write::SimpleFileOptions::default().compression_method(method);
    for file_name in names {
        let name = file_name.strip_suffix(".npy").unwrap();
        // Nothing for a member is one that goes.
        if members
            .iter()
            .any(|(other, content)| *other == name && content.is_empty())
        {
            continue;
        }
        let content = match members.iter().find(|(other, _)| *other == name) {
            Some((_, content)) => content.clone(),
            None => member(&bytes, name),
        };
        out.start_file(file_name, options).unwrap();
        out.write_all(&content).unwrap();
    }
    std::fs::write(path, out.finish().unwrap().into_inner()).unwrap();
}

/// Takes members out of an archive.
pub(crate) fn remove_members(path: &Path, names: &[&str]) {
    let gone: Vec<(&str, Vec<u8>)> = names.iter().map(|&name| (name, Vec::new())).collect();
    replace_members(path, &gone, zip::CompressionMethod::Stored);
}

/// Has the manifest name the bytes that a part, or the patch table, has now.
pub(crate) fn adopt(directory: &Path, path: &Path, part: Option<u32>) {
    let checksum = blake3::hash(&std::fs::read(path).unwrap()).to_hex().to_string();
    doctor_manifest(directory, |manifest| {
        let entry = match part {
            Some(index) => &mut manifest["parts"][index as usize],
            None => &mut manifest["patches"],
        };
        entry["blake3"] = json!(checksum);
    });
}

/// Changes the manifest through its JSON, and signs it again.
pub(crate) fn doctor_manifest(directory: &Path, change: impl FnOnce(&mut serde_json::Value)) {
    let path = directory.join("manifest.json");
    let mut value: serde_json::Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    change(&mut value);
    let fields = value.as_object_mut().unwrap();
    fields.remove("blake3");
    let mut text = serde_json::to_string_pretty(&fields).unwrap();
    text.truncate(text.len() - "\n}".len());
    let checksum = blake3::hash(text.as_bytes()).to_hex();
    std::fs::write(&path, format!("{text},\n  \"blake3\": \"{checksum}\"\n}}\n")).unwrap();
}

/// Writes a part as if the library had written `part`, whatever it holds, and has the manifest agree.
pub(crate) fn doctor_part(directory: &Path, part: &Part) {
    let path = directory.join(format!("parts/part-{:05}.npz", part.index));
    let sums: Vec<u64> = part
        .sums
        .iter()
        .flat_map(|sums| [sums.visible, sums.escaped, sums.blocked, sums.unselected])
        .collect();
    let errors: Vec<[f32; 3]> = part.errors.iter().map(|errors| errors.to_array()).collect();
    let shares: Vec<[f64; 3]> = part.shares.iter().map(|shares| shares.to_array()).collect();
    let (rows, entries) = (part.rows.len() as u64, part.data.len() as u64);
    replace_members(
        &path,
        &[
            (
                "data",
                match &part.data {
                    FactorVec::Single(data) => npy(&[entries], data),
                    FactorVec::Double(data) => npy(&[entries], data),
                },
            ),
            ("indices", npy(&[entries], &part.indices)),
            ("indptr", npy(&[rows + 1], &part.indptr)),
            ("rows", npy(&[rows], &part.rows)),
            ("sums", npy(&[rows, 4], &sums)),
            ("shares", npy(&[rows, 3], shares.as_flattened())),
            ("hemicubes", npy(&[rows], &part.hemicubes)),
            ("errors", npy(&[rows, 3], errors.as_flattened())),
            ("rays", npy(&[rows], &part.rays)),
        ],
        zip::CompressionMethod::Stored,
    );
    let checksum = blake3::hash(&std::fs::read(&path).unwrap()).to_hex().to_string();
    let total = |of: fn(&RowSums) -> u64| part.sums.iter().map(of).sum::<u64>();
    doctor_manifest(directory, |manifest| {
        let entry = &mut manifest["parts"][part.index as usize];
        let before = entry["entries"].as_u64().unwrap();
        entry["blake3"] = json!(checksum);
        entry["entries"] = json!(entries);
        entry["sums"] = json!({
            "visible": total(|sums| sums.visible),
            "escaped": total(|sums| sums.escaped),
            "blocked": total(|sums| sums.blocked),
            "unselected": total(|sums| sums.unselected),
        });
        manifest["entries"] = json!(manifest["entries"].as_u64().unwrap() - before + entries);
    });
}
