"""What the package offers to command line, Python and launcher."""

from trepid.packages import Offers, Verb

OFFERS = Offers(
    verbs={
        "sim": Verb("sim_harness.cli", "app", "Run scenarios in lock-step, faster than real time."),
        "estimate": Verb(
            "sim_harness.footage.estimate_cli",
            "estimate",
            "Estimate the lane, or find the vehicle ahead, in images, folders of images, videos and recordings.",
        ),
        "compare": Verb(
            "sim_harness.compare.cli",
            "compare",
            "Compare two recordings, traces, files of stored runs, or folders of them, side by side.",
        ),
    },
    added={"fear": {"tune": Verb("sim_harness.tuning.cli", "tune")}},
    examples={
        "sim list": "trepid sim list --tag traffic",
        "sim run": "trepid sim run circuit s_curve --seeds 4 --jobs 2 --report runs.html",
        "sim limits": "trepid sim limits cut_in --corners 8",
        "sim resimulate": "trepid sim resimulate clip.mp4 --speed 25",
        "sim schema": "trepid sim schema",
        "sim disturbances": "trepid sim disturbances --picture kinds.png",
        "sim leads": "trepid sim leads --picture leads.png",
        "sim road show": "trepid sim road show town --picture town.png",
        "sim road export": "trepid sim road export town town.xodr",
        "sim road import": "trepid sim road import town.xodr town.yaml",
        "estimate": "trepid estimate --annotate out.png road.jpg",
        "compare": "trepid compare before.mcap after.mcap --picture both.png",
        "fear tune": "trepid fear tune config/fear.yaml --trials 40 --out tuned.yaml",
    },
    functions={
        "run": "sim_harness.api",
        "sweep": "sim_harness.api",
        "rate": "sim_harness.footage.api",
        "compare": "sim_harness.compare.api",
    },
    courses="sim_harness.live.course",
    simulated_car="sim_harness.live.vehicle_node",
    simulates=True,
)
