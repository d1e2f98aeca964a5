"""Pictures that ``skmotionseg segment`` draws: motions, report, masks, viewer."""

from __future__ import annotations

from itertools import islice

from .._core.geometry.tracks import unpack_tracks
from .console import pyplot, save_figure, timed_stage
from .mask_files import OF_THINGS, write_masks


def draw(arguments, sequence, segmenter, console):
    """Draw what is asked for.

    Parameters
    ----------
    arguments : argparse.Namespace
        Of ``skmotionseg segment``.
    sequence : Bunch
        Tracks as :func:`skmotionseg.datasets.load_tracks` gives them; of a video with
        its ``frames``. Gets the ``objects`` that are drawn, and the ``seconds`` that it
        all takes.
    segmenter : MotionSegmenter
        Fitted to them.
    console : rich.console.Console
        For how far it is.
    """
    drawn = [getattr(arguments, option) for option in (*OF_THINGS, "render")]
    if sequence.video and any(each is not None for each in drawn):
        _write_pictures(arguments, sequence, segmenter, console)
    elif arguments.render is not None:
        _draw_tracks(arguments, sequence, segmenter.labels_)
    if arguments.report is not None:
        _draw_report(arguments, sequence, segmenter)


def _draw_tracks(arguments, sequence, labels):
    from ..plotting import plot_motions

    plt = pyplot()
    figure, ax = plt.subplots(figsize=(8, 5), layout="constrained")
    plot_motions(sequence.data, labels, ax=ax)
    save_figure(figure, arguments.render)


def _draw_report(arguments, sequence, segmenter):
    from ..plotting import ReportDisplay

    pyplot()
    under = _frame_under(sequence) if sequence.video else {}
    display = ReportDisplay.from_estimator(segmenter, sequence.data, **under)
    save_figure(display.figure_, arguments.report)


def _frame_under(sequence):
    """The frame of a video that sees most tracks, and its number, for a report."""
    _, visibility = unpack_tracks(sequence.data)
    number = int(visibility.sum(axis=0).argmax())
    frame = next(islice(iter(sequence.frames), number, None))
    return {"frame": number, "image": frame[..., ::-1]}


def _write_pictures(arguments, sequence, segmenter, console):
    """Masks, prompts and pictures of a video, as far as they are asked for."""
    from ..video import find_objects, render_segmentation, write_viewer

    size = {side: sequence.video[side] for side in ("width", "height")}
    video = sequence.frames, sequence.data
    with timed_stage("objects", sequence, console) as progress:
        objects = sequence.objects = find_objects(
            sequence.data,
            segmenter.labels_,
            **size,
            source=sequence.frames,
            progress=progress,
        )
    masks = write_masks(arguments, sequence.frames, sequence, objects, console)
    if arguments.render is not None:
        with timed_stage("rendering", sequence, console) as progress:
            render_segmentation(
                *video, objects, arguments.render, masks=masks(), progress=progress
            )
    if arguments.viewer is not None:
        with timed_stage("viewer", sequence, console) as progress:
            write_viewer(
                *video,
                objects,
                arguments.viewer,
                masks=masks(),
                probabilities=getattr(segmenter, "probabilities_", None),
                progress=progress,
            )
