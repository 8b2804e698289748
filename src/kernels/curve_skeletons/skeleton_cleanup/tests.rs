use super::*;
use crate::kernels::curve_skeletons::curve_skeleton::{CurveSkeleton, NO_NODE};
use crate::kernels::curve_skeletons::local_separators::{
    LocalSeparatorsOptions, SpatialGraph, local_separators,
};
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::geometry::shapes::{torus, tube};

/// Every node has one vertex, with its number.
fn skeleton(points: &[[f64; 2]], radius: f64, edges: &[[u32; 2]]) -> CurveSkeleton {
    let positions: Vec<Vec3> = points.iter().map(|&[x, y]| Vec3::new(x, y, 0.0)).collect();
    let labels = (0..positions.len() as u32).collect();
    let radii = vec![radius; positions.len()];
    CurveSkeleton::new(positions, radii, edges.to_vec(), labels).unwrap()
}

/// A path along x from 0 to `n - 1`.
fn path(n: u32) -> (Vec<[f64; 2]>, Vec<[u32; 2]>) {
    ((0..n).map(|it| [f64::from(it), 0.0]).collect(), (1..n).map(|it| [it - 1, it]).collect())
}

#[test]
fn a_cycle_becomes_its_mean_with_its_edges() {
    // A square with a tail at 0 and another at 2.
    let points = [[0., 0.], [2., 0.], [2., 2.], [0., 2.], [-1., 0.], [3., 3.]];
    let edges = [[0, 1], [1, 2], [2, 3], [0, 3], [0, 4], [2, 5]];
    let res = collapse_cycles(&skeleton(&points, 1.0, &edges));
    assert_eq!((res.n_nodes(), res.edges()), (3, &[[0, 1], [0, 2]][..]));
    assert_eq!(res.positions()[0], Vec3::new(1.0, 1.0, 0.0));
    assert_eq!(res.node_of_vertex(), [0, 0, 0, 0, 1, 2]);
}

#[test]
fn cycles_that_share_an_edge_are_gone_one_by_one() {
    // Two triangles on one edge beside a pentagon.
    let points = [[0., 0.], [1., 0.], [0., 1.], [1., 1.], [2., 0.], [3., 0.], [3., 1.], [2., 1.]];
    let edges = [[0, 1], [0, 2], [1, 2], [1, 3], [2, 3], [3, 4], [4, 5], [5, 6], [6, 7], [7, 3]];
    let start = skeleton(&points, 1.0, &edges);
    assert_eq!(start.n_cycles(), 3);
    let res = collapse_cycles(&start);
    assert_eq!((res.n_cycles(), res.n_components()), (0, 1));
}

#[test]
fn a_torus_collapses_to_a_node() {
    let graph = SpatialGraph::of_mesh(&torus(1.0, 0.3, 60, 24));
    let ring = local_separators(&graph, &LocalSeparatorsOptions::default());
    let res = collapse_cycles(&ring);
    assert_eq!((res.n_nodes(), res.n_edges()), (1, 0));
    assert!(res.positions()[0].norm() < 0.05);
    assert!(res.node_of_vertex().iter().all(|&it| it == 0));
}

#[test]
fn spurs_by_nodes_and_by_length() {
    let (mut points, mut edges) = path(20);
    points.extend([[10., 1.], [10., 2.], [5., 1.], [5., 2.], [5., 3.]]);
    edges.extend([[10, 20], [20, 21], [5, 22], [22, 23], [23, 24]]);
    let start = skeleton(&points, 2.0, &edges);
    let pruned = |max_nodes, max_radii| {
        let res = prune(&start, start.radii(), &PruneOptions { max_nodes, max_radii });
        (res.leaves().len(), res.n_nodes())
    };
    assert_eq!(pruned(2, 0.0), (4, 25));
    assert_eq!(pruned(3, 0.0), (3, 23), "leaf, node and junction are three");
    assert_eq!(pruned(4, 0.0), (2, 20));
    assert_eq!(pruned(0, 1.2), (3, 23), "2 is shorter than 1.2 radii of 2, 3 is not");
    assert_eq!(pruned(0, 1.6), (2, 20));
    let res = prune(&start, start.radii(), &PruneOptions { max_nodes: 4, max_radii: 0.0 });
    assert_eq!(res.node_of_vertex()[20..], [10, 10, 5, 5, 5]);
}

#[test]
fn no_component_is_pruned_away() {
    let star = skeleton(&[[0., 0.], [1., 0.], [0., 1.], [-1., 0.]], 9.0, &[[0, 1], [0, 2], [0, 3]]);
    let res = prune(&star, star.radii(), &PruneOptions::default());
    assert_eq!((res.n_nodes(), res.leaves().len()), (3, 2));
    let (points, edges) = path(2);
    let short = skeleton(&points, 9.0, &edges);
    assert_eq!(prune(&short, short.radii(), &PruneOptions::default()), short);
}

