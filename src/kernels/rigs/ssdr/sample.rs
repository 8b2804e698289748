//! A few vertices that stand for all.

use std::collections::VecDeque;

use crate::kernels::numerics::random::Random;

/// Some vertices, and which of them is near on the surface to every vertex.
pub struct Sample {
    /// Ascending.
    pub vertices: Vec<u32>,
    /// An index in `vertices` for every vertex; `u32::MAX` if no path leads to one.
    pub owner: Vec<u32>,
    /// Pairs of indices: what two vertices own meets there.
    pub edges: Vec<(u32, u32)>,
}

/// Draws vertices, always the same ones.
///
/// Every so many-th would be all along one line of a regular mesh.
pub fn sample(n_vertices: usize, edges: &[(u32, u32)], n_wanted: usize) -> Sample {
    let mut vertices: Vec<u32> = (0..n_vertices as u32).collect();
    Random::stream(0, "ssdr").shuffle(&mut vertices);
    vertices.truncate(n_wanted);
    vertices.sort_unstable();
    let mut neighbours = vec![Vec::new(); n_vertices];
    for &(a, b) in edges {
        neighbours[a as usize].push(b);
        neighbours[b as usize].push(a);
    }
    let mut owner = vec![u32::MAX; n_vertices];
    for (index, &vertex) in (0..).zip(&vertices) {
        owner[vertex as usize] = index;
    }
    let mut queue = VecDeque::from(vertices.clone());
    while let Some(vertex) = queue.pop_front() {
        for &other in &neighbours[vertex as usize] {
            if owner[other as usize] == u32::MAX {
                owner[other as usize] = owner[vertex as usize];
                queue.push_back(other);
            }
        }
    }
    let owners = |&(a, b): &(u32, u32)| (owner[a as usize], owner[b as usize]);
    let mut edges: Vec<(u32, u32)> = edges
        .iter()
        .map(owners)
        .filter(|(a, b)| a != b)
        .map(|(a, b)| (a.min(b), a.max(b)))
        .collect();
    edges.sort_unstable();
    edges.dedup();
    Sample { vertices, owner, edges }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_vertex_with_a_path_to_the_sample_has_a_near_owner() {
        // A path of 100 vertices, and 20 without edges.
        let edges: Vec<(u32, u32)> = (0..99).map(|it| (it, it + 1)).collect();
        let res = sample(120, &edges, 30);
        assert_eq!(res.vertices.len(), 30);
        let on_path: Vec<u32> = res.vertices.iter().copied().filter(|&it| it < 100).collect();
        for vertex in 0..100_u32 {
            let far = |it: &u32| it.abs_diff(vertex);
            let owner = res.vertices[res.owner[vertex as usize] as usize];
            assert_eq!(Some(far(&owner)), on_path.iter().map(far).min());
        }
        // Regions on a path meet their neighbours only.
        let expected: Vec<(u32, u32)> = (1..on_path.len() as u32).map(|it| (it - 1, it)).collect();
        assert_eq!(res.edges, expected);
        for vertex in 100..120 {
            assert_eq!(res.owner[vertex] == u32::MAX, !res.vertices.contains(&(vertex as u32)));
        }
        // More than there are: all.
        assert_eq!(sample(120, &edges, 1000).vertices.len(), 120);
    }
}
