"""Our fusions beside those of others, on the same affinities and in the same minute.

    pip install --no-deps mvlearn seaborn
    python -m benchmarks.peers --data DIR [--rows "*"] [--repeats 5] [--json FILE]

All cluster the affinities of three models into the true number of motions. Everything
runs with one BLAS thread, warm, in turns, with other hypotheses each repeat.
"""

from __future__ import annotations

import argparse
import importlib.util
from fnmatch import fnmatch
from pathlib import Path

import numpy as np
from sklearn.cluster import KMeans, SpectralClustering
from threadpoolctl import threadpool_limits

from skmotionseg import MultiModelSpectralClustering, make_motion_pipeline
from skmotionseg.datasets import load_kt3dmoseg
from skmotionseg.metrics import misclassification_error

from . import report
from .measuring import interleave, show_progress, spread
from .plain import N_SWEEPS, unit_rows
from .stages import FUSIONS

TEXTBOOK = Path(__file__).parents[1] / "tests" / "helpers" / "textbook.py"
LAM = GAMMA = 1e-2  # of all who have such weights
N_INIT = 20  # restarts of k-means, likewise

COLUMNS = {
    "method": lambda row: row["row"],
    "seconds": lambda row: row.get("problem") or report.seconds(row),
    "error %, median": report.number("median_error", "{:.2f}"),
    "mean": report.number("mean_error", "{:.2f}"),
    "times ours": report.number("ratio"),
    "ours being": lambda row: row.get("ours", ""),
}


# ------------------------------------------- methods: (views, count, seed) -> labels


def ours(fusion):
    def cluster(views, count, seed):
        clusterer = MultiModelSpectralClustering(
            count, fusion=fusion, lam=LAM, gamma=GAMMA, n_init=N_INIT, random_state=seed
        )
        return clusterer.fit_predict(np.hstack(views))

    return cluster


def sklearn_sum(views, count, seed):
    clusterer = SpectralClustering(
        count, affinity="precomputed", n_init=N_INIT, random_state=seed
    )
    return clusterer.fit_predict(sum(views))


def mvlearn_coreg():
    from mvlearn.cluster import MultiviewCoRegSpectralClustering

    class Precomputed(MultiviewCoRegSpectralClustering):
        def _affinity_mat(self, X):
            return X

    def cluster(views, count, seed):
        clusterer = Precomputed(count, v_lambda=LAM, n_init=N_INIT, random_state=seed)
        return clusterer.fit_predict(list(views))

    return cluster


def textbook(fusion):
    """The paper's equations in loops and full eigendecompositions."""
    spec = importlib.util.spec_from_file_location("textbook", TEXTBOOK)
    book = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(book)
    embed = {
        "kernel_addition": book.kernel_addition,
        "coreg": lambda *a: book.co_regularization(*a, LAM, N_SWEEPS),
        "subset": lambda *a: book.subset_constraint(*a, GAMMA, N_SWEEPS),
    }[fusion]

    def cluster(views, count, seed):
        features = unit_rows(np.hstack([unit_rows(U) for U in embed(views, count)]))
        kmeans = KMeans(count, n_init=N_INIT, random_state=seed)
        return kmeans.fit_predict(features)

    return cluster


# What each is, what makes it, and which of ours it is held against.
METHODS = {
    **{f"ours, {f}": (lambda f=f: ours(f), f) for f in FUSIONS},
    "scikit-learn SpectralClustering, sum": (lambda: sklearn_sum, "kernel_addition"),
    "mvlearn MultiviewCoRegSpectralClustering": (mvlearn_coreg, "coreg"),
    **{f"textbook, {f}": (lambda f=f: textbook(f), f) for f in FUSIONS},
}


def make_peers(clips, patterns, repeats):
    """A row per method whose name matches; all of ours are always there."""
    calls, rows = {}, []
    for name, (make, _) in METHODS.items():
        if name.startswith("ours") or any(fnmatch(name, p) for p in patterns):
            try:
                calls[name] = make()
            except ImportError as error:
                package = (error.name or "").partition(".")[0]
                problem = f"not installed: pip install --no-deps {package}"
                rows.append({"row": name, "problem": problem})
    seconds = np.empty((len(calls), len(clips), repeats))
    errors = np.empty_like(seconds)
    with threadpool_limits(1):
        for c, clip in enumerate(clips):
            show_progress(f"peers: {clip.name}, {c + 1} of {len(clips)}")
            runs = _on_clip(clip, calls, repeats, warm=c == 0)
            for i, each in enumerate(runs.values()):
                seconds[i, c] = each.seconds
                errors[i, c] = [
                    misclassification_error(clip.target, labels)
                    for labels in each.results
                ]
    show_progress("")
    position = {name: i for i, name in enumerate(calls)}
    for name, i in position.items():
        fusion = METHODS[name][1]
        ratios = seconds[i] / seconds[position[f"ours, {fusion}"]]
        rows.append(
            {
                "row": name,
                "seconds": spread(np.median(seconds[i], axis=0)),
                "median_error": 100 * float(np.median(errors[i])),
                "mean_error": 100 * float(errors[i].mean()),
                "ratio": float(np.median(ratios)),
                "ours": fusion,
            }
        )
    return sorted(rows, key=lambda row: [*METHODS].index(row["row"]))


def _on_clip(clip, calls, repeats, warm):
    """Time the methods on the clip; each repeat has hypotheses of its own."""
    affinities = [
        make_motion_pipeline(random_state=seed)[0].fit_transform(clip.data)
        for seed in range(repeats)
    ]
    views = [np.stack(np.hsplit(each.astype(float), 3)) for each in affinities]
    count = len(np.unique(clip.target[clip.target >= 0]))
    seeded = {
        name: lambda seed, cluster=cluster: cluster(views[seed], count, seed)
        for name, cluster in calls.items()
    }
    return interleave(seeded, repeats, warm=warm)


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--rows", nargs="+", default=["*"], help="patterns of methods")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    clips = load_kt3dmoseg(arguments.data / "KT3DMoSeg")
    rows = make_peers(clips, arguments.rows, arguments.repeats)
    report.show(rows, COLUMNS)
    report.save(arguments.json, "peers", rows)


if __name__ == "__main__":
    main()
