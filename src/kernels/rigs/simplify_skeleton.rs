//! Skeletons with some of their joints left out.

use glob::Pattern;
use nalgebra::{Isometry3, Translation3};

use super::clip::Clip;
use super::skeleton::Skeleton;
use super::weights::SkinWeights;

/// Which joints stay.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct JointChoice {
    /// Names or patterns with `*`, `?` and `[…]`; all joints if it is empty.
    pub keep: Vec<String>,
    /// Names or patterns of joints that go, among those.
    pub remove: Vec<String>,
}

/// Why joints cannot be chosen.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ChoiceError {
    #[error("`{pattern}` is no pattern: {what}")]
    Pattern { pattern: String, what: String },
    #[error("no joint is called `{pattern}`; the joints are {joints}")]
    NoSuchJoint { pattern: String, joints: String },
    #[error("no joint is left of {n_joints}")]
    NothingLeft { n_joints: usize },
    #[error("the skeleton has {skeleton} joints, but the {what} belong to {found}")]
    Joints { skeleton: usize, what: &'static str, found: usize },
}

/// A choice of a skeleton's joints.
#[derive(Debug, Clone, PartialEq)]
pub struct Simplification {
    /// The joints that stay, hung on the nearest ancestor that stays.
    pub skeleton: Skeleton,
    /// The old index of every joint.
    pub old_of_new: Vec<usize>,
    /// For every old joint the new one that takes over its weights: itself, the nearest ancestor that
    /// stays, or else the descendant that stays and comes first.
    pub new_of_old: Vec<usize>,
    old_parents: Vec<Option<usize>>,
}

/// Leaves joints out of a skeleton.
///
/// # Errors
/// See [`ChoiceError`].
pub fn simplify_skeleton(
    skeleton: &Skeleton,
    choice: &JointChoice,
) -> Result<Simplification, ChoiceError> {
    let kept = kept_joints(skeleton, choice)?;
    let parents = skeleton.parents();
    let old_of_new: Vec<usize> = (0..kept.len()).filter(|&it| kept[it]).collect();
    if old_of_new.is_empty() {
        return Err(ChoiceError::NothingLeft { n_joints: kept.len() });
    }
    let new_index = |old: usize| old_of_new.binary_search(&old).expect("a joint that stays");
    // By old joint: the nearest that stays, upward from the joint itself.
    let mut above: Vec<Option<usize>> = Vec::with_capacity(kept.len());
    for (joint, parent) in parents.iter().enumerate() {
        let inherited = parent.and_then(|it| above[it]);
        above.push(if kept[joint] { Some(new_index(joint)) } else { inherited });
    }
    let new_parents =
        old_of_new.iter().map(|&it| parents[it].and_then(|parent| above[parent])).collect();
    let below = first_below(parents, &above);
    let new_of_old =
        (0..kept.len()).map(|it| above[it].or(below[it]).unwrap_or_default()).collect();
    let names = old_of_new.iter().map(|&it| skeleton.names()[it].clone()).collect();
    let positions = old_of_new.iter().map(|&it| skeleton.positions()[it]).collect();
    Ok(Simplification {
        skeleton: Skeleton::new(names, new_parents, positions).expect("joints of a skeleton"),
        old_of_new,
        new_of_old,
        old_parents: parents.to_vec(),
    })
}

/// For joints without a joint that stays above them, the first one below.
fn first_below(parents: &[Option<usize>], above: &[Option<usize>]) -> Vec<Option<usize>> {
    let mut below: Vec<Option<usize>> = above.to_vec();
    for joint in (0..parents.len()).rev() {
        let (Some(parent), Some(found)) = (parents[joint], below[joint]) else { continue };
        if above[parent].is_none() {
            below[parent] = Some(below[parent].map_or(found, |it| it.min(found)));
        }
    }
    below
}

