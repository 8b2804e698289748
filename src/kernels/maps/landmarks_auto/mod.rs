//! Landmarks of a body without a rig: what sticks out, told apart by distances along the surface.

mod body;
mod chest;
mod front;
mod limb;
mod protrusions;
mod roles;
mod surface;
#[cfg(test)]
mod tests;

use crate::kernels::geometry::landmarks::Landmarks;
use crate::kernels::geometry::mesh::{MeshError, TriMesh, Vec3};
use crate::kernels::geometry::topology::Topology;
use body::Body;
use limb::Limb;
use protrusions::{maxima, protrusions};
use roles::{Roles, assign};
use surface::Surface;

/// The number of vertices that mean distances are measured from.
const N_SAMPLES: usize = 48;

/// Least values of the tests; measured bodies are far above, other shapes below.
const LEAST_PROMINENCE: f64 = 0.1;
const LEAST_GAP: f64 = 1.25;
const LEAST_FIT: f64 = 0.3;
const LEAST_MARGIN: f64 = 0.2;
const LEAST_QUADRUPED_MARGIN: f64 = 0.1;

/// The plan of a body.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BodyPlan {
    /// A head, two arms, two legs.
    Biped,
    /// A head, four legs, perhaps a tail.
    Quadruped,
}

/// What is known beforehand.
#[derive(Debug, Clone, Copy)]
pub struct FindOptions {
    pub plan: BodyPlan,
    /// Decides where the front is (of a quadruped, where the head is) instead of the body's shape.
    pub front: Option<Vec3>,
}

/// What a test found.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    pub test: &'static str,
    pub value: f64,
    /// The least value that passes; NaN if nothing hangs on it.
    pub least: f64,
}

/// Landmarks and how sure they are.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    pub landmarks: Landmarks,
    pub findings: Vec<Finding>,
}

/// Why landmarks cannot be told.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FindError {
    #[error(transparent)]
    Mesh(#[from] MeshError),
    #[error(
        "the shape is in {n_parts} parts too far from each other to be joined; the largest has \
         {largest} of {n_vertices} vertices. `clean` keeps the largest part"
    )]
    Parts { n_parts: usize, largest: usize, n_vertices: usize },
    #[error(
        "the faces look inwards (the enclosed volume is {volume:.3e}): the surface is inside out, or \
         the body is its mirror image, whose left is right. Turn the faces, or mirror it back"
    )]
    InsideOut { volume: f64 },
    #[error("{found} parts stick out, but a body of this plan has {needed}")]
    FewProtrusions { found: usize, needed: usize },
    #[error(
        "this does not look like a body: the {ordinal}th part that sticks out has {value:.3} of the \
         mean distance on the surface, and {least} is needed"
    )]
    Flat { ordinal: usize, value: f64, least: f64 },
    #[error(
        "it is not clear what sticks out: a body of this plan has {kept} such parts, but another one \
         is nearly as prominent (ratio {ratio:.2}, {least} is needed). A part of the body may be \
         missing, or touch another one"
    )]
    Crowded { kept: usize, ratio: f64, least: f64 },
    #[error(
        "head, arms and legs cannot be told apart: {what} is {value:.3}, and {least} is needed. This \
         is no body of this plan, a part is missing, or parts touch"
    )]
    Roles { what: &'static str, value: f64, least: f64 },
    #[error("the torso has no extent")]
    NoTorso,
    #[error(
        "the given front points to where the hind legs are. If it is right, head and tail look too \
         much alike here"
    )]
    FrontBehind,
    #[error("no vertex of the torso is {place}")]
    NoChest { place: &'static str },
    #[error(
        "front and back cannot be told apart: the evidence is {value:.3}, and {least} is needed \
         ({witnesses}). Choose `front`"
    )]
    NoFront { value: f64, least: f64, witnesses: String },
    #[error(
        "the given front is not across the body: its share along the found axis is {value:.3}, and \
         {least} is needed"
    )]
    FrontAside { value: f64, least: f64 },
}

