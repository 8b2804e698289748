//! Writing binary glTF: a mesh, with its rig and motion if it has one.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion};
use serde_json::{Value, json};

use crate::kernels::{
    geometry::mesh::{TriMesh, Vec3},
    rigs::{clip::Clip, skeleton::Skeleton, weights::SkinWeights},
};

const FLOAT: u32 = 5126;
const U16: u32 = 5123;
const U32: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const POINTS: u32 = 0;
const TRIANGLES: u32 = 4;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// What is written into one file.
#[derive(Debug, Clone, Copy)]
pub struct GlbScene<'a> {
    pub mesh: &'a TriMesh,
    /// One sRGB colour a vertex. The file holds them linear, as glTF demands.
    pub colours: Option<&'a [[u8; 3]]>,
    pub rig: Option<GlbRig<'a>>,
    /// Most influences kept for a vertex, the largest ones; four fit into one attribute, and many
    /// programs read no more.
    pub max_influences: usize,
}

/// A skeleton, what it moves, and how.
#[derive(Debug, Clone, Copy)]
pub struct GlbRig<'a> {
    pub skeleton: &'a Skeleton,
    /// Without weights the skeleton is written as nodes that move nothing.
    pub weights: Option<&'a SkinWeights>,
    pub clips: &'a [Clip],
}

/// A file, and how much of the weights was cut off.
#[derive(Debug, Clone, PartialEq)]
pub struct Glb {
    pub bytes: Vec<u8>,
    /// Vertices with more influences than were kept.
    pub n_cut_vertices: usize,
    /// The largest sum of weights that one vertex lost, before the rest was scaled to one.
    pub max_cut_weight: f64,
}

/// Writes a scene so that other programs show what it means.
///
/// The local +Y of every joint points to its only child, to the middle of several, or on from its
/// parent, as programs with bones expect; clips are turned into these frames exactly. The skinned
/// mesh is a root of the scene, several roots of a skeleton get one above them, weights are sorted by
/// size and sum to one. Positions are in single precision. Clips without frames are left out.
///
/// # Panics
/// If the counts of vertices or joints do not agree.
pub fn write_glb(scene: GlbScene<'_>) -> Glb {
    let mut out = Out::default();
    let (attributes, cut) = attributes(&mut out, &scene);
    let mut primitive = json!({ "attributes": attributes, "mode": POINTS });
    if !scene.mesh.is_point_cloud() {
        let indices = bytemuck::cast_slice(scene.mesh.faces());
        let indices = out.accessor(indices, U32, "SCALAR", 1, Some(ELEMENT_ARRAY_BUFFER), false);
        primitive["indices"] = json!(indices);
        primitive["mode"] = json!(TRIANGLES);
    }
    let mesh = json!({ "name": "mesh", "primitives": [primitive] });
    let mut document = json!({
        "asset": { "version": "2.0", "generator": concat!("sinew ", env!("CARGO_PKG_VERSION")) },
        "scene": 0,
    });
    let mut mesh_node = json!({ "name": "mesh", "mesh": 0 });
    let mut nodes = Vec::new();
    let mut roots = Vec::new();
    if let Some(rig) = &scene.rig {
        let joints = Joints::of(rig.skeleton);
        nodes = joints.nodes();
        roots.push(json!(joints.root()));
        if rig.weights.is_some() {
            let binds: Vec<f32> = joints.inverse_binds();
            let binds = out.accessor(bytemuck::cast_slice(&binds), FLOAT, "MAT4", 16, None, false);
            document["skins"] = json!([{
                "name": "skin",
                "joints": (0..joints.n_nodes()).collect::<Vec<_>>(),
                "skeleton": joints.root(),
                "inverseBindMatrices": binds,
            }]);
            mesh_node["skin"] = json!(0);
        }
        let clips = rig.clips.iter().filter(|it| it.n_frames() > 0);
        let animations: Vec<Value> =
            clips.map(|it| animation(&mut out, it, rig.skeleton, &joints)).collect();
        if !animations.is_empty() {
            document["animations"] = json!(animations);
        }
    }
    roots.insert(0, json!(nodes.len()));
    nodes.push(mesh_node);
    document["scenes"] = json!([{ "nodes": roots }]);
    document["nodes"] = json!(nodes);
    document["meshes"] = json!([mesh]);
    let bytes = out.finish(document);
    Glb { bytes, n_cut_vertices: cut.0, max_cut_weight: cut.1 }
}

