//! Maps between two shapes: of functions, and of points.

use faer::Mat;

use crate::kernels::spectral::basis::Basis;
use crate::kernels::spectral::function_space::FunctionSpace;

/// A linear map of functions on a target shape to functions on a source shape.
///
/// Pulling back: a map of points source -> target carries functions the other way. With `F(N)` the
/// functions on the target and `F(M)` those on the source, `C: F(N) -> F(M)` takes coefficients in the
/// target's basis to coefficients in the source's.
/// Both bases are those of the shapes at total area one, so that no scale enters the map.
#[derive(Debug, Clone)]
pub struct FunctionalMap {
    /// `k_source x k_target`.
    pub source_from_target: Mat<f64>,
    /// What the coefficients on either side belong to; unknown for maps of other programs.
    pub spaces: Option<MapSpaces>,
}

/// The two ends of a functional map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MapSpaces {
    /// Where functions are carried to.
    pub source: FunctionSpace,
    /// Where they come from.
    pub target: FunctionSpace,
}

/// Why a map cannot be applied to a basis.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum WrongSpace {
    #[error(
        "source and target are swapped: the map goes from functions on its target \
         ({n_target} vertices) to functions on its source ({n_source}), but the source basis is \
         that of its target, and the target basis that of its source"
    )]
    Swapped { n_source: usize, n_target: usize },
    #[error(
        "the map goes from functions on its target to functions on its source, but the {side} \
         basis is that of its {other}"
    )]
    OtherEnd { side: &'static str, other: &'static str },
    #[error("the map's {side} has {expected} vertices, but the {side} basis belongs to {found}")]
    Vertices { side: &'static str, expected: usize, found: usize },
    #[error(
        "the map's {side} is not the shape of the {side} basis, though both have {n_vertices} \
         vertices"
    )]
    Shape { side: &'static str, n_vertices: usize },
    #[error(
        "the {side} basis belongs to the map's {side}, but the map was made with other \
         eigenfunctions of it: use the same basis, as signs and numbers of eigenfunctions matter"
    )]
    Functions { side: &'static str },
}

impl FunctionalMap {
    /// A map from functions on the target to functions on the source, `k_source x k_target`.
    ///
    /// # Panics
    /// If a basis has fewer eigenfunctions than the matrix needs.
    pub fn new(source: &Basis, target: &Basis, source_from_target: Mat<f64>) -> Self {
        assert!(source_from_target.nrows() <= source.k(), "a row for every source function");
        assert!(source_from_target.ncols() <= target.k(), "a column for every target function");
        let spaces =
            MapSpaces { source: FunctionSpace::of(source), target: FunctionSpace::of(target) };
        Self { source_from_target, spaces: Some(spaces) }
    }

    /// A map whose bases are not known, so that only sizes can be checked.
    pub fn without_spaces(source_from_target: Mat<f64>) -> Self {
        Self { source_from_target, spaces: None }
    }

    /// Refuses bases that are not the map's own.
    ///
    /// # Errors
    /// [`WrongSpace`].
    pub fn check_bases(&self, source: &Basis, target: &Basis) -> Result<(), WrongSpace> {
        let Some(own) = &self.spaces else { return Ok(()) };
        let given =
            MapSpaces { source: FunctionSpace::of(source), target: FunctionSpace::of(target) };
        let swapped = MapSpaces { source: own.target, target: own.source };
        if given == swapped && given != *own {
            let (n_source, n_target) = (own.source.n_vertices, own.target.n_vertices);
            return Err(WrongSpace::Swapped { n_source, n_target });
        }
        own.check_source(given.source)?;
        own.check_target(given.target)
    }

    /// Refuses a target basis that is not the map's own.
    ///
    /// # Errors
    /// [`WrongSpace`].
    pub fn check_target(&self, target: &Basis) -> Result<(), WrongSpace> {
        self.spaces.map_or(Ok(()), |it| it.check_target(FunctionSpace::of(target)))
    }
}

