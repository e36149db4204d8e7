"""Another revision of this repository in a temporary folder, and a process that times frames with a revision's code."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

CHILD = Path(__file__).resolve().parent / "revision_child.py"


@contextmanager
def checked_out(root: Path, revision: str) -> Iterator[Path]:
    """A folder with the files of a revision, deleted afterwards. SystemExit if git does not have the revision."""
    archive = _git(root, revision, "archive", "--format=tar", f"{_commit(root, revision)}")
    with tempfile.TemporaryDirectory(prefix="lassokin_revision_") as folder:
        with tarfile.open(fileobj=io.BytesIO(archive)) as files:
            files.extractall(folder, filter="data")
        yield Path(folder)


def _commit(root: Path, revision: str) -> str:
    found = _git(root, revision, "rev-parse", "--verify", "--quiet", "--end-of-options", f"{revision}^{{commit}}")
    return found.decode().strip()


def _git(root: Path, revision: str, *arguments: str) -> bytes:
    try:
        return subprocess.run(["git", "-C", str(root), *arguments], check=True, capture_output=True).stdout
    except (OSError, subprocess.CalledProcessError) as error:
        raise SystemExit(
            f"'{revision}' is no revision that git finds in {root} ({error}); expected a commit, tag or branch"
        ) from None


class RevisionProcess:
    """A child process with the code in `root`, which times frames on request."""

    def __init__(self, root: Path, frames: Path, bodies: Path, domain: int) -> None:
        """frames: the npz file of `against.write_frames`; domain: the child's own ROS domain."""
        environment = {
            **os.environ, "PYTHONPATH": str(root), "PYTHONDONTWRITEBYTECODE": "1", "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1", "ROS_DOMAIN_ID": str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        }  # fmt: skip
        self._errors = tempfile.TemporaryFile("w+", encoding="utf-8")
        self._process = subprocess.Popen(
            [sys.executable, str(CHILD), str(frames), str(bodies)], cwd=root, env=environment, text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._errors,
        )  # fmt: skip

    def ask(self, figure: str, first: int, count: int) -> dict[str, Any]:
        """Times (s) of frames first to first + count, and the last one's joints. SystemExit if the child ended."""
        assert self._process.stdin is not None and self._process.stdout is not None
        try:
            print(json.dumps({"figure": figure, "first": first, "count": count}), file=self._process.stdin, flush=True)
        except BrokenPipeError:
            pass  # the empty answer says it
        line = self._process.stdout.readline()
        if not line:
            self._process.wait()
            self._errors.seek(0)
            last = (self._errors.read().strip().splitlines() or ["no message"])[-1]
            raise SystemExit(f"{figure} could not be timed in {self._process.args[1]}'s process: {last}")  # type: ignore[index]
        answer: dict[str, Any] = json.loads(line)
        return answer

    def close(self) -> None:
        """End the child."""
        assert self._process.stdin is not None and self._process.stdout is not None
        try:
            self._process.stdin.close()
            self._process.wait(timeout=20)
        except (BrokenPipeError, subprocess.TimeoutExpired):
            self._process.kill()
            self._process.wait()
        self._process.stdout.close()
        self._errors.close()
