//! Tubes with a changing elliptic cross-section, as distance functions.

use crate::kernels::geometry::mesh::Vec3;

/// A cross-section of a loft: an ellipse whose two halves may differ, in metres.
#[derive(Debug, Clone, Copy)]
pub struct Station {
    pub centre: Vec3,
    /// The radius across the front direction, on both sides.
    pub side: f64,
    /// The radius towards the front direction.
    pub front: f64,
    /// The radius away from the front direction.
    pub back: f64,
}

impl Station {
    /// A circle.
    pub fn round(centre: Vec3, radius: f64) -> Self {
        Self { centre, side: radius, front: radius, back: radius }
    }

    /// An ellipse that is the same in front and behind.
    pub fn oval(centre: Vec3, side: f64, depth: f64) -> Self {
        Self { centre, side, front: depth, back: depth }
    }
}

/// A smooth tube through stations, closed by half ellipsoids.
#[derive(Debug, Clone)]
pub struct Loft {
    stations: Vec<Station>,
    /// Chord length from the first station to every station.
    knots: Vec<f64>,
    /// Derivatives of the centres and of the three radii at the stations.
    slopes: Vec<(Vec3, [f64; 3])>,
    front: Vec3,
    caps: [f64; 2],
    /// Nothing of the loft is farther from its chords.
    reach: f64,
    low: Vec3,
    high: Vec3,
}

/// What a loft says about a point.
#[derive(Debug, Clone, Copy)]
pub struct LoftSample {
    /// Negative inside; close to the true distance near the surface.
    pub distance: f64,
    /// The nearest place on the axis, as chord length from the first station.
    pub along: f64,
    /// The least radius of the section there.
    pub radius: f64,
}

impl Loft {
    /// Interpolates at least two stations.
    ///
    /// The axis is a cubic Hermite spline with finite differences as derivatives; radii are monotone
    /// between stations (Fritsch & Carlson 1980), so that no bulge appears that is not asked for.
    /// `front` orients the sections; `caps` are the lengths of the closing half ellipsoids.
    pub fn new(stations: Vec<Station>, front: Vec3, caps: [f64; 2]) -> Self {
        let mut knots = vec![0.0];
        for pair in stations.windows(2) {
            knots.push(knots[knots.len() - 1] + (pair[1].centre - pair[0].centre).norm());
        }
        let slopes = (0..stations.len()).map(|it| slope(&stations, &knots, it)).collect();
        let extent = |it: &Station| it.side.max(it.front).max(it.back).max(caps[0]).max(caps[1]);
        let inf = |low: Vec3, it: &Station| low.inf(&it.centre.add_scalar(-extent(it)));
        let sup = |high: Vec3, it: &Station| high.sup(&it.centre.add_scalar(extent(it)));
        let first = stations[0].centre;
        let (low, high) = (stations.iter().fold(first, inf), stations.iter().fold(first, sup));
        // The axis bends away from its chords by less than a fifth of a radius in any body plan.
        let reach = 1.2 * stations.iter().map(extent).fold(0.0, f64::max);
        Self { stations, knots, slopes, front, caps, reach, low, high }
    }

    /// The chord length of the axis up to the point of it that is nearest to `point`.
    pub fn along(&self, point: Vec3) -> f64 {
        self.sample(point).along
    }

    /// A box that holds the loft.
    pub fn bounds(&self) -> (Vec3, Vec3) {
        (self.low, self.high)
    }

    /// A lower bound of the distance that costs little.
    pub fn distance_bound(&self, point: Vec3) -> f64 {
        (self.low - point).sup(&(point - self.high)).sup(&Vec3::zeros()).norm()
    }

    /// The distance, or a lower bound of it if that is above `needed`.
    pub fn distance_within(&self, point: Vec3, needed: f64) -> f64 {
        let bound = self.distance_bound(point);
        if bound > needed {
            return bound;
        }
        let (along, squared) = self.nearest_on_chords(point);
        let bound = squared.sqrt() - self.reach;
        if bound > needed { bound } else { self.sample_from(point, along).distance }
    }

