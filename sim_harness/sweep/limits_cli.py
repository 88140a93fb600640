"""``trepid sim limits``: the limits of each range of a scenario beyond which it fails."""

import json
import sys
from typing import Annotated, Any

import typer

from sim_harness.lockstep.closed_loop import run
from sim_harness.scenarios.boundary import TOLERANCE, Limit, limits
from sim_harness.scenarios.sampling import Case
from sim_harness.scenarios.scenario import load_scenario
from trepid.config import InputError, parse_overrides


def limits_verb(
    source: Annotated[str, typer.Argument(metavar="S", help="A scenario name or .yaml file.")],
    seed: Annotated[int, typer.Option(min=0, help="Seed from which the seed of the cases is derived.")] = 0,
    tolerance: Annotated[
        float, typer.Option(min=1e-4, max=0.5, help="Resolution as a share of the range.")
    ] = TOLERANCE,
    corners: Annotated[int, typer.Option(min=0, help="Number of random corners to search as well.")] = 0,
    settings: Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON Lines.")] = False,
) -> int:
    """Search the limit of each range in `vary` at which the scenario fails; exit code 1 when no case passes."""
    scenario = load_scenario(source, parse_overrides(settings or []))
    if not scenario.vary:
        raise InputError(f"scenario {scenario.name}: no ranges under vary")
    found = limits(scenario, passes, seed=seed, tolerance=tolerance, corners=corners)
    any_passes = False
    for limit in found:
        any_passes |= limit.passes is not None
        print(json.dumps(row(limit)) if as_json else sentence(limit), flush=True)
    return 0 if any_passes else 1


def passes(case: Case) -> bool:
    """Run a case, report it on standard error, return whether it passed."""
    result = run(case.scenario, seed=case.seed)
    values = ", ".join(f"{name} = {value}" for name, value in case.parameters.items())
    print(f"{'failed' if result.reasons else 'passed'}: {values}", file=sys.stderr, flush=True)
    return not result.reasons


def row(limit: Limit) -> dict[str, Any]:
    """A limit as one JSON object."""
    return {
        "ray": limit.ray,
        "passes": limit.passes.parameters if limit.passes else None,
        "fails": limit.fails.parameters if limit.fails else None,
        "gap": limit.gap,
        "runs": limit.runs,
    }


def sentence(limit: Limit) -> str:
    """A limit as one line of text."""
    if limit.fails is None:
        return f"{limit.ray}: passes to the end of the range"
    if limit.passes is None:
        return f"{limit.ray}: no case passes"
    good, bad = limit.passes.parameters, limit.fails.parameters
    changes = [f"{name} between {good[name]} and {bad[name]}" for name in good if good[name] != bad[name]]
    return f"{limit.ray}: passes, then fails, with {', '.join(changes)}"
