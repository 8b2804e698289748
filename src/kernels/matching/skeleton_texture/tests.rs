use super::*;
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::geometry::shapes::tube;
use crate::kernels::rigs::segment_map::Segment;
use crate::kernels::rigs::segments_by_name::segments_by_name;
use crate::kernels::synthetic::synthesize::{SynthesizeOptions, synthesize};

/// A chain of joints along +Y at some heights.
fn chain(heights: &[f64]) -> Skeleton {
    let names = (0..heights.len()).map(|it| it.to_string()).collect();
    let parents = (0..heights.len()).map(|it| it.checked_sub(1)).collect();
    let places = heights.iter().map(|&it| Vec3::y() * it).collect();
    Skeleton::new(names, parents, places).unwrap()
}

/// A tube about +Y with an elliptic section, `stretch` as wide along X.
fn pipe(radius: f64, length: f64, stretch: f64, n_around: usize) -> TriMesh {
    let it = tube(radius, length, n_around, 41, 1.0);
    let places = it.vertices().iter().map(|it| Vec3::new(it.x * stretch, it.y, it.z)).collect();
    it.with_vertices(places).unwrap()
}

/// Weights of joints that change linearly with the height, as hats around their heights.
fn hats(mesh: &TriMesh, heights: &[f64]) -> SkinWeights {
    let row = |it: &Vec3| {
        let above = heights.iter().position(|&height| height >= it.y - 1e-12).unwrap();
        if above == 0 {
            return vec![(0, 1.0)];
        }
        let share = (it.y - heights[above - 1]) / (heights[above] - heights[above - 1]);
        vec![(above as u32 - 1, 1.0 - share), (above as u32, share)]
    };
    let rows: Vec<_> = mesh.vertices().iter().map(row).collect();
    SkinWeights::from_rows(heights.len(), &rows).unwrap()
}

fn part(source: u32, from: f64, to: f64) -> Option<Segment> {
    Some(Segment { source, from, to })
}

fn largest_difference(a: &SkinWeights, b: &SkinWeights) -> f64 {
    let of = |vertex: usize| {
        (0..a.n_joints()).map(move |it| (a.get(vertex, it) - b.get(vertex, it)).abs())
    };
    (0..a.n_vertices()).flat_map(of).fold(0.0, f64::max)
}

fn assert_sums_to_one(weights: &SkinWeights) {
    for vertex in 0..weights.n_vertices() {
        assert!((weights.row(vertex).map(|it| it.1).sum::<f64>() - 1.0).abs() < 1e-9);
    }
}

#[test]
fn a_longer_and_wider_pipe_gets_linear_weights() {
    let (source_mesh, source) = (pipe(0.2, 1.0, 1.0, 24), chain(&[0.0, 0.5, 1.0]));
    let weights = hats(&source_mesh, &[0.0, 0.5, 1.0]);
    for texels in [Texels::AllJoints, Texels::TopFour] {
        let (mesh, target) = (pipe(0.5, 3.0, 1.0, 31), chain(&[0.0, 1.5, 3.0]));
        let map = segments_by_name(&source, &target);
        let options =
            SkeletonTextureOptions { texels, resolution: 256, smoothing: 0, ..Default::default() };
        let it =
            skeleton_texture((&source_mesh, &source, &weights), (&mesh, &target), &map, &options);
        let it = it.unwrap();
        assert!(!it.fell_back && it.n_inherited == 0);
        assert_eq!(it.target.n_covered, mesh.n_vertices());
        let texel = 1.0 / (0.5 * it.source.texels_per_length);
        let expected = hats(&mesh, &[0.0, 1.5, 3.0]);
        let error = largest_difference(&it.weights, &expected);
        assert!(error < 2.0 * texel, "{error} {texel}");
        assert_sums_to_one(&it.weights);
    }
}

