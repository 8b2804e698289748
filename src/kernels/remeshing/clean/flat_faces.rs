//! Faces without a height, which have no angles.

use std::collections::BTreeSet;

use super::Repair;
use crate::kernels::geometry::topology::Edges;

impl Repair {
    /// Gives the thin space of a flat face to the neighbour across its longest edge.
    ///
    /// Removing the face instead would leave a slit: its short edges would lie on the long one
    /// without being glued to it. Where the flip is impossible, the face does go.
    pub(super) fn flip_flat(&mut self) {
        // A flip may leave a neighbour flat (several vertices on one line): a few rounds settle that.
        for _ in 0..8 {
            let flat: Vec<usize> =
                (0..self.faces.len()).filter(|&it| self.is_flat(self.faces[it])).collect();
            if flat.is_empty() {
                return;
            }
            let edges = Edges::of(&self.faces);
            let edge_of_side = edges.edge_of_side();
            let mut known: BTreeSet<(u32, u32)> =
                edges.iter().map(|it| (it[0].low, it[0].high)).collect();
            let mut is_touched = vec![false; self.faces.len()];
            let mut is_removed = vec![false; self.faces.len()];
            for face in flat {
                if is_touched[face] {
                    continue;
                }
                self.report.n_flat_faces += 1;
                let side = self.longest_side(face);
                let sides = edges.sides(edge_of_side[3 * face + side] as usize);
                let other = sides.iter().map(|it| it.face as usize).find(|&it| it != face);
                match other.filter(|&it| sides.len() == 2 && !is_touched[it]) {
                    Some(other) if self.flip(face, side, other, &mut known) => {
                        is_touched[face] = true;
                        is_touched[other] = true;
                    }
                    Some(_) => is_removed[face] = true,
                    // On a rim the face is no loss; beside a face just changed it waits a round.
                    None if sides.len() == 2 => self.report.n_flat_faces -= 1,
                    None => is_removed[face] = true,
                }
            }
            let mut removed = is_removed.iter();
            self.faces.retain(|_| !removed.next().expect("as many as faces"));
        }
    }

    /// Whether the height is below a billionth of the longest edge: no angle can be told.
    fn is_flat(&self, face: [u32; 3]) -> bool {
        let [a, b, c] = face.map(|it| self.vertices[it as usize]);
        let longest =
            (b - a).norm_squared().max((c - b).norm_squared()).max((a - c).norm_squared());
        (b - a).cross(&(c - a)).norm() <= 1e-9 * longest
    }

    fn longest_side(&self, face: usize) -> usize {
        let corners = self.faces[face].map(|it| self.vertices[it as usize]);
        let length = |side: usize| (corners[(side + 1) % 3] - corners[side]).norm_squared();
        (0..3).max_by(|&a, &b| length(a).total_cmp(&length(b))).expect("three sides")
    }

    /// Replaces `[u, v, tip]` and the face beyond `uv` by the two faces beside the edge tip-to-tip.
    fn flip(
        &mut self,
        face: usize,
        side: usize,
        other: usize,
        known: &mut BTreeSet<(u32, u32)>,
    ) -> bool {
        let [u, v, tip] = [0, 1, 2].map(|it| self.faces[face][(side + it) % 3]);
        let beyond = *self.faces[other]
            .iter()
            .find(|&&it| it != u && it != v)
            .expect("a face that is not collapsed has a third vertex");
        let edge = (tip.min(beyond), tip.max(beyond));
        if tip == beyond || known.contains(&edge) {
            return false;
        }
        // The other face may be turned the other way; both new ones follow it, as it has an area.
        let walks_alike =
            (0..3).any(|it| self.faces[other][it] == u && self.faces[other][(it + 1) % 3] == v);
        let new = [[u, beyond, tip], [beyond, v, tip]];
        let new = if walks_alike { new.map(|[a, b, c]| [a, c, b]) } else { new };
        known.insert(edge);
        known.remove(&(u.min(v), u.max(v)));
        self.faces[face] = new[0];
        self.faces[other] = new[1];
        true
    }
}
