"""The documentation site: `./setup.sh docs` builds it into build/docs. What is long lies in `_site`."""

import sys
from importlib.util import find_spec
from pathlib import Path
from shutil import copyfile, copytree
from typing import Any

import flexarm

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_site"))

import pages  # noqa: E402  (of _site)

project = "flexarm"
author = copyright = "the flexarm authors"
version = release = flexarm.__version__
extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
    "myst_nb",
    "sphinx_copybutton",
    "api",  # of _site
    "live",
    "pages",
]
exclude_patterns = ["_*", "figures"]
suppress_warnings = [
    "config.cache",  # functions among the settings; the site is built anew anyway
]

# --- Pages
myst_enable_extensions = ["amsmath", "dollarmath"]
myst_heading_anchors = 4
nb_execution_mode = "force"
nb_execution_in_temp = True
nb_execution_raise_on_error = True
nb_execution_timeout = 600  # s, of a notebook's cell: a busy machine may be slow
nb_merge_streams = True
numfig = True  # numbers equations by section, where the table of contents numbers pages: (3.2)
numfig_secnum_depth = 1
math_eqref_format = "({number})"

# --- Docstrings: Google's style; what stands in backticks is code
default_role = "code"
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_custom_sections = [("Attributes", "params_style")]
add_module_names = False
toc_object_entries_show_parents = "hide"
autodoc_default_options = {"members": True}
autodoc_member_order = "bysource"
autodoc_mock_imports = ["gymnasium", "jax", "torch"]  # so that the site needs none of them
autodoc_preserve_defaults = True
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented_params"
autodoc_type_aliases = {name: name for name in ("Array", "ArrayLike", "Loss", "Output")}  # NumPy's are long
smartquotes_action = "D"  # dashes alone: "z" is a string
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 88

# --- Looks
html_theme = "pydata_sphinx_theme"
html_title = "flexarm"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = html_show_sourcelink = False
templates_path = ["_templates"]
html_sidebars = {"**": ["contents.html"]}
html_theme_options: dict[str, Any] = {
    "logo": {"text": "flexarm"},
    "icon_links": [{"name": "GitHub", "url": pages.SOURCE, "icon": "fa-brands fa-github"}],
    "navbar_center": [],
    "navbar_end": ["theme-switcher", "navbar-icon-links"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "secondary_sidebar_items": ["page-toc"],
    "show_toc_level": 2,
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}

# --- Mathematics without a network: one script of MathJax, and its fonts
mathjax_path = "mathjax/tex-chtml-full.js"
mathjax3_config = {"tex": {"maxBuffer": 20480}, "options": {"enableMenu": False}}


def copy_mathjax(app: Any) -> None:
    spec = find_spec("sphinx-mathjax-offline")
    assert spec and spec.origin
    kept, place = Path(spec.origin).parent / "static", Path(app.outdir) / "_static"
    fonts = "mathjax/output/chtml/fonts/woff-v2"
    copytree(kept / fonts, place / fonts, dirs_exist_ok=True)
    copyfile(kept / mathjax_path, place / mathjax_path)


def setup(app: Any) -> None:
    app.connect("builder-inited", copy_mathjax)
