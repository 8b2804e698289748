//! Tracking a surface through a depth video.

use super::correspond::{Limits, Pair, Seen, source_to_target, target_to_source, visible};
use super::energy::{Posed, Terms};
use super::erode::{erode, on_faces};
use super::graph::DeformationGraph;
use super::normal_matrix::Pattern;
use super::paper::{PaperOptions, fit_frame};
use super::relocalize::relocalize;
use super::silhouette::overlaps;
use super::solve::Level;
use super::target::{Target, Window};
use super::warp::{Motion, warp};
use crate::kernels::geometry::mesh::{TriMesh, Vec3};
use crate::kernels::geometry::mesh_sequence::{MeshSequence, SequenceError};
use crate::kernels::sensors::depth::{DepthVideo, steps::step_gate};

/// How frames are fitted.
#[derive(Debug, Clone, PartialEq)]
pub enum Solver {
    /// Gauss-Newton steps on point-to-plane pairs, from coarse to fine.
    GaussNewton,
    /// As Transfer4D publishes it: Adam on chamfer distances. Of the other options `spacing`, `erosion`
    /// and `seed` count; no frame with a measurement is ever lost.
    Paper(PaperOptions),
}

/// How a surface is tracked. Lengths are for a surface whose box has a diagonal of 2 m, and are scaled
/// with it.
#[derive(Debug, Clone, PartialEq)]
pub struct NrrOptions {
    pub solver: Solver,
    /// The distance between nodes of the finest graph; coarser ones have 2 and 4 times that.
    pub spacing: f64,
    /// Outer iterations on each level.
    pub iterations: usize,
    /// The weight of smoothness against 1000 times the mean squared distance (Transfer4D: 10; fast limbs
    /// want less).
    pub smoothness: f64,
    /// The farthest pairs at the beginning of a frame.
    pub reach: f64,
    /// The farthest pairs at its end.
    pub final_reach: f64,
    /// The largest angle between normals of a pair.
    pub max_angle_deg: f64,
    /// The step in depth that separates surfaces, in metres as they are; told from the source frame if
    /// not given (see [`step_gate`]).
    pub gate: Option<f64>,
    /// How many pixels around each one its depth is averaged over.
    pub smoothing: usize,
    /// The weight of pairs from bare target points to the surface.
    pub reverse: f64,
    /// How many vertices carry data at most.
    pub n_samples: usize,
    /// The share of the last motion by which a frame may start ahead of the frame before.
    pub momentum: f64,
    /// Rounds of erosion before nodes are placed.
    pub erosion: usize,
    /// The least share of what is seen of the surface that lies on the subject; below, the subject is
    /// sought anew.
    pub least_overlap: f64,
    /// The decrease of the energy, relative, at which a level is done.
    pub tolerance: f64,
    pub seed: u64,
}

impl Default for NrrOptions {
    fn default() -> Self {
        Self {
            solver: Solver::GaussNewton,
            spacing: 0.05,
            iterations: 5,
            smoothness: 2.0,
            reach: 0.15,
            final_reach: 0.05,
            max_angle_deg: 60.0,
            gate: None,
            smoothing: 2,
            reverse: 0.5,
            n_samples: 5000,
            momentum: 1.0,
            erosion: 1,
            least_overlap: 0.5,
            tolerance: 1e-2,
            seed: 0,
        }
    }
}

