//! Curve skeletons as things to draw: thin tubes with balls at leaves and junctions.

use std::f64::consts::TAU;

use crate::kernels::curve_skeletons::curve_skeleton::CurveSkeleton;
use crate::kernels::geometry::mesh::Vec3;

use super::bones::{Role, add_ball};
use super::raster::Soup;

/// Sides of a tube.
const SIDES: usize = 10;

/// Adds a curve skeleton. `size` is the figure's extent, from which the thickness follows.
pub fn add_curves(soup: &mut Soup, curves: &CurveSkeleton, size: f64) {
    let radius = 0.0028 * size;
    let positions = curves.positions();
    for edge in curves.edges() {
        let [from, to] = edge.map(|it| positions[it as usize]);
        add_tube(soup, from, to, radius);
    }
    for (&position, degree) in positions.iter().zip(curves.degrees()) {
        match degree {
            2 => add_ball(soup, position, 1.15 * radius, Role::Own.bone_color()),
            _ => add_ball(soup, position, 2.4 * radius, Role::Own.joint_color()),
        }
    }
}

fn add_tube(soup: &mut Soup, from: Vec3, to: Vec3, radius: f64) {
    let Some(direction) = (to - from).try_normalize(0.0) else {
        return;
    };
    // Any axis that is not along the tube gives a frame around it; of the three, the farthest.
    let side = direction.cross(&Vec3::ith(direction.iamin(), 1.0)).normalize();
    let other = direction.cross(&side);
    let first = soup.points.len() as u32;
    for step in 0..SIDES {
        let (sin, cos) = (TAU * step as f64 / SIDES as f64).sin_cos();
        let normal = side * cos + other * sin;
        for end in [from, to] {
            soup.push(end + normal * radius, normal, Role::Own.bone_color());
        }
    }
    let corner = |step: usize, end: u32| first + 2 * (step % SIDES) as u32 + end;
    for step in 0..SIDES {
        let [a, b] = [corner(step, 0), corner(step + 1, 0)];
        let [c, d] = [corner(step + 1, 1), corner(step, 1)];
        soup.triangles.extend([[a, b, c], [a, c, d]]);
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Figure, SnapshotOptions, snapshot};
    use super::*;
    use crate::kernels::geometry::shapes::icosphere;

    #[test]
    fn a_curve_shines_through_its_body() {
        let sphere = icosphere(3);
        let positions = vec![-Vec3::y() * 0.8, Vec3::zeros(), Vec3::y() * 0.8];
        let curves =
            CurveSkeleton::new(positions, vec![0.1; 3], vec![[0, 1], [1, 2]], vec![]).unwrap();
        let options = SnapshotOptions { width: 200, height: 200, ..Default::default() };
        let mut figure = Figure::new(&sphere);
        figure.curves = Some(&curves);
        let image = snapshot(&[figure], &options).unwrap();
        let light = |row: usize, column: usize| {
            image.pixels[row * 200 + column].map(i32::from).iter().sum::<i32>()
        };
        for row in [60, 80, 120, 140] {
            assert!(light(row, 100) + 60 < light(row, 80), "a dark line runs down the middle");
        }
    }
}
