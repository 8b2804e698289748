//! Triangles to samples: a z-buffer in tiles.
//!
//! Every tile is drawn by one thread, its triangles in their order, and no tile sees another: the
//! picture does not depend on the number of threads.

use crate::kernels::geometry::mesh::Vec3;

use super::camera::{Camera, Placement};
use super::colors::Color;

/// Samples along one side of a pixel.
pub const SAMPLES: usize = 2;

/// Triangles with what their vertices show.
#[derive(Debug, Clone, Default)]
pub struct Soup {
    pub points: Vec<Vec3>,
    /// Unit length, or zero where there is none.
    pub normals: Vec<Vec3>,
    pub colors: Vec<Color>,
    pub triangles: Vec<[u32; 3]>,
    /// From this point on, points are drawn as if they were so much nearer to the camera.
    pub lifted: Option<(usize, f64)>,
}

impl Soup {
    pub fn push(&mut self, point: Vec3, normal: Vec3, color: Color) {
        self.points.push(point);
        self.normals.push(normal);
        self.colors.push(color);
    }
}

/// A vertex as the camera sees it: samples from the cell's top left, and samples toward the camera.
type Seen = [f32; 3];

/// A soup before a camera.
pub struct SeenSoup<'a> {
    pub soup: &'a Soup,
    seen: Vec<Seen>,
    /// Normals in the camera's axes.
    normals: Vec<[f32; 3]>,
    /// Triangles by tile.
    bins: Vec<Vec<u32>>,
    tile: usize,
}

/// The tiles of a cell, `side` pixels each way.
#[derive(Debug, Clone, Copy)]
pub struct Tiles {
    pub side: usize,
    pub columns: usize,
    pub rows: usize,
}

impl Tiles {
    pub fn of(placement: &Placement, side: usize) -> Self {
        let cell = placement.cell;
        Self { side, columns: cell.width.div_ceil(side), rows: cell.height.div_ceil(side) }
    }
}

impl<'a> SeenSoup<'a> {
    pub fn new(soup: &'a Soup, camera: &Camera, placement: &Placement, tiles: Tiles) -> Self {
        let samples = SAMPLES as f64;
        let origin = [
            placement.origin[0] - placement.cell.left as f64,
            placement.origin[1] - placement.cell.top as f64,
        ];
        let seen: Vec<Seen> = soup
            .points
            .iter()
            .enumerate()
            .map(|(index, point)| {
                let lift = soup.lifted.filter(|it| index >= it.0).map_or(0.0, |it| it.1);
                let p = camera.project(&(point + camera.toward * lift)) * placement.scale;
                let at = [origin[0] + p.x, origin[1] - p.y, p.z];
                at.map(|it| (it * samples) as f32)
            })
            .collect();
        let normals = soup
            .normals
            .iter()
            .map(|normal| camera.project(normal))
            .map(|it| [it.x as f32, it.y as f32, it.z as f32])
            .collect();
        let bins = bins(&seen, &soup.triangles, tiles);
        Self { soup, seen, normals, bins, tile: tiles.side * SAMPLES }
    }

    /// For every sample of a tile, the nearest triangle, or [`Hit::NONE`].
    pub fn draw(&self, tiles: Tiles, tile: usize) -> Vec<Hit> {
        let mut hits = vec![Hit::NONE; self.tile * self.tile];
        let left = (tile % tiles.columns * self.tile) as f32;
        let top = (tile / tiles.columns * self.tile) as f32;
        for &triangle in &self.bins[tile] {
            self.draw_triangle(triangle, [left, top], &mut hits);
        }
        hits
    }

    fn draw_triangle(&self, triangle: u32, [left, top]: [f32; 2], hits: &mut [Hit]) {
        let corners = self.soup.triangles[triangle as usize]
            .map(|it| self.seen[it as usize])
            .map(|it| [it[0] - left, it[1] - top, it[2]]);
        let [a, b, c] = corners;
        let area = edge(a, b, [c[0], c[1]]);
        if area == 0.0 {
            return;
        }
        let inverse = 1.0 / area;
        let range = |axis: usize| {
            let low = a[axis].min(b[axis]).min(c[axis]) - 0.5;
            let high = a[axis].max(b[axis]).max(c[axis]) - 0.5;
            (low.ceil().max(0.0) as usize)..((high.floor() + 1.0).max(0.0) as usize).min(self.tile)
        };
        let columns = range(0);
        for y in range(1) {
            for x in columns.clone() {
                let at = [x as f32 + 0.5, y as f32 + 0.5];
                let u = edge(b, c, at) * inverse;
                let v = edge(c, a, at) * inverse;
                let w = 1.0 - u - v;
                if u < 0.0 || v < 0.0 || w < 0.0 {
                    continue;
                }
                let depth = u * a[2] + v * b[2] + w * c[2];
                let hit = &mut hits[y * self.tile + x];
                if depth > hit.depth {
                    *hit = Hit { depth, triangle, weights: [u, v] };
                }
            }
        }
    }

