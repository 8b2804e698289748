//! How far estimated joints are from the true ones.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::skeleton::Skeleton;
use crate::kernels::geometry::mesh::{TriMesh, Vec3};

/// Distances of the joints that two skeletons share.
#[derive(Debug, Clone, PartialEq)]
pub struct JointErrors {
    /// The common joints, in the estimate's order.
    pub names: Vec<String>,
    /// Euclidean distances, in mesh units.
    pub distances: Vec<f64>,
    /// What distances are divided by for percentages.
    pub height: f64,
    /// Joints of the estimate that the truth does not have.
    pub only_estimate: Vec<String>,
    /// Joints of the truth that the estimate does not have.
    pub only_truth: Vec<String>,
}

impl JointErrors {
    pub fn mean(&self) -> f64 {
        self.distances.iter().sum::<f64>() / self.distances.len() as f64
    }

    pub fn least(&self) -> f64 {
        self.distances.iter().fold(f64::INFINITY, |a, &b| a.min(b))
    }

    pub fn greatest(&self) -> f64 {
        self.distances.iter().fold(0.0, |a, &b| a.max(b))
    }

    /// The mean of the squared distances, in squared mesh units.
    pub fn mean_squared(&self) -> f64 {
        let squares: f64 = self.distances.iter().map(|it| it * it).sum();
        squares / self.distances.len() as f64
    }

    /// A length in percent of the height.
    pub fn percent(&self, length: f64) -> f64 {
        100.0 * length / self.height
    }
}

/// Why joints cannot be compared.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum JointErrorError {
    #[error(
        "the skeletons share no joint: the estimate has `{estimate}` and {n_estimate} joints, \
         the truth `{truth}` and {n_truth} joints"
    )]
    NothingShared { estimate: String, n_estimate: usize, truth: String, n_truth: usize },
    #[error("the mesh has no extent along the chosen axis")]
    NoHeight,
}

/// What percentages refer to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum HeightAxis {
    /// The extent along x.
    X,
    /// The extent along y: the height of meshes whose up axis is y.
    #[default]
    Y,
    /// The extent along z.
    Z,
    /// The greatest of the three extents.
    Largest,
}

/// Compares joints of equal names.
///
/// # Errors
/// See [`JointErrorError`].
pub fn joint_errors(
    estimate: &Skeleton,
    truth: &Skeleton,
    mesh: &TriMesh,
    axis: HeightAxis,
) -> Result<JointErrors, JointErrorError> {
    let height = height(mesh, axis);
    if !(height > 0.0) {
        return Err(JointErrorError::NoHeight);
    }
    let mut errors = JointErrors {
        names: Vec::new(),
        distances: Vec::new(),
        height,
        only_estimate: Vec::new(),
        only_truth: truth
            .names()
            .iter()
            .filter(|it| estimate.joint(it).is_none())
            .cloned()
            .collect(),
    };
    for (name, position) in estimate.names().iter().zip(estimate.positions()) {
        match truth.joint(name) {
            Some(joint) => {
                errors.names.push(name.clone());
                errors.distances.push((position - truth.positions()[joint]).norm());
            }
            None => errors.only_estimate.push(name.clone()),
        }
    }
    if errors.names.is_empty() {
        return Err(JointErrorError::NothingShared {
            estimate: estimate.names()[0].clone(),
            n_estimate: estimate.n_joints(),
            truth: truth.names()[0].clone(),
            n_truth: truth.n_joints(),
        });
    }
    Ok(errors)
}

/// The extent that percentages refer to, in mesh units.
pub fn height(mesh: &TriMesh, axis: HeightAxis) -> f64 {
    let (low, high) = mesh.bounds();
    let extent: Vec3 = high - low;
    match axis {
        HeightAxis::X => extent.x,
        HeightAxis::Y => extent.y,
        HeightAxis::Z => extent.z,
        HeightAxis::Largest => extent.max(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes::rectangle;

    fn skeleton(joints: &[(&str, f64)]) -> Skeleton {
        let names = joints.iter().map(|it| it.0.to_owned()).collect();
        let positions = joints.iter().map(|it| Vec3::new(it.1, 0.0, 0.0)).collect();
        Skeleton::new(names, vec![None; joints.len()], positions).unwrap()
    }

    #[test]
    fn joints_are_matched_by_name() {
        let mesh = rectangle(1, 1, 1.0, 2.0);
        let estimate = skeleton(&[("a", 0.0), ("extra", 5.0), ("b", 1.0)]);
        let truth = skeleton(&[("b", 1.4), ("missing", 0.0), ("a", 0.2)]);
        let errors = joint_errors(&estimate, &truth, &mesh, HeightAxis::Y).unwrap();
        assert_eq!(errors.names, ["a", "b"]);
        assert!((errors.mean() - 0.3).abs() < 1e-15);
        assert!((errors.greatest() - 0.4).abs() < 1e-15 && (errors.least() - 0.2).abs() < 1e-15);
        assert!((errors.mean_squared() - 0.1).abs() < 1e-15);
        assert!((errors.percent(errors.mean()) - 15.0).abs() < 1e-12);
        assert_eq!((&errors.only_estimate[0][..], &errors.only_truth[0][..]), ("extra", "missing"));
    }

    #[test]
    fn strangers_cannot_be_compared() {
        let mesh = rectangle(1, 1, 1.0, 2.0);
        let error =
            joint_errors(&skeleton(&[("a", 0.0)]), &skeleton(&[("b", 0.0)]), &mesh, HeightAxis::Y)
                .unwrap_err();
        assert_eq!(
            error.to_string(),
            "the skeletons share no joint: the estimate has `a` and 1 joints, \
             the truth `b` and 1 joints"
        );
        let (a, flat) = (skeleton(&[("a", 0.0)]), HeightAxis::Z);
        assert_eq!(joint_errors(&a, &a, &mesh, flat), Err(JointErrorError::NoHeight));
    }
}
