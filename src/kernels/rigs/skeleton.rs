//! Skeletons: named joints in a forest, at rest.

use crate::kernels::geometry::mesh::Vec3;

/// Joints in rest pose. A parent always comes before its children.
///
/// Rest frames are aligned with the world (the SMPL convention): a pose turns a joint about world
/// axes through its rest position, so a skeleton needs no rest orientations.
#[derive(Debug, Clone, PartialEq)]
pub struct Skeleton {
    names: Vec<String>,
    parents: Vec<Option<usize>>,
    positions: Vec<Vec3>,
}

/// Why something is no skeleton.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SkeletonError {
    #[error("the skeleton has no joints")]
    NoJoints,
    #[error("the skeleton has {names} names, {parents} parents and {positions} positions")]
    Counts { names: usize, parents: usize, positions: usize },
    #[error("joint {joint} (`{name}`) has the parent {parent}, which does not come before it")]
    ParentOrder { joint: usize, name: String, parent: usize },
    #[error("two joints have the name `{name}`")]
    SameName { name: String },
    #[error("joint `{name}` has the coordinate {value}")]
    NotFinite { name: String, value: f64 },
}

impl Skeleton {
    /// Checks and wraps `Q` joints.
    ///
    /// # Errors
    /// See [`SkeletonError`].
    pub fn new(
        names: Vec<String>,
        parents: Vec<Option<usize>>,
        positions: Vec<Vec3>,
    ) -> Result<Self, SkeletonError> {
        if names.is_empty() {
            return Err(SkeletonError::NoJoints);
        }
        if names.len() != parents.len() || names.len() != positions.len() {
            return Err(SkeletonError::Counts {
                names: names.len(),
                parents: parents.len(),
                positions: positions.len(),
            });
        }
        for (joint, &parent) in parents.iter().enumerate() {
            if let Some(parent) = parent.filter(|&it| it >= joint) {
                return Err(SkeletonError::ParentOrder {
                    joint,
                    name: names[joint].clone(),
                    parent,
                });
            }
        }
        let mut sorted: Vec<&String> = names.iter().collect();
        sorted.sort();
        if let Some(pair) = sorted.windows(2).find(|it| it[0] == it[1]) {
            return Err(SkeletonError::SameName { name: pair[0].clone() });
        }
        for (name, position) in names.iter().zip(&positions) {
            if let Some(&value) = position.iter().find(|it| !it.is_finite()) {
                return Err(SkeletonError::NotFinite { name: name.clone(), value });
            }
        }
        Ok(Self { names, parents, positions })
    }

    pub fn n_joints(&self) -> usize {
        self.names.len()
    }

    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// The parent of every joint; `None` for roots. Always a smaller index.
    pub fn parents(&self) -> &[Option<usize>] {
        &self.parents
    }

    /// World positions at rest.
    pub fn positions(&self) -> &[Vec3] {
        &self.positions
    }

    /// Finds a joint by its name.
    pub fn joint(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|it| it == name)
    }

    /// Every (parent, child) pair, in the children's order.
    pub fn bones(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        self.parents.iter().enumerate().filter_map(|(child, &parent)| Some((parent?, child)))
    }

    /// The children of every joint, in order.
    pub fn children(&self) -> Vec<Vec<usize>> {
        let mut children = vec![Vec::new(); self.n_joints()];
        for (parent, child) in self.bones() {
            children[parent].push(child);
        }
        children
    }

    /// The same joints at other positions.
    ///
    /// # Errors
    /// [`SkeletonError::Counts`] or [`SkeletonError::NotFinite`].
    pub fn with_positions(&self, positions: Vec<Vec3>) -> Result<Self, SkeletonError> {
        Self::new(self.names.clone(), self.parents.clone(), positions)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parent_comes_before_its_children() {
        let names = vec!["hip".to_owned(), "knee".to_owned()];
        let positions = vec![Vec3::zeros(), Vec3::y()];
        let skeleton =
            Skeleton::new(names.clone(), vec![None, Some(0)], positions.clone()).unwrap();
        assert_eq!(skeleton.bones().collect::<Vec<_>>(), [(0, 1)]);
        let error = Skeleton::new(names, vec![Some(1), None], positions).unwrap_err();
        assert_eq!(
            error.to_string(),
            "joint 0 (`hip`) has the parent 1, which does not come before it"
        );
    }
}
