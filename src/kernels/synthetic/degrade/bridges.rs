//! Parts that touch and grow together, as scans of hands on thighs do.

use std::collections::{BTreeSet, BinaryHeap};

use super::DegradeError;
use crate::kernels::geometry::{
    mesh::{TriMesh, Vec3},
    point_tree::PointTree,
};

/// Options of [`bridges`].
#[derive(Debug, Clone, PartialEq)]
pub struct Bridges {
    pub count: usize,
    /// How far parts may be apart in space, over the square root of the area.
    pub reach: f64,
    /// How many times farther they must be along the surface.
    pub detour: f64,
}

impl Bridges {
    pub fn new(count: usize) -> Self {
        Self { count, reach: 0.2, detour: 4.0 }
    }
}

/// Joins near parts of a surface by tubes, each of which takes a face away at both ends.
///
/// The pairs of faces with the least distance in space come first among those that face each other and
/// are `detour` times as far apart along the edges; two bridges are as far from each other as they are
/// long, and a tenth of the root of the area.
///
/// # Errors
/// [`DegradeError::Bridges`].
pub fn bridges(
    mesh: &TriMesh,
    protected: &[u32],
    options: &Bridges,
) -> Result<Vec<[u32; 3]>, DegradeError> {
    let unit = mesh.area().sqrt();
    let middles: Vec<Vec3> =
        (0..mesh.n_faces()).map(|it| mesh.corners(it).iter().sum::<Vec3>() / 3.0).collect();
    let graph = EdgeGraph::new(mesh);
    let mut chosen: Vec<(usize, usize)> = Vec::new();
    let mut ends: Vec<Vec3> = Vec::new();
    for (distance, first, second) in candidates(mesh, &middles, protected, options.reach * unit) {
        if chosen.len() == options.count {
            break;
        }
        let apart = (0.1 * unit).max(distance);
        let near = |it: usize| ends.iter().any(|end| (end - middles[it]).norm() < apart);
        let limit = options.detour * distance.max(0.05 * unit);
        if near(first) || near(second) || graph.joins(mesh, first, second, limit) {
            continue;
        }
        chosen.push((first, second));
        ends.extend([middles[first], middles[second]]);
    }
    if chosen.len() < options.count {
        return Err(DegradeError::Bridges { asked: options.count, possible: chosen.len() });
    }
    Ok(with_tubes(mesh, &chosen))
}

/// Pairs of faces that see each other, nearest first.
fn candidates(
    mesh: &TriMesh,
    middles: &[Vec3],
    protected: &[u32],
    reach: f64,
) -> Vec<(f64, usize, usize)> {
    let protected: BTreeSet<u32> = protected.iter().copied().collect();
    let is_free = |face: usize| mesh.faces()[face].iter().all(|it| !protected.contains(it));
    let normals: Vec<Vec3> = (0..mesh.n_faces())
        .map(|it| mesh.area_vector(it).try_normalize(0.0).unwrap_or_default())
        .collect();
    let tree = PointTree::new(middles);
    let mut found = Vec::new();
    let mut pairs = Vec::new();
    for first in (0..mesh.n_faces()).filter(|&it| is_free(it)) {
        tree.within(middles[first], reach, &mut found);
        // Only the nearest that is faced: enough pairs, and not millions.
        let faced = found.iter().map(|it| (it.0.sqrt(), it.1 as usize)).find(|&(distance, it)| {
            let towards = (middles[it] - middles[first]) / distance.max(f64::MIN_POSITIVE);
            it != first && normals[first].dot(&towards) > 0.7 && normals[it].dot(&towards) < -0.7
        });
        if let Some((distance, second)) = faced.filter(|it| is_free(it.1)) {
            pairs.push((distance, first.min(second), first.max(second)));
        }
    }
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)).then(a.2.cmp(&b.2)));
    pairs.dedup();
    pairs
}

/// Vertices and the lengths of their edges.
struct EdgeGraph {
    neighbours: Vec<Vec<(u32, f64)>>,
}

impl EdgeGraph {
    fn new(mesh: &TriMesh) -> Self {
        let mut neighbours = vec![Vec::new(); mesh.n_vertices()];
        for face in mesh.faces() {
            for corner in 0..3 {
                let (a, b) = (face[corner], face[(corner + 1) % 3]);
                let length = (mesh.vertices()[a as usize] - mesh.vertices()[b as usize]).norm();
                neighbours[a as usize].push((b, length));
                neighbours[b as usize].push((a, length));
            }
        }
        Self { neighbours }
    }

    /// Whether a path along edges that is no longer than the limit leads from one face to another.
    fn joins(&self, mesh: &TriMesh, first: usize, second: usize, limit: f64) -> bool {
        let goals = mesh.faces()[second];
        let mut best = std::collections::BTreeMap::new();
        let mut queue = BinaryHeap::new();
        for &start in &mesh.faces()[first] {
            queue.push((std::cmp::Reverse(0u64), start));
        }
        // Lengths of at least zero are ordered as their bits are.
        while let Some((std::cmp::Reverse(bits), vertex)) = queue.pop() {
            if goals.contains(&vertex) {
                return true;
            }
            if best.get(&vertex).is_some_and(|&it| it <= bits) {
                continue;
            }
            best.insert(vertex, bits);
            for &(next, length) in &self.neighbours[vertex as usize] {
                let sum = f64::from_bits(bits) + length;
                if sum <= limit {
                    queue.push((std::cmp::Reverse(sum.to_bits()), next));
                }
            }
        }
        false
    }
}

/// The faces with pairs of them replaced by tubes.
fn with_tubes(mesh: &TriMesh, pairs: &[(usize, usize)]) -> Vec<[u32; 3]> {
    let removed: BTreeSet<usize> = pairs.iter().flat_map(|&(a, b)| [a, b]).collect();
    let kept = mesh.faces().iter().enumerate().filter(|it| !removed.contains(&it.0));
    let mut faces: Vec<[u32; 3]> = kept.map(|it| *it.1).collect();
    for &(first, second) in pairs {
        let from = mesh.faces()[first];
        let [p, q, r] = mesh.faces()[second];
        let at = |it: u32| mesh.vertices()[it as usize];
        // The ends face each other, so one runs round the other way; of the three ways to twist the
        // tube, the shortest.
        let ways = [[p, r, q], [r, q, p], [q, p, r]];
        let length = |way: &[u32; 3]| -> f64 {
            from.iter().zip(way).map(|(&a, &b)| (at(a) - at(b)).norm()).sum()
        };
        let to = ways.into_iter().min_by(|a, b| length(a).total_cmp(&length(b)));
        let to = to.expect("there are three ways");
        for corner in 0..3 {
            let next = (corner + 1) % 3;
            faces.push([from[corner], from[next], to[next]]);
            faces.push([from[corner], to[next], to[corner]]);
        }
    }
    faces
}
