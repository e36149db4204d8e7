"""Files are data: no code in a file is executed, no file fills the memory, and an unreadable file gives one line."""

import ast
from pathlib import Path

import pytest

from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.errors import ConfigurationError, LassokinError, LayoutError, SkeletonError
from lassokin_ros.pipeline.parameter_files import offline_settings

ROOT = Path(__file__).resolve().parents[2]
FORBIDDEN_MODULES = {"pickle", "cPickle", "dill", "cloudpickle", "joblib", "marshal", "shelve"}
LOADERS = {"_Loader", "_ShippedLoader"}
FORBIDDEN_CALLS = {"eval", "exec", "compile", "unsafe_load", "full_load", "load_all", "system", "popen"}


def sources():
    return [
        f for folder in ("lassokin_ros", "msg_adapters", "benchmarks", "launch") for f in (ROOT / folder).rglob("*.py")
    ]


def name_of(call):
    function = call.func
    return function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")


def faults_of(file):
    """Places in a source file at which external content could be executed."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            modules = {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            modules = {(node.module or "").split(".")[0]}
        else:
            modules = set()
        if modules & FORBIDDEN_MODULES:
            yield f"{file}:{node.lineno} imports {modules & FORBIDDEN_MODULES}"
        if not isinstance(node, ast.Call):
            continue
        owner = getattr(getattr(node.func, "value", None), "id", "")
        keywords = {k.arg: k.value for k in node.keywords}
        if name_of(node) in FORBIDDEN_CALLS and owner != "re":
            yield f"{file}:{node.lineno} calls {name_of(node)}"
        if owner == "yaml" and name_of(node) == "load" and getattr(keywords.get("Loader"), "id", "") not in LOADERS:
            yield f"{file}:{node.lineno} loads YAML by another loader"
        if getattr(keywords.get("allow_pickle"), "value", False):
            yield f"{file}:{node.lineno} allows pickles"
        if getattr(keywords.get("shell"), "value", False):
            yield f"{file}:{node.lineno} asks a shell"


def test_the_sources_neither_unpickle_nor_execute_files():
    assert len(sources()) > 60
    faults = [fault for file in sources() for fault in faults_of(file)]
    written = ROOT / "lassokin_ros" / "robot" / "retarget.py"  # motions in the form of others' tools are pickles
    assert "pickle.load" not in written.read_text(encoding="utf-8") and "Unpickler" not in written.read_text()
    arrays = ROOT / "lassokin_ros" / "pipeline" / "camera" / "calibration_formats.py"  # OpenCap's: arrays alone
    assert "pickle.load" not in arrays.read_text(encoding="utf-8")
    assert [fault for fault in faults if not fault.startswith((f"{written}:", f"{arrays}:"))] == []


@pytest.mark.parametrize(
    "line",
    [
        "import pickle",
        "from pickle import loads",
        "np.load(f, allow_pickle=True)",
        "yaml.load(t, Loader=yaml.Loader)",
        "yaml.unsafe_load(t)",
        "eval(t)",
        "os.system(t)",
        "subprocess.run(t, shell=True)",
    ],
)
def test_the_search_finds_every_unsafe_call(line, tmp_path):
    file = tmp_path / "a.py"
    file.write_text(line)
    assert list(faults_of(file))


def bomb(levels=12):
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, levels)]
    return "\n".join(lines)


TEXTS = {
    "an object": "a: !!python/object/apply:os.system ['touch ran']",
    "an object, new style": "a: !!python/object/new:os.system ['touch ran']",
    "a name": "a: !!python/name:os.system",
    "a module": "a: !!python/module:os",
    "a tuple": "a: !!python/tuple [1]",
    "an unknown tag": "a: !mine 1",
    "a bomb of aliases": bomb(),
    "an alias of itself": "a: &a [*a]",
    "a number of 5000 digits": "a: " + "9" * 5000,
    "no date": "a: 2001-99-99",
    "no number": "a: !!int x",
    "no truth": "a: !!bool x",
    "no bytes": "a: !!binary é",
    "no time": "a: !!timestamp x",
    "a list as a key": "? [a]\n: b",
    "deep": "a: " + "[" * 1000,
    "deep and closed": "a: " + "[" * 1000 + "]" * 1000,
    "a zero byte": "a: \x00",
    "two documents": "a: 1\n---\nb: 2",
    "long": "#" * 1_000_001,
}


@pytest.mark.parametrize("kind", TEXTS)
def test_yaml_files_with_code_are_refused_in_one_line(kind, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "bad.yaml"
    file.write_text(TEXTS[kind], encoding="utf-8")
    skeleton = Skeleton.load("anthropometric", 1.75)
    readers = {
        SkeletonError: lambda: Skeleton.load(str(file), 1.75),
        LayoutError: lambda: Layout.load(str(file), skeleton),
        ConfigurationError: lambda: offline_settings([file], []),
    }
    for error, read in readers.items():
        with pytest.raises(error) as caught:
            read()
        assert "bad.yaml" in str(caught.value) and "\n" not in str(caught.value) and len(str(caught.value)) < 1000
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.parametrize("kind", sorted(set(TEXTS) - {"two documents", "long"}))
def test_parameter_values_with_code_are_refused(kind):
    with pytest.raises(LassokinError) as caught:
        offline_settings([], [f"height:={TEXTS[kind].removeprefix('a: ')}"])
    assert len(str(caught.value)) < 1000
