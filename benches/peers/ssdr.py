"""Dem Bones on the moving meshes of `benches/ssdr.rs`.

    cargo bench --bench ssdr -- file=adult.glb write=adult.bin
    python benches/peers/ssdr.py adult.bin [--bones 10,20,30] [--iterations 30]

Needs numpy and py-dem-bones. One thread, 4 influences, its other defaults; CPU seconds of the process,
one run. The error is measured anew from weights and motions, as the Rust program does.
"""
import argparse
import os
import time

os.environ["OMP_NUM_THREADS"] = "1"
import numpy as np
from py_dem_bones.portable import _prepare_solver, _read_skinning_result


def read(path):
    """Rest pose, faces, frames."""
    with open(path, "rb") as file:
        n_vertices, n_faces, n_frames = np.fromfile(file, "<u4", 3).astype(int)
        rest = np.fromfile(file, "<f8", 3 * n_vertices).reshape(-1, 3)
        frames = np.fromfile(file, "<f8", 3 * n_vertices * n_frames).reshape(n_frames, -1, 3)
        faces = np.fromfile(file, "<u4", 3 * n_faces).reshape(-1, 3)
    return rest, faces, frames


def measure(rest, faces, frames, n_bones, iterations):
    solver = _prepare_solver(rest, frames, n_bones, faces=faces.tolist(), max_influences=4,
                             iterations=iterations)
    wall, cpu = time.time(), time.process_time()
    solver.compute()
    wall, cpu = time.time() - wall, time.process_time() - cpu
    found = _read_skinning_result(solver)
    weights, motions = np.asarray(found.weights), np.asarray(found.transforms)
    points = np.c_[rest, np.ones(len(rest))]
    squares = [((np.einsum("bv,bij,vj->vi", weights, motion[:, :3], points) - frame) ** 2).sum(1).mean()
               for motion, frame in zip(motions, frames)]
    error = np.sqrt(np.mean(squares)) / np.linalg.norm(np.ptp(rest, axis=0))
    print(f"dem bones  n={len(rest)} frames={len(frames)} bones={solver.nB}/{n_bones} cpu={cpu:.3f}s "
          f"wall={wall:.3f}s rmse={100 * error:.4f}%", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("files", nargs="+")
    parser.add_argument("--bones", default="10,20,30")
    parser.add_argument("--iterations", type=int, default=30)
    arguments = parser.parse_args()
    for path in arguments.files:
        for n_bones in map(int, arguments.bones.split(",")):
            measure(*read(path), n_bones, arguments.iterations)


if __name__ == "__main__":
    main()
