"""Coverage-guided fuzzing of one target with atheris; `run.py` starts one process of this for each.

python test/fuzz/guided.py "file bvh" CORPUS [options of libFuzzer]
"""

import sys
from pathlib import Path

import atheris

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "test" / "support")]

with atheris.instrument_imports(include=["msg_adapters", "lassokin_ros"]):
    from targets import TARGETS


def main() -> None:
    """Write the seeds into the corpus, then fuzz until libFuzzer ends the process."""
    name, corpus, *options = sys.argv[1:]
    target = TARGETS[name]
    for number, seed in enumerate(target.seeds()):
        (Path(corpus) / f"seed{number}").write_bytes(seed)
    atheris.Setup([sys.argv[0], corpus, *options], target.run)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
