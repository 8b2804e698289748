//! Where the joints around a stiff part are: where the axes of limbs meet over the poses.

use nalgebra::{Isometry3, Matrix3, Point3, Translation3};

use super::bends::Bend;
use super::chains::Chain;
use crate::kernels::geometry::kabsch::best_rotation;
use crate::kernels::geometry::mesh::Vec3;

/// A part is placed by its joints if it has so many; fewer leave it loose.
const FEWEST: usize = 3;

/// What all places on the curve of a part count together, against one axis of a limb.
const PART_WEIGHT: f64 = 1.0;

/// What the place of a joint on the curve counts, against its limb's axis in one pose.
const CURVE_WEIGHT: f64 = 0.005;

/// Rounds of placing parts, then joints.
const ROUNDS: usize = 100;

/// The axis of a limb is taken between these distances behind its joint, in windows.
const AXIS: [f64; 2] = [0.75, 2.5];

/// How far joints may be moved, in windows.
const FARTHEST: f64 = 1.5;

/// A limb that begins at a joint: a point of its axis and the direction, at rest and in all poses.
struct Limb {
    start: Vec3,
    rest: Option<(Vec3, Vec3)>,
    poses: Vec<Option<(Vec3, Vec3)>>,
}

/// The places of joints, at rest, in the order of the bends.
///
/// A curve in the middle of a figure passes beside its hips and shoulders, but the straight part of a limb
/// turns about a point of its own axis. Where at least three limbs begin at a part that does not bend, the
/// part is placed in every pose so that its joints lie on the axes of their limbs, and each joint where
/// it is nearest to its axis in all poses, in turns. Other joints stay on the curve.
pub fn centers(chains: &[Chain], joints: &[&Bend], window: f64) -> Vec<Vec3> {
    let place = |it: &&Bend| chains[it.chain].rest[it.sample];
    let mut places: Vec<Vec3> = joints.iter().map(place).collect();
    let keys = part_of_chains(chains, joints);
    let own: Vec<Option<usize>> = (0..joints.len())
        .map(|it| {
            before(chains, joints, joints[it].chain, way(chains, joints[it]))
                .or(keys[joints[it].chain])
        })
        .collect();
    let mut parts: Vec<Option<usize>> = own.clone();
    parts.sort_unstable();
    parts.dedup();
    for part in parts {
        let members: Vec<usize> = (0..joints.len()).filter(|&it| own[it] == part).collect();
        if members.len() < FEWEST {
            continue;
        }
        let limbs: Vec<Limb> =
            members.iter().map(|&it| limb(chains, joints, joints[it], window)).collect();
        let points = points_of_part(chains, joints, &keys, part, window);
        for (&member, found) in members.iter().zip(fit(&limbs, &points)) {
            if (found - places[member]).norm() <= FARTHEST * window {
                places[member] = found;
            }
        }
    }
    places
}

fn way(chains: &[Chain], joint: &Bend) -> f64 {
    chains[joint.chain].ways[joint.sample]
}

/// The last joint on a chain before a way.
fn before(chains: &[Chain], joints: &[&Bend], chain: usize, limit: f64) -> Option<usize> {
    (0..joints.len())
        .filter(|&it| joints[it].chain == chain && way(chains, joints[it]) < limit)
        .max_by(|&a, &b| way(chains, joints[a]).total_cmp(&way(chains, joints[b])))
}

/// For every chain the last joint before it: chains of the same part begin behind the same joint.
fn part_of_chains(chains: &[Chain], joints: &[&Bend]) -> Vec<Option<usize>> {
    let mut keys: Vec<Option<usize>> = Vec::with_capacity(chains.len());
    for chain in chains {
        let key =
            chain.before.and_then(|it| before(chains, joints, it, f64::INFINITY).or(keys[it]));
        keys.push(key);
    }
    keys
}

/// The way of the first joint of a chain behind another way.
fn next_way(chains: &[Chain], joints: &[&Bend], chain: usize, after: f64) -> Option<f64> {
    let ways = joints.iter().filter(|it| it.chain == chain).map(|it| way(chains, it));
    ways.filter(|it| *it > after).min_by(f64::total_cmp)
}