/// Collects accessors, views and their bytes.
#[derive(Default)]
struct Out {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Out {
    /// Adds numbers and returns the accessor's index.
    fn accessor(
        &mut self,
        data: &[u8],
        component: u32,
        shape: &str,
        width: usize,
        target: Option<u32>,
        bounds: bool,
    ) -> usize {
        while !self.bytes.len().is_multiple_of(4) {
            self.bytes.push(0);
        }
        let mut view =
            json!({ "buffer": 0, "byteOffset": self.bytes.len(), "byteLength": data.len() });
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.bytes.extend_from_slice(data);
        let size = if component == U16 { 2 } else { 4 };
        let mut accessor = json!({
            "bufferView": self.views.len(), "componentType": component,
            "count": data.len() / (size * width), "type": shape,
        });
        if bounds {
            let values: Vec<f32> = bytemuck::pod_collect_to_vec(data);
            let fold = |start: f32, pick: fn(f32, f32) -> f32| -> Vec<f32> {
                let column = |it| values.iter().skip(it).step_by(width).copied();
                (0..width).map(|it| column(it).fold(start, pick)).collect()
            };
            accessor["min"] = json!(fold(f32::INFINITY, f32::min));
            accessor["max"] = json!(fold(f32::NEG_INFINITY, f32::max));
        }
        self.views.push(view);
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    fn floats(
        &mut self,
        data: &[f32],
        shape: &str,
        width: usize,
        target: Option<u32>,
        bounds: bool,
    ) -> usize {
        self.accessor(bytemuck::cast_slice(data), FLOAT, shape, width, target, bounds)
    }

    fn finish(mut self, mut document: Value) -> Vec<u8> {
        while !self.bytes.len().is_multiple_of(4) {
            self.bytes.push(0);
        }
        document["accessors"] = json!(self.accessors);
        document["bufferViews"] = json!(self.views);
        document["buffers"] = json!([{ "byteLength": self.bytes.len() }]);
        let mut text = document.to_string().into_bytes();
        while !text.len().is_multiple_of(4) {
            text.push(b' ');
        }
        let length = 12 + 8 + text.len() + 8 + self.bytes.len();
        let mut out = Vec::with_capacity(length);
        out.extend_from_slice(b"glTF");
        out.extend_from_slice(&2u32.to_le_bytes());
        out.extend_from_slice(&(length as u32).to_le_bytes());
        for (kind, chunk) in [(b"JSON", &text), (b"BIN\0", &self.bytes)] {
            out.extend_from_slice(&(chunk.len() as u32).to_le_bytes());
            out.extend_from_slice(kind);
            out.extend_from_slice(chunk);
        }
        out
    }
}

/// The attributes of the mesh, and (vertices, largest weight) cut off.
fn attributes(out: &mut Out, scene: &GlbScene<'_>) -> (Value, (usize, f64)) {
    let mesh = scene.mesh;
    let target = Some(ARRAY_BUFFER);
    let positions: Vec<f32> = mesh.vertices().iter().flat_map(single).collect();
    // A vertex without faces needs a normal all the same.
    let up = |it: Vec3| if it == Vec3::zeros() { Vec3::y() } else { it };
    let normals: Vec<f32> =
        mesh.vertex_normals().into_iter().flat_map(|it| single(&up(it))).collect();
    let mut res = json!({
        "POSITION": out.floats(&positions, "VEC3", 3, target, true),
        "NORMAL": out.floats(&normals, "VEC3", 3, target, false),
    });
    if let Some(colours) = scene.colours {
        assert_eq!(colours.len(), mesh.n_vertices(), "a colour for every vertex");
        let linear: Vec<f32> = colours.iter().flatten().map(|&it| linear_of_srgb(it)).collect();
        res["COLOR_0"] = json!(out.floats(&linear, "VEC3", 3, target, false));
    }
    let Some(weights) = scene.rig.and_then(|it| it.weights) else { return (res, (0, 0.0)) };
    assert_eq!(weights.n_vertices(), mesh.n_vertices(), "weights for every vertex");
    let n_kept = scene.max_influences.clamp(1, weights.max_influences().max(1));
    let mut cut = (0, 0.0f64);
    let rows: Vec<Vec<(u16, f32)>> = (0..mesh.n_vertices())
        .map(|it| largest(weights.row(it).collect(), n_kept, &mut cut))
        .collect();
    for set in 0..n_kept.div_ceil(4) {
        let slot =
            |row: &Vec<(u16, f32)>, it: usize| row.get(4 * set + it).copied().unwrap_or((0, 0.0));
        let joints: Vec<u16> =
            rows.iter().flat_map(|row| [0, 1, 2, 3].map(|it| slot(row, it).0)).collect();
        let values: Vec<f32> =
            rows.iter().flat_map(|row| [0, 1, 2, 3].map(|it| slot(row, it).1)).collect();
        let joints = out.accessor(bytemuck::cast_slice(&joints), U16, "VEC4", 4, target, false);
        res[format!("JOINTS_{set}")] = json!(joints);
        res[format!("WEIGHTS_{set}")] = json!(out.floats(&values, "VEC4", 4, target, false));
    }
    (res, cut)
}

/// The largest influences in single precision, by size, with a sum of one.
fn largest(mut row: Vec<(u32, f64)>, n_kept: usize, cut: &mut (usize, f64)) -> Vec<(u16, f32)> {
    row.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    if row.len() > n_kept {
        cut.0 += 1;
        cut.1 = cut.1.max(row[n_kept..].iter().map(|it| it.1).sum());
        row.truncate(n_kept);
    }
    let sum: f64 = row.iter().map(|it| it.1).sum();
    let mut row: Vec<(u16, f32)> =
        row.into_iter().map(|it| (it.0 as u16, (it.1 / sum) as f32)).collect();
    // Weights that vanish in single precision must not name a joint.
    row.retain(|it| it.1 > 0.0);
    let rest: f64 = row.iter().skip(1).map(|it| f64::from(it.1)).sum();
    row[0].1 = (1.0 - rest) as f32;
    row
}

/// The frames of the joints at rest, with one root.
struct Joints<'a> {
    skeleton: &'a Skeleton,
    /// `world_from_joint`: +Y along the bone.
    frames: Vec<UnitQuaternion<f64>>,
    /// The name of a node above several roots.
    extra_root: Option<String>,
}

impl<'a> Joints<'a> {
    fn of(skeleton: &'a Skeleton) -> Self {
        let n_roots = skeleton.parents().iter().filter(|it| it.is_none()).count();
        let extra_root = (n_roots > 1).then(|| {
            let mut name = "root".to_owned();
            while skeleton.joint(&name).is_some() {
                name.push('_');
            }
            name
        });
        Self { skeleton, frames: bone_frames(skeleton), extra_root }
    }

