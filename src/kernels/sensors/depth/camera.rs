//! Where a camera stands.

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion};

use crate::kernels::geometry::mesh::Vec3;

/// A camera that looks at a place from a distance; the world has +y up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Orbit {
    /// Metres to the place it looks at.
    pub distance: f64,
    /// 0 is in front of a figure that looks along +z, 90 at its left (+x).
    pub azimuth_deg: f64,
    /// Above the horizon; less than 90 either way.
    pub elevation_deg: f64,
}

impl Orbit {
    /// The camera's frame: `x_camera = camera_from_world * x_world`, x right, y down, z forward.
    pub fn camera_from_world(&self, place: &Vec3) -> Isometry3<f64> {
        let (azimuth, elevation) = (self.azimuth_deg.to_radians(), self.elevation_deg.to_radians());
        let away = Vec3::new(
            elevation.cos() * azimuth.sin(),
            elevation.sin(),
            elevation.cos() * azimuth.cos(),
        );
        let forward = -away;
        let right = forward.cross(&Vec3::y()).normalize();
        let down = forward.cross(&right);
        let rows = Matrix3::from_rows(&[right.transpose(), down.transpose(), forward.transpose()]);
        let rotation =
            UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rows));
        let centre = place + away * self.distance;
        Isometry3::from_parts(Translation3::from(-(rotation * centre)), rotation)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;

    #[test]
    fn the_place_is_ahead_and_up_is_up() {
        let place = Vec3::new(1.0, 2.0, 3.0);
        for (azimuth_deg, elevation_deg) in [(0.0, 0.0), (30.0, 15.0), (-140.0, -60.0)] {
            let orbit = Orbit { distance: 2.5, azimuth_deg, elevation_deg };
            let frame = orbit.camera_from_world(&place);
            let seen = frame * Point3::from(place);
            assert!((seen.coords - Vec3::z() * 2.5).norm() < 1e-12);
            assert!((frame * Vec3::y()).y < 0.0);
        }
        // From the front, a figure's left (+x) is at the right of the picture.
        let front = Orbit { distance: 2.0, azimuth_deg: 0.0, elevation_deg: 0.0 };
        let seen = front.camera_from_world(&Vec3::zeros()) * Vec3::x();
        assert!((seen - Vec3::x()).norm() < 1e-12);
    }
}
