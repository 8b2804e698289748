"""scipy's shift-invert ARPACK with CHOLMOD on the operators that `benches/eigs.rs` wrote.

    cargo bench --bench eigs -- meshes=/tmp/operators
    python benches/peers/eigs.py /tmp/operators/*.operator [--k 200] [--superlu]

Needs numpy, scipy and scikit-sparse (0.4.16 with SuiteSparse 5, `apt-get install libsuitesparse-dev`).
One thread, CPU seconds of the process; run it right after the Rust benchmark, on the same machine.
"""
import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import time

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sla


def read(path):
    """-> stiffness (CSR), masses"""
    raw = open(path, "rb").read()
    n, n_stored = np.frombuffer(raw, "<u8", 2)
    n, n_stored = int(n), int(n_stored)
    indices = np.frombuffer(raw, "<u8", n + 1 + n_stored, 16).astype(np.int32)
    floats = np.frombuffer(raw, "<f8", n_stored + n, 16 + 8 * (n + 1 + n_stored))
    stiffness = sp.csr_matrix((floats[:n_stored], indices[n + 1 :], indices[: n + 1]), (n, n))
    return stiffness, floats[n_stored:]


def solve(stiffness, mass, k, superlu):
    """The k smallest pairs by ARPACK on the inverse of L + s M, and the CPU time of the factor."""
    shift = -0.01 / mass.sum()
    matrix = (stiffness - shift * sp.diags(mass)).tocsc()
    start = time.process_time()
    if superlu:
        inverse = sla.splu(matrix, permc_spec="MMD_AT_PLUS_A", options=dict(SymmetricMode=True)).solve
    else:
        from sksparse.cholmod import cholesky

        inverse = cholesky(matrix)
    factor_secs = time.process_time() - start
    calls = [0]

    def apply(right):
        calls[0] += 1
        return inverse(right)

    operator = sla.LinearOperator(matrix.shape, matvec=apply, dtype=np.float64)
    values, vectors = sla.eigsh(stiffness, k, sp.diags(mass), sigma=shift, OPinv=operator)
    return values, vectors, factor_secs, calls[0]


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("operators", nargs="+")
    parser.add_argument("--k", type=int, default=200)
    parser.add_argument("--superlu", action="store_true")
    arguments = parser.parse_args()
    for path in arguments.operators:
        stiffness, mass = read(path)
        start = time.process_time()
        values, vectors, factor_secs, n_solves = solve(stiffness, mass, arguments.k, arguments.superlu)
        secs = time.process_time() - start
        weighted = mass[:, None] * vectors
        residuals = np.linalg.norm(stiffness @ vectors - weighted * values, axis=0)
        residual = (residuals / np.linalg.norm(weighted, axis=0)).max() / values[-1]
        orthogonality = np.abs(vectors.T @ weighted - np.eye(arguments.k)).max()
        name = "superlu" if arguments.superlu else "cholmod"
        print(
            f"scipy+{name} n={len(mass)} k={arguments.k} cpu={secs:.3f}s factor={factor_secs:.3f}s "
            f"solves={n_solves} residual={residual:.1e} orthogonality={orthogonality:.1e} "
            f"lambda_k={values[-1]:.10e}",
            flush=True,
        )


main()
