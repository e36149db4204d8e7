"""Mutation testing of a tiny module: which mutants its tests notice, and which mutants there are."""

import random
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from benchmarks.mutants import scores, try_room  # noqa: E402
from benchmarks.mutation import trial  # noqa: E402

CODE = """def larger(a: int | None, b: int) -> int:
    if a > b:
        return a
    return b
"""
TESTS = "from msg_adapters.tiny import larger\n\n\ndef test_larger():\n    assert larger(1, 2) == 2 == larger(2, 1)\n"


@pytest.fixture
def repository(tmp_path, monkeypatch):
    """A module, its tests, and the tests of another room, which fail."""
    root = tmp_path / "repository"
    for name, text in {
        "msg_adapters/__init__.py": "",
        "msg_adapters/tiny.py": CODE,
        "msg_adapters/detectors/far.py": "",
        "test/msg_adapters/test_tiny.py": TESTS,
        "test/msg_adapters/test_a.py": "",
        "test/other/test_other.py": "assert False\n",
    }.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    monkeypatch.setattr(trial, "GRACE_S", 0.0)
    monkeypatch.setenv("PYTHONPATH", "")  # the copy sets it, and the next one
    monkeypatch.setenv(trial.SWITCH, "1")
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    return root


def mutants(repository, *changes):
    path = repository / "msg_adapters" / "tiny.py"
    return [SimpleNamespace(path=path, line=2, operator="by hand", code=CODE.replace(*change)) for change in changes]


def test_mutants_are_killed_time_out_or_survive(repository, tmp_path):
    endless = ("if a > b:\n        return a", "while True:\n        a")
    made = mutants(repository, ("a > b", "a < b"), ("a > b", "a >= b"), endless, ("return b", "return b +"))
    copy = trial.Copy(repository, tmp_path, preloaded=("pytest",))
    records = list(try_room(copy, "tiny", made))
    assert [record["outcome"] for record in records] == ["killed", "survived", "timed out", "killed"]
    assert copy.test(["test/msg_adapters/test_tiny.py"]).seconds.keys() == {"test/msg_adapters/test_tiny.py"}
    assert records[1]["change"] == "-    if a > b:\n+    if a >= b:"
    assert (records[0]["path"], records[0]["line"], records[0]["room"]) == ("msg_adapters/tiny.py", 2, "tiny")
    assert (
        (copy.root / "msg_adapters" / "tiny.py").read_text()
        == (repository / "msg_adapters" / "tiny.py").read_text()
        == CODE
    )
    (row,) = scores(records)
    assert (row["sampled"], row["killed"], row["survived"], row["timed_out"], row["score"]) == (4, 3, 1, 1, 0.75)


def test_a_package_that_the_benchmark_has_imported_itself_is_tested_as_the_copy_has_it(repository, tmp_path):
    """The trials' own module imports lassokin_ros, and from its own repository."""
    path = repository / "lassokin_ros" / "tiny.py"
    path.parent.mkdir()
    path.write_text(CODE)
    (path.parent / "__init__.py").touch()
    (repository / "test" / "test_tiny.py").write_text(TESTS.replace("msg_adapters", "lassokin_ros"))
    mutant = SimpleNamespace(path=path, line=2, operator="by hand", code=CODE.replace("a > b", "a < b"))
    (record,) = try_room(trial.Copy(repository, tmp_path, preloaded=("pytest",)), "tiny", [mutant])
    assert record["outcome"] == "killed"


def test_tests_that_fail_by_themselves_are_reported(repository, tmp_path):
    (repository / "test/msg_adapters/test_a.py").write_text("assert False\n")
    copy = trial.Copy(repository, tmp_path, preloaded=("pytest",))
    with pytest.raises(SystemExit, match="test_tiny.py fail without a mutant .exit code 1"):
        list(try_room(copy, "tiny", mutants(repository, (">", "<"))))


def test_the_tests_of_a_module_are_in_the_folder_that_mirrors_its_own(repository):
    expected = ["test/msg_adapters/test_a.py", "test/msg_adapters/test_tiny.py"]
    for module in ("tiny.py", "detectors/far.py"):
        assert trial.tests_of(repository / "msg_adapters" / module, repository) == expected
    assert trial.tests_of(repository / "lassokin_ros/other/x.py", repository) == ["test/other/test_other.py"]


def test_the_mutants_of_a_module(repository):
    """Needs what `make mutants` installs."""
    pytest.importorskip("cosmic_ray", reason="cosmic-ray is installed by `make mutants` only")
    from benchmarks.mutation.mutants import sample

    path = repository / "msg_adapters" / "tiny.py"
    path.write_text(CODE + "\n\nassert CODE != 2\nprint(larger(1, 2))\n")
    every = list(sample([path], 1000, random.Random(0)))
    assert len({mutant.code for mutant in every}) == len(every)
    assert not any(
        "None" in mutant.code.replace("int | None", "") and "return None" not in mutant.code for mutant in every
    )
    assert all("a: int | None, b: int) -> int" in mutant.code for mutant in every)  # annotations stay
    names = [mutant.operator for mutant in every]
    assert names.count("ReturnNone") == 2 and names.count("RemoveCall") == 1 and names.count("NumberReplacer") == 2
    (removed,) = [mutant.code for mutant in every if mutant.operator == "RemoveCall"]
    assert removed == CODE + "\n\nassert CODE != 2\npass\n"
    some = [mutant.code for mutant in sample([path], 3, random.Random(5))]
    assert some == [mutant.code for mutant in sample([path], 3, random.Random(5))] and len(some) == 3
