"""The check of a real car before its first process starts: the files that its processes will read.

``python -m drive.check`` is the check as a process of its own (:func:`check_car_apart`): the launcher, which stays
for the whole drive, then holds neither networks nor rules.
"""

import json
import subprocess
import sys
import traceback
from collections.abc import Sequence
from contextlib import redirect_stdout

from pydantic import TypeAdapter

from drive.course import Findings
from drive.plan import ESTIMATOR, LEAD
from trepid.car.camera import Camera
from trepid.config import BAD_INPUT, CONFIG_DIR, ROOT, InputError, default_file, load
from trepid.loudness import Loudness, detail, loudness, speak
from trepid.processes.settings import ProcessSpec


def check_car(specs: Sequence[ProcessSpec]) -> Findings:
    """Load every file of settings, rules and weights that these processes of a real car read.

    Raises InputError with file:line:column for the first invalid value, and where the embedded lead detector,
    trained on drawn vehicles, would get real images.
    """
    import controller.controller
    import controller.limiter
    import perception.estimators
    import perception.lead.finder
    import supervisor.supervisor

    perception.lead.finder.check_lead(specs)
    load(CONFIG_DIR / "camera.yaml", Camera)
    controller.limiter.build()
    controller.controller.build()
    supervisor.supervisor.build(rules=default_file("fear.yaml"))
    for spec in specs:
        if spec.module == ESTIMATOR and "estimator" in spec.options:
            perception.estimators.build(spec.options["estimator"], network=spec.options.get("network"))
        elif spec.module == LEAD:
            perception.lead.finder.build()
    return Findings(perception.estimators.misfits(), perception.lead.finder.blindness(specs))


def check_car_apart(specs: Sequence[ProcessSpec]) -> Findings:
    """:func:`check_car` in a process that ends with it. Raises InputError as it does.

    Its warnings go to the standard error of this process. Ctrl-C reaches this process only, which then ends it.
    """
    done = subprocess.run(
        [sys.executable, "-m", "drive.check", str(int(loudness()))],
        cwd=ROOT,  # `-m` then prefers the packages of this checkout
        input=_specs().dump_json(tuple(specs)),
        stdout=subprocess.PIPE,
        start_new_session=True,
        check=False,
    )
    if done.returncode == BAD_INPUT:
        raise InputError(done.stdout.decode())
    done.check_returncode()
    return Findings(**json.loads(done.stdout))


def _specs() -> TypeAdapter[tuple[ProcessSpec, ...]]:
    return TypeAdapter(tuple[ProcessSpec, ...])


def main() -> int:
    """Check the processes on standard input; print the findings, or the error; return the exit code."""
    speak(Loudness(int(sys.argv[1])))
    specs = _specs().validate_json(sys.stdin.buffer.read())
    try:
        with redirect_stdout(sys.stderr):  # of packages that add parts
            findings = check_car(specs)
    except InputError as error:
        detail(traceback.format_exc().rstrip())
        print(error, end="")
        return BAD_INPUT
    print(json.dumps(findings._asdict()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
