"""Settings of the documentation site: `make docs` builds it into build/site.

Pages are the Markdown files of this folder, and the reference is made of docstrings.
Nothing is fetched: the theme's fonts are the reader's own.
"""

import swarmstart

project = "swarmstart"
author = "The swarmstart developers"
copyright = "The swarmstart developers"
release = version = swarmstart.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["README.md"]
myst_heading_anchors = 4
myst_enable_extensions = ["colon_fence", "deflist"]
nitpicky = False
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_preserve_defaults = True
napoleon_use_ivar = True

html_theme = "furo"
html_title = f"swarmstart {release}"
html_copy_source = False
html_show_sphinx = False
