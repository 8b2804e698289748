//! Signed distances sampled at the corners of an adaptive octree.

use std::collections::HashMap;

use rayon::prelude::*;

use super::DistanceField;
use crate::kernels::geometry::mesh::Vec3;

/// How finely to sample.
#[derive(Debug, Clone)]
pub struct SamplingOptions {
    /// Cells are split until interpolated values are right to this, at the middles of the cell, of
    /// its faces and of its edges. In the unit of the surface.
    pub tolerance: f64,
    /// Cells are halved at most this often.
    pub max_depth: u32,
    /// Cells farther outside than this are not split.
    pub reach: f64,
}

/// A distance field as trilinear functions on the cells of an octree (Frisken et al. 2000).
///
/// Some thirty nanoseconds a value, where the exact field takes microseconds; but values jump a
/// little between cells of different sizes.
#[derive(Debug, Clone)]
pub struct SampledDistance {
    low: Vec3,
    side: f64,
    cells: Vec<Cell>,
}

#[derive(Debug, Clone, Copy)]
struct Cell {
    /// The first of eight children, or 0.
    children: u32,
    /// Values at the corners; bit 0 of the index is x, bit 1 y, bit 2 z.
    values: [f64; 8],
}

/// A cell that is being looked at: its least corner and its size, in units of half the finest cell.
#[derive(Debug, Clone, Copy)]
struct Place {
    cell: usize,
    corner: [u32; 3],
    size: u32,
}

/// A place to be sampled, and what is known about it: that no surface is nearer than `bound` is far,
/// and maybe the sign.
struct Question {
    key: u64,
    bound: f64,
    sign: Option<f64>,
}

impl SampledDistance {
    /// Samples a field in a cube.
    ///
    /// # Panics
    /// If `max_depth` exceeds 15.
    pub fn new(field: &DistanceField, low: Vec3, side: f64, options: &SamplingOptions) -> Self {
        assert!(options.max_depth <= 15, "16 bits hold a coordinate");
        let mut sampler = Sampler {
            field,
            low,
            unit: side / f64::from(2u32 << options.max_depth),
            values: HashMap::new(),
        };
        let root = Place { cell: 0, corner: [0; 3], size: 2 << options.max_depth };
        let keys = corner_offsets().map(|offset| key_at(&root, offset, root.size));
        sampler.answer(
            keys.iter().map(|&key| Question { key, bound: f64::INFINITY, sign: None }).collect(),
        );
        let values = keys.map(|it| sampler.values[&it]);
        let mut cells = vec![Cell { children: 0, values }];
        let mut level = vec![root];
        while !level.is_empty() {
            level.retain(|it| sampler.is_near(it, &cells[it.cell].values, options.reach));
            let questions = level.iter().flat_map(|it| sampler.questions(it, &cells[it.cell]));
            let questions = questions.collect();
            sampler.answer(questions);
            let mut next = Vec::new();
            for place in &level {
                if place.size > 2 && sampler.error(place, &cells[place.cell]) > options.tolerance {
                    next.extend(sampler.split(place, &mut cells));
                }
            }
            level = next;
        }
        Self { low, side, cells }
    }

    /// The signed distance, interpolated; places outside of the cube count as its nearest ones, plus
    /// their distance to them.
    pub fn distance(&self, place: Vec3) -> f64 {
        let (cell, at, _, outside) = self.locate(place);
        interpolate(&cell.values, at) + outside.norm()
    }

    /// The signed distance and its gradient.
    pub fn distance_and_gradient(&self, place: Vec3) -> (f64, Vec3) {
        let (cell, at, size, outside) = self.locate(place);
        let value = interpolate(&cell.values, at) + outside.norm();
        let inside = gradient(&cell.values, at) / size;
        let within = inside.zip_map(&outside, |slope, out| if out == 0.0 { slope } else { 0.0 });
        (value, within + outside.try_normalize(0.0).unwrap_or_default())
    }

