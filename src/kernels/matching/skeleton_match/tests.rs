use super::*;
use crate::kernels::numerics::random::Random;

type Points<'a> = &'a [[f64; 3]];

fn graph(points: Points<'_>, edges: &[[u32; 2]]) -> SkeletonGraph {
    let positions = points.iter().map(|it| Vec3::new(it[0], it[1], it[2])).collect();
    SkeletonGraph { positions, edges: edges.to_vec(), roots: vec![0] }
}

/// A pelvis (0) with two legs, a chest (3) with a head and two arms, each arm with an elbow.
fn humanoid() -> SkeletonGraph {
    let points = [
        [0.0, 1.0, 0.0],
        [0.2, 0.0, 0.0],
        [-0.2, 0.0, 0.0],
        [0.0, 1.5, 0.0],
        [0.0, 1.8, 0.0],
        [0.4, 1.4, 0.0],
        [-0.4, 1.4, 0.0],
        [0.7, 1.2, 0.1],
        [-0.7, 1.2, 0.1],
    ];
    graph(&points, &[[0, 1], [0, 2], [0, 3], [3, 4], [3, 5], [3, 6], [5, 7], [6, 8]])
}

/// Legs of these lengths around a node, in a fan.
fn star(lengths: &[f64]) -> SkeletonGraph {
    let tip = |(index, length): (usize, &f64)| {
        let angle = index as f64 * std::f64::consts::TAU / lengths.len() as f64;
        Vec3::new(length * angle.cos(), length * angle.sin(), 0.0)
    };
    let mut positions = vec![Vec3::zeros()];
    positions.extend(lengths.iter().enumerate().map(tip));
    let edges = (1..positions.len() as u32).map(|it| [0, it]).collect();
    SkeletonGraph { positions, edges, roots: vec![0] }
}

fn cycle(n: u32) -> SkeletonGraph {
    let place = |it: u32| {
        let angle = f64::from(it) * std::f64::consts::TAU / f64::from(n);
        Vec3::new(angle.cos(), angle.sin(), 0.0)
    };
    let edges = (0..n).map(|it| [it, (it + 1) % n]).collect();
    SkeletonGraph { positions: (0..n).map(place).collect(), edges, roots: vec![0] }
}

/// Everything that is possible, without bounds.
fn all() -> MatchOptions {
    let tolerance = f64::INFINITY;
    MatchOptions { tolerance, partial: Partial::Never, n_kept: 1000, ..Default::default() }
}

fn matched(source: &SkeletonGraph, target: &SkeletonGraph, options: &MatchOptions) -> Ranking {
    let ranking = match_skeletons(source, target, options).unwrap();
    for it in &ranking.matches {
        for branch in it.branches() {
            let ends = |list: &[u32]| [list[0], list[list.len() - 1]];
            let [first, last] = ends(&branch.source).map(|it| it);
            let images = [first, last].map(|node| it.target_of(node).unwrap());
            assert_eq!(images, ends(&branch.target));
            for (graph, nodes) in [(source, &branch.source), (target, &branch.target)] {
                for pair in nodes.windows(2) {
                    let joins = |it: &[u32; 2]| it == pair || [it[1], it[0]] == pair;
                    assert!(graph.edges.iter().any(joins), "{pair:?} is no edge");
                }
            }
        }
    }
    ranking
}

fn is_identity(it: &SkeletonMatch) -> bool {
    it.nodes().iter().all(|it| it[0] == it[1])
        && it.branches().iter().all(|it| it.source == it.target)
}

#[test]
fn identical_skeletons_match_as_they_are() {
    for rating in [Rating::Lengths, Rating::NodeCounts] {
        let (both, options) = (humanoid(), MatchOptions { rating, ..Default::default() });
        let ranking = matched(&both, &both, &options);
        let best = &ranking.matches[0];
        assert!(is_identity(best) && ranking.is_complete && !ranking.is_partial);
        assert!(best.ratings()[0] < 1e-12 && best.ratings()[1] < 1e-12);
        assert_eq!((best.nodes().len(), best.branches().len()), (7, 6));
    }
}

#[test]
fn a_humanoid_fits_itself_in_twelve_ways_four_of_them_equally_long() {
    let both = humanoid();
    let ranking = matched(&both, &both, &all());
    assert_eq!((ranking.n_found, ranking.matches.len()), (12, 12));
    let n_equal = ranking.matches.iter().filter(|it| it.ratings()[0] < 1e-9).count();
    assert_eq!(n_equal, 4);
    assert!(is_identity(&ranking.matches[0]) && ranking.matches[1].ratings()[1] > 0.01);
    let near = matched(&both, &both, &MatchOptions::default());
    assert_eq!(near.n_found, 4);
}