/// Why a surface cannot be tracked.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NrrError {
    #[error("frame {frame} is the source, but the video has {n_frames} frames")]
    Frame { frame: usize, n_frames: usize },
    #[error("the source has no faces")]
    NoFaces,
    #[error("the source lies {depth} m before the camera; it must be in camera space, z forward")]
    Behind { depth: f64 },
    #[error("the source of {n_faces} faces is too small for a deformation graph")]
    NoNodes { n_faces: usize },
    #[error("`{name}` is {value}")]
    Option { name: &'static str, value: f64 },
    #[error(transparent)]
    Sequence(#[from] SequenceError),
}

/// How well a frame was tracked.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameReport {
    /// The mean distance of paired vertices to their pairs, in metres; NaN without pairs.
    pub residual: f64,
    /// The share of target pixels that the tracked surface covers; NaN without any.
    pub coverage: f64,
    /// Intersection over union of silhouettes.
    pub iou: f64,
    /// The share of the surface's silhouette that lies on the subject's. Sides that the source did not
    /// show lower `iou` as they come into view, but not this.
    pub overlap: f64,
    /// The share of samples that face the camera unhidden.
    pub visible: f64,
    /// The share of visible samples that found a pair.
    pub paired: f64,
    /// The frame was empty or could not be explained; the surface stays as in the frame before, unless
    /// what was found lies on more of the subject.
    pub is_lost: bool,
    /// The subject had to be sought anew.
    pub is_relocalized: bool,
    pub n_iterations: usize,
}

/// A tracked surface.
#[derive(Debug, Clone)]
pub struct Tracked {
    pub sequence: MeshSequence,
    /// One a frame.
    pub reports: Vec<FrameReport>,
    pub n_nodes: usize,
}

/// Follows a surface, which lies in camera space where frame `source` shows it, through all frames.
///
/// Embedded deformation on three levels and one rigid one before them; each frame starts where the
/// frame before ended, forward and backward from the source. See Li, Sumner & Pauly 2008 and
/// Transfer4D (Maheshwari et al. 2023), whose energy this is but for point-to-plane distances, Huber's
/// function and a Gauss-Newton solver.
///
/// # Errors
/// See [`NrrError`]; frames that cannot be tracked are no errors but reported.
pub fn track(
    video: &DepthVideo,
    mesh: &TriMesh,
    source: usize,
    options: &NrrOptions,
) -> Result<Tracked, NrrError> {
    check(video, mesh, source, options)?;
    let tracker = Tracker::new(video, mesh, source, options)?;
    let n_frames = video.n_frames();
    let mut tracked: Vec<Option<(Vec<Vec3>, FrameReport)>> = vec![None; n_frames];
    tracker.follow(source..n_frames, &mut tracked);
    tracker.follow((0..source).rev(), &mut tracked);
    let (frames, reports) = tracked.into_iter().map(|it| it.expect("both ways")).unzip();
    let sequence =
        MeshSequence::from_frames(frames, mesh.faces().to_vec(), video.frames_per_second())?;
    Ok(Tracked { sequence, reports, n_nodes: tracker.fine.n_nodes() })
}

fn check(
    video: &DepthVideo,
    mesh: &TriMesh,
    source: usize,
    options: &NrrOptions,
) -> Result<(), NrrError> {
    let n_frames = video.n_frames();
    if source >= n_frames {
        return Err(NrrError::Frame { frame: source, n_frames });
    }
    if mesh.is_point_cloud() {
        return Err(NrrError::NoFaces);
    }
    let depth = mesh.vertices().iter().map(|it| it.z).fold(f64::INFINITY, f64::min);
    if depth <= 0.0 {
        return Err(NrrError::Behind { depth });
    }
    let positive = [
        ("spacing", options.spacing),
        ("reach", options.reach),
        ("final_reach", options.final_reach),
        ("gate", options.gate.unwrap_or(1.0)),
        ("smoothness", options.smoothness),
        ("max_angle_deg", options.max_angle_deg),
    ];
    match positive.into_iter().find(|it| !(it.1 > 0.0 && it.1.is_finite())) {
        Some((name, value)) => Err(NrrError::Option { name, value }),
        None => Ok(()),
    }
}

/// How many target pixels tell how much of a frame is covered.
const N_COVERED: usize = 4000;

/// A tracked frame.
struct Step {
    motion: Motion,
    vertices: Vec<Vec3>,
    report: FrameReport,
    /// By node, how much of what it moves was found; empty if the frame was not.
    shares: Vec<f64>,
}

struct Tracker<'a> {
    video: &'a DepthVideo,
    mesh: &'a TriMesh,
    options: &'a NrrOptions,
    gate: f64,
    /// Half the diagonal of the surface's box.
    scale: f64,
    /// The vertices that the graph holds.
    bound: Vec<u32>,
    /// Those that carry data.
    samples: Vec<u32>,
    /// From rigid to twice the finest spacing.
    coarse: Vec<(DeformationGraph, Pattern)>,
    fine: DeformationGraph,
    fine_pattern: Pattern,
}

