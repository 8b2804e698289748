//! Filling of holes.

use std::collections::{BTreeMap, BTreeSet};

use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::geometry::topology::Edges;

/// Closes boundary loops of at most `max_edges` edges with faces between their vertices.
///
/// Among all triangulations of a loop, takes the one with the least area (Barequet & Sharir 1995;
/// cubic in the loop's length). The new faces walk the boundary against the old ones, so an oriented
/// mesh stays oriented. No new edge joins two vertices that an edge joins already: it would get more
/// than two faces. Loops that this leaves no triangulation, and loops that pass through a vertex twice,
/// stay open. Returns the number of filled holes.
pub fn fill_holes(vertices: &[Vec3], faces: &mut Vec<[u32; 3]>, max_edges: usize) -> usize {
    let edges = Edges::of(faces);
    let loops = boundary_loops(faces, &edges);
    let mut known: BTreeSet<[u32; 2]> = edges.iter().map(|it| [it[0].low, it[0].high]).collect();
    let mut n_filled = 0;
    for rim in loops.iter().filter(|it| (3..=max_edges).contains(&it.len())) {
        if let Some(new) = least_area_triangulation(vertices, rim, &known) {
            known.extend(new.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]].map(sorted)));
            faces.extend(new);
            n_filled += 1;
        }
    }
    n_filled
}

fn sorted([a, b]: [u32; 2]) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

/// Simple loops of boundary edges, each walked against the faces beside it.
fn boundary_loops(faces: &[[u32; 3]], edges: &Edges) -> Vec<Vec<u32>> {
    let mut nexts: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for it in edges.iter().filter(|it| it.len() == 1).map(|it| it[0]) {
        let corners = faces[it.face as usize];
        let (from, to) = (corners[it.side as usize], corners[(it.side as usize + 1) % 3]);
        nexts.entry(to).or_default().push(from);
    }
    let mut loops = Vec::new();
    let mut is_done: BTreeMap<u32, bool> = nexts.keys().map(|&it| (it, false)).collect();
    for &start in nexts.keys() {
        let mut rim = Vec::new();
        let mut vertex = start;
        while let Some(done @ false) = is_done.get_mut(&vertex) {
            *done = true;
            rim.push(vertex);
            let [next] = nexts[&vertex][..] else { break };
            vertex = next;
        }
        if !rim.is_empty() && vertex == start {
            loops.push(rim);
        }
    }
    loops
}

/// None if every triangulation needs an edge that is known.
fn least_area_triangulation(
    vertices: &[Vec3],
    rim: &[u32],
    known: &BTreeSet<[u32; 2]>,
) -> Option<Vec<[u32; 3]>> {
    let n = rim.len();
    // A rim's own edges are known, and have room for one more face.
    let is_barred = |i: usize, j: usize| {
        j - i > 1 && j - i < n - 1 && known.contains(&sorted([rim[i], rim[j]]))
    };
    let point = |it: usize| vertices[rim[it] as usize];
    let area = |a: usize, b: usize, c: usize| {
        (point(b) - point(a)).cross(&(point(c) - point(a))).norm() / 2.0
    };
    // `cost[i][j]`: the least area that closes the polygon i, i + 1, …, j.
    let mut cost = vec![vec![0.0f64; n]; n];
    let mut apex = vec![vec![0usize; n]; n];
    for span in 2..n {
        for i in 0..n - span {
            let j = i + span;
            let total = |k: usize| cost[i][k] + cost[k][j] + area(i, k, j);
            let best = (i + 1..j).min_by(|&a, &b| total(a).total_cmp(&total(b)));
            let best = best.expect("a span of two has an apex");
            cost[i][j] = if is_barred(i, j) { f64::INFINITY } else { total(best) };
            apex[i][j] = best;
        }
    }
    if !cost[0][n - 1].is_finite() {
        return None;
    }
    let mut triangles = Vec::with_capacity(n - 2);
    let mut open = vec![(0, n - 1)];
    while let Some((i, j)) = open.pop() {
        if j - i >= 2 {
            let k = apex[i][j];
            triangles.push([rim[i], rim[k], rim[j]]);
            open.extend([(i, k), (k, j)]);
        }
    }
    Some(triangles)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::mesh::TriMesh;
    use crate::kernels::geometry::shapes::{icosphere, torus};
    use crate::kernels::geometry::topology::Topology;

    #[test]
    fn a_filled_surface_is_closed_and_oriented_again() {
        for (mesh, genus) in [(icosphere(2), 0), (torus(2.0, 0.5, 12, 8), 1)] {
            let hub = mesh.faces()[mesh.n_faces() / 2][0];
            let mut faces = mesh.faces().to_vec();
            faces.retain(|it| !it.contains(&hub));
            faces.remove(0);
            assert_eq!(fill_holes(mesh.vertices(), &mut faces, 2), 0);
            assert_eq!(fill_holes(mesh.vertices(), &mut faces, 6), 2);
            let filled = TriMesh::new(mesh.vertices().to_vec(), faces).unwrap();
            let facts = Topology::of(&filled);
            assert!(facts.is_closed && facts.is_oriented && facts.is_manifold());
            assert_eq!((facts.genus, facts.n_unreferenced), (Some(genus), 1));
        }
    }

    #[test]
    fn a_flat_hole_is_filled_with_its_own_area() {
        let rim = [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [1.0, 0.5], [0.0, 2.0]];
        let vertices: Vec<Vec3> = rim.iter().map(|it| Vec3::new(it[0], it[1], 0.0)).collect();
        let faces =
            least_area_triangulation(&vertices, &[0, 1, 2, 3, 4], &BTreeSet::new()).unwrap();
        let mesh = TriMesh::new(vertices, faces).unwrap();
        assert!((mesh.area() - 2.5).abs() < 1e-12, "not convex: a fan would cover more");
    }

    #[test]
    fn no_edge_gets_a_third_face() {
        // The square hole's diagonal 0-2 is an edge of the roof already, 1-3 is free.
        let rim = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let mut vertices: Vec<Vec3> = rim.iter().map(|it| Vec3::new(it[0], it[1], 0.0)).collect();
        vertices[1].z = 0.2;
        let known = BTreeSet::from([[0, 2]]);
        let faces = least_area_triangulation(&vertices, &[0, 1, 2, 3], &known).unwrap();
        assert!(faces.iter().all(|it| it.contains(&1) && it.contains(&3)), "{faces:?}");
        let known = BTreeSet::from([[0, 2], [1, 3]]);
        assert_eq!(least_area_triangulation(&vertices, &[0, 1, 2, 3], &known), None);
    }
}
