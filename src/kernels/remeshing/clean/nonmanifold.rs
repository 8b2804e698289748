//! Edges of three and more faces, and vertices where surfaces only touch.

use std::collections::BTreeMap;

use super::Repair;
use crate::kernels::geometry::topology::{Edges, Fans};

impl Repair {
    pub(super) fn drop_fins(&mut self) {
        loop {
            let edges = Edges::of(&self.faces);
            let mut touches = vec![(false, false); self.faces.len()];
            for sides in edges.iter() {
                for it in sides {
                    touches[it.face as usize].0 |= sides.len() > 2;
                    touches[it.face as usize].1 |= sides.len() == 1;
                }
            }
            let n_faces = self.faces.len();
            let mut fins = touches.iter().map(|&(hangs, is_free)| hangs && is_free);
            let is_fin: Vec<bool> = fins.by_ref().collect();
            // An open sheet that is all fins (three leaves on one edge) is a surface, not debris.
            if !is_fin.contains(&true) || is_fin.iter().filter(|it| **it).count() * 2 > n_faces {
                return;
            }
            let mut drop = is_fin.into_iter();
            self.faces.retain(|_| !drop.next().expect("as many as faces"));
            self.report.n_fin_faces += n_faces - self.faces.len();
        }
    }

    /// Gives every fan of faces at a vertex a vertex of its own (Gueziec et al. 2001, "cutting").
    pub(super) fn split(&mut self) {
        let edges = Edges::of(&self.faces);
        let fans = Fans::of(&self.faces, &edges, |n_faces| n_faces == 2);
        let mut vertex_of_fan = BTreeMap::new();
        for at_vertex in fans.by_vertex().chunk_by(|a, b| a.0 == b.0) {
            for &(vertex, fan) in &at_vertex[1..] {
                vertex_of_fan.insert(fan, self.vertices.len() as u32);
                self.vertices.push(self.vertices[vertex as usize]);
                self.old_of_vertex.push(self.old_of_vertex[vertex as usize]);
            }
        }
        for (corner, vertex) in self.faces.iter_mut().flatten().enumerate() {
            if let Some(&copy) = vertex_of_fan.get(&fans.fan_of_corner[corner]) {
                *vertex = copy;
            }
        }
        self.report.n_split_vertices = vertex_of_fan.len();
    }
}