impl<'a> Tracker<'a> {
    fn new(
        video: &'a DepthVideo,
        mesh: &'a TriMesh,
        source: usize,
        options: &'a NrrOptions,
    ) -> Result<Self, NrrError> {
        let gate = options.gate.unwrap_or_else(|| step_gate(video, source));
        let (vertices, faces) = (mesh.vertices(), mesh.faces());
        let (low, high) = mesh.bounds();
        let scale = (high - low).norm() / 2.0;
        let stays = erode(vertices.len(), faces, options.erosion, 3);
        let inner = on_faces(vertices.len(), faces, &stays);
        let graph = |factor: f64| {
            let spacing = options.spacing * scale * factor;
            let whole = || on_faces(vertices.len(), faces, &vec![true; faces.len()]);
            DeformationGraph::new(vertices, faces, &inner, spacing)
                .or_else(|| DeformationGraph::new(vertices, faces, &whole(), spacing))
                .ok_or(NrrError::NoNodes { n_faces: faces.len() })
        };
        let fine = graph(1.0)?;
        let bound: Vec<u32> =
            (0..vertices.len() as u32).filter(|it| fine.is_bound[*it as usize]).collect();
        let step = bound.len().div_ceil(options.n_samples.max(1)).max(1);
        let samples: Vec<u32> = bound.iter().copied().step_by(step).collect();
        let coarse = [DeformationGraph::rigid(vertices), graph(4.0)?, graph(2.0)?];
        let with_pattern = |it: DeformationGraph| {
            let pattern = Pattern::new(&it, &samples);
            (it, pattern)
        };
        let coarse = coarse.into_iter().map(with_pattern).collect();
        let fine_pattern = Pattern::new(&fine, &samples);
        Ok(Self { video, mesh, options, gate, scale, bound, samples, coarse, fine, fine_pattern })
    }

    /// Tracks frames from the source's neighbour on.
    fn follow(
        &self,
        frames: impl Iterator<Item = usize>,
        tracked: &mut [Option<(Vec<Vec3>, FrameReport)>],
    ) {
        let mut motion = Motion::identity(self.fine.n_nodes());
        let mut ahead = motion.clone();
        for frame in frames {
            let Step { motion: next, vertices, report, shares } = self.step(frame, &motion, &ahead);
            // What is hidden stays where it was: nothing would stop it.
            let shares: Vec<f64> = shares.iter().map(|it| it * self.options.momentum).collect();
            ahead = if report.is_lost { next.clone() } else { next.ahead(&motion, &shares) };
            (motion, tracked[frame]) = (next, Some((vertices, report)));
        }
    }

    /// The share of the samples of every node that find their pairs in a frame.
    fn paired_shares(&self, target: &Target, vertices: &[Vec3]) -> Vec<f64> {
        let seen = Seen::new(target, vertices, self.mesh.faces());
        let limits = self.limit(1.0);
        let places: Vec<(u32, Vec3)> =
            self.samples.iter().map(|it| (*it, vertices[*it as usize])).collect();
        let visible = visible(target, &seen, &places, &limits);
        let sums = |samples: &mut dyn Iterator<Item = u32>| {
            let mut sums = vec![0.0; self.fine.n_nodes()];
            for (node, weight) in samples.flat_map(|it| self.fine.skin[it as usize]) {
                sums[node as usize] += weight;
            }
            sums
        };
        let pairs = source_to_target(target, &seen, &visible, &limits);
        let paired = sums(&mut pairs.iter().map(|it| self.samples[it.sample as usize]));
        let all = sums(&mut self.samples.iter().copied());
        paired.iter().zip(all).map(|(part, all)| if all > 0.0 { part / all } else { 0.0 }).collect()
    }