    /// The leaf that a place lies in, the place in it from 0 to 1, the leaf's size, and by how much
    /// the place is outside of the cube.
    fn locate(&self, place: Vec3) -> (&Cell, Vec3, f64, Vec3) {
        let clamped = (place - self.low).map(|it| it.clamp(0.0, self.side));
        let mut at = clamped / self.side;
        let mut size = self.side;
        let mut cell = &self.cells[0];
        while cell.children != 0 {
            let mut child = 0;
            for axis in 0..3 {
                at[axis] *= 2.0;
                if at[axis] >= 1.0 {
                    at[axis] -= 1.0;
                    child |= 1 << axis;
                }
            }
            size /= 2.0;
            cell = &self.cells[cell.children as usize + child];
        }
        (cell, at, size, place - self.low - clamped)
    }
}

fn interpolate(values: &[f64; 8], at: Vec3) -> f64 {
    let mix = |a: f64, b: f64, t: f64| a + (b - a) * t;
    let line = |it: usize| mix(values[it], values[it + 1], at.x);
    mix(mix(line(0), line(2), at.y), mix(line(4), line(6), at.y), at.z)
}

fn gradient(values: &[f64; 8], at: Vec3) -> Vec3 {
    let other = |axis: usize| [(axis + 1) % 3, (axis + 2) % 3];
    Vec3::from_fn(|axis, _| {
        let [first, second] = other(axis);
        let mut slope = 0.0;
        for corner in (0..8).filter(|it| it & (1 << axis) == 0) {
            let share =
                |axis: usize| if corner & (1 << axis) == 0 { 1.0 - at[axis] } else { at[axis] };
            slope += (values[corner | (1 << axis)] - values[corner]) * share(first) * share(second);
        }
        slope
    })
}

fn corner_offsets() -> [[u32; 3]; 8] {
    std::array::from_fn(|it| [0, 1, 2].map(|axis| (it as u32 >> axis) & 1))
}

/// The name of a place: a corner of a cell plus steps of a size.
fn key_at(place: &Place, steps: [u32; 3], step: u32) -> u64 {
    let at = |axis: usize| u64::from(place.corner[axis] + steps[axis] * step);
    at(0) | at(1) << 20 | at(2) << 40
}

struct Sampler<'a> {
    field: &'a DistanceField,
    low: Vec3,
    unit: f64,
    /// Looked up only, never walked through.
    values: HashMap<u64, f64>,
}

