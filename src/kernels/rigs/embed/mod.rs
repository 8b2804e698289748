//! Puts a skeleton into a body: the embedding of Pinocchio.
//!
//! The body is described by a graph of balls in it, the skeleton by its ends and
//! branchings (`reduced`). The best matching of these joints with balls (`penalties`, `search`) is
//! spread over all joints and improved in the body (`refine`). Everything happens in a frame in which
//! the body is 0.9 large and stands in the middle of the unit cube; lengths in these files are in it.

mod align;
mod penalties;
mod reduced;
mod refine;
mod search;

use nalgebra::UnitQuaternion;
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::skeleton::Skeleton;
use crate::kernels::geometry::distance_field::{DistanceField, SampledDistance, SamplingOptions};
use crate::kernels::geometry::medial_balls::{BODY_SIZE, Ball, MedialOptions, medial_balls, pack};
use crate::kernels::geometry::medial_graph::MedialGraph;
use crate::kernels::geometry::mesh::{MeshError, TriMesh, Vec3};
use crate::kernels::geometry::shapes::outward;

use align::{axis_rotations, extent, mirror_images};
use penalties::Problem;
use reduced::{Reduced, Working, along};
use search::{Matching, SearchOptions, search, terms_of_matching};

pub use penalties::{TERM_NAMES, Terms};

/// What is given up when a joint finds no place.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum GiveUp {
    /// This joint: what hangs on it hangs on its parent then, and a limb gets shorter by a bone.
    #[default]
    Joint,
    /// This joint and all joints below it (Transfer4D).
    Branch,
}

/// What is embedded how.
#[derive(Debug, Clone)]
pub struct EmbedOptions {
    /// The largest extent of the body that the skeleton comes from, in the skeleton's unit. The
    /// skeleton is scaled so that this becomes the largest extent of the target. Without it, the
    /// skeleton's own extent counts as 0.9 of it.
    pub source_extent: Option<f64>,
    /// The middle of that body's bounding box. If it is known, joints are looked for where they are in
    /// their own body, when both boxes have the same middle…
    pub source_center: Option<Vec3>,
    /// … and this is how much that matters; 0 for not at all.
    pub place: f64,
    /// … and directions over less than this length matter less (bodies are 0.9 large).
    pub short: f64,
    /// What is given up when a joint finds no place.
    pub give_up: GiveUp,
    /// Turns the skeleton before anything else.
    pub rotation: UnitQuaternion<f64>,
    /// Try all 24 rotations of axes into axes (after `rotation`) and take the one that fits best.
    pub align: bool,
    /// Joints that should stand at the bottom.
    pub feet: Vec<String>,
    /// Joints that should be in the thick of the body.
    pub fat: Vec<String>,
    /// Bones that mirror each other in the skeleton should be equally long.
    pub symmetry: bool,
    /// The least angle between two places where a medial ball touches the surface, in degrees.
    pub medial_angle_deg: f64,
    pub max_balls: usize,
    pub max_queue: usize,
    pub max_steps: usize,
    pub refine_rounds: usize,
}

impl Default for EmbedOptions {
    fn default() -> Self {
        Self {
            source_extent: None,
            source_center: None,
            place: 1.0,
            short: 0.1,
            give_up: GiveUp::default(),
            rotation: UnitQuaternion::identity(),
            align: false,
            feet: Vec::new(),
            fat: Vec::new(),
            symmetry: true,
            medial_angle_deg: 90.0,
            max_balls: 1000,
            max_queue: 100_000,
            max_steps: 20_000,
            refine_rounds: 10,
        }
    }
}

/// A skeleton in its new body.
#[derive(Debug, Clone)]
pub struct Embedding {
    /// The joints that were matched, where they are in the target.
    pub skeleton: Skeleton,
    /// One for every joint of the given skeleton.
    pub joints: Vec<JointReport>,
    /// The sum of the penalties of the matching, below one.
    pub penalty: f64,
    /// How the skeleton was turned.
    pub rotation: UnitQuaternion<f64>,
    pub n_balls: usize,
    pub n_edges: usize,
    /// Searches that it took: joints that found no place were given up between them.
    pub n_searches: usize,
}

