# SPDX-License-Identifier: Apache-2.0
"""The program `earshot`, run beside Python."""

from __future__ import annotations

import contextlib
import ctypes
import os
import shutil
import signal
import subprocess
from collections.abc import Callable, Mapping, Sequence

from ._engine import InputError, RunError

_PR_SET_PDEATHSIG = 1
BAD_INPUT = 2  #: exit code
_libc = ctypes.CDLL(None, use_errno=True)


def find_program(program: str | os.PathLike[str] | None = None) -> str:
    """The absolute path of the program: the one given, that of the variable EARSHOT_PROGRAM, or `earshot` of the PATH.

    :raises InputError: There is none, or it cannot be executed.
    """
    named = os.fspath(program) if program is not None else os.environ.get("EARSHOT_PROGRAM", "earshot")
    found = shutil.which(named)
    if found is None:
        raise InputError(f"program {named}: is not found or cannot be executed; set EARSHOT_PROGRAM, or give program=PATH")
    return os.path.abspath(found)


def text_arguments(what: str, arguments: Sequence[str | os.PathLike[str]], refused: Mapping[str, str]) -> list[str]:
    """The arguments of a command as texts.

    :param refused: Options that the caller sets, each with the reason.
    :raises InputError: One of them is among the arguments.
    :raises TypeError: `arguments` is one text or holds other things.
    """
    if isinstance(arguments, str | bytes) or not all(isinstance(argument, str | os.PathLike) for argument in arguments):
        raise TypeError(f"{what}: arguments must be a list of texts, such as ['config.yaml', '--set', 'seed=1']")
    texts = [os.fspath(argument) for argument in arguments]
    for text in texts:
        option = text.split("=")[0]
        if option in refused:
            raise InputError(f"{what}: {option} {refused[option]}; leave it out")
    return texts


def run_program(
    command: Sequence[str],
    *,
    cwd: str,
    environment: Mapping[str, str] | None = None,
    ends_with: signal.Signals = signal.SIGKILL,
    poll: Callable[[], None] | None = None,
    poll_s: float = 1.0,
) -> str:
    """What the command prints, its errors last.

    The command ends with the thread that calls, also where this process is killed.

    :param environment: Variables; None: those of this process.
    :param ends_with: The signal by which it then ends.  SIGTERM lets a training leave its checkpoint.
    :param poll: Called every `poll_s`.  If it raises, the command is ended as well.
    :raises InputError: The program refused its input.  The message is its line.
    :raises RunError: It failed, or was ended by a signal.
    """
    parent = os.getpid()

    def end_with_parent() -> None:  # between fork and exec: no locks, no imports
        _libc.prctl(_PR_SET_PDEATHSIG, int(ends_with))
        if os.getppid() != parent:
            os._exit(1)

    with subprocess.Popen(
        command,
        cwd=cwd,
        env=None if environment is None else dict(environment),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        preexec_fn=end_with_parent,
    ) as process:
        try:
            while True:
                try:
                    text, _ = process.communicate(timeout=poll_s if poll else None)
                    break
                except subprocess.TimeoutExpired:
                    if poll:
                        poll()
        except BaseException:
            process.send_signal(ends_with)
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.communicate(timeout=60)
            process.kill()
            raise
    if process.returncode != 0:
        raise _failure(command, process.returncode, text)
    return text


def _failure(command: Sequence[str], code: int, text: str) -> InputError | RunError:
    lines = [line for line in text.splitlines() if line.strip()]
    said = next((line for line in reversed(lines) if line.startswith("earshot: ")), lines[-1] if lines else "no output")
    said = said.removeprefix("earshot: ").strip()
    if code == BAD_INPUT:
        return InputError(said)
    name = " ".join(["earshot", *command[1:3]])
    if code < 0:
        return RunError(f"{name}: was ended by signal {-code}; last output: {said}")
    return RunError(f"{name}: failed with code {code}: {said}")
