"""Log odds of two groups of tracks being different motions, from simulated scenes.

The number of motions is the largest of which the best partition has groups that are
all apart: the two that are least apart decide. So scenes are searched for partitions
into as many motions as there are, where these two are apart, and into one more, where
they are not. A logistic regression on what says that they are different motions
(``skmotionseg._core.partition.apartness.evidence``) gives the constants of that
module. Which partition is the best, and which two groups decide, depends on the
constants, so it is repeated with those that decide by the constants of the last time.
Evidence is of the windows of the search; in clips of more than twenty frames, longer
ones decide, by the same constants.
With ``--data DIR``, partitions of real sequences are told by the same constants, for
comparison::

    python -m benchmarks.apartness --scenes 30 --jobs 2 --data DIR
"""

from __future__ import annotations

import argparse
import warnings
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np
from joblib import Parallel, delayed
from sklearn.linear_model import LogisticRegression

from skmotionseg import MotionSegmenter, datasets
from skmotionseg._core.labels import groups_of
from skmotionseg._core.partition.apartness import evidence
from skmotionseg._core.partition.rigid_partitions import rank
from skmotionseg._core.partition.rigid_search import Step

from .measuring import show_progress
from .scenes_bench import scenes_of
from .watching import WITHOUT_WINDOWS, compared_steps

NAMES = "gain", "links", "far", "cross", "few"
# Times that the groups that decide are looked for. The constants are the means of the
# last ones and those of a regression, as they may go to and fro.
ROUNDS = 15


class Partition(NamedTuple):
    """What tells whether the groups of a partition are apart.

    Attributes
    ----------
    step : Step
        Without its motions.
    evidence : ndarray of shape (n_pairs, 5)
        Of the pairs of groups that were compared.
    by_links : ndarray of shape (n_pairs,)
        Log odds of groups that are seen at other times, which are by links alone; NaN
        of others.
    """

    step: Step
    evidence: np.ndarray
    by_links: np.ndarray


def partitions_of(X, n_motions):
    """Partitions into so many motions that are compared.

    Parameters
    ----------
    X : ndarray of shape (n_tracks, 2 * n_frames)
    n_motions : int

    Returns
    -------
    list of Partition
        Empty where there is nothing to tell apart.
    """
    with compared_steps() as compared, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        segmenter = MotionSegmenter(n_motions, random_state=0).fit(X)
    # The last search is without the outliers, where they are many.
    compared = [
        each
        for each in compared
        if each[0] is compared[-1][0] and each[1].n_motions == n_motions
    ]
    if n_motions == 1 or hasattr(segmenter, "windows_") or not compared:
        return []
    partitions = [_partition(*each) for each in compared]
    return [partition for partition in partitions if len(partition.evidence)]


def _partition(search, step):
    groups = groups_of(step.labels)
    keys = (
        (groups[i].tobytes(), groups[j].tobytes())
        for i in range(len(groups))
        for j in range(i)
    )
    compared = search.comparisons.found
    found = [compared[key] for key in keys if key in compared]
    known = [
        evidence(
            each.size, each.gain, each.links, each.far, each.cross, len(step.labels)
        )
        for each in found
    ]
    # The two are the same number only where one is taken for the other.
    by_links = [
        each.log_odds if each.log_odds == each.distance else np.nan for each in found
    ]
    step = step._replace(motions=[])
    return Partition(step, np.array(known), np.array(by_links))


def decisions_of(X, n_motions):
    """Partitions that decide whether there are as many motions, and one more.

    Returns
    -------
    tuple of list of Partition
    """
    return tuple(partitions_of(X, n_motions + more) for more in range(2))


def decisive(partitions, coefficients, prior):
    """What decides on a number of motions.

    Parameters
    ----------
    partitions : list of Partition
        Into that number.
    coefficients : ndarray of shape (5,)
    prior : float

    Returns
    -------
    log_odds : float
        Infinite where there is nothing to tell apart.
    evidence : ndarray of shape (5,) or None
        Of the two groups that are least apart in the best partition; None where that
        is told by their links.
    """
    decided = []
    for step, known, by_links in partitions:
        odds = np.where(np.isnan(by_links), known @ coefficients + prior, by_links)
        k = odds.argmin()
        decides = known[k] if np.isnan(by_links[k]) else None
        decided.append((rank(step._replace(log_odds=odds[k])), odds[k], decides))
    best = min(decided, key=lambda each: each[0], default=(None, np.inf, None))
    return best[1:]


def regression(decisions):
    """Coefficients by which numbers of motions are told, and the prior.

    Parameters
    ----------
    decisions : list of (list of Partition, list of Partition)
        As from :func:`decisions_of`.

    Returns
    -------
    coefficients : ndarray of shape (5,)
    prior : float
    """
    coefficients, prior = np.ones(len(NAMES)), -5.0
    for _ in range(ROUNDS):
        rows = [
            (decisive(partitions, coefficients, prior)[1], more == 0)
            for each in decisions
            for more, partitions in enumerate(each)
        ]
        X, truth = zip(*((x, y) for x, y in rows if x is not None), strict=True)
        model = LogisticRegression(C=100, max_iter=1000).fit(X, truth)
        coefficients = (coefficients + model.coef_[0]) / 2
        prior = (prior + model.intercept_[0]) / 2
    return coefficients, prior


def print_errors(name, decisions, coefficients, prior):
    """Print how often some coefficients say too few or too many motions."""
    odds = np.array(
        [[decisive(each, coefficients, prior)[0] for each in two] for two in decisions]
    )
    odds[np.isinf(odds[:, 1]), 1] = -np.inf  # no partition into one more
    many = odds[:, 1] > 0
    few = (odds[:, 0] <= 0) & ~many
    print(
        f"{name}: {len(odds)}; right {np.mean(~few & ~many):.1%}, "
        f"too few motions {few.mean():.1%}, too many {many.mean():.1%}",
        flush=True,
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--scenes", type=int, default=30, help="scenes per family")
    parser.add_argument("--data", type=Path, help="folder of real sequences")
    parser.add_argument("--jobs", type=int)
    arguments = parser.parse_args()
    parallel = Parallel(n_jobs=arguments.jobs)

    def decided(clips):
        return parallel(delayed(decisions_of)(*clip) for clip in clips)

    decisions = []
    for family in datasets.scene_families():
        if family not in WITHOUT_WINDOWS:
            show_progress(f"apartness: {family}")
            scenes = islice(scenes_of(family, "tune"), arguments.scenes)
            decisions += decided((each.data, each.n_motions) for each in scenes)
    show_progress("")
    coefficients, prior = regression(decisions)
    for name, value in zip(NAMES, coefficients, strict=True):
        print(f"{name} {value:.2f}", end=", ")
    print(f"prior {prior:.2f}")
    print_errors("simulated scenes", decisions, coefficients, prior)
    if arguments.data is not None:
        sequences = datasets.load_kt3dmoseg(arguments.data / "KT3DMoSeg")
        sequences += datasets.load_hopkins155(arguments.data / "Hopkins155")[::4]
        real = decided(
            (each.data, len(np.unique(each.target[each.target >= 0])))
            for each in sequences
        )
        print_errors("real sequences", real, coefficients, prior)


if __name__ == "__main__":
    main()
