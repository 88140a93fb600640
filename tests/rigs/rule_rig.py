"""Small rule files for tests: inputs over 0..1 whose sets are evenly spread."""

from supervisor.rules.inference import FearRules
from supervisor.rules.rule_file import Action, Actions, Hysteresis, Input, Method, RuleFile, Sets
from supervisor.rules.sentence import parse_rule
from trepid.messages import Mode

EVEN = Sets(
    very_low=(0, 0, 0.25),
    low=(0, 0.25, 0.5),
    medium=(0.25, 0.5, 0.75),
    high=(0.5, 0.75, 1),
    very_high=(0.75, 1, 1),
)
RISING = Input(meaning="a risk", unit="1", range=(0, 1), risk="rising", sets=EVEN)
FALLING = Input(meaning="a safety", unit="1", range=(0, 1), risk="falling", sets=EVEN)
ACTIONS = Actions(
    very_low=Action(at=0, speed_factor=1, mode=Mode.KEEP),
    low=Action(at=0.25, speed_factor=1, mode=Mode.KEEP),
    medium=Action(at=0.5, speed_factor=0.7, mode=Mode.CAUTION),
    high=Action(at=0.75, speed_factor=0.4, mode=Mode.CAUTION),
    very_high=Action(at=1, speed_factor=0, mode=Mode.STOP),
)
HYSTERESIS = Hysteresis(band=0.05, calm_after_s=1, stop_after_s=0.4, recovery_per_s=0.25, catch_up_per_s=2)


def small_rules(
    *sentences: str,
    inputs: dict[str, Input] | None = None,
    estimators: tuple[str, ...] = (),
    method: Method = "monotone",
) -> FearRules:
    """Rules over two risks, ``a`` and ``b``, unless other inputs are given."""
    file = RuleFile(
        method=method,
        estimators=estimators,
        inputs=inputs or {"a": RISING, "b": RISING},
        rules=sentences,
        fear=ACTIONS,
        hysteresis=HYSTERESIS,
    )
    return FearRules(file, tuple(parse_rule(s, file.inputs, outputs=file.outputs) for s in sentences))
