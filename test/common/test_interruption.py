"""Interruption: a signal ends the running code anywhere, and cleaning up is completed."""

import os
import signal
import subprocess
import sys
import time
import weakref
from contextlib import closing

import pytest

from lassokin_ros.common.interruption import REPEAT_S, Interrupted, interruptible, uninterrupted

CLEANING_S = 4 * REPEAT_S


def interrupt_this_process(*_):
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(0)  # a point where Python handles signals


class Dying:
    """Its destructor is interrupted; Python drops exceptions there."""

    def __del__(self):
        interrupt_this_process()


def lose_in_destructor():
    Dying()


def lose_in_weak_callback():
    class Referent:
        pass

    referent = Referent()
    kept = weakref.ref(referent, interrupt_this_process)
    del referent
    assert kept() is None


def swallow():
    try:
        interrupt_this_process()
    except BaseException:
        pass


def wait(seconds):
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        time.sleep(0.001)


@pytest.mark.parametrize("lose", [lose_in_destructor, lose_in_weak_callback, swallow])
def test_a_lost_interruption_is_repeated(lose, monkeypatch):
    told = []
    monkeypatch.setattr(sys, "unraisablehook", told.append)
    with pytest.raises(Interrupted), interruptible():
        lose()
        wait(10)
        raise AssertionError("went on")
    assert sys.unraisablehook == told.append
    assert told == []


def cleaned_in_generator(done):
    try:
        yield
    finally:
        wait(CLEANING_S)
        done.append("generator")


def test_cleaning_up_is_completed():
    done = []
    with pytest.raises(Interrupted, match="half"), interruptible():
        with closing(cleaned_in_generator(done)) as generator:
            next(generator)
            try:
                interrupt_this_process()
            except Interrupted:
                try:
                    raise ValueError
                except ValueError:
                    wait(CLEANING_S)
                    done.append("nested")
                raise Interrupted("half") from None
            finally:
                wait(CLEANING_S)
                done.append("finally")
    assert done == ["nested", "finally", "generator"]


def test_a_protected_block_is_completed_first():
    done = []
    with pytest.raises(Interrupted), interruptible():
        with uninterrupted():
            interrupt_this_process()
            interrupt_this_process()
            done.append("step")
        done.append("after")
    assert done == ["step"]


def test_handlers_and_timer_are_restored():
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)
    before = [signal.getsignal(number) for number in numbers]
    with pytest.raises(Interrupted), interruptible():
        interrupt_this_process()
        wait(10)
    assert [signal.getsignal(number) for number in numbers] == before
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


def test_a_second_signal_does_not_stop_cleaning_up():
    code = (
        "import os, signal, time\n"
        "from lassokin_ros.common.interruption import Interrupted, interruptible\n"
        "try:\n"
        "    with interruptible():\n"
        "        try:\n"
        "            os.kill(os.getpid(), signal.SIGTERM)\n"
        "            time.sleep(10)\n"
        "        finally:\n"
        "            os.kill(os.getpid(), signal.SIGINT)\n"
        "            time.sleep(0.2)\n"
        "            print('cleaned')\n"
        "except Interrupted as interrupted:\n"
        "    print(interrupted)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "cleaned\nnothing was written\n", "")
