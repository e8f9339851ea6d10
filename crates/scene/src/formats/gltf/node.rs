//! The node hierarchy: the place of each mesh.
//!
//! World matrix = parent's · local, local = matrix or T · R · S, all in f64 (glTF 2.0, 3.5.3). A negative determinant
//! turns the winding (3.7.4). The walk keeps its own stack, so that a deep hierarchy is no deep recursion.

use super::accessor::{Elements, Layout};
use super::json::{Document, Object};
use super::{MEND, extension};
use crate::{Error, Fate, Kind, Ledger};
use glam::{DAffine3, DMat3, DQuat, DVec3};
use std::collections::BTreeMap;

/// A mesh placed by a node.
pub(super) struct Placement {
    pub(super) node: usize,
    pub(super) mesh: usize,
    pub(super) transform: DAffine3,
    /// True if the transform turns left into right.
    pub(super) mirrored: bool,
    /// Copies, where the node has them by `EXT_mesh_gpu_instancing`.
    pub(super) copies: Option<Copies>,
}

/// The copies of a node: accessors of their translations, rotations and scales.
#[derive(Clone, Copy)]
pub(super) struct Copies {
    pub(super) count: usize,
    pub(super) accessors: [Option<usize>; 3],
}

impl Copies {
    /// The copies that a node has.
    fn of(document: &Document<'_>, node: &Object<'_>) -> Result<Option<Self>, Error> {
        let extensions = node.object("extensions")?;
        let Some(of) = extensions
            .map(|all| all.object(extension::INSTANCING))
            .transpose()?
            .flatten()
        else {
            return Ok(None);
        };
        let attributes = of.required_object("attributes")?;
        let mut accessors = [None; 3];
        let mut count: Option<usize> = None;
        let names = [("TRANSLATION", 3), ("ROTATION", 4), ("SCALE", 3)];
        for (accessor, (name, width)) in accessors.iter_mut().zip(names) {
            *accessor = attributes.reference(name, &document.accessors)?;
            let Some(index) = *accessor else { continue };
            let layout = Layout::of(document, index)?;
            let place = attributes.place();
            if !layout.has_width(width) {
                return Err(Error::malformed(format!(
                    "`{place}.{name}` is `accessors[{index}]`, which has not {width} numbers an element; {MEND}"
                )));
            }
            if count.is_some_and(|count| count != layout.count) {
                return Err(Error::malformed(format!(
                    "`{place}` has accessors of different lengths; {MEND}"
                )));
            }
            count = Some(layout.count);
        }
        // Without an attribute that is read there is one copy, where the node stands.
        Ok(count.map(|count| Self { count, accessors }))
    }

    /// The place of copy `n` in its node: translation · rotation · scale, and whether it mirrors.
    pub(super) fn place(&self, n: usize, elements: &BTreeMap<usize, Elements<'_>>) -> Result<(DAffine3, bool), Error> {
        let [translation, rotation, scale] = self.accessors.map(|accessor| elements.get(&accessor?));
        let vector = |of: Option<&Elements<'_>>, none: f64| {
            of.map_or(DVec3::splat(none), |of| DVec3::from_array(of.numbers::<3>(n)))
        };
        let rotation = match rotation.map(|of| of.numbers::<4>(n)) {
            None => DQuat::IDENTITY,
            Some(q) => {
                let length = q.iter().fold(0.0_f64, |a, b| a.hypot(*b));
                if !(length.is_finite() && length > 0.0) {
                    return Err(Error::malformed(format!(
                        "the rotation of copy {n} of a node is no rotation; {MEND}"
                    )));
                }
                DQuat::from_array(q.map(|component| component / length))
            }
        };
        let scale = vector(scale, 1.0);
        let mirrored = scale.to_array().iter().filter(|s| **s < 0.0).count() % 2 == 1;
        let place = DAffine3::from_scale_rotation_translation(scale, rotation, vector(translation, 0.0));
        Ok((place, mirrored))
    }
}

/// Deviation of a quaternion's length from 1 above which it is counted: well above f32 rounding, well below a mistake.
const UNIT_TOLERANCE: f64 = 1e-3;

/// The meshes of the scene, in reading order.
pub(super) fn place(document: &Document<'_>, ledger: &mut Ledger) -> Result<Vec<Placement>, Error> {
    let nodes = &document.nodes;
    let mut children: Vec<Vec<usize>> = Vec::with_capacity(nodes.len());
    let mut parents: Vec<Option<usize>> = vec![None; nodes.len()];
    for (index, node) in nodes.iter().enumerate() {
        let node = node?;
        node.reference("mesh", &document.meshes)?;
        let below = node.references("children", nodes)?;
        for &child in &below {
            if let Some(first) = parents[child].replace(index) {
                return Err(Error::malformed(format!(
                    "`nodes[{child}]` is a child of `nodes[{first}]` and again of `nodes[{index}]`; {MEND}"
                )));
            }
        }
        children.push(below);
    }
    refuse_cycle(&children, &parents)?;

    let roots = roots(document, &parents, ledger)?;
    let mut placements = Vec::new();
    let mut stack: Vec<(usize, DAffine3, bool)> = roots
        .into_iter()
        .rev()
        .map(|root| (root, DAffine3::IDENTITY, false))
        .collect();
    while let Some((index, above, above_mirrored)) = stack.pop() {
        let node = nodes.get(index)?;
        let (local, local_mirrored) = local_transform(&node, ledger)?;
        let transform = above * local;
        let mirrored = above_mirrored != local_mirrored;
        stack.extend(children[index].iter().rev().map(|&child| (child, transform, mirrored)));
        if let Some(mesh) = node.reference("mesh", &document.meshes)? {
            if node.has("skin") {
                let kind = Kind {
                    fate: Fate::Approximated,
                    what: "skinned mesh read in its rest position",
                    next: "export it with its pose applied",
                };
                ledger.lose(kind, 1, None, || format!("`nodes[{index}]`"));
            }
            placements.push(Placement {
                node: index,
                mesh,
                transform,
                mirrored,
                copies: Copies::of(document, &node)?,
            });
        }
    }
    Ok(placements)
}