#[test]
fn the_forks_of_an_open_strip_are_spurs() {
    let mesh = tube(0.1, 1.0, 24, 60, 0.5);
    let graph = SpatialGraph::of_mesh(&mesh);
    let strip = local_separators(&graph, &LocalSeparatorsOptions::default());
    assert_eq!((strip.leaves().len(), strip.junctions().len()), (4, 2));
    let radii = strip_radii(&strip, &mesh);
    for junction in strip.junctions() {
        // More than half the length of the half circle, but no more than its radius allows.
        let found = radii[junction as usize];
        assert!((0.05..0.065).contains(&(found / std::f64::consts::PI)), "{found}");
    }
    assert_eq!(strip_radii(&strip, &torus(1.0, 0.3, 48, 30)), strip.radii(), "no boundary");
    let by_nodes = prune(&strip, &radii, &PruneOptions { max_radii: 0.0, ..Default::default() });
    assert_eq!(by_nodes.leaves().len(), 4, "they have more than three nodes");
    let res = prune(&strip, &radii, &PruneOptions::default());
    assert_eq!((res.leaves().len(), res.junctions().len(), res.n_cycles()), (2, 0, 0));
}

#[test]
fn close_nodes_unite_and_ends_stay() {
    let points = [[0., 0.], [0.1, 0.], [1., 0.], [1.2, 0.], [3., 0.]];
    let edges = [[0, 1], [1, 2], [2, 3], [3, 4]];
    let res = merge_close_nodes(&skeleton(&points, 1.0, &edges), 0.5);
    let x: Vec<f64> = res.positions().iter().map(|it| it.x).collect();
    assert_eq!(x, [0.0, 1.1, 3.0]);
    assert_eq!(res.node_of_vertex(), [0, 0, 1, 1, 2]);
    assert_eq!(merge_close_nodes(&res, 0.5), res);
    // All of them: one node is left, and nothing turns around.
    assert_eq!(merge_close_nodes(&res, 10.0).n_nodes(), 1);
}

#[test]
fn junctions_give_their_vertices_away() {
    let points = [[0., 0.], [1., 0.], [-2., 0.], [0., 3.]];
    let star = skeleton(&points, 1.0, &[[0, 1], [0, 2], [0, 3]]);
    let res = free_junctions(&star, star.positions());
    assert_eq!(res.node_of_vertex(), [1, 1, 2, 3]);
    let labels = vec![0, 0, NO_NODE, 0];
    let all_at_junction =
        CurveSkeleton::new(star.positions().to_vec(), vec![0.0; 4], star.edges().to_vec(), labels)
            .unwrap();
    assert_eq!(free_junctions(&all_at_junction, star.positions()), all_at_junction);
}

#[test]
fn components_are_dropped_and_joined() {
    // Paths of three, two and one nodes.
    let points = [[0., 0.], [1., 0.], [2., 0.], [2.5, 4.], [9., 4.], [5., 5.]];
    let start = skeleton(&points, 0.1, &[[0, 1], [1, 2], [3, 4]]);
    let dropped = drop_small_components(&start, 2);
    assert_eq!((dropped.n_components(), dropped.n_nodes()), (2, 5));
    assert_eq!(dropped.node_of_vertex(), [0, 1, 2, 3, 4, NO_NODE]);
    assert_eq!(drop_small_components(&start, 100).n_nodes(), 3, "the largest stays");
    let joined = connect_components(&start);
    assert_eq!(joined.edges(), [[0, 1], [1, 2], [2, 3], [3, 4], [3, 5]]);
    assert_eq!(connect_components(&joined), joined);
}

#[test]
fn nothing_stays_nothing() {
    let nothing = CurveSkeleton::new(vec![], vec![], vec![], vec![NO_NODE; 3]).unwrap();
    assert_eq!(collapse_cycles(&nothing), nothing);
    assert_eq!(prune(&nothing, &[], &PruneOptions::default()), nothing);
    assert_eq!(merge_close_nodes(&nothing, 1.0), nothing);
    assert_eq!(connect_components(&drop_small_components(&nothing, 5)), nothing);
    assert_eq!(free_junctions(&nothing, &[Vec3::zeros(); 3]), nothing);
}

#[test]
fn a_leaf_with_few_vertices_goes_to_the_next_node() {
    let (points, edges) = path(4);
    let start = skeleton(&points, 1.0, &edges);
    let labels = [vec![0; 9], vec![1; 9], vec![2; 9], vec![3; 2]].concat();
    let (places, radii) = (start.positions().to_vec(), start.radii().to_vec());
    let start = CurveSkeleton::new(places, radii, start.edges().to_vec(), labels).unwrap();
    let res = drop_slight_leaves(&start, 0.5);
    assert_eq!((res.n_nodes(), res.vertices_of_nodes()[2].len()), (3, 11));
    assert_eq!(drop_slight_leaves(&start, 0.2), start);
}