/// Finds landmarks of a body: its protrusions, and two points of the torso, left and right told apart.
///
/// What sticks out are persistent maxima of the mean distance along the surface; which is which
/// follows from the distances between them (`roles.rs`), whatever the pose. Left and right then
/// follow from front and up in space: `left = up x front`. The front of a biped is where its feet
/// point, carried up the legs, and where its knees bend to; that of a quadruped, where its head is.
///
/// Names and order are those of rigged bodies: `head_top`, `hand_left`, `hand_right`, `foot_left`,
/// `foot_right`, `chest_front`, `chest_back`; of quadrupeds also `nose` and `tail_tip`, the hands
/// are the fore feet, and the chest's front is below its back.
///
/// # Errors
/// See [`FindError`]: whatever is not clear is refused.
pub fn find_landmarks(mesh: &TriMesh, options: FindOptions) -> Result<Found, FindError> {
    let mut tests = Tests::default();
    mesh.check_has_faces()?;
    check_outside(mesh, &mut tests)?;
    let surface = connected(mesh)?;
    let function = surface.mean_distances(N_SAMPLES);
    let all = maxima(&surface, &function);
    let scale = function.iter().sum::<f64>() / function.len() as f64;
    let n_kept = count_kept(&all, options.plan, scale, &mut tests)?;
    let parts = protrusions(&surface, &function, &all[..n_kept]);
    let limbs: Vec<Limb> = parts.iter().map(|it| Limb::of(&surface, it)).collect();
    let minor = minor_persistences(&limbs, &all[n_kept..]);
    let head_is_ahead = |it: &Roles| match (options.front, it.tail) {
        (Some(front), Some(tail)) => {
            let at = |limb: usize| surface.positions[limbs[limb].tip];
            (at(it.head) - at(tail)).dot(&front) >= 0.0
        }
        _ => true,
    };
    let found = assign(&limbs, &minor, head_is_ahead);
    tests.roles("the fit", found.fit, LEAST_FIT)?;
    let least_margin = match options.plan {
        BodyPlan::Biped => LEAST_MARGIN,
        BodyPlan::Quadruped => LEAST_QUADRUPED_MARGIN,
    };
    tests.roles("the lead over the next best way", found.margin, least_margin)?;
    let lesser: Vec<usize> = all[n_kept..].iter().map(|it| it.0).collect();
    let body = Body { surface: &surface, limbs: &limbs, lesser: &lesser, front: options.front };
    let landmarks = match options.plan {
        BodyPlan::Biped => body.biped(found.roles, found.side_margin, &mut tests)?,
        BodyPlan::Quadruped => body.quadruped(found.roles, &mut tests)?,
    };
    Ok(Found { landmarks, findings: tests.findings })
}

/// What was measured so far.
#[derive(Debug, Default)]
struct Tests {
    findings: Vec<Finding>,
}

impl Tests {
    /// Notes a value; true if it is large enough.
    fn pass(&mut self, test: &'static str, value: f64, least: f64) -> bool {
        self.findings.push(Finding { test, value, least });
        value >= least
    }

    fn note(&mut self, test: &'static str, value: f64) {
        self.findings.push(Finding { test, value, least: f64::NAN });
    }

    fn roles(&mut self, what: &'static str, value: f64, least: f64) -> Result<(), FindError> {
        match self.pass(what, value, least) {
            true => Ok(()),
            false => Err(FindError::Roles { what, value, least }),
        }
    }
}

/// Faces that agree with each other must look outwards.
fn check_outside(mesh: &TriMesh, tests: &mut Tests) -> Result<(), FindError> {
    if !Topology::of(mesh).is_oriented {
        return Ok(());
    }
    let middle = mesh.vertices().iter().sum::<Vec3>() / mesh.n_vertices() as f64;
    let sixfold: f64 = (0..mesh.n_faces())
        .map(|face| {
            let [a, b, c] = mesh.corners(face).map(|it| it - middle);
            a.dot(&b.cross(&c))
        })
        .sum();
    let volume = sixfold / 6.0;
    // A ball has 0.094 of its area to the power of 3/2.
    let compactness = volume / mesh.area().powf(1.5);
    match tests.pass("outwards: volume / area^1.5", compactness, 0.0) {
        true => Ok(()),
        false => Err(FindError::InsideOut { volume }),
    }
}

fn connected(mesh: &TriMesh) -> Result<Surface, FindError> {
    let surface = Surface::of(mesh);
    let mut parts = surface.components();
    parts.sort_unstable();
    let sizes: Vec<usize> = parts.chunk_by(|a, b| a == b).map(<[usize]>::len).collect();
    match sizes.len() {
        1 => Ok(surface),
        n_parts => {
            let largest = sizes.into_iter().max().expect("there are several");
            Err(FindError::Parts { n_parts, largest, n_vertices: surface.len() })
        }
    }
}

/// How many of the maxima are limbs and head: where the persistence falls the most.
fn count_kept(
    all: &[(usize, f64)],
    plan: BodyPlan,
    scale: f64,
    tests: &mut Tests,
) -> Result<usize, FindError> {
    let persistence = |it: usize| all.get(it).map_or(0.0, |it| it.1);
    // A maximum that is a hundredth of the scale is noise, and no ratio to it means anything.
    let gap = |kept: usize| persistence(kept - 1) / persistence(kept).max(0.01 * scale);
    if all.len() < 5 {
        return Err(FindError::FewProtrusions { found: all.len(), needed: 5 });
    }
    let kept = match plan {
        BodyPlan::Quadruped if gap(6) > gap(5) => 6,
        _ => 5,
    };
    let prominence = persistence(kept - 1) / scale;
    if !tests.pass("prominence of the least limb", prominence, LEAST_PROMINENCE) {
        let (value, least) = (prominence, LEAST_PROMINENCE);
        return Err(FindError::Flat { ordinal: kept, value, least });
    }
    if !tests.pass("prominence of limbs over what follows", gap(kept), LEAST_GAP) {
        return Err(FindError::Crowded { kept, ratio: gap(kept), least: LEAST_GAP });
    }
    Ok(kept)
}

/// For every limb, the sum of the persistences of lesser maxima on it.
fn minor_persistences(limbs: &[Limb], lesser: &[(usize, f64)]) -> Vec<f64> {
    let on = |limb: &Limb, tip: usize| limb.members.binary_search(&(tip as u32)).is_ok();
    let of = |limb: &Limb| lesser.iter().filter(|it| on(limb, it.0)).map(|it| it.1).sum();
    limbs.iter().map(of).collect()
}
