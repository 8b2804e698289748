//! The sides of faces, grouped by the edges on which they lie.

/// The sides of all faces, grouped into edges.
///
/// Sorted by counting their smaller vertices first: for the many faces of a cloud, that is several
/// times faster than sorting by comparison.
pub(super) struct Sides {
    sides: Vec<Side>,
    /// One more than edges.
    offsets: Vec<u32>,
}

impl Sides {
    pub(super) fn of(n_vertices: usize, faces: &[[u32; 3]]) -> Self {
        assert!(faces.len() < u32::MAX as usize / 12, "half-edges are numbered by 32 bits");
        let mut begins = vec![0_u32; n_vertices + 1];
        for [a, b, c] in faces {
            for low in [a.min(b), b.min(c), c.min(a)] {
                begins[*low as usize + 1] += 1;
            }
        }
        for vertex in 0..n_vertices {
            begins[vertex + 1] += begins[vertex];
        }
        let mut ends = begins.clone();
        let mut sides = vec![Side { high: 0, packed: 0 }; 3 * faces.len()];
        for (face, corners) in faces.iter().enumerate() {
            for side in 0..3 {
                let (from, to) = (corners[side], corners[(side + 1) % 3]);
                let place = &mut ends[from.min(to) as usize];
                let half_edge = (3 * face + side) as u32;
                sides[*place as usize] = Side::new(from.max(to), half_edge, from < to);
                *place += 1;
            }
        }
        let mut offsets = Vec::with_capacity(sides.len() / 2 + 1);
        for low in 0..n_vertices {
            let (begin, end) = (begins[low] as usize, begins[low + 1] as usize);
            sides[begin..end].sort_unstable();
            let starts =
                (begin..end).filter(|&it| it == begin || sides[it].high != sides[it - 1].high);
            offsets.extend(starts.map(|it| it as u32));
        }
        offsets.push(sides.len() as u32);
        Self { sides, offsets }
    }

    pub(super) fn n_edges(&self) -> usize {
        self.offsets.len() - 1
    }

    /// The sides that lie on every edge, by ascending face.
    pub(super) fn edges(&self) -> impl Iterator<Item = &[Side]> + '_ {
        self.offsets.windows(2).map(|it| &self.sides[it[0] as usize..it[1] as usize])
    }
}

/// One side of a face: the edge from corner `side` to the next corner.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Side {
    /// The greater vertex of the edge.
    high: u32,
    /// `3 * face + side`, times two, and one more if the face walks from the smaller vertex.
    packed: u32,
}

impl Side {
    fn new(high: u32, half_edge: u32, forward: bool) -> Self {
        Self { high, packed: 2 * half_edge + u32::from(forward) }
    }

    /// `3 * face + side`.
    pub(super) fn half_edge(self) -> u32 {
        self.packed / 2
    }

    pub(super) fn is_forward(self) -> bool {
        self.packed % 2 == 1
    }
}
