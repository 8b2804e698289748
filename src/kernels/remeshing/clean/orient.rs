//! Faces that agree with their neighbours and face outward.

use std::collections::VecDeque;

use super::Repair;
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::geometry::topology::Edges;

impl Repair {
    /// Turns faces so that neighbours agree, then whole patches so that they face outward.
    ///
    /// A patch is what hangs together by edges of two faces. The sign of its volume, seen from its own
    /// centroid, says whether it faces outward; a patch that is nearly flat keeps the majority's side.
    pub(super) fn orient(&mut self) {
        let edges = Edges::of(&self.faces);
        let edge_of_side = edges.edge_of_side();
        let mut turns: Vec<Option<bool>> = vec![None; self.faces.len()];
        for seed in 0..self.faces.len() {
            if turns[seed].is_some() {
                continue;
            }
            let patch = self.agree(seed, &edges, &edge_of_side, &mut turns);
            if self.faces_inward(&patch, &turns) {
                for &face in &patch {
                    turns[face] = turns[face].map(|it| !it);
                }
            }
        }
        let turn = |face: u32| turns[face as usize] == Some(true);
        for sides in edges.iter().filter(|it| it.len() == 2) {
            let [a, b] = [sides[0], sides[1]].map(|it| it.forward != turn(it.face));
            self.report.n_unorientable_edges += usize::from(a == b);
        }
        for (face, turn) in self.faces.iter_mut().zip(&turns) {
            if *turn == Some(true) {
                face.swap(1, 2);
                self.report.n_turned_faces += 1;
            }
        }
    }

    /// Walks from face to face, and notes which must turn to agree with the seed.
    fn agree(
        &self,
        seed: usize,
        edges: &Edges,
        edge_of_side: &[u32],
        turns: &mut [Option<bool>],
    ) -> Vec<usize> {
        turns[seed] = Some(false);
        let mut patch = vec![seed];
        let mut queue = VecDeque::from([seed]);
        while let Some(face) = queue.pop_front() {
            for side in 0..3 {
                let sides = edges.sides(edge_of_side[3 * face + side] as usize);
                let [a, b] = sides else { continue };
                let (this, next) = if a.face as usize == face { (a, b) } else { (b, a) };
                let next_face = next.face as usize;
                if turns[next_face].is_none() {
                    let alike = this.forward == next.forward;
                    turns[next_face] = Some(turns[face] == Some(!alike));
                    patch.push(next_face);
                    queue.push_back(next_face);
                }
            }
        }
        patch
    }

    fn faces_inward(&self, patch: &[usize], turns: &[Option<bool>]) -> bool {
        let corners = |face: usize| self.faces[face].map(|it| self.vertices[it as usize]);
        let sum: Vec3 = patch.iter().map(|&it| corners(it).iter().sum::<Vec3>()).sum();
        let centre = sum / (3 * patch.len()) as f64;
        let (mut volume, mut area) = (0.0, 0.0);
        for &face in patch {
            let [a, b, c] = corners(face).map(|it| it - centre);
            let sign = if turns[face] == Some(true) { -1.0 } else { 1.0 };
            volume += sign * a.dot(&b.cross(&c)) / 6.0;
            area += (b - a).cross(&(c - a)).norm() / 2.0;
        }
        // A ball of this area has a volume of about 0.094 area^1.5.
        if volume.abs() > 1e-4 * area.powf(1.5) {
            return volume < 0.0;
        }
        2 * patch.iter().filter(|&&it| turns[it] == Some(true)).count() > patch.len()
    }
}