fn kept_joints(skeleton: &Skeleton, choice: &JointChoice) -> Result<Vec<bool>, ChoiceError> {
    let names = skeleton.names();
    let mut kept = vec![choice.keep.is_empty(); names.len()];
    for (patterns, stays) in [(&choice.keep, true), (&choice.remove, false)] {
        for text in patterns {
            let pattern = Pattern::new(text).map_err(|e| ChoiceError::Pattern {
                pattern: text.clone(),
                what: e.msg.to_owned(),
            })?;
            let mut found = false;
            for (name, kept) in names.iter().zip(&mut kept) {
                if name == text || pattern.matches(name) {
                    (*kept, found) = (stays, true);
                }
            }
            if !found {
                let joints: Vec<String> = names.iter().map(|it| format!("`{it}`")).collect();
                let (pattern, joints) = (text.clone(), joints.join(", "));
                return Err(ChoiceError::NoSuchJoint { pattern, joints });
            }
        }
    }
    Ok(kept)
}

impl Simplification {
    /// The skin weights: those of a joint that went are its successor's.
    ///
    /// # Errors
    /// [`ChoiceError::Joints`].
    pub fn weights(&self, weights: &SkinWeights) -> Result<SkinWeights, ChoiceError> {
        self.check("weights", weights.n_joints())?;
        let mut rows = weights.to_rows();
        for entry in rows.iter_mut().flatten() {
            entry.0 = self.new_of_old[entry.0 as usize] as u32;
        }
        let n_joints = self.skeleton.n_joints();
        Ok(SkinWeights::from_rows(n_joints, &rows).expect("rows that summed to one"))
    }

    /// The clip: joints that stay move as before.
    ///
    /// # Errors
    /// [`ChoiceError::Joints`].
    pub fn clip(&self, clip: &Clip) -> Result<Clip, ChoiceError> {
        self.check("motions", clip.n_joints)?;
        let n_joints = self.skeleton.n_joints();
        let capacity = clip.n_frames() * n_joints;
        let mut res = Clip {
            name: clip.name.clone(),
            frames_per_second: clip.frames_per_second,
            n_joints,
            rotations: Vec::with_capacity(capacity),
            translations: Vec::with_capacity(capacity),
        };
        for frame in 0..clip.n_frames() {
            let local = |joint: usize| {
                let at = frame * clip.n_joints + joint;
                let place = Translation3::from(clip.translations[at]);
                Isometry3::from_parts(place, clip.rotations[at])
            };
            for (new, &old) in self.old_of_new.iter().enumerate() {
                let end = self.skeleton.parents()[new].map(|it| self.old_of_new[it]);
                let mut parent_from_joint = local(old);
                let mut next = self.old_parents[old];
                while let Some(joint) = next.filter(|_| next != end) {
                    parent_from_joint = local(joint) * parent_from_joint;
                    next = self.old_parents[joint];
                }
                res.rotations.push(parent_from_joint.rotation);
                res.translations.push(parent_from_joint.translation.vector);
            }
        }
        Ok(res)
    }

