//! The triangles around every point, and who is joined with whom by them.

use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::geometry::topology::{DisjointSets, is_collapsed};

/// The stars of `n` points. Star triangles have their centre first; those of a mesh are its faces, each
/// in the stars of its three corners, those of a cloud need not fit each other.
#[derive(Debug, Clone)]
pub struct Rings {
    /// Star triangles, by centre.
    pub triangles: Vec<[u32; 3]>,
    /// `n + 1` offsets into `triangles`.
    pub triangle_offsets: Vec<usize>,
    /// The other corners of every star, ascending.
    pub neighbors: Vec<u32>,
    /// `n + 1` offsets into `neighbors`.
    pub offsets: Vec<usize>,
}

impl Rings {
    /// Of star triangles in any order; each has its centre first.
    pub fn new(n_points: usize, mut triangles: Vec<[u32; 3]>) -> Self {
        triangles.sort_unstable();
        triangles.dedup();
        let mut triangle_offsets = vec![0; n_points + 1];
        for triangle in &triangles {
            triangle_offsets[triangle[0] as usize + 1] += 1;
        }
        for point in 0..n_points {
            triangle_offsets[point + 1] += triangle_offsets[point];
        }
        let mut neighbors = Vec::with_capacity(triangles.len());
        let mut offsets = Vec::with_capacity(n_points + 1);
        offsets.push(0);
        let mut own = Vec::new();
        for point in 0..n_points {
            own.clear();
            let star = &triangles[triangle_offsets[point]..triangle_offsets[point + 1]];
            own.extend(star.iter().flat_map(|it| [it[1], it[2]]));
            own.sort_unstable();
            own.dedup();
            neighbors.extend_from_slice(&own);
            offsets.push(neighbors.len());
        }
        Self { triangles, triangle_offsets, neighbors, offsets }
    }

    /// Of the faces of a mesh.
    pub fn of_faces(n_points: usize, faces: &[[u32; 3]]) -> Self {
        let proper = faces.iter().filter(|it| !is_collapsed(it));
        let turned = proper.flat_map(|&[a, b, c]| [[a, b, c], [b, c, a], [c, a, b]]);
        Self::new(n_points, turned.collect())
    }

    pub fn n_points(&self) -> usize {
        self.offsets.len() - 1
    }

    /// The triangles around a point.
    pub fn star(&self, point: usize) -> &[[u32; 3]] {
        &self.triangles[self.triangle_offsets[point]..self.triangle_offsets[point + 1]]
    }

    /// The points around a point, ascending.
    pub fn ring(&self, point: usize) -> &[u32] {
        &self.neighbors[self.offsets[point]..self.offsets[point + 1]]
    }

    /// Every triangle of any star once, corners ascending.
    pub fn all_triangles(&self) -> Vec<[u32; 3]> {
        let mut all = self.triangles.clone();
        all.iter_mut().for_each(|it| it.sort_unstable());
        all.sort_unstable();
        all.dedup();
        all
    }

    /// The points of every connected part of at least `n_least` points, ascending; parts by their
    /// first points.
    pub fn parts(&self, n_least: usize) -> Vec<Vec<u32>> {
        let n_points = self.n_points();
        let mut sets = DisjointSets::new(n_points);
        for [a, b, c] in &self.triangles {
            sets.join(*a as usize, *b as usize);
            sets.join(*b as usize, *c as usize);
        }
        let mut parts: Vec<Vec<u32>> = vec![Vec::new(); n_points];
        for point in 0..n_points {
            parts[sets.find(point)].push(point as u32);
        }
        parts.retain(|it| it.len() >= n_least);
        parts.sort_unstable_by_key(|it| it[0]);
        parts
    }

    /// The stars of a connected part, with its points numbered from 0.
    pub fn part(&self, points: &[u32]) -> Self {
        if points.len() == self.n_points() {
            return self.clone();
        }
        let mut new_of_old = vec![u32::MAX; self.n_points()];
        for (new, &old) in points.iter().enumerate() {
            new_of_old[old as usize] = new as u32;
        }
        let own = points.iter().flat_map(|&it| self.star(it as usize));
        let own = own.map(|it| it.map(|point| new_of_old[point as usize])).collect();
        Self::new(points.len(), own)
    }

    /// The mean over all points of the mean distance from a point to its ring.
    pub fn mean_edge(&self, positions: &[Vec3]) -> f64 {
        let mean = |point: usize| {
            let ring = self.ring(point);
            let lengths = ring.iter().map(|&it| (positions[it as usize] - positions[point]).norm());
            lengths.sum::<f64>() / ring.len().max(1) as f64
        };
        (0..self.n_points()).map(mean).sum::<f64>() / self.n_points().max(1) as f64
    }

    /// The area of all star triangles together.
    pub fn area(&self, positions: &[Vec3]) -> f64 {
        self.triangles.iter().map(|it| area(positions, it)).sum()
    }
}

/// The area of a triangle.
pub fn area(positions: &[Vec3], triangle: &[u32; 3]) -> f64 {
    let [a, b, c] = triangle.map(|it| positions[it as usize]);
    0.5 * (b - a).cross(&(c - a)).norm()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes::{icosphere, moved, union};

    #[test]
    fn every_face_is_in_three_stars() {
        let sphere = icosphere(2);
        let two = union(&sphere, &moved(&sphere, Vec3::x() * 5.0));
        let rings = Rings::of_faces(two.n_vertices(), two.faces());
        assert_eq!(rings.triangles.len(), 3 * two.n_faces());
        assert_eq!(rings.all_triangles().len(), two.n_faces());
        assert!((rings.area(two.vertices()) - 3.0 * two.area()).abs() < 1e-9);
        assert!((0..two.n_vertices()).all(|it| rings.ring(it).len() == rings.star(it).len()));
        let parts = rings.parts(1);
        assert_eq!((parts.len(), parts[1][0] as usize), (2, sphere.n_vertices()));
        let alone = Rings::of_faces(sphere.n_vertices(), sphere.faces());
        assert_eq!(rings.part(&parts[1]).triangles, alone.triangles);
        assert_eq!(rings.parts(1000).len(), 0);
    }
}
