"""A run that is killed, whenever, goes on to the same bytes as one that is not."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from algorithms.registry import get_method
from bench.spec import RunSpec
from tests.bench.killing import Killing, differences, leftovers
from tests.optional import needs_omnisafe

Make = Callable[..., RunSpec]
KILLS = 20
STEPS = 4_000
"""A second or two of training, in ten parts for SAC, in four epochs on policy."""
EPOCHS = {"epoch_decisions": "200", "least_epochs": "4"}


def test_a_kill_in_the_middle_of_sac_leaves_no_trace_in_its_record(tmp_path: Path, make_spec: Make) -> None:
    version = get_method("sac").version
    killing = Killing(make_spec(method="sac", method_version=version, steps=2_400, eval_episodes=8), every_steps=400)
    whole, seconds = killing.whole(tmp_path / "whole")
    records = killing.killed(tmp_path / "killed", 2, seconds, seed=3)
    assert all(differences(record, whole) == [] for record in records)
    assert all(leftovers(record) == [] for record in records)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "at", "settings"),
    [
        ("sac", "between two roll-outs", {}),
        ("dd-rq", "between two roll-outs", {}),
        ("dd-rq:rq=shuffled", "between two roll-outs", {}),
        ("dd-rq-plus:share=shuffled", "between two roll-outs", {}),
        pytest.param("trpo-lag", "at the end of an epoch", EPOCHS, marks=needs_omnisafe),
    ],
)
def test_twenty_kills_at_random_moments_leave_no_trace_in_the_records(
    tmp_path: Path, make_spec: Make, method: str, at: str, settings: dict[str, str]
) -> None:
    def share_artefacts(results: Path) -> None:
        if (tmp_path / "whole" / "cache").exists() and not (results / "cache").exists():
            shutil.copytree(tmp_path / "whole" / "cache", results / "cache")

    version = get_method(method).version
    spec = make_spec(method=method, method_version=version, steps=STEPS, eval_episodes=8, settings=settings)
    killing = Killing(spec, 400, share_artefacts)
    whole, seconds = killing.whole(tmp_path / "whole")
    records = killing.killed(tmp_path / "killed", KILLS, seconds, seed=1)
    assert all(differences(record, whole) == [] for record in records)
    assert all(leftovers(record) == [] for record in records)
    assert {resume["at"] for record in records for resume in record.details["resumes"]} == {at}
