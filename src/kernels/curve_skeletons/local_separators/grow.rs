//! Growing a set of points until what is around it falls apart.

use super::graph::SpatialGraph;
use super::scratch::{Mark, Scratch};
use crate::kernels::geometry::mesh::Vec3;

/// A front falls apart when its smallest part has at least this share of the points of its largest
/// (Bærentzen & Rotenberg 2021, section 3): small bumps do not count.
const LEAST_BALANCE: f64 = 0.09;

/// A set of points whose front has several parts; the scratch has them marked as inside and sides.
#[derive(Debug, Clone, PartialEq)]
pub struct Growth {
    /// In the order in which they were reached.
    pub inside: Vec<u32>,
    /// Of the sphere that swept over them.
    pub center: Vec3,
}

/// Why a set does not separate anything.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NoGrowth {
    /// It covers all that the seed is connected with.
    UsedUp,
    /// It has as many points as it may.
    TooLarge,
}

/// Grows a set from a seed: the point of the front that is closest to the center of a sphere joins,
/// and the sphere moves to touch it, until the front has several parts of comparable size.
///
/// # Errors
/// See [`NoGrowth`].
pub fn grow(
    graph: &SpatialGraph,
    seed: u32,
    max_size: usize,
    scratch: &mut Scratch,
) -> Result<Growth, NoGrowth> {
    scratch.forget();
    let mut front = Front::default();
    let mut sphere = Sphere { center: graph.position(seed), radius: 0.0 };
    let mut inside = vec![seed];
    scratch.put_inside(seed);
    front.reach(graph, seed, scratch);
    let mut parts = Parts::count(graph, &front.points, scratch);
    while !parts.is_apart() {
        if front.points.is_empty() {
            return Err(NoGrowth::UsedUp);
        }
        if inside.len() >= max_size {
            return Err(NoGrowth::TooLarge);
        }
        let (next, position) = front.take_closest(&sphere.center);
        sphere.move_to_touch(position);
        inside.push(next);
        scratch.put_inside(next);
        front.reach(graph, next, scratch);
        if parts.n_parts != 1 || !is_surely_connected(graph, next, scratch) {
            parts = Parts::count(graph, &front.points, scratch);
        }
    }
    scratch.label_sides(graph, &front.points);
    Ok(Growth { inside, center: sphere.center })
}

struct Sphere {
    center: Vec3,
    radius: f64,
}

impl Sphere {
    /// The smallest sphere through a point outside and the far side of this one.
    fn move_to_touch(&mut self, point: Vec3) {
        let offset = self.center - point;
        let distance = offset.norm();
        if distance > self.radius {
            self.radius = 0.5 * (self.radius + distance);
            self.center = point + offset * (self.radius / distance);
        }
    }
}

/// Points that are next to the set.
#[derive(Default)]
struct Front {
    points: Vec<u32>,
    positions: Vec<Vec3>,
}

impl Front {
    /// Adds the neighbours of a point that have not been seen.
    fn reach(&mut self, graph: &SpatialGraph, from: u32, scratch: &mut Scratch) {
        for &next in graph.neighbors(from) {
            if scratch.mark(next) == Mark::Unseen {
                scratch.put_side(next, 0);
                self.points.push(next);
                self.positions.push(graph.position(next));
            }
        }
    }

    fn take_closest(&mut self, center: &Vec3) -> (u32, Vec3) {
        let mut closest = (0, f64::INFINITY);
        for (place, position) in self.positions.iter().enumerate() {
            let distance = (position - center).norm_squared();
            if distance < closest.1 {
                closest = (place, distance);
            }
        }
        (self.points.swap_remove(closest.0), self.positions.swap_remove(closest.0))
    }
}

/// The connected parts of a front.
#[derive(Debug, Clone, Copy)]
struct Parts {
    n_parts: usize,
    smallest: usize,
    largest: usize,
}

impl Parts {
    fn count(graph: &SpatialGraph, front: &[u32], scratch: &mut Scratch) -> Self {
        let mut parts = Self { n_parts: 0, smallest: usize::MAX, largest: 0 };
        scratch.begin_walk();
        for &from in front {
            let is_front = |it: &Scratch, next| matches!(it.mark(next), Mark::Side(_));
            let size = scratch.flood(graph, from, is_front, |_| {});
            if size > 0 {
                parts.n_parts += 1;
                parts.smallest = parts.smallest.min(size);
                parts.largest = parts.largest.max(size);
            }
        }
        parts
    }

    fn is_apart(&self) -> bool {
        self.n_parts > 1 && self.smallest as f64 >= LEAST_BALANCE * self.largest as f64
    }
}

/// Whether a connected front surely stays connected when a point leaves it: the neighbours of the
/// point in the front are joined by edges among themselves.
///
/// This spares most searches through the whole front; when it says no, nothing is known.
fn is_surely_connected(graph: &SpatialGraph, point: u32, scratch: &Scratch) -> bool {
    let around = graph.neighbors(point);
    if around.len() > 64 {
        return false;
    }
    let mut links = [0_u64; 64];
    let mut wanted = 0_u64;
    for (place, &neighbor) in around.iter().enumerate() {
        if matches!(scratch.mark(neighbor), Mark::Side(_)) {
            wanted |= 1 << place;
            links[place] = common(around, graph.neighbors(neighbor));
        }
    }
    let mut reached = wanted & wanted.wrapping_neg();
    let mut edge = reached;
    while edge != 0 {
        let place = edge.trailing_zeros() as usize;
        let new = links[place] & wanted & !reached;
        reached |= new;
        edge = (edge & (edge - 1)) | new;
    }
    wanted != 0 && reached == wanted
}

/// The places in an ascending list of numbers that are also in another one.
fn common(list: &[u32], other: &[u32]) -> u64 {
    let mut places = 0;
    let mut next = 0;
    for (place, &number) in list.iter().enumerate() {
        while next < other.len() && other[next] < number {
            next += 1;
        }
        if other.get(next) == Some(&number) {
            places |= 1 << place;
        }
    }
    places
}
