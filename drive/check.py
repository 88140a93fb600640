"""The check of a real car before its first process starts: the files that its processes will read."""

from collections.abc import Sequence

from drive.course import Findings
from drive.plan import ESTIMATOR, LEAD
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, default_file, load
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
