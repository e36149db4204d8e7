"""The compiled kernel gives the answers of the Python code, refuses what it does not treat, and is really used."""

import os
import shutil
import subprocess
import sys
import sysconfig
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sequences import CONFIG, detected, observations
from test_cameras import scene

from lassokin_ros.core import kernel as module
from lassokin_ros.core.kernel import FUNCTIONS, compiled, kernel
from lassokin_ros.core.tracker import Tracker

ROOT = Path(__file__).parents[2]
LARGEST_DIFFERENCE = 1e-5
"""m: the depth network computes with single precision, in which a rounding may go the other way."""

needs_kernel = pytest.mark.skipif(compiled is None, reason="the kernel is not built: no C compiler was found")


def test_the_kernel_is_built_where_there_is_a_compiler():
    headers = Path(sysconfig.get_path("include"), "Python.h").is_file()
    assert compiled is not None or not (shutil.which("cc") and headers)


# The same answers -----------------------------------------------------------------------------------------------------


def with_gaps_and_swaps():
    """Frames with a gap, points that are missing, sides that are exchanged, an outlier, and a long pause."""
    random, frames = np.random.default_rng(3), [seen for _, seen in observations(Tracker(CONFIG), 6.0)]
    sides = np.array([0, 2, 1, 4, 3, 6, 5, 8, 7, 10, 9, 12, 11, 14, 13, 16, 15])
    for number, seen in enumerate(frames):
        points, confidence = seen.points.copy(), seen.confidence.copy()
        if 40 <= number < 46:
            points = points[sides]
        confidence[random.integers(17, size=3)] = 0.0 if number % 7 == 0 else 1.0
        points[5] += [0.2, 0.0] if number in (70, 71) else [0.0, 0.0]
        frames[number] = replace(seen, points=points, confidence=confidence)
    return frames[:90] + frames[95:120] + frames[150:]


def with_depth():
    """Frames with measured depth, from the second on."""
    tracker = Tracker(CONFIG)
    frames = observations(tracker, 3.0)
    depths = [np.full(17, truth[0, 2]) for truth, _ in frames]
    return [seen if i == 0 else replace(seen, depth=depths[i]) for i, (_, seen) in enumerate(frames)]


def of_two_cameras():
    """Two cameras in turn and together."""
    _, front, side, observe = scene(3.0)
    frames = []
    for number in range(90):
        both = [observe(front, number), observe(side, number)]
        frames.append(both if number % 3 else both[:1])
    return frames


def slow():
    """5 Hz: longer steps, more linearisations, and fits to single frames."""
    return [seen for _, seen in observations(Tracker(CONFIG), 8.0)][::6]


SEQUENCES = {
    "calibration": lambda: [seen for _, seen in observations(Tracker(CONFIG), 12.0)],
    "gaps and swaps": with_gaps_and_swaps,
    "the demo's detector": lambda: detected(6.0)[1],
    "depth": with_depth,
    "two cameras": of_two_cameras,
    "5 Hz": slow,
}
SETTINGS = {
    "default": CONFIG,
    "without the network": replace(CONFIG, depth_prior=False),
    "unknown height": replace(CONFIG, height=0.0),
}


@needs_kernel
@pytest.mark.parametrize(
    "sequence, settings",
    [
        *((sequence, "default") for sequence in SEQUENCES),
        ("gaps and swaps", "without the network"),
        ("depth", "unknown height"),
        ("two cameras", "unknown height"),
    ],
)
def test_kernel_and_python_give_the_same_answers(sequence, settings):
    frames, trackers = SEQUENCES[sequence](), [Tracker(SETTINGS[settings]) for _ in range(2)]
    reset_at = len(frames) // 2
    accepted = 0
    for number, seen in enumerate(frames):
        answers = []
        for tracker, active in zip(trackers, (False, True)):
            with kernel.switched(active):
                if number == reset_at:
                    tracker.reset()
                answers.append(tracker.track(seen))
        plain, fast = answers
        assert plain.rejection == fast.rejection and plain.initialised == fast.initialised
        if plain.accepted:
            accepted += 1
            assert np.abs(plain.pose.positions - fast.pose.positions).max() < LARGEST_DIFFERENCE
            assert np.array_equal(plain.visible, fast.visible) and fast.certificate.kkt_residual < 1e-6
            assert fast.cost == pytest.approx(plain.cost, rel=1e-4, abs=1e-4)
    assert accepted > 0.8 * len(frames)


# It is used -----------------------------------------------------------------------------------------------------------


@needs_kernel
def test_a_tracked_frame_uses_each_function(monkeypatch):
    done, refused = Counter(), Counter()
    for name in FUNCTIONS:

        def counted(*arguments, name=name, function=getattr(kernel, name)):
            found = function(*arguments)
            (done if found else refused)[name] += 1
            return found

        monkeypatch.setattr(kernel, name, counted)
    tracker = Tracker(CONFIG)
    frames = [seen for _, seen in observations(tracker, 3.0)]
    with kernel.switched(True):
        for seen in frames:
            tracker.track(seen)
    for name in FUNCTIONS:
        assert done[name] > 0.9 * len(frames), name
        assert refused[name] < 0.1 * done[name], name


