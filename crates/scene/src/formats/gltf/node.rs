//! The node hierarchy: the place of each mesh.
//!
//! World matrix = parent's · local, local = matrix or T · R · S, all in f64 (glTF 2.0, 3.5.3). A negative determinant
//! turns the winding (3.7.4). The walk keeps its own stack, so that a deep hierarchy is no deep recursion.

use super::json::{Document, Object};
use super::{MEND, extension};
use crate::{Error, Findings};
use glam::{DAffine3, DMat3, DQuat, DVec3};

/// A mesh placed by a node.
pub(super) struct Placement {
    pub(super) node: usize,
    pub(super) mesh: usize,
    pub(super) transform: DAffine3,
    /// True if the transform turns left into right.
    pub(super) mirrored: bool,
}

/// Deviation of a quaternion's length from 1 above which it is counted: well above f32 rounding, well below a mistake.
const UNIT_TOLERANCE: f64 = 1e-3;

/// The meshes of the scene, in reading order.
pub(super) fn place(document: &Document<'_>, findings: &mut Findings) -> Result<Vec<Placement>, Error> {
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

    let roots = roots(document, &parents, findings)?;
    let mut placements = Vec::new();
    let mut stack: Vec<(usize, DAffine3, bool)> = roots
        .into_iter()
        .rev()
        .map(|root| (root, DAffine3::IDENTITY, false))
        .collect();
    while let Some((index, above, above_mirrored)) = stack.pop() {
        let node = nodes.get(index)?;
        let (local, local_mirrored) = local_transform(&node, findings)?;
        let transform = above * local;
        let mirrored = above_mirrored != local_mirrored;
        stack.extend(children[index].iter().rev().map(|&child| (child, transform, mirrored)));
        if let Some(mesh) = node.reference("mesh", &document.meshes)? {
            if node.has("skin") {
                findings.count("skinned mesh read in its rest position");
            }
            if node.has_extension(&[extension::INSTANCING])? {
                let reason = "instanced node read once (EXT_mesh_gpu_instancing)";
                if findings.get(reason) == 0 {
                    findings.warnings.push(format!(
                        "`nodes[{index}]` has its copies in `{}`, which is not read: the scene has one of them only; \
                         export it with one node for each copy",
                        extension::INSTANCING
                    ));
                }
                findings.count(reason);
            }
            placements.push(Placement {
                node: index,
                mesh,
                transform,
                mirrored,
            });
        }
    }
    Ok(placements)
}

/// The root nodes of the scene. None has a parent and none is there twice, so no node is met twice.
fn roots(document: &Document<'_>, parents: &[Option<usize>], findings: &mut Findings) -> Result<Vec<usize>, Error> {
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
        findings.warnings.push(format!(
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
fn local_transform(node: &Object<'_>, findings: &mut Findings) -> Result<(DAffine3, bool), Error> {
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
                findings.count("rotation that is not of unit length, made so");
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
