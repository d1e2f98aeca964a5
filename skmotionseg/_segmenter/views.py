"""A branch: sampler and kernel of one motion model, and what is done with them."""

from __future__ import annotations

import time
import zlib

import numpy as np

from .._core.geometry.motion_models import added_motion_models
from .._core.geometry.tracks import unpack_tracks
from .._core.labels import nearest_votes
from .._parallel.engine import run_tasks
from .._parallel.tasks import Task
from .._utils.validation import as_memory, get_motion_model
from ..kernels import ORKKernel
from ..sampling import HypothesisSampler
from .memory import batches

ALL_MODELS = ("affine", "homography", "fundamental")
# Frame pairs that tell whom a track moves with. Where the fitted ones are seen in twice
# as many or more, every second pair, or fewer, is looked at.
PAIRS_TO_PLACE = 12


def make_branch(
    model,
    seed,
    *,
    n_hypotheses,
    frame_gap=1,
    top=0.1,
    sparsity=6.0,
    covisibility_prior=2.0,
):
    """A sampler and a kernel that agree on the number of hypotheses."""
    sampler = HypothesisSampler(
        model, n_hypotheses=n_hypotheses, frame_gap=frame_gap, random_state=seed
    )
    kernel = ORKKernel(
        n_hypotheses=n_hypotheses,
        top=top,
        sparsity=sparsity,
        covisibility_prior=covisibility_prior,
    )
    return sampler, kernel


def check_models(models):
    """Names of the models, the simplest first, in whatever order they were given."""
    names = [models] if isinstance(models, str) else list(models)
    if not names:
        raise ValueError("models must name at least one motion model; got none")
    if len(set(names)) < len(names):
        raise ValueError(f"models must differ; got {names}")
    models = sorted(map(get_motion_model, names), key=lambda m: m.minimal_size)
    return [model.name for model in models]


def model_seeds(random_state):
    """One seed for each registered model and one for clustering, always all drawn."""
    names = [*ALL_MODELS, "clustering", "landmarks"]
    drawn = random_state.randint(np.iinfo(np.int32).max, size=len(names))
    seeds = dict(zip(names, map(int, drawn), strict=True))
    # Those of added models depend on nothing but their names, for other processes may
    # know other models, or know them in another order.
    for name in added_motion_models():
        if name not in seeds:
            entropy = [seeds["clustering"], zlib.crc32(name.encode())]
            seeds[name] = int(np.random.SeedSequence(entropy).generate_state(1)[0])
    return seeds


def fit_branches(branches, tracks, n_jobs, memory=None):
    """Fit the sampler and kernel of each model, from memory if they are there.

    Parameters
    ----------
    branches : dict of str to (HypothesisSampler, ORKKernel)
        By the name of the model.
    tracks : ndarray of shape (n, 2 * n_frames)
    n_jobs : int or None
    memory : str, path, joblib.Memory or None

    Returns
    -------
    fitted : dict of str to (HypothesisSampler, ORKKernel)
    affinities : ndarray of shape (n_models, n, n), float64
    seconds : ndarray of shape (2,)
        For hypotheses and kernels, summed over the models.
    """
    fit = as_memory(memory).cache(_fit_branch)
    results = run_tasks(
        (
            Task(f"fitting the {model} model", fit, *branch, tracks)
            for model, branch in branches.items()
        ),
        n_jobs=n_jobs,
        prefer="threads",
    )
    fitted = {
        model: (sampler, kernel)
        for model, (sampler, kernel, *_) in zip(branches, results, strict=True)
    }
    affinities = np.stack([affinity for _, _, affinity, _ in results]).astype(float)
    return fitted, affinities, np.sum([seconds for *_, seconds in results], axis=0)


def _fit_branch(sampler, kernel, tracks):
    """Fit one model's sampler and kernel; give them, the affinity and the seconds.

    The residuals go from one to the other a frame pair at a time: all of them would be
    the largest array by far.
    """
    started = time.perf_counter()
    sampler.fit(tracks)
    sampled = time.perf_counter()
    affinity = kernel._fit_blocks(len(tracks), sampler._blocks(*unpack_tracks(tracks)))
    done = time.perf_counter()
    return sampler, kernel, affinity, (sampled - started, done - sampled)


def place_tracks(branches, tracks, labels, batch_size, n_jobs):
    """Labels of tracks by the vote of the fitted ones that they have most affinity to.

    Parameters
    ----------
    branches : dict of str to (HypothesisSampler, ORKKernel)
        Fitted, by the name of the model.
    tracks : ndarray of shape (m, 2 * n_frames)
    labels : ndarray of int, shape (n_partitions, n_fitted)
        Of the fitted tracks, in several ways.
    batch_size : int or "auto"
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
                list(branches.values()),
                tracks[batch],
                labels,
            )
            for batch in batches(len(tracks), batch_size)
        ),
        n_jobs=n_jobs,
        prefer="threads",
    )
    labels, shares = zip(*placed, strict=True)
    return np.concatenate(labels, axis=1), np.concatenate(shares, axis=1)


def _place_batch(branches, tracks, labels):
    """Labels and their shares, (n_partitions, m) each, by the most alike tracks."""
    tracks = unpack_tracks(tracks)
    affinity = 0
    for sampler, kernel in branches:
        pairs = kernel._spread_pairs(PAIRS_TO_PLACE)
        blocks = sampler._blocks(*tracks, pairs)
        affinity += kernel._transform_blocks(len(tracks[0]), blocks, pairs)
    votes = [nearest_votes(affinity, partition) for partition in labels]
    return tuple(map(np.stack, zip(*votes, strict=True)))
