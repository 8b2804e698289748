//! How far estimated landmarks are from the true ones, and whether left and right are swapped.

use crate::kernels::geometry::landmarks::Landmarks;
use crate::kernels::geometry::mesh::TriMesh;
use crate::kernels::rigs::joint_error::{HeightAxis, height};

/// Distances of the landmarks that two lists share.
#[derive(Debug, Clone, PartialEq)]
pub struct LandmarkErrors {
    /// The common landmarks, in the estimate's order.
    pub names: Vec<String>,
    /// Euclidean distances, in mesh units.
    pub distances: Vec<f64>,
    /// Whether a landmark is nearer to the true place of its counterpart than to its own.
    pub is_swapped: Vec<bool>,
    /// What distances are divided by for percentages.
    pub height: f64,
    /// Landmarks that only one of the lists has.
    pub unmatched: Vec<String>,
}

/// Why landmarks cannot be compared.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LandmarkErrorError {
    #[error(
        "the estimate and the truth share no landmark: the estimate has {estimate}, the truth {truth}"
    )]
    NothingShared { estimate: String, truth: String },
    #[error("landmark `{name}` is vertex {vertex}, but the mesh has {n_vertices} vertices")]
    OutOfRange { name: String, vertex: u32, n_vertices: usize },
    #[error("the mesh has no extent along the chosen axis")]
    NoHeight,
}

/// Words that turn a landmark's name into that of its counterpart.
const OPPOSITES: [(&str, &str); 2] = [("left", "right"), ("front", "back")];

/// Compares landmarks of equal names.
///
/// # Errors
/// See [`LandmarkErrorError`].
pub fn landmark_errors(
    estimate: &Landmarks,
    truth: &Landmarks,
    mesh: &TriMesh,
    axis: HeightAxis,
) -> Result<LandmarkErrors, LandmarkErrorError> {
    let n_vertices = mesh.n_vertices();
    for (name, &vertex) in
        [estimate, truth].into_iter().flat_map(|it| it.names.iter().zip(&it.vertices))
    {
        if vertex as usize >= n_vertices {
            let name = name.clone();
            return Err(LandmarkErrorError::OutOfRange { name, vertex, n_vertices });
        }
    }
    let height = height(mesh, axis);
    if !(height > 0.0) {
        return Err(LandmarkErrorError::NoHeight);
    }
    let find = |name: &str| {
        let place = truth.names.iter().position(|it| it == name)?;
        Some(mesh.vertices()[truth.vertices[place] as usize])
    };
    let only_truth = truth.names.iter().filter(|it| !estimate.names.contains(it)).cloned();
    let mut errors = LandmarkErrors {
        names: Vec::new(),
        distances: Vec::new(),
        is_swapped: Vec::new(),
        height,
        unmatched: only_truth.collect(),
    };
    for (name, &vertex) in estimate.names.iter().zip(&estimate.vertices) {
        let Some(true_place) = find(name) else {
            errors.unmatched.push(name.clone());
            continue;
        };
        let place = mesh.vertices()[vertex as usize];
        let distance = (place - true_place).norm();
        let other = counterpart(name).and_then(|it| find(&it));
        errors.names.push(name.clone());
        errors.distances.push(distance);
        errors.is_swapped.push(other.is_some_and(|it| (place - it).norm() < distance));
    }
    if errors.names.is_empty() {
        let list = |it: &Landmarks| it.names.join(", ");
        let (estimate, truth) = (list(estimate), list(truth));
        return Err(LandmarkErrorError::NothingShared { estimate, truth });
    }
    Ok(errors)
}

fn counterpart(name: &str) -> Option<String> {
    let pairs = OPPOSITES.iter().flat_map(|&(a, b)| [(a, b), (b, a)]);
    pairs.into_iter().find(|it| name.contains(it.0)).map(|(from, to)| name.replace(from, to))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes::rectangle;

    fn landmarks(pairs: &[(&str, u32)]) -> Landmarks {
        let (names, vertices) = pairs.iter().map(|it| (it.0.to_owned(), it.1)).unzip();
        Landmarks { names, vertices }
    }

    #[test]
    fn distances_and_swaps() {
        let mesh = rectangle(4, 1, 4.0, 1.0);
        let at =
            |x: f64| mesh.vertices().iter().position(|it| it.x == x && it.y == 0.0).unwrap() as u32;
        let truth = landmarks(&[("hand_left", at(0.0)), ("hand_right", at(4.0)), ("top", at(2.0))]);
        let found = [("hand_right", at(1.0)), ("hand_left", at(1.0)), ("nose", at(3.0))];
        let errors =
            landmark_errors(&landmarks(&found), &truth, &mesh, HeightAxis::Largest).unwrap();
        assert_eq!(errors.names, ["hand_right", "hand_left"]);
        assert_eq!(errors.distances, [3.0, 1.0]);
        assert_eq!(errors.is_swapped, [true, false]);
        assert_eq!((errors.height, errors.unmatched.join(" ")), (4.0, "top nose".to_owned()));
    }

    #[test]
    fn mistakes_are_named() {
        let mesh = rectangle(1, 1, 1.0, 1.0);
        let check = |estimate: &[(&str, u32)], truth: &[(&str, u32)], expected: &str| {
            let (estimate, truth) = (landmarks(estimate), landmarks(truth));
            let error = landmark_errors(&estimate, &truth, &mesh, HeightAxis::Y).unwrap_err();
            assert_eq!(error.to_string(), expected);
        };
        check(&[("a", 9)], &[], "landmark `a` is vertex 9, but the mesh has 4 vertices");
        check(
            &[("a", 0)],
            &[("b", 0), ("c", 1)],
            "the estimate and the truth share no landmark: the estimate has a, the truth b, c",
        );
    }
}
