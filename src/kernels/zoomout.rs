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
        map = source.pull_back(&target, &matches, k).ok_or(ZoomOutError::FewSamples {
            samples: options.samples,
            k,
        })?;
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
            None => (0..options.samples)
                .map(|it| (it * n_vertices / options.samples) as u32)
                .collect(),
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
        let pulled = Mat::from_fn(matches.len(), k, |row, column| {
            factor * vectors[(vertex(row), column)]
        });
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
    matrix.col_iter().map(|it| it.iter().map(|value| value * value).sum::<f64>()).sum::<f64>().sqrt()
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
