//! Balls that touch a surface from inside at several places.

use rayon::prelude::*;

use super::distance_field::DistanceField;
use super::mesh::{TriMesh, Vec3};

/// A ball inside a body that touches its surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ball {
    pub center: Vec3,
    /// The distance of the centre from the surface.
    pub radius: f64,
}

/// Which balls are wanted; lengths in the unit of the surface.
#[derive(Debug, Clone, Copy)]
pub struct MedialOptions {
    /// The distance between starting points on the surface.
    pub spacing: f64,
    pub least_radius: f64,
    /// The greatest cosine of the angle between two places of touch, as seen from the centre.
    pub greatest_cosine: f64,
}

/// The largest side of a body's box where its balls are looked for with [`MedialOptions::for_body`].
pub const BODY_SIZE: f64 = 0.9;

impl MedialOptions {
    /// What is wanted of a body that is [`BODY_SIZE`] large: balls that touch it at places at least an
    /// angle apart.
    pub fn for_body(least_angle_deg: f64) -> Self {
        let greatest_cosine = least_angle_deg.to_radians().cos();
        Self { spacing: 0.006, least_radius: 0.006, greatest_cosine }
    }
}

/// Starting points are spread more widely than wanted if they would be more than this.
const MAX_STARTS: f64 = 200_000.0;

/// Finds maximal balls inside a closed outward surface: samples of its medial axis.
///
/// From points spread evenly over the surface, a ball that touches there is shrunk until nothing of
/// the surface is inside of it (Ma, Bae & Choi 2012). Distances are exact, so centres lie on the
/// medial axis itself; the order is that of the starting points.
pub fn medial_balls(field: &DistanceField, mesh: &TriMesh, options: &MedialOptions) -> Vec<Ball> {
    let starts = starts(mesh, options.spacing);
    starts
        .into_par_iter()
        .filter_map(|(place, inward)| shrink(field, place, inward, options))
        .collect()
}

/// Points of the surface with their inward unit normals: as many on every face as its area wants,
/// within a face by a sequence that fills it evenly (Roberts 2018).
fn starts(mesh: &TriMesh, spacing: f64) -> Vec<(Vec3, Vec3)> {
    let area = mesh.area();
    let count = (area / (spacing * spacing)).clamp(1.0, MAX_STARTS).floor();
    let each = area / count;
    let mut starts = Vec::with_capacity(count as usize);
    let mut owed = 0.5;
    for face in 0..mesh.n_faces() {
        let area_vector = mesh.area_vector(face);
        owed += area_vector.norm() / each;
        let Some(normal) = area_vector.try_normalize(0.0) else { continue };
        let [a, b, c] = mesh.corners(face);
        while owed >= 1.0 {
            owed -= 1.0;
            let index = starts.len() as f64;
            let mut u = (0.5 + 0.754_877_666_246_692_7 * index).fract();
            let mut v = (0.5 + 0.569_840_290_998_053_2 * index).fract();
            if u + v > 1.0 {
                (u, v) = (1.0 - u, 1.0 - v);
            }
            starts.push((a + (b - a) * u + (c - a) * v, -normal));
        }
    }
    starts
}

/// The ball that touches the surface at a place and somewhere else.
fn shrink(
    field: &DistanceField,
    place: Vec3,
    inward: Vec3,
    options: &MedialOptions,
) -> Option<Ball> {
    let tree = field.tree();
    // The far side, where a ball would have to touch if nothing was in between.
    let hit = tree.first_hit(place, inward, [0.1 * options.least_radius, f64::INFINITY])?;
    let mut radius = hit.along / 2.0;
    let mut touch = place + inward * hit.along;
    loop {
        if radius < options.least_radius {
            return None;
        }
        let center = place + inward * radius;
        let bound = radius * (1.0 - 1e-6);
        let Some(nearest) = tree.nearest_within(center, bound * bound) else { break };
        let offset = nearest.point - place;
        let smaller = offset.norm_squared() / (2.0 * offset.dot(&inward));
        // Rounding near the place of the start itself.
        if !(smaller > 0.0 && smaller < radius * (1.0 - 1e-9)) {
            break;
        }
        radius = smaller;
        touch = nearest.point;
    }
    let ball = Ball { center: place + inward * radius, radius };
    let is_wanted = touches_widely(field, &ball, vec![place, touch], options.greatest_cosine)
        && field.is_inside(ball.center);
    is_wanted.then_some(ball)
}

/// How far beyond its radius a ball counts as touching, where bodies are 0.9 large.
const TOUCH: f64 = 0.003;

/// Whether two of the places where a ball touches the surface are seen from its centre under an angle
/// of this cosine, or a greater angle.
///
/// A ball in a round limb touches all around, but is stopped by one place beside its start: further
/// ones are looked for away from those that are known.
fn touches_widely(
    field: &DistanceField,
    ball: &Ball,
    mut touches: Vec<Vec3>,
    greatest_cosine: f64,
) -> bool {
    for _ in 0..3 {
        let directions: Vec<Vec3> =
            touches.iter().filter_map(|it| (it - ball.center).try_normalize(0.0)).collect();
        if least_dot(&directions) <= greatest_cosine {
            return true;
        }
        let Some(known) = directions.iter().sum::<Vec3>().try_normalize(0.0) else { return false };
        touches.push(field.nearest(ball.center - known * (TOUCH / 2.0)).point);
    }
    false
}

fn least_dot(directions: &[Vec3]) -> f64 {
    let pairs = directions
        .iter()
        .enumerate()
        .flat_map(|(index, a)| directions[..index].iter().map(move |b| a.dot(b)));
    pairs.fold(1.0, f64::min)
}

/// Keeps the largest ball, then the largest whose centre lies in none that is kept, and so on.
pub fn pack(balls: &[Ball], max_balls: usize) -> Vec<Ball> {
    let mut order: Vec<&Ball> = balls.iter().collect();
    // Stable: of equal balls the first stays first.
    order.sort_by(|a, b| b.radius.total_cmp(&a.radius));
    let mut kept: Vec<Ball> = Vec::new();
    for ball in order {
        let is_covered =
            |it: &Ball| (it.center - ball.center).norm_squared() < it.radius * it.radius;
        if kept.len() < max_balls && !kept.iter().any(is_covered) {
            kept.push(*ball);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes::torus;

    fn balls() -> Vec<Ball> {
        let mesh = torus(0.3, 0.1, 100, 50);
        let options = MedialOptions { spacing: 0.01, least_radius: 0.006, greatest_cosine: 0.0 };
        medial_balls(&DistanceField::new(&mesh), &mesh, &options)
    }

    #[test]
    fn balls_of_a_torus_lie_on_its_circle() {
        let balls = balls();
        assert!(balls.len() > 100, "{}", balls.len());
        for it in &balls {
            let from_circle = (it.center.x.hypot(it.center.z) - 0.3).hypot(it.center.y);
            assert!(from_circle < 0.005 && (it.radius - 0.1).abs() < 0.005, "{it:?}");
        }
    }

    #[test]
    fn kept_balls_cover_all_centres_and_none_covers_another() {
        let balls = balls();
        let kept = pack(&balls, 1000);
        for it in &balls {
            assert!(kept.iter().any(|ball| (ball.center - it.center).norm() <= ball.radius));
        }
        for (index, it) in kept.iter().enumerate() {
            let mut before = kept[..index].iter();
            assert!(before.all(|ball| (ball.center - it.center).norm() >= ball.radius));
        }
        assert_eq!(pack(&balls, 3).len(), 3);
    }
}
