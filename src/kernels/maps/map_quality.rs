//! How good a map between two shapes is, with and without the truth.

use faer::MatRef;
use rayon::prelude::*;

use super::{correspondences::Correspondences, functional_map::PointMap};
use crate::kernels::geometry::{geodesics::Geodesics, mesh::TriMesh};

/// `|C^T C - I|_F / sqrt(k)`: zero for maps that keep areas, 0.1 to 0.5 on good real pairs.
pub fn orthogonality(map: MatRef<'_, f64>) -> f64 {
    let gram = map.transpose() * map;
    let mut sum = 0.0;
    for column in 0..gram.ncols() {
        for (row, value) in gram.col_as_slice(column).iter().enumerate() {
            let expected = if row == column { 1.0 } else { 0.0 };
            sum += (value - expected).powi(2);
        }
    }
    (sum / gram.ncols() as f64).sqrt()
}

/// The part of `|C|_F^2` that lies within `half_width` of the diagonal, which leads from corner to
/// corner. Near-isometries keep eigenvalues and with them the diagonal.
pub fn band_energy(map: MatRef<'_, f64>, half_width: usize) -> f64 {
    let slope = map.nrows() as f64 / map.ncols() as f64;
    let (mut near, mut all) = (0.0, 0.0);
    for column in 0..map.ncols() {
        for (row, value) in map.col(column).iter().enumerate() {
            let square = value * value;
            all += square;
            if (row as f64 - slope * column as f64).abs() <= half_width as f64 {
                near += square;
            }
        }
    }
    near / all
}

/// The part of the target's area whose vertices are matched by some source vertex.
///
/// The number of source vertices limits it, if the target is denser.
///
/// # Panics
/// If there are not as many masses as target vertices.
pub fn coverage(matches: &PointMap, target_mass: &[f64]) -> f64 {
    assert_eq!(target_mass.len(), matches.n_target, "one mass for every target vertex");
    let mut hit = vec![false; matches.n_target];
    for &vertex in &matches.target_of_source {
        hit[vertex as usize] = true;
    }
    let covered: f64 = target_mass.iter().zip(&hit).filter(|it| *it.1).map(|it| it.0).sum();
    covered / target_mass.iter().sum::<f64>()
}

/// The Dirichlet energy of the map of the source's surface into space, over the target's area.
///
/// `1/4 sum cot a_ij |x_m(i) - x_m(j)|^2` over the corners that face the edges `ij`. An isometry has the
/// value one, maps that stretch or fold are above; matches that tear neighbours apart, far above.
///
/// # Panics
/// If meshes and matches do not belong together.
pub fn dirichlet_energy(source: &TriMesh, matches: &PointMap, target: &TriMesh) -> f64 {
    let image = |vertex: u32| target.vertices()[matches.target_of_source[vertex as usize] as usize];
    let mean_area = source.area() / source.n_faces().max(1) as f64;
    let mut energy = 0.0;
    for (face, vertices) in source.faces().iter().enumerate() {
        let corners = source.corners(face);
        let double_area = 2.0 * source.area_vector(face).norm();
        if double_area <= 2e-14 * mean_area {
            continue;
        }
        for at in 0..3 {
            let (i, j) = ((at + 1) % 3, (at + 2) % 3);
            let cotangent =
                (corners[i] - corners[at]).dot(&(corners[j] - corners[at])) / double_area;
            energy += 0.25 * cotangent * (image(vertices[i]) - image(vertices[j])).norm_squared();
        }
    }
    energy / target.area()
}

/// How far from home every vertex comes back: the distance along its own surface between a vertex and
/// `back[forth[vertex]]`, in parts of the root of the surface's area. Infinite on other components.
///
/// # Panics
/// If the maps do not belong together and to the mesh.
pub fn return_distances(mesh: &TriMesh, forth: &PointMap, back: &PointMap) -> Vec<f64> {
    let geodesics = Geodesics::new(mesh).expect("a mesh has faces");
    let faces = FaceOfVertex::new(mesh);
    let unit = mesh.area().sqrt();
    let pair = |vertex: usize| {
        let returned = back.target_of_source[forth.target_of_source[vertex] as usize];
        (faces.place(vertex as u32), returned)
    };
    distances(&geodesics, mesh.n_vertices(), unit, pair)
}

