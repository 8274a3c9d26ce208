"""Workers, their environment, and the outcomes that they leave."""

import json
import os
import signal
import subprocess
import sys
from functools import partial

import pytest
from tasks import blocked_signals, die, refuse, size, unpicklable, wait_for_others

from experiments.cli import options, running
from experiments.runs import THREADS, environment, one_thread_each
from experiments.runs.workers import Checkpoint, Workers, worker_pool
from ident.errors import InputError

LARGE = bytes(2_000_000)  # More bytes than a pipe holds.


def test_local_workers_are_other_processes_with_one_thread_which_ignore_requests_to_end(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "8")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)
    with worker_pool(2) as pool:
        tasks = [pool.submit(size, LARGE, plus=k) for k in range(5)]
        refused, lost = pool.submit(refuse, "this"), pool.submit(unpicklable)
        assert [task.result() for task in tasks] == [len(LARGE) + k for k in range(5)]
        with pytest.raises(ValueError, match="not this"):
            refused.result()
        with pytest.raises(TypeError, match="pickle"):
            lost.result()
        assert [pool.submit(os.getenv, name).result() for name in THREADS] == ["1"] * 3
        assert pool.submit(os.getpid).result() != os.getpid()
        if sys.platform != "win32":
            assert {signal.SIGINT, signal.SIGTERM} <= pool.submit(blocked_signals).result()
            assert signal.SIGINT not in blocked_signals()
    with pytest.raises(RuntimeError, match="after shutdown"):
        pool.submit(size, LARGE)
    assert 2 * Workers(2).threads <= max(os.cpu_count(), 2)
    assert os.environ["OMP_NUM_THREADS"] == "8" and "MKL_NUM_THREADS" not in os.environ


def test_a_dead_worker_is_one_sentence_however_large_the_tasks_are():
    with pytest.raises(ValueError, match="A worker process died"), worker_pool(2) as pool:
        for task in [pool.submit(die, LARGE) for _ in range(8)]:
            task.result()


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


def outcome(number):
    return json.dumps([number, number**2])


def answers(numbers, error=None):
    """Outcomes of tasks in pairs, the latter one first, and then perhaps an error."""
    for number in numbers[::2]:
        yield {k: outcome(k) for k in (number + 1, number)}
    if error is not None:
        raise error


@pytest.fixture
def run(tmp_path):
    return Checkpoint("runs", tmp_path / "runs.npz", {"seed": 1, "scale": (0.5, 1)})


@pytest.mark.parametrize("error", [ValueError("refused"), KeyboardInterrupt(), MemoryError()])
def test_whatever_fails_the_outcomes_are_kept(run, capsys, error):
    with pytest.raises(InputError, match=r"--resume goes on with the runs in .*, but none is done; leave it out\."):
        run.done()
    with pytest.raises(type(error)):
        run.collect(answers([], error), [""] * 8)
    assert run.done() == [] and "None of the runs is done; settings are in" in capsys.readouterr().err
    outcomes = [""] * 8
    with pytest.raises(type(error)):
        run.collect(answers([0, 1, 4, 5], error), outcomes)
    assert run.done() == outcomes[:6] == [*map(outcome, range(2)), "", "", *map(outcome, (4, 5))]
    assert f"The runs done so far are in {run.file}; run again with --resume" in capsys.readouterr().err
    run.collect(answers([2, 3, 6, 7]), outcomes)
    assert run.done() == outcomes == [*map(outcome, range(8))]


def test_a_long_task_holds_up_no_others(run):
    """Every other worker would wait for the first task, which lasts until all others are done."""
    done = run.file.with_name("done")
    done.mkdir()
    assert Workers(2).collected(partial(wait_for_others, done, 9), range(10), run) == list(range(10))
    assert Workers(2, resume=True).collected(refuse, range(10), run) == list(range(10))
    run.file.unlink()


NAMES = (*THREADS, "MUJOCO_GL")


@pytest.mark.parametrize("own", [{}, {"OMP_NUM_THREADS": "8"}, {"MUJOCO_GL": "egl"}])
def test_commands_take_one_thread_and_look_for_no_screen_unless_the_user_says_otherwise(monkeypatch, own):
    for name in NAMES:
        monkeypatch.delenv(name, raising=False)
    for name, value in own.items():
        monkeypatch.setenv(name, value)
    during, parser = {}, options.parser("any", None, {})
    assert running.run(lambda _: during.update(os.environ), lambda: parser, ()) == 0
    assert {name: os.environ[name] for name in NAMES if name in os.environ} == own
    threads = {} if "OMP_NUM_THREADS" in own else dict.fromkeys(THREADS, "1")
    assert {name: during[name] for name in NAMES if name in during} == {**threads, "MUJOCO_GL": "disable"} | own


def test_linear_algebra_may_have_threads_of_its_own(monkeypatch):
    for name in THREADS:
        monkeypatch.delenv(name, raising=False)
    one = {"OMP_NUM_THREADS": "1"}
    for stated, alone in (({}, False), (one, True), (one | {"MKL_NUM_THREADS": "4"}, False)):
        with pytest.raises(KeyError), environment(stated):
            assert one_thread_each() == alone
            raise KeyError
        assert not {*THREADS} & os.environ.keys(), "variables are as before whatever happens"