    fn n_nodes(&self) -> usize {
        self.skeleton.n_joints() + usize::from(self.extra_root.is_some())
    }

    /// The node of the one root.
    fn root(&self) -> usize {
        if self.extra_root.is_some() { self.n_nodes() - 1 } else { 0 }
    }

    fn nodes(&self) -> Vec<Value> {
        let skeleton = self.skeleton;
        let children = skeleton.children();
        let mut nodes: Vec<Value> = (0..skeleton.n_joints())
            .map(|joint| {
                let at = skeleton.positions()[joint];
                let (rotation, offset) = match skeleton.parents()[joint] {
                    None => (self.frames[joint], at),
                    Some(parent) => {
                        let parent_from_world = self.frames[parent].inverse();
                        let offset = at - skeleton.positions()[parent];
                        (parent_from_world * self.frames[joint], parent_from_world * offset)
                    }
                };
                let mut node = json!({
                    "name": skeleton.names()[joint],
                    "translation": single(&offset),
                    "rotation": rotation.coords.map(|it| it as f32).as_slice(),
                });
                if !children[joint].is_empty() {
                    node["children"] = json!(children[joint]);
                }
                node
            })
            .collect();
        if let Some(name) = &self.extra_root {
            let roots: Vec<usize> =
                (0..skeleton.n_joints()).filter(|&it| skeleton.parents()[it].is_none()).collect();
            nodes.push(json!({ "name": name, "children": roots }));
        }
        nodes
    }

