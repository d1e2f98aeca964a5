"""
Static points for SLAM, frame by frame
======================================

Odometry, SLAM and structure from motion want points that stand still.
:class:`~skmotionseg.OnlineMotionSegmenter` says which these are while the camera films:
the static scene is motion 0. Here a car drives through a made-up street, where most
points are on others that drive, too, and the true poses of its camera are known.
"""

import cv2
import matplotlib.pyplot as plt
import numpy as np

from skmotionseg import OnlineMotionSegmenter, unpack_tracks
from skmotionseg.datasets import make_scene

street = make_scene(
    "street",
    n_tracks=420,
    n_frames=44,
    n_motions=4,
    background=0.42,
    outliers=0.05,
    late=0.9,
    life=60,
    random_state=5,
)
points, seen = unpack_tracks(street.data)
n_frames = seen.shape[1]

# %%
# The loop is what a robot would have: points of a tracker in, static points out.

segmenter = OnlineMotionSegmenter(random_state=0)
static = np.zeros_like(seen)
for frame in range(n_frames):
    ids = np.flatnonzero(seen[:, frame])
    labels = segmenter.update(points[ids, frame], ids)
    for event in segmenter.events_:
        print(event)
    static[ids[labels == 0], frame] = True
    # Here they would go to the SLAM system: slam.add(ids[labels == 0], ...)

# %%
# Two-view pose from the points of six frames ago and now: of all points, and of those
# that the loop has kept. Both by OpenCV, with RANSAC, which by itself leaves out what
# moves as long as the static points are the most. Here they are not.

GAP, FIRST = 6, 16
camera = np.array(
    [
        [street.focal, 0, street.image_size[0] / 2],
        [0, street.focal, street.image_size[1] / 2],
        [0, 0, 1],
    ]
)


def true_pose(first, second):
    """Rotation and direction of translation from one camera to another."""
    R, t = (
        poses[street.background] for poses in (street.rotations, street.translations)
    )
    rotation = R[second] @ R[first].T
    translation = t[second] - rotation @ t[first]
    return rotation, translation / np.linalg.norm(translation)


def pose_error(kept, first, second):
    """Degrees by which the direction of translation is wrong, and the rotation.

    NaN where the points are too few for a pose.
    """
    x, y = points[kept, first], points[kept, second]
    if len(x) < 5:
        return np.full(2, np.nan)
    cv2.setRNGSeed(0)
    essential, mask = cv2.findEssentialMat(
        x, y, camera, method=cv2.RANSAC, threshold=0.5
    )
    if essential is None:
        return np.full(2, np.nan)
    _, R, t, _ = cv2.recoverPose(essential[:3], x, y, camera, mask=mask)
    rotation, translation = true_pose(first, second)
    turn = np.arccos(np.clip((np.trace(R @ rotation.T) - 1) / 2, -1, 1))
    slant = np.arccos(np.clip(t[:, 0] @ translation, -1, 1))
    return np.degrees([slant, turn])


frames = np.arange(FIRST, n_frames)
errors = {"all points": [], "static points": []}
for frame in frames:
    both = seen[:, frame] & seen[:, frame - GAP]
    errors["all points"].append(pose_error(both, frame - GAP, frame))
    errors["static points"].append(
        pose_error(both & static[:, frame], frame - GAP, frame)
    )
means = {name: np.nanmean(values, axis=0) for name, values in errors.items()}
for name, values in errors.items():
    slant, turn = means[name]
    missing = np.isnan(values).any(axis=1).sum()
    print(
        f"{name:14s} {slant:5.2f} degrees of translation, {turn:.3f} of rotation, "
        f"{missing} of {len(frames)} frames without a pose"
    )
assert (means["static points"] < means["all points"] / 2).all()

# %%

figure, (view, curve) = plt.subplots(2, figsize=(8, 6.5), layout="constrained")
shown = seen[:, -1]
for name, rows, colour in (
    ("left out", shown & ~static[:, -1], "tab:red"),
    ("static scene", shown & static[:, -1], "tab:blue"),
):
    view.plot(*points[rows, -1].T, ".", color=colour, label=name)
view.set(xlim=(0, street.image_size[0]), ylim=(street.image_size[1], 0), aspect=1)
view.set_title("points of the last frame")
view.legend()
for name, colour in (("all points", "tab:red"), ("static points", "tab:blue")):
    curve.plot(frames, np.array(errors[name])[:, 0], color=colour, label=name)
curve.set(xlabel="frame", ylabel="degrees", yscale="log")
curve.set_title("error of the direction of translation, over six frames")
curve.legend()
plt.show()