    /// Tracks one frame from the motion of its neighbour, or from ahead of it where that is nearer.
    fn step(&self, frame: usize, previous: &Motion, ahead: &Motion) -> Step {
        if let Solver::Paper(options) = &self.options.solver {
            return self.paper_step(frame, previous, options);
        }
        let before = warp(&self.fine, self.mesh.vertices(), previous);
        let window = Window::around(self.video, frame, &before);
        let smoothing = self.options.smoothing;
        let target = Target::of_window(self.video, frame, window, self.gate, smoothing);
        let first = self.report(&target, &before, 0);
        if target.measured.is_empty() {
            let report = FrameReport { is_lost: true, ..first };
            return Step { motion: previous.clone(), vertices: before, report, shares: vec![] };
        }
        let (mut motion, mut is_relocalized) = (previous.clone(), false);
        let at_once = warp(&self.fine, self.mesh.vertices(), ahead);
        if ahead != previous && self.report(&target, &at_once, 0).iou > first.iou {
            motion = ahead.clone();
        } else if self.is_off(&first) {
            let faces = self.mesh.faces();
            let seed = self.options.seed ^ frame as u64;
            if let Some(rigid) = relocalize(&target, &before, faces, self.scale, seed) {
                motion = self.moved(&motion, |it| rigid.0 * it + rigid.1, |_| rigid.0);
                is_relocalized = true;
            }
        }
        let (motion, n_iterations) = self.refine(&target, motion);
        let vertices = warp(&self.fine, self.mesh.vertices(), &motion);
        let report = self.report(&target, &vertices, N_COVERED);
        let is_lost = self.is_off(&report);
        let report = FrameReport { n_iterations, is_relocalized, is_lost, ..report };
        if is_lost && !(report.iou > first.iou) {
            return Step { motion: previous.clone(), vertices: before, report, shares: vec![] };
        }
        let shares = self.paired_shares(&target, &vertices);
        Step { motion, vertices, report, shares }
    }

    /// Tracks one frame as the paper does.
    fn paper_step(&self, frame: usize, previous: &Motion, options: &PaperOptions) -> Step {
        let target = Target::new(self.video, frame, self.gate, 0);
        let points: Vec<Vec3> =
            target.measured.iter().map(|it| target.points[*it as usize]).collect();
        let mut motion = previous.clone();
        let is_lost = points.is_empty();
        if !is_lost {
            let (nodes, rest) = (&self.fine.nodes, self.mesh.vertices());
            let posed = Posed { graph: &self.fine, nodes, rest, samples: &self.bound };
            let seed = self.options.seed ^ frame as u64;
            motion = fit_frame(&posed, &points, previous, self.scale, options, seed);
        }
        let vertices = warp(&self.fine, self.mesh.vertices(), &motion);
        let n_iterations = if is_lost { 0 } else { options.n_steps };
        let report = self.report(&target, &vertices, N_COVERED);
        let report = FrameReport { is_lost, n_iterations, ..report };
        Step { motion, vertices, report, shares: vec![0.0; self.fine.n_nodes()] }
    }

    /// Whether a surface does not explain a frame.
    fn is_off(&self, report: &FrameReport) -> bool {
        let overlaps = report.overlap >= self.options.least_overlap;
        !(overlaps && report.residual <= 0.1 * self.scale)
    }

    /// Level by level, from rigid to fine.
    fn refine(&self, target: &Target, mut motion: Motion) -> (Motion, usize) {
        let n_levels = self.coarse.len() + 1;
        let mut n_iterations = 0;
        for (index, (graph, pattern)) in self.coarse.iter().enumerate() {
            let vertices = warp(&self.fine, self.mesh.vertices(), &motion);
            let nodes: Vec<Vec3> = match graph.node_vertices.is_empty() {
                true => vec![vertices.iter().sum::<Vec3>() / vertices.len() as f64],
                false => graph.node_vertices.iter().map(|it| vertices[*it as usize]).collect(),
            };
            let posed = Posed { graph, nodes: &nodes, rest: &vertices, samples: &self.samples };
            let level = self.level(posed, pattern, target);
            let start = Motion::identity(graph.n_nodes());
            let (found, n) = level.refine(start, &self.limits(index, n_levels));
            n_iterations += n;
            motion = self.carried(&motion, graph, &nodes, &found);
        }
        let rest = self.mesh.vertices();
        let nodes = &self.fine.nodes;
        let posed = Posed { graph: &self.fine, nodes, rest, samples: &self.samples };
        let level = self.level(posed, &self.fine_pattern, target);
        let (motion, n) = level.refine(motion, &self.limits(n_levels - 1, n_levels));
        (motion, n_iterations + n)
    }

