//! Boxes in layers: readers below what they read, few crossings, no overlaps.

use std::collections::BTreeSet;

/// Distances in pixels.
const GAP_X: f64 = 26.0;
const GAP_Y: f64 = 44.0;
/// How wide a long wire is where it passes a layer.
const LANE: f64 = 10.0;
const N_SWEEPS: usize = 8;

/// Where a box lies within its drawing, from the top left corner.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Position {
    pub x: f64,
    pub y: f64,
}

/// A drawing's boxes, wires and size.
pub struct Layout {
    pub positions: Vec<Position>,
    /// By wire: the points between its ends, where it passes layers.
    pub bends: Vec<Vec<Position>>,
    pub width: f64,
    pub height: f64,
}

/// A box, or a place where a wire passes a layer.
struct Item {
    layer: usize,
    size: (f64, f64),
    above: Vec<usize>,
    below: Vec<usize>,
    /// Its centre.
    x: f64,
}

/// Lays out boxes of these sizes (width, height), with wires from one box to another.
pub fn layout(sizes: &[(f64, f64)], wires: &[(usize, usize)]) -> Layout {
    let layers = layers_of(sizes.len(), wires);
    let mut items: Vec<Item> = sizes
        .iter()
        .zip(&layers)
        .map(|(&size, &layer)| Item { layer, size, above: Vec::new(), below: Vec::new(), x: 0.0 })
        .collect();
    let lanes: Vec<Vec<usize>> = wires.iter().map(|&it| add_wire(&mut items, it)).collect();
    let n_layers = layers.iter().max().map_or(0, |it| it + 1);
    let mut rows = vec![Vec::new(); n_layers];
    for (index, item) in items.iter().enumerate() {
        rows[item.layer].push(index);
    }
    order_rows(&mut rows, &items);
    place_rows(&rows, &mut items);
    finish(sizes, &rows, &items, &lanes)
}

/// By box: one more than the deepest box that it reads. A wire that closes a circle (which boxes
/// made of several nodes can form) does not count.
fn layers_of(n: usize, wires: &[(usize, usize)]) -> Vec<usize> {
    let mut readers = vec![Vec::new(); n];
    for &(from, to) in wires {
        readers[from].push(to);
    }
    let mut res = vec![0; n];
    for start in 0..n {
        let mut path = BTreeSet::new();
        deepen(start, &readers, &mut res, &mut path);
    }
    res
}

fn deepen(from: usize, readers: &[Vec<usize>], layers: &mut [usize], path: &mut BTreeSet<usize>) {
    path.insert(from);
    for &to in &readers[from] {
        if !path.contains(&to) && layers[to] <= layers[from] {
            layers[to] = layers[from] + 1;
            deepen(to, readers, layers, path);
        }
    }
    path.remove(&from);
}

/// Joins two boxes, with an item in every layer between them. Returns these, from the source on.
fn add_wire(items: &mut Vec<Item>, (from, to): (usize, usize)) -> Vec<usize> {
    let mut lanes = Vec::new();
    let mut last = from;
    for layer in items[from].layer + 1..items[to].layer {
        let lane = items.len();
        let size = (LANE, 0.0);
        items.push(Item { layer, size, above: vec![last], below: Vec::new(), x: 0.0 });
        items[last].below.push(lane);
        lanes.push(lane);
        last = lane;
    }
    items[last].below.push(to);
    items[to].above.push(last);
    lanes
}

/// Orders every row by the mean position of what its items are joined to, down and up in turn.
fn order_rows(rows: &mut [Vec<usize>], items: &[Item]) {
    let mut ranks = vec![0.0; items.len()];
    let rank = |row: &[usize], ranks: &mut [f64]| {
        row.iter().enumerate().for_each(|(rank, &it)| ranks[it] = rank as f64);
    };
    rows.iter().for_each(|it| rank(it, &mut ranks));
    for sweep in 0..N_SWEEPS {
        let is_down = sweep % 2 == 0;
        for step in 0..rows.len() {
            let row = if is_down { step } else { rows.len() - 1 - step };
            let key = |&it: &usize| {
                let joined = if is_down { &items[it].above } else { &items[it].below };
                mean(joined.iter().map(|&it| ranks[it])).unwrap_or(ranks[it])
            };
            let mut sorted = rows[row].clone();
            sorted.sort_by(|a, b| key(a).total_cmp(&key(b)));
            rank(&sorted, &mut ranks);
            rows[row] = sorted;
        }
    }
}

