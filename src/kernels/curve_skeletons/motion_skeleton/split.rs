//! Curves cut where the surface around them bends.

use rayon::prelude::*;

use super::moments::Moments;
use super::{MotionSkeletonOptions, Moving};

/// Bones as paths of nodes, both ends included. A node belongs to the first bone that it is on.
#[derive(Debug, Clone, PartialEq)]
pub struct Bones {
    pub paths: Vec<Vec<u32>>,
    /// The bone of every node; `u32::MAX` for nodes that are on none.
    pub bone_of_node: Vec<u32>,
    pub n_splits: usize,
}

impl Bones {
    pub fn new(n_nodes: usize, paths: Vec<Vec<u32>>) -> Self {
        let mut bone_of_node = vec![u32::MAX; n_nodes];
        for (bone, path) in (0_u32..).zip(&paths) {
            for &node in path {
                let owner = &mut bone_of_node[node as usize];
                *owner = bone.min(*owner);
            }
        }
        Self { paths, bone_of_node, n_splits: 0 }
    }

    /// Cuts a bone at an inner place of its path: the first part keeps its number and the node.
    fn cut(&mut self, bone: usize, at: usize) {
        let second = self.paths[bone][at..].to_vec();
        self.paths[bone].truncate(at + 1);
        let new = self.paths.len() as u32;
        for &node in &second[1..] {
            if self.bone_of_node[node as usize] == bone as u32 {
                self.bone_of_node[node as usize] = new;
            }
        }
        self.paths.push(second);
        self.n_splits += 1;
    }
}

/// Where a bone is best cut.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cut {
    /// The place in the bone's path.
    pub at: usize,
    /// What the rigid cost loses, and the share of it.
    pub gain: f64,
    pub share: f64,
}

/// Splits bones at the node that lowers their rigid cost most, if it does so by more than the threshold
/// (Transfer4D, equation 9), in rounds: every bone once a round, those that gain most first.
///
/// The global error cannot rise, as two motions fit no worse than one.
pub fn split_bones(
    moving: &Moving<'_>,
    moments: &[Moments],
    bones: &mut Bones,
    options: &MotionSkeletonOptions,
) {
    for _ in 0..options.rounds {
        let cuts: Vec<Option<Cut>> = (0..bones.paths.len())
            .into_par_iter()
            .map(|it| best_cut(moving, moments, bones, it, options))
            .collect();
        let mut wanted: Vec<(usize, Cut)> = cuts
            .into_iter()
            .enumerate()
            .filter_map(|(bone, cut)| Some((bone, cut?)))
            .filter(|it| it.1.share > options.threshold)
            .collect();
        wanted.sort_by(|a, b| b.1.gain.total_cmp(&a.1.gain).then(a.0.cmp(&b.0)));
        wanted.truncate(options.max_bones.saturating_sub(bones.paths.len()));
        if wanted.is_empty() {
            break;
        }
        wanted.iter().for_each(|(bone, cut)| bones.cut(*bone, cut.at));
    }
}

/// The cut of a bone with the least cost of both sides, each of enough vertices. None for a bone that is
/// too small, or moves rigidly.
///
/// Sums along the path give the sides of every cut, so that all cuts take a singular value
/// decomposition a node and frame.
pub fn best_cut(
    moving: &Moving<'_>,
    moments: &[Moments],
    bones: &Bones,
    bone: usize,
    options: &MotionSkeletonOptions,
) -> Option<Cut> {
    let path = &bones.paths[bone];
    let is_own = |node: u32| bones.bone_of_node[node as usize] == bone as u32;
    let mut total = Moments::none(moving.n_frames());
    path.iter().filter(|&&it| is_own(it)).for_each(|&it| total.add(&moments[it as usize]));
    let cost = total.rigid_cost();
    let least = (options.least_error * moving.diagonal).powi(2);
    if path.len() < 3
        || total.n < options.min_vertices
        || cost <= least * (total.n * moving.n_frames()) as f64
    {
        return None;
    }
    let mut first = Moments::none(moving.n_frames());
    let mut best: Option<Cut> = None;
    for (at, &node) in path.iter().enumerate().take(path.len() - 1) {
        if is_own(node) {
            first.add(&moments[node as usize]);
        }
        if at == 0 || first.n < options.min_side || total.n - first.n < options.min_side {
            continue;
        }
        let gain = cost - first.rigid_cost() - total.without(&first).rigid_cost();
        if best.is_none_or(|it| gain > it.gain) {
            best = Some(Cut { at, gain, share: gain / cost });
        }
    }
    best
}
