"""Which inputs and which trust of the fear rules rate an estimator: those of its name, else those of its kind.

A rule file names estimators in inputs such as ``cv_confidence`` and in outputs such as ``trust_cv``. An estimator
that it does not name is rated by the name that ``rated_as`` in ``config/supervisor.yaml`` gives to it or its kind.
"""

from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache

from supervisor.inputs.validation import ValidatedEstimate
from supervisor.rules.inference import FearRules
from supervisor.rules.rule_file import FORMER_PATH_JITTER
from trepid.messages import EstimateKind
from trepid.spelling import did_you_mean

CONFIDENCE, JITTER, PATH_JITTER, SUPPORT = "_confidence", "_jitter", "_path_jitter", "_support"
ESTIMATOR_SUFFIXES = (CONFIDENCE, PATH_JITTER, FORMER_PATH_JITTER, JITTER, SUPPORT)  # longer endings first
RATED_AS: Mapping[str, str] = {EstimateKind.LANE.value: "cv", EstimateKind.ANGLE.value: "angle"}


def rating_names(
    estimates: Iterable[ValidatedEstimate], rules: FearRules, rated_as: Mapping[str, str]
) -> dict[str, str]:
    """The name in ``rules`` that rates each estimator."""
    named = _named_estimators(rules.names, rules.file.estimators)
    return {
        e.estimator: e.estimator
        if e.estimator in named
        else rated_as.get(e.estimator) or rated_as.get(e.kind, e.estimator)
        for e in estimates
    }


def unrated_names(rules: FearRules, rated_as: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """Key and error text of every name in ``rated_as`` that ``rules`` do not rate, where they name any."""
    named = _named_estimators(rules.names, rules.file.estimators)
    known = named.union(RATED_AS.values())
    for key, name in rated_as.items():
        if named and name not in known:
            yield key, f"no rule rates {name!r}; {did_you_mean(name, known)}"


def near_miss(rules: FearRules, name: str) -> str:
    """A question with the known estimator or kind that ``name`` nearly is; "" where it is one, or near none.

    Estimators may have further names, so that a near miss is no error.
    """
    known = _named_estimators(rules.names, rules.file.estimators).union(RATED_AS, RATED_AS.values())
    return "" if name in known else did_you_mean(name, known, otherwise="", cutoff=0.75)


def absent_values(rules: FearRules, estimators: int) -> dict[str, float | None]:
    """Values of the estimator inputs of ``rules`` where no estimator runs that they rate.

    With one estimator alone they are 0: no confidence, because nothing confirms it. With two or more they are calm,
    except support: what does not run supports no other estimator.
    """
    alone = estimators < 2
    return {
        name: 0.0 if alone or name.endswith(SUPPORT) else rules.inputs[name].calmest
        for name in rules.names
        if name.endswith(ESTIMATOR_SUFFIXES)
    }


@lru_cache(maxsize=16)
def _named_estimators(inputs: tuple[str, ...], trusted: tuple[str, ...]) -> frozenset[str]:
    """The estimators that a rule file names."""
    suffixes = {name: next(filter(name.endswith, ESTIMATOR_SUFFIXES), None) for name in inputs}
    return frozenset(name.removesuffix(s) for name, s in suffixes.items() if s).union(trusted)
