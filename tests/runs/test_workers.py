import os
import signal
import sys
from concurrent.futures import BrokenExecutor
from itertools import count

import pytest
from commands import refusal
from tasks import blocked_signals, die, never_ends, refuse, size, unpicklable

import experiments
from experiments import multicontact
from experiments.runs.workers import Processes, hired
from ident.estimation.in_order import in_order

LARGE = bytes(2_000_000)
"""More than a pipe holds."""


def test_processes_are_an_executor():
    with Processes(2) as executor:
        tasks = [executor.submit(size, LARGE, plus=k) for k in range(5)]
        refused, lost = executor.submit(refuse, "this"), executor.submit(unpicklable)
    assert [task.result(timeout=0) for task in tasks] == [len(LARGE) + k for k in range(5)]
    with pytest.raises(ValueError, match="not this"):
        refused.result(timeout=0)
    with pytest.raises(TypeError, match="pickle"):
        lost.result(timeout=0)


def test_processes_do_not_work_on_after_shutdown():
    with Processes(1) as executor:
        pass
    with pytest.raises(RuntimeError, match="after shutdown"):
        executor.submit(size, LARGE)


def test_workers_are_other_processes_with_one_thread_for_linear_algebra(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "8")
    with hired(2) as crew:
        assert crew.executor.submit(os.getenv, "OPENBLAS_NUM_THREADS").result() == "1"
        assert crew.executor.submit(os.getenv, "OMP_NUM_THREADS").result() == "1"
        assert crew.executor.submit(os.getpid).result() != os.getpid()
        assert 2 * crew.threads <= max(os.cpu_count(), 2)
    assert os.environ["OMP_NUM_THREADS"] == "8"


@pytest.mark.skipif(sys.platform == "win32", reason="signal masks are POSIX")
def test_workers_are_deaf_to_ctrl_c():
    with hired(1) as crew:
        assert signal.SIGINT in crew.executor.submit(blocked_signals).result()
    assert signal.SIGINT not in blocked_signals()


def test_a_dead_worker_is_one_sentence_however_large_the_tasks_are():
    with pytest.raises(ValueError, match="A worker process died"), hired(2) as crew:
        list(in_order(crew.executor, die, (LARGE for _ in count()), ahead=8))


def test_work_that_never_ends_is_left_at_once():
    with hired(2) as crew:
        tasks = [crew.executor.submit(never_ends, LARGE) for _ in range(8)]
    for task in tasks:
        assert task.cancelled() or isinstance(task.exception(timeout=0), BrokenExecutor)


@pytest.mark.parametrize(
    "address", ["localhost:8786", "tcp://localhost", "tcp://:8786", "http://a:1", "tcp://a:x", "tcp://a:99999", ""]
)
def test_a_malformed_address_is_one_sentence(address, tmp_path, capsys):
    said = refusal(multicontact.main, ["--scheduler", address, "--out", str(tmp_path)], capsys)
    assert f"--scheduler: needs an address as tcp://host:port, got '{address}'" in said


@pytest.mark.usefixtures("undrawn")
def test_a_scheduler_needs_the_extra(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    monkeypatch.delitem(sys.modules, "experiments.runs.cluster", raising=False)
    monkeypatch.delattr(experiments, "cluster", raising=False)
    command = ["--trials", "2", "--scheduler", "tcp://localhost:8786", "--formats", "png", "--out", str(tmp_path)]
    said = refusal(multicontact.main, command, capsys)
    assert "needs the package 'distributed', which the extra 'cluster' brings" in said


def test_missing_tls_files_are_named_before_any_work(tmp_path, capsys):
    ours = tmp_path / "ca.pem"
    ours.touch()
    command = ["--trials", "2", "--scheduler", "tls://127.0.0.1:1", "--tls", str(ours), "absent.pem", str(ours)]
    assert "argument --tls: needs files that exist, got 'absent.pem'" in refusal(multicontact.main, command, capsys)
