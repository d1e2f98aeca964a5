"""Clips of many frames: windows that overlap, and what joins them."""

from __future__ import annotations

import json
import warnings

import numpy as np
import pytest
from helpers.films import film
from joblib import parallel_config
from numpy.testing import assert_array_equal
from sklearn.base import clone
from sklearn.exceptions import NotFittedError

from skmotionseg import MotionSegmenter, NCREModelSelector, pack_tracks
from skmotionseg._core.stream.agreement import WindowMotions
from skmotionseg._segmenter import long_clips
from skmotionseg._utils.validation import TooFewTracksError
from skmotionseg.datasets import make_rigid_motions
from skmotionseg.metrics import misclassification_error

pytestmark = pytest.mark.xdist_group("long clip")  # fitted once for all


@pytest.fixture(scope="module")
def movie():
    return film(n_frames=104, n_static=150, n_moving=75, life=40)


@pytest.fixture(scope="module")
def X(movie):
    kept = movie.seen.sum(axis=1) >= 4
    return pack_tracks(movie.points[kept], movie.seen[kept]), movie.things[kept]


@pytest.fixture(scope="module")
def segmented():
    """What was found in each window when the clip was fitted, by its tracks."""
    return {}


@pytest.fixture(scope="module")
def fitted(X, segmented):
    segment = long_clips._segment

    def noted(estimator, X, version):
        found = segment(estimator, X, version)
        segmented.setdefault(X.tobytes(), found)
        return found

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(long_clips, "_segment", noted)
        return MotionSegmenter(2, n_hypotheses=100, random_state=0).fit(X[0])


@pytest.mark.slow
def test_motions_of_a_long_clip(X, fitted):
    tracks, things = X
    assert fitted.n_motions_ == 2
    assert misclassification_error(things, fitted.labels_) < 0.02
    assert_array_equal(fitted.windows_[[0, -1]], [[0, 29], [74, 103]])
    assert_array_equal(fitted.predict(tracks[::3]), fitted.labels_[::3])
    assert ((fitted.probabilities_ > 0) == (fitted.labels_ >= 0)).all()
    assert set(fitted.label_reasons_[fitted.labels_ < 0]) <= {"outlier", "too short"}
    assert (fitted.labels_[things == 0] == fitted.background_).mean() > 0.98
    assert not hasattr(fitted, "views_")


@pytest.mark.slow
def test_report_of_a_long_clip_is_of_its_windows(X, fitted):
    tracks, _ = X
    report = fitted.report(tracks)
    assert [each.n_tracks for each in report.motions] == [
        (fitted.labels_ == label).sum() for label in (0, 1)
    ]
    for label, motion in enumerate(report.motions):
        seen = np.isfinite(tracks[fitted.labels_ == label, ::2]).any(axis=0)
        assert_array_equal(motion.frames, np.flatnonzero(seen))
        assert 0 < motion.residual < 1
        assert set(motion.description_lengths) == {
            "affine",
            "homography",
            "fundamental",
        }
    assert report.counts == ()
    assert_array_equal([each.frames for each in report.windows], fitted.windows_)
    found = [each.n_motions for each in report.windows]
    assert_array_equal(found, fitted.window_counts_)
    assert max(found) == 2
    assert "5 windows" in str(report)
    assert f"{found.count(2)}" in str(report)
    assert json.loads(json.dumps(report.to_dict()))["windows"][0]["frames"] == [0, 29]
    with pytest.raises(ValueError, match="tracks that were fitted; got 9"):
        fitted.report(tracks[:9])


@pytest.mark.slow
def test_of_a_long_clip_only_known_tracks_are_placed(X, fitted):
    tracks, _ = X
    with pytest.raises(ValueError, match="1 of 10 were not"):
        fitted.predict(np.concatenate([tracks[:9], tracks[:1] + 1]))


