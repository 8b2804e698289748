use super::*;
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::matching::skeleton_match::{MatchOptions, SkeletonGraph, match_skeletons};

/// A chain along x with joints at these places; the root is the joint of index `root`.
fn chain(places: &[f64], root: usize) -> Skeleton {
    let order: Vec<usize> = (root..places.len()).chain((0..root).rev()).collect();
    let joint = |place: usize| order.iter().position(|&it| it == place).unwrap();
    let parent = |&place: &usize| match place.cmp(&root) {
        std::cmp::Ordering::Equal => None,
        std::cmp::Ordering::Less => Some(joint(place + 1)),
        std::cmp::Ordering::Greater => Some(joint(place - 1)),
    };
    let names = order.iter().map(|it| format!("j{it}")).collect();
    let positions = order.iter().map(|&it| Vec3::x() * places[it]).collect();
    Skeleton::new(names, order.iter().map(parent).collect(), positions).unwrap()
}

fn even(n_bones: usize) -> Skeleton {
    let places: Vec<f64> = (0..=n_bones).map(|it| it as f64 / n_bones as f64).collect();
    chain(&places, 0)
}

fn mapped(source: &Skeleton, target: &Skeleton, options: &MapSegmentsOptions) -> MappedSegments {
    let graphs = [source, target].map(SkeletonGraph::from);
    let ranking = match_skeletons(&graphs[0], &graphs[1], &MatchOptions::default()).unwrap();
    map_segments(source, target, &ranking.matches[0], options).unwrap()
}

/// The names of the source's joints that the target's follow, by the target's names.
fn followed(source: &Skeleton, it: &MappedSegments) -> Vec<(String, String)> {
    let name = |it: &Option<Segment>| match it {
        Some(it) => source.names()[it.source as usize].clone(),
        None => "-".to_owned(),
    };
    let mut names: Vec<(String, String)> =
        it.target.names().iter().cloned().zip(it.map.segments().iter().map(name)).collect();
    names.sort();
    names
}

#[test]
fn equal_skeletons_follow_themselves() {
    for skeleton in [even(4), chain(&[0.0, 0.1, 0.5, 0.9, 1.0], 2)] {
        for insertion in [Insertion::Joints, Insertion::Empty, Insertion::Midpoints] {
            let options = MapSegmentsOptions { insertion, ..Default::default() };
            let res = mapped(&skeleton, &skeleton, &options);
            assert_eq!((&res.target, res.n_inserted, res.n_empty), (&skeleton, 0, 0));
            for (joint, it) in res.map.segments().iter().enumerate() {
                let whole = Segment { source: joint as u32, from: 0.0, to: 1.0 };
                let it = it.unwrap();
                assert_eq!(it.source, whole.source);
                assert!(it.from < 1e-9 && it.to > 1.0 - 1e-9);
            }
        }
    }
}

#[test]
fn two_bones_are_followed_by_three_each_of_six() {
    for assignment in [Assignment::End, Assignment::Nearest] {
        let options = MapSegmentsOptions { assignment, ..Default::default() };
        let res = mapped(&even(2), &even(6), &options);
        let found: Vec<String> = followed(&even(2), &res).into_iter().map(|it| it.1).collect();
        let expected = match assignment {
            Assignment::End => ["j0", "j1", "j1", "j1", "j2", "j2", "j2"],
            // The place 4/6 is nearer to the middle than to the end.
            Assignment::Nearest => ["j0", "j1", "j1", "j1", "j1", "j2", "j2"],
        };
        assert_eq!((res.n_inserted, found), (0, expected.map(str::to_owned).to_vec()));
    }
    let spans = mapped(&even(2), &even(6), &MapSegmentsOptions::default());
    let it = spans.map.segments()[2].unwrap();
    assert!((it.from - 1.0 / 3.0).abs() < 1e-9 && (it.to - 2.0 / 3.0).abs() < 1e-9);
}

#[test]
fn one_bone_is_parted_twice_to_follow_four() {
    for insertion in [Insertion::Midpoints, Insertion::Empty, Insertion::Joints] {
        let options = MapSegmentsOptions { insertion, ..Default::default() };
        let res = mapped(&even(4), &even(1), &options);
        assert_eq!((res.n_inserted, res.n_empty), (3, 0));
        let places: Vec<f64> = res.target.positions().iter().map(|it| it.x).collect();
        assert_eq!(places, [0.0, 0.25, 0.5, 0.75, 1.0]);
        let source: Vec<u32> = res.map.segments().iter().map(|it| it.unwrap().source).collect();
        assert_eq!(source, [0, 1, 2, 3, 4]);
        assert_eq!(res.target.names()[4], "j1", "old joints keep their names");
    }
    let options = MapSegmentsOptions { insertion: Insertion::Never, ..Default::default() };
    assert_eq!(mapped(&even(4), &even(1), &options).n_empty, 3);
}

#[test]
fn the_target_gets_the_roots_place() {
    let source = chain(&[0.0, 0.3, 0.6, 1.0], 1);
    let target = chain(&[0.0, 0.5, 1.0], 0);
    let res = mapped(&source, &target, &MapSegmentsOptions::default());
    let root = res.target.parents().iter().position(Option::is_none).unwrap();
    assert!((res.target.positions()[root].x - 0.3).abs() < 1e-9 && res.is_root_moved);
    assert!(res.map.segments().iter().all(Option::is_some));
    assert_eq!(res.target.n_joints(), 5);
    // Where the target keeps its root, the bones between the roots follow nothing.
    let options = MapSegmentsOptions { move_root: false, ..Default::default() };
    let kept = mapped(&source, &target, &options);
    let found = followed(&source, &kept);
    assert_eq!(kept.target.names()[0], "j0");
    let nothing: Vec<&str> =
        found.iter().filter(|it| it.1 == "-").map(|it| it.0.as_str()).collect();
    assert_eq!(nothing, ["j0", "j1.1"]);
}

#[test]
fn what_is_not_matched_follows_nothing() {
    let names = |n: usize| (0..n).map(|it| format!("j{it}")).collect::<Vec<_>>();
    let points = [[0.0, 0.0], [0.0, 2.0], [2.0, 0.0], [-2.0, 0.0], [0.0, -0.5]];
    let points: Vec<Vec3> = points.iter().map(|it| Vec3::new(it[0], it[1], 0.0)).collect();
    let star = |n: usize| {
        let parents = (0..n).map(|it| (it > 0).then_some(0)).collect();
        Skeleton::new(names(n), parents, points[..n].to_vec()).unwrap()
    };
    let (source, target) = (star(4), star(5));
    let res = mapped(&source, &target, &MapSegmentsOptions::default());
    assert_eq!(res.map.segments()[4], None);
    assert_eq!(res.map.segments().iter().flatten().count(), 4);
    let graphs = [&source, &target].map(SkeletonGraph::from);
    let ranking = match_skeletons(&graphs[0], &graphs[1], &MatchOptions::default()).unwrap();
    let error = map_segments(&target, &target, &ranking.matches[0], &Default::default());
    let expected = "the match is of a source with 4 joints, but the source has 5";
    assert_eq!(error.unwrap_err().to_string(), expected);
}
