"""How the documentation is built: ``sphinx-build -W docs docs/_build``."""

from __future__ import annotations

import farpoint

project = "farpoint"
author = "The farpoint authors"
copyright = author
version = release = farpoint.__version__

extensions = [
    "myst_parser",
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

# A name between single backticks in a docstring links to what bears it.
default_role = "py:obj"
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the signature and numpydoc's sections say it already
numpydoc_show_class_members = False