@pytest.mark.slow
def test_window_that_takes_two_things_for_one_is_segmented_again(
    X, fitted, segmented, monkeypatch
):
    tracks, _ = X
    segment, asked = long_clips._segment, []

    def mistaken(estimator, X, version):
        """The open number of a window that sees the frames of the third is one."""
        if not np.array_equal(X, third, equal_nan=True):
            assert estimator.n_motions == "auto"
            return segmented[X.tobytes()]
        asked.append((estimator.n_motions, estimator.max_motions))
        if estimator.n_motions == "auto":
            return np.zeros(len(X), dtype=int), 1.0
        return segment(estimator, X, version)

    clip = long_clips.LongClip(tracks, 2)
    third = pack_tracks(*clip.window(clip.parts[2]))
    monkeypatch.setattr(long_clips, "_segment", mistaken)
    segmenter = MotionSegmenter(2, n_hypotheses=100, random_state=0, n_jobs=2)
    with parallel_config(backend="threading"):
        segmenter.fit(tracks)
    assert asked == [("auto", 2), (2, 2)]
    assert_array_equal(segmenter.window_counts_, 2)
    beside = fitted.window_confidences_[[1, 3]]
    assert segmenter.window_confidences_[2] == beside.min()
    assert (segmenter.labels_ == fitted.labels_).mean() > 0.99


@pytest.mark.slow
def test_selectors_of_their_own_are_not_overruled(X, monkeypatch):
    """They say nothing of how probable a number is, and may allow no other."""
    selection = NCREModelSelector(min_clusters=1, max_clusters=2)
    segmenter = MotionSegmenter(selection=selection, n_hypotheses=50, random_state=0)
    asked, of = [], long_clips._WindowFits.of
    monkeypatch.setattr(
        long_clips._WindowFits, "of", lambda *a: asked.append(a[1:]) or of(*a)
    )
    segmenter.fit(X[0])
    assert asked == [(range(5),)]
    assert segmenter.window_counts_.max() <= 2
    assert_array_equal(segmenter.window_confidences_, 1)


@pytest.mark.slow
def test_windows_that_are_there_are_not_segmented_again(X, tmp_path, monkeypatch):
    tracks, _ = X
    quick = {"selection": "ncre", "n_hypotheses": 50, "random_state": 0}
    quick["max_motions"] = 2
    segmenter = MotionSegmenter(**quick, memory=tmp_path)
    done, segment = [], MotionSegmenter._fit_window

    def interrupted(self, X):
        if len(done) == 2:
            raise KeyboardInterrupt
        done.append(1)
        return segment(self, X)

    with monkeypatch.context() as patched:
        patched.setattr(MotionSegmenter, "_fit_window", interrupted)
        with pytest.raises(KeyboardInterrupt):
            segmenter.fit(tracks)
    assert len(list(tmp_path.rglob("output.pkl"))) == 2
    plain = MotionSegmenter(**quick).fit(tracks)
    assert_array_equal(segmenter.fit(tracks).labels_, plain.labels_)
    assert len(list(tmp_path.rglob("output.pkl"))) == len(plain.windows_)


def short_lived(n_tracks=180, n_frames=110, life=40):
    """Three motions of which no window sees all tracks."""
    X, _ = make_rigid_motions(n_tracks, n_frames, missing=0, random_state=1)
    starts = np.random.default_rng(0).integers(-20, n_frames - 20, n_tracks)
    age = np.arange(n_frames) - starts[:, None]
    X[np.repeat((age < 0) | (age >= life), 2, axis=1)] = np.nan
    return X


@pytest.mark.slow
def test_windows_have_as_many_landmarks_as_tracks():
    X = short_lived()
    segmenter = MotionSegmenter(
        selection="ncre", max_motions=3, n_hypotheses=50, n_landmarks=100
    )
    segmenter.set_params(random_state=0).fit(X)
    assert segmenter.window_counts_.min() >= 1
    assert np.isfinite(segmenter.window_confidences_).all()
    assert (segmenter.labels_ >= 0).mean() > 0.9


def test_errors_of_windows_are_errors():
    """Only that there are too few tracks is what a window may have."""
    X = short_lived(n_tracks=60)

    def broken(views, n_clusters):
        raise ValueError("no fusion")

    with pytest.raises(ValueError, match="no fusion"):
        MotionSegmenter(fusion=broken, n_hypotheses=50).fit(X)
    with pytest.raises(ValueError, match="frame_gap=30 needs at least 31 frames; clip"):
        MotionSegmenter(frame_gap=30).fit(X)


