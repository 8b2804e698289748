//! Curves in the middle of the shape around them.

mod circle_fit;
mod folds;
mod passages;
mod rays;
mod rounds;
mod sections;
mod short_edges;
#[cfg(test)]
mod tests;

use super::super::curve_skeleton::CurveSkeleton;
use crate::kernels::geometry::distance_field::DistanceField;
use crate::kernels::geometry::mesh::Vec3;

use folds::without_folds;
use passages::passages;
use rays::Rays;
use rounds::moved;
use sections::Sections;
use short_edges::Split;

/// How nodes are moved to the middle.
#[derive(Debug, Clone, PartialEq)]
pub struct CenterOptions {
    /// Edges longer than so many radii of the shape around them get new nodes.
    pub max_edge: f64,
    /// How often nodes are moved.
    pub rounds: usize,
}

impl Default for CenterOptions {
    fn default() -> Self {
        Self { max_edge: 0.6, rounds: 6 }
    }
}

/// Moves curves to the middle of the shape, as it is seen from them.
///
/// Long edges get new nodes. Then, some times over, every node between two others looks across the
/// curve, at right angles to the line between its neighbours, and moves to the middle of what is there:
/// of a closed surface, whose distances are `field`, to where rays go equally far, without it to the
/// middle of the circle that the points around it fit best. A junction looks across its trunk; the
/// roots of its limbs, across which there is no middle, become straight. Nodes slide to the middle of
/// their neighbours along the curve, for which they stay apart. Where the curve turns back the line
/// tells no direction; such a node moves to the middle of its neighbours, and goes in the end if it has
/// no vertices and is still turned back.
///
/// Leaves and nodes outside of the surface stay; no node moves through the surface, and no edge that is
/// inside comes to leave it. Vertices of a node go to the nearest of it and the new nodes beside it, up
/// to the middles of its edges.
pub fn center(
    skeleton: &CurveSkeleton,
    vertices: &[Vec3],
    field: Option<&DistanceField>,
    options: &CenterOptions,
) -> CurveSkeleton {
    let split = Split::new(skeleton, options.max_edge);
    let Some(field) = field else {
        let all: Vec<u32> = (0..split.curves.n_nodes() as u32).collect();
        let labelled = split.labelled(&split.curves, vertices, &all);
        let points = Sections::new(&labelled, vertices);
        return centered(&split, split.curves.clone(), vertices, &points, options.rounds);
    };
    let inside = rays::with_new_inside(&split.curves, skeleton.n_nodes(), field);
    centered(&split, inside, vertices, &Rays::new(field), options.rounds)
}

fn centered(
    split: &Split,
    mut curves: CurveSkeleton,
    vertices: &[Vec3],
    shape: &dyn Surroundings,
    n_rounds: usize,
) -> CurveSkeleton {
    let neighbors = curves.neighbors();
    let is_free: Vec<bool> = curves.positions().iter().map(|it| !shape.is_outside(*it)).collect();
    let mut looks = vec![None; curves.n_nodes()];
    for _ in 0..n_rounds {
        let passages = passages(&curves, &neighbors, &is_free);
        curves = moved(&curves, &passages, &mut looks, shape);
    }
    let (kept, new_of_old) = without_folds(&curves, shape);
    split.labelled(&kept, vertices, &new_of_old)
}

/// What is around curves: a surface, or points.
trait Surroundings: Sync {
    /// What a node sees across the curve; none if there is no middle.
    fn look(&self, view: &View) -> Option<Look>;

    /// Whether the segment between two places is known to leave the shape.
    fn is_crossed(&self, from: Vec3, to: Vec3) -> bool;

    /// Whether a place is known to be outside of the shape.
    fn is_outside(&self, place: Vec3) -> bool;
}

/// From where, and where to, a node looks.
#[derive(Debug, Clone, Copy)]
struct View {
    node: usize,
    place: Vec3,
    /// Where the curve leads, of length one.
    along: Vec3,
    /// Of the shape around the node.
    radius: f64,
    /// How far it was to the shape when the node looked last; infinite if it never did.
    last_reach: f64,
}

impl View {
    /// Two directions across the curve, at right angles to each other.
    fn across(&self) -> [Vec3; 2] {
        let side = self.along.cross(&Vec3::ith(self.along.iamin(), 1.0)).normalize();
        [side, self.along.cross(&side)]
    }
}

/// What a node saw across the curve.
#[derive(Debug, Clone, Copy)]
struct Look {
    /// The next step to the middle.
    shift: Vec3,
    /// How far it is to the shape.
    reach: f64,
}
