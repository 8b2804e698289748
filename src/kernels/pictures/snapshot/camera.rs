//! Where the camera stands, and which part of the picture shows what.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::kernels::geometry::mesh::Vec3;

/// A direction from which a figure is seen. Up is +y and a figure looks along +z.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum View {
    Front,
    /// From the figure's front and left.
    ThreeQuarter,
    /// From the figure's left.
    Side,
    Back,
    Top,
}

/// How sizes of different figures relate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Scale {
    /// Every figure fills its part of the picture.
    #[default]
    Fit,
    /// All figures share one scale and stand on one ground line.
    Shared,
}

/// The axes of an orthographic camera.
#[derive(Debug, Clone, Copy)]
pub struct Camera {
    pub right: Vec3,
    pub up: Vec3,
    /// From the figure to the camera.
    pub toward: Vec3,
}

impl Camera {
    pub fn of(view: View) -> Self {
        let (azimuth_deg, elevation_deg): (f64, f64) = match view {
            View::Front => (0.0, 7.0),
            View::ThreeQuarter => (38.0, 14.0),
            View::Side => (90.0, 7.0),
            View::Back => (180.0, 7.0),
            View::Top => (0.0, 90.0),
        };
        let (sin_a, cos_a) = azimuth_deg.to_radians().sin_cos();
        let (sin_e, cos_e) = elevation_deg.to_radians().sin_cos();
        let toward = Vec3::new(sin_a * cos_e, sin_e, cos_a * cos_e);
        let right = Vec3::new(cos_a, 0.0, -sin_a);
        Self { right, up: toward.cross(&right), toward }
    }

    /// Right, up, toward the camera.
    pub fn project(&self, point: &Vec3) -> Vec3 {
        Vec3::new(point.dot(&self.right), point.dot(&self.up), point.dot(&self.toward))
    }
}

/// A part of the picture, in pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cell {
    pub left: usize,
    pub top: usize,
    pub width: usize,
    pub height: usize,
}

/// What one part of the picture has to show: low and high corners in the camera's plane.
#[derive(Debug, Clone, Copy)]
pub struct Extent {
    pub figure: usize,
    pub low: [f64; 2],
    pub high: [f64; 2],
}

impl Extent {
    fn size(&self) -> [f64; 2] {
        [0, 1].map(|it| (self.high[it] - self.low[it]).max(1e-300))
    }
}

/// A part of the picture with its scale.
#[derive(Debug, Clone, Copy)]
pub struct Placement {
    pub cell: Cell,
    /// Pixels a mesh unit.
    pub scale: f64,
    /// The pixel at which the camera's plane has its origin, from the picture's top left.
    pub origin: [f64; 2],
    /// The lowest pixel of the figure.
    pub bottom: f64,
}

/// The share of a cell that its figure may fill.
const FILL: [f64; 2] = [0.88, 0.86];

/// Arranges the panels in rows so that the figures become as large as possible.
///
/// A row holds all views of some figures, or some views of one figure. `caption_px` is kept free below
/// every row.
pub fn arrange(
    extents: &[Extent],
    n_views: usize,
    size: [usize; 2],
    caption_px: usize,
    scale: Scale,
) -> Vec<Placement> {
    let layout = |n_columns: usize| {
        let cells = cells(extents, n_columns, size, caption_px, scale);
        let scales = scales(extents, &cells, scale);
        (cells, scales)
    };
    let filled = |n_columns: usize| -> f64 {
        let (_, scales) = layout(n_columns);
        extents.iter().zip(&scales).map(|(it, s)| s * it.size()[0].hypot(it.size()[1])).sum()
    };
    let best = (1..=extents.len())
        .filter(|it| it.is_multiple_of(n_views) || n_views.is_multiple_of(*it))
        .max_by(|&a, &b| filled(a).total_cmp(&filled(b)))
        .expect("one view of one figure fits into one column");
    let (cells, scales) = layout(best);
    let tallest = extents.iter().zip(&scales).map(|(it, s)| s * it.size()[1]).fold(0.0, f64::max);
    let ground = (scale == Scale::Shared).then_some(tallest / 2.0);
    extents
        .iter()
        .zip(cells.into_iter().zip(scales))
        .map(|(extent, (cell, cell_scale))| place(extent, cell, cell_scale, ground))
        .collect()
}

