//! What scans have and models have not: noise, clothes, holes, hidden sides, touching parts.

mod bridges;
mod clothes;
mod holes;
mod noise;
mod visible;

pub use bridges::{Bridges, bridges};
pub use clothes::clothes;
pub use holes::cut_holes;
pub use noise::displaced;
pub use visible::visible_faces;

use crate::kernels::{
    geometry::mesh::{MeshError, TriMesh, Vec3},
    numerics::random::Random,
    remeshing::resampled::Resampled,
};

/// What is done to a mesh, in the order of the fields.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct DegradeOptions {
    /// How far clothes stand off, over the square root of the area.
    pub clothes: f64,
    /// The number of places where parts that come near each other are grown together.
    pub n_bridges: usize,
    /// Directions from which the surface is seen; nothing else stays. None: all stays.
    pub visible_from: Vec<Vec3>,
    pub n_holes: usize,
    /// Over the square root of the area.
    pub hole_radius: f64,
    /// The deviation of displacements along the normals, over the mean edge length.
    pub noise: f64,
    pub seed: u64,
}

/// Why a mesh cannot be degraded as asked.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DegradeError {
    #[error("vertex {vertex} is to be kept, but the mesh has {n_vertices} vertices")]
    Protected { vertex: u32, n_vertices: usize },
    #[error("{asked} holes were asked for, but only {possible} find room")]
    Holes { asked: usize, possible: usize },
    #[error("{asked} bridges were asked for, but only {possible} parts come near each other")]
    Bridges { asked: usize, possible: usize },
    #[error("a direction of view is zero")]
    NoDirection,
    #[error("nothing is visible")]
    NothingVisible,
    #[error(transparent)]
    Mesh(#[from] MeshError),
}

/// Degrades a mesh. `protected` vertices (landmarks) keep their faces, except where they cannot be seen.
///
/// # Errors
/// See [`DegradeError`].
pub fn degrade(
    mesh: &TriMesh,
    protected: &[u32],
    options: &DegradeOptions,
) -> Result<Resampled, DegradeError> {
    mesh.check_has_faces()?;
    let n_vertices = mesh.n_vertices();
    if let Some(&vertex) = protected.iter().find(|&&it| it as usize >= n_vertices) {
        return Err(DegradeError::Protected { vertex, n_vertices });
    }
    let unit = mesh.area().sqrt();
    let stream = |purpose: &str| Random::stream(options.seed, purpose);
    let mut dressed = mesh.clone();
    if options.clothes > 0.0 {
        dressed = clothes(mesh, protected, options.clothes * unit, &mut stream("clothes"))?;
    }
    let mut faces = dressed.faces().to_vec();
    if options.n_bridges > 0 {
        faces = bridges(&dressed, protected, &Bridges::new(options.n_bridges))?;
    }
    let bridged = TriMesh::new(dressed.vertices().to_vec(), faces)?;
    let mut faces = bridged.faces().to_vec();
    if !options.visible_from.is_empty() {
        let seen = visible_faces(&bridged, &options.visible_from)?;
        faces = faces.into_iter().zip(seen).filter(|it| it.1).map(|it| it.0).collect();
        if faces.is_empty() {
            return Err(DegradeError::NothingVisible);
        }
    }
    if options.n_holes > 0 {
        let (asked, radius) = (options.n_holes, options.hole_radius * unit);
        let part = TriMesh::new(bridged.vertices().to_vec(), faces)?;
        let (left, possible) = cut_holes(&part, protected, asked, radius, &mut stream("holes"));
        if possible < asked {
            return Err(DegradeError::Holes { asked, possible });
        }
        faces = left;
    }
    let mut res = Resampled::of_faces(&bridged, &faces)?;
    if options.noise > 0.0 {
        res.mesh = displaced(&res.mesh, options.noise, &mut stream("noise"));
    }
    Ok(res)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes::{icosphere, moved, union};
    use crate::kernels::geometry::topology::Topology;

    #[test]
    fn nothing_asked_changes_nothing() {
        let sphere = icosphere(3);
        let same = degrade(&sphere, &[], &DegradeOptions::default()).unwrap();
        assert_eq!(same.mesh, sphere);
    }

    #[test]
    fn a_sphere_shows_half_of_itself() {
        let sphere = icosphere(4);
        let options = DegradeOptions { visible_from: vec![Vec3::z()], ..Default::default() };
        let half = degrade(&sphere, &[], &options).unwrap();
        let share = half.mesh.area() / sphere.area();
        assert!((0.44..0.51).contains(&share), "{share}");
        assert!(half.mesh.vertices().iter().all(|it| it.z > -0.05));
        // A second sphere behind the first cannot be seen at all.
        let behind = union(&sphere, &moved(&sphere, Vec3::new(0.0, 0.0, -3.0)));
        let both = degrade(&behind, &[], &options).unwrap().mesh.n_faces() as f64;
        // The pixels of the rim are others.
        assert!((both / half.mesh.n_faces() as f64 - 1.0).abs() < 0.01);
    }

    #[test]
    fn a_bridge_joins_what_is_near_and_apart() {
        let sphere = icosphere(3);
        let two = union(&sphere, &moved(&sphere, Vec3::new(2.05, 0.0, 0.0)));
        let options = DegradeOptions { n_bridges: 1, ..Default::default() };
        let one = degrade(&two, &[], &options).unwrap();
        let topology = Topology::of(&one.mesh);
        assert_eq!(topology.n_components, 1);
        assert!(topology.is_manifold());
        assert_eq!(topology.n_boundary_edges, 0, "a closed tube");
        let error = degrade(&sphere, &[], &options).unwrap_err().to_string();
        assert_eq!(error, "1 bridges were asked for, but only 0 parts come near each other");
    }

    #[test]
    fn holes_and_clothes_spare_the_protected() {
        let sphere = icosphere(4);
        let options = DegradeOptions {
            n_holes: 4,
            hole_radius: 0.06,
            clothes: 0.02,
            noise: 0.05,
            ..Default::default()
        };
        let res = degrade(&sphere, &[0], &options).unwrap();
        assert_eq!(Topology::of(&res.mesh).n_components, 1);
        assert!(res.mesh.area() < sphere.area() * 1.2);
        let kept = res.new_of_old[0].unwrap() as usize;
        let edge = 0.07;
        assert!((res.mesh.vertices()[kept] - sphere.vertices()[0]).norm() < 5.0 * 0.05 * edge);
        let error = degrade(&sphere, &[9999], &options).unwrap_err().to_string();
        assert_eq!(error, "vertex 9999 is to be kept, but the mesh has 2562 vertices");
        let many = DegradeOptions { n_holes: 900, ..options };
        assert!(matches!(degrade(&sphere, &[0], &many), Err(DegradeError::Holes { .. })));
    }
}
