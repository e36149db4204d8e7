"""The commands and code of the documentation run as written; its links lead to existing files and names."""

import ast
import os
import pickle
import re
import signal
import subprocess
import sys
import tempfile
import textwrap
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from forked import Forked, ForkedCommands
from scipy import sparse

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.skeleton_readers.load import load_skeleton

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = ["README.md", *sorted(page.name for page in DOCS.glob("*.md") if page.name != "README.md")]
"""In the order in which they run; the first page makes the recording that the others use."""
OTHER_MACHINES = re.compile(r"\$ (ros2 |colcon |rviz2|source |sudo apt |export ROS_|dask |lassokin .* --scheduler )")
MOST_ON_OTHER_MACHINES = 40
"""Largest number of commands, in all pages, that are not run here."""


@dataclass(frozen=True)
class Block:
    """A fenced block of a page; line: of its fence."""

    page: str
    line: int
    language: str
    text: str

    @property
    def place(self):
        return f"docs/{self.page}:{self.line}"


def blocks(page):
    """Every fenced block of a page; those in a list are indented."""
    text = (DOCS / page).read_text(encoding="utf-8")
    for found in re.finditer(r"^( *)```(\w*)\n(.*?)^\1```$", text, re.DOTALL | re.MULTILINE):
        indent, language, body = found.groups()
        line = text.count("\n", 0, found.start()) + 1
        yield Block(page, line, language, re.sub(f"^{indent}", "", body, flags=re.MULTILINE))


def test_every_block_is_run_or_marked_as_not_run():
    languages = {block.language for page in PAGES for block in blocks(page)}
    assert languages <= {"sh", "python", "console", "text", "math", "yaml", "cpp", "mermaid"}, languages
    lines = [
        (block.place, line)
        for page in PAGES
        for block in blocks(page)
        if block.language == "console"
        for line in block.text.splitlines()
        if line
    ]
    assert all(OTHER_MACHINES.match(line) for _, line in lines), lines
    assert 0 < len(lines) <= MOST_ON_OTHER_MACHINES


@pytest.fixture(scope="module")
def workplace(tmp_path_factory):
    """A folder that looks like the repository after `make test`, for the files that the pages write."""
    for module in ("rclpy", "rosbags", "matplotlib"):
        pytest.importorskip(module, reason=f"{module} is needed by what the pages show")
    environment = Path(sys.prefix)
    if not (environment / "bin" / "activate").is_file():
        pytest.skip("the pages begin with a virtual environment's activate, and this Python has none")
    folder = tmp_path_factory.mktemp("repository")
    for entry in ("benchmarks", "config", "launch", "docs", "lassokin_ros", "msg_adapters", "README.md", "setup.py"):
        (folder / entry).symlink_to(ROOT / entry)
    (folder / ".venv").symlink_to(environment)
    path = os.pathsep.join([str(environment / "bin"), os.environ["PATH"]])
    python = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    variables = {**os.environ, "PATH": path, "PYTHONPATH": python, "MPLBACKEND": "Agg"}
    with ForkedCommands(variables, tmp_path_factory.mktemp("commands") / "socket") as environment:
        yield folder, environment


def run(block, command, workplace):
    folder, environment = workplace
    with tempfile.TemporaryFile("w+") as said:  # no pipe: reading it would wait for background processes
        process = subprocess.Popen(
            command, cwd=folder, env=environment, start_new_session=True, stdout=said, stderr=subprocess.STDOUT
        )
        try:
            code = process.wait(timeout=120)
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
        said.seek(0)
        assert code == 0, f"{block.place} ends with {code}:\n{block.text}\n{said.read()}"


