//! Skeletons of moving surfaces by simpler methods, which others are measured against.

mod k_means;
pub mod keypoints;
pub mod le;
mod leading_vectors;
mod regions;
mod tree;
pub mod zhang;

use nalgebra::UnitQuaternion;

use crate::kernels::geometry::mesh::{TriMesh, Vec3};
use crate::kernels::geometry::mesh_sequence::MeshSequence;
use crate::kernels::rigs::clip::Clip;
use crate::kernels::rigs::skeleton::{Skeleton, SkeletonError};
use crate::kernels::rigs::ssdr::{Ssdr, SsdrError, SsdrOptions, ssdr};
use crate::kernels::rigs::weights::{SkinWeights, WeightsError};
use crate::kernels::table::{Column, Table};

/// A skeleton that was found in a moving surface.
#[derive(Debug, Clone, PartialEq)]
pub struct MovingSkeleton {
    /// Joints at rest: `joint_00`, …
    pub skeleton: Skeleton,
    /// Where the joints go: rotations are the identity, translations the offsets from the parents.
    pub clip: Clip,
    pub weights: SkinWeights,
    /// The root of the mean squared distance, over all frames and vertices, of the surface that is
    /// skinned by the weights with the bones' rigid motions; in the surface's unit.
    pub error: f64,
}

impl MovingSkeleton {
    /// One row: the number of joints and the error.
    pub fn summary(&self) -> Table {
        Table::new(vec![
            Column::numbers("joints", "", vec![self.skeleton.n_joints() as f64]),
            Column::numbers("error", "", vec![self.error]),
        ])
    }
}

/// Why there is no skeleton.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BaselineError {
    #[error("the sequence has {n_frames} frames, but motion needs 2")]
    Frames { n_frames: usize },
    #[error("the rest pose has {n_rest} vertices, but the sequence has {n_vertices}")]
    Rest { n_rest: usize, n_vertices: usize },
    #[error("{n_clusters} clusters are wanted of {n_vertices} vertices")]
    Clusters { n_clusters: usize, n_vertices: usize },
    #[error("the option `{name}` is {value}, but must be {wanted}")]
    Option { name: &'static str, value: f64, wanted: &'static str },
    #[error("the {n_points} points have no {k} leading eigenvectors")]
    Eigenvectors { n_points: usize, k: usize },
    #[error(transparent)]
    Ssdr(#[from] SsdrError),
    #[error(transparent)]
    Skeleton(#[from] SkeletonError),
    #[error(transparent)]
    Weights(#[from] WeightsError),
}

/// A surface in motion, and its rest pose.
pub struct Moving<'a> {
    rest: &'a [Vec3],
    faces: &'a [[u32; 3]],
    frames: Vec<&'a [Vec3]>,
    frames_per_second: f64,
}

impl<'a> Moving<'a> {
    /// Without a `rest` pose the first frame is it.
    ///
    /// # Errors
    /// [`BaselineError::Frames`] or [`BaselineError::Rest`].
    pub fn new(
        sequence: &'a MeshSequence,
        rest: Option<&'a TriMesh>,
    ) -> Result<Self, BaselineError> {
        let n_frames = sequence.n_frames();
        if n_frames < 2 {
            return Err(BaselineError::Frames { n_frames });
        }
        let frames: Vec<&[Vec3]> = (0..n_frames).map(|it| sequence.frame(it)).collect();
        let rest = rest.map_or(frames[0], TriMesh::vertices);
        let (n_rest, n_vertices) = (rest.len(), sequence.n_vertices());
        if n_rest != n_vertices {
            return Err(BaselineError::Rest { n_rest, n_vertices });
        }
        let frames_per_second = sequence.frames_per_second();
        Ok(Self { rest, faces: sequence.faces(), frames, frames_per_second })
    }

    fn n_vertices(&self) -> usize {
        self.rest.len()
    }

    /// Half the diagonal of the box around the rest pose; 1 if that is a point.
    fn scale(&self) -> f64 {
        let first = self.rest[0];
        let (low, high) =
            self.rest.iter().fold((first, first), |(l, h), it| (l.inf(it), h.sup(it)));
        let half = (high - low).norm() / 2.0;
        if half > 0.0 { half } else { 1.0 }
    }

    fn check_clusters(&self, n_clusters: usize) -> Result<(), BaselineError> {
        let n_vertices = self.n_vertices();
        match n_clusters == 0 || n_clusters > n_vertices {
            true => Err(BaselineError::Clusters { n_clusters, n_vertices }),
            false => Ok(()),
        }
    }

    /// The rigid motions that fit the vertices of every label best. Labels are `0..n`, each with a
    /// vertex.
    fn rigid_motions(&self, labels: &[u32]) -> Result<Ssdr, BaselineError> {
        let options = SsdrOptions { max_iterations: 0, smoothness: 0.0, ..SsdrOptions::default() };
        Ok(ssdr(self.rest, self.faces, &self.frames, Some(labels), &options)?)
    }

    /// Puts a skeleton together from joints in any order; also returns the new number of every one.
    ///
    /// `paths` holds the joints' places in every frame. Joints are numbered from the root outward.
    fn assembled(
        &self,
        rest: &[Vec3],
        paths: &[Vec<Vec3>],
        parents: &[Option<usize>],
    ) -> Result<(Skeleton, Clip, Vec<u32>), BaselineError> {
        let n_joints = rest.len();
        let order = tree::outward(parents);
        let mut new_of_old = vec![0_u32; n_joints];
        for (new, old) in (0_u32..).zip(&order) {
            new_of_old[*old] = new;
        }
        let names = (0..n_joints).map(|it| format!("joint_{it:02}")).collect();
        let parent = |old: &usize| parents[*old].map(|it| new_of_old[it] as usize);
        let positions = order.iter().map(|old| rest[*old]).collect();
        let skeleton = Skeleton::new(names, order.iter().map(parent).collect(), positions)?;
        let offset = |places: &[Vec3], old: usize| match parents[old] {
            Some(parent) => places[old] - places[parent],
            None => places[old],
        };
        let translations =
            paths.iter().flat_map(|places| order.iter().map(|old| offset(places, *old))).collect();
        let clip = Clip {
            name: "tracked".to_owned(),
            frames_per_second: self.frames_per_second,
            n_joints,
            rotations: vec![UnitQuaternion::identity(); n_joints * paths.len()],
            translations,
        };
        Ok((skeleton, clip, new_of_old))
    }
}

/// The means of the members of each of `n` labels in one frame.
fn means(points: &[Vec3], labels: &[u32], n: usize) -> Vec<Vec3> {
    let mut sums = vec![(Vec3::zeros(), 0.0); n];
    for (point, &label) in points.iter().zip(labels) {
        let (sum, count) = &mut sums[label as usize];
        *sum += point;
        *count += 1.0;
    }
    sums.into_iter().map(|(sum, count)| sum / f64::max(count, 1.0)).collect()
}

#[cfg(test)]
mod tests;