/// Rows of equal height; columns as wide as what they show.
fn cells(
    extents: &[Extent],
    n_columns: usize,
    [width, height]: [usize; 2],
    caption_px: usize,
    scale: Scale,
) -> Vec<Cell> {
    let n_rows = extents.len().div_ceil(n_columns);
    let height_of = |figure: usize| {
        let own = extents.iter().filter(|it| scale == Scale::Shared || it.figure == figure);
        own.map(|it| it.size()[1]).fold(0.0, f64::max)
    };
    let mut needs = vec![0.0f64; n_columns];
    for (index, extent) in extents.iter().enumerate() {
        let need = &mut needs[index % n_columns];
        *need = need.max((extent.size()[0] / height_of(extent.figure)).clamp(0.01, 100.0));
    }
    let mean = needs.iter().sum::<f64>() / n_columns as f64;
    let mut edges = vec![0.0];
    for need in needs {
        edges.push(edges[edges.len() - 1] + need + 0.3 * mean);
    }
    let total = edges[n_columns];
    let edge = |column: usize| (width as f64 * edges[column] / total).round() as usize;
    (0..extents.len())
        .map(|index| {
            let (row, column) = (index / n_columns, index % n_columns);
            let (left, top) = (edge(column), height * row / n_rows);
            let bottom = (height * (row + 1) / n_rows).saturating_sub(caption_px);
            let width = edge(column + 1).saturating_sub(left).max(1);
            Cell { left, top, width, height: bottom.saturating_sub(top).max(1) }
        })
        .collect()
}

/// One scale a figure, over all its views; or one for all.
fn scales(extents: &[Extent], cells: &[Cell], scale: Scale) -> Vec<f64> {
    let own = |extent: &Extent, cell: &Cell| {
        let [w, h] = extent.size();
        (FILL[0] * cell.width as f64 / w).min(FILL[1] * cell.height as f64 / h)
    };
    let all = || extents.iter().zip(cells).map(|(extent, cell)| (extent.figure, own(extent, cell)));
    let least = |figure: Option<usize>| {
        all().filter(|it| figure.is_none_or(|f| f == it.0)).fold(f64::INFINITY, |r, it| r.min(it.1))
    };
    let shared = (scale == Scale::Shared).then(|| least(None));
    extents.iter().map(|it| shared.unwrap_or_else(|| least(Some(it.figure)))).collect()
}

/// Centres a figure in its cell, or stands it on a line so many pixels below the cell's centre.
fn place(extent: &Extent, cell: Cell, scale: f64, ground: Option<f64>) -> Placement {
    let middle = [0, 1].map(|it| (extent.low[it] + extent.high[it]) / 2.0);
    let centre_x = cell.left as f64 + cell.width as f64 / 2.0;
    let centre_y = cell.top as f64 + cell.height as f64 / 2.0;
    let y = match ground {
        None => centre_y + middle[1] * scale,
        Some(below) => centre_y + below + extent.low[1] * scale,
    };
    let bottom = y - extent.low[1] * scale;
    Placement { cell, scale, origin: [centre_x - middle[0] * scale, y], bottom }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_are_right_handed_and_see_the_named_side() {
        for view in [View::Front, View::ThreeQuarter, View::Side, View::Back, View::Top] {
            let camera = Camera::of(view);
            assert!((camera.right.cross(&camera.up) - camera.toward).norm() < 1e-12);
        }
        assert!(Camera::of(View::Front).toward.z > 0.9);
        assert!(Camera::of(View::Side).toward.x > 0.9);
        assert!(Camera::of(View::Back).toward.z < -0.9);
        assert!((Camera::of(View::Top).up - -Vec3::z()).norm() < 1e-12);
    }

    #[test]
    fn figures_fit_into_their_cells_and_shared_ones_stand_on_one_line() {
        let tall = Extent { figure: 0, low: [-0.3, 0.0], high: [0.3, 1.8] };
        let small = Extent { figure: 1, low: [-0.2, 0.0], high: [0.2, 0.9] };
        for (scale, ratio) in [(Scale::Fit, 2.0), (Scale::Shared, 1.0)] {
            let placed = arrange(&[tall, small], 1, [1200, 800], 40, scale);
            assert_eq!(placed[0].cell.top, placed[1].cell.top, "tall figures stand side by side");
            assert!((placed[1].scale / placed[0].scale - ratio).abs() < 1e-9);
            for (extent, it) in [tall, small].iter().zip(&placed) {
                let top = it.origin[1] - it.scale * extent.high[1];
                let bottom = it.origin[1] - it.scale * extent.low[1];
                assert!(top >= 0.0 && bottom <= 760.0);
            }
        }
        let placed = arrange(&[tall, small], 1, [1200, 800], 40, Scale::Shared);
        assert_eq!(placed[0].origin[1], placed[1].origin[1]);
    }
}
