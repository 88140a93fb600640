"""The tables of the supervisor as pages: ``python -m cockpit.rulebook.tables`` writes them into ``docs/``.

Drawn from the code and the configuration, so that they cannot say anything else; a test keeps them current.
"""

from collections.abc import Iterable, Sequence

from cockpit.rulebook.terms import WHY
from supervisor.modes.analyser import SUSPECTS
from supervisor.modes.modes import DRIVING, HAND_OVER, TRANSITIONS, ModeSettings, Transition
from supervisor.rules.inference import FearRules
from supervisor.rules.rule_file import LEVELS
from supervisor.rules.sentence import Rule
from supervisor.supervisor import SupervisorSettings
from trepid.config import CONFIG_DIR, ROOT, load
from trepid.messages import Mode

MODES_PAGE, TERMS_PAGE = ROOT / "docs" / "fear_modes.md", ROOT / "docs" / "fear_terms.md"
NOTE = (
    "*Drawn by `python -m cockpit.rulebook.tables` from the code and `config/`; edit those, not this page.*"
)


def modes_page(settings: SupervisorSettings, rules: FearRules) -> str:
    """``docs/fear_modes.md``: causes, modes, transitions and the times that they wait."""
    return (
        "\n\n".join(
            [
                "# From cause to act",
                NOTE,
                "First the analyser names the cause, then the act follows from it: whom to trust (the "
                "`trust_` rules), how "
                "fast to drive (fear), and which mode to be in. A symptom that a fear rule names, such "
                "as a low "
                "confidence, is traced back to the first suspect below for which there is evidence.",
                "## The suspects, in the order of causation",
                table(
                    ("cause", "part", "evidence", "whom the rules trust less"),
                    [(f"`{s.cause}`", s.part, s.because, _distrust(s.cause, rules)) for s in SUSPECTS],
                ),
                "How much is evidence enough: section `analyser` of `config/supervisor.yaml`. What is "
                "done about the "
                "picture itself, perception does by itself: the CV estimator takes road edges where it "
                "finds no lines, "
                "and says so (`marked`); it judges contrast locally, so there is no histogram to be "
                "matched for it.",
                "## The modes",
                diagram([*TRANSITIONS, HAND_OVER]),
                table(
                    ("from", "to", "when"),
                    [(_modes(row), f"`{row.target}`", row.because) for row in [*TRANSITIONS, HAND_OVER]],
                ),
                "The first row that fits decides. A stop latches until standstill, and grows only "
                "harder. The last row "
                "leaves only the stop in which a supervisor begins.",
                "## What is waited for",
                table(("what", "how long"), _waits(settings.modes, rules)),
            ]
        )
        + "\n"
    )


def terms_page(rules: FearRules) -> str:
    """``docs/fear_terms.md``: what is feared, in which unit and direction, and why."""
    rows = [
        (f"`{name}`", spec.unit, "more" if spec.risk == "rising" else "less", spec.meaning, WHY[name])
        for name, spec in rules.inputs.items()
    ]
    return (
        "\n\n".join(
            [
                "# What is feared, and why",
                NOTE,
                "Worse is *more* or *less* of the number. A value that is missing, not finite or "
                "impossible makes fear 1. "
                "Sets and rules: `config/fear.yaml`.",
                table(("term", "unit", "worse", "meaning", "why it is feared"), rows),
            ]
        )
        + "\n"
    )


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def diagram(rows: Iterable[Transition]) -> str:
    """The transitions as a Mermaid state diagram; those from every driving mode leave the group of these."""
    lines = ["```mermaid", "stateDiagram-v2", "    [*] --> STOP", "    state driving {"]
    inside = [f"    {_arrow(row, source)}" for row in rows for source in _sources(row) if source != "driving"]
    lines += [line for line in inside if " STOP" not in line]
    lines += ["    }"]
    lines += [line.removeprefix("    ") for line in inside if " STOP" in line]
    lines += [_arrow(row, "driving") for row in rows if row.sources == DRIVING]
    return "\n".join([*lines, "```"])


def _sources(row: Transition) -> list[str]:
    return ["driving"] if row.sources == DRIVING else [mode for mode in Mode if mode in row.sources]


def _arrow(row: Transition, source: str) -> str:
    return f"    {source} --> {row.target}: {row.because}"


def _modes(row: Transition) -> str:
    return ", ".join(f"`{mode}`" for mode in Mode if mode in row.sources)


def _distrust(cause: str, rules: FearRules) -> str:
    lowered = {name for name, voice in rules.trust_voices.items() for r in voice.rules if _about(r, cause)}
    return ", ".join(sorted(lowered)) or "–"


def _about(rule: Rule, cause: str) -> bool:
    return rule.cause == cause


def _waits(modes: ModeSettings, rules: FearRules) -> list[tuple[str, str]]:
    h = rules.file.hysteresis
    borne = [(f"`{c}` frightens: comfort stop", f"{s:g} s") for c, s in modes.stop_after_s.items()]
    borne += [
        (f"`{c}` frightens on the move: emergency stop", f"{s:g} s")
        for c, s in modes.emergency_after_s.items()
    ]
    return [
        (f"fear is {LEVELS[-1]}: comfort stop", f"{h.stop_after_s:g} s"),
        *borne,
        ("no frame: comfort stop", f"{modes.comfort_stop_age_s:g} s"),
        ("no frame on the move: emergency stop", f"{modes.emergency_stop_age_s:g} s"),
        ("no path at all on the move: emergency stop", f"{modes.blind_s:g} s"),
        ("too near a vehicle ahead for the comfort stop going on: emergency stop", f"{modes.near_s:g} s"),
        (
            f"fear is {LEVELS[-1]} on the move and no estimator is believed by {modes.guess_confidence:g}:"
            " emergency stop",
            f"{modes.guess_s:g} s",
        ),
        (f"calm by more than {h.band:g} of fear: back to `KEEP`", f"{h.calm_after_s:g} s"),
        (f"road seen with {modes.road_back_confidence:g}: `FOLLOW` ends", f"{modes.road_back_s:g} s"),
        (
            "healthy at standstill: drive",
            "never" if modes.reengage_after_s is None else f"{modes.reengage_after_s:g} s",
        ),
    ]


def pages() -> dict[str, str]:
    """Text of every page by its path."""
    rules = FearRules.load(CONFIG_DIR / "fear.yaml")
    settings = load(CONFIG_DIR / "supervisor.yaml", SupervisorSettings)
    return {str(MODES_PAGE): modes_page(settings, rules), str(TERMS_PAGE): terms_page(rules)}


if __name__ == "__main__":
    MODES_PAGE.write_text(pages()[str(MODES_PAGE)])
    TERMS_PAGE.write_text(pages()[str(TERMS_PAGE)])
