"""A rule file in the terminal: the sets of its inputs, its rules, its actions, and fear over two inputs."""

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from cockpit.rulebook.figure import risk, shown_range, surface
from supervisor.rules.inference import FearRules
from supervisor.rules.rule_file import LEVELS, Input
from supervisor.rules.shapes import FuzzySet

PLOT_COLUMNS = 44
SURFACE_ROWS, SURFACE_COLUMNS = 17, 49  # odd, so that the middle is shown
BARS, SHADES = " ▁▂▃▄▅▆▇█", "·░▒▓█"


def show_rules(rules: FearRules, console: Console) -> None:
    """The whole file."""
    for name, spec in rules.inputs.items():
        low, high = spec.range
        about = f"[{spec.unit}] {low:g} … {high:g}, {risk(spec)}: {spec.meaning}"
        console.print(f"[bold]{name}[/bold] {escape(about)}", highlight=False, soft_wrap=True)
        console.print(_set_table(spec))
    console.print("[bold]rules[/bold]")
    for rule in rules.rules:
        console.print(f"  {escape(rule.text)}", soft_wrap=True)
    console.print(_action_table(rules))


def show_surface(
    rules: FearRules, x_name: str, y_name: str, others: dict[str, float | None], console: Console
) -> None:
    """Fear over two inputs as shades, one for each level."""
    x, y, fear = surface(rules, x_name, y_name, others, (SURFACE_COLUMNS, SURFACE_ROWS))
    legend = "  ".join(f"{shade} {level}" for shade, level in zip(SHADES, LEVELS, strict=True))
    y_unit, x_unit = rules.inputs[y_name].unit, rules.inputs[x_name].unit
    lines = [f"fear: {legend}", "", f"{y_name} [{y_unit}], {risk(rules.inputs[y_name])}"]
    for row in reversed(range(len(y))):
        label = f"{y[row]:.3g}" if row % 4 == 0 else ""
        shades = "".join(SHADES[rules.level_index(float(value))] for value in fear[row])
        lines.append(f"{label:>8} │{shades}")
    lines.append(f"{'':>8} └{'─' * len(x)}")
    marks = "".join(f"{x[column]:<12.3g}" for column in range(0, len(x), 12))
    lines += [f"{'':>10}{marks}", f"{'':>10}{x_name} [{x_unit}], {risk(rules.inputs[x_name])}"]
    console.print("\n".join(lines), markup=False, highlight=False, soft_wrap=True)


def _set_table(spec: Input) -> Table:
    table = Table(box=None, show_header=False, padding=(0, 1))
    for level in LEVELS:
        table.add_row(f"  {level}", _curve(spec.shapes[level], *shown_range(spec)), _set_text(spec, level))
    return table


def _set_text(spec: Input, level: str) -> str:
    """A set as the file states it: its points, or its function with the parameters."""
    stated = getattr(spec.sets, level)
    if isinstance(stated, tuple):
        return " ".join(f"{x:g}" for x in stated)
    return f"{stated.function} {' '.join(str(x) for x in stated.parameters)}"


def _curve(shape: FuzzySet, low: float, high: float) -> str:
    """A set as a row of bars."""
    places = [low + (high - low) * i / (PLOT_COLUMNS - 1) for i in range(PLOT_COLUMNS)]
    return "".join(BARS[round(8 * shape.membership(x))] for x in places)


def _action_table(rules: FearRules) -> Table:
    table = Table("fear", "at", "speed factor", "mode", box=None)
    for level, action in zip(LEVELS, rules.file.fear.all, strict=True):
        table.add_row(level, f"{action.at:g}", f"{action.speed_factor:g}", action.mode.value)
    return table
