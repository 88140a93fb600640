"""A recording identifies the rules of each decision, also when they were changed while driving."""

from dataclasses import replace
from pathlib import Path

from supervisor_rig import ESTIMATE, Drive

from cockpit.logbook.recall import recall
from supervisor.rules.inference import FearRules
from supervisor.rules.reload import RuleChange
from trepid.config import CONFIG_DIR
from trepid.messages import Diagnostic, Health
from trepid.recording.writer import Recording, attachments
from trepid.topics import DECISION, DIAGNOSTICS
from trepid.wire import to_cdr

SHIPPED = CONFIG_DIR / "fear.yaml"
OTHER = SHIPPED.read_text(encoding="utf-8").replace("low:       {at: 0.25,", "low:       {at: 0.3,")
EDGES = replace(ESTIMATE, marked=False)


def record_a_change(path: Path) -> None:
    changed = path.with_name("other.yaml")
    changed.write_text(OTHER, encoding="utf-8")
    drive = Drive.under_way()
    with Recording(path, attachments(SHIPPED)) as file:

        def drive_on(frames: int) -> None:
            for _ in range(frames):
                decision = drive.frame(cv=EDGES)
                file.add(DECISION.key, to_cdr(decision), at_s=decision.decided_s)

        drive_on(5)
        rules = FearRules.load(changed)
        drive.supervisor.adopt(rules)
        diagnostic = Diagnostic(
            t_s=drive.now_s,
            process="supervisor",
            health=Health.OK,
            message="",
            values=RuleChange(rules, "", OTHER).values(from_s=drive.now_s),
        )
        file.add(DIAGNOSTICS.key, to_cdr(diagnostic), at_s=drive.now_s)
        drive_on(5)


def test_every_decision_is_explained_by_its_own_rules(tmp_path: Path) -> None:
    record_a_change(tmp_path / "drive.mcap")
    drive = recall(tmp_path / "drive.mcap")
    before, after = drive.decisions[4].fear, drive.decisions[9].fear
    assert 0 < before < after
    assert all(drive.repeats(i) for i in range(10))
    assert drive.rules_from == "fear.yaml, as recorded, changed 1 times during the drive"


def test_rules_given_by_hand_explain_the_whole_drive(tmp_path: Path) -> None:
    record_a_change(tmp_path / "drive.mcap")
    drive = recall(tmp_path / "drive.mcap", SHIPPED)
    assert [drive.repeats(i) for i in range(10)] == [True] * 5 + [False] * 5
