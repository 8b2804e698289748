//! Which protrusion is the head, which are arms, legs and a tail.

use super::front::ROOT;
use super::limb::Limb;
use crate::kernels::geometry::mesh::Vec3;

/// Indices into limbs; arms and legs are paired by side: `arms[0]` and `legs[0]` are on one side.
///
/// Of quadrupeds, arms are the fore legs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Roles {
    pub head: usize,
    pub arms: [usize; 2],
    pub legs: [usize; 2],
    pub tail: Option<usize>,
}

/// The best roles, with how well they fit.
#[derive(Debug, Clone, Copy)]
pub struct Assignment {
    pub roles: Roles,
    /// How well the roles fit, without unit: how long torso and neck are, less all asymmetry.
    pub fit: f64,
    /// The fit less that of the best other roles.
    pub margin: f64,
    /// How much farther tips of opposite sides are from each other than those of one side.
    pub side_margin: f64,
}

/// Tries all ways to call five protrusions head, arms and legs, or six with a tail.
///
/// Tests are intrinsic, so that the pose does not matter:
/// - arms, and legs, are equally long, equally fat, and equally far from the others;
/// - the tree that the distances between tips make (the four-point condition, Buneman 1974) has a
///   torso, with arms and head at one of its ends, legs and tail at the other;
/// - the head is fatter than an arm or a tail, and has what sticks out of it: nose, ears, horns
///   (`minor`: for every limb the sum of lesser persistences on it).
///
/// Only where a tail may be taken for a leg, the places of the roots are compared in space. Roles for
/// which `allows` is false are left out.
pub fn assign(limbs: &[Limb], minor: &[f64], allows: impl Fn(&Roles) -> bool) -> Assignment {
    let tips = Tips::of(limbs, minor);
    let mut ranked: Vec<(f64, Roles)> =
        all_roles(limbs.len()).into_iter().filter(allows).map(|it| (tips.fit(it), it)).collect();
    ranked.sort_by(|a, b| b.0.total_cmp(&a.0));
    let (fit, mut roles) = ranked[0];
    let mut side_margin = tips.side_margin(roles);
    if side_margin < 0.0 {
        roles.legs.swap(0, 1);
        side_margin = -side_margin;
    }
    let next = ranked.get(1).map_or(f64::NEG_INFINITY, |it| it.0);
    Assignment { roles, fit, margin: fit - next, side_margin }
}

/// Every choice once; what differs only in the order of a pair is the same.
fn all_roles(n_limbs: usize) -> Vec<Roles> {
    let mut res = Vec::new();
    for head in 0..n_limbs {
        let tails: Vec<Option<usize>> = match n_limbs {
            5 => vec![None],
            _ => (0..n_limbs).filter(|&it| it != head).map(Some).collect(),
        };
        for tail in tails {
            let others: Vec<usize> =
                (0..n_limbs).filter(|&it| it != head && Some(it) != tail).collect();
            for partner in 1..4 {
                let pair = [others[0], others[partner]];
                let mut rest = others.iter().copied().filter(|it| !pair.contains(it));
                let rest = [(); 2].map(|()| rest.next().expect("four less two"));
                res.push(Roles { head, arms: pair, legs: rest, tail });
                res.push(Roles { head, arms: rest, legs: pair, tail });
            }
        }
    }
    res
}

/// What is compared, free of units.
struct Tips {
    /// Distances between tips, over their mean.
    distances: Vec<Vec<f64>>,
    reaches: Vec<f64>,
    /// Logarithms.
    fatness: Vec<f64>,
    minor: Vec<f64>,
    /// In space.
    roots: Vec<Vec3>,
}

impl Tips {
    fn of(limbs: &[Limb], minor: &[f64]) -> Self {
        let n = limbs.len();
        let between = |a: &Limb, b: &Limb| 0.5 * (a.distances[b.tip] + b.distances[a.tip]);
        let sum: f64 = limbs.iter().map(|a| limbs.iter().map(|b| between(a, b)).sum::<f64>()).sum();
        let scale = sum / (n * (n - 1)) as f64;
        let row = |a: &Limb| limbs.iter().map(|b| between(a, b) / scale).collect();
        Self {
            distances: limbs.iter().map(row).collect(),
            reaches: limbs.iter().map(|it| it.reach / scale).collect(),
            fatness: limbs.iter().map(|it| it.fatness().ln()).collect(),
            minor: minor.iter().map(|it| it / scale).collect(),
            roots: limbs.iter().map(|it| it.center_at(ROOT)).collect(),
        }
    }