def test_the_environment_switches_it_off():
    code = "from lassokin_ros.core.kernel import kernel; print(kernel.active)"
    environment = {**os.environ, module.SWITCH: "0", "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_a_kernel_of_another_revision_is_not_used_and_told():
    """Git ignores it, so that it stays when the sources change."""
    code = (
        "import sys, types; sys.modules['lassokin_ros.core._kernel'] = types.ModuleType('old');"
        "from lassokin_ros import Tracker; from lassokin_ros.core.kernel import kernel; print(kernel.active)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False" and "build it again with `python setup.py" in done.stderr


# What it does not treat -----------------------------------------------------------------------------------------------

FUZZ = """
import sys
sys.path[:0] = [{folder!r}]
import numpy as np
import _kernel
names = [name for name in dir(_kernel) if not name.startswith("__")]
random = np.random.default_rng({seed})
kinds = (float, float, float, float, np.int64, np.float32, bool, np.int32, complex)
def number():
    return random.choice([0.0, 1.0, -1.0, np.nan, np.inf, -np.inf, 1e300, 1e-300, 0.5, 3.0])
def array(depth=0):
    choice = random.integers(14)
    if choice == 0:
        return random.choice([None, 3, 2.5, "text", b"12345678"])
    if choice == 1 and depth < 2:
        return tuple(array(depth + 1) for _ in range(random.choice([0, 3, 6, 9, 10])))
    shape = [int(random.choice([0, 1, 2, 3, 4, 9, 24, 44, 47])) for _ in range(random.integers(1, 4))]
    found = np.ones(shape) * number() if random.random() < 0.3 else random.normal(size=shape) * 10
    with np.errstate(all="ignore"):
        found = found.astype(random.choice(kinds))
    if choice == 2:
        found = found.T
    if choice == 3:
        found = found[::-1]
    if choice == 4:
        found.flags.writeable = False
    return found
for case in range({cases}):
    function = getattr(_kernel, names[random.integers(len(names))])
    assert function(*[array() for _ in range(random.integers(12))]) in (True, False)
"""


@needs_kernel
def test_any_other_arguments_are_refused():
    """No exception, and the process lives."""
    folder = str(Path(compiled.__file__).parent)
    code = FUZZ.format(folder=folder, seed=0, cases=3_000)
    done = subprocess.run([sys.executable, "-W", "ignore", "-c", code], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[-2000:]


DRIVE = """
import sys
sys.path[:0] = [{support!r}, {root!r}, {tests!r}]
import lassokin_ros.core
lassokin_ros.core.__path__.insert(0, {folder!r})
from lassokin_ros.core.kernel import compiled, kernel
assert compiled.__file__.startswith({folder!r}) and kernel.active
from test_kernel import CONFIG, SEQUENCES, Tracker, replace
for name, sequence in SEQUENCES.items():
    for config in (CONFIG, replace(CONFIG, depth_prior=False)):
        tracker = Tracker(config)
        for seen in sequence()[:12]:
            tracker.track(seen)
"""


@needs_kernel
def test_sanitizers_find_nothing(tmp_path):
    """The kernel, built for the address and undefined-behaviour sanitizers, tracks and is given wrong arguments."""
    compiler = shutil.which("gcc")
    asked = [compiler, "-print-file-name=libasan.so"]
    runtime = compiler and subprocess.run(asked, capture_output=True, text=True, check=True).stdout.strip()
    if not (runtime and Path(runtime).is_file()):
        pytest.skip("gcc with its address sanitizer is not installed")
    target = tmp_path / Path(compiled.__file__).name
    checks = ["-fsanitize=address,undefined", "-fno-sanitize-recover=undefined", "-g", "-O1", "-std=c11"]
    source, include = ROOT / "lassokin_ros" / "core" / "_kernel.c", sysconfig.get_path("include")
    warnings = ["-Wall", "-Wextra", "-Werror", "-shared", "-fPIC"]
    subprocess.run([compiler, *checks, *warnings, f"-I{include}", source, "-o", target, "-lm"], check=True)
    settings = {module.SWITCH: "1", "LD_PRELOAD": runtime, "ASAN_OPTIONS": "detect_leaks=0", "OMP_NUM_THREADS": "1"}
    environment = {**os.environ, **settings}
    places = {"support": str(ROOT / "test/support"), "root": str(ROOT), "tests": str(ROOT / "test/core")}
    for code in (DRIVE.format(folder=str(tmp_path), **places), FUZZ.format(folder=str(tmp_path), seed=9, cases=2_000)):
        done = subprocess.run(
            [sys.executable, "-W", "ignore", "-c", code], env=environment, capture_output=True, text=True, timeout=600
        )
        assert done.returncode == 0, done.stderr[-3000:]


# How it is built ------------------------------------------------------------------------------------------------------


def test_without_a_compiler_the_package_builds_without_the_kernel(tmp_path):
    environment = {**os.environ, "CC": "/bin/false"}
    folders = ["--build-lib", tmp_path / "lib", "--build-temp", tmp_path / "temp"]
    command = [sys.executable, "setup.py", "-q", "build_ext", *folders]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert not list((tmp_path / "lib").rglob("_kernel*")) and "_kernel" in done.stderr  # it is said
