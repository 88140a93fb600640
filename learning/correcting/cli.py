"""``trepid correct``: let a network drive alone in the simulator, label where it drifts, train again."""

import json
import math
from pathlib import Path
from typing import Annotated

import typer

from learning.models.catalogue import model
from learning.rendered import need_torch, say
from learning.training.recipe import load_recipe
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, InputError, load, parse_overrides
from trepid.options import Car, typed_command

SPEED_MPS = 5 * 0.44704  # 5 mph, that of Deep Steer, on lanes of the reference world


def correct(
    data: Annotated[Path, typer.Option(metavar="DIR", help="Data set of `trepid dataset build`.")],
    name: Annotated[str, typer.Option("--model", metavar="NAME", help="The network, as of `trepid train`.")],
    out: Annotated[Path, typer.Option(metavar="F.onnx", help="Weights file to write.")],
    scenarios: Annotated[
        list[str], typer.Option("--scenario", metavar="S", help="Drive this scenario; may be repeated.")
    ],
    rounds: Annotated[int, typer.Option(min=1, max=100, help="Number of corrections.")] = 3,
    speed: Annotated[
        float | None,
        typer.Option(
            min=0.01,
            max=60.0,
            help="Set speed of the drives [m/s]; default: 2.24 on lanes of 3.3 m, by lane width.",
        ),
    ] = None,
    seeds: Annotated[int, typer.Option(min=1, max=1000, help="Drives of each scenario.")] = 1,
    drift_m: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            max=5.0,
            help="Label frames in which the car is farther than this beside the lane centre [m]; default: 0.15 on"
            " lanes of 3.3 m, by lane width.",
        ),
    ] = None,
    drift_deg: Annotated[
        float,
        typer.Option(
            min=0.0,
            max=45.0,
            help="Label frames in which the road-wheel angle is wrong by more than this [deg].",
        ),
    ] = 1.0,
    start: Annotated[
        Path | None,
        typer.Option(
            metavar="F.onnx", help="Begin with this network and F.onnx.train; default: train it on --data."
        ),
    ] = None,
    config: Annotated[
        Path | None, typer.Option(metavar="F.yaml", help="Recipe, as of `trepid train`.")
    ] = None,
    changes: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Another value of the recipe; may be repeated."),
    ] = None,
    jobs: Annotated[int, typer.Option(min=1, help="Processes that drive.")] = 1,
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue with the folder F.onnx.correct of a killed run.")
    ] = False,
    car: Car = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the rounds as JSON.")] = False,
) -> None:
    """Let a network drive alone in the simulator, label where it drifts, train again; needs the extra 'train'."""
    model(name)
    if out.suffix != ".onnx":
        raise InputError(f"--out {out}: the name of a weights file ends with .onnx")
    recipe = load_recipe(name, config, overrides=parse_overrides(changes or []))
    need_torch("correct")
    from learning.correcting.corrections import Drift
    from learning.correcting.rounds import Plan
    from learning.correcting.rounds import correct as do
    from learning.dataset.dataset import Dataset
    from learning.training.run import run
    from learning.training.start import check_start
    from perception.estimators import name_of
    from perception.net.driver import DriverNetwork
    from sim_harness.lockstep.closed_loop import check_configuration
    from sim_harness.scenarios.scenario import load_scenario

    name_of(out.name)
    if start is not None:
        DriverNetwork(start)
        check_start(start)
    scale = load(CONFIG_DIR / "vehicle.yaml", Vehicle).scale
    driven = {"speed_mps": str(SPEED_MPS * scale if speed is None else speed)}
    check_configuration(load_scenario(one, driven) for one in scenarios)
    plan = Plan(
        data=Dataset.open(data),
        model=name,
        recipe=recipe,
        scenarios=tuple(dict.fromkeys(scenarios)),
        changes=driven,
        seeds=tuple(range(seeds)),
        rounds=rounds,
        drift=Drift(Drift().offset_m * scale if drift_m is None else drift_m, math.radians(drift_deg)),
        out=out,
        start=start,
        command=typed_command(),
    )
    try:
        rows = do(plan, run, resume=resume, jobs=jobs, report=say)
    except OSError as error:
        raise InputError(f"{error.filename or out}: cannot be written: {error.strerror or error}") from error
    if as_json:
        print(json.dumps({"file": str(out), "rounds": rows}))
        return
    typer.echo("round  added frames  interventions  autonomy  rms beside the centre")
    for row in rows:
        autonomy, rms = f"{row['autonomy_percent']:.1f} %", f"{row['rms_lateral_error_m']:.3f} m"
        typer.echo(
            f"{row['round']:>5} {row['corrections']:>13} {row['interventions']:>14} {autonomy:>9} {rms:>22}"
        )
    typer.echo(f"{out}: the best of them; {out.with_suffix('.md')}: its card")