/// Moves items towards what they are joined to, as far as their neighbours in the row let them.
fn place_rows(rows: &[Vec<usize>], items: &mut [Item]) {
    for row in rows {
        spread(row, items, &vec![0.0; row.len()]);
    }
    for sweep in 0..N_SWEEPS {
        for step in 0..rows.len() {
            let row = &rows[if sweep % 2 == 0 { step } else { rows.len() - 1 - step }];
            let wanted: Vec<f64> = row
                .iter()
                .map(|&it| {
                    let joined = items[it].above.iter().chain(&items[it].below);
                    mean(joined.map(|&it| items[it].x)).unwrap_or(items[it].x)
                })
                .collect();
            spread(row, items, &wanted);
        }
    }
}

/// Puts a row's items at the wanted centres; where they would overlap, at the mean of what pushing
/// from the left and pushing from the right gives.
fn spread(row: &[usize], items: &mut [Item], wanted: &[f64]) {
    let distance = |a: usize, b: usize| (items[a].size.0 + items[b].size.0) / 2.0 + GAP_X;
    let mut from_left = wanted.to_vec();
    for i in 1..row.len() {
        from_left[i] = from_left[i].max(from_left[i - 1] + distance(row[i - 1], row[i]));
    }
    let mut from_right = wanted.to_vec();
    for i in (1..row.len()).rev() {
        from_right[i - 1] = from_right[i - 1].min(from_right[i] - distance(row[i - 1], row[i]));
    }
    for (i, &item) in row.iter().enumerate() {
        items[item].x = (from_left[i] + from_right[i]) / 2.0;
    }
}

fn finish(
    sizes: &[(f64, f64)],
    rows: &[Vec<usize>],
    items: &[Item],
    lanes: &[Vec<usize>],
) -> Layout {
    let left = items.iter().map(|it| it.x - it.size.0 / 2.0).fold(f64::INFINITY, f64::min);
    let right = items.iter().map(|it| it.x + it.size.0 / 2.0).fold(f64::NEG_INFINITY, f64::max);
    let heights: Vec<f64> =
        rows.iter().map(|row| row.iter().map(|&it| items[it].size.1).fold(0.0, f64::max)).collect();
    let top = |layer: usize| heights[..layer].iter().map(|it| it + GAP_Y).sum::<f64>();
    let middle = |it: &Item| top(it.layer) + heights[it.layer] / 2.0;
    let corner =
        |it: &Item| Position { x: it.x - it.size.0 / 2.0 - left, y: middle(it) - it.size.1 / 2.0 };
    let bend = |&it: &usize| {
        let (x, y) = (items[it].x - left, top(items[it].layer));
        [Position { x, y }, Position { x, y: y + heights[items[it].layer] }]
    };
    Layout {
        positions: items[..sizes.len()].iter().map(corner).collect(),
        bends: lanes.iter().map(|it| it.iter().flat_map(bend).collect()).collect(),
        width: (right - left).max(0.0),
        height: (top(rows.len()) - GAP_Y).max(0.0),
    }
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, n) = values.fold((0.0, 0), |(sum, n), it| (sum + it, n + 1));
    (n > 0).then(|| sum / f64::from(n))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Wires of a graph without circles, drawn by a small fixed generator.
    fn random_wires(n: usize, seed: u64) -> Vec<(usize, usize)> {
        let mut state = seed;
        let mut next = |bound: usize| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 33) as usize % bound
        };
        (1..n).flat_map(|to| [(next(to), to), (next(to), to)]).collect()
    }

    #[test]
    fn boxes_do_not_overlap_and_readers_lie_below() {
        for seed in 0..20 {
            let sizes: Vec<(f64, f64)> =
                (0..30).map(|it| (40.0 + f64::from(it * 7 % 50), 30.0)).collect();
            let wires = random_wires(sizes.len(), seed);
            let res = layout(&sizes, &wires);
            for &(from, to) in &wires {
                assert!(res.positions[from].y + sizes[from].1 < res.positions[to].y);
            }
            for a in 0..sizes.len() {
                for b in 0..a {
                    let (p, q) = (res.positions[a], res.positions[b]);
                    let apart_x = p.x + sizes[a].0 <= q.x || q.x + sizes[b].0 <= p.x;
                    let apart_y = p.y + sizes[a].1 <= q.y || q.y + sizes[b].1 <= p.y;
                    assert!(apart_x || apart_y, "seed {seed}: {a} and {b}");
                }
                let p = res.positions[a];
                assert!(p.x >= -1e-9 && p.x + sizes[a].0 <= res.width + 1e-9);
                assert!(p.y >= 0.0 && p.y + sizes[a].1 <= res.height + 1e-9);
            }
        }
    }

    #[test]
    fn circles_and_nothing_are_laid_out_too() {
        assert_eq!(layout(&[], &[]).height, 0.0);
        let res = layout(&[(10.0, 10.0); 2], &[(0, 1), (1, 0)]);
        assert!(res.positions[0].y != res.positions[1].y);
    }
}
