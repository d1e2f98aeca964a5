"""Hyper-parameters over a training set, and what they are worth on a test set.

The paper chooses one setting for all of FBMS-59 on its training sequences. Here that
is ``GridSearchCV`` over ``PerSequence``: each sample is a sequence, affinities are
computed once for each model and kept in a cache, and the result is a table and a map of
the errors. Progress is shown by scikit-learn's own callback where there is one (from
1.9, with rich), and otherwise a line a fit.

Run it on synthetic scenes, on the clips of KT3DMoSeg under ``DIR/KT3DMoSeg``, or, if it
is there, on FBMS-59 with MoSeg's tracks under ``DIR/FBMS59``, which has training and
test sequences and is scored by its F-measure::

    python examples/tune.py --out tuning
    python examples/tune.py --out tuning --data DIR --cache CACHE    # some minutes

With ``--cache``, a run that was interrupted goes on when it is started again: labels of
each sequence and setting are kept there, and affinities, which a run with other values
reads back, too.
"""

from __future__ import annotations

import argparse
import csv
import tempfile
from pathlib import Path

import joblib
import matplotlib.pyplot as plt
from sklearn.model_selection import GridSearchCV, KFold
from sklearn.utils import Bunch

from skmotionseg import MotionSegmenter, PerSequence
from skmotionseg.datasets import load_fbms59, load_kt3dmoseg, make_rigid_motions
from skmotionseg.metrics import fbms_mean, fbms_scores
from skmotionseg.plotting import GridDisplay

A, H, F = "affine", "homography", "fundamental"
GRID = {
    "estimator__models": [(A, H), (H, F), (A, H, F)],
    "estimator__delta": [0.1, 0.2, 0.3, 0.5, 1.0],
    "estimator__lam": [1e-3, 1e-2, 1e-1],
}
QUICK_GRID = {
    "estimator__models": [(A, H), (H, F)],
    "estimator__delta": [0.2, 1.0],
    "estimator__lam": [1e-2],
}


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--data", type=Path, metavar="DIR")
    parser.add_argument("--out", type=Path, default=Path("tuning"), metavar="DIR")
    parser.add_argument("--cache", type=Path, metavar="DIR", help="to go on from")
    parser.add_argument("--jobs", type=int, help="settings and folds at a time")
    parser.add_argument("--quick", action="store_true", help="fewer of everything")
    arguments = parser.parse_args(argv)
    arguments.out.mkdir(parents=True, exist_ok=True)
    train, test, scoring = read_sequences(arguments)
    with tempfile.TemporaryDirectory() as folder:
        memory = joblib.Memory(arguments.cache or folder, verbose=0)
        search = make_search(memory, scoring, len(train), arguments)
        print(f"{len(train)} sequences to choose on, {len(test)} to judge on")
        search.fit(*tracks_and_labels(train))
        print_table(search)
        chosen = ", ".join(
            f"{short(name)} {text(value)}"
            for name, value in search.best_params_.items()
        )
        print(f"\nbest: {chosen}; error {1 - search.best_score_:.1%}")
        if test:
            error = 1 - search.score(*tracks_and_labels(test))
            print(f"on the test sequences: error {error:.1%}")
    write_table(search, arguments.out / "settings.csv")
    draw_map(search, arguments.out / "errors.png")


