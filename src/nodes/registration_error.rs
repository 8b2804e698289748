//! Kind `registration_error`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, OptionalInput, Output, Spec};
use crate::kernels::geometry::mesh_sequence::MeshSequence;
use crate::kernels::sensors::depth::DepthVideo;
use crate::kernels::sensors::registration::error::{FrameError, registration_errors};
use crate::kernels::table::{Column, Table};

/// Measures how well a surface was tracked through a depth video.
///
/// Point-to-plane distance to the measured surface, mean squared difference of inverse depths over the
/// pixels where either has one, intersection over union of silhouettes; with a `truth`, distances of
/// vertices to their true places.
#[derive(Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RegistrationError {
    /// The frame in which tracked vertices are tied to a truth of other vertices, where they are
    /// nearest to it.
    pub source_frame: usize,
}

impl RegistrationError {
    const SEQUENCE: Input<MeshSequence> = Input::new("sequence", "the tracked surface");
    const VIDEO: Input<DepthVideo> = Input::new("video", "what it was tracked in");
    const TRUTH: OptionalInput<MeshSequence> =
        OptionalInput::new("truth", "the true surface in camera space, of any vertices");
    const FRAMES: Output<Table> = Output::new("frames", "one row a frame");
    const SUMMARY: Output<Table> = Output::new("summary", "one row: means over the frames");
}

/// A column's name, its unit, and how it is read.
type Measure = (&'static str, &'static str, fn(&FrameError) -> f64);

const MEASURES: [Measure; 5] = [
    ("point to plane", "m", |it| it.point_to_plane),
    ("inverse depth", "1/m²", |it| it.inverse_depth),
    ("iou", "", |it| it.iou),
    ("mean error", "m", |it| it.mean),
    ("max error", "m", |it| it.max),
];

/// The mean of what is not NaN.
fn mean(values: &[f64]) -> f64 {
    let known: Vec<f64> = values.iter().copied().filter(|it| !it.is_nan()).collect();
    known.iter().sum::<f64>() / known.len() as f64
}

impl Node for RegistrationError {
    const SPEC: Spec = Spec {
        kind: "registration_error",
        version: 1,
        inputs: &[Self::SEQUENCE.port(), Self::VIDEO.port(), Self::TRUTH.port()],
        outputs: &[Self::FRAMES.port(), Self::SUMMARY.port()],
        cites: &[],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.film]
kind = "render_depth"
mesh = "@body.mesh"
skeleton = "@body.skeleton"
weights = "@body.weights"
clip = "@body.clip"
frames = 3
width = 160
height = 120

[nodes.score]
kind = "registration_error"
sequence = "@film.truth"
video = "@film.video"
truth = "@film.truth"
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let (sequence, video) = (io.get(Self::SEQUENCE), io.get(Self::VIDEO));
        let truth = io.get_optional(Self::TRUTH);
        let errors = registration_errors(&sequence, &video, truth.as_deref(), self.source_frame)?;
        let shown = &MEASURES[..if truth.is_some() { 5 } else { 3 }];
        let values = |of: fn(&FrameError) -> f64| errors.iter().map(of).collect::<Vec<f64>>();
        let mut frames =
            vec![Column::numbers("frame", "", (0..errors.len()).map(|it| it as f64).collect())];
        frames.extend(shown.iter().map(|it| Column::numbers(it.0, it.1, values(it.2))));
        let summary = shown.iter().map(|it| Column::numbers(it.0, it.1, vec![mean(&values(it.2))]));
        let summary = Table::new(summary.collect());
        io.put(Self::FRAMES, Table::new(frames));
        io.put(Self::SUMMARY, summary);
        Ok(())
    }
}
