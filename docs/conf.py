"""How the documentation is built: ``sphinx-build -W docs docs/_build``."""

from __future__ import annotations

import sys
from pathlib import Path

import farpoint

sys.path.insert(0, str(Path(__file__).parent))  # measured_table

project = "farpoint"
author = "The farpoint authors"
copyright = author
version = release = farpoint.__version__

extensions = [
    "measured_table",
    "myst_nb",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "sphinx.ext.viewcode",
]
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = f"farpoint {release}"

myst_enable_extensions = ["amsmath", "dollarmath", "deflist"]
myst_heading_anchors = 3

# Notebooks are stored without outputs and executed by each build; an error in one ends it.
nb_execution_mode = "force"
nb_execution_timeout = 120
nb_execution_raise_on_error = True

# A name between single backticks in a docstring links to what bears it.
default_role = "py:obj"
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the signature and numpydoc's sections say it already
numpydoc_show_class_members = False