#[test]
fn a_relabelled_copy_is_mapped_by_the_permutation() {
    let mut random = Random::new(7);
    let source = humanoid();
    for _ in 0..20 {
        let mut new_of_old: Vec<u32> = (0..9).collect();
        random.shuffle(&mut new_of_old);
        let mut target = source.clone();
        for (old, &new) in new_of_old.iter().enumerate() {
            target.positions[new as usize] = source.positions[old] * 3.0 + Vec3::repeat(5.0);
        }
        let rename = |it: &[u32; 2]| it.map(|it| new_of_old[it as usize]);
        target.edges = source.edges.iter().rev().map(rename).collect();
        target.roots = vec![new_of_old[0]];
        let ranking = matched(&source, &target, &MatchOptions::default());
        let best = &ranking.matches[0];
        assert!(best.nodes().iter().all(|it| it[1] == new_of_old[it[0] as usize]));
        assert!(best.ratings()[0] < 1e-9 && best.ratings()[1] < 1e-9);
    }
}

#[test]
fn three_legs_go_into_five_in_sixty_ways() {
    let (three, five) = (star(&[1.0, 2.0, 3.0]), star(&[1.0, 1.5, 2.0, 2.5, 3.0]));
    assert_eq!(matched(&three, &five, &all()).n_found, 60);
    // The larger one may be the source as well.
    let back = matched(&five, &three, &all());
    assert_eq!((back.n_found, back.matches[0].n_source()), (60, 6));
}

#[test]
fn a_cycle_is_no_part_of_a_tree() {
    let tree = star(&[1.0; 5]);
    let theta = graph(
        &[[0.0; 3], [1.0, 0.0, 0.0], [0.5, 1.0, 0.0], [0.5, -1.0, 0.0]],
        &[[0, 1], [0, 2], [2, 1], [0, 3], [3, 1]],
    );
    for cyclic in [&cycle(6), &theta] {
        assert!(matched(cyclic, &tree, &all()).matches.is_empty());
    }
    let options = MatchOptions { partial: Partial::Always, ..Default::default() };
    assert!(matched(&theta, &tree, &options).matches.is_empty());
}

#[test]
fn cycles_and_parallel_branches_match_their_like() {
    let theta = |height: f64| {
        graph(
            &[[0.0; 3], [2.0, 0.0, 0.0], [1.0, 1.0, 0.0], [1.0, -height, 0.0]],
            &[[0, 1], [0, 2], [2, 1], [0, 3], [3, 1]],
        )
    };
    let collapsed = collapse(&theta(2.0));
    assert_eq!((collapsed.nodes.len(), collapsed.branches.len()), (2, 3));
    let ranking = matched(&theta(2.0), &theta(2.0), &MatchOptions::default());
    assert!(is_identity(&ranking.matches[0]) && ranking.matches[0].branches().len() == 3);
    // A ring with a tail: a loop at one node.
    let lollipop = graph(
        &[[0.0; 3], [1.0, 1.0, 0.0], [2.0, 0.0, 0.0], [1.0, -1.0, 0.0], [-1.0, 0.0, 0.0]],
        &[[0, 1], [1, 2], [2, 3], [3, 0], [0, 4]],
    );
    let collapsed = collapse(&lollipop);
    assert_eq!((collapsed.nodes.clone(), collapsed.degree(0)), (vec![0, 4], 3));
    let best = &matched(&lollipop, &lollipop, &MatchOptions::default()).matches[0];
    assert!(best.ratings()[0] < 1e-12 && best.branches().len() == 2);
}

#[test]
fn a_cycle_keeps_its_root_and_the_place_opposite() {
    let mut ring = cycle(8);
    ring.roots = vec![3];
    let collapsed = collapse(&ring);
    assert_eq!(collapsed.nodes, [3, 7]);
    assert_eq!(collapsed.branches.iter().map(|it| it.inner.len()).collect::<Vec<_>>(), [3, 3]);
    let best = &matched(&cycle(8), &cycle(12), &MatchOptions::default()).matches[0];
    assert_eq!((best.nodes(), best.branches().len()), (&[[0, 0], [4, 6]][..], 2));
}

