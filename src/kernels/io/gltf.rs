//! glTF 2.0, binary and text: meshes, skins and animations.

use std::collections::{BTreeSet, HashMap};

use gltf::{Document, mesh::Mode};
use nalgebra::Matrix4;

use super::{
    character::{Character, unique_name},
    error::ReadError,
};
use crate::kernels::{
    geometry::mesh::{TriMesh, Vec3},
    rigs::{skeleton::Skeleton, weights::SkinWeights},
};

mod accessor;
mod animation;
mod container;
mod nodes;

pub use container::external_buffers;
use nodes::Nodes;

const FORMAT: &str = "glTF";

/// What to make of a glTF file.
#[derive(Debug, Clone, Copy)]
pub struct GltfOptions {
    /// Joins vertices of one skin (or of the unskinned meshes) that coincide exactly where they are
    /// stored. Files split a surface along the seams of normals and texture coordinates; joining
    /// closes it. Weights of joined vertices are averaged.
    pub weld: bool,
    pub rest: RestPose,
    /// The rate at which clips are sampled.
    pub frames_per_second: f64,
}

impl Default for GltfOptions {
    fn default() -> Self {
        Self { weld: true, rest: RestPose::Scene, frames_per_second: 30.0 }
    }
}

/// Which pose counts as the rest pose. Most files hold the same pose twice.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum RestPose {
    /// As the scene stands before any clip plays: what a viewer shows.
    #[default]
    Scene,
    /// As the skin was bound to the joints, placed where the skin's first joint stands.
    Bind,
}

/// Reads the default scene (the first, if none is) of a `.glb` or `.gltf` file.
///
/// `side_file` finds the buffers that a `.gltf` names. In a file with skins, the joints of all skins in
/// the scene make one skeleton, and the character is made of the skinned meshes and of the meshes
/// that hang on a joint (they follow it stiffly); other meshes are left out, with a note. In a
/// file without skins all meshes are merged as they stand. Points and lines are skipped.
///
/// Joints stand in the order of the skins, but parents before children; an ancestor that is no joint
/// is folded into the positions. Joints without a name become `joint_0`, ..., equal names get numbers.
/// Weights are divided by their sums. Every animation that moves a joint becomes a clip (see
/// [`Clip`](crate::kernels::rigs::clip::Clip)); scales cannot be expressed there and are left out.
///
/// # Errors
/// With the index of the accessor, mesh, node or animation that is wrong.
pub fn read_gltf(
    bytes: &[u8],
    side_file: &dyn Fn(&str) -> Option<Vec<u8>>,
    options: GltfOptions,
) -> Result<Character, ReadError> {
    let (document, buffers) = container::open(bytes, side_file)?;
    let nodes = Nodes::of(&document)?;
    let instances = scene_meshes(&document, &nodes);
    let mut notes = Vec::new();
    let rig = Rig::of(&document, &nodes, &buffers, &instances, options.rest)?;
    let mut parts = Parts::default();
    for &(node, mesh, skin) in &instances {
        let mover = match (&rig, skin) {
            (Some(rig), Some(skin)) => Mover::Skin(&rig.skins[&skin]),
            (Some(rig), None) => {
                match nodes.nearest(node, |it| rig.joint_of_node.contains_key(&it)) {
                    Some(it) => Mover::Joint(rig.joint_of_node[&it], rig.carry(&nodes, it, node)),
                    None => {
                        notes.push(format!("mesh {mesh} hangs on no joint and is left out"));
                        continue;
                    }
                }
            }
            (None, _) => Mover::Nothing(nodes.world[node]),
        };
        let mesh = document.meshes().nth(mesh).expect("the document is validated");
        parts.add(&mesh, &buffers, skin, &mover, options.weld)?;
    }
    parts.finish();
    if parts.n_unweighted > 0 {
        let n_unweighted = parts.n_unweighted;
        notes.push(format!(
            "{n_unweighted} vertices without weights follow the first joint of their skin"
        ));
    }
    let mesh = TriMesh::new(parts.vertices, parts.faces).map_err(ReadError::mesh(FORMAT))?;
    mesh.check_has_faces().map_err(ReadError::mesh(FORMAT))?;
    let mut res = Character { notes, ..Character::of_mesh(mesh) };
    if let Some(rig) = rig {
        let weights = SkinWeights::from_rows(rig.joint_nodes.len(), &parts.rows)
            .map_err(|error| ReadError::Weights { format: FORMAT, error })?;
        res.clips = animation::clips(&document, &buffers, &nodes, &rig, options.frames_per_second)?;
        (res.skeleton, res.weights) = (Some(rig.skeleton), Some(weights));
    }
    Ok(res)
}

