"""Trials and sweeps on the workers of a real Dask cluster on this machine."""

import logging
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from itertools import count

import numpy as np
import pytest
from commands import refusal
from fits import fitted, sampled
from mechanisms import GRAVITY, double_pendulum, random_states
from trial_runs import Mortal, draw, interrupted, kept, resumed, run

import scenes
from experiments import multicontact, stream, sweep
from experiments.runs.workers import worker_pool
from ident.estimation.pieces import in_order
from sim.motion.excitation import DOUBLE_PENDULUM
from sim.simulation.simulate import simulate

distributed = pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")
cluster_module = pytest.importorskip("experiments.runs.cluster")

TREE = double_pendulum()
ONE = {"OPENBLAS_NUM_THREADS": "1"}


@contextmanager
def started(pattern, *command, **environment):
    """Starts a part of a cluster as users do, and returns its first matching output."""
    command = [sys.executable, "-m", "dask", *command, "--no-dashboard"]
    with (
        tempfile.TemporaryFile() as log,
        subprocess.Popen(command, stdout=log, stderr=log, env=os.environ | environment) as process,
    ):
        try:
            while not (match := re.search(pattern, os.pread(log.fileno(), 100_000, 0))):
                assert process.poll() is None
                time.sleep(0.05)
            yield process, match[1].decode()
        finally:
            process.terminate()


def started_scheduler(*more):
    return started(rb"Scheduler at:\s+(t\w\w://\S+)", "scheduler", "--host", "127.0.0.1", "--port", "0", *more)


def started_worker(address, *more, **environment):
    return started(rb"Registered to:\s+(t\w\w://\S+)", "worker", address, "--nthreads", "1", *more, **environment)


@pytest.fixture(scope="module")
def cluster():
    settings = {"dashboard_address": ":0", "silence_logs": logging.CRITICAL, "host": "127.0.0.1", "death_timeout": 60}
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, **settings) as cluster:
        yield cluster


@pytest.fixture(scope="module")
def address(cluster):
    return cluster.scheduler_address


def negative(k):
    return -k


def test_workers_have_one_thread_for_linear_algebra(address):
    with worker_pool(1, address) as pool:
        assert (pool.ahead, pool.threads) == (4, 1)
        values = in_order(pool.executor, os.getenv, ["OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"])
        assert list(values) == ["1", "1"]
        assert list(in_order(pool.executor, negative, range(100), ahead=7)) == [-k for k in range(100)]


def test_a_worker_killed_in_the_middle_changes_no_number(address, tmp_path):
    source = draw(tmp_path, "--redraw", "sensors")
    whole = run(source, 40, tmp_path, file=tmp_path / "whole.npz")
    mortal = Mortal.at(25, source, tmp_path)
    with worker_pool(1, address) as pool:
        outcomes = run(source, 40, tmp_path, executor=pool.executor, analyse=mortal)
    assert mortal.died.exists()
    np.testing.assert_array_equal(outcomes, whole)
    np.testing.assert_array_equal(kept(tmp_path), whole)


def test_a_task_that_kills_every_worker_is_one_sentence_and_costs_no_trials(cluster, address, tmp_path, monkeypatch):
    source = draw(tmp_path, "--redraw", "sensors")
    whole = run(source, 40, tmp_path)
    monkeypatch.setattr(cluster.scheduler, "allowed_failures", 0)
    with (
        pytest.raises(ValueError, match=r"workers of the cluster at tcp://127\.0\.0\.1:\d+ died of the same task"),
        worker_pool(1, address) as pool,
    ):
        run(source, 40, tmp_path, executor=pool.executor, analyse=Mortal.at(25, source, tmp_path))
    before = kept(tmp_path)
    assert 16 <= len(before) <= 25
    np.testing.assert_array_equal(resumed(source, 40, tmp_path), whole)


@pytest.mark.usefixtures("undrawn", "no_trajectory", "here")
def test_the_command_line_takes_a_cluster(address, tmp_path):
    command = [
        "--formats",
        "png",
        "--samples",
        "200",
        "--trials",
        "8",
        "--trajectory-trials",
        "2",
        "--redraw",
        "sensors",
    ]
    assert multicontact.main([*command, "--out", str(tmp_path / "local")]) == 0
    assert multicontact.main([*command, "--out", str(tmp_path / "far"), "--scheduler", address]) == 0
    np.testing.assert_array_equal(kept(tmp_path / "far"), kept(tmp_path / "local"))


