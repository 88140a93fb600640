"""The log of a process keeps the end of what it writes, whatever it writes."""

import subprocess
import sys

from trepid.processes.launch import KEPT_BYTES, LONGEST_BYTES, new_log, shorten

WRITES = (
    "import sys\nfor line in sys.stdin:\n    print('x' * int(line), flush=True)\n    sys.stderr.write('.')"
)


def test_a_log_is_shortened_to_its_end_while_the_process_writes_on() -> None:
    with new_log() as log:
        writer = subprocess.Popen(
            [sys.executable, "-c", WRITES], stdin=subprocess.PIPE, stdout=log, stderr=log, text=True
        )
        assert writer.stdin is not None
        writer.stdin.write(f"{2 * LONGEST_BYTES}\n")
        writer.stdin.flush()
        while log.seek(0, 2) < 2 * LONGEST_BYTES + len(b"\n."):
            pass
        shorten(log)
        assert log.seek(0, 2) == KEPT_BYTES
        writer.communicate("3\n")
        log.seek(0)
        end = log.read()
    assert end.endswith(b"xxx\n.")
    assert len(end) == KEPT_BYTES + len(b"xxx\n.")


def test_a_log_of_usual_length_stays_as_it_is() -> None:
    with new_log() as log:
        log.write(b"a line")
        shorten(log)
        log.seek(0)
        assert log.read() == b"a line"
