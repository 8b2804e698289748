"""PyGEL3D on the meshes of `benches/skeletons.rs`.

    cargo bench --bench skeletons -- file=horse.ply write=meshes
    python benches/peers/skeletons.py meshes/5000.obj meshes/10000.obj [--plain 10000]

Needs numpy and pygel3d. CPU seconds of the process, one run; run it right after the Rust benchmark, on
the same machine.
"""
import argparse
import time

import numpy as np
from pygel3d import graph


def read(path):
    vertices, faces = [], []
    for words in map(str.split, open(path)):
        if words and words[0] == "v":
            vertices.append([float(it) for it in words[1:4]])
        elif words and words[0] == "f":
            faces.append([int(it.split("/")[0]) - 1 for it in words[1:4]])
    return np.array(vertices), faces


def graph_of(vertices, faces):
    res = graph.Graph()
    for vertex in vertices:
        res.add_node(vertex)
    edges = {(min(pair), max(pair)) for a, b, c in faces for pair in ((a, b), (b, c), (c, a))}
    for low, high in sorted(edges):
        res.connect_nodes(low, high)
    return res


def counts(skeleton):
    degrees = {node: len(list(skeleton.neighbors(node))) for node in skeleton.nodes()}
    parents = {node: node for node in degrees}

    def root(node):
        while parents[node] != node:
            node = parents[node]
        return node

    for node in degrees:
        for other in skeleton.neighbors(node):
            parents[root(node)] = root(other)
    n_components = len({root(node) for node in degrees})
    cycles = sum(degrees.values()) // 2 - len(degrees) + n_components
    leaves = sum(it == 1 for it in degrees.values())
    junctions = sum(it > 2 for it in degrees.values())
    return f"nodes={len(degrees)} leaves={leaves} junctions={junctions} cycles={cycles}"


def measure(name, extract, mesh):
    wall, cpu = time.time(), time.process_time()
    skeleton = extract(mesh)
    wall, cpu = time.time() - wall, time.process_time() - cpu
    n = len(list(mesh.nodes()))
    print(f"{name:10} n={n} cpu={cpu:.3f}s wall={wall:.3f}s {counts(skeleton)}", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("files", nargs="+")
    parser.add_argument("--plain", type=int, default=10_000, help="most vertices of the plain variant")
    arguments = parser.parse_args()
    for path in arguments.files:
        mesh = graph_of(*read(path))
        measure("multiscale", graph.MSLS_skeleton, mesh)
        if len(list(mesh.nodes())) <= arguments.plain:
            measure("plain", graph.LS_skeleton, mesh)


if __name__ == "__main__":
    main()