/// The nodes with a mesh in the scene: node, mesh, skin.
fn scene_meshes(document: &Document, nodes: &Nodes) -> Vec<(usize, usize, Option<usize>)> {
    let scene = document.default_scene().or_else(|| document.scenes().next());
    let roots: Option<BTreeSet<usize>> = scene.map(|it| it.nodes().map(|it| it.index()).collect());
    let in_scene = |it| roots.as_ref().is_none_or(|roots| roots.contains(&nodes.root(it)));
    let all: Vec<_> = document.nodes().collect();
    nodes
        .order
        .iter()
        .filter(|&&it| in_scene(it))
        .filter_map(|&it| {
            let skin = all[it].skin().map(|it| it.index());
            Some((it, all[it].mesh()?.index(), skin))
        })
        .collect()
}

/// A skeleton and how it hangs together with the nodes.
struct Rig {
    skeleton: Skeleton,
    joint_nodes: Vec<usize>,
    joint_of_node: HashMap<usize, u32>,
    /// `world_from_joint` at rest, with the node's own axes and scale.
    rest: Vec<Matrix4<f64>>,
    skins: HashMap<usize, Skin>,
}

struct Skin {
    /// By the skin's own joint numbers.
    joints: Vec<u32>,
    /// `world_from_mesh` at rest, by the skin's own joint numbers.
    world_from_mesh: Vec<Matrix4<f64>>,
}

impl Rig {
    fn of(
        document: &Document,
        nodes: &Nodes,
        buffers: &[Vec<u8>],
        instances: &[(usize, usize, Option<usize>)],
        pose: RestPose,
    ) -> Result<Option<Self>, ReadError> {
        let mut used: Vec<usize> = Vec::new();
        for skin in instances.iter().filter_map(|it| it.2) {
            if !used.contains(&skin) {
                used.push(skin);
            }
        }
        let mut binds = Vec::new();
        for &index in &used {
            let skin = document.skins().nth(index).expect("the document is validated");
            let skin_nodes: Vec<usize> = skin.joints().map(|it| it.index()).collect();
            let inverse_binds = inverse_binds(&skin, buffers, skin_nodes.len())?;
            binds.push((index, skin_nodes, inverse_binds));
        }
        let joint_nodes = joint_order(nodes, binds.iter().flat_map(|it| it.1.iter().copied()));
        if joint_nodes.is_empty() {
            return Ok(None);
        }
        let joint_of_node: HashMap<usize, u32> =
            joint_nodes.iter().enumerate().map(|(joint, &node)| (node, joint as u32)).collect();
        let mut rest: Vec<_> = joint_nodes.iter().map(|&it| nodes.world[it]).collect();
        if pose == RestPose::Bind {
            for (_, skin_nodes, inverse_binds) in binds.iter().rev() {
                let world_from_mesh = nodes.world[skin_nodes[0]] * inverse_binds[0];
                for (node, inverse_bind) in skin_nodes.iter().zip(inverse_binds) {
                    let bind = inverse_bind.try_inverse().ok_or_else(|| singular(nodes, *node))?;
                    rest[joint_of_node[node] as usize] = world_from_mesh * bind;
                }
            }
        }
        let skins = binds
            .into_iter()
            .map(|(index, skin_nodes, inverse_binds)| {
                let joints: Vec<u32> = skin_nodes.iter().map(|it| joint_of_node[it]).collect();
                let world_from_mesh =
                    joints.iter().zip(&inverse_binds).map(|(&q, bind)| rest[q as usize] * bind);
                (index, Skin { world_from_mesh: world_from_mesh.collect(), joints })
            })
            .collect();
        let skeleton = skeleton_of(nodes, &joint_nodes, &joint_of_node, &rest)?;
        Ok(Some(Self { skeleton, joint_nodes, joint_of_node, rest, skins }))
    }

