//! Kind `segment`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::sensors::depth::DepthVideo;
use crate::kernels::sensors::depth::segment::{SegmentOptions, Segmented, segment};
use crate::kernels::sensors::depth::smooth::smooth_video;

/// Cuts a subject out of a depth video: a depth range, a region, the largest connected component.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Segment {
    /// What is nearer is dropped, in metres.
    #[schemars(range(min = 0.0))]
    pub near: f64,
    /// What is farther is dropped, in metres.
    #[schemars(range(min = 0.0))]
    pub far: f64,
    /// The step in depth between neighbouring pixels at which objects part, in metres.
    #[schemars(range(min = 0.0))]
    pub step: f64,
    /// Left, top, right and bottom in pixels, the last two excluded; the whole picture if it is left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub region: Option<[usize; 4]>,
    /// Whether only the largest connected component (of 8 neighbours) of each frame stays.
    pub largest: bool,
    /// How many pixels around each one its depth is averaged over afterwards; 0 for not at all. A noisy
    /// sensor needs 2 or 3 before a surface is made.
    #[schemars(range(max = 10))]
    pub smoothing: usize,
    /// Only depths within so many metres are averaged; above the noise, below the steps.
    #[schemars(range(min = 0.0))]
    pub gate: f64,
}

impl Default for Segment {
    fn default() -> Self {
        let SegmentOptions { near, far, step, region, largest } = SegmentOptions::default();
        Self { near, far, step, region, largest, smoothing: 0, gate: 0.05 }
    }
}

impl Segment {
    const VIDEO: Input<DepthVideo> = Input::new("video", "what the camera sees");
    const SUBJECT: Output<DepthVideo> = Output::new("video", "the same without all else");
}

impl Node for Segment {
    const SPEC: Spec = Spec {
        kind: "segment",
        version: 1,
        inputs: &[Self::VIDEO.port()],
        outputs: &[Self::SUBJECT.port()],
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

[nodes.subject]
kind = "segment"
video = "@film.video"
near = 0.5
far = 6.0
"#,
    };

    fn validate(&self) -> Result<(), String> {
        match self.near < self.far {
            true => Ok(()),
            false => Err(format!("`near` is {}, and `far` is {}", self.near, self.far)),
        }
    }

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let Self { near, far, step, region, largest, .. } = *self;
        let video = io.get(Self::VIDEO);
        let options = SegmentOptions { near, far, step, region, largest };
        let Segmented { video: subject, rivalled } = segment(&video, &options)?;
        if let Some(frame) = rivalled.first() {
            let n = rivalled.len();
            io.note(format!(
                "in {n} of {} frames, first in frame {frame}, another object is at least half as large \
                 as the one that stays; `region`, `near` and `far` choose one, `largest = false` \
                 keeps all",
                video.n_frames()
            ));
        }
        let subject = match self.smoothing {
            0 => subject,
            radius => smooth_video(&subject, self.gate, radius)?,
        };
        let empty: Vec<String> = (0..subject.n_frames())
            .filter(|it| subject.frame(*it).iter().all(|it| *it == 0.0))
            .map(|it| it.to_string())
            .collect();
        if !empty.is_empty() {
            io.note(format!("nothing is left in {} frames: {}", empty.len(), empty.join(", ")));
        }
        io.put(Self::SUBJECT, subject);
        Ok(())
    }
}
