//! Rectangles in a square.

/// Texels between rectangles.
const GUTTER: usize = 1;

/// Places rectangles (rows, columns) in a square of so many texels, without overlap: the tallest first,
/// each on the first shelf that has room. The first row and column of each, in the order given; `None`
/// if they do not fit.
pub fn pack(sizes: &[[usize; 2]], side: usize) -> Option<Vec<[usize; 2]>> {
    let mut order: Vec<usize> = (0..sizes.len()).collect();
    order.sort_by(|&a, &b| {
        sizes[b][0].cmp(&sizes[a][0]).then(sizes[b][1].cmp(&sizes[a][1])).then(a.cmp(&b))
    });
    // Of every shelf: its first row, its height, and the first free column.
    let mut shelves: Vec<[usize; 3]> = Vec::new();
    let mut places = vec![[0, 0]; sizes.len()];
    for index in order {
        let [height, width] = sizes[index];
        let has_room = |it: &&mut [usize; 3]| it[1] >= height && it[2] + width <= side;
        if let Some(shelf) = shelves.iter_mut().find(has_room) {
            places[index] = [shelf[0], shelf[2]];
            shelf[2] += width + GUTTER;
            continue;
        }
        let top = shelves.last().map_or(0, |it| it[0] + it[1] + GUTTER);
        if top + height > side || width > side {
            return None;
        }
        shelves.push([top, height, width + GUTTER]);
        places[index] = [top, 0];
    }
    Some(places)
}

/// Rectangles at the largest scale at which they fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Packing {
    /// Of the square: the one asked for, or as often doubled as the least sizes need.
    pub side: usize,
    /// Texels a unit of length.
    pub scale: f64,
    /// Rows and columns of every rectangle.
    pub sizes: Vec<[usize; 2]>,
    pub places: Vec<[usize; 2]>,
}

/// The least rows and columns of a rectangle.
const LEAST: [usize; 2] = [4, 8];

/// Finds the largest scale, by bisection, at which rectangles of these lengths (along, around) fit into a
/// square.
pub fn pack_largest(lengths: &[[f64; 2]], side: usize) -> Packing {
    let sizes = |scale: f64| -> Vec<[usize; 2]> {
        let size = |of: &[f64; 2]| {
            [0, 1].map(|it| ((of[it] * scale).ceil().min(1e6) as usize).max(LEAST[it]))
        };
        lengths.iter().map(size).collect()
    };
    let mut side = side;
    while pack(&sizes(0.0), side).is_none() {
        side *= 2;
    }
    let longest = lengths.iter().flatten().fold(0.0, |most: f64, &it| most.max(it));
    let (mut fits, mut fails) =
        (0.0, if longest > 0.0 { 2.0 * side as f64 / longest } else { 0.0 });
    for _ in 0..40 {
        let middle = 0.5 * (fits + fails);
        if pack(&sizes(middle), side).is_some() { fits = middle } else { fails = middle }
    }
    let sizes = sizes(fits);
    let places = pack(&sizes, side).expect("it did when it was tried");
    Packing { side, scale: fits, sizes, places }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::numerics::random::Random;

    #[test]
    fn rectangles_lie_inside_and_apart() {
        let mut random = Random::new(8);
        for count in [1, 2, 30, 80] {
            let mut length = || random.between(0.01, 1.0);
            let lengths: Vec<[f64; 2]> = (0..count).map(|_| [length(), length()]).collect();
            let it = pack_largest(&lengths, 512);
            assert_eq!(it.side, 512);
            let mut taken = vec![false; it.side * it.side];
            for ([top, left], [height, width]) in it.places.iter().zip(&it.sizes) {
                for row in *top..top + height {
                    for column in *left..left + width {
                        assert!(!std::mem::replace(&mut taken[row * it.side + column], true));
                    }
                }
            }
            let used = taken.iter().filter(|&&it| it).count() as f64 / taken.len() as f64;
            assert!(used > if count > 2 { 0.5 } else { 0.2 }, "{count}: {used}");
        }
    }

    #[test]
    fn a_square_that_is_too_small_is_doubled() {
        assert_eq!(pack_largest(&vec![[1.0, 1.0]; 100], 16).side, 128);
        assert!(pack(&[[20, 5]], 16).is_none());
    }
}
