"""CPU seconds of a functional map between two meshes through pyFM and SciPy, one thread.

    python functional_transfer.py SOURCE TARGET [SAMPLES]

SOURCE and TARGET are folders with `mesh.safetensors` and `landmarks.safetensors`, as `sinew run` exports them.
The same steps as `pipelines/papers/parts/timed_chain.toml`: 120 eigenpairs, wave kernels and landmark maps, a map of 20,
ZoomOut to 120 in steps of 5 with SAMPLES vertices (1,000), matches of all vertices.
Needs pyfmaps, safetensors.
"""

import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import sys
import time

import numpy as np
from pyFM.functional import FunctionalMapping
from pyFM.mesh import TriMesh
from pyFM.refine.zoomout import zoomout_refine
from safetensors.numpy import load_file


class Clock:
    def __init__(self):
        self.last = self.first = time.process_time()

    def lap(self, step):
        now = time.process_time()
        print(f"{step:24}{now - self.last:8.2f}", flush=True)
        self.last = now


def read(folder):
    mesh = load_file(f"{folder}/mesh.safetensors")
    (landmarks,) = load_file(f"{folder}/landmarks.safetensors").values()
    return TriMesh(mesh["vertices"], mesh["faces"].astype(int)), landmarks.astype(int)


(source, source_marks), (target, target_marks) = read(sys.argv[1]), read(sys.argv[2])
n_samples = int(sys.argv[3]) if len(sys.argv) > 3 else 1000
clock = Clock()
for mesh in (source, target):
    mesh.process(k=120, intrinsic=False)
clock.lap("eigenpairs")
model = FunctionalMapping(source, target)
marks = np.c_[source_marks, target_marks]
model.preprocess(n_descr=200, landmarks=marks, subsample_step=10, k_process=120, k_descr=120)
clock.lap("descriptors")
model.fit(
    K=(20, 20),
    w_descr=0.1,
    w_lap=1e-3,
    w_dcomm=1,
    w_orient=0,
    use_resolvent_laplacian=False,
    normalize_weights=False,
)
clock.lap("fit")
samples = [it.farthest_point_sampling(n_samples, geodesic=False) for it in (source, target)]
clock.lap("samples, Euclidean")
refined, matches = zoomout_refine(
    model.FM_12,
    source.eigenvectors,
    target.eigenvectors,
    nit=20,
    step=5,
    A2=target.A,
    subsample=samples,
    return_p2p=True,
    n_jobs=1,
)
clock.lap("zoomout, matches")
print(f"{'all':24}{clock.last - clock.first:8.2f}")
model.zoomout_refine(nit=20, step=5, subsample=n_samples)
clock.lap("zoomout, own samples")
