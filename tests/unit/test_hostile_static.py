"""Nothing in the package runs texts, opens pickles of strangers or hands words to a shell: read off its own source."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import maglev_ctrl

ROOT = Path(maglev_ctrl.__file__).parent
BUILTINS = {"eval", "exec", "compile", "__import__"}
MODULES = {
    "yaml", "marshal", "shelve", "dill", "cloudpickle", "joblib", "xml", "lxml", "pickle", "cPickle", "code", "codeop",
    "telnetlib", "ftplib", "smtplib", "urllib.request", "http.client", "requests",
}  # fmt: skip
CALLS = {"tempfile.mktemp", "os.system", "os.popen", "os.execv", "os.spawnv", "jinja2.Template"}
LOOKED_AT = {"shell", "allow_pickle", "autoescape"}
OWN_PIPES = {"workbench/slow_process.py", "workbench/slow_work.py"}
"""Both ends of a pipe between the page and a process it started: no stranger writes there. Dask and multiprocessing
pickle between the processes of one study by themselves."""


def dotted(node: ast.expr) -> str:
    """The name of what is called; '' where it is no name."""
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute):
        return f"{dotted(node.value)}.{node.attr}"
    return ""


def breaches(source: str, file: str) -> Iterator[str]:
    """What a module does that none may do, with its line."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import | ast.ImportFrom):
            names = [one.name for one in node.names] if isinstance(node, ast.Import) else [node.module or ""]
            if isinstance(node, ast.ImportFrom):
                names += [f"{node.module}.{one.name}" for one in node.names]
            for name in names:
                if any(name == one or name.startswith(f"{one}.") for one in MODULES):
                    if name.split(".")[0] == "pickle" and file in OWN_PIPES:
                        continue
                    yield f"{file}:{node.lineno}: imports {name}"
        if not isinstance(node, ast.Call):
            continue
        called = dotted(node.func)
        given = {word.arg: ast.unparse(word.value) for word in node.keywords if word.arg in LOOKED_AT}
        if called in BUILTINS or called.removeprefix("builtins.") in BUILTINS:
            yield f"{file}:{node.lineno}: calls {called}"
        if called in CALLS:
            yield f"{file}:{node.lineno}: calls {called}"
        if called in ("np.load", "numpy.load") and given.get("allow_pickle") != "False":
            yield f"{file}:{node.lineno}: np.load without allow_pickle=False"
        if given.get("shell", "False") != "False":
            yield f"{file}:{node.lineno}: a shell"
        if given.get("allow_pickle", "False") != "False":
            yield f"{file}:{node.lineno}: allow_pickle"
        if called in ("jinja2.Environment", "Environment") and given.get("autoescape") != "True":
            yield f"{file}:{node.lineno}: a template without autoescape"


def test_no_module_does_what_none_may_do() -> None:
    files = sorted(ROOT.rglob("*.py"))
    assert len(files) > 300
    found = [
        one for file in files for one in breaches(file.read_text(encoding="utf-8"), file.relative_to(ROOT).as_posix())
    ]
    assert found == []


@pytest.mark.parametrize(
    "line",
    [
        "eval('1')", "exec('x = 1')", "compile('1', '', 'eval')", "import pickle", "from yaml import load",
        "import marshal",
        "import xml.etree.ElementTree", "from xml.etree import ElementTree", "np.load(f)",
        "np.load(f, allow_pickle=True)",
        "numpy.load(f, mmap_mode='r')", "subprocess.run(x, shell=True)", "tempfile.mktemp()", "os.system('ls')",
        "np.savez(f, allow_pickle=True)", "import shelve", "__import__('os')", "builtins.eval('1')", "import joblib",
        "jinja2.Environment()", "Environment(autoescape=False)", "from urllib.request import urlopen",
    ],
)  # fmt: skip
def test_each_of_them_is_seen(line: str) -> None:
    assert list(breaches(f"def f():\n    {line}\n", "study/any.py"))


def test_what_is_allowed_is_not_told() -> None:
    fine = "import json\nnp.load(f, allow_pickle=False)\nsubprocess.Popen(words)\nre.compile('x')\nmodel.eval\n"
    assert not list(breaches(fine, "study/any.py"))
    assert not list(breaches("import pickle\n", "workbench/slow_work.py"))
