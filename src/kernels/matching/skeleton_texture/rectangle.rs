//! Values on the unrolled surface around a bone.

use super::bones::{Bone, Place};

/// A grid of texels: rows along a bone, columns around it. The last column is followed by the first.
///
/// Every texel holds one value for each of some channels.
#[derive(Debug, Clone, PartialEq)]
pub struct Rectangle {
    pub grid: Grid,
    /// Ascending.
    pub channels: Vec<u32>,
    /// `rows * columns * channels` values.
    pub values: Vec<f64>,
}

/// Where the texels of a rectangle are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grid {
    /// The part of the bone's axis that is covered, in lengths of the bone.
    pub span: [f64; 2],
    pub n_rows: usize,
    pub n_columns: usize,
}

/// A corner of a triangle: where it is, and its values by channel.
pub type Corner<'a> = (Place, &'a [(u32, f64)]);

/// A rectangle that is written.
///
/// Where surfaces lie over each other, that is taken which is nearest to the axis: it is the one that the
/// bone sees.
pub struct Writer {
    rectangle: Rectangle,
    /// By texel: the distance from the axis of what is written there.
    depths: Vec<f64>,
}

impl Grid {
    /// The middle of a row, along the bone.
    pub fn along(&self, row: usize) -> f64 {
        let share = (row as f64 + 0.5) / self.n_rows as f64;
        self.span[0] + (self.span[1] - self.span[0]) * share
    }

    /// The middle of a column, in turns.
    pub fn around(&self, column: usize) -> f64 {
        (column as f64 + 0.5) / self.n_columns as f64
    }

    /// In texels; the middle of the first is at 0.5.
    fn row_of(&self, along: f64) -> f64 {
        (along - self.span[0]) / (self.span[1] - self.span[0]) * self.n_rows as f64
    }
}

impl Rectangle {
    /// The values of a texel, one a channel.
    pub fn texel(&self, row: usize, column: usize) -> &[f64] {
        let n = self.channels.len();
        let first = (row * self.grid.n_columns + column) * n;
        &self.values[first..first + n]
    }

    /// Values between the middles of texels, bilinearly; beyond the first and last rows theirs.
    pub fn sample(&self, along: f64, around: f64) -> Vec<f64> {
        let grid = self.grid;
        let row = (grid.row_of(along) - 0.5).clamp(0.0, (grid.n_rows - 1) as f64);
        let column = around.rem_euclid(1.0) * grid.n_columns as f64 - 0.5;
        let (below, left) = (row.floor(), column.floor());
        let (t, s) = (row - below, column - left);
        let rows = [below as usize, (below as usize + 1).min(grid.n_rows - 1)];
        let columns =
            [0, 1].map(|it| (left as isize + it).rem_euclid(grid.n_columns as isize) as usize);
        let mut res = vec![0.0; self.channels.len()];
        for (row, of_row) in rows.into_iter().zip([1.0 - t, t]) {
            for (column, of_column) in columns.into_iter().zip([1.0 - s, s]) {
                let weight = of_row * of_column;
                let texel = self.texel(row, column);
                res.iter_mut().zip(texel).for_each(|(sum, it)| *sum += weight * it);
            }
        }
        res
    }

    /// The values of the nearest texel.
    pub fn nearest(&self, along: f64, around: f64) -> &[f64] {
        let grid = self.grid;
        let row = grid.row_of(along).clamp(0.0, (grid.n_rows - 1) as f64) as usize;
        let column = (around.rem_euclid(1.0) * grid.n_columns as f64) as usize;
        self.texel(row, column.min(grid.n_columns - 1))
    }

    /// Keeps only so many of the largest values of every texel, and their sum.
    pub fn limit_channels(&mut self, count: usize) {
        for texel in self.values.chunks_exact_mut(self.channels.len().max(1)) {
            let sum: f64 = texel.iter().sum();
            let mut order: Vec<usize> = (0..texel.len()).collect();
            order.sort_by(|&a, &b| texel[b].total_cmp(&texel[a]).then(a.cmp(&b)));
            order.iter().skip(count).for_each(|&it| texel[it] = 0.0);
            let kept: f64 = texel.iter().sum();
            if kept > 0.0 {
                texel.iter_mut().for_each(|it| *it *= sum / kept);
            }
        }
    }
}

impl Writer {
    pub fn new(grid: Grid, channels: Vec<u32>) -> Self {
        let n_texels = grid.n_rows * grid.n_columns;
        let values = vec![0.0; n_texels * channels.len()];
        Self {
            rectangle: Rectangle { grid, channels, values },
            depths: vec![f64::INFINITY; n_texels],
        }
    }

    /// Writes a vertex to the texel that it is in.
    pub fn dot(&mut self, corner: Corner<'_>) {
        let grid = self.rectangle.grid;
        let row = grid.row_of(corner.0.along).floor();
        if row >= 0.0 && row <= grid.n_rows as f64 {
            let row = (row as usize).min(grid.n_rows - 1);
            let column = (corner.0.around * grid.n_columns as f64) as usize % grid.n_columns;
            self.set(row, column, [(1.0, corner), (0.0, corner), (0.0, corner)]);
        }
    }

