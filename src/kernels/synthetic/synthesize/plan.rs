//! What a body plan consists of, and a builder for it.

use super::{
    loft::{Loft, Station},
    surface::{Part, Stretch, Surface},
};
use crate::kernels::{geometry::mesh::Vec3, rigs::skeleton::Skeleton};

/// A body at rest: its joints, its surface, and where its landmarks are.
#[derive(Debug, Clone)]
pub struct Plan {
    pub skeleton: Skeleton,
    pub surface: Surface,
    pub landmarks: Vec<Aim>,
}

/// A landmark: where a ray from inside leaves the body.
#[derive(Debug, Clone, Copy)]
pub struct Aim {
    pub name: &'static str,
    pub from: Vec3,
    pub direction: Vec3,
}

/// Joints under construction.
#[derive(Debug, Default)]
pub struct Joints {
    names: Vec<String>,
    parents: Vec<Option<usize>>,
    positions: Vec<Vec3>,
}

impl Joints {
    /// Adds a joint under one that is there already (a root without).
    pub fn add(&mut self, name: impl Into<String>, parent: Option<usize>, position: Vec3) -> usize {
        self.names.push(name.into());
        self.parents.push(parent);
        self.positions.push(position);
        self.names.len() - 1
    }

    /// Adds joints each under the one before.
    pub fn chain(&mut self, prefix: &str, parent: usize, joints: &[(&str, Vec3)]) -> Vec<usize> {
        let mut parent = parent;
        let add = |&(name, position): &(&str, Vec3)| {
            parent = self.add(format!("{prefix}{name}"), Some(parent), position);
            parent
        };
        joints.iter().map(add).collect()
    }

    pub fn position(&self, joint: usize) -> Vec3 {
        self.positions[joint]
    }

    pub fn finish(self) -> Skeleton {
        Skeleton::new(self.names, self.parents, self.positions)
            .expect("a plan adds parents first and names once")
    }

    /// A part whose stretches begin nearest to the positions of their joints.
    ///
    /// `moved_by` lists joints with the softness of their beginning, in metres; the first holds from
    /// the start of the loft, wherever its own position is.
    pub fn part(&self, loft: Loft, blend: f64, moved_by: &[(usize, f64)]) -> Part {
        let stretch = |&(joint, softness): &(usize, f64)| Stretch {
            joint,
            start: loft.along(self.positions[joint]),
            softness,
        };
        let stretches = moved_by.iter().map(stretch).collect();
        Part { loft, blend, stretches }
    }
}

/// A blob: half ellipsoids around a short axis.
pub fn blob(centre: Vec3, axis: Vec3, radius: f64, length: f64) -> Loft {
    let stations = [-0.5, 0.5].map(|it| Station::round(centre + axis * it * length, radius));
    Loft::new(stations.to_vec(), perpendicular(axis), [radius, radius])
}

/// Some direction that is not that of `axis`.
fn perpendicular(axis: Vec3) -> Vec3 {
    if axis.z.abs() < 0.8 * axis.norm() { Vec3::z() } else { Vec3::y() }
}

/// The two sides of a body: the prefix of joints and the sign of x. +X is the character's left.
pub const SIDES: [(&str, f64); 2] = [("left_", 1.0), ("right_", -1.0)];
