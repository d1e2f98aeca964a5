"""Settings of Sphinx: ``sphinx-build -W docs docs/_build`` makes the pages."""

from __future__ import annotations

import sys
from pathlib import Path

from docutils import nodes

import skmotionseg

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_ext"))

project = "skmotionseg"
author = "The skmotionseg developers"
copyright = f"2026, {author}"
version = release = skmotionseg.__version__

extensions = [
    "mathml",
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.intersphinx",
    "sphinx_copybutton",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = ["_build"]
templates_path = ["_templates"]
nitpicky = True
# scikit-learn's words about n_jobs, of which the inventory here has no part.
nitpick_ignore = [("py:obj", "joblib.parallel_backend"), ("std:term", "n_jobs")]

# ----------------------------------------------------------------------------- pages

html_theme = "furo"
html_title = f"skmotionseg {release}"
html_static_path = ["_static"]
html_css_files = ["skmotionseg.css"]
html_math_renderer = "mathml"
html_copy_source = False
html_show_sourcelink = False
myst_enable_extensions = ["amsmath", "colon_fence", "dollarmath"]
myst_heading_anchors = 3
math_eqref_format = "({number})"
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True

# ----------------------------------------------------------------------- the interface

autosummary_generate = True
autosummary_ignore_module_all = False
autodoc_typehints = "none"  # docstrings say more: shapes, units, ranges
autodoc_member_order = "bysource"
numpydoc_show_class_members = False

# The names of other projects that are linked, and where they are described: what there
# is of their inventories, so that no network is needed.
intersphinx_mapping = {
    "sklearn": ("https://scikit-learn.org/stable/", "inventories/sklearn.inv"),
}

# ----------------------------------------------------------------------------- gallery

sphinx_gallery_conf = {
    "examples_dirs": "../examples/gallery",
    "gallery_dirs": "gallery",
    "filename_pattern": r"plot_\w+\.py$",
    "within_subsection_order": "FileNameSortKey",
    "download_all_examples": False,
    "show_memory": False,
    "show_signature": False,
    "remove_config_comments": True,
    "min_reported_time": 1e6,
    "write_computation_times": False,
    "plot_gallery": "True",
    "parallel": 2,  # examples at a time
    "image_srcset": ["2x"],
}


def trim_code(app, doctree):
    """Drop the empty line that doctest needs at the end of a block in Markdown."""
    for block in doctree.findall(nodes.literal_block):
        block.rawsource = block.astext().rstrip("\n")
        block.children = [nodes.Text(block.rawsource)]


def setup(app):
    app.connect("doctree-read", trim_code)
