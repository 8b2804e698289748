//! A surface unrolled around its skeleton.

use super::assign::{Assignment, assign};
use super::bones::{Bone, Place};
use super::pack::{Packing, pack_largest};
use super::rectangle::{Corner, Grid, Rectangle, Writer};
use crate::kernels::geometry::mesh::TriMesh;
use crate::kernels::geometry::triangle_tree::TriangleTree;
use crate::kernels::image::Image;
use crate::kernels::pictures::canvas::color::srgb_from_linear;
use crate::kernels::pictures::snapshot::colors::joint_color;

/// The bones of a surface, their vertices, and a rectangle for each.
pub struct Atlas<'a> {
    pub mesh: &'a TriMesh,
    pub bones: Vec<Bone>,
    pub assignment: Assignment,
    pub packing: Packing,
    /// The part of its axis that each bone's vertices lie at.
    spans: Vec<[f64; 2]>,
}

impl<'a> Atlas<'a> {
    /// Assigns vertices to bones, measures what lies around each, and lays out rectangles.
    pub fn new(mesh: &'a TriMesh, tree: &TriangleTree, bones: Vec<Bone>, side: usize) -> Self {
        let assignment = assign(mesh, tree, &bones);
        let mut spans = vec![[0.0_f64, 1.0_f64]; bones.len()];
        let mut radii = vec![(0.0, 0.0); bones.len()];
        for (vertex, &bone) in assignment.bone_of_vertex.iter().enumerate() {
            let bone = bone as usize;
            let place = bones[bone].place(mesh.vertices()[vertex]);
            spans[bone][0] = spans[bone][0].min(place.along);
            spans[bone][1] = spans[bone][1].max(place.along);
            radii[bone].0 += place.radius;
            radii[bone].1 += 1.0;
        }
        let length = |index: usize| {
            let (sum, count) = radii[index];
            let radius = if count > 0.0 { sum / count } else { 0.0 };
            let [low, high] = spans[index];
            [bones[index].length * (high - low), std::f64::consts::TAU * radius]
        };
        let lengths: Vec<[f64; 2]> = (0..bones.len()).map(length).collect();
        let packing = pack_largest(&lengths, side);
        Self { mesh, bones, assignment, packing, spans }
    }

    /// The texels of a bone.
    pub fn grid(&self, bone: usize) -> Grid {
        let [n_rows, n_columns] = self.packing.sizes[bone];
        Grid { span: self.spans[bone], n_rows, n_columns }
    }

    /// Where a vertex is around its bone.
    pub fn place(&self, vertex: usize) -> Place {
        let bone = self.assignment.bone_of_vertex[vertex] as usize;
        self.bones[bone].place(self.mesh.vertices()[vertex])
    }

    /// Writes values of vertices (by channel) to the rectangle of every bone; `None` where a bone has no
    /// vertices.
    ///
    /// Triangles across bones are written to all of them, so that rectangles fit together.
    pub fn write(&self, values: &[Vec<(u32, f64)>]) -> Vec<Option<Rectangle>> {
        let bone_of = &self.assignment.bone_of_vertex;
        let mut faces: Vec<Vec<[u32; 3]>> = vec![Vec::new(); self.bones.len()];
        for face in self.mesh.faces() {
            let mut bones = face.map(|it| bone_of[it as usize]).to_vec();
            bones.sort_unstable();
            bones.dedup();
            bones.iter().for_each(|&it| faces[it as usize].push(*face));
        }
        let mut vertices: Vec<Vec<u32>> = vec![Vec::new(); self.bones.len()];
        for (vertex, &bone) in bone_of.iter().enumerate() {
            vertices[bone as usize].push(vertex as u32);
        }
        (0..self.bones.len())
            .map(|it| self.write_bone(it, &faces[it], &vertices[it], values))
            .collect()
    }

    fn write_bone(
        &self,
        index: usize,
        faces: &[[u32; 3]],
        vertices: &[u32],
        values: &[Vec<(u32, f64)>],
    ) -> Option<Rectangle> {
        let bone = &self.bones[index];
        let all = faces.iter().flatten().chain(vertices);
        let mut channels: Vec<u32> =
            all.flat_map(|&it| values[it as usize].iter().map(|it| it.0)).collect();
        channels.sort_unstable();
        channels.dedup();
        let mut writer = Writer::new(self.grid(index), channels);
        let corner = |vertex: &u32| -> Corner<'_> {
            (bone.place(self.mesh.vertices()[*vertex as usize]), &values[*vertex as usize])
        };
        for face in faces {
            writer.triangle(bone, face.each_ref().map(corner));
        }
        vertices.iter().for_each(|it| writer.dot(corner(it)));
        writer.finish()
    }

    /// The rectangles where they are packed, a hue for each channel.
    pub fn picture(&self, rectangles: &[Option<Rectangle>]) -> Image {
        let side = self.packing.side;
        let mut pixels = vec![[32; 3]; side * side];
        for (rectangle, [top, left]) in rectangles.iter().zip(&self.packing.places) {
            let Some(it) = rectangle else { continue };
            let colors: Vec<_> = it.channels.iter().map(|&it| joint_color(it as usize)).collect();
            for row in 0..it.grid.n_rows {
                for column in 0..it.grid.n_columns {
                    let mut color = [0.0_f32; 3];
                    for (value, of) in it.texel(row, column).iter().zip(&colors) {
                        (0..3).for_each(|it| color[it] += *value as f32 * of[it]);
                    }
                    let srgb = color.map(|it| srgb_from_linear(it.clamp(0.0, 1.0)));
                    pixels[(top + row) * side + left + column] =
                        srgb.map(|it| (255.0 * it).round() as u8);
                }
            }
        }
        Image { width: side, height: side, pixels }
    }
}