    /// The distance, to first order near the surface: `k0 (k0 - 1) / k1` with the scaled radius `k0`
    /// and the length `k1` of its gradient (Quilez, "ellipsoid").
    pub fn sample(&self, point: Vec3) -> LoftSample {
        self.sample_from(point, self.nearest_on_chords(point).0)
    }

    fn sample_from(&self, point: Vec3, start: f64) -> LoftSample {
        let along = self.nearest(point, start);
        let (centre, direction) = self.axis(along);
        let [side, front, back] = self.radii(along);
        let direction = direction.normalize();
        let facing = (self.front - direction * direction.dot(&self.front)).normalize();
        let offset = point - centre;
        let axial = offset.dot(&direction);
        let depth = offset.dot(&facing);
        let across = (offset - direction * axial - facing * depth).norm();
        let depth_radius = if depth > 0.0 { front } else { back };
        let end = self.knots[self.knots.len() - 1];
        let cap = match () {
            () if along <= 0.0 && axial < 0.0 => self.caps[0],
            () if along >= end && axial > 0.0 => self.caps[1],
            () => f64::INFINITY,
        };
        let scaled = Vec3::new(across / side, depth / depth_radius, axial / cap);
        let steep = Vec3::new(scaled.x / side, scaled.y / depth_radius, scaled.z / cap).norm();
        let relative = scaled.norm();
        let distance = if relative < 1e-6 {
            -side.min(depth_radius)
        } else {
            relative * (relative - 1.0) / steep
        };
        LoftSample { distance, along, radius: side.min(front).min(back) }
    }

    /// The chord length up to the nearest point of the chords, and its squared distance.
    fn nearest_on_chords(&self, point: Vec3) -> (f64, f64) {
        let (mut along, mut best) = (0.0, f64::INFINITY);
        for (span, pair) in self.stations.windows(2).enumerate() {
            let width = self.knots[span + 1] - self.knots[span];
            let chord = pair[1].centre - pair[0].centre;
            let offset = point - pair[0].centre;
            let fraction = (offset.dot(&chord) / (width * width)).clamp(0.0, 1.0);
            let distance = (offset - chord * fraction).norm_squared();
            if distance < best {
                best = distance;
                along = self.knots[span] + fraction * width;
            }
        }
        (along, best)
    }

    /// Gauss-Newton on the squared distance to the axis.
    fn nearest(&self, point: Vec3, start: f64) -> f64 {
        let end = self.knots[self.knots.len() - 1];
        let mut along = start;
        for _ in 0..2 {
            let (centre, direction) = self.axis(along);
            let step = (point - centre).dot(&direction) / direction.norm_squared();
            along = (along + step).clamp(0.0, end);
        }
        along
    }

    /// The span that holds a chord length, its width, and the place in it from 0 to 1.
    fn span(&self, along: f64) -> (usize, f64, f64) {
        let last_span = self.knots.len() - 2;
        let span = self.knots[1..=last_span].iter().take_while(|&&it| it <= along).count();
        let width = self.knots[span + 1] - self.knots[span];
        (span, width, (along - self.knots[span]) / width)
    }

    /// The axis and its derivative at a chord length.
    fn axis(&self, along: f64) -> (Vec3, Vec3) {
        let (span, width, u) = self.span(along);
        let (a, b) = (self.stations[span].centre, self.stations[span + 1].centre);
        let (a_slope, b_slope) = (self.slopes[span].0, self.slopes[span + 1].0);
        let [h00, h10, h01, h11] = hermite(u, width);
        let centre = h00 * a + h10 * a_slope + h01 * b + h11 * b_slope;
        let direction = (6.0 * u * (1.0 - u) / width) * (b - a)
            + (1.0 - u) * (1.0 - 3.0 * u) * a_slope
            + u * (3.0 * u - 2.0) * b_slope;
        (centre, direction)
    }