/// One bone of the source for three of the target, then the other way round: the weights of a joint are
/// those of the joints that move like it.
#[test]
fn bones_may_be_split_and_joined() {
    let (mesh, one, many) =
        (pipe(0.2, 2.0, 1.0, 24), chain(&[0.0, 1.0, 2.0]), chain(&[0.0, 0.25, 0.5, 1.0, 2.0]));
    let options = SkeletonTextureOptions { resolution: 256, smoothing: 0, ..Default::default() };
    let weights = hats(&mesh, &[0.0, 1.0, 2.0]);
    let split = vec![
        part(0, 0.0, 0.0),
        part(1, 0.0, 0.25),
        part(1, 0.25, 0.5),
        part(1, 0.5, 1.0),
        part(2, 0.0, 1.0),
    ];
    let map = SegmentMap::new(3, split).unwrap();
    let it = skeleton_texture((&mesh, &one, &weights), (&mesh, &many), &map, &options).unwrap();
    for vertex in 0..mesh.n_vertices() {
        let lower: f64 = (0..3).map(|joint| it.weights.get(vertex, joint)).sum();
        assert!((lower - weights.get(vertex, 0)).abs() < 0.02);
        assert!((it.weights.get(vertex, 3) - weights.get(vertex, 1)).abs() < 0.02);
    }
    let weights = hats(&mesh, &[0.0, 0.25, 0.5, 1.0, 2.0]);
    let joined = vec![part(0, 0.0, 0.0), part(3, 0.0, 1.0), part(4, 0.0, 1.0)];
    let map = SegmentMap::new(5, joined).unwrap();
    let it = skeleton_texture((&mesh, &many, &weights), (&mesh, &one), &map, &options).unwrap();
    for vertex in 0..mesh.n_vertices() {
        let lower: f64 = (0..3).map(|joint| weights.get(vertex, joint)).sum();
        assert!((it.weights.get(vertex, 0) - lower).abs() < 0.02, "{}", mesh.vertices()[vertex]);
        assert!((it.weights.get(vertex, 1) - weights.get(vertex, 3)).abs() < 0.02);
    }
}

/// Weights differ from one side to the other: they come out on the right one only if the angles fit. The
/// target's rest pose lies along +X, which turns the section, too.
#[test]
fn angles_follow_the_rest_pose() {
    let mesh = pipe(0.2, 1.0, 1.0, 48);
    let skeleton = chain(&[0.0, 1.0]);
    let row = |it: &Vec3| vec![(0, 0.5 + 2.0 * it.z), (1, 0.5 - 2.0 * it.z)];
    let rows: Vec<_> = mesh.vertices().iter().map(row).collect();
    let weights = SkinWeights::from_rows(2, &rows).unwrap();
    let turn = |it: &Vec3| Vec3::new(it.y, -it.x, it.z) + Vec3::repeat(3.0);
    let moved = mesh.with_vertices(mesh.vertices().iter().map(turn).collect()).unwrap();
    let target = skeleton.with_positions(skeleton.positions().iter().map(turn).collect()).unwrap();
    let map = segments_by_name(&skeleton, &target);
    let options = SkeletonTextureOptions { resolution: 256, smoothing: 0, ..Default::default() };
    let it = skeleton_texture((&mesh, &skeleton, &weights), (&moved, &target), &map, &options);
    let error = largest_difference(&it.unwrap().weights, &weights);
    assert!(error < 0.02, "{error}");
}

/// An elliptic pipe turned by a quarter about its axis, which no skeleton shows: only the shape of the
/// section does.
#[test]
fn a_turned_section_is_found_by_correlation() {
    let flat = pipe(0.2, 1.0, 0.5, 48);
    let skeleton = chain(&[0.0, 1.0]);
    // One side is thicker, so that half a turn is something else.
    let bulged = |it: &Vec3| Vec3::new(it.x, it.y, if it.z > 0.0 { 1.5 * it.z } else { it.z });
    let mesh = flat.with_vertices(flat.vertices().iter().map(bulged).collect()).unwrap();
    let row = |it: &Vec3| vec![(0, 0.5 + it.z), (1, 0.5 - it.z)];
    let rows: Vec<_> = mesh.vertices().iter().map(row).collect();
    let weights = SkinWeights::from_rows(2, &rows).unwrap();
    let turn = |it: &Vec3| Vec3::new(it.z, it.y, -it.x);
    let turned = mesh.with_vertices(mesh.vertices().iter().map(turn).collect()).unwrap();
    let map = segments_by_name(&skeleton, &skeleton);
    let error = |correct_phase| {
        let options = SkeletonTextureOptions {
            correct_phase,
            resolution: 256,
            smoothing: 0,
            ..Default::default()
        };
        let of = (&mesh, &skeleton, &weights);
        let it = skeleton_texture(of, (&turned, &skeleton), &map, &options).unwrap();
        (largest_difference(&it.weights, &weights), it.n_shifted)
    };
    let (wrong, n_shifted) = error(false);
    assert!(wrong > 0.2 && n_shifted == 0);
    let (right, n_shifted) = error(true);
    assert!(right < 0.02 && n_shifted == 1, "{right} {n_shifted}");
}

