"""What the package offers to command line, Python and launcher."""

from trepid.packages import Offers, Verb

OFFERS = Offers(
    verbs={
        "init": Verb(
            "cockpit.car.init",
            "init",
            "Write the folder of a new car: commented YAML files that override the defaults field by field.",
        ),
        "doctor": Verb(
            "cockpit.car.cli",
            "doctor",
            "Check the machine and the car, with a remedy for each fault; exit code 1 when a check fails.",
        ),
        "example": Verb("cockpit.examples", "app", "List and copy the examples of the documentation."),
        "camera": Verb(
            "cockpit.calibration.camera_cli", "app", "Calibrate a camera: its lens and how it is mounted."
        ),
        "calibrate": Verb("cockpit.calibration.rc_cli", "app", "Calibrate the pulses of an RC car, live."),
        "fear": Verb("cockpit.rulebook.cli", "app", "Check, show and explain fuzzy rule files."),
        "vehicle": Verb(
            "cockpit.calibration.vehicle_cli",
            "app",
            "Steering angles of the bicycle model, vehicle parameters from a log, margins of steering.",
        ),
        "replay": Verb(
            "cockpit.replay.cli",
            "replay",
            "Play a recording onto the bus, or run nodes on its inputs again and show what differs.",
        ),
        "export": Verb(
            "cockpit.export.cli",
            "export",
            "Export a recording as table, video, figure, tub of donkeycar, LeRobot data set, or for Foxglove.",
        ),
        "status": Verb(
            "cockpit.status_cli",
            "status",
            "Show the processes of a running drive: up, rate, age of the last heartbeat, CPU, restarts, message.",
        ),
        "service": Verb(
            "cockpit.status_cli",
            "service",
            "Write a systemd unit that drives a car, with readiness and watchdog notifications.",
        ),
    },
    examples={
        "init": "trepid init mycar --like shuttle",
        "doctor": "trepid doctor --car mycar",
        "example list": "trepid example list",
        "example copy": "trepid example copy night_bend",
        "camera import": "trepid camera import camera_info.yaml --out mycar/camera.yaml --force",
        "camera calibrate": "trepid camera calibrate boards/ --out mycar/camera.yaml --force",
        "calibrate steering": "trepid calibrate steering --car mycar",
        "fear schema": "trepid fear schema",
        "fear export": "trepid fear export config/fear.yaml",
        "fear import": "trepid fear import rules.fcl --like config/fear.yaml",
        "fear check": "trepid fear check mycar/fear.yaml",
        "fear show": "trepid fear show config/fear.yaml --surface disagreement separation speed=8",
        "fear explain": "trepid fear explain config/fear.yaml lane_confidence=0.3 speed=8",
        "vehicle steer": "trepid vehicle steer --vehicle config/vehicle.yaml --curvature 0.05 --speed 8",
        "vehicle identify": "trepid vehicle identify drive.mcap",
        "vehicle margins": "trepid vehicle margins",
        "replay": "trepid replay drive.mcap --through supervisor --rules config/fear.yaml",
        "export": "trepid export drive.mcap drive.csv --rate 20",
        "status": "trepid status",
        "service": "trepid service mycar --out ~/.config/systemd/user",
    },
    functions={
        "Car": "cockpit.api",
        "OpenRecording": "cockpit.api",
        "estimate": "cockpit.footage.api",
        "explain": "cockpit.api",
        "load": "cockpit.api",
        "open_recording": "cockpit.api",
    },
    elsewhere={"bench": "pip install -e lab"},
    publishes={"cockpit.page.node": ("driver/stop",)},
)
