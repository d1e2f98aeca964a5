"""
One setting for many sequences
==============================

Segmentation is unsupervised within a sequence, but its parameters can be tuned on a set
of sequences with known labels: with :class:`~skmotionseg.PerSequence`, the samples of
:class:`~sklearn.model_selection.GridSearchCV` are whole sequences.
"""

import matplotlib.pyplot as plt
import numpy as np
from sklearn.model_selection import GridSearchCV, KFold

from skmotionseg import MotionSegmenter, ORKKernel, PerSequence
from skmotionseg.datasets import make_rigid_motions

scenes = [
    make_rigid_motions(120, 6, 4, noise=2.5, random_state=seed) for seed in range(6)
]
sequences, labels = [X for X, y in scenes], [y for X, y in scenes]

# %%
# The number of motions is known here; the search is over the sparsity of the affinities
# and the fusion of the models.

segmenter = MotionSegmenter(
    4, n_hypotheses=200, kernel=ORKKernel(), selection="ncre", random_state=0
)
search = GridSearchCV(
    PerSequence(segmenter),
    {
        "estimator__kernel__sparsity": [2, 4, 6, 8, 12, 20],
        "estimator__fusion": ["kernel_addition", "coreg"],
    },
    cv=KFold(3),
).fit(sequences, labels)
print(f"best: {search.best_params_}, error {1 - search.best_score_:.1%}")

# %%
# The score is one minus the mean misclassification error. Error bars are standard
# deviations over the folds.

figure, ax = plt.subplots(figsize=(7, 4), layout="constrained")
results = search.cv_results_
for fusion, style, shift in (("kernel_addition", "o-", 0), ("coreg", "s--", 0.15)):
    rows = np.flatnonzero(results["param_estimator__fusion"] == fusion)
    ax.errorbar(
        results["param_estimator__kernel__sparsity"][rows].astype(float) + shift,
        100 * (1 - results["mean_test_score"][rows]),
        100 * results["std_test_score"][rows],
        fmt=style,
        capsize=3,
        label=fusion,
    )
ax.set(
    xlabel="sparsity", ylabel="misclassified tracks (%)", xticks=[2, 4, 6, 8, 12, 20]
)
figure.legend(title="fusion", frameon=False, loc="outside right upper")
plt.show()
