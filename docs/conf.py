"""Configuration of the documentation site: `make docs` builds it into docs/_build/html.

The source folder is the root of the repository: links between documents are the same on the site and in a checkout.
"""

import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT), str(Path(__file__).parent)]

import lightwell  # noqa: E402

project = "lightwell"
author = "The lightwell authors"
copyright = "the lightwell authors, Apache-2.0"
release = version = lightwell.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "verb_help", "live_list", "accessible"]
myst_enable_extensions = ["deflist", "fieldlist"]
myst_heading_anchors = 4
include_patterns = ["docs/**.md", "format/*.md", "examples/**.md", "web/README.md", "benchmarks/README.md", "*.md"]
exclude_patterns = ["docs/_build", "docs/_live", "**/node_modules"]
root_doc = "docs/index"

# `make check-links` asks other sites.
linkcheck_ignore = [r"https?://(localhost|127\.0\.0\.1)"]
linkcheck_timeout = 20
linkcheck_retries = 2
linkcheck_anchors = False

# Warnings are errors (`-W`), links between pages and to headings included.
autodoc_typehints = "description"
autodoc_member_order = "bysource"
napoleon_google_docstring = True
napoleon_numpy_docstring = False

html_theme = "furo"
html_title = f"lightwell {release}"
html_static_path = ["_static"]
html_extra_path = ["_root", *(["_live"] if (ROOT / "docs/_live").is_dir() else [])]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False
# Pages of the site load nothing from elsewhere and count nobody.
html_theme_options = {"source_repository": "", "navigation_with_keys": True}
