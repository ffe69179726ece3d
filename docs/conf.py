"""How the documentation is built: `sphinx-build -W docs build/docs`. Nothing of it is loaded from elsewhere."""

from __future__ import annotations

import sys
from pathlib import Path

import brdfcore

project = "brdf-tables"
author = "the authors of brdf-tables"
project_copyright = "the authors of brdf-tables; Apache-2.0"
version = release = brdfcore.__version__

sys.path.insert(0, str(Path(__file__).parent))
extensions = ["myst_parser", "sphinx.ext.autodoc", "docstrings"]
exclude_patterns = ["build"]
nitpicky = True
smartquotes = False  # quotes and dots in text are often a value
highlight_language = "text"

myst_heading_anchors = 3
autodoc_member_order = "bysource"
autodoc_typehints = "none"
python_maximum_signature_line_length = 76

html_theme = "furo"  # fonts of the system; nothing else of it is loaded from elsewhere either
html_title = "brdf-tables"
html_static_path = ["static"]
html_css_files = ["pages.css"]
html_show_sourcelink = False
html_copy_source = False
html_show_sphinx = False
