//! Rigged bipeds and quadrupeds from a seed.
//!
//! A body plan gives joints and an implicit surface: lofts (tubes with a changing elliptic section)
//! that blend where they belong together. Its zero set is polygonized and remeshed, skinned by the
//! lofts that form it, posed by linear blend skinning, and given a walk cycle.

mod biped;
mod defects;
mod gait;
mod loft;
mod meshing;
mod plan;
mod pose;
mod proportions;
mod quadruped;
mod skin;
mod surface;
#[cfg(test)]
mod tests;
mod walk;

use nalgebra::UnitQuaternion;

pub use self::{meshing::Connectivity, walk::N_FRAMES};
use self::{plan::Plan, pose::Pose, proportions::Proportions};
use crate::kernels::{
    geometry::{
        landmarks::Landmarks,
        mesh::{TriMesh, Vec3},
    },
    rigs::{clip::Clip, skeleton::Skeleton, skinning, weights::SkinWeights},
};

/// Which body plan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Body {
    /// 22 joints, 1.75 m tall, in A-pose.
    Biped,
    /// 32 joints, 1.3 m at the withers, standing.
    Quadruped,
}

/// The pose in which a character is delivered.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Stance {
    /// As modelled.
    Rest,
    /// Arms straight out; a quadruped stays at rest.
    T,
    /// A phase of the walk cycle, from 0 to 1.
    Walk(f64),
    /// Random turns of all joints, scaled by a factor.
    Random(f64),
}

/// What [`synthesize`] makes.
#[derive(Debug, Clone)]
pub struct SynthesizeOptions {
    pub body: Body,
    /// 1,000 to 250,000.
    pub n_vertices: usize,
    /// Decides on the individual, the pose, the connectivity and the order of vertices.
    pub seed: u64,
    /// How much individuals differ, from 0 to 1.
    pub variation: f64,
    /// Factors on what the seed gives.
    pub height: f64,
    pub girth: f64,
    pub limb_length: f64,
    pub head_size: f64,
    pub stance: Stance,
    pub connectivity: Connectivity,
    /// The deviation of random displacements along normals, over the mean edge length.
    pub noise: f64,
    /// How many holes are cut into the surface.
    pub n_holes: usize,
}

impl Default for SynthesizeOptions {
    fn default() -> Self {
        Self {
            body: Body::Biped,
            n_vertices: 5_000,
            seed: 0,
            variation: 1.0,
            height: 1.0,
            girth: 1.0,
            limb_length: 1.0,
            head_size: 1.0,
            stance: Stance::Rest,
            connectivity: Connectivity::Isotropic,
            noise: 0.0,
            n_holes: 0,
        }
    }
}

/// A rigged character with everything that is known about it.
#[derive(Debug, Clone, PartialEq)]
pub struct Character {
    pub mesh: TriMesh,
    /// The true joints in the mesh's pose.
    pub skeleton: Skeleton,
    pub weights: SkinWeights,
    pub landmarks: Landmarks,
    /// The walk, for the mesh in its pose.
    pub clip: Clip,
}

/// Why there is no such character.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SynthesizeError {
    #[error("{n_vertices} vertices were asked for, but 1000 to 250000 are possible")]
    VertexCount { n_vertices: usize },
    #[error(
        "these proportions make no single closed surface: {n_components} parts with the Euler \
         characteristic {euler} in all"
    )]
    Topology { n_components: usize, euler: i64 },
    #[error("{asked} holes were asked for, but the surface has room for {possible}")]
    Holes { asked: usize, possible: usize },
}

