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
/// places are taken.
pub fn farthest_points(positions: &[Vec3], count: usize) -> Spread {
    let mut chosen = Vec::with_capacity(count.min(positions.len()));
    let mut distances = vec![f64::INFINITY; positions.len()];
    let mut cells = vec![0; positions.len()];
    let mut next = 0;
    while chosen.len() < count.min(positions.len()) && distances[next] > 0.0 {
        let (cell, place) = (chosen.len() as u32, positions[next]);
        chosen.push(next as u32);
        let mut farthest = -1.0;
        for (vertex, position) in positions.iter().enumerate() {
            let distance = (position - place).norm_squared();
            if distance < distances[vertex] {
                distances[vertex] = distance;
                cells[vertex] = cell;
            }
            if distances[vertex] > farthest {
                (next, farthest) = (vertex, distances[vertex]);
            }
        }
    }
    Spread { chosen, cells }
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

    #[test]
    fn a_place_is_chosen_once() {
        let places = [Vec3::zeros(), Vec3::x(), Vec3::zeros(), Vec3::x()];
        assert_eq!(farthest_points(&places, 4).chosen, [0, 1]);
        assert_eq!(farthest_points(&[], 4).chosen, [0; 0]);
    }
}
