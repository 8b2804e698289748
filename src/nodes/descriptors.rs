//! Kind `descriptors`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, OptionalInput, Output, Spec};
use crate::kernels::geometry::landmarks::Landmarks;
use crate::kernels::spectral::basis::Basis;
use crate::kernels::spectral::descriptors::{DescriptorOptions, Descriptors, descriptors};

/// Computes functions that look alike at corresponding points of similar shapes.
///
/// Wave kernel signatures and, for each landmark, wave kernel maps, from all eigenpairs of the basis;
/// heat kernels are an option. Everything is evaluated at total area one, so the mesh's unit does not
/// matter. Use the same parameters, as many eigenpairs, and the same landmarks in the same order for
/// the shapes that are to be compared.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DescriptorsNode {
    /// Energies (wave kernels) or times (heat kernels) a family.
    #[schemars(range(min = 2, max = 10000))]
    pub n_samples: usize,
    /// Every so-manieth function is kept; neighbours are much alike.
    #[schemars(range(min = 1))]
    pub keep_every: usize,
    /// The width of the wave kernels' bands, in steps between energies.
    #[schemars(range(min = 0.1, max = 1000.0))]
    pub variance: f64,
    /// Wave kernel signatures: what a point is by itself.
    pub wave_signature: bool,
    /// Wave kernel maps: what a point is to every landmark. They tell left from right.
    pub wave_landmarks: bool,
    /// Heat kernel signatures.
    pub heat_signature: bool,
    /// Heat kernel maps of every landmark.
    pub heat_landmarks: bool,
    /// The least and the greatest time of the heat kernels, at total area one.
    pub heat_times: [f64; 2],
}

impl Default for DescriptorsNode {
    fn default() -> Self {
        let options = DescriptorOptions::default();
        Self {
            n_samples: options.n_samples,
            keep_every: options.keep_every,
            variance: options.variance,
            wave_signature: options.wave_signature,
            wave_landmarks: options.wave_landmarks,
            heat_signature: options.heat_signature,
            heat_landmarks: options.heat_landmarks,
            heat_times: options.heat_times,
        }
    }
}

impl DescriptorsNode {
    const BASIS: Input<Basis> = Input::new("basis", "the eigenpairs of the shape");
    const LANDMARKS: OptionalInput<Landmarks> =
        OptionalInput::new("landmarks", "vertices that correspond across the shapes");
    const DESCRIPTORS: Output<Descriptors> = Output::new("descriptors", "the functions");
}

impl Node for DescriptorsNode {
    const SPEC: Spec = Spec {
        kind: "descriptors",
        version: 2,
        inputs: &[Self::BASIS.port(), Self::LANDMARKS.port()],
        outputs: &[Self::DESCRIPTORS.port()],
        cites: &["aubry2011wave", "sun2009concise", "musoni2021functional"],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.operator]
kind = "laplacian"
mesh = "@body.mesh"

[nodes.basis]
kind = "eigs"
operator = "@operator"
k = 40

[nodes.functions]
kind = "descriptors"
basis = "@basis"
landmarks = "@body.landmarks"
"#,
    };

    fn validate(&self) -> Result<(), String> {
        let [first, last] = self.heat_times;
        if !(0.0 < first && first < last && last.is_finite()) {
            return Err(format!(
                "`heat_times` are {first} and {last}: two positive, ascending times"
            ));
        }
        Ok(())
    }

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let basis = io.get(Self::BASIS);
        let landmarks = io.get_optional(Self::LANDMARKS);
        let landmarks: Vec<(String, u32)> = landmarks
            .iter()
            .flat_map(|it| it.names.iter().cloned().zip(it.vertices.iter().copied()))
            .collect();
        let options = DescriptorOptions {
            n_samples: self.n_samples,
            keep_every: self.keep_every,
            variance: self.variance,
            wave_signature: self.wave_signature,
            wave_landmarks: self.wave_landmarks,
            heat_signature: self.heat_signature,
            heat_landmarks: self.heat_landmarks,
            heat_times: self.heat_times,
        };
        io.put(Self::DESCRIPTORS, descriptors(&basis, &landmarks, &options)?);
        Ok(())
    }
}
