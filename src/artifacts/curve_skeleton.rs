use super::mesh::{points, put_points};
use crate::engine::artifact::{Artifact, ArtifactType, DecodeError, Decoder, Encoder};
use crate::kernels::curve_skeletons::curve_skeleton::CurveSkeleton;

impl Artifact for CurveSkeleton {
    const TYPE: ArtifactType = ArtifactType {
        name: "curve_skeleton",
        version: 1,
        doc: "A graph of curves inside a shape: `positions` (N x 3), `radii` (N), `edges` (E x 2), \
              `node_of_vertex` (V, 4294967295 for none; empty if unknown).",
    };

    fn encode<'a>(&'a self, to: &mut Encoder<'a>) {
        put_points(to, "positions", self.positions());
        to.array("radii", &[self.n_nodes()], self.radii());
        to.array("edges", &[self.n_edges(), 2], bytemuck::cast_slice::<_, u32>(self.edges()));
        to.array("node_of_vertex", &[self.node_of_vertex().len()], self.node_of_vertex());
    }

    fn decode(from: &Decoder<'_>) -> Result<Self, DecodeError> {
        let (_, 2, edges) = from.matrix::<u32>("edges")? else {
            return Err(DecodeError::new("`edges` has no two columns"));
        };
        let edges = edges.chunks_exact(2).map(|it| [it[0], it[1]]).collect();
        let radii = from.vector::<f64>("radii")?.into_owned();
        let labels = from.vector::<u32>("node_of_vertex")?.into_owned();
        Self::new(points(from, "positions")?, radii, edges, labels)
            .map_err(|e| DecodeError::new(e.to_string()))
    }

    fn summary(&self) -> Vec<(String, String)> {
        let counts = [
            ("nodes", self.n_nodes()),
            ("edges", self.n_edges()),
            ("components", self.n_components()),
            ("leaves", self.leaves().len()),
            ("junctions", self.junctions().len()),
            ("cycles", self.n_cycles()),
            ("vertices", self.node_of_vertex().len()),
        ];
        let mut lines: Vec<(String, String)> =
            counts.iter().map(|(name, count)| ((*name).to_owned(), count.to_string())).collect();
        // An empty sum is -0.
        lines.push(("length".to_owned(), format!("{:.6}", self.total_length() + 0.0)));
        lines
    }
}
