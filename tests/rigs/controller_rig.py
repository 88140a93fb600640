"""The shipped settings of controller and limiter."""

from controller.controller import ControllerSettings
from controller.limiter import Limits
from trepid.config import CONFIG_DIR, load

SETTINGS = load(CONFIG_DIR / "controller.yaml", ControllerSettings)
LIMITS = load(CONFIG_DIR / "limiter.yaml", Limits)
G = 9.80665
