use crate::engine::artifact::{Artifact, ArtifactType, DecodeError, Decoder, Encoder};
use crate::kernels::sensors::depth::{DepthVideo, Intrinsics};

impl Artifact for DepthVideo {
    const TYPE: ArtifactType = ArtifactType {
        name: "depth_video",
        version: 1,
        doc: "Depth video: `depths` (T x H*W metres along the optical axis, rows from the top, 0 where \
              nothing was measured), `size` (width, height), `intrinsics` (fx fy cx cy in pixels; whole \
              numbers are centres) and `frames_per_second`. Camera space: x right, y down, z forward.",
    };

    fn encode<'a>(&'a self, to: &mut Encoder<'a>) {
        let (width, height, camera) = (self.width(), self.height(), self.intrinsics());
        to.array("depths", &[self.n_frames(), width * height], self.depths());
        to.owned("size", &[2], vec![width as u64, height as u64]);
        to.owned("intrinsics", &[4], vec![camera.fx, camera.fy, camera.cx, camera.cy]);
        to.owned("frames_per_second", &[1], vec![self.frames_per_second()]);
    }

    fn decode(from: &Decoder<'_>) -> Result<Self, DecodeError> {
        let (_, n_pixels, depths) = from.matrix::<f32>("depths")?;
        let (size, camera) = (from.vector::<u64>("size")?, from.vector::<f64>("intrinsics")?);
        let rate = from.vector::<f64>("frames_per_second")?;
        let (&[width, height], &[fx, fy, cx, cy], &[rate]) = (&size[..], &camera[..], &rate[..])
        else {
            return Err(DecodeError::new("`size` is two numbers, `intrinsics` four, the rate one"));
        };
        if n_pixels == 0 {
            return Err(DecodeError::new("the frames have no pixels"));
        }
        let frames = depths.chunks_exact(n_pixels).map(<[f32]>::to_vec).collect();
        let size = [width, height].map(|it| usize::try_from(it).unwrap_or(0));
        Self::new(size, Intrinsics { fx, fy, cx, cy }, rate, frames)
            .map_err(|e| DecodeError::new(e.to_string()))
    }

    fn summary(&self) -> Vec<(String, String)> {
        let camera = self.intrinsics();
        let measured = self.depths().iter().filter(|it| **it > 0.0);
        let (low, high) = measured
            .clone()
            .fold((f32::INFINITY, 0.0_f32), |(low, high), it| (low.min(*it), high.max(*it)));
        let share = 100.0 * measured.count() as f64 / self.depths().len() as f64;
        vec![
            ("frames".to_owned(), self.n_frames().to_string()),
            ("frames a second".to_owned(), self.frames_per_second().to_string()),
            ("size".to_owned(), format!("{} x {}", self.width(), self.height())),
            ("focal lengths".to_owned(), format!("{} {}", camera.fx, camera.fy)),
            ("measured".to_owned(), format!("{share:.1} % from {low:.3} to {high:.3} m")),
        ]
    }
}
