"""The documentation site: `make docs`.

Pages are Markdown. Those with code cells are executed when the site is built; a cell that fails, fails the build, and
so does every warning. Nothing is fetched: formulas become MathML, fonts are the reader's, and no script is from
elsewhere.
"""

from __future__ import annotations

import os
import sys
from importlib.metadata import version as version_of
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parent
sys.path[:0] = [str(HERE / "site"), str(ROOT)]

# Of the cells' processes: the command `maxjax` and this checkout, and no colours from progress lines.
os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
os.environ["NO_COLOR"] = "1"
# XLA's older code generator compiles in two thirds of the time, which is most of what the cells take.
if version_of("jaxlib").startswith("0.10."):
    os.environ.setdefault("XLA_FLAGS", "--xla_cpu_use_fusion_emitters=false --xla_cpu_parallel_codegen_split_count=1")

project = "maxjax"
copyright = "The maxjax authors"
author = "The maxjax authors"
release = version_of("maxjax")

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "myst_nb",
    "sphinx_design",
    "sphinx_copybutton",
    "docstrings",
    "included",
    "literals",
    "mathml",
]
exclude_patterns = ["site", "static", "samples"]
html_theme = "furo"
html_title = "maxjax"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_math_renderer = "mathml"
html_copy_source = False
html_show_sphinx = False
html_theme_options = {"navigation_with_keys": True}
pygments_dark_style = "github-dark"

# Pages.
myst_enable_extensions = ["amsmath", "attrs_block", "attrs_inline", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 4
myst_links_external_new_tab = False
suppress_warnings = ["myst.header"]  # README's sections begin at their own depth


default_role = "code"  # backticks of docstrings

# Cells: executed once, and again when they or what is named here change.
nb_execution_mode = "cache"
nb_execution_cache_path = str(ROOT / "build" / "notebooks")
nb_execution_timeout = 900  # machines may be busy
nb_execution_raise_on_error = True
nb_execution_show_tb = True
nb_merge_streams = True
nb_render_markdown_format = "myst"

# Reference.
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True  # as written: Field(), not all that it consists of
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_type_aliases = {"ArrayLike": "ArrayLike"}  # not all that NumPy's consists of
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_attr_annotations = False
napoleon_use_ivar = False
napoleon_use_rtype = False

# What is copied from a code block.
copybutton_prompt_text = "$ "
