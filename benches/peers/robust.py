"""robust_laplacian, libigl and pyFM on the meshes of `benches/operators.rs`.

    cargo bench --bench operators -- files=a.off,b.off eigenvalues=1
    python benches/peers/robust.py a.off b.off [--runs 5] [--eigenvalues]

Needs numpy, scipy, robust_laplacian, libigl and pyfmaps. One thread, CPU seconds of the process, the
least of several runs; run it right after the Rust benchmark, on the same machine.
"""
import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import time

import igl
import numpy as np
import robust_laplacian
import scipy.sparse as sp
import scipy.sparse.linalg as sla
from pyFM.mesh import laplacian as pyfm


def cotan_igl(vertices, faces):
    return -igl.cotmatrix(vertices, faces), igl.massmatrix(vertices, faces, igl.MASSMATRIX_TYPE_VORONOI)


def cotan_pyfm(vertices, faces):
    return pyfm.cotangent_weights(vertices, faces), pyfm.dia_area_mat(vertices, faces)


OPERATORS = {
    "cotan of libigl": cotan_igl,
    "cotan of pyFM": cotan_pyfm,
    "tufted of robust_laplacian": robust_laplacian.mesh_laplacian,
    "cloud of robust_laplacian": lambda vertices, faces: robust_laplacian.point_cloud_laplacian(vertices),
}


def measure(name, path, arguments):
    vertices, faces = igl.read_triangle_mesh(path)[:2]
    vertices, faces = np.ascontiguousarray(vertices, float), np.ascontiguousarray(faces)
    best = float("inf")
    for _ in range(arguments.runs):
        start = time.process_time()
        stiffness, mass = OPERATORS[name](vertices, faces)
        best = min(best, time.process_time() - start)
    areas = sp.csr_matrix(mass).diagonal()
    off_diagonal = sp.csr_matrix(stiffness).copy()
    off_diagonal.setdiag(0)
    print(
        f"{name} {os.path.basename(path)} n={len(vertices)} cpu={best:.4f}s stored={stiffness.nnz} "
        f"negative_weights={(off_diagonal.data > 1e-12).sum()} area={areas.sum():.9f}",
        flush=True,
    )
    if arguments.eigenvalues:
        shift = -0.01 / areas.sum()
        values = np.sort(sla.eigsh(stiffness.tocsc(), 50, sp.diags(areas).tocsc(), sigma=shift)[0])
        shown = " ".join(f"{values[it]:.9f}" for it in (1, 2, 5, 10, 20, 49))
        print(f"       eigenvalues 1, 2, 5, 10, 20, 49: {shown}", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("meshes", nargs="+")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--eigenvalues", action="store_true")
    arguments = parser.parse_args()
    for path in arguments.meshes:
        for name in OPERATORS:
            measure(name, path, arguments)


main()
