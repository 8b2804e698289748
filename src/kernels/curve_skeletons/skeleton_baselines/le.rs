//! Le and Deng's skeleton: rigid bones of a skinning decomposition, joined where they hinge.

use nalgebra::{Isometry3, Matrix3, Point3};

use super::{BaselineError, Moving, MovingSkeleton, tree};
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::geometry::point_tree::PointTree;
use crate::kernels::geometry::spanning_tree::spanning_tree;
use crate::kernels::rigs::ssdr::{Ssdr, SsdrOptions, ssdr};
use crate::kernels::rigs::weights::SkinWeights;

/// How bones are found and joined.
#[derive(Debug, Clone, PartialEq)]
pub struct LeOptions {
    /// How many bones there are in the end, at most.
    pub n_bones: usize,
    /// How many bones there are at first.
    pub first_bones: usize,
    /// Bones with a smaller share of the largest sum of squared weights go.
    pub least_share: f64,
    /// How strongly joints are pulled to the middle of the border of their bones.
    pub pull: f64,
    /// The most rounds of the first decomposition.
    pub iterations: usize,
    /// Rounds after a bone was removed.
    pub refits: usize,
}

impl Default for LeOptions {
    fn default() -> Self {
        Self { n_bones: 20, first_bones: 30, least_share: 0.1, pull: 0.1, iterations: 5, refits: 2 }
    }
}

/// Finds a skeleton from a smooth skinning decomposition (Le & Deng 2014, as Transfer4D compares with).
///
/// The decomposition starts with many bones; the one with the least sum of squared weights is removed
/// and the rest fitted again until few enough are left, then small ones go. Bones that share vertices
/// are joined at the `x` that minimizes `sum_t |(R_i - R_j) x + T_i - T_j|^2 + pull |x^t - c^t|^2`, where
/// `x^t` is the mean of what the two bones make of it and `c^t` the middle of their border; of all joints
/// those stay that are a minimum spanning tree for `residual / (w_i . w_j)`. Where no bones share
/// vertices, the nearest are joined. The root is in the middle of the most central bone, and a joint
/// without weights ends every outer bone at its farthest vertex.
///
/// # Errors
/// See [`BaselineError`].
pub fn skeletonize_le(
    moving: &Moving<'_>,
    options: &LeOptions,
) -> Result<MovingSkeleton, BaselineError> {
    moving.check_clusters(options.n_bones)?;
    for (name, value) in [("least_share", options.least_share), ("pull", options.pull)] {
        if !(value >= 0.0 && value.is_finite()) {
            return Err(BaselineError::Option { name, value, wanted: "a number from 0" });
        }
    }
    let bones = decomposed(moving, options)?;
    let n = bones.centers.len();
    let joints = joints(moving, &bones, options.pull);
    let pairs = joints.iter().map(|it| (it.cost, it.bones.0, it.bones.1)).collect();
    let edges = spanning_tree(n, pairs);
    let root = most_central(&bones.centers, &edges);
    let parents = tree::rooted(n, &edges, root);
    rigged(moving, &bones, &joints, &parents)
}

fn decomposed(moving: &Moving<'_>, options: &LeOptions) -> Result<Ssdr, BaselineError> {
    let first = SsdrOptions {
        n_bones: options.first_bones.max(options.n_bones),
        max_iterations: options.iterations,
        tolerance: 1e-2,
        patience: 1,
        // Joints are where bones meet, so bones must not leave their vertices.
        affinity: 10.0,
        ..SsdrOptions::default()
    };
    let refit = SsdrOptions { max_iterations: options.refits, ..first.clone() };
    let mut bones = ssdr(moving.rest, moving.faces, &moving.frames, None, &first)?;
    while bones.centers.len() > options.n_bones {
        let sizes = sizes(&bones.weights);
        let least = (0..sizes.len()).min_by(|a, b| sizes[*a].total_cmp(&sizes[*b]));
        let least = least.expect("there are bones");
        bones = without(moving, &bones, &|it| it == least, &refit)?;
    }
    let sizes = sizes(&bones.weights);
    let least = options.least_share * sizes.iter().fold(0.0, |a, b| f64::max(a, *b));
    match sizes.iter().any(|it| *it < least) {
        true => without(moving, &bones, &|it| sizes[it] < least, &refit),
        false => Ok(bones),
    }
}

