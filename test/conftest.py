"""Settings before rclpy or numpy are imported: strict messages, one thread, a DDS domain for this process."""

import fcntl
import os
import sys
import tempfile
from pathlib import Path

import pytest
from installation.pip_only import PIP_ONLY
from live_runs import runs_nodes

DOMAINS = range(1, 102)
"""Those that DDS can use on every Linux, without 0, which robots use."""


def reserved_domain():
    """(DDS domain that no other test process of this machine uses, file that is locked until this process ends)."""
    for domain in DOMAINS:
        try:
            file = open(Path(tempfile.gettempdir(), f"lassokin_ros_domain_{domain}"), "a")
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:  # of another process, or of another user
            continue
        return domain, file
    raise RuntimeError(f"no DDS domain is free: see {tempfile.gettempdir()}/lassokin_ros_domain_*")


DOMAIN, DOMAIN_LOCK = reserved_domain()
os.environ["ROS_DOMAIN_ID"] = str(DOMAIN)
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
if os.environ.get("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp") == "rmw_fastrtps_cpp":
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "SYSTEM_DEFAULT"  # that of the profile: the loopback interface
    os.environ["FASTRTPS_DEFAULT_PROFILES_FILE"] = str(Path(__file__).parent / "support" / "dds_loopback.xml")
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
os.environ.setdefault("OMP_NUM_THREADS", "1")


class TestFile(pytest.Module):
    """A test file, which is skipped where one of PIP_ONLY is missing: `colcon test` then collects without errors."""

    def _getobj(self):
        try:
            return super()._getobj()
        except self.CollectError as error:
            name = (getattr(error.__cause__, "name", None) or "").partition(".")[0]
            if name not in PIP_ONLY:
                raise
            pytest.skip(f"needs {name}: pip install {name}", allow_module_level=True)


def pytest_pycollect_makemodule(module_path, parent):
    """Every test file is a TestFile."""
    return TestFile.from_parent(parent, path=module_path)


def pytest_configure(config):
    """Register the mark of pytest-xdist, so that the tests also run without it."""
    config.addinivalue_line("markers", "xdist_group(name): tests that run one after the other")


@pytest.hookimpl(tryfirst=True)  # before the hook of pytest-xdist, which reads the marks
def pytest_collection_modifyitems(items):
    """If processes share the tests, those of `test/node` run one after the other, and so do others that run nodes.

    More nodes at once would compete for a core. The tests of a file stay together, because they share the fixtures of
    their module, such as a running node.
    """
    groups = {path: group_of(path) for path in {item.path for item in items}}
    for item in items:
        item.add_marker(pytest.mark.xdist_group(groups[item.path]))


def group_of(path):
    """The group of a test file: `nodes`, `commands` with nodes, or the file alone."""
    if not runs_nodes(path):
        return path.stem
    return "nodes" if "node" in path.relative_to(Path(__file__).parent).parts else "commands"


def pytest_terminal_summary(terminalreporter, config):
    """Print the number of fuzz cases, if they ran in this process, and whether groups were kept together."""
    fuzzing = sys.modules.get("fuzzing")
    for line in fuzzing.report() if fuzzing else ():
        terminalreporter.write_line(line)
    # pytest-xdist appends the group to a test's id. Without it, tests may not have been grouped.
    passed = terminalreporter.stats.get("passed", ())
    if config.getoption("dist", "no") == "loadgroup" and not all("@" in report.nodeid for report in passed):
        terminalreporter.write_line("pytest-xdist groups no tests under this pytest: nodes ran two at once", red=True)