#[test]
fn paths_match_with_their_roots() {
    let path = |root: u32| {
        let points: Vec<[f64; 3]> = (0..7).map(|it| [f64::from(it), 0.0, 0.0]).collect();
        let edges: Vec<[u32; 2]> = (0..6).map(|it| [it, it + 1]).collect();
        SkeletonGraph { roots: vec![root], ..graph(&points, &edges) }
    };
    let best = &matched(&path(2), &path(3), &MatchOptions::default()).matches[0];
    assert_eq!(best.nodes(), [[0, 0], [2, 3], [6, 6]]);
    let sources: Vec<&[u32]> = best.branches().iter().map(|it| &it.source[..]).collect();
    assert_eq!(sources, [&[2, 1, 0][..], &[2, 3, 4, 5, 6]]);
    // A root at an end: nothing to part.
    let whole = &matched(&path(0), &path(3), &MatchOptions::default()).matches[0];
    assert_eq!((whole.nodes().len(), whole.branches().len()), (2, 1));
}

#[test]
fn a_limb_too_many_is_dropped_the_cheapest_one() {
    // Four legs do not fit three, and there is one node less to take.
    let four = star(&[1.0, 0.2, 1.0, 1.0]);
    let mut three = star(&[1.0, 1.0, 1.0]);
    // More nodes than the other: two more on a branch node at the end of a leg.
    three.positions.extend([Vec3::new(2.0, 0.2, 0.0), Vec3::new(2.0, -0.2, 0.0)]);
    three.edges.extend([[1, 4], [1, 5]]);
    assert!(matched(&four, &three, &all()).matches.is_empty());
    let ranking = matched(&four, &three, &MatchOptions::default());
    assert!(ranking.is_partial);
    let best = &ranking.matches[0];
    assert_eq!(best.target_of(0), Some(0));
    assert_eq!(best.target_of(2), None, "the short leg");
    assert_eq!(best.nodes().len(), 4);
}

#[test]
fn spurs_on_both_sides_are_passed_by() {
    let mut source = humanoid();
    let mut target = humanoid();
    // A spur at an elbow here, at a knee there: both become branch nodes.
    source.positions.push(Vec3::new(0.45, 1.3, 0.0));
    source.edges.push([5, 9]);
    target.positions.extend([Vec3::new(0.1, 0.5, 0.0), Vec3::new(0.1, 0.5, 0.1)]);
    target.edges[0] = [0, 9];
    target.edges.extend([[9, 1], [9, 10]]);
    let options = MatchOptions { partial: Partial::Always, ..Default::default() };
    let best = &matched(&source, &target, &options).matches[0];
    let expected = [[0, 0], [1, 1], [2, 2], [3, 3], [4, 4], [7, 7], [8, 8]];
    assert_eq!(best.nodes(), expected);
    let along = |ends: [u32; 2]| {
        let joins = |it: &&MatchedBranch| [it.source[0], *it.source.last().unwrap()] == ends;
        best.branches().iter().find(joins).unwrap()
    };
    assert_eq!(
        (&along([3, 7]).source[..], &along([3, 7]).target[..]),
        (&[3, 5, 7][..], &[3, 5, 7][..])
    );
    assert_eq!(along([0, 1]).target, [0, 9, 1]);
}

#[test]
fn a_turn_about_the_axis_is_no_reflection() {
    // A head that looks forward tells left from right.
    let mut source = humanoid();
    source.positions[4] = Vec3::new(0.0, 1.7, 0.3);
    let turn = nalgebra::UnitQuaternion::from_axis_angle(&Vec3::y_axis(), 2.5);
    let mut target = source.clone();
    target.positions.iter_mut().for_each(|it| *it = turn * *it + Vec3::x());
    let still = &matched(&source, &target, &MatchOptions::default()).matches[0];
    assert!(!is_identity(still), "turned by more than a quarter, sides look swapped");
    let options = MatchOptions { turn_axis: Some(Vec3::y()), ..Default::default() };
    let turned = &matched(&source, &target, &options).matches[0];
    assert!(is_identity(turned) && turned.ratings()[1] < 1e-9);
    let mut mirrored = source.clone();
    mirrored.positions.iter_mut().for_each(|it| it.x = -it.x);
    let mirrored = matched(&source, &mirrored, &options);
    let identity = mirrored.matches.iter().find(|it| is_identity(it)).unwrap();
    assert!(identity.ratings()[1] > 0.05, "left stays left");
}

