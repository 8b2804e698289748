//! Triangles that move, in trees of boxes that are refitted.

use crate::kernels::geometry::mesh::Vec3;

/// A hierarchy of triangles whose shape stays while they move.
pub struct GroupTree {
    /// In the order of the leaves.
    faces: Vec<[u32; 3]>,
    /// A node's lower half is the next one, its upper half is named; 0 for leaves.
    nodes: Vec<Node>,
}

struct Node {
    begin: u32,
    end: u32,
    upper: u32,
}

/// A box.
#[derive(Clone, Copy)]
pub struct Bounds {
    low: Vec3,
    high: Vec3,
}

/// A tree, its points, and the boxes of its nodes.
type Posed<'a> = (&'a GroupTree, &'a [Vec3], &'a [Bounds]);

/// The most triangles of a leaf.
const LEAF: usize = 4;

/// How far an edge may be outside a triangle, in shares of its sides, and still cross it.
const SLACK: f64 = 1e-9;

impl GroupTree {
    pub fn new(mut faces: Vec<[u32; 3]>, points: &[Vec3]) -> Self {
        let mut nodes = Vec::new();
        if !faces.is_empty() {
            let n_faces = faces.len();
            build(&mut faces, points, [0, n_faces], &mut nodes);
        }
        Self { faces, nodes }
    }

    /// Computes the boxes of all nodes; children come after their parents.
    pub fn refit(&self, points: &[Vec3], bounds: &mut Vec<Bounds>) {
        let none =
            Bounds { low: Vec3::repeat(f64::INFINITY), high: Vec3::repeat(f64::NEG_INFINITY) };
        bounds.clear();
        bounds.resize(self.nodes.len(), none);
        for (index, node) in self.nodes.iter().enumerate().rev() {
            bounds[index] = if node.upper == 0 {
                let faces = &self.faces[node.begin as usize..node.end as usize];
                faces.iter().flatten().fold(none, |it, &at| {
                    let point = points[at as usize];
                    Bounds { low: it.low.inf(&point), high: it.high.sup(&point) }
                })
            } else {
                let (a, b) = (bounds[index + 1], bounds[node.upper as usize]);
                Bounds { low: a.low.inf(&b.low), high: a.high.sup(&b.high) }
            };
        }
    }
}

impl Bounds {
    fn meets(&self, other: &Self) -> bool {
        (0..3).all(|it| self.low[it] <= other.high[it] && other.low[it] <= self.high[it])
    }
}

/// Whether any triangles of two trees cross.
pub fn are_crossing(a: Posed<'_>, b: Posed<'_>) -> bool {
    visit(a, b, true) > 0
}

/// How many pairs of triangles of two trees cross.
pub fn n_crossings(a: Posed<'_>, b: Posed<'_>) -> usize {
    visit(a, b, false)
}

fn visit(a: Posed<'_>, b: Posed<'_>, only_first: bool) -> usize {
    let ((tree_a, points_a, bounds_a), (tree_b, points_b, bounds_b)) = (a, b);
    let mut count = 0;
    let mut stack = vec![(0_usize, 0_usize)];
    if bounds_a.is_empty() || bounds_b.is_empty() {
        return 0;
    }
    while let Some((i, j)) = stack.pop() {
        let (box_a, box_b) = (&bounds_a[i], &bounds_b[j]);
        if !box_a.meets(box_b) {
            continue;
        }
        let (node_a, node_b) = (&tree_a.nodes[i], &tree_b.nodes[j]);
        let size = |it: &Node| it.end - it.begin;
        if node_a.upper != 0 && (node_b.upper == 0 || size(node_a) >= size(node_b)) {
            stack.extend([(i + 1, j), (node_a.upper as usize, j)]);
            continue;
        }
        if node_b.upper != 0 {
            stack.extend([(i, j + 1), (i, node_b.upper as usize)]);
            continue;
        }
        for face_a in &tree_a.faces[node_a.begin as usize..node_a.end as usize] {
            let corners_a = face_a.map(|it| points_a[it as usize]);
            for face_b in &tree_b.faces[node_b.begin as usize..node_b.end as usize] {
                if triangles_cross(&corners_a, &face_b.map(|it| points_b[it as usize])) {
                    count += 1;
                    if only_first {
                        return count;
                    }
                }
            }
        }
    }
    count
}

/// Whether an edge of one triangle passes through the other. Parallel triangles do not cross.
fn triangles_cross(a: &[Vec3; 3], b: &[Vec3; 3]) -> bool {
    if is_beside(a, b) || is_beside(b, a) {
        return false;
    }
    let passes = |from: &[Vec3; 3], through: &[Vec3; 3]| {
        (0..3).any(|it| edge_crosses(&from[it], &from[(it + 1) % 3], through))
    };
    passes(a, b) || passes(b, a)
}

