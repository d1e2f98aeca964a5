"""Digests of what is computed under many settings; ``python determinism.py FOLDER``.

Prints JSON: by setting, a digest. In FOLDER, pickled estimators are written, or read
and judged if they are there.
"""

from __future__ import annotations

import hashlib
import json
import pickle
import sys
from pathlib import Path
from unittest import mock

import numpy as np
from joblib import parallel_config

from skmotionseg import MotionSegmenter, PerSequence, make_motion_pipeline
from skmotionseg._segmenter import views
from skmotionseg.datasets import make_rigid_motions

ENGINES = ("threading", "loky", "multiprocessing")
# So few that they are still segmented by rigid motion over windows.
N_TRACKS, N_LANDMARKS = 40, 30
# The group that does all there is to do, placing tracks included. With n_jobs, all
# groups are on joblib's default engine, loky.
WITH_ENGINES = (f"description_length, n_landmarks={N_LANDMARKS}",)
OTHER_ENGINES = ("threading", "multiprocessing")
SMALL = {"n_hypotheses": 20, "random_state": 3}
RULES = {
    "description_length": {"max_motions": 3},
    "ncre": {"selection": "ncre", "fusion": "coreg", "max_motions": 3},
}


def digest(*arrays):
    """A name for arrays that differs if a bit of them does."""
    known = hashlib.sha256()
    for array in map(np.asarray, arrays):
        known.update(f"{array.dtype.str} {array.shape} ".encode())
        known.update(np.ascontiguousarray(array).tobytes())
    return known.hexdigest()[:16]


def judge(segmenter, X):
    return {
        "labels": digest(segmenter.labels_, segmenter.candidate_labels_),
        "costs": digest(segmenter.counts_, segmenter.costs_),
        "landmarks": digest(segmenter.landmarks_),
        "predicted": digest(segmenter.predict(X[::3])),
        "affinities": digest(
            *(
                kernel.transform(sampler.transform(X[:40]))
                for sampler, kernel in segmenter.views_.values()
            )
        ),
    }


def judge_pipeline(X, n_jobs):
    pipeline = make_motion_pipeline(n_clusters=3, **SMALL)
    pipeline.set_params(affinity__n_jobs=n_jobs)
    return {
        "affinities": digest(pipeline[0].fit_transform(X)),
        "labels": digest(pipeline.fit(X)[-1].labels_),
    }


def settings():
    """Names and parameters that must not matter."""
    for n_jobs, batch_size in ((2, 7), (-1, 30)):
        yield f"n_jobs={n_jobs}, batches of {batch_size}", n_jobs, batch_size


def judge_in_batches(X, n_jobs, batch_size, **params):
    with mock.patch.object(views, "TRACKS_PER_BATCH", batch_size):
        return judge(MotionSegmenter(n_jobs=n_jobs, **params).fit(X), X)


def judge_pickled(fitted, path, X):
    """What another process wrote, or else a copy of what is to be written."""
    if path.exists():
        return {"pickled": judge(pickle.loads(path.read_bytes()), X)}
    path.write_bytes(pickle.dumps(fitted))
    return {"copied": judge(pickle.loads(pickle.dumps(fitted)), X)}


def main(folder):
    X, _ = make_rigid_motions(N_TRACKS, 3, 2, outliers=0.05, random_state=0)
    found = {}
    again = any(folder.iterdir())  # other threads and hash seed: not all once more
    for rule, params in RULES.items():
        for landmarks in (None, N_LANDMARKS):
            common = {**SMALL, **params, "n_landmarks": landmarks}
            group = f"{rule}, n_landmarks={landmarks}"
            fitted = MotionSegmenter(n_jobs=1, **common).fit(X)
            found[group] = {"n_jobs=1, one batch": judge(fitted, X)}
            path = folder / f"{rule}-{landmarks}.pkl"
            for name, n_jobs, batch_size in list(settings())[again:]:
                found[group][name] = judge_in_batches(X, n_jobs, batch_size, **common)
            found[group] |= judge_pickled(fitted, path, X)
            for engine in OTHER_ENGINES if group in WITH_ENGINES and not again else ():
                with parallel_config(backend=engine, n_jobs=2):
                    found[group][engine] = judge_in_batches(X, None, 30, **common)
    n_jobs = (1,) if again else (1, 2, -1)
    found["pipeline"] = {str(n): judge_pipeline(X, n) for n in n_jobs}
    sequences = PerSequence(MotionSegmenter(**SMALL, selection="ncre", max_motions=3))
    found["sequences"] = {}
    for engine in ENGINES[:1] if again else ENGINES:
        with parallel_config(backend=engine, n_jobs=2):
            labels = sequences.fit([X[:25], X[15:]]).predict([X[:25], X[15:]])
        found["sequences"][engine] = {"labels": digest(*labels)}
    print(json.dumps(found))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