    /// The three radii at a chord length.
    fn radii(&self, along: f64) -> [f64; 3] {
        let (span, width, u) = self.span(along);
        let (from, to) = (radii(&self.stations[span]), radii(&self.stations[span + 1]));
        let (a_slope, b_slope) = (self.slopes[span].1, self.slopes[span + 1].1);
        let [h00, h10, h01, h11] = hermite(u, width);
        std::array::from_fn(|k| h00 * from[k] + h10 * a_slope[k] + h01 * to[k] + h11 * b_slope[k])
    }
}

/// The cubic Hermite basis of values and slopes at both ends of a span.
fn hermite(u: f64, width: f64) -> [f64; 4] {
    [
        (1.0 + 2.0 * u) * (1.0 - u) * (1.0 - u),
        u * (1.0 - u) * (1.0 - u) * width,
        u * u * (3.0 - 2.0 * u),
        u * u * (u - 1.0) * width,
    ]
}

fn radii(station: &Station) -> [f64; 3] {
    [station.side, station.front, station.back]
}

/// Derivatives at a station. Radii are stationary at both ends, where the caps begin.
fn slope(stations: &[Station], knots: &[f64], at: usize) -> (Vec3, [f64; 3]) {
    let secant = |span: usize| {
        let width = knots[span + 1] - knots[span];
        let (a, b) = (&stations[span], &stations[span + 1]);
        let (from, to) = (radii(a), radii(b));
        let radii: [f64; 3] = std::array::from_fn(|k| (to[k] - from[k]) / width);
        (width, (b.centre - a.centre) / width, radii)
    };
    if at == 0 {
        return (secant(0).1, [0.0; 3]);
    }
    if at + 1 == stations.len() {
        return (secant(at - 1).1, [0.0; 3]);
    }
    let ((before, axis_before, radii_before), (after, axis_after, radii_after)) =
        (secant(at - 1), secant(at));
    let axis = (axis_before * after + axis_after * before) / (before + after);
    let radii = std::array::from_fn(|k| {
        let (left, right) = (radii_before[k], radii_after[k]);
        // The harmonic mean, weighted as by Fritsch & Butland (1984).
        let (one, two) = (2.0 * after + before, after + 2.0 * before);
        if left * right <= 0.0 { 0.0 } else { (one + two) / (one / left + two / right) }
    });
    (axis, radii)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_loft_of_equal_circles_is_a_capsule() {
        let ends = [Vec3::zeros(), Vec3::y() * 2.0];
        let stations = ends.map(|it| Station::round(it, 0.5)).to_vec();
        let loft = Loft::new(stations, Vec3::z(), [0.5, 0.5]);
        let check = |x: f64, y: f64, z: f64, distance: f64, along: f64| {
            let sample = loft.sample(Vec3::new(x, y, z));
            assert!((sample.distance - distance).abs() < 1e-12, "{sample:?}");
            assert!((sample.along - along).abs() < 1e-12, "{sample:?}");
        };
        check(0.8, 1.2, 0.0, 0.3, 1.2);
        check(0.0, 0.3, -0.1, -0.4, 0.3);
        check(0.0, 3.0, 0.0, 0.5, 2.0);
        check(0.3, -0.4, 0.0, 0.0, 0.0);
    }

    #[test]
    fn sections_are_interpolated_without_overshoot() {
        let stations = vec![
            Station { centre: Vec3::zeros(), side: 1.0, front: 0.5, back: 0.2 },
            Station { centre: Vec3::y(), side: 1.0, front: 0.5, back: 0.2 },
            Station { centre: Vec3::y() * 2.0, side: 2.0, front: 0.5, back: 0.2 },
        ];
        let loft = Loft::new(stations, Vec3::z(), [0.1, 0.1]);
        let distance = |x: f64, y: f64, z: f64| loft.sample(Vec3::new(x, y, z)).distance;
        assert!(distance(1.0, 0.5, 0.0).abs() < 1e-12, "no dip before the wide station");
        assert!(distance(0.0, 1.7, 0.5).abs() < 1e-12);
        assert!(distance(0.0, 1.7, -0.2).abs() < 1e-12);
        assert!(distance(0.0, 2.1, 0.0).abs() < 1e-12);
    }
}
