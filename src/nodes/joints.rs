//! Kind `joints`.

use std::sync::Arc;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, OptionalInputs, Output, Spec};
use crate::kernels::geometry::mesh::{TriMesh, Vec3};
use crate::kernels::matching::find_joints::{
    Joint, JointOptions, add_images, find_joints, joint_skeleton, trim_to_surface,
};
use crate::kernels::matching::fit_joints::{FitOptions, fit_joints};
use crate::kernels::motion::fit_clip::world_positions;
use crate::kernels::rigs::clip::Clip;
use crate::kernels::rigs::skeleton::Skeleton;
use crate::kernels::table::{Column, Table};

/// Finds the joints of a figure from its skeleton in several poses.
///
/// A joint is where the skeleton bends most against the pose that it comes in. How a limb rolls about
/// itself cannot be seen, so a joint has one or two degrees of freedom.
///
/// With `surfaces` joints do not lie on the curves but where the surface turns about them: the parts between
/// joints are moved onto the surface of every pose. Joints that the surfaces can do without are dropped, and
/// new ones are put where a part does not move as one. In the end skin near joints moves with the parts on
/// both sides, which tells where joints are that have hardly anything but skin around them. Surfaces need no
/// vertices in common. Limbs end where their bones would leave the surface at rest.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Joints {
    /// Directions are taken over this share of the skeleton's greatest extent.
    #[schemars(range(min = 0.0, max = 0.5))]
    pub window: f64,
    /// A joint bends by more than this, in degrees.
    #[schemars(range(min = 0.0, max = 180.0))]
    pub min_angle: f64,
    /// Joints of one branch are at least so many windows apart.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub separation: f64,
    /// Joints are at least so many windows from the ends of limbs.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub tip: f64,
    /// Joints on branches are at least so many windows from branch nodes.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub fork: f64,
    /// Branch nodes may be joints.
    pub at_forks: bool,
    /// Put joints around a part that does not bend (hips, shoulders) where the axes of its limbs meet over
    /// the poses, not on the curve.
    pub centered: bool,
    /// A degree of freedom turns by more than this, in degrees (root of the mean square)…
    #[schemars(range(min = 0.0, max = 180.0))]
    pub min_spread: f64,
    /// … and by more than this share of the first one.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub spread_share: f64,
    /// With surfaces: joints are tried to be left out if without them at most this share more of the smaller
    /// part beside them would be off the surface of every pose.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub min_gain: f64,
    /// With surfaces: about so many of their points are looked at.
    #[schemars(range(min = 100, max = 1_000_000))]
    pub samples: usize,
    /// Give joints images on limbs that are like their own.
    pub symmetric: bool,
    /// How unlike limbs may be for that: the greatest rating of the skeleton's match with itself.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub symmetry: f64,
}

impl Default for Joints {
    fn default() -> Self {
        let (it, fit) = (JointOptions::default(), FitOptions::default());
        Self {
            window: it.window,
            min_angle: it.min_angle,
            separation: it.separation,
            tip: it.tip,
            fork: it.fork,
            at_forks: it.at_forks,
            centered: it.is_centered,
            min_spread: it.min_spread,
            spread_share: it.spread_share,
            min_gain: fit.min_gain,
            samples: fit.n_samples,
            symmetric: it.is_symmetric,
            symmetry: it.symmetry_rating,
        }
    }
}

impl Joints {
    const SKELETON: Input<Skeleton> =
        Input::new("skeleton", "a skeleton of many nodes, in the pose that bends are held against");
    const CLIP: Input<Clip> = Input::new("clip", "its poses, a frame each");
    const SURFACES: OptionalInputs<TriMesh> =
        OptionalInputs::new("surfaces", "the figure's surface in every pose, in the clip's order");
    const JOINTS: Output<Table> =
        Output::new("joints", "one row a joint: place, angle, degrees of freedom, axis");
    const REDUCED: Output<Skeleton> =
        Output::new("skeleton", "joints, roots, branch nodes and ends only");
}

