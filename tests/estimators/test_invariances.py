"""What leaves the answer as it is: order, place, scale, direction, empty frames.

Tracks are changed in a way that does not change who moves with whom, and everything is
computed once more from the same minimal sets: residuals, ranked kernel, partition. Some
changes are exact in floating-point arithmetic, and so is then all that follows; the
others hold to rounding.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from unittest import mock

import numpy as np
import pytest
from helpers.minimal_sets import fit_minimal_sets
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.utils import check_random_state

from skmotionseg import (
    HypothesisSampler,
    MotionSegmenter,
    MultiModelSpectralClustering,
    ORKKernel,
    pack_tracks,
)
from skmotionseg._core.geometry.hypotheses import (
    draw_minimal_sets,
    residual_matrix,
)
from skmotionseg._core.geometry.motion_models import MOTION_MODELS
from skmotionseg._core.geometry.tracks import (
    frame_pairs,
    unpack_tracks,
    working_coordinates,
)
from skmotionseg.datasets import make_rigid_motions

MODELS = tuple(MOTION_MODELS)
N_HYPOTHESES, TOP = 100, 0.1
# What single precision takes from distances, the square roots of residuals: at worst,
# and from all but one in a thousand.
RELATIVE, PIXELS, USUAL_PIXELS = 1e-3, 3e-3, 5e-4


@cache
def scene():
    """Three motions: points, visibility and true labels."""
    X, y = make_rigid_motions(
        n_tracks=120, n_frames=4, n_motions=3, missing=0.1, noise=0.2, random_state=0
    )
    return *unpack_tracks(X), y


@dataclass(frozen=True)
class Change:
    """A way to change tracks that does not change who moves with whom.

    Attributes
    ----------
    points : callable
        ``(n_tracks, n_frames, 2) -> (n_tracks, n_frames, 2)``.
    order : ndarray of int, shape (n_tracks,), optional
        New position to old position.
    backwards : bool
        Whether the last frame becomes the first.
    scale : float
        Of lengths.
    exact : bool
        Whether it holds to the last bit.
    """

    points: Callable = lambda points: points
    order: np.ndarray | None = None
    backwards: bool = False
    scale: float = 1.0
    exact: bool = False

    def tracks(self, points, visibility):
        """Points and visibility as they are afterwards."""
        step = -1 if self.backwards else 1
        points, visibility = self.points(points)[:, ::step], visibility[:, ::step]
        return self.rows(points), self.rows(visibility)

    def rows(self, array):
        return array if self.order is None else array[self.order]

    def sets(self, sets):
        """The same tracks, by their new positions and in the new order of pairs."""
        if self.order is not None:
            sets = np.argsort(self.order)[sets]
        return sets[::-1] if self.backwards else sets

    def residuals(self, R):
        """What residuals (n_tracks, n_pairs, n_hypotheses) ought to become."""
        R = self.scale**2 * self.rows(R)
        return R[:, ::-1] if self.backwards else R


def rotated(points, angle):
    c, s = np.cos(angle), np.sin(angle)
    return points @ np.array([[c, s], [-s, c]])


CHANGES = {
    "tracks permuted": Change(order=np.random.default_rng(0).permutation(120)),
    "time reversed": Change(backwards=True),
    "mirrored": Change(lambda points: points * [-1, 1], exact=True),
    "upside down": Change(lambda points: points * [1, -1], exact=True),
    "half as large": Change(lambda points: points / 2, scale=0.5, exact=True),
    "eight times as large": Change(lambda points: 8 * points, scale=8, exact=True),
    "in another unit": Change(lambda points: 0.0254 * points, scale=0.0254),
    "shifted": Change(lambda points: np.add(points, [1234.5, -67.8])),
    "axes swapped": Change(lambda points: points[..., ::-1]),
    "rotated": Change(lambda points: rotated(points, 0.7)),
}
every_change = pytest.mark.parametrize("name", CHANGES)
every_model = pytest.mark.parametrize("model", MODELS)


@cache
def minimal_sets(model, seed=0):
    """Tracks (n_pairs, N_HYPOTHESES, p) of the unchanged scene."""
    _, visibility, _ = scene()
    pairs = frame_pairs(visibility.shape[1])
    rng, size = check_random_state(seed), MOTION_MODELS[model].minimal_size
    sets = []
    for pair in pairs:
        rows = np.flatnonzero(visibility[:, pair].all(axis=1))
        drawn = draw_minimal_sets(np.full(N_HYPOTHESES, len(rows)), size, rng)
        sets.append(rows[drawn])
    return np.stack(sets)


def residuals_of(model, points, visibility, sets, *, swapped=False):
    """Residuals (n_tracks, n_pairs, N_HYPOTHESES) to the models through given sets."""
    pairs = frame_pairs(visibility.shape[1])
    pairs = pairs[:, ::-1] if swapped else pairs
    model = MOTION_MODELS[model]
    hypotheses = fit_minimal_sets(points, visibility, pairs, model, sets)
    assert np.isfinite(hypotheses).all()
    working = working_coordinates(points, visibility)
    R = residual_matrix(points, visibility, pairs, hypotheses, model, *working)
    return R.reshape(len(points), len(pairs), -1)


@cache
def residuals_before_and_after(model, name):
    points, visibility, _ = scene()
    sets, change = minimal_sets(model), CHANGES[name]
    before = residuals_of(model, points, visibility, sets)
    changed = change.tracks(points, visibility)
    return change.residuals(before), residuals_of(model, *changed, change.sets(sets))


def assert_same_distances(actual, expected, atol):
    assert_allclose(np.sqrt(actual), np.sqrt(expected), rtol=RELATIVE, atol=atol)


def kernel(R, **parameters):
    parameters = {"n_hypotheses": R.shape[2], "top": TOP} | parameters
    return ORKKernel(**parameters).fit_transform(R.reshape(len(R), -1))


def tracks_of_sure_ranks(R, pixels):
    """Tracks whose last preferred residual is clearly smaller than the next, always."""
    n_top = round(TOP * R.shape[2])
    last, following = np.moveaxis(np.sort(R, axis=2)[..., n_top - 1 : n_top + 1], 2, 0)
    gap = np.sqrt(following) - np.sqrt(last)
    close = gap < 2 * (RELATIVE * np.sqrt(last) + pixels)
    return np.flatnonzero(~close.any(axis=1))  # NaN is not close


def assert_same_partition(actual, expected):
    """The same groups, however they are numbered."""
    assert_array_equal(actual[:, None] == actual, expected[:, None] == expected)
    assert_array_equal(actual == -1, expected == -1)


# ---------------------------------------------------------------------------- residuals


@every_model
@every_change
def test_residuals_are_the_same(model, name):
    """In time reversed, those of homographies are so to first order alone."""
    expected, actual = residuals_before_and_after(model, name)
    change = CHANGES[name]
    if change.exact:
        assert_array_equal(actual, expected)
    elif not (change.backwards and model == "homography"):
        assert_same_distances(actual, expected, PIXELS * change.scale)


@every_model
def test_residuals_do_not_depend_on_which_frame_of_a_pair_is_the_first(model):
    points, visibility, _ = scene()
    sets = minimal_sets(model)
    before = residuals_of(model, points, visibility, sets)
    after = residuals_of(model, points, visibility, sets, swapped=True)
    assert_array_equal(np.isnan(after), np.isnan(before))
    if model == "homography":  # to first order, so where residuals are small
        small = before < 0.25
        assert small.sum() > 1000
        assert_allclose(after[small], before[small], rtol=0.1, atol=PIXELS)
    else:
        assert_same_distances(after, before, PIXELS)


@every_model
def test_a_copy_of_a_track_has_its_residuals(model):
    points, visibility, _ = scene()
    sets = minimal_sets(model)
    twice = np.append(np.arange(120), 7)
    pairs = frame_pairs(visibility.shape[1])
    found = fit_minimal_sets(points, visibility, pairs, MOTION_MODELS[model], sets)
    working = working_coordinates(points, visibility)
    R = residual_matrix(
        points[twice], visibility[twice], pairs, found, MOTION_MODELS[model], *working
    )
    assert_array_equal(R[-1], R[7])


# --------------------------------------------------------------------------- affinities


@every_model
@every_change
def test_affinities_are_the_same(model, name):
    """Those of tracks that no rounding can make prefer another hypothesis."""
    expected, actual = residuals_before_and_after(model, name)
    change = CHANGES[name]
    if change.exact:
        for sparsity in (None, 6.0):
            before, after = (kernel(R, sparsity=sparsity) for R in (expected, actual))
            assert_array_equal(after, before)
    elif not (change.backwards and model == "homography"):
        sure = tracks_of_sure_ranks(expected, USUAL_PIXELS * change.scale)
        assert len(sure) > 60
        before, after = (kernel(R, sparsity=None) for R in (expected, actual))
        assert_array_equal(after[np.ix_(sure, sure)], before[np.ix_(sure, sure)])


# ---------------------------------------------------------------------------- partition


@every_change
@pytest.mark.parametrize("fusion", ["kernel_addition", "coreg", "subset"])
def test_the_spectral_partition_is_the_same(fusion, name):
    views = [residuals_before_and_after(model, name) for model in MODELS]
    before, after = (
        MultiModelSpectralClustering(3, fusion=fusion, random_state=0).fit_predict(
            np.hstack([kernel(view[side]) for view in views])
        )
        for side in (0, 1)
    )
    assert_same_partition(after, before)


def segment(points, n_motions, selection):
    segmenter = MotionSegmenter(
        n_motions, selection=selection, n_hypotheses=N_HYPOTHESES, random_state=0
    )
    return segmenter.fit(pack_tracks(points))


def segment_by_given_sets(change, n_motions, selection):
    """The changed scene; the sampler is given minimal sets instead of drawing them."""

    def fit(points, visibility, pairs, model, n_hypotheses, random_state):
        sets = change.sets(minimal_sets(model.name))
        assert n_hypotheses == sets.shape[1]
        return fit_minimal_sets(points, visibility, pairs, model, sets), sets

    points, visibility, _ = scene()
    with mock.patch("skmotionseg.sampling.draw_hypotheses", fit):
        return segment(change.tracks(points, visibility)[0], n_motions, selection)


# The unchanged scene, with which all others are compared.
@cache
def unchanged(n_motions, selection):
    return segment(scene()[0], n_motions, selection)


@cache
def unchanged_by_given_sets(n_motions, selection):
    return segment_by_given_sets(Change(), n_motions, selection)


WAYS = [(3, "description_length"), ("auto", "description_length"), (3, "ncre")]
# Of the other axis, or of another scale: what goes wrong with one does with both.
ALIKE = {"upside down", "half as large", "in another unit"}
# The steps to a known number are some of those to an unknown one: one of each kind.
WITH_KNOWN_NUMBER = {"tracks permuted", "time reversed", "mirrored", "rotated"}
repeats = pytest.mark.long  # what repeats others: the search takes longest
every_way = pytest.mark.parametrize(
    ("n_motions", "selection"), [pytest.param(*WAYS[0], marks=repeats), *WAYS[1:]]
)


def every_way_of(names):
    """Each change and way; changes like others in the long run alone."""

    def marks(name, way):
        alike = name in ALIKE or (way == WAYS[0] and name not in WITH_KNOWN_NUMBER)
        return [repeats] if alike else []

    return pytest.mark.parametrize(
        ("name", "n_motions", "selection"),
        [
            pytest.param(name, *way, marks=marks(name, way))
            for way in WAYS
            for name in names
        ],
    )


@every_way_of(CHANGES)
def test_the_segmentation_is_the_same(name, n_motions, selection):
    change = CHANGES[name]
    before = unchanged_by_given_sets(n_motions, selection)
    after = segment_by_given_sets(change, n_motions, selection)
    assert before.n_motions_ > 1
    assert_same_partition(after.labels_, change.rows(before.labels_))


@every_way_of([name for name, change in CHANGES.items() if change.exact])
def test_the_same_seed_draws_the_same_sets_of_a_changed_image(
    name, n_motions, selection
):
    points, visibility, _ = scene()
    changed, _ = CHANGES[name].tracks(points, visibility)
    before = unchanged(n_motions, selection)
    after = segment(changed, n_motions, selection)
    assert_array_equal(after.labels_, before.labels_)
    assert_array_equal(after.candidate_labels_, before.candidate_labels_)
    assert_allclose(after.costs_, before.costs_, rtol=1e-9)


# ------------------------------------------------------------------------- empty frames


def with_empty_frames(points, *, before=0, after=0):
    n_frames = points.shape[1]
    longer = np.full((len(points), before + n_frames + after, 2), np.nan)
    longer[:, before : before + n_frames] = points
    return longer


EMPTY_FRAMES = [{"before": 3, "after": 5}, {"before": 1}, {"after": 1}]
# At both ends, and at each by itself in the long run alone.
empty_frames = pytest.mark.parametrize(
    "frames",
    [EMPTY_FRAMES[0], *(pytest.param(f, marks=repeats) for f in EMPTY_FRAMES[1:])],
    ids=str,
)


@every_model
@pytest.mark.parametrize("frames", EMPTY_FRAMES, ids=str)
def test_a_frame_that_sees_nothing_adds_pairs_without_residuals(model, frames):
    points, _, _ = scene()
    R, longer = (
        HypothesisSampler(model, n_hypotheses=20, random_state=0)
        .fit_transform(pack_tracks(p))
        .reshape(120, -1, 20)
        for p in (points, with_empty_frames(points, **frames))
    )
    start = frames.get("before", 0)
    stop = start + R.shape[1]
    assert_array_equal(longer[:, start:stop], R)
    assert np.isnan(longer[:, :start]).all()
    assert np.isnan(longer[:, stop:]).all()
    assert_array_equal(kernel(longer), kernel(R))


def with_empty_frames_between(points, places):
    """Tracks with a frame in which nothing is seen before each of these frames."""
    return np.insert(points, places, np.nan, axis=1)


@pytest.mark.parametrize(
    "places", [pytest.param([1], marks=repeats), [2, 2], [0, 2, 3]], ids=str
)
@every_way
def test_a_frame_that_sees_nothing_parts_no_neighbours(places, n_motions, selection):
    points, _, _ = scene()
    longer = with_empty_frames_between(points, places)
    before = unchanged(n_motions, selection)
    after = segment(longer, n_motions, selection)
    assert_array_equal(after.labels_, before.labels_)
    assert_array_equal(after.candidate_labels_, before.candidate_labels_)
    assert_array_equal(after.costs_, before.costs_)
    tracks = pack_tracks(points), pack_tracks(longer)
    assert_array_equal(after.predict(tracks[1]), before.predict(tracks[0]))
    first, second = before.report(tracks[0]), after.report(tracks[1])
    assert second.n_frames == first.n_frames + len(places)
    assert [m.residual for m in second.motions] == [m.residual for m in first.motions]


@empty_frames
@every_way
def test_a_frame_that_sees_nothing_changes_nothing(frames, n_motions, selection):
    points, _, _ = scene()
    longer = with_empty_frames(points, **frames)
    before = unchanged(n_motions, selection)
    after = segment(longer, n_motions, selection)
    assert_array_equal(after.labels_, before.labels_)
    assert_array_equal(after.candidate_labels_, before.candidate_labels_)
    assert_array_equal(after.costs_, before.costs_)


@cache
def with_landmarks(n_frames, before=0, after=0):
    X, _ = make_rigid_motions(90, n_frames, 2, missing=0.05, random_state=0)
    points, _ = unpack_tracks(X)
    return MotionSegmenter(2, n_landmarks=45, n_hypotheses=40, random_state=0).fit(
        pack_tracks(with_empty_frames(points, before=before, after=after))
    )


@empty_frames
@pytest.mark.parametrize("n_frames", [4, 40])  # of 40, some of the pairs place tracks
def test_a_frame_that_sees_nothing_changes_no_landmark_and_no_place(n_frames, frames):
    before, after = with_landmarks(n_frames), with_landmarks(n_frames, **frames)
    assert_array_equal(after.landmarks_, before.landmarks_)
    assert_array_equal(after.labels_, before.labels_)
    assert_array_equal(after.probabilities_, before.probabilities_)


# ----------------------------------------------------------------------- doubled tracks


@every_way
@pytest.mark.parametrize(
    "seed", [0, pytest.param(1, marks=repeats), pytest.param(2, marks=repeats)]
)
def test_a_track_and_its_copy_get_the_same_label(n_motions, selection, seed):
    """Many copies of few tracks, of which some are stray."""
    points, _, _ = scene()
    rows = np.random.default_rng(seed).choice(120, size=100)
    segmenter = segment(points[rows], n_motions, selection)
    for labels in (segmenter.labels_, *segmenter.candidate_labels_):
        assert len(set(zip(rows, labels, strict=True))) == len(set(rows))