    /// `joint_from_world` at rest, column by column.
    fn inverse_binds(&self) -> Vec<f32> {
        let mut res = Vec::new();
        for (frame, position) in self.frames.iter().zip(self.skeleton.positions()) {
            let inverse = frame.inverse();
            let mut matrix = inverse.to_homogeneous();
            matrix.fixed_view_mut::<3, 1>(0, 3).copy_from(&-(inverse * position));
            res.extend(matrix.iter().map(|&it| it as f32));
        }
        if self.extra_root.is_some() {
            res.extend(nalgebra::Matrix4::<f32>::identity().iter());
        }
        res
    }
}

/// For every joint a frame whose +Y points along its bone.
fn bone_frames(skeleton: &Skeleton) -> Vec<UnitQuaternion<f64>> {
    let positions = skeleton.positions();
    let children = skeleton.children();
    let mut directions: Vec<Vec3> = Vec::with_capacity(skeleton.n_joints());
    for (joint, &parent) in skeleton.parents().iter().enumerate() {
        let own = &children[joint];
        let middle: Vec3 =
            own.iter().map(|&it| positions[it]).sum::<Vec3>() / own.len().max(1) as f64;
        let along = if own.is_empty() { Vec3::zeros() } else { middle - positions[joint] };
        // A child at the same point gives no direction; neither do children all around.
        let direction = along.try_normalize(1e-9).or_else(|| parent.map(|it| directions[it]));
        directions.push(direction.unwrap_or_else(Vec3::y));
    }
    directions.iter().map(frame_along).collect()
}

/// A rotation that takes +Y to a unit vector; its +X stays level where it can.
fn frame_along(y: &Vec3) -> UnitQuaternion<f64> {
    let helper = if y.z.abs() < 0.9 { Vec3::z() } else { Vec3::x() };
    let x = y.cross(&helper).normalize();
    let z = x.cross(y);
    let matrix = Matrix3::from_columns(&[x, *y, z]);
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix))
}

/// A clip in the frames of the bones.
///
/// With `G` the frame of a joint at rest, `P` that of its parent and `r`, `t` the clip's rotation and
/// translation in frames that are aligned with the world, the local rotation is `P^-1 r G` and the
/// translation `P^-1 t`.
fn animation(out: &mut Out, clip: &Clip, skeleton: &Skeleton, joints: &Joints<'_>) -> Value {
    let n_joints = skeleton.n_joints();
    assert_eq!(clip.n_joints, n_joints, "a clip of this skeleton");
    let times: Vec<f32> =
        (0..clip.n_frames()).map(|it| (it as f64 / clip.frames_per_second) as f32).collect();
    let times = out.floats(&times, "SCALAR", 1, None, true);
    let (mut samplers, mut channels) = (Vec::new(), Vec::new());
    let mut channel = |joint: usize, path: &str, values: usize| {
        channels.push(json!({
            "sampler": samplers.len(), "target": { "node": joint, "path": path },
        }));
        samplers.push(json!({ "input": times, "output": values, "interpolation": "LINEAR" }));
    };
    for joint in 0..n_joints {
        let parent = skeleton.parents()[joint];
        let frame = parent.map_or_else(UnitQuaternion::identity, |it| joints.frames[it]).inverse();
        let of_joint = (0..clip.n_frames()).map(|it| it * n_joints + joint);
        let mut rotations: Vec<f32> = Vec::new();
        let mut last = UnitQuaternion::identity();
        for index in of_joint.clone() {
            let rotation = frame * clip.rotations[index] * joints.frames[joint];
            // Of the two signs the one nearer to the last frame, for readers that do not look.
            let sign = if rotation.coords.dot(&last.coords) < 0.0 { -1.0 } else { 1.0 };
            last = UnitQuaternion::new_unchecked(rotation.into_inner() * sign);
            rotations.extend(last.coords.iter().map(|&it| it as f32));
        }
        channel(joint, "rotation", out.floats(&rotations, "VEC4", 4, None, false));
        let at_rest = skeleton.positions()[joint]
            - parent.map_or_else(Vec3::zeros, |it| skeleton.positions()[it]);
        if of_joint.clone().any(|it| clip.translations[it] != at_rest) {
            let translations: Vec<f32> =
                of_joint.flat_map(|it| single(&(frame * clip.translations[it]))).collect();
            channel(joint, "translation", out.floats(&translations, "VEC3", 3, None, false));
        }
    }
    json!({ "name": clip.name, "channels": channels, "samplers": samplers })
}

