"""Which tracks are fitted where there are too many, so that no motion is too few."""

from __future__ import annotations

import numpy as np

from .._core.geometry.coverage import choose_landmarks, draw_evenly
from .._core.geometry.tracks import unpack_tracks
from .._core.graph.spectral import ViewGraph
from .._parallel.tasks import noting
from ..cluster import MultiModelSpectralClustering
from .views import fit_branches, make_branch, place_tracks

# A first look: so many tracks, cut by hypotheses this few into so many pieces.
FIRST_LANDMARKS = 600
FIRST_HYPOTHESES = 200
PIECES = 30


def landmarks_of(
    tracks, n_landmarks, models, seeds, *, batch_size="auto", n_jobs=None, memory=None
):
    """Positions of the tracks to fit: all, or a choice.

    A thing that covers a fiftieth of the image has a fiftieth of the tracks, and a cut
    through the background is then cheaper than one around it. So a first choice of
    tracks, which covers all places, displacements and frames, is cut into many pieces,
    all tracks are placed in these, and as many landmarks are drawn from each.

    Parameters
    ----------
    tracks : ndarray of shape (n_tracks, 2 * n_frames)
    n_landmarks : int
    models : list of str
    seeds : dict
        One for each model, and that of the choice, by name.
    batch_size : int or "auto"
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
    if n_landmarks == len(tracks):
        return np.arange(len(tracks))
    rng = np.random.RandomState(seeds["landmarks"])
    n_first = min(max(FIRST_LANDMARKS, n_landmarks), len(tracks))
    first = choose_landmarks(*unpack_tracks(tracks), n_first, rng)
    branches = {
        model: make_branch(model, seeds[model], n_hypotheses=FIRST_HYPOTHESES)
        for model in models
    }
    with noting(
        f"looking at {n_first} tracks of {len(tracks)}; n_landmarks says how many"
    ):
        fitted, affinities, _ = fit_branches(branches, tracks[first], n_jobs, memory)
    pieces = _pieces(affinities, rng)
    placed, _ = place_tracks(fitted, tracks, pieces[None], batch_size, n_jobs)
    return draw_evenly(placed[0], n_landmarks, rng)


def _pieces(affinities, rng):
    """Labels of many small groups of tracks that are alike."""
    graph = ViewGraph.from_affinities(affinities, PIECES)
    clusterer = MultiModelSpectralClustering(
        graph.n_leading, fusion="kernel_addition", n_init=5, random_state=rng
    )
    return clusterer.cluster_graph(graph)
