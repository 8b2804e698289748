//! Vertices spread over a shape.

use super::mesh::Vec3;

/// Vertices spread over a shape, and which of them is nearest to every vertex.
#[derive(Debug, Clone, PartialEq)]
pub struct Spread {
    pub chosen: Vec<u32>,
    /// For every vertex the index in `chosen`, by Euclidean distance.
    pub cells: Vec<u32>,
}

impl Spread {
    /// The sum of the values in every cell.
    pub fn sums(&self, values: &[f64]) -> Vec<f64> {
        let mut sums = vec![0.0; self.chosen.len()];
        for (&cell, value) in self.cells.iter().zip(values) {
            sums[cell as usize] += value;
        }
        sums
    }
}

/// Chooses vertices, each the farthest by Euclidean distance from those before.
///
/// The first is vertex 0; ties go to the smallest index. Fewer than `count` are returned if all other
/// places are taken. Vertices lie in small boxes, of which those are passed over that a new vertex
/// cannot be near enough to.
pub fn farthest_points(positions: &[Vec3], count: usize) -> Spread {
    let mut spread = Spread { chosen: Vec::new(), cells: vec![0; positions.len()] };
    let mut boxes = Vec::new();
    let mut order: Vec<u32> = (0..positions.len() as u32).collect();
    split(positions, &mut order, &mut boxes);
    let mut next = Farthest { vertex: 0, distance: f64::INFINITY };
    while spread.chosen.len() < count.min(positions.len()) && next.distance > 0.0 {
        let (cell, place) = (spread.chosen.len() as u32, positions[next.vertex as usize]);
        spread.chosen.push(next.vertex);
        next = Farthest::NONE;
        for it in &mut boxes {
            if it.distance_squared(&place) < it.farthest.distance {
                it.take(&place, cell, &mut spread.cells);
            }
            next = next.or(it.farthest);
        }
    }
    spread
}

/// Vertices in a box.
const BOX: usize = 64;

struct Box3 {
    low: Vec3,
    high: Vec3,
    /// Vertices and places, ascending.
    members: Vec<(u32, Vec3)>,
    /// Squared distances from the nearest chosen vertex.
    distances: Vec<f64>,
    farthest: Farthest,
}

#[derive(Debug, Clone, Copy)]
struct Farthest {
    vertex: u32,
    /// Squared.
    distance: f64,
}

impl Farthest {
    const NONE: Self = Self { vertex: u32::MAX, distance: -1.0 };

    /// The farther one; of equally far ones the one with the smaller index.
    fn or(self, other: Self) -> Self {
        let is_first = other.distance == self.distance && other.vertex < self.vertex;
        if other.distance > self.distance || is_first { other } else { self }
    }
}

impl Box3 {
    fn new(positions: &[Vec3], members: &[u32]) -> Self {
        let mut members = members.to_vec();
        members.sort_unstable();
        let members: Vec<(u32, Vec3)> =
            members.into_iter().map(|it| (it, positions[it as usize])).collect();
        let (low, high) = bounds(members.iter().map(|it| &it.1));
        let distances = vec![f64::INFINITY; members.len()];
        let farthest = Farthest { vertex: members[0].0, distance: f64::INFINITY };
        Self { low, high, members, distances, farthest }
    }

    /// No vertex of the box is nearer to a place.
    fn distance_squared(&self, place: &Vec3) -> f64 {
        (self.low - place).sup(&(place - self.high)).sup(&Vec3::zeros()).norm_squared()
    }

    /// Gives the vertices that are nearer to a new place than to those before to its cell.
    fn take(&mut self, place: &Vec3, cell: u32, cells: &mut [u32]) {
        self.farthest = Farthest::NONE;
        for ((vertex, position), distance) in self.members.iter().zip(&mut self.distances) {
            let found = (position - place).norm_squared();
            if found < *distance {
                *distance = found;
                cells[*vertex as usize] = cell;
            }
            self.farthest = self.farthest.or(Farthest { vertex: *vertex, distance: *distance });
        }
    }
}

fn bounds<'a>(mut places: impl Iterator<Item = &'a Vec3>) -> (Vec3, Vec3) {
    let first = *places.next().expect("a box has members");
    places.fold((first, first), |(low, high), it| (low.inf(it), high.sup(it)))
}

/// Halves vertices along the longest side of their box until boxes are small.
fn split(positions: &[Vec3], order: &mut [u32], boxes: &mut Vec<Box3>) {
    if order.is_empty() {
        return;
    }
    if order.len() <= BOX {
        boxes.push(Box3::new(positions, order));
        return;
    }
    let (low, high) = bounds(order.iter().map(|&it| &positions[it as usize]));
    let axis = (high - low).imax();
    let middle = order.len() / 2;
    order.select_nth_unstable_by(middle, |&a, &b| {
        positions[a as usize][axis].total_cmp(&positions[b as usize][axis]).then(a.cmp(&b))
    });
    let (lower, upper) = order.split_at_mut(middle);
    split(positions, lower, boxes);
    split(positions, upper, boxes);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_on_a_line_are_halved() {
        let line: Vec<Vec3> = (0..9).map(|it| Vec3::x() * f64::from(it)).collect();
        let spread = farthest_points(&line, 5);
        assert_eq!(spread.chosen, [0, 8, 4, 2, 6]);
        assert_eq!(spread.cells, [0, 0, 3, 2, 2, 2, 4, 1, 1]);
        assert_eq!(spread.sums(&[1.0; 9]), [2.0, 2.0, 3.0, 1.0, 1.0]);
    }

    /// The definition, without boxes.
    fn one_by_one(positions: &[Vec3], count: usize) -> Vec<u32> {
        let mut chosen = vec![0u32];
        while chosen.len() < count {
            let distance = |it: &u32| {
                let gap = |other: &u32| positions[*it as usize] - positions[*other as usize];
                chosen.iter().map(|it| gap(it).norm_squared()).fold(f64::INFINITY, f64::min)
            };
            let all: Vec<f64> = (0..positions.len() as u32).map(|it| distance(&it)).collect();
            let most = all.iter().copied().fold(0.0, f64::max);
            chosen.push(all.iter().position(|it| *it == most).unwrap() as u32);
        }
        chosen
    }

    #[test]
    fn boxes_change_nothing() {
        let sphere = crate::kernels::geometry::shapes::geodesic_sphere(9);
        let spread = farthest_points(sphere.vertices(), 120);
        assert_eq!(spread.chosen, one_by_one(sphere.vertices(), 120));
        let place = |it: u32| sphere.vertices()[it as usize];
        for (vertex, &cell) in spread.cells.iter().enumerate() {
            let far = |it: u32| (place(it) - sphere.vertices()[vertex]).norm_squared();
            let own = far(spread.chosen[cell as usize]);
            assert!(spread.chosen.iter().all(|&it| far(it) >= own));
        }
    }

    #[test]
    fn a_place_is_chosen_once() {
        let places = [Vec3::zeros(), Vec3::x(), Vec3::zeros(), Vec3::x()];
        assert_eq!(farthest_points(&places, 4).chosen, [0, 1]);
        assert_eq!(farthest_points(&[], 4).chosen, [0; 0]);
    }
}
