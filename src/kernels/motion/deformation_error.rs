//! How far a mesh in motion is from the same mesh moved by its true rig.

use crate::kernels::{
    geometry::{
        mesh::{TriMesh, Vec3},
        mesh_sequence::MeshSequence,
        topology::Edges,
    },
    rigs::joint_error::{self, HeightAxis},
};

/// One frame of an animation beside the true one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameError {
    /// Mean and largest distance of vertices, in mesh units.
    pub mean: f64,
    pub largest: f64,
    /// The part of the edges that are stretched or pressed far more than in truth.
    pub outliers: f64,
    /// The largest factor between an edge's length and its true one, or the inverse.
    pub stretch: f64,
}

/// Why animations cannot be compared.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DeformationError {
    #[error(
        "the estimate has {estimate} {what}, the truth {truth}: both must be animations of one mesh"
    )]
    Counts { what: &'static str, estimate: usize, truth: usize },
    #[error("the mesh has {mesh} vertices, the animations {animations}")]
    Mesh { mesh: usize, animations: usize },
    #[error("the mesh has no extent along the chosen axis")]
    NoHeight,
}

/// Compares two animations of one mesh, frame by frame.
///
/// An edge is an outlier if it is longer or shorter than in truth by more than the factor
/// `max_stretch`. Edges whose true length is below a thousandth of their rest length are not
/// counted: the true rig has folded them away. Lengths are never taken to be less than that.
///
/// # Errors
/// See [`DeformationError`].
pub fn deformation_errors(
    estimate: &MeshSequence,
    truth: &MeshSequence,
    rest: &TriMesh,
    max_stretch: f64,
) -> Result<Vec<FrameError>, DeformationError> {
    for (what, estimate, truth) in [
        ("vertices", estimate.n_vertices(), truth.n_vertices()),
        ("faces", estimate.faces().len(), truth.faces().len()),
        ("frames", estimate.n_frames(), truth.n_frames()),
    ] {
        if estimate != truth {
            return Err(DeformationError::Counts { what, estimate, truth });
        }
    }
    if rest.n_vertices() != truth.n_vertices() {
        let (mesh, animations) = (rest.n_vertices(), truth.n_vertices());
        return Err(DeformationError::Mesh { mesh, animations });
    }
    let edges = edges(rest);
    let frame = |it| {
        frame_error(estimate.frame(it), truth.frame(it), (rest.vertices(), &edges), max_stretch)
    };
    Ok((0..truth.n_frames()).map(frame).collect())
}

/// The extent of a mesh that percentages refer to.
///
/// # Errors
/// [`DeformationError::NoHeight`].
pub fn height(mesh: &TriMesh, axis: HeightAxis) -> Result<f64, DeformationError> {
    let height = joint_error::height(mesh, axis);
    if height > 0.0 { Ok(height) } else { Err(DeformationError::NoHeight) }
}

fn edges(mesh: &TriMesh) -> Vec<[u32; 2]> {
    let edges = Edges::of(mesh.faces());
    edges.iter().map(|sides| [sides[0].low, sides[0].high]).collect()
}

fn frame_error(
    estimate: &[Vec3],
    truth: &[Vec3],
    (rest, edges): (&[Vec3], &[[u32; 2]]),
    max_stretch: f64,
) -> FrameError {
    let distances = || estimate.iter().zip(truth).map(|(a, b)| (a - b).norm());
    let length = |at: &[Vec3], [a, b]: [u32; 2]| (at[a as usize] - at[b as usize]).norm();
    let (mut counted, mut outliers, mut stretch) = (0usize, 0usize, 1.0f64);
    for &edge in edges {
        let least = 1e-3 * length(rest, edge);
        let true_length = length(truth, edge);
        if !(true_length > least) {
            continue;
        }
        let ratio = length(estimate, edge).max(least) / true_length;
        let factor = ratio.max(1.0 / ratio);
        counted += 1;
        outliers += usize::from(factor > max_stretch);
        stretch = stretch.max(factor);
    }
    FrameError {
        mean: distances().sum::<f64>() / truth.len() as f64,
        largest: distances().fold(0.0, f64::max),
        outliers: outliers as f64 / counted.max(1) as f64,
        stretch,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes::rectangle;

    #[test]
    fn a_moved_vertex_and_its_edges_are_counted() {
        let mesh = rectangle(2, 2, 2.0, 2.0);
        let still = mesh.vertices().to_vec();
        let mut moved = still.clone();
        // The middle one of nine, half way to its right neighbour.
        moved[4] += Vec3::x() * 0.5;
        let sequence = |positions: Vec<Vec3>| {
            MeshSequence::new(30.0, 9, mesh.faces().to_vec(), positions).unwrap()
        };
        let truth = sequence([still.clone(), still.clone()].concat());
        let estimate = sequence([still, moved].concat());
        let errors = deformation_errors(&estimate, &truth, &mesh, 1.9).unwrap();
        let perfect = FrameError { mean: 0.0, largest: 0.0, outliers: 0.0, stretch: 1.0 };
        assert_eq!(errors[0], perfect);
        assert!((errors[1].mean - 0.5 / 9.0).abs() < 1e-15 && errors[1].largest == 0.5);
        // Of 16 edges, the one to the right is half as long.
        assert!((errors[1].outliers - 1.0 / 16.0).abs() < 1e-15, "{:?}", errors[1]);
        assert!((errors[1].stretch - 2.0).abs() < 1e-12);
        let few = MeshSequence::new(30.0, 9, mesh.faces().to_vec(), mesh.vertices().to_vec());
        let error = deformation_errors(&few.unwrap(), &truth, &mesh, 1.5).unwrap_err();
        assert_eq!(
            error.to_string(),
            "the estimate has 1 frames, the truth 2: both must be animations of one mesh"
        );
    }
}
