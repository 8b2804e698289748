"""Times Sinew beside other engines and build tools on one synthetic graph, in one run.

    cargo build --release && cargo bench --no-run --bench engine
    python3 benches/peers/engine.py --bench ../shared/bench/engine -n 1000 sinew_exec ninja snakemake

The harness in the folder `--bench` makes the graph, times every scenario as a whole process, and counts the nodes
that ran. It has adapters for the other engines; this file adds two for Sinew:

- `sinew_exec`: every node is a `command` that starts the program of the other engines' nodes, and
  the last layer is exported
- `sinew_node`: the same numbers from a kind of our own, in one process (by `benches/engine.rs`)

Environment: SINEW, the program; SINEW_BENCH, the executable of `benches/engine.rs`; and those of
the harness (BENCH_DIR, BENCH_VENVS, BENCH_N2).
"""

import argparse
import importlib
import json
import os
import statistics
import sys
import types
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
RELEASE = ROOT / "target" / "release"
SCENARIOS = ("cold", "noop", "change", "cutoff", "revert")


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--bench", type=Path, required=True, help="the folder of the harness")
    options.add_argument("-n", type=int, default=1000, help="the number of nodes")
    options.add_argument("-j", type=int, default=2, help="how many nodes run at a time")
    options.add_argument("--reps", type=int, default=5, help="repetitions of each scenario")
    options.add_argument("--cold-reps", type=int, default=1, help="repetitions of the cold one")
    options.add_argument("--scenarios", default=",".join(SCENARIOS))
    options.add_argument("--out", type=Path, default=Path("engine.jsonl"), help="where rows are added")
    options.add_argument("engines", nargs="+")
    asked = options.parse_args()
    sys.path.insert(0, str(asked.bench.resolve()))
    harness = importlib.import_module("bench")
    for name, adapter in (("sinew_exec", exec_adapter()), ("sinew_node", node_adapter())):
        sys.modules[f"adapters.{name}"] = adapter
    asked.out.unlink(missing_ok=True)
    for engine in asked.engines:
        measure(harness, engine, asked)
    print_table([json.loads(it) for it in asked.out.read_text().splitlines()])


def measure(harness, engine, asked):
    """All scenarios of one engine; one that fails does not stop the others."""
    sys.argv = ["bench.py", engine, "-n", str(asked.n), "-j", str(asked.j), "--out", str(asked.out)]
    sys.argv += ["--reps", str(asked.reps), "--cold-reps", str(asked.cold_reps)]
    sys.argv += ["--scenarios", asked.scenarios]
    try:
        harness.main()
    except (SystemExit, OSError) as error:
        print(f"{engine} failed: {error}", file=sys.stderr)


def print_table(rows):
    """Medians: nodes that ran, processor time, wall time, the peak of memory, the machine's load."""
    print("\n| engine | nodes | scenario | ran (ideal) | CPU | wall | peak | load |")
    print("|---|---|---|---|---|---|---|---|")
    groups = {}
    for row in rows:
        groups.setdefault((row["engine"], row["n"], row["scenario"]), []).append(row)
    for (engine, n, scenario), group in groups.items():
        median = {it: statistics.median(row[it] for row in group)
                  for it in ("ran", "expect", "cpu", "wall", "load1")}
        peak = statistics.median(max(row["peak_one"], row["peak_tree"]) for row in group)
        print(f"| {engine} | {n} | {scenario} | {median['ran']:.0f} ({median['expect']:.0f}) "
              f"| {1e3 * median['cpu']:.1f} ms | {1e3 * median['wall']:.1f} ms | {peak:.0f} MiB "
              f"| {median['load1']:.1f} |")


def exec_adapter():
    """Nodes that start the harness' program."""
    program = os.environ.get("SINEW", str(RELEASE / "sinew"))

    def apply(folder, graph, work, **_):
        log = json.dumps(str(folder.parent / "runs"))
        text = []
        for layer, column in graph.nodes():
            argv = [work, "{out:value.txt}", graph.params[(layer, column)]]
            parents = [f"@n{a}_{b}.value" for a, b in graph.parents(layer, column)]
            argv += ["{in:parents.txt}"] if parents else []
            text.append(f'[nodes.n{layer}_{column}]\nkind = "command"\ncommand = {json.dumps(argv)}\n')
            if parents:
                text.append(f"inputs = {{ parents = {json.dumps(parents)} }}\n")
            text.append(f'outputs = {{ value = "text" }}\nenv = {{ RUNS_LOG = {log} }}\n\n')
        last = graph.layers - 1
        text.append("[outputs]\n")
        text += [f'"out/{last}_{it}.txt" = "@n{last}_{it}.value"\n' for it in range(graph.width)]
        (folder / "pipeline.toml").write_text("".join(text))

    def command(folder, graph, jobs, **_):
        return [program, "run", "pipeline.toml", "--jobs", str(jobs)]

    return adapter("sinew_exec", program, apply, command)


def node_adapter():
    """Nodes of a kind in the process itself."""
    program = os.environ.get("SINEW_BENCH") or newest_bench()

    def apply(folder, graph, **_):
        text = []
        for layer, column in graph.nodes():
            parents = json.dumps([f"@n{a}_{b}" for a, b in graph.parents(layer, column)])
            text.append(f'[nodes.n{layer}_{column}]\nkind = "work"\n'
                        f"param = {graph.params[(layer, column)]}\nparents = {parents}\n\n")
        (folder / "pipeline.toml").write_text("".join(text))

    def command(folder, graph, jobs, **_):
        return [program, "run", str(folder), str(jobs)]

    return adapter("sinew_node", os.environ.get("SINEW", str(RELEASE / "sinew")), apply, command)


def newest_bench():
    """The executable of `benches/engine.rs` that was built last."""
    found = [it for it in (RELEASE / "deps").glob("engine-*") if not it.suffix]
    return str(max(found, key=lambda it: it.stat().st_mtime)) if found else "engine"


def adapter(name, program, apply, command):
    """A module as the harness wants it."""
    module = types.ModuleType(f"adapters.{name}")
    version = importlib.import_module("adapters.util").first_line
    module.version = lambda: version(program, "--version")
    module.prepare = lambda folder, graph, **_: None
    module.apply, module.command = apply, command
    return module


if __name__ == "__main__":
    main()