/// What became of a joint.
#[derive(Debug, Clone, PartialEq)]
pub struct JointReport {
    pub is_matched: bool,
    /// For ends and branchings that are matched.
    pub terms: Option<Terms>,
}

/// Why a skeleton cannot be embedded.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum EmbedError {
    #[error(transparent)]
    Mesh(#[from] MeshError),
    #[error("the skeleton has {n_roots} roots (`{first}`, `{second}`), but must be one tree")]
    Roots { n_roots: usize, first: String, second: String },
    #[error("there is no joint `{name}` among the skeleton's {n_joints}")]
    NoSuchJoint { name: String, n_joints: usize },
    #[error("the option `{name}` is {value}, but must be {wanted}")]
    Option { name: &'static str, value: f64, wanted: &'static str },
    #[error("the target's largest extent is {extent}: nothing fits into it")]
    Extent { extent: f64 },
    #[error(
        "no ball of 1/150 of the target's largest extent ({extent}) fits into the target: is its \
         surface closed, or is it a sheet?"
    )]
    NoInside { extent: f64 },
    #[error(
        "none of the skeleton's {n_joints} joints can be matched beside the root: is its scale or \
         its direction another than that of the target ({n_balls} balls)?"
    )]
    NothingFits { n_joints: usize, n_balls: usize },
}

/// How much of its body's extent a skeleton spans if nothing is known.
const USUAL_SHARE: f64 = 0.9;
/// How long every rotation is tried.
const ALIGN_STEPS: usize = 1000;

/// Embeds a skeleton into a closed surface (Baran & Popović 2007), with the changes that Maheshwari
/// et al. (2023) made to it for arbitrary skeletons: joints that find no place are given up.
///
/// Only directions and lengths of the skeleton's bones matter, and where joints are in their own body if
/// that is known. The target should be
/// one closed surface; holes are bridged by the winding number, and a surface that is inside out is
/// turned.
///
/// # Errors
/// See [`EmbedError`].
pub fn embed(
    mesh: &TriMesh,
    skeleton: &Skeleton,
    options: &EmbedOptions,
) -> Result<Embedding, EmbedError> {
    check(skeleton, options)?;
    let target = Target::new(mesh, options)?;
    let source = Source::new(skeleton, options)?;
    let rotation = match options.align {
        true => best_rotation(&target, &source, options),
        false => options.rotation,
    };
    let attempt = attempt(&target, &source, rotation, options.max_steps);
    let Attempt { working, reduced, matching, terms, working_of_given, n_all, n_searches } =
        attempt;
    if matching.balls.is_empty() || (working.n() == 1 && n_all > 1) {
        let (n_joints, n_balls) = (skeleton.n_joints(), target.graph.n());
        return Err(EmbedError::NothingFits { n_joints, n_balls });
    }
    let mut embedded = spread(&target.graph, &working, &reduced, &matching);
    if options.refine_rounds > 0 {
        let mirrored = earlier_mirror(&working, options.symmetry);
        let body = refine::Body::new(&target.field, &target.balls);
        refine::refine(&body, &working, &mirrored, &mut embedded, options.refine_rounds);
    }
    // Given joints by the working joints before any was given up.
    let mut place_of_first = vec![None; n_all];
    let first_of_given: Vec<usize> = first_given(&working_of_given, n_all);
    for (joint, given) in working.joints.iter().enumerate() {
        place_of_first[working_of_given[*given]] = Some(joint);
    }
    let mut joints = Vec::with_capacity(skeleton.n_joints());
    for given in 0..skeleton.n_joints() {
        let first = working_of_given[given];
        let place = place_of_first[first];
        let is_own = first_of_given[first] == given;
        let reduced_joint = place.and_then(|it| reduced.joints.iter().position(|&own| own == it));
        let terms = reduced_joint.filter(|_| is_own).map(|it| terms[it]);
        joints.push(JointReport { is_matched: place.is_some(), terms });
    }
    let places = working_of_given.iter().map(|&it| place_of_first[it].map(|it| embedded[it]));
    let skeleton = kept_skeleton(skeleton, &target, &places.collect::<Vec<_>>());
    Ok(Embedding {
        skeleton,
        joints,
        penalty: matching.penalty,
        rotation,
        n_balls: target.graph.n(),
        n_edges: target.graph.n_edges(),
        n_searches,
    })
}

