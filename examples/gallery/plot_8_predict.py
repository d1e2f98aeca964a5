"""
New tracks of the same video
============================

``predict`` labels tracks of the same video that were not passed to ``fit``, such as
dense tracks after sparse ones, or tracks that a tracker adds later. A new track gets
the label of the fitted tracks that prefer the same hypotheses.
"""

import matplotlib.pyplot as plt
import numpy as np

from skmotionseg import MotionSegmenter
from skmotionseg.datasets import make_rigid_motions
from skmotionseg.metrics import misclassification_error
from skmotionseg.plotting import plot_motions

X, y = make_rigid_motions(1500, 10, 3, random_state=1)
rng = np.random.default_rng(0)
fitted = np.zeros(len(X), dtype=bool)
fitted[rng.choice(len(X), 200, replace=False)] = True

segmenter = MotionSegmenter(random_state=0).fit(X[fitted])
placed = segmenter.predict(X[~fitted])
print(
    f"{fitted.sum()} fitted tracks, "
    f"{misclassification_error(y[fitted], segmenter.labels_):.1%} misclassified"
)
print(
    f"{len(placed)} new tracks, "
    f"{misclassification_error(y[~fitted], placed):.1%} misclassified"
)

# %%
# Both have the same labels for the same motions.

figure, axes = plt.subplots(2, 1, figsize=(7, 8), layout="constrained")
plot_motions(X[fitted], segmenter.labels_, ax=axes[0], title="fitted")
plot_motions(X[~fitted], placed, ax=axes[1], title="labelled by predict")
plt.show()