    fn check(&self, what: &'static str, found: usize) -> Result<(), ChoiceError> {
        let skeleton = self.new_of_old.len();
        if skeleton == found {
            return Ok(());
        }
        Err(ChoiceError::Joints { skeleton, what, found })
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::UnitQuaternion;

    use super::*;
    use crate::kernels::geometry::mesh::Vec3;
    use crate::kernels::rigs::skinning::world_from_joint;

    /// root - hip - (legL - footL, legR - footR), root - spine.
    fn skeleton() -> Skeleton {
        let names = ["root", "hip", "leg_l", "leg_r", "foot_l", "foot_r", "spine"];
        let parents = vec![None, Some(0), Some(1), Some(1), Some(2), Some(3), Some(0)];
        let positions = (0..7).map(|it| Vec3::new(f64::from(it), f64::from(it * it), 0.5));
        Skeleton::new(names.map(str::to_owned).to_vec(), parents, positions.collect()).unwrap()
    }

    fn choose(keep: &[&str], remove: &[&str]) -> Result<Simplification, ChoiceError> {
        let owned = |it: &[&str]| it.iter().map(|&it| it.to_owned()).collect();
        simplify_skeleton(&skeleton(), &JointChoice { keep: owned(keep), remove: owned(remove) })
    }

    #[test]
    fn children_hang_on_the_nearest_ancestor_that_stays() {
        let simple = choose(&[], &["hip", "foot_*"]).unwrap();
        assert_eq!(simple.skeleton.names(), ["root", "leg_l", "leg_r", "spine"]);
        assert_eq!(simple.skeleton.parents(), [None, Some(0), Some(0), Some(0)]);
        assert_eq!(simple.new_of_old, [0, 0, 1, 2, 1, 2, 3]);
        assert_eq!(choose(&["*"], &[]).unwrap().skeleton, skeleton());
    }

    #[test]
    fn what_stood_above_all_goes_to_the_first_below() {
        let simple = choose(&["leg_?", "spine"], &[]).unwrap();
        assert_eq!(simple.skeleton.parents(), [None, None, None]);
        assert_eq!(simple.new_of_old, [0, 0, 0, 1, 0, 1, 2]);
    }

    #[test]
    fn weights_of_joints_that_went_are_added() {
        let row = vec![(1, 0.25), (0, 0.5), (4, 0.25)];
        let weights = SkinWeights::from_rows(7, &[row]).unwrap();
        let merged = choose(&[], &["hip", "foot_*"]).unwrap().weights(&weights).unwrap();
        assert_eq!(merged.n_joints(), 4);
        assert_eq!(merged.row(0).collect::<Vec<_>>(), [(0, 0.75), (1, 0.25)]);
        let few = SkinWeights::from_rows(3, &[vec![(1, 1.0)]]).unwrap();
        assert_eq!(
            choose(&["root"], &[]).unwrap().weights(&few).unwrap_err().to_string(),
            "the skeleton has 7 joints, but the weights belong to 3"
        );
    }

    #[test]
    fn joints_that_stay_move_as_before() {
        let own = skeleton();
        let turn = |it: usize| {
            UnitQuaternion::from_euler_angles(0.1 * it as f64, 0.3, 0.2 * (it % 3) as f64)
        };
        let clip = Clip {
            name: "wave".to_owned(),
            frames_per_second: 30.0,
            n_joints: 7,
            rotations: (0..14).map(turn).collect(),
            translations: (0..14).map(|it| Vec3::new(0.1, f64::from(it), 1.0)).collect(),
        };
        for choice in [choose(&[], &["hip", "foot_*"]), choose(&["leg_?", "spine"], &[])] {
            let simple = choice.unwrap();
            let few = simple.clip(&clip).unwrap();
            for frame in 0..2 {
                let all = world_from_joint(&own, &clip, frame).unwrap();
                let kept = world_from_joint(&simple.skeleton, &few, frame).unwrap();
                for (new, &old) in simple.old_of_new.iter().enumerate() {
                    let gap = (kept[new].inverse() * all[old]).to_homogeneous()
                        - nalgebra::Matrix4::identity();
                    assert!(gap.norm() < 1e-12, "{gap}");
                }
            }
        }
    }

    #[test]
    fn choices_that_mean_nothing_are_refused() {
        let error = |keep: &[&str], remove: &[&str]| choose(keep, remove).unwrap_err().to_string();
        assert_eq!(error(&["*"], &["*"]), "no joint is left of 7");
        assert_eq!(
            error(&["tail"], &[]),
            "no joint is called `tail`; the joints are `root`, `hip`, `leg_l`, `leg_r`, `foot_l`, \
             `foot_r`, `spine`"
        );
        assert!(error(&["[a"], &[]).starts_with("`[a` is no pattern: "));
    }
}
