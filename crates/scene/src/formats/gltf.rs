//! Reads glTF 2.0, `.gltf` and `.glb`: the triangles of the default scene, in world coordinates.
//!
//! Specification: Khronos Group, glTF 2.0, 2021 (3.5 nodes, 3.6 buffers and accessors, 3.7 meshes, 4 GLB), and the
//! extension `KHR_mesh_quantization`.
//!
//! Reads, in this order: the nodes of the default scene depth first, each node's mesh, its primitives in file order. A
//! node is an object. Without a `scene` member the first scene is read; without scenes every node without a parent is a
//! root. A mesh without a node is not part of the scene.
//!
//! Refuses nodes, meshes, accessors and views with references to nothing, accessors of positions and indices that do
//! not fit their buffers, and geometry in need of a decoder (Draco, meshopt). Never opens or checks the rest: images,
//! textures, animations, skins, cameras, and buffers for those only.
//!
//! Not the crate `gltf-json`, because its types round node transforms to f32, take an index modulo 2³² (so that
//! 4294967296 silently means 0), refuse legal scenes without nodes, and refuse the whole file for a fault in a part
//! without geometry. The JSON is held as `serde_json::Value` and typed at each access.
//!
//! Work and memory: vertices are read straight from the buffers, triangle by triangle, so both are in proportion to the
//! size of the file and to the number of triangles. The triangles are counted before the first is made.

mod accessor;
mod buffer;
mod extension;
mod glb;
mod json;
mod material;
mod mesh;
mod node;

use crate::bounds::Bounds;
use crate::{Axis, Error, ErrorKind, Fate, Kind, Ledger, ReadOptions, Scene, Triangle};
use accessor::{Elements, Layout};
use json::Document;
use material::Materials;
use mesh::{Mesh, Primitive};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;

/// More triangles than this could not all be patches; see [`crate::Patches::new`].
const TRIANGLES_MAX: u64 = (1 << 31) - 16;

/// The next step after a refusal for the writer's mistake.
const MEND: &str = "export the scene again (the glTF validator lists such faults)";

/// Longer names are cut: one name can be used by many nodes, and the copies must not outgrow the file.
const NAME_BYTES_MAX: usize = 1024;

