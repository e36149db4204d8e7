"""Settings before rclpy or numpy are imported: strict messages, one thread, a DDS domain for this process.

And which tests are slow: `make check` leaves these out.
"""

import fcntl
import os
import sys
import tempfile
import time
from importlib.util import cache_from_source
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


@pytest.fixture
def tasks_here(monkeypatch):
    """The recordings of an archive are replayed in this process."""
    from lassokin_ros.archive import archive, tasks

    monkeypatch.setattr(archive, "in_processes", lambda jobs: lambda given: (tasks.run_task(task) for task in given))


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


SLOW_FOLDERS = set("archive benchmarks camera demo examples fuzz launch replay robot training video viewer".split())
"""Folders whose tests run whole commands, programs or examples."""
TESTS = Path(__file__).parent
SLOW_TESTS = set((TESTS / "slow_tests.txt").read_text(encoding="utf-8").split())
"""Other tests that take more than 0.3 s of processor time or start Python, as file::function."""
FAST_S = 0.5
"""s of processor time: a test that takes longer, and does not count as slow, is listed after the run."""


def is_slow(path):
    """True if all tests of a file count as slow, because of its folder or because it runs nodes."""
    return path.relative_to(TESTS).parts[0] in SLOW_FOLDERS or runs_nodes(path)


def name_of(item):
    """The name of a test in `slow_tests.txt`."""
    return f"{item.path.relative_to(TESTS).as_posix()}::{item.originalname}"


def pytest_configure(config):
    """Register the marks; that of pytest-xdist, too, so that the tests also run without it."""
    config.addinivalue_line("markers", "xdist_group(name): tests that run one after the other")
    config.addinivalue_line(
        "markers", "slow: takes more than 0.3 s of processor time, or starts Python; see `make check`"
    )
    sys.addaudithook(note_processes)


def pytest_ignore_collect(collection_path, config):
    """Do not import files of slow tests alone for `make check`: rclpy takes a second in each process."""
    if config.option.markexpr == "not slow" and collection_path.suffix == ".py" and is_slow(collection_path):
        return True
    return None


BYTECODE = Path(cache_from_source(TESTS / "skeleton_readers" / "any.py")).parent
"""Of the last folder that `make check` and `make test` both collect."""
COMPILED = sys.dont_write_bytecode or any(BYTECODE.glob("*-pytest-*.pyc"))
"""Whether no process need wait at the start."""


@pytest.hookimpl(wrapper=True)
def pytest_collection(session):
    """Let one of the processes compile the tests, 15 s: each of the others would do it again, at the same time."""
    worker = os.environ.get("PYTEST_XDIST_WORKER", "")
    done = Path(tempfile.gettempdir(), f"lassokin_ros_collected_{os.environ.get('PYTEST_XDIST_TESTRUNUID')}")
    end = time.monotonic() + 120
    while worker not in ("", "gw0") and not (COMPILED or done.exists() or time.monotonic() > end):
        time.sleep(0.1)
    result = yield
    if worker == "gw0" and not COMPILED:
        done.touch()
        session.config.add_cleanup(done.unlink)
    return result


@pytest.hookimpl(tryfirst=True)  # before the hook of pytest-xdist, which reads the marks
def pytest_collection_modifyitems(items):
    """Mark slow tests. Each file is a group, which one process runs: its tests share a running node, for example.

    The order is that in which the processes take the files (with `--no-loadscope-reorder`). Those that run nodes, which
    mostly wait, are spread among the other slow ones, which use a core. The fast ones come last, so that the processes
    end at the same time.
    """
    slow = {item.path for item in items if name_of(item) in SLOW_TESTS}
    nodes, others, fast = [], [], []
    for path in dict.fromkeys(item.path for item in items):
        kind = nodes if runs_nodes(path) else others if is_slow(path) or path in slow else fast
        kind.append(path)
    order = {path: (kind is fast, i / len(kind)) for kind in (nodes, others, fast) for i, path in enumerate(kind)}
    items.sort(key=lambda item: order[item.path])
    for item in items:
        item.add_marker(pytest.mark.xdist_group(item.path.stem))
        if item.path in nodes or is_slow(item.path) or name_of(item) in SLOW_TESTS:
            item.add_marker(pytest.mark.slow)


started = []
"""Commands of the Python processes that the present test has started."""


def note_processes(event, arguments):
    """Remember that Python is started (an audit hook, see `sys.addaudithook`)."""
    if event == "subprocess.Popen" and sys.executable in map(str, [arguments[0], *arguments[1]]):
        started.append(arguments[1])


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item):
    """Note the processor time of a test. One that starts Python must count as slow."""
    before = time.process_time()
    result = yield
    item.user_properties.append(("processor time", time.process_time() - before))
    commands, started[:] = list(started), []  # of fixtures, too
    if commands and item.get_closest_marker("slow") is None:
        pytest.fail(f"starts Python, and is not in slow_tests.txt: {name_of(item)}: {commands[0]}", pytrace=False)
    return result


def pytest_terminal_summary(terminalreporter, config):
    """Print the number of fuzz cases of this process, tests that should count as slow, and whether groups were kept."""
    fuzzing = sys.modules.get("fuzzing")
    for line in fuzzing.report() if fuzzing else ():
        terminalreporter.write_line(line)
    passed = terminalreporter.stats.get("passed", ())
    for report in passed:
        seconds = dict(report.user_properties).get("processor time", 0.0)
        if seconds > FAST_S and "slow" not in report.keywords:
            terminalreporter.write_line(f"{report.nodeid} takes {seconds:.1f} s, and is not in slow_tests.txt")
    # pytest-xdist appends the group to a test's id. Without it, tests may not have been grouped.
    if config.getoption("dist", "no") == "loadgroup" and not all("@" in report.nodeid for report in passed):
        terminalreporter.write_line("pytest-xdist groups no tests under this pytest: nodes ran two at once", red=True)
