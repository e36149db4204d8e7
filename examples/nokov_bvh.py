"""Rewrite a .bvh of --export with Nokov's names of joints, in cm, as GMR's reader of BVH expects it (format nokov).

python3 examples/nokov_bvh.py walk.bvh walk_nokov.bvh
"""

import re
import sys
from pathlib import Path

CM = 100.0
LIMBS = {
    **{"hip": "UpLeg", "knee": "Leg", "ankle": "Foot", "foot": "ToeBase"},
    **{"collar": "Shoulder", "shoulder": "Arm", "elbow": "ForeArm", "wrist": "Hand", "hand": "HandEnd"},
}
NAMES = {"pelvis": "Hips", "spine1": "Spine", "spine2": "Spine1", "spine3": "Spine2", "neck": "Neck", "head": "Head"}
NAMES |= {f"{side}_{ours}": side.title() + theirs for side in ("left", "right") for ours, theirs in LIMBS.items()}


def renamed(text: str) -> str:
    """Return the text of a BVH file with Nokov's names, lengths times 100. Joints of other names keep theirs."""
    head, _, motion = text.partition("MOTION\n")
    head = re.sub(r"(ROOT|JOINT) (\S+)", lambda found: f"{found[1]} {NAMES.get(found[2], found[2])}", head)
    head = re.sub(r"OFFSET (.*)", lambda found: "OFFSET " + _scaled(found[1].split()), head)
    frames, period, *rows = motion.splitlines()
    rows = [f"{_scaled(row.split()[:3])} {' '.join(row.split()[3:])}" for row in rows]
    return "\n".join([head + "MOTION", frames, period, *rows]) + "\n"


def _scaled(values: list[str]) -> str:
    return " ".join(f"{CM * float(value):.6f}" for value in values)


if __name__ == "__main__":
    source, target = map(Path, sys.argv[1:])
    target.write_text(renamed(source.read_text(encoding="utf-8")), encoding="utf-8")