    /// `world_from_local` at rest of a node that hangs on a joint.
    fn carry(&self, nodes: &Nodes, joint_node: usize, node: usize) -> Matrix4<f64> {
        let rest = self.rest[self.joint_of_node[&joint_node] as usize];
        let joint_from_world = nodes.world[joint_node].try_inverse().unwrap_or_else(Matrix4::zeros);
        rest * joint_from_world * nodes.world[node]
    }
}

fn singular(nodes: &Nodes, node: usize) -> ReadError {
    let name = nodes.names[node].as_deref().unwrap_or_default();
    ReadError::content(FORMAT, format!("the transform of joint `{name}` (node {node}) is singular"))
}

fn inverse_binds(
    skin: &gltf::Skin<'_>,
    buffers: &[Vec<u8>],
    n_joints: usize,
) -> Result<Vec<Matrix4<f64>>, ReadError> {
    let Some(accessor) = skin.inverse_bind_matrices() else {
        return Ok(vec![Matrix4::identity(); n_joints]);
    };
    let values = accessor::floats(&accessor, buffers, 16)?;
    if values.len() < 16 * n_joints {
        let what = format!(
            "skin {} has {} inverse bind matrices for {n_joints} joints",
            skin.index(),
            values.len() / 16
        );
        return Err(ReadError::content(FORMAT, what));
    }
    Ok(values.chunks_exact(16).take(n_joints).map(Matrix4::from_column_slice).collect())
}

/// The joints in the order of the skins, but every ancestor before its descendants.
fn joint_order(nodes: &Nodes, joints: impl Iterator<Item = usize>) -> Vec<usize> {
    let joints: Vec<usize> = joints.collect();
    let is_joint: BTreeSet<usize> = joints.iter().copied().collect();
    let mut placed = BTreeSet::new();
    let mut res = Vec::new();
    for joint in joints {
        let mut chain: Vec<usize> = nodes.up(joint).filter(|it| is_joint.contains(it)).collect();
        chain.reverse();
        res.extend(chain.into_iter().filter(|&it| placed.insert(it)));
    }
    res
}

fn skeleton_of(
    nodes: &Nodes,
    joint_nodes: &[usize],
    joint_of_node: &HashMap<usize, u32>,
    rest: &[Matrix4<f64>],
) -> Result<Skeleton, ReadError> {
    let mut taken = BTreeSet::new();
    let mut names = Vec::new();
    let mut parents = Vec::new();
    for (joint, &node) in joint_nodes.iter().enumerate() {
        let name = nodes.names[node].clone().filter(|it| !it.is_empty());
        let name = name.unwrap_or_else(|| format!("joint_{joint}"));
        names.push(unique_name(&mut taken, &name));
        let above = nodes.up(node).skip(1).find_map(|it| joint_of_node.get(&it));
        parents.push(above.map(|&it| it as usize));
    }
    let positions = rest.iter().map(|it| it.fixed_view::<3, 1>(0, 3).into_owned()).collect();
    Skeleton::new(names, parents, positions)
        .map_err(|error| ReadError::Skeleton { format: FORMAT, error })
}

/// What moves the vertices of a mesh.
enum Mover<'a> {
    Skin(&'a Skin),
    /// One joint, with `world_from_local` at rest.
    Joint(u32, Matrix4<f64>),
    Nothing(Matrix4<f64>),
}

