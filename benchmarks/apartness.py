"""Log odds of two groups of tracks being different motions, from simulated scenes.

Over-segmentations of scenes are merged down to one group, and the two groups that are
least apart in each step, which decide on the number of motions, are a sample: apart if
they are (mostly) of different motions; one if they are of the same motion, or one of
them is of outliers. A logistic regression on how much worse one rigid motion explains
both than two do, and on the log of the links between them over those that chance would
give, gives the constants of ``skmotionseg._core.partition.rigid_search``. With
``--data DIR``, another regression on pairs of real sequences, for comparison::

    python -m benchmarks.apartness --scenes 4 --data DIR
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

# A group is of the motion that most of its tracks have, if so many do.
PURE = 0.8


def pairs_of(X, target):
    """Pairs of groups that are met when over-segmentations of a clip are merged to one.

    Parameters
    ----------
    X : ndarray of shape (n_tracks, 2 * n_frames)
    target : ndarray of int, shape (n_tracks,)

    Returns
    -------
    list of (float, float, int)
        Gain, log of links over chance, and 1 if the two are apart.
    """

    def descend(found, over_segments, *_):
        found.calibrate(over_segments[0])
        paths = found.run(*(found.descent(some, 1) for some in over_segments))
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
                gain = min(found.gain, rigid_search.MOST_GAIN)
                links = np.log(found.links + rigid_search.FEWEST_LINKS)
                rows.append((gain, links, truth))
    return rows


def beginning(X, target):
    """The frames of a clip that are segmented as one, and the tracks in them."""
    X = X[:, : 2 * LONG_CLIP]
    there = np.isfinite(X).sum(axis=1) >= 4
    return X[there], target[there]


def _truth(first, second):
    """Whether two groups are apart; None where their motions are mixed."""
    motions, shares = zip(*map(_motion, (first, second)), strict=True)
    if motions[0] == motions[1]:
        return 0
    if -1 in motions:
        return 0 if min(shares) > 0.5 else None
    return 1 if min(shares) > PURE else None


def _motion(labels):
    values, counts = np.unique(labels, return_counts=True)
    return int(values[counts.argmax()]), counts.max() / len(labels)


def regress(name, rows):
    """Print the regression on some pairs, and how well it tells them."""
    *features, truth = np.array(rows).T
    X = np.column_stack(features)
    model = LogisticRegression(C=100, max_iter=1000).fit(X, truth)
    odds = model.decision_function(X)
    missed, false = np.mean(odds[truth == 1] < 0), np.mean(odds[truth == 0] > 0)
    print(
        f"{name}: {len(X)} pairs, {truth.mean():.0%} apart; gain "
        f"{model.coef_[0, 0]:.2f}, links {model.coef_[0, 1]:.1f}, prior "
        f"{model.intercept_[0]:.2f}; area under the curve "
        f"{roc_auc_score(truth, odds):.3f}; missed {missed:.1%}, false {false:.1%}",
        flush=True,
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--scenes", type=int, default=4, help="scenes per family")
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
    regress("simulated scenes", rows)
    if arguments.data is not None:
        sequences = datasets.load_kt3dmoseg(arguments.data / "KT3DMoSeg")
        sequences += datasets.load_hopkins155(arguments.data / "Hopkins155")[::8]
        pairs = (pairs_of(each.data, each.target) for each in sequences)
        regress("real sequences", [row for each in pairs for row in each])


if __name__ == "__main__":
    main()
