"""Units of systemd for the drive of a car."""

import getpass
import shlex
import sys
from pathlib import Path

from trepid.config import CONFIG_DIR, DOCS_DIR, ROOT, InputError, load, use_car
from trepid.processes.drive_settings import DriveSettings
from trepid.processes.process import STOP_S
from trepid.processes.settings import load_processes

WATCHDOG_S = 5  # the launcher notifies twice in this time
UNIT = """\
# Written by `trepid service {car}`. Install:
#   {install}
# It starts when a person starts it: a car that has stopped after a failure waits for one.
[Unit]
Description=Trepid drives {name}
Documentation=file://{docs}/processes.md

[Service]
Type=notify
NotifyAccess=main
ExecStart={command}
WorkingDirectory={folder}
Environment="PYTHONUNBUFFERED=1" "PYTHONPATH={root}"
{account}# READY=1 comes when every process has reported; WATCHDOG=1 while the launcher works.
TimeoutStartSec={start_s:.0f}
WatchdogSec={watchdog_s}
# SIGTERM goes to the launcher, which stops the car and ends its processes. When the launcher itself is killed, its
# processes stop the car and end themselves; every other mode would kill them in a moving car.
KillMode=process
TimeoutStopSec={stop_s:.0f}
Restart=no
# For `nice` below 0 and the option `realtime` in processes.yaml.
LimitNICE=-20
LimitRTPRIO=99
# When memory is short, other programs are ended first.
OOMScoreAdjust=-500

[Install]
WantedBy={target}
"""


def write_units(car: Path, out: Path, *, user: bool = False) -> list[Path]:
    """Write the unit of the drive of ``car`` into the folder ``out``, which is made; its path.

    Raises InputError for an invalid car, for a folder that cannot be written, and when the unit exists with another
    content.
    """
    use_car(car)
    load_processes()
    limits = load(CONFIG_DIR / "drive.yaml", DriveSettings)
    folder = car.resolve()
    path = out / f"trepid-{folder.name}.service"
    if user:
        install = f"cp {path.name} ~/.config/systemd/user/ && systemctl --user start {path.stem}"
    else:
        install = f"sudo cp {path.name} /etc/systemd/system/ && sudo systemctl start {path.stem}"
    text = UNIT.format(
        car=car,
        install=install,
        name=folder.name,
        root=_quote(str(ROOT)),
        docs=_quote(str(DOCS_DIR)),
        folder=_quote(str(folder)),
        command=_quote(
            shlex.join([sys.executable, "-m", "trepid", "drive", "--car", str(folder), "--no-dashboard"])
        ),
        account="" if user else f"User={getpass.getuser()}\n",
        start_s=limits.ready_timeout_s + 30.0,
        stop_s=limits.stop_timeout_s + STOP_S + 5.0,
        watchdog_s=WATCHDOG_S,
        target="default.target" if user else "multi-user.target",
    )
    try:
        if path.exists() and path.read_text(encoding="utf-8") != text:
            raise InputError(f"{path}: exists with another content and is kept; remove it, or give --out")
        out.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error
    return [path]


def _quote(text: str) -> str:
    """Text in a unit: percent signs begin specifiers there."""
    return text.replace("%", "%%")
