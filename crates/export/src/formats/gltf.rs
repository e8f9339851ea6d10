//! Binary glTF 2.0 (Khronos, *glTF 2.0 Specification*): the model in the colours of one result.
//!
//! A node and a mesh for each object. Every patch has three vertices of its own, with its colour (`COLOR_0`, linear, 16
//! bits) and its id (`_PATCH`, a float, exact below 2²⁴). The material is unlit and one-sided: a closed room can be
//! looked into, and the two patches of a two-sided surface show their own colours. The root node turns the scene y up
//! and moves it to its place: positions are f32 relative to the middle of the scene.

use super::PatchWriter;
use crate::write::{on_write, too_large, write_file};
use crate::{Colors, PatchResults, Result, Values, WriteOptions};
use hemicube_scene::Axis;
use serde_json::{Value, json};
use std::f64::consts::FRAC_1_SQRT_2;
use std::io::{self, BufWriter, Write};
use std::path::Path;

/// Ids told apart by a float.
const PATCHES_MAX: usize = 1 << 24;

const MAGIC: &[u8; 4] = b"glTF";
const JSON_CHUNK: &[u8; 4] = b"JSON";
const BINARY_CHUNK: &[u8; 4] = b"BIN\0";
const FLOAT: u32 = 5126;
const UNSIGNED_SHORT: u32 = 5123;
const ARRAY_BUFFER: u32 = 34962;
const TRIANGLES: u32 = 4;

/// Bytes of a vertex in each of the three arrays: position, colour, id.
const STRIDES: [usize; 3] = [12, 8, 4];

pub(super) struct BinaryGltf;

impl PatchWriter for BinaryGltf {
    fn write(&self, results: &PatchResults, path: &Path, options: WriteOptions<'_>) -> Result<u64> {
        let layout = Layout::new(results, results.corners_for(path)?, results.colors_for(path)?);
        let layout = layout.map_err(|reason| too_large(path, reason))?;
        write_file(path, options, |mut file| {
            layout.write(&mut file).map_err(|error| on_write(path, error))?;
            Ok(file)
        })
    }
}

/// A file before it is written.
struct Layout {
    json: Vec<u8>,
    positions: Vec<[f32; 3]>,
    colors: Vec<[u16; 3]>,
    /// The patch of every three vertices.
    patches: Vec<u32>,
}

/// Linear light (16 bits) of an 8-bit sRGB channel (IEC 61966-2-1).
fn linear(channel: u8) -> u16 {
    let shown = f64::from(channel) / 255.0;
    let light = if shown <= 0.04045 {
        shown / 12.92
    } else {
        ((shown + 0.055) / 1.055).powf(2.4)
    };
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 0 to 65535")]
    let rounded = (light * 65535.0).round() as u16;
    rounded
}

type Turn = fn([f64; 3]) -> [f64; 3];

/// The rotation of `up` to the y axis, as a quaternion and as a function of a point.
fn upright(up: Axis) -> ([f64; 4], Turn) {
    let h = FRAC_1_SQRT_2;
    match up {
        Axis::Y => ([0.0, 0.0, 0.0, 1.0], |point| point),
        Axis::Z => ([-h, 0.0, 0.0, h], |[x, y, z]| [x, z, -y]),
        Axis::X => ([0.0, 0.0, h, h], |[x, y, z]| [-y, x, z]),
    }
}

/// The middle of the scene's box; the origin if there are no patches.
fn middle(corners: &[[[f64; 3]; 3]]) -> [f64; 3] {
    let all = || corners.as_flattened().iter();
    let low = all().fold([f64::INFINITY; 3], |low, c| {
        [0, 1, 2].map(|axis: usize| low[axis].min(c[axis]))
    });
    let high = all().fold([f64::NEG_INFINITY; 3], |high, c| {
        [0, 1, 2].map(|axis: usize| high[axis].max(c[axis]))
    });
    [0, 1, 2].map(|axis: usize| {
        if corners.is_empty() {
            0.0
        } else {
            (low[axis] + high[axis]) / 2.0
        }
    })
}

/// A node, a mesh and three accessors for each object.
#[derive(Default)]
struct Objects {
    nodes: Vec<Value>,
    meshes: Vec<Value>,
    accessors: Vec<Value>,
    /// Number of patches of these objects.
    patches: usize,
}

