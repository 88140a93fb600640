"""How late may frames be on the S bend? Run it: trepid sim run latency_sweep.py --jobs 2"""

from sim_harness.scenarios.scenario import load_scenario

s_curve = load_scenario("s_curve")
scenarios = [
    s_curve.model_copy(
        update={
            "name": f"s_curve, {latency_ms} ms",
            "camera": s_curve.camera.model_copy(update={"latency_s": latency_ms / 1000}),
        }
    )
    for latency_ms in (20, 60, 100, 140)
]
