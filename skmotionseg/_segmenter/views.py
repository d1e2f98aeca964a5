"""Views: sampler and kernel of each motion model, fitted, and asked to place tracks."""

from __future__ import annotations

import time
from collections.abc import Iterable
from hashlib import blake2b

import numpy as np
from sklearn.base import clone
from sklearn.utils import gen_batches

from .._core.geometry.coverage import resemblance
from .._core.geometry.hypotheses import of_others
from .._core.geometry.motion_models import (
    MOTION_MODELS,
    MotionModel,
    get_motion_model,
)
from .._core.labels import nearest_votes_in_each
from .._parallel.engine import run_tasks
from .._parallel.tasks import Task
from .._utils.caching import as_memory, recall
from ..kernels import ORKKernel
from ..sampling import HypothesisSampler
from .memory import TRACKS_PER_BATCH

# Models that are combined unless others are asked for.
DEFAULT_MODELS = ("affine", "homography", "fundamental")
# Models whose seeds are drawn whether or not they take part, in this order. Both are
# written out: another built-in model changes no result unless it is asked for.
SEEDED_MODELS = ("affine", "homography", "fundamental")
# Frame pairs that tell whom a track moves with. Where the fitted ones are seen in twice
# as many or more, every second pair, or fewer, is looked at.
PAIRS_TO_PLACE = 12


def list_models(
    models: str | MotionModel | Iterable[str | MotionModel],
) -> list[str | MotionModel]:
    """Models as a list, of one or of several.

    Raises
    ------
    TypeError
        If they are something else.
    """
    if isinstance(models, str | MotionModel):
        return [models]
    if not isinstance(models, Iterable):
        raise TypeError(
            "models must be names of motion models or MotionModel objects; got "
            f"{models!r}"
        )
    return list(models)


def check_models(
    models: str | MotionModel | Iterable[str | MotionModel],
) -> list[MotionModel]:
    """The models, the simplest first, in whatever order they were given.

    Raises
    ------
    TypeError, ValueError
        If they are no models, there are none, or two of one name, or a name that is
        none.
    """
    given = list_models(models)
    if not given:
        raise ValueError("models must name at least one motion model; got none")
    found = [get_motion_model(model) for model in given]
    names = [model.name for model in found]
    if len(set(names)) < len(names):
        raise ValueError(f"models must differ; got {names}")
    return sorted(found, key=lambda model: model.minimal_size)


def view_seeds(random_state, models):
    """Seeds by name: of each model, and of "clustering".

    The seed of a model does not depend on which others there are: those of
    :data:`SEEDED_MODELS` are always all drawn, and those of all others follow from one
    more and their names.

    Parameters
    ----------
    random_state : numpy.random.RandomState
    models : list of MotionModel

    Returns
    -------
    dict of str to int
    """
    names = [*SEEDED_MODELS, "clustering"]
    most = np.iinfo(np.int32).max
    drawn = random_state.randint(most, size=len(names))
    seeds = dict(zip(names, map(int, drawn), strict=True))
    others = [model.name for model in models if model.name not in seeds]
    if others:
        drawn = random_state.randint(most)
        seeds |= {name: _seed_by_name(drawn, name) for name in others}
    return seeds


def _seed_by_name(seed, name):
    """A seed below 2**31, the same in every process."""
    digest = blake2b(f"{seed} {name}".encode(), digest_size=4).digest()
    return int.from_bytes(digest, "little") >> 1


def make_view(model, seed, *, n_hypotheses, frame_gap=1, kernel=None):
    """A sampler and a kernel of one motion model, not fitted.

    Parameters
    ----------
    model : MotionModel
        A built-in one is passed on by its name.
    seed : int
    n_hypotheses, frame_gap : int
    kernel : ORKKernel, optional
        A clone of it is taken.

    Returns
    -------
    (HypothesisSampler, ORKKernel)
    """
    known = MOTION_MODELS.get(model.name) is model
    sampler = HypothesisSampler(
        model.name if known else model,
        n_hypotheses=n_hypotheses,
        frame_gap=frame_gap,
        random_state=seed,
    )
    return sampler, ORKKernel() if kernel is None else clone(kernel)


def fit_views(
    views, points, visibility, n_jobs, memory=None, pairs=None, by_others=False
):
    """Fit the sampler and kernel of each model, from memory if they are there.

    Parameters
    ----------
    views : dict of str to (HypothesisSampler, ORKKernel)
        By the name of the model.
    points : ndarray of shape (n, n_frames, 2)
    visibility : ndarray of bool, shape (n, n_frames)
    n_jobs : int or None
    memory : str, path, joblib.Memory or None
    pairs : ndarray of int, shape (n_pairs, 2), optional
        Frame pairs, in place of those at the distance that the samplers have.
    by_others : bool, default=False
        Whether tracks prefer hypotheses among those that were fitted to others; the
        paper has them prefer any.

    Returns
    -------
    fitted : dict of str to (HypothesisSampler, ORKKernel)
    affinities : ndarray of shape (n_models, n, n), float64
    seconds : ndarray of shape (2,)
        For hypotheses and kernels, summed over the models.
    """
    memory, given = as_memory(memory), (points, visibility, pairs, by_others)
    results = run_tasks(
        (
            Task(
                f"fitting the {model} model",
                recall,
                memory,
                _fit_view,
                *view,
                *given,
            )
            for model, view in views.items()
        ),
        n_jobs=n_jobs,
        prefer="threads",
    )
    fitted = {
        model: (sampler, kernel)
        for model, (sampler, kernel, *_) in zip(views, results, strict=True)
    }
    affinities = np.stack([affinity for _, _, affinity, _ in results]).astype(float)
    return fitted, affinities, np.sum([seconds for *_, seconds in results], axis=0)


