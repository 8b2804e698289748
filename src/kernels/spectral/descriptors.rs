//! Descriptors: functions on a shape that look alike at corresponding points of other shapes.

use faer::Mat;

use super::{basis::Basis, function_space::FunctionSpace};
use crate::kernels::numerics::tall;

/// `p` functions on one shape.
#[derive(Debug, Clone)]
pub struct Descriptors {
    /// What each function is (`wks 10`, `wkm head_top 40`): equal names are compared across shapes.
    pub names: Vec<String>,
    /// `V x p` values by columns, each of unit norm with respect to the masses of the shape at total
    /// area one. A function that vanishes stays zero.
    pub values: Mat<f64>,
    /// The basis they were computed from; unknown for those of other programs.
    pub space: Option<FunctionSpace>,
}

impl Descriptors {
    pub fn n_vertices(&self) -> usize {
        self.values.nrows()
    }

    /// The number of functions.
    pub fn count(&self) -> usize {
        self.names.len()
    }
}

/// Which families of functions [`descriptors`] computes.
#[derive(Debug, Clone, PartialEq)]
pub struct DescriptorOptions {
    /// Energies of the wave kernels and times of the heat kernels.
    pub n_samples: usize,
    /// Keeps every so-manieth function of the concatenated families.
    pub keep_every: usize,
    /// The width of the wave kernels' bands, in steps between energies.
    pub variance: f64,
    pub wave_signature: bool,
    pub wave_landmarks: bool,
    pub heat_signature: bool,
    pub heat_landmarks: bool,
    /// The least and greatest time of the heat kernels, at total area one.
    pub heat_times: [f64; 2],
}

impl Default for DescriptorOptions {
    fn default() -> Self {
        Self {
            n_samples: 200,
            keep_every: 10,
            variance: 7.0,
            wave_signature: true,
            wave_landmarks: true,
            heat_signature: false,
            heat_landmarks: false,
            heat_times: [0.005, 0.2],
        }
    }
}

/// Why there are no descriptors.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DescriptorError {
    #[error("descriptors need at least 3 eigenpairs, but the basis has {k}")]
    FewPairs { k: usize },
    #[error("eigenpair {index} has the eigenvalue zero: the shape has several components")]
    Disconnected { index: usize },
    #[error("landmark `{name}` is vertex {vertex}, but the basis belongs to {n_vertices} vertices")]
    LandmarkOutOfRange { name: String, vertex: u32, n_vertices: usize },
    #[error("no function is left: every family is off, or the landmarks are missing")]
    Empty,
}

/// Computes wave and heat kernel functions from all eigenpairs of a basis.
///
/// With `E_k = ln lambda_k` over the `K - 1` non-constant eigenpairs and `T` samples:
/// - wave kernel signature (Aubry et al. 2011): `sum_k phi_k(x)^2 g_tk / sum_k g_tk`, where
///   `g_tk = exp(-(e_t - E_k)^2 / 2 s^2)`, `e` from the least energy to the greatest over 1.02, and
///   `s` is `variance` steps;
/// - wave kernel map of a landmark `l`: `sum_k g_tk phi_k(l) phi_k(x)`, with `e` two `s` inside of
///   the range;
/// - heat kernel signature and map: `sum_k exp(-lambda_k t) phi_k(y) phi_k(x)` for `y = x` and
///   `y = l`, at times with equal ratios.
///
/// Everything is evaluated as if the shape had total area one (eigenvalues times the area,
/// eigenfunctions times its root), so scaling a mesh changes nothing. `landmarks` are pairs of a
/// name and a vertex, in the order that both shapes share.
///
/// Energies depend on the last eigenvalue: compare shapes with equally many eigenpairs.
///
/// # Errors
/// See [`DescriptorError`].
pub fn descriptors(
    basis: &Basis,
    landmarks: &[(String, u32)],
    options: &DescriptorOptions,
) -> Result<Descriptors, DescriptorError> {
    let spectrum = Spectrum::at_unit_area(basis)?;
    for (name, vertex) in landmarks {
        let (vertex, n_vertices) = (*vertex, basis.n_vertices());
        if vertex as usize >= n_vertices {
            let name = name.clone();
            return Err(DescriptorError::LandmarkOutOfRange { name, vertex, n_vertices });
        }
    }
    let functions = functions(&spectrum, landmarks, options);
    if functions.is_empty() {
        return Err(DescriptorError::Empty);
    }
    let mut values = Mat::zeros(basis.n_vertices(), functions.len());
    let of_squares = spectrum.combine(&functions, |it| it.at.is_none());
    let of_values = spectrum.combine(&functions, |it| it.at.is_some());
    let (mut squares, mut plain) = (0..of_squares.ncols(), 0..of_values.ncols());
    for (column, function) in functions.iter().enumerate() {
        let (from, index) = match function.at {
            None => (&of_squares, squares.next()),
            Some(_) => (&of_values, plain.next()),
        };
        let index = index.expect("one column for every function");
        values.col_mut(column).copy_from(from.col(index));
        normalize(&mut values, column, basis);
    }
    let names = functions.into_iter().map(|it| it.name).collect();
    Ok(Descriptors { names, values, space: Some(FunctionSpace::of(basis)) })
}

