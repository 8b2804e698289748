//! A depth frame as a target: points, normals, and where they can be trusted.

use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::geometry::point_tree::PointTree;
use crate::kernels::sensors::depth::{DepthVideo, Intrinsics, mesh::unproject, smooth::smooth};

/// What a pixel holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pixel {
    Nothing,
    /// At a step in depth or beside a pixel without measurement.
    Edge,
    Surface,
}

/// Columns and rows of a picture, the last ones excluded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    pub left: usize,
    pub top: usize,
    pub right: usize,
    pub bottom: usize,
}

/// Columns and rows around what must be seen.
const MARGIN: usize = 4;

impl Window {
    pub fn all(video: &DepthVideo) -> Self {
        Self { left: 0, top: 0, right: video.width(), bottom: video.height() }
    }

    /// What holds all measurements of a frame and a surface; never empty.
    pub fn around(video: &DepthVideo, frame: usize, vertices: &[Vec3]) -> Self {
        let (width, height) = (video.width(), video.height());
        let (mut low, mut high) = ([width, height], [0, 0]);
        let mut take = |x: usize, y: usize| {
            low = [low[0].min(x), low[1].min(y)];
            high = [high[0].max(x), high[1].max(y)];
        };
        for (y, row) in video.frame(frame).chunks_exact(width).enumerate() {
            if let Some(first) = row.iter().position(|it| *it > 0.0) {
                let last = row.iter().rposition(|it| *it > 0.0).unwrap_or(first);
                take(first, y);
                take(last, y);
            }
        }
        for vertex in vertices.iter().filter(|it| it.z > 0.01) {
            let [u, v] = video.intrinsics().project(vertex);
            take(u.clamp(0.0, width as f64) as usize, v.clamp(0.0, height as f64) as usize);
        }
        let span = |axis: usize, n: usize| {
            let first = low[axis].saturating_sub(MARGIN).min(n - 1);
            (first, (high[axis] + MARGIN + 1).clamp(first + 1, n))
        };
        let ((left, right), (top, bottom)) = (span(0, width), span(1, height));
        Self { left, top, right, bottom }
    }
}

/// One frame of a video, or a part of it, prepared to be aligned with.
pub struct Target {
    pub width: usize,
    pub height: usize,
    pub camera: Intrinsics,
    /// Smoothed points, one a pixel.
    pub points: Vec<Vec3>,
    /// Unit normals that face the camera, one a pixel; zero unless it is a surface.
    pub normals: Vec<Vec3>,
    pub pixels: Vec<Pixel>,
    /// The pixels that hold a measurement, ascending.
    pub measured: Vec<u32>,
    tree: PointTree,
}

impl Target {
    /// The whole picture; `gate` is the step in depth that separates surfaces, in metres.
    pub fn new(video: &DepthVideo, frame: usize, gate: f64, smoothing: usize) -> Self {
        Self::of_window(video, frame, Window::all(video), gate, smoothing)
    }

    /// A part of the picture, with pixels of its own.
    pub fn of_window(
        video: &DepthVideo,
        frame: usize,
        window: Window,
        gate: f64,
        smoothing: usize,
    ) -> Self {
        let Window { left, top, right, bottom } = window;
        let (width, height) = (right - left, bottom - top);
        let whole = video.intrinsics();
        let camera = Intrinsics { cx: whole.cx - left as f64, cy: whole.cy - top as f64, ..whole };
        let row = |it: usize| &video.frame(frame)[it * video.width()..][left..right];
        let raw: Vec<f32> = (top..bottom).flat_map(|it| row(it).iter().copied()).collect();
        let raw = &raw[..];
        let depths = smooth(raw, width, gate as f32, smoothing);
        let points = unproject(&depths, width, &camera);
        let measured: Vec<u32> =
            (0..raw.len() as u32).filter(|it| raw[*it as usize] > 0.0).collect();
        let mut pixels = vec![Pixel::Nothing; raw.len()];
        let mut normals = vec![Vec3::zeros(); raw.len()];
        for &pixel in &measured {
            let pixel = pixel as usize;
            let normal = normal(&depths, &points, width, gate as f32, pixel);
            pixels[pixel] = if normal.is_some() { Pixel::Surface } else { Pixel::Edge };
            normals[pixel] = normal.unwrap_or_default();
        }
        let places: Vec<Vec3> = measured.iter().map(|it| points[*it as usize]).collect();
        let tree = PointTree::new(&places);
        Self { width, height, camera, points, normals, pixels, measured, tree }
    }

    /// The pixel at which the camera sees a point, if it lies in the picture.
    pub fn pixel_of(&self, point: &Vec3) -> Option<usize> {
        if point.z <= 0.01 {
            return None;
        }
        let [u, v] = self.camera.project(point).map(f64::round);
        let is_inside = u >= 0.0 && v >= 0.0 && u < self.width as f64 && v < self.height as f64;
        is_inside.then(|| v as usize * self.width + u as usize)
    }

    /// The measured pixel nearest to a point among 5 x 5 around its projection, with the distance.
    pub fn nearest_in_window(&self, point: &Vec3) -> Option<(f64, usize)> {
        let pixel = self.pixel_of(point)?;
        let (column, row) = (pixel % self.width, pixel / self.width);
        let columns = column.saturating_sub(2)..(column + 3).min(self.width);
        let mut best: Option<(f64, usize)> = None;
        for y in row.saturating_sub(2)..(row + 3).min(self.height) {
            let range = y * self.width + columns.start..y * self.width + columns.end;
            let around = self.points[range.clone()].iter().zip(&self.pixels[range.clone()]);
            for (other, (place, _)) in range.zip(around).filter(|it| *it.1.1 != Pixel::Nothing) {
                let square = (place - point).norm_squared();
                if best.is_none_or(|it| square < it.0) {
                    best = Some((square, other));
                }
            }
        }
        best.map(|(square, pixel)| (square.sqrt(), pixel))
    }

    /// The measured pixel nearest to a point, with the distance.
    pub fn nearest(&self, point: &Vec3, found: &mut Vec<(f64, u32)>) -> Option<(f64, usize)> {
        self.tree.nearest(*point, 1, found);
        let (square, index) = found.first()?;
        Some((square.sqrt(), self.measured[*index as usize] as usize))
    }
}

/// The normal by central differences, if all four neighbours continue the surface.
fn normal(depths: &[f32], points: &[Vec3], width: usize, gate: f32, pixel: usize) -> Option<Vec3> {
    let (column, row, height) = (pixel % width, pixel / width, depths.len() / width);
    if column == 0 || row == 0 || column + 1 == width || row + 1 == height {
        return None;
    }
    let continues = |it: usize| depths[it] > 0.0 && (depths[it] - depths[pixel]).abs() <= gate;
    let around = [pixel - 1, pixel + 1, pixel - width, pixel + width];
    if !around.into_iter().all(continues) {
        return None;
    }
    let [left, right, above, below] = around.map(|it| points[it]);
    // With y down and z forward this order faces the camera.
    (below - above).cross(&(right - left)).try_normalize(0.0)
}
