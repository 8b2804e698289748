//! What sticks out of a shape: maxima of the mean distance that stay maxima for long.

use std::mem::{swap, take};

use super::surface::Surface;
use crate::kernels::geometry::topology::DisjointSets;

/// Something that sticks out: a limb, a head, an ear.
#[derive(Debug, Clone)]
pub struct Protrusion {
    /// The vertex that is farthest out.
    pub tip: usize,
    /// The vertices farther out than where it meets another protrusion, of those that are kept; ascending.
    pub members: Vec<u32>,
}

/// The maxima of a function on a surface with their persistence, greatest first: how far the function
/// falls from there to where a higher maximum is met.
///
/// Vertices are taken from high to low (Edelsbrunner, Letscher & Zomorodian 2002): each begins a new
/// component, belongs to one, or joins several, of which the one with the highest maximum lives on.
/// The highest of all, which never ends, counts to where it meets the most persistent other one.
pub fn maxima(surface: &Surface, function: &[f64]) -> Vec<(usize, f64)> {
    let mut found: Vec<(usize, f64)> = Vec::new();
    let order = descending(function);
    sweep(
        surface,
        &order,
        |above, level, roots| {
            // The elder is the set whose maximum came first.
            for &younger in &roots[1..] {
                let maximum = above.maximum[younger];
                found.push((maximum, function[maximum] - level));
            }
        },
        function,
    );
    let greatest_first =
        |a: &(usize, f64), b: &(usize, f64)| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0));
    found.sort_by(greatest_first);
    let top = order[0] as usize;
    let met = match found.first() {
        Some(&(other, persistence)) => function[other] - persistence,
        None => function[order[order.len() - 1] as usize],
    };
    found.push((top, function[top] - met));
    found.sort_by(greatest_first);
    found
}

/// The parts of a surface that belong to given maxima and to no two of them.
pub fn protrusions(surface: &Surface, function: &[f64], kept: &[(usize, f64)]) -> Vec<Protrusion> {
    let mut res: Vec<Protrusion> =
        kept.iter().map(|&(tip, _)| Protrusion { tip, members: Vec::new() }).collect();
    let mut is_closed = vec![false; res.len()];
    let place = |maximum: usize| kept.iter().position(|it| it.0 == maximum);
    let order = descending(function);
    sweep(
        surface,
        &order,
        |above, _, roots| {
            let meeting: Vec<usize> =
                roots.iter().filter(|&&it| place(above.maximum[it]).is_some()).copied().collect();
            if meeting.len() < 2 {
                return;
            }
            for root in meeting {
                let it = place(above.maximum[root]).expect("filtered above");
                if !is_closed[it] {
                    is_closed[it] = true;
                    res[it].members = above.members[root].clone();
                }
            }
        },
        function,
    );
    for it in &mut res {
        it.members.sort_unstable();
    }
    res
}

fn descending(function: &[f64]) -> Vec<u32> {
    let mut order: Vec<u32> = (0..function.len() as u32).collect();
    order.sort_by(|&a, &b| function[b as usize].total_cmp(&function[a as usize]).then(a.cmp(&b)));
    order
}

/// The components of what lies above a level that sinks.
struct Components {
    sets: DisjointSets,
    /// Of every root, the vertex of its greatest value.
    maximum: Vec<usize>,
    /// Of every root, its vertices.
    members: Vec<Vec<u32>>,
}

impl Components {
    /// Makes one component of two.
    fn join(&mut self, a: usize, b: usize, maximum: usize) {
        let (a, b) = (self.sets.find(a), self.sets.find(b));
        self.sets.join(a, b);
        // The larger list takes the smaller one in.
        let (mut all, mut rest) = (take(&mut self.members[a]), take(&mut self.members[b]));
        if all.len() < rest.len() {
            swap(&mut all, &mut rest);
        }
        all.extend(rest);
        let root = self.sets.find(a);
        self.members[root] = all;
        self.maximum[root] = maximum;
    }
}

/// Calls back with the level and the roots that meet there, that of the highest maximum first.
fn sweep(
    surface: &Surface,
    order: &[u32],
    mut meet: impl FnMut(&Components, f64, &[usize]),
    function: &[f64],
) {
    let n = surface.len();
    let mut above = Components {
        sets: DisjointSets::new(n),
        maximum: (0..n).collect(),
        members: vec![Vec::new(); n],
    };
    let mut rank = vec![0_u32; n];
    order.iter().enumerate().for_each(|(place, &it)| rank[it as usize] = place as u32);
    for &vertex in order {
        let vertex = vertex as usize;
        above.members[vertex].push(vertex as u32);
        let mut roots: Vec<usize> = Vec::new();
        for &(neighbor, _) in surface.ways(vertex) {
            let neighbor = neighbor as usize;
            if rank[neighbor] < rank[vertex] {
                roots.push(above.sets.find(neighbor));
            }
        }
        roots.sort_unstable_by_key(|&it| rank[above.maximum[it]]);
        roots.dedup();
        if roots.len() > 1 {
            meet(&above, function[vertex], &roots);
        }
        // The highest maximum lives on.
        let Some(&highest) = roots.first() else { continue };
        let maximum = above.maximum[highest];
        roots.iter().for_each(|&it| above.join(vertex, it, maximum));
    }
}
