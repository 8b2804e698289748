//! Whether a functional map keeps left and right apart.

use faer::{Mat, MatRef};

use super::functional_map::FunctionalMap;
use crate::kernels::{geometry::mesh::TriMesh, numerics::tall, spectral::basis::Basis};

/// Functions whose gradients are compared.
const FUNCTIONS: usize = 8;

/// Coefficients that the comparison uses: what is smooth is not disturbed by noise.
const COEFFICIENTS: usize = 40;

/// Tells whether a map keeps the orientation of the surface: from 1 (it does) to -1 (it mirrors).
///
/// Two functions `f`, `g` on an oriented surface have a third one `n . (grad f x grad g)`, which changes
/// its sign under a reflection and is otherwise only multiplied by a change of area (the idea of the
/// orientation term of Ren et al. 2018). For pairs of the target's smoothest eigenfunctions, the
/// function of their images on the source is correlated with the image of their function.
///
/// It looks at the smooth part of the map alone, so that neither noise nor bad matches of single
/// vertices matter. Values near zero mean that it cannot tell, for instance since the faces of a mesh
/// are not oriented. `None` without faces, or if the map is smaller than 3 x 3.
///
/// # Panics
/// If bases, meshes and map do not belong together.
pub fn chirality(
    source: (&Basis, &TriMesh),
    target: (&Basis, &TriMesh),
    map: &FunctionalMap,
) -> Option<f64> {
    let map = map.source_from_target.as_ref();
    let (n_rows, n_cols) = (map.nrows().min(COEFFICIENTS), map.ncols().min(COEFFICIENTS));
    if n_rows < 3 || n_cols < 3 || source.1.is_point_cloud() || target.1.is_point_cloud() {
        return None;
    }
    let map = map.submatrix(0, 0, n_rows, n_cols);
    // All but the constant, whose gradient is zero.
    let n_functions = FUNCTIONS.min(n_cols - 1);
    let on_target = target.0.truncated(n_cols).subcols(1, n_functions);
    let images = tall::product(source.0.truncated(n_rows), map.subcols(1, n_functions));
    let crossed = cross_coefficients(target.1, on_target, target.0.truncated(n_cols));
    let carried = map * crossed;
    let found = cross_coefficients(source.1, images.as_ref(), source.0.truncated(n_rows));
    let (mut product, mut squares) = (0.0, [0.0, 0.0]);
    for column in 0..found.ncols() {
        for (a, b) in found.col_as_slice(column).iter().zip(carried.col_as_slice(column)) {
            product += a * b;
            squares[0] += a * a;
            squares[1] += b * b;
        }
    }
    let length = (squares[0] * squares[1]).sqrt();
    (length > 0.0).then(|| product / length)
}

/// The coefficients of `n . (grad f x grad g)` for all pairs `f < g`: `k x pairs`.
///
/// On a triangle with linear functions, the integral of that is half of
/// `(f_b - f_a) (g_c - g_a) - (f_c - f_a) (g_b - g_a)`, of which every corner gets a third.
fn cross_coefficients(
    mesh: &TriMesh,
    functions: MatRef<'_, f64>,
    basis: MatRef<'_, f64>,
) -> Mat<f64> {
    let count = functions.ncols();
    let pairs: Vec<(usize, usize)> =
        (0..count).flat_map(|f| (f + 1..count).map(move |g| (f, g))).collect();
    let mut integrals = Mat::zeros(mesh.n_vertices(), pairs.len());
    for (column, &(f, g)) in pairs.iter().enumerate() {
        let integral = integrals.col_as_slice_mut(column);
        let (f, g) = (functions.col(f), functions.col(g));
        for face in mesh.faces() {
            let [a, b, c] = face.map(|it| it as usize);
            let (f_ab, f_ac) = (f[b] - f[a], f[c] - f[a]);
            let (g_ab, g_ac) = (g[b] - g[a], g[c] - g[a]);
            let share = (f_ab * g_ac - f_ac * g_ab) / 6.0;
            integral[a] += share;
            integral[b] += share;
            integral[c] += share;
        }
    }
    tall::inner_products(basis, integrals.as_ref())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::{
        geometry::mesh::Vec3,
        test_shapes::{basis_of, creature},
    };

    /// The map that follows from equal numbers of vertices.
    fn by_numbers(source: &Basis, target: &Basis, k: usize) -> FunctionalMap {
        let units = (target.area() / source.area()).sqrt();
        let map = tall::mass_products(source.truncated(k), &source.mass, target.truncated(k));
        FunctionalMap::new(source, target, map * faer::Scale(units))
    }

    #[test]
    fn a_reflection_is_told_from_a_rotation() {
        let (mesh, changed) = (creature(0.0), creature(0.3));
        let basis = basis_of(&mesh, 30);
        let turn = nalgebra::Rotation3::from_euler_angles(0.3, -1.1, 2.0);
        let turned = changed.vertices().iter().map(|p| turn * p * 3.0).collect();
        let mirrored = changed.vertices().iter().map(|p| Vec3::new(-p.x, p.y, p.z)).collect();
        for (vertices, turned_over, sign) in
            [(turned, false, 1.0), (mirrored, true, -1.0)] as [(Vec<Vec3>, bool, f64); 2]
        {
            let other = changed.with_vertices(vertices).unwrap();
            // Faces look outwards after a reflection, if they are walked the other way round.
            let faces = other.faces().iter();
            let faces = faces.map(|&[a, b, c]| if turned_over { [a, c, b] } else { [a, b, c] });
            let other = TriMesh::new(other.vertices().to_vec(), faces.collect()).unwrap();
            let target = basis_of(&other, 30);
            for (k, least) in [(8, 0.5), (30, 0.9)] {
                let map = by_numbers(&basis, &target, k);
                let found = chirality((&basis, &mesh), (&target, &other), &map).unwrap();
                assert!(sign * found > least, "{found} with {k} functions");
            }
        }
    }

    #[test]
    fn clouds_and_tiny_maps_have_none() {
        let mesh = creature(0.0);
        let cloud = TriMesh::from_points(mesh.vertices().to_vec()).unwrap();
        let basis = basis_of(&mesh, 8);
        let map = by_numbers(&basis, &basis, 8);
        assert_eq!(chirality((&basis, &cloud), (&basis, &mesh), &map), None);
        let map = by_numbers(&basis, &basis, 2);
        assert_eq!(chirality((&basis, &mesh), (&basis, &mesh), &map), None);
    }
}
