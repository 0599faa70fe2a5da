"""Processes that work for another: they end with it, however it ends, and so does what they share."""

from __future__ import annotations

import errno
import os
import shutil
import signal
import subprocess
import sys
import threading
from contextlib import suppress
from multiprocessing import active_children, get_context
from pathlib import Path

import numpy as np
import pytest

from estimator.numerics import memory
from estimator.numerics.broadcast import Broadcaster
from estimator.numerics.memory import SharedMemory
from estimator.numerics.pool import worker_pool
from estimator.numerics.worker import Worker
from humanoid.support.errors import InputError
from tests.waiting import DEADLINE, until
from tests.worker_jobs import Table, TableJob, fill, work_on

pytestmark = pytest.mark.usefixtures("default_signals")

ROOT = Path(__file__).parent.parent
ENVIRONMENT = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}


def alive(pid: int) -> bool:
    """Whether a process is there and not just waiting to be buried by a first process that never does."""
    state = subprocess.run(["ps", "-o", "stat=", "-p", str(pid)], capture_output=True, text=True, check=False).stdout
    return bool(state.strip()) and not state.startswith("Z")


@pytest.mark.parametrize(("number", "everybody"), [(signal.SIGKILL, False), (signal.SIGTERM, True)])
def test_workers_at_work_end_with_their_leader(number: signal.Signals, everybody: bool) -> None:
    """Nothing keeps the caller's pipes open either."""
    leader = subprocess.Popen(
        [sys.executable, "-m", "tests.worker_jobs"], stdout=subprocess.PIPE, env=ENVIRONMENT, cwd=ROOT,
        start_new_session=True,
    )  # fmt: skip
    assert leader.stdout is not None
    try:
        working = [int(pid) for pid in leader.stdout.readline().split()]
        assert len(working) == 2
        if everybody:
            os.killpg(leader.pid, number)
        else:
            leader.send_signal(number)
        leader.communicate(timeout=DEADLINE)  # to the end of the pipe
        until(lambda: not any(alive(pid) for pid in working), "the workers end")
    finally:
        with suppress(ProcessLookupError):
            os.killpg(leader.pid, signal.SIGKILL)


def test_a_worker_at_work_is_not_waited_for() -> None:
    worker = Worker(work_on)
    pid = worker.receive()
    closing = threading.Thread(target=worker.close, args=(0.0,), daemon=True)
    closing.start()
    closing.join(DEADLINE)
    assert not alive(pid)


def test_a_pool_works_for_what_is_no_search() -> None:
    """Every process gets pieces; contexts follow each other, and what is done everywhere stays until the next one."""
    meeting = get_context("spawn").Barrier(3, timeout=DEADLINE)
    tables = [Table(np.arange(float(2 * rows)).reshape(rows, 2), meeting) for rows in (40, 5000)]
    with worker_pool(TableJob(2.0, meeting), 3) as pool:
        for table in tables:
            pool.show(table)
            for offset in (0.0, 1.0):
                done = pool.each(Table.row, range(40))
                assert [value for value, _ in done] == [4.0 * i + 1.0 + offset for i in range(40)]
                met = pool.each(Table.row_of_each, range(3))
                assert [value for value, _ in met] == [4.0 * i + 1.0 + offset for i in range(3)]
                assert len({pid for _, pid in met}) == pool.size == 3
                pool.everywhere(Table.shift, 1.0)
            assert table.offset == 2.0
        with pytest.raises(IndexError):
            pool.each(Table.row, [10**6] * 40)
        assert pool.each(Table.row, [0, 1]) == [(3.0, os.getpid()), (7.0, os.getpid())]  # alone from now on
    assert active_children() == []
    with pytest.raises(KeyboardInterrupt), worker_pool(TableJob(2.0, meeting), 3):
        signal.raise_signal(signal.SIGINT)
    assert active_children() == []
    with worker_pool(TableJob(2.0, meeting), 1) as alone:
        with pytest.raises(RuntimeError, match="shown"):
            alone.each(Table.row, [0])
        alone.show(tables[0])
        assert {pid for _, pid in alone.each(Table.row, range(4))} == {os.getpid()}


def test_memory_is_reserved_before_it_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without that a full /dev/shm is a bus error in the process that writes first."""

    def full(*_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    open_files = len(os.listdir("/dev/fd"))
    for name in ("posix_fallocate", "pwrite"):
        monkeypatch.setattr(os, name, full, raising=False)
    with (
        Broadcaster() as broadcaster,
        pytest.raises(InputError, match=r"workers: 80 MB.* No space left.*--workers 1") as raised,
    ):
        broadcaster.show(np.zeros(10**7))
    assert len(str(raised.value)) < 200
    assert len(os.listdir("/dev/fd")) == open_files


@pytest.mark.parametrize("missing", [(), ("memfd_create", "posix_fallocate")])
def test_memory_without_a_name(missing: tuple[str, ...], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """On systems without files in memory it is a file on the disk, which has no name either."""
    for name in missing:
        monkeypatch.delattr(os, name, raising=False)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    size = 3_000_000
    made, other = SharedMemory.of_size(size), Worker(fill, size)
    assert os.fstat(made.descriptor).st_blocks * 512 >= size  # it is there, and not only promised
    made.data[:3] = b"abc"
    other.hand_over(made.descriptor)
    assert other.receive() == size
    assert made.data[:3] == b"\0\0\0"
    assert list(tmp_path.iterdir()) == []
    other.close()
    made.close()


@pytest.mark.skipif(not shutil.which("unshare") or os.getuid() != 0, reason="needs a mount namespace")
def test_dev_shm_may_be_tiny() -> None:
    """As in a container."""
    code = "from estimator.numerics.memory import SharedMemory; m = SharedMemory.of_size(8 << 20); "
    code += "m.data[:] = bytes(8 << 20); print('well')"
    script = f'mount -t tmpfs -o size=64k none /dev/shm || exit 77; exec {sys.executable} -c "{code}"'
    done = subprocess.run(
        ["unshare", "-m", "sh", "-c", script], capture_output=True, text=True, env=ENVIRONMENT, cwd=ROOT, check=False,
        timeout=DEADLINE,
    )  # fmt: skip
    if done.returncode in (1, 77) and "well" not in done.stdout and "Error" not in done.stderr:
        pytest.skip(f"no mount namespace here: {done.stderr.strip()}")
    assert (done.returncode, done.stdout) == (0, "well\n")


def test_no_memory_at_all_is_said(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delattr(os, "memfd_create", raising=False)
    monkeypatch.setattr(memory.tempfile, "tempdir", str(tmp_path / "missing"))
    with pytest.raises(InputError, match="TMPDIR"):
        SharedMemory.of_size(10)
