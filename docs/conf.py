"""Settings of the documentation site: `make docs` builds it into build/site.

Pages are the Markdown files of this folder. The reference is made of docstrings, of
the command line's parser and of the JSON Schema, by the modules of `_extensions`.
Nothing is fetched: the theme's fonts are the reader's own.
"""

import swarmstart
from swarmstart.docs._extensions import gallery

project = "swarmstart"
author = "The swarmstart developers"
copyright = "The swarmstart developers"
release = version = swarmstart.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_gallery.gen_gallery",
    "swarmstart.docs._extensions.accessible",
    "swarmstart.docs._extensions.docstrings",
    "swarmstart.docs._extensions.generated_pages",
]
exclude_patterns = ["README.md", "_extensions"]
gallery.dropped_if_old()
sphinx_gallery_conf = gallery.settings()
nitpicky = False
default_role = "literal"  # Docstrings mark code by single backticks.
toc_object_entries_show_parents = "hide"

myst_heading_anchors = 4
myst_enable_extensions = ["colon_fence", "deflist"]

autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_format = "short"
autodoc_typehints_description_target = "documented"
autodoc_preserve_defaults = True
python_maximum_signature_line_length = 80
napoleon_use_rtype = False
napoleon_custom_sections = ["Source", ("Attributes", "params_style")]

html_theme = "furo"
html_title = f"swarmstart {release}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_show_sphinx = False
