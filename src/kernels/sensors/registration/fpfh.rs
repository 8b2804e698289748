//! Fast point feature histograms (Rusu, Blodow & Beetz 2009).

use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::geometry::point_tree::PointTree;

/// Three histograms of 11 bins, one row a point.
pub type Features = Vec<[f64; 33]>;

const BINS: usize = 11;

/// Describes oriented points by the angles between their normals within a radius.
pub fn describe(points: &[Vec3], normals: &[Vec3], radius: f64) -> Features {
    let tree = PointTree::new(points);
    let neighbours: Vec<Vec<(f64, u32)>> = points
        .iter()
        .map(|point| {
            let mut found = Vec::new();
            tree.within(*point, radius, &mut found);
            found.retain(|it| it.0 > 0.0);
            found
        })
        .collect();
    let simple: Features = (0..points.len())
        .map(|own| {
            let mut histogram = [0.0; 3 * BINS];
            let share = 1.0 / neighbours[own].len().max(1) as f64;
            for &(_, other) in &neighbours[own] {
                let other = other as usize;
                let pair = [(points[own], normals[own]), (points[other], normals[other])];
                for (angle, value) in angles(pair).into_iter().enumerate() {
                    let bin = ((value * BINS as f64) as usize).min(BINS - 1);
                    histogram[angle * BINS + bin] += share;
                }
            }
            histogram
        })
        .collect();
    (0..points.len())
        .map(|own| {
            let mut sum = simple[own];
            let n = neighbours[own].len().max(1) as f64;
            for &(square, other) in &neighbours[own] {
                // Nearer neighbours count more, without a unit.
                let weight = (1.0 - square.sqrt() / radius).max(0.0) / n;
                let theirs = &simple[other as usize];
                sum.iter_mut().zip(theirs).for_each(|(sum, it)| *sum += weight * it);
            }
            sum
        })
        .collect()
}

/// The three angles of a pair in Darboux's frame, each brought to `[0, 1]`.
fn angles([(p, u), (q, n)]: [(Vec3, Vec3); 2]) -> [f64; 3] {
    let line = (q - p).normalize();
    let v = line.cross(&u).try_normalize(1e-12).unwrap_or_default();
    let w = u.cross(&v);
    let theta = w.dot(&n).atan2(u.dot(&n)) / std::f64::consts::TAU + 0.5;
    [v.dot(&n) / 2.0 + 0.5, u.dot(&line) / 2.0 + 0.5, theta].map(|it| it.clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;

    use super::*;
    use crate::kernels::geometry::shapes;

    #[test]
    fn a_rigid_motion_changes_nothing() {
        let mesh = shapes::bumpy_sphere(8);
        let normals = mesh.vertex_normals();
        let before = describe(mesh.vertices(), &normals, 0.4);
        let rotation = Rotation3::new(Vec3::new(0.4, 1.0, -0.3));
        let moved: Vec<Vec3> = mesh.vertices().iter().map(|it| rotation * it + Vec3::x()).collect();
        let turned: Vec<Vec3> = normals.iter().map(|it| rotation * it).collect();
        let after = describe(&moved, &turned, 0.4);
        // A value on the border of two bins may change sides, so most and not all are equal.
        let is_same =
            |(a, b): &(&[f64; 33], &[f64; 33])| a.iter().zip(*b).all(|(a, b)| (a - b).abs() < 1e-9);
        let n_same = before.iter().zip(&after).filter(|it| is_same(it)).count();
        assert!(n_same * 10 > before.len() * 9, "{n_same} of {}", before.len());
        assert!(before.iter().any(|it| (it[0] - before[0][0]).abs() > 1e-3));
    }
}
