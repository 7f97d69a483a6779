"""Virtual time waits for the recorder: samples and commands are whole, however it is stopped."""

from __future__ import annotations

import os
import signal
import threading
import time
from typing import TYPE_CHECKING

import numpy as np
import pytest

from support.recorded_samples import States, answered_samples

if TYPE_CHECKING:
    from pathlib import Path

    from support.system_graph import Graph

pytestmark = [pytest.mark.system, pytest.mark.slow]

SAMPLES = 24_000
"""At least a third more than a reader that is stopped can leave to its writer."""


@pytest.mark.exhaustive
def test_record___recorder_stopped_for_seconds___has_every_sample_and_command(
    graph: Graph, tmp_path: Path
) -> None:
    bag = tmp_path / "bag"
    recorder = graph.start("recorder", {"topics": ["state", "command"]})
    graph.start("controller", {"law": "pd", "reference": "square"})
    graph.start("daq", {"samples": SAMPLES, "real_time_factor": 0.0, "rate_hz": 1000.0})
    graph.activate_loop()
    graph.operator.record(str(bag))
    ended = threading.Event()

    def stop_and_go() -> None:
        while not ended.wait(0.2):
            os.kill(recorder.popen.pid, signal.SIGSTOP)
            time.sleep(3.0)
            os.kill(recorder.popen.pid, signal.SIGCONT)

    interruptions = threading.Thread(target=stop_and_go)
    interruptions.start()
    try:
        assert graph.transition("daq", "activate")
        graph.await_state("daq", "inactive")
    finally:
        ended.set()
        interruptions.join()
    # As the verbs do: it waits until its readers have every command.
    assert graph.transition("controller", "deactivate")
    graph.operator.record(None)

    run = States(bag)
    np.testing.assert_array_equal(run.sequence, np.arange(1, SAMPLES + 1))
    # The last sample ends the run, and nobody waits for its answer.
    answered = [sample for sample in answered_samples(bag) if sample < SAMPLES]
    np.testing.assert_array_equal(answered, np.arange(1, SAMPLES))
