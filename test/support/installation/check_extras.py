"""Install each optional part beside `.[replay]`, each in a fresh environment, and use it; see CONTRIBUTING.md.

    python test/support/installation/check_extras.py VIDEO [--model pose.onnx] [--only onnx]

A part fails if pip prints an error line, if `pip check` finds a conflict, if numpy and OpenCV do not work together, or
if `lassokin track` does not track a person in VIDEO. Downloads about 400 MB; the environments are removed at the end.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import venv
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).resolve().parents[3]
PARTS = ("mediapipe", "onnx", "view", "mediapipe,onnx,view", "mediapipe+view")
"""Extras of one call of pip; after a plus those of a further call."""
USE = """if True:
    import cv2, numpy
    image = numpy.random.default_rng(0).integers(0, 255, (48, 64, 3), dtype=numpy.uint8)
    assert numpy.array_equal(cv2.imdecode(cv2.imencode(".png", image)[1], cv2.IMREAD_COLOR), image)
    assert numpy.isclose(numpy.linalg.inv(numpy.diag([2.0, 4.0])).sum(), 0.75)
    print(f"numpy {numpy.__version__}, OpenCV {cv2.__version__}", end="")
"""


def main() -> int:
    """Check the parts and print one line for each; the exit code is 1 if one fails."""
    options = _parser().parse_args()
    failed = 0
    for extras in [options.only] if options.only else PARTS:
        with TemporaryDirectory(prefix="lassokin_extras_") as folder:
            problem, said = check(extras, Path(folder), options.video.resolve(), options.model)
        failed += bool(problem)
        print(f"{extras:<20} {'FAILED: ' + problem if problem else 'good'}; {said}", flush=True)
    return 1 if failed else 0


def check(extras: str, folder: Path, video: Path, model: Path | None) -> tuple[str, str]:
    """Install extras in an environment in the folder and use them. Return the problem, if any, and what was printed."""
    venv.create(folder / "venv", with_pip=True)
    python = str(folder / "venv" / "bin" / "python")
    for wanted in ("replay", *extras.split("+")):
        done = _run([python, "-m", "pip", "install", "--disable-pip-version-check", f"{ROOT}[{wanted}]"], folder)
        errors = [line for line in done.stderr.splitlines() if line.startswith("ERROR")]
        if done.returncode or errors:
            return "pip install", "; ".join(errors) or done.stderr[-300:]
    for name, arguments in (("pip check", ["-m", "pip", "check"]), ("numpy and OpenCV", ["-c", USE])):
        done = _run([python, *arguments], folder)
        if done.returncode:
            return name, (done.stdout + done.stderr)[-300:]
    versions = done.stdout
    detector = "mediapipe" if "mediapipe" in extras else model if "onnx" in extras else None
    if detector is None:
        return "", versions
    options = ["--height", "1.72", "--report", "r.html", "--video", "v.mp4", "--detector", str(detector)]
    options += ["--view", "view.rrd"] if "view" in extras else []
    done = _run([python, "-m", "lassokin_ros.cli.lassokin", "track", str(video), *options], folder)
    images = next((line for line in done.stdout.splitlines() if line.startswith("images")), "no summary")
    if done.returncode or " 0 tracked" in images:
        return "lassokin track", (images + " " + done.stderr)[-300:]
    return "", f"{versions}, {' '.join(images.split())}"


def _run(command: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def _parser() -> argparse.ArgumentParser:
    result = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    result.add_argument("video", type=Path, metavar="VIDEO", help="a video of a person")
    result.add_argument(
        "--model", type=lambda name: Path(name).resolve(), help="an ONNX pose model, for the extra onnx"
    )
    result.add_argument("--only", metavar="EXTRAS", help=f"one part: {', '.join(PARTS)}")
    return result


if __name__ == "__main__":
    sys.exit(main())
