"""Sphinx: `sphinx-build -W --keep-going docs docs/_build/html`. Needs the extra `docs`, and no network.

The cells of the tutorial are run, which takes minutes; `-D nb_execution_mode=off` leaves them and their outputs out.
"""

import inspect
import os
import pkgutil
import re
from collections import defaultdict
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

from sphinx.pycode import ModuleAnalyzer

import ggcnn_net2net as gn

project = gn.__name__
author = "the ggcnn_net2net authors"
version = release = gn.__version__
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "sphinx.ext.napoleon", "sphinx_click"]
html_theme = "furo"
html_title = f"{project} {version}"
highlight_language = "text"  # of blocks that name none: commands and output
smartquotes = False  # commands and options are to be copied
exclude_patterns = ["_build"]

nb_execution_mode = "force"
nb_execution_in_temp = True  # cells write files
nb_execution_raise_on_error = True
nb_execution_timeout = 1800  # seconds a cell, on a slow machine
nb_merge_streams = True
nb_output_stderr = "warn"  # log lines do not belong on the page
os.environ["JUPYTER_PREFER_ENV_PATH"] = "1"  # cells run in this environment, whatever kernels the user has

myst_heading_anchors = 3
myst_enable_extensions = ["substitution"]
napoleon_numpy_docstring = False
default_role = "py:obj"  # `name` in docstrings: a link if it is documented
autodoc_default_options = {"members": True}
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_typehints_format = "short"
autosummary_generate = False
maximum_signature_line_length = 100

MARKUP = re.compile(r"`([^`]+)`|\|")
NAME = re.compile(r"[A-Za-z_][\w.]*")
CODE_EXAMPLE = (".. rubric:: Example", "", "::", "")


def documented() -> Iterator[tuple[str, object]]:
    """Names and objects of the reference: what the modules export that its pages name, and their public methods."""
    for page in sorted(Path(__file__).parent.glob("reference/*.md")):
        for name in re.findall(r"^\.\. automodule:: (\S+)", page.read_text(encoding="utf-8"), re.MULTILINE):
            for member, value in inspect.getmembers(import_module(name), callable):
                if is_documented(name, member, value):
                    yield f"{name}.{member}", value
                    if inspect.isclass(value):
                        yield from ((f"{name}.{member}.{key}", item) for key, item in methods(value))


def is_documented(module: str, name: str, value: object) -> bool:
    """Whether a member is documented with a module: a room's public names with the room, others where they are made."""
    exported = getattr(import_module(module), "__all__", None)
    if exported is not None:
        return name in exported
    room = module.rpartition(".")[0]
    in_room = room != project and name in getattr(import_module(room), "__all__", ())
    return getattr(value, "__module__", None) == module and not name.startswith("_") and not in_room


def methods(kind: type) -> Iterator[tuple[str, object]]:
    """Public methods that a class defines itself."""
    for name, value in vars(kind).items():
        function = getattr(value, "__func__", getattr(value, "fget", value))
        is_field = name in getattr(kind, "__dataclass_fields__", ())
        if inspect.isfunction(function) and not name.startswith("_") and not is_field:
            yield name, function


def public_names() -> str:
    """The names of `gn.__all__`, each linked to the page of its room: functions and classes as a table."""
    homes = {name: f"~{project}.{gn._HOME[name]}.{name}" for name in gn.__all__ if name in gn._HOME}
    constants = [name for name in homes if not callable(getattr(gn, name))]
    table = "\n".join(f"   {home}" for name, home in homes.items() if name not in constants)
    links = ", ".join(f"{{py:obj}}`{homes[name]}`" for name in constants)
    return f"```{{eval-rst}}\n.. autosummary::\n\n{table}\n```\n\nConstants: {links}."


def raised_by() -> str:
    """Table of the errors and of what is documented to raise them."""
    raisers = defaultdict(list)
    for name, value in documented():
        docstrings = [inspect.getdoc(value), inspect.getdoc(vars(value).get("__init__"))]
        for docstring in filter(None, docstrings):
            raises = docstring.partition("Raises:\n")[2].partition("\n\n")[0]
            for error in re.findall(r"\b\w+Error\b(?=[\w, ]*:)", raises):
                raisers[error].append(f"{{py:obj}}`{name.removeprefix(f'{project}.')} <{name}>`")
    rows = (
        f"| {{py:obj}}`~{project}.errors.{error}` | {', '.join(raisers[error])} |"
        for error in vars(import_module(f"{project}.errors"))
        if error in raisers
    )
    return "\n".join(["| error | raised by |", "|---|---|", *rows])


def plain_text(app, what, name, obj, options, lines):  # noqa: ARG001
    """Docstrings are plain text: bars are bars, `.h5` is no name, and what stands before a colon is not a type."""
    if what == "data" and hasattr(import_module(name.rpartition(".")[0]), "__path__"):
        lines[:] = constant_docstring(name)
    for number, line in enumerate(lines):
        if line.strip() == "Example:" and not lines[number + 1].lstrip().startswith(">>>"):
            lines[number : number + 1] = [f"{line.partition('E')[0]}{text}" for text in CODE_EXAMPLE]
        if not line.lstrip().startswith(">>>"):
            lines[number] = MARKUP.sub(_as_rst, line)
        follows_heading = number > 0 and lines[number - 1].strip() in ("Returns:", "Yields:")
        if follows_heading or (number == 0 and what in ("attribute", "data", "property")):
            lines[number] = re.sub(r"(?=\S)", ": ", lines[number], count=1)  # napoleon: a type, which is empty


def _as_rst(match: re.Match[str]) -> str:
    if match[1] is None:
        return r"\|"
    return match[0] if NAME.fullmatch(match[1]) else f"``{match[1]}``"


def skip_member(app, what, name, obj, skip, options):  # noqa: ARG001
    """Document a name once."""
    if what == "module" and callable(obj) and not is_documented(app.env.current_document.autodoc_module, name, obj):
        return True
    return None


def constant_docstring(name: str) -> list[str]:
    """What stands below a constant, in the module of the room that makes it."""
    room, _, constant = name.rpartition(".")
    for module in pkgutil.iter_modules(import_module(room).__path__, f"{room}."):
        found = ModuleAnalyzer.for_module(module.name).find_attr_docs().get(("", constant))
        if found:
            return found
    return []


myst_substitutions = {"public_names": public_names(), "raised_by": raised_by()}


def setup(app):
    """Called by Sphinx."""
    app.connect("autodoc-skip-member", skip_member)
    app.connect("autodoc-process-docstring", plain_text, priority=400)  # before napoleon
