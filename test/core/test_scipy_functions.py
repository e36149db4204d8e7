"""Scipy's compiled modules, loaded alone, are scipy's; without their files, scipy's packages are used."""

import subprocess
import sys

import numpy as np
import pytest
from scipy import linalg, optimize

from lassokin_ros.core import kernel
from lassokin_ros.core.kernel import compiled_module, lapack


def test_the_functions_are_those_of_scipy():
    random = np.random.default_rng(0)
    J = random.normal(size=(9, 6))
    for mine, theirs in zip(lapack.dposv(J.T @ J, J.T), linalg.lapack.dposv(J.T @ J, J.T)):
        assert np.array_equal(mine, theirs)
    costs = random.random((4, 3))
    assigned = compiled_module("optimize", "_lsap", "optimize").linear_sum_assignment(costs)
    assert np.array_equal(assigned, optimize.linear_sum_assignment(costs))


@pytest.mark.parametrize(
    "package, name, public, module",
    [("linalg", "_flapack", "linalg.lapack", linalg.lapack), ("optimize", "_lsap", "optimize", optimize)],
)
def test_a_scipy_without_the_file_is_used_as_a_whole(package, name, public, module, monkeypatch):
    assert compiled_module(package, name, public) is not module
    monkeypatch.setattr(kernel, "EXTENSION_SUFFIXES", [".none"])
    assert compiled_module(package, name, public) is module


@pytest.mark.parametrize("first, then", [("mine", "theirs"), ("theirs", "mine")])
def test_scipy_itself_can_be_imported_before_and_after(first, then):
    imports = {"mine": "from lassokin_ros.core.kernel import lapack", "theirs": "import scipy.linalg"}
    code = f"""if True:
        {imports[first]}
        {imports[then]}
        import numpy as np
        H = 2 * np.eye(3)
        print(np.allclose(lapack.dposv(H, H)[1], scipy.linalg.cho_solve(scipy.linalg.cho_factor(H), H)))
    """
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert (done.stdout, done.stderr) == ("True\n", "")
