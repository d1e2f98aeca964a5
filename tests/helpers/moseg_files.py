"""Files of the Freiburg benchmarks, as their program reads them."""

from __future__ import annotations

import numpy as np

from skmotionseg import unpack_tracks


def track_text(n_frames, tracks, *, one_line=False):
    """Text of a Tracks10.dat. ``tracks``: (label, [(x, y, frame), ...]) of each."""
    gap = " " if one_line else "\n"
    lines = [f"{n_frames}\n{len(tracks)}"]
    for label, points in tracks:
        lines.append(f"{label}{gap}{len(points)}")
        lines += [f"{x} {y} {frame}" for x, y, frame in points]
    return "\n".join(lines) + "\n"


def write_tracks(path, X, labels):
    """A Tracks10.dat of tracks that are seen in one run of frames."""
    points, seen = unpack_tracks(X)
    tracks = [
        (label, [(*points[row, frame], frame) for frame in np.flatnonzero(seen[row])])
        for row, label in enumerate(labels)
    ]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(track_text(seen.shape[1], tracks))


def definition_text(scales, n_frames, masks):
    """Text of a NAMEDef.dat. ``masks``: (frame, file name) of each."""
    lines = ["Ground truth definition file; do not change!", ""]
    lines += ["Total number of regions:", len(scales)]
    for region, scale in enumerate(scales):
        lines += [f"Scale of region {region}:", scale]
    lines += ["", "Confusion penality matrix:"]
    lines += [" ".join("01"[i != j] for i in range(len(scales)))
              for j in range(len(scales))]  # fmt: skip
    lines += ["", "Total number of frames in this shot:", n_frames]
    lines += ["Total number of labeled frames for this shot:", len(masks)]
    for frame, name in masks:
        lines += ["Frame number:", frame, "File name:", name]
        lines += ["Input file name:", f"frame_{frame:04}.ppm"]
    return "\n".join(map(str, lines)) + "\n"


def write_definition(folder, scales, n_frames, masks):
    """``folder/GroundTruth/NAMEDef.dat`` and its masks: {frame: (file name, image)}."""
    truth = folder / "GroundTruth"
    truth.mkdir(parents=True, exist_ok=True)
    names = [(frame, name) for frame, (name, _) in masks.items()]
    text = definition_text(scales, n_frames, names)
    (truth / f"{folder.name}Def.dat").write_text(text)
    for name, image in masks.values():
        write_image(truth / name, image)


def write_image(path, image):
    """A binary portable map: grey (h, w) in a .pgm, colours (h, w, 3) in a .ppm."""
    image = np.asarray(image, dtype=np.uint8)
    kind = "P6" if image.ndim == 3 else "P5"
    header = f"{kind}\n{image.shape[1]} {image.shape[0]}\n255\n"
    path.write_bytes(header.encode() + image.tobytes())
