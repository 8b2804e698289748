//! ZoomOut: functional maps grown from coarse to fine.

use faer::Mat;

use super::{
    functional_map::{FunctionalMap, PointMap, WrongSpace},
    nearest::nearest_rows,
    point_map::point_map,
};
use crate::kernels::{
    geometry::{farthest_points::farthest_points, mesh::Vec3},
    numerics::{cholesky::Cholesky, tall},
    spectral::basis::Basis,
};

/// Options of [`zoomout`].
#[derive(Debug, Clone, PartialEq)]
pub struct ZoomOutOptions {
    /// The eigenfunctions of the final map.
    pub k: usize,
    /// Eigenfunctions added at a time.
    pub step: usize,
    /// Vertices of either shape that take part while eigenfunctions are added; 0 for all.
    pub samples: usize,
    /// Matchings of all vertices at the full `k`, after those of samples.
    pub final_rounds: usize,
    /// Weighs vertices by their areas when a map follows from matches, so that uneven sampling does
    /// not matter. The paper's demo does not.
    pub mass_weighted: bool,
}

impl Default for ZoomOutOptions {
    fn default() -> Self {
        Self { k: 120, step: 5, samples: 3000, final_rounds: 0, mass_weighted: true }
    }
}

/// Why a map cannot be refined.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ZoomOutError {
    #[error("the step is zero")]
    NoStep,
    #[error("{k} eigenfunctions are wanted, but the {side} basis has {available}")]
    FewPairs { side: &'static str, k: usize, available: usize },
    #[error(
        "the map is {n_rows} x {n_cols}: refining to {k} eigenfunctions needs a square map of at \
         most that size"
    )]
    Shape { n_rows: usize, n_cols: usize, k: usize },
    #[error("the map has an entry that is not finite")]
    NotFinite,
    #[error("{samples} samples do not determine {k} coefficients")]
    FewSamples { samples: usize, k: usize },
    #[error(transparent)]
    WrongSpace(#[from] WrongSpace),
}

/// Refines a functional map by matching points and adding eigenfunctions in turns.
///
/// From the matches `m` of source vertices, nearest rows of `Psi_k C^T` to rows of `Phi_k`, follows
/// the map with more eigenfunctions `C = Phi^+ Psi[m]` (Melzi et al. 2019, for `C: F(N) -> F(M)`).
/// `Phi^+` is the least-squares solution weighted by areas, `Phi^T A_M` if all vertices take part;
/// that of samples are the areas of their cells. The returned matches come from the returned map.
///
/// Coordinates are those of both shapes at total area one, as in
/// [`super::fmap::fit_functional_map`]. The positions serve to choose samples, spread by
/// farthest-point sampling; without them, the first eigenfunctions do.
///
/// # Errors
/// See [`ZoomOutError`].
pub fn zoomout(
    source: (&Basis, Option<&[Vec3]>),
    target: (&Basis, Option<&[Vec3]>),
    map: &FunctionalMap,
    options: &ZoomOutOptions,
) -> Result<(FunctionalMap, PointMap), ZoomOutError> {
    let map = refine(source, target, map, options)?;
    let matches = point_map(source.0, target.0, &map);
    Ok((map, matches))
}

/// [`zoomout`] without the matches of all vertices in the end, which functional transfer does not
/// need and which take most of the time for large meshes.
///
/// # Errors
/// See [`ZoomOutError`].
pub fn refine(
    source: (&Basis, Option<&[Vec3]>),
    target: (&Basis, Option<&[Vec3]>),
    map: &FunctionalMap,
    options: &ZoomOutOptions,
) -> Result<FunctionalMap, ZoomOutError> {
    let start = check(source.0, target.0, map, options)?;
    let samples = |shape| Vertices::samples(shape, options);
    let sampled = (samples(source), samples(target));
    let few = |k| ZoomOutError::FewSamples { samples: sampled.0.count(), k };
    let mut map = map.source_from_target.clone();
    let mut k = start;
    while k < options.k {
        let next = (k + options.step).min(options.k);
        map = round(&sampled.0, &sampled.1, &map, next).ok_or_else(|| few(next))?;
        k = next;
    }
    let all = (Vertices::all(source.0, options), Vertices::all(target.0, options));
    for _ in 0..options.final_rounds {
        map = round(&all.0, &all.1, &map, options.k).ok_or_else(|| few(options.k))?;
    }
    Ok(FunctionalMap::new(source.0, target.0, map))
}

