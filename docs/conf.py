"""Settings of the documentation site.

`make docs` writes docs/_build/html without a network, and the pages need none either.
"""

import logging
import re
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

# Without types, and only there where the site is built.
nodes = import_module("docutils.nodes")
mathml = import_module("docutils.utils.math.latex2mathml")
figure_rst = import_module("sphinx_gallery.scrapers").figure_rst

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parent)]

# A style for code that comes along with the theme makes every logger talk.
logging.getLogger("femnl").setLevel(logging.WARNING)

project = "femnl"
author = "The femnl developers"
version = release = import_module("femnl").__version__
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.viewcode",
    "sphinx_gallery.gen_gallery",
]
myst_enable_extensions = ["dollarmath"]
exclude_patterns = ["_build", "sg_execution_times.rst"]
html_theme = "furo"
html_title = "femnl"
html_math_renderer = "mathml"
html_show_sphinx = html_show_copyright = False
html_static_path = ["static"]
html_css_files = ["site.css"]
default_role = "code"
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
# Above this, each parameter stands on a line of its own
maximum_signature_line_length = 72
suppress_warnings = ["config.cache"]
sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"\.py$",
    "abort_on_example_error": True,
    "download_all_examples": False,
    "show_signature": False,
    "show_memory": False,
    "write_computation_times": False,
    "min_reported_time": 1e9,
    "thumbnail_size": (800, 560),
    "image_scrapers": ("conf.keep_figures",),
}
drawn: set[int] = set()
ARRAY = re.compile(
    r"~numpy\.ndarray\[tuple\[~typing\.Any, \.\.\.\], ~numpy\.dtype\[~numpy\.(\w+)\]\]"
)
ARRAY_LIKE = re.compile(r"~numpy\.[\w.]*_Buffer \| .*?_NestedSequence\[complex \| bytes \| str\]")
APPLIED = re.compile(r"<mo>&ApplyFunction;</mo>(?=\s*<m(?:i|n|sub|sup|subsup|frac)>)")


def keep_figures(block: Any, variables: dict[str, Any], settings: dict[str, Any]) -> str:
    """Save every new figure that an example leaves in a variable.

    Femnl's figures belong to no window, where others look for them.
    """
    paths = []
    for value in variables["example_globals"].values():
        if isinstance(value, Figure) and id(value) not in drawn:
            drawn.add(id(value))
            paths.append(next(variables["image_path_iterator"]))
            value.savefig(paths[-1], dpi=150)
    return str(figure_rst(paths, settings["src_dir"]))


def setup(app: Any) -> None:
    """Draw the architecture and formulas, make pages, and take docstrings as they are written."""
    architecture = import_module("architecture")
    architecture.PICTURE.write_text(architecture.draw(), encoding="utf-8")
    import_module("generated_pages").write()
    app.add_html_math_renderer(
        "mathml", inline_renderers=(draw_formula, None), block_renderers=(draw_equation, None)
    )
    app.connect("autodoc-process-docstring", lay_out)
    app.connect("autodoc-process-signature", shorten)


def draw_formula(writer: Any, node: Any) -> None:
    """Write a formula within a line."""
    writer.body.append(spaced(mathml.tex2mathml(node.astext())))
    raise nodes.SkipNode


def spaced(formula: str) -> str:
    """Put a thin space behind the name of a function: ln 100, not ln100."""
    return APPLIED.sub(r'\g<0><mspace width="0.167em"></mspace>', formula)


def draw_equation(writer: Any, node: Any) -> None:
    """Write a formula on a line of its own."""
    formula = spaced(mathml.tex2mathml(node.astext(), as_block=True))
    writer.body.append(f'<div class="math">{formula}</div>')
    raise nodes.SkipNode


def shorten(
    app: object, what: str, name: str, value: object, *rest: Any
) -> tuple[str | None, str | None]:
    """Write the types of arrays as their users do. rest: options, signature, returned type."""
    _, signature, returned = rest
    return _named(signature), _named(returned)


def _named(text: str | None) -> str | None:
    if text is None:
        return None
    return ARRAY_LIKE.sub("ArrayLike", ARRAY.sub(r"NDArray[\1]", text))


def lay_out(
    app: object, what: str, name: str, value: object, options: object, lines: list[str]
) -> None:
    """Keep |ξ| and * as they are, and start a line with each of Args, Returns, Raises."""
    text = [
        line.replace("\\", r"\\").replace("|", r"\|").replace("*", r"\*").replace("_ ", r"\_ ")
        for line in lines
    ]
    lines[:] = []
    for line in text:
        word = line.strip().split(":")[0]
        if line.strip() and word in (
            "Args",
            "Returns",
            "Raises",
            "Valid",
            "Source",
            "Args, Returns, Source",
            "Args, Raises",
        ):
            lines += ["", f"**{word}.**{line.strip()[len(word) + 1 :]}"]
        else:
            lines.append(line.strip())
    lines.append("")
