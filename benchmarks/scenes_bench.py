"""Errors on simulated scenes, family by family.

    python -m benchmarks.scenes_bench --scenes 20 --half tune
    python -m benchmarks.scenes_bench --families dense_small --tracks 2000 7000
    python -m benchmarks.scenes_bench --families table articulated --frames 24 60

Constants are set on the scenes with even seeds (``--half tune``) and reported on those
with odd ones (``--half report``). Only scenes whose true motions tell the tracks apart
are judged (``--separation``), and which show enough tracks of each motion at a time to
find it by (``--together``); each family has as many of them. They have a few hundred
tracks; with more (``--tracks``), landmarks are what is judged, and in more frames
(``--frames``), longer windows judge the number of motions. Another program calls
:func:`run` with an estimator of its own.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable, Iterator
from itertools import count, islice
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed
from sklearn.utils import Bunch

from skmotionseg import MotionSegmenter, unpack_tracks
from skmotionseg._core.labels import groups_of
from skmotionseg.datasets import make_scene, scene_families
from skmotionseg.metrics import misclassification_error

from . import report

HALVES = {"tune": 0, "report": 1}  # remainder of the seed
SEPARATION = 0.98
WORST_SEPARATION = 0.9  # of the motion that is hardest to tell from the others
# Tracks of each motion that are seen in the same frame: five determine how a rigid body
# moves between two images, so that one more can agree with them.
TOGETHER = 6
# Tracks and frames (low, high) with which a scene takes about a second.
LIMITS = {
    name: {"n_tracks": (60, 250), "n_frames": (8, 20)} for name in scene_families()
}
LIMITS |= {
    "two_images": {"n_tracks": (80, 400)},
    "photographs": {"n_tracks": (150, 400)},
    "crowd": {"n_tracks": (200, 400), "n_frames": (10, 20)},
    "one_motion": {"n_tracks": (30, 250), "n_frames": (2, 20)},
    "long": {"n_tracks": (200, 400), "n_frames": (60, 90)},
    "dense_small": {"n_tracks": (700, 1400), "n_frames": (6, 12)},
}
COLUMNS = ("family", "scenes", "known", "unknown", "right", "rejected", "seconds")


def default_segmenter(n_motions, seed):
    """The estimator that is measured if none is given."""
    return MotionSegmenter(n_motions, random_state=seed)


def scenes_of(
    family: str,
    half: str = "tune",
    separation: float = SEPARATION,
    together: int = TOGETHER,
    **overrides,
) -> Iterator[Bunch]:
    """Scenes of a half, without end, in which the true motions can be found.

    Parameters
    ----------
    family : str
    half : {"tune", "report"}
    separation : float
        Least share of tracks that their own motion explains best; of each motion,
        nine in ten must be.
    together : int
        Tracks of each motion that some frame must show.
    **overrides
        For ``make_scene``, instead of ``LIMITS``.

    Yields
    ------
    scene : Bunch
        As from ``make_scene``, with ``seed``.
    """
    if half not in HALVES:
        raise ValueError(f"half must be one of {tuple(HALVES)}; got {half!r}")
    for seed in count(HALVES[half], 2):
        scene = make_scene(family, random_state=seed, **(LIMITS[family] | overrides))
        worst = min(scene.separations)
        apart = scene.separation >= separation and worst >= WORST_SEPARATION
        if apart and _most_together(scene) >= together:
            scene.seed = seed
            yield scene


def _most_together(scene):
    """Tracks in the frame that shows most of a motion's; of the motion with fewest."""
    seen = unpack_tracks(scene.data)[1]
    return min(seen[group].sum(axis=0).max() for group in groups_of(scene.target))


def judge(scene, factory, known=True, unknown=True):
    """What an estimator makes of a scene.

    Parameters
    ----------
    scene : Bunch
    factory : callable
        ``factory(n_motions, seed)`` gives an estimator; ``n_motions`` is a number or
        "auto".
    known, unknown : bool
        Which of the two is run.

    Returns
    -------
    row : dict
        ``family``, ``seed``, errors ``known`` and ``unknown`` (shares of the tracks of
        motions), ``count`` and ``right`` (number unknown), ``rejected`` (share of the
        tracks of no motion labelled so, number unknown if it was run), ``seconds`` per
        fit and ``failure``. An estimator that fails is wrong everywhere.
    """
    row = {"family": scene.family, "seed": scene.seed, "n_motions": scene.n_motions}
    runs = {"known": scene.n_motions} if known else {}
    runs |= {"unknown": "auto"} if unknown else {}
    seconds = []
    for name, n_motions in runs.items():
        started = time.perf_counter()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                labels = factory(n_motions, scene.seed).fit_predict(scene.data)
        except Exception as error:  # of thousands of scenes, the rest is still wanted
            row["failure"] = f"{type(error).__name__}: {error}"
            labels = np.full(len(scene.data), -1)
        seconds.append(time.perf_counter() - started)
        row[name] = misclassification_error(scene.target, labels)
        wrong = scene.target < 0
        row["rejected"] = np.mean(labels[wrong] < 0) if wrong.any() else np.nan
    if unknown:
        row["count"] = len(np.unique(labels[labels >= 0]))
        row["right"] = row["count"] == scene.n_motions
    return row | {"seconds": float(np.mean(seconds))}


