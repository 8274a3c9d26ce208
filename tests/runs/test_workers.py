import os
import signal
import subprocess
import sys
from itertools import count

import pytest
from tasks import blocked_signals, die, refuse, size, unpicklable

from experiments.runs.workers import Workers, worker_pool
from ident.estimation.sources import in_order

LARGE = bytes(2_000_000)
"""More bytes than a pipe holds."""


def test_local_workers_are_an_executor():
    with worker_pool(2) as pool:
        tasks = [pool.submit(size, LARGE, plus=k) for k in range(5)]
        refused, lost = pool.submit(refuse, "this"), pool.submit(unpicklable)
        assert [task.result() for task in tasks] == [len(LARGE) + k for k in range(5)]
        with pytest.raises(ValueError, match="not this"):
            refused.result()
        with pytest.raises(TypeError, match="pickle"):
            lost.result()
    with pytest.raises(RuntimeError, match="after shutdown"):
        pool.submit(size, LARGE)


def test_workers_are_other_processes_with_one_thread_for_linear_algebra(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "8")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)
    with worker_pool(2) as pool:
        for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
            assert pool.submit(os.getenv, name).result() == "1"
        assert pool.submit(os.getpid).result() != os.getpid()
    assert 2 * Workers(2).threads <= max(os.cpu_count(), 2)
    assert os.environ["OMP_NUM_THREADS"] == "8"
    assert "MKL_NUM_THREADS" not in os.environ


@pytest.mark.skipif(sys.platform == "win32", reason="signal masks are POSIX")
def test_workers_are_deaf_to_requests_to_end():
    with worker_pool(1) as pool:
        assert {signal.SIGINT, signal.SIGTERM} <= pool.submit(blocked_signals).result()
    assert signal.SIGINT not in blocked_signals()


def test_a_dead_worker_is_one_sentence_however_large_the_tasks_are():
    with pytest.raises(ValueError, match="A worker process died"), worker_pool(2) as pool:
        list(in_order(pool, die, (LARGE for _ in count()), ahead=8))


@pytest.mark.skipif(os.name != "posix", reason="pipes to several processes are POSIX")
def test_workers_end_with_a_command_that_is_killed():
    script = """if True:
        import os
        from experiments.runs.workers import Processes

        executor = Processes(2)
        executor.submit(int).result()
        os.kill(os.getpid(), 9)
    """
    # They inherit the standard error, which ends with the last of them.
    killed = subprocess.run([sys.executable, "-c", script], stderr=subprocess.PIPE, timeout=60, check=False)
    assert (killed.returncode, killed.stderr) == (-signal.SIGKILL, b"")
