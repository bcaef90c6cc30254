"""The documentation site: `sphinx-build -W -n --keep-going docs docs/_build/html`."""

import dataclasses
import re

from pygments.lexers.shell import BashLexer  # type: ignore[import-untyped]
from sphinx.application import Sphinx

import nearfar

project = "nearfar"
version = release = nearfar.__version__

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "sphinx.ext.napoleon"]
exclude_patterns = ["_build", "**/.ipynb_checkpoints"]

html_theme = "furo"
html_title = f"nearfar {version}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_copyright = False

myst_heading_anchors = 3
nb_execution_mode = "off"
nb_render_markdown_format = "gfm"

default_role = "autolink"
smartquotes_action = "D"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
napoleon_numpy_docstring = False
maximum_signature_line_length = 88
python_use_unqualified_type_names = True

nitpick_ignore_regex = [
    # Other packages describe their own types, and a build needs no network to link there.
    ("py:(class|obj)", r"(collections|cv2|numpy|os|pathlib|time)\..*|Parameter"),
    # In backticks in docstrings, but no names of the reference that the context would resolve.
    (
        "py:obj",
        r"RelativePose|Keypoints\.of|ImageMatcher\.\w+|adaptive|localization\.json|nearfar\.exports\.hloc_files|StorageError",
    ),
    # Type variables, and what only benchmarks make.
    (
        "py:class",
        r"nearfar\.(methods|features)\.Features|nearfar\.(registry|runtime\.timing)\.T|FeatureStore",
    ),
]

ARRAY = re.compile(
    r"ndarray\[tuple\[~?(typing\.)?Any, \.\.\.\], ~?numpy\.dtype\[[~\w.]+(\[[~\w.]+\])?\]\]"
)
"""What `NDArray[...]` becomes; shapes and units stand in the docstrings."""


def short_signature(
    _app: Sphinx,
    _what: str,
    _name: str,
    documented: object,
    _options: object,
    signature: str | None,
    returned: str | None,
) -> tuple[str, str | None] | None:
    """Arrays by their short name; none of data classes, whose fields follow, and protocols."""
    if signature is None:
        return None
    if dataclasses.is_dataclass(documented) or getattr(documented, "_is_protocol", False):
        return "", None
    return ARRAY.sub("ndarray", signature), returned and ARRAY.sub("ndarray", returned)


def whole_sentence(
    _app: Sphinx, what: str, _name: str, _documented: object, _options: object, lines: list[str]
) -> None:
    """Keep napoleon from taking what stands before a colon as the type of what is described."""
    if what in ("attribute", "data", "property") and lines:
        lines[0] = f": {lines[0]}"
    for at, line in enumerate(lines[:-1], 1):
        if line.strip() == "Returns:":
            text = lines[at].lstrip()
            lines[at] = f"{lines[at][: -len(text)]}: {text}"


def short_types(
    _app: Sphinx, _what: str, _name: str, _documented: object, _options: object, lines: list[str]
) -> None:
    """Arrays by their short name in the types of attributes."""
    lines[:] = [ARRAY.sub("ndarray", line) for line in lines]


def setup(app: Sphinx) -> None:
    """Highlight consoles as shell scripts, since they have no prompts; tidy up the reference."""
    app.add_lexer("console", BashLexer)
    app.connect("autodoc-process-signature", short_signature)
    app.connect("autodoc-process-docstring", whole_sentence, priority=400)
    app.connect("autodoc-process-docstring", short_types, priority=600)