    fn level<'b>(
        &'b self,
        posed: Posed<'b>,
        pattern: &'b Pattern,
        target: &'b Target,
    ) -> Level<'b> {
        let terms = Terms {
            data: 1000.0,
            smooth: self.options.smoothness,
            plane: 0.9,
            huber: 0.02 * self.scale,
        };
        let (reverse, tolerance) = (self.options.reverse, self.options.tolerance);
        Level { posed, pattern, faces: self.mesh.faces(), target, terms, reverse, tolerance }
    }

    /// The limits of a level's outer iterations: distances fall geometrically over all of them.
    fn limits(&self, level: usize, n_levels: usize) -> Vec<Limits> {
        let n = self.options.iterations;
        let last = (n_levels * n).saturating_sub(1).max(1) as f64;
        (0..n).map(|it| self.limit((level * n + it) as f64 / last)).collect()
    }

    /// The limits at a share of all iterations.
    fn limit(&self, share: f64) -> Limits {
        let (from, to) = (self.options.reach, self.options.final_reach);
        Limits {
            distance: self.scale * from * (to / from).powf(share),
            cosine: self.options.max_angle_deg.to_radians().cos(),
            occlusion: 0.02 * self.scale,
        }
    }

    /// Applies a coarser level's motion to the fine nodes.
    fn carried(
        &self,
        motion: &Motion,
        graph: &DeformationGraph,
        nodes: &[Vec3],
        by: &Motion,
    ) -> Motion {
        let mut res = motion.clone();
        for (node, vertex) in self.fine.node_vertices.iter().enumerate() {
            let skin = &graph.skin[*vertex as usize];
            let place = self.fine.nodes[node] + motion.translations[node];
            res.translations[node] = by.point(nodes, skin, &place) - self.fine.nodes[node];
            res.rotations[node] = by.rotation(skin) * motion.rotations[node];
        }
        res
    }

    /// Moves all fine nodes.
    fn moved(
        &self,
        motion: &Motion,
        point: impl Fn(Vec3) -> Vec3,
        turn: impl Fn(usize) -> nalgebra::Rotation3<f64>,
    ) -> Motion {
        let mut res = motion.clone();
        for (node, rest) in self.fine.nodes.iter().enumerate() {
            res.translations[node] = point(rest + motion.translations[node]) - rest;
            res.rotations[node] = turn(node) * motion.rotations[node];
        }
        res
    }

    /// Compares a surface with a frame; its coverage is told from at most so many target pixels.
    fn report(&self, target: &Target, vertices: &[Vec3], n_covered: usize) -> FrameReport {
        let seen = Seen::new(target, vertices, self.mesh.faces());
        let limits = self.limit(0.0);
        let places: Vec<(u32, Vec3)> =
            self.samples.iter().map(|it| (*it, vertices[*it as usize])).collect();
        let visible = visible(target, &seen, &places, &limits);
        let n_visible = visible.len();
        let pairs = source_to_target(target, &seen, &visible, &limits);
        let distance = |it: &Pair| (it.point - places[it.sample as usize].1).norm();
        let residual = pairs.iter().map(distance).sum::<f64>() / pairs.len() as f64;
        let coverage = match n_covered {
            0 => f64::NAN,
            most => target_to_source(target, &seen, &visible, &limits, 1.0, most).1,
        };
        let (iou, overlap) = overlaps(target, &seen);
        FrameReport {
            residual,
            coverage,
            iou,
            overlap,
            visible: n_visible as f64 / places.len().max(1) as f64,
            paired: pairs.len() as f64 / n_visible.max(1) as f64,
            is_lost: false,
            is_relocalized: false,
            n_iterations: 0,
        }
    }
}
