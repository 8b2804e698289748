//! The Laplacian of points that sample a surface.

use std::cmp::Ordering;

use super::edge_weights::EdgeWeights;
use super::operator::Operator;
use super::tufted::{Gluing, TuftedError, TuftedReport, cover_laplacian};
use crate::kernels::geometry::delaunay_stars::{StarOptions, delaunay_stars};
use crate::kernels::geometry::mesh::Vec3;

/// Options of [`cloud_laplacian`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CloudOptions {
    /// The nearest points of which the surface around a point is made.
    pub n_neighbors: usize,
}

impl Default for CloudOptions {
    fn default() -> Self {
        Self { n_neighbors: 30 }
    }
}

/// What was found and done on the way to the operator.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CloudReport {
    /// Points at the place of an earlier one.
    pub n_duplicates: usize,
    /// Points that no triangle has. Functions are zero there.
    pub n_isolated: usize,
    /// How the triangles became an operator.
    pub cover: TuftedReport,
}

/// Why there is no operator.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CloudError {
    #[error("the {n_points} points are {n_places} places; a surface needs three at least")]
    TooFew { n_points: usize, n_places: usize },
    #[error("{n_neighbors} neighbours make no triangle; two at least do")]
    TooFewNeighbors { n_neighbors: usize },
    #[error("the {n_points} points lie on a line: there is no triangle between them")]
    NoTriangles { n_points: usize },
    #[error(transparent)]
    Tufted(#[from] TuftedError),
}

/// Every triangle of a surface is found three times: around each of its corners.
const COPIES: f64 = 3.0;

/// The weight of the edge that ties a point to an earlier one at the same place. Weights of other
/// edges are about one: functions differ there by a hundredth of what they differ between neighbours,
/// and eigenpairs lose two digits of their sixteen.
const TIE: f64 = 100.0;

/// Assembles the Laplacian of a point cloud (Sharp & Crane 2020).
///
/// Around every point, its nearest neighbours are projected to the plane that fits them best, and the
/// triangles of their Delaunay triangulation that have the point as a corner are kept. All those
/// triangles together, which cover the surface about three times and fit each other here and there
/// only, go through the tufted cover ([`tufted_laplacian`]); a third of that is the operator.
///
/// Masses add up to about the area. Points at the same place share their mass and are tied together,
/// so functions have the same value there; points far from any other plane have the stiffness 1 and a
/// tiny mass.
///
/// [`tufted_laplacian`]: super::tufted::tufted_laplacian
///
/// # Errors
/// See [`CloudError`].
pub fn cloud_laplacian(
    points: &[Vec3],
    options: &CloudOptions,
) -> Result<(Operator, CloudReport), CloudError> {
    let n_points = points.len();
    let n_neighbors = options.n_neighbors;
    if n_neighbors < 2 {
        return Err(CloudError::TooFewNeighbors { n_neighbors });
    }
    let places = Places::of(points);
    let n_places = places.positions.len();
    if n_places < 3 {
        return Err(CloudError::TooFew { n_points, n_places });
    }
    let around = StarOptions { n_neighbors, sheets: None };
    let triangles = delaunay_stars(&places.positions, &around);
    if triangles.is_empty() {
        return Err(CloudError::NoTriangles { n_points });
    }
    let (mut operator, cover) =
        cover_laplacian(&places.positions, &triangles, Gluing::FromSideToSide)?;
    operator.stiffness.values.iter_mut().for_each(|it| *it /= COPIES);
    operator.mass.iter_mut().for_each(|it| *it /= COPIES);
    let report =
        CloudReport { n_duplicates: n_points - n_places, n_isolated: cover.n_unreferenced, cover };
    Ok((places.give_back(&operator, n_points), report))
}

/// The different places among points, sorted: nothing depends on the order of the points.
struct Places {
    positions: Vec<Vec3>,
    /// The points at every place, ascending.
    points: Vec<Vec<u32>>,
}

impl Places {
    fn of(points: &[Vec3]) -> Self {
        // Adding zero makes the two zeros one.
        let key = |point: u32| points[point as usize] + Vec3::zeros();
        let mut order: Vec<u32> = (0..points.len() as u32).collect();
        order.sort_unstable_by(|&a, &b| {
            let (p, q) = (key(a), key(b));
            let axes = p.iter().zip(&q).map(|(p, q)| p.total_cmp(q));
            axes.fold(Ordering::Equal, Ordering::then).then(a.cmp(&b))
        });
        let groups = order.chunk_by(|&a, &b| key(a) == key(b));
        let (positions, points) = groups.map(|it| (key(it[0]), it.to_vec())).unzip();
        Self { positions, points }
    }