/// One function to be: filter values over the eigenpairs, of the squared eigenfunctions or of the
/// eigenfunctions times their values at a vertex.
struct Function {
    name: String,
    at: Option<usize>,
    /// `K` factors.
    filter: Vec<f64>,
}

/// Lists the functions in the order of the demo: signatures, then landmark by landmark.
fn functions(
    spectrum: &Spectrum<'_>,
    landmarks: &[(String, u32)],
    options: &DescriptorOptions,
) -> Vec<Function> {
    let mut all: Vec<(String, Option<usize>, Family)> = Vec::new();
    let mut add = |name: String, at, family| all.push((name, at, family));
    if options.wave_signature {
        add("wks".to_owned(), None, Family::WaveSignature);
    }
    if options.heat_signature {
        add("hks".to_owned(), None, Family::Heat);
    }
    for (name, vertex) in landmarks {
        let vertex = Some(*vertex as usize);
        if options.wave_landmarks {
            add(format!("wkm {name}"), vertex, Family::WaveMap);
        }
        if options.heat_landmarks {
            add(format!("hkm {name}"), vertex, Family::Heat);
        }
    }
    let samples = 0..options.n_samples;
    let pairs = all.iter().flat_map(|family| samples.clone().map(move |sample| (family, sample)));
    pairs
        .step_by(options.keep_every.max(1))
        .map(|((name, at, family), sample)| Function {
            name: format!("{name} {sample}"),
            at: *at,
            filter: spectrum.filter(*family, sample, options),
        })
        .collect()
}

#[derive(Clone, Copy)]
enum Family {
    WaveSignature,
    WaveMap,
    Heat,
}

/// A basis at total area one.
struct Spectrum<'a> {
    basis: &'a Basis,
    area: f64,
    /// `K` eigenvalues.
    eigenvalues: Vec<f64>,
    /// `ln` of all eigenvalues but the first.
    energies: Vec<f64>,
}

impl<'a> Spectrum<'a> {
    fn at_unit_area(basis: &'a Basis) -> Result<Self, DescriptorError> {
        let k = basis.k();
        if k < 3 {
            return Err(DescriptorError::FewPairs { k });
        }
        let area = basis.area();
        let eigenvalues: Vec<f64> = basis.eigenvalues.iter().map(|it| it * area).collect();
        if let Some(index) = (1..k).find(|&it| eigenvalues[it] < 1e-6) {
            return Err(DescriptorError::Disconnected { index });
        }
        let energies = eigenvalues[1..].iter().map(|it| it.ln()).collect();
        Ok(Self { basis, area, eigenvalues, energies })
    }

    /// The `K` filter values of one sample of a family. Waves leave the constant function out.
    fn filter(&self, family: Family, sample: usize, options: &DescriptorOptions) -> Vec<f64> {
        let n_steps = (options.n_samples.max(2) - 1) as f64;
        let fraction = sample as f64 / n_steps;
        let (least, most) = (self.energies[0], self.energies[self.energies.len() - 1]);
        match family {
            Family::WaveSignature => {
                // A greatest energy below zero would be moved up by the division.
                let most = if most > 0.0 { most / 1.02 } else { most };
                let width = options.variance * (most - least) / n_steps;
                let mut band = self.band(least + fraction * (most - least), width);
                let sum: f64 = band.iter().sum();
                band.iter_mut().for_each(|it| *it /= sum);
                band
            }
            Family::WaveMap => {
                let width = options.variance * (most - least) / options.n_samples as f64;
                let (least, most) = (least + 2.0 * width, most - 2.0 * width);
                self.band(least + fraction * (most - least), width)
            }
            Family::Heat => {
                let [first, last] = options.heat_times;
                let time = first * (last / first).powf(fraction);
                self.eigenvalues.iter().map(|it| (-it * time).exp()).collect()
            }
        }
    }

    /// A Gaussian band of energies.
    fn band(&self, energy: f64, width: f64) -> Vec<f64> {
        // Equal energies make a band without width; it is then flat.
        let width = width.max(1e-12);
        let gauss = |it: &f64| (-(energy - it).powi(2) / (2.0 * width * width)).exp();
        std::iter::once(0.0).chain(self.energies.iter().map(gauss)).collect()
    }

    /// The wanted functions as one product: `V x K` eigenfunctions (squared for signatures) times
    /// `K x p'` filters.
    fn combine(&self, functions: &[Function], wanted: impl Fn(&Function) -> bool) -> Mat<f64> {
        let wanted: Vec<&Function> = functions.iter().filter(|it| wanted(it)).collect();
        let vectors = self.basis.eigenvectors.as_ref();
        if wanted.is_empty() {
            return Mat::zeros(vectors.nrows(), 0);
        }
        let filters = Mat::from_fn(self.basis.k(), wanted.len(), |pair, column| {
            let at = wanted[column].at.map_or(1.0, |vertex| vectors[(vertex, pair)]);
            self.area * at * wanted[column].filter[pair]
        });
        if wanted[0].at.is_some() {
            return tall::product(vectors, filters.as_ref());
        }
        let squares = Mat::from_fn(vectors.nrows(), vectors.ncols(), |row, column| {
            vectors[(row, column)].powi(2)
        });
        tall::product(squares.as_ref(), filters.as_ref())
    }
}