/// The root nodes of the scene. None has a parent and none is there twice, so no node is met twice.
fn roots(document: &Document<'_>, parents: &[Option<usize>], ledger: &mut Ledger) -> Result<Vec<usize>, Error> {
    let chosen = document.root.reference("scene", &document.scenes)?;
    if document.scenes.len() == 0 {
        return Ok(parents
            .iter()
            .enumerate()
            .filter(|(_, parent)| parent.is_none())
            .map(|(index, _)| index)
            .collect());
    }
    if chosen.is_none() && document.scenes.len() > 1 {
        ledger.warnings.push(format!(
            "The file names none of its {} scenes as the default; the first was read.",
            document.scenes.len()
        ));
    }
    let scene = document.scenes.get(chosen.unwrap_or(0))?;
    let roots = scene.references("nodes", &document.nodes)?;
    let mut listed = vec![false; parents.len()];
    for &root in &roots {
        if let Some(parent) = parents[root] {
            return Err(Error::malformed(format!(
                "`{}` lists `nodes[{root}]` as a root, but it is a child of `nodes[{parent}]`; {MEND}",
                scene.place()
            )));
        }
        if std::mem::replace(&mut listed[root], true) {
            return Err(Error::malformed(format!(
                "`{}` lists `nodes[{root}]` twice; {MEND}",
                scene.place()
            )));
        }
    }
    Ok(roots)
}

/// No node has two parents here, so a node not below any root is on a cycle or below one.
fn refuse_cycle(children: &[Vec<usize>], parents: &[Option<usize>]) -> Result<(), Error> {
    let mut reached: Vec<bool> = parents.iter().map(Option::is_none).collect();
    let mut stack: Vec<usize> = (0..parents.len()).filter(|&index| reached[index]).collect();
    while let Some(index) = stack.pop() {
        for &child in &children[index] {
            reached[child] = true;
            stack.push(child);
        }
    }
    let Some(mut node) = reached.iter().position(|reached| !reached) else {
        return Ok(());
    };
    for _ in 0..parents.len() {
        node = parents[node].unwrap_or(node);
    }
    Err(Error::malformed(format!(
        "`nodes[{node}]` is among its own descendants; {MEND}"
    )))
}

/// A node's own transform, and whether it mirrors.
fn local_transform(node: &Object<'_>, ledger: &mut Ledger) -> Result<(DAffine3, bool), Error> {
    let place = node.place();
    let translation = node.numbers::<3>("translation")?;
    let rotation = node.numbers::<4>("rotation")?;
    let scale = node.numbers::<3>("scale")?;
    if let Some(m) = node.numbers::<16>("matrix")? {
        if translation.is_some() || rotation.is_some() || scale.is_some() {
            return Err(Error::malformed(format!(
                "`{place}` has a `matrix` beside `translation`, `rotation` or `scale`; {MEND}"
            )));
        }
        if [m[3], m[7], m[11], m[15]] != [0.0, 0.0, 0.0, 1.0] {
            return Err(Error::malformed(format!(
                "the last row of `{place}.matrix` is not 0 0 0 1; {MEND}"
            )));
        }
        let linear = DMat3::from_cols_array(&[m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]]);
        // The sign only: scaled first, since the determinant of a tiny matrix would vanish and of a huge one overflow.
        let largest = linear.to_cols_array().iter().fold(0.0_f64, |a, b| a.max(b.abs()));
        let mirrored = largest > 0.0 && (linear * (1.0 / largest)).determinant() < 0.0;
        return Ok((
            DAffine3::from_mat3_translation(linear, DVec3::new(m[12], m[13], m[14])),
            mirrored,
        ));
    }
    let rotation = match rotation {
        None => DQuat::IDENTITY,
        Some(q) => {
            let length = q.iter().fold(0.0_f64, |a, b| a.hypot(*b));
            if !(length.is_finite() && length > 0.0) {
                return Err(Error::malformed(format!("`{place}.rotation` is no rotation; {MEND}")));
            }
            if (length - 1.0).abs() > UNIT_TOLERANCE {
                ledger.note("rotation that is not of unit length, made so");
            }
            // Always normalised: a quaternion written with seven digits would scale by 10⁻⁷.
            DQuat::from_array(q.map(|component| component / length))
        }
    };
    let scale = DVec3::from_array(scale.unwrap_or([1.0; 3]));
    let translation = DVec3::from_array(translation.unwrap_or([0.0; 3]));
    let mirrored = scale.to_array().iter().filter(|s| **s < 0.0).count() % 2 == 1;
    Ok((
        DAffine3::from_scale_rotation_translation(scale, rotation, translation),
        mirrored,
    ))
}
