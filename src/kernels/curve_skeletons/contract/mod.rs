//! Curve skeletons by Laplacian contraction, of meshes and of point clouds.

mod center;
mod coarse;
mod collapse;
mod contraction;
mod equations;
mod finish;
mod places;
mod rings;
mod schedule;
#[cfg(test)]
mod tests;

use rayon::prelude::*;

use super::curve_skeleton::{CurveSkeleton, NO_NODE};
use super::local_separators::median_distance;
use super::skeleton_cleanup::{drop_slight_leaves, merge_crowded_nodes, merge_junctions};
use super::skeleton_placement::place_by_boundaries;
use crate::kernels::geometry::cloud_sheets::CloudSheets;
use crate::kernels::geometry::delaunay_stars::{StarOptions, delaunay_stars};
use crate::kernels::geometry::mesh::{TriMesh, Vec3};

pub use center::{CenterOptions, center};
pub use coarse::{CoarseContractionError, coarse_contraction};
pub use collapse::{CollapseOptions, Collapsed, collapse};
pub use contraction::{Contraction, Step, Stop, contract};
pub use finish::{FinishOptions, finish};
pub use rings::Rings;
pub use schedule::{RingSize, Schedule};

use places::Places;

/// How skeletons are found.
#[derive(Debug, Clone, PartialEq)]
pub struct ContractOptions {
    /// Of clouds: how many of the nearest points make the surface around one.
    pub neighbors: Neighbors,
    /// Of clouds: pass over points of other sheets that come near.
    pub separate_sheets: bool,
    /// Without, that of meshes or clouds.
    pub schedule: Option<Schedule>,
    pub collapse: CollapseOptions,
    /// Unite junctions with a neighbour whose distances from the surface differ by less than this
    /// part; 0 for never.
    pub merge_junctions: f64,
    /// Unite nodes that are closer than this part of the shape's radius around them; 0 for never.
    pub spacing: f64,
    /// Move nodes to the middle of the rings between their regions.
    pub recenter: bool,
    /// Parts of fewer points have no skeleton.
    pub min_points: usize,
}

impl Default for ContractOptions {
    fn default() -> Self {
        Self {
            neighbors: Neighbors::default(),
            separate_sheets: true,
            schedule: None,
            collapse: CollapseOptions::default(),
            merge_junctions: 0.9,
            spacing: 0.5,
            recenter: true,
            min_points: FEWEST,
        }
    }
}

/// A share of all points, between two numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Neighbors {
    pub share: f64,
    pub least: usize,
    pub most: usize,
}

impl Default for Neighbors {
    /// Of Madaras et al. 2014: 12 from 600 points on.
    fn default() -> Self {
        Self { share: 0.02, least: 8, most: 12 }
    }
}

impl Neighbors {
    /// The number of neighbours in a cloud of so many points.
    pub fn of(&self, n_points: usize) -> usize {
        let most = self.most.max(self.least);
        ((self.share * n_points as f64).round() as usize).clamp(self.least, most)
    }
}

/// Fewer points make no shape.
pub const FEWEST: usize = 8;

/// A skeleton and how it came about.
#[derive(Debug, Clone, PartialEq)]
pub struct ContractionSkeleton {
    pub skeleton: CurveSkeleton,
    /// For every part that has a skeleton, in the order of its first point.
    pub parts: Vec<PartReport>,
    /// Points at the place of an earlier one, which they went with.
    pub n_duplicates: usize,
    /// Points that belong to no part.
    pub n_lost: usize,
    /// The points in their last places.
    pub contracted: Vec<Vec3>,
    /// For every point a direction across the surface, of either sign; zero where unknown.
    pub normals: Vec<Vec3>,
}

/// What happened to a connected part.
#[derive(Debug, Clone, PartialEq)]
pub struct PartReport {
    pub n_points: usize,
    pub steps: Vec<Step>,
    pub stop: Stop,
}

/// Why there is no skeleton.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ContractError {
    #[error("the {n_points} points are at {n_places} places; a skeleton needs {FEWEST}")]
    TooFew { n_points: usize, n_places: usize },
    #[error(
        "no part has the {least} points that a skeleton needs; the largest of {n_parts} has {largest}"
    )]
    OnlySmallParts { least: usize, n_parts: usize, largest: usize },
}