fn check(skeleton: &Skeleton, options: &EmbedOptions) -> Result<(), EmbedError> {
    let roots: Vec<usize> =
        (0..skeleton.n_joints()).filter(|&it| skeleton.parents()[it].is_none()).collect();
    if let [first, second, ..] = roots[..] {
        let [first, second] = [first, second].map(|it| skeleton.names()[it].clone());
        return Err(EmbedError::Roots { n_roots: roots.len(), first, second });
    }
    for name in options.feet.iter().chain(&options.fat) {
        if skeleton.joint(name).is_none() {
            let n_joints = skeleton.n_joints();
            return Err(EmbedError::NoSuchJoint { name: name.clone(), n_joints });
        }
    }
    let option = |name, value, wanted| Err(EmbedError::Option { name, value, wanted });
    let angle = options.medial_angle_deg;
    match options.source_extent {
        Some(it) if !(it > 0.0 && it.is_finite()) => {
            option("source_extent", it, "a positive number")
        }
        _ if !(angle > 0.0 && angle < 180.0) => {
            option("medial_angle_deg", angle, "between 0 and 180")
        }
        _ if !(options.place >= 0.0 && options.place.is_finite()) => {
            option("place", options.place, "a number from 0")
        }
        _ if options.max_balls == 0 => option("max_balls", 0.0, "at least 1"),
        _ if options.max_queue < 2 => option("max_queue", options.max_queue as f64, "at least 2"),
        _ => Ok(()),
    }
}

/// The body, in the frame of the work.
struct Target {
    low: Vec3,
    high: Vec3,
    scale: f64,
    field: SampledDistance,
    balls: Vec<Ball>,
    graph: MedialGraph,
}

impl Target {
    fn new(mesh: &TriMesh, options: &EmbedOptions) -> Result<Self, EmbedError> {
        mesh.check_has_faces()?;
        let (low, high, size) = extent(mesh.vertices());
        let scale = BODY_SIZE / size;
        if !(size > 0.0 && size.is_finite() && scale.is_finite()) {
            return Err(EmbedError::Extent { extent: size });
        }
        let frame = |it: &Vec3| (it - (low + high) / 2.0) * scale + Vec3::repeat(0.5);
        let inside = outward(mesh.with_vertices(mesh.vertices().iter().map(frame).collect())?);
        let exact = DistanceField::new(&inside);
        let medial = MedialOptions::for_body(options.medial_angle_deg);
        let balls = medial_balls(&exact, &inside, &medial);
        if balls.is_empty() {
            return Err(EmbedError::NoInside { extent: size });
        }
        let graph = MedialGraph::new(pack(&balls, options.max_balls), &exact);
        let sampling = SamplingOptions { tolerance: 0.003, max_depth: 10, reach: 0.0 };
        let field = SampledDistance::new(&exact, Vec3::zeros(), 1.0, &sampling);
        Ok(Self { low, high, scale, field, balls, graph })
    }

    /// Where a place of the work is in the frame of the mesh.
    fn mesh_from_work(&self, place: Vec3) -> Vec3 {
        (place - Vec3::repeat(0.5)) / self.scale + (self.low + self.high) / 2.0
    }
}

