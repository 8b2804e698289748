//! Matches of vertices with places inside of faces, in the space of eigenfunctions.

use faer::MatRef;
use rayon::prelude::*;

use crate::kernels::maps::nearest::nearest_rows;

/// A place on a mesh: up to three vertices and shares that sum to one.
pub type Place = [(u32, f64); 3];

/// For every query the nearest place on the faces around the nearest point.
///
/// Points and queries have as many coordinates as there are eigenfunctions. The faces tried are those at
/// the nearest point (Ezuz & Ben-Chen 2017 try all faces nearby; the rest changes little). Without
/// faces, the place is the nearest point itself.
pub fn nearest_places(
    queries: MatRef<'_, f64>,
    points: MatRef<'_, f64>,
    faces: &[[u32; 3]],
) -> Vec<Place> {
    let nearest = nearest_rows(queries, points);
    let around = faces_at(faces, points.nrows());
    let place = |query: usize| {
        let vertex = nearest[query];
        let distance = |of: &Place| distance_squared(queries, points, query, of);
        let mut best = [(vertex, 1.0), (vertex, 0.0), (vertex, 0.0)];
        let mut least = distance(&best);
        for &face in &around[vertex as usize] {
            let corners = faces[face as usize];
            let place = nearest_in_face(queries, points, query, corners);
            let gap = distance(&place);
            if gap < least {
                (best, least) = (place, gap);
            }
        }
        best
    };
    (0..queries.nrows()).into_par_iter().map(place).collect()
}

fn faces_at(faces: &[[u32; 3]], n_vertices: usize) -> Vec<Vec<u32>> {
    let mut around = vec![Vec::new(); n_vertices];
    for (face, corners) in faces.iter().enumerate() {
        corners.iter().for_each(|&it| around[it as usize].push(face as u32));
    }
    around
}

fn distance_squared(
    queries: MatRef<'_, f64>,
    points: MatRef<'_, f64>,
    query: usize,
    place: &Place,
) -> f64 {
    (0..queries.ncols())
        .map(|axis| {
            let at: f64 = place.iter().map(|it| it.1 * points[(it.0 as usize, axis)]).sum();
            (queries[(query, axis)] - at).powi(2)
        })
        .sum()
}

/// The nearest place of a face: inside, or on the nearest of its sides.
fn nearest_in_face(
    queries: MatRef<'_, f64>,
    points: MatRef<'_, f64>,
    query: usize,
    corners: [u32; 3],
) -> Place {
    let [a, b, c] = corners.map(|it| it as usize);
    let (mut uu, mut uv, mut vv, mut uq, mut vq) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for axis in 0..queries.ncols() {
        let origin = points[(a, axis)];
        let (u, v) = (points[(b, axis)] - origin, points[(c, axis)] - origin);
        let q = queries[(query, axis)] - origin;
        uu += u * u;
        uv += u * v;
        vv += v * v;
        uq += u * q;
        vq += v * q;
    }
    let [s, t] = nearest_in_triangle([uu, uv, vv], [uq, vq]);
    [(corners[0], 1.0 - s - t), (corners[1], s), (corners[2], t)]
}

/// Minimizes `|s u + t v - q|^2` over `s, t >= 0`, `s + t <= 1`, from inner products.
fn nearest_in_triangle([uu, uv, vv]: [f64; 3], [uq, vq]: [f64; 2]) -> [f64; 2] {
    let determinant = uu * vv - uv * uv;
    if determinant > 1e-12 * uu * vv {
        let s = (vv * uq - uv * vq) / determinant;
        let t = (uu * vq - uv * uq) / determinant;
        if s >= 0.0 && t >= 0.0 && s + t <= 1.0 {
            return [s, t];
        }
    }
    let along =
        |dot: f64, square: f64| if square > 0.0 { (dot / square).clamp(0.0, 1.0) } else { 0.0 };
    let opposite = along(vq - uq - uv + uu, uu - 2.0 * uv + vv);
    let sides = [[along(uq, uu), 0.0], [0.0, along(vq, vv)], [1.0 - opposite, opposite]];
    let value =
        |&[s, t]: &[f64; 2]| s * s * uu + 2.0 * s * t * uv + t * t * vv - 2.0 * (s * uq + t * vq);
    let mut best = sides[0];
    for side in &sides[1..] {
        if value(side) < value(&best) {
            best = *side;
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use faer::Mat;

    use super::*;
    use crate::kernels::geometry::shapes::rectangle;
    use crate::kernels::numerics::random::Random;

    #[test]
    fn places_inside_of_faces_are_found() {
        let mesh = rectangle(4, 4, 1.0, 1.0);
        let points = Mat::from_fn(25, 3, |row, axis| mesh.vertices()[row][axis]);
        let mut random = Random::new(3);
        let queries = Mat::from_fn(40, 3, |_, axis| if axis < 2 { random.uniform() } else { 0.1 });
        let places = nearest_places(queries.as_ref(), points.as_ref(), mesh.faces());
        for (query, place) in places.iter().enumerate() {
            let at = |axis: usize| -> f64 {
                place.iter().map(|it| it.1 * points[(it.0 as usize, axis)]).sum()
            };
            assert!(place.iter().all(|it| it.1 >= -1e-15));
            assert!((at(0) - queries[(query, 0)]).abs() < 1e-12);
            assert!((at(1) - queries[(query, 1)]).abs() < 1e-12);
        }
        let corners = nearest_places(queries.as_ref(), points.as_ref(), &[]);
        assert!(corners.iter().all(|it| it[0].1 == 1.0));
    }

    #[test]
    fn outside_the_nearest_side_counts() {
        // A right triangle of unit legs, seen from outside of each side.
        for (q, expected) in [
            ([-1.0, -1.0], [0.0, 0.0]),
            ([2.0, 0.0], [1.0, 0.0]),
            ([0.5, -3.0], [0.5, 0.0]),
            ([-3.0, 0.25], [0.0, 0.25]),
            ([1.0, 1.0], [0.5, 0.5]),
        ] {
            let found = nearest_in_triangle([1.0, 0.0, 1.0], q);
            assert!((found[0] - expected[0]).abs() + (found[1] - expected[1]).abs() < 1e-12);
        }
    }
}
