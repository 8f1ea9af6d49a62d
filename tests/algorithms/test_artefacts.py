"""What runs share is built once, goes on after a kill, and those who wait for it say so."""

import fcntl
import json
import threading

import pytest

from algorithms import artefacts, atomic
from algorithms.artefacts import cached
from algorithms.checkpoints import FileCheckpoints
from algorithms.driving_agent import DrivingAgentSpec, driving_agent


class Killed(BaseException):
    """Stands for a kill."""


def test_a_driving_agent_that_was_killed_goes_on_to_the_same_bytes(tmp_path, monkeypatch):
    def kill(steps, _scalars):
        if steps == spec.steps:
            raise Killed

    monkeypatch.setattr(FileCheckpoints, "due", lambda _self, steps: steps % 400 == 0 and steps > 0)
    spec, told = DrivingAgentSpec("a", 2_400), []
    driving_agent(spec, tmp_path / "whole")
    with pytest.raises(Killed):
        driving_agent(spec, tmp_path / "killed", kill)
    assert (tmp_path / "killed" / f"{spec.key}.checkpoints").is_dir()
    driving_agent(spec, tmp_path / "killed", lambda steps, _scalars: told.append(steps))
    assert told[0] == 2_000, "it went on where the last checkpoint was"
    for name in ("actor.safetensors", "actor.json", "agent.json"):
        whole, killed = (tmp_path / folder / spec.key / name for folder in ("whole", "killed"))
        assert whole.read_bytes() == killed.read_bytes(), name
    assert json.loads(whole.read_text())["curve"][-1]["steps"] == spec.steps
    assert sorted(path.suffix for path in (tmp_path / "killed").iterdir()) == ["", ".lock"]


def test_who_waits_for_an_artefact_gives_signs_of_life_and_then_finds_it(tmp_path, monkeypatch):
    monkeypatch.setattr(artefacts, "WAIT_S", 0.01)
    waited = threading.Event()
    with (tmp_path / "thing.lock").open("a") as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        found = []
        waiter = threading.Thread(
            target=lambda: found.append(cached(tmp_path / "thing", lambda _folder: pytest.fail("built"), waited.set))
        )
        waiter.start()
        assert waited.wait(timeout=60)
        (tmp_path / "thing").mkdir()
    waiter.join(timeout=60)
    assert found == [tmp_path / "thing"]


def test_what_a_killed_builder_left_is_removed(tmp_path):
    leftover = tmp_path / f"{atomic.TEMPORARY}123-thing"
    leftover.mkdir()
    cached(tmp_path / "thing", lambda folder: (folder / "whole").touch())
    assert not leftover.exists()
    assert (tmp_path / "thing" / "whole").exists()
