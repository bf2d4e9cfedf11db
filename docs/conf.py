"""The documentation site: `make docs` builds it into site/ and fails on each warning."""

project = "HELIOS"
author = copyright = "the HELIOS authors, Apache-2.0"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx_copybutton"]

html_theme = "furo"
html_title = "HELIOS"
html_theme_options = {"source_directory": "docs/"}
html_copy_source = False
html_show_sourcelink = False

myst_heading_anchors = 4
myst_enable_extensions = ["colon_fence"]

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_default_options = {"members": True, "undoc-members": True, "show-inheritance": False}
autodoc_class_signature = "separated"
exclude_patterns = ["images/README.md"]
