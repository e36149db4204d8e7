"""Every formulation and solver of benchmarks/solvers.py gives the minimiser of the same lasso, and is checked."""

import json

import numpy as np
import pytest

from benchmarks.common.report import data_folder
from benchmarks.solvers import certified, main, measure
from benchmarks.timing.formulations import Recorded, methods
from lassokin_ros.core.lasso.problem import Lasso

pytestmark = pytest.mark.filterwarnings("ignore:Converted matrix")
NAMES = list(methods())


@pytest.fixture(scope="module")
def every_method():
    """The methods by name. No module keeps their solvers, because proxsuite's binding would report them as leaked."""
    return methods()


def problem(m, n, seed=0):
    random = np.random.default_rng(seed)
    A, B = random.normal(size=(m, n)), random.normal(size=(m, 3))
    truth = np.where(random.random(n) < 0.2, random.normal(size=n), 0.0)
    z = A @ truth + B @ [0.1, -0.2, 0.3] + 0.1 * random.normal(size=m)
    return Recorded(Lasso(A, B, z, random.uniform(0.5, 1.5, n)), guess=np.zeros(n), dead=4)


@pytest.mark.parametrize("size", [(24, 30), (50, 20)], ids=["image rows", "more rows than columns"])
@pytest.mark.parametrize("name", NAMES)
def test_every_method_solves_the_lasso(name, size, every_method):
    recorded = problem(*size)
    certificate = certified(recorded, every_method[name](recorded))
    assert certificate.kkt_residual < 1e-2 and abs(certificate.relative_gap) < 1e-3


def test_no_method_uses_cached_results_of_another(every_method):
    found = []

    def look(recorded):
        found.append("reduced" in vars(recorded.problem))
        return every_method[NAMES[0]](recorded)

    recorded = problem(24, 30)
    measure("test", [recorded, recorded], {"one": look, "other": look})
    assert len(found) == 6 and not any(found[2:])  # the first two are not timed


def test_wrong_and_missing_answers_are_counted_as_failures(every_method):
    def wrong(recorded):
        return np.ones(30), np.zeros(3)

    def broken(recorded):
        raise RuntimeError("no answer")

    default = NAMES[0]
    records = measure("test", [problem(24, 30)], {default: every_method[default], "wrong": wrong, "broken": broken})
    assert [r["certified_percent"] for r in records] == [100, 0, 0]
    assert [r["failed_percent"] for r in records] == [0, 100, 100]
    assert records[0]["ratio"] == 1.0


@pytest.mark.skipif(not (data_folder() / "mocap").is_dir(), reason="no motion capture: set LASSOKIN_DATA")
def test_the_command_line_solves_recorded_problems(tmp_path, capsys):
    file = tmp_path / "records.json"
    clips = ["--clips", "exp_running_1"]
    assert main([*clips, "--problems", "4", "--methods", "primal split", "--json", str(file)]) == 0
    records = json.loads(file.read_text(encoding="utf-8"))
    assert [r["kind"] for r in records] == ["plain"] * 2 + ["default"] * 2
    assert all(r["certified_percent"] == 100 for r in records if r["method"].startswith("default"))
    assert "one thread" in capsys.readouterr().out
