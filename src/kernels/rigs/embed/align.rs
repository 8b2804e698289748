//! How the skeleton has to be turned to stand like the target, and which of its joints mirror others.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion};

use super::reduced::Working;
use crate::kernels::geometry::mesh::Vec3;

/// The 24 rotations that turn axes into axes; the identity is the first.
pub fn axis_rotations() -> Vec<UnitQuaternion<f64>> {
    let axes = [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]];
    let mut res = Vec::with_capacity(24);
    for axes in axes {
        for signs in 0..8 {
            let mut matrix = Matrix3::zeros();
            for (row, &column) in axes.iter().enumerate() {
                matrix[(row, column)] = if signs & (1 << row) == 0 { 1.0 } else { -1.0 };
            }
            if matrix.determinant() > 0.0 {
                let rotation = Rotation3::from_matrix_unchecked(matrix);
                res.push(UnitQuaternion::from_rotation_matrix(&rotation));
            }
        }
    }
    res
}

/// Joints are mirror images up to this distance, where bodies are 0.9 large.
const MIRROR_ERROR: f64 = 0.03;

/// For every joint the one that mirrors it in the plane through the root, across the axis that gives
/// most pairs; joints in the plane have none. Only joints whose parents are mirror images too count.
pub fn mirror_images(working: &Working) -> Vec<Option<usize>> {
    let across = |axis: usize| -> Vec<Option<usize>> {
        let root = working.positions[0][axis];
        let image = |joint: usize| {
            let mut place = working.positions[joint];
            place[axis] = 2.0 * root - place[axis];
            let distance = |it: &usize| (working.positions[*it] - place).norm();
            let near = (0..working.n()).min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
            (distance(&near) <= MIRROR_ERROR).then_some(near)
        };
        let images: Vec<Option<usize>> = (0..working.n()).map(image).collect();
        let parent_image = |joint: usize| working.parents[joint].and_then(|it| images[it]);
        (0..working.n())
            .map(|joint| {
                let other = images[joint].filter(|&it| it != joint && images[it] == Some(joint))?;
                let parents_mirror = parent_image(joint) == working.parents[other];
                parents_mirror.then_some(other)
            })
            .collect()
    };
    let count = |images: &[Option<usize>]| images.iter().flatten().count();
    let mut best = across(0);
    for axis in [1, 2] {
        let images = across(axis);
        if count(&images) > count(&best) {
            best = images;
        }
    }
    best
}

/// Least and greatest coordinates, and the largest extent.
pub fn extent(points: &[Vec3]) -> (Vec3, Vec3, f64) {
    let first = points[0];
    let (low, high) = points.iter().fold((first, first), |(l, h), it| (l.inf(it), h.sup(it)));
    (low, high, (high - low).max())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_are_24_different_rotations() {
        let rotations = axis_rotations();
        assert_eq!(rotations.len(), 24);
        assert!(rotations[0].angle() < 1e-12);
        for (index, a) in rotations.iter().enumerate() {
            assert!(rotations[..index].iter().all(|b| a.angle_to(b) > 0.1));
        }
    }

    #[test]
    fn arms_mirror_each_other() {
        let parents = [None, Some(0), Some(1), Some(1), Some(2), Some(3)];
        let places = [(0.0, 0.0), (0.0, 0.4), (0.2, 0.4), (-0.2, 0.41), (0.4, 0.4), (-0.4, 0.4)];
        let positions: Vec<Vec3> = places.iter().map(|it| Vec3::new(it.0, it.1, 0.0)).collect();
        let (working, _) = Working::new(&parents, &positions);
        assert_eq!(mirror_images(&working), [None, None, Some(3), Some(2), Some(5), Some(4)]);
    }
}
