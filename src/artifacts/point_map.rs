use crate::engine::artifact::{Artifact, ArtifactType, DecodeError, Decoder, Encoder};
use crate::kernels::maps::functional_map::PointMap;

impl Artifact for PointMap {
    const TYPE: ArtifactType = ArtifactType {
        name: "point_map",
        version: 1,
        doc: "For every source vertex a target vertex: `target_of_source` (V_source indices).",
    };

    fn encode<'a>(&'a self, to: &mut Encoder<'a>) {
        to.array("target_of_source", &[self.target_of_source.len()], &self.target_of_source);
        to.text("n_target", self.n_target.to_string());
    }

    fn decode(from: &Decoder<'_>) -> Result<Self, DecodeError> {
        let n_target: usize =
            from.text("n_target")?.parse().map_err(|_| DecodeError::new("`n_target`"))?;
        let target_of_source = from.vector::<u32>("target_of_source")?.into_owned();
        if let Some(vertex) = target_of_source.iter().find(|&&it| it as usize >= n_target) {
            return Err(DecodeError(format!("vertex {vertex} of {n_target} is matched")));
        }
        Ok(Self { target_of_source, n_target })
    }

    fn summary(&self) -> Vec<(String, String)> {
        let mut hit = self.target_of_source.clone();
        hit.sort_unstable();
        hit.dedup();
        let percent = 100.0 * hit.len() as f64 / self.n_target.max(1) as f64;
        vec![
            ("source vertices".to_owned(), self.target_of_source.len().to_string()),
            (
                "target vertices".to_owned(),
                format!("{}, of which {} ({percent:.0} %) are matched", self.n_target, hit.len()),
            ),
        ]
    }
}
