//! Videos of a depth camera.

use crate::kernels::geometry::mesh::Vec3;

/// A pinhole camera: focal lengths and principal point in pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Intrinsics {
    pub fx: f64,
    pub fy: f64,
    pub cx: f64,
    pub cy: f64,
}

/// `T` frames of `H x W` depths.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthVideo {
    width: usize,
    height: usize,
    intrinsics: Intrinsics,
    frames_per_second: f64,
    /// `T * H * W` metres along the optical axis, rows from the top; 0 where nothing was measured.
    depths: Vec<f32>,
}

/// Why something is no depth video.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DepthError {
    #[error("the video has no frames")]
    NoFrames,
    #[error("{width} x {height} pixels are no picture of 2 to 16384 pixels a side")]
    Size { width: usize, height: usize },
    #[error("frame {frame} has {n_pixels} pixels instead of {width} x {height}")]
    FrameSize { frame: usize, n_pixels: usize, width: usize, height: usize },
    #[error("`{name}` is {value}")]
    Intrinsics { name: &'static str, value: f64 },
    #[error("frame {frame}, pixel ({column}, {row}): the depth is {value}")]
    Depth { frame: usize, column: usize, row: usize, value: f32 },
    #[error("{frames_per_second} frames a second")]
    Rate { frames_per_second: f64 },
}

impl Intrinsics {
    /// # Errors
    /// [`DepthError::Intrinsics`] names what is not finite or, of focal lengths, not positive.
    pub fn check(&self) -> Result<(), DepthError> {
        let Self { fx, fy, cx, cy } = *self;
        for (name, value) in [("fx", fx), ("fy", fy), ("cx", cx), ("cy", cy)] {
            if !value.is_finite() || (name.starts_with('f') && value <= 0.0) {
                return Err(DepthError::Intrinsics { name, value });
            }
        }
        Ok(())
    }

    /// The point that a pixel sees: `D(u) K^-1 [u_x, u_y, 1]^T`.
    pub fn unproject(&self, u: f64, v: f64, depth: f64) -> Vec3 {
        Vec3::new((u - self.cx) / self.fx * depth, (v - self.cy) / self.fy * depth, depth)
    }

    /// The pixel coordinates of a point in front of the camera.
    pub fn project(&self, point: &Vec3) -> [f64; 2] {
        [self.fx * point.x / point.z + self.cx, self.fy * point.y / point.z + self.cy]
    }
}

impl DepthVideo {
    /// Checks and wraps frames of `height * width` depths in metres.
    ///
    /// # Errors
    /// See [`DepthError`].
    pub fn new(
        [width, height]: [usize; 2],
        intrinsics: Intrinsics,
        frames_per_second: f64,
        frames: Vec<Vec<f32>>,
    ) -> Result<Self, DepthError> {
        intrinsics.check()?;
        if !(2..=16384).contains(&width) || !(2..=16384).contains(&height) {
            return Err(DepthError::Size { width, height });
        }
        if !(frames_per_second > 0.0 && frames_per_second.is_finite()) {
            return Err(DepthError::Rate { frames_per_second });
        }
        if frames.is_empty() {
            return Err(DepthError::NoFrames);
        }
        for (frame, depths) in frames.iter().enumerate() {
            let n_pixels = depths.len();
            if n_pixels != width * height {
                return Err(DepthError::FrameSize { frame, n_pixels, width, height });
            }
            if let Some(pixel) = depths.iter().position(|it| !(it.is_finite() && *it >= 0.0)) {
                let (column, row, value) = (pixel % width, pixel / width, depths[pixel]);
                return Err(DepthError::Depth { frame, column, row, value });
            }
        }
        Ok(Self { width, height, intrinsics, frames_per_second, depths: frames.concat() })
    }

    pub fn width(&self) -> usize {
        self.width
    }

    pub fn height(&self) -> usize {
        self.height
    }

    pub fn intrinsics(&self) -> Intrinsics {
        self.intrinsics
    }

    pub fn frames_per_second(&self) -> f64 {
        self.frames_per_second
    }

    pub fn n_frames(&self) -> usize {
        self.depths.len() / (self.width * self.height)
    }

    /// The `height * width` depths of a frame, rows from the top.
    ///
    /// # Panics
    /// If there is no such frame.
    pub fn frame(&self, frame: usize) -> &[f32] {
        let n_pixels = self.width * self.height;
        &self.depths[frame * n_pixels..][..n_pixels]
    }

    /// All frames, one after the other.
    pub fn depths(&self) -> &[f32] {
        &self.depths
    }

    /// The same camera with other depths.
    ///
    /// # Errors
    /// See [`DepthError`].
    pub fn with_frames(&self, frames: Vec<Vec<f32>>) -> Result<Self, DepthError> {
        Self::new([self.width, self.height], self.intrinsics, self.frames_per_second, frames)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA: Intrinsics = Intrinsics { fx: 500.0, fy: 510.0, cx: 31.5, cy: 23.5 };

    #[test]
    fn a_pixel_and_its_point_belong_together() {
        let point = CAMERA.unproject(12.25, 40.5, 2.5);
        let [u, v] = CAMERA.project(&point);
        assert!((u - 12.25).abs() < 1e-12 && (v - 40.5).abs() < 1e-12 && point.z == 2.5);
    }

    #[test]
    fn what_is_no_video_is_told() {
        let check = |camera, size, frames, expected: &str| {
            let error = DepthVideo::new(size, camera, 30.0, frames).unwrap_err();
            assert_eq!(error.to_string(), expected);
        };
        let bad = Intrinsics { fx: f64::NAN, ..CAMERA };
        check(bad, [2, 2], vec![vec![1.0; 4]], "`fx` is NaN");
        check(CAMERA, [2, 2], vec![], "the video has no frames");
        let two = vec![vec![1.0; 4], vec![1.0; 6]];
        check(CAMERA, [2, 2], two, "frame 1 has 6 pixels instead of 2 x 2");
        let nan = vec![vec![1.0, 1.0, 1.0, f32::NAN]];
        check(CAMERA, [2, 2], nan, "frame 0, pixel (1, 1): the depth is NaN");
        check(
            CAMERA,
            [0, 2],
            vec![vec![]],
            "0 x 2 pixels are no picture of 2 to 16384 pixels a side",
        );
    }
}