    /// The mean distance between one of some tips and one of others.
    fn between(&self, some: &[usize], others: &[usize]) -> f64 {
        let sum: f64 =
            some.iter().map(|&a| others.iter().map(|&b| self.distances[a][b]).sum::<f64>()).sum();
        sum / (some.len() * others.len()) as f64
    }

    fn fit(&self, Roles { head, arms, legs, tail }: Roles) -> f64 {
        let d = |a: usize, b: usize| self.distances[a][b];
        let uneven = |it: usize, pair: [usize; 2]| (d(it, pair[0]) - d(it, pair[1])).abs();
        let differ = |values: &[f64], pair: [usize; 2]| (values[pair[0]] - values[pair[1]]).abs();
        let mut asymmetry = uneven(head, arms)
            + uneven(head, legs)
            + (d(arms[0], legs[0]) - d(arms[1], legs[1])).abs()
            + (d(arms[0], legs[1]) - d(arms[1], legs[0])).abs();
        for pair in [arms, legs] {
            asymmetry += differ(&self.reaches, pair) + 0.5 * differ(&self.fatness, pair);
        }
        let (arm_arm, leg_leg) = (d(arms[0], arms[1]), d(legs[0], legs[1]));
        let arm_leg = self.between(&arms, &legs);
        let (head_arm, head_leg) = (self.between(&[head], &arms), self.between(&[head], &legs));
        // Inner edges of the tree: the way that pairs of tips of different ends share.
        let torso = arm_leg - 0.5 * (arm_arm + leg_leg);
        let neck_to_legs = 0.5 * (head_leg + arm_leg - head_arm - leg_leg);
        let arm_fatness = 0.5 * (self.fatness[arms[0]] + self.fatness[arms[1]]);
        let Some(tail) = tail else {
            return torso + neck_to_legs + 0.3 * (self.fatness[head] - arm_fatness) - asymmetry;
        };
        asymmetry += uneven(tail, arms) + uneven(tail, legs);
        let (tail_arm, tail_leg) = (self.between(&[tail], &arms), self.between(&[tail], &legs));
        let tail_to_arms = 0.5 * (tail_arm + arm_leg - tail_leg - arm_arm);
        let face = (self.minor[head] - self.minor[tail]).clamp(-0.2, 0.2);
        let fatter = (self.fatness[head] - self.fatness[tail]).clamp(-1.0, 1.0);
        asymmetry += self.skew(Roles { head, arms, legs, tail: Some(tail) }, tail);
        torso + neck_to_legs + tail_to_arms + 2.0 * face + 0.2 * fatter - asymmetry
    }

    /// How far roots are from being symmetric in space, over the distance between fore and hind legs.
    ///
    /// A hind leg and a tail can be equally long and thin, but roots hardly move with the pose: those
    /// of head and tail are in the middle plane that the roots of the legs make.
    fn skew(&self, Roles { head, arms, legs, .. }: Roles, tail: usize) -> f64 {
        let root = |it: usize| self.roots[it];
        let middle = |pair: [usize; 2]| (root(pair[0]) + root(pair[1])) * 0.5;
        let (fore, hind) = (middle(arms), middle(legs));
        let span = (fore - hind).norm().max(f64::MIN_POSITIVE);
        let spine = (fore - hind) / span;
        // A stride parts the legs of a pair along the spine, too.
        let across = |pair: [usize; 2]| {
            let apart = root(pair[0]) - root(pair[1]);
            (apart - spine * apart.dot(&spine)).try_normalize(0.0)
        };
        let (Some(fore_across), Some(hind_across)) = (across(arms), across(legs)) else {
            return 2.0;
        };
        let aside = |offset: Vec3, across: Vec3| (offset.dot(&across) / span).abs().min(1.0);
        aside(root(head) - fore, fore_across)
            + aside(root(tail) - hind, hind_across)
            + (1.0 - fore_across.dot(&hind_across).abs())
    }

    fn side_margin(&self, Roles { arms, legs, .. }: Roles) -> f64 {
        let d = |a: usize, b: usize| self.distances[a][b];
        0.5 * (d(arms[0], legs[1]) + d(arms[1], legs[0])
            - d(arms[0], legs[0])
            - d(arms[1], legs[1]))
    }
}
