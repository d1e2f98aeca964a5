"""Which tracks are fitted where there are too many, so that no motion has too few."""

from __future__ import annotations

import numpy as np

from .._core.geometry.coverage import draw_covering, draw_stratified
from .._core.geometry.isolation import isolation
from .._core.graph.clustering import cluster_graph
from .._core.graph.fusion import kernel_addition
from .._core.graph.spectral import ViewGraph
from .._parallel.tasks import noting
from .views import fit_views, make_view, place_by_landmarks, view_seeds

# A first look: so many tracks, cut by hypotheses this few into so many over-segments,
# few and large ones first. Of small ones alone, nearly all are parts of the background,
# whose landmarks then leave few hypotheses to what moves.
FIRST_LANDMARKS = 600
FIRST_HYPOTHESES = 200
OVER_SEGMENTS = 8, 30
RESTARTS = 5
# Tracks so much farther from going with their neighbours than these are from theirs are
# isolated, and no more than this share of the landmarks: in dense simulated scenes,
# 87 % of the outliers are, and 5 % of the others. Of none at all, tracks of a small
# motion that are scattered among others would be lost.
ISOLATED = 4.0
SHARE_ISOLATED = 0.05
# The choice is the same for every seed of a fit: other landmarks are other data, and of
# two numbers of motions that are nearly as likely, another may then be chosen.
SEED = 0


def choose_landmarks(
    points, visibility, n_landmarks, models, *, n_jobs=None, memory=None
):
    """Positions of the tracks to fit: all, or a choice.

    A thing that covers a fiftieth of the image has a fiftieth of the tracks, and a cut
    through the background is then cheaper than one around it. So a first choice of
    tracks, which covers all places, displacements and frames, is over-segmented, all
    tracks are placed in the over-segments, and as many landmarks are drawn from each:
    from each of a few, and within it from each of many.
    Outliers are far from everything, and would be half of such a choice: so it is made
    among tracks that go with their neighbours, and a few others.

    Parameters
    ----------
    points : ndarray of shape (n_tracks, n_frames, 2)
    visibility : ndarray of bool, shape (n_tracks, n_frames)
    n_landmarks : int
    models : list of MotionModel
    n_jobs : int or None
    memory : str, path, joblib.Memory or None

    Returns
    -------
    ndarray of int, shape (n_landmarks,)
        Ascending.

    Raises
    ------
    ValueError
        If so few tracks leave no frame pair with as many as a model needs.
    """
    n_tracks = len(points)
    if n_landmarks == n_tracks:
        return np.arange(n_tracks)
    rng = np.random.RandomState(SEED)
    worthy = _hardly_isolated(points, visibility, n_landmarks, rng)
    points, visibility = points[worthy], visibility[worthy]
    seeds = view_seeds(rng, models)
    n_first = min(max(FIRST_LANDMARKS, n_landmarks), len(points))
    first = draw_covering(points, visibility, n_first, rng)
    views = {
        model.name: make_view(model, seeds[model.name], n_hypotheses=FIRST_HYPOTHESES)
        for model in models
    }
    with noting(
        f"looking at {n_first} tracks of {n_tracks}; n_landmarks says how many"
    ):
        fitted, affinities, _ = fit_views(
            views, points[first], visibility[first], n_jobs, memory
        )
    segments = _over_segments(affinities, rng)
    placed, _ = place_by_landmarks(fitted, points, visibility, first, segments, n_jobs)
    return worthy[draw_stratified(placed, n_landmarks, rng)]


def _hardly_isolated(points, visibility, n_landmarks, rng):
    """Positions, ascending, of tracks that go with neighbours, and of a few others."""
    isolated = isolation(points, visibility) > ISOLATED
    along, alone = np.flatnonzero(~isolated), np.flatnonzero(isolated)
    n_alone = max(int(SHARE_ISOLATED * n_landmarks), n_landmarks - len(along))
    return np.sort(np.concatenate([along, rng.permutation(alone)[:n_alone]]))


def _over_segments(affinities, rng):
    """Labels (n_levels, n) of groups of tracks that are alike, the largest first."""
    graph = ViewGraph.from_affinities(affinities, max(OVER_SEGMENTS))
    counts = (min(count, graph.n_leading) for count in OVER_SEGMENTS)
    return np.stack(
        [cluster_graph(graph, n, kernel_addition, RESTARTS, rng) for n in counts]
    )
