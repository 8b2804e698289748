//! Delaunay triangles around one point of the plane.

/// A neighbour of the center, in coordinates of which the center is the origin.
#[derive(Debug, Clone, Copy)]
pub struct Spoke {
    pub index: u32,
    at: [f64; 2],
    /// Chooses between triangulations of points on one circle; in `[0, 1)`.
    tie_breaker: f64,
    /// Grows with the angle, from -2 to 2.
    angle: f64,
    /// The image in the unit circle: `at / |at|^2`, but for the tie breakers.
    inverse: [f64; 2],
}

/// What a tie breaker counts, in parts of the squared length of the shortest spoke: more than rounding,
/// less than any difference of positions that matters.
const TIE: f64 = 1e-9;

/// Angles between spokes that are this near to zero or pi count as such.
const STRAIGHT: f64 = 1e-8;

impl Spoke {
    /// A neighbour at a place, which is not the origin.
    pub fn new(index: u32, at: [f64; 2], tie_breaker: f64) -> Self {
        let [x, y] = at;
        let slope = y / (x.abs() + y.abs());
        let angle = if x >= 0.0 { slope } else { 2.0_f64.copysign(slope) - slope };
        Self { index, at, tie_breaker, angle, inverse: at }
    }

    fn square(&self) -> f64 {
        self.at[0] * self.at[0] + self.at[1] * self.at[1]
    }
}

/// Finds the neighbours of the center in the Delaunay triangulation of all, counter-clockwise.
///
/// They are the corners of the convex hull of the spokes' inverses in the unit circle: a circle
/// through the center becomes a line, and what is inside of it lies beyond that line. Of spokes in one
/// direction the shortest is kept.
///
/// Returns whether the triangles go all around; if there is a gap of at least half a turn, the first
/// and the last of the ring are at its sides. The ring is empty if there are no triangles.
///
/// `spokes` are sorted; `ring` is emptied and filled.
pub fn delaunay_star(spokes: &mut Vec<Spoke>, tie_breaker: f64, ring: &mut Vec<Spoke>) -> bool {
    ring.clear();
    let shortest = spokes.iter().map(Spoke::square).fold(f64::INFINITY, f64::min);
    for spoke in spokes.iter_mut() {
        let square = spoke.square() + TIE * shortest * (tie_breaker - spoke.tie_breaker);
        spoke.inverse = spoke.at.map(|it| it / square);
    }
    spokes.sort_unstable_by(|a, b| {
        a.angle
            .total_cmp(&b.angle)
            .then(a.square().total_cmp(&b.square()))
            .then(a.index.cmp(&b.index))
    });
    keep_one_a_direction(spokes);
    let n_spokes = spokes.len();
    if n_spokes < 2 {
        return false;
    }
    let mut gaps =
        (0..n_spokes).filter(|&it| !turns_left(&spokes[it], &spokes[(it + 1) % n_spokes]));
    let (gap, second_gap) = (gaps.next(), gaps.next());
    if second_gap.is_some() {
        // All spokes lie on one line.
        return false;
    }
    // A corner of the hull for sure: the side of a gap, or what lies farthest out.
    let first = match gap {
        Some(before) => (before + 1) % n_spokes,
        None => farthest_out(spokes),
    };
    spokes.rotate_left(first);
    for &spoke in spokes.iter() {
        push_corner(ring, spoke);
    }
    if gap.is_none() {
        push_corner(ring, spokes[0]);
        ring.pop();
    }
    gap.is_none()
}

/// Of neighbours in one direction, keeps the shortest; they lie beside each other.
fn keep_one_a_direction(spokes: &mut Vec<Spoke>) {
    spokes.dedup_by(|later, kept| {
        let same = is_same_direction(later, kept);
        if same && later.square() < kept.square() {
            *kept = *later;
        }
        same
    });
    // The circle closes in the middle of a direction.
    while let [first, .., last] = spokes[..] {
        if !is_same_direction(&first, &last) {
            break;
        }
        if last.square() < first.square() {
            spokes[0] = last;
        }
        spokes.pop();
    }
}

fn is_same_direction(a: &Spoke, b: &Spoke) -> bool {
    let cross = a.at[0] * b.at[1] - a.at[1] * b.at[0];
    let dot = a.at[0] * b.at[0] + a.at[1] * b.at[1];
    dot > 0.0 && cross.abs() <= STRAIGHT * dot
}

/// Whether one gets from one direction to the other by less than half a turn to the left.
fn turns_left(from: &Spoke, to: &Spoke) -> bool {
    let cross = from.at[0] * to.at[1] - from.at[1] * to.at[0];
    let dot = from.at[0] * to.at[0] + from.at[1] * to.at[1];
    let is_straight = dot < 0.0 && cross <= STRAIGHT * -dot;
    cross > 0.0 && !is_straight
}