/// How far matches are from the truth, for maps to a shape with true places on the source.
///
/// For every source vertex the distance along the source between the vertex and the true place of the
/// target vertex that it is matched to, in parts of the root of the source's area (Kim et al. 2011).
///
/// # Panics
/// If source, matches and truth do not belong together.
pub fn geodesic_errors(source: &TriMesh, matches: &PointMap, truth: &Correspondences) -> Vec<f64> {
    let geodesics = Geodesics::new(source).expect("a mesh has faces");
    let unit = source.area().sqrt();
    let pair = |vertex: usize| {
        let matched = matches.target_of_source[vertex] as usize;
        ((truth.faces[matched] as usize, truth.barycentric[matched]), vertex as u32)
    };
    distances(&geodesics, source.n_vertices(), unit, pair)
}

/// The same for a map from the target to the source: between the source vertex that a target vertex is
/// matched to and the target vertex's true place.
///
/// # Panics
/// If source, matches and truth do not belong together.
pub fn inverse_geodesic_errors(
    source: &TriMesh,
    source_of_target: &PointMap,
    truth: &Correspondences,
) -> Vec<f64> {
    let geodesics = Geodesics::new(source).expect("a mesh has faces");
    let unit = source.area().sqrt();
    let pair = |vertex: usize| {
        let place = (truth.faces[vertex] as usize, truth.barycentric[vertex]);
        (place, source_of_target.target_of_source[vertex])
    };
    distances(&geodesics, truth.faces.len(), unit, pair)
}

/// Distances between `count` pairs of a place and a vertex, in parts of a unit.
fn distances(
    geodesics: &Geodesics,
    count: usize,
    unit: f64,
    pair: impl Fn(usize) -> ((usize, [f64; 3]), u32) + Sync,
) -> Vec<f64> {
    (0..count)
        .into_par_iter()
        .with_min_len(64)
        .map_init(
            || geodesics.front(),
            |front, index| {
                let (place, vertex) = pair(index);
                geodesics.distance_between(front, place, vertex) / unit
            },
        )
        .collect()
}

/// For every vertex a face that it belongs to.
struct FaceOfVertex(Vec<Option<(u32, u8)>>);

impl FaceOfVertex {
    fn new(mesh: &TriMesh) -> Self {
        let mut res = vec![None; mesh.n_vertices()];
        for (face, corners) in mesh.faces().iter().enumerate() {
            for (corner, &vertex) in corners.iter().enumerate() {
                res[vertex as usize].get_or_insert((face as u32, corner as u8));
            }
        }
        Self(res)
    }

    /// A vertex as a place; one of no face is put anywhere, as nothing can be reached from it.
    fn place(&self, vertex: u32) -> (usize, [f64; 3]) {
        let (face, corner) = self.0[vertex as usize].unwrap_or((0, 0));
        let mut barycentric = [0.0; 3];
        barycentric[usize::from(corner)] = 1.0;
        (face as usize, barycentric)
    }
}

/// The mean of the errors that are finite, weighted by areas; NaN without any.
pub fn weighted_mean(values: &[f64], weights: &[f64]) -> f64 {
    let (mut sum, mut weight) = (0.0, 0.0);
    for (value, share) in values.iter().zip(weights).filter(|it| it.0.is_finite()) {
        sum += value * share;
        weight += share;
    }
    sum / weight
}

/// The parts of errors that are at most each of some thresholds.
pub fn error_curve(errors: &[f64], thresholds: &[f64]) -> Vec<f64> {
    let mut sorted = errors.to_vec();
    sorted.sort_by(f64::total_cmp);
    let share = |it: &f64| sorted.partition_point(|error| error <= it) as f64;
    thresholds.iter().map(|it| share(it) / errors.len() as f64).collect()
}

