//! Light, hollows, shadows, and the layers of a picture.

use rayon::prelude::*;

use crate::kernels::geometry::mesh::{TriMesh, Vec3};
use crate::kernels::pictures::canvas::{Canvas, color::mix};

use super::camera::{Camera, Cell, Placement, View};
use super::colors::Color;
use super::raster::{Hit, SAMPLES, SeenSoup, Tiles};

/// What a tile needs to know of its panel.
pub struct Scene<'a> {
    pub body: &'a SeenSoup<'a>,
    pub bones: &'a SeenSoup<'a>,
    /// The figure's diagonal in pixels.
    pub size_px: f32,
    pub levels: Option<&'a Levels<'a>>,
}

/// The levels at which lines are drawn.
pub struct Levels<'a> {
    values: &'a [f64],
    low: f64,
    step: f64,
}

impl<'a> Levels<'a> {
    pub fn of(values: &'a [f64], count: usize) -> Self {
        let low = values.iter().copied().fold(f64::INFINITY, f64::min);
        let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        Self { values, low, step: (high - low) / (count + 1) as f64 }
    }

    /// How much of a line covers a hit: one on the line, fading within a sample of its rim.
    fn cover(&self, body: &SeenSoup<'_>, hit: &Hit) -> f32 {
        let (value, slope) = body.value_and_slope(hit, self.values);
        let place = (value - self.low) / self.step;
        let level = place.round();
        if !(slope > 0.0) || !(self.step > 0.0) || level < 1.0 {
            return 0.0;
        }
        let distance_samples = (place - level).abs() * self.step / slope;
        (1.6 - distance_samples).clamp(0.0, 1.0) as f32
    }
}

/// What one pixel holds before hollows, ground and layers are put together.
#[derive(Debug, Clone, Copy, Default)]
pub struct Pixel {
    /// The body's light, times its cover.
    body: Color,
    cover: f32,
    /// The mean depth of the covered samples, in pixels.
    depth: f32,
    /// The bones' light, times their opacity.
    bone: Color,
    bone_alpha: f32,
}

/// Shades the samples of a tile and averages them to pixels.
pub fn tile(scene: &Scene<'_>, body: &[Hit], bones: &[Hit], side: usize) -> Vec<Pixel> {
    let mut pixels = vec![Pixel::default(); side * side];
    let share = 1.0 / (SAMPLES * SAMPLES) as f32;
    for (sample, (body_hit, bone_hit)) in body.iter().zip(bones).enumerate() {
        let (y, x) = (sample / (side * SAMPLES), sample % (side * SAMPLES));
        let pixel = &mut pixels[y / SAMPLES * side + x / SAMPLES];
        if body_hit.is_some() {
            let mut color = lit(scene.body.color(body_hit), scene.body.normal(body_hit), 0.04);
            if let Some(levels) = scene.levels {
                color = mix(color, [0.03; 3], 0.62 * levels.cover(scene.body, body_hit));
            }
            pixel.body = add(pixel.body, color, share);
            pixel.cover += share;
            pixel.depth += body_hit.depth / SAMPLES as f32;
        }
        if bone_hit.is_some() {
            let alpha = bone_opacity(scene, body_hit, bone_hit);
            let color = lit(scene.bones.color(bone_hit), scene.bones.normal(bone_hit), 0.22);
            pixel.bone = add(pixel.bone, color, share * alpha);
            pixel.bone_alpha += share * alpha;
        }
    }
    for pixel in pixels.iter_mut().filter(|it| it.cover > 0.0) {
        pixel.depth *= share / pixel.cover;
    }
    pixels
}

/// Bones in front of the body are solid; behind its skin they fade with their depth.
fn bone_opacity(scene: &Scene<'_>, body: &Hit, bone: &Hit) -> f32 {
    if !body.is_some() || bone.depth >= body.depth {
        return 1.0;
    }
    let inside = (body.depth - bone.depth) / (scene.size_px * SAMPLES as f32);
    0.90 - 0.30 * (inside * 6.0).min(1.0)
}

