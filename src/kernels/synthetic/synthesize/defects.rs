//! What scanners do to surfaces: noise and holes.

use super::{Character, SynthesizeError, SynthesizeOptions};
use crate::kernels::{
    numerics::random::Random,
    remeshing::resampled::Resampled,
    synthetic::degrade::{cut_holes, displaced},
};

/// The radius of a hole over the square root of the area.
const HOLE_RADIUS: f64 = 0.035;

/// Displaces vertices and cuts holes as the options ask for.
pub fn apply(
    character: Character,
    options: &SynthesizeOptions,
) -> Result<Character, SynthesizeError> {
    let mut random = Random::stream(options.seed, "defects");
    let mut res = character;
    if options.noise > 0.0 {
        res.mesh = displaced(&res.mesh, options.noise, &mut random);
    }
    if options.n_holes > 0 {
        res = with_holes(res, options.n_holes, &mut random)?;
    }
    Ok(res)
}

fn with_holes(
    character: Character,
    asked: usize,
    random: &mut Random,
) -> Result<Character, SynthesizeError> {
    let Character { mesh, skeleton, weights, landmarks, clip } = character;
    let radius = HOLE_RADIUS * mesh.area().sqrt();
    let (faces, possible) = cut_holes(&mesh, &landmarks.vertices, asked, radius, random);
    if possible < asked {
        return Err(SynthesizeError::Holes { asked, possible });
    }
    let left = Resampled::of_faces(&mesh, &faces).expect("holes leave faces");
    let weights = left.weights(&weights).expect("weights of this mesh");
    let landmarks = left.landmarks(&landmarks).expect("holes keep away from landmarks");
    Ok(Character { mesh: left.mesh, skeleton, weights, landmarks, clip })
}
