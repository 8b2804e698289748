//! Minimum spanning trees.

use super::topology::DisjointSets;

/// The edges of a minimum spanning tree of `n` nodes (Kruskal 1956), the cheapest first, from pairs of nodes
/// with their costs; ties go to smaller indices. Parts that no pair joins stay apart.
///
/// # Panics
/// If a pair names a node that there is not.
pub fn spanning_tree(n: usize, mut pairs: Vec<(f64, usize, usize)>) -> Vec<(usize, usize)> {
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    let mut sets = DisjointSets::new(n);
    let mut edges = Vec::new();
    for (_, a, b) in pairs {
        if sets.find(a) != sets.find(b) {
            sets.join(a, b);
            edges.push((a, b));
        }
    }
    edges
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cheapest_pairs_join_all_that_can_be_joined() {
        let pairs = vec![(3.0, 0, 1), (1.0, 1, 2), (2.0, 0, 2), (1.0, 3, 4), (1.0, 0, 2)];
        assert_eq!(spanning_tree(6, pairs), [(0, 2), (1, 2), (3, 4)]);
        assert!(spanning_tree(3, vec![]).is_empty());
    }
}
