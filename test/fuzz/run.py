"""Fuzz decoders and file readers, guided by coverage; a table of what was run, exit code 1 if there are faults.

    python test/fuzz/run.py [--seconds 60] [--only message|file|bag|NAME] [--corpus DIR]

Each target runs in a process of its own for --seconds. The corpus grows in DIR from run to run; an input that finds a
fault is written there as crash-*, oom-* or timeout-*.
"""

import argparse
import re
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parents[1]), str(HERE.parent / "support")]

from targets import TARGETS  # noqa: E402

from benchmarks.common.report import table  # noqa: E402

OPTIONS = ["-timeout=20", "-rss_limit_mb=2048", "-print_final_stats=1"]
COLUMNS = {"target": "<", "inputs": "", "coverage": "", "corpus": "", "fault": "<"}
FAULTS = ("crash-", "oom-", "timeout-", "leak-")


def main() -> int:
    """Command line; the exit code."""
    options = parser().parse_args()
    if find_spec("atheris") is None:
        print("guided fuzzing is left out: it needs atheris, which has wheels for Linux on x86-64: pip install atheris")
        return 0
    names = [name for name in TARGETS if not options.only or name.startswith(tuple(options.only))]
    if not names:
        raise SystemExit(f"--only names none of: {', '.join(TARGETS)}")
    with tempfile.TemporaryDirectory(prefix="lassokin_corpus_") as temporary:
        root = options.corpus or Path(temporary)
        records = [fuzz(name, root.resolve() / name.replace(" ", "_"), options.seconds) for name in names]
    print(table(records, COLUMNS))
    return int(any(record["fault"] for record in records))


def parser() -> argparse.ArgumentParser:
    """Its options."""
    result = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    result.add_argument("--seconds", type=int, default=60, help="for each target")
    result.add_argument("--only", action="append", help="beginning of the targets' names; may be repeated")
    result.add_argument("--corpus", type=Path, help="folder in which the inputs are kept")
    return result


def fuzz(name: str, place: Path, seconds: int) -> dict[str, object]:
    """One target: its row of the table."""
    corpus = place / "corpus"
    corpus.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, str(HERE / "guided.py"), name, str(corpus), *OPTIONS]
    command += [f"-max_total_time={seconds}", f"-artifact_prefix={place}/"]
    print(f"{name}: {seconds} s", file=sys.stderr, flush=True)
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, cwd=place)
    log = done.stdout.decode(errors="replace")
    (place / "log.txt").write_text(log)
    faults = sorted(file.name for file in place.iterdir() if file.name.startswith(FAULTS))
    if done.returncode and not faults:
        faults = [f"exit code {done.returncode}, see log.txt"]
    if faults:
        print("\n".join(log.splitlines()[-60:]), file=sys.stderr, flush=True)
    statuses = re.findall(r"^#(\d+)\s.*cov: (\d+) ft", log, re.MULTILINE)
    inputs, coverage = statuses[-1] if statuses else ("0", "0")
    return {
        "target": name,
        "inputs": int(inputs),
        "coverage": int(coverage),
        "corpus": sum(1 for _ in corpus.iterdir()),
        "fault": ", ".join(faults),
    }


if __name__ == "__main__":
    sys.exit(main())
