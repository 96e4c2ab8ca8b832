"""Configuration of the documentation; ``python -m sphinx -W docs docs/_build`` builds it."""

import importlib.util
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE)]

import mbdcasadi  # noqa: E402  (from the folder above)

project = "mbdcasadi"
author = "mbdcasadi contributors"
copyright = author
version = release = mbdcasadi.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx.ext.viewcode",
    "numpydoc",
    "gallery",
    "api_links",
]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
exclude_patterns = ["_build", "_pages"]
templates_path = ["_templates"]
nitpicky = False

myst_enable_extensions = ["dollarmath", "amsmath", "deflist", "colon_fence", "attrs_block", "attrs_inline"]
myst_heading_anchors = 3

# formulas are drawn by a copy of MathJax that is part of the site: nothing is fetched from elsewhere
mathjax_package = importlib.util.find_spec("sphinx-mathjax-offline")
if mathjax_package is None:
    raise RuntimeError("the documentation needs sphinx-mathjax-offline; pip install '.[docs]'")
MATHJAX = Path(mathjax_package.submodule_search_locations[0]) / "static" / "mathjax" / "tex-svg-full.js"
mathjax_path = MATHJAX.name
mathjax3_config = {
    "tex": {
        "macros": {
            "vec": [r"\boldsymbol{\mathbf{#1}}", 1],
            "mat": [r"\mathbf{#1}", 1],
            "T": r"^{\mathsf{T}}",
        }
    },
    "options": {"enableMenu": False},
}

autosummary_generate = True
autodoc_member_order = "bysource"
autodoc_typehints = "none"
autodoc_docstring_signature = False
numpydoc_show_class_members = False
numpydoc_attributes_as_param_list = True
numpydoc_xref_param_type = True
# terms of Python's glossary, which is on another site
numpydoc_xref_aliases = {"bool": "bool", "sequence": "collections.abc.Sequence", "iterable": "collections.abc.Iterable"}
numpydoc_xref_ignore = set("optional default of or and in if to from it the them expression".split())

html_theme = "furo"
html_title = "mbdcasadi"
html_static_path = ["_static", str(MATHJAX)]
# pages for the browser, which pictures.md and the examples write
html_extra_path = ["_pages"]
html_css_files = ["site.css"]
html_theme_options = {"navigation_with_keys": True}
html_copy_source = False
pygments_style = "friendly"


def skip_casadi(app, what, name, member, skip, options):
    """Leave out what inputs and parameters inherit from CasADi, whose own pages describe it."""
    function = getattr(member, "fget", member)
    return True if (getattr(function, "__module__", None) or "").startswith("casadi") else None


def remove_stale_stubs(app, config):
    """Delete generated pages of what the reference lists no longer; Sphinx would build them for ever."""
    reference = HERE / "reference"
    listed = {
        line.strip() for page in reference.glob("*.rst") for line in page.read_text(encoding="utf-8").splitlines()
    }
    for stub in (reference / "generated").glob("*.rst"):
        if not {stub.stem, stub.stem.removeprefix("mbdcasadi.")} & listed:
            stub.unlink()


def setup(app):
    """Connect the handlers of Sphinx events."""
    app.connect("config-inited", remove_stale_stubs)
    app.connect("autodoc-skip-member", skip_casadi)