/// Matches by a map, and the map with `k` eigenfunctions that follows from the matches.
fn round(
    source: &Vertices<'_>,
    target: &Vertices<'_>,
    map: &Mat<f64>,
    k: usize,
) -> Option<Mat<f64>> {
    let points = target.functions(map.ncols());
    let points = tall::product(points.as_ref(), map.transpose());
    let matches = nearest_rows(source.functions(map.nrows()).as_ref(), points.as_ref());
    source.pull_back(target, &matches, k)
}

fn check(
    source: &Basis,
    target: &Basis,
    map: &FunctionalMap,
    options: &ZoomOutOptions,
) -> Result<usize, ZoomOutError> {
    map.check_bases(source, target)?;
    let (map, k) = (&map.source_from_target, options.k);
    let (n_rows, n_cols) = (map.nrows(), map.ncols());
    for (side, available) in [("source", source.k()), ("target", target.k())] {
        if available < k {
            return Err(ZoomOutError::FewPairs { side, k, available });
        }
    }
    if options.step == 0 {
        return Err(ZoomOutError::NoStep);
    }
    if n_rows != n_cols || n_rows > k || n_rows == 0 {
        return Err(ZoomOutError::Shape { n_rows, n_cols, k });
    }
    if !map.is_all_finite() {
        return Err(ZoomOutError::NotFinite);
    }
    if options.samples > 0 && options.samples < k {
        return Err(ZoomOutError::FewSamples { samples: options.samples, k });
    }
    Ok(n_rows)
}

/// The vertices of a shape that take part.
struct Vertices<'a> {
    basis: &'a Basis,
    /// `None` for all vertices.
    chosen: Option<Vec<u32>>,
    /// Areas at total area one; `None` for equal weights.
    weights: Option<Vec<f64>>,
}

impl<'a> Vertices<'a> {
    fn all(basis: &'a Basis, options: &ZoomOutOptions) -> Self {
        let weights = options.mass_weighted.then(|| {
            let area = basis.area();
            basis.mass.iter().map(|it| it / area).collect()
        });
        Self { basis, chosen: None, weights }
    }