/// The sum of squared weights of every bone.
fn sizes(weights: &SkinWeights) -> Vec<f64> {
    let mut sizes = vec![0.0; weights.n_joints()];
    let all = (0..weights.n_vertices()).flat_map(|it| weights.row(it));
    all.for_each(|(bone, weight)| sizes[bone as usize] += weight * weight);
    sizes
}

/// Fits again without some bones: their vertices go to the bone with the next largest weight or, if
/// there is none, the one that moves them best.
fn without(
    moving: &Moving<'_>,
    bones: &Ssdr,
    goes: &dyn Fn(usize) -> bool,
    options: &SsdrOptions,
) -> Result<Ssdr, BaselineError> {
    let stays: Vec<usize> = (0..bones.centers.len()).filter(|it| !goes(*it)).collect();
    let label = |vertex: usize| {
        let others = bones.weights.row(vertex).filter(|it| !goes(it.0 as usize));
        let heaviest = others.max_by(|a, b| a.1.total_cmp(&b.1));
        heaviest.map_or_else(|| best(moving, bones, &stays, vertex), |it| it.0)
    };
    let labels: Vec<u32> = (0..moving.n_vertices()).map(label).collect();
    Ok(ssdr(moving.rest, moving.faces, &moving.frames, Some(&labels), options)?)
}

/// The bone that alone moves a vertex best.
fn best(moving: &Moving<'_>, bones: &Ssdr, among: &[usize], vertex: usize) -> u32 {
    let square = |bone: usize| -> f64 {
        let place = moving.rest[vertex];
        let off = |(frame, at): (usize, &&[Vec3])| {
            (moved(&motion(bones, frame, bone), place) - at[vertex]).norm_squared()
        };
        moving.frames.iter().enumerate().map(off).sum()
    };
    let squares = among.iter().map(|it| (square(*it), *it));
    squares.min_by(|a, b| a.0.total_cmp(&b.0)).expect("some bones stay").1 as u32
}

fn motion(bones: &Ssdr, frame: usize, bone: usize) -> Isometry3<f64> {
    bones.motions[frame * bones.centers.len() + bone]
}

fn moved(motion: &Isometry3<f64>, place: Vec3) -> Vec3 {
    (motion * Point3::from(place)).coords
}

/// Where two bones may be joined.
struct Joint {
    bones: (usize, usize),
    place: Vec3,
    cost: f64,
}

/// A joint for every pair of bones. Those that share vertices cost less than any that do not.
fn joints(moving: &Moving<'_>, bones: &Ssdr, pull: f64) -> Vec<Joint> {
    let n = bones.centers.len();
    let overlaps = overlaps(moving, &bones.weights);
    let labels = heaviest(&bones.weights);
    let gaps = tree::largest_gaps(&moving.frames, &labels, n);
    // Noise must not decide between joints that fit exactly.
    let exact = (1e-9 * moving.scale()).powi(2);
    let mut joints: Vec<Joint> = Vec::new();
    let mut apart = Vec::new();
    for (gap, i, j) in gaps {
        match &overlaps[i * n + j] {
            Some((overlap, border)) => {
                let (place, residual) = hinge(bones, (i, j), border, pull);
                joints.push(Joint { bones: (i, j), place, cost: (residual + exact) / overlap });
            }
            None => apart.push((gap, i, j)),
        }
    }
    let most = joints.iter().map(|it| it.cost).fold(0.0, f64::max);
    for (gap, i, j) in apart {
        let border = middle(moving, &labels, (i, j));
        let (place, _) = hinge(bones, (i, j), &border, pull);
        joints.push(Joint { bones: (i, j), place, cost: most + 1.0 + gap });
    }
    joints
}