#[test]
fn small_and_apart() {
    let node = graph(&[[1.0, 2.0, 3.0]], &[]);
    let best = &matched(&node, &node, &MatchOptions::default()).matches[0];
    assert_eq!((best.nodes(), best.branches().len()), (&[[0, 0]][..], 0));
    assert_eq!(matched(&node, &humanoid(), &MatchOptions::default()).matches[0].nodes().len(), 1);
    let mut two = humanoid();
    let n_nodes = two.positions.len() as u32;
    two.positions.extend([Vec3::x() * 9.0, Vec3::x() * 10.0]);
    two.edges.push([n_nodes, n_nodes + 1]);
    two.roots.push(n_nodes);
    assert!(is_identity(&matched(&two, &two, &MatchOptions::default()).matches[0]));
    let partial = MatchOptions { partial: Partial::Always, ..Default::default() };
    assert_eq!(matched(&two, &humanoid(), &partial).matches[0].nodes().len(), 7);
    let mut nothing = graph(&[], &[]);
    let check = |target: &SkeletonGraph, expected: &str| {
        let error = match_skeletons(&node, target, &MatchOptions::default()).unwrap_err();
        assert_eq!(error.to_string(), expected);
    };
    check(&nothing, "the target has no nodes");
    nothing.positions.push(Vec3::zeros());
    nothing.edges.push([0, 4]);
    check(&nothing, "the target names node 4, but it has 1 nodes");
    let many = star(&[1.0; 2000]);
    assert!(match_skeletons(&many, &many, &MatchOptions::default()).is_err());
}

#[test]
fn symmetric_stars_take_bounded_time() {
    let mut random = Random::new(3);
    let mut noisy = || -> Vec<f64> { (0..20).map(|_| random.between(0.9, 1.1)).collect() };
    let (equal, noisy, other) = (star(&[1.0; 20]), star(&noisy()), star(&noisy()));
    for (source, target, is_same) in
        [(&equal, &equal, true), (&noisy, &noisy, true), (&noisy, &other, false)]
    {
        for turn_axis in [None, Some(Vec3::y())] {
            for partial in [Partial::Needed, Partial::Always] {
                let options = MatchOptions { turn_axis, partial, ..Default::default() };
                let start = std::time::Instant::now();
                let ranking = matched(source, target, &options);
                // In release 10 to 50 ms; far more than that is no search with bounds.
                assert!(start.elapsed().as_secs() < 5, "{:?}", start.elapsed());
                println!("{:?}", start.elapsed());
                assert_eq!(ranking.matches[0].nodes().len(), 21);
                let is_found = is_identity(&ranking.matches[0]);
                assert!(is_found || !is_same, "places decide among equal legs");
            }
        }
    }
}

/// Two legs beside each other, one swung forwards by `swing`, the other one backwards.
fn striding(swing: f64) -> SkeletonGraph {
    let mut points = vec![[0.0, 1.0, 0.0], [0.0, 1.3, 0.6], [0.0, 1.0, -1.0]];
    let mut edges = vec![[0, 1], [0, 2]];
    for side in [1.0, -1.0] {
        let first = points.len() as u32;
        points.extend([
            [0.15 * side, 0.9, 0.02 * swing * side],
            [0.15 * side, 0.5, 0.4 * swing * side],
            [0.15 * side, 0.1, 0.8 * swing * side],
        ]);
        edges.extend([[0, first], [first, first + 1], [first + 1, first + 2]]);
    }
    graph(&points, &edges)
}

#[test]
fn directions_tell_left_from_right_where_places_do_not() {
    let (left_ahead, right_ahead) = (striding(1.0), striding(-1.0));
    for (second_rating, is_swapped) in
        [(SecondRating::Places, true), (SecondRating::Directions, false)]
    {
        let options = MatchOptions { second_rating, ..Default::default() };
        let best = &matched(&left_ahead, &right_ahead, &options).matches[0];
        let foot = if is_swapped { 8 } else { 5 };
        assert_eq!(best.target_of(5), Some(foot), "{second_rating:?}");
    }
    // The same figure is rated 0, also after any turn of it.
    let options = MatchOptions { second_rating: SecondRating::Directions, ..Default::default() };
    let itself = matched(&left_ahead, &left_ahead, &options);
    assert!(itself.matches[0].ratings()[1] < 1e-9);
    let mut turned = left_ahead.clone();
    let turn = nalgebra::UnitQuaternion::new(Vec3::y() * 2.0);
    turned.positions.iter_mut().for_each(|it| *it = turn * *it);
    let options = MatchOptions { turn_axis: Some(Vec3::y()), ..options };
    let best = &matched(&left_ahead, &turned, &options).matches[0];
    assert!(best.ratings()[1] < 1e-9 && best.target_of(5) == Some(5));
}