impl Sampler<'_> {
    fn position(&self, key: u64) -> Vec3 {
        let at = |axis: u64| (key >> (20 * axis) & 0xf_ffff) as f64;
        self.low + Vec3::new(at(0), at(1), at(2)) * self.unit
    }

    /// Whether a part of the cell may be inside, or at most `reach` outside.
    fn is_near(&self, place: &Place, values: &[f64; 8], reach: f64) -> bool {
        let diagonal = f64::from(place.size) * self.unit * 3f64.sqrt();
        let least = values.iter().fold(f64::INFINITY, |a, &b| a.min(b));
        // Every point is at most half a diagonal away from a corner.
        least - diagonal / 2.0 < reach
    }

    /// The corners, and the middles of edges, faces and the whole, that have no value yet.
    fn questions(&self, place: &Place, cell: &Cell) -> Vec<Question> {
        let half = place.size / 2;
        let corners = corner_offsets().map(|it| self.position(key_at(place, it, place.size)));
        let mut questions = Vec::with_capacity(19);
        for steps in thirds() {
            let key = key_at(place, steps, half);
            if self.values.contains_key(&key) {
                continue;
            }
            let position = self.position(key);
            let mut question = Question { key, bound: f64::INFINITY, sign: None };
            for (corner, value) in corners.iter().zip(cell.values) {
                let step = (corner - position).norm();
                question.bound = question.bound.min(value.abs() + step);
                // Between the two places there is no surface.
                if value.abs() > step * (1.0 + 1e-9) {
                    question.sign = Some(value.signum());
                }
            }
            questions.push(question);
        }
        questions
    }

    fn answer(&mut self, mut questions: Vec<Question>) {
        questions.sort_by_key(|it| it.key);
        questions.dedup_by(|later, kept| {
            let same = later.key == kept.key;
            if same {
                kept.sign = kept.sign.or(later.sign);
                kept.bound = kept.bound.min(later.bound);
            }
            same
        });
        let answers: Vec<f64> = questions.par_iter().map(|it| self.measure(it)).collect();
        self.values.extend(questions.iter().map(|it| it.key).zip(answers));
    }

    fn measure(&self, question: &Question) -> f64 {
        let position = self.position(question.key);
        let bound = question.bound * (1.0 + 1e-9);
        let tree = self.field.tree();
        let nearest =
            tree.nearest_within(position, bound * bound).unwrap_or_else(|| tree.nearest(position));
        let distance = nearest.square.sqrt();
        match question.sign {
            Some(sign) => sign * distance,
            None if self.field.is_inside(position) => -distance,
            None => distance,
        }
    }

    /// The largest error of the cell's own values in the middles.
    fn error(&self, place: &Place, cell: &Cell) -> f64 {
        let errors = thirds().map(|steps| {
            let at = Vec3::from_fn(|axis, _| f64::from(steps[axis]) / 2.0);
            let exact = self.values[&key_at(place, steps, place.size / 2)];
            (interpolate(&cell.values, at) - exact).abs()
        });
        errors.fold(0.0, f64::max)
    }

    /// Appends the eight children of a cell.
    fn split(&self, place: &Place, cells: &mut Vec<Cell>) -> [Place; 8] {
        let half = place.size / 2;
        let first = cells.len();
        cells[place.cell].children = first as u32;
        let mut child = 0;
        corner_offsets().map(|steps| {
            let corner = [0, 1, 2].map(|axis| place.corner[axis] + steps[axis] * half);
            let own = Place { cell: first + child, corner, size: half };
            let values = corner_offsets().map(|it| self.values[&key_at(&own, it, half)]);
            cells.push(Cell { children: 0, values });
            child += 1;
            own
        })
    }
}

/// The 27 places of a cell's corners, edges, faces and middle, in steps of half its size.
fn thirds() -> impl Iterator<Item = [u32; 3]> {
    (0..27u32).map(|it| [it % 3, it / 3 % 3, it / 9])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes::torus;
    use crate::kernels::numerics::random::Random;

    fn sampled(tolerance: f64) -> (DistanceField, SampledDistance) {
        let field = DistanceField::new(&torus(0.3, 0.1, 80, 40));
        let options = SamplingOptions { tolerance, max_depth: 9, reach: 0.02 };
        let sampled = SampledDistance::new(&field, Vec3::repeat(-0.5), 1.0, &options);
        (field, sampled)
    }

    #[test]
    fn inside_values_are_right_to_about_the_tolerance() {
        let (field, sampled) = sampled(0.003);
        let mut random = Random::new(4);
        let mut largest = 0.0f64;
        for _ in 0..3000 {
            let place = Vec3::from_fn(|_, _| random.between(-0.45, 0.45));
            let exact = field.distance(place);
            if exact < 0.0 {
                largest = largest.max((sampled.distance(place) - exact).abs());
            }
        }
        assert!(largest < 0.006, "{largest}");
    }

    #[test]
    fn gradients_are_the_slopes_of_the_values() {
        let (_, sampled) = sampled(0.01);
        let mut random = Random::new(5);
        let step = 1e-7;
        for _ in 0..200 {
            let place = Vec3::from_fn(|_, _| random.between(-0.6, 0.6));
            let (value, gradient) = sampled.distance_and_gradient(place);
            assert_eq!(value, sampled.distance(place));
            for axis in 0..3 {
                let mut further = place;
                further[axis] += step;
                let slope = (sampled.distance(further) - value) / step;
                assert!((slope - gradient[axis]).abs() < 1e-4, "{slope} {gradient}");
            }
        }
    }

    #[test]
    fn samples_are_the_same_at_any_number_of_threads() {
        let with = |n: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
            pool.install(|| sampled(0.005).1.cells.iter().map(|it| it.values).collect::<Vec<_>>())
        };
        assert_eq!(with(1), with(3));
    }
}
