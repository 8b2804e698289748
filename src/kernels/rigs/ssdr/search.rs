//! Which bones there are: a search over few of the vertices.

use super::additions::additions;
use super::descent::Descent;
use super::motions::Motions;
use super::sample::sample;
use super::smoothing::Smoothing;
use super::weights::{self, Row};
use super::{Moving, SsdrOptions, clusters::clusters, from_labels};

/// Vertices a bone that the search looks at, and the least of all.
const VERTICES: (usize, usize) = (30, 400);
/// Steps of the descent before bones are exchanged, and after.
const STEPS: usize = 4;
/// Exchanges that are tried, and how many in a row may fail.
const ROUNDS: usize = 10;
const FAILURES: usize = 2;
/// The share of bones that are exchanged at a time, at first.
const SHARE: f64 = 0.1;

/// Finds at most `n_bones` bones, and which of them move a vertex.
///
/// Fitting motions and weights in turn ends in the minimum next to the clusters that it starts from,
/// which may have two bones where one would do and one where two are needed. So the bones without
/// which the error grows least are moved to where it is largest, and stay there if the error is less
/// after some steps. Bones have few numbers, so that some vertices are enough to tell.
pub fn search(all: &Moving, edges: &[(u32, u32)], options: &SsdrOptions) -> (Motions, Vec<Row>) {
    let (per_bone, least) = VERTICES;
    let sample = sample(all.n_vertices(), edges, (per_bone * options.n_bones).max(least));
    let moving = all.part(&sample.vertices);
    let smoothing = Smoothing::new(&moving, &sample.edges);
    let (motions, rows) = from_labels(&moving, &clusters(&moving, options.n_bones));
    let mut now = Descent::new(&moving, &smoothing, options, motions, rows);
    (0..STEPS).for_each(|_| now.step());
    exchange(&mut now, options.n_bones);
    let row = |it: &u32| now.rows.get(*it as usize).cloned().unwrap_or_default();
    let mut rows: Vec<Row> = sample.owner.iter().map(row).collect();
    weights::fill(all, &now.motions, &mut rows);
    (now.motions, rows)
}

/// Adds bones up to `n_bones`, and moves bones to better places.
fn exchange(now: &mut Descent, n_bones: usize) {
    let mut n_moved = ((SHARE * n_bones as f64) as usize).max(1);
    // So many of the most promising places have been tried in vain.
    let mut n_failed = 0;
    for _ in 0..ROUNDS {
        let n_free = n_bones - now.motions.n_bones();
        let added = additions(now, n_moved.max(n_free), n_failed);
        if added.is_empty() {
            return;
        }
        let mut next = now.clone();
        next.replace(&least_useful(now, added.len().saturating_sub(n_free)), &added);
        (0..STEPS).for_each(|_| next.step());
        if next.error() < now.error() {
            *now = next;
            n_failed = 0;
            continue;
        }
        n_failed += usize::from(added.len() == 1);
        n_moved = (added.len() / 2).max(1);
        if n_failed >= FAILURES {
            return;
        }
    }
}

/// The bones without which the error grows least, ascending.
fn least_useful(now: &Descent, n: usize) -> Vec<usize> {
    let costs = weights::removal_costs(now.moving, &now.motions, &now.rows, &now.errors);
    let mut order: Vec<usize> = (0..costs.len()).collect();
    order.sort_by(|&a, &b| costs[a].total_cmp(&costs[b]).then(a.cmp(&b)));
    order.truncate(n);
    order.sort_unstable();
    order
}
