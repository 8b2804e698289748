//! Triangles in a tree of boxes: nearest points, and what a line meets first.

use super::mesh::{TriMesh, Vec3};
use super::triangle::closest_on_triangle;

/// The faces of a mesh in a bounding volume hierarchy, for exact queries.
///
/// Of faces at the same distance, the one with the smaller index is taken, so answers do not depend
/// on how the tree was built.
#[derive(Debug, Clone)]
pub struct TriangleTree {
    /// Corners of the faces in the order of the leaves.
    pub(super) triangles: Vec<[Vec3; 3]>,
    /// The index in the mesh of every one of them.
    faces: Vec<u32>,
    pub(super) nodes: Vec<Node>,
}

/// A box around the triangles `begin..end`; the lower half of an inner node is the next node, the
/// upper half the one with the index `upper`. Leaves have `upper = 0`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Node {
    low: Vec3,
    high: Vec3,
    pub begin: u32,
    pub end: u32,
    pub upper: u32,
}

/// The point of a surface that is nearest to a place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nearest {
    pub face: u32,
    pub point: Vec3,
    /// The squared distance.
    pub square: f64,
}

/// Where a line meets a face.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    pub face: u32,
    /// The place, in lengths of the line's direction from its start.
    pub along: f64,
}

/// The most triangles of a leaf.
const LEAF: usize = 4;

impl TriangleTree {
    /// Sorts the faces of a mesh into a tree.
    ///
    /// # Panics
    /// If the mesh has no faces.
    pub fn new(mesh: &TriMesh) -> Self {
        assert!(mesh.n_faces() > 0, "a tree of triangles needs a triangle");
        let corners: Vec<[Vec3; 3]> = (0..mesh.n_faces()).map(|it| mesh.corners(it)).collect();
        let centers: Vec<Vec3> = corners.iter().map(|[a, b, c]| (a + b + c) / 3.0).collect();
        let mut faces: Vec<u32> = (0..mesh.n_faces() as u32).collect();
        let mut nodes = Vec::with_capacity(2 * faces.len() / LEAF + 1);
        build(&corners, &centers, &mut faces, 0, &mut nodes);
        let triangles = faces.iter().map(|&it| corners[it as usize]).collect();
        Self { triangles, faces, nodes }
    }

    /// Finds the point of the surface that is nearest to a place.
    pub fn nearest(&self, place: Vec3) -> Nearest {
        self.nearest_within(place, f64::INFINITY).expect("there is a triangle")
    }

    /// Finds the nearest point if its squared distance is at most `bound`.
    pub fn nearest_within(&self, place: Vec3, bound: f64) -> Option<Nearest> {
        let mut best: Option<Nearest> = None;
        let mut bound = bound;
        let mut stack = [(0u32, 0.0f64); 64];
        stack[0] = (0, self.nodes[0].square_distance(&place));
        let mut height = 1;
        while height > 0 {
            height -= 1;
            let (index, square) = stack[height];
            if square > bound {
                continue;
            }
            let node = &self.nodes[index as usize];
            if node.upper == 0 {
                for at in node.begin as usize..node.end as usize {
                    let triangle = &self.triangles[at];
                    let [u, v, w] = closest_on_triangle(&place, triangle);
                    let point = triangle[0] * u + triangle[1] * v + triangle[2] * w;
                    let square = (point - place).norm_squared();
                    let face = self.faces[at];
                    let nearer = best.is_none_or(|it| {
                        square < it.square || (square == it.square && face < it.face)
                    });
                    if square <= bound && nearer {
                        best = Some(Nearest { face, point, square });
                        bound = square;
                    }
                }
                continue;
            }
            let children = [index + 1, node.upper];
            let squares = children.map(|it| self.nodes[it as usize].square_distance(&place));
            let near = usize::from(squares[1] < squares[0]);
            stack[height] = (children[1 - near], squares[1 - near]);
            stack[height + 1] = (children[near], squares[near]);
            height += 2;
        }
        best
    }

