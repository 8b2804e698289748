//! Choosing separators that do not get in each other's way.

use super::shrink::Separator;
use crate::kernels::numerics::sparse::row_offsets;

/// Chooses separators greedily by weight, so that no more of them go through a point than its
/// capacity allows.
///
/// The weight of a separator is its quality over one plus the qualities of all others that share a
/// point with it: good ones win, and of equally good ones those that block few others. Repeated ones
/// are dropped. Returns the chosen ones, the heaviest first.
pub fn pack(mut separators: Vec<Separator>, capacities: &[u32]) -> Vec<Separator> {
    separators.sort_by(|a, b| a.points.cmp(&b.points).then(b.quality.total_cmp(&a.quality)));
    separators.dedup_by(|later, kept| later.points == kept.points);
    let weights = weights(&separators, capacities.len());
    let mut order: Vec<usize> = (0..separators.len()).collect();
    order.sort_by(|&a, &b| weights[b].total_cmp(&weights[a]).then(a.cmp(&b)));
    let mut room = capacities.to_vec();
    let mut chosen = vec![];
    for index in order {
        let points = &separators[index].points;
        if points.iter().all(|&it| room[it as usize] > 0) {
            points.iter().for_each(|&it| room[it as usize] -= 1);
            chosen.push(std::mem::replace(
                &mut separators[index],
                Separator { points: vec![], quality: 0.0 },
            ));
        }
    }
    chosen
}

fn weights(separators: &[Separator], n_points: usize) -> Vec<f64> {
    let through = Through::of(separators, n_points);
    let mut last_met = vec![u32::MAX; separators.len()];
    let weigh = |(index, separator): (usize, &Separator)| {
        let mut total = 1.0;
        last_met[index] = index as u32;
        for &other in separator.points.iter().flat_map(|&point| through.separators(point)) {
            if last_met[other as usize] != index as u32 {
                last_met[other as usize] = index as u32;
                total += separators[other as usize].quality;
            }
        }
        separator.quality / total
    };
    separators.iter().enumerate().map(weigh).collect()
}

/// The separators through every point.
struct Through {
    offsets: Vec<usize>,
    separators: Vec<u32>,
}

impl Through {
    fn of(separators: &[Separator], n_points: usize) -> Self {
        let points = separators.iter().flat_map(|it| &it.points);
        let offsets = row_offsets(n_points, points.copied());
        let mut next = offsets.clone();
        let mut through = vec![0; offsets[n_points]];
        for (index, separator) in separators.iter().enumerate() {
            for &point in &separator.points {
                through[next[point as usize]] = index as u32;
                next[point as usize] += 1;
            }
        }
        Self { offsets, separators: through }
    }

    fn separators(&self, point: u32) -> &[u32] {
        let point = point as usize;
        &self.separators[self.offsets[point]..self.offsets[point + 1]]
    }
}