/// Reads a scene from the bytes of a `.gltf` or `.glb` file. Buffers in files of their own are looked up in `base_dir`.
///
/// Degenerate triangles (also those joining strips) and non-finite positions are kept: dropping them is
/// [`crate::repair`]'s work. The up axis is y and the unit is the metre, by the format.
///
/// With [`ReadOptions::optics`] a material's diffuse reflectance is its base colour × (1 − metallic factor), since only
/// the non-metallic part of glTF's surface model is diffuse, and its emission is the emissive factor × the strength of
/// `KHR_materials_emissive_strength`. Textures varying either are not read and are counted in the ledger.
///
/// # Errors
/// When the bytes are not glTF 2, when nodes, meshes, accessors or buffers contradict one another or are missing, or
/// when the geometry needs an extension that is not read. The message names the place in the file.
///
/// ```
/// use hemicube_scene::{Axis, ReadOptions, gltf};
///
/// // A triangle, whose nine coordinates are within the file.
/// let text = br#"{ "asset": { "version": "2.0" }, "scenes": [{ "nodes": [0] }], "scene": 0,
///     "nodes": [{ "name": "roof", "mesh": 0, "scale": [2, 2, 2] }],
///     "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 } }] }],
///     "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3" }],
///     "bufferViews": [{ "buffer": 0, "byteLength": 36 }],
///     "buffers": [{ "byteLength": 36, "uri":
///         "data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA" }] }"#;
/// let scene = gltf::read(text, None, ReadOptions::default())?;
/// assert_eq!(scene.triangles[0].corners[1], glam::DVec3::X * 2.0, "nodes have moved it to its place");
/// assert_eq!((&*scene.objects[0], scene.up, scene.metres_per_unit), ("roof", Some(Axis::Y), Some(1.0)));
/// # Ok::<(), hemicube_scene::Error>(())
/// ```
pub fn read(bytes: &[u8], base_dir: Option<&Path>, options: ReadOptions) -> Result<Scene, Error> {
    let mut ledger = Ledger::default();
    let container = glb::open(bytes, &mut ledger)?;
    let root = json::parse(&container, &mut ledger)?;
    let document = Document::new(&root)?;
    extension::check(&document)?;
    accessor::check_references(&document)?;
    let meshes = mesh::plan(&document)?;
    let placements = node::place(&document, &mut ledger)?;

    let mut placed = vec![false; meshes.len()];
    let mut triangle_count: u64 = 0;
    for placement in &placements {
        placed[placement.mesh] = true;
        let copies = placement.copies.map_or(1, |copies| copies.count as u64);
        let triangles = meshes[placement.mesh].triangle_count.saturating_mul(copies);
        triangle_count = triangle_count.saturating_add(triangles);
    }
    let mut unplaced = (0..placed.len()).filter(|&mesh| !placed[mesh] && meshes[mesh].triangle_count > 0);
    if let Some(first) = unplaced.next() {
        let kind = Kind {
            fate: Fate::LeftOut,
            what: "mesh that no node of the scene places",
            next: "place it by a node, or take it away",
        };
        ledger.lose(kind, 1 + unplaced.count() as u64, None, || format!("`meshes[{first}]`"));
    }
    if triangle_count > TRIANGLES_MAX {
        return Err(Error::new(ErrorKind::TooLarge(format!(
            "the nodes place {triangle_count} triangles, more than the {TRIANGLES_MAX} that are read; place fewer \
             copies of the meshes"
        ))));
    }

    let (buffers, layouts) = open_buffers(&document, &meshes, &placements, container.bin, base_dir)?;
    // Buffers within the file count twice: a file of copies may have a few more.
    let beside = buffers
        .values()
        .fold(0_u64, |sum, bytes| sum.saturating_add(bytes.len() as u64));
    Bounds::new(bytes.len(), options).triangles(triangle_count, beside)?;
    // Checking sparse indices costs time in their number, multiplied by accessors sharing their bytes.
    let sparse_count = layouts
        .values()
        .fold(0_usize, |sum, layout| sum.saturating_add(layout.sparse_count()));
    let byte_count = buffers
        .values()
        .fold(0_usize, |sum, bytes| sum.saturating_add(bytes.len()));
    if sparse_count > byte_count {
        return Err(Error::malformed(format!(
            "the sparse accessors replace {sparse_count} elements, but the buffers hold {byte_count} bytes; {MEND}"
        )));
    }
    let mut elements = BTreeMap::new();
    for (&index, layout) in &layouts {
        elements.insert(index, Elements::new(index, layout, &buffers)?);
    }

    let mut scene = Scene {
        up: Some(Axis::Y),
        metres_per_unit: Some(1.0),
        ..Scene::default()
    };
    usize::try_from(triangle_count)
        .ok()
        .and_then(|n| scene.triangles.try_reserve_exact(n).ok())
        .ok_or_else(|| {
            Error::new(ErrorKind::TooLarge(format!(
                "the {triangle_count} triangles that the nodes place do not fit in this machine's memory; place fewer \
             copies of the meshes"
            )))
        })?;
    let mut materials = Materials::new(&document, options);
    for placement in &placements {
        let mesh = &meshes[placement.mesh];
        let name = document.nodes.get(placement.node)?.name().or(mesh.name);
        let name = name.map_or_else(|| format!("node {}", placement.node), |n| cut(n).to_owned());
        for (&what, &count) in &mesh.counts {
            let fate = match what {
                mesh::NO_POSITIONS => Fate::LeftOut,
                mesh::HALF_A_TRIANGLE | mesh::UNQUANTIZED => Fate::Doubtful,
                mesh::MORPHED => Fate::Approximated,
                _ => Fate::Noted,
            };
            ledger.lose(Kind { fate, what, next: "" }, count, None, || format!("`{name}`"));
        }
        if mesh.primitives.is_empty() {
            continue;
        }
        let object = u32::try_from(scene.objects.len()).map_err(|_| too_many_objects())?;
        scene.objects.push(name);
        for primitive in &mesh.primitives {
            let (material, two_sided) = materials.resolve(primitive.material, &mut ledger)?;
            let triangle = Triangle {
                corners: [glam::DVec3::ZERO; 3],
                object,
                material,
                face: 0,
                two_sided,
            };
            for copy in 0..placement.copies.map_or(1, |copies| copies.count) {
                let (place, mirrored) = match placement.copies {
                    Some(copies) => copies.place(copy, &elements)?,
                    None => (glam::DAffine3::IDENTITY, false),
                };
                let place = (placement.transform * place, placement.mirrored != mirrored);
                emit(primitive, &elements, place, triangle, &mut scene.triangles)?;
            }
        }
    }
    scene.materials = materials.into_used();
    scene.ledger = ledger;
    Ok(scene)
}