    /// Finds where the line `start + along * direction` first meets the surface, for `along` in a
    /// range that includes its ends. Faces are seen from both sides; those parallel to the line are
    /// not met.
    pub fn first_hit(&self, start: Vec3, direction: Vec3, range: [f64; 2]) -> Option<Hit> {
        let [least, mut greatest] = range;
        let inverse = direction.map(|it| 1.0 / it);
        let mut best: Option<Hit> = None;
        let mut stack = [0u32; 64];
        let mut height = 1;
        while height > 0 {
            height -= 1;
            let index = stack[height];
            let node = &self.nodes[index as usize];
            if !node.is_met(&start, &inverse, least, greatest) {
                continue;
            }
            if node.upper != 0 {
                // The half that the line enters first is looked at first.
                let middle = |it: u32| {
                    let it = &self.nodes[it as usize];
                    (it.low + it.high).dot(&direction)
                };
                let children = [index + 1, node.upper];
                let near = usize::from(middle(children[1]) < middle(children[0]));
                stack[height] = children[1 - near];
                stack[height + 1] = children[near];
                height += 2;
                continue;
            }
            for at in node.begin as usize..node.end as usize {
                let Some(along) = meets(&self.triangles[at], &start, &direction) else { continue };
                let face = self.faces[at];
                let nearer =
                    best.is_none_or(|it| along < it.along || (along == it.along && face < it.face));
                if (least..=greatest).contains(&along) && nearer {
                    best = Some(Hit { face, along });
                    greatest = along;
                }
            }
        }
        best
    }

    /// Whether the segment between two places meets the surface.
    pub fn is_crossed(&self, from: Vec3, to: Vec3) -> bool {
        self.first_hit(from, to - from, [0.0, 1.0]).is_some()
    }
}

impl Node {
    fn square_distance(&self, place: &Vec3) -> f64 {
        let outside = (self.low - place).sup(&(place - self.high)).sup(&Vec3::zeros());
        outside.norm_squared()
    }

    /// Whether a line passes through the box (slabs; Kay & Kajiya 1986), a little enlarged against
    /// rounding. A zero component of the direction makes infinities that come out right, or no
    /// numbers for lines along a side, which count as passing.
    fn is_met(&self, start: &Vec3, inverse: &Vec3, least: f64, greatest: f64) -> bool {
        let (mut enter, mut leave) = (least, greatest);
        for axis in 0..3 {
            let near = (self.low[axis] - start[axis]) * inverse[axis];
            let far = (self.high[axis] - start[axis]) * inverse[axis];
            if near.is_nan() || far.is_nan() {
                continue;
            }
            enter = enter.max(near.min(far));
            leave = leave.min(near.max(far));
        }
        // Of the smaller one: beside a box, along one of its sides, a line enters at infinity.
        let slack = 2e-12 * enter.abs().min(leave.abs());
        enter <= leave + slack
    }
}

/// Where a line meets a triangle (Möller & Trumbore 1997), if it does.
fn meets(triangle: &[Vec3; 3], start: &Vec3, direction: &Vec3) -> Option<f64> {
    let [a, b, c] = triangle;
    let (ab, ac) = (b - a, c - a);
    let cross = direction.cross(&ac);
    let determinant = ab.dot(&cross);
    if determinant == 0.0 {
        return None;
    }
    let offset = start - a;
    let u = offset.dot(&cross) / determinant;
    let other = offset.cross(&ab);
    let v = direction.dot(&other) / determinant;
    // Lines through an edge meet at least one of its faces in spite of rounding.
    const EDGE: f64 = 1e-12;
    let inside = u >= -EDGE && v >= -EDGE && u + v <= 1.0 + EDGE;
    let along = ac.dot(&other) / determinant;
    (inside && along.is_finite()).then_some(along)
}

