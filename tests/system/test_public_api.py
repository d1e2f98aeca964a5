"""What is public is listed and documented; what is imported is what is needed."""

from __future__ import annotations

import ast
import inspect
import re
import subprocess
import sys
from dataclasses import is_dataclass
from graphlib import TopologicalSorter
from pathlib import Path

import pytest
from helpers.public_names import (
    CLASSES,
    ESTIMATORS,
    FUNCTIONS,
    METHODS,
    MODULES,
    NAMES,
)
from sklearn.base import BaseEstimator

import skmotionseg
from skmotionseg import (
    datasets,
    metrics,
    online,
    pipelines,
    plotting,
    preprocessing,
    video,
)

PACKAGE = Path(skmotionseg.__file__).parent
CORE_FILES = sorted((PACKAGE / "_core").rglob("*.py"))
# What each may import, beside itself.
CORE_FOLDERS = {
    "geometry": [],
    "graph": ["labels"],
    "partition": ["geometry", "graph", "labels"],
    "stream": ["geometry"],
}
LEAVES = ("metrics.py", "_version.py", "_utils/optional.py", "_utils/colours.py")
EXTRAS = ("matplotlib", "PIL", "rich", "pandas", "cv2", "dask", "skimage")


every_name = pytest.mark.parametrize("name", NAMES)


# ------------------------------------------------------------------------------ names


@pytest.mark.parametrize(
    "module", [skmotionseg, datasets, plotting], ids=lambda m: m.__name__
)
def test_all_is_exactly_what_is_public(module):
    public = {
        name
        for name, value in vars(module).items()
        if not name.startswith("_") and not inspect.ismodule(value)
    }
    assert set(module.__all__) == public
    assert list(module.__all__) == sorted(module.__all__)


# By module, what is public.
CONTRACT = {
    skmotionseg: {
        "EigengapModelSelector",
        "HypothesisSampler",
        "MotionModel",
        "MotionSegmenter",
        "MultiModelSpectralClustering",
        "NCREModelSelector",
        "ORKKernel",
        "OnlineMotionSegmenter",
        "PerSequence",
        "SegmentationReport",
        "SelfTuningModelSelector",
        "make_motion_pipeline",
        "pack_tracks",
        "save_motions",
        "static_mask",
        "unpack_tracks",
    },
    datasets: {
        "load_adelaide",
        "load_arrigoni",
        "load_bms26",
        "load_complex_background",
        "load_davis16",
        "load_fbms59",
        "load_hopkins12",
        "load_hopkins155",
        "load_kt3dmoseg",
        "load_mtpv62",
        "load_tracks",
        "make_rigid_motions",
        "make_scene",
        "scene_families",
    },
    metrics: {
        "FBMSObjects",
        "FBMSScores",
        "boundary_f_measure",
        "fbms_mean",
        "fbms_objects",
        "fbms_scores",
        "misclassification_error",
        "motion_count_accuracy",
        "region_similarity",
        "sequence_scorer",
    },
    online: {"Event", "OnlineMotionSegmenter"},
    pipelines: {"ModelUnion", "make_motion_pipeline"},
    plotting: {
        "AffinityDisplay",
        "CountDisplay",
        "FusionWeightDisplay",
        "GridDisplay",
        "MotionDisplay",
        "ReportDisplay",
        "SequenceErrorDisplay",
        "plot_motions",
    },
    preprocessing: {
        "select_balanced_tracks",
        "select_inliers",
        "select_long_tracks",
    },
    video: {
        "TrackedFrame",
        "VideoTracks",
        "follow_points",
        "dense_masks",
        "find_objects",
        "prompt_points",
        "render_segmentation",
        "track_video",
        "write_viewer",
    },
}


@pytest.mark.parametrize("module", CONTRACT, ids=lambda module: module.__name__)
def test_the_contract(module):
    assert set(module.__all__) == CONTRACT[module]


@pytest.mark.parametrize("module", MODULES.values(), ids=lambda m: m.__name__)
def test_each_public_module_lists_what_it_gives(module):
    assert list(module.__all__) == sorted(module.__all__)
    for name in module.__all__:
        assert vars(module)[name].__module__.startswith("skmotionseg")


# Written in public modules, for others of the package.
SHARED = {"AffinityInput", "CountSelector"}


@pytest.mark.parametrize("module", MODULES.values(), ids=lambda m: m.__name__)
def test_what_public_modules_write_is_listed_or_private(module):
    written = {
        name
        for name, value in vars(module).items()
        if inspect.isclass(value) or inspect.isfunction(value)
        if value.__module__ == module.__name__ and not name.startswith("_")
    }
    assert written - SHARED <= set(module.__all__)


def test_the_version_is_a_version():
    assert re.fullmatch(r"\d+\.\d+\.\d+(\.dev\d+)?", skmotionseg.__version__)


# ------------------------------------------------------------------------- docstrings


def sections(docstring):
    """Docstring sections by title, in numpydoc's layout."""
    parts = re.split(r"^(\w[\w ]*)\n-+$", inspect.cleandoc(docstring), flags=re.M)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def documented(text):
    """Names on the unindented lines of a section: ``a, b : type`` gives a and b."""
    lines = re.findall(r"^(\S[^:\n]*?)(?: ?:.*)?$", text, flags=re.M)
    return {name.strip().lstrip("*") for line in lines for name in line.split(",")}


