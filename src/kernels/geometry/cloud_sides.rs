//! Normals of a cloud that look to the same side of its surface.

use super::cloud_sheets::CloudSheets;
use super::mesh::Vec3;
use super::point_tree::PointTree;
use super::spanning_tree::spanning_tree;

/// Turns the normals of a cloud to the side that `votes` say: for every point how much speaks for its own
/// normal (above 0) or against it, 0 if nothing is known.
///
/// Votes may be wrong over whole regions: all points that hang together along the surface, by a tree of the
/// most parallel normals (Hoppe et al. 1992), look to one side, and the sum of their votes says to
/// which.
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
    let mut normals = sheets.normals().to_vec();
    let (order, parents) = outward(points.len(), &links(points, sheets, n_neighbors));
    let mut roots: Vec<usize> = (0..points.len()).collect();
    let mut sums = vec![0.0; points.len()];
    for &point in &order {
        let mut vote = votes[point];
        if let Some(parent) = parents[point] {
            roots[point] = roots[parent];
            if normals[point].dot(&normals[parent]) < 0.0 {
                normals[point] = -normals[point];
                vote = -vote;
            }
        }
        sums[roots[point]] += vote;
    }
    for (normal, root) in normals.iter_mut().zip(roots) {
        if sums[root] < 0.0 {
            *normal = -*normal;
        }
    }
    normals
}

/// A tree along the sheets: of neighbours whose normals are most parallel, and across which one goes most
/// nearly along the surface, so that an arm is joined to its shoulder and not to the hip beside it.
fn links(points: &[Vec3], sheets: &CloudSheets, n_neighbors: usize) -> Vec<(usize, usize)> {
    let tree = PointTree::new(points);
    let normals = sheets.normals();
    let (mut found, mut pairs) = (Vec::new(), Vec::new());
    for a in 0..points.len() {
        tree.nearest(points[a], n_neighbors + 1, &mut found);
        for b in found.iter().map(|it| it.1 as usize) {
            if a != b && sheets.are_one(points, a as u32, b as u32) {
                let way = (points[b] - points[a]).try_normalize(0.0).unwrap_or_default();
                let off = normals[a].dot(&way).abs().max(normals[b].dot(&way).abs());
                let cost = 1.0 - normals[a].dot(&normals[b]).abs() + off;
                pairs.push((cost, a.min(b), a.max(b)));
            }
        }
    }
    spanning_tree(points.len(), pairs)
}

/// Points of a forest from its roots outward, and the parent of each.
fn outward(n: usize, links: &[(usize, usize)]) -> (Vec<usize>, Vec<Option<usize>>) {
    let mut near = vec![Vec::new(); n];
    for &(a, b) in links {
        near[a].push(b);
        near[b].push(a);
    }
    let (mut order, mut parents) = (Vec::with_capacity(n), vec![None; n]);
    let mut is_met = vec![false; n];
    for root in 0..n {
        if is_met[root] {
            continue;
        }
        is_met[root] = true;
        let mut next = order.len();
        order.push(root);
        while next < order.len() {
            let point: usize = order[next];
            next += 1;
            for &other in &near[point] {
                if !is_met[other] {
                    is_met[other] = true;
                    parents[other] = Some(point);
                    order.push(other);
                }
            }
        }
    }
    (order, parents)
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
        // A third of the points is told wrong, and a fifth nothing.
        let vote = |(normal, own): (&Vec3, &Vec3)| match random.uniform() {
            it if it < 0.33 => -normal.dot(own),
            it if it < 0.8 => normal.dot(own),
            _ => 0.0,
        };
        let votes: Vec<f64> = outside.iter().zip(sheets.normals()).map(vote).collect();
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
