//! Bringing whole curves back into the shape.

use rayon::prelude::*;

use super::super::curve_skeleton::CurveSkeleton;
use super::pull_inside::is_nearly_closed;
use crate::kernels::geometry::distance_field::DistanceField;
use crate::kernels::geometry::mesh::{TriMesh, Vec3};
use crate::kernels::geometry::shapes::signed_volume;

/// Rounds of bending: an edge has at most so many levels of new nodes.
const ROUNDS: usize = 3;

/// Places of an edge that are looked at.
const PLACES: usize = 8;

/// The distances from a surface that has an inside: one that is nearly closed and not inside out.
pub fn inside_of(mesh: &TriMesh) -> Option<DistanceField> {
    (is_nearly_closed(mesh) && signed_volume(mesh) > 0.0).then(|| DistanceField::new(mesh))
}

/// Bends the edges that leave a shape: each gets a node, without vertices, beside where it is farthest
/// outside; up to three times.
pub fn bend_edges(skeleton: &CurveSkeleton, field: &DistanceField) -> CurveSkeleton {
    let mut bent = skeleton.clone();
    for _ in 0..ROUNDS {
        let is_inside: Vec<bool> =
            bent.positions().par_iter().map(|it| field.is_inside(*it)).collect();
        let found: Vec<Option<Vec3>> = (bent.edges().par_iter().enumerate())
            .map(|(edge, ends)| {
                let [from, to] = ends.map(|it| bent.positions()[it as usize]);
                // What does not meet the surface does not leave it.
                let stays = ends.iter().all(|&it| is_inside[it as usize])
                    && !field.tree().is_crossed(from, to);
                if stays { None } else { worst_place(&bent, edge, field) }
            })
            .collect();
        if found.iter().all(Option::is_none) {
            break;
        }
        bent = with_nodes(&bent, &found);
    }
    bent
}

/// Where an edge is farthest outside, moved into the shape: by half of the radius around it at most.
fn worst_place(skeleton: &CurveSkeleton, edge: usize, field: &DistanceField) -> Option<Vec3> {
    let ends = skeleton.edges()[edge].map(|it| it as usize);
    let [from, to] = ends.map(|it| skeleton.positions()[it]);
    let places = (1..=PLACES).map(|it| from + (to - from) * (it as f64 / (PLACES + 1) as f64));
    let outside = places.filter(|it| !field.is_inside(*it));
    let far = outside.map(|it| (field.nearest(it).square, it));
    let (_, place) = far.max_by(|a, b| a.0.total_cmp(&b.0))?;
    let reach = 0.25 * ends.iter().map(|&it| skeleton.radii()[it]).sum::<f64>();
    moved_inside(&place, reach, field)
}

/// A place outside, moved through the nearest surface by half of how thick the shape is there, and by
/// `reach` at most: across a trunk the middle would be far away.
pub fn moved_inside(place: &Vec3, reach: f64, field: &DistanceField) -> Option<Vec3> {
    let nearest = field.nearest(*place);
    let inward = (nearest.point - place).try_normalize(0.0)?;
    let range = [1e-3 * reach, 2.0 * reach];
    let behind = field.tree().first_hit(nearest.point, inward, range);
    Some(nearest.point + inward * behind.map_or(reach, |it| 0.5 * it.along))
}

/// With a new node in the edges that have a place for it.
fn with_nodes(skeleton: &CurveSkeleton, places: &[Option<Vec3>]) -> CurveSkeleton {
    let (mut positions, mut radii) = (skeleton.positions().to_vec(), skeleton.radii().to_vec());
    let mut edges = Vec::with_capacity(skeleton.n_edges());
    for (&[from, to], place) in skeleton.edges().iter().zip(places) {
        let Some(place) = place else {
            edges.push([from, to]);
            continue;
        };
        let new = positions.len() as u32;
        positions.push(*place);
        radii.push(0.5 * (radii[from as usize] + radii[to as usize]));
        edges.extend([[from, new], [to, new]]);
    }
    let labels = skeleton.node_of_vertex().to_vec();
    CurveSkeleton::new(positions, radii, edges, labels).expect("new nodes between old ones")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes::torus;

    #[test]
    fn a_chord_of_a_ring_is_bent_into_it() {
        let mesh = torus(1.0, 0.2, 96, 48);
        let ends = vec![Vec3::x(), Vec3::z()];
        let skeleton = CurveSkeleton::new(ends, vec![0.2; 2], vec![[0, 1]], vec![]).unwrap();
        let field = inside_of(&mesh).unwrap();
        let bent = bend_edges(&skeleton, &field);
        assert!(bent.n_nodes() > 2 && bent.leaves() == [0, 1] && bent.junctions().is_empty());
        assert!((0..bent.n_edges()).all(|it| worst_place(&bent, it, &field).is_none()));
        assert_eq!(bend_edges(&bent, &field), bent);
    }
}
