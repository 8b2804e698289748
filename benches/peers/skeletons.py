"""PyGEL3D and skeletor on the meshes of `benches/skeletons.rs`.

    cargo bench --bench skeletons -- file=horse.ply write=meshes
    python benches/peers/skeletons.py meshes/5000.obj meshes/10000.obj [--plain 10000] [--write curves]
    cargo bench --bench skeletons -- file=horse.ply judge=curves

Needs numpy, and pygel3d or skeletor; what is missing is left out. CPU seconds of the process, one run;
run it right after the Rust benchmark, on the same machine. skeletor contracts until a tenth of the area
is left (its default), then clusters vertices. `--write` leaves its skeletons, for the Rust program to
tell how much of them is inside and in the middle.
"""
import argparse
import os
import time

import numpy as np

try:
    from pygel3d import graph
except ImportError:
    graph = None
try:
    import skeletor
    import trimesh
except ImportError:
    skeletor = None


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


def measure_skeletor(path, vertices, faces, folder):
    """skeletor.pre.contract (Au et al. 2008) and clusters of vertices, at the scale of a box of side 1.6."""
    scale = 1.6 / np.ptp(vertices, axis=0).max()
    mesh = trimesh.Trimesh(vertices * scale, faces, process=False)
    wall, cpu = time.time(), time.process_time()
    thin = skeletor.pre.contract(mesh, epsilon=0.1, progress=False)
    contracted = time.process_time() - cpu
    curves = skeletor.skeletonize.by_vertex_clusters(thin, sampling_dist=0.02, progress=False)
    wall, cpu = time.time() - wall, time.process_time() - cpu
    n = len(vertices)
    print(f"skeletor   n={n} cpu={cpu:.3f}s contract={contracted:.3f}s wall={wall:.3f}s "
          f"nodes={len(curves.vertices)} edges={len(curves.edges)}", flush=True)
    if folder:
        os.makedirs(folder, exist_ok=True)
        size = os.path.splitext(os.path.basename(path))[0]
        with open(os.path.join(folder, f"skeletor_{size}.obj"), "w") as file:
            file.writelines("v %r %r %r\n" % tuple(map(float, it / scale)) for it in curves.vertices)
            file.writelines(f"l {a + 1} {b + 1}\n" for a, b in curves.edges)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("files", nargs="+")
    parser.add_argument("--plain", type=int, default=10_000, help="most vertices of the plain variant")
    parser.add_argument("--write", help="a folder for skeletor's skeletons")
    arguments = parser.parse_args()
    for path in arguments.files:
        if skeletor is not None:
            measure_skeletor(path, *read(path), arguments.write)
        if graph is None:
            continue
        mesh = graph_of(*read(path))
        measure("multiscale", graph.MSLS_skeleton, mesh)
        if len(list(mesh.nodes())) <= arguments.plain:
            measure("plain", graph.LS_skeleton, mesh)


if __name__ == "__main__":
    main()
