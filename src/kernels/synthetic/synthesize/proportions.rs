//! How one individual differs from the nominal body.

use crate::kernels::numerics::random::Random;

/// Factors on the measures of a body plan; 1 is the nominal body.
#[derive(Debug, Clone, PartialEq)]
pub struct Proportions {
    pub height: f64,
    pub girth: f64,
    pub limb_girth: f64,
    pub torso: f64,
    pub arms: f64,
    pub legs: f64,
    pub head: f64,
    pub shoulders: f64,
    pub hips: f64,
    pub waist: f64,
    pub feet: f64,
    /// From 0 (flat) to 1.
    pub bust: f64,
    /// From -1 (slender) to 1 (muscular).
    pub muscle: f64,
    /// For quadrupeds: from 0 (dog) to 1 (horse).
    pub hoofed: f64,
    pub neck: f64,
    pub muzzle: f64,
    pub ears: f64,
    pub tail: f64,
}

impl Proportions {
    /// Draws an individual; `variation` of 0 gives the nominal body for every seed, 1 the full spread.
    pub fn draw(seed: u64, variation: f64) -> Self {
        let mut random = Random::stream(seed, "proportions");
        let mut around = |middle: f64, spread: f64| {
            // The mean of two uniform numbers: bounded, and extremes are rare.
            let unit = random.uniform() + random.uniform() - 1.0;
            middle + variation * spread * unit
        };
        Self {
            height: around(1.0, 0.20),
            girth: around(1.0, 0.22),
            limb_girth: around(1.0, 0.18),
            torso: around(1.0, 0.08),
            arms: around(1.0, 0.12),
            legs: around(1.0, 0.14),
            head: around(1.0, 0.16),
            shoulders: around(1.0, 0.15),
            hips: around(1.0, 0.16),
            waist: around(1.0, 0.24),
            feet: around(1.0, 0.14),
            bust: around(0.5, 0.5),
            muscle: around(0.0, 1.0),
            hoofed: around(0.6, 0.4),
            neck: around(1.0, 0.28),
            muzzle: around(1.0, 0.28),
            ears: around(1.0, 0.35),
            tail: around(1.0, 0.30),
        }
    }
}