impl Node for Joints {
    const SPEC: Spec = Spec {
        kind: "joints",
        version: 6,
        inputs: &[Self::SKELETON.port(), Self::CLIP.port(), Self::SURFACES.port()],
        outputs: &[Self::JOINTS.port(), Self::REDUCED.port()],
        cites: &["madaras2014skeleton", "pekelny2008articulated", "obrien2000automatic"],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.bent]
kind = "pose"
mesh = "@body.mesh"
skeleton = "@body.skeleton"
weights = "@body.weights"
turns = { left_forearm = [-80, 0, 0], right_leg = [70, 0, 0] }

[nodes.union]
kind = "union_skeleton"
skeletons = ["@body.skeleton", "@bent.skeleton"]
reference = 0

[nodes.joints]
kind = "joints"
skeleton = "@union.skeleton"
clip = "@union.clip"
surfaces = ["@body.mesh", "@bent.mesh"]
samples = 500
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let (skeleton, clip) = (io.get(Self::SKELETON), io.get(Self::CLIP));
        let n_joints = skeleton.n_joints();
        if clip.n_joints != n_joints {
            let found = clip.n_joints;
            let message = format!("the clip has {found} joints, but the skeleton {n_joints}");
            return Err(NodeError::failed(message));
        }
        let parents = skeleton.parents();
        let poses: Vec<_> =
            (0..clip.n_frames()).map(|frame| world_positions(&clip, frame, parents)).collect();
        let surfaces = io.get_all_optional(Self::SURFACES);
        let mut skeleton = (*skeleton).clone();
        let joints = match surfaces.is_empty() {
            true => find_joints(&skeleton, &poses, &self.options())?,
            false => {
                let (joints, rest) = self.fitted(io, &skeleton, &poses, &surfaces)?;
                let (trimmed, joints) = trim_to_surface(&skeleton, &joints, &surfaces[rest]);
                skeleton = trimmed;
                joints
            }
        };
        if joints.is_empty() {
            let (n_poses, least) = (poses.len(), self.min_angle);
            io.note(format!("nothing bends by more than {least} degrees in {n_poses} poses"));
        }
        io.put(Self::JOINTS, table(&skeleton, &joints));
        io.put(Self::REDUCED, joint_skeleton(&skeleton, &joints));
        Ok(())
    }
}

impl Joints {
    fn options(&self) -> JointOptions {
        JointOptions {
            window: self.window,
            min_angle: self.min_angle,
            separation: self.separation,
            tip: self.tip,
            fork: self.fork,
            at_forks: self.at_forks,
            is_centered: self.centered,
            min_spread: self.min_spread,
            spread_share: self.spread_share,
            is_symmetric: self.symmetric,
            symmetry_rating: self.symmetry,
        }
    }

    fn fitted(
        &self,
        io: &mut NodeIo<'_>,
        skeleton: &Skeleton,
        poses: &[Vec<Vec3>],
        surfaces: &[Arc<TriMesh>],
    ) -> Result<(Vec<Joint>, usize), NodeError> {
        /// Parts turn less than the curves between them bend, where curves cut corners.
        const ANGLE_SHARE: f64 = 0.8;
        let options = self.options();
        let on_curves = JointOptions { is_symmetric: false, is_centered: false, ..options };
        let candidates = find_joints(skeleton, poses, &on_curves)?;
        let surfaces: Vec<&TriMesh> = surfaces.iter().map(|it| &**it).collect();
        let fit_options = FitOptions {
            n_samples: self.samples,
            min_angle: ANGLE_SHARE * self.min_angle,
            min_gain: self.min_gain,
            freedoms: [self.min_spread, self.spread_share],
            ..Default::default()
        };
        let fit = fit_joints(skeleton, poses, &surfaces, &candidates, &fit_options)?;
        let worst = fit.fits.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1));
        if let Some((pose, share)) = worst {
            io.note(format!(
                "{} joints from {} on curves; at least {:.0} % of the surface lies on that of every \
                 other pose (least in the {}.)",
                fit.joints.len(),
                candidates.len(),
                100.0 * share,
                pose + 1
            ));
        }
        let mut joints = fit.joints;
        if self.symmetric {
            add_images(skeleton, &mut joints, &options);
        }
        Ok((joints, fit.rest))
    }
}

fn table(skeleton: &Skeleton, joints: &[Joint]) -> Table {
    let number = |name: &str, unit: &str, of: &dyn Fn(&Joint) -> f64| {
        Column::numbers(name, unit, joints.iter().map(of).collect())
    };
    // The axis of an image is not known.
    let axis =
        |index: usize| move |it: &Joint| if it.is_mirrored { f64::NAN } else { it.axis[index] };
    let node = |it: &Joint| skeleton.names()[it.at(skeleton)].clone();
    let source = |it: &Joint| if it.is_mirrored { "image" } else { "seen" }.to_owned();
    Table::new(vec![
        Column::texts("node", joints.iter().map(node).collect()),
        number("x", "", &|it| it.position.x),
        number("y", "", &|it| it.position.y),
        number("z", "", &|it| it.position.z),
        number("angle", "°", &|it| it.angle),
        number("freedoms", "", &|it| it.n_freedoms as f64),
        number("axis x", "", &axis(0)),
        number("axis y", "", &axis(1)),
        number("axis z", "", &axis(2)),
        number("first spread", "°", &|it| it.spreads[0]),
        number("second spread", "°", &|it| it.spreads[1]),
        Column::texts("source", joints.iter().map(source).collect()),
    ])
}
