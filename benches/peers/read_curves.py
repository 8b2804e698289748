"""Curve skeletons from files with lines `v x y z` and `l from to`, for `skeletons.toml`."""

import numpy as np


def read(curves):
    rows = [it.split() for it in open(curves)]
    positions = np.array([it[1:4] for it in rows if it[0] == "v"], dtype=float)
    edges = np.array([it[1:3] for it in rows if it[0] == "l"], dtype=np.int64) - 1
    edges = edges[edges[:, 0] != edges[:, 1]]
    return {
        "curves": {
            "positions": positions,
            "radii": np.zeros(len(positions)),
            "edges": edges.astype(np.uint32),
            "node_of_vertex": np.zeros(0, dtype=np.uint32),
        }
    }


def points(mesh):
    return {"mesh": {"vertices": mesh.vertices, "faces": np.zeros((0, 3), dtype=np.uint32)}}