    /// From the operator of the places to that of the points.
    fn give_back(&self, of_places: &Operator, n_points: usize) -> Operator {
        let mut mass = vec![0.0; n_points];
        let mut room = vec![1; n_points];
        let mut pinned = Vec::new();
        for (place, points) in self.points.iter().enumerate() {
            for &point in points {
                mass[point as usize] = of_places.mass[place] / points.len() as f64;
            }
            let n_neighbors = of_places.stiffness.row(place).count() - 1;
            room[points[0] as usize] = (n_neighbors + points.len() - 1) as u32;
            if n_neighbors == 0 {
                pinned.push(points[0]);
            }
        }
        let mut weights = EdgeWeights::with_room(&room);
        for (place, points) in self.points.iter().enumerate() {
            let later = of_places.stiffness.row(place).filter(|it| it.0 > place);
            for (other, value) in later {
                weights.add(points[0], self.points[other][0], -value);
            }
            for &copy in &points[1..] {
                weights.add(points[0], copy, TIE);
            }
        }
        let mut stiffness = weights.into_stiffness();
        for point in pinned {
            let row = stiffness.offsets[point as usize]..stiffness.offsets[point as usize + 1];
            let diagonal = row.clone().find(|&it| stiffness.columns[it] == point);
            stiffness.values[diagonal.expect("every row has its diagonal")] += 1.0;
        }
        Operator { stiffness, mass }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::mesh::TriMesh;
    use crate::kernels::geometry::shapes::{icosphere, rectangle};
    use crate::kernels::numerics::random::Random;
    use crate::kernels::spectral::eigs::{EigsOptions, eigs};
    use crate::kernels::test_shapes::permuted;

    fn check(points: &[Vec3]) -> (Operator, CloudReport) {
        let (operator, report) = cloud_laplacian(points, &CloudOptions::default()).unwrap();
        assert_eq!(report.cover.flips.n_left, 0);
        let sums = operator.stiffness.mul_vec(&vec![1.0; points.len()]);
        let n_pinned = sums.iter().filter(|it| it.abs() > 1e-10).count();
        assert_eq!(n_pinned, report.n_isolated);
        for row in 0..points.len() {
            for (column, value) in operator.stiffness.row(row) {
                assert!(column == row || value <= 0.0, "{row}, {column}: {value}");
            }
        }
        assert!(operator.mass.iter().all(|&it| it > 0.0));
        (operator, report)
    }

    fn eigenvalues(operator: &Operator, k: usize) -> Vec<f64> {
        eigs(operator, &EigsOptions { k, ..Default::default() }).unwrap().0.eigenvalues
    }

    fn total_mass(operator: &Operator) -> f64 {
        operator.mass.iter().sum()
    }

    fn random_sphere(n_points: usize, seed: u64) -> Vec<Vec3> {
        let mut random = Random::new(seed);
        (0..n_points).map(|_| Vec3::from_fn(|_, _| random.normal()).normalize()).collect()
    }

    #[test]
    fn the_vertices_of_an_icosphere_have_the_operator_of_its_faces() {
        let sphere = icosphere(4);
        let (operator, report) = check(sphere.vertices());
        assert_eq!((report.n_duplicates, report.n_isolated), (0, 0));
        let (of_mesh, _) = crate::kernels::spectral::tufted::tufted_laplacian(&sphere).unwrap();
        assert!((total_mass(&operator) - 12.5514).abs() < 5e-5, "{}", total_mass(&operator));
        for (a, b) in eigenvalues(&operator, 17).iter().zip(eigenvalues(&of_mesh, 17)) {
            assert!((a - b).abs() < 1e-9, "{a} and {b}");
        }
    }

    /// The truth is 2 and 6. Gluing by angle, as the authors' program does, puts copies of a triangle
    /// beside each other: surfaces with slits, whose eigenvalues are too small by a twentieth.
    #[test]
    fn random_points_of_the_sphere() {
        let points = random_sphere(4000, 1);
        let (operator, _) = check(&points);
        assert!((total_mass(&operator) - 12.570).abs() < 0.02, "{}", total_mass(&operator));
        let found = eigenvalues(&operator, 9);
        assert!(found[1..4].iter().all(|it| (it - 2.0).abs() < 0.01), "{found:?}");
        assert!(found[4..9].iter().all(|it| (it - 6.0).abs() < 0.08), "{found:?}");

        let n_neighbors = CloudOptions::default().n_neighbors;
        let triangles = delaunay_stars(&points, &StarOptions { n_neighbors, sheets: None });
        let (by_angle, _) = cover_laplacian(&points, &triangles, Gluing::ByAngle).unwrap();
        let found = eigenvalues(&by_angle, 9);
        assert!(found[1..4].iter().all(|it| (1.88..1.92).contains(it)), "{found:?}");
    }

    #[test]
    fn a_regular_grid_is_covered_once() {
        let grid = rectangle(30, 20, 3.0, 2.0);
        let (operator, _) = check(grid.vertices());
        assert!((total_mass(&operator) / 6.0 - 1.0).abs() < 1e-9, "{}", total_mass(&operator));
    }

    #[test]
    fn the_order_of_the_points_does_not_matter() {
        let points = random_sphere(600, 2);
        let (one, _) = check(&points);
        let (mixed, order) = permuted(&TriMesh::from_points(points).unwrap());
        let (other, _) = check(mixed.vertices());
        for (point, &new) in order.iter().enumerate() {
            assert!((other.mass[new as usize] / one.mass[point] - 1.0).abs() < 1e-12);
        }
        for (a, b) in eigenvalues(&one, 9).iter().zip(eigenvalues(&other, 9)) {
            assert!((a - b).abs() < 1e-9, "{a} and {b}");
        }
    }

    #[test]
    fn scale_does_not_matter() {
        let points = random_sphere(600, 3);
        let (one, _) = check(&points);
        for factor in [1e-6, 1e6] {
            let scaled: Vec<Vec3> = points.iter().map(|it| it * factor).collect();
            let (other, _) = check(&scaled);
            for (a, b) in eigenvalues(&one, 9).iter().zip(eigenvalues(&other, 9)) {
                assert!((a - b * factor * factor).abs() < 1e-6, "{a} and {b}");
            }
        }
    }

    #[test]
    fn repeated_points_have_the_functions_of_the_first() {
        let points = random_sphere(500, 4);
        let (one, _) = check(&points);
        let repeated = [&points[..], &points[..20], &points[5..6]].concat();
        let (two, report) = check(&repeated);
        assert_eq!(report.n_duplicates, 21);
        assert!((total_mass(&two) / total_mass(&one) - 1.0).abs() < 1e-12);
        for (a, b) in eigenvalues(&one, 9).iter().zip(eigenvalues(&two, 9)) {
            assert!((a - b).abs() < 1e-3 * (1.0 + a), "{a} and {b}");
        }
        let (basis, _) = eigs(&two, &EigsOptions { k: 9, ..Default::default() }).unwrap();
        for copy in 0..20 {
            for column in 0..9 {
                let vectors = &basis.eigenvectors;
                let difference = vectors[(copy, column)] - vectors[(500 + copy, column)];
                assert!(difference.abs() < 3e-3, "{difference}");
            }
        }
    }

    #[test]
    fn points_on_lines_and_lone_points_do_not_disturb_the_others() {
        let mut points = random_sphere(500, 5);
        points.extend((0..40).map(|it| Vec3::new(50.0 + f64::from(it), 0.0, 0.0)));
        let (_, report) = check(&points);
        assert_eq!(report.n_isolated, 40);
    }

    #[test]
    fn one_thread_and_three_give_the_same_bytes() {
        let points = random_sphere(900, 6);
        let run = |n_threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
            pool.install(|| cloud_laplacian(&points, &CloudOptions::default()).unwrap().0)
        };
        assert_eq!(run(1), run(3));
    }

    #[test]
    fn too_little_is_refused() {
        let message = |points: &[Vec3], n_neighbors: usize| {
            cloud_laplacian(points, &CloudOptions { n_neighbors }).unwrap_err().to_string()
        };
        assert_eq!(
            message(&[Vec3::x(), Vec3::x(), Vec3::y()], 30),
            "the 3 points are 2 places; a surface needs three at least"
        );
        let line: Vec<Vec3> = (0..9).map(|it| Vec3::x() * f64::from(it)).collect();
        assert_eq!(
            message(&line, 30),
            "the 9 points lie on a line: there is no triangle between them"
        );
        assert_eq!(message(&line, 1), "1 neighbours make no triangle; two at least do");
    }
}