def test_a_fit_leaves_nothing_of_the_one_before(X):
    short, _ = make_rigid_motions(60, 5, 2, random_state=0)
    segmenter = MotionSegmenter(2, n_hypotheses=50, random_state=0)
    fresh = segmenter.fit(short).predict(short)
    of_short = set(vars(segmenter))
    few = X[0][:120]
    segmenter.set_params(selection="ncre").fit(few)
    assert not hasattr(segmenter, "landmarks_")
    segmenter.set_params(selection="description_length").fit(short)
    assert set(vars(segmenter)) == of_short
    assert_array_equal(segmenter.predict(short), fresh)
    assert str(segmenter.report(short)).startswith("2 motions in 60 tracks")
    with pytest.raises(ValueError):
        segmenter.fit(short[:4])
    with pytest.raises(NotFittedError):
        segmenter.predict(short)


def glimpsed(n_frames=104, n_tracks=40):
    """Tracks of the first frames, then a glimpse of two in each, and later ones."""
    rng = np.random.RandomState(0)
    points = rng.uniform(0, 800, (n_tracks, 1, 2)) + rng.normal(
        scale=0.2, size=(n_tracks, n_frames, 2)
    )
    points += np.arange(n_frames)[None, :, None] * [1.0, 0.5]
    early, late = points.copy(), points.copy()
    early[:, 20:] = late[:, :50] = np.nan
    for frame in range(20, 50):
        two = [(2 * frame) % n_tracks, (2 * frame + 1) % n_tracks]
        early[two, frame] = points[two, frame]
    return pack_tracks(np.concatenate([early, late]))


@pytest.mark.parametrize(
    "n_landmarks, selection", [("auto", "description_length"), (30, "ncre")]
)
def test_window_without_tracks_is_one_without_motions(n_landmarks, selection):
    segmenter = MotionSegmenter(n_landmarks=n_landmarks, selection=selection)
    segmenter.set_params(n_hypotheses=30, random_state=0).fit(glimpsed())
    assert segmenter.window_counts_.min() == 0
    assert (segmenter.labels_ == 0).all()


@pytest.mark.parametrize(
    "n_before, selection", [(50, "description_length"), (50, "ncre"), (64, "ncre")]
)
def test_motions_before_and_after_a_cut_are_two_in_whatever_place_they_are(
    n_before, selection
):
    rng = np.random.default_rng(0)
    swaying = np.sin(np.arange(60 + n_before) / 20)[:, None] * [20.0, 10.0]
    points = rng.uniform(0, [800, 600], (80, 1, 2)) + swaying
    points += rng.normal(scale=0.2, size=points.shape)
    points[:40, n_before:] = points[40:, :n_before] = np.nan
    segmenter = MotionSegmenter(selection=selection, n_hypotheses=30, random_state=0)
    labels = segmenter.fit_predict(pack_tracks(points))
    assert len(set(labels[:40])) == len(set(labels[40:])) == 1
    assert labels[0] != labels[40]


def test_tracks_where_too_few_are_seen_are_no_outliers():
    X = glimpsed(n_frames=160)
    X[-6:-3, 2 * 121 :] = X[-3:, : 2 * 121] = np.nan  # three, and then three others
    X[:-6, 2 * 100 :] = np.nan
    found = MotionSegmenter(n_hypotheses=30, random_state=0).fit(X)
    assert_array_equal(found.labels_[-3:], -1)
    assert_array_equal(found.label_reasons_[-3:], "isolated")


@pytest.mark.parametrize("n_frames", [90, 110])
def test_a_clip_with_too_few_tracks_is_refused_whatever_its_length(n_frames):
    X, _ = make_rigid_motions(5, n_frames, 1, missing=0, random_state=0)
    for tracks in (X, np.full((40, 2 * n_frames), np.nan)):
        with pytest.raises(TooFewTracksError, match="seen in the same two"):
            MotionSegmenter(2).fit(tracks)


def test_window_without_motions_has_none():
    found = long_clips._segment(MotionSegmenter(), np.ones((3, 20)), "")
    labels, *probabilities = found
    assert np.isnan(probabilities).all()
    assert_array_equal(labels, [-1, -1, -1])


@pytest.fixture(scope="module")
def gapped():
    """A clip whose first ten frames see nothing, and a segmenter of it."""
    X, _ = make_rigid_motions(150, 120, 2, missing=0.3, random_state=0)
    X[:, :20] = np.nan
    segmenter = MotionSegmenter(selection="ncre", n_hypotheses=50, random_state=0)
    return X, segmenter.fit(X)


