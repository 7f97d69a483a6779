"""One thread of BLAS: inside, nested, after errors, in several threads, and around `identify`."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

BEFORE = 2
DEADLINE_S = 60.0
HEAD = """
import json
import scipy.linalg
from threadpoolctl import ThreadpoolController
from flexarm_ident.fitting.blas import one_thread

def threads():
    found = ThreadpoolController().select(user_api="blas").info()
    return sorted({each["num_threads"] for each in found})

seen = [threads()]
"""
NESTED = """
with one_thread():
    seen.append(threads())
    with one_thread():
        seen.append(threads())
    try:
        with one_thread():
            1 / 0
    except ZeroDivisionError:
        pass
seen.append(threads())
"""
IN_A_THREAD = """
from threading import Thread

@one_thread()
def look():
    seen.append(threads())

for _ in range(2):
    one = Thread(target=look)
    one.start()
    one.join()
seen.append(threads())
"""
IDENTIFICATION = """
import numpy as np
from flexarm_ident import IoData, identify

rng = np.random.default_rng(0)
u = rng.normal(size=(900, 1))
y = 0.01 * np.cumsum(u, axis=0) + 0.01 * rng.normal(size=u.shape)
inside = set()
data = IoData(u, y, dt_s=0.01, inputs=("u",), outputs=("y",))
found = identify(data, progress=lambda _stage, _part: inside.add(tuple(threads())))
seen += [*map(list, inside), threads()]
"""


@pytest.mark.parametrize(
    ("program", "inside"), [(NESTED, 2), (IN_A_THREAD, 2), (IDENTIFICATION, 1)]
)
@pytest.mark.slow
def test_blas___inside___has_one_thread_and_its_own_number_after(program: str, inside: int) -> None:
    done = subprocess.run(  # noqa: S603 - the programs above
        [sys.executable, "-c", f"{HEAD}{program}print(json.dumps(seen))"],
        env=os.environ | {"OPENBLAS_NUM_THREADS": str(BEFORE)},
        capture_output=True,
        text=True,
        timeout=DEADLINE_S,
        check=True,
    )
    seen = json.loads(done.stdout)
    if seen[0] != [BEFORE]:
        pytest.skip(f"this BLAS has {seen[0]} threads where {BEFORE} are asked for")
    assert seen == [[BEFORE], *[[1]] * inside, [BEFORE]]