/// The skeleton, scaled to the frame of the work but not turned.
struct Source<'a> {
    skeleton: &'a Skeleton,
    positions: Vec<Vec3>,
    /// The middle of its body.
    center: Option<Vec3>,
    options: &'a EmbedOptions,
}

impl<'a> Source<'a> {
    fn new(skeleton: &'a Skeleton, options: &'a EmbedOptions) -> Result<Self, EmbedError> {
        let (low, _, own) = extent(skeleton.positions());
        let whole = options.source_extent.unwrap_or(own / USUAL_SHARE);
        // A skeleton at one place has no size, and needs none.
        let scale = if own > 0.0 { BODY_SIZE / whole } else { 0.0 };
        if !scale.is_finite() {
            let wanted = "within the range of double precision";
            return Err(EmbedError::Option { name: "source_extent", value: whole, wanted });
        }
        let positions = skeleton.positions().iter().map(|it| (it - low) * scale).collect();
        let center = options.source_center.map(|it| (it - low) * scale);
        Ok(Self { skeleton, positions, center, options })
    }

    /// For every reduced joint, whether a list of joints names it.
    fn is_named(&self, working: &Working, reduced: &Reduced, names: &[String]) -> Vec<bool> {
        let given = reduced.joints.iter().map(|&it| working.joints[it]);
        given.map(|it| names.contains(&self.skeleton.names()[it])).collect()
    }
}

/// Searches for the best matching, and takes apart its penalty.
fn match_joints(
    target: &Target,
    source: &Source<'_>,
    working: &Working,
    reduced: &Reduced,
    rotation: &UnitQuaternion<f64>,
    max_steps: usize,
) -> (Matching, Vec<Terms>) {
    let options = source.options;
    let working_mirror = earlier_mirror(working, options.symmetry);
    let reduced_of_working = |it: usize| reduced.joints.iter().position(|&own| own == it);
    let mirrored = reduced.joints.iter().enumerate().map(|(joint, &it)| {
        let images = [working_mirror[it].and_then(reduced_of_working)];
        images.into_iter().flatten().find(|&it| it < joint && it > 0)
    });
    let problem = Problem {
        graph: &target.graph,
        reduced,
        up: rotation * Vec3::y(),
        is_foot: source.is_named(working, reduced, &options.feet),
        mirrored: mirrored.collect(),
        places: source
            .center
            .filter(|_| options.place > 0.0)
            .map(|it| (options.place, Vec3::repeat(0.5) - rotation * it)),
        short: options.short,
    };
    let is_fat = source.is_named(working, reduced, &options.fat);
    let candidates: Vec<Vec<usize>> =
        (0..reduced.n()).map(|it| problem.candidates(it, is_fat[it])).collect();
    let search_options = SearchOptions { max_queue: options.max_queue, max_steps };
    let matching = search(&problem, &candidates, &search_options);
    let terms = terms_of_matching(&problem, &matching.balls);
    (matching, terms)
}

/// The joint that mirrors a joint, for one of every pair; none if symmetry is not wanted.
fn earlier_mirror(working: &Working, symmetry: bool) -> Vec<Option<usize>> {
    if !symmetry {
        return vec![None; working.n()];
    }
    let images = mirror_images(working);
    images.into_iter().enumerate().map(|(joint, it)| it.filter(|&it| it < joint)).collect()
}

/// A skeleton of which all joints are matched.
struct Attempt {
    working: Working,
    reduced: Reduced,
    /// Without balls if nothing could be matched.
    matching: Matching,
    terms: Vec<Terms>,
    /// The working joint of every given joint, before any was given up.
    working_of_given: Vec<usize>,
    /// The number of working joints before any was given up.
    n_all: usize,
    n_searches: usize,
}

impl Attempt {
    /// The penalty, plus the share of joints that were given up.
    fn score(&self) -> f64 {
        match self.matching.balls.is_empty() {
            true => f64::INFINITY,
            false => {
                self.matching.penalty + (self.n_all - self.working.n()) as f64 / self.n_all as f64
            }
        }
    }
}

