//! ZoomOut: functional maps grown from coarse to fine.

use faer::{Mat, MatRef};

use super::{
    basis::Basis,
    cholesky::Cholesky,
    functional_map::{FunctionalMap, PointMap},
    mesh::{TriMesh, Vec3},
    nearest::nearest_rows,
    tall,
};

/// Options of [`zoomout`].
#[derive(Debug, Clone, PartialEq)]
pub struct ZoomOutOptions {
    /// The eigenfunctions of the final map.
    pub k: usize,
    /// Eigenfunctions added at a time.
    pub step: usize,
    /// Vertices of either shape that take part in all but the last matching; 0 for all.
    pub samples: usize,
}

impl Default for ZoomOutOptions {
    fn default() -> Self {
        Self { k: 120, step: 5, samples: 0 }
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
}

/// Refines a functional map by matching points and adding eigenfunctions in turns.
///
/// From the matches `m` of source vertices, nearest rows of `Psi_k C^T` to rows of `Phi_k`, follows
/// the map with more eigenfunctions `C = Phi^+ Psi[m]` (Melzi et al. 2019, for `C: F(N) -> F(M)`).
/// `Phi^+ = Phi^T A_M` is weighted by the masses, so that uneven sampling does not matter; among
/// samples it is the least-squares solution. The returned matches come from the returned map.
///
/// Coordinates are those of both shapes at total area one, as in
/// [`super::fmap::fit_functional_map`]. The positions serve to choose samples, spread by
/// farthest-point sampling.
///
/// # Errors
/// See [`ZoomOutError`].
pub fn zoomout(
    source: (&Basis, Option<&[Vec3]>),
    target: (&Basis, Option<&[Vec3]>),
    map: &FunctionalMap,
    options: &ZoomOutOptions,
) -> Result<(FunctionalMap, PointMap), ZoomOutError> {
    let start = check(source.0, target.0, map, options)?;
    let (source, target) = (Shape::new(source, options), Shape::new(target, options));
    let mut map = map.source_from_target.clone();
    let mut k = start;
    while k < options.k {
        let matches = nearest_rows(
            source.sampled(k).as_ref(),
            tall::product(target.sampled(k).as_ref(), map.transpose()).as_ref(),
        );
        k = (k + options.step).min(options.k);
        map = source
            .pull_back(&target, &matches, k)
            .ok_or(ZoomOutError::FewSamples { samples: options.samples, k })?;
    }
    let map = FunctionalMap { source_from_target: map };
    let matches = point_map(source.basis, target.basis, &map);
    Ok((map, matches))
}

/// The matches of a functional map: for every row of `Phi` the nearest row of `Psi C^T`.
///
/// # Panics
/// If a basis has fewer eigenfunctions than the map.
pub fn point_map(source: &Basis, target: &Basis, map: &FunctionalMap) -> PointMap {
    let map = map.source_from_target.as_ref();
    // At total area one, eigenfunctions are multiplied by the root of the area.
    let (from, to) = (source.area().sqrt(), target.area().sqrt());
    let queries = source.truncated(map.nrows()) * faer::Scale(from);
    let scaled = map.transpose() * faer::Scale(to);
    let points = tall::product(target.truncated(map.ncols()), scaled.as_ref());
    let target_of_source = nearest_rows(queries.as_ref(), points.as_ref());
    PointMap { target_of_source, n_target: target.n_vertices() }
}

fn check(
    source: &Basis,
    target: &Basis,
    map: &FunctionalMap,
    options: &ZoomOutOptions,
) -> Result<usize, ZoomOutError> {
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

/// A basis and the vertices of it that take part.
struct Shape<'a> {
    basis: &'a Basis,
    /// `None` for all vertices.
    samples: Option<Vec<u32>>,
}

impl<'a> Shape<'a> {
    fn new((basis, positions): (&'a Basis, Option<&[Vec3]>), options: &ZoomOutOptions) -> Self {
        let n_vertices = basis.n_vertices();
        let some = options.samples > 0 && options.samples < n_vertices;
        let samples = some.then(|| match positions {
            Some(positions) => farthest_points(positions, options.samples),
            None => {
                (0..options.samples).map(|it| (it * n_vertices / options.samples) as u32).collect()
            }
        });
        Self { basis, samples }
    }

    /// The first `k` eigenfunctions at the samples, `s x k`, at total area one.
    fn sampled(&self, k: usize) -> Mat<f64> {
        let factor = self.basis.area().sqrt();
        let vectors = &self.basis.eigenvectors;
        match &self.samples {
            None => self.basis.truncated(k) * faer::Scale(factor),
            Some(samples) => Mat::from_fn(samples.len(), k, |row, column| {
                factor * vectors[(samples[row] as usize, column)]
            }),
        }
    }

    /// `Phi^+ Psi[matches]` for matches of samples among the target's samples.
    fn pull_back(&self, target: &Shape<'_>, matches: &[u32], k: usize) -> Option<Mat<f64>> {
        let factor = target.basis.area().sqrt();
        let vectors = &target.basis.eigenvectors;
        let vertex = |sample: usize| match &target.samples {
            None => matches[sample] as usize,
            Some(samples) => samples[matches[sample] as usize] as usize,
        };
        let pulled =
            Mat::from_fn(matches.len(), k, |row, column| factor * vectors[(vertex(row), column)]);
        let Some(_) = &self.samples else {
            let scale = faer::Scale(1.0 / self.basis.area().sqrt());
            let vectors = self.basis.truncated(k);
            return Some(tall::mass_products(vectors, &self.basis.mass, pulled.as_ref()) * scale);
        };
        let own = self.sampled(k);
        let gram = tall::inner_products(own.as_ref(), own.as_ref());
        let right = tall::inner_products(own.as_ref(), pulled.as_ref());
        Some(Cholesky::new(gram.as_ref())?.solve(right.as_ref()))
    }
}

/// Vertices spread over a shape: each is the farthest, by Euclidean distance, from those before.
///
/// The first is vertex 0; ties go to the smallest index.
fn farthest_points(positions: &[Vec3], count: usize) -> Vec<u32> {
    let mut res = vec![0u32];
    let mut distances = vec![f64::INFINITY; positions.len()];
    while res.len() < count.min(positions.len()) {
        let last = positions[res[res.len() - 1] as usize];
        let mut farthest = (0, -1.0);
        for (vertex, position) in positions.iter().enumerate() {
            let distance = distances[vertex].min((position - last).norm_squared());
            distances[vertex] = distance;
            if distance > farthest.1 {
                farthest = (vertex, distance);
            }
        }
        res.push(farthest.0 as u32);
    }
    res
}

/// Signs of a good or a bad map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapHealth {
    /// `|C^T C - I|_F / sqrt(k)`: zero for maps that keep areas, above about 0.6 for failed ones.
    pub orthogonality: f64,
    /// The part of the target's area whose vertices are matched by some source vertex.
    pub coverage: f64,
    /// The part of the source's area whose faces keep their orientation, of those whose corners are
    /// matched to three vertices: near one for a good map, below a half for a mirrored one. NaN
    /// without meshes.
    pub chirality: f64,
}

/// Computes the signs of a good map; `meshes` are those of the source and the target.
///
/// Coverage is limited by the number of source vertices, which the denser shape does not reach.
///
/// # Panics
/// If matches, masses and meshes differ in their numbers of vertices.
pub fn map_health(
    map: &FunctionalMap,
    matches: &PointMap,
    target: &Basis,
    meshes: Option<(&TriMesh, &TriMesh)>,
) -> MapHealth {
    let map = map.source_from_target.as_ref();
    let gram = map.transpose() * map;
    let off = Mat::from_fn(gram.nrows(), gram.ncols(), |row, column| {
        gram[(row, column)] - if row == column { 1.0 } else { 0.0 }
    });
    let mut hit = vec![false; matches.n_target];
    for &vertex in &matches.target_of_source {
        hit[vertex as usize] = true;
    }
    let covered: f64 = target.mass.iter().zip(&hit).filter(|it| *it.1).map(|it| it.0).sum();
    MapHealth {
        orthogonality: norm(off.as_ref()) / (gram.nrows() as f64).sqrt(),
        coverage: covered / target.area(),
        chirality: meshes.map_or(f64::NAN, |(from, to)| chirality(from, to, matches)),
    }
}

fn norm(matrix: MatRef<'_, f64>) -> f64 {
    matrix
        .col_iter()
        .map(|it| it.iter().map(|value| value * value).sum::<f64>())
        .sum::<f64>()
        .sqrt()
}

fn chirality(source: &TriMesh, target: &TriMesh, matches: &PointMap) -> f64 {
    let normals = target.vertex_normals();
    let (mut kept, mut all) = (0.0, 0.0);
    for (face, corners) in source.faces().iter().enumerate() {
        let image = corners.map(|it| matches.target_of_source[it as usize] as usize);
        let [a, b, c] = image.map(|it| target.vertices()[it]);
        let turn = (b - a).cross(&(c - a)).dot(&image.map(|it| normals[it]).iter().sum::<Vec3>());
        if turn == 0.0 {
            continue;
        }
        let area = source.area_vector(face).norm();
        all += area;
        kept += if turn > 0.0 { area } else { 0.0 };
    }
    kept / all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::{
        descriptors::{DescriptorOptions, descriptors},
        exact_regressor::{RegressorOptions, exact_regressor},
        fmap::{FitOptions, fit_functional_map},
        skeleton::Skeleton,
        skeleton_transfer::{spectral_regressor, transfer_by_functions, transfer_by_points},
        test_shapes::{LANDMARKS, basis_of, creature, landmarks, permuted},
        weights::SkinWeights,
    };

    const FIT: FitOptions =
        FitOptions { k: 12, descriptors: 0.1, commutativity: 1.0, laplacian: 1e-3 };
    const REFINE: ZoomOutOptions = ZoomOutOptions { k: 60, step: 6, samples: 0 };

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
        let health = map_health(&map, &matches, &target, Some((&mesh, &renumbered)));
        assert!(health.orthogonality < 1e-8, "{health:?}");
        assert!(health.coverage > 1.0 - 1e-12 && health.chirality == 1.0, "{health:?}");

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
            let options = ZoomOutOptions { k, ..REFINE };
            let shape = |basis| Shape::new((basis, None), &options);
            let (from, to) = (shape(&source), shape(&target));
            let map = from.pull_back(&to, &matches.target_of_source, k).unwrap();
            let map = FunctionalMap { source_from_target: map };
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
        let sphere = crate::kernels::shapes::geodesic_sphere(8);
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
            let health = map_health(&map, &matches, &basis, Some((&mesh, &mesh)));
            assert_eq!(health.chirality > 0.5, sign > 0.0, "{health:?}");
        }
    }

    #[test]
    fn samples_are_enough() {
        let mesh = creature(0.0);
        let (renumbered, order) = permuted(&mesh);
        let (source, target) = (basis_of(&mesh, 60), basis_of(&renumbered, 60));
        let moved = LANDMARKS.map(|it| order[it as usize]);
        let map = fitted((&source, &LANDMARKS), (&target, &moved));
        let options = ZoomOutOptions { k: 60, step: 6, samples: 200 };
        let (_, matches) = zoomout(
            (&source, Some(mesh.vertices())),
            (&target, Some(renumbered.vertices())),
            &map,
            &options,
        )
        .unwrap();
        let found = matches.target_of_source.iter().zip(&order).filter(|it| it.0 == it.1).count();
        assert!(found * 10 > order.len() * 6, "{found} of {}", order.len());
    }

    #[test]
    fn unfit_maps_are_refused() {
        let basis = basis_of(&creature(0.0), 20);
        let check = |size: (usize, usize), options: ZoomOutOptions, expected: &str| {
            let map = FunctionalMap { source_from_target: Mat::identity(size.0, size.1) };
            let error = zoomout((&basis, None), (&basis, None), &map, &options).unwrap_err();
            assert_eq!(error.to_string(), expected);
        };
        let options = |k, step, samples| ZoomOutOptions { k, step, samples };
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
