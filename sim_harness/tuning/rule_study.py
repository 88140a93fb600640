"""The search for numbers of a rule file: a candidate passes the check of rule files, its cost is that of drives."""

import hashlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path

from sim_harness.sweep.plan import Plan
from sim_harness.tuning.numbers import NumberedText
from sim_harness.tuning.score import Fearless, RunCrashed, score
from sim_harness.tuning.settings import Costs
from sim_harness.tuning.study import Evaluation, EvaluationError, Invalid, Task
from supervisor.rules.inference import FearRules
from supervisor.rules.verify import verify
from trepid.config import InputError, read_text


@dataclass(frozen=True, kw_only=True)
class RuleTask(Task):
    """Numbers of the file ``rules`` over the drives ``planned``."""

    rules: Path
    planned: Plan
    references: list[Fearless]
    costs: Costs

    @property
    def name(self) -> str:
        """Name of the study: a hash of rules, parameters, cases and costs."""
        spans = {name: [span.low, span.high] for name, span in self.parameters.items()}
        about = [read_text(self.rules), spans, list(self.planned), self.costs.model_dump()]
        digest = hashlib.sha256(json.dumps(about).encode()).hexdigest()
        return f"{self.rules.stem}-{digest[:12]}"

    def start(self) -> dict[str, float]:
        """The values of the file."""
        text = NumberedText(self.rules)
        return {name: text.value(name) for name in self.parameters}

    def evaluate(self, values: dict[str, float], folder: Path) -> Evaluation:
        """The cost of driving with a file of these values."""
        try:
            found = score(self.candidate(values, folder), self.planned, self.references, self.costs)
        except RunCrashed as error:
            raise EvaluationError(str(error)) from error
        return Evaluation(found.cost, asdict(found))

    def candidate(self, values: dict[str, float], folder: Path) -> Path:
        """The rule file with other values, checked. Raises Invalid."""
        path = folder / "candidate.yaml"
        path.write_text(NumberedText(self.rules).change_numbers(values), encoding="utf-8")
        try:
            problems = verify(FearRules.load(path)).problems
        except InputError as error:
            raise Invalid(str(error)) from error
        if problems:
            raise Invalid(str(problems[0]))
        return path
