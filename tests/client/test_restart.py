"""A client lives through the restart of its service, killed in the middle of its work."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

import brdfcore as bc
from brdfcore import testing
from brdfcore.client import Client
from tests.client.serving import Service


@pytest.fixture
def service(folder: Path) -> Iterator[Service]:
    made = Service(folder)
    made.start()
    yield made
    made.kill()


def test_survives_restarts_within_the_deadline(service: Service, local: dict[str, bc.Brdf]) -> None:
    angles = testing.sample_angles(500)
    expected = local["gold-grid"].evaluate(*angles)
    answers: list[bool] = []
    errors: list[BaseException] = []
    over = threading.Event()

    def work() -> None:
        try:
            # the first request finds nobody listening yet
            with Client(service.url, deadline=40) as client:
                gold = client.material("gold-grid")
                while not over.is_set():
                    answers.append(np.array_equal(gold.evaluate(*angles), expected))
        except BaseException as error:
            errors.append(error)

    worker = threading.Thread(target=work)
    worker.start()
    service.wait()
    for number in (signal.SIGKILL, signal.SIGTERM):
        before = len(answers)
        wait_for(lambda before=before: len(answers) > before + 3 or bool(errors))
        service.kill(number)
        service.start()
    before = len(answers)
    wait_for(lambda: len(answers) > before + 3 or bool(errors))
    over.set()
    worker.join()
    assert errors == []
    assert all(answers)


def wait_for(true: Callable[[], bool], seconds: float = 40) -> None:
    until = time.monotonic() + seconds
    while not true() and time.monotonic() < until:
        time.sleep(0.02)
    assert true()
