"""Rule files name known causes only: a misspelt one is refused at its place, a new one is declared first."""

import re
from pathlib import Path

import pytest

from supervisor.rules.inference import FearRules
from trepid.config import CONFIG_DIR, InputError

SHIPPED = (CONFIG_DIR / "fear.yaml").read_text(encoding="utf-8")
BECAUSE = sorted(set(re.findall(r"because (\w+)$", SHIPPED, re.MULTILINE)))
MISSING = sorted(set(re.findall(r"missing: (\w+)$", SHIPPED, re.MULTILINE)))


def refusal(path: Path, text: str) -> str:
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as error:
        FearRules.load(path)
    return str(error.value)


def place(text: str, part: str, name: str) -> str:
    """line:column of ``name`` in the first occurrence of ``part``."""
    offset = text.index(part) + part.index(name)
    return f"{text.count(chr(10), 0, offset) + 1}:{offset - text.rfind(chr(10), 0, offset)}"


@pytest.mark.parametrize("cause", BECAUSE)
def test_a_misspelt_cause_of_a_rule_is_refused_at_its_place(tmp_path: Path, cause: str) -> None:
    path, wrong = tmp_path / "fear.yaml", f"because {cause}x"
    text = SHIPPED.replace(f"because {cause}\n", f"{wrong}\n", 1)
    expected = f"{path}:{place(text, wrong, f'{cause}x')}: unknown cause '{cause}x'; did you mean '{cause}'?"
    assert refusal(path, text) == expected


@pytest.mark.parametrize("cause", MISSING)
def test_a_misspelt_cause_of_a_missing_input_is_refused_at_its_place(tmp_path: Path, cause: str) -> None:
    path, wrong = tmp_path / "fear.yaml", f"missing: {cause}x"
    text = SHIPPED.replace(f"missing: {cause}\n", f"{wrong}\n", 1)
    message, where = refusal(path, text), place(text, wrong, "missing")
    assert message.startswith(f"{path}:{where}: ")
    assert message.endswith(f"unknown cause '{cause}x'; did you mean '{cause}'?")


def test_a_cause_that_the_file_declares_may_be_named(tmp_path: Path) -> None:
    path = tmp_path / "fear.yaml"
    text = SHIPPED.replace("because demand\n", "because ice\n")
    assert "unknown cause 'ice'" in refusal(path, text)
    path.write_text(text.replace("inputs:\n", "causes: {ice: the road is slippery}\n\ninputs:\n", 1))
    assert "ice" in FearRules.load(path).causes
