"""The estimators of a replay in a process of their own, ahead of the other nodes.

All their inputs are recorded, so that they wait for no other node. Python code of one process runs on one core; two
processes use two cores. The outputs come through a pipe in the order of the steps; while it is full, the process
waits.
"""

import os
import pickle
import subprocess
import sys
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import cv2

from cockpit.replay.nodes import NO_ESTIMATORS, Node, nodes_of, settings_of
from cockpit.replay.player import Player
from cockpit.replay.tape import Tape
from trepid.config import ROOT, InputError


@contextmanager
def estimate_ahead(path: Path, names: Collection[str], networks: Sequence[str]) -> Iterator[Iterator[Any]]:
    """The output of each step of the estimators ``names``, which begin to run at once.

    None: the image of the step was not recorded. The iterator raises InputError when an estimator cannot be built,
    and when the process ends before the last step. Without names there is no process.
    """
    if not names:
        yield iter(())
        return
    words = [sys.executable, "-m", __name__, str(path.absolute()), ",".join(names)]
    files = [str(Path(file).absolute()) for file in networks]
    with subprocess.Popen(
        [*words, *files], cwd=ROOT, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, start_new_session=True
    ) as process:  # of its own session: a keyboard interrupt ends the starter, and the starter ends it
        try:
            yield _receive_outputs(process)
        finally:
            process.kill()


def _receive_outputs(process: "subprocess.Popen[bytes]") -> Iterator[Any]:
    assert process.stdout is not None
    while True:
        try:
            output = pickle.load(process.stdout)
        except (EOFError, pickle.UnpicklingError) as error:
            raise InputError(
                f"the process of the estimators ended too early, with exit code {process.wait()}"
            ) from error
        if isinstance(output, InputError):
            raise output
        yield output


def estimators_among(picked: Collection[Node]) -> set[str]:
    """Names of the nodes of ``picked`` that run ahead."""
    return {node.name for node in picked} - NO_ESTIMATORS


def main(path: str, names: str, *networks: str) -> None:
    """Write the outputs to the standard output, each pickled, or the InputError that prevents them."""
    with suppress(BrokenPipeError), os.fdopen(os.dup(1), "wb") as out:  # broken: the starter has ended
        os.dup2(2, 1)  # what a library prints is no output
        for output in _outputs(Path(path), names.split(","), networks):
            pickle.dump(output, out, pickle.HIGHEST_PROTOCOL)
            out.flush()


def _outputs(path: Path, names: Sequence[str], networks: Sequence[str]) -> Iterator[Any]:
    cv2.setNumThreads(1)
    try:
        tape = Tape(path, said=True)
        with settings_of(tape, None, networks) as setup:
            nodes = nodes_of(tape, setup)
            yield from Player(tape, [nodes[name] for name in names]).outputs_of(names)
    except InputError as error:
        yield error


if __name__ == "__main__":
    main(*sys.argv[1:])
