//! What sticks out of a shape: maxima of the mean distance that stay maxima for long.

use super::surface::Surface;

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
        |sets, level, roots| {
            // The elder is the set whose maximum came first.
            for &younger in &roots[1..] {
                let maximum = sets.maximum[younger];
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
        |sets, _, roots| {
            let meeting: Vec<usize> =
                roots.iter().filter(|&&it| place(sets.maximum[it]).is_some()).copied().collect();
            if meeting.len() < 2 {
                return;
            }
            for root in meeting {
                let it = place(sets.maximum[root]).expect("filtered above");
                if !is_closed[it] {
                    is_closed[it] = true;
                    res[it].members = sets.members[root].clone();
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
struct Sets {
    parent: Vec<u32>,
    /// Of every root, the vertex of its greatest value.
    maximum: Vec<usize>,
    /// Of every root, its vertices.
    members: Vec<Vec<u32>>,
}

impl Sets {
    fn find(&mut self, mut it: usize) -> usize {
        while self.parent[it] as usize != it {
            self.parent[it] = self.parent[self.parent[it] as usize];
            it = self.parent[it] as usize;
        }
        it
    }
}

/// Calls back with the level and the roots that meet there, that of the highest maximum first.
fn sweep(
    surface: &Surface,
    order: &[u32],
    mut meet: impl FnMut(&Sets, f64, &[usize]),
    function: &[f64],
) {
    let n = surface.len();
    let mut sets =
        Sets { parent: vec![u32::MAX; n], maximum: vec![0; n], members: vec![Vec::new(); n] };
    let mut rank = vec![0_u32; n];
    order.iter().enumerate().for_each(|(place, &it)| rank[it as usize] = place as u32);
    for &vertex in order {
        let vertex = vertex as usize;
        sets.parent[vertex] = vertex as u32;
        sets.maximum[vertex] = vertex;
        sets.members[vertex].push(vertex as u32);
        let mut roots: Vec<usize> = Vec::new();
        for &(neighbor, _) in surface.ways(vertex) {
            if sets.parent[neighbor as usize] != u32::MAX && neighbor as usize != vertex {
                roots.push(sets.find(neighbor as usize));
            }
        }
        roots.sort_unstable_by_key(|&it| rank[sets.maximum[it]]);
        roots.dedup();
        if roots.len() > 1 {
            meet(&sets, function[vertex], &roots);
        }
        for root in roots {
            // The larger list takes the smaller one in; the highest maximum lives on.
            let (mut into, mut from) = (sets.find(vertex), root);
            let by_rank = rank[sets.maximum[into]].min(rank[sets.maximum[from]]);
            if sets.members[into].len() < sets.members[from].len() {
                std::mem::swap(&mut into, &mut from);
            }
            sets.parent[from] = into as u32;
            let moved = std::mem::take(&mut sets.members[from]);
            sets.members[into].extend(moved);
            sets.maximum[into] = order[by_rank as usize] as usize;
        }
    }
}
