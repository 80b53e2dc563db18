"""The site: `sphinx-build -W docs FOLDER`. Pages in `docs/generated` are made from the code."""

import importlib.metadata
import os
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]
os.environ.setdefault("JAX_PLATFORMS", "cpu")

import kneejax  # noqa: E402

kneejax.configure()

import jax  # noqa: E402
import site_pages  # noqa: E402
from sphinx.domains.python import PyObject  # noqa: E402

# Types say `jax.Array`, and not where jaxlib keeps it; fields are attributes.
jax.Array.__qualname__ = "Array"
for field in PyObject.doc_field_types:
    field.label = "Attributes" if field.name == "variable" else field.label

# Executed notebooks, where `notebooks/execute.py --out FOLDER` has written them.
notebooks = Path(os.environ.get("KNEEJAX_NOTEBOOKS", HERE.parent / "notebooks"))
site_pages.write_all(HERE / "generated", notebooks)

project = "kneejax"
author = "The kneejax contributors"
copyright = author
release = version = importlib.metadata.version("kneejax")
extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
]
exclude_patterns = ["_build", "figures/*.md"]
# Notebooks are executed once, by notebooks/execute.py; the site shows what came out.
nb_execution_mode = "off"
nb_ipywidgets_js = {}
myst_enable_extensions = ["colon_fence", "deflist", "attrs_inline"]
myst_heading_anchors = 4
# Signatures in docstrings are words and formulas in single backticks.
default_role = "code"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_inherit_docstrings = False
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True
toc_object_entries_show_parents = "hide"
suppress_warnings = ["mystnb.unknown_mime_type", "config.cache", "ref.python"]
# `sphinx-build -b linkcheck docs OUT` needs a network; publishers redirect a DOI.
linkcheck_timeout = 20
linkcheck_retries = 2
linkcheck_allowed_redirects = {r"https://doi\.org/.*": r"https://.*"}
linkcheck_report_timeouts_as_broken = False

html_theme = "pydata_sphinx_theme"
html_title = "kneejax"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
# Pages without others below them have nothing to list at their side.
html_sidebars = dict.fromkeys(("index", "getting_started", "gallery"), [])
html_theme_options = {
    "show_nav_level": 1,
    "navigation_depth": 2,
    "header_links_before_dropdown": 6,
    "show_prev_next": False,
    "secondary_sidebar_items": ["page-toc"],
    "navbar_align": "left",
    "footer_start": ["copyright"],
    "footer_end": [],
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}
copybutton_exclude = ".linenos, .gp, .go"


def setup(app):
    """Docstrings are plain text with backticks: what RST would read as markup is escaped."""
    app.connect("autodoc-process-docstring", site_pages.plain_docstring)
    app.connect("autodoc-process-signature", site_pages.plain_signature)
    app.connect("autodoc-skip-member", site_pages.skip_member)
