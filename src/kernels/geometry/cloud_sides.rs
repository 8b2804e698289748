//! Normals of a cloud that look to the same side of its surface.

use faer::Mat;

use super::cloud_sheets::CloudSheets;
use super::mesh::Vec3;
use super::point_tree::PointTree;
use crate::kernels::numerics::sparse::CsrMatrix;
use crate::kernels::numerics::sparse_cholesky::SparseCholesky;

/// Turns the normals of a cloud to the side that `votes` say: for every point how much speaks for its own
/// normal (above 0) or against it, 0 if nothing is known.
///
/// Votes may be wrong over whole regions. So neighbours that lie on one sheet of the surface agree as much
/// as their normals are parallel: signs are those of the numbers `x` with the least
///
/// `sum_ij w_ij (x_i - s_ij x_j)^2 + t sum_i |v_i| (x_i - sign v_i)^2`,
///
/// where `s_ij` says whether the normals of neighbours have the same side (a tree of them, as by Hoppe et al.
/// 1992, turns whole limbs by one false link).
///
/// # Panics
/// If there are not as many votes and sheets as points.
pub fn sided_normals(
    points: &[Vec3],
    sheets: &CloudSheets,
    n_neighbors: usize,
    votes: &[f64],
) -> Vec<Vec3> {
    assert_eq!(points.len(), votes.len(), "one vote a point");
    let normals = sheets.normals();
    let sides = sides(normals, &links(points, sheets, n_neighbors), votes);
    normals.iter().zip(sides).map(|(normal, it)| if it < 0.0 { -normal } else { *normal }).collect()
}

/// How much all votes weigh against the links of all points.
const TRUST: f64 = 0.1;

/// The power of what speaks for a link: a few good links say more than many poor ones.
const SHARPNESS: i32 = 8;

/// What makes the numbers of points determined of which nothing is known.
const LEAST: f64 = 1e-9;

fn sides(normals: &[Vec3], links: &[(u32, u32, f64)], votes: &[f64]) -> Vec<f64> {
    let n = normals.len();
    let total: f64 = votes.iter().map(|it| it.abs()).sum();
    if total <= 0.0 {
        return vec![0.0; n];
    }
    let mut triplets = Vec::with_capacity(3 * links.len() + n);
    for &(a, b, weight) in links {
        let side = normals[a as usize].dot(&normals[b as usize]).signum();
        triplets.extend([(a, a, weight), (b, b, weight), (a.min(b), a.max(b), -side * weight)]);
    }
    let scale = TRUST * n as f64 / total;
    triplets.extend((0..n).map(|it| (it as u32, it as u32, scale * votes[it].abs() + LEAST)));
    let matrix = CsrMatrix::from_triplets(n, n, &triplets);
    let factor = SparseCholesky::new(&matrix).expect("the diagonal dominates");
    let mut sides = Mat::from_fn(n, 1, |row, _| scale * votes[row]);
    factor.solve_in_place(sides.as_mut());
    (0..n).map(|it| sides[(it, 0)]).collect()
}

/// Neighbours on one sheet, and how surely they are: as their normals are parallel, and as one goes along the
/// surface from one to the other, not from an arm to the hip beside it. The surest of every point counts 1, so
/// that one where the surface is sharply bent is not left alone.
fn links(points: &[Vec3], sheets: &CloudSheets, n_neighbors: usize) -> Vec<(u32, u32, f64)> {
    let tree = PointTree::new(points);
    let normals = sheets.normals();
    let (mut found, mut links) = (Vec::new(), Vec::new());
    for a in 0..points.len() {
        let first = links.len();
        tree.nearest(points[a], n_neighbors + 1, &mut found);
        for b in found.iter().map(|it| it.1 as usize) {
            if a != b && sheets.are_one(points, a as u32, b as u32) {
                let way = (points[b] - points[a]).try_normalize(0.0).unwrap_or_default();
                let off = normals[a].dot(&way).abs().max(normals[b].dot(&way).abs());
                let along = normals[a].dot(&normals[b]).abs() * (1.0 - off);
                links.push((a as u32, b as u32, along.powi(SHARPNESS)));
            }
        }
        let surest = links[first..].iter().fold(f64::MIN_POSITIVE, |most, it| it.2.max(most));
        links[first..].iter_mut().for_each(|it| it.2 /= surest);
    }
    links
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes::bumpy_sphere;
    use crate::kernels::numerics::random::Random;

    const N_NEIGHBORS: usize = 16;

    #[test]
    fn votes_that_are_often_wrong_turn_all_normals_outwards() {
        let mesh = bumpy_sphere(12);
        let points = mesh.vertices();
        let sheets = CloudSheets::new(points, N_NEIGHBORS);
        let outside = mesh.vertex_normals();
        let mut random = Random::new(1);
        // An eighth of the points is told wrong, and a fifth nothing.
        let vote = |(normal, own): (&Vec3, &Vec3)| match random.uniform() {
            it if it < 0.125 => -normal.dot(own),
            it if it < 0.8 => normal.dot(own),
            _ => 0.0,
        };
        let mut votes: Vec<f64> = outside.iter().zip(sheets.normals()).map(vote).collect();
        // And so is a whole patch.
        let mut patch = Vec::new();
        PointTree::new(points).nearest(points[0], 8, &mut patch);
        for at in patch.iter().map(|it| it.1 as usize) {
            votes[at] = -outside[at].dot(&sheets.normals()[at]);
        }
        let sided = sided_normals(points, &sheets, N_NEIGHBORS, &votes);
        assert!(outside.iter().zip(&sided).all(|(a, b)| a.dot(b) > 0.5));
        let against: Vec<f64> = votes.iter().map(|it| -it).collect();
        let inward = sided_normals(points, &sheets, N_NEIGHBORS, &against);
        assert!(outside.iter().zip(&inward).all(|(a, b)| a.dot(b) < -0.5));
    }

    #[test]
    fn parts_have_sides_of_their_own() {
        let sphere = bumpy_sphere(6);
        let n = sphere.n_vertices();
        let mut points = sphere.vertices().to_vec();
        points.extend(sphere.vertices().iter().map(|it| it + Vec3::x() * 10.0));
        let sheets = CloudSheets::new(&points, N_NEIGHBORS);
        let outside = sphere.vertex_normals();
        let vote = |it: usize| {
            outside[it % n].dot(&sheets.normals()[it]) * if it < n { 1.0 } else { -1.0 }
        };
        let votes: Vec<f64> = (0..2 * n).map(vote).collect();
        let sided = sided_normals(&points, &sheets, N_NEIGHBORS, &votes);
        assert!((0..n).all(|it| outside[it].dot(&sided[it]) > 0.5));
        assert!((0..n).all(|it| outside[it].dot(&sided[n + it]) < -0.5));
    }
}