fn farthest_out(spokes: &[Spoke]) -> usize {
    let square = |it: &Spoke| it.inverse[0] * it.inverse[0] + it.inverse[1] * it.inverse[1];
    let mut best = 0;
    for place in 1..spokes.len() {
        if square(&spokes[place]) > square(&spokes[best]) {
            best = place;
        }
    }
    best
}

/// Adds the next corner of the hull, after those have gone that it makes inner points (Graham's scan).
fn push_corner(ring: &mut Vec<Spoke>, spoke: Spoke) {
    while let [.., before, last] = ring[..] {
        let [a, b, c] = [before.inverse, last.inverse, spoke.inverse];
        let turn = (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0]);
        if turn > 0.0 {
            break;
        }
        ring.pop();
    }
    ring.push(spoke);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::numerics::random::Random;

    fn star(points: &[[f64; 2]]) -> (Vec<u32>, bool) {
        let spoke = |(index, at): (usize, &[f64; 2])| Spoke::new(index as u32, *at, 0.0);
        let mut spokes: Vec<Spoke> = points.iter().enumerate().map(spoke).collect();
        let mut ring = Vec::new();
        let closed = delaunay_star(&mut spokes, 0.0, &mut ring);
        (ring.iter().map(|it| it.index).collect(), closed)
    }

    /// Whether no point lies inside of the circle through the origin and two points.
    fn is_empty(points: &[[f64; 2]], [a, b]: [usize; 2]) -> bool {
        let (p, q) = (points[a], points[b]);
        let squares = [p, q].map(|it| it[0] * it[0] + it[1] * it[1]);
        let double_cross = 2.0 * (p[0] * q[1] - p[1] * q[0]);
        let center = [
            (q[1] * squares[0] - p[1] * squares[1]) / double_cross,
            (p[0] * squares[1] - q[0] * squares[0]) / double_cross,
        ];
        let inside = |it: &[f64; 2]| {
            it[0] * (it[0] - 2.0 * center[0]) + it[1] * (it[1] - 2.0 * center[1]) < -1e-12
        };
        !points.iter().enumerate().any(|(place, it)| place != a && place != b && inside(it))
    }

    #[test]
    fn triangles_of_random_stars_are_those_with_empty_circles() {
        let mut random = Random::new(17);
        for round in 0..300 {
            let n_points = 3 + round % 28;
            // Every third round has a gap of half a turn.
            let low = if round % 3 == 0 { 0.01 } else { -1.0 };
            let points: Vec<[f64; 2]> = (0..n_points)
                .map(|_| [random.between(-1.0, 1.0), random.between(low, 1.0)])
                .collect();
            let (ring, closed) = star(&points);
            let n_triangles = if closed { ring.len() } else { ring.len() - 1 };
            let mut found: Vec<[usize; 2]> = (0..n_triangles)
                .map(|it| [ring[it] as usize, ring[(it + 1) % ring.len()] as usize])
                .collect();
            let pairs = (0..n_points).flat_map(|a| (0..n_points).map(move |b| [a, b]));
            let left = |[a, b]: [usize; 2]| {
                points[a][0] * points[b][1] - points[a][1] * points[b][0] > 0.0
            };
            let mut expected: Vec<[usize; 2]> =
                pairs.filter(|&it| left(it) && is_empty(&points, it)).collect();
            found.sort_unstable();
            expected.sort_unstable();
            assert_eq!(found, expected, "round {round}");
            assert!(closed || ring.len() == n_triangles + 1);
        }
    }

    #[test]
    fn of_spokes_in_one_direction_the_shortest_is_kept() {
        let (ring, closed) =
            star(&[[2.0, 0.0], [1.0, 0.0], [-1.0, 1.0], [-1.0, -1.0], [-2.0, -2.0]]);
        assert!(closed);
        let start = ring.iter().position(|&it| it == 1).unwrap();
        let turned: Vec<u32> = ring[start..].iter().chain(&ring[..start]).copied().collect();
        assert_eq!(turned, [1, 2, 3]);
    }

    #[test]
    fn a_straight_border_is_a_gap() {
        let (ring, closed) = star(&[[1.0, 1e-12], [0.0, 1.0], [-1.0, 1e-12]]);
        assert_eq!((ring, closed), (vec![0, 1, 2], false));
        // Rounding and the sign of zero put points of the border before and behind each other.
        let border =
            [[1.0, 0.0], [2.0, -1e-17], [0.0, 1.0], [-1.0, 0.0], [-2.0, -0.0], [-3.0, -1e-17]];
        assert_eq!(star(&border), (vec![0, 2, 3], false));
        assert_eq!(star(&[[1.0, 0.0], [-1.0, 0.0]]), (vec![], false));
        assert_eq!(star(&[[1.0, 0.0]]), (vec![], false));
    }
}