/// Whether all of a triangle is on one side of the other's plane.
fn is_beside(a: &[Vec3; 3], b: &[Vec3; 3]) -> bool {
    let normal = (b[1] - b[0]).cross(&(b[2] - b[0]));
    let [x, y, z] = a.map(|it| normal.dot(&(it - b[0])));
    (x > 0.0 && y > 0.0 && z > 0.0) || (x < 0.0 && y < 0.0 && z < 0.0)
}

/// Whether a segment passes through a triangle (Möller & Trumbore 1997).
fn edge_crosses(from: &Vec3, to: &Vec3, [a, b, c]: &[Vec3; 3]) -> bool {
    let direction = to - from;
    let (ab, ac) = (b - a, c - a);
    let cross = direction.cross(&ac);
    let determinant = ab.dot(&cross);
    if determinant == 0.0 {
        return false;
    }
    let offset = from - a;
    let u = offset.dot(&cross) / determinant;
    let other = offset.cross(&ab);
    let v = direction.dot(&other) / determinant;
    let along = ac.dot(&other) / determinant;
    u >= -SLACK && v >= -SLACK && u + v <= 1.0 + SLACK && (0.0..=1.0).contains(&along)
}

/// Appends the node of a range of faces, and what is below it.
fn build(faces: &mut [[u32; 3]], points: &[Vec3], [begin, end]: [usize; 2], nodes: &mut Vec<Node>) {
    let own = nodes.len();
    nodes.push(Node { begin: begin as u32, end: end as u32, upper: 0 });
    if end - begin <= LEAF {
        return;
    }
    let center = |face: &[u32; 3]| face.iter().map(|&it| points[it as usize]).sum::<Vec3>();
    let first = center(&faces[begin]);
    let (low, high) = faces[begin..end].iter().fold((first, first), |(low, high), it| {
        let at = center(it);
        (low.inf(&at), high.sup(&at))
    });
    let axis = (high - low).imax();
    let middle = (end - begin) / 2;
    faces[begin..end].select_nth_unstable_by(middle, |a, b| {
        center(a)[axis].total_cmp(&center(b)[axis]).then(a.cmp(b))
    });
    build(faces, points, [begin, begin + middle], nodes);
    nodes[own].upper = nodes.len() as u32;
    build(faces, points, [begin + middle, end], nodes);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::mesh::TriMesh;
    use crate::kernels::geometry::shapes::bumpy_sphere;
    use crate::kernels::numerics::random::Random;

    fn moved(mesh: &TriMesh, by: Vec3) -> Vec<Vec3> {
        mesh.vertices().iter().map(|it| it + by).collect()
    }

    /// The trees are built in one place and used in another; every pair of triangles is tried.
    #[test]
    fn crossings_are_those_of_all_pairs() {
        let mesh = bumpy_sphere(5);
        let tree = GroupTree::new(mesh.faces().to_vec(), mesh.vertices());
        let mut random = Random::new(5);
        for round in 0..12 {
            let by = Vec3::from_fn(|_, _| random.between(-2.0, 2.0)) * f64::from(round % 4);
            let (a, b) = (mesh.vertices().to_vec(), moved(&mesh, by + Vec3::x() * 0.1));
            let (mut bounds_a, mut bounds_b) = (Vec::new(), Vec::new());
            tree.refit(&a, &mut bounds_a);
            tree.refit(&b, &mut bounds_b);
            let corners = |face: &[u32; 3], of: &[Vec3]| face.map(|it| of[it as usize]);
            let faces = mesh.faces();
            let expected = faces.iter().map(|face| {
                let own = corners(face, &a);
                faces.iter().filter(|it| triangles_cross(&own, &corners(it, &b))).count()
            });
            let expected: usize = expected.sum();
            let (a, b) = ((&tree, &a[..], &bounds_a[..]), (&tree, &b[..], &bounds_b[..]));
            assert_eq!(n_crossings(a, b), expected);
            assert_eq!(are_crossing(a, b), expected > 0);
            assert!(round > 0 || expected > 0, "a sphere moved a little crosses itself");
        }
    }

    #[test]
    fn triangles_cross_if_an_edge_passes() {
        let floor = [Vec3::zeros(), Vec3::x(), Vec3::z()];
        let wall = |at: f64, height: f64| {
            [[at, height, at], [at + 0.1, height, at], [at, height + 1.0, at]].map(Vec3::from)
        };
        assert!(triangles_cross(&floor, &wall(0.2, -0.5)));
        assert!(!triangles_cross(&floor, &wall(0.2, 0.1)));
        assert!(!triangles_cross(&floor, &wall(0.8, -0.5)));
        assert!(!triangles_cross(&floor, &floor.map(|it| it + Vec3::y())));
    }
}
