use super::*;
use crate::kernels::geometry::shapes::{icosphere, moved, signed_volume, torus, union};

fn cleaned(mesh: &TriMesh, options: &CleanOptions) -> (Resampled, CleanReport) {
    clean(mesh, options).unwrap()
}

fn with_faces(mesh: &TriMesh, faces: Vec<[u32; 3]>) -> TriMesh {
    TriMesh::new(mesh.vertices().to_vec(), faces).unwrap()
}

/// Every face with vertices of its own.
fn soup(mesh: &TriMesh) -> TriMesh {
    let vertices = (0..mesh.n_faces()).flat_map(|it| mesh.corners(it)).collect();
    let faces = (0..mesh.n_faces() as u32).map(|it| [3 * it, 3 * it + 1, 3 * it + 2]);
    TriMesh::new(vertices, faces.collect()).unwrap()
}

#[test]
fn a_clean_mesh_stays_as_it_is() {
    for mesh in [icosphere(2), torus(2.0, 0.5, 12, 8)] {
        let (same, report) = cleaned(&mesh, &CleanOptions::default());
        assert_eq!(same.mesh, mesh);
        assert_eq!(report.before, report.after);
        assert_eq!(same.function(&vec![2.0; mesh.n_vertices()]), vec![2.0; mesh.n_vertices()]);
    }
}

#[test]
fn a_soup_of_triangles_becomes_the_surface_at_three_scales() {
    for scale in [1e-8, 1.0, 1e8] {
        for weld in [0.0, 1e-6] {
            let mesh = torus(2.0, 0.5, 12, 8);
            let vertices = mesh.vertices().iter().map(|it| it * scale).collect();
            let mesh = mesh.with_vertices(vertices).unwrap();
            let options = CleanOptions { weld: Some(weld), ..Default::default() };
            let (welded, report) = cleaned(&soup(&mesh), &options);
            assert_eq!(report.after.genus, Some(1));
            assert_eq!(welded.mesh.n_vertices(), mesh.n_vertices());
            assert_eq!(report.n_welded_vertices, 3 * mesh.n_faces() - mesh.n_vertices());
            assert!((welded.mesh.area() / mesh.area() - 1.0).abs() < 1e-12);
        }
    }
}

#[test]
fn repeated_and_collapsed_faces_and_stray_vertices_go() {
    let mesh = icosphere(1);
    let mut vertices = mesh.vertices().to_vec();
    vertices.push(Vec3::x() * 1e6);
    let mut faces = mesh.faces().to_vec();
    let [a, b, c] = faces[3];
    faces.extend([[b, c, a], [b, a, c], [a, a, b]]);
    let (found, report) =
        cleaned(&TriMesh::new(vertices, faces).unwrap(), &CleanOptions::default());
    assert_eq!(found.mesh, mesh);
    assert_eq!((report.n_duplicate_faces, report.n_collapsed_faces), (2, 1));
    assert_eq!((report.n_unreferenced_vertices, found.new_of_old.last()), (1, Some(&None)));
}

#[test]
fn a_flat_face_is_flipped_away_without_a_slit() {
    // Vertex 4 lies on the diagonal 0-2 of the square.
    let mut vertices: Vec<Vec3> = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
        .map(|[x, y]| Vec3::new(x, y, 0.0))
        .to_vec();
    vertices.push(Vec3::new(0.5, 0.5, 0.0));
    // The sliver 0-4-2 lies between the two halves of the square.
    let faces = vec![[0, 1, 2], [0, 2, 4], [0, 4, 3], [4, 2, 3]];
    let mesh = TriMesh::new(vertices, faces).unwrap();
    let (found, report) = cleaned(&mesh, &CleanOptions::default());
    assert_eq!(report.n_flat_faces, 1);
    assert_eq!(report.after.n_boundary_edges, 4);
    assert_eq!((report.after.euler_characteristic, report.after.n_components), (1, 1));
    assert!((found.mesh.area() - 1.0).abs() < 1e-12);
    let smallest = (0..found.mesh.n_faces()).map(|it| found.mesh.area_vector(it).norm());
    assert!(smallest.fold(1.0, f64::min) > 0.2);
}

