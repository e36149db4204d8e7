"""Tables and errors on the terminal, records in a JSON file, and where the shared data is."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any, Callable, Mapping, Sequence

import numpy as np

from lassokin_ros.common.command_line import missing_package
from lassokin_ros.core.errors import LassokinError

Record = dict[str, Any]


def data_folder() -> Path:
    """The shared data (mocap/, detections/): LASSOKIN_DATA, or ../shared/data beside the repository; may not exist."""
    default = Path(__file__).resolve().parents[3] / "shared" / "data"
    return Path(os.environ.get("LASSOKIN_DATA", default))


def table(rows: Sequence[Mapping[str, Any]], columns: Mapping[str, str]) -> str:
    """Text table: a column per key of `columns`, whose value is the format ("8.1f"; a bare width or "<12" for text)."""
    lines = [[_cell(row.get(key), form) for key, form in columns.items()] for row in rows]
    widths = [max(len(key), *(len(line[i]) for line in lines), 0) for i, key in enumerate(columns)]
    left = [form.startswith("<") for form in columns.values()]
    everything = [list(columns), ["-" * width for width in widths], *lines]
    padded = (
        [cell.ljust(width) if text else cell.rjust(width) for cell, width, text in zip(line, widths, left)]
        for line in everything
    )
    return "\n".join("  ".join(line).rstrip() for line in padded)


def _cell(value: Any, form: str) -> str:
    if value is None or (isinstance(value, float) and not np.isfinite(value)):
        return "-"
    return format(value, form).strip() if not isinstance(value, str) else value


def summarise(records: Sequence[Record], by: Sequence[str], figures: Sequence[str]) -> list[Record]:
    """One row per combination of values of `by` and statistic (median, mean) over its records, NaN left out."""
    rows = []
    for values in dict.fromkeys(tuple(record[key] for key in by) for record in records):
        group = [record for record in records if tuple(record[key] for key in by) == values]
        for name, statistic in (("median", np.nanmedian), ("mean", np.nanmean)):
            row: Record = {**dict(zip(by, values)), "statistic": name, "runs": len(group)}
            for figure in figures:
                column = np.array([record[figure] for record in group], dtype=float)
                row[figure] = float(statistic(column)) if np.isfinite(column).any() else float("nan")
            rows.append(row)
    return rows


def write_json(path: Path | None, records: Sequence[Record]) -> None:
    """Write the records as a JSON list, NaN as null. Nothing is written if `path` is None."""
    if path is None:
        return
    clean = [{key: _plain(value) for key, value in record.items()} for record in records]
    try:
        path.write_text(json.dumps(clean, indent=1) + "\n", encoding="utf-8")
    except OSError as error:
        raise SystemExit(f"cannot write {path}: {error.strerror}; expected a file that can be written") from None


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not np.isfinite(value) else value


def exit_code(command: Callable[[], int | None]) -> int:
    """Exit code of a script: that of `command`, or 2 after one line with the reason."""
    try:
        return command() or 0
    except LassokinError as error:
        why = str(error)
    except ModuleNotFoundError as error:
        why = missing_package(error)
    except SystemExit as end:
        # argparse uses code 2 for usage errors. A SystemExit with a text would end with code 1, as a traceback does.
        if not isinstance(end.code, str):
            raise
        why = end.code
    print(f"{Path(sys.argv[0]).name}: {why}", file=sys.stderr)
    return 2
