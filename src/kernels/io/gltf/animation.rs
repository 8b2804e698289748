//! Animations as clips of a constant rate.

use std::collections::BTreeSet;

use gltf::{
    Document,
    animation::{Channel, Interpolation, Property},
};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion};

use super::{
    FORMAT, Rig, accessor,
    nodes::{Local, Nodes, unit_quaternion},
    singular,
};
use crate::kernels::{
    geometry::mesh::Vec3,
    io::{
        character::{push_local_frames, unique_name},
        error::ReadError,
    },
    rigs::clip::Clip,
};

/// More frames than this, and a thousand for every key, are a damaged file (an hour between two keys
/// at 30 frames a second).
const MAX_FRAMES: usize = 108_000;

/// Every animation that moves a joint or an ancestor of one.
///
/// Frames run from the first key to the last, `1 / frames_per_second` apart.
pub fn clips(
    document: &Document,
    buffers: &[Vec<u8>],
    nodes: &Nodes,
    rig: &Rig,
    frames_per_second: f64,
) -> Result<Vec<Clip>, ReadError> {
    let above: BTreeSet<usize> = rig.joint_nodes.iter().flat_map(|&it| nodes.up(it)).collect();
    let rest_inverses = rig
        .rest
        .iter()
        .zip(&rig.joint_nodes)
        .map(|(rest, &node)| {
            let linear: Matrix3<f64> = rest.fixed_view::<3, 3>(0, 0).into_owned();
            linear.try_inverse().ok_or_else(|| singular(nodes, node))
        })
        .collect::<Result<Vec<_>, _>>()?;
    let mut taken = BTreeSet::new();
    let mut clips = Vec::new();
    for animation in document.animations() {
        let mut tracks = Vec::new();
        for channel in animation.channels() {
            let node = channel.target().node().index();
            if above.contains(&node) && channel.target().property() != Property::MorphTargetWeights
            {
                tracks.push(Track::read(&channel, buffers, node)?);
            }
        }
        if tracks.is_empty() {
            continue;
        }
        let fallback = format!("clip_{}", animation.index());
        let name = unique_name(&mut taken, animation.name().unwrap_or(&fallback));
        clips.push(sample(name, &tracks, nodes, rig, &rest_inverses, frames_per_second)?);
    }
    Ok(clips)
}

fn sample(
    name: String,
    tracks: &[Track],
    nodes: &Nodes,
    rig: &Rig,
    rest_inverses: &[Matrix3<f64>],
    frames_per_second: f64,
) -> Result<Clip, ReadError> {
    let start = tracks.iter().map(|it| it.times[0]).fold(f64::INFINITY, f64::min);
    let end = tracks.iter().map(|it| it.times[it.times.len() - 1]).fold(start, f64::max);
    // Times are stored in single precision: a last frame that is just missed still counts.
    let n_steps = ((end - start) * frames_per_second + 1e-3).floor();
    let n_keys: usize = tracks.iter().map(|it| it.times.len()).sum();
    if n_steps > (MAX_FRAMES + 1000 * n_keys) as f64 {
        let what = format!("animation `{name}` lasts {} s", end - start);
        return Err(ReadError::content(FORMAT, what));
    }
    let n_joints = rig.joint_nodes.len();
    let mut clip =
        Clip { name, frames_per_second, n_joints, rotations: Vec::new(), translations: Vec::new() };
    let mut rotations = vec![UnitQuaternion::identity(); n_joints];
    for frame in 0..=n_steps as usize {
        let time = start + frame as f64 / frames_per_second;
        let mut locals = nodes.locals.clone();
        for track in tracks {
            track.apply(time, 1e-3 / frames_per_second, &mut locals[track.node]);
        }
        let world = nodes.world_of(&locals);
        let mut positions: Vec<Vec3> = Vec::with_capacity(n_joints);
        for (joint, &node) in rig.joint_nodes.iter().enumerate() {
            let linear = world[node].fixed_view::<3, 3>(0, 0) * rest_inverses[joint];
            // A joint shrunk to nothing keeps its last rotation.
            rotations[joint] = nearest_rotation(&linear).unwrap_or(rotations[joint]);
            positions.push(world[node].fixed_view::<3, 1>(0, 3).into_owned());
        }
        if let Some(joint) = positions.iter().position(|it| it.iter().any(|it| !it.is_finite())) {
            let joint = &rig.skeleton.names()[joint];
            let what = format!("animation `{}` moves joint `{joint}` to infinity", clip.name);
            return Err(ReadError::content(FORMAT, what));
        }
        push_local_frames(&mut clip, rig.skeleton.parents(), &rotations, &positions);
    }
    Ok(clip)
}

