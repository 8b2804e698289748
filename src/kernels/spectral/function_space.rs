//! What coefficients belong to.

use super::basis::Basis;

/// The functions on a shape that one eigenbasis stands for.
///
/// Coefficients mean nothing without their basis: even two computations of the same eigenfunctions may
/// differ in signs. Fingerprints tell bases apart, without keeping them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FunctionSpace {
    pub n_vertices: usize,
    /// Of the masses: the same for all bases of one operator.
    pub shape: u64,
    /// Of the eigenvalues and the first eigenfunctions.
    pub functions: u64,
}

/// Eigenfunctions whose values are part of a fingerprint.
const FINGERPRINT_FUNCTIONS: usize = 8;

impl FunctionSpace {
    /// The functions that a basis stands for.
    pub fn of(basis: &Basis) -> Self {
        let n_functions = basis.k().min(FINGERPRINT_FUNCTIONS);
        let values = (0..n_functions).flat_map(|it| basis.eigenvectors.col_as_slice(it)).copied();
        Self {
            n_vertices: basis.n_vertices(),
            shape: fingerprint(basis.mass.iter().copied()),
            functions: fingerprint(basis.eigenvalues.iter().copied().chain(values)),
        }
    }
}

/// FNV-1a, a number at a time.
fn fingerprint(values: impl Iterator<Item = f64>) -> u64 {
    values.fold(0xcbf2_9ce4_8422_2325, |hash, value| {
        let mixed = (hash ^ value.to_bits()).wrapping_mul(0x100_0000_01b3);
        // Products carry low bits upwards only.
        mixed ^ (mixed >> 32)
    })
}