fn single(it: &Vec3) -> [f32; 3] {
    [it.x as f32, it.y as f32, it.z as f32]
}

/// The light of an sRGB byte (IEC 61966-2-1).
fn linear_of_srgb(byte: u8) -> f32 {
    let it = f64::from(byte) / 255.0;
    let linear = if it <= 0.04045 { it / 12.92 } else { ((it + 0.055) / 1.055).powf(2.4) };
    linear as f32
}

/// A small rigged file for the tests of readers.
#[cfg(test)]
pub(super) fn small_rig() -> Vec<u8> {
    tests::written(4).bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::{
        io::gltf::{GltfOptions, read_gltf},
        rigs::skinning::skin,
    };

    /// Two triangles on a bent arm of four joints, and a clip.
    fn arm() -> (TriMesh, Skeleton, SkinWeights, Clip) {
        let points = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.3, 1.9, 0.2], [0.3, 1.9, 0.9]];
        let positions: Vec<Vec3> = points.iter().map(|&it| Vec3::from(it)).collect();
        let names = ["hip", "spine", "arm", "hand"].map(str::to_owned).to_vec();
        let parents = vec![None, Some(0), Some(1), Some(1)];
        let skeleton = Skeleton::new(names, parents, positions.clone()).unwrap();
        let rows = vec![
            vec![(0, 1.0)],
            vec![(0, 0.25), (1, 0.75)],
            vec![(0, 0.1), (1, 0.2), (2, 0.3), (3, 0.4)],
            vec![(3, 1.0)],
        ];
        let weights = SkinWeights::from_rows(4, &rows).unwrap();
        let vertices = positions.iter().map(|it| it + Vec3::new(0.1, 0.0, 0.05)).collect();
        let mesh = TriMesh::new(vertices, vec![[0, 1, 2], [1, 3, 2]]).unwrap();
        let mut clip = Clip {
            name: "wave".to_owned(),
            frames_per_second: 30.0,
            n_joints: 4,
            rotations: vec![],
            translations: vec![],
        };
        for frame in 0..20 {
            for joint in 0..4 {
                let (a, b) = (f64::from(frame) * 0.05, f64::from(joint) * 0.4);
                clip.rotations.push(UnitQuaternion::from_scaled_axis(Vec3::new(
                    a,
                    -b * a,
                    2.0 * a - b,
                )));
                let parent = skeleton.parents()[joint as usize];
                let at = skeleton.positions()[joint as usize];
                let rest = at - parent.map_or_else(Vec3::zeros, |it| skeleton.positions()[it]);
                clip.translations.push(rest * (1.0 + 0.01 * a));
            }
        }
        (mesh, skeleton, weights, clip)
    }

    pub(super) fn written(max_influences: usize) -> Glb {
        let (mesh, skeleton, weights, clip) = arm();
        let rig = GlbRig { skeleton: &skeleton, weights: Some(&weights), clips: &[clip] };
        write_glb(GlbScene { mesh: &mesh, colours: None, rig: Some(rig), max_influences })
    }

    #[test]
    fn a_point_cloud_is_written_as_points() {
        let (mesh, ..) = arm();
        let cloud = TriMesh::from_points(mesh.vertices().to_vec()).unwrap();
        let scene = GlbScene { mesh: &cloud, colours: None, rig: None, max_influences: 4 };
        let bytes = write_glb(scene).bytes;
        let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        let document: Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
        let primitive = &document["meshes"][0]["primitives"][0];
        assert_eq!(primitive["mode"], json!(0));
        assert!(primitive.get("indices").is_none(), "{primitive}");
    }

    #[test]
    fn what_is_read_is_what_was_written() {
        let (mesh, skeleton, weights, clip) = arm();
        let read = read_gltf(&written(4).bytes, &|_| None, GltfOptions::default()).unwrap();
        assert_eq!(read.mesh.faces(), mesh.faces());
        let close = |a: &Vec3, b: &Vec3| (a - b).norm() < 2e-7;
        assert!(read.mesh.vertices().iter().zip(mesh.vertices()).all(|(a, b)| close(a, b)));
        let read_skeleton = read.skeleton.unwrap();
        assert_eq!(read_skeleton.names(), skeleton.names());
        assert_eq!(read_skeleton.parents(), skeleton.parents());
        assert!(
            read_skeleton.positions().iter().zip(skeleton.positions()).all(|(a, b)| close(a, b))
        );
        let read_weights = read.weights.unwrap();
        for vertex in 0..mesh.n_vertices() {
            for (joint, weight) in weights.row(vertex) {
                assert!((read_weights.get(vertex, joint as usize) - weight).abs() < 1e-7);
            }
        }
        let read_clip = &read.clips[0];
        assert_eq!((read_clip.name.as_str(), read_clip.n_frames()), ("wave", 20));
        for index in 0..clip.rotations.len() {
            assert!(read_clip.rotations[index].angle_to(&clip.rotations[index]) < 2e-6);
            assert!((read_clip.translations[index] - clip.translations[index]).norm() < 1e-6);
        }
        for frame in 0..20 {
            let posed = skin(&mesh, &skeleton, &weights, &clip, frame).unwrap();
            let again = skin(&read.mesh, &read_skeleton, &read_weights, read_clip, frame).unwrap();
            assert!(posed.iter().zip(&again).all(|(a, b)| (a - b).norm() < 3e-6), "frame {frame}");
        }
    }

    #[test]
    fn bones_point_to_their_children() {
        let (_, skeleton, ..) = arm();
        let frames = bone_frames(&skeleton);
        let positions = skeleton.positions();
        let middle = (positions[2] + positions[3]) / 2.0;
        for (joint, to) in
            [(0, positions[1]), (1, middle), (2, positions[2] + middle - positions[1])]
        {
            let along = (to - positions[joint]).normalize();
            assert!((frames[joint] * Vec3::y() - along).norm() < 1e-12, "joint {joint}");
        }
    }

    #[test]
    fn fewer_influences_say_what_is_lost() {
        let glb = written(2);
        assert_eq!(glb.n_cut_vertices, 1);
        assert!((glb.max_cut_weight - 0.3).abs() < 1e-12);
        assert_eq!(written(8).n_cut_vertices, 0);
    }

    #[test]
    fn several_roots_get_one_above_them() {
        let names = vec!["root".to_owned(), "b".to_owned()];
        let skeleton = Skeleton::new(names, vec![None, None], vec![Vec3::x(), Vec3::y()]).unwrap();
        let (mesh, ..) = arm();
        let weights = SkinWeights::from_rows(2, &vec![vec![(0, 0.5), (1, 0.5)]; 4]).unwrap();
        let rig = GlbRig { skeleton: &skeleton, weights: Some(&weights), clips: &[] };
        let colours = [[255, 128, 0]; 4];
        let scene =
            GlbScene { mesh: &mesh, colours: Some(&colours), rig: Some(rig), max_influences: 4 };
        let read = read_gltf(&write_glb(scene).bytes, &|_| None, GltfOptions::default()).unwrap();
        let skeleton = read.skeleton.unwrap();
        assert_eq!(skeleton.names(), ["root_", "root", "b"]);
        assert_eq!(skeleton.parents(), [None, Some(0), Some(0)]);
    }

    #[test]
    fn a_bare_mesh_has_no_rig() {
        let (mesh, ..) = arm();
        let scene = GlbScene { mesh: &mesh, colours: None, rig: None, max_influences: 4 };
        let read = read_gltf(&write_glb(scene).bytes, &|_| None, GltfOptions::default()).unwrap();
        assert_eq!(read.mesh.faces(), mesh.faces());
        assert_eq!((read.skeleton, read.weights), (None, None));
    }
}
