"""Eigenpairs of a mesh by robust_laplacian and SciPy: `spectrum.py MESH K OUT.npz`."""

import sys

import numpy as np
import potpourri3d
import robust_laplacian
import scipy.sparse.linalg

mesh, k, out = sys.argv[1], int(sys.argv[2]), sys.argv[3]
vertices, faces = potpourri3d.read_mesh(mesh)
# Without mollification, the Laplacian of the intrinsic Delaunay triangulation.
stiffness, mass = robust_laplacian.mesh_laplacian(vertices, faces, mollify_factor=0.0)
start = np.random.default_rng(0).standard_normal(len(vertices))
values, vectors = scipy.sparse.linalg.eigsh(stiffness, k, mass, sigma=-1e-8, v0=start)
values[0] = max(values[0], 0.0)
np.savez(out, eigenvalues=values, eigenvectors=vectors, mass=mass.diagonal())
print(f"{k} eigenpairs of {len(vertices)} vertices")
