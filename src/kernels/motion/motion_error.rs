//! How far a transferred motion is from the true one.

use crate::kernels::geometry::kabsch::best_rotation;
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::geometry::mesh_sequence::MeshSequence;

/// The diagonal of the bounding box that errors of different characters are compared in.
pub const USUAL_DIAGONAL: f64 = 2.0;

/// Errors of a motion, in the unit of the truth.
#[derive(Debug, Clone, PartialEq)]
pub struct MotionErrors {
    /// The root of the mean squared distance of vertices, by frame.
    pub reconstruction: Vec<f64>,
    /// The same after the best rigid motion of every frame.
    pub local_pose: Vec<f64>,
    /// What makes the diagonal of the true first frame [`USUAL_DIAGONAL`]; NaN if it has none.
    pub scale: f64,
}

impl MotionErrors {
    /// The root of the mean of squares over frames, which all have as many vertices.
    pub fn overall(of_frames: &[f64]) -> f64 {
        (of_frames.iter().map(|it| it * it).sum::<f64>() / of_frames.len() as f64).sqrt()
    }
}

/// Why motions cannot be compared.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MotionErrorError {
    #[error("the estimate has {estimate} {what}, the truth {truth}")]
    Counts { what: &'static str, estimate: usize, truth: usize },
}

/// Compares a moving mesh with the true one, vertex by vertex (Transfer4D, section 4.2).
///
/// # Errors
/// [`MotionErrorError::Counts`].
pub fn motion_errors(
    estimate: &MeshSequence,
    truth: &MeshSequence,
) -> Result<MotionErrors, MotionErrorError> {
    for (what, estimate, truth) in [
        ("vertices", estimate.n_vertices(), truth.n_vertices()),
        ("frames", estimate.n_frames(), truth.n_frames()),
    ] {
        if estimate != truth {
            return Err(MotionErrorError::Counts { what, estimate, truth });
        }
    }
    let frames = || (0..truth.n_frames()).map(|it| (estimate.frame(it), truth.frame(it)));
    let (low, high) = truth.mesh(0).expect("a sequence has a frame").bounds();
    let diagonal = (high - low).norm();
    Ok(MotionErrors {
        reconstruction: frames().map(|(a, b)| distance(a, b)).collect(),
        local_pose: frames().map(|(a, b)| distance_of_shapes(a, b)).collect(),
        scale: if diagonal > 0.0 { USUAL_DIAGONAL / diagonal } else { f64::NAN },
    })
}

fn distance(a: &[Vec3], b: &[Vec3]) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(a, b)| (a - b).norm_squared()).sum();
    (sum / a.len() as f64).sqrt()
}

fn distance_of_shapes(a: &[Vec3], b: &[Vec3]) -> f64 {
    let mean = |it: &[Vec3]| it.iter().sum::<Vec3>() / it.len() as f64;
    let (from, to) = (mean(a), mean(b));
    let rotation =
        best_rotation(&a.iter().zip(b).map(|(a, b)| (b - to) * (a - from).transpose()).sum());
    let moved: Vec<Vec3> = a.iter().map(|it| rotation * (it - from) + to).collect();
    distance(&moved, b)
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion};

    use super::*;
    use crate::kernels::geometry::shapes::icosphere;

    fn sequence(frames: Vec<Vec<Vec3>>) -> MeshSequence {
        MeshSequence::from_frames(frames, icosphere(1).faces().to_vec(), 30.0).unwrap()
    }

    #[test]
    fn rigid_motions_have_no_local_error_and_shifts_are_measured() {
        let sphere = icosphere(1).vertices().to_vec();
        let turn = UnitQuaternion::from_scaled_axis(Vec3::new(0.3, -1.0, 0.4));
        let motion = Isometry3::from_parts(Translation3::new(1.0, 2.0, -2.0), turn);
        let moved: Vec<Vec3> =
            sphere.iter().map(|it| (motion * Point3::from(*it)).coords).collect();
        let shifted: Vec<Vec3> = sphere.iter().map(|it| it + Vec3::new(0.0, 3.0, 4.0)).collect();
        let truth = sequence(vec![sphere.clone(), sphere.clone()]);
        let errors = motion_errors(&sequence(vec![moved, shifted]), &truth).unwrap();
        assert!(errors.local_pose.iter().all(|it| *it < 1e-12));
        assert!((errors.reconstruction[1] - 5.0).abs() < 1e-12);
        let (low, high) = truth.mesh(0).unwrap().bounds();
        assert!((errors.scale * (high - low).norm() - 2.0).abs() < 1e-12);
        let expected = (0.5_f64 * (errors.reconstruction[0].powi(2) + 25.0)).sqrt();
        assert!((MotionErrors::overall(&errors.reconstruction) - expected).abs() < 1e-12);
    }

    #[test]
    fn a_limb_that_is_off_is_off_in_both() {
        let sphere = icosphere(1).vertices().to_vec();
        let off = sphere.iter().map(|it| if it.x > 0.5 { it * 1.5 } else { *it }).collect();
        let errors = motion_errors(&sequence(vec![off]), &sequence(vec![sphere.clone()])).unwrap();
        assert!(errors.local_pose[0] > 0.01 && errors.local_pose[0] < errors.reconstruction[0]);
        let two = sequence(vec![sphere.clone(), sphere.clone()]);
        let error = motion_errors(&two, &sequence(vec![sphere])).unwrap_err().to_string();
        assert_eq!(error, "the estimate has 2 frames, the truth 1");
    }
}