/// The rotation closest to a matrix (its polar factor); `None` if it is singular or mirrors.
fn nearest_rotation(linear: &Matrix3<f64>) -> Option<UnitQuaternion<f64>> {
    let determinant = linear.determinant();
    if !(determinant.is_finite() && determinant > f64::MIN_POSITIVE) {
        return None;
    }
    let scaled = linear / determinant.cbrt();
    let orthogonal = (scaled.transpose() * scaled - Matrix3::identity()).amax() < 1e-12;
    let rotation = if orthogonal {
        scaled
    } else {
        let svd = scaled.try_svd(true, true, f64::EPSILON, 100)?;
        svd.u? * svd.v_t?
    };
    Some(UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation)))
}

/// The keys of one property of one node.
struct Track {
    node: usize,
    property: Property,
    interpolation: Interpolation,
    times: Vec<f64>,
    /// By key; by key in-tangent, value, out-tangent for cubic splines.
    values: Vec<f64>,
    width: usize,
}

impl Track {
    fn read(channel: &Channel<'_>, buffers: &[Vec<u8>], node: usize) -> Result<Self, ReadError> {
        let place = format!("animation {}, node {node}", channel.animation().index());
        let fail = |what: String| ReadError::content(FORMAT, format!("{place}: {what}"));
        let (sampler, property) = (channel.sampler(), channel.target().property());
        let width = if property == Property::Rotation { 4 } else { 3 };
        let times = accessor::floats(&sampler.input(), buffers, 1)?;
        let values = accessor::floats(&sampler.output(), buffers, width)?;
        let interpolation = sampler.interpolation();
        let per_key = if interpolation == Interpolation::CubicSpline { 3 * width } else { width };
        if times.is_empty() || values.len() != times.len() * per_key {
            let (n_keys, n_values) = (times.len(), values.len() / per_key);
            return Err(fail(format!("{n_keys} times for {n_values} keys")));
        }
        if let Some(value) = times.iter().chain(&values).find(|it| !it.is_finite()) {
            return Err(fail(format!("a key is {value}")));
        }
        if let Some(it) = times.windows(2).find(|it| it[0] > it[1]) {
            return Err(fail(format!("the time {} comes after {}", it[1], it[0])));
        }
        Ok(Self { node, property, interpolation, times, values, width })
    }

    fn apply(&self, time: f64, tolerance: f64, local: &mut Local) {
        // A node with a matrix must not be animated; its matrix then counts as no transform.
        if let Local::Matrix(_) = local {
            let (translation, rotation) = (Vec3::zeros(), UnitQuaternion::identity());
            *local = Local::Parts { translation, rotation, scale: Vec3::repeat(1.0) };
        }
        let value = self.at(time, tolerance);
        if let Local::Parts { translation, rotation, scale } = local {
            match self.property {
                Property::Translation => *translation = Vec3::from_column_slice(&value),
                Property::Rotation => *rotation = unit_quaternion(&value),
                Property::Scale => *scale = Vec3::from_column_slice(&value),
                Property::MorphTargetWeights => {}
            }
        }
    }

    fn at(&self, time: f64, tolerance: f64) -> Vec<f64> {
        let last = self.times.len() - 1;
        let after = self.times.partition_point(|&it| it <= time + tolerance);
        let Some(key) = after.checked_sub(1) else { return self.value(0, 1).to_vec() };
        if key == last || time - self.times[key] <= tolerance {
            return self.value(key, 1).to_vec();
        }
        let span = self.times[key + 1] - self.times[key];
        let s = (time - self.times[key]) / span;
        let (from, to) = (self.value(key, 1), self.value(key + 1, 1));
        match self.interpolation {
            Interpolation::Step => from.to_vec(),
            Interpolation::Linear if self.width == 4 => {
                let (from, to) = (unit_quaternion(from), unit_quaternion(to));
                let turned = from.try_slerp(&to, s, 1e-12).unwrap_or(from);
                turned.coords.as_slice().to_vec()
            }
            Interpolation::Linear => from.iter().zip(to).map(|(a, b)| a + s * (b - a)).collect(),
            Interpolation::CubicSpline => {
                let (out, into) = (self.value(key, 2), self.value(key + 1, 0));
                let (s2, s3) = (s * s, s * s * s);
                (0..self.width)
                    .map(|it| {
                        (2.0 * s3 - 3.0 * s2 + 1.0) * from[it]
                            + span * (s3 - 2.0 * s2 + s) * out[it]
                            + (3.0 * s2 - 2.0 * s3) * to[it]
                            + span * (s3 - s2) * into[it]
                    })
                    .collect()
            }
        }
    }

    /// `part` is 0, 1, 2 for the in-tangent, the value and the out-tangent of a cubic spline.
    fn value(&self, key: usize, part: usize) -> &[f64] {
        let row =
            if self.interpolation == Interpolation::CubicSpline { 3 * key + part } else { key };
        &self.values[row * self.width..][..self.width]
    }
}
