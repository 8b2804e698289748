"""Writes pipelines/data/makehuman*.toml: the files of `make_body` with their URLs and hashes.

    python3 scripts/makehuman_pipelines.py MAKEHUMAN MPFB2

The arguments are checkouts of makehumancommunity/makehuman and mpfb2 at the commits below.
Needs the package `blake3`.
"""

import sys
from pathlib import Path

from blake3 import blake3

HOST = "https://raw.githubusercontent.com/makehumancommunity/"
DATA = "makehuman/a8bc2d54ff0ac92e78ff71431b1023eda42bf482/makehuman/data/"
RIGS = "mpfb2/80919fa4682335c41847f761a4d79dcad4124732/src/mpfb/data/rigs/standard/"
MACROS = "targets/macrodetails/"


def pipeline(title, note, files):
    lines = [
        f"# {note}",
        "# Written by scripts/makehuman_pipelines.py.",
        "",
        "[pipeline]",
        f'title = "{title}"',
        "",
        "[nodes.download]",
        'kind = "download"',
        'licence = "CC0-1.0"',
        'attribution = "MakeHuman team"',
        f'base = "{HOST}{DATA}"',
        "files = [",
    ]
    for path, url, file in files:
        url = "" if url == path else f' url = "{url}",'
        digest = blake3(file.read_bytes()).hexdigest()
        lines.append(f'  {{ path = "{path}",{url} blake3 = "{digest}" }},')
    return "\n".join(lines + ["]", "", "[outputs]", 'files = "@download.files"', ""])


def main(makehuman, mpfb2):
    data, rigs = Path(makehuman) / "makehuman/data", Path(mpfb2) / "src/mpfb/data/rigs/standard"
    macros = data / MACROS
    base = ["3dobjs/base.obj"]
    base += sorted(MACROS + it.name for it in macros.glob("*-*.target"))
    base += sorted(
        f"{MACROS}height/{it.name}" for it in (macros / "height").glob("*-averagemuscle-averageweight-*")
    )
    files = [(it, it, data / it) for it in base]
    files += [(it, HOST + RIGS + it, rigs / it) for it in ("rig.cmu_mb.json", "weights.cmu_mb.json")]
    more = sorted(f"{MACROS}{it.parent.name}/{it.name}" for it in macros.glob("*/*.target"))
    more = [(it, it, data / it) for it in more if it not in base]
    out = Path(__file__).parent.parent / "pipelines/data"
    title = "MakeHuman: base mesh, macro targets, rig"
    note = "All that `make_body` needs for average proportions."
    (out / "makehuman.toml").write_text(pipeline(title, note, files))
    note = "All that `make_body` needs for any proportions and `height_targets = \"every_build\"`."
    (out / "makehuman_every_build.toml").write_text(pipeline(title, note, files + more))


if __name__ == "__main__":
    main(*sys.argv[1:])