/// Extracts curve skeletons by contraction: of a mesh (Au et al., "Skeleton extraction by mesh
/// contraction", 2008), or of a cloud without faces, around whose points triangles are found in
/// tangent planes (Cao et al., "Point cloud skeletons via Laplacian-based contraction", 2010; Madaras
/// et al. 2014).
///
/// Points are drawn together until the shape is as thin as curves ([`contract`]), edges are collapsed
/// until no triangle is left ([`collapse`]), and what is left is moved to the middle of the points
/// that went there. Every connected part has a skeleton of its own; a ring keeps its cycle.
///
/// # Errors
/// See [`ContractError`].
pub fn contraction_skeleton(
    shape: &TriMesh,
    options: &ContractOptions,
) -> Result<ContractionSkeleton, ContractError> {
    let places = Places::of(shape.vertices());
    let (n_points, n_places) = (shape.n_vertices(), places.positions.len());
    if n_places < FEWEST {
        return Err(ContractError::TooFew { n_points, n_places });
    }
    let surface = Surface::of(shape, &places, options);
    let least = options.min_points.max(FEWEST);
    let parts = surface.rings.parts(least);
    if parts.is_empty() {
        let sizes: Vec<usize> = surface.rings.parts(1).iter().map(Vec::len).collect();
        let largest = sizes.iter().copied().max().unwrap_or(0);
        return Err(ContractError::OnlySmallParts { least, n_parts: sizes.len(), largest });
    }
    let schedule = options.schedule.clone().unwrap_or(match shape.is_point_cloud() {
        true => Schedule::of_clouds(),
        false => Schedule::of_meshes(),
    });
    let found: Vec<Part> = parts
        .par_iter()
        .map(|it| {
            Part::new(
                &surface.rings.part(it),
                &positions_of(&places.positions, it),
                &schedule,
                options,
            )
        })
        .collect();
    Ok(joined(&places, &surface, &parts, found))
}

/// The stars of places, and normals.
struct Surface {
    rings: Rings,
    normals: Vec<Vec3>,
}

impl Surface {
    fn of(shape: &TriMesh, places: &Places, options: &ContractOptions) -> Self {
        let positions = &places.positions;
        if !shape.is_point_cloud() {
            let place = |it: u32| places.place_of_point[it as usize];
            let faces: Vec<[u32; 3]> = shape.faces().iter().map(|it| it.map(place)).collect();
            let rings = Rings::of_faces(positions.len(), &faces);
            let mesh = TriMesh::new(positions.clone(), faces).expect("places of a mesh");
            return Self { rings, normals: mesh.vertex_normals() };
        }
        let n_neighbors = options.neighbors.of(positions.len());
        let sheets = CloudSheets::new(positions, n_neighbors);
        let kept = options.separate_sheets.then_some(&sheets);
        let triangles = delaunay_stars(positions, &StarOptions { n_neighbors, sheets: kept });
        let rings = Rings::new(positions.len(), triangles);
        Self { rings, normals: sheets.normals().to_vec() }
    }
}

fn positions_of(all: &[Vec3], chosen: &[u32]) -> Vec<Vec3> {
    chosen.iter().map(|&it| all[it as usize]).collect()
}

/// Ends of curves with less than this part of the points of the next node are no ends.
const SLIGHT: f64 = 0.5;

/// A connected part and its skeleton.
struct Part {
    skeleton: CurveSkeleton,
    contraction: Contraction,
}

impl Part {
    fn new(
        rings: &Rings,
        positions: &[Vec3],
        schedule: &Schedule,
        options: &ContractOptions,
    ) -> Self {
        let contraction = contract(rings, positions, schedule);
        let triangles = rings.all_triangles();
        let graph = collapse(&contraction.positions, &triangles, &options.collapse);
        let mut skeleton = curves(&graph, &contraction.positions, positions);
        if options.merge_junctions > 0.0 {
            skeleton = merge_junctions(&skeleton, positions, options.merge_junctions);
        }
        skeleton = merge_crowded_nodes(&with_radii(&skeleton, positions), options.spacing);
        skeleton = by_nearest_nodes(&skeleton, &contraction.positions);
        skeleton = drop_slight_leaves(&skeleton, SLIGHT);
        if options.recenter {
            skeleton = place_by_boundaries(&skeleton, positions, &edges_of(&triangles));
        }
        Self { skeleton: with_radii(&skeleton, positions), contraction }
    }
}

