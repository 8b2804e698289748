"""Pinocchio's library and ours: the same skeleton goes to the same mesh.

    git clone https://github.com/elrond79/Pinocchio
    cargo build --release
    python benches/peers/pinocchio.py --pinocchio Pinocchio/Pinocchio --sinew target/release/sinew \\
        human:adult.ply:adult.joints.json human:other.obj horse:horse.ply:horse.joints.json

Needs g++ and numpy; Pinocchio's library is built (-O3) in a temporary folder. The skeletons are its own:
`human`, `quad`, `horse`; it takes connected, closed surfaces only. Least CPU seconds of several runs: its
library step by step, of our program whole processes on one thread, first up to the embedding, then the weights
(reading, start and the cache count as ours). With the true joints of MakeHuman's or Quaternius' rigs as a third
part, the mean and the largest distance of those joints that both have, in percent of the height. Joints are
inside where the winding number of the surface is above a half. `--scale` is Pinocchio's option: its program
takes skeletons smaller than ours does, which spans nine tenths of the mesh.
"""
import argparse
import csv
import glob
import json
import os
import resource
import subprocess
import tempfile

import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
STEPS = ["field", "spheres", "search", "refine"]

# True joints of Pinocchio's; its left is where x is negative.
HUMAN = {"hips": "Hips", "head": "Head"} | {
    it.format(short): it_true.format(long)
    for short, long in (("l", "Right"), ("r", "Left"))
    for it, it_true in (("{}thigh", "{}UpLeg"), ("{}knee", "{}Leg"), ("{}ankle", "{}Foot"),
                        ("{}shoulder", "{}Arm"), ("{}elbow", "{}ForeArm"), ("{}hand", "{}Hand"))
}
HORSE = {"hips": "Back", "head": "Head", "shoulders": "Torso3"} | {
    it.format(short): f"{it_true}.{long}"
    for short, long in (("l", "R"), ("r", "L"))
    for it, it_true in (("{}thigh", "BackLeg"), ("{}hknee", "BackUpperLeg"), ("{}hheel", "BackLowerLeg"),
                        ("{}hfoot", "FFB"), ("{}shoulder", "FrontUpperLeg"), ("{}fknee", "FrontLowerLeg"),
                        ("{}ffoot", "FF"))
}
QUAD = {name: it for name, it in HORSE.items() if "hheel" not in name and "hknee" not in name}
# What its skeletons want at the bottom and in the thick of the body.
FEET = {"human": ["lfoot", "rfoot"], "horse": ["lhfoot", "rhfoot", "lffoot", "rffoot"]}
FEET["quad"] = FEET["horse"]
FAT = ["hips", "shoulders", "head"]
TRUE_NAMES = {"human": HUMAN, "horse": HORSE, "quad": QUAD}


def build(pinocchio, folder):
    program = os.path.join(folder, "pinocchio")
    sources = sorted(it for it in glob.glob(os.path.join(pinocchio, "*.cpp"))
                     if os.path.basename(it) != "Pinocchio.cpp")
    # It was written for the compilers of 2007.
    subprocess.run(["g++", "-std=gnu++98", "-O3", "-w", "-fpermissive", "-fno-access-control", "-I", pinocchio,
                    os.path.join(HERE, "pinocchio.cpp"), *sources, "-o", program], check=True)
    return program


def cpu_of(command, folder):
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, cwd=folder)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def ours(arguments, skeleton, mesh, joints, folder):
    command = [os.path.abspath(arguments.sinew), "run", os.path.join(HERE, "pinocchio.toml"), "--quiet", "--jobs", "1"]
    for name, value in (("mesh", mesh), ("joints", joints)):
        command += ["--set", f"{name}={os.path.abspath(value)}"]
    command += ["--set", f"feet={json.dumps(FEET[skeleton])}", "--set", f"fat={json.dumps(FAT)}"]
    embed, weights = [], []
    for run in range(arguments.runs):
        fresh = [*command, "--cache", os.path.join(folder, f"cache_{os.path.basename(mesh)}_{run}")]
        embed.append(cpu_of([*fresh, "embedded"], folder))
        weights.append(cpu_of([*fresh, "skin"], folder))
    cpu_of(fresh, folder)
    with open(os.path.join(folder, "out", "joints.csv")) as file:
        names = [it["joint"] for it in csv.DictReader(file) if float(it["matched"]) == 1.0]
    places = dict(zip(names, np.load(os.path.join(folder, "out", "skeleton.npz"))["positions"], strict=True))
    return min(embed), min(weights), places, os.path.join(folder, "out", "mesh.obj")


