use super::super::tests::{Capsule, body, cloud_of, distance_to, fork, topology};
use super::super::{
    ContractOptions, FinishOptions, coarse_contraction, contraction_skeleton, finish,
};
use super::*;
use crate::kernels::geometry::isosurface::{Grid, isosurface};
use crate::kernels::geometry::mesh::TriMesh;
use crate::kernels::geometry::shapes::tube;

/// Finished curves, centred in so many rounds.
fn centered_curves(shape: &TriMesh, n_points: usize, rounds: usize) -> CurveSkeleton {
    let found = coarse_contraction(shape, n_points, &ContractOptions::default()).unwrap();
    let center = Some(CenterOptions { rounds, ..Default::default() });
    finish(&found, shape, &FinishOptions { center, ..Default::default() }).unwrap()
}

/// The farthest that places along curves are off an axis, away from the curves' ends.
fn off_axis(skeleton: &CurveSkeleton, distance: &dyn Fn(&Vec3) -> f64) -> f64 {
    let ends = skeleton.leaves();
    let along = skeleton.edges().iter().filter(|it| it.iter().all(|it| !ends.contains(it)));
    let places = along.flat_map(|edge| {
        let [from, to] = edge.map(|it| skeleton.positions()[it as usize]);
        (0..=8).map(move |it| from.lerp(&to, f64::from(it) / 8.0))
    });
    places.map(|it| distance(&it)).fold(0.0, f64::max)
}

/// Three quarters of a ring.
fn hook(radius: f64, cell: f64) -> TriMesh {
    let value = |it: Vec3| axis_distance(&it) - radius;
    let half = 1.0 + radius + 2.1 * cell;
    let (low, high) = (Vec3::new(-half, -half, 1.0 - half), Vec3::new(half, half, half - 1.0));
    let n_cells = [0, 1, 2].map(|axis| ((high - low)[axis] / cell).ceil() as usize);
    isosurface(&Grid { origin: low, cell, n_cells }, &value).unwrap()
}

/// The distance from the hook's axis.
fn axis_distance(place: &Vec3) -> f64 {
    if place.x > 0.0 && place.y < 0.0 {
        return (place - Vec3::x()).norm().min((place + Vec3::y()).norm());
    }
    (place.x.hypot(place.y) - 1.0).hypot(place.z)
}

#[test]
fn curves_lie_on_the_axis_of_a_bent_limb() {
    let mesh = hook(0.2, 0.04);
    let off = |rounds: usize| {
        let skeleton = centered_curves(&mesh, 1500, rounds);
        assert_eq!(topology(&skeleton), [1, 2, 0, 0]);
        let field = DistanceField::new(&mesh);
        assert!(skeleton.positions().iter().all(|it| field.is_inside(*it)));
        off_axis(&skeleton, &axis_distance) / 0.2
    };
    assert!(off(6) < 0.08 && off(0) > 0.1, "{}, {}", off(6), off(0));
    // What has come to rest rests.
    assert!(off(40) < 0.08, "{}", off(40));
}

#[test]
fn curves_of_clouds_lie_on_the_axis_also_when_one_side_was_seen() {
    let whole = cloud_of(&hook(0.2, 0.04), 3000);
    let seen = whole.vertices().iter().copied().filter(|it| it.z > 0.0).collect();
    let side = TriMesh::from_points(seen).unwrap();
    for (name, cloud, bound, uncentered) in [("whole", whole, 0.05, 0.09), ("side", side, 0.4, 0.6)]
    {
        let off = |rounds: usize| {
            let skeleton = centered_curves(&cloud, 6000, rounds);
            assert_eq!(topology(&skeleton), [1, 2, 0, 0], "{name}");
            assert_eq!(skeleton.node_of_vertex().len(), cloud.n_vertices());
            off_axis(&skeleton, &axis_distance) / 0.2
        };
        assert!(off(6) < bound && off(0) > uncentered, "{name}: {}, {}", off(6), off(0));
    }
}

/// A thick trunk along z, of whose one side two limbs come.
fn trunk_with_limbs() -> [Capsule; 3] {
    let limb = |y: f64| (Vec3::new(0.1, y, 0.0), Vec3::new(1.6, 2.0 * y, 0.0), 0.12);
    [(Vec3::z() * -1.4, Vec3::z() * 1.4, 0.4), limb(0.2), limb(-0.2)]
}

#[test]
fn trunks_are_centered_where_limbs_leave_them() {
    let mesh = body(&trunk_with_limbs(), 0.05);
    let [(from, to, radius), ..] = trunk_with_limbs();
    let cloud = cloud_of(&mesh, 5000);
    for (name, shape) in [("mesh", &mesh), ("cloud", &cloud)] {
        // Junctions' distances from the trunk's axis.
        let off = |rounds: usize| {
            let skeleton = centered_curves(shape, 6000, rounds);
            let places = skeleton.junctions().into_iter();
            let places = places.map(|it| skeleton.positions()[it as usize]);
            places.map(|it| distance_to(&it, &from, &to) / radius).fold(0.0, f64::max)
        };
        assert!(off(6) < 0.45 && off(0) > 0.5, "{name}: {}, {}", off(6), off(0));
    }
}

#[test]
fn curves_have_the_vertices_around_them() {
    let mesh = body(&fork(), 0.04);
    let cloud = TriMesh::from_points(mesh.vertices().to_vec()).unwrap();
    for shape in [&mesh, &cloud] {
        let found = contraction_skeleton(shape, &ContractOptions::default()).unwrap();
        let finished = |center| {
            let options = FinishOptions { center, ..Default::default() };
            finish(&found, shape, &options).unwrap()
        };
        // The mean distance of vertices from their nodes.
        let spread = |it: &CurveSkeleton| {
            let distance =
                |(node, vertex): (&u32, &Vec3)| (it.positions()[*node as usize] - vertex).norm();
            let sum: f64 = it.node_of_vertex().iter().zip(shape.vertices()).map(distance).sum();
            sum / shape.n_vertices() as f64
        };
        let (fine, coarse) = (finished(Some(CenterOptions::default())), finished(None));
        assert_eq!(topology(&fine), topology(&coarse));
        assert!(fine.n_nodes() > coarse.n_nodes() && spread(&fine) < spread(&coarse));
        let longest = (0..fine.n_edges()).map(|it| fine.length(it)).fold(0.0, f64::max);
        assert!(longest < 0.14, "{longest}");
    }
}

#[test]
fn curves_of_open_surfaces_stay() {
    let half = tube(0.2, 3.0, 24, 60, 0.5);
    let found = contraction_skeleton(&half, &ContractOptions::default()).unwrap();
    let kept = finish(&found, &half, &FinishOptions { center: None, ..Default::default() });
    assert_eq!(finish(&found, &half, &FinishOptions::default()), kept);
}

#[test]
fn threads_do_not_matter() {
    let mesh = body(&fork(), 0.06);
    let cloud = cloud_of(&mesh, 2000);
    for shape in [&mesh, &cloud] {
        let run = |n_threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
            pool.install(|| centered_curves(shape, 1000, 6))
        };
        assert_eq!(run(1), run(3));
    }
}
