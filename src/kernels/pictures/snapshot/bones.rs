//! Skeletons as things to draw: octahedra for bones, balls for joints.

use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::geometry::shapes::icosphere;
use crate::kernels::pictures::canvas::color::mix;
use crate::kernels::rigs::skeleton::Skeleton;

use super::colors::Color;
use super::raster::Soup;

/// What a skeleton stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// A result or an input.
    Own,
    /// The truth, drawn thinner beside it.
    Truth,
}

impl Role {
    pub(super) fn bone_color(self) -> Color {
        match self {
            Self::Own => [0.030, 0.065, 0.235],
            Self::Truth => [0.030, 0.480, 0.170],
        }
    }

    pub(super) fn joint_color(self) -> Color {
        match self {
            Self::Own => [0.880, 0.195, 0.045],
            Self::Truth => [0.180, 0.800, 0.300],
        }
    }

    fn thickness(self) -> f64 {
        match self {
            Self::Own => 1.0,
            Self::Truth => 0.4,
        }
    }
}

/// Adds a skeleton. `size` is the figure's extent, from which the thickness of bones follows.
pub fn add_skeleton(soup: &mut Soup, skeleton: &Skeleton, role: Role, size: f64) {
    let positions = skeleton.positions();
    for (parent, child) in skeleton.bones() {
        add_bone(soup, positions[parent], positions[child], role, size);
    }
    let radius = 0.0078 * size * role.thickness();
    for &joint in positions {
        add_ball(soup, joint, radius, role.joint_color());
    }
}

/// Adds a ball.
pub fn add_ball(soup: &mut Soup, centre: Vec3, radius: f64, color: Color) {
    let ball = icosphere(2);
    let first = soup.points.len() as u32;
    for normal in ball.vertices() {
        soup.push(centre + normal * radius, *normal, color);
    }
    soup.triangles.extend(ball.faces().iter().map(|face| face.map(|it| it + first)));
}

/// An octahedron that is thickest near the parent.
fn add_bone(soup: &mut Soup, from: Vec3, to: Vec3, role: Role, size: f64) {
    let along = to - from;
    let length = along.norm();
    if length <= 1e-6 * size {
        return;
    }
    let radius = (0.11 * length).clamp(0.0045 * size, 0.0125 * size) * role.thickness();
    let direction = along / length;
    // Any axis that is not along the bone gives a frame around it; of the three, the farthest.
    let axis = Vec3::ith(direction.iamin(), 1.0);
    let side = direction.cross(&axis).normalize();
    let other = direction.cross(&side);
    let waist = from + along * 0.16_f64.min(1.5 * radius / length);
    let diagonal = std::f64::consts::FRAC_1_SQRT_2;
    let ring = [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)]
        .map(|(u, v)| waist + (side * u + other * v) * (radius * diagonal * 1.2));
    let color = role.bone_color();
    for corner in 0..4 {
        let (a, b) = (ring[corner], ring[(corner + 1) % 4]);
        for tip in [from, to] {
            let corners = if tip == from { [b, a, tip] } else { [a, b, tip] };
            let normal = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
            let first = soup.points.len() as u32;
            for point in corners {
                let shade = if point == to { mix(color, [1.0; 3], 0.06) } else { color };
                soup.push(point, normal.try_normalize(0.0).unwrap_or(direction), shade);
            }
            soup.triangles.push([first, first + 1, first + 2]);
        }
    }
}
