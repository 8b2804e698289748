//! Kind `snapshot`.

use std::sync::Arc;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{
    Inputs, Node, NodeError, NodeIo, OptionalInput, OptionalInputs, Output, Spec,
};
use crate::kernels::curve_skeletons::curve_skeleton::CurveSkeleton;
use crate::kernels::maps::functional_map::PointMap;
use crate::kernels::pictures::snapshot::colors::{
    Color, ColorMap, function_colors, matched_colors, position_colors, weight_colors,
};
use crate::kernels::pictures::snapshot::{
    Figure, Isolines, Role, Scale, SnapshotOptions, View, snapshot,
};
use crate::kernels::spectral::basis::Basis;
use crate::kernels::{
    geometry::{landmarks::Landmarks, mesh::TriMesh},
    image::Image,
    rigs::{skeleton::Skeleton, weights::SkinWeights},
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
    /// With `bases`: the eigenfunction that is shown; 0 is the constant one.
    #[serde(default = "one")]
    pub function: usize,
    /// The colours of a function.
    #[serde(default = "diverging")]
    pub color_map: ColorMap,
    /// The number of level lines of a function; none if it is 0.
    #[serde(default)]
    #[schemars(range(max = 200))]
    pub isolines: usize,
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

fn one() -> usize {
    1
}

fn diverging() -> ColorMap {
    ColorMap::Diverging
}

/// The colours of two meshes by places on the second, brought to the first by a map.
fn matched_pair(map: &PointMap, meshes: &[Arc<TriMesh>]) -> Result<[Vec<Color>; 2], NodeError> {
    let [source, target] = meshes else {
        let n_meshes = meshes.len();
        return Err(NodeError::failed(format!("`matches` join two `meshes`, not {n_meshes}")));
    };
    let (n_source, n_target) = (source.n_vertices(), target.n_vertices());
    if map.target_of_source.len() != n_source || map.n_target != n_target {
        return Err(NodeError::failed(format!(
            "`matches` lead from {} vertices to {}, but the meshes have {n_source} and {n_target}",
            map.target_of_source.len(),
            map.n_target
        )));
    }
    let colors = position_colors(target);
    Ok([matched_colors(map, &colors), colors])
}

impl Snapshot {
    /// The values of the shown eigenfunction.
    fn function_of(&self, basis: &Basis) -> Result<Vec<f64>, NodeError> {
        if self.function >= basis.k() {
            let (function, k) = (self.function, basis.k());
            return Err(NodeError::failed(format!(
                "`function` is {function} of {k} eigenfunctions"
            )));
        }
        Ok(basis.eigenvectors.col_as_slice(self.function).to_vec())
    }

    const MESHES: Inputs<TriMesh> = Inputs::new("meshes", "what is shown, from left to right");
    const SKELETONS: OptionalInputs<Skeleton> =
        OptionalInputs::new("skeletons", "a skeleton for every mesh");
    const TRUTHS: OptionalInputs<Skeleton> = OptionalInputs::new(
        "truths",
        "the true skeleton of every mesh, thin and green, to compare",
    );
    const CURVES: OptionalInputs<CurveSkeleton> =
        OptionalInputs::new("curves", "a curve skeleton for every mesh, as thin tubes");
    const WEIGHTS: OptionalInputs<SkinWeights> =
        OptionalInputs::new("weights", "skin weights for every mesh, shown as a colour a joint");
    const LANDMARKS: OptionalInputs<Landmarks> =
        OptionalInputs::new("landmarks", "landmarks of every mesh, shown as dots in matching hues");
    const BASES: OptionalInputs<Basis> = OptionalInputs::new(
        "bases",
        "a basis for every mesh: one eigenfunction is shown as colours",
    );
    const MATCHES: OptionalInput<PointMap> = OptionalInput::new(
        "matches",
        "a map from the first of two meshes to the second: matched points get the same colour",
    );
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
            Self::CURVES.port(),
            Self::WEIGHTS.port(),
            Self::LANDMARKS.port(),
            Self::BASES.port(),
            Self::MATCHES.port(),
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
        let curves = io.get_all_optional(Self::CURVES);
        let weights = io.get_all_optional(Self::WEIGHTS);
        let landmarks = io.get_all_optional(Self::LANDMARKS);
        let bases = io.get_all_optional(Self::BASES);
        let matches = io.get_optional(Self::MATCHES);
        let counts = [
            ("skeletons", skeletons.len()),
            ("truths", truths.len()),
            ("curves", curves.len()),
            ("weights", weights.len()),
            ("landmarks", landmarks.len()),
            ("bases", bases.len()),
            ("captions", self.captions.len()),
        ];
        if let Some((what, count)) = counts.iter().find(|it| it.1 != 0 && it.1 != meshes.len()) {
            let n_meshes = meshes.len();
            return Err(NodeError::failed(format!("{count} `{what}` for {n_meshes} `meshes`")));
        }
        let functions =
            bases.iter().map(|it| self.function_of(it)).collect::<Result<Vec<_>, _>>()?;
        let matched = matches.map(|it| matched_pair(&it, &meshes)).transpose()?;
        let figures: Vec<Figure<'_>> = (0..meshes.len())
            .map(|index| {
                let own = skeletons.get(index).map(|it| (&**it, Role::Own));
                let truth = truths.get(index).map(|it| (&**it, Role::Truth));
                Figure {
                    colors: (matched.as_ref().map(|it| it[index].clone()))
                        .or_else(|| Some(function_colors(functions.get(index)?, self.color_map)))
                        .or_else(|| weights.get(index).map(|it| weight_colors(it))),
                    isolines: functions
                        .get(index)
                        .filter(|_| self.isolines > 0)
                        .map(|values| Isolines { values, count: self.isolines }),
                    skeletons: own.into_iter().chain(truth).collect(),
                    curves: curves.get(index).map(|it| &**it),
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
