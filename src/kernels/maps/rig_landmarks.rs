//! Landmarks of a rigged mesh: extreme vertices of what named joints move.

use crate::kernels::{
    geometry::{
        landmarks::Landmarks,
        mesh::{TriMesh, Vec3},
    },
    rigs::{skeleton::Skeleton, weights::SkinWeights},
};

/// One landmark to be found.
#[derive(Debug, Clone, PartialEq)]
pub struct LandmarkPick {
    pub name: String,
    /// The joint whose vertices are searched.
    pub joint: String,
    pub direction: PickDirection,
    /// Search what the joint's descendants move as well.
    pub with_descendants: bool,
}

/// In which direction the landmark is the farthest vertex.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PickDirection {
    /// From the joint's parent to the joint: the tip of a limb.
    Bone,
    /// A fixed direction of any length.
    Fixed(Vec3),
}

/// Why a landmark cannot be found.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PickError {
    #[error("landmark `{name}`: the skeleton has no joint `{joint}`")]
    NoJoint { name: String, joint: String },
    #[error("landmark `{name}`: no vertex is moved mostly by joint `{joint}`")]
    NoVertex { name: String, joint: String },
    #[error(
        "landmark `{name}`: joint `{joint}` has no bone that would show a direction; choose one"
    )]
    NoBone { name: String, joint: String },
    #[error(
        "the mesh has {mesh} vertices and the skeleton {skeleton} joints, but the weights are \
         {n_vertices} x {n_joints}"
    )]
    Counts { mesh: usize, skeleton: usize, n_vertices: usize, n_joints: usize },
}

/// Finds landmarks: of the vertices that a joint moves the most, the farthest in a direction.
///
/// Ties go to the smallest index. The same picks on two shapes of one rig give landmarks that
/// correspond.
///
/// # Errors
/// See [`PickError`].
pub fn rig_landmarks(
    mesh: &TriMesh,
    skeleton: &Skeleton,
    weights: &SkinWeights,
    picks: &[LandmarkPick],
) -> Result<Landmarks, PickError> {
    let (n_vertices, n_joints) = (weights.n_vertices(), weights.n_joints());
    if mesh.n_vertices() != n_vertices || skeleton.n_joints() != n_joints {
        let (mesh, skeleton) = (mesh.n_vertices(), skeleton.n_joints());
        return Err(PickError::Counts { mesh, skeleton, n_vertices, n_joints });
    }
    let owners: Vec<usize> = (0..n_vertices).map(|vertex| owner(weights, vertex)).collect();
    let mut landmarks = Landmarks { names: Vec::new(), vertices: Vec::new() };
    for pick in picks {
        landmarks.names.push(pick.name.clone());
        landmarks.vertices.push(find(mesh, skeleton, &owners, pick)?);
    }
    Ok(landmarks)
}

/// The joint that moves a vertex the most.
fn owner(weights: &SkinWeights, vertex: usize) -> usize {
    let mut best = (0, -1.0);
    for (joint, weight) in weights.row(vertex) {
        if weight > best.1 {
            best = (joint as usize, weight);
        }
    }
    best.0
}

fn find(
    mesh: &TriMesh,
    skeleton: &Skeleton,
    owners: &[usize],
    pick: &LandmarkPick,
) -> Result<u32, PickError> {
    let (name, joint_name) = (pick.name.clone(), pick.joint.clone());
    let Some(joint) = skeleton.joint(&pick.joint) else {
        return Err(PickError::NoJoint { name, joint: joint_name });
    };
    let direction = match pick.direction {
        PickDirection::Fixed(direction) => direction,
        PickDirection::Bone => match bone(skeleton, joint) {
            Some(direction) => direction,
            None => return Err(PickError::NoBone { name, joint: joint_name }),
        },
    };
    let belongs = |owner: usize| {
        owner == joint || (pick.with_descendants && descends(skeleton, owner, joint))
    };
    let mut farthest = None;
    for (vertex, position) in mesh.vertices().iter().enumerate() {
        let reach = position.dot(&direction);
        if belongs(owners[vertex]) && farthest.is_none_or(|(_, most)| reach > most) {
            farthest = Some((vertex as u32, reach));
        }
    }
    farthest.map(|it| it.0).ok_or(PickError::NoVertex { name, joint: joint_name })
}

/// From the nearest ancestor at another place to the joint.
fn bone(skeleton: &Skeleton, joint: usize) -> Option<Vec3> {
    let end = skeleton.positions()[joint];
    let mut ancestor = skeleton.parents()[joint];
    while let Some(it) = ancestor {
        if let Some(direction) = (end - skeleton.positions()[it]).try_normalize(0.0) {
            return Some(direction);
        }
        ancestor = skeleton.parents()[it];
    }
    None
}

fn descends(skeleton: &Skeleton, joint: usize, ancestor: usize) -> bool {
    let mut at = Some(joint);
    while let Some(it) = at {
        if it == ancestor {
            return true;
        }
        at = skeleton.parents()[it];
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes::rectangle;

    /// A strip from 0 to 4 along x; three joints at 1, 2, 3 move what is nearest to them.
    fn strip() -> (TriMesh, Skeleton, SkinWeights) {
        let mesh = rectangle(8, 1, 4.0, 1.0);
        let names = ["hip", "knee", "foot"].map(str::to_owned).to_vec();
        let positions = [1.0, 2.0, 3.0].map(|x| Vec3::new(x, 0.5, 0.0)).to_vec();
        let skeleton = Skeleton::new(names, vec![None, Some(0), Some(1)], positions).unwrap();
        let joint = |x: f64| (x.round().clamp(1.0, 3.0) - 1.0) as u32;
        let rows: Vec<_> = mesh.vertices().iter().map(|it| vec![(joint(it.x), 1.0)]).collect();
        (mesh, skeleton, SkinWeights::from_rows(3, &rows).unwrap())
    }

    fn pick(joint: &str, direction: PickDirection, with_descendants: bool) -> LandmarkPick {
        LandmarkPick { name: "it".to_owned(), joint: joint.to_owned(), direction, with_descendants }
    }

    #[test]
    fn tips_lie_at_the_ends_of_limbs() {
        let (mesh, skeleton, weights) = strip();
        let find =
            |pick| rig_landmarks(&mesh, &skeleton, &weights, &[pick]).map(|it| it.vertices[0]);
        let at = |vertex: u32| mesh.vertices()[vertex as usize].x;
        assert_eq!(at(find(pick("foot", PickDirection::Bone, true)).unwrap()), 4.0);
        assert_eq!(at(find(pick("knee", PickDirection::Bone, true)).unwrap()), 4.0);
        assert!(at(find(pick("knee", PickDirection::Bone, false)).unwrap()) < 2.6);
        let back = PickDirection::Fixed(-Vec3::x());
        assert_eq!(at(find(pick("hip", back, false)).unwrap()), 0.0);
        assert_eq!(
            find(pick("hip", PickDirection::Bone, true)).unwrap_err().to_string(),
            "landmark `it`: joint `hip` has no bone that would show a direction; choose one"
        );
        assert_eq!(
            find(pick("tail", back, true)).unwrap_err().to_string(),
            "landmark `it`: the skeleton has no joint `tail`"
        );
    }
}
