"""Arrays in a temporary file are read back unchanged, one by one and as columns."""

import errno
from types import SimpleNamespace

import numpy as np
import pytest

from lassokin_ros.common.array_spool import ArraySpool, SpoolError


def records(spool, count):
    random = np.random.default_rng(0)
    given = [{"places": random.normal(size=(4, 3)), "count": np.asarray(number)} for number in range(count)]
    return given, [spool.append(arrays) for arrays in given]


def test_arrays_are_read_back_one_by_one():
    spool = ArraySpool()
    given, stored = records(spool, 3)
    strided = spool.append({"places": np.arange(24.0).reshape(6, 4)[::2]})
    for arrays, record in zip(given, stored):
        found = spool.read(record)
        assert set(found) == set(arrays) and all(np.array_equal(found[name], arrays[name]) for name in found)
    assert spool.read(spool.append({})) == {}
    assert np.array_equal(spool.read(strided)["places"], np.arange(24.0).reshape(6, 4)[::2])


@pytest.mark.parametrize("wanted", [slice(None), slice(1, 4)])
def test_columns_contain_all_or_some_records(wanted):
    spool = ArraySpool()
    given, stored = records(spool, 5)
    columns = spool.columns(stored[wanted])
    assert np.array_equal(columns["places"], [arrays["places"] for arrays in given[wanted]])
    assert columns["count"].tolist() == list(range(5))[wanted]


def test_records_with_other_arrays_have_no_columns():
    spool = ArraySpool()
    _, stored = records(spool, 2)
    with pytest.raises(ValueError, match="several layouts"):
        spool.columns([*stored, spool.append({})])


def test_a_full_disk_is_reported_with_advice(monkeypatch):
    spool = ArraySpool()

    def full():
        raise OSError(errno.ENOSPC, "No space left on device")

    record = spool.append({"places": np.zeros(3)})
    monkeypatch.setattr(spool, "_file", SimpleNamespace(flush=full, fileno=lambda: 0))
    with pytest.raises(SpoolError, match="No space left on device; .* TMPDIR"):
        spool.read(record)
