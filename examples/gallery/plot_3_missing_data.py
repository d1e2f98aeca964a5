"""
Tracks that come and go
=======================

Tracks may be missing in some frames, where their two columns are NaN.
:func:`~skmotionseg.pack_tracks` also takes a mask of the visible points. Here, up to
70 % of all entries are missing.
"""

import matplotlib.pyplot as plt
import numpy as np

from skmotionseg import MotionSegmenter
from skmotionseg.datasets import make_rigid_motions
from skmotionseg.metrics import misclassification_error

shares = [0, 0.2, 0.4, 0.6, 0.7]
errors = np.empty((len(shares), 2))
for i, missing in enumerate(shares):
    for seed in range(errors.shape[1]):
        X, y = make_rigid_motions(120, 12, 3, missing=missing, random_state=10 + seed)
        labels = MotionSegmenter(3, random_state=0).fit_predict(X)
        errors[i, seed] = misclassification_error(y, labels)

# %%
# Tracks are compared in the frame pairs in which both are seen. The fewer there are,
# the lower their affinity. The left panel shows which entries of the last scene are
# seen: tracks at its beginning and at its end are never seen together, and few others
# connect them. Then there is no evidence that they move alike, and the error in the
# right panel increases.

seen = np.isfinite(X[:, ::2])
order = np.lexsort((seen.argmax(axis=1), y))
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 4), layout="constrained")
left.imshow(seen[order], aspect="auto", cmap="Greys", interpolation="nearest")
left.set(
    xlabel="frame", ylabel="track", title=f"seen (black), {shares[-1]:.0%} missing"
)
right.plot(np.multiply(shares, 100), errors * 100, "o", color="0.7")
right.plot(np.multiply(shares, 100), errors.mean(axis=1) * 100, "-", color="black")
right.set(
    xlabel="missing entries (%)", ylabel="misclassified tracks (%)", ylim=(-1, 50)
)
right.set_title("two scenes each, and their mean")
plt.show()