impl Objects {
    /// Adds the object of the next `count` patches; `positions` are those of all.
    fn push(&mut self, name: &str, positions: &[[f32; 3]], count: usize) {
        let first = self.patches;
        let vertices = &positions[3 * first..3 * (first + count)];
        let least = vertices.iter().fold([f32::INFINITY; 3], |low, v| {
            [0, 1, 2].map(|axis: usize| low[axis].min(v[axis]))
        });
        let most = vertices.iter().fold([f32::NEG_INFINITY; 3], |high, v| {
            [0, 1, 2].map(|axis: usize| high[axis].max(v[axis]))
        });
        let place = self.accessors.len();
        let accessor = |view: usize, component: u32, kind: &str| {
            json!({
                "bufferView": view,
                "byteOffset": 3 * first * STRIDES[view],
                "componentType": component,
                "count": 3 * count,
                "type": kind,
            })
        };
        let mut position = accessor(0, FLOAT, "VEC3");
        position["min"] = json!(least.map(f64::from));
        position["max"] = json!(most.map(f64::from));
        let mut color = accessor(1, UNSIGNED_SHORT, "VEC4");
        color["normalized"] = json!(true);
        self.accessors.extend([position, color, accessor(2, FLOAT, "SCALAR")]);
        self.nodes.push(json!({ "name": name, "mesh": self.meshes.len() }));
        self.meshes.push(json!({
            "name": name,
            "primitives": [{
                "attributes": { "POSITION": place, "COLOR_0": place + 1, "_PATCH": place + 2 },
                "material": 0,
                "mode": TRIANGLES,
            }],
        }));
        self.patches += count;
    }
}

/// The object of each patch, and the names of objects.
fn objects_of(results: &PatchResults) -> (impl Fn(u32) -> u32, &[String]) {
    let (objects, names): (&[u32], &[String]) = match results.column("object").map(|column| &column.values) {
        Some(Values::Named(objects, names)) => (objects, names),
        _ => (&[], &[]),
    };
    (
        move |patch: u32| objects.get(patch as usize).copied().unwrap_or(0),
        names,
    )
}

/// Positions, colours and numbers of patches, from `starts` of the buffer on.
fn buffer_views(count: usize, starts: &[usize]) -> Vec<Value> {
    (0..3)
        .map(|view: usize| {
            json!({
                "buffer": 0,
                "byteOffset": starts[view],
                "byteLength": 3 * count * STRIDES[view],
                "byteStride": STRIDES[view],
                "target": ARRAY_BUFFER,
            })
        })
        .collect()
}

impl Layout {
    /// Lays a file out. The error says what is too large.
    fn new(
        results: &PatchResults,
        corners: &[[[f64; 3]; 3]],
        colors: &Colors,
    ) -> std::result::Result<Self, &'static str> {
        let count = corners.len();
        let bytes = |stride| 3 * count as u64 * stride as u64;
        let size: u64 = STRIDES.into_iter().map(bytes).sum();
        if count >= PATCHES_MAX || u32::try_from(size + (1 << 28)).is_err() {
            return Err("a glTF file has room for some 16 million patches; `.vtp` has room for more");
        }
        let (object_of, names) = objects_of(results);
        #[allow(clippy::cast_possible_truncation, reason = "fewer than 2²⁴, see above")]
        let mut patches: Vec<u32> = (0..count as u32).collect();
        patches.sort_by_key(|&patch| object_of(patch));

        let middle = middle(corners);
        #[allow(clippy::cast_possible_truncation, reason = "rounding is wanted")]
        let near = |corner: [f64; 3]| [0, 1, 2].map(|axis: usize| (corner[axis] - middle[axis]) as f32);
        let positions: Vec<[f32; 3]> = patches
            .iter()
            .flat_map(|&patch| corners[patch as usize].map(near))
            .collect();
        let linear_of = |&patch: &u32| colors.srgb[patch as usize].map(linear);