/// Matches the joints of the turned skeleton, and gives up those that find no place until the rest is
/// matched.
fn attempt(
    target: &Target,
    source: &Source<'_>,
    rotation: UnitQuaternion<f64>,
    max_steps: usize,
) -> Attempt {
    let positions: Vec<Vec3> = source.positions.iter().map(|it| rotation * it).collect();
    let (mut working, working_of_given) = Working::new(source.skeleton.parents(), &positions);
    let n_all = working.n();
    let mut n_searches = 0;
    loop {
        n_searches += 1;
        let reduced = Reduced::new(&working);
        let (matching, terms) =
            match_joints(target, source, &working, &reduced, &rotation, max_steps);
        let lost = matching.lost.filter(|_| working.n() > 1);
        let Some(lost) = lost else {
            return Attempt {
                working,
                reduced,
                matching,
                terms,
                working_of_given,
                n_all,
                n_searches,
            };
        };
        let lost = reduced.joints[lost];
        working = match source.options.give_up {
            GiveUp::Branch => working.without(lost),
            GiveUp::Joint => working.without_only(lost),
        };
    }
}

/// Of all rotations of axes into axes, the one with the best score.
fn best_rotation(
    target: &Target,
    source: &Source<'_>,
    options: &EmbedOptions,
) -> UnitQuaternion<f64> {
    let rotations: Vec<_> = axis_rotations().into_iter().map(|it| it * options.rotation).collect();
    let scores: Vec<f64> = rotations
        .par_iter()
        .map(|&it| attempt(target, source, it, options.max_steps.min(ALIGN_STEPS)).score())
        .collect();
    let best = (0..scores.len()).min_by(|&a, &b| scores[a].total_cmp(&scores[b]));
    rotations[best.expect("there are 24")]
}

/// Places all joints along the paths between the matched ones.
fn spread(
    graph: &MedialGraph,
    working: &Working,
    reduced: &Reduced,
    matching: &Matching,
) -> Vec<Vec3> {
    let mut places = vec![Vec3::zeros(); working.n()];
    places[0] = graph.balls[matching.balls[0]].center;
    for joint in 1..reduced.n() {
        let parent = reduced.parents[joint].expect("only the first joint is a root");
        let ends = (matching.balls[parent], matching.balls[joint]);
        let mut polyline: Vec<Vec3> =
            graph.path_back(ends.0, ends.1).map(|it| graph.balls[it].center).collect();
        polyline.reverse();
        let chain = &reduced.chains[joint];
        for (&at, place) in chain.joints.iter().zip(along(&polyline, &chain.fractions)) {
            places[at] = place;
        }
    }
    places
}

/// The first given joint of every working joint.
fn first_given(working_of_given: &[usize], n_working: usize) -> Vec<usize> {
    let mut first = vec![usize::MAX; n_working];
    for (given, &working) in working_of_given.iter().enumerate().rev() {
        first[working] = given;
    }
    first
}

fn kept_skeleton(skeleton: &Skeleton, target: &Target, places: &[Option<Vec3>]) -> Skeleton {
    let (mut names, mut parents, mut positions) = (vec![], vec![], vec![]);
    // A joint that was given up stands for its parent.
    let mut new_of_old: Vec<Option<usize>> = vec![None; places.len()];
    for (joint, place) in places.iter().enumerate() {
        let parent = skeleton.parents()[joint].and_then(|it| new_of_old[it]);
        new_of_old[joint] = parent;
        let Some(place) = place else { continue };
        new_of_old[joint] = Some(names.len());
        names.push(skeleton.names()[joint].clone());
        parents.push(parent);
        positions.push(target.mesh_from_work(*place));
    }
    Skeleton::new(names, parents, positions)
        .expect("parents of kept joints are kept, and come first")
}

#[cfg(test)]
mod tests;
