"""How far a moment is from the next level of fear: for each input alone, the value at which the rules reach it."""

from supervisor.rules.inference import FearRules, Values
from supervisor.rules.rule_file import LEVELS

_PRECISION = 1e-4  # of the range of an input


def next_level(rules: FearRules, fear: float) -> str | None:
    """The level above that of ``fear``; None at the highest."""
    above = rules.level_index(fear) + 1
    return LEVELS[above] if above < len(LEVELS) else None


def raising(rules: FearRules, values: Values) -> list[tuple[str, float, str]]:
    """Each input that alone would raise fear to a higher level, the value from which it does, and the cause then.

    The inputs are moved towards the worst end of their range, the others held; that which needs the smallest share
    of its range comes first. Empty at the highest level, to which also every missing input leads.
    """
    level = rules.level_index(rules.evaluate(values).fear)
    found = []
    for name, spec in rules.inputs.items():
        low, high = spec.range
        value = values.get(name)
        if value is None or level == len(LEVELS) - 1:
            continue
        calm, worse = min(max(value, low), high), spec.worst
        if not _rises(rules, values, name, worse, level):
            continue
        while abs(worse - calm) > _PRECISION * (high - low):
            middle = (calm + worse) / 2
            calm, worse = (calm, middle) if _rises(rules, values, name, middle, level) else (middle, worse)
        cause = rules.evaluate({**values, name: worse}).cause
        found.append((abs(worse - value) / (high - low), name, worse, cause))
    return [(name, worse, cause) for _, name, worse, cause in sorted(found)]


def _rises(rules: FearRules, values: Values, name: str, value: float, level: int) -> bool:
    return rules.level_index(rules.evaluate({**values, name: value}).fear) > level