def run(
    factory: Callable = default_segmenter,
    *,
    families=None,
    n_scenes: int = 20,
    half: str = "tune",
    known: bool = True,
    unknown: bool = True,
    separation: float = SEPARATION,
    together: int = TOGETHER,
    n_jobs: int | None = 1,
    progress: Callable | None = None,
    overrides: dict | None = None,
) -> list[dict]:
    """Judge an estimator on scenes of each family.

    Parameters
    ----------
    factory : callable
        ``factory(n_motions, seed)`` gives an estimator with ``fit_predict``.
    families : sequence of str, optional
        All if not given.
    n_scenes : int
        Per family.
    half : {"tune", "report"}
    known, unknown : bool
        Whether to run with the number of motions given, and with "auto".
    separation, together
        Of the scenes that are judged (see :func:`scenes_of`).
    n_jobs : int or None
        Scenes at a time.
    progress : callable, optional
        Given the rows of each family once they are there.
    overrides : dict, optional
        For ``make_scene``, beside ``LIMITS``.

    Returns
    -------
    rows : list of dict
        One per scene, as from :func:`judge`.
    """
    rows = []
    with Parallel(n_jobs=n_jobs) as parallel:
        for family in families or scene_families():
            scenes = scenes_of(family, half, separation, together, **(overrides or {}))
            of_family = parallel(
                delayed(judge)(scene, factory, known, unknown)
                for scene in islice(scenes, n_scenes)
            )
            rows += of_family
            if progress is not None:
                progress(of_family)
    return rows


def summarise(rows, family=None):
    """Cells of a line of the table: means, with their standard errors.

    Parameters
    ----------
    rows : list of dict
        As from :func:`judge`.
    family : str, optional
        What the line is called.

    Returns
    -------
    line : dict
        By name of column; numbers as (mean, standard error), percent or seconds.
    """
    line = {"family": family or rows[0]["family"], "scenes": len(rows)}
    line["failures"] = sum("failure" in row for row in rows)
    for name in COLUMNS[2:]:
        values = np.array([row.get(name, np.nan) for row in rows], dtype=float)
        values = values[np.isfinite(values)] * (1 if name == "seconds" else 100)
        if len(values):
            line[name] = values.mean(), values.std() / np.sqrt(len(values))
    return line


def show_line(line):
    """Print a line of the table."""
    cells = []
    for name in COLUMNS[2:]:
        mean, error = line.get(name, (np.nan, np.nan))
        cells.append("-" if np.isnan(mean) else f"{mean:.1f} +- {error:.1f}")
    failed = f"  {line['failures']} failed" if line["failures"] else ""
    text = f"{line['family']:13s}{line['scenes']:7d}"
    print(text + "".join(f"{cell:>15s}" for cell in cells) + failed, flush=True)


def show(rows):
    """Print a line for each family, and one for the mean of all scenes."""
    for family in dict.fromkeys(row["family"] for row in rows):
        show_line(summarise([row for row in rows if row["family"] == family]))
    show_line(summarise(rows, "all"))


def _parser():
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.scenes_bench",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--scenes", type=int, default=20, help="per family")
    add("--half", choices=tuple(HALVES), default="tune")
    add("--families", nargs="+", choices=scene_families(), default=scene_families())
    add("--separation", type=float, default=SEPARATION)
    add("--together", type=int, default=TOGETHER, help="in some frame, of each motion")
    for what in ("tracks", "frames"):
        add(f"--{what}", type=int, nargs=2, metavar=("LOW", "HIGH"), help="of a scene")
    add("--jobs", type=int, default=1, help="scenes at a time")
    add("--known", action="store_true", help="only with the number of motions given")
    add("--unknown", action="store_true", help="only without")
    add("--json", type=Path, help="keep the figures of each family there")
    return parser


def _overrides(**given):
    """What is given of the tracks and frames of a scene, as ranges."""
    return {name: tuple(limits) for name, limits in given.items() if limits}


def main(arguments=None):
    arguments = _parser().parse_args(arguments)
    both = arguments.known == arguments.unknown
    header = "".join(f"{name:>15s}" for name in COLUMNS[2:])
    print(f"{'family':13s}{'scenes':>7s}{header}", flush=True)
    rows = run(
        families=arguments.families,
        n_scenes=arguments.scenes,
        half=arguments.half,
        known=both or arguments.known,
        unknown=both or arguments.unknown,
        separation=arguments.separation,
        together=arguments.together,
        n_jobs=arguments.jobs,
        progress=lambda rows: show_line(summarise(rows)),
        overrides=_overrides(n_tracks=arguments.tracks, n_frames=arguments.frames),
    )
    show_line(summarise(rows, "all"))
    for row in rows:
        if "failure" in row:
            print(f"{row['family']}, seed {row['seed']}: {row['failure']}")
    if arguments.json:
        lines = [
            summarise([row for row in rows if row["family"] == family])
            for family in arguments.families
        ]
        for line in lines:
            line["row"] = f"{line['family']} {arguments.half}"
        report.save(arguments.json, "scenes", lines)


if __name__ == "__main__":
    main()
