//! Circles through points in a plane.

use nalgebra::{Matrix2, Vector2};

/// A circle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Circle {
    pub center: Vector2<f64>,
    pub radius: f64,
}

/// Steps of Gauss and Newton.
const STEPS: usize = 5;

/// Fits a circle to points by least squares of their distances from it (Gander, Golub & Strebel 1994),
/// beginning at the origin, at which the center is held as if by `hold` points: an arc that is nearly
/// straight tells no center.
///
/// None if there are no points, or all of them are at one place.
pub fn fit_circle(points: &[Vector2<f64>], hold: f64) -> Option<Circle> {
    let count = points.len() as f64;
    let mut circle = Circle { center: Vector2::zeros(), radius: 0.0 };
    for _ in 0..STEPS {
        let arms: Vec<Vector2<f64>> = points.iter().map(|it| it - circle.center).collect();
        circle.radius = arms.iter().map(|it| it.norm()).sum::<f64>() / count;
        let units: Vec<Vector2<f64>> =
            arms.iter().map(|it| it.try_normalize(0.0).unwrap_or_default()).collect();
        // The best radius goes along with the center, by the mean of the directions.
        let mean = units.iter().sum::<Vector2<f64>>() / count;
        let mut matrix = Matrix2::from_diagonal_element(hold);
        let mut right = -circle.center * hold;
        for (arm, unit) in arms.iter().zip(&units) {
            let row = unit - mean;
            matrix += row * row.transpose();
            right += row * (arm.norm() - circle.radius);
        }
        circle.center += matrix.try_inverse()? * right;
    }
    (circle.radius > 0.0).then_some(circle)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points of a circle of radius 1 around (0.3, -0.2), between two angles, times a scale.
    fn arc(from: f64, to: f64, scale: f64) -> Vec<Vector2<f64>> {
        let angles = (0..12).map(|it| from + (to - from) * f64::from(it) / 11.0);
        angles.map(|it| Vector2::new(0.3 + it.cos(), it.sin() - 0.2) * scale).collect()
    }

    #[test]
    fn half_a_circle_has_its_center_at_every_scale() {
        for scale in [1.0, 1e8, 1e-8] {
            let circle = fit_circle(&arc(0.2, 3.3, scale), 1e-9).unwrap();
            assert!((circle.center / scale - Vector2::new(0.3, -0.2)).norm() < 1e-3, "{circle:?}");
            assert!((circle.radius / scale - 1.0).abs() < 1e-3, "{circle:?}");
        }
    }

    #[test]
    fn a_held_center_goes_part_of_the_way_and_a_line_moves_it_little() {
        let held = fit_circle(&arc(0.2, 3.3, 1.0), 0.5).unwrap().center;
        let way = held.dot(&Vector2::new(0.3, -0.2)) / 0.13;
        assert!((0.3..0.99).contains(&way), "{way}");
        let line: Vec<Vector2<f64>> =
            (0..9).map(|it| Vector2::new(f64::from(it) * 0.01 - 0.04, 1.0)).collect();
        assert!(fit_circle(&line, 0.5).unwrap().center.norm() < 0.01);
    }

    #[test]
    fn no_points_have_no_circle() {
        assert_eq!(fit_circle(&[], 0.5), None);
        assert_eq!(fit_circle(&[Vector2::zeros(); 5], 0.5), None);
    }
}
