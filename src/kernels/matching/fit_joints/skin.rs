//! Skin near joints, which moves partly with one side of the joint and partly with the other.

use rayon::prelude::*;

use super::blocks::{Point, is_same_side};
use super::fitted::Setting;
use super::parts::on_bone;
use super::solve::{Pose, State};
use crate::kernels::geometry::mesh::Vec3;

/// Skin is looked for up to this distance along the curve from a joint.
const WIDE: f64 = 0.1;

/// Shares are multiples of one over this.
const N_SHARES: usize = 10;

/// What a share off the expected one costs, squared, where 1 is a point that is off all surfaces.
const STIFFNESS: f64 = 0.1;

/// Gives every point near a joint the share with which it moves as the part behind the joint: that with which
/// it lies best on the surfaces of all poses, and which is near to what it is where skin goes over evenly.
/// Such points count as all others.
pub fn blend_skin(points: &mut [Point], setting: &Setting<'_>, state: &State) {
    let Setting { figure, parts, cuts, .. } = setting;
    let skeleton = &figure.skeleton;
    points.par_iter_mut().zip(&figure.samples).for_each(|(point, sample)| {
        let place = on_bone(skeleton, skeleton.positions(), sample.bone, sample.share);
        let near = |(joint, (sides, cut)): (usize, (&[usize; 2], &Vec3))| {
            sides.contains(&point.part).then(|| ((cut - place).norm(), joint))
        };
        let all = parts.sides.iter().zip(cuts).enumerate().filter_map(near);
        let nearest = all.min_by(|a, b| a.0.total_cmp(&b.0)).filter(|it| it.0 < WIDE);
        let Some((distance, joint)) = nearest else { return };
        let of_other = 0.5 * (1.0 - distance / WIDE);
        let is_behind = parts.sides[joint][1] == point.part;
        let expected = if is_behind { 1.0 - of_other } else { of_other };
        let cost = |share: f64| {
            let skin = Point { skin: Some((joint, share)), ..*point };
            off(&skin, setting, state) + STIFFNESS * (share - expected).powi(2)
        };
        let shares = (0..=N_SHARES).map(|it| it as f64 / N_SHARES as f64);
        let costs = shares.map(|it| (cost(it), it));
        let best = costs.min_by(|a, b| a.0.total_cmp(&b.0)).expect("there are shares");
        (point.skin, point.weight) = (Some((joint, best.1)), sample.area);
    });
}

/// How far a point is off the surfaces of all poses in the mean, from 0 to 1.
fn off(point: &Point, setting: &Setting<'_>, state: &State) -> f64 {
    let Setting { parts, poses, options, .. } = setting;
    let square = options.reach * options.reach;
    let off = |(motions, pose): (&Vec<_>, &Pose<'_>)| {
        let (place, normal) = point.in_pose(motions, &parts.sides);
        let near = pose.surface.nearest_within(place, square);
        near.filter(|it| is_same_side(normal, pose.normals[it.face as usize]))
            .map_or(1.0, |it| it.square / square)
    };
    state.motions.iter().zip(poses).map(off).sum::<f64>() / poses.len().max(1) as f64
}
