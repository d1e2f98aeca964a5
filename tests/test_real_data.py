"""Real clips: what was promised of them, on a few that are quick."""

from __future__ import annotations

import numpy as np
import pytest

from skmotionseg import MotionSegmenter
from skmotionseg.datasets import load_kt3dmoseg
from skmotionseg.metrics import misclassification_error

CLIPS = ("Seq005_Clip01", "Seq011_Clip01", "Seq113_Clip01")


@pytest.fixture(scope="module")
def clips(real_data):
    by_name = {clip.name: clip for clip in load_kt3dmoseg(real_data / "KT3DMoSeg")}
    return [by_name[name] for name in CLIPS]


def test_motions_of_a_driving_camera_are_found(clips):
    for clip in (clips[0], clips[2]):
        segmenter = MotionSegmenter(random_state=0).fit(clip.data)
        assert segmenter.n_motions_ == len(np.unique(clip.target))
        assert misclassification_error(clip.target, segmenter.labels_) < 0.02


def test_tracks_left_out_of_fit_land_in_their_motion(clips):
    for clip in clips:
        n_motions = len(np.unique(clip.target))
        shuffled = np.random.RandomState(0).permutation(len(clip.data))
        fitted, left_out = shuffled[::2], shuffled[1::2]
        segmenter = MotionSegmenter(n_motions, random_state=0)
        whole = segmenter.fit(clip.data).labels_
        placed = segmenter.fit(clip.data[fitted]).predict(clip.data[left_out])
        error = misclassification_error(clip.target[left_out], placed)
        assert error <= misclassification_error(clip.target, whole) + 0.015
