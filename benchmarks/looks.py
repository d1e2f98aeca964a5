"""How things that were out of view are known again: what their looks tell.

    python -m benchmarks.looks --data DIR

Things are the objects of DAVIS16, by their true masks, with tracks on a grid. A thing
is compared with itself after it was out of view for some frames, and with the things of
other videos. As these are short, fewer frames of each are compared than in use. Printed
are the weights of a logistic regression beside those that are used, and, for videos
that were left out of it, how often things are known again and how often others are
taken for them.
"""

from __future__ import annotations

import argparse
from itertools import permutations, product
from pathlib import Path

import numpy as np
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import roc_auc_score
from sklearn.model_selection import LeaveOneGroupOut

from skmotionseg.datasets import load_davis16
from skmotionseg.datasets._videos import read_video_mask
from skmotionseg.video import _recognition as recognition
from skmotionseg.video._frames import open_frames

from .measuring import show_progress

# Pixels between tracks of the grid; frames for which things are out of view, those
# between two such times, and how many are compared before and after.
GRID, GAPS, STEP, BEFORE, AFTER = 6, (20, 36), 5, 3, 4
# Places, as shares of a video, at which its thing is compared with others.
PLACES = (0.0, 0.5, 1.0)
# Weak enough that the weights are those of the data.
C = 100.0


def looks_of(video):
    """What each frame of a video shows, objects by their true masks.

    Parameters
    ----------
    video : Bunch
        As from :func:`skmotionseg.datasets.load_davis16`.

    Returns
    -------
    list
        Thing 1 is the object.
    """
    shown = []
    for number, frame in enumerate(open_frames(video.frames)):
        mask = read_video_mask(video, number) > 0
        rows, columns = np.mgrid[: mask.shape[0] : GRID, : mask.shape[1] : GRID]
        points = np.column_stack([columns.ravel(), rows.ravel()]).astype(float)
        things = mask[rows.ravel(), columns.ravel()].astype(int)
        shown.append(recognition.seen_in(frame, points, things))
    return shown


def compared(before, after):
    """Evidence of matches and overlap of colours, or None if there is too little."""
    old = recognition.together([seen.of(1) for seen in before])
    new = recognition.together([seen.of(1) for seen in after])
    others = np.concatenate([seen.but(1) for seen in after])
    if recognition.too_little(old, new, others):
        return None
    matches = recognition.match_evidence(old.descriptors, new.descriptors, others)
    return matches, recognition.overlap(old.colours, new.colours)


def pairs_of(shown):
    """Evidence (n, 2) of all pairs, whether they are one thing, and video of the first.

    Parameters
    ----------
    shown : dict of str to list
        By name of the video, as from :func:`looks_of`.
    """
    before, after = (recognition.EVERY * (n - 1) + 1 for n in (BEFORE, AFTER))
    rows = []
    for name, frames in shown.items():
        for gap in GAPS:
            for start in range(0, len(frames) - before - gap - after + 1, STEP):
                come = start + before + gap
                pair = _some(frames, start, before), _some(frames, come, after)
                rows.append((compared(*pair), True, name))
    for one, other in permutations(shown, 2):
        for place, there in product(PLACES, PLACES):
            start = round(place * (len(shown[one]) - before))
            come = round(there * (len(shown[other]) - after))
            pair = _some(shown[one], start, before), _some(shown[other], come, after)
            rows.append((compared(*pair), False, one))
    known = [row for row in rows if row[0] is not None]
    return tuple(map(np.array, zip(*known, strict=True)))


def _some(frames, start, length):
    return frames[start : start + length : recognition.EVERY]


def main(argv=None):
    """Print the weights, and how well things of other videos are judged."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--data", type=Path, required=True)
    options = parser.parse_args(argv)
    videos = load_davis16(options.data / "DAVIS16")
    shown = {}
    for number, video in enumerate(videos):
        shown[video.name] = looks_of(video)
        show_progress(f"{number + 1}/{len(videos)} {video.name}")
    show_progress("")
    evidence, same, names = pairs_of(shown)
    model = LogisticRegression(C=C, class_weight="balanced")
    odds = np.zeros(len(same))
    for known, left_out in LeaveOneGroupOut().split(evidence, same, names):
        model.fit(evidence[known], same[known])
        odds[left_out] = model.decision_function(evidence[left_out])
    model.fit(evidence, same)
    matches, colours = model.coef_[0]
    used = recognition.MATCHES_WORTH, recognition.COLOURS_WORTH
    print(f"{same.sum()} pairs of one thing, {(~same).sum()} of two")
    print(f"per nat of matches  {matches:6.2f}   used {used[0]}")
    print(f"overlap of colours  {colours:6.2f}   used {used[1]}")
    print(f"constant            {model.intercept_[0]:6.2f}   used {recognition.PRIOR}")
    print(f"area under the ROC curve {roc_auc_score(same, odds):.3f}")
    sure = odds > recognition.SURE
    print(
        f"known again {sure[same].mean():.1%}, taken for one {sure[~same].mean():.1%}"
    )
    ours = recognition.weighed(*evidence.T)
    sure = ours > recognition.SURE
    print(
        f"as used: known again {sure[same].mean():.1%}, taken for one "
        f"{sure[~same].mean():.1%}; highest log odds of two {ours[~same].max():.1f}"
    )


if __name__ == "__main__":
    main()