def read_sequences(arguments):
    """Bunches to choose on and to judge on, and the scoring of GridSearchCV."""
    folder = arguments.data
    if folder is not None and (folder / "FBMS59").is_dir():
        clips = load_fbms59(folder / "FBMS59")
        train = [clip for clip in clips if clip.set == "Trainingset"]
        test = [clip for clip in clips if clip.set == "Testset"]
        return train, test, f_measure_of(clips)
    if folder is not None:
        clips = load_kt3dmoseg(folder / "KT3DMoSeg")
    else:
        clips = [
            make_scene(n_motions=2 + seed % 3, random_state=seed)
            for seed in range(6 if arguments.quick else 12)
        ]
    n_train = -(-2 * len(clips) // 3)
    return clips[:n_train], clips[n_train:], None  # None: what PerSequence scores


def make_scene(**parameters):
    """Hard enough to tell settings apart: few frames, noise, many entries unseen."""
    X, y = make_rigid_motions(
        140, 8, missing=0.4, noise=1.0, outliers=0.1, **parameters
    )
    return Bunch(data=X, target=y)


def tracks_and_labels(sequences):
    return [s.data for s in sequences], [s.target for s in sequences]


def f_measure_of(sequences):
    """A scorer by regions, which are not in tracks or labels: looked up by the tracks.

    By their content, because they are copies in other processes.
    """
    by_tracks = {joblib.hash(sequence.data): sequence for sequence in sequences}

    def score(estimator, X, y):
        scores = []
        for tracks, labels in zip(X, estimator.predict(X), strict=True):
            sequence = by_tracks[joblib.hash(tracks)]
            scores.append(
                fbms_scores(
                    sequence.point_target,
                    labels[sequence.point_track],
                    sample_weight=sequence.point_weight,
                    region_sizes=sequence.region_sizes,
                )
            )
        return fbms_mean(scores).f_measure

    return score


def make_search(memory, scoring, n_train, arguments):
    """An unfitted search that shows how far it is."""
    segmenter = MotionSegmenter(
        selection="ncre",
        fusion="coreg",
        n_hypotheses=200 if arguments.quick else 500,
        max_motions=6,
        memory=memory,
        random_state=0,
    )
    # Nothing is learnt from one sequence for another, so few folds will do: each has
    # its sequences segmented with each setting, once.
    search = GridSearchCV(
        PerSequence(segmenter, memory=memory),
        QUICK_GRID if arguments.quick else GRID,
        cv=KFold(min(4, n_train)),
        scoring=scoring,
        n_jobs=arguments.jobs,
    )
    try:
        from sklearn.callback import ProgressBar

        return search.set_callbacks(ProgressBar(max_propagation_depth=0))
    except ImportError:  # scikit-learn before 1.9, or no rich
        return search.set_params(verbose=2)


# ---------------------------------------------------------------------------- results


def rows_of(search):
    """A dict a setting, the best first: its values, mean error and time."""
    results = search.cv_results_
    order = results["rank_test_score"].argsort(kind="stable")
    return [
        {
            **{short(k): text(v) for k, v in results["params"][i].items()},
            "error (%)": f"{100 * (1 - results['mean_test_score'][i]):.2f}",
            "std over folds": f"{100 * results['std_test_score'][i]:.2f}",
            "seconds per fold": f"{results['mean_score_time'][i]:.2f}",
        }
        for i in order
    ]


def print_table(search, n_rows=10):
    rows = rows_of(search)
    print("\n" + "  ".join(f"{name:>14}" for name in rows[0]))
    for row in rows[:n_rows]:
        print("  ".join(f"{value:>14}" for value in row.values()))
    if len(rows) > n_rows:
        print(f"and {len(rows) - n_rows} more in settings.csv")


def write_table(search, path):
    """All settings; ``pandas.read_csv`` takes it."""
    rows = rows_of(search)
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, list(rows[0]))
        table.writeheader()
        table.writerows(rows)
    print(f"wrote {path}")


def draw_map(search, path):
    """Models against delta, lambda being that of the best setting."""
    display = GridDisplay.from_estimator(
        search, x="estimator__delta", y="estimator__models"
    )
    lam = search.best_params_["estimator__lam"]
    display.ax_.set_title(f"training error, $\\lambda$ = {lam:g}")
    display.figure_.savefig(path, dpi=120)
    plt.close(display.figure_)
    print(f"wrote {path}")


def short(name):
    return name.rpartition("__")[2]


def text(value):
    """Models by their initials, numbers in few digits."""
    if isinstance(value, tuple):
        return "+".join(name[0].upper() for name in value)
    return f"{value:g}"


if __name__ == "__main__":
    main()
