//! Skin weights of one rigged body for another, by textures around the bones of both.

mod assign;
mod atlas;
mod bones;
mod copy;
mod pack;
mod phase;
mod read;
mod rectangle;
#[cfg(test)]
mod tests;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use self::atlas::Atlas;
use self::bones::{bones, follow_references};
use self::copy::{Copy, Piece, pieces};
use self::phase::best_shift;
use self::read::{Copied, Reader};
use self::rectangle::Rectangle;
use crate::kernels::geometry::mesh::{MeshError, TriMesh};
use crate::kernels::geometry::triangle_tree::TriangleTree;
use crate::kernels::image::Image;
use crate::kernels::rigs::limit_influences::limit_influences;
use crate::kernels::rigs::segment_map::SegmentMap;
use crate::kernels::rigs::skeleton::Skeleton;
use crate::kernels::rigs::skin_weights::{SkinWeightsError, SkinWeightsOptions, skin_weights};
use crate::kernels::rigs::weights::{SkinWeights, WeightsError};
use crate::kernels::transfer::transfer_weights::smooth::{Neighbours, diffuse};

/// What a texel holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Texels {
    /// The weights of all joints that occur around the bone, which are filtered linearly.
    #[default]
    AllJoints,
    /// The four joints of the largest weights, as in a texture of indices and one of weights: they
    /// cannot be filtered, and the nearest texel is taken.
    TopFour,
}

/// What [`skeleton_texture`] does.
#[derive(Debug, Clone, PartialEq)]
pub struct SkeletonTextureOptions {
    /// Texels along a side of the texture.
    pub resolution: usize,
    pub texels: Texels,
    /// Whether each bone's angles are shifted so that the surfaces around both bones fit best.
    pub correct_phase: bool,
    /// Steps of diffusion over the target's edges, which close seams between rectangles.
    pub smoothing: usize,
    /// The joints kept a vertex, the heaviest; 0 for all.
    pub max_influences: usize,
    /// Smaller weights are dropped.
    pub least_weight: f64,
    /// If less than this share of either surface sees its skeleton, the weights are those of heat
    /// diffusion from the target's bones.
    pub least_covered: f64,
}

impl Default for SkeletonTextureOptions {
    fn default() -> Self {
        Self {
            resolution: 1024,
            texels: Texels::default(),
            correct_phase: false,
            smoothing: 1,
            max_influences: 0,
            least_weight: 1e-4,
            least_covered: 0.5,
        }
    }
}

/// Weights, and how they came about.
#[derive(Debug, Clone, PartialEq)]
pub struct SkeletonTexture {
    pub weights: SkinWeights,
    pub source: Side,
    pub target: Side,
    /// Whether the weights are not from the texture, because a skeleton is not reliable.
    pub fell_back: bool,
    /// Bones of the target that follow nothing and have the weights at the end of the bone above.
    pub n_inherited: usize,
    /// Bones whose angles are shifted.
    pub n_shifted: usize,
}

/// A body and its texture.
#[derive(Debug, Clone, PartialEq)]
pub struct Side {
    pub n_vertices: usize,
    /// Vertices that see a bone.
    pub n_covered: usize,
    pub n_bones: usize,
    /// Bones that have vertices.
    pub n_used_bones: usize,
    pub texels_per_length: f64,
    /// The weights, a hue for each of the source's joints.
    pub texture: Image,
}

