//! A limb: a protrusion with the line through its middle.

use super::protrusions::Protrusion;
use super::surface::Surface;
use crate::kernels::geometry::mesh::Vec3;

/// The number of bands that a limb is cut into, from tip to root.
const N_BANDS: usize = 24;

/// A protrusion, measured by the distance along the surface from its tip.
#[derive(Debug, Clone)]
pub struct Limb {
    pub tip: usize,
    /// Vertices of the protrusion.
    pub members: Vec<u32>,
    /// Distances of all vertices of the surface from the tip.
    pub distances: Vec<f64>,
    /// Up to this distance from the tip there is only the limb.
    pub reach: f64,
    /// The area within reach.
    pub area: f64,
    /// Centres of the bands within reach.
    line: Vec<Vec3>,
}

impl Limb {
    pub fn of(surface: &Surface, protrusion: &Protrusion) -> Self {
        let distances = surface.distances_from(protrusion.tip);
        let mut is_member = vec![false; surface.len()];
        protrusion.members.iter().for_each(|&it| is_member[it as usize] = true);
        let outside = (0..surface.len()).filter(|&it| !is_member[it]);
        let reach = outside.map(|it| distances[it]).fold(f64::INFINITY, f64::min);
        let mut limb = Self {
            tip: protrusion.tip,
            members: protrusion.members.clone(),
            distances,
            reach,
            area: 0.0,
            line: Vec::new(),
        };
        limb.area = limb.within(0.0, 1.0).map(|it| surface.areas[it]).sum();
        limb.line = (0..N_BANDS).map(|it| limb.band_center(surface, it)).collect();
        limb
    }

    /// The members from one part of the reach (0: tip, 1: root) to another.
    pub fn within(&self, from: f64, to: f64) -> impl Iterator<Item = usize> + '_ {
        let (from, to) = (from * self.reach, to * self.reach);
        self.members
            .iter()
            .map(|&it| it as usize)
            .filter(move |&it| self.distances[it] >= from && self.distances[it] <= to)
    }

    /// The middle of the limb at a part of its reach.
    pub fn center_at(&self, part: f64) -> Vec3 {
        let place = (part * N_BANDS as f64 - 0.5).clamp(0.0, (N_BANDS - 1) as f64);
        let below = (place.floor() as usize).min(N_BANDS - 2);
        self.line[below].lerp(&self.line[below + 1], place - below as f64)
    }

    /// From one part of the reach to another, a unit vector.
    pub fn direction(&self, from: f64, to: f64) -> Option<Vec3> {
        (self.center_at(to) - self.center_at(from)).try_normalize(0.0)
    }

    /// How compact the limb is: its area over its squared length.
    pub fn fatness(&self) -> f64 {
        self.area / (self.reach * self.reach)
    }

    /// A band's centre by area; bands without vertices widen until they have some.
    fn band_center(&self, surface: &Surface, band: usize) -> Vec3 {
        let middle = (band as f64 + 0.5) / N_BANDS as f64;
        for half_widths in 1..=N_BANDS {
            let half = 0.5 * half_widths as f64 / N_BANDS as f64;
            let (area, center) = surface.area_and_center(self.within(middle - half, middle + half));
            if area > 0.0 {
                return center;
            }
        }
        surface.positions[self.tip]
    }
}
