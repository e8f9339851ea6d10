// Hidden beginning of the documentation's examples of stores, here and in `hemicube-solve`. Each includes this file in
// a module `room`. No run of `hemicube` makes its rows: they are known, and neither crate waits for that one.

use hemicube_store::{
    BackendEntry, Form, HEMICUBE_WEIGHT, Header, Part, PatchTable, RowErrors, RowShares, RowSums, SceneEntry, Store,
    StoreWriter,
};
use std::path::Path;

pub type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

/// Of a unit cube's face, the form factor to the opposite one (Howell, C-11); the four others share the rest.
pub const OPPOSITE: f64 = 0.199_824_895_698_387;

/// Inward normals: floor, light, and four walls; the opposite of each is known by its sign.
const NORMALS: [[f64; 3]; 6] = [
    [0.0, 0.0, 1.0],
    [0.0, 0.0, -1.0],
    [1.0, 0.0, 0.0],
    [0.0, 1.0, 0.0],
    [-1.0, 0.0, 0.0],
    [0.0, -1.0, 0.0],
];

pub fn header() -> Header {
    Header {
        program: hemicube_store::PROGRAM.to_owned(),
        scene: SceneEntry { file: "room.obj".to_owned(), blake3: "0".repeat(64) },
        settings: serde_json::json!({ "resolution": 64, "samples": 1 }),
        correction: "pixel".to_owned(),
        patch_count: 6,
        row_count: 6,
        rows_per_part: 2,
        form: Form::Plain,
        min_factor: 0.0,
        backend: BackendEntry { name: "cpu".to_owned(), version: "1".to_owned() },
        objects: ["floor", "light", "wall"].map(str::to_owned).to_vec(),
        materials: vec![String::new()],
    }
}

/// The faces of a unit cube, a patch each.
pub fn table() -> PatchTable {
    PatchTable {
        face: (0..6).collect(),
        object: vec![0, 1, 2, 2, 2, 2],
        material: vec![0; 6],
        side: vec![0; 6],
        area: vec![1.0; 6],
        centroid: NORMALS.map(|normal| normal.map(|along| 0.5 - 0.5 * along)).to_vec(),
        normal: NORMALS.to_vec(),
        ..PatchTable::default()
    }
}

/// Three parts of two rows. Form factors to neighbours are too large by the share `off`, and too small, in turn.
pub fn parts(off: f64) -> Vec<Part> {
    let mut parts = Vec::new();
    for index in 0..3 {
        let mut part = Part { index, indptr: vec![0], ..Part::default() };
        for row in [2 * index, 2 * index + 1] {
            let normal = NORMALS[row as usize];
            let is_opposite = |column: usize| normal.iter().zip(NORMALS[column]).all(|(a, b)| *a == -b);
            let (mut weights, mut sign) = ([0_u64; 6], 1.0);
            for column in (0..6).filter(|&column| column != row as usize && !is_opposite(column)) {
                weights[column] = (HEMICUBE_WEIGHT as f64 * (1.0 - OPPOSITE) / 4.0 * (1.0 + sign * off)) as u64;
                sign = -sign;
            }
            let rest = HEMICUBE_WEIGHT - weights.iter().sum::<u64>();
            for column in 0..6 {
                let weight = if is_opposite(column) { rest } else { weights[column] };
                if weight > 0 {
                    part.indices.push(column as i32);
                    part.data.push(weight as f64 / HEMICUBE_WEIGHT as f64);
                }
            }
            let sums = RowSums { visible: HEMICUBE_WEIGHT, ..RowSums::default() };
            part.rows.push(row);
            part.indptr.push(part.data.len() as i64);
            part.shares.push(RowShares::of_hemicubes(&sums, 1));
            part.sums.push(sums);
            part.hemicubes.push(1);
            part.errors.push(RowErrors::UNKNOWN);
            part.rays.push(0);
        }
        parts.push(part);
    }
    parts
}

/// A store of the cube.
pub fn stored(directory: &Path, off: f64) -> Result<Store> {
    let mut writer = StoreWriter::create(directory, header(), &table(), false)?;
    for part in parts(off) {
        writer.write_part(&part)?;
    }
    writer.finish()?;
    Ok(Store::open(directory)?)
}