fn heaviest(weights: &SkinWeights) -> Vec<u32> {
    let heaviest = |it: usize| weights.row(it).max_by(|a, b| a.1.total_cmp(&b.1));
    (0..weights.n_vertices()).map(|it| heaviest(it).expect("weights sum to one").0).collect()
}

/// `w_i . w_j` and the middle of the border in every frame.
type Overlap = (f64, Vec<Vec3>);

/// For pairs of bones that share vertices how much, and where, at `i * n + j`.
fn overlaps(moving: &Moving<'_>, weights: &SkinWeights) -> Vec<Option<Overlap>> {
    let n = weights.n_joints();
    let mut res: Vec<Option<Overlap>> = vec![None; n * n];
    for vertex in 0..weights.n_vertices() {
        for (i, weight) in weights.row(vertex) {
            for (j, other) in weights.row(vertex).filter(|it| it.0 > i) {
                let product = weight * other;
                let (sum, places) = res[i as usize * n + j as usize]
                    .get_or_insert_with(|| (0.0, vec![Vec3::zeros(); moving.frames.len()]));
                *sum += product;
                let frames = places.iter_mut().zip(&moving.frames);
                frames.for_each(|(place, frame)| *place += frame[vertex] * product);
            }
        }
    }
    for (sum, places) in res.iter_mut().flatten() {
        places.iter_mut().for_each(|it| *it /= *sum);
    }
    res
}

/// How much farther than the least distance of two bones their border reaches.
const BORDER: f64 = 1.2;

/// The middle between two bones where they are nearest at rest, in every frame.
fn middle(moving: &Moving<'_>, labels: &[u32], (i, j): (usize, usize)) -> Vec<Vec3> {
    let of = |bone: usize| (0..labels.len()).filter(|it| labels[*it] as usize == bone).collect();
    let (first, second): (Vec<usize>, Vec<usize>) = (of(i), of(j));
    let tree = PointTree::new(&second.iter().map(|it| moving.rest[*it]).collect::<Vec<_>>());
    let mut found = Vec::new();
    let nearest = first.iter().map(|it| {
        tree.nearest(moving.rest[*it], 1, &mut found);
        (found[0].0, *it, second[found[0].1 as usize])
    });
    let pairs: Vec<(f64, usize, usize)> = nearest.collect();
    let least = pairs.iter().map(|it| it.0).fold(f64::INFINITY, f64::min);
    let border: Vec<_> = pairs.iter().filter(|it| it.0 <= BORDER * BORDER * least).collect();
    let mean = |frame: &&[Vec3]| {
        let sum: Vec3 = border.iter().map(|it| frame[it.1] + frame[it.2]).sum();
        sum / (2.0 * border.len() as f64)
    };
    moving.frames.iter().map(mean).collect()
}

/// Where two bones are joined best, and the mean squared distance of what they make of it.
fn hinge(bones: &Ssdr, (i, j): (usize, usize), border: &[Vec3], pull: f64) -> (Vec3, f64) {
    let parts = |frame: usize| {
        let (a, b) = (motion(bones, frame, i), motion(bones, frame, j));
        let matrix = |it: &Isometry3<f64>| it.rotation.to_rotation_matrix().into_inner();
        let (ra, rb) = (matrix(&a), matrix(&b));
        let (ta, tb) = (a.translation.vector, b.translation.vector);
        (ra - rb, ta - tb, (ra + rb) / 2.0, (ta + tb) / 2.0)
    };
    // Bones that never turn against each other leave the place open: the border decides.
    let pull = pull.max(1e-9);
    let (mut matrix, mut side) = (Matrix3::zeros(), Vec3::zeros());
    for (frame, middle) in border.iter().enumerate() {
        let (apart, shift, mean, mean_shift) = parts(frame);
        matrix += apart.transpose() * apart + mean.transpose() * mean * pull;
        side += mean.transpose() * (middle - mean_shift) * pull - apart.transpose() * shift;
    }
    let place = matrix.cholesky().map_or(Vec3::zeros(), |it| it.solve(&side));
    let square = |frame: usize| {
        let (apart, shift, _, _) = parts(frame);
        (apart * place + shift).norm_squared()
    };
    let residual = (0..border.len()).map(square).sum::<f64>() / border.len() as f64;
    (place, residual)
}

