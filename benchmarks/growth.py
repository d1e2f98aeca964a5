"""How time and memory grow with tracks and frames, as a picture.

    python -m benchmarks.growth [--json docs/speed.json] [--out docs/images/growth.png]

It draws the rows ``tracks-*`` and ``frames-*`` that ``python -m benchmarks --table
--json FILE`` has measured; ``python -m benchmarks --write`` draws it, too.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

SCENES = {"tracks": "n_tracks", "frames": "n_frames"}
# What a page shows it with.
SHOWN = "![CPU seconds and memory against tracks and frames](images/growth.png)"
MEASURES = {
    "CPU seconds": lambda row: row["cpu_seconds"],
    "peak memory (MB)": lambda row: row["peak"] / 1e6,
}


def of_scene(rows, scene):
    """The rows of a scene, by size."""
    chosen = [row for row in rows if row["row"].startswith(f"{scene}-")]
    return sorted(chosen, key=lambda row: row[SCENES[scene]])


def draw_growth(rows, path):
    """Draw a panel for each scene and measure, log-log, with a guide of slope 1.

    Parameters
    ----------
    rows : list of dict
        Of :mod:`benchmarks.table`.
    path : path-like

    Raises
    ------
    ValueError
        If a scene was measured at fewer than two sizes.
    """
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, panels = plt.subplots(
        2, 2, figsize=(8, 6), sharex="col", layout="constrained"
    )
    for column, (scene, size) in zip(panels.T, SCENES.items(), strict=True):
        chosen = of_scene(rows, scene)
        if len(chosen) < 2:
            raise ValueError(
                f"growth needs two rows {scene}-* or more; got {len(chosen)}"
            )
        sizes = np.array([row[size] for row in chosen])
        for axes, (title, measure) in zip(column, MEASURES.items(), strict=True):
            values = np.array([measure(row) for row in chosen])
            slope = np.polyfit(np.log(sizes), np.log(values), 1)[0]
            axes.loglog(sizes, values, "o-", label=f"measured, slope {slope:.2f}")
            guide = values[0] * sizes / sizes[0]
            axes.loglog(sizes, guide, "--", color="0.6", label="slope 1")
            axes.set(ylabel=title, xticks=sizes, xticklabels=[f"{s:,}" for s in sizes])
            ends = [min(values), max(values)]  # those between may be too close to write
            axes.set_yticks(ends, [f"{v:,.{2 * (v < 10)}f}" for v in ends])
            axes.minorticks_off()
            axes.legend(frameon=False)
        other = "n_frames" if scene == "tracks" else "n_tracks"
        fixed = " and ".join(f"{each:,}" for each in sorted({r[other] for r in chosen}))
        column[0].set_title(f"{fixed} {other.removeprefix('n_')}")
        column[1].set_xlabel(scene)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--json", type=Path, default=Path("docs/speed.json"))
    parser.add_argument("--out", type=Path, default=Path("docs/images/growth.png"))
    arguments = parser.parse_args()
    rows = json.loads(arguments.json.read_text()).get("table", [])
    draw_growth(rows, arguments.out)
    print(f"drew {arguments.out}")


if __name__ == "__main__":
    main()
