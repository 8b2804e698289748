//! Points of triangles.

use super::mesh::Vec3;

/// Barycentric coordinates of the point of a triangle that is closest to another (Ericson 2005, 5.1.5).
pub fn closest_on_triangle(point: &Vec3, &[a, b, c]: &[Vec3; 3]) -> [f64; 3] {
    let (ab, ac) = (b - a, c - a);
    let from = |corner: Vec3| {
        let offset = point - corner;
        (ab.dot(&offset), ac.dot(&offset))
    };
    let (d1, d2) = from(a);
    if d1 <= 0.0 && d2 <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    let (d3, d4) = from(b);
    if d3 >= 0.0 && d4 <= d3 {
        return [0.0, 1.0, 0.0];
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let t = d1 / (d1 - d3);
        return [1.0 - t, t, 0.0];
    }
    let (d5, d6) = from(c);
    if d6 >= 0.0 && d5 <= d6 {
        return [0.0, 0.0, 1.0];
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let t = d2 / (d2 - d6);
        return [1.0 - t, 0.0, t];
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        let t = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return [0.0, 1.0 - t, t];
    }
    let sum = va + vb + vc;
    [1.0 - vb / sum - vc / sum, vb / sum, vc / sum]
}
