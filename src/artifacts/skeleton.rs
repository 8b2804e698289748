use super::mesh::{points, put_points, show_point};
use crate::engine::artifact::{Artifact, ArtifactType, DecodeError, Decoder, Encoder};
use crate::kernels::rigs::skeleton::Skeleton;

impl Artifact for Skeleton {
    const TYPE: ArtifactType = ArtifactType {
        name: "skeleton",
        version: 1,
        doc: "Joints at rest: `positions` (Q x 3), `parents` (Q, -1 for a root), `names`.",
    };

    fn encode<'a>(&'a self, to: &mut Encoder<'a>) {
        put_points(to, "positions", self.positions());
        put_parents(to, self.parents());
        to.texts("names", self.names());
    }

    fn decode(from: &Decoder<'_>) -> Result<Self, DecodeError> {
        Self::new(from.texts("names")?, parents(from)?, points(from, "positions")?)
            .map_err(|e| DecodeError::new(e.to_string()))
    }

    fn summary(&self) -> Vec<(String, String)> {
        let mut lines = vec![("joints".to_owned(), self.n_joints().to_string())];
        for joint in 0..self.n_joints() {
            let parent = self.parents()[joint].map_or("root", |it| self.names()[it].as_str());
            let position = show_point(&self.positions()[joint]);
            lines.push((self.names()[joint].clone(), format!("{position}  (of {parent})")));
        }
        lines
    }
}

/// Writes the parents of joints, -1 for roots.
pub fn put_parents(to: &mut Encoder<'_>, parents: &[Option<usize>]) {
    let values: Vec<i64> = parents.iter().map(|it| it.map_or(-1, |it| it as i64)).collect();
    to.owned("parents", &[values.len()], values);
}

/// Reads the parents of joints.
///
/// # Errors
/// If the array is missing or holds a number that is neither -1 nor an index of a joint before.
pub fn parents(from: &Decoder<'_>) -> Result<Vec<Option<usize>>, DecodeError> {
    let values = from.vector::<i64>("parents")?;
    let read = |(joint, &value): (usize, &i64)| match usize::try_from(value) {
        Ok(parent) if parent < joint => Ok(Some(parent)),
        Err(_) if value == -1 => Ok(None),
        _ => Err(DecodeError(format!("joint {joint} has the parent {value}"))),
    };
    values.iter().enumerate().map(read).collect()
}
