//! How good a curve skeleton is.

use rayon::prelude::*;

use super::curve_skeleton::CurveSkeleton;
use crate::kernels::geometry::distance_field::DistanceField;
use crate::kernels::geometry::mesh::{TriMesh, Vec3};
use crate::kernels::rigs::skeleton::Skeleton;

/// How well a curve skeleton lies in a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fit {
    /// The share of the length of all curves that is inside.
    pub inside: f64,
    /// How far the worst place is outside, in the unit of the surface.
    pub outside: f64,
    /// The mean distance from places on curves to the middle of the surface around them, across the
    /// curve, over the mean distance of the surface: 0 on the axis, about 1 on the surface. NaN if no
    /// place has the surface all around it.
    pub off_center: f64,
}

/// How near a curve skeleton is to true bones, in percent of a height.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigDistance {
    /// Mean distance from the joints to the nearest place on a curve.
    pub joints_to_curves: f64,
    /// Mean distance from places on curves to the nearest bone.
    pub curves_to_bones: f64,
}

/// Places along every edge of a skeleton: at most a hundredth of the longest side of its box apart.
const STEPS: f64 = 100.0;

/// Rays across a curve.
const RAYS: usize = 16;

/// How far a ray looks, in distances to the nearest surface: across the trunk from a place in an arm's
/// root there is no middle to be found.
const REACH: f64 = 8.0;

/// Measures how a skeleton lies in the surface it was found for; the surface should be closed.
///
/// Places are spread evenly along the edges. The middle around a place is the mean of where rays
/// across its edge first meet the surface; places that some ray leaves without a hit near enough do
/// not count for it.
///
/// # Panics
/// If the mesh has no faces.
pub fn fit_of(skeleton: &CurveSkeleton, mesh: &TriMesh) -> Fit {
    let field = DistanceField::new(mesh);
    let places = places_on(skeleton);
    let seen: Vec<(f64, Option<f64>)> = places
        .par_iter()
        .map(|it| {
            let distance = field.distance(it.position);
            (distance, if distance < 0.0 { off_center(&field, it, -distance) } else { None })
        })
        .collect();
    let n_inside = seen.iter().filter(|it| it.0 < 0.0).count();
    let centered: Vec<f64> = seen.iter().filter_map(|it| it.1).collect();
    Fit {
        inside: n_inside as f64 / seen.len() as f64,
        outside: seen.iter().map(|it| it.0).fold(0.0, f64::max),
        off_center: centered.iter().sum::<f64>() / centered.len() as f64,
    }
}

/// A place on a curve, and where the curve leads; zero at a node without edges.
#[derive(Debug, Clone, Copy)]
struct Place {
    position: Vec3,
    direction: Vec3,
}

fn places_on(skeleton: &CurveSkeleton) -> Vec<Place> {
    let positions = skeleton.positions();
    let first = positions.first().copied().unwrap_or_default();
    let (low, high) = positions.iter().fold((first, first), |it, p| (it.0.inf(p), it.1.sup(p)));
    let step = (high - low).max() / STEPS;
    let degrees = skeleton.degrees();
    let lonely = (0..positions.len()).filter(|&it| degrees[it] == 0);
    let mut places: Vec<Place> =
        lonely.map(|it| Place { position: positions[it], direction: Vec3::zeros() }).collect();
    for &edge in skeleton.edges() {
        let [from, to] = edge.map(|it| positions[it as usize]);
        let n_places = ((to - from).norm() / step.max(f64::MIN_POSITIVE)).ceil().max(1.0) as usize;
        places.extend((0..n_places).map(|it| Place {
            position: from + (to - from) * ((it as f64 + 0.5) / n_places as f64),
            direction: to - from,
        }));
    }
    places
}

fn off_center(field: &DistanceField, place: &Place, depth: f64) -> Option<f64> {
    let along = place.direction.try_normalize(0.0)?;
    let side = along.cross(&Vec3::ith(along.iamin(), 1.0)).normalize();
    let other = along.cross(&side);
    let (mut middle, mut radius) = (Vec3::zeros(), 0.0);
    for ray in 0..RAYS {
        let (sin, cos) = (std::f64::consts::TAU * ray as f64 / RAYS as f64).sin_cos();
        let direction = side * cos + other * sin;
        let hit = field.tree().first_hit(place.position, direction, [0.0, REACH * depth])?;
        middle += direction * hit.along / RAYS as f64;
        radius += hit.along / RAYS as f64;
    }
    // Where rays leave a circle is, in the mean, half as far off the place as the circle's middle.
    Some(2.0 * middle.norm() / radius)
}

