//! Kind `snapshot`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Inputs, Node, NodeError, NodeIo, OptionalInputs, Output, Spec};
use crate::kernels::snapshot::colors::weight_colors;
use crate::kernels::snapshot::{Figure, Role, Scale, SnapshotOptions, View, snapshot};
use crate::kernels::{
    image::Image, landmarks::Landmarks, mesh::TriMesh, skeleton::Skeleton, weights::SkinWeights,
};

/// Draws meshes side by side, with their skeletons shining through.
///
/// A list has one entry for every mesh, in the meshes' order, or is left out.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Snapshot {
    /// Every mesh is shown from each of these. Up is +y, and a figure looks along +z.
    #[serde(default = "default_views")]
    #[schemars(length(min = 1, max = 8))]
    pub views: Vec<View>,
    /// Pixels.
    #[serde(default = "default_width")]
    #[schemars(range(min = 64, max = 8192))]
    pub width: usize,
    /// Pixels.
    #[serde(default = "default_height")]
    #[schemars(range(min = 64, max = 8192))]
    pub height: usize,
    /// How the sizes of different meshes relate.
    #[serde(default)]
    pub scale: Scale,
    /// A line of text below each mesh.
    #[serde(default)]
    pub captions: Vec<String>,
}

fn default_views() -> Vec<View> {
    vec![View::Front]
}

fn default_width() -> usize {
    SnapshotOptions::default().width
}

fn default_height() -> usize {
    SnapshotOptions::default().height
}

impl Snapshot {
    const MESHES: Inputs<TriMesh> = Inputs::new("meshes", "what is shown, from left to right");
    const SKELETONS: OptionalInputs<Skeleton> =
        OptionalInputs::new("skeletons", "a skeleton for every mesh");
    const TRUTHS: OptionalInputs<Skeleton> = OptionalInputs::new(
        "truths",
        "the true skeleton of every mesh, thin and green, to compare",
    );
    const WEIGHTS: OptionalInputs<SkinWeights> =
        OptionalInputs::new("weights", "skin weights for every mesh, shown as a colour a joint");
    const LANDMARKS: OptionalInputs<Landmarks> =
        OptionalInputs::new("landmarks", "landmarks of every mesh, shown as dots in matching hues");
    const IMAGE: Output<Image> = Output::new("image", "the picture");
}

impl Node for Snapshot {
    const SPEC: Spec = Spec {
        kind: "snapshot",
        version: 1,
        inputs: &[
            Self::MESHES.port(),
            Self::SKELETONS.port(),
            Self::TRUTHS.port(),
            Self::WEIGHTS.port(),
            Self::LANDMARKS.port(),
        ],
        outputs: &[Self::IMAGE.port()],
        cites: &[],
        example: r#"[nodes.body]
kind = "synthesize"

[nodes.picture]
kind = "snapshot"
meshes = ["@body.mesh", "@body.mesh"]
skeletons = ["@body.skeleton", "@body.skeleton"]
captions = ["source", "target"]
width = 400
height = 300
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let meshes = io.get_all(Self::MESHES);
        let skeletons = io.get_all_optional(Self::SKELETONS);
        let truths = io.get_all_optional(Self::TRUTHS);
        let weights = io.get_all_optional(Self::WEIGHTS);
        let landmarks = io.get_all_optional(Self::LANDMARKS);
        let counts = [
            ("skeletons", skeletons.len()),
            ("truths", truths.len()),
            ("weights", weights.len()),
            ("landmarks", landmarks.len()),
            ("captions", self.captions.len()),
        ];
        if let Some((what, count)) = counts.iter().find(|it| it.1 != 0 && it.1 != meshes.len()) {
            let n_meshes = meshes.len();
            return Err(NodeError::failed(format!("{count} `{what}` for {n_meshes} `meshes`")));
        }
        let figures: Vec<Figure<'_>> = (0..meshes.len())
            .map(|index| {
                let own = skeletons.get(index).map(|it| (&**it, Role::Own));
                let truth = truths.get(index).map(|it| (&**it, Role::Truth));
                Figure {
                    colors: weights.get(index).map(|it| weight_colors(it)),
                    skeletons: own.into_iter().chain(truth).collect(),
                    dots: landmarks.get(index).map_or(&[], |it| &it.vertices),
                    caption: self.captions.get(index).cloned().unwrap_or_default(),
                    ..Figure::new(&meshes[index])
                }
            })
            .collect();
        let options = SnapshotOptions {
            width: self.width,
            height: self.height,
            views: self.views.clone(),
            scale: self.scale,
        };
        let image = snapshot(&figures, &options)?;
        io.put(Self::IMAGE, image);
        Ok(())
    }
}
