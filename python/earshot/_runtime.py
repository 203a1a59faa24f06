# SPDX-License-Identifier: Apache-2.0
"""Forks wait for what the engine does, so that no lock of it is held for ever in the child; so does the end of the process."""

from __future__ import annotations

import atexit
import os
import signal
import sys
import traceback

from . import _engine

PATIENCE_S = 60.0


def _at_exit() -> None:
    # After an unhandled Ctrl-C the process ends by the signal, past what would take memory from under a call.
    if getattr(sys, "last_type", None) is KeyboardInterrupt and not hasattr(sys, "ps1"):
        return
    try:
        # A stub of the engine, from which the documentation is made, says nothing.
        if _engine.wait_until_idle(PATIENCE_S) is not False:
            return
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        _flush()
        os.kill(os.getpid(), signal.SIGINT)
    except BaseException:  # of another signal handler
        traceback.print_exc()
    _flush()
    os._exit(1)


def _flush() -> None:
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            stream.flush()


os.register_at_fork(
    before=_engine.before_fork,
    after_in_parent=_engine.after_fork_in_parent,
    after_in_child=_engine.after_fork_in_child,
)
atexit.register(_at_exit)
