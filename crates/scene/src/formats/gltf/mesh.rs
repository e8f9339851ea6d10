//! Meshes: the yield of each primitive, found before any vertex is read.

use super::accessor::{Component, Layout};
use super::json::{Document, Object};
use super::{MEND, extension};
use crate::Error;
use std::collections::BTreeMap;

/// Rule that makes triangles of a primitive's corners (glTF 2.0, 3.7.2.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Topology {
    List,
    Strip,
    Fan,
}

impl Topology {
    /// The corners of triangle `n`. Every second triangle of a strip is turned, so that all face one way.
    pub(super) fn corners(self, n: usize) -> [usize; 3] {
        match self {
            Self::List => [3 * n, 3 * n + 1, 3 * n + 2],
            Self::Strip => [n, n + 1 + n % 2, n + 2 - n % 2],
            Self::Fan => [n + 1, n + 2, 0],
        }
    }

    fn triangle_count(self, corner_count: usize) -> usize {
        match self {
            Self::List => corner_count / 3,
            Self::Strip | Self::Fan => corner_count.saturating_sub(2),
        }
    }
}

/// Findings of meshes that are losses.
pub(super) const NO_POSITIONS: &str = "primitive without positions";
pub(super) const HALF_A_TRIANGLE: &str = "primitive that ends inside a triangle";
pub(super) const UNQUANTIZED: &str = "integer positions without KHR_mesh_quantization";
pub(super) const MORPHED: &str = "morph targets ignored";

/// A primitive with at least one triangle.
pub(super) struct Primitive {
    /// Index of the mesh, for messages.
    pub(super) mesh: usize,
    /// Index in its mesh, for messages.
    pub(super) number: usize,
    pub(super) topology: Topology,
    /// The accessor of the positions.
    pub(super) positions: usize,
    /// The accessor of the indices.
    pub(super) indices: Option<usize>,
    pub(super) material: Option<usize>,
    pub(super) triangle_count: usize,
}

/// A mesh of the file.
pub(super) struct Mesh<'v> {
    pub(super) name: Option<&'v str>,
    /// Primitives with triangles. The others are only counted, so that placing a mesh costs no more than its triangles.
    pub(super) primitives: Vec<Primitive>,
    pub(super) triangle_count: u64,
    /// Ledger counted each time a node places the mesh.
    pub(super) counts: BTreeMap<&'static str, u64>,
}

/// All meshes of a file, with every accessor of positions and indices checked against the buffers' claimed lengths.
pub(super) fn plan<'v>(document: &Document<'v>) -> Result<Vec<Mesh<'v>>, Error> {
    let quantized = document
        .root
        .texts("extensionsUsed")?
        .contains(&"KHR_mesh_quantization");
    let mut meshes = Vec::with_capacity(document.meshes.len());
    for (index, object) in document.meshes.iter().enumerate() {
        let object = object?;
        let mut mesh = Mesh {
            name: object.name(),
            primitives: Vec::new(),
            triangle_count: 0,
            counts: BTreeMap::new(),
        };
        for (number, primitive) in object.required_list("primitives")?.iter().enumerate() {
            if let Some((primitive, component)) =
                plan_primitive(document, &primitive?, index, number, &mut mesh.counts)?
            {
                if component != Component::F32 && !quantized {
                    *mesh.counts.entry(UNQUANTIZED).or_default() += 1;
                }
                mesh.triangle_count = mesh.triangle_count.saturating_add(primitive.triangle_count as u64);
                mesh.primitives.push(primitive);
            }
        }
        meshes.push(mesh);
    }
    Ok(meshes)
}

/// A primitive and the component type of its positions; `None` if it makes no triangle.
fn plan_primitive(
    document: &Document<'_>,
    primitive: &Object<'_>,
    mesh: usize,
    number: usize,
    counts: &mut BTreeMap<&'static str, u64>,
) -> Result<Option<(Primitive, Component)>, Error> {
    let mut count = |reason: &'static str, n: usize| {
        if n > 0 {
            let total = counts.entry(reason).or_default();
            *total = total.saturating_add(n as u64);
        }
    };
    let place = primitive.place();
    let attributes = primitive.required_object("attributes")?;
    let indices = primitive.reference("indices", &document.accessors)?;
    let material = primitive.reference("material", &document.materials)?;
    let mode = primitive.whole("mode")?.unwrap_or(4);
    let Some(positions) = attributes.reference("POSITION", &document.accessors)? else {
        count(NO_POSITIONS, 1);
        return Ok(None);
    };

    let position_layout = Layout::of(document, positions)?;
    if !position_layout.is_positions() {
        return Err(Error::malformed(format!(
            "`{place}.attributes.POSITION` is `accessors[{positions}]`, which does not hold positions (`VEC3` of \
             floats, or of integers of one or two bytes); {MEND}"
        )));
    }
    let mut corner_count = position_layout.count;
    let mut zero = position_layout.is_zero();
    if let Some(indices) = indices {
        let layout = Layout::of(document, indices)?;
        if !layout.is_indices() {
            return Err(Error::malformed(format!(
                "`{place}.indices` is `accessors[{indices}]`, which does not hold indices (`SCALAR` of an unsigned \
                 type); {MEND}"
            )));
        }
        corner_count = layout.count;
        zero |= layout.is_zero();
    }
    // A reader without Draco sees a compressed primitive without a fallback as an accessor without bytes.
    if zero && primitive.has_extension(&[extension::DRACO])? {
        return Err(extension::draco(&format!("`{place}`")));
    }

    let topology = match mode {
        0 => {
            count("point element", corner_count);
            return Ok(None);
        }
        1 => {
            count("line element", corner_count / 2);
            return Ok(None);
        }
        2 => {
            count("line element", if corner_count > 1 { corner_count } else { 0 });
            return Ok(None);
        }
        3 => {
            count("line element", corner_count.saturating_sub(1));
            return Ok(None);
        }
        4 => Topology::List,
        5 => Topology::Strip,
        6 => Topology::Fan,
        _ => {
            return Err(Error::malformed(format!(
                "`{place}.mode` is {mode}, which is not 0 to 6; {MEND}"
            )));
        }
    };
    let triangle_count = topology.triangle_count(corner_count);
    let whole = match topology {
        Topology::List => corner_count.is_multiple_of(3),
        Topology::Strip | Topology::Fan => corner_count >= 3,
    };
    count(HALF_A_TRIANGLE, usize::from(!whole));
    if triangle_count == 0 {
        return Ok(None);
    }
    count(MORPHED, usize::from(primitive.list("targets")?.len() > 0));
    let primitive = Primitive {
        mesh,
        number,
        topology,
        positions,
        indices,
        material,
        triangle_count,
    };
    Ok(Some((primitive, position_layout.component)))
}