/// Appends the node of a range of triangles, and what is below it.
fn build(
    corners: &[[Vec3; 3]],
    centers: &[Vec3],
    faces: &mut [u32],
    begin: usize,
    nodes: &mut Vec<Node>,
) {
    let points = faces.iter().flat_map(|&it| corners[it as usize]);
    let first = corners[faces[0] as usize][0];
    let (low, high) = points.fold((first, first), |(lo, hi), it| (lo.inf(&it), hi.sup(&it)));
    let own = nodes.len();
    let end = (begin + faces.len()) as u32;
    nodes.push(Node { low, high, begin: begin as u32, end, upper: 0 });
    if faces.len() <= LEAF {
        return;
    }
    let first = centers[faces[0] as usize];
    let (low, high) = faces.iter().fold((first, first), |(lo, hi), &it| {
        (lo.inf(&centers[it as usize]), hi.sup(&centers[it as usize]))
    });
    let axis = (high - low).imax();
    let middle = faces.len() / 2;
    faces.select_nth_unstable_by(middle, |&a, &b| {
        centers[a as usize][axis].total_cmp(&centers[b as usize][axis]).then(a.cmp(&b))
    });
    let (lower, upper) = faces.split_at_mut(middle);
    build(corners, centers, lower, begin, nodes);
    nodes[own].upper = nodes.len() as u32;
    build(corners, centers, upper, begin + middle, nodes);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes::{bumpy_sphere, torus};
    use crate::kernels::numerics::random::Random;

    fn places(count: usize) -> Vec<Vec3> {
        let mut random = Random::new(7);
        (0..count).map(|_| Vec3::from_fn(|_, _| random.between(-2.5, 2.5))).collect()
    }

    #[test]
    fn the_nearest_point_is_that_of_all_faces() {
        for mesh in [bumpy_sphere(8), torus(1.0, 0.3, 30, 12)] {
            let tree = TriangleTree::new(&mesh);
            for place in places(200) {
                let all = (0..mesh.n_faces()).map(|face| {
                    let corners = mesh.corners(face);
                    let [u, v, w] = closest_on_triangle(&place, &corners);
                    let point = corners[0] * u + corners[1] * v + corners[2] * w;
                    Nearest { face: face as u32, point, square: (point - place).norm_squared() }
                });
                let expected = all
                    .min_by(|a, b| a.square.total_cmp(&b.square).then(a.face.cmp(&b.face)))
                    .unwrap();
                assert_eq!(tree.nearest(place), expected);
                assert_eq!(tree.nearest_within(place, 0.99 * expected.square), None);
            }
        }
    }

    #[test]
    fn the_first_hit_is_that_of_all_faces() {
        for mesh in [bumpy_sphere(8), torus(1.0, 0.3, 30, 12)] {
            let tree = TriangleTree::new(&mesh);
            let places = places(400);
            for ends in places.chunks(2) {
                let (start, direction) = (ends[0], ends[1] - ends[0]);
                let all = (0..mesh.n_faces()).filter_map(|face| {
                    let along = meets(&mesh.corners(face), &start, &direction)?;
                    Some(Hit { face: face as u32, along })
                });
                let expected = all
                    .filter(|it| (0.0..=1.0).contains(&it.along))
                    .min_by(|a, b| a.along.total_cmp(&b.along).then(a.face.cmp(&b.face)));
                assert_eq!(tree.first_hit(start, direction, [0.0, 1.0]), expected);
                assert_eq!(tree.is_crossed(ends[0], ends[1]), expected.is_some());
            }
        }
    }

    #[test]
    fn a_line_along_an_axis_passes_by_the_boxes_beside_it() {
        let (low, high) = (Vec3::zeros(), Vec3::repeat(1.0));
        let node = Node { low, high, begin: 0, end: 0, upper: 0 };
        let inverse = Vec3::x().map(|it| 1.0 / it);
        for (y, expected) in [(-0.5, false), (0.0, true), (0.5, true), (1.0, true), (1.5, false)] {
            for greatest in [5.0, f64::INFINITY] {
                let start = Vec3::new(-1.0, y, 0.5);
                assert_eq!(node.is_met(&start, &inverse, 0.0, greatest), expected, "{y}");
            }
        }
    }

    /// Rays along an axis have directions with zeros, and edges that lie in their planes.
    #[test]
    fn a_ray_along_an_axis_leaves_a_torus() {
        let tree = TriangleTree::new(&torus(1.0, 0.25, 64, 32));
        let hit = tree.first_hit(Vec3::x(), Vec3::x(), [0.0, f64::INFINITY]).unwrap();
        assert!((hit.along - 0.25).abs() < 1e-3, "{}", hit.along);
        let hit = tree.first_hit(Vec3::zeros(), Vec3::x(), [0.0, f64::INFINITY]).unwrap();
        assert!((hit.along - 0.75).abs() < 1e-3, "{}", hit.along);
        assert_eq!(tree.first_hit(Vec3::zeros(), Vec3::y(), [0.0, f64::INFINITY]), None);
    }
}