/// Gives every point to the node that is nearest to where it was drawn, as far as one gets there from
/// its own node by ever nearer ones.
///
/// Points of a ring around a limb are drawn to one place, but edges that collapse one by one may take
/// them to different nodes; a node with half a ring would not find the middle.
fn by_nearest_nodes(skeleton: &CurveSkeleton, contracted: &[Vec3]) -> CurveSkeleton {
    let neighbors = skeleton.neighbors();
    let places = skeleton.positions();
    let nearest = |(&node, place): (&u32, &Vec3)| {
        let distance = |it: u32| (places[it as usize] - place).norm_squared();
        let mut node = node;
        loop {
            let around = neighbors[node as usize].iter().copied();
            let best = around.min_by(|&a, &b| distance(a).total_cmp(&distance(b)));
            match best.filter(|&it| distance(it) < distance(node)) {
                Some(nearer) => node = nearer,
                None => return node,
            }
        }
    };
    let labels = skeleton.node_of_vertex().par_iter().zip(contracted).map(nearest).collect();
    let (radii, edges) = (skeleton.radii().to_vec(), skeleton.edges().to_vec());
    CurveSkeleton::new(places.to_vec(), radii, edges, labels).expect("labels of nodes there are")
}

fn edges_of(triangles: &[[u32; 3]]) -> Vec<[u32; 2]> {
    let sides = triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [a, c]]);
    let mut edges: Vec<[u32; 2]> = sides.map(|[a, b]| [a.min(b), a.max(b)]).collect();
    edges.sort_unstable();
    edges.dedup();
    edges
}

fn curves(graph: &Collapsed, contracted: &[Vec3], positions: &[Vec3]) -> CurveSkeleton {
    let nodes = positions_of(contracted, &graph.nodes);
    let radii = vec![0.0; nodes.len()];
    let labels = graph.node_of_point.clone();
    let skeleton = CurveSkeleton::new(nodes, radii, graph.edges.clone(), labels);
    with_radii(&skeleton.expect("contracted places are finite"), positions)
}

/// The same skeleton with the median distances of vertices from their nodes as radii.
pub fn with_radii(skeleton: &CurveSkeleton, vertices: &[Vec3]) -> CurveSkeleton {
    let places = skeleton.positions().to_vec();
    let groups = skeleton.vertices_of_nodes();
    let radius = |(members, place): (&Vec<u32>, &Vec3)| {
        median_distance(&positions_of(vertices, members), place)
    };
    let radii = groups.iter().zip(&places).map(radius).collect();
    let labels = skeleton.node_of_vertex().to_vec();
    CurveSkeleton::new(places, radii, skeleton.edges().to_vec(), labels)
        .expect("only radii are others, and they are finite")
}

/// One skeleton of all parts, for all points.
fn joined(
    places: &Places,
    surface: &Surface,
    parts: &[Vec<u32>],
    found: Vec<Part>,
) -> ContractionSkeleton {
    let n_places = places.positions.len();
    let (mut nodes, mut radii, mut edges) = (Vec::new(), Vec::new(), Vec::new());
    let mut node_of_place = vec![NO_NODE; n_places];
    let mut contracted = places.positions.clone();
    let mut reports = Vec::new();
    for (points, part) in parts.iter().zip(found) {
        let first = nodes.len() as u32;
        for (point, &place) in points.iter().enumerate() {
            let node = part.skeleton.node_of_vertex()[point];
            node_of_place[place as usize] = first + node;
            contracted[place as usize] = part.contraction.positions[point];
        }
        nodes.extend_from_slice(part.skeleton.positions());
        radii.extend_from_slice(part.skeleton.radii());
        edges.extend(part.skeleton.edges().iter().map(|it| it.map(|node| first + node)));
        let Contraction { steps, stop, .. } = part.contraction;
        reports.push(PartReport { n_points: points.len(), steps, stop });
    }
    let labels: Vec<u32> = places.spread(&node_of_place);
    ContractionSkeleton {
        n_lost: labels.iter().filter(|it| **it == NO_NODE).count(),
        skeleton: CurveSkeleton::new(nodes, radii, edges, labels).expect("skeletons of the parts"),
        parts: reports,
        n_duplicates: places.place_of_point.len() - n_places,
        contracted: places.spread(&contracted),
        normals: places.spread(&surface.normals),
    }
}