def parameters(function):
    signature = inspect.signature(function)
    return {name for name in signature.parameters if name not in ("self", "cls")}


@every_name
def test_every_public_name_has_an_example(name):
    assert ">>> " in sections(NAMES[name].__doc__)["Examples"]


@every_name
def test_every_public_docstring_starts_with_a_line(name):
    first, *rest = inspect.cleandoc(NAMES[name].__doc__).split("\n")
    assert first.endswith(".")
    assert rest[0] == ""


@every_name
def test_every_public_docstring_names_its_parameters(name):
    names = documented(sections(NAMES[name].__doc__)["Parameters"])
    assert names == parameters(NAMES[name])


@pytest.mark.parametrize("name", METHODS)
def test_every_method_names_its_parameters(name):
    names = documented(sections(METHODS[name].__doc__).get("Parameters", ""))
    assert names == parameters(METHODS[name])


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_function_says_what_it_returns(name):
    assert "Returns" in sections(NAMES[name].__doc__)


@pytest.mark.parametrize("cls", ESTIMATORS)
def test_every_estimator_validates_all_its_parameters(cls):
    assert issubclass(cls, BaseEstimator)
    assert set(cls._parameter_constraints) == parameters(cls.__init__)


def is_record(cls):
    return is_dataclass(cls) or issubclass(cls, tuple)


@pytest.mark.parametrize("cls", [cls for cls in CLASSES if not is_record(cls)])
def test_every_class_documents_what_it_learns(cls):
    """Every attribute that the source sets in fitting or drawing, mixins' included."""
    source = "".join(inspect.getsource(c) for c in cls.__mro__ if is_ours(c))
    learned = set(re.findall(r"self\.([a-z]\w*_)\b(?!\()", source))
    if cls in ESTIMATORS and cls.__name__ != "PerSequence":
        learned.add("n_features_in_")
    assert learned == documented(sections(cls.__doc__)["Attributes"])


def is_ours(cls):
    return cls.__module__.startswith("skmotionseg")


# ---------------------------------------------------------------------------- imports


def python(code):
    command = [sys.executable, "-W", "error", "-c", code]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    return result.stdout.strip()


# Like an environment without them; ``sys.modules[name] = None`` upsets scikit-learn.
WITHOUT_EXTRAS = f"""
import sys

class Absent:
    def find_spec(name, path=None, target=None):
        if name.partition(".")[0] in {EXTRAS}:
            raise ModuleNotFoundError(name)

sys.meta_path.insert(0, Absent)
"""

SEGMENT = """
from skmotionseg import MotionSegmenter
from skmotionseg.datasets import make_rigid_motions
from skmotionseg.metrics import misclassification_error
X, y = make_rigid_motions(100, 8, 2, missing=0, random_state=0)
labels = MotionSegmenter(2, random_state=0).fit_predict(X)
print(misclassification_error(y, labels) < 0.05)
"""

PLOT = """
from skmotionseg.plotting import plot_motions
try:
    plot_motions([[0, 0, 1, 1]], [0])
except ImportError as error:
    print(error)
"""


def test_the_method_needs_no_extra_and_plotting_names_the_one_that_it_does():
    right, message = python(WITHOUT_EXTRAS + SEGMENT + PLOT).splitlines()
    assert right == "True"
    assert "this needs matplotlib, which is not installed" in message
    assert 'pip install "skmotionseg[plot]"' in message


def imports(path):
    """Modules that a file imports, anywhere in it: (level, dotted name)."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from ((0, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.level, node.module or ""


def rooms_imported(path):
    """Places of the package that a file imports, as dotted names from its top."""
    folder = path.relative_to(PACKAGE).parent.parts
    for level, name in imports(path):
        if level:
            above = folder[: len(folder) + 1 - level]
            yield ".".join([*above, *filter(None, name.split("."))])


def room_of(name):
    return name.partition(".")[0]


@pytest.mark.parametrize("path", CORE_FILES, ids=lambda path: path.stem)
def test_the_core_imports_numpy_scipy_and_itself(path):
    allowed = {"numpy", "scipy", *sys.stdlib_module_names}
    assert all(name.startswith("_core.") for name in rooms_imported(path))
    for level, name in imports(path):
        assert level or name.partition(".")[0] in allowed, name


def test_no_import_runs_back_up():
    """Top-level modules and folders can be put in an order that all imports obey."""
    below = {}
    for path in PACKAGE.rglob("*.py"):
        room = path.relative_to(PACKAGE).with_suffix("").parts[0]
        found = {room_of(name) for name in rooms_imported(path)}
        below.setdefault(room, set()).update(found - {room})
    list(TopologicalSorter(below).static_order())  # raises where there is a circle


@pytest.mark.parametrize("folder, below", CORE_FOLDERS.items())
def test_folders_of_the_core_import_those_below(folder, below):
    for path in (PACKAGE / "_core" / folder).glob("*.py"):
        for name in rooms_imported(path):
            assert name.split(".")[1] in (folder, *below), (path, name)


@pytest.mark.parametrize("file", LEAVES)
def test_leaves_import_nothing_of_the_package(file):
    assert not list(rooms_imported(PACKAGE / file))


def test_data_sets_import_nothing_but_the_core_and_utilities():
    for path in (PACKAGE / "datasets").glob("*.py"):
        rooms = set(map(room_of, rooms_imported(path)))
        assert rooms <= {"_core", "_utils", "datasets"}, path