@pytest.mark.slow
def test_windows_of_a_clip_with_empty_frames_are_in_its_frames(gapped):
    X, segmenter = gapped
    report = segmenter.report(X)
    assert_array_equal(segmenter.windows_[[0, -1]], [[10, 39], [90, 119]])
    assert report.n_frames == 120
    assert report.windows[0].frames == (10, 39)


@pytest.mark.slow
def test_a_long_clip_has_as_many_motions_as_are_asked_for(gapped):
    X, segmenter = gapped
    n_motions = segmenter.n_motions_ + 1
    more = clone(segmenter).set_params(n_motions=n_motions).fit(X)
    assert more.n_motions_ == n_motions
    assert set(more.labels_) - {-1} == set(range(n_motions))


@pytest.mark.slow
def test_motions_that_no_window_tells_apart_are_warned_of(monkeypatch):
    def one_motion(estimator, X, version):
        return np.zeros(len(X), dtype=int), 1.0, 0.0

    monkeypatch.setattr(long_clips, "_segment", one_motion)
    X, _ = make_rigid_motions(30, 120, 2, missing=0, random_state=0)
    with pytest.warns(UserWarning, match="n_motions=3 was asked for, but .* only 1"):
        segmenter = MotionSegmenter(3, n_hypotheses=50, random_state=0).fit(X)
    assert segmenter.n_motions_ == 1


def test_a_window_is_fitted_once_into_each_number(monkeypatch):
    fits = []

    def one_motion(estimator, X, version):
        fits.append(estimator.n_motions)
        return np.zeros(len(X), dtype=int), 1.0, 0.0

    monkeypatch.setattr(long_clips, "_segment", one_motion)
    X, _ = make_rigid_motions(30, 120, 2, missing=0, random_state=0)
    rng = np.random.RandomState(0)
    windows = long_clips._WindowFits(
        long_clips.LongClip(X, 2), MotionSegmenter(), rng, None
    )
    first = windows.of([0, 1], [2, 3])
    assert windows.of([1, 0], [3, 2])[1] is first[0]
    windows.of([0], [2], attempt=1)
    assert fits == [2, 3, 2]


class OfHalves(MotionSegmenter):
    """Has tracks of every second pixel, and one parameter."""

    def __init__(self, random_state=None):
        super().__init__(2, n_hypotheses=20, random_state=random_state)

    def fit(self, X, y=None):
        return super().fit(2 * X)


def test_windows_of_a_subclass_are_fitted_once(monkeypatch):
    X, _ = make_rigid_motions(40, 104, 2, missing=0, random_state=0)
    fitted = []

    def segment(estimator, X, version):
        assert type(estimator) is MotionSegmenter
        assert (estimator.n_hypotheses, estimator.max_motions) == (20, 2)
        fitted.append(X)
        return np.arange(len(X)) % 2, 1.0, 0.0

    monkeypatch.setattr(long_clips, "_segment", segment)
    segmenter = OfHalves(random_state=0).fit(X)
    assert segmenter.n_motions_ == 2
    assert_array_equal(np.hstack(fitted)[:, :60], 2 * X[:, :60])


@pytest.mark.parametrize(
    "unexplained, told", [((0, 53, 0), 0), ((0, 53), 0), ((9, 53, 0), 1), ((53,), 1)]
)
def test_a_poor_window_beside_better_ones_is_no_matter(unexplained, told):
    one = WindowMotions(np.arange(3), np.zeros(3, dtype=int), 0.9)
    few = WindowMotions(np.arange(1), np.full(1, -1), np.nan)  # not searched
    found = [one._replace(unexplained=float(each)) for each in unexplained]
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        long_clips._warn_if_unexplained([few, *found, few])
    assert len(heard) == told
    assert all("half of the tracks of the usual window" in str(w) for w in heard)


def test_windows_are_fitted_without_a_word():
    """The clip's fit says what there is to say."""
    X = pack_tracks(np.random.RandomState(0).uniform(0, 500, (30, 30, 2)))
    estimator = MotionSegmenter(random_state=0)
    labels, surely, more, unexplained = long_clips._segment(estimator, X, None)
    assert len(labels) == 30
    assert 0 <= more <= surely <= 1
    assert unexplained > 50