impl MapSpaces {
    /// Refuses another space than the one that functions are carried to.
    ///
    /// # Errors
    /// [`WrongSpace`].
    pub fn check_source(&self, given: FunctionSpace) -> Result<(), WrongSpace> {
        check(["source", "target"], self.source, self.target, given)
    }

    /// Refuses another space than the one that functions come from.
    ///
    /// # Errors
    /// [`WrongSpace`].
    pub fn check_target(&self, given: FunctionSpace) -> Result<(), WrongSpace> {
        check(["target", "source"], self.target, self.source, given)
    }
}

fn check(
    [side, other]: [&'static str; 2],
    expected: FunctionSpace,
    other_end: FunctionSpace,
    given: FunctionSpace,
) -> Result<(), WrongSpace> {
    if given == expected {
        return Ok(());
    }
    let n_vertices = expected.n_vertices;
    Err(if given == other_end {
        WrongSpace::OtherEnd { side, other }
    } else if given.n_vertices != n_vertices {
        WrongSpace::Vertices { side, expected: n_vertices, found: given.n_vertices }
    } else if given.shape != expected.shape {
        WrongSpace::Shape { side, n_vertices }
    } else {
        WrongSpace::Functions { side }
    })
}

/// For every vertex of a source shape, a vertex of a target shape.
#[derive(Debug, Clone, PartialEq)]
pub struct PointMap {
    /// `n_source` vertex indices of the target.
    pub target_of_source: Vec<u32>,
    pub n_target: usize,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::test_shapes::{basis_of, creature};

    #[test]
    fn a_map_is_not_applied_backwards_though_the_sizes_agree() {
        let (source, target) = (basis_of(&creature(0.0), 8), basis_of(&creature(0.3), 8));
        let map = FunctionalMap::new(&source, &target, Mat::identity(8, 8));
        assert_eq!(map.check_bases(&source, &target), Ok(()));
        assert_eq!(map.check_target(&target), Ok(()));
        assert_eq!(
            map.check_bases(&target, &source).unwrap_err().to_string(),
            "source and target are swapped: the map goes from functions on its target (362 \
             vertices) to functions on its source (362), but the source basis is that of its \
             target, and the target basis that of its source"
        );
        assert_eq!(
            map.check_target(&source).unwrap_err().to_string(),
            "the map goes from functions on its target to functions on its source, but the \
             target basis is that of its source"
        );
    }

    #[test]
    fn other_shapes_and_other_eigenfunctions_are_told_apart() {
        let (source, target) = (basis_of(&creature(0.0), 8), basis_of(&creature(0.3), 8));
        let map = FunctionalMap::new(&source, &target, Mat::identity(8, 8));
        let check = |basis: &Basis, expected: WrongSpace| {
            assert_eq!(map.check_bases(&source, basis), Err(expected));
        };
        let side = "target";
        check(&basis_of(&creature(0.5), 8), WrongSpace::Shape { side, n_vertices: 362 });
        check(&basis_of(&creature(0.3), 9), WrongSpace::Functions { side });
        let mut turned = target.clone();
        turned.eigenvectors.col_mut(5).iter_mut().for_each(|it| *it = -*it);
        check(&turned, WrongSpace::Functions { side });
        let mut fewer = target.clone();
        fewer.mass.pop();
        fewer.eigenvectors = fewer.eigenvectors.subrows(0, 361).to_owned();
        check(&fewer, WrongSpace::Vertices { side, expected: 362, found: 361 });
        // Nothing is known of a map from elsewhere, nor does a shape mapped to itself have ends.
        let foreign = FunctionalMap::without_spaces(Mat::identity(8, 8));
        assert_eq!(foreign.check_bases(&target, &source), Ok(()));
        let own = FunctionalMap::new(&source, &source, Mat::identity(8, 8));
        assert_eq!(own.check_bases(&source, &source), Ok(()));
    }
}
