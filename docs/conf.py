"""How the documentation site is built: everything local, every example executed, every warning an error."""

from __future__ import annotations

import logging
import os
import re
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
sys.path.insert(0, str(HERE / "_ext"))

# The examples run in kernels that inherit these: one thread each, one look for all figures, the repository at hand.
os.environ["OMP_NUM_THREADS"] = "1"
os.environ["MATPLOTLIBRC"] = str(HERE / "matplotlibrc")
os.environ["MAGLEV_ROOT"] = str(ROOT)
os.environ.setdefault("PYDEVD_DISABLE_FILE_VALIDATION", "1")

if os.environ.pop("PYTHONDONTWRITEBYTECODE", ""):
    # A dozen short-lived kernels would each compile the same libraries: let them share the result here.
    os.environ["PYTHONPYCACHEPREFIX"] = str(HERE / "_build" / "pycache")
    sys.dont_write_bytecode, sys.pycache_prefix = False, os.environ["PYTHONPYCACHEPREFIX"]
logging.getLogger("traitlets").setLevel(logging.WARNING)

# A profile of their own: no start-up files of the user, and no kernel chatter in the build's output.
PROFILE = HERE / "_build" / "ipython" / "profile_default"
PROFILE.mkdir(parents=True, exist_ok=True)
(PROFILE / "ipython_kernel_config.py").write_text("c.Application.log_level = 40\nc.HistoryManager.enabled = False\n")
os.environ["IPYTHONDIR"] = str(PROFILE.parent)

from maglev_ctrl._version import __version__  # noqa: E402

project = "maglev_ctrl"
author = "the maglev_ctrl contributors"
project_copyright = author
release = __version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "mathml",
    "scenario_reference",
    "gallery",
    "validation",
    "reliability",
    "local_only",
]
exclude_patterns = ["_build", "_ext", "**.ipynb_checkpoints", "jupyter_execute"]
# Every name that a page refers to has to be found; types in signatures, which nobody wrote as references, need not.
nitpicky = True
nitpick_ignore_regex = [(r"py:(class|obj|data|exc)", r".*")]

# -- Pages and examples -----------------------------------------------------------------------------------------------
myst_enable_extensions = ["amsmath", "attrs_inline", "colon_fence", "deflist", "dollarmath", "fieldlist"]
myst_heading_anchors = 3
myst_update_mathjax = False
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_show_tb = True
nb_execution_timeout = 60
nb_merge_streams = True
nb_output_stderr = "show"

# -- Mathematics: MathML, which browsers draw themselves --------------------------------------------------------------
html_math_renderer = "mathml"
math_number_all = False

# -- Reference from docstrings ----------------------------------------------------------------------------------------
autodoc_default_options = {"members": True, "member-order": "bysource"}
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
autodoc_type_aliases = {name: name for name in ("ArrayLike", "ComplexArray", "FloatArray")}
napoleon_google_docstring = False
napoleon_numpy_docstring = True
napoleon_use_rtype = False
python_use_unqualified_type_names = True
add_module_names = False

FIELDS = ("Parameters", "Raises", "Returns", "Attributes")


def plain_words(line: str) -> str:
    """A docstring line as reStructuredText: `code` becomes literal, nothing else is markup."""
    pieces = line.split("`")
    for place in range(0, len(pieces), 2):
        text = re.sub(r"([*|\\])", r"\\\1", pieces[place])
        pieces[place] = re.sub(r"(?<=\w)_(?=\W|$)", r"\\_", text)
    return "".join(f"``{piece}``" if place % 2 else piece for place, piece in enumerate(pieces))


def tidy_docstring(app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Docstrings of this project say `name : meaning` in one line; numpydoc wants the meaning on the next one."""
    tidy: list[str] = []
    section, doctest = "", False
    for place, line in enumerate(lines):
        rule = lines[place + 1].strip() if place + 1 < len(lines) else ""
        if rule and set(rule) == {"-"}:
            section = line.strip()
        doctest = line.lstrip().startswith(">>>") or (doctest and bool(line.strip()))
        if doctest or (line.strip() and set(line.strip()) == {"-"}):
            tidy.append(line)
            continue
        entry = re.fullmatch(r"(\S[^:]*?) : (.*)", line) if section in FIELDS else None
        if entry:
            tidy += [entry[1].replace("*", r"\*"), "    " + plain_words(entry[2])]
        else:
            tidy.append(plain_words(line))
    if what in ("attribute", "data", "property") and ":" in tidy[0]:
        tidy.insert(0, r"\ ")  # else what stands before the colon is taken for a type
    lines[:] = tidy


def setup(app: Any) -> None:
    """Hooks of this configuration; pages are read by two processes, each running its own examples."""
    app.connect("autodoc-process-docstring", tidy_docstring, priority=400)
    app.parallel = max(app.parallel, 2)


# -- Look -------------------------------------------------------------------------------------------------------------
html_theme = "furo"
html_title = f"maglev_ctrl {release}"
# Browsers draw roots and brackets to size only with a mathematical font; this one (STIX Two, OFL) comes with ziamath.
MATH_FONT = Path(str(find_spec("ziamath").origin)).parent / "fonts" / "STIXTwoMath-Regular.ttf"  # type: ignore[union-attr]
html_static_path = ["_static", str(MATH_FONT)]
html_css_files = ["maglev.css"]
html_show_sphinx = False
html_copy_source = False
html_theme_options = {"navigation_with_keys": True}
copybutton_exclude = ".linenos, .gp, .go"
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True