/// The node from which the farthest other one is nearest, along the tree.
fn most_central(places: &[Vec3], edges: &[(usize, usize)]) -> usize {
    let farthest = |root: usize| {
        let parents = tree::rooted(places.len(), edges, root);
        let mut distances = vec![0.0; places.len()];
        for node in tree::outward(&parents) {
            if let Some(parent) = parents[node] {
                distances[node] = distances[parent] + (places[node] - places[parent]).norm();
            }
        }
        distances.into_iter().fold(0.0, f64::max)
    };
    let all = (0..places.len()).map(|it| (farthest(it), it));
    all.min_by(|a, b| a.0.total_cmp(&b.0)).expect("there are bones").1
}

/// Joints between bones, at the root, and at the ends; every bone hangs on the joint above it.
fn rigged(
    moving: &Moving<'_>,
    bones: &Ssdr,
    joints: &[Joint],
    parents: &[Option<usize>],
) -> Result<MovingSkeleton, BaselineError> {
    let n = parents.len();
    let between = |a: usize, b: usize| {
        let pair = (a.min(b), a.max(b));
        joints.iter().find(|it| it.bones == pair).expect("every pair has a joint").place
    };
    let above = |bone: usize| parents[bone].map_or(bones.centers[bone], |it| between(bone, it));
    let mut rest: Vec<Vec3> = (0..n).map(above).collect();
    let mut all_parents = parents.to_vec();
    // The bones that move a joint: it is in the middle of where they want it.
    let mut movers: Vec<(usize, usize)> =
        (0..n).map(|it| (it, parents[it].unwrap_or(it))).collect();
    let labels = heaviest(&bones.weights);
    for bone in 0..n {
        let n_joined = parents.iter().filter(|it| **it == Some(bone)).count()
            + usize::from(parents[bone].is_some());
        let own = (0..labels.len()).filter(|it| labels[*it] as usize == bone);
        let off = |it: &usize| (moving.rest[*it] - rest[bone]).norm();
        let end = own.max_by(|a, b| off(a).total_cmp(&off(b)).then(b.cmp(a)));
        if let Some(end) = end.filter(|_| n_joined <= 1) {
            rest.push(moving.rest[end]);
            all_parents.push(Some(bone));
            movers.push((bone, bone));
        }
    }
    let path = |frame: usize| -> Vec<Vec3> {
        let place = |(at, by): (&Vec3, &(usize, usize))| {
            let by_bone = |bone: usize| moved(&motion(bones, frame, bone), *at);
            (by_bone(by.0) + by_bone(by.1)) / 2.0
        };
        rest.iter().zip(&movers).map(place).collect()
    };
    let paths: Vec<Vec<Vec3>> = (0..moving.frames.len()).map(path).collect();
    let (skeleton, clip, new_of_old) = moving.assembled(&rest, &paths, &all_parents)?;
    let renumbered = |row: Vec<(u32, f64)>| -> Vec<(u32, f64)> {
        row.into_iter().map(|it| (new_of_old[it.0 as usize], it.1)).collect()
    };
    let rows: Vec<Vec<(u32, f64)>> = bones.weights.to_rows().into_iter().map(renumbered).collect();
    let weights = SkinWeights::from_rows(rest.len(), &rows)?;
    Ok(MovingSkeleton { skeleton, clip, weights, error: bones.rmse })
}
