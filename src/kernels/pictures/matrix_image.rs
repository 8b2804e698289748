//! Pictures of matrices: a coloured cell an entry.

use faer::MatRef;

use super::canvas::{
    Canvas,
    color::Color,
    text::{Lettering, width, write, write_centered},
};
use super::snapshot::colors::viridis;
use crate::kernels::image::Image;

/// What stands around the cells.
#[derive(Debug, Clone, PartialEq)]
pub struct MatrixImageOptions {
    /// Pixels of a cell.
    pub cell: [usize; 2],
    pub rows: Vec<String>,
    /// Below the columns.
    pub x_label: String,
    pub title: String,
    /// Orders of magnitude below the largest entry that colours tell apart.
    pub decades: f64,
}

const INK: Color = [0.02, 0.02, 0.02];
const LETTER: f32 = 8.0;

/// Draws entries that are not negative by their magnitude: from violet (small or zero) to yellow.
///
/// Columns are numbered from zero.
pub fn matrix_image(matrix: MatRef<'_, f64>, options: &MatrixImageOptions) -> Image {
    let [cell_x, cell_y] = options.cell;
    let widest = options.rows.iter().map(|it| width(it, LETTER)).fold(0.0, f32::max);
    let (left, top) = (widest.ceil() as usize + 20, 34);
    let (n_rows, n_cols) = (matrix.nrows(), matrix.ncols());
    let (right, bottom) = (left + n_cols * cell_x, top + n_rows * cell_y);
    let mut canvas = Canvas::white(right + 20, bottom + 48);
    let largest = (0..n_cols)
        .flat_map(|column| (0..n_rows).map(move |row| matrix[(row, column)]))
        .filter(|it| it.is_finite())
        .fold(0.0, f64::max);
    for row in 0..n_rows {
        for column in 0..n_cols {
            let color = color(matrix[(row, column)], largest, options.decades);
            for (x, y) in cell_pixels(options.cell) {
                canvas.blend(left + column * cell_x + x, top + row * cell_y + y, color, 1.0);
            }
        }
    }
    for (row, name) in options.rows.iter().enumerate() {
        let middle = top as f32 + (row as f32 + 0.5) * cell_y as f32 + LETTER / 2.0;
        let lettering = Lettering { height: LETTER, anchor: 1.0, angle_rad: 0.0, pen: 0.085 };
        write(&mut canvas, name, [left as f32 - 8.0, middle], lettering, INK);
    }
    for column in (0..n_cols).step_by(tick_step(n_cols, cell_x)) {
        let x = left as f32 + (column as f32 + 0.5) * cell_x as f32;
        let below = bottom as f32 + 6.0 + LETTER;
        write_centered(&mut canvas, &column.to_string(), [x, below], LETTER, INK);
    }
    let middle = (left + right) as f32 / 2.0;
    write_centered(&mut canvas, &options.x_label, [middle, bottom as f32 + 34.0], 10.0, INK);
    write_centered(&mut canvas, &options.title, [middle, 22.0], 11.0, INK);
    canvas.into_image()
}

fn cell_pixels([width, height]: [usize; 2]) -> impl Iterator<Item = (usize, usize)> {
    (0..height).flat_map(move |y| (0..width).map(move |x| (x, y)))
}

fn color(value: f64, largest: f64, decades: f64) -> Color {
    if !value.is_finite() {
        return [0.5; 3];
    }
    if !(value > 0.0) {
        return viridis(0.0);
    }
    viridis(1.0 + (value / largest).log10() / decades)
}

/// Columns from one number to the next, so that numbers stand apart.
fn tick_step(n_cols: usize, cell: usize) -> usize {
    let steps = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000];
    steps.into_iter().find(|it| it * cell >= 34).unwrap_or(n_cols.max(1))
}

#[cfg(test)]
mod tests {
    use faer::Mat;

    use super::*;

    #[test]
    fn cells_stand_where_their_entries_do() {
        let matrix =
            Mat::from_fn(3, 4, |row, column| if (row, column) == (2, 1) { 5.0 } else { 0.0 });
        let options = MatrixImageOptions {
            cell: [10, 12],
            rows: ["a", "b", "c"].map(str::to_owned).to_vec(),
            x_label: "frequency".to_owned(),
            title: "entries".to_owned(),
            decades: 4.0,
        };
        let image = matrix_image(matrix.as_ref(), &options);
        let left =
            width("a", LETTER).max(width("b", LETTER)).max(width("c", LETTER)).ceil() as usize;
        let at = |row: usize, column: usize| {
            let (x, y) = (left + 20 + column * 10 + 5, 34 + row * 12 + 6);
            image.pixels[y * image.width + x]
        };
        let bright = |it: [u8; 3]| u32::from(it[0]) + u32::from(it[1]);
        assert!(bright(at(2, 1)) > 400, "{:?}", at(2, 1));
        for (row, column) in [(0, 0), (1, 1), (2, 0), (2, 2)] {
            assert!(bright(at(row, column)) < 120, "{:?}", at(row, column));
        }
    }

    #[test]
    fn magnitudes_span_the_decades() {
        assert_eq!(color(1.0, 1.0, 4.0), viridis(1.0));
        assert_eq!(color(1e-2, 1.0, 4.0), viridis(0.5));
        assert_eq!(color(1e-9, 1.0, 4.0), viridis(0.0));
        assert_eq!(color(f64::NAN, 1.0, 4.0), [0.5; 3]);
    }
}
