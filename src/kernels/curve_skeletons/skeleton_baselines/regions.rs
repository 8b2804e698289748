//! Connected parts of a surface with one label each.

use std::collections::BTreeMap;

use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::geometry::point_tree::PointTree;

use super::k_means::by_first;

/// Splits labels into connected regions, and merges those with less than a share of the vertices into
/// the neighbour with the longest common border, or into the region that is nearest at rest if they
/// have no neighbour. Without faces nothing is split.
///
/// Regions are numbered by their first vertices.
pub fn regions(rest: &[Vec3], faces: &[[u32; 3]], labels: &[u32], least_share: f64) -> Vec<u32> {
    let edges = edges(faces);
    let mut regions = match faces.is_empty() {
        true => by_first(labels),
        false => split(labels, &edges),
    };
    let least = least_share * rest.len() as f64;
    loop {
        let n = regions.iter().max().map_or(0, |it| *it as usize + 1);
        let mut counts = vec![0_usize; n];
        regions.iter().for_each(|it| counts[*it as usize] += 1);
        let smallest = (0..n).min_by_key(|it| counts[*it]);
        let Some(smallest) = smallest.filter(|it| n > 1 && (counts[*it] as f64) < least) else {
            return regions;
        };
        let own = smallest as u32;
        let into =
            by_border(&regions, &edges, own).unwrap_or_else(|| by_place(rest, &regions, own));
        regions.iter_mut().filter(|it| **it == own).for_each(|it| *it = into);
        regions = by_first(&regions);
    }
}

/// Undirected edges, each once.
fn edges(faces: &[[u32; 3]]) -> Vec<(u32, u32)> {
    let sides = faces.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]);
    let mut edges: Vec<(u32, u32)> = sides.map(|(a, b)| (a.min(b), a.max(b))).collect();
    edges.sort_unstable();
    edges.dedup();
    edges
}

fn split(labels: &[u32], edges: &[(u32, u32)]) -> Vec<u32> {
    let mut roots: Vec<u32> = (0..labels.len() as u32).collect();
    let find = |roots: &mut Vec<u32>, mut it: u32| {
        while roots[it as usize] != it {
            roots[it as usize] = roots[roots[it as usize] as usize];
            it = roots[it as usize];
        }
        it
    };
    for &(a, b) in edges.iter().filter(|it| labels[it.0 as usize] == labels[it.1 as usize]) {
        let (a, b) = (find(&mut roots, a), find(&mut roots, b));
        roots[a.max(b) as usize] = a.min(b);
    }
    let all: Vec<u32> = (0..labels.len() as u32).map(|it| find(&mut roots, it)).collect();
    by_first(&all)
}

fn by_border(regions: &[u32], edges: &[(u32, u32)], own: u32) -> Option<u32> {
    let mut shared: BTreeMap<u32, usize> = BTreeMap::new();
    for &(a, b) in edges {
        let (a, b) = (regions[a as usize], regions[b as usize]);
        if (a == own) != (b == own) {
            *shared.entry(if a == own { b } else { a }).or_default() += 1;
        }
    }
    let longest = shared.values().max()?;
    shared.iter().find(|it| it.1 == longest).map(|it| *it.0)
}

fn by_place(rest: &[Vec3], regions: &[u32], own: u32) -> u32 {
    let others: Vec<usize> = (0..rest.len()).filter(|it| regions[*it] != own).collect();
    let tree = PointTree::new(&others.iter().map(|it| rest[*it]).collect::<Vec<_>>());
    let mut found = Vec::new();
    let nearest = (0..rest.len()).filter(|it| regions[*it] == own).map(|it| {
        tree.nearest(rest[it], 1, &mut found);
        found[0]
    });
    let best = nearest.min_by(|a, b| a.0.total_cmp(&b.0)).expect("regions have vertices");
    regions[others[best.1 as usize]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes;

    #[test]
    fn labels_are_split_and_specks_are_merged() {
        let grid = shapes::rectangle(20, 4, 20.0, 4.0);
        // Label 1 is on both ends, label 2 on one vertex within the middle.
        let mut labels: Vec<u32> = (grid.vertices().iter())
            .map(|it| u32::from(!(5.0..=15.0).contains(&(it.x - grid.bounds().0.x))))
            .collect();
        let speck = labels.iter().position(|it| *it == 0).unwrap() + 2;
        labels[speck] = 2;
        let found = regions(grid.vertices(), grid.faces(), &labels, 0.02);
        assert_eq!(found.iter().max(), Some(&2));
        let kept = regions(grid.vertices(), grid.faces(), &labels, 0.0);
        assert_eq!(kept.iter().max(), Some(&3));
        assert_eq!(found[speck], found[speck + 1]);
    }

    #[test]
    fn an_island_joins_what_is_nearest() {
        let sheet = shapes::rectangle(10, 10, 1.0, 1.0);
        let island = shapes::moved(&shapes::rectangle(1, 1, 0.1, 0.1), Vec3::x() * 1.5);
        let mesh = shapes::union(&sheet, &island);
        let middle = (sheet.bounds().0.x + sheet.bounds().1.x) / 2.0;
        let labels: Vec<u32> =
            mesh.vertices().iter().map(|it| u32::from(it.x > middle + 0.01)).collect();
        let found = regions(mesh.vertices(), mesh.faces(), &labels, 0.1);
        assert_eq!(found.iter().max(), Some(&1));
        let right = (0..sheet.n_vertices()).find(|it| labels[*it] == 1).unwrap();
        assert_eq!(found[mesh.n_vertices() - 1], found[right]);
    }
}