    fn samples((basis, positions): (&'a Basis, Option<&[Vec3]>), options: &ZoomOutOptions) -> Self {
        let n_vertices = basis.n_vertices();
        if options.samples == 0 || options.samples >= n_vertices {
            return Self::all(basis, options);
        }
        let spread = match positions {
            Some(positions) => farthest_points(positions, options.samples),
            None => farthest_points(&spectral_positions(basis), options.samples),
        };
        let weights = options.mass_weighted.then(|| spread.sums(&basis.mass));
        Self { basis, chosen: Some(spread.chosen), weights }
    }

    fn count(&self) -> usize {
        self.chosen.as_ref().map_or(self.basis.n_vertices(), Vec::len)
    }

    /// The first `k` eigenfunctions at the vertices, `s x k`, at total area one.
    fn functions(&self, k: usize) -> Mat<f64> {
        let factor = self.basis.area().sqrt();
        match &self.chosen {
            None => self.basis.truncated(k) * faer::Scale(factor),
            Some(chosen) => gather(self.basis, chosen, k),
        }
    }

    /// `Phi^+ Psi[matches]` for matches of these vertices among those of the target.
    fn pull_back(&self, target: &Vertices<'_>, matches: &[u32], k: usize) -> Option<Mat<f64>> {
        let pulled = match &target.chosen {
            None => gather(target.basis, matches, k),
            Some(chosen) => {
                let vertices: Vec<u32> = matches.iter().map(|&it| chosen[it as usize]).collect();
                gather(target.basis, &vertices, k)
            }
        };
        let own = self.functions(k);
        let ones;
        let weights = match &self.weights {
            Some(weights) => weights,
            None => {
                ones = vec![1.0; self.count()];
                &ones
            }
        };
        let right = tall::mass_products(own.as_ref(), weights, pulled.as_ref());
        // Eigenfunctions at all vertices are orthonormal with respect to the masses.
        if self.chosen.is_none() && self.weights.is_some() {
            return Some(right);
        }
        let gram = tall::mass_products(own.as_ref(), weights, own.as_ref());
        Some(Cholesky::new(gram.as_ref())?.solve(right.as_ref()))
    }
}

/// Places of the vertices that know nothing but the basis: the first eigenfunctions, as long as their
/// waves are.
fn spectral_positions(basis: &Basis) -> Vec<Vec3> {
    let coordinate = |vertex: usize, axis: usize| match basis.eigenvalues.get(axis + 1) {
        Some(value) if *value > 0.0 => basis.eigenvectors[(vertex, axis + 1)] / value.sqrt(),
        _ => 0.0,
    };
    let place = |it| Vec3::new(coordinate(it, 0), coordinate(it, 1), coordinate(it, 2));
    (0..basis.n_vertices()).map(place).collect()
}

/// The first `k` eigenfunctions at some vertices, at total area one.
fn gather(basis: &Basis, vertices: &[u32], k: usize) -> Mat<f64> {
    let factor = basis.area().sqrt();
    let mut res = Mat::zeros(vertices.len(), k);
    for column in 0..k {
        let values = basis.eigenvectors.col_as_slice(column);
        for (slot, &vertex) in res.col_as_slice_mut(column).iter_mut().zip(vertices) {
            *slot = factor * values[vertex as usize];
        }
    }
    res
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::{
        geometry::mesh::TriMesh,
        maps::{
            chirality::chirality,
            fmap::{FitOptions, Solver, fit_functional_map},
            map_quality,
        },
        rigs::{skeleton::Skeleton, weights::SkinWeights},
        spectral::descriptors::{DescriptorOptions, descriptors},
        test_shapes::{LANDMARKS, basis_of, creature, landmarks, permuted},
        transfer::{
            exact_regressor::{RegressorOptions, exact_regressor},
            skeleton_transfer::{spectral_regressor, transfer_by_functions, transfer_by_points},
        },
    };

    const FIT: FitOptions = FitOptions {
        k: 12,
        descriptors: 0.1,
        commutativity: 1.0,
        laplacian: 1e-3,
        normalized_gaps: true,
        solver: Solver::Exact,
    };
    const REFINE: ZoomOutOptions =
        ZoomOutOptions { k: 60, step: 6, samples: 0, final_rounds: 0, mass_weighted: true };

    fn fitted(source: (&Basis, &[u32]), target: (&Basis, &[u32])) -> FunctionalMap {
        let options = DescriptorOptions::default();
        let g = descriptors(source.0, &landmarks(source.1), &options).unwrap();
        let f = descriptors(target.0, &landmarks(target.1), &options).unwrap();
        fit_functional_map((source.0, &g), (target.0, &f), &FIT).unwrap()
    }

    fn refined(
        source: (&Basis, &[u32]),
        target: (&Basis, &[u32]),
        options: &ZoomOutOptions,
    ) -> (FunctionalMap, PointMap) {
        let map = fitted(source, target);
        zoomout((source.0, None), (target.0, None), &map, options).unwrap()
    }

    /// Joints inside of [`creature`], with weights that blend between the nearest two.
    fn rig(mesh: &TriMesh) -> (Skeleton, SkinWeights) {
        let names = ["root", "limb", "other"].map(str::to_owned).to_vec();
        let positions = vec![Vec3::zeros(), Vec3::new(0.0, 0.0, 0.8), Vec3::new(0.7, 0.0, -0.25)];
        let skeleton = Skeleton::new(names, vec![None, Some(0), Some(0)], positions).unwrap();
        let near = |p: &Vec3, joint: usize| (-(p - skeleton.positions()[joint]).norm()).exp();
        let rows: Vec<_> = mesh
            .vertices()
            .iter()
            .map(|p| (0..3).map(|joint| (joint as u32, near(p, joint))).collect())
            .collect();
        (skeleton, SkinWeights::from_rows(3, &rows).unwrap())
    }

    /// Test 5: the map of a shape to itself renumbered finds every vertex, and the error of the joints
    /// is that of the truncated coordinates.
    #[test]
    fn a_renumbered_shape_is_found_again() {
        let mesh = creature(0.0);
        let (renumbered, order) = permuted(&mesh);
        let (source, target) = (basis_of(&mesh, 60), basis_of(&renumbered, 60));
        let moved = LANDMARKS.map(|it| order[it as usize]);
        let (map, matches) = refined((&source, &LANDMARKS), (&target, &moved), &REFINE);
        assert_eq!(matches.target_of_source, order);
        let orthogonality = map_quality::orthogonality(map.source_from_target.as_ref());
        assert!(orthogonality < 1e-8, "{orthogonality}");
        assert!(map_quality::coverage(&matches, &target.mass) > 1.0 - 1e-12);
        let kept = chirality((&source, &mesh), (&target, &renumbered), &map).unwrap();
        assert!(kept > 1.0 - 1e-6, "{kept}");

        let (skeleton, weights) = rig(&mesh);
        let (regressor, _) =
            exact_regressor(&mesh, &skeleton, &weights, &RegressorOptions::default()).unwrap();
        let spectral = spectral_regressor(&regressor, &source, 60).unwrap();
        let functional =
            transfer_by_functions(&spectral, &map, &target, renumbered.vertices()).unwrap();
        let pointwise = transfer_by_points(&regressor, &matches, renumbered.vertices()).unwrap();
        let smooth = source.reconstruct(source.project_vertices(mesh.vertices()).as_ref());
        for joint in 0..3 {
            let truncated: Vec3 = regressor
                .matrix
                .row(joint)
                .map(|(it, r)| Vec3::new(smooth[(it, 0)], smooth[(it, 1)], smooth[(it, 2)]) * r)
                .sum();
            assert!((functional.positions()[joint] - truncated).norm() < 1e-9);
            assert!((pointwise.positions()[joint] - skeleton.positions()[joint]).norm() < 1e-12);
        }
    }

    /// Test 6: moving and scaling the target moves and scales its joints.
    #[test]
    fn joints_follow_a_moved_and_scaled_target() {
        let (mesh, changed) = (creature(0.0), creature(0.3));
        let turn = nalgebra::Rotation3::from_euler_angles(0.3, -1.1, 2.0);
        let carry = |p: &Vec3| turn * p * 37.5 + Vec3::new(100.0, -3.0, 8.0);
        let moved = changed.with_vertices(changed.vertices().iter().map(carry).collect()).unwrap();
        let source = basis_of(&mesh, 60);
        let (skeleton, weights) = rig(&mesh);
        let (regressor, _) =
            exact_regressor(&mesh, &skeleton, &weights, &RegressorOptions::default()).unwrap();
        let spectral = spectral_regressor(&regressor, &source, 60).unwrap();
        let joints = |target: &TriMesh| {
            let basis = basis_of(target, 60);
            let (map, matches) = refined((&source, &LANDMARKS), (&basis, &LANDMARKS), &REFINE);
            let functional =
                transfer_by_functions(&spectral, &map, &basis, target.vertices()).unwrap();
            (functional, transfer_by_points(&regressor, &matches, target.vertices()).unwrap())
        };
        let (here, there) = (joints(&changed), joints(&moved));
        for joint in 0..3 {
            for (a, b) in [(&here.0, &there.0), (&here.1, &there.1)] {
                let gap = carry(&a.positions()[joint]) - b.positions()[joint];
                assert!(gap.norm() < 1e-5, "joint {joint}: {gap}");
            }
        }
        // A basis of a normalized copy serves the original as well.
        let basis = basis_of(&changed, 60);
        let (map, _) = refined((&source, &LANDMARKS), (&basis, &LANDMARKS), &REFINE);
        let mixed = transfer_by_functions(&spectral, &map, &basis, moved.vertices()).unwrap();
        for joint in 0..3 {
            let gap = carry(&here.0.positions()[joint]) - mixed.positions()[joint];
            assert!(gap.norm() < 1e-9, "joint {joint}: {gap}");
        }
    }

    /// Test 7: with the true map and all eigenfunctions, functional and pointwise transfer agree.
    #[test]
    fn with_all_eigenfunctions_both_transfers_agree() {
        let (mesh, changed) = (creature(0.0), creature(0.3));
        let (skeleton, weights) = rig(&mesh);
        let (regressor, _) =
            exact_regressor(&mesh, &skeleton, &weights, &RegressorOptions::default()).unwrap();
        let identity: Vec<u32> = (0..mesh.n_vertices() as u32).collect();
        let matches = PointMap { n_target: identity.len(), target_of_source: identity };
        let pointwise = transfer_by_points(&regressor, &matches, changed.vertices()).unwrap();
        let mut gaps = Vec::new();
        for k in [20, 80, mesh.n_vertices()] {
            let (source, target) = (basis_of(&mesh, k), basis_of(&changed, k));
            let all = |basis| Vertices::all(basis, &REFINE);
            let map = all(&source).pull_back(&all(&target), &matches.target_of_source, k).unwrap();
            let map = FunctionalMap::new(&source, &target, map);
            let spectral = spectral_regressor(&regressor, &source, k).unwrap();
            let functional =
                transfer_by_functions(&spectral, &map, &target, changed.vertices()).unwrap();
            let gap = |it: usize| (functional.positions()[it] - pointwise.positions()[it]).norm();
            gaps.push((0..3).map(gap).fold(0.0, f64::max));
        }
        assert!(gaps[0] > gaps[1] && gaps[2] < 1e-8, "{gaps:?}");
    }

    /// Test 9: applying the regressor to the carried coordinates is the same product.
    #[test]
    fn the_farm_baseline_is_the_same_product() {
        let (mesh, changed) = (creature(0.0), creature(0.3));
        let (source, target) = (basis_of(&mesh, 60), basis_of(&changed, 60));
        let (map, _) = refined((&source, &LANDMARKS), (&target, &LANDMARKS), &REFINE);
        let (skeleton, weights) = rig(&mesh);
        let (regressor, _) =
            exact_regressor(&mesh, &skeleton, &weights, &RegressorOptions::default()).unwrap();
        let spectral = spectral_regressor(&regressor, &source, 60).unwrap();
        let proposed = transfer_by_functions(&spectral, &map, &target, changed.vertices()).unwrap();
        let units = faer::Scale((source.area() / target.area()).sqrt());
        let carried = &map.source_from_target * target.project_vertices(changed.vertices()) * units;
        let on_source = source.reconstruct(carried.as_ref());
        for joint in 0..3 {
            for axis in 0..3 {
                let farm = regressor.matrix.mul_vec(on_source.col_as_slice(axis))[joint];
                assert!((farm - proposed.positions()[joint][axis]).abs() < 1e-10);
            }
        }
    }

    /// A shape that is symmetric about `x = 0` but for its landmarks.
    fn symmetric() -> TriMesh {
        let sphere = crate::kernels::geometry::shapes::geodesic_sphere(8);
        let grow = |p: &Vec3| {
            let limb = |axis: Vec3, length: f64, sharpness: f64| {
                let side = p.dot(&axis.normalize()) - 1.0;
                length * (sharpness * side).exp()
            };
            let body = 1.0
                + limb(Vec3::new(1.0, 0.2, 0.0), 1.2, 9.0)
                + limb(Vec3::new(-1.0, 0.2, 0.0), 1.2, 9.0)
                + limb(Vec3::new(0.0, 1.0, 0.1), 0.6, 8.0);
            p.component_mul(&Vec3::new(1.0, 0.9, 0.6 + 0.15 * p.z)) * body
        };
        sphere.with_vertices(sphere.vertices().iter().map(grow).collect()).unwrap()
    }

    fn extreme(mesh: &TriMesh, direction: Vec3) -> u32 {
        let reach = |it: &usize| mesh.vertices()[*it].dot(&direction);
        (0..mesh.n_vertices()).max_by(|a, b| reach(a).total_cmp(&reach(b))).unwrap() as u32
    }

    /// Test 10: swapped landmarks give the mirrored skeleton, and the orientation tells.
    #[test]
    fn swapped_landmarks_mirror_the_skeleton() {
        let mesh = symmetric();
        let basis = basis_of(&mesh, 60);
        let [left, right] = [Vec3::x(), -Vec3::x()].map(|it| extreme(&mesh, it));
        let rest = [Vec3::y(), Vec3::z(), -Vec3::z()].map(|it| extreme(&mesh, it));
        let straight = [left, right, rest[0], rest[1], rest[2]];
        let swapped = [right, left, rest[0], rest[1], rest[2]];
        let hand = Vec3::new(1.2, 0.25, 0.0);
        let skeleton = Skeleton::new(vec!["hand".to_owned()], vec![None], vec![hand]).unwrap();
        let near = |p: &Vec3| (p - hand).norm() < 0.8;
        let rows: Vec<_> =
            mesh.vertices().iter().map(|p| vec![(0, if near(p) { 1.0 } else { 0.5 })]).collect();
        let weights = SkinWeights::from_rows(1, &rows).unwrap();
        let (regressor, _) =
            exact_regressor(&mesh, &skeleton, &weights, &RegressorOptions::default()).unwrap();
        for (landmarks, sign) in [(straight, 1.0), (swapped, -1.0)] {
            let (map, matches) = refined((&basis, &straight), (&basis, &landmarks), &REFINE);
            let joint = transfer_by_points(&regressor, &matches, mesh.vertices()).unwrap();
            let joint = joint.positions()[0];
            let expected = Vec3::new(sign * hand.x, hand.y, hand.z);
            assert!((joint - expected).norm() < 0.15, "{joint} instead of {expected}");
            let kept = chirality((&basis, &mesh), (&basis, &mesh), &map).unwrap();
            assert!(sign * kept > 0.8, "{kept}");
        }
    }

    #[test]
    fn samples_are_enough() {
        let mesh = creature(0.0);
        let (renumbered, order) = permuted(&mesh);
        let (source, target) = (basis_of(&mesh, 60), basis_of(&renumbered, 60));
        let moved = LANDMARKS.map(|it| order[it as usize]);
        let map = fitted((&source, &LANDMARKS), (&target, &moved));
        let options = ZoomOutOptions { samples: 200, ..REFINE };
        let places = (Some(mesh.vertices()), Some(renumbered.vertices()));
        for (from, to) in [places, (None, None)] {
            let (_, matches) = zoomout((&source, from), (&target, to), &map, &options).unwrap();
            let pairs = matches.target_of_source.iter().zip(&order);
            let found = pairs.filter(|it| it.0 == it.1).count();
            assert!(found * 10 > order.len() * 6, "{found} of {}", order.len());
        }
        // One matching of all vertices finds the rest.
        let options = ZoomOutOptions { final_rounds: 2, ..options };
        let (_, matches) =
            zoomout((&source, places.0), (&target, places.1), &map, &options).unwrap();
        assert_eq!(matches.target_of_source, order);
    }

    #[test]
    fn unfit_maps_are_refused() {
        let basis = basis_of(&creature(0.0), 20);
        let check = |size: (usize, usize), options: ZoomOutOptions, expected: &str| {
            let map = FunctionalMap::without_spaces(Mat::identity(size.0, size.1));
            let error = zoomout((&basis, None), (&basis, None), &map, &options).unwrap_err();
            assert_eq!(error.to_string(), expected);
        };
        let options = |k, step, samples| ZoomOutOptions { k, step, samples, ..REFINE };
        check(
            (5, 5),
            options(30, 5, 0),
            "30 eigenfunctions are wanted, but the source basis has 20",
        );
        check((5, 5), options(20, 0, 0), "the step is zero");
        check((5, 5), options(20, 5, 9), "9 samples do not determine 20 coefficients");
        check(
            (5, 4),
            options(20, 5, 0),
            "the map is 5 x 4: refining to 20 eigenfunctions needs a square map of at most that size",
        );
    }
}
