"""The configuration that runs read, loaded before the first of them starts."""

from collections.abc import Iterable

import controller.controller
import controller.limiter
import perception.estimators
import perception.lead.finder
import supervisor.supervisor
from sim_harness.lockstep.lead_model import build_lead_model
from sim_harness.lockstep.vehicle import load_simulator
from sim_harness.scenarios.scenario import RULES_FILE, LeadSensor, Scenario, Sight
from sim_harness.world.roads.disturbance_table import load_table
from supervisor.rules.rule_file import RuleFile
from trepid.camera import Camera
from trepid.config import CONFIG_DIR, load


def check_configuration(scenarios: Iterable[Scenario]) -> None:
    """Load every file of settings, rules and weights that a run of ``scenarios`` reads.

    Raises InputError with file:line:column for the first invalid value.
    """
    scenarios = tuple(scenarios)
    load_simulator()
    load(CONFIG_DIR / "camera.yaml", Camera)
    load(RULES_FILE, RuleFile)  # its levels of fear are words of conditions
    controller.limiter.build()
    controller.controller.build()
    for rules in dict.fromkeys(scenario.rules_file for scenario in scenarios):
        supervisor.supervisor.build(rules=rules)
    with_images = [scenario for scenario in scenarios if scenario.sight is Sight.CAMERA]
    for name in dict.fromkeys(name for scenario in with_images for name in scenario.estimators):
        perception.estimators.build(name)
    sensors = {scenario.leads_by for scenario in scenarios}
    if LeadSensor.CAMERA in sensors:
        perception.lead.finder.build()
    if LeadSensor.MODELLED in sensors:
        build_lead_model(seed=0)
    if any(scenario.disturbances for scenario in scenarios):
        load_table()