/// The merged meshes.
#[derive(Default)]
struct Parts {
    vertices: Vec<Vec3>,
    rows: Vec<Vec<(u32, f64)>>,
    faces: Vec<[u32; 3]>,
    /// Vertices by the space in which they are stored and their coordinates there.
    known: HashMap<(Option<usize>, [u64; 3]), u32>,
    sources: Vec<Source>,
    n_unweighted: usize,
}

struct Source {
    stored: Vec3,
    /// By joint; empty where the vertex is stored in the world.
    world_from_stored: Vec<(u32, Matrix4<f64>)>,
}

impl Parts {
    fn add(
        &mut self,
        mesh: &gltf::Mesh<'_>,
        buffers: &[Vec<u8>],
        skin: Option<usize>,
        mover: &Mover<'_>,
        weld: bool,
    ) -> Result<(), ReadError> {
        for primitive in mesh.primitives() {
            let place = format!("mesh {}, primitive {}", mesh.index(), primitive.index());
            let fail = |what: String| ReadError::content(FORMAT, format!("{place}: {what}"));
            let Some(accessor) = primitive.get(&gltf::Semantic::Positions) else { continue };
            if !matches!(
                primitive.mode(),
                Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan
            ) {
                continue;
            }
            let positions = accessor::floats(&accessor, buffers, 3)?;
            let n_local = positions.len() / 3;
            if let Some(at) = positions.iter().position(|it| !it.is_finite()) {
                let what = format!("vertex {} has the coordinate {}", at / 3, positions[at]);
                return Err(fail(what));
            }
            let indices = match primitive.indices() {
                Some(it) => accessor::indices(&it, buffers)?,
                None => (0..n_local as u32).collect(),
            };
            let triangles = triangles(primitive.mode(), &indices);
            if let Some(&vertex) = indices.iter().find(|&&it| it as usize >= n_local) {
                let what = format!("a face refers to vertex {vertex}, but there are {n_local}");
                return Err(fail(what));
            }
            let mut rows = match mover {
                Mover::Skin(it) => weight_rows(&primitive, buffers, n_local, it, &fail)?,
                _ => Vec::new(),
            };
            for row in rows.iter_mut().filter(|it| it.is_empty()) {
                self.n_unweighted += 1;
                row.push((0, 1.0));
            }
            let merged: Vec<u32> = (0..n_local)
                .map(|it| {
                    let local = Vec3::from_column_slice(&positions[3 * it..3 * it + 3]);
                    let row = rows.get(it).map(Vec::as_slice).unwrap_or_default();
                    self.vertex(local, row, skin, mover, weld)
                })
                .collect();
            let faces = triangles.into_iter().map(|it| it.map(|it| merged[it as usize]));
            // Joining may leave a face without area; the file's own such faces stay as they are.
            self.faces.extend(faces.filter(|[a, b, c]| !weld || (a != b && b != c && c != a)));
        }
        Ok(())
    }

    /// The number of a new vertex, or of one that it is joined with.
    fn vertex(
        &mut self,
        local: Vec3,
        row: &[(u32, f64)],
        skin: Option<usize>,
        mover: &Mover<'_>,
        weld: bool,
    ) -> u32 {
        // Skinned vertices are compared where they are stored: in the rest pose, seams whose sides
        // have different weights may gape. Stiff ones are compared in the world.
        let stored = match mover {
            Mover::Skin(_) => local,
            Mover::Joint(_, it) | Mover::Nothing(it) => it.transform_point(&local.into()).coords,
        };
        let key = (skin, [stored.x, stored.y, stored.z].map(|it| (it + 0.0).to_bits()));
        let next = self.sources.len() as u32;
        let vertex = if weld { *self.known.entry(key).or_insert(next) } else { next };
        if vertex == next {
            self.sources.push(Source { stored, world_from_stored: Vec::new() });
            self.rows.push(Vec::new());
        }
        match mover {
            Mover::Skin(skin) => {
                for &(own, weight) in row {
                    let joint = skin.joints[own as usize];
                    self.rows[vertex as usize].push((joint, weight));
                    let matrices = &mut self.sources[vertex as usize].world_from_stored;
                    if matrices.iter().all(|it| it.0 != joint) {
                        matrices.push((joint, skin.world_from_mesh[own as usize]));
                    }
                }
            }
            Mover::Joint(joint, _) => self.rows[vertex as usize].push((*joint, 1.0)),
            Mover::Nothing(_) => {}
        }
        vertex
    }

