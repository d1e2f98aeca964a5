"""Real clips: what was promised of them, on a few that are quick."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.reliability import right_labels
from skmotionseg import MotionSegmenter
from skmotionseg.datasets import load_kt3dmoseg
from skmotionseg.metrics import misclassification_error

pytestmark = pytest.mark.xdist_group("real data")  # fitted once for all

CLIPS = ("Seq005_Clip01", "Seq113_Clip01")


@pytest.fixture(scope="module")
def clips(real_data):
    by_name = {clip.name: clip for clip in load_kt3dmoseg(real_data / "KT3DMoSeg")}
    return [by_name[name] for name in CLIPS]


@pytest.fixture(scope="module")
def of_whole():
    """Fit a whole clip, as it comes; each clip once."""
    fitted = {}

    def fit(clip):
        if clip.name not in fitted:
            fitted[clip.name] = MotionSegmenter(random_state=0).fit(clip.data)
        return fitted[clip.name]

    return fit


def test_motions_of_a_driving_camera_are_found(clips, of_whole):
    for clip in clips:
        segmenter = of_whole(clip)
        assert segmenter.n_motions_ == len(np.unique(clip.target))
        assert misclassification_error(clip.target, segmenter.labels_) < 0.02


def test_tracks_left_out_of_fit_land_in_their_motion(clips, of_whole):
    for clip in clips:
        n_motions = len(np.unique(clip.target))
        shuffled = np.random.RandomState(0).permutation(len(clip.data))
        fitted, left_out = shuffled[::2], shuffled[1::2]
        whole = of_whole(clip).labels_
        segmenter = MotionSegmenter(n_motions, random_state=0)
        placed = segmenter.fit(clip.data[fitted]).predict(clip.data[left_out])
        error = misclassification_error(clip.target[left_out], placed)
        assert error <= misclassification_error(clip.target, whole) + 0.015


def test_the_least_sure_tenth_of_the_tracks_holds_most_errors(real_data, of_whole):
    names = ("Seq009_Clip02", "Seq038_Clip02", "Seq113_Clip01")
    shares = []
    for clip in load_kt3dmoseg(real_data / "KT3DMoSeg"):
        if clip.name in names:
            segmenter = of_whole(clip)
            wrong = ~right_labels(clip.target, segmenter.labels_)
            least = np.argsort(segmenter.probabilities_)[: len(wrong) // 10]
            shares.append(wrong[least].sum() / wrong.sum())
    assert len(shares) == 3
    assert np.mean(shares) >= 0.5