#[test]
fn an_inside_out_half_is_turned_outward() {
    for mesh in [icosphere(2), torus(2.0, 0.5, 12, 8)] {
        let turn = |(index, &[a, b, c]): (usize, &[u32; 3])| {
            if index % 3 > 0 { [a, c, b] } else { [a, b, c] }
        };
        let faces = mesh.faces().iter().enumerate().map(turn).collect();
        let (found, report) = cleaned(&with_faces(&mesh, faces), &CleanOptions::default());
        assert!(report.after.is_oriented);
        assert!((signed_volume(&found.mesh) - signed_volume(&mesh)).abs() < 1e-12);
        assert!(report.n_turned_faces > mesh.n_faces() / 2);
    }
}

#[test]
fn the_largest_part_stays_with_its_values() {
    let far = moved(&torus(2.0, 0.5, 12, 8), Vec3::x() * 9.0);
    let both = union(&icosphere(1), &far);
    let (found, report) = cleaned(&both, &CleanOptions::default());
    assert_eq!((report.n_removed_components, &found.mesh), (1, &far));
    let x: Vec<f64> = both.vertices().iter().map(|it| it.x).collect();
    let expected: Vec<f64> = far.vertices().iter().map(|it| it.x).collect();
    assert_eq!(found.function(&x), expected);
    let all = CleanOptions { keep: Keep::All, ..Default::default() };
    assert_eq!(cleaned(&both, &all).0.mesh, both);
}

#[test]
fn fins_go_and_touching_surfaces_are_cut_apart() {
    let sphere = icosphere(2);
    // A second sphere whose vertex 0 is the first one's, and a fin on an edge of the first.
    let second = moved(&sphere, sphere.vertices()[0] * 3.0);
    let shift = sphere.n_vertices() as u32;
    let both = union(&sphere, &second);
    let merge = |it: u32| if it == shift { 0 } else { it };
    let mut faces: Vec<[u32; 3]> = both.faces().iter().map(|it| it.map(merge)).collect();
    let [a, b, _] = faces[7];
    faces.push([a, b, shift]);
    let mut vertices = both.vertices().to_vec();
    vertices[shift as usize] = Vec3::y() * 3.0;
    let mesh = TriMesh::new(vertices, faces).unwrap();
    let before = Topology::of(&mesh);
    assert_eq!((before.n_nonmanifold_edges, before.n_nonmanifold_vertices), (1, 1));
    let options = CleanOptions { keep: Keep::All, ..Default::default() };
    let (_, report) = cleaned(&mesh, &options);
    assert_eq!((report.n_fin_faces, report.n_split_vertices), (1, 1));
    assert!(report.after.is_manifold() && report.after.is_closed);
    assert_eq!((report.after.n_components, report.after.genus), (2, Some(0)));
    let keep = CleanOptions { nonmanifold: Nonmanifold::Keep, ..options.clone() };
    assert_eq!(cleaned(&mesh, &keep).1.after.n_nonmanifold_edges, 1);
    let split = CleanOptions { nonmanifold: Nonmanifold::Split, ..options };
    let (_, report) = cleaned(&mesh, &split);
    assert!(report.after.is_manifold());
    assert_eq!((report.n_fin_faces, report.after.n_faces), (0, mesh.n_faces()));
}

#[test]
fn a_moebius_band_is_reported_as_unorientable() {
    let n = 12u32;
    let vertices = (0..2 * n)
        .map(|it| {
            let u = f64::from(it / 2) / f64::from(n) * std::f64::consts::TAU;
            let v = if it % 2 == 0 { -0.3 } else { 0.3 };
            let radius = 1.0 + v * (u / 2.0).cos();
            Vec3::new(radius * u.cos(), v * (u / 2.0).sin(), radius * u.sin())
        })
        .collect();
    let faces = (0..n).flat_map(|it| {
        let [a, b] = [2 * it, 2 * it + 1];
        let [c, d] = if it + 1 < n { [a + 2, b + 2] } else { [1, 0] };
        [[a, b, d], [a, d, c]]
    });
    let mesh = TriMesh::new(vertices, faces.collect()).unwrap();
    let (_, report) = cleaned(&mesh, &CleanOptions::default());
    assert_eq!(report.n_unorientable_edges, 1);
    assert_eq!((report.after.n_boundary_loops, report.after.euler_characteristic), (1, 0));
}

