//! Vertices that lie on each other become one.

use std::collections::BTreeMap;

use super::Repair;
use crate::kernels::geometry::mesh::Vec3;

impl Repair {
    pub(super) fn weld(&mut self, tolerance: f64) {
        let mut is_referenced = vec![false; self.vertices.len()];
        self.faces.iter().flatten().for_each(|&it| is_referenced[it as usize] = true);
        self.welded = weld_targets(&self.vertices, &is_referenced, tolerance);
        for face in &mut self.faces {
            *face = face.map(|vertex| self.welded[vertex as usize]);
        }
        let joined = self.welded.iter().enumerate().filter(|(from, to)| *from != **to as usize);
        self.report.n_welded_vertices = joined.count();
    }
}

/// For every vertex, the first vertex within the tolerance that is itself joined to no other.
///
/// Only referenced vertices count for the bounding box: strays are often far away.
fn weld_targets(vertices: &[Vec3], is_referenced: &[bool], tolerance: f64) -> Vec<u32> {
    let referenced = || vertices.iter().zip(is_referenced).filter(|it| *it.1).map(|it| it.0);
    let Some(first) = referenced().next() else {
        return (0..vertices.len() as u32).collect();
    };
    let (low, high) = referenced().fold((*first, *first), |(l, h), it| (l.inf(it), h.sup(it)));
    let radius = tolerance * (high - low).norm();
    // With no tolerance, any cell size does: equal points share a cell.
    let cell_size =
        if radius > 0.0 { radius } else { f64::MIN_POSITIVE.max((high - low).max() * 1e-6) };
    let cell_of = |point: &Vec3| ((point - low) / cell_size).map(f64::floor);
    let reach = if radius > 0.0 { 1 } else { 0 };
    let mut cells: BTreeMap<[i64; 3], Vec<u32>> = BTreeMap::new();
    let mut targets: Vec<u32> = (0..vertices.len() as u32).collect();
    for (vertex, point) in vertices.iter().enumerate().filter(|it| is_referenced[it.0]) {
        let cell = cell_of(point);
        let key = [cell.x as i64, cell.y as i64, cell.z as i64];
        let near = neighbour_cells(key, reach)
            .filter_map(|it| cells.get(&it))
            .flatten()
            .filter(|&&it| (vertices[it as usize] - point).norm() <= radius)
            .min();
        match near {
            Some(&target) => targets[vertex] = target,
            None => cells.entry(key).or_default().push(vertex as u32),
        }
    }
    targets
}

fn neighbour_cells([x, y, z]: [i64; 3], reach: i64) -> impl Iterator<Item = [i64; 3]> {
    let around = -reach..=reach;
    around.clone().flat_map(move |dx| {
        let around = around.clone();
        around.clone().flat_map(move |dy| around.clone().map(move |dz| [x + dx, y + dy, z + dz]))
    })
}
