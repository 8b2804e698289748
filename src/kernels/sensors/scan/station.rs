//! What one station measures.

use std::f64::consts::TAU;

use nalgebra::{Isometry3, Translation3, Unit, UnitQuaternion};

use super::ScanOptions;
use crate::kernels::geometry::mesh::{TriMesh, Vec3};
use crate::kernels::geometry::triangle::closest_on_triangle;
use crate::kernels::numerics::random::Random;
use crate::kernels::sensors::depth::portrait::Portrait;
use crate::kernels::sensors::depth::raster::NO_FACE;

/// A measured point.
#[derive(Debug, Clone, Copy)]
pub struct Shot {
    /// On the surface.
    pub place: Vec3,
    /// With noise along the ray.
    pub measured: Vec3,
    /// The corners of its face and their shares in its place.
    pub corners: [u32; 3],
    pub shares: [f64; 3],
}

/// The direction to a station: evenly around the axis, off by up to a quarter of the way to the next.
pub fn stand(index: usize, options: &ScanOptions, random: &mut Random) -> Unit<Vec3> {
    let step = TAU / options.n_stations as f64;
    let azimuth = step * (index as f64 + random.between(-0.25, 0.25));
    let elevation = options.elevation_deg.to_radians() * random.between(-1.0, 1.0);
    let (sin, cos) = elevation.sin_cos();
    Unit::new_normalize(Vec3::new(cos * azimuth.sin(), sin, cos * azimuth.cos()))
}

/// A small motion about the middle of the shape.
pub fn registration_error(
    middle: &Vec3,
    diagonal: f64,
    options: &ScanOptions,
    random: &mut Random,
) -> Isometry3<f64> {
    let mut vector = |deviation: f64| Vec3::from_fn(|_, _| deviation * random.normal());
    let turn = UnitQuaternion::from_scaled_axis(vector(options.turn_deg.to_radians()));
    let shift = vector(options.shift * diagonal);
    Isometry3::from_parts(Translation3::from(middle - turn * middle + shift), turn)
}

/// The points that a station measures, in the order of its pixels.
pub fn shoot(
    mesh: &TriMesh,
    direction: Unit<Vec3>,
    diagonal: f64,
    options: &ScanOptions,
    random: &mut Random,
) -> Vec<Shot> {
    let portrait = Portrait::new(mesh, direction, options.distance, options.resolution);
    let least_cosine = options.grazing_deg.to_radians().sin();
    let mut shots: Vec<Shot> = Vec::new();
    for (pixel, &face) in portrait.buffer.faces.iter().enumerate() {
        if face == NO_FACE {
            continue;
        }
        // Both numbers are drawn for every pixel, so that one option does not reseed another.
        let (chance, normal) = (random.uniform(), random.normal());
        let [column, row] = [pixel % options.resolution, pixel / options.resolution];
        let camera = &portrait.camera;
        let ray = Vec3::new(
            (column as f64 - camera.cx) / camera.fx,
            (row as f64 - camera.cy) / camera.fy,
            1.0,
        );
        let seen = portrait.to_world(&(ray * portrait.depth([column, row])));
        let toward = (portrait.to_world(&Vec3::zeros()) - seen).normalize();
        let across = mesh.area_vector(face as usize).normalize();
        // Both sides of an open surface are seen.
        if chance < options.dropped || across.dot(&toward).abs() < least_cosine {
            continue;
        }
        let corners = mesh.faces()[face as usize];
        let triangle = mesh.corners(face as usize);
        // Depths have the precision of a picture's; the face has all digits.
        let shares = closest_on_triangle(&seen, &triangle);
        let place = triangle[0] * shares[0] + triangle[1] * shares[1] + triangle[2] * shares[2];
        let measured = place + toward * (options.noise * diagonal * normal);
        shots.push(Shot { place, measured, corners, shares });
    }
    thin_out(shots, options.points_per_station, random)
}

/// So many of them at most, in their old order.
fn thin_out(shots: Vec<Shot>, most: usize, random: &mut Random) -> Vec<Shot> {
    if shots.len() <= most {
        return shots;
    }
    let mut order: Vec<usize> = (0..shots.len()).collect();
    random.shuffle(&mut order);
    order.truncate(most);
    order.sort_unstable();
    order.into_iter().map(|it| shots[it]).collect()
}
