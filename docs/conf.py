"""How the documentation is built: ``make docs`` puts it into ``out/docs``, without a network; a warning is an error."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "experiments"))  # where `theory` is
sys.path.insert(0, str(Path(__file__).parent))  # where `generated.py` and `mathml.py` are

from gtmbench.version import __version__

project = "gtmbench"
author = "the gtmbench authors"
copyright = author  # noqa: A001
version = release = __version__

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "numpydoc",
    "myst_nb",
    "sphinx_design",
    "sphinx_copybutton",
    "sphinx_click",
    "generated",  # pages that are made of the code: every public name, the channels, the banks
    "mathml",  # formulas that any browser draws by itself
]
exclude_patterns = ["_templates", "how_to/examples", "**/.ipynb_checkpoints"]
templates_path = ["_templates"]
html_static_path = ["_static"]
html_css_files = ["site.css"]

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 120

default_role = "obj"  # `name` in a docstring is a link where there is such a name
autosummary_generate = True
autodoc_typehints = "none"  # numpydoc's sections say types where the signature doesn't
autodoc_member_order = "bysource"
numpydoc_show_class_members = False
numpydoc_xref_param_type = False

html_theme = "pydata_sphinx_theme"
html_title = f"gtmbench {version}"
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "show_toc_level": 2,
    "navbar_align": "left",
    "footer_start": ["copyright"],
    "footer_end": [],
    "pygments_light_style": "tango",
    "pygments_dark_style": "monokai",
}
html_sidebars = {"index": []}
copybutton_exclude = ".linenos, .gp, .go"