/// Light on a surface of a colour: sky and ground, a key light from the upper left, a fill light, a
/// little gloss, and a darker rim where the surface turns away. The normal is in the camera's axes.
fn lit(albedo: Color, normal: [f32; 3], gloss: f32) -> Color {
    const KEY: [f32; 3] = [-0.444_3, 0.641_8, 0.624_9];
    const FILL: [f32; 3] = [0.778_5, 0.111_2, 0.617_7];
    // Halfway between the key light and the camera.
    const HALF: [f32; 3] = [-0.246_4, 0.355_9, 0.901_4];
    const SKY: Color = [0.97, 1.0, 1.06];
    const GROUND: Color = [0.74, 0.70, 0.68];
    let toward = |light: [f32; 3]| (0..3).map(|it| normal[it] * light[it]).sum::<f32>();
    let wrapped = |cosine: f32, wrap: f32| ((cosine + wrap) / (1.0 + wrap)).max(0.0);
    let sky = mix(GROUND, SKY, 0.5 + 0.5 * normal[1]);
    let direct = 0.66 * wrapped(toward(KEY), 0.30) + 0.20 * wrapped(toward(FILL), 0.2);
    let away = 1.0 - normal[2].clamp(0.0, 1.0);
    let rim = 1.0 - 0.38 * away * away * away;
    let shine = gloss * toward(HALF).max(0.0).powi(32);
    [0, 1, 2].map(|it| albedo[it] * (0.42 * sky[it] + direct) * rim + shine)
}

fn add(sum: Color, color: Color, share: f32) -> Color {
    [0, 1, 2].map(|it| sum[it] + color[it] * share)
}

/// All pixels of a panel.
pub struct Layers {
    pixels: Vec<Pixel>,
    width: usize,
    height: usize,
    /// How much light reaches each pixel of the body, 0 to 1.
    open: Vec<f32>,
}

impl Layers {
    /// Puts tiles together.
    pub fn assemble(drawn: Vec<Vec<Pixel>>, tiles: Tiles, cell: Cell, size_px: f32) -> Self {
        let (width, height) = (cell.width, cell.height);
        let mut pixels = vec![Pixel::default(); width * height];
        for (tile, from) in drawn.iter().enumerate() {
            let (left, top) =
                (tile % tiles.columns * tiles.side, tile / tiles.columns * tiles.side);
            let columns = tiles.side.min(width - left);
            for row in 0..tiles.side.min(height - top) {
                let to = (top + row) * width + left;
                let line = &from[row * tiles.side..row * tiles.side + columns];
                pixels[to..to + columns].copy_from_slice(line);
            }
        }
        let open = openness(&pixels, width, height, size_px);
        Self { pixels, width, height, open }
    }

    /// Ground, body, bones, one over the other.
    pub fn compose(&self, canvas: &mut Canvas, cell: Cell, ground: Option<&Ground>) {
        let columns = cell.left..cell.left + self.width;
        let rows = canvas.rows_mut().skip(cell.top).take(self.height);
        rows.enumerate().for_each(|(y, row)| {
            for (x, color) in row[columns.clone()].iter_mut().enumerate() {
                *color = self.compose_pixel(*color, x, y, ground);
            }
        });
    }

    fn compose_pixel(
        &self,
        mut color: Color,
        x: usize,
        y: usize,
        ground: Option<&Ground>,
    ) -> Color {
        const SHADOW: Color = [0.16, 0.17, 0.21];
        let index = y * self.width + x;
        let pixel = &self.pixels[index];
        if pixel.cover < 1.0 {
            let shadow = ground.map_or(0.0, |it| it.shadow(x, y));
            if shadow > 0.0 {
                color = mix(color, SHADOW, shadow * self.inward(x, y));
            }
        }
        let (light, clear) = (self.open[index], 1.0 - pixel.bone_alpha);
        color = [0, 1, 2].map(|it| color[it] * (1.0 - pixel.cover) + pixel.body[it] * light);
        [0, 1, 2].map(|it| color[it] * clear + pixel.bone[it])
    }
}

