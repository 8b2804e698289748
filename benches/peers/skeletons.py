"""PyGEL3D, skeletor, pc-skeletor and CGAL on the meshes of `benches/skeletons.rs`.

    cargo bench --bench skeletons -- file=horse.ply write=meshes
    python benches/peers/skeletons.py meshes/5000.obj meshes/10000.obj [--plain 10000] [--write curves]
    cargo bench --bench skeletons -- file=horse.ply judge=curves

`skeleton_meshes.toml` and `skeletons.toml` make meshes and judge curves without the benchmark.

Needs numpy and pygel3d, skeletor, pc-skeletor (with robust_laplacian, mistree, open3d), or g++ and CGAL with
Eigen (libcgal-dev); what is missing is left out. CPU seconds of the process, the least of `--runs`; run it right
after the Rust benchmark, on the same machine, with OMP_NUM_THREADS=1 and OPENBLAS_NUM_THREADS=1. skeletor
contracts until a tenth of the area is left (its default), then clusters vertices; CGAL and pc-skeletor have
their defaults, pc-skeletor takes the vertices as points. `--write` leaves the skeletons of these three, for the
Rust program to tell how much of them is inside and in the middle; pc-skeletor's is the graph before it drops all
nodes between junctions, after which edges cut corners (`pc-skeletor-topology`).
"""
import argparse
import os
import shutil
import subprocess
import tempfile
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
try:
    import open3d
    from pc_skeletor import LBC
except ImportError:
    LBC = None


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


def least(n_runs, extract):
    """What a function returns, with the least CPU seconds that it took and the wall clock of that run."""
    best = None
    for _ in range(n_runs):
        wall, cpu = time.time(), time.process_time()
        made = extract()
        wall, cpu = time.time() - wall, time.process_time() - cpu
        best = min(best or (cpu, wall), (cpu, wall))
    return made, *best


def write(folder, name, path, positions, edges):
    if folder:
        os.makedirs(folder, exist_ok=True)
        size = os.path.splitext(os.path.basename(path))[0]
        with open(os.path.join(folder, f"{name}_{size}.obj"), "w") as file:
            file.writelines("v %r %r %r\n" % tuple(map(float, it)) for it in positions)
            file.writelines(f"l {a + 1} {b + 1}\n" for a, b in edges)


def measure_skeletor(path, vertices, faces, arguments):
    """skeletor.pre.contract (Au et al. 2008) and clusters of vertices, at the scale of a box of side 1.6."""
    scale = 1.6 / np.ptp(vertices, axis=0).max()
    mesh = trimesh.Trimesh(vertices * scale, faces, process=False)

    def extract():
        thin = skeletor.pre.contract(mesh, epsilon=0.1, progress=False)
        return skeletor.skeletonize.by_vertex_clusters(thin, sampling_dist=0.02, progress=False)

    curves, cpu, wall = least(arguments.runs, extract)
    print(f"skeletor   n={len(vertices)} cpu={cpu:.3f}s wall={wall:.3f}s "
          f"nodes={len(curves.vertices)} edges={len(curves.edges)}", flush=True)
    write(arguments.write, "skeletor", path, curves.vertices / scale, curves.edges)


def measure_pc_skeletor(path, vertices, arguments):
    """Laplacian-based contraction (Cao et al. 2010)."""
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(vertices))

    def extract():
        res = LBC(point_cloud=cloud)
        res.extract_skeleton()
        res.extract_topology()
        return res

    res, cpu, wall = least(arguments.runs, extract)
    places = [res.skeleton_graph.nodes[it]["pos"] for it in range(res.skeleton_graph.number_of_nodes())]
    edges = list(res.skeleton_graph.edges())
    print(f"pc-skeletor n={len(vertices)} cpu={cpu:.3f}s wall={wall:.3f}s nodes={len(places)} edges={len(edges)}",
          flush=True)
    write(arguments.write, "pc-skeletor", path, places, edges)
    write(arguments.write, "pc-skeletor-topology", path, np.asarray(res.topology.points),
          np.asarray(res.topology.lines))


def build_cgal(folder):
    source = os.path.join(os.path.dirname(os.path.abspath(__file__)), "cgal_skeleton.cpp")
    program = os.path.join(folder, "cgal_skeleton")
    flags = ["-O3", "-DNDEBUG", "-DCGAL_EIGEN3_ENABLED", "-I/usr/include/eigen3"]
    built = subprocess.run(["g++", *flags, source, "-o", program, "-lgmp", "-lmpfr"], stderr=subprocess.DEVNULL)
    return program if built.returncode == 0 else None


def measure_cgal(program, path, n_vertices, arguments, folder):
    """Mean curvature flow (Tagliasacchi et al. 2012)."""
    curves = os.path.join(folder, "curves.obj")
    runs = [subprocess.run([program, path, curves], stdout=subprocess.PIPE, text=True, check=True).stdout.split()
            for _ in range(arguments.runs)]
    cpu, nodes, edges = min(runs, key=lambda it: float(it[0]))
    print(f"cgal       n={n_vertices} cpu={cpu}s nodes={nodes} edges={edges}", flush=True)
    if arguments.write:
        os.makedirs(arguments.write, exist_ok=True)
        shutil.copy(curves, os.path.join(arguments.write, f"cgal_{os.path.basename(path)}"))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("files", nargs="+")
    parser.add_argument("--plain", type=int, default=10_000, help="most vertices of the plain variant")
    parser.add_argument("--write", help="a folder for the skeletons")
    parser.add_argument("--runs", type=int, default=1)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        cgal = build_cgal(folder) if shutil.which("g++") else None
        for path in arguments.files:
            vertices, faces = read(path)
            if cgal:
                measure_cgal(cgal, path, len(vertices), arguments, folder)
            if skeletor is not None:
                measure_skeletor(path, vertices, faces, arguments)
            if LBC is not None:
                measure_pc_skeletor(path, vertices, arguments)
            if graph is not None:
                mesh = graph_of(vertices, faces)
                measure("multiscale", graph.MSLS_skeleton, mesh)
                if len(vertices) <= arguments.plain:
                    measure("plain", graph.LS_skeleton, mesh)


if __name__ == "__main__":
    main()
