//! One step of all motions in all poses and of all joints together.

use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, Translation3, UnitQuaternion};
use rayon::prelude::*;

use super::blocks::{Blocks, Point, Seen, surface_terms};
use super::parts::moved;
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::geometry::triangle_tree::TriangleTree;

/// What is looked at in one pose.
pub struct Pose<'a> {
    pub surface: &'a TriangleTree,
    pub normals: &'a [Vec3],
    /// For every part: pairs of places on its curve, at rest and in the pose.
    pub curve: &'a [Vec<(Vec3, Vec3)>],
}

/// What is to be fitted.
#[derive(Clone, Copy)]
pub struct Problem<'a> {
    pub points: &'a [Point],
    pub poses: &'a [Pose<'a>],
    /// Of joints: the part before and the one behind.
    pub sides: &'a [[usize; 2]],
    /// Where joints began.
    pub cuts: &'a [Vec3],
    /// Joints that stay there.
    pub is_held: &'a [bool],
}

/// What the terms count, against the distances of all points from the surface, which count 1 in all.
#[derive(Debug, Clone, Copy)]
pub struct Weights {
    /// Points that slide along the surface.
    pub slide: f64,
    /// Distances from the curves.
    pub curve: f64,
    /// Distances between both sides of a joint.
    pub joint: f64,
    /// Distances of joints from where they began.
    pub prior: f64,
    /// The same, along axes on which turns hardly say where a joint is.
    pub free: f64,
    /// The same, of joints that are held.
    pub held: f64,
    /// Beyond this distance a point of the surface counts less and less.
    pub reach: f64,
}

/// The unknowns: motions by pose and part, and places of joints at rest.
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    pub motions: Vec<Vec<Isometry3<f64>>>,
    pub joints: Vec<Vec3>,
}

/// The normal equations of one pose: of its motions, of them with the joints, and of the joints.
struct Equations {
    motions: DMatrix<f64>,
    mixed: DMatrix<f64>,
    right: DVector<f64>,
    joints: DMatrix<f64>,
    right_joints: DVector<f64>,
}

/// Makes a Gauss-Newton step; returns the share of
/// the weight of points that lay on the surface of each pose.
pub fn step(state: &mut State, problem: &Problem<'_>, weights: &Weights) -> Vec<f64> {
    let Problem { points, poses, sides, cuts, is_held } = *problem;
    let n_joints = sides.len();
    let all: Vec<(Equations, f64)> = poses
        .par_iter()
        .zip(&state.motions)
        .map(|(pose, motions)| equations(motions, &state.joints, points, pose, sides, weights))
        .collect();
    let mut matrix = DMatrix::<f64>::identity(3 * n_joints, 3 * n_joints) * 1e-12;
    let mut right = DVector::<f64>::zeros(3 * n_joints);
    for (joint, &place) in cuts.iter().enumerate() {
        let at_all = if is_held[joint] { weights.held } else { weights.prior };
        let mut prior = Matrix3::identity() * at_all;
        if weights.free > 0.0 && !is_held[joint] {
            prior += known_little(&all, joint) * weights.free;
        }
        let mut view = matrix.fixed_view_mut::<3, 3>(3 * joint, 3 * joint);
        view += prior;
        let mut view = right.fixed_rows_mut::<3>(3 * joint);
        view -= prior * (state.joints[joint] - place);
    }
    let mut solved = Vec::with_capacity(all.len());
    for (it, _) in &all {
        let Some(cholesky) = it.motions.clone().cholesky() else {
            solved.push(None);
            continue;
        };
        let (mixed, own) = (cholesky.solve(&it.mixed), cholesky.solve(&it.right));
        matrix += &it.joints - it.mixed.transpose() * &mixed;
        right += &it.right_joints - it.mixed.transpose() * &own;
        solved.push(Some((mixed, own)));
    }
    let moves = match n_joints {
        0 => DVector::zeros(0),
        _ => matrix.cholesky().map_or_else(|| DVector::zeros(3 * n_joints), |it| it.solve(&right)),
    };
    for (pose, solved) in solved.iter().enumerate() {
        let Some((mixed, own)) = solved else { continue };
        let change = own - mixed * &moves;
        for (part, motion) in state.motions[pose].iter_mut().enumerate() {
            let turn = Vec3::new(change[6 * part], change[6 * part + 1], change[6 * part + 2]);
            let shift = Vec3::new(change[6 * part + 3], change[6 * part + 4], change[6 * part + 5]);
            let turn = turn * (1.0 / turn.norm()).min(1.0);
            let step = UnitQuaternion::new(turn);
            let translation = step * motion.translation.vector + shift;
            let mut rotation = step * motion.rotation;
            rotation.renormalize();
            *motion = Isometry3::from_parts(Translation3::from(translation), rotation);
        }
    }
    for (joint, place) in state.joints.iter_mut().enumerate() {
        *place += Vec3::new(moves[3 * joint], moves[3 * joint + 1], moves[3 * joint + 2]);
    }
    let total: f64 = points.iter().map(|it| it.weight).sum();
    all.iter().map(|it| if total > 0.0 { it.1 / total } else { 0.0 }).collect()
}

fn cross(a: Vec3) -> Matrix3<f64> {
    a.cross_matrix()
}