#[test]
fn nothing_but_points_is_refused() {
    let mesh = TriMesh::new(vec![Vec3::x(); 3], vec![[0, 1, 2]]).unwrap();
    let error = clean(&mesh, &CleanOptions::default()).unwrap_err();
    assert_eq!(error.to_string(), "no face of 1 has an area");
}

/// A mesh of the corpus (binary little-endian `.ply` of floats and triangles), or none without it.
fn corpus(name: &str) -> Option<TriMesh> {
    let root = std::env::var_os("SINEW_CORPUS").map_or_else(
        || std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"),
        Into::into,
    );
    let path = root.join("meshes_plain/defective").join(name);
    let Ok(bytes) = std::fs::read(&path) else {
        println!("skipped: no corpus at {}", path.display());
        return None;
    };
    let body = bytes.windows(11).position(|it| it == b"end_header\n").unwrap() + 11;
    let header = std::str::from_utf8(&bytes[..body]).unwrap();
    let count = |element: &str| -> usize {
        let line = header.lines().find_map(|it| it.strip_prefix(element)).unwrap();
        line.trim().parse().unwrap()
    };
    let (n_vertices, n_faces) = (count("element vertex"), count("element face"));
    let (points, faces) = bytes[body..].split_at(12 * n_vertices);
    let float = |it: &[u8]| f64::from(f32::from_le_bytes(it.try_into().unwrap()));
    let index = |it: &[u8]| u32::from_le_bytes(it.try_into().unwrap());
    let point = |it: &[u8]| Vec3::new(float(&it[..4]), float(&it[4..8]), float(&it[8..]));
    let face = |it: &[u8]| [index(&it[1..5]), index(&it[5..9]), index(&it[9..])];
    let faces: Vec<_> = faces.chunks_exact(13).map(face).collect();
    assert_eq!(faces.len(), n_faces);
    Some(TriMesh::new(points.chunks_exact(12).map(point).collect(), faces).unwrap())
}

/// Closed, oriented, one part, no handle: what every defect was made from.
#[track_caller]
fn assert_whole(name: &str, expect: impl Fn(&CleanReport) -> bool) {
    let Some(mesh) = corpus(name) else { return };
    let options = CleanOptions { fill_holes: 60, ..Default::default() };
    let (found, report) = cleaned(&mesh, &options);
    let facts = &report.after;
    assert!(facts.is_manifold() && facts.is_oriented && facts.is_closed, "{name}: {facts:?}");
    assert_eq!((facts.n_components, facts.genus), (1, Some(0)), "{name}");
    assert!(signed_volume(&found.mesh) > 0.0, "{name}");
    assert!(expect(&report), "{name}: {report:?}");
}

#[test]
fn broken_bodies_of_the_corpus_are_made_whole() {
    assert_whole("adult_m25_components.ply", |it| it.n_removed_components == 12);
    assert_whole("adult_m25_degenerate.ply", |it| it.before.n_collapsed_faces == 30);
    // 40 strays and the 40 vertices that the duplicates left without a face.
    assert_whole("adult_m25_duplicates.ply", |it| {
        (it.n_duplicate_faces, it.n_welded_vertices, it.n_unreferenced_vertices) == (200, 460, 80)
    });
    assert_whole("adult_m25_flipped.ply", |it| it.n_turned_faces == 3273);
    assert_whole("adult_m25_holes.ply", |it| {
        (it.n_removed_components, it.n_filled_holes) == (1, 9)
    });
    assert_whole("adult_m25_nonmanifold.ply", |it| {
        (it.n_fin_faces, it.n_split_vertices) == (25, 6)
    });
    assert_whole("horse_components.ply", |it| it.n_removed_components == 12);
    assert_whole("horse_holes.ply", |it| it.n_filled_holes == 9);
    assert_whole("horse_nonmanifold.ply", |it| (it.n_fin_faces, it.n_split_vertices) == (25, 6));
}
