"""The plotly.js of the report's page: npm's file as CONTRIBUTING.md states it, which nobody edits."""

import hashlib
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
REPORT = ROOT / "lassokin_ros" / "replay" / "report"
PLOTLY = (REPORT / "plotly-gl3d.min.js").read_bytes()
STATED = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")


def test_version_and_content_are_the_stated_ones():
    (version,) = re.findall(rb"plotly\.js \(gl3d - minified\) v([\d.]+)", PLOTLY)
    assert set(re.findall(r"plotly\.js-gl3d-dist-min[@ ]([\d.]+\d)", STATED)) == {version.decode()}
    assert re.findall(r"SHA-256 `(\w+)`", STATED) == [hashlib.sha256(PLOTLY).hexdigest()]


def test_its_licence_is_beside_it():
    licence = (REPORT / "plotly-gl3d.LICENSE").read_text(encoding="utf-8")
    assert licence.startswith("MIT License") and "Plotly" in licence and "shall be included in" in licence


def test_it_can_stand_in_a_script_element():
    """It does not end the element, and opens nothing in it that hides the end."""
    assert len(PLOTLY) > 1_000_000 and not re.search(rb"</script|<script|<!--", PLOTLY, re.IGNORECASE)