/// Why there are no weights.
#[derive(Debug, thiserror::Error)]
pub enum SkeletonTextureError {
    #[error("the source has {n_vertices} vertices, but its weights {n_rows} rows")]
    Vertices { n_vertices: usize, n_rows: usize },
    #[error("the source skeleton has {skeleton} joints, but the weights {weights}")]
    Joints { skeleton: usize, weights: usize },
    #[error(
        "the map leads from {map_target} joints to {map_source}, but the target has {target} and the \
         source {source_joints}"
    )]
    Map { map_target: usize, map_source: usize, target: usize, source_joints: usize },
    #[error("the {whose} skeleton has no bone of any length")]
    NoBones { whose: &'static str },
    #[error(transparent)]
    Mesh(#[from] MeshError),
    #[error(transparent)]
    Weights(#[from] WeightsError),
    #[error(transparent)]
    Heat(#[from] SkinWeightsError),
}

/// A rigged body.
pub type Source<'a> = (&'a TriMesh, &'a Skeleton, &'a SkinWeights);

/// Transfers skin weights by skeleton texture mapping (Madaras et al. 2014, section 7).
///
/// Both surfaces are unrolled around their bones: a vertex belongs to the nearest bone that it sees, and
/// has a place along and an angle around it; angles count from directions that follow each other by
/// the map. The source's weights are drawn into a rectangle for each bone, copied to those of the target
/// by the map (in parts, or several in a row), and read where the target's vertices are. A weight of the
/// source's joint goes to the joint where the target's bone begins, if it is that of the bone, and
/// otherwise to the joint that ends the target's bone of the same end.
///
/// # Errors
/// See [`SkeletonTextureError`].
pub fn skeleton_texture(
    (source_mesh, source, weights): Source<'_>,
    (target_mesh, target): (&TriMesh, &Skeleton),
    map: &SegmentMap,
    options: &SkeletonTextureOptions,
) -> Result<SkeletonTexture, SkeletonTextureError> {
    check((source_mesh, source, weights), (target_mesh, target), map)?;
    let trees = [source_mesh, target_mesh].map(TriangleTree::new);
    let source_bones = bones(source, &trees[0]);
    let mut target_bones = bones(target, &trees[1]);
    for (bones, whose) in [(&source_bones, "source"), (&target_bones, "target")] {
        if bones.is_empty() {
            return Err(SkeletonTextureError::NoBones { whose });
        }
    }
    follow_references(&mut target_bones, target, (&source_bones, source), map);
    let pieces = pieces((source, &source_bones), (target, &target_bones), map);
    let source_atlas = Atlas::new(source_mesh, &trees[0], source_bones, options.resolution);
    let target_atlas = Atlas::new(target_mesh, &trees[1], target_bones, options.resolution);
    let mut drawn = source_atlas.write(&weights.to_rows());
    if options.texels == Texels::TopFour {
        drawn.iter_mut().flatten().for_each(|it| it.limit_channels(4));
    }
    let shifts = shifts(&source_atlas, &target_atlas, &pieces, options.correct_phase);
    let copied = Copied::new(&source_atlas, &target_atlas, &drawn, &pieces, &shifts, options);
    let reader = Reader { source, target, map, atlas: &target_atlas, copied: &copied };
    let sides = [side(&source_atlas, &drawn), side(&target_atlas, &copied.rectangles)];
    let share = |it: &Side| it.n_covered as f64 / it.n_vertices as f64;
    let fell_back = sides.iter().any(|it| share(it) < options.least_covered);
    let weights = if fell_back {
        skin_weights(target_mesh, target, &SkinWeightsOptions::default())?.weights
    } else {
        smoothed(reader.weights(options)?, target_mesh, options)?
    };
    let weights = match options.max_influences {
        0 => weights,
        count => limit_influences(&weights, count).0,
    };
    let [source, target] = sides;
    let n_inherited = pieces.iter().filter(|it| it.is_empty()).count();
    let n_shifted = shifts.iter().filter(|&&it| it != 0.0).count();
    Ok(SkeletonTexture { weights, source, target, fell_back, n_inherited, n_shifted })
}

fn smoothed(
    weights: SkinWeights,
    mesh: &TriMesh,
    options: &SkeletonTextureOptions,
) -> Result<SkinWeights, WeightsError> {
    if options.smoothing == 0 {
        return Ok(weights);
    }
    let mut columns = vec![vec![0.0; weights.n_vertices()]; weights.n_joints()];
    for vertex in 0..weights.n_vertices() {
        weights.row(vertex).for_each(|(joint, it)| columns[joint as usize][vertex] = it);
    }
    diffuse(&Neighbours::of(mesh), &mut columns, options.smoothing);
    let row = |vertex: usize| {
        let of = columns.iter().enumerate().map(|(joint, it)| (joint as u32, it[vertex]));
        of.filter(|it| it.1 >= options.least_weight).collect::<Vec<_>>()
    };
    let rows: Vec<_> = (0..weights.n_vertices()).map(row).collect();
    SkinWeights::from_rows(weights.n_joints(), &rows)
}

fn check(
    (source_mesh, source, weights): Source<'_>,
    (target_mesh, target): (&TriMesh, &Skeleton),
    map: &SegmentMap,
) -> Result<(), SkeletonTextureError> {
    use SkeletonTextureError as E;
    source_mesh.check_has_faces()?;
    target_mesh.check_has_faces()?;
    let (n_vertices, n_rows) = (source_mesh.n_vertices(), weights.n_vertices());
    if n_vertices != n_rows {
        return Err(E::Vertices { n_vertices, n_rows });
    }
    if source.n_joints() != weights.n_joints() {
        return Err(E::Joints { skeleton: source.n_joints(), weights: weights.n_joints() });
    }
    let (map_target, map_source) = (map.segments().len(), map.n_source());
    let (target, source_joints) = (target.n_joints(), source.n_joints());
    match map_target == target && map_source == source_joints {
        true => Ok(()),
        false => Err(E::Map { map_target, map_source, target, source_joints }),
    }
}

fn side(atlas: &Atlas<'_>, rectangles: &[Option<Rectangle>]) -> Side {
    let mut used = vec![false; atlas.bones.len()];
    atlas.assignment.bone_of_vertex.iter().for_each(|&it| used[it as usize] = true);
    Side {
        n_vertices: atlas.mesh.n_vertices(),
        n_covered: atlas.assignment.n_covered,
        n_bones: atlas.bones.len(),
        n_used_bones: used.iter().filter(|&&it| it).count(),
        texels_per_length: atlas.packing.scale,
        texture: atlas.picture(rectangles),
    }
}

/// By target bone: how far its angles are turned against those of the source.
fn shifts(
    source: &Atlas<'_>,
    target: &Atlas<'_>,
    pieces: &[Vec<Piece>],
    correct: bool,
) -> Vec<f64> {
    if !correct {
        return vec![0.0; pieces.len()];
    }
    let radii = |atlas: &Atlas<'_>| {
        let of = |vertex| vec![(0, atlas.place(vertex).radius)];
        let values: Vec<_> = (0..atlas.mesh.n_vertices()).map(of).collect();
        atlas.write(&values)
    };
    let (source_radii, target_radii) = (radii(source), radii(target));
    let copy = Copy { source_bones: &source.bones, rectangles: &source_radii, shift: 0.0 };
    let of_bone = |(index, pieces): (usize, &Vec<Piece>)| {
        let own = target_radii[index].as_ref()?;
        if pieces.is_empty() || pieces.iter().any(|it| source_radii[it.bone].is_none()) {
            return None;
        }
        Some(best_shift(&copy.rectangle(pieces, target.grid(index), false), own))
    };
    pieces.iter().enumerate().map(|it| of_bone(it).unwrap_or(0.0)).collect()
}