/// Norms below this are rounding noise of functions that vanish.
const VANISHING: f64 = 1e-12;

fn normalize(values: &mut Mat<f64>, column: usize, basis: &Basis) {
    let column = values.col_as_slice_mut(column);
    let area = basis.area();
    let squares = column.iter().zip(&basis.mass).map(|(value, mass)| value * value * mass / area);
    let norm = squares.sum::<f64>().sqrt();
    let factor = if norm < VANISHING { 0.0 } else { 1.0 / norm };
    column.iter_mut().for_each(|it| *it *= factor);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::test_shapes::{LANDMARKS, basis_of, creature, landmarks, permuted};

    const ALL: DescriptorOptions = DescriptorOptions {
        n_samples: 40,
        keep_every: 4,
        variance: 7.0,
        wave_signature: true,
        wave_landmarks: true,
        heat_signature: true,
        heat_landmarks: true,
        heat_times: [0.005, 0.2],
    };

    #[test]
    fn the_defaults_are_those_of_the_paper() {
        let basis = basis_of(&creature(0.0), 30);
        let seven: Vec<u32> = (0..7).collect();
        let found = descriptors(&basis, &landmarks(&seven), &DescriptorOptions::default()).unwrap();
        assert_eq!(found.count(), 160);
        assert_eq!(found.names[..2], ["wks 0", "wks 10"]);
        assert_eq!(found.names[159], "wkm l6 190");
    }

    #[test]
    fn scaling_changes_nothing() {
        let mesh = creature(0.0);
        let reference = descriptors(&basis_of(&mesh, 30), &landmarks(&LANDMARKS), &ALL).unwrap();
        for scale in [1e-4, 250.0] {
            let scaled = mesh.vertices().iter().map(|it| it * scale).collect();
            let basis = basis_of(&mesh.with_vertices(scaled).unwrap(), 30);
            let found = descriptors(&basis, &landmarks(&LANDMARKS), &ALL).unwrap();
            let error = (&found.values - &reference.values).norm_max();
            assert!(error < 1e-7, "{error:e} at {scale}");
        }
    }

    #[test]
    fn renumbering_renumbers_the_values() {
        let (mesh, k) = (creature(0.0), 30);
        let (renumbered, order) = permuted(&mesh);
        let moved = LANDMARKS.map(|it| order[it as usize]);
        let a = descriptors(&basis_of(&mesh, k), &landmarks(&LANDMARKS), &ALL).unwrap();
        let b = descriptors(&basis_of(&renumbered, k), &landmarks(&moved), &ALL).unwrap();
        for (old, &new) in order.iter().enumerate() {
            let error = (a.values.row(old) - b.values.row(new as usize)).norm_max();
            assert!(error < 1e-7, "vertex {old}: {error:e}");
        }
    }

    #[test]
    fn every_function_has_unit_norm() {
        let basis = basis_of(&creature(0.0), 30);
        let found = descriptors(&basis, &landmarks(&LANDMARKS), &ALL).unwrap();
        for column in 0..found.count() {
            let values = found.values.col_as_slice(column);
            let squares: f64 = values.iter().zip(&basis.mass).map(|(f, m)| f * f * m).sum();
            assert!((squares / basis.area() - 1.0).abs() < 1e-12, "{}", found.names[column]);
        }
    }

    /// The heat kernel of a short time is largest at its source.
    #[test]
    fn heat_maps_are_hot_at_their_landmarks() {
        let mesh = creature(0.0);
        let height = |it: &usize| mesh.vertices()[*it].z;
        let tip = (0..mesh.n_vertices()).max_by(|a, b| height(a).total_cmp(&height(b))).unwrap();
        let basis = basis_of(&mesh, 30);
        let options = DescriptorOptions {
            wave_signature: false,
            wave_landmarks: false,
            heat_signature: false,
            keep_every: 40,
            heat_times: [0.05, 0.2],
            ..ALL
        };
        let found = descriptors(&basis, &landmarks(&[tip as u32]), &options).unwrap();
        let values = found.values.col_as_slice(0);
        assert!(values.iter().all(|&it| it <= values[tip]));
    }

    #[test]
    fn what_is_missing_is_named() {
        let basis = basis_of(&creature(0.0), 30);
        let check = |vertices: &[u32], options: &DescriptorOptions, expected: &str| {
            let error = descriptors(&basis, &landmarks(vertices), options).unwrap_err();
            assert_eq!(error.to_string(), expected);
        };
        check(&[9000], &ALL, "landmark `l0` is vertex 9000, but the basis belongs to 362 vertices");
        let none = DescriptorOptions { wave_signature: false, heat_signature: false, ..ALL };
        check(&[], &none, "no function is left: every family is off, or the landmarks are missing");
    }
}