    /// Adds up the weights of joined vertices and puts the vertices into the rest pose.
    fn finish(&mut self) {
        for (source, row) in self.sources.iter().zip(&mut self.rows) {
            // Adding in the order of joints makes equal weights give equal positions.
            row.sort_by_key(|it| it.0);
            let sum: f64 = row.iter().map(|it| it.1).sum();
            if source.world_from_stored.is_empty() {
                self.vertices.push(source.stored);
                continue;
            }
            let mut position = Vec3::zeros();
            for &(joint, weight) in row.iter() {
                let matrix = source.world_from_stored.iter().find(|it| it.0 == joint);
                let (_, matrix) = matrix.expect("stored with the weight");
                position += matrix.transform_point(&source.stored.into()).coords * (weight / sum);
            }
            self.vertices.push(position);
        }
    }
}

/// Weights by the skin's own joint numbers, divided by their sums.
fn weight_rows(
    primitive: &gltf::Primitive<'_>,
    buffers: &[Vec<u8>],
    n_vertices: usize,
    skin: &Skin,
    fail: &dyn Fn(String) -> ReadError,
) -> Result<Vec<Vec<(u32, f64)>>, ReadError> {
    let mut rows = vec![Vec::new(); n_vertices];
    for set in 0.. {
        let (Some(joints), Some(weights)) = (
            primitive.get(&gltf::Semantic::Joints(set)),
            primitive.get(&gltf::Semantic::Weights(set)),
        ) else {
            break;
        };
        let joints = accessor::floats(&joints, buffers, 4)?;
        let weights = accessor::floats(&weights, buffers, 4)?;
        if joints.len() != 4 * n_vertices || weights.len() != 4 * n_vertices {
            let (n_joints, n_weights) = (joints.len() / 4, weights.len() / 4);
            return Err(fail(format!(
                "{n_joints} rows of joints and {n_weights} of weights for {n_vertices} vertices"
            )));
        }
        for (index, (&joint, &weight)) in joints.iter().zip(&weights).enumerate() {
            let vertex = index / 4;
            if !(0.0..f64::INFINITY).contains(&weight) {
                return Err(fail(format!("vertex {vertex} has the weight {weight}")));
            }
            if weight == 0.0 {
                continue;
            }
            if joint >= skin.joints.len() as f64 {
                let n_joints = skin.joints.len();
                return Err(fail(format!(
                    "vertex {vertex} is moved by joint {joint}, but the skin has {n_joints}"
                )));
            }
            rows[vertex].push((joint as u32, weight));
        }
    }
    for row in &mut rows {
        let sum: f64 = row.iter().map(|it| it.1).sum();
        row.iter_mut().for_each(|it| it.1 /= sum);
    }
    Ok(rows)
}

/// Triangles of lists, strips (every other one turned) and fans.
fn triangles(mode: Mode, indices: &[u32]) -> Vec<[u32; 3]> {
    match mode {
        Mode::TriangleStrip => indices
            .windows(3)
            .enumerate()
            .map(|(at, it)| if at % 2 == 0 { [it[0], it[1], it[2]] } else { [it[1], it[0], it[2]] })
            .collect(),
        Mode::TriangleFan => super::error::fan(indices).collect(),
        _ => indices.chunks_exact(3).map(|it| [it[0], it[1], it[2]]).collect(),
    }
}