impl Layers {
    /// Zero at the panel's rim, one well inside: a shadow must not end in a straight line.
    fn inward(&self, x: usize, y: usize) -> f32 {
        let rim = [x, self.width - 1 - x, y, self.height - 1 - y].into_iter().min();
        let share = rim.expect("four sides") as f32 / (0.07 * self.width.min(self.height) as f32);
        let t = share.min(1.0);
        t * t * (3.0 - 2.0 * t)
    }
}

/// Darkens what lies behind its surroundings (unsharp masking of the depth buffer, Luft et al. 2006),
/// at two radii: one for folds, one for whole limbs.
fn openness(pixels: &[Pixel], width: usize, height: usize, size_px: f32) -> Vec<f32> {
    let mut open = vec![1.0f32; pixels.len()];
    for (radius_share, strength) in [(0.008, 0.40), (0.03, 0.42)] {
        let radius = ((size_px * radius_share) as usize).max(1);
        let mut weights: Vec<f32> = pixels.iter().map(|it| it.cover).collect();
        let mut depths: Vec<f32> = pixels.iter().map(|it| it.cover * it.depth).collect();
        let blur = |values: &mut [f32]| {
            (0..2).for_each(|_| box_blur(values, width, height, radius));
        };
        rayon::join(|| blur(&mut weights), || blur(&mut depths));
        for (index, pixel) in pixels.iter().enumerate().filter(|it| it.1.cover > 0.0) {
            let around = depths[index] / weights[index].max(1e-6);
            let behind = (around - pixel.depth) / (2.0 * radius as f32) - 0.06;
            // At an outline only the nearer side has depths: that is no hollow.
            let is_inside = ((weights[index] - 0.5) / 0.4).clamp(0.0, 1.0);
            open[index] *= (-strength * is_inside * behind.clamp(0.0, 1.0)).exp();
        }
    }
    open
}

/// The mean over a square of `2 * radius + 1` pixels; beyond the rim there is zero.
fn box_blur(values: &mut [f32], width: usize, height: usize, radius: usize) {
    let share = 1.0 / (2 * radius + 1) as f32;
    let mut line = Vec::new();
    for row in values.chunks_exact_mut(width) {
        line.clear();
        line.extend_from_slice(row);
        slide(&line, radius, |at, sum| row[at] = sum * share);
    }
    // Columns are summed side by side, so that memory is walked along rows.
    let before = values.to_vec();
    let mut sums = vec![0.0f32; width];
    let row = |y: usize| &before[y * width..(y + 1) * width];
    for y in 0..radius.min(height) {
        sums.iter_mut().zip(row(y)).for_each(|(sum, it)| *sum += it);
    }
    for y in 0..height {
        if y + radius < height {
            sums.iter_mut().zip(row(y + radius)).for_each(|(sum, it)| *sum += it);
        }
        if y > radius {
            sums.iter_mut().zip(row(y - radius - 1)).for_each(|(sum, it)| *sum -= it);
        }
        let to = &mut values[y * width..(y + 1) * width];
        to.iter_mut().zip(&sums).for_each(|(to, sum)| *to = sum.max(0.0) * share);
    }
}

fn slide(line: &[f32], radius: usize, mut write: impl FnMut(usize, f32)) {
    let mut sum: f32 = line.iter().take(radius).sum();
    for at in 0..line.len() {
        sum += line.get(at + radius).copied().unwrap_or(0.0);
        if at > radius {
            sum -= line[at - radius - 1];
        }
        write(at, sum.max(0.0));
    }
}

/// A soft shadow on the plane below a figure.
pub struct Ground {
    /// Darkness from 0 to 1 by cells of the plane.
    map: Vec<f32>,
    n: usize,
    /// The plane's corner and the size of a cell, in mesh units.
    low: [f64; 2],
    cell: f64,
    height: f64,
    camera: Camera,
    scale: f64,
    /// The camera's origin from the panel's top left, in pixels.
    origin: [f64; 2],
}