/// Makes a rigged character: Y up, facing +Z, its left along +X, metres, feet on `y = 0`.
///
/// Without noise and holes the surface is closed, manifold, of genus 0 and in one piece; at rest it
/// is symmetric about `x = 0` while its connectivity is not. Vertices are in random order. Same
/// options, same bytes, at any number of threads.
///
/// # Errors
/// See [`SynthesizeError`].
pub fn synthesize(options: &SynthesizeOptions) -> Result<Character, SynthesizeError> {
    let plan = plan(options);
    let mesh = meshing::mesh(&plan.surface, options)?;
    let weights = skin::skin_weights(&plan.surface, plan.skeleton.n_joints(), mesh.vertices());
    let landmarks = landmarks(&plan, &mesh);
    let walk = walk::walk(&plan.skeleton);
    let mut pose = match options.stance {
        Stance::Rest => Pose::rest(&plan.skeleton),
        Stance::T if options.body == Body::Biped => pose::t_pose(&plan.skeleton),
        Stance::T => Pose::rest(&plan.skeleton),
        Stance::Walk(phase) => match options.body {
            Body::Biped => walk::biped_pose(&plan.skeleton, phase),
            Body::Quadruped => walk::quadruped_pose(&plan.skeleton, phase),
        },
        Stance::Random(amount) => pose::random_pose(&plan.skeleton, options.seed, amount),
    };
    let posed =
        skinning::blend(mesh.vertices(), &plan.skeleton, &weights, &pose.world_from_joint());
    let ground = posed.iter().map(|it| it.y).fold(f64::INFINITY, f64::min);
    pose.shift(-Vec3::y() * ground);
    let positions = posed.into_iter().map(|it| it - Vec3::y() * ground).collect();
    let mesh = mesh.with_vertices(positions).expect("blends of finite points are finite");
    let (clip, skeleton) = rebase(&walk, &plan.skeleton, &pose);
    let character = Character { mesh, skeleton, weights, landmarks, clip };
    defects::apply(character, options)
}

fn plan(options: &SynthesizeOptions) -> Plan {
    let mut proportions = Proportions::draw(options.seed, options.variation);
    proportions.height *= options.height;
    proportions.girth *= options.girth;
    // Limbs follow less: thick ones bend too sharply for their section.
    proportions.limb_girth *= options.girth.sqrt();
    proportions.arms *= options.limb_length;
    proportions.legs *= options.limb_length;
    proportions.head *= options.head_size;
    match options.body {
        Body::Biped => biped::biped(&proportions),
        Body::Quadruped => quadruped::quadruped(&proportions),
    }
}

/// The vertices nearest to where the plan's rays leave the body.
fn landmarks(plan: &Plan, mesh: &TriMesh) -> Landmarks {
    let nearest = |point: Vec3| {
        let distances = mesh.vertices().iter().map(|it| (it - point).norm_squared());
        let nearest = distances.enumerate().min_by(|a, b| a.1.total_cmp(&b.1));
        nearest.expect("a mesh has vertices").0 as u32
    };
    let aims = plan.landmarks.iter();
    Landmarks {
        names: aims.clone().map(|it| it.name.to_owned()).collect(),
        vertices: aims.map(|it| nearest(plan.surface.exit(it.from, it.direction))).collect(),
    }
}

/// A clip of a skeleton at rest, told from another pose of it that becomes the rest pose; and the
/// skeleton in that pose.
fn rebase(clip: &Clip, skeleton: &Skeleton, pose: &Pose<'_>) -> (Clip, Skeleton) {
    let posed = pose.world_from_joint();
    let positions: Vec<Vec3> = posed.iter().map(|it| it.translation.vector).collect();
    let (mut rotations, mut translations) = (Vec::new(), Vec::new());
    for frame in 0..clip.n_frames() {
        let transforms = skinning::world_from_joint(skeleton, clip, frame)
            .expect("the clip is of this skeleton");
        let from_posed: Vec<UnitQuaternion<f64>> =
            transforms.iter().zip(&posed).map(|(it, rest)| it.rotation / rest.rotation).collect();
        for (joint, parent) in skeleton.parents().iter().enumerate() {
            match *parent {
                Some(parent) => {
                    rotations.push(from_posed[parent].inverse() * from_posed[joint]);
                    translations.push(positions[joint] - positions[parent]);
                }
                None => {
                    rotations.push(from_posed[joint]);
                    translations.push(transforms[joint].translation.vector);
                }
            }
        }
    }
    let clip = Clip { rotations, translations, ..clip.clone() };
    let skeleton = skeleton.with_positions(positions).expect("poses of finite joints are finite");
    (clip, skeleton)
}
