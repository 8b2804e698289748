//! The forest of nodes and its transforms.

use gltf::{Document, scene::Transform};
use nalgebra::{Matrix4, Quaternion, UnitQuaternion};

use super::FORMAT;
use crate::kernels::{geometry::mesh::Vec3, io::error::ReadError};

/// Where a node stands in its parent.
#[derive(Debug, Clone, Copy)]
pub enum Local {
    Matrix(Matrix4<f64>),
    Parts { translation: Vec3, rotation: UnitQuaternion<f64>, scale: Vec3 },
}

impl Local {
    pub fn matrix(&self) -> Matrix4<f64> {
        match *self {
            Self::Matrix(it) => it,
            Self::Parts { translation, rotation, scale } => {
                Matrix4::new_translation(&translation)
                    * rotation.to_homogeneous()
                    * Matrix4::new_nonuniform_scaling(&scale)
            }
        }
    }
}

pub struct Nodes {
    pub names: Vec<Option<String>>,
    pub parents: Vec<Option<usize>>,
    pub locals: Vec<Local>,
    /// Depth first: parents before children, siblings in order.
    pub order: Vec<usize>,
    /// `world_from_node` before any animation.
    pub world: Vec<Matrix4<f64>>,
}

impl Nodes {
    /// # Errors
    /// If a node has two parents, or nodes form a cycle.
    pub fn of(document: &Document) -> Result<Self, ReadError> {
        let n_nodes = document.nodes().count();
        let children: Vec<Vec<usize>> =
            document.nodes().map(|it| it.children().map(|it| it.index()).collect()).collect();
        let mut parents: Vec<Option<usize>> = vec![None; n_nodes];
        for (parent, children) in children.iter().enumerate() {
            for &child in children {
                if let Some(other) = parents[child].replace(parent) {
                    let what = format!("node {child} has two parents, {other} and {parent}");
                    return Err(ReadError::content(FORMAT, what));
                }
            }
        }
        let mut stack: Vec<usize> =
            (0..n_nodes).filter(|&it| parents[it].is_none()).rev().collect();
        let mut order = Vec::with_capacity(n_nodes);
        while let Some(node) = stack.pop() {
            order.push(node);
            stack.extend(children[node].iter().rev());
        }
        if order.len() < n_nodes {
            let n_left = n_nodes - order.len();
            return Err(ReadError::content(FORMAT, format!("{n_left} nodes form a cycle")));
        }
        let locals: Vec<Local> = document.nodes().map(|it| local(&it.transform())).collect();
        let names = document.nodes().map(|it| it.name().map(str::to_owned)).collect();
        let mut nodes = Self { names, parents, locals, order, world: Vec::new() };
        nodes.world = nodes.world_of(&nodes.locals);
        Ok(nodes)
    }

    /// `world_from_node` for given local transforms.
    pub fn world_of(&self, locals: &[Local]) -> Vec<Matrix4<f64>> {
        let mut world = vec![Matrix4::identity(); locals.len()];
        for &node in &self.order {
            let local = locals[node].matrix();
            world[node] = self.parents[node].map_or(local, |it| world[it] * local);
        }
        world
    }

    /// The node, its parent, ... up to the root.
    pub fn up(&self, node: usize) -> impl Iterator<Item = usize> + '_ {
        std::iter::successors(Some(node), |&it| self.parents[it])
    }

    pub fn root(&self, node: usize) -> usize {
        self.up(node).last().unwrap_or(node)
    }

    /// The first of the node and its ancestors for which `wanted` holds.
    pub fn nearest(&self, node: usize, wanted: impl Fn(usize) -> bool) -> Option<usize> {
        self.up(node).find(|&it| wanted(it))
    }
}

fn local(transform: &Transform) -> Local {
    match transform {
        Transform::Matrix { matrix } => {
            Local::Matrix(Matrix4::from_fn(|row, column| f64::from(matrix[column][row])))
        }
        Transform::Decomposed { translation, rotation, scale } => Local::Parts {
            translation: Vec3::from(translation.map(f64::from)),
            rotation: unit_quaternion(&rotation.map(f64::from)),
            scale: Vec3::from(scale.map(f64::from)),
        },
    }
}

/// From x, y, z, w; zero or not finite becomes no rotation.
pub fn unit_quaternion(xyzw: &[f64]) -> UnitQuaternion<f64> {
    let quaternion = Quaternion::new(xyzw[3], xyzw[0], xyzw[1], xyzw[2]);
    let norm = quaternion.norm();
    if norm.is_finite() && norm > 0.0 {
        UnitQuaternion::new_normalize(quaternion)
    } else {
        UnitQuaternion::identity()
    }
}
