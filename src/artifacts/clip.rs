use nalgebra::{Quaternion, UnitQuaternion};

use super::mesh::{points, put_points};
use crate::engine::artifact::{Artifact, ArtifactType, DecodeError, Decoder, Encoder};
use crate::kernels::rigs::clip::Clip;

impl Artifact for Clip {
    const TYPE: ArtifactType = ArtifactType {
        name: "clip",
        version: 1,
        doc: "Animation: `rotations` (T*Q x 4 quaternions x y z w, relative to the parent, frames \
              aligned with the world at rest) and `translations` (T*Q x 3 offsets from the parent).",
    };

    fn encode<'a>(&'a self, to: &mut Encoder<'a>) {
        let rotations = self.rotations.iter().flat_map(|it| [it.i, it.j, it.k, it.w]).collect();
        to.owned::<f64>("rotations", &[self.rotations.len(), 4], rotations);
        put_points(to, "translations", &self.translations);
        to.owned("frames_per_second", &[1], vec![self.frames_per_second]);
        to.owned("n_joints", &[1], vec![self.n_joints as u64]);
        to.text("name", self.name.as_str());
    }

    fn decode(from: &Decoder<'_>) -> Result<Self, DecodeError> {
        let (n_rotations, 4, values) = from.matrix::<f64>("rotations")? else {
            return Err(DecodeError::new("`rotations` has no four columns"));
        };
        let translations = points(from, "translations")?;
        let n_joints = from.vector::<u64>("n_joints")?;
        let rate = from.vector::<f64>("frames_per_second")?;
        let (&[n_joints], &[frames_per_second]) = (&n_joints[..], &rate[..]) else {
            return Err(DecodeError::new("`n_joints` and `frames_per_second` are one number each"));
        };
        let n_joints = usize::try_from(n_joints).unwrap_or(0);
        if n_joints == 0 || n_rotations % n_joints != 0 || translations.len() != n_rotations {
            let n_translations = translations.len();
            return Err(DecodeError(format!(
                "{n_rotations} rotations and {n_translations} translations of {n_joints} joints"
            )));
        }
        if !(frames_per_second > 0.0 && frames_per_second.is_finite()) {
            return Err(DecodeError(format!("{frames_per_second} frames a second")));
        }
        let mut rotations = Vec::with_capacity(n_rotations);
        for it in values.chunks_exact(4) {
            let quaternion = Quaternion::new(it[3], it[0], it[1], it[2]);
            if !((quaternion.norm() - 1.0).abs() < 1e-6) {
                return Err(DecodeError(format!("a rotation has the norm {}", quaternion.norm())));
            }
            rotations.push(UnitQuaternion::new_unchecked(quaternion));
        }
        let name = from.text("name")?.to_owned();
        Ok(Self { name, frames_per_second, n_joints, rotations, translations })
    }

    fn summary(&self) -> Vec<(String, String)> {
        vec![
            ("name".to_owned(), self.name.clone()),
            ("frames".to_owned(), self.n_frames().to_string()),
            ("frames a second".to_owned(), self.frames_per_second.to_string()),
            ("duration".to_owned(), format!("{:.2} s", self.duration_secs())),
            ("joints".to_owned(), self.n_joints.to_string()),
        ]
    }
}
