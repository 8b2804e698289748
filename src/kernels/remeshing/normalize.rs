//! Bringing meshes to a common place and size.

use serde::{Deserialize, Serialize};

use crate::kernels::geometry::mesh::{TriMesh, Vec3};

/// What becomes one.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, schemars::JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum UnitSize {
    /// The total area.
    #[default]
    Area,
    /// The extent along y.
    Height,
    /// The largest extent of the bounding box.
    Box,
    /// Nothing: the size stays.
    Keep,
}

/// A uniform scale and a shift: `normalized = scale * original + offset`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Similarity {
    pub scale: f64,
    pub offset: Vec3,
}

impl Similarity {
    pub fn apply(&self, point: &Vec3) -> Vec3 {
        point * self.scale + self.offset
    }
}

/// Why a mesh cannot be normalized.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NormalizeError {
    #[error("the mesh has no area: all {n_faces} faces are points or lines")]
    NoArea { n_faces: usize },
    #[error("a point cloud has no area to become one; its height or its box can")]
    CloudArea,
    #[error("the mesh has no {what}")]
    NoExtent { what: &'static str },
}

/// Moves the centroid of the area to the origin and scales the mesh to a unit size. A point cloud's
/// centroid is that of its points.
///
/// # Errors
/// If the mesh has no area or no extent to scale by.
pub fn normalize(mesh: &TriMesh, unit: UnitSize) -> Result<(TriMesh, Similarity), NormalizeError> {
    let area = mesh.area();
    if mesh.is_point_cloud() && unit == UnitSize::Area {
        return Err(NormalizeError::CloudArea);
    }
    if !(area > 0.0 || mesh.is_point_cloud()) {
        return Err(NormalizeError::NoArea { n_faces: mesh.n_faces() });
    }
    let (low, high) = mesh.bounds();
    let (size, what) = match unit {
        UnitSize::Area => (area.sqrt(), "area"),
        UnitSize::Height => (high.y - low.y, "height"),
        UnitSize::Box => ((high - low).max(), "extent"),
        UnitSize::Keep => (1.0, "size"),
    };
    if !(size > 0.0) {
        return Err(NormalizeError::NoExtent { what });
    }
    let scale = 1.0 / size;
    let similarity = Similarity { scale, offset: -centroid(mesh, area) * scale };
    let vertices = mesh.vertices().iter().map(|it| similarity.apply(it)).collect();
    let normalized = mesh.with_vertices(vertices).map_err(|_| NormalizeError::NoExtent { what })?;
    Ok((normalized, similarity))
}

/// The mean position over the surface, or of the points.
fn centroid(mesh: &TriMesh, area: f64) -> Vec3 {
    if mesh.is_point_cloud() {
        return mesh.vertices().iter().sum::<Vec3>() / mesh.n_vertices() as f64;
    }
    let sum: Vec3 = (0..mesh.n_faces())
        .map(|face| {
            let [a, b, c] = mesh.corners(face);
            (a + b + c) / 3.0 * mesh.area_vector(face).norm()
        })
        .sum();
    sum / area
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes::{icosphere, moved, rectangle, torus};

    #[test]
    fn size_and_place_are_the_unit_ones_at_three_scales() {
        for scale in [1e-8, 1.0, 1e8] {
            for mesh in [icosphere(2), torus(2.0, 0.5, 16, 8), rectangle(3, 3, 1.0, 1.0)] {
                let away = moved(&mesh, Vec3::new(3.0, -1.0, 2.0));
                let vertices = away.vertices().iter().map(|it| it * scale).collect();
                let away = away.with_vertices(vertices).unwrap();
                let (unit, similarity) = normalize(&away, UnitSize::Area).unwrap();
                assert!((unit.area() - 1.0).abs() < 1e-9);
                assert!(centroid(&unit, 1.0).norm() < 1e-9);
                assert_eq!(similarity.apply(&away.vertices()[1]), unit.vertices()[1]);
                let (unit, _) = normalize(&away, UnitSize::Height).unwrap();
                let (low, high) = unit.bounds();
                assert!((high.y - low.y - 1.0).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn a_cloud_has_a_height_but_no_area() {
        let cloud = TriMesh::from_points(icosphere(2).vertices().to_vec()).unwrap();
        let (unit, _) = normalize(&cloud, UnitSize::Height).unwrap();
        let (low, high) = unit.bounds();
        assert!((high.y - low.y - 1.0).abs() < 1e-12 && (high.y + low.y).abs() < 1e-12);
        assert_eq!(normalize(&cloud, UnitSize::Area), Err(NormalizeError::CloudArea));
    }

    #[test]
    fn a_mesh_without_area_is_refused() {
        let line = vec![Vec3::zeros(), Vec3::x(), Vec3::x() * 2.0];
        let mesh = TriMesh::new(line, vec![[0, 1, 2]]).unwrap();
        assert_eq!(normalize(&mesh, UnitSize::Area), Err(NormalizeError::NoArea { n_faces: 1 }));
    }
}