fn equations(
    motions: &[Isometry3<f64>],
    joints: &[Vec3],
    points: &[Point],
    pose: &Pose<'_>,
    sides: &[[usize; 2]],
    weights: &Weights,
) -> (Equations, f64) {
    const CHUNK: usize = 512;
    let of_chunk = |chunk: &[Point]| surface_terms(chunk, motions, pose, sides, weights);
    let chunks: Vec<Blocks> = points.par_chunks(CHUNK).map(of_chunk).collect();
    let mut blocks = Blocks::new(motions.len(), sides.len());
    chunks.iter().for_each(|it| blocks.add_all(it));
    for (part, pairs) in pose.curve.iter().enumerate() {
        let own = &blocks.parts[part].0;
        // A part that no point belongs to still follows its curve.
        let weight = weights.curve * (own[(3, 3)] + own[(4, 4)] + own[(5, 5)]).max(1e-4);
        for &(rest, now) in pairs {
            let point = Point { place: rest, normal: Vec3::zeros(), part, weight: 1.0, skin: None };
            let seen = Seen { point: &point, motions, sides };
            let residual = moved(&motions[part], rest) - now;
            blocks.add_place(&seen, residual, weight / pairs.len() as f64);
        }
    }
    (assemble(motions, joints, &blocks, sides, weights), blocks.near)
}

/// Projects onto the axes along which turns hardly say where a joint is: a hinge turns points of its axis nowhere,
/// so that gaps are the same wherever on it the joint is.
fn known_little(all: &[(Equations, f64)], joint: usize) -> Matrix3<f64> {
    /// What is known there, against the axis of which most is.
    const LITTLE: f64 = 0.03;
    let block = |it: &(Equations, f64)| -> Matrix3<f64> {
        it.0.joints.fixed_view::<3, 3>(3 * joint, 3 * joint).into_owned()
    };
    let known = all.iter().map(block).sum::<Matrix3<f64>>().symmetric_eigen();
    let most = known.eigenvalues.max();
    let axes = known.eigenvalues.iter().zip(known.eigenvectors.column_iter());
    let little = axes.filter(|(it, _)| **it < LITTLE * most);
    little.map(|(_, axis)| axis * axis.transpose()).sum()
}

/// Both sides of a joint that are farther apart than this count less and less for it.
const GAP: f64 = 0.03;

/// Joins the equations of parts by the joints and the skin between them.
fn assemble(
    motions: &[Isometry3<f64>],
    joints: &[Vec3],
    blocks: &Blocks,
    sides: &[[usize; 2]],
    weights: &Weights,
) -> Equations {
    let (n_motions, n_joints) = (6 * motions.len(), 3 * joints.len());
    let mut res = Equations {
        motions: DMatrix::identity(n_motions, n_motions) * 1e-9,
        mixed: DMatrix::zeros(n_motions, n_joints),
        right: DVector::zeros(n_motions),
        joints: DMatrix::zeros(n_joints, n_joints),
        right_joints: DVector::zeros(n_joints),
    };
    for (part, (matrix, right)) in blocks.parts.iter().enumerate() {
        let mut view = res.motions.fixed_view_mut::<6, 6>(6 * part, 6 * part);
        view += matrix;
        let mut view = res.right.fixed_rows_mut::<6>(6 * part);
        view += right;
    }
    for (&[a, b], pair) in sides.iter().zip(&blocks.pairs) {
        let mut view = res.motions.fixed_view_mut::<6, 6>(6 * a, 6 * b);
        view += pair;
        let mut view = res.motions.fixed_view_mut::<6, 6>(6 * b, 6 * a);
        view += pair.transpose();
    }
    for (joint, (&[a, b], &place)) in sides.iter().zip(joints).enumerate() {
        let [here, there] = [a, b].map(|it| moved(&motions[it], place));
        let residual = here - there;
        let identity = Matrix3::identity();
        // The change of the gap by the turns and shifts of both parts, and by the joint.
        let columns: [(usize, Matrix3<f64>); 4] = [
            (6 * a, -cross(here)),
            (6 * a + 3, identity),
            (6 * b, cross(there)),
            (6 * b + 3, -identity),
        ];
        let turns = [a, b].map(|it| motions[it].rotation.to_rotation_matrix().into_inner());
        let own = turns[0] - turns[1];
        // A part that is lost in a pose says nothing about the joint.
        let robust = GAP * GAP / (GAP * GAP + residual.norm_squared());
        let weight = weights.joint * robust * robust;
        for (row, left) in &columns {
            for (column, other) in &columns {
                let mut view = res.motions.fixed_view_mut::<3, 3>(*row, *column);
                view += left.transpose() * other * weight;
            }
            let mut view = res.mixed.fixed_view_mut::<3, 3>(*row, 3 * joint);
            view += left.transpose() * own * weight;
            let mut view = res.right.fixed_rows_mut::<3>(*row);
            view -= left.transpose() * residual * weight;
        }
        let mut view = res.joints.fixed_view_mut::<3, 3>(3 * joint, 3 * joint);
        view += own.transpose() * own * weight;
        let mut view = res.right_joints.fixed_rows_mut::<3>(3 * joint);
        view -= own.transpose() * residual * weight;
    }
    res
}
