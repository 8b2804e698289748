//! Places along branches that mean the same in all poses.

use super::point_at;
use crate::kernels::map_segments::places_along;
use crate::kernels::mesh::Vec3;

/// Steps of the reference's line; offsets are found in a tenth of them.
const N_STEPS: usize = 48;
const FINE: i64 = 10;

/// The farthest that a place may be shifted, over the length of the branch.
const MOST_SHIFT: f64 = 0.15;

/// Bends that differ by more count the same, in radians: a joint is no reason to shift anything.
const CAP_RAD: f64 = 0.5;

/// What stretching costs, in radians, and from where on it costs in proportion only.
const STRETCH_COST: f64 = 0.7;
const STRETCH_KNEE: f64 = 0.25;

/// Half of the chord that bends are measured over, over the length of the branch.
const REACH: f64 = 0.12;

/// Moves the points of a line along it, so that it bends where the reference does.
///
/// Both lines have the same number of points, which are at the same shares of their lengths. Where ends of a
/// branch are found at other places of the figure, or a bent limb is shorter along its centre curve, equal
/// shares are not equal places. Dynamic programming finds the shifts that make the bends of both lines
/// (how much, not where to) alike at the least stretching; ends stay.
pub fn aligned(reference: &[Vec3], line: &[Vec3], scale: f64) -> Vec<Vec3> {
    let [own, theirs] = [Line::new(reference), Line::new(line)];
    if reference.len() < 3 || !(own.length > 0.0 && theirs.length > 0.0 && scale > 0.0) {
        return line.to_vec();
    }
    // In units of the reference's length.
    let end = theirs.length * scale / own.length - 1.0;
    let step = 1.0 / N_STEPS as f64;
    let fine = step / FINE as f64;
    let most = ((MOST_SHIFT + end.abs()) / fine).ceil() as i64;
    let Some(shifts) = shifts(&own, &theirs, end, most, fine) else { return line.to_vec() };
    let shift = |share: f64| {
        let at = (share / step).min(N_STEPS as f64);
        let index = (at as usize).min(N_STEPS - 1);
        shifts[index] + (shifts[index + 1] - shifts[index]) * (at - index as f64)
    };
    let last = reference.len() - 1;
    let place = |index: usize| {
        if index == 0 || index == last {
            return line[index];
        }
        let share = own.along[index];
        theirs.at((share + shift(share)) / (1.0 + end))
    };
    (0..=last).map(place).collect()
}

struct Line<'a> {
    points: &'a [Vec3],
    along: Vec<f64>,
    length: f64,
}

impl<'a> Line<'a> {
    fn new(points: &'a [Vec3]) -> Self {
        let length = points.windows(2).map(|it| (it[1] - it[0]).norm()).sum();
        Self { points, along: places_along(points), length }
    }

    fn at(&self, share: f64) -> Vec3 {
        point_at(self.points, &self.along, share.clamp(0.0, 1.0))
    }

    /// The angle between the chords before and after a share, in radians.
    fn bend(&self, share: f64, reach: f64) -> f64 {
        let [a, b, c] = [-reach, 0.0, reach].map(|it| self.at(share + it));
        let (before, after) = (b - a, c - b);
        if before.norm() <= 1e-9 * self.length || after.norm() <= 1e-9 * self.length {
            return 0.0;
        }
        before.angle(&after)
    }
}