fn limb(chains: &[Chain], joints: &[&Bend], joint: &Bend, window: f64) -> Limb {
    let chain = &chains[joint.chain];
    let start = way(chains, joint);
    let end = next_way(chains, joints, joint.chain, start).map(|it| it - 0.25 * window);
    let end = end.unwrap_or(chain.length()).min(start + AXIS[1] * window);
    let from = start + AXIS[0] * window;
    let axis = |pose: Option<usize>| {
        let [a, b] = [from, end].map(|it| chain.place(pose, it));
        let direction = (b - a).try_normalize(1e-12)?;
        (end - from > 0.25 * window).then_some((a, direction))
    };
    let poses = (0..chain.poses.len()).map(|it| axis(Some(it))).collect();
    Limb { start: chain.rest[joint.sample], rest: axis(None), poses }
}

/// Places on the curves of a part: at rest, then in every pose.
fn points_of_part(
    chains: &[Chain],
    joints: &[&Bend],
    keys: &[Option<usize>],
    part: Option<usize>,
    window: f64,
) -> Vec<Vec<Vec3>> {
    const STEPS: usize = 8;
    let n_poses = chains.first().map_or(0, |it| it.poses.len());
    let mut points = vec![Vec::new(); n_poses + 1];
    for (index, chain) in chains.iter().enumerate().filter(|it| keys[it.0] == part) {
        let end = next_way(chains, joints, index, -1.0).map(|it| it - window);
        let end = end.unwrap_or(chain.length()).max(0.0);
        for step in 0..=STEPS {
            let at = end * step as f64 / STEPS as f64;
            points[0].push(chain.place(None, at));
            for pose in 0..n_poses {
                points[pose + 1].push(chain.place(Some(pose), at));
            }
        }
    }
    points
}

fn fit(limbs: &[Limb], points: &[Vec<Vec3>]) -> Vec<Vec3> {
    let n_poses = points.len() - 1;
    let mut joints: Vec<Vec3> = limbs.iter().map(|it| it.start).collect();
    let weight = PART_WEIGHT / points[0].len().max(1) as f64;
    let part: Vec<Vec<(Vec3, Vec3, f64)>> = (0..n_poses)
        .map(|pose| {
            let pairs = points[0].iter().zip(&points[pose + 1]);
            pairs.map(|(a, b)| (*a, *b, weight)).collect()
        })
        .collect();
    let mut motions: Vec<Isometry3<f64>> = part.iter().map(|it| motion(it)).collect();
    for _ in 0..ROUNDS {
        for (pose, motion_of_pose) in motions.iter_mut().enumerate() {
            let mut pairs = part[pose].clone();
            for (limb, joint) in limbs.iter().zip(&joints) {
                let Some((point, direction)) = limb.poses[pose] else { continue };
                let now = (*motion_of_pose * Point3::from(*joint)).coords;
                let on_axis = point + direction * (now - point).dot(&direction);
                pairs.push((*joint, on_axis, 1.0));
            }
            *motion_of_pose = motion(&pairs);
        }
        for (index, limb) in limbs.iter().enumerate() {
            joints[index] = nearest_to_axes(limb, &motions);
        }
    }
    joints
}

/// The rigid motion that fits weighted pairs of places best.
fn motion(pairs: &[(Vec3, Vec3, f64)]) -> Isometry3<f64> {
    let total: f64 = pairs.iter().map(|it| it.2).sum();
    if !(total > 0.0) {
        return Isometry3::identity();
    }
    let from = pairs.iter().map(|it| it.0 * it.2).sum::<Vec3>() / total;
    let to = pairs.iter().map(|it| it.1 * it.2).sum::<Vec3>() / total;
    let covariance: Matrix3<f64> =
        pairs.iter().map(|it| (it.1 - to) * (it.0 - from).transpose() * it.2).sum();
    let turn = best_rotation(&covariance);
    Isometry3::from_parts(Translation3::from(to - turn * from), turn)
}

/// The place at rest that is nearest to a limb's axis in all poses, seen from its part.
fn nearest_to_axes(limb: &Limb, motions: &[Isometry3<f64>]) -> Vec3 {
    let back = |(axis, motion): (&Option<(Vec3, Vec3)>, &Isometry3<f64>)| {
        let (point, direction) = (*axis)?;
        let inverse = motion.inverse();
        Some(((inverse * Point3::from(point)).coords, inverse.rotation * direction))
    };
    let lines = limb.poses.iter().zip(motions).filter_map(back).chain(limb.rest);
    let mut matrix = Matrix3::zeros();
    let mut right = Vec3::zeros();
    for (point, direction) in lines {
        let across = Matrix3::identity() - direction * direction.transpose();
        matrix += across + Matrix3::identity() * CURVE_WEIGHT;
        right += across * point + limb.start * CURVE_WEIGHT;
    }
    matrix.cholesky().map_or(limb.start, |it| it.solve(&right))
}