        let (rotation, turned) = upright(results.up);
        let starts: Vec<usize> = STRIDES
            .iter()
            .scan(0, |start, stride| {
                let at = *start;
                *start += 3 * count * stride;
                Some(at)
            })
            .collect();
        let total = 3 * count * STRIDES.iter().sum::<usize>();
        let mut objects = Objects::default();
        for run in patches.chunk_by(|&a, &b| object_of(a) == object_of(b)) {
            let object = object_of(run[0]);
            let name = names
                .get(object as usize)
                .filter(|name| !name.is_empty())
                .map_or_else(|| format!("object {object}"), Clone::clone);
            objects.push(&name, &positions, run.len());
        }
        let Objects {
            mut nodes,
            meshes,
            accessors,
            ..
        } = objects;
        let children: Vec<usize> = (1..=nodes.len()).collect();
        nodes.insert(
            0,
            json!({
                "name": results.scene,
                "rotation": rotation,
                "translation": turned(middle).map(|coordinate| coordinate + 0.0),
                "children": children,
            }),
        );
        let views = buffer_views(count, &starts);
        let file = json!({
            "asset": {
                "version": "2.0",
                "generator": concat!("hemicube ", env!("CARGO_PKG_VERSION")),
                "extras": { "colors": colors.legend },
            },
            "extensionsUsed": ["KHR_materials_unlit"],
            "scene": 0,
            "scenes": [{ "nodes": [0] }],
            "nodes": nodes,
            "meshes": meshes,
            "materials": [{
                "name": colors.legend.quantity,
                "pbrMetallicRoughness": { "metallicFactor": 0, "roughnessFactor": 1 },
                "extensions": { "KHR_materials_unlit": {} },
            }],
            "accessors": accessors,
            "bufferViews": views,
            "buffers": [{ "byteLength": total }],
        });
        let mut json = file.to_string().into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        if u32::try_from(json.len() + total + 28).is_err() {
            return Err("a glTF file has at most 4 GB; `.vtp` has room for more");
        }
        Ok(Self {
            json,
            positions,
            colors: patches.iter().map(linear_of).collect(),
            patches,
        })
    }

    fn write(&self, out: &mut impl Write) -> io::Result<()> {
        let mut out = BufWriter::with_capacity(1 << 18, out);
        let binary = self.positions.len() * STRIDES.iter().sum::<usize>();
        let size = |bytes: usize| u32::try_from(bytes).map_err(io::Error::other).map(u32::to_le_bytes);
        out.write_all(MAGIC)?;
        out.write_all(&2u32.to_le_bytes())?;
        out.write_all(&size(12 + 8 + self.json.len() + 8 + binary)?)?;
        out.write_all(&size(self.json.len())?)?;
        out.write_all(JSON_CHUNK)?;
        out.write_all(&self.json)?;
        out.write_all(&size(binary)?)?;
        out.write_all(BINARY_CHUNK)?;
        for coordinate in self.positions.as_flattened() {
            out.write_all(&coordinate.to_le_bytes())?;
        }
        for &[red, green, blue] in &self.colors {
            for channel in [red, green, blue, u16::MAX].repeat(3) {
                out.write_all(&channel.to_le_bytes())?;
            }
        }
        for &patch in &self.patches {
            // Below 2²⁴: exact.
            #[allow(clippy::cast_precision_loss, reason = "exact")]
            let id = (patch as f32).to_le_bytes();
            for _ in 0..3 {
                out.write_all(&id)?;
            }
        }
        out.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn up_is_y() {
        for (up, axis) in [
            (Axis::X, [1.0, 0.0, 0.0]),
            (Axis::Y, [0.0, 1.0, 0.0]),
            (Axis::Z, [0.0, 0.0, 1.0]),
        ] {
            let ([x, y, z, w], turned) = upright(up);
            let point = glam::DVec3::new(1.0, 2.0, 3.0);
            let rotated = glam::DQuat::from_xyzw(x, y, z, w) * point;
            assert!((rotated - glam::DVec3::from(turned(point.into()))).length() < 1e-12);
            assert_eq!(turned(axis), [0.0, 1.0, 0.0]);
        }
    }

    #[test]
    fn a_screens_light() {
        assert_eq!([0, 255].map(linear), [0, 65535]);
        // Middle grey of a screen is a fifth of its light.
        assert_eq!(linear(118), 11873);
    }
}
