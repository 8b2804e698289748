use crate::engine::artifact::{Artifact, ArtifactType, DecodeError, Decoder, Encoder};
use crate::kernels::rigs::weights::SkinWeights;

impl Artifact for SkinWeights {
    const TYPE: ArtifactType = ArtifactType {
        name: "weights",
        version: 1,
        doc: "Skin weights, V x Q, sparse by rows: `offsets` (V + 1), `joints`, `values`; \
              every row sums to one.",
    };

    fn encode<'a>(&'a self, to: &mut Encoder<'a>) {
        let (offsets, joints, values) = self.as_parts();
        to.owned("offsets", &[offsets.len()], offsets.iter().map(|&it| it as u64).collect());
        to.array("joints", &[joints.len()], joints);
        to.array("values", &[values.len()], values);
        to.text("n_joints", self.n_joints().to_string());
    }

    fn decode(from: &Decoder<'_>) -> Result<Self, DecodeError> {
        let offsets = from.vector::<u64>("offsets")?;
        let joints = from.vector::<u32>("joints")?;
        let values = from.vector::<f64>("values")?;
        let n_joints =
            from.text("n_joints")?.parse().map_err(|_| DecodeError::new("`n_joints`"))?;
        let offsets = offsets.iter().map(|&it| it as usize).collect();
        Self::from_parts(n_joints, offsets, joints.into_owned(), values.into_owned())
            .map_err(DecodeError)
    }

    fn summary(&self) -> Vec<(String, String)> {
        let (_, joints, _) = self.as_parts();
        let mean = joints.len() as f64 / self.n_vertices().max(1) as f64;
        vec![
            ("vertices".to_owned(), self.n_vertices().to_string()),
            ("joints".to_owned(), self.n_joints().to_string()),
            (
                "influences a vertex".to_owned(),
                format!("mean {mean:.2}, max {}", self.max_influences()),
            ),
        ]
    }
}