@pytest.mark.parametrize("page", PAGES)
def test_every_command_of_a_page_runs(page, workplace):
    """Run commands and Python in the page's order.

    The Python blocks of a page are one program, which is run before a command that reads its output.
    """
    pending = []
    found = list(blocks(page))
    if page != PAGES[0] and not (workplace[0] / "walk").exists():
        run_python([block for block in blocks(PAGES[0]) if block.language == "python"], workplace)
    for block in found:
        if block.language == "python":
            pending.append(block)
        elif block.language == "sh":
            run_python(pending, workplace)
            run(block, ["bash", "-e", "-u", "-o", "pipefail", "-c", block.text], workplace)
    run_python(pending, workplace)


def run_python(pending, workplace):
    """Run Python blocks as one program, and forget them."""
    if pending:
        program, (folder, environment) = "\n".join(block.text for block in pending), workplace
        command = [sys.executable, "-c", program]
        process = Forked(command, folder, environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        said, _ = process.communicate(timeout=120)
        assert process.returncode == 0, f"{pending[0].place} ends with {process.returncode}:\n{program}\n{said}"
        pending.clear()


def test_the_recipe_for_smpls_files_makes_a_skeleton(tmp_path):
    """With a pickle in SMPL's form that contains no model: each joint is the mean of two vertices."""
    (recipe,) = re.findall(r"\n\n((?:    .*\n|\n)+)", (DOCS / "files.md").read_text(encoding="utf-8"))
    ours = Skeleton.load("anthropometric", 1.7)
    joints = ours.rest_positions
    vertices = np.concatenate([joints - 0.03, joints + 0.03])
    regressor = sparse.csc_matrix(np.hstack([np.eye(24), np.eye(24)]) / 2)
    model = {"J_regressor": regressor, "v_template": vertices, "shapedirs": np.zeros((48, 3, 10)), "f": None}
    (tmp_path / "SMPL_NEUTRAL.pkl").write_bytes(pickle.dumps(model))
    subprocess.run([sys.executable, "-c", textwrap.dedent(recipe)], cwd=tmp_path, check=True, timeout=120)
    skeleton = load_skeleton(str(tmp_path / "smpl.npz"), 1.75)
    assert np.abs(skeleton.offsets - ours.offsets).max() < 1e-9


LINK = re.compile(r"!?\[([^\]]*)\]\(([^)\s]+)\)")


def links(page):
    """(text, path, anchor) of every link into the repository."""
    for text, target in LINK.findall((DOCS / page).read_text(encoding="utf-8")):
        if "://" not in target:
            path, _, anchor = target.partition("#")
            yield text, ((DOCS / page).parent / path).resolve() if path else DOCS / page, anchor


@pytest.mark.parametrize("page", [*PAGES, "../README.md", "../CONTRIBUTING.md"])
def test_every_link_leads_somewhere(page):
    for text, path, anchor in links(page):
        assert path.exists(), f"docs/{page}: {path} is not there"
        assert path.is_relative_to(ROOT)
        if anchor:
            assert anchor in headings(path), f"docs/{page}: {path.name} has no heading #{anchor}"
        name = text.strip("`")
        if path.suffix == ".py" and text.startswith("`") and "/" not in name:
            assert name in names_in(path), f"docs/{page}: {path.name} has no {name}"


FOLDERS = "lassokin_ros|msg_adapters|benchmarks|training|test|launch|config|examples"


def test_every_file_that_a_page_names_exists():
    """By its whole path, as in `benchmarks/gait.py`."""
    for page in (*PAGES, "../README.md", "../CONTRIBUTING.md"):
        named = re.findall(rf"`((?:{FOLDERS})/[\w/.-]+\.\w+)[`:]", (DOCS / page).read_text(encoding="utf-8"))
        assert not [p for p in named if not ((ROOT / p).is_file() or (ROOT / "test" / p).is_file())], page


@lru_cache
def headings(path):
    """Anchors of a page, as GitHub makes them."""
    lines = re.findall(r"^#+ (.*)$", path.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", line.lower()).replace(" ", "-") for line in lines}


@lru_cache
def names_in(path):
    """Functions, classes, methods (as Class.method) and constants that a module defines."""
    names = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            names.add(node.name)
        if isinstance(node, ast.ClassDef):
            names |= {f"{node.name}.{item.name}" for item in node.body if isinstance(item, ast.FunctionDef)}
        if isinstance(node, ast.Assign):
            names |= {target.id for target in node.targets if isinstance(target, ast.Name)}
    return names


def test_the_method_names_every_equation_and_its_code():
    page = (DOCS / "method.md").read_text(encoding="utf-8")
    named = {int(number) for number in re.findall(r"\((\d+)\)", page)}
    for first, last in re.findall(r"\((\d+)\)\\text\{-\}\((\d+)\)", page):
        named |= set(range(int(first), int(last)))
    assert set(range(1, 16)) <= named
    linked = {path.name for _, path, _ in links("method.md")}
    expected = {"kinematics.py", "projection.py", "problem.py", "solver.py", "certificate.py"}
    assert expected <= linked


def test_every_reason_for_a_rejection_is_in_the_troubleshooting():
    from lassokin_ros.pipeline.concerns.rejections import REASONS

    page = (DOCS / "troubleshooting.md").read_text(encoding="utf-8")
    assert not [reason for reason in REASONS if f"`{reason}`" not in page]


def arguments_of(launch_file):
    """Names of the arguments of a launch file, which cannot be imported without ROS."""
    tree = ast.parse((ROOT / "launch" / launch_file).read_text(encoding="utf-8"))
    tables = {ast.unparse(node.targets[0]): node.value for node in tree.body if isinstance(node, ast.Assign)}
    return {key.value for name in ("ARGUMENTS", "PARAMETERS") if name in tables for key in tables[name].keys if key}


def test_launch_arguments_are_those_of_the_launch_file():
    page = (DOCS / "reference.md").read_text(encoding="utf-8")
    (listed,) = re.findall(r"lists the arguments with their defaults: (.*?)\.\n\n", page, re.DOTALL)
    (files,) = re.findall(r" \(a file, or one of\s(.*?)\)", listed, re.DOTALL)
    assert set(re.findall(r"`(\w+)`", listed)) - set(re.findall(r"`(\w+)`", files)) == arguments_of("tracker.launch.py")
    assert set(re.findall(r"`(\w+)`", files)) == {path.stem for path in (ROOT / "config").glob("*.yaml")}


def test_the_distance_of_keypoints_that_fit_no_body_is_that_of_the_diagnostics():
    from lassokin_ros.pipeline.concerns.live import NO_BODY

    page = (DOCS / "troubleshooting.md").read_text(encoding="utf-8")
    (percent,) = re.findall(r'"off the best body" if they are off by (\d+) % of the height', page)
    assert int(percent) == round(100 * NO_BODY)


def test_figures_are_small_and_shown():
    suffixes = {".png", ".svg", ".webp"}
    shown = {path for page in PAGES for _, path, _ in links(page) if path.suffix in suffixes}
    figures = set((DOCS / "figures").iterdir())
    assert figures and figures <= shown
    for figure in figures:
        assert figure.stat().st_size < 100_000, figure


def test_extras_are_installed_from_the_repository():
    """The package is not on PyPI."""
    files = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *DOCS.glob("*.md"), *ROOT.glob("lassokin_ros/**/*.py")]
    assert not [file for file in files if "lassokin_ros[" in file.read_text(encoding="utf-8")]


def test_every_parameter_is_in_the_tuning_guide():
    from lassokin_ros.pipeline.parameter_files import all_settings

    text = "".join((DOCS / page).read_text(encoding="utf-8") for page in PAGES)
    missing = [item.name for item in all_settings() if f"`{item.name}" not in text and f"{item.name}:=" not in text]
    assert not missing


def test_inline_mathematics_is_on_one_line():
    """The renderer shows a formula that is broken over lines as text."""
    for page in PAGES:
        text = re.sub(r"```.*?```|`[^`\n]*`", "", (DOCS / page).read_text(encoding="utf-8"), flags=re.DOTALL)
        assert not [line for line in text.splitlines() if line.count("$") % 2], page
