//! Kind `resample_clip`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::motion::quaternion_spline::Keys;
use crate::kernels::motion::resample_clip::{ResampleClipOptions, resample_clip};
use crate::kernels::rigs::clip::Clip;

/// Lays smooth curves through keys of a clip and samples them at another rate.
///
/// Cubic B-splines of rotations and of offsets. The result goes from the first key to the last.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ResampleClip {
    /// The rate of the result; that of the clip if it is left out.
    #[serde(default)]
    #[schemars(range(min = 0.001, max = 10_000.0))]
    pub frames_per_second: Option<f64>,
    /// Every so many frames there is a key, from the first frame on.
    #[serde(default = "one")]
    #[schemars(range(min = 1))]
    pub key_every: usize,
    /// Whether the curves pass through the keys, or take them for control points.
    #[serde(default)]
    pub keys: Keys,
}

fn one() -> usize {
    1
}

impl ResampleClip {
    const CLIP: Input<Clip> = Input::new("clip", "a motion");
    const RESULT: Output<Clip> = Output::new("clip", "the same motion at the other rate");
    /// The most frames of a result.
    const MAX_FRAMES: f64 = 1e6;
}

impl Node for ResampleClip {
    const SPEC: Spec = Spec {
        kind: "resample_clip",
        version: 1,
        inputs: &[Self::CLIP.port()],
        outputs: &[Self::RESULT.port()],
        cites: &["kim1995general", "madaras2014skeleton"],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.smooth]
kind = "resample_clip"
clip = "@body.clip"
frames_per_second = 48
key_every = 4
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let clip = io.get(Self::CLIP);
        if clip.n_frames() == 0 {
            return Err(NodeError::failed("the clip has no frames"));
        }
        let frames_per_second = self.frames_per_second.unwrap_or(clip.frames_per_second);
        let n_frames = clip.duration_secs() * frames_per_second;
        if !(n_frames <= Self::MAX_FRAMES) {
            return Err(NodeError::failed(format!(
                "{:.1} seconds at {frames_per_second} frames per second are more than {} frames",
                clip.duration_secs(),
                Self::MAX_FRAMES
            )));
        }
        let (key_every, keys) = (self.key_every, self.keys);
        let frames_per_second = Some(frames_per_second);
        let options = ResampleClipOptions { frames_per_second, key_every, keys };
        let res = resample_clip(&clip, &options);
        if res.n_left_out > 0 {
            io.note(format!(
                "the last {} frames come after the last of {} keys and are left out",
                res.n_left_out, res.n_keys
            ));
        }
        if res.largest_miss_rad > 1e-6 {
            io.note(format!(
                "keys are so far apart that curves miss them by up to {:.2} degrees",
                res.largest_miss_rad.to_degrees()
            ));
        }
        io.put(Self::RESULT, res.clip);
        Ok(())
    }
}
