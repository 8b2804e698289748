use super::*;
use crate::kernels::curve_skeleton::NO_NODE;
use crate::kernels::mesh::{TriMesh, Vec3};
use crate::kernels::shapes::{icosphere, moved, torus, tube, union};

fn options(variant: Variant, sampling: bool) -> LocalSeparatorsOptions {
    LocalSeparatorsOptions { variant, sampling, seed: 0 }
}

const ALL: [(Variant, bool); 4] = [
    (Variant::Plain, true),
    (Variant::Plain, false),
    (Variant::Multiscale, true),
    (Variant::Multiscale, false),
];

/// Checks leaves, junctions and cycles by all variants, and returns the skeletons.
fn check(mesh: &TriMesh, expected: [usize; 4]) -> Vec<CurveSkeleton> {
    let graph = SpatialGraph::of_mesh(mesh);
    let of = |(variant, sampling): (Variant, bool)| {
        let it = local_separators(&graph, &options(variant, sampling));
        let found = [it.n_components(), it.leaves().len(), it.junctions().len(), it.n_cycles()];
        assert_eq!(found, expected, "{variant:?}, sampling {sampling}");
        it
    };
    ALL.map(of).to_vec()
}

#[test]
fn a_tube_is_a_path_along_its_axis() {
    for skeleton in check(&tube(0.1, 1.0, 24, 60, 1.0), [1, 2, 0, 0]) {
        assert!(skeleton.n_nodes() >= 14, "{} nodes", skeleton.n_nodes());
        // Near the rims curves may end at a side.
        for (node, position) in skeleton.positions().iter().enumerate() {
            if (0.2..0.8).contains(&position.y) {
                assert!(position.xz().norm() < 0.01, "{position} is off the axis");
                let radius = skeleton.radii()[node];
                assert!((radius - 0.1).abs() < 0.02, "radius {radius}");
            }
        }
        assert!(skeleton.node_of_vertex().iter().all(|&it| it != NO_NODE));
    }
}

#[test]
fn a_torus_is_one_cycle_of_all_its_rings() {
    for (skeleton, (variant, _)) in check(&torus(1.0, 0.3, 60, 24), [1, 0, 0, 1]).iter().zip(ALL) {
        let off = |it: &Vec3| (it.xz().norm() - 1.0).hypot(it.y);
        let worst = skeleton.positions().iter().map(off).fold(0.0, f64::max);
        assert!(worst < 0.09, "{worst} off the middle of the tube");
        if variant == Variant::Plain {
            assert_eq!(skeleton.n_nodes(), 60);
        }
    }
}

#[test]
fn an_open_strip_forks_at_both_ends() {
    check(&tube(0.1, 1.0, 24, 60, 0.5), [1, 4, 2, 0]);
}

#[test]
fn a_ball_has_no_curve() {
    for skeleton in check(&icosphere(3), [0; 4]) {
        assert_eq!(skeleton.n_nodes(), 0);
        assert_eq!(skeleton.node_of_vertex(), vec![NO_NODE; 642]);
    }
}

#[test]
fn every_part_has_its_own_curve() {
    let tube = tube(0.1, 1.0, 12, 30, 1.0);
    let two = union(&tube, &moved(&tube, Vec3::x()));
    let with_ball = union(&two, &moved(&icosphere(2), Vec3::x() * 5.0));
    for skeleton in check(&with_ball, [2, 4, 0, 0]) {
        let side = |vertex: usize| skeleton.node_of_vertex()[vertex];
        assert!(side(0) != NO_NODE && side(360) != NO_NODE && side(0) != side(360));
        assert!((720..720 + 162).all(|it| side(it) == NO_NODE));
    }
}

#[test]
fn poor_input_has_poor_skeletons() {
    let point = SpatialGraph::new(vec![Vec3::zeros(); 3], vec![]);
    let path = SpatialGraph::new(
        (0..5).map(|it| Vec3::x() * f64::from(it)).collect(),
        (1..5).map(|it| [it - 1, it]).collect(),
    );
    let same_place = SpatialGraph::new(vec![Vec3::x(); 5], vec![[0, 1], [1, 2], [2, 3], [3, 4]]);
    for (variant, sampling) in ALL {
        let options = options(variant, sampling);
        assert_eq!(local_separators(&point, &options).n_nodes(), 0);
        assert_eq!(local_separators(&path, &options).n_cycles(), 0);
        local_separators(&same_place, &options);
    }
    // Three sheets on one edge, which separates them; a face without area, a stray vertex.
    let vertices = vec![Vec3::zeros(), Vec3::y(), Vec3::x(), -Vec3::x(), Vec3::z(), Vec3::z()];
    let faces = vec![[0, 1, 2], [0, 1, 3], [0, 1, 4], [0, 0, 1], [0, 1, 2]];
    check(&TriMesh::new(vertices, faces).unwrap(), [1, 0, 0, 0]);
}

#[test]
fn same_bytes_on_any_number_of_threads() {
    let graph = SpatialGraph::of_mesh(&torus(1.0, 0.3, 70, 30));
    for (variant, sampling) in ALL {
        let run = |n_threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
            pool.install(|| local_separators(&graph, &options(variant, sampling)))
        };
        assert_eq!(run(1), run(3));
    }
}

/// Numbers of vertices change with sizes and turns of the shape only by rounding.
#[test]
fn size_and_place_change_nothing() {
    let mesh = torus(1.0, 0.3, 40, 16);
    let of = |scale: f64| {
        let vertices = mesh.vertices().iter().map(|it| it * scale).collect();
        let graph = SpatialGraph::of_mesh(&mesh.with_vertices(vertices).unwrap());
        local_separators(&graph, &options(Variant::Plain, true))
    };
    // Powers of two scale without rounding.
    let (one, small, large) = (of(1.0), of(0.5_f64.powi(60)), of(2.0_f64.powi(60)));
    assert_eq!(one.node_of_vertex(), small.node_of_vertex());
    assert_eq!(one.edges(), large.edges());
}
