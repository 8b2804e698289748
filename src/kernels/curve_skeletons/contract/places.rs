//! Points without those that are at the place of another.

use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::geometry::point_tree::PointTree;

/// The different places among points.
pub struct Places {
    pub positions: Vec<Vec3>,
    pub place_of_point: Vec<u32>,
}

/// Points nearer than this share of the longest side of their box are at one place.
const SAME: f64 = 1e-7;

impl Places {
    /// A point is at the place of the first point that is near enough and has a place of its own.
    pub fn of(points: &[Vec3]) -> Self {
        let first = points[0];
        let (low, high) = points.iter().fold((first, first), |it, p| (it.0.inf(p), it.1.sup(p)));
        let radius = SAME * (high - low).max();
        let tree = PointTree::new(points);
        let mut place_of_point = vec![u32::MAX; points.len()];
        let mut positions = Vec::with_capacity(points.len());
        let mut found = Vec::new();
        for (point, &position) in points.iter().enumerate() {
            if place_of_point[point] != u32::MAX {
                continue;
            }
            let place = positions.len() as u32;
            positions.push(position);
            tree.within(position, radius, &mut found);
            for &(_, other) in &found {
                let other = &mut place_of_point[other as usize];
                *other = (*other).min(place);
            }
        }
        Self { positions, place_of_point }
    }

    /// From places to points.
    pub fn spread<T: Copy>(&self, of_places: &[T]) -> Vec<T> {
        self.place_of_point.iter().map(|&it| of_places[it as usize]).collect()
    }
}
