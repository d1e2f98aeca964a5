"""What ``skmotionseg bench --paper`` runs: the protocol of the paper's own programs.

Xu, Cheong and Li (2021) choose the exponent of the epsilon-neighbourhood for each data
set and method on the sequences on which they test, from 5 to 15, and ``delta`` for each
data set. That is repeated here. Residuals and affinities are computed once for each
sequence and seed, and the exponents are swept on top of them.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.utils import check_random_state

from .._core.geometry.tracks import unpack_tracks
from .._core.graph.neighbourhood import neighbourhood_thresholds, sparsify
from .._segmenter.views import check_models, fit_views, make_view, view_seeds
from .._version import __version__
from ..kernels import ORKKernel
from ..metrics import misclassification_error
from ..model_selection import (
    EigengapModelSelector,
    NCREModelSelector,
    SelfTuningModelSelector,
)
from .runs import (
    PAPER_FUSIONS,
    PAPER_MODELS,
    code_digest,
    digest_of,
    run_in_parallel,
)

EXPONENTS = tuple(range(5, 16))
# The rules that it compares with were run on affinities that it does not describe.
RULE_EXPONENTS = tuple(range(1, 5))
MAX_MOTIONS = 10
N_HYPOTHESES = 500
# Their programs divide by the common frames and 0.1; ours by the common frame pairs, of
# which there is one less, and this.
COVISIBILITY_PRIOR = 1.1
DELTAS = {"Hopkins155": 0.1, "Hopkins12": 0.1, "MTPV62": 0.1, "KT3DMoSeg": 1.0}

SUBSETS = {"A+H": PAPER_MODELS[:2], "H+F": PAPER_MODELS[1:]}
# Models and fusion of each method, by its name.
METHODS: dict[str, tuple[tuple[str, ...], str]] = {
    **{model: ((model,), "kernel_addition") for model in PAPER_MODELS},
    **{fusion: (PAPER_MODELS, fusion) for fusion in PAPER_FUSIONS},
    **{
        f"{subset} {fusion}": (models, fusion)
        for subset, models in SUBSETS.items()
        for fusion in PAPER_FUSIONS
    },
}
RULES = ("eigengap", "relative eigengap", "self-tuning")


def run_paper(sequences, seeds, n_jobs, exponents=EXPONENTS, journal=None):
    """Yield the records of one sequence and seed after another, as they finish.

    Parameters
    ----------
    sequences : list of (str, Bunch)
        Dataset and sequence.
    seeds : int
    n_jobs : int or None
    exponents : sequence of int
    journal : Journal, optional
        Runs that are in it are not done again; others are added as each ends.

    Yields
    ------
    list of dict
        A record per method and exponent.

    Raises
    ------
    ValueError
        If the paper has no figures of a dataset.
    """
    for dataset, _ in sequences:
        if dataset not in DELTAS:
            raise ValueError(
                f"the paper's tables are of {', '.join(DELTAS)}; got {dataset}"
            )
    jobs = [
        (
            f"segmenting {sequence.name}",
            _describe(dataset, sequence, seed, exponents),
            (sequence, DELTAS[dataset], seed, exponents),
        )
        for seed in range(seeds)
        for dataset, sequence in sequences
    ]
    for run, records in run_in_parallel(jobs, measure_paper, n_jobs, journal):
        names = {name: run[name] for name in ("dataset", "sequence", "seed")}
        yield [{**names, **record} for record in records]


def _describe(dataset, sequence, seed, exponents):
    """What the result of a run depends on, as JSON can hold it."""
    return {
        "protocol": "paper",
        "dataset": dataset,
        "sequence": sequence.name,
        "seed": seed,
        "exponents": list(exponents),
        "tracks": digest_of(sequence),
        "version": __version__,
        "code": code_digest(),
    }


def measure_paper(sequence, delta, seed, exponents):
    """Errors of every method of the paper on one sequence.

    Parameters
    ----------
    sequence : Bunch
    delta : float
        Weight of the reconstruction error in NCRE.
    seed : int
    exponents : sequence of int

    Returns
    -------
    list of dict
        ``method``, ``exponent``, ``n_motions`` (the true number); ``error_known``; and
        ``found_from_1``, ``error_from_1``, ``found_from_2``, ``error_from_2``, with the
        number of motions unknown.
    """
    dense = dense_affinities(sequence.data, seed)
    records = []
    for exponent in sorted({*RULE_EXPONENTS, *exponents}):
        views = sparse_affinities(dense, exponent)
        if exponent in exponents:
            for name, (models, fusion) in METHODS.items():
                chosen = np.stack([views[model] for model in models])
                selector = NCREModelSelector(
                    fusion=fusion, lam=1e-2, gamma=1e-2, delta=delta
                )
                totals = _fit(selector, chosen, seed).costs_[:, 2]
                found = _record(sequence.target, selector, totals)
                records.append({"method": name, "exponent": exponent, **found})
        for name, found in _rules(views["homography"], sequence.target, seed):
            records.append({"method": name, "exponent": exponent, **found})
    return records


def dense_affinities(
    X: npt.ArrayLike, seed: int
) -> dict[str, npt.NDArray[np.floating]]:
    """Affinities by the name of the model, before any is dropped.

    Parameters
    ----------
    X : array-like of shape (n_tracks, 2 * n_frames)
    seed : int

    Returns
    -------
    dict of str to ndarray of shape (n_tracks, n_tracks)
    """
    models = check_models(PAPER_MODELS)
    seeds = view_seeds(check_random_state(seed), models)
    kernel = ORKKernel(sparsity=None, covisibility_prior=COVISIBILITY_PRIOR)
    views = {
        model.name: make_view(
            model, seeds[model.name], n_hypotheses=N_HYPOTHESES, kernel=kernel
        )
        for model in models
    }
    fitted, affinities, _ = fit_views(views, *unpack_tracks(X), n_jobs=1)
    return dict(zip(fitted, affinities, strict=True))


def sparse_affinities(dense, exponent):
    """Affinities after the epsilon-neighbourhood, as :class:`ORKKernel` gives them.

    Parameters
    ----------
    dense : dict of str to ndarray of shape (n, n)
    exponent : float

    Returns
    -------
    dict of str to ndarray of shape (n, n)
    """
    sparse = {}
    for name, affinity in dense.items():
        own = np.diagonal(affinity)
        thresholds = neighbourhood_thresholds(affinity, exponent, own)
        sparse[name] = sparsify(affinity, thresholds, thresholds)
    return sparse


def _fit(selector, views, seed):
    """A selector, fitted to views (n_views, n, n) for counts up to the largest."""
    selector.set_params(max_clusters=MAX_MOTIONS, random_state=seed)
    return selector.fit(np.hstack(list(views)))


def _record(y, selector, totals, fewest=1):
    """Errors of a fitted selector that takes the count of the least total."""
    counts, candidates = selector.counts_, selector.candidate_labels_
    errors = [misclassification_error(y, labels) for labels in candidates]
    n_motions = len(np.unique(y[y >= 0]))
    known = np.flatnonzero(counts == n_motions)
    record: dict[str, Any] = {
        "n_motions": n_motions,
        "error_known": errors[known[0]] if len(known) else None,
    }
    for start in (1, 2):
        tried = np.flatnonzero(counts >= max(start, fewest))
        if not len(tried):  # a single track has an affinity to another
            tried = np.arange(len(counts))
        best = tried[np.argmin(totals[tried])]
        record[f"found_from_{start}"] = int(counts[best])
        record[f"error_from_{start}"] = errors[best]
    return record


def _rules(affinity, y, seed) -> Iterator[tuple[str, dict[str, Any]]]:
    """Records of the rules by eigenvalues and eigenvectors, on one view."""
    eigengap = _fit(EigengapModelSelector(), [affinity], seed)
    value, following, difference = eigengap.costs_.T
    yield "eigengap", _record(y, eigengap, difference)
    # The first eigenvalue is 0 and has no ratio to the next.
    ratio = value / np.maximum(following, np.finfo(float).eps)
    yield "relative eigengap", _record(y, eigengap, ratio, fewest=2)
    tuned = _fit(SelfTuningModelSelector(), [affinity], seed)
    chosen = np.arange(len(tuned.counts_)) != tuned.best_index_
    yield "self-tuning", _record(y, tuned, chosen.astype(float), fewest=2)


# ---------------------------------------------------------------------------- summary

# What is chosen by its mean error: the number of motions known, and unknown.
CASES = ("known", "from_1", "from_2")


def summarize_paper(records):
    """For each dataset, method and case, the figures at the best exponent.

    Parameters
    ----------
    records : list of dict
        As of :func:`measure_paper`, with ``dataset``, ``sequence`` and ``seed``.

    Returns
    -------
    dict of (dataset, method) to dict
        ``n_sequences``, ``n_seeds``; and for "known", "from_1" and "from_2" a dict of
        ``exponent``, ``error`` and ``median`` (percent, means over the seeds), and
        ``correct`` (percent; 100 where the number is known).
    """
    groups: Any = defaultdict(lambda: defaultdict(list))
    for record in records:
        key = record["dataset"], record["method"]
        groups[key][record["exponent"]].append(record)
    return {key: _summarize_method(of_key) for key, of_key in groups.items()}


def _summarize_method(by_exponent):
    some = next(iter(by_exponent.values()))
    figures: dict[str, Any] = {
        "n_sequences": len({record["sequence"] for record in some}),
        "n_seeds": len({record["seed"] for record in some}),
    }
    for case in CASES:
        at_each = [_at_exponent(case, *item) for item in sorted(by_exponent.items())]
        figures[case] = min(at_each, key=lambda found: found["error"])
    return figures


def _at_exponent(case, exponent, records):
    """Error, its median over sequences, and share of right counts; percent."""
    errors: Any = defaultdict(list)
    for record in records:
        error = record[f"error_{case}"]
        errors[record["seed"]].append(1.0 if error is None else error)
    correct = [
        case == "known" or record[f"found_{case}"] == record["n_motions"]
        for record in records
    ]
    return {
        "exponent": exponent,
        "error": 100 * float(np.mean([np.mean(seed) for seed in errors.values()])),
        "median": 100 * float(np.mean([np.median(seed) for seed in errors.values()])),
        "correct": 100 * float(np.mean(correct)),
    }