/// The area under the curve of the parts of errors up to `limit`, over `limit`: one if all are zero.
pub fn area_under_curve(errors: &[f64], limit: f64) -> f64 {
    let gain = |error: &f64| (1.0 - error / limit).max(0.0);
    errors.iter().map(gain).sum::<f64>() / errors.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::{
        geometry::shapes::rectangle,
        maps::correspondences::closest_places,
        test_shapes::{creature, permuted},
    };
    use faer::Mat;

    fn map_to(target_of_source: Vec<u32>, n_target: usize) -> PointMap {
        PointMap { target_of_source, n_target }
    }

    #[test]
    fn rotations_are_orthogonal_and_stretches_are_not() {
        let (sin, cos) = 0.4f64.sin_cos();
        let turn = Mat::from_fn(2, 2, |i, j| [[cos, -sin], [sin, cos]][i][j]);
        assert!(orthogonality(turn.as_ref()) < 1e-15);
        let twice = Mat::<f64>::identity(4, 4) * faer::Scale(2.0);
        assert_eq!(orthogonality(twice.as_ref()), 3.0);
    }

    #[test]
    fn the_band_follows_the_diagonal_of_a_rectangle() {
        let map = Mat::from_fn(8, 4, |i, j| if i == 2 * j { 1.0 } else { 0.0 });
        assert_eq!(band_energy(map.as_ref(), 0), 1.0);
        let all = Mat::from_fn(4, 4, |_, _| 1.0);
        assert_eq!(band_energy(all.as_ref(), 1), 10.0 / 16.0);
    }

    #[test]
    fn a_renumbered_copy_is_matched_perfectly() {
        let mesh = creature(0.2);
        let (copy, order) = permuted(&mesh);
        let mut back = vec![0; order.len()];
        for (old, &new) in order.iter().enumerate() {
            back[new as usize] = old as u32;
        }
        let (forth, back) = (map_to(order, mesh.n_vertices()), map_to(back, mesh.n_vertices()));
        assert!((dirichlet_energy(&mesh, &forth, &copy) - 1.0).abs() < 1e-12);
        assert_eq!(coverage(&forth, &vec![1.0; mesh.n_vertices()]), 1.0);
        assert!(return_distances(&mesh, &forth, &back).iter().all(|it| *it < 1e-9));
        let truth = closest_places(copy.vertices(), &mesh).unwrap();
        let errors = geodesic_errors(&mesh, &forth, &truth);
        assert!(errors.iter().all(|it| *it < 1e-6), "{errors:?}");
        let errors = inverse_geodesic_errors(&mesh, &back, &truth);
        assert!(errors.iter().all(|it| *it < 1e-6), "{errors:?}");
    }

    /// On a strip of 3 x 2, whose root of the area is the unit.
    #[test]
    fn a_shift_by_one_column_is_measured() {
        let strip = rectangle(30, 20, 3.0, 2.0);
        let columns = 31;
        let shifted: Vec<u32> = (0..strip.n_vertices() as u32)
            .map(|it| if it % columns == columns - 1 { it } else { it + 1 })
            .collect();
        let there = map_to(shifted, strip.n_vertices());
        let same = map_to((0..strip.n_vertices() as u32).collect(), strip.n_vertices());
        let truth = closest_places(strip.vertices(), &strip).unwrap();
        let errors = geodesic_errors(&strip, &there, &truth);
        let one = 0.1 / 6f64.sqrt();
        let expected = |it: usize| if it as u32 % columns == columns - 1 { 0.0 } else { one };
        for (vertex, error) in errors.iter().enumerate() {
            assert!((error - expected(vertex)).abs() < 1e-6, "{vertex}: {error}");
        }
        for (error, back) in errors.iter().zip(return_distances(&strip, &there, &same)) {
            assert!((error - back).abs() < 1e-6);
        }
        assert_eq!(error_curve(&errors, &[0.9 * one, 1.1 * one]), [1.0 / 31.0, 1.0]);
        let auc = area_under_curve(&errors, 2.0 * one);
        assert!((auc - (30.0 * 0.5 + 1.0) / 31.0).abs() < 1e-6, "{auc}");
    }
}
