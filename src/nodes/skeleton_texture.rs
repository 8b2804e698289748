//! Kind `skeleton_texture`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::geometry::mesh::TriMesh;
use crate::kernels::image::Image;
use crate::kernels::matching::skeleton_texture::{
    Side, SkeletonTexture, SkeletonTextureOptions, Texels, skeleton_texture,
};
use crate::kernels::rigs::segment_map::SegmentMap;
use crate::kernels::rigs::skeleton::Skeleton;
use crate::kernels::rigs::weights::SkinWeights;
use crate::kernels::table::{Column, Table};

/// Gives a body skin weights of another by textures around the bones of both.
///
/// Skeleton texture mapping: surfaces are unrolled around their bones into rectangles; a `map` of the
/// bones says which rectangle is copied where. No correspondence of the surfaces is needed, but
/// skeletons that lie inside of them. Where too little of a surface sees its skeleton, the weights are
/// those of `skin_weights`.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SkeletonTextureNode {
    /// Texels along a side of the square texture.
    #[schemars(range(min = 16, max = 8192))]
    pub resolution: usize,
    /// What a texel holds.
    pub texels: Texels,
    /// Whether angles around a bone are shifted, in steps of 22.5 degrees, where the shapes of both
    /// bodies say so. Otherwise only the skeletons' rest poses do.
    pub correct_phase: bool,
    /// Steps of diffusion over the target's edges, which close seams between rectangles.
    #[schemars(range(min = 0, max = 1000))]
    pub smoothing: usize,
    /// The joints kept a vertex, the heaviest; 0 for all.
    #[schemars(range(min = 0, max = 64))]
    pub max_influences: usize,
    /// The least share of vertices that must see a bone, on both bodies.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub least_covered: f64,
}

impl Default for SkeletonTextureNode {
    fn default() -> Self {
        let it = SkeletonTextureOptions::default();
        Self {
            resolution: it.resolution,
            texels: it.texels,
            correct_phase: it.correct_phase,
            smoothing: it.smoothing,
            max_influences: it.max_influences,
            least_covered: it.least_covered,
        }
    }
}

impl SkeletonTextureNode {
    const SOURCE_MESH: Input<TriMesh> = Input::new("source_mesh", "the body that has weights");
    const SOURCE: Input<Skeleton> = Input::new("source_skeleton", "its joints");
    const SOURCE_WEIGHTS: Input<SkinWeights> = Input::new("source_weights", "its weights");
    const TARGET_MESH: Input<TriMesh> = Input::new("target_mesh", "the body that gets weights");
    const TARGET: Input<Skeleton> = Input::new("target_skeleton", "its joints");
    const MAP: Input<SegmentMap> = Input::new("map", "which target bones follow which");
    const WEIGHTS: Output<SkinWeights> = Output::new("weights", "how the target's joints move it");
    const TEXTURE: Output<Image> =
        Output::new("texture", "the target's texture, a hue for each of the source's joints");
    const SOURCE_TEXTURE: Output<Image> = Output::new("source_texture", "that of the source");
    const RELIABILITY: Output<Table> =
        Output::new("reliability", "one row a body: how much of it sees its skeleton");
}

impl Node for SkeletonTextureNode {
    const SPEC: Spec = Spec {
        kind: "skeleton_texture",
        version: 1,
        inputs: &[
            Self::SOURCE_MESH.port(),
            Self::SOURCE.port(),
            Self::SOURCE_WEIGHTS.port(),
            Self::TARGET_MESH.port(),
            Self::TARGET.port(),
            Self::MAP.port(),
        ],
        outputs: &[
            Self::WEIGHTS.port(),
            Self::TEXTURE.port().aside(),
            Self::SOURCE_TEXTURE.port().aside(),
            Self::RELIABILITY.port().aside(),
        ],
        cites: &["madaras2014skeleton", "baran2007automatic"],
        example: r#"[nodes.adult]
kind = "synthesize"
n_vertices = 1000

[nodes.other]
kind = "synthesize"
n_vertices = 1000
seed = 1
pose = "t"

[nodes.map]
kind = "segments_by_name"
source_skeleton = "@adult.skeleton"
target_skeleton = "@other.skeleton"

[nodes.skin]
kind = "skeleton_texture"
source_mesh = "@adult.mesh"
source_skeleton = "@adult.skeleton"
source_weights = "@adult.weights"
target_mesh = "@other.mesh"
target_skeleton = "@other.skeleton"
map = "@map"
resolution = 256
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let (source_mesh, source) = (io.get(Self::SOURCE_MESH), io.get(Self::SOURCE));
        let weights = io.get(Self::SOURCE_WEIGHTS);
        let (target_mesh, target) = (io.get(Self::TARGET_MESH), io.get(Self::TARGET));
        let options = SkeletonTextureOptions {
            resolution: self.resolution,
            texels: self.texels,
            correct_phase: self.correct_phase,
            smoothing: self.smoothing,
            max_influences: self.max_influences,
            least_covered: self.least_covered,
            ..Default::default()
        };
        let of = (&*source_mesh, &*source, &*weights);
        let to = (&*target_mesh, &*target);
        let res = skeleton_texture(of, to, &io.get(Self::MAP), &options)?;
        self.note(io, &res);
        io.put(Self::RELIABILITY, reliability(&res));
        io.put(Self::WEIGHTS, res.weights);
        io.put(Self::TEXTURE, res.target.texture);
        io.put(Self::SOURCE_TEXTURE, res.source.texture);
        Ok(())
    }
}

impl SkeletonTextureNode {
    fn note(&self, io: &mut NodeIo<'_>, res: &SkeletonTexture) {
        if res.fell_back {
            let share = |n: usize, of: usize| 100.0 * n as f64 / of as f64;
            io.note(format!(
                "{:.1} % of the source and {:.1} % of the target see a bone, but {:.1} % must: the \
                 weights are those of heat from the target's bones",
                share(res.source.n_covered, res.source.n_vertices),
                share(res.target.n_covered, res.target.n_vertices),
                100.0 * self.least_covered
            ));
        }
        if res.n_inherited > 0 {
            io.note(format!(
                "{} of {} bones of the target follow nothing and have the weights at the end of the \
                 bone above",
                res.n_inherited, res.target.n_bones
            ));
        }
        if res.n_shifted > 0 {
            let (n_shifted, n_bones) = (res.n_shifted, res.target.n_bones);
            io.note(format!("angles around {n_shifted} of {n_bones} bones are shifted"));
        }
    }
}

fn reliability(res: &SkeletonTexture) -> Table {
    let sides = [&res.source, &res.target];
    let numbers = |of: &dyn Fn(&Side) -> f64| sides.iter().map(|it| of(it)).collect::<Vec<f64>>();
    let covered = |it: &crate::kernels::matching::skeleton_texture::Side| {
        100.0 * it.n_covered as f64 / it.n_vertices as f64
    };
    Table::new(vec![
        Column::texts("body", vec!["source".to_owned(), "target".to_owned()]),
        Column::numbers("vertices", "", numbers(&|it| it.n_vertices as f64)),
        Column::numbers("covered", "%", numbers(&covered)),
        Column::numbers("bones", "", numbers(&|it| it.n_bones as f64)),
        Column::numbers("bones with vertices", "", numbers(&|it| it.n_used_bones as f64)),
        Column::numbers("texture side", "texels", numbers(&|it| it.texture.width as f64)),
        Column::numbers("texels a length", "", numbers(&|it| it.texels_per_length)),
    ])
}