def _fit_view(sampler, kernel, points, visibility, pairs, by_others, version):
    """Fit one model's sampler and kernel; give them, the affinity and the seconds.

    The residuals go from one to the other a frame pair at a time: all of them would be
    the largest array by far. The version says of what code they are, where they are
    kept.
    """
    started = time.perf_counter()
    sampler.n_features_in_ = 2 * points.shape[1]
    sampler._fit(points, visibility, pairs)
    sampled = time.perf_counter()
    blocks = sampler._blocks(points, visibility)
    if by_others:
        pairs = sampler.frame_pairs_
        blocks = of_others(blocks, sampler.minimal_sets_, points, pairs)
    affinity = kernel._fit_blocks(len(points), blocks, sampler.n_hypotheses)
    done = time.perf_counter()
    return sampler, kernel, affinity, (sampled - started, done - sampled)


def place_by_landmarks(views, points, visibility, landmarks, labels, n_jobs):
    """Labels of the tracks that were not fitted, by a vote of those that were.

    The landmarks nearest in place and displacement vote: twenty times cheaper
    than affinities to them, and on tracks of real videos as good (on dense tracks of
    KT3DMoSeg, half a point of error worse). A track that no two
    consecutive frames see with a landmark is placed by affinities.

    Parameters
    ----------
    views : dict of str to (HypothesisSampler, ORKKernel)
        Fitted to the landmarks, by the name of the model.
    points : ndarray of shape (n_tracks, n_frames, 2)
    visibility : ndarray of bool, shape (n_tracks, n_frames)
    landmarks : ndarray of int, shape (n_landmarks,)
    labels : ndarray of int, shape (n_partitions, n_landmarks)
        Of the landmarks, in several ways.
    n_jobs : int or None

    Returns
    -------
    labels : ndarray of int, shape (n_partitions, n_tracks)
        Those of the landmarks are as given.
    shares : ndarray of shape (n_partitions, n_tracks)
        Of the votes that the labels have; 1 for landmarks.
    """
    n_tracks = len(points)
    everywhere = np.full((len(labels), n_tracks), -1)
    shares = np.ones(everywhere.shape)
    others = np.setdiff1d(np.arange(n_tracks), landmarks)
    alike = resemblance(points, visibility, landmarks, others)
    votes = [nearest_votes_in_each(batch, labels) for batch in alike]
    if votes:
        found, share = (
            np.concatenate(each, axis=1) for each in zip(*votes, strict=True)
        )
        everywhere[:, others], shares[:, others] = found, share
        alone = others[(everywhere[:, others] < 0).all(axis=0)]
        if len(alone):
            everywhere[:, alone], shares[:, alone] = place_tracks(
                views, points[alone], visibility[alone], labels, n_jobs
            )
    everywhere[:, landmarks] = labels
    return everywhere, shares


def place_tracks(views, points, visibility, labels, n_jobs):
    """Labels of tracks by a k-nearest-neighbour vote of the fitted ones.

    Parameters
    ----------
    views : dict of str to (HypothesisSampler, ORKKernel)
        Fitted, by the name of the model.
    points : ndarray of shape (m, n_frames, 2)
    visibility : ndarray of bool, shape (m, n_frames)
    labels : ndarray of int, shape (n_partitions, n_fitted)
        Of the fitted tracks, in several ways.
    n_jobs : int or None

    Returns
    -------
    labels : ndarray of int, shape (n_partitions, m)
    shares : ndarray of shape (n_partitions, m)
        Of the votes that the labels have.
    """
    placed = run_tasks(
        (
            Task(
                f"placing tracks {batch.start} to {batch.stop - 1}",
                _place_batch,
                list(views.values()),
                points[batch],
                visibility[batch],
                labels,
            )
            for batch in gen_batches(len(points), TRACKS_PER_BATCH)
        ),
        n_jobs=n_jobs,
        prefer="threads",
    )
    labels, shares = zip(*placed, strict=True)
    return np.concatenate(labels, axis=1), np.concatenate(shares, axis=1)


def _place_batch(views, points, visibility, labels):
    """Labels and their shares, (n_partitions, m) each, by the most alike tracks."""
    affinity = 0
    for sampler, kernel in views:
        pairs = kernel._spread_pairs(PAIRS_TO_PLACE)
        blocks = sampler._blocks(points, visibility, pairs)
        affinity += kernel._transform_blocks(len(points), blocks, pairs)
    return nearest_votes_in_each(affinity, labels)
