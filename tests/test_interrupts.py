"""Signals that end a computation in order."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

COMPILE = """
import os, sys, threading, time
import numba
from farpoint.interrupts import interruptible

@numba.njit
def inverse(a):
    return a @ a @ a if a.size > 9 else a + a.T

def compile_function():
    inverse(np.eye(3))
    time.sleep(60.0)

import numpy as np

with interruptible():
    # Once the compiler is at work, as a look at the frames of this thread shows.
    def signal_when_compiling():
        main = threading.main_thread().ident
        while True:
            frame = sys._current_frames()[main]
            while frame is not None:
                if frame.f_code.co_name == "type_inference_stage":
                    os.kill(os.getpid(), NUMBER)
                    return
                frame = frame.f_back
            time.sleep(0.001)

    threading.Thread(target=signal_when_compiling, daemon=True).start()
    try:
        compile_function()
    except KeyboardInterrupt:
        print("interrupted with", len(inverse.signatures), "compiled", flush=True)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_during_a_compilation_waits_for_its_end(number: signal.Signals):
    code, out, errors = run(COMPILE.replace("NUMBER", str(int(number))), number)
    # The signal may come at once after the compilation, in the middle of any output.
    assert (code, out) == (0, "interrupted with 1 compiled\n"), errors


DESTROY = """
import os, signal, time
from farpoint.interrupts import interruptible

class Slow:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(1.0)
        print("never", flush=True)

def destroy():
    slow = Slow()
    del slow
    time.sleep(60.0)

with interruptible():
    try:
        destroy()
    except KeyboardInterrupt:
        print("interrupted", flush=True)
"""


def run(script: str, number: signal.Signals = signal.SIGINT) -> tuple[int, str, str]:
    """Exit code and both streams of a script that does not ignore the signal from the start."""
    done = subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True,
        text=True,
        timeout=120,
        preexec_fn=lambda: signal.signal(number, signal.SIG_DFL),
    )
    return done.returncode, done.stdout, done.stderr


def test_a_signal_that_is_lost_in_a_destructor_is_sent_once_more():
    assert run(DESTROY) == (0, "interrupted\n", "")


AT_THE_END = """
import os, signal, threading
from farpoint import interrupts

interrupts._AGAIN_S = 1.0
interrupts._COMPILERS = ("__main__",)
try:
    with interrupts.interruptible():
        os.kill(os.getpid(), signal.SIGINT)
        interrupts._COMPILERS = ()
        print("finished", flush=True)
except KeyboardInterrupt:
    print("interrupted", flush=True)
print("goes on", flush=True)
"""


def test_a_signal_that_waits_at_the_end_interrupts_in_order():
    assert run(AT_THE_END) == (0, "finished\ninterrupted\ngoes on\n", "")
