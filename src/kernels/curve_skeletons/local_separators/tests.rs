use std::collections::BTreeSet;

use super::*;
use crate::kernels::curve_skeletons::curve_skeleton::NO_NODE;
use crate::kernels::geometry::mesh::{TriMesh, Vec3};
use crate::kernels::geometry::shapes::{bumpy_sphere, icosphere, moved, torus, tube, union};

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

/// The parts of what is next to a set.
fn front_parts(graph: &SpatialGraph, inside: &[u32]) -> Vec<BTreeSet<u32>> {
    let is_inside = |it: &u32| inside.binary_search(it).is_ok();
    let mut front: BTreeSet<u32> =
        inside.iter().flat_map(|&it| graph.neighbors(it)).copied().collect();
    front.retain(|it| !is_inside(it));
    let mut parts = vec![];
    while let Some(first) = front.pop_first() {
        let (mut part, mut stack) = (BTreeSet::from([first]), vec![first]);
        while let Some(point) = stack.pop() {
            for &next in graph.neighbors(point) {
                if front.remove(&next) {
                    part.insert(next);
                    stack.push(next);
                }
            }
        }
        parts.push(part);
    }
    parts
}

#[test]
fn separators_separate_and_none_of_their_points_is_spare() {
    let ring = torus(1.0, 0.4, 30, 18);
    let meshes = [ring.clone(), tube(0.1, 1.0, 16, 40, 0.7), bumpy_sphere(12)];
    let mut n_checked = 0;
    for graph in meshes.map(|it| SpatialGraph::of_mesh(&it)) {
        let options = SearchOptions { sampling: false, min_quality: 0.0, seed: 3 };
        for max_size in [40, usize::MAX] {
            let touched = vec![0; graph.n_points()];
            let found = search::search(&graph, touched, &|_| max_size, &options);
            for Separator { points, quality } in &found.separators {
                let parts = front_parts(&graph, points);
                assert!(parts.len() > 1 && *quality > 0.0 && *quality <= 1.0);
                for &point in points {
                    let touches = |part: &&BTreeSet<u32>| {
                        graph.neighbors(point).iter().any(|it| part.contains(it))
                    };
                    assert!(parts.iter().filter(touches).count() != 1, "{point} of {points:?}");
                }
                n_checked += 1;
            }
        }
    }
    assert!(n_checked > 1000, "{n_checked}");
}

#[test]
fn packed_separators_keep_to_the_capacities() {
    let graph = SpatialGraph::of_mesh(&torus(1.0, 0.4, 30, 18));
    let options = SearchOptions { sampling: false, min_quality: 0.0, seed: 3 };
    let found = search::search(&graph, vec![0; 540], &|_| usize::MAX, &options).separators;
    for capacity in 1..4 {
        let chosen = pack::pack(found.clone(), &[capacity; 540]);
        let mut used = vec![0; 540];
        chosen.iter().flat_map(|it| &it.points).for_each(|&it| used[it as usize] += 1);
        assert!(used.iter().all(|it| *it <= capacity));
        // None that was left out fits.
        let fits = |it: &&Separator| it.points.iter().all(|&at| used[at as usize] < capacity);
        let is_chosen = |it: &&Separator| chosen.iter().any(|other| other.points == it.points);
        assert!(found.iter().filter(|it| !is_chosen(it)).all(|it| !fits(&it)));
    }
}

#[test]
fn layers_halve_and_keep_parts_and_points() {
    let two = union(&torus(1.0, 0.4, 30, 18), &moved(&icosphere(3), Vec3::x() * 9.0));
    let graph = SpatialGraph::of_mesh(&two);
    let n_points = graph.n_points();
    let layers = layers::layers(graph);
    assert!(layers.len() >= 5);
    for (depth, layer) in layers.iter().enumerate() {
        assert_eq!(layer.capacities.iter().sum::<u32>() as usize, n_points);
        assert_eq!(layer.graph.parts().len(), 2);
        if let Some(finer) = depth.checked_sub(1).map(|it| &layers[it]) {
            assert_eq!(layer.graph.n_points(), finer.graph.n_points().div_ceil(2));
            // A point is at the mean of what it stands for.
            let mut sums = vec![Vec3::zeros(); layer.graph.n_points()];
            for (fine, &coarse) in layer.coarse_of_fine.iter().enumerate() {
                let weight = f64::from(finer.capacities[fine]);
                sums[coarse as usize] += finer.graph.positions()[fine] * weight;
            }
            for (point, sum) in sums.iter().enumerate() {
                let mean = sum / f64::from(layer.capacities[point]);
                assert!((mean - layer.graph.positions()[point]).norm() < 1e-12);
            }
        }
    }
}
