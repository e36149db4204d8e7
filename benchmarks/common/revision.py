"""Another revision of this repository, unpacked into a folder, with its compiled kernel if this tree has its own."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from lassokin_ros.core.kernel import kernel

ROOT = Path(__file__).resolve().parents[2]


def check_out(revision: str, folder: Path) -> str:
    """Unpack a revision into a new folder and return its short name. Raises SystemExit if there is none."""
    found = subprocess.run(
        ["git", "rev-parse", "--verify", "--short", f"{revision}^{{commit}}"],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if found.returncode:
        raise SystemExit(f"there is no revision '{revision}' in this repository; expected a commit, branch or tag")
    folder.mkdir()
    archive = subprocess.run(["git", "archive", revision], cwd=ROOT, capture_output=True, check=True)
    subprocess.run(["tar", "-x", "-C", str(folder)], input=archive.stdout, check=True)
    if kernel.active and (folder / "lassokin_ros" / "core" / "_kernel.c").is_file():
        build = [sys.executable, "setup.py", "-q", "build_ext", "--inplace"]
        subprocess.run(build, cwd=folder, capture_output=True, check=True)
    return found.stdout.strip()
