//! Clusters of points in any number of dimensions.

use rayon::prelude::*;

use crate::kernels::numerics::random::Random;

/// Beginnings that are tried.
const RESTARTS: u64 = 8;

/// The most rounds of Lloyd's algorithm from each.
const ROUNDS: usize = 100;

/// Labels points by k-means: Lloyd's algorithm from k-means++ (Arthur & Vassilvitskii 2007), the best
/// of eight tries.
///
/// `points` holds `n x dimension` numbers. Labels are `0..k` by their first points; there are fewer
/// than `k` only if there are not so many different points.
pub fn k_means(points: &[f64], dimension: usize, k: usize, seed: u64) -> Vec<u32> {
    let tries: Vec<(f64, Vec<u32>)> =
        (0..RESTARTS).into_par_iter().map(|it| one_try(points, dimension, k, seed, it)).collect();
    let best = tries.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)).expect("there are tries").1;
    by_first(&best)
}

/// Numbers labels by where they first occur.
pub fn by_first(labels: &[u32]) -> Vec<u32> {
    let n = labels.iter().max().map_or(0, |it| *it as usize + 1);
    let (mut new_of_old, mut next) = (vec![u32::MAX; n], 0);
    let number = |it: &u32| {
        let new = &mut new_of_old[*it as usize];
        if *new == u32::MAX {
            *new = next;
            next += 1;
        }
        *new
    };
    labels.iter().map(number).collect()
}

fn square(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

/// The sum of squares and the labels from one beginning.
fn one_try(points: &[f64], dimension: usize, k: usize, seed: u64, index: u64) -> (f64, Vec<u32>) {
    let rows: Vec<&[f64]> = points.chunks_exact(dimension).collect();
    let mut random = Random::stream(seed.wrapping_add(index << 32), "k_means");
    let mut centres = beginning(&rows, k, &mut random);
    let mut labels = vec![u32::MAX; rows.len()];
    let mut total = f64::INFINITY;
    for _ in 0..ROUNDS {
        let nearest = |row: &&[f64]| {
            let squares = centres.iter().map(|it| square(row, it)).zip(0_u32..);
            squares.min_by(|a, b| a.0.total_cmp(&b.0)).expect("there are centres")
        };
        let found: Vec<(f64, u32)> = rows.iter().map(nearest).collect();
        total = found.iter().map(|it| it.0).sum();
        let next: Vec<u32> = found.iter().map(|it| it.1).collect();
        if next == labels {
            break;
        }
        labels = next;
        recentre(&rows, &found, &mut centres);
    }
    (total, labels)
}

/// Rows, each chosen with a chance that grows with the squared distance from those before.
fn beginning(rows: &[&[f64]], k: usize, random: &mut Random) -> Vec<Vec<f64>> {
    let mut centres = vec![rows[random.below(rows.len())].to_vec()];
    let mut squares: Vec<f64> = rows.iter().map(|it| square(it, &centres[0])).collect();
    while centres.len() < k {
        let mut left = random.uniform() * squares.iter().sum::<f64>();
        let chosen = squares.iter().position(|it| {
            left -= it;
            left < 0.0
        });
        // All points are chosen already: there are fewer places than clusters.
        let Some(chosen) = chosen else { break };
        let centre = rows[chosen].to_vec();
        squares.iter_mut().zip(rows).for_each(|(it, row)| *it = it.min(square(row, &centre)));
        centres.push(centre);
    }
    centres
}

/// Moves centres to the means of their rows, and those without any to the rows farthest from theirs.
fn recentre(rows: &[&[f64]], found: &[(f64, u32)], centres: &mut [Vec<f64>]) {
    let mut counts = vec![0.0; centres.len()];
    centres.iter_mut().for_each(|it| it.fill(0.0));
    for (row, (_, label)) in rows.iter().zip(found) {
        counts[*label as usize] += 1.0;
        centres[*label as usize].iter_mut().zip(*row).for_each(|(sum, it)| *sum += it);
    }
    let mut farthest: Vec<usize> = (0..rows.len()).collect();
    farthest.sort_by(|a, b| found[*b].0.total_cmp(&found[*a].0).then(a.cmp(b)));
    let mut farthest = farthest.into_iter();
    for (centre, count) in centres.iter_mut().zip(&counts) {
        match *count > 0.0 {
            true => centre.iter_mut().for_each(|it| *it /= count),
            false => centre.copy_from_slice(rows[farthest.next().expect("more rows than centres")]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heaps_are_told_apart() {
        let mut random = Random::new(3);
        let truth: Vec<u32> = (0..300).map(|it| it % 5).collect();
        let points: Vec<f64> = (truth.iter())
            .flat_map(|it| {
                let at = f64::from(*it);
                [at + 0.1 * random.normal(), (2.0 * at).sin() + 0.1 * random.normal(), 0.0]
            })
            .collect();
        let labels = k_means(&points, 3, 5, 0);
        let n_wrong = labels.iter().zip(&truth).filter(|it| it.0 != it.1).count();
        assert_eq!(n_wrong, 0);
    }

    #[test]
    fn there_are_no_more_clusters_than_places() {
        let points = [0.0, 0.0, 1.0, 1.0, 1.0];
        assert_eq!(k_means(&points, 1, 4, 0), [0, 0, 1, 1, 1]);
        assert_eq!(k_means(&points, 1, 1, 0), [0; 5]);
    }
}
