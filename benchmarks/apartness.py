"""Log odds of two groups of tracks being different motions, from simulated scenes.

Over-segmentations of scenes are merged down to one group, and the two groups that are
least apart in each step, which decide on the number of motions, are a sample: apart if
their tracks, outliers aside, are (mostly) of different motions; one if they are of the
same motion, or one of them is of outliers. A logistic regression on what says that they
are different motions (``skmotionseg._core.partition.rigid_search.evidence``) gives the
constants of that module. With ``--data DIR``, the same for pairs of real sequences,
with the coefficients of the simulated ones, for comparison::

    python -m benchmarks.apartness --scenes 8 --data DIR
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import roc_auc_score

from skmotionseg import MotionSegmenter, datasets
from skmotionseg._core.labels import groups_of
from skmotionseg._core.partition import rigid_search
from skmotionseg._segmenter.long_clips import LONG_CLIP

from .watching import WITHOUT_WINDOWS, rigid_searches, true_labels

# A group is of the motion that most of its tracks have, outliers aside, if so many do;
# and of outliers if fewer than so many are of motions.
PURE, KNOWN = 0.8, 0.3


def pairs_of(X, target):
    """Pairs of groups that are met when over-segmentations of a clip are merged to one.

    Parameters
    ----------
    X : ndarray of shape (n_tracks, 2 * n_frames)
    target : ndarray of int, shape (n_tracks,)

    Returns
    -------
    list of (float, float, float, float, int)
        The evidence, and 1 if the two are apart.
    """

    def descend(found, over_segments, *_):
        paths = rigid_search.calibrated_paths(found, over_segments)
        return [step for path in paths for step in path]

    with rigid_searches(descend) as kept:
        MotionSegmenter(n_landmarks=None, random_state=0).fit(X)
    rows = []
    for one, steps in kept:
        mine = true_labels(one, X, target)
        for step in steps:
            if step.pair is None:
                continue
            groups = groups_of(step.labels)
            first, second = (groups[k] for k in step.pair)
            found = one.apart[second.tobytes(), first.tobytes()]
            truth = _truth(mine[first], mine[second])
            if truth is not None:
                known = found.gain, found.links, found.far, found.behind
                rows.append((*rigid_search.evidence(*known), truth))
    return rows


def beginning(X, target):
    """The frames of a clip that are segmented as one, and the tracks in them."""
    X = X[:, : 2 * LONG_CLIP]
    there = np.isfinite(X).sum(axis=1) >= 4
    return X[there], target[there]


def _truth(first, second):
    """Whether two groups are apart; None where their motions are mixed."""
    motions, shares = zip(*map(_motion, (first, second)), strict=True)
    if motions[0] == motions[1] or -1 in motions:
        return 0
    return 1 if min(shares) > PURE else None


def _motion(labels):
    """The motion of a group, -1 for outliers, and the share of its tracks with it."""
    known = labels[labels >= 0]
    if len(known) < KNOWN * len(labels):
        return -1, 1.0
    values, counts = np.unique(known, return_counts=True)
    return int(values[counts.argmax()]), counts.max() / len(known)


def regression(rows):
    """Coefficients by which pairs are told apart, and the prior."""
    *features, truth = np.array(rows).T
    X = np.column_stack(features)
    model = LogisticRegression(C=100, max_iter=1000).fit(X, truth)
    return model.coef_[0], model.intercept_[0]


def print_errors(name, rows, coefficients, prior):
    """Print how well some coefficients tell pairs apart."""
    *features, truth = np.array(rows).T
    odds = np.column_stack(features) @ coefficients + prior
    missed, false = np.mean(odds[truth == 1] < 0), np.mean(odds[truth == 0] > 0)
    print(
        f"{name}: {len(odds)} pairs, {truth.mean():.0%} apart; area under the curve "
        f"{roc_auc_score(truth, odds):.3f}; missed {missed:.1%}, false {false:.1%}",
        flush=True,
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--scenes", type=int, default=8, help="scenes per family")
    parser.add_argument("--data", type=Path, help="folder of real sequences")
    arguments = parser.parse_args()
    rows = []
    for seed in range(0, 2 * arguments.scenes, 2):  # even: the half to set constants on
        for family in datasets.scene_families():
            if family not in WITHOUT_WINDOWS:
                scene = datasets.make_scene(
                    family, n_tracks=(80, 450), random_state=seed
                )
                rows += pairs_of(*beginning(scene.data, scene.target))
    coefficients, prior = regression(rows)
    names = "gain", "links", "far", "behind"
    for name, value in zip(names, coefficients, strict=True):
        print(f"{name} {value:.2f}", end=", ")
    print(f"prior {prior:.2f}")
    print_errors("simulated scenes", rows, coefficients, prior)
    if arguments.data is not None:
        sequences = datasets.load_kt3dmoseg(arguments.data / "KT3DMoSeg")
        sequences += datasets.load_hopkins155(arguments.data / "Hopkins155")[::8]
        pairs = (pairs_of(each.data, each.target) for each in sequences)
        real = [row for each in pairs for row in each]
        print_errors("real sequences", real, coefficients, prior)


if __name__ == "__main__":
    main()
