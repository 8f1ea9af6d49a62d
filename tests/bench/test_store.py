"""Records are whole or absent, owned by one process, and refused by name where anything is wrong with them."""

import json
import multiprocessing
import os
import shutil
import socket
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import psutil
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from algorithms import atomic
from bench import schema, store
from bench.errors import AlreadyDoneError, LockedError, RecordError
from bench.lock import LOCK_NAME, SILENT_S, RunLock
from bench.records import collect, read_record
from bench.spec import RunSpec
from bench.store import Failure, State, Store
from envs.world import EPISODE

Make = Callable[..., RunSpec]
MakeRecord = Callable[..., Path]
CALLS = ("fsync", "replace", "rename")


class FullDisk:
    """Every n-th call of os.fsync, os.replace or os.rename fails."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, fails_at: int) -> None:
        self.calls = 0
        for name in CALLS:
            monkeypatch.setattr(os, name, self._failing(getattr(os, name), fails_at))

    def _failing(self, real: Callable[..., None], fails_at: int) -> Callable[..., None]:
        def call(*arguments: object) -> None:
            self.calls += 1
            if self.calls == fails_at:
                raise OSError(28, "No space left on device")
            real(*arguments)

        return call


def test_a_write_error_at_every_call_leaves_no_half_written_file(
    tmp_path: Path, make_record: MakeRecord, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        disk = FullDisk(patch, fails_at=-1)
        whole = make_record(tmp_path / "whole")
    contents = {path.name: path.read_bytes() for path in atomic.files_below(whole)}
    assert disk.calls == 19
    for n in range(1, disk.calls + 1):
        with monkeypatch.context() as patch:
            FullDisk(patch, fails_at=n)
            with pytest.raises(OSError, match="No space left"):
                make_record(tmp_path / str(n))
        found = list((tmp_path / str(n) / "runs").rglob("*"))
        files = [path for path in found if path.is_file()]
        assert all(path.read_bytes() == contents[path.name] for path in files), n
        assert not [path for path in found if path.name.startswith(atomic.TEMPORARY)], n
        # Only the last call, the sync of the folder after DONE was renamed, may fail with DONE there.
        assert not (n < disk.calls and any(path.name == store.DONE_FILE for path in files)), n


def test_an_overwrite_that_fails_keeps_the_old_content(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "file"
    atomic.write_file(path, b"old")
    FullDisk(monkeypatch, fails_at=1)
    with pytest.raises(OSError, match="No space left"):
        atomic.write_file(path, b"new")
    assert path.read_bytes() == b"old"


def test_what_is_done_cannot_be_begun_again(tmp_path: Path, make_spec: Make, make_record: MakeRecord) -> None:
    path = make_record(tmp_path)
    before = {file: file.read_bytes() for file in atomic.files_below(path)}
    with pytest.raises(AlreadyDoneError), Store(tmp_path).begin(make_spec()):
        pass
    Store(tmp_path).fail(make_spec(), Failure("worker", 0, "late"))
    with RunLock(path) as lock:
        store.RunFolder(path, make_spec(), lock).fail(Failure("write", 0, "the sync after DONE failed"))
    assert {file: file.read_bytes() for file in atomic.files_below(path)} == before


def test_a_new_attempt_starts_from_an_empty_folder(tmp_path: Path, make_spec: Make) -> None:
    results = Store(tmp_path)
    with results.begin(make_spec()) as folder:
        folder.write_run({})
        folder.write_policy(lambda path: (path / "weights").write_bytes(b"1") and None)
        folder.fail(Failure("train", 5, "tripped"))
    assert results.state(make_spec()) is State.FAILED
    assert results.failure(make_spec()) == Failure("train", 5, "tripped")
    with results.begin(make_spec()) as folder:
        assert [path.name for path in folder.path.iterdir()] == [LOCK_NAME]
    assert results.state(make_spec()) is State.UNFINISHED


def test_a_failure_before_anything_was_written_is_still_a_readable_row(tmp_path: Path, make_spec: Make) -> None:
    Store(tmp_path).fail(make_spec(), Failure("worker", 0, "was killed"))
    (missing,) = collect(tmp_path).missing
    assert missing.spec == make_spec()
    assert missing.reason == "failed at step 0 (worker): was killed"


def test_episodes_survive_the_round_trip() -> None:
    rng = np.random.default_rng(0)
    episodes = np.zeros(30, EPISODE)
    for name in EPISODE.names or ():
        episodes[name] = rng.integers(0, 5, 30)
    episodes["ttc_min"][3] = np.inf
    episodes["end_step"] = 5_000_000
    table = schema.from_bytes(schema.to_bytes(schema.episodes_table(episodes)), schema.EPISODES, "here")
    assert table.column_names == list(EPISODE.names or ())
    for name in table.column_names:
        np.testing.assert_array_equal(schema.column(table, name), episodes[name])


def test_a_count_that_does_not_fit_is_an_error_not_a_wrong_number() -> None:
    episodes = np.zeros(1, EPISODE)
    episodes["steps"] = 40_000
    with pytest.raises(pa.ArrowInvalid):
        schema.episodes_table(episodes)


def _hold(folder: Path, ready: "multiprocessing.Queue[str]") -> None:
    with RunLock(folder):
        ready.put("held")
        time.sleep(60)


def test_a_second_owner_is_refused_by_name_and_a_killed_owner_leaves_no_lock(tmp_path: Path) -> None:
    context = multiprocessing.get_context("spawn")
    ready: multiprocessing.Queue[str] = context.Queue()
    holder = context.Process(target=_hold, args=(tmp_path, ready))
    holder.start()
    try:
        ready.get(timeout=60)
        with pytest.raises(LockedError, match=f"process {holder.pid} on {socket.gethostname()}, since 0 min"):
            RunLock(tmp_path).__enter__()
    finally:
        holder.kill()
        holder.join()
    assert (tmp_path / LOCK_NAME).exists(), "a killed owner cannot clean up"
    with RunLock(tmp_path):
        assert json.loads((tmp_path / LOCK_NAME).read_text())["pid"] == os.getpid()
    assert not (tmp_path / LOCK_NAME).exists()


def test_a_lock_of_another_host_holds_until_it_is_silent_for_long(tmp_path: Path) -> None:
    path = tmp_path / LOCK_NAME
    path.write_text(json.dumps({"pid": 1, "host": "elsewhere", "started": time.time()}))
    with pytest.raises(LockedError, match="elsewhere"):
        RunLock(tmp_path).__enter__()
    os.utime(path, (0, time.time() - SILENT_S - 60.0))
    with RunLock(tmp_path):
        pass


def test_a_process_that_inherited_the_number_of_a_dead_owner_is_not_the_owner(tmp_path: Path, make_spec: Make) -> None:
    results = Store(tmp_path)
    with results.begin(make_spec()) as folder:
        folder.write_run({})
        assert results.state(make_spec()) is State.RUNNING
    started = psutil.Process().create_time() - 3600.0
    owner = {"pid": os.getpid(), "host": socket.gethostname(), "started": started}
    (folder.path / LOCK_NAME).write_text(json.dumps(owner))
    assert results.state(make_spec()) is State.UNFINISHED


def _edit(path: Path, **changes: object) -> None:
    path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))


def _truncate(folder: Path) -> None:
    os.truncate(folder / store.EVAL_FILE, 500)


def _other_version(folder: Path) -> None:
    _edit(folder / store.RUN_FILE, record_version=99)


def _foreign(folder: Path) -> None:
    (folder / store.RUN_FILE).write_text('{"hello": 1}')


def _copied(folder: Path) -> None:
    shutil.copytree(folder, folder.with_name("copy"))


def _retouched(folder: Path) -> None:
    spec = json.loads((folder / store.RUN_FILE).read_text())["spec"]
    _edit(folder / store.RUN_FILE, spec={**spec, "seed": 5})


def _halved_run_file(folder: Path) -> None:
    os.truncate(folder / store.RUN_FILE, 100)


def _edited_provenance(folder: Path) -> None:
    _edit(folder / store.RUN_FILE, provenance={})


def _strange_folder(folder: Path) -> None:
    other = folder.with_name("holiday")
    other.mkdir()
    (other / "photo.png").write_bytes(b"")


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (_other_version, "version 99"),
        (_foreign, "not a record of this project"),
        (_copied, "copy is a copy of a-v1_fake-learner_s0"),
        (_retouched, "specification was changed"),
        (_halved_run_file, "truncated or damaged"),
        (_edited_provenance, "not what was sealed"),
        (_strange_folder, "holiday/run.json is missing"),
    ],
)
def test_a_bad_record_is_refused_by_name_with_the_remedy(
    tmp_path: Path, make_record: MakeRecord, damage: Callable[[Path], None], message: str
) -> None:
    path = make_record(tmp_path)
    assert len(collect(tmp_path).records) == 1
    damage(path)
    with pytest.raises(RecordError, match=message) as refusal:
        collect(tmp_path)
    assert "remove" in str(refusal.value) or "move" in str(refusal.value) or "run it again" in str(refusal.value)


def test_a_truncated_table_is_refused_by_name(tmp_path: Path, make_record: MakeRecord) -> None:
    path = make_record(tmp_path)
    _truncate(path)
    with pytest.raises(RecordError, match=f"{path.name}/{store.EVAL_FILE} is not what was sealed"):
        read_record(path).eval_episodes()


def test_numbers_keep_16_significant_bits_rounded_to_the_nearest():
    # 1 + 2^-15 is the next number after 1 with 16 bits; 2^-16 is half way, and goes away from zero.
    values = np.array([1.0, 1.0 + 2.0**-15, 1.0 + 2.0**-17, 1.0 + 2.0**-16, -1.0 - 2.0**-16, np.inf, 0.0])
    expected = [1.0, 1.0 + 2.0**-15, 1.0, 1.0 + 2.0**-15, -1.0 - 2.0**-15, np.inf, 0.0]
    assert schema.rounded(values).tolist() == expected


@given(st.floats(-1e30, 1e30).filter(lambda x: x == 0.0 or abs(x) > 1e-30))
def test_rounding_moves_a_number_by_at_most_one_part_in_2_to_the_16(value):
    assert abs(float(schema.rounded(np.array([value]))[0]) - value) <= abs(value) * 2.0**-16


def test_tables_of_other_columns_are_refused_with_their_version() -> None:
    foreign = schema.to_bytes(pa.table({"x": [1]}))
    with pytest.raises(RecordError, match="version none"):
        schema.from_bytes(foreign, schema.EPISODES, "here")
    with pytest.raises(RecordError, match="not readable"):
        schema.from_bytes(b"PAR1 and nothing else", schema.EPISODES, "here")


@pytest.mark.parametrize("field", ["method_version", "scenario_version"])
def test_records_of_two_versions_never_share_a_table(tmp_path: Path, make_record: MakeRecord, field: str) -> None:
    make_record(tmp_path)
    make_record(tmp_path, seed=1, **{field: 2})
    with pytest.raises(RecordError, match="versions 1 and 2 never share a table"):
        collect(tmp_path)


def test_several_bad_records_are_all_named(tmp_path: Path, make_record: MakeRecord) -> None:
    paths = [make_record(tmp_path, seed=seed) for seed in range(3)]
    for path in paths[:2]:
        _other_version(path)
    with pytest.raises(RecordError) as refusal:
        collect(tmp_path)
    assert [path.name in str(refusal.value) for path in paths] == [True, True, False]


def test_an_empty_results_folder_is_an_empty_collection(tmp_path: Path) -> None:
    assert collect(tmp_path / "nothing") == collect(tmp_path)
    assert not collect(tmp_path).records


def test_records_that_are_known_are_not_read_again(standard_results: Path) -> None:
    first = collect(standard_results).records
    again = collect(standard_results, known=first[1:]).records
    assert [one is other for one, other in zip(first, again, strict=True)] == [False, *[True] * (len(first) - 1)]