def theirs(arguments, program, skeleton, mesh):
    """The least seconds of every step, and places by joints; none if it refuses the mesh."""
    steps, places = {}, {}
    for _ in range(arguments.runs):
        run = subprocess.run([program, "rig", skeleton, mesh, str(arguments.scale)], stdout=subprocess.PIPE,
                             text=True)
        if run.returncode != 0:
            return None, None
        for words in map(str.split, run.stdout.splitlines()):
            if words[0] == "seconds":
                steps[words[1]] = min(float(words[2]), steps.get(words[1], np.inf))
            elif words[0] == "joint":
                places[words[1]] = np.array(words[2:5], dtype=float)
    return steps, places


def read(path):
    rows = [it.split() for it in open(path)]
    vertices = np.array([it[1:4] for it in rows if it and it[0] == "v"], dtype=float)
    return vertices, np.array([[int(at.split("/")[0]) - 1 for at in it[1:4]] for it in rows if it and it[0] == "f"])


def winding_number(place, vertices, faces):
    a, b, c = ((vertices - place)[faces[:, it]] for it in range(3))
    x, y, z = (np.linalg.norm(it, axis=1) for it in (a, b, c))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    rest = x * y * z + (a * b).sum(1) * z + (b * c).sum(1) * x + (a * c).sum(1) * y
    return abs(np.arctan2(volume, rest).sum() / (2 * np.pi))


def quality(places, vertices, faces, truth, names):
    inside = sum(winding_number(it, vertices, faces) > 0.5 for it in places.values())
    text = f"inside={inside}/{len(places)}"
    if truth:
        height = np.ptp(vertices[:, 1])
        off = {name: 100 * np.linalg.norm(places[name] - truth[true]) / height
               for name, true in names.items() if name in places and true in truth}
        worst = max(off, key=off.get)
        text += f" off={np.mean(list(off.values())):.1f}% worst={off[worst]:.1f}% ({worst})"
    return text


def true_joints(path):
    if not path:
        return {}
    file = json.load(open(path))
    joints = file["joints"] + file.get("core_joints", [])
    return {it["name"]: np.array(it["position"]) for it in joints}


def compare(arguments, program, folder, case):
    skeleton, mesh, truth = (case.split(":") + [""])[:3]
    joints = os.path.join(folder, f"{skeleton}.csv")
    with open(joints, "w") as file:
        subprocess.run([program, "joints", skeleton], check=True, stdout=file)
    embed, weights, places, surface = ours(arguments, skeleton, mesh, joints, folder)
    vertices, faces = read(surface)
    truth = true_joints(truth)
    print(f"{os.path.basename(mesh)}: {skeleton}, {len(vertices)} vertices")
    print(f"  sinew     embed={embed:.2f}s weights={weights:.3f}s all={embed + weights:.2f}s "
          f"{quality(places, vertices, faces, truth, TRUE_NAMES[skeleton])}")
    steps, places = theirs(arguments, program, skeleton, surface)
    if steps is None:
        return
    parts = " ".join(f"{it}={steps[it]:.2f}s" for it in STEPS)
    their_embed, total = sum(steps[it] for it in STEPS), sum(steps.values())
    print(f"  Pinocchio embed={their_embed:.2f}s weights={steps['weights']:.3f}s all={total:.2f}s "
          f"{quality(places, vertices, faces, truth, TRUE_NAMES[skeleton])}")
    print(f"            {parts}; ours is {their_embed / embed:.2f}, {steps['weights'] / weights:.2f}, "
          f"{total / (embed + weights):.2f} times as fast", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("cases", nargs="+", help="SKELETON:MESH[:JOINTS.json]")
    parser.add_argument("--pinocchio", required=True, help="the folder of its library's source")
    parser.add_argument("--sinew", required=True, help="our program")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--scale", type=float, default=1.0)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        program = build(arguments.pinocchio, folder)
        for case in arguments.cases:
            compare(arguments, program, folder, case)


if __name__ == "__main__":
    main()