/// Measures how near a skeleton is to true bones; NaN where there is nothing to measure.
pub fn rig_distance(skeleton: &CurveSkeleton, truth: &Skeleton, height: f64) -> RigDistance {
    let curves: Vec<[Vec3; 2]> = segments(skeleton);
    let at = |it: usize| truth.positions()[it];
    let bones: Vec<[Vec3; 2]> = truth.bones().map(|(from, to)| [at(from), at(to)]).collect();
    let percent = |sum: f64, count: usize| 100.0 * sum / count as f64 / height;
    let joints = truth.positions();
    let places = places_on(skeleton);
    let to_curves: f64 = joints.iter().map(|it| distance_to(it, &curves)).sum();
    let to_bones: f64 = places.iter().map(|it| distance_to(&it.position, &bones)).sum();
    RigDistance {
        joints_to_curves: percent(to_curves, joints.len()),
        curves_to_bones: percent(to_bones, places.len()),
    }
}

/// The edges, and nodes without edges.
fn segments(skeleton: &CurveSkeleton) -> Vec<[Vec3; 2]> {
    let positions = skeleton.positions();
    let edges = skeleton.edges().iter().map(|it| it.map(|node| positions[node as usize]));
    let degrees = skeleton.degrees();
    let lonely = (0..positions.len()).filter(|&it| degrees[it] == 0);
    edges.chain(lonely.map(|it| [positions[it]; 2])).collect()
}

fn distance_to(place: &Vec3, segments: &[[Vec3; 2]]) -> f64 {
    let distance = |[from, to]: &[Vec3; 2]| {
        let along = to - from;
        let share = (place - from).dot(&along) / along.norm_squared().max(f64::MIN_POSITIVE);
        (from + along * share.clamp(0.0, 1.0) - place).norm()
    };
    segments.iter().map(distance).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes::icosphere;

    /// A long ball along x: radius 0.5 across, 4 long.
    fn cigar() -> TriMesh {
        let sphere = icosphere(4);
        let stretch = |it: &Vec3| Vec3::new(4.0 * it.x, 0.5 * it.y, 0.5 * it.z);
        sphere.with_vertices(sphere.vertices().iter().map(stretch).collect()).unwrap()
    }

    fn line(height: f64, half: f64) -> CurveSkeleton {
        let ends = vec![Vec3::new(-half, height, 0.0), Vec3::new(half, height, 0.0)];
        CurveSkeleton::new(ends, vec![0.0; 2], vec![[0, 1]], vec![]).unwrap()
    }

    #[test]
    fn the_axis_is_in_the_middle() {
        let fit = fit_of(&line(0.0, 2.0), &cigar());
        assert!(fit.inside == 1.0 && fit.outside == 0.0 && fit.off_center < 0.01, "{fit:?}");
        // A fifth of the radius off, where it is largest.
        let fit = fit_of(&line(0.1, 0.4), &cigar());
        assert!((fit.off_center - 0.1 / 0.5).abs() < 0.02, "{fit:?}");
    }

    #[test]
    fn what_sticks_out_is_seen() {
        let fit = fit_of(&line(0.0, 5.0), &cigar());
        assert!((fit.inside - 0.8).abs() < 0.02, "{fit:?}");
        assert!((fit.outside - 1.0).abs() < 0.1, "{fit:?}");
    }

    #[test]
    fn distances_from_a_rig_are_percent_of_the_height() {
        let names = ["a", "b", "c"].map(str::to_owned).to_vec();
        let places = vec![Vec3::zeros(), Vec3::x(), Vec3::new(1.0, 0.5, 0.0)];
        let truth = Skeleton::new(names, vec![None, Some(0), Some(1)], places).unwrap();
        let found = rig_distance(&line(-0.1, 1.0), &truth, 2.0);
        assert!((found.joints_to_curves - 100.0 * (0.1 + 0.1 + 0.6) / 3.0 / 2.0).abs() < 1e-9);
        // Half of the line is beside the bone, the other up to one beyond its end.
        assert!(found.curves_to_bones > 100.0 * 0.1 / 2.0);
    }
}