impl Ground {
    /// The shadow of light from straight above, softer the higher what casts it. None from the top,
    /// where the figure hides it.
    pub fn of(mesh: &TriMesh, view: View, camera: &Camera, placement: &Placement) -> Option<Self> {
        const N: usize = 96;
        if view == View::Top {
            return None;
        }
        let (low, high) = mesh.bounds();
        let extent = high - low;
        let reach = extent.x.max(extent.z).max(0.15 * extent.y).max(1e-300);
        let cell = 2.0 * reach / N as f64;
        let corner = [(low.x + high.x) / 2.0, (low.z + high.z) / 2.0].map(|it| it - reach);
        let mut map = vec![0.0f32; N * N];
        for (centre, area) in shades(mesh) {
            let above = (centre.y - low.y) / (0.35 * extent.y.max(0.2 * reach));
            let area = area / (cell * cell) * (-above).exp();
            splat(
                &mut map,
                N,
                [(centre.x - corner[0]) / cell, (centre.z - corner[1]) / cell],
                area,
            );
        }
        for _ in 0..3 {
            box_blur(&mut map, N, N, 3);
        }
        for (index, value) in map.iter_mut().enumerate() {
            let [i, j] = [index % N, index / N].map(|it| 2.0 * (it as f32 + 0.5) / N as f32 - 1.0);
            let fade = (1.0 - i * i).max(0.0) * (1.0 - j * j).max(0.0);
            *value = 0.34 * (1.0 - (-1.3 * *value).exp()) * fade;
        }
        let origin = [
            placement.origin[0] - placement.cell.left as f64,
            placement.origin[1] - placement.cell.top as f64,
        ];
        let (camera, scale) = (*camera, placement.scale);
        Some(Self { map, n: N, low: corner, cell, height: low.y, camera, scale, origin })
    }

    /// How dark the ground is that a pixel of the panel shows.
    fn shadow(&self, x: usize, y: usize) -> f32 {
        let u = (x as f64 + 0.5 - self.origin[0]) / self.scale;
        let v = (self.origin[1] - y as f64 - 0.5) / self.scale;
        let on_plane = self.camera.right * u + self.camera.up * v;
        // Along the ray, the height changes by `toward.y`.
        let along = (self.height - on_plane.y) / self.camera.toward.y;
        let point = on_plane + self.camera.toward * along;
        let at =
            [(point.x - self.low[0]) / self.cell - 0.5, (point.z - self.low[1]) / self.cell - 0.5];
        let last = (self.n - 1) as f64;
        if at.iter().any(|it| !(0.0..last).contains(it)) {
            return 0.0;
        }
        let [i, j] = at.map(|it| it as usize);
        let [s, t] = [(at[0] - i as f64) as f32, (at[1] - j as f64) as f32];
        let value = |i: usize, j: usize| self.map[j * self.n + i];
        let near = value(i, j) * (1.0 - s) + value(i + 1, j) * s;
        let far = value(i, j + 1) * (1.0 - s) + value(i + 1, j + 1) * s;
        near * (1.0 - t) + far * t
    }
}

/// What casts a shadow: places, and the area that each hides from above.
fn shades(mesh: &TriMesh) -> Vec<(Vec3, f64)> {
    if mesh.is_point_cloud() {
        // Half of the disk of a bead: what stands upright hides less.
        let area = 0.5 * std::f64::consts::PI * super::beads::bead_radius(mesh).powi(2);
        return mesh.vertices().iter().map(|&it| (it, area)).collect();
    }
    let face = |face: usize| {
        let centre = mesh.corners(face).iter().sum::<Vec3>() / 3.0;
        (centre, mesh.area_vector(face).y.abs())
    };
    (0..mesh.n_faces()).map(face).collect()
}

/// Shares an amount among the four cells around a place.
fn splat(map: &mut [f32], n: usize, at: [f64; 2], amount: f64) {
    let at = at.map(|it| it - 0.5);
    let [i, j] = at.map(|it| it.floor().clamp(0.0, (n - 2) as f64) as usize);
    let [s, t] = [(at[0] - i as f64).clamp(0.0, 1.0), (at[1] - j as f64).clamp(0.0, 1.0)];
    for (dj, share_j) in [(0, 1.0 - t), (1, t)] {
        for (di, share_i) in [(0, 1.0 - s), (1, s)] {
            map[(j + dj) * n + i + di] += (amount * share_i * share_j) as f32;
        }
    }
}