    /// Writes a triangle to all texels whose middles it covers: by barycentric interpolation on the
    /// unrolled plane, across the seam where need be.
    ///
    /// A triangle that the axis passes through covers all angles, and is written point by point.
    pub fn triangle(&mut self, bone: &Bone, corners: [Corner<'_>; 3]) {
        let grid = self.rectangle.grid;
        let first = corners[0].0.around;
        let turn = |it: &Corner<'_>| it.0.around - (it.0.around - first).round();
        let turns = [0, 1, 2].map(|it| turn(&corners[it]));
        if (turns[1] - turns[2]).abs() > 0.5 {
            return self.cap(bone, corners);
        }
        let x = turns.map(|it| it * grid.n_columns as f64);
        let y = corners.map(|it| grid.row_of(it.0.along));
        let determinant = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0]);
        if determinant.abs() < 1e-12 {
            return;
        }
        let range = |it: [f64; 3]| {
            let (low, high) = (it[0].min(it[1]).min(it[2]), it[0].max(it[1]).max(it[2]));
            ((low - 0.5).ceil(), (high - 0.5).floor())
        };
        let (rows, columns) = (range(y), range(x));
        let last = grid.n_rows as f64 - 1.0;
        let (low, high) = (rows.0.max(0.0), rows.1.min(last));
        for row in low as isize..=high as isize {
            for column in columns.0 as isize..=columns.1 as isize {
                let (dx, dy) = (column as f64 + 0.5 - x[0], row as f64 + 0.5 - y[0]);
                let b = (dx * (y[2] - y[0]) - dy * (x[2] - x[0])) / determinant;
                let c = (dy * (x[1] - x[0]) - dx * (y[1] - y[0])) / determinant;
                let a = 1.0 - b - c;
                if a.min(b).min(c) < -1e-9 {
                    continue;
                }
                let column = column.rem_euclid(grid.n_columns as isize) as usize;
                let [p, q, r] = corners;
                self.set(row as usize, column, [(a, p), (b, q), (c, r)]);
            }
        }
    }

    fn cap(&mut self, bone: &Bone, corners: [Corner<'_>; 3]) {
        const STEPS: usize = 24;
        let grid = self.rectangle.grid;
        let points = corners.map(|it| bone.point(it.0));
        for i in 0..=STEPS {
            for j in 0..=STEPS - i {
                let [b, c] = [i, j].map(|it| it as f64 / STEPS as f64);
                let a = 1.0 - b - c;
                let place = bone.place(points[0] * a + points[1] * b + points[2] * c);
                let row = grid.row_of(place.along).floor();
                if row < 0.0 || row >= grid.n_rows as f64 {
                    continue;
                }
                let column = (place.around * grid.n_columns as f64) as usize % grid.n_columns;
                let [p, q, r] = corners;
                self.set(row as usize, column, [(a, p), (b, q), (c, r)]);
            }
        }
    }

    /// Writes a mean of corners to a texel if it is nearer to the axis than what is there.
    fn set(&mut self, row: usize, column: usize, parts: [(f64, Corner<'_>); 3]) {
        let rectangle = &mut self.rectangle;
        let texel = row * rectangle.grid.n_columns + column;
        let depth: f64 = parts.iter().map(|(share, corner)| share * corner.0.radius).sum();
        if depth >= self.depths[texel] {
            return;
        }
        self.depths[texel] = depth;
        let n = rectangle.channels.len();
        let values = &mut rectangle.values[texel * n..(texel + 1) * n];
        values.fill(0.0);
        for (share, (_, corner)) in parts {
            for (channel, value) in corner {
                let at = rectangle.channels.binary_search(channel).expect("all are listed");
                values[at] += share * value;
            }
        }
    }

    /// What was written, and holes filled: around the bone between the nearest written
    /// texels, then whole rows from the nearest row. `None` if nothing was written.
    pub fn finish(mut self) -> Option<Rectangle> {
        let n = self.rectangle.channels.len();
        if self.depths.iter().all(|it| it.is_infinite()) {
            return None;
        }
        let grid = self.rectangle.grid;
        let is_written = |row: usize| {
            let row = row * grid.n_columns..(row + 1) * grid.n_columns;
            self.depths[row].iter().any(|it| it.is_finite())
        };
        let written_rows: Vec<usize> = (0..grid.n_rows).filter(|&it| is_written(it)).collect();
        for &row in &written_rows {
            self.fill_row(row);
        }
        let row_length = grid.n_columns * n;
        for row in (0..grid.n_rows).filter(|it| written_rows.binary_search(it).is_err()) {
            let from = *written_rows
                .iter()
                .min_by_key(|&&it| (it.abs_diff(row), it))
                .expect("something was written");
            let values = &mut self.rectangle.values;
            values.copy_within(from * row_length..(from + 1) * row_length, row * row_length);
        }
        Some(self.rectangle)
    }

    fn fill_row(&mut self, row: usize) {
        let (n, n_columns) = (self.rectangle.channels.len(), self.rectangle.grid.n_columns);
        let known: Vec<usize> =
            (0..n_columns).filter(|it| self.depths[row * n_columns + it].is_finite()).collect();
        for (index, &left) in known.iter().enumerate() {
            let right = known[(index + 1) % known.len()];
            let gap = (right + n_columns - left - 1) % n_columns + 1;
            for step in 1..gap {
                let t = step as f64 / gap as f64;
                let column = (left + step) % n_columns;
                for channel in 0..n {
                    let at = |column: usize| (row * n_columns + column) * n + channel;
                    let values = &mut self.rectangle.values;
                    values[at(column)] = values[at(left)] * (1.0 - t) + values[at(right)] * t;
                }
            }
        }
    }
}
