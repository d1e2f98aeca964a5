"""Whether the search finds partitions as good as the truth, on simulated scenes.

    python -m benchmarks.search_gap --scenes 4 [--half report] [--json FILE]

The number of motions is given. What the search minimises is computed for the partition
that it found and for the true one, from which tracks are assigned and motions fitted
again until nothing gets better; outliers, which have no true motion, begin in the
largest, or, between two images, as mismatches. Over windows of frames, what a group
costs is by the best motion that the search knows, of which there are more when the
truth is settled: so the labels that were found are then priced once more, too. The gap
is closed where what was found costs no more. An error where it is closed is one of the
judge: another partition than the truth costs less.
"""

from __future__ import annotations

import argparse
import warnings
from itertools import islice
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed

from skmotionseg import MotionSegmenter, pack_tracks
from skmotionseg._core.geometry.two_views import fit_two_view_motions
from skmotionseg._core.geometry.windows import FEWEST_TRACKS
from skmotionseg._core.partition.rigid_partitions import ROUNDS, rank_in, with_odds
from skmotionseg._core.partition.two_view_energy import settle
from skmotionseg._core.partition.two_view_partitions import best_by_number_of_motions
from skmotionseg.datasets import scene_families
from skmotionseg.metrics import misclassification_error

from . import report
from .measuring import show_progress
from .scenes_bench import HALVES, scenes_of
from .watching import rigid_searches, true_labels, two_view_searches

# Families in which there is nothing to search, or in several pairs of images.
LEFT_OUT = ("one_motion", "photographs")
TOLERANCE = 1e-6  # nats per track
COLUMNS = {
    "family": lambda row: row["row"],
    "scenes": lambda row: str(row["n_scenes"]),
    "gap closed %": report.number("closed", "{:.0f}"),
    "error %": report.number("error"),
    "where closed": report.number("error_closed"),
    "where open": report.number("error_open"),
}


def gap(scene):
    """By how much what was found costs more than the truth, and its error.

    Parameters
    ----------
    scene : Bunch

    Returns
    -------
    (float, float) or None
        Nats per track, negative where the truth costs more; share of the tracks. None
        where neither motions between two images nor rigid ones are searched, or these
        in several windows of a long clip, or where a true one has too few tracks.
    """
    segmenter = MotionSegmenter(scene.n_motions, random_state=scene.seed)
    with (
        rigid_searches() as over_windows,
        two_view_searches() as between_images,
        warnings.catch_warnings(),
    ):
        warnings.simplefilter("ignore")
        labels = segmenter.fit_predict(scene.data)
    more = None
    if between_images:
        more = _more_between_images(scene, between_images[-1])
    elif not hasattr(segmenter, "windows_"):
        more = _more_over_windows(scene, segmenter, over_windows)
    error = misclassification_error(scene.target, labels)
    return None if more is None else (more, error)


def _more_over_windows(scene, segmenter, searches):
    """By how many nats per track rigid motions that were found cost more; or None."""
    answered = [each for each in searches if each[1] is not None]
    if not answered:
        return None
    search, found = answered[-1]  # without the outliers, where they are many
    # What is searched are the tracks as a shutter that reads at once would show them.
    tracks = pack_tracks(*segmenter._unpack(scene.data))
    truth = np.maximum(true_labels(search, tracks, scene.target), 0)
    if np.bincount(truth, minlength=scene.n_motions).min() < FEWEST_TRACKS:
        return None
    found, cost = found.steps[found.chosen], rank_in(search)
    (true,) = search.run(_step_of(search, truth, rounds=ROUNDS))
    (again,) = search.run(_step_of(search, found.labels, found.motions, rounds=0))
    return min(cost(found), cost(again)) - cost(true)


def _step_of(search, labels, motions=None, *, rounds):
    """The step of a partition, settled by what the search knows by now."""
    settled = yield from search.settled(labels, motions, rounds)
    return (yield from with_odds(search, settled))


def _more_between_images(scene, search):
    """By how many nats per track motions between two images cost more; or None.

    The true ones are of one surface each, while several may make up one that is found.
    """
    n_motions, n = scene.n_motions, len(search.scene.views)
    found = best_by_number_of_motions(search).get(n_motions)
    if found is None or n < len(scene.target):  # a track that meets no other is left
        return None
    labels = np.where(scene.target < 0, n_motions, scene.target)
    shares = (labels == np.arange(n_motions + 1)[:, None]).astype(float)
    motions = fit_two_view_motions(search.scene.views, shares[:-1])
    true = settle(search.scene, motions, shares)
    if true is None or len(true.motions) < n_motions:
        return None
    return (found.cost - true.cost) / n


def row_of(name, gaps):
    """Figures of some scenes.

    Parameters
    ----------
    name : str
    gaps : list of (float, float)
        As from :func:`gap`.

    Returns
    -------
    row : dict
        In percent.
    """
    gaps, errors = 100 * np.array(gaps, dtype=float).reshape(-1, 2).T
    closed = gaps <= 100 * TOLERANCE
    row = {"row": name, "n_scenes": len(gaps)}
    for key, values in (
        ("closed", 100 * closed),
        ("error", errors),
        ("error_closed", errors[closed]),
        ("error_open", errors[~closed]),
    ):
        row[key] = float(values.mean()) if len(values) else None
    return row


def measure(families, n_scenes, half, n_jobs=None):
    """A row per family, and one for all scenes.

    Parameters
    ----------
    families : sequence of str
    n_scenes : int
        Per family.
    half : {"tune", "report"}
    n_jobs : int, optional

    Returns
    -------
    list of dict
    """
    rows, everything = [], []
    with Parallel(n_jobs=n_jobs) as parallel:
        for family in families:
            show_progress(f"search gap: {family}")
            scenes = islice(scenes_of(family, half), n_scenes)
            found = parallel(delayed(gap)(scene) for scene in scenes)
            gaps = [each for each in found if each is not None]
            rows.append(row_of(family, gaps))
            everything += gaps
    show_progress("")
    return [*rows, row_of("all", everything)]


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    choices = [name for name in scene_families() if name not in LEFT_OUT]
    parser.add_argument("--scenes", type=int, default=4, help="per family")
    parser.add_argument("--half", choices=tuple(HALVES), default="report")
    parser.add_argument("--families", nargs="+", choices=choices, default=choices)
    parser.add_argument("--jobs", type=int)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    rows = measure(arguments.families, arguments.scenes, arguments.half, arguments.jobs)
    report.show(rows, COLUMNS)
    report.save(arguments.json, "search_gap", rows)


if __name__ == "__main__":
    main()
