use super::*;
use crate::kernels::geometry::mesh::TriMesh;
use crate::kernels::geometry::shapes::tube;

const RADIUS: f64 = 0.1;

/// A half tube about the y axis with one node for every three rings.
fn half_tube() -> (TriMesh, CurveSkeleton) {
    let mesh = tube(RADIUS, 1.0, 25, 30, 0.5);
    let labels: Vec<u32> = (0..mesh.n_vertices()).map(|it| (it / 75) as u32).collect();
    let mut positions = vec![Vec3::zeros(); 10];
    for (vertex, &node) in mesh.vertices().iter().zip(&labels) {
        positions[node as usize] += vertex / 75.0;
    }
    let edges = (1..10).map(|it| [it - 1, it]).collect();
    (mesh, CurveSkeleton::new(positions, vec![RADIUS; 10], edges, labels).unwrap())
}

fn options(lambda_cpp: f64, lambda_euc: f64, lambda_s: f64) -> PlacementOptions {
    PlacementOptions { lambda_cpp, lambda_euc, lambda_s, ..Default::default() }
}

/// The distances of all nodes from the axis.
fn off_axis(skeleton: &CurveSkeleton) -> Vec<f64> {
    skeleton.positions().iter().map(|it| it.xz().norm()).collect()
}

/// The normals of the tube, not those of its faces.
fn normals(mesh: &TriMesh) -> Vec<Vec3> {
    mesh.vertices().iter().map(|it| Vec3::new(it.x, 0.0, it.z) / RADIUS).collect()
}

fn placed(skeleton: &CurveSkeleton, options: &PlacementOptions) -> CurveSkeleton {
    let (mesh, _) = half_tube();
    place(skeleton, mesh.vertices(), &normals(&mesh), options).unwrap()
}

#[test]
fn half_a_tube_shows_its_axis_to_its_normals_only() {
    let (_, skeleton) = half_tube();
    for found in off_axis(&placed(&skeleton, &options(1.0, 0.0, 0.0))) {
        assert!(found < 1e-14, "{found} off the axis");
    }
    for (cpp, euc) in [(0.0, 1.0), (0.8, 0.2), (0.1, 0.9)] {
        // In the plane of symmetry the normals n and vertices v = r n give
        // (cpp (1 - mean n_z^2) + euc) z = euc mean v_z.
        let angles = (0..25).map(|it| std::f64::consts::PI * f64::from(it) / 24.0);
        let mean = angles.clone().map(f64::sin).sum::<f64>() / 25.0;
        let mean_square = angles.map(|it| it.sin().powi(2)).sum::<f64>() / 25.0;
        let expected = euc * RADIUS * mean / (cpp * (1.0 - mean_square) + euc);
        for found in off_axis(&placed(&skeleton, &options(cpp, euc, 0.0))) {
            assert!((found - expected).abs() < 1e-14, "{found} off the axis, not {expected}");
        }
    }
}

#[test]
fn stiff_edges_draw_nodes_together_and_relative_ones_at_any_density() {
    let (_, skeleton) = half_tube();
    let of = |options| placed(&skeleton, &options).total_length();
    let free = of(options(0.8, 0.2, 0.0));
    let once = of(PlacementOptions { counts_edges_twice: false, ..options(0.8, 0.2, 200.0) });
    let twice = of(options(0.8, 0.2, 200.0));
    assert!(twice < once && once < free, "{twice} {once} {free}");
    assert_eq!(once, of(options(0.8, 0.2, 100.0)));
    // 75 vertices a node.
    let relative = PlacementOptions { is_relative: true, ..options(0.8, 0.2, 2.0) };
    assert!((of(relative) - of(options(0.8, 0.2, 150.0))).abs() < 1e-12);
}

#[test]
fn plain_distances_bear_an_outlier() {
    let (mesh, skeleton) = half_tube();
    let mut vertices = mesh.vertices().to_vec();
    vertices[5 * 75 + 12].z += 5.0;
    let bent = mesh.with_vertices(vertices).unwrap();
    let worst = |norm| {
        let options = PlacementOptions { norm, ..options(0.0, 1.0, 0.0) };
        let [straight, bent] =
            [&mesh, &bent].map(|it| place(&skeleton, it.vertices(), &[], &options).unwrap());
        (straight.positions()[5] - bent.positions()[5]).norm()
    };
    let (squared, plain) = (worst(Norm::Squared), worst(Norm::Plain));
    assert!((squared - 5.0 / 75.0).abs() < 1e-9 && plain < 0.1 * squared, "{squared} {plain}");
}

#[test]
fn plain_distances_are_at_their_minimum() {
    let (mesh, skeleton) = half_tube();
    let options = PlacementOptions { norm: Norm::Plain, ..options(0.8, 0.2, 20.0) };
    let normals = normals(&mesh);
    let energy = |positions: &[Vec3]| {
        let data: f64 = (0..mesh.n_vertices())
            .map(|vertex| {
                let node = skeleton.node_of_vertex()[vertex] as usize;
                let offset = positions[node] - mesh.vertices()[vertex];
                let share = if node == 0 || node == 9 { 2.0 } else { 1.0 };
                share * (0.8 * offset.cross(&normals[vertex]).norm() + 0.2 * offset.norm())
            })
            .sum();
        let smooth: f64 = (1..10).map(|it| (positions[it] - positions[it - 1]).norm()).sum();
        data + 2.0 * 20.0 * smooth
    };
    let placed = placed(&skeleton, &options);
    let least = energy(placed.positions());
    for node in 0..10 {
        for axis in 0..3 {
            for step in [1e-3, -1e-3] {
                let mut moved = placed.positions().to_vec();
                moved[node][axis] += step;
                assert!(energy(&moved) > least, "node {node}, axis {axis}, {step}");
            }
        }
    }
}

#[test]
fn what_holds_nothing_is_named() {
    let (mesh, skeleton) = half_tube();
    let with = |skeleton: &CurveSkeleton, options: &PlacementOptions| {
        place(skeleton, mesh.vertices(), &normals(&mesh), options)
    };
    let without = CurveSkeleton::new(vec![Vec3::x()], vec![1.0], vec![], vec![]).unwrap();
    assert_eq!(
        with(&without, &PlacementOptions::default()).unwrap_err().to_string(),
        "the skeleton labels 0 vertices, but the shape has 750"
    );
    let error = with(&skeleton, &options(0.8, -1.0, 0.0)).unwrap_err();
    assert_eq!(error.to_string(), "`lambda_euc` is -1, which is no weight");
    let error = with(&skeleton, &options(0.0, 0.0, 1.0)).unwrap_err();
    assert!(matches!(error, PlacementError::Undetermined { .. }), "{error}");
    // A node of its own without vertices stays; one that is joined follows.
    let labels = vec![0; mesh.n_vertices()];
    let positions = vec![Vec3::zeros(), Vec3::x(), Vec3::z() * 7.0];
    let alone = CurveSkeleton::new(positions, vec![0.0; 3], vec![[0, 1]], labels).unwrap();
    let placed = with(&alone, &PlacementOptions::default()).unwrap();
    assert_eq!(placed.positions()[2], Vec3::z() * 7.0);
    assert!((placed.positions()[0] - placed.positions()[1]).norm() < 1e-9);
}
