"""Any tracks at all: an answer that keeps the contract, or an error that says why not.

The arrays are made by track_strategies.py. Each estimator has a contract here, and a
list of refusals: which of them is due is worked out from the arrays, not read off the
error. ``pytest`` looks at about two hundred and fifty cases, ``pytest -m long`` at
twenty-two thousand, from fixed seeds, and says at the end what came of them.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from itertools import combinations
from typing import NamedTuple

import numpy as np
import pytest
from helpers.generated_cases import CASES_A_TEST, run_cases
from helpers.track_strategies import affinities, matches, mostly, residuals, tracks
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from skmotionseg import (
    EigengapModelSelector,
    HypothesisSampler,
    MotionSegmenter,
    MultiModelSpectralClustering,
    NCREModelSelector,
    ORKKernel,
    SelfTuningModelSelector,
)
from skmotionseg._core.geometry.tracks import frame_pairs
from skmotionseg._core.partition import photograph_partitions
from skmotionseg._utils.validation import TooFewTracksError

MODELS = ("affine", "homography", "fundamental")
MINIMAL_SIZE = {"affine": 3, "homography": 4, "fundamental": 8}
SELECTIONS = ("description_length", "ncre", "eigengap", "self_tuning")
FUSIONS = ("kernel_addition", "coreg", "subset")
CASES = {"short": 300, "long": 20_000}  # times the shares, which add up to 1.1

# Errors that are ours: others are of NumPy, and say nothing of what was expected.
WORDED = (ValueError, TypeError, TooFewTracksError)
# Why an input may be refused, and how the error says so.
REFUSALS = {
    "infinity": "Input X contains infinity or a value too large for dtype",
    "NaN": "Input X contains NaN",
    "gap": r"frame_gap=\d+ needs at least \d+ frames; got \d+$",
    "few tracks": r"the \w+ model needs \d tracks that are seen in the same two "
    r"frames; the best frame pair has \d+ \(n_samples=\d+\)$",
    "motions": r"\d+ motions are more than the tracks \(n_samples=\d+\)$",
    "loners": r"\d+ motions are more than the \d+ tracks that share a preference with "
    r"another \(n_samples=\d+\)$",
    "landmarks": r"n_landmarks=\d+ is more than the tracks \(n_samples=\d+\)",
    "few landmarks": r"n_landmarks must be at least the \d tracks that the \w+ model "
    r"needs; got \d+$",
    "groups": r"(n|min)_clusters=\d+ is more than the \d+ tracks that have an affinity "
    r"to another \(n_samples=\d+\)$",
    "columns": r"residual columns come in groups of n_hypotheses=\d+, one per "
    r"frame pair; got \d+ columns$",
    "square": r"stacked affinities need shape \(n, n_views \* n\), square blocks side "
    r"by side; got \(\d+, \d+\) \(the rows of a fold are no stacked affinities: ",
    "no columns": r"Found array with 0 feature\(s\)",
    "symmetric": r"affinities need to be symmetric; entries of view \d differ from "
    r"their transposes by up to ",
    "negative": r"Negative values in data passed to (X in )?"
    r"(MultiModelSpectralClustering|\w+ModelSelector)",
}


# --------------------------------------------------------------------------- contracts


def assert_labels(labels, n_tracks, most):
    """A whole number per track: -1, or 0, 1, ... from the largest motion down."""
    assert isinstance(labels, np.ndarray)
    assert labels.shape == (n_tracks,)
    assert labels.dtype.kind == "i"
    assert labels.min() >= -1
    sizes = np.bincount(labels[labels >= 0])
    assert 0 < len(sizes) <= most
    assert (sizes > 0).all()
    assert (np.diff(sizes) <= 0).all()


def assert_copies_are_alike(recipe, rows):
    """The last tracks are copies of the first ones, and so is what comes of them."""
    k = recipe.n_copies
    assert_array_equal(rows[len(rows) - k :], rows[:k])


def visible(X):
    return np.isfinite(X.reshape(len(X), -1, 2)).all(axis=2)


def without_empty_frames(X, gap):
    """What a segmenter looks at, if there is a pair of frames in it."""
    filled = visible(X).any(axis=0)
    return X[:, np.repeat(filled, 2)] if filled.sum() > gap else X


def seen_in_pairs(X, gap):
    """Bool, (n_tracks, n_pairs)."""
    seen = visible(X)
    return seen[:, frame_pairs(seen.shape[1], gap)].all(axis=2)


# Refusals that are due to an estimator for some input, and those that may come: what
# they depend on shows only on the way.


def due_to_tracks(X, models, gap):
    if np.isinf(X).any():
        return {"infinity"}
    if X.shape[1] // 2 <= gap:
        return {"gap"}
    return due_to_pairs(seen_in_pairs(X, gap), models)


def due_to_pairs(seen, models):
    most = seen.sum(axis=0).max()
    return {"few tracks"} if any(most < MINIMAL_SIZE[m] for m in models) else set()


def seen_apart(X):
    """Whether tracks that are seen twice or more are seen in no two frames in a row.

    Bool, (n_tracks_seen_twice,).
    """
    twice = visible(X).sum(axis=1) > 1
    return ~seen_in_pairs(X, 1)[twice].any(axis=1)


def are_photographs(X):
    """Whether more than a fifth of the tracks are not seen in consecutive frames."""
    apart = seen_apart(X)
    return apart.size > 0 and apart.mean() > 0.2


def seen_in_any_pairs(X):
    """Bool, (n_tracks, n_pairs), of all pairs of frames."""
    seen = visible(X)
    return np.stack([a & b for a, b in combinations(seen.T, 2)], axis=1)


def due_to_affinities(recipe):
    n, n_views = recipe.n, len(recipe.graphs)
    if recipe.flaw == "not a number":
        return {"NaN"}
    if recipe.flaw == "negative":
        return {"negative"}
    if recipe.flaw == "lopsided" and n > 1:
        return {"symmetric"}
    if recipe.flaw == "a column short" and n * n_views == 1:
        return {"no columns"}
    if recipe.flaw == "a column short" and n > 1:
        return {"square"}
    return set()


def has_affinity_to_another(recipe):
    """Bool, (n,)."""
    if recipe.n == 1:
        return np.array([True])
    others = recipe.views().any(axis=0) & ~np.eye(recipe.n, dtype=bool)
    return others.any(axis=1)


# ------------------------------------------------------------------- HypothesisSampler


@st.composite
def samplers(draw):
    return HypothesisSampler(
        draw(st.sampled_from(MODELS)),
        n_hypotheses=draw(st.integers(1, 40)),
        frame_gap=draw(mostly(st.sampled_from((1, 2)), st.integers(3, 5))),
        random_state=draw(st.integers(0, 9)),
    )


def refusals_of_sampler(sampler, recipe):
    return due_to_tracks(recipe.matrix(), [sampler.model], sampler.frame_gap), set()


def check_sampler(sampler, recipe):
    X, n_hypotheses = recipe.matrix(), sampler.n_hypotheses
    R = sampler.fit_transform(recipe.given())
    seen = seen_in_pairs(X, sampler.frame_gap)
    enough = seen.sum(axis=0) >= MINIMAL_SIZE[sampler.model]
    assert np.isfinite(sampler.hypotheses_[enough]).all()
    assert np.isnan(sampler.hypotheses_[~enough]).all()
    assert R.dtype == np.float32
    assert R.shape == (len(X), seen.shape[1] * n_hypotheses)
    known = np.repeat(seen & enough, n_hypotheses, axis=1)
    assert_array_equal(np.isnan(R), ~known)
    assert np.isfinite(R[known]).all()
    assert (R[known] >= 0).all()
    assert_copies_are_alike(recipe, R)
    assert_array_equal(sampler.transform(recipe.given()), R)


# --------------------------------------------------------------------------- ORKKernel


@st.composite
def kernels(draw):
    return ORKKernel(
        n_hypotheses=draw(st.integers(1, 120)),
        top=draw(st.sampled_from((0.01, 0.1, 0.5, 1.0))),
        sparsity=draw(st.sampled_from((None, 0.5, 4.0, 6.0, 17.3))),
        covisibility_prior=draw(st.sampled_from((0.0, 0.5, 2.0))),
    )


def of_its_groups(case):
    """Most kernels know how many hypotheses each pair has."""
    kernel, recipe = case
    if recipe.seed % 16:
        kernel.set_params(n_hypotheses=recipe.n_hypotheses)
    return kernel, recipe


def refusals_of_kernel(kernel, recipe):
    width = recipe.n_pairs * recipe.n_hypotheses
    return ({"columns"} if width % kernel.n_hypotheses else set()), set()


def check_kernel(kernel, recipe):
    R, prior = recipe.matrix(), kernel.covisibility_prior
    K = kernel.fit_transform(recipe.given())
    seen = ~np.isnan(R.reshape(len(R), -1, kernel.n_hypotheses)).any(axis=2)
    n_seen = seen.sum(axis=1)
    own = np.where(n_seen > 0, n_seen / np.maximum(n_seen + prior, 1), 0)
    assert K.dtype == np.float32
    assert K.shape == (len(R), len(R))
    assert np.isfinite(K).all()
    assert (K >= 0).all()
    assert (K.max(axis=1) <= own * (1 + 1e-6)).all()
    assert_array_equal(K, K.T)
    assert_allclose(np.diagonal(K), own, rtol=1e-6)
    meet = seen.astype(int) @ seen.T > 0
    assert (K[~meet] == 0).all()
    assert_array_equal(kernel.transform(recipe.given()), K)


# --------------------------- MultiModelSpectralClustering, NCREModelSelector and others


@st.composite
def clusterings(draw):
    return MultiModelSpectralClustering(
        draw(mostly(st.integers(1, 4), st.integers(1, 30))),
        fusion=draw(st.sampled_from(FUSIONS)),
        lam=draw(st.sampled_from((0.0, 1e-2, 1.0))),
        gamma=draw(st.sampled_from((0.0, 1e-2, 1.0))),
        n_init=draw(st.integers(1, 5)),
        random_state=draw(st.integers(0, 9)),
    )


def refusals_of_clustering(clustering, recipe):
    too_many = clustering.n_clusters > has_affinity_to_another(recipe).sum()
    return due_to_affinities(recipe) or ({"groups"} if too_many else set()), set()


def check_clustering(clustering, recipe):
    clustering.fit(recipe.given())
    assert_labels(clustering.labels_, recipe.n, clustering.n_clusters)
    assert np.isfinite(clustering.view_embeddings_).all()
    assert np.isfinite(clustering.objective_).all()
    assert_affinities_are_clustered(clustering, recipe)


def assert_affinities_are_clustered(estimator, recipe):
    alone = ~has_affinity_to_another(recipe)
    assert_array_equal(estimator.labels_ == -1, alone)
    placed = estimator.predict(recipe.given())
    strange = ~recipe.views()[:, :, ~alone].any(axis=(0, 2))
    assert_array_equal(placed == -1, strange)
    assert set(placed) <= set(estimator.labels_) | {-1}


@st.composite
def selectors(draw):
    fewest = draw(mostly(st.just(1), st.integers(1, 6)))
    clusterer = draw(clusterings())
    counts = {"min_clusters": fewest, "max_clusters": draw(st.integers(fewest, 7))}
    other = draw(
        mostly(
            st.none(),
            *[st.just(EigengapModelSelector)] * 3,
            *[st.just(SelfTuningModelSelector)] * 3,
        )
    )
    if other is not None:
        return other(clusterer, **counts)
    delta = draw(st.sampled_from((0.0, 0.2, 1.0)))
    return NCREModelSelector(clusterer, delta=delta, **counts)


def refusals_of_selector(selector, recipe):
    too_many = selector.min_clusters > has_affinity_to_another(recipe).sum()
    return due_to_affinities(recipe) or ({"groups"} if too_many else set()), set()


def check_selector(selector, recipe):
    selector.fit(recipe.given())
    counts, costs = selector.counts_, selector.costs_
    assert selector.min_clusters <= counts[0] <= counts[-1] <= selector.max_clusters
    assert_labels(selector.labels_, recipe.n, counts[-1])
    assert selector.n_clusters_ == selector.labels_.max() + 1
    assert costs.shape == (len(counts), 3)
    assert np.isfinite(costs).all()
    chosen = selector.candidate_labels_[selector.best_index_]
    assert_array_equal(selector.labels_, chosen)
    if isinstance(selector, NCREModelSelector):
        assert_costs_are_in_bounds(selector, len(recipe.graphs))
    assert_affinities_are_clustered(selector, recipe)


def assert_costs_are_in_bounds(selector, n_views):
    cut, error, total = selector.costs_.T
    assert ((cut >= 0) & (cut <= n_views * selector.counts_ + 1e-9)).all()
    assert ((error >= -1e-9) & (error <= 2 * n_views + 1e-9)).all()
    assert_allclose(total, cut + selector.delta * error)
    assert selector.best_index_ == total.argmin()


# ---------------------------------------------------------------------- MotionSegmenter


@st.composite
def segmenters(draw):
    models = st.sampled_from((MODELS, MODELS[:2], MODELS[1:], *MODELS))
    return MotionSegmenter(
        draw(st.sampled_from(("auto", "auto", 1, 2, 3))),
        models=draw(models),
        selection=draw(
            mostly(st.sampled_from(SELECTIONS[:2]), *map(st.just, SELECTIONS[2:]))
        ),
        n_hypotheses=draw(st.integers(20, 50)),
        frame_gap=draw(mostly(st.just(1), st.integers(2, 4))),
        fusion=draw(st.sampled_from(FUSIONS)),
        kernel=draw(
            st.sampled_from((None, ORKKernel(sparsity=2.0), ORKKernel(sparsity=6.0)))
        ),
        min_motions=draw(mostly(st.just(1), st.integers(2, 3))),
        max_motions=draw(st.integers(3, 6)),
        n_landmarks=draw(mostly(st.just("auto"), st.integers(1, 40))),
        random_state=draw(st.integers(0, 9)),
    )


def refusals_of_segmenter(segmenter, recipe):
    X = recipe.matrix()
    auto = segmenter.n_motions == "auto"
    fewest = segmenter.min_motions if auto else segmenter.n_motions
    some = segmenter.n_landmarks != "auto"
    models = (
        [segmenter.models] if isinstance(segmenter.models, str) else segmenter.models
    )
    X = X if np.isinf(X).any() else without_empty_frames(X, segmenter.frame_gap)
    due = due_to_tracks(X, models, segmenter.frame_gap)
    possible = {"loners"}
    if due == {"few tracks"} and segmenter.frame_gap == 1 and seen_apart(X).any():
        due = due_to_pairs(seen_in_any_pairs(X), models)
        if not are_photographs(X):  # few pairs are added, which may see enough or not
            possible |= {"few tracks"}
    if "infinity" not in due and fewest > len(X):
        due = {"motions"}
    elif "infinity" not in due and some and segmenter.n_landmarks > len(X):
        due = {"landmarks"}
    if some and segmenter.n_landmarks < max(MINIMAL_SIZE[m] for m in models):
        due = {"few landmarks"}  # which needs no look at the tracks
    # Landmarks may be too few even where the tracks are not.
    return due, possible | ({"few tracks"} if some else set())


def check_segmenter(segmenter, recipe):
    X, given_tracks = recipe.matrix(), recipe.given()
    segmenter.fit(given_tracks)
    auto = segmenter.n_motions == "auto"
    most = segmenter.max_motions if auto else segmenter.n_motions
    assert_labels(segmenter.labels_, len(X), most)
    assert segmenter.n_motions_ == segmenter.labels_.max() + 1
    assert np.isfinite(segmenter.costs_).all()
    assert segmenter.costs_.shape == (len(segmenter.counts_), 3)
    assert segmenter.candidate_labels_.shape == (len(segmenter.counts_), len(X))
    sampler, _ = next(iter(segmenter.views_.values()))
    seen = visible(without_empty_frames(X, segmenter.frame_gap))
    hidden = ~seen[:, sampler.frame_pairs_].all(axis=2).any(axis=1)
    assert (segmenter.labels_[hidden] == -1).all()
    placed = segmenter.predict(given_tracks)
    assert placed.shape == (len(X),)
    assert set(placed) <= set(range(-1, segmenter.n_motions_))
    assert (placed[hidden] == -1).all()
    assert_copies_are_alike(recipe, placed)
    if len(segmenter.landmarks_) == len(X):
        assert_copies_are_alike(recipe, segmenter.labels_)


@st.composite
def plain_segmenters(draw):
    return MotionSegmenter(
        draw(st.sampled_from(("auto", "auto", 1, 2, 3))),
        n_hypotheses=draw(st.integers(20, 50)),
        min_motions=draw(mostly(st.just(1), st.integers(2, 3))),
        max_motions=draw(st.integers(3, 6)),
        random_state=draw(st.integers(0, 9)),
    )


def check_matches(segmenter, recipe):
    check_segmenter(segmenter, recipe)
    labels, sure = segmenter.labels_, segmenter.probabilities_
    assert ((sure >= 0) & (sure <= 1)).all()
    assert (sure[labels == -1] == 0).all()
    assert_array_equal(segmenter.label_reasons_ == "assigned", labels >= 0)
    chances = segmenter.count_probabilities_
    assert np.isnan(chances).all() or abs(chances.sum() - 1) < 1e-9
    assert str(segmenter.report(recipe.given()))


def is_quick(case):
    """Whether a case takes a second or two: photographs are compared two at a time.

    Those of junk take 12 seconds where they are eight.
    """
    X = case[1].matrix()
    points, seen = X.reshape(len(X), -1, 2), visible(X)
    if points.shape[1] <= 5 or np.isinf(X).any() or seen.sum(axis=1).max() < 2:
        return True
    return not photograph_partitions.are_photographs(points, seen)


# --------------------------------------------------------------------------- the runs


class Subject(NamedTuple):
    """What is tested, on what, and how large its share of the cases is."""

    cases: st.SearchStrategy
    refusals: Callable
    check: Callable
    share: float


SUBJECTS = {
    "HypothesisSampler": Subject(
        st.tuples(samplers(), tracks()), refusals_of_sampler, check_sampler, 0.2
    ),
    "ORKKernel": Subject(
        st.tuples(kernels(), residuals()).map(of_its_groups),
        refusals_of_kernel,
        check_kernel,
        0.15,
    ),
    "MultiModelSpectralClustering": Subject(
        st.tuples(clusterings(), affinities()),
        refusals_of_clustering,
        check_clustering,
        0.15,
    ),
    "NCREModelSelector and others": Subject(
        st.tuples(selectors(), affinities()), refusals_of_selector, check_selector, 0.1
    ),
    "MotionSegmenter": Subject(
        st.tuples(segmenters(), tracks()).filter(is_quick),
        refusals_of_segmenter,
        check_segmenter,
        0.4,
    ),
    "MotionSegmenter, two images": Subject(
        st.tuples(plain_segmenters(), matches(2)),
        refusals_of_segmenter,
        check_matches,
        0.05,
    ),
    "MotionSegmenter, photographs": Subject(
        st.tuples(plain_segmenters(), st.integers(4, 5).flatmap(matches)),
        refusals_of_segmenter,
        check_matches,
        0.05,
    ),
}


def outcome_of(subject, estimator, recipe):
    """Check one case: "answer", or the name of the refusal."""
    due, possible = subject.refusals(estimator, recipe)
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "all coordinates are between")
            warnings.filterwarnings("ignore", "half of the tracks are")
            warnings.filterwarnings("ignore", r"some tracks are at \(0, 0\)")
            subject.check(estimator, recipe)
    except (ValueError, TypeError) as error:
        reasons = [
            reason for reason, words in REFUSALS.items() if re.match(words, str(error))
        ]
        if not reasons or type(error) not in WORDED:
            raise
        assert set(reasons) <= due | possible, f"refused, and should not be: {error}"
        return f"{type(error).__name__}, {reasons[0]}"
    assert not due, f"not refused: {due}"
    return "answer"


def cases_of(name, n_cases, piece=None):
    """Check so many cases of a subject, from a fixed seed; name and outcomes."""
    subject = SUBJECTS[name]

    def outcome(case):
        return outcome_of(subject, *case)

    return [name, run_cases(subject.cases, outcome, n_cases, piece)]


PIECES = [
    pytest.param(name, piece, id=f"{name}-{piece}")
    for name, subject in SUBJECTS.items()
    for piece in range(round(subject.share * CASES["long"] / CASES_A_TEST))
]


@pytest.mark.parametrize("name", SUBJECTS)
def test_an_answer_or_an_error_that_says_why(name, record_property):
    n_cases = round(SUBJECTS[name].share * CASES["short"])
    if name.startswith("MotionSegmenter"):  # whose cases take longest
        n_cases = min(n_cases, 48 if name == "MotionSegmenter" else 7)
    record_property("outcomes", cases_of(name, n_cases))


@pytest.mark.long
@pytest.mark.parametrize(("name", "piece"), PIECES)
def test_very_many_cases(name, piece, record_property):
    record_property("outcomes", cases_of(name, CASES_A_TEST, piece))