fn too_many_objects() -> Error {
    Error::new(ErrorKind::TooLarge(format!(
        "more than {} objects; join nodes that belong together",
        u32::MAX
    )))
}

/// The start of `name`, short enough for a copy in every node.
fn cut(name: &str) -> &str {
    let mut end = name.len().min(NAME_BYTES_MAX);
    while !name.is_char_boundary(end) {
        end -= 1;
    }
    &name[..end]
}

/// The buffers of the placed meshes, by index, and the layouts of their accessors, by index.
type Geometry<'a> = (BTreeMap<usize, Cow<'a, [u8]>>, BTreeMap<usize, Layout>);

fn open_buffers<'a>(
    document: &Document<'_>,
    meshes: &[Mesh<'_>],
    placements: &[node::Placement],
    bin: Option<&'a [u8]>,
    base_dir: Option<&Path>,
) -> Result<Geometry<'a>, Error> {
    let mut layouts = BTreeMap::new();
    let mut opened = vec![false; meshes.len()];
    for placement in placements {
        let of_copies = placement.copies.map_or([None; 3], |copies| copies.accessors);
        let first = !std::mem::replace(&mut opened[placement.mesh], true);
        let primitives = if first {
            &meshes[placement.mesh].primitives[..]
        } else {
            &[]
        };
        let of_mesh = primitives
            .iter()
            .flat_map(|primitive| [Some(primitive.positions), primitive.indices]);
        for index in of_mesh.chain(of_copies).flatten() {
            if let std::collections::btree_map::Entry::Vacant(vacant) = layouts.entry(index) {
                vacant.insert(Layout::of(document, index)?);
            }
        }
    }
    let mut buffers = BTreeMap::new();
    for index in layouts.values().flat_map(Layout::buffers) {
        if let std::collections::btree_map::Entry::Vacant(vacant) = buffers.entry(index) {
            vacant.insert(buffer::open(document, index, bin, base_dir)?);
        }
    }
    Ok((buffers, layouts))
}

/// Appends the triangles of one primitive at one place; `triangle` holds their common fields.
fn emit(
    primitive: &Primitive,
    elements: &BTreeMap<usize, Elements<'_>>,
    (transform, mirrored): (glam::DAffine3, bool),
    triangle: Triangle,
    triangles: &mut Vec<Triangle>,
) -> Result<(), Error> {
    let bound = |index: usize| {
        elements
            .get(&index)
            .ok_or_else(|| Error::malformed(format!("`accessors[{index}]` was not opened; {MEND}")))
    };
    let positions = bound(primitive.positions)?;
    let indices = primitive.indices.map(bound).transpose()?;
    for n in 0..primitive.triangle_count {
        let mut vertices = primitive.topology.corners(n);
        if let Some(indices) = indices {
            for vertex in &mut vertices {
                *vertex = indices.vertex(*vertex, positions.count(), primitive)?;
            }
        }
        if mirrored {
            vertices.swap(1, 2);
        }
        let face = u32::try_from(triangles.len()).map_err(|_| {
            Error::new(ErrorKind::TooLarge(format!(
                "more than {TRIANGLES_MAX} triangles; place fewer copies"
            )))
        })?;
        let corners = vertices.map(|vertex| transform.transform_point3(positions.position(vertex)));
        triangles.push(Triangle {
            corners,
            face,
            ..triangle
        });
    }
    Ok(())
}