/// Where the surface lies over itself around a bone (shoulders, the crotch) texels hold the mean of both
/// sheets; everywhere else weights come back.
#[test]
fn a_body_gets_its_own_weights_back() {
    let it = synthesize(&SynthesizeOptions { n_vertices: 2000, ..Default::default() }).unwrap();
    let map = segments_by_name(&it.skeleton, &it.skeleton);
    let of = (&it.mesh, &it.skeleton, &it.weights);
    let options = SkeletonTextureOptions { smoothing: 0, ..Default::default() };
    let res = skeleton_texture(of, (&it.mesh, &it.skeleton), &map, &options).unwrap();
    assert!(!res.fell_back && res.source.n_covered * 1000 > 998 * res.source.n_vertices);
    assert_sums_to_one(&res.weights);
    let largest = |vertex: usize| {
        (0..it.skeleton.n_joints())
            .map(|joint| (res.weights.get(vertex, joint) - it.weights.get(vertex, joint)).abs())
            .fold(0.0, f64::max)
    };
    let errors: Vec<f64> = (0..it.mesh.n_vertices()).map(largest).collect();
    let n_off = errors.iter().filter(|&&it| it > 0.02).count();
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    assert!(n_off * 50 < errors.len() && mean < 0.003, "{n_off} of {}, {mean}", errors.len());
}

#[test]
fn unmapped_bones_inherit_and_hidden_skeletons_fall_back() {
    let (mesh, source, target) =
        (pipe(0.2, 1.0, 1.0, 24), chain(&[0.0, 0.5, 1.0]), chain(&[0.0, 0.5, 1.0]));
    let weights = hats(&mesh, &[0.0, 0.5, 1.0]);
    let map = SegmentMap::new(3, vec![part(0, 0.0, 0.0), part(1, 0.0, 1.0), None]).unwrap();
    let options = SkeletonTextureOptions { resolution: 128, ..Default::default() };
    let of = (&mesh, &source, &weights);
    let it = skeleton_texture(of, (&mesh, &target), &map, &options).unwrap();
    assert_eq!(it.n_inherited, 1);
    for (vertex, place) in mesh.vertices().iter().enumerate() {
        if place.y > 0.5 {
            assert!(it.weights.get(vertex, 1) > 0.95, "the weights at the end of the bone below");
        }
    }
    let all = SkeletonTextureOptions { least_covered: 1.1, ..options };
    let map = segments_by_name(&source, &target);
    let it = skeleton_texture(of, (&mesh, &target), &map, &all).unwrap();
    let heat = skin_weights(&mesh, &target, &SkinWeightsOptions::default()).unwrap();
    assert!(it.fell_back && it.weights == heat.weights);
}

#[test]
fn what_does_not_fit_is_told() {
    let (mesh, skeleton) = (pipe(0.2, 1.0, 1.0, 8), chain(&[0.0, 1.0]));
    let weights = hats(&mesh, &[0.0, 1.0]);
    let map = segments_by_name(&skeleton, &skeleton);
    let message = |skeleton: &Skeleton, target: &Skeleton, map: &SegmentMap| {
        let of = (&mesh, skeleton, &weights);
        let options = SkeletonTextureOptions::default();
        skeleton_texture(of, (&mesh, target), map, &options).unwrap_err().to_string()
    };
    assert_eq!(
        message(&chain(&[0.0, 1.0, 2.0]), &skeleton, &map),
        "the source skeleton has 3 joints, but the weights 2"
    );
    assert_eq!(
        message(&skeleton, &chain(&[0.0, 1.0, 2.0]), &map),
        "the map leads from 2 joints to 2, but the target has 3 and the source 2"
    );
    let point = chain(&[0.0, 0.0]);
    assert_eq!(message(&skeleton, &point, &map), "the target skeleton has no bone of any length");
}
