"""What the reference documents says what it takes, gives and raises; its examples run.

ruff (rules D and DOC) checks that docstrings are there, and that sections are complete where they exist.
"""

import builtins
import doctest
import importlib.util
import inspect
import pkgutil
import re
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from sphinx.ext.napoleon import Config, GoogleDocstring

import ggcnn_net2net as gn
from ggcnn_net2net import errors

PARSER = Config(napoleon_use_param=True)
FIELD = re.compile(r"^:(param|raises|returns|Yields)(?: ([^:]+))?:", re.MULTILINE)


def configuration():
    """The documentation's configuration, which knows what the reference documents."""
    path = Path(__file__).parents[1] / "docs" / "conf.py"
    spec = importlib.util.spec_from_file_location("docs_conf", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


CONF = configuration()


def documented():
    """Names and objects of the reference."""
    for name, value in CONF.documented():
        yield pytest.param(value, is_exported(name), id=name.removeprefix("ggcnn_net2net."))


def is_exported(name):
    """Whether a name, or the class that it belongs to, is one that a room exports."""
    room, *members = name.removeprefix("ggcnn_net2net.").split(".")
    return members[:1] != [] and members[0] in getattr(import_module(f"ggcnn_net2net.{room}"), "__all__", ())


DOCUMENTED = list(documented())


def fields(docstring):
    """The sections of a docstring by kind."""
    found = {"param": [], "raises": [], "returns": [], "Yields": []}
    for kind, name in FIELD.findall(str(GoogleDocstring(inspect.cleandoc(docstring), PARSER))):
        found[kind] += [part.lstrip("\\*") for part in name.split(", ")]
    return found


def test_parser_sees_sections():
    found = fields("""Do it.

    Args:
        one: first.
        *rest: others.

    Returns:
        Something.

    Raises:
        GraspError, OSError: never.
    """)
    assert found == {"param": ["one", "rest"], "raises": ["GraspError", "OSError"], "returns": [""], "Yields": []}


def test_much_is_documented():
    names = {parameter.id for parameter in DOCUMENTED}
    assert {"net2net.wider", "grasping.Decoding", "datasets.hdf5.GraspDataset.batch", "errors.GraspError"} <= names
    assert len(names) > 250


@pytest.mark.parametrize(("value", "exported"), DOCUMENTED)
def test_arguments_and_results(value, exported):
    """A docstring of several lines has Args and Returns; one line is enough where it says all, unless for export."""
    assert value.__doc__, "no docstring"
    function = vars(value).get("__init__") if inspect.isclass(value) else value
    if function is None or hasattr(value, "__dataclass_fields__"):  # fields are documented one by one
        return
    docstring = inspect.getdoc(function) or ""
    found = fields(docstring)
    if inspect.isclass(value) and not found["param"]:
        found = fields(value.__doc__)
    names = [name for name in inspect.signature(function).parameters if name not in ("self", "cls", "args", "kwargs")]
    short = "\n" not in docstring.strip()
    if found["param"] or not short or exported:
        assert found["param"] == names
    gives = inspect.signature(function).return_annotation not in (None, "None", inspect.Signature.empty)
    if gives and names and (not short or exported):
        assert found["returns"] or found["Yields"], "no Returns"


@pytest.mark.parametrize("room", [module.name for module in pkgutil.iter_modules(gn.__path__) if module.ispkg])
def test_exported_constants(room):
    module = import_module(f"ggcnn_net2net.{room}")
    constants = [name for name in getattr(module, "__all__", ()) if not callable(getattr(module, name))]
    assert [name for name in constants if not CONF.constant_docstring(f"ggcnn_net2net.{room}.{name}")] == []


@pytest.mark.parametrize(("value", "exported"), DOCUMENTED)
def test_errors_are_ours(value, exported):
    """Raises names errors of the package, or Python's own."""
    docstrings = [value.__doc__, getattr(vars(value).get("__init__"), "__doc__", None)]
    for docstring in filter(None, docstrings):
        for name in fields(docstring)["raises"]:
            known = getattr(errors, name, None) or getattr(builtins, name, None)
            assert known is not None, f"{name} is no error of the package"
            assert issubclass(known, BaseException)


def examples():
    """All examples of the package."""
    finder = doctest.DocTestFinder(exclude_empty=True)
    for module in pkgutil.walk_packages(gn.__path__, "ggcnn_net2net."):
        if not module.name.endswith("__main__"):
            for example in finder.find(import_module(module.name), module.name):
                if example.examples:
                    yield pytest.param(example, id=example.name.removeprefix("ggcnn_net2net."))


def box_on_a_table():
    """(480, 640) metres: what a camera 0.7 m above a table sees."""
    depth = np.full((480, 640), 0.7, np.float32)
    depth[200:280, 300:330] = 0.65
    return depth


@pytest.mark.parametrize("example", list(examples()))
def test_examples(example, request):
    if '"published"' in example.docstring:
        request.getfixturevalue("data_root")
    example.globs |= {name: getattr(gn, name) for name in gn.__all__} | {
        "model": gn.build_ggcnn(gn.ORIGINAL),
        "depth": box_on_a_table(),
        "camera_info": SimpleNamespace(K=(615, 0, 320, 0, 615, 240, 0, 0, 1)),
    }
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS)
    printed = []
    runner.run(example, out=printed.append)
    assert runner.failures == 0, "".join(printed)