def test_pieces_are_identified_while_a_worker_dies(cluster, address):
    rng = np.random.default_rng(0)
    states = random_states(rng, TREE, 1200)
    whole = sampled(*states, rng.normal(size=(1200, 6)))

    def read():
        for k in range(0, 1200, 30):
            if k == 600:
                with distributed.Client(address, set_as_default=False) as client:
                    victim = next(iter(client.run(os.getpid).values()))
                os.kill(victim, signal.SIGKILL)
            yield whole[k : k + 30]

    alone = fitted(TREE, whole, gravity=GRAVITY)
    with worker_pool(1, address) as pool:
        fit = fitted(TREE, read(), gravity=GRAVITY, executor=pool.executor, ahead=pool.ahead)
    assert fit.samples == 1200 and "of 40 chunks" in fit.method
    np.testing.assert_allclose(fit.psi, alone.psi, rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(fit.covariance, alone.covariance, rtol=1e-8, atol=1e-12)


def test_a_long_recording_is_read_for_a_cluster(address, tmp_path):
    spec = scenes.load("double_pendulum")
    simulate(spec, DOUBLE_PENDULUM, samples=400).save(tmp_path / "long.npz")
    (tmp_path / "model.xml").write_text(spec.to_xml())
    command = [str(tmp_path / "model.xml"), str(tmp_path / "long.npz"), "--base", "base", "--piece", "60", "--out"]
    assert stream.main([*command, str(tmp_path / "local")]) == 0
    assert stream.main([*command, str(tmp_path / "far"), "--scheduler", address]) == 0
    local, far = (tmp_path / where / "base_parameters.csv" for where in ("local", "far"))
    assert far.read_bytes() == local.read_bytes()


def test_a_sweep_takes_a_cluster(address, tmp_path):
    command = ["multicontact", "--over", "noise_scale", "0", "1", "--formats", "png", "--out"]
    assert sweep.main([*command, str(tmp_path / "local")]) == 0
    assert sweep.main([*command, str(tmp_path / "far"), "--scheduler", address]) == 0
    local, far = (tmp_path / where / "multicontact/noise_scale/table_sweep.csv" for where in ("local", "far"))
    assert far.read_bytes() == local.read_bytes()


def test_ctrl_c_ends_the_command_and_leaves_the_cluster(address, tmp_path):
    command = ["--trials", "100000", "--redraw", "sensors", "--scheduler", address, "--out", str(tmp_path)]
    code, output = interrupted([*command, "--formats", "png"], rb" [1-9]\d*/100000")
    assert code == 130
    assert b"Traceback" not in output
    assert b"run again with --resume" in output
    assert b"every file is whole" in output
    with worker_pool(1, address) as pool:
        assert pool.executor.submit(negative, 2).result() == -2


@pytest.mark.usefixtures("undrawn", "no_trajectory")
def test_a_scheduler_that_cannot_be_reached_is_one_sentence(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(cluster_module, "ANSWER", 0.5)
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        command = ["--samples", "200", "--trials", "2", "--scheduler", address, "--formats", "png"]
        command += ["--out", str(tmp_path)]
        message = refusal(multicontact.main, command, capsys)
    assert f"error: There is no Dask scheduler with workers at {address} (" in message
    assert message.count("\n") == 1


def test_a_scheduler_without_workers_is_one_sentence(monkeypatch):
    monkeypatch.setattr(cluster_module, "ANSWER", 0.5)
    with (
        started_scheduler() as (_, at),
        pytest.raises(ValueError, match=f"There is no Dask scheduler with workers at {at}"),
        worker_pool(1, at),
    ):
        pass


def test_a_worker_with_many_threads_for_linear_algebra_is_refused():
    with (
        started_scheduler() as (_, at),
        started_worker(at, "--no-nanny", OPENBLAS_NUM_THREADS="2"),
        pytest.raises(ValueError, match=f"The workers of the cluster at {at} need one thread for linear algebra"),
        worker_pool(1, at),
    ):
        pass


@pytest.mark.parametrize("ahead", [1, 8])
def test_a_scheduler_that_dies_is_one_sentence(ahead):
    with (
        started_scheduler() as (scheduler, at),
        started_worker(at, "--no-nanny", **ONE),
        pytest.raises(ValueError, match=f"The connection to the Dask scheduler at {at} was lost"),
        worker_pool(1, at) as pool,
    ):
        # Tasks that were waiting when the connection ended, and later ones.
        for result in in_order(pool.executor, abs, count(), ahead=ahead):
            if result == 10:
                scheduler.kill()


def certificate(folder, name):
    """Files of a self-signed certificate and of its key."""
    files = [str(folder / f"{name}.{kind}") for kind in ("pem", "key")]
    request = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", f"/CN={name}"]
    subprocess.run([*request, "-out", files[0], "-keyout", files[1]], check=True, capture_output=True)
    return files[0], *files


@pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl makes the certificates")
def test_an_encrypted_cluster_is_taken_with_the_right_files_only(tmp_path, monkeypatch):
    ours, others = certificate(tmp_path, "ours"), certificate(tmp_path, "others")
    names = ("--tls-ca-file", "--tls-cert", "--tls-key")
    files = [x for pair in zip(names, ours, strict=True) for x in pair]
    with started_scheduler("--protocol", "tls", *files) as (_, at), started_worker(at, "--no-nanny", *files, **ONE):
        assert at.startswith("tls://")
        with worker_pool(1, at, ours) as pool:
            assert list(in_order(pool.executor, abs, range(5))) == list(range(5))
        monkeypatch.setattr(cluster_module, "ANSWER", 2.0)
        for wrong in (None, others, [*ours[:2], str(tmp_path / "none")]):
            with (
                pytest.raises(ValueError, match=f"There is no Dask scheduler with workers at {at}"),
                worker_pool(1, at, wrong),
            ):
                pass


def test_files_for_tls_need_an_address_with_it():
    for address in (None, "tcp://127.0.0.1:8786"):
        with (
            pytest.raises(ValueError, match="--tls are for a --scheduler at tls://"),
            worker_pool(1, address, ("a", "b", "c")),
        ):
            pass