/// The shift at every step of the reference.
fn shifts(own: &Line<'_>, theirs: &Line<'_>, end: f64, most: i64, fine: f64) -> Option<Vec<f64>> {
    let n_offsets = (2 * most + 1) as usize;
    let scale = 1.0 + end;
    let last = (end / fine).round() as i64;
    let index = |offset: i64| (offset + most) as usize;
    let bends: Vec<f64> =
        (0..=N_STEPS).map(|it| own.bend(it as f64 / N_STEPS as f64, REACH)).collect();
    // Their bends at all places that an offset may lead to, in fine steps.
    let n_fine = N_STEPS as i64 * FINE;
    let their_bends: Vec<f64> = (-most..=n_fine + most)
        .map(|it| theirs.bend(it as f64 * fine / scale, REACH / scale))
        .collect();
    let misfit = |step: usize, offset: i64| {
        let place = step as i64 * FINE + offset;
        let bend = their_bends[(place + most) as usize];
        (bend - bends[step]).abs().min(CAP_RAD)
    };
    let stretch = |change: i64| {
        let slope = (change as f64 / FINE as f64).abs();
        STRETCH_COST
            * match slope < STRETCH_KNEE {
                true => slope * slope / (2.0 * STRETCH_KNEE),
                false => slope - STRETCH_KNEE / 2.0,
            }
    };
    let mut costs = vec![f64::INFINITY; n_offsets];
    costs[index(0)] = 0.0;
    let mut from = vec![0_i64; n_offsets * (N_STEPS + 1)];
    for step in 1..=N_STEPS {
        let mut next = vec![f64::INFINITY; n_offsets];
        for offset in -most..=most {
            let mut best = (f64::INFINITY, 0);
            for change in (1 - FINE)..FINE {
                let before = offset - change;
                if before.abs() > most {
                    continue;
                }
                let cost = costs[index(before)] + stretch(change);
                if cost < best.0 {
                    best = (cost, before);
                }
            }
            next[index(offset)] = best.0 + misfit(step, offset);
            from[step * n_offsets + index(offset)] = best.1;
        }
        costs = next;
    }
    if !costs[index(last)].is_finite() {
        return None;
    }
    let mut offset = last;
    let mut res = vec![end];
    for step in (1..=N_STEPS).rev() {
        offset = from[step * n_offsets + index(offset)];
        res.push(offset as f64 * fine);
    }
    res.reverse();
    Some(res)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A line with corners after these ways, of these angles in degrees, sampled evenly.
    fn line(corners: &[(f64, f64)], length: f64, n: usize) -> Vec<Vec3> {
        let place = |way: f64| {
            let (mut point, mut at, mut angle) = (Vec3::zeros(), 0.0, 0.0_f64);
            for &(corner, turn) in corners {
                let part = way.min(corner) - at;
                if part <= 0.0 {
                    break;
                }
                point += Vec3::new(angle.cos(), angle.sin(), 0.0) * part;
                at += part;
                if way > corner {
                    angle += turn.to_radians();
                }
            }
            point + Vec3::new(angle.cos(), angle.sin(), 0.0) * (way - at).max(0.0)
        };
        (0..=n).map(|it| place(length * it as f64 / n as f64)).collect()
    }

    #[test]
    fn equal_lines_stay() {
        for corners in [&[][..], &[(0.3, 40.0), (0.8, -60.0)]] {
            let it = line(corners, 1.0, 40);
            for (a, b) in aligned(&it, &it, 1.0).iter().zip(&it) {
                assert!((a - b).norm() < 1e-9);
            }
        }
    }

    #[test]
    fn bends_come_together_and_a_new_joint_stays_in_its_place() {
        // An ankle at 0.85 of 1. The other line misses a piece at its start, and has a new knee.
        let reference = line(&[(0.85, 60.0)], 1.0, 50);
        let bent = line(&[(0.40, 70.0), (0.75, 60.0)], 0.9, 50);
        let at = |points: &[Vec3], way: f64| points[(way * 50.0).round() as usize];
        let (knee, ankle) = (Vec3::x() * 0.40, bent[(0.75_f64 / 0.9 * 50.0).round() as usize]);
        let res = aligned(&reference, &bent, 1.0);
        let errors =
            |points: &[Vec3]| [(at(points, 0.5) - knee).norm(), (at(points, 0.84) - ankle).norm()];
        let (before, after) = (errors(&bent), errors(&res));
        assert!(before[0] > 0.045 && after[0] < 0.03, "{before:?} {after:?}");
        assert!(after[1] < 0.03, "{before:?} {after:?}");
    }
}
