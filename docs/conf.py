"""The documentation site: `make docs` builds it into site/ and fails on each warning."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))  # for the scripts

project = "HELIOS"
author = copyright = "the HELIOS authors, Apache-2.0"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx_copybutton", "scripts.site_reference"]

html_theme = "furo"
html_title = "HELIOS"
html_theme_options = {"source_directory": "docs/"}
html_copy_source = False
html_show_sourcelink = False
html_static_path = ["_static"]
html_css_files = ["tables.css"]

myst_heading_anchors = 4
myst_enable_extensions = ["colon_fence"]

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_default_options = {"members": True, "undoc-members": True, "show-inheritance": False}
autodoc_class_signature = "separated"