    /// The normal at a hit in the camera's axes, turned to the camera.
    pub fn normal(&self, hit: &Hit) -> [f32; 3] {
        let [x, y, z] = self.blend(hit, |it| self.normals[it]);
        let length = (x * x + y * y + z * z).sqrt();
        if length == 0.0 {
            return [0.0, 0.0, 1.0];
        }
        let inverse = if z < 0.0 { -1.0 } else { 1.0 } / length;
        [x, y, z].map(|it| it * inverse)
    }

    pub fn color(&self, hit: &Hit) -> Color {
        self.blend(hit, |it| self.soup.colors[it])
    }

    /// A value at a hit, and how much it changes over one sample.
    pub fn value_and_slope(&self, hit: &Hit, values: &[f64]) -> (f64, f64) {
        let triangle = self.soup.triangles[hit.triangle as usize];
        let [a, b, c] = triangle.map(|it| self.seen[it as usize]);
        let [fa, fb, fc] = triangle.map(|it| values[it as usize]);
        let [u, v] = hit.weights.map(f64::from);
        let area = f64::from(edge(a, b, [c[0], c[1]]));
        // The gradient of a linear function: the edges across, weighted by the opposite values.
        let slope = [0, 1].map(|axis| {
            let across = |p: Seen, q: Seen| f64::from(q[axis] - p[axis]);
            (fa * across(b, c) + fb * across(c, a) + fc * across(a, b)) / area
        });
        (u * fa + v * fb + (1.0 - u - v) * fc, slope[0].hypot(slope[1]))
    }

    fn blend(&self, hit: &Hit, of: impl Fn(usize) -> [f32; 3]) -> [f32; 3] {
        let [a, b, c] = self.soup.triangles[hit.triangle as usize].map(|it| of(it as usize));
        let [u, v] = hit.weights;
        [0, 1, 2].map(|it| u * a[it] + v * b[it] + (1.0 - u - v) * c[it])
    }
}

/// The triangle nearest to the camera at a sample.
#[derive(Debug, Clone, Copy)]
pub struct Hit {
    pub depth: f32,
    pub triangle: u32,
    /// The weights of the first two corners.
    weights: [f32; 2],
}

impl Hit {
    pub const NONE: Self = Self { depth: f32::NEG_INFINITY, triangle: u32::MAX, weights: [0.0; 2] };

    pub fn is_some(&self) -> bool {
        self.triangle != u32::MAX
    }
}

/// Twice the signed area of `a`, `b` and a point.
fn edge(a: Seen, b: Seen, at: [f32; 2]) -> f32 {
    (b[0] - a[0]) * (at[1] - a[1]) - (b[1] - a[1]) * (at[0] - a[0])
}

fn bins(seen: &[Seen], triangles: &[[u32; 3]], tiles: Tiles) -> Vec<Vec<u32>> {
    let mut bins = vec![Vec::new(); tiles.columns * tiles.rows];
    let size = (tiles.side * SAMPLES) as f32;
    for (index, triangle) in triangles.iter().enumerate() {
        let corners = triangle.map(|it| seen[it as usize]);
        let range = |axis: usize, limit: usize| {
            let low = corners.iter().fold(f32::INFINITY, |res, it| res.min(it[axis]));
            let high = corners.iter().fold(f32::NEG_INFINITY, |res, it| res.max(it[axis]));
            if high < 0.0 {
                return 0..0;
            }
            ((low / size).max(0.0) as usize)..((high / size) as usize + 1).min(limit)
        };
        for row in range(1, tiles.rows) {
            for column in range(0, tiles.columns) {
                bins[row * tiles.columns + column].push(index as u32);
            }
        }
    }
    bins
}
