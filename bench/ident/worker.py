"""One measurement of the identification benchmark, in a process and an environment of its own.

It runs where the measured method is installed, so it imports numpy and that method only. Arguments:
method, folder with `u.npy` and `y.npy`, order (0: of its own choice), block rows. The answer is a
line of JSON.
"""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

# Before numpy loads its BLAS.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_variable] = "1"

import numpy as np  # noqa: E402 - see above

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    # A, B, C and D; None for what the method does not give. Ours adds how many eigenvalues its
    # policy moved inside the unit circle.
    Model = tuple[Any, ...]
    Prepare = Callable[[Array, Array], Any]
    Identify = Callable[[Any, int, int], Model]

DT_S = 1.0 / 300.0
_WARM_UP_SAMPLES = 400


def flexarm(method: str) -> tuple[Prepare, Identify]:
    """Our own estimators: A, B, C and x0."""
    from flexarm_ident import IoData, identify  # noqa: PLC0415 - only where it is measured

    def prepare(u: Array, y: Array) -> IoData:
        outputs = tuple(f"y{channel}" for channel in range(y.shape[1]))
        return IoData(u, y, dt_s=DT_S, inputs=("u",), outputs=outputs)

    def run(data: IoData, order: int, block_rows: int) -> Model:
        found = identify(data, order=order, block_rows=block_rows, method=method, feedthrough=False)
        model = found.model
        return model.A, model.B, model.C, model.D, found.moved_eigenvalues

    return prepare, run


def ctrlsys() -> tuple[Prepare, Identify]:
    """SLICOT: N4SID from the Cholesky factor of the data's Gram matrix, without x0.

    Its routine for x0 takes as long again, and ten times as long when fast modes decay into
    denormal numbers.
    """
    import ctrlsys as slicot  # noqa: PLC0415

    def prepare(u: Array, y: Array) -> tuple[Array, Array]:
        return np.asfortranarray(u), np.asfortranarray(y)

    def run(data: tuple[Array, Array], order: int, block_rows: int) -> Model:
        u, y = data
        r, m = u.shape[1], y.shape[1]
        gap, factor = slicot.ib01ad(
            "N", "C", "M", "O", "N", "N", block_rows, r, m, u, y, 0.0, -1.0
        )[:2]
        order = order or max(1, min(gap, block_rows - 1))
        A, C, B, D = slicot.ib01bd("N", "A", "N", block_rows, order, r, m, len(u), factor, 0.0)[:4]
        return A, B, C, D

    return prepare, run


def sippy() -> tuple[Prepare, Identify]:
    """SIPPY's N4SID, without x0."""
    import sippy_unipi  # noqa: PLC0415

    def prepare(u: Array, y: Array) -> tuple[Array, Array]:
        return u.T, y.T

    def run(data: tuple[Array, Array], order: int, block_rows: int) -> Model:
        u, y = data
        own = {"IC": "AIC", "SS_orders": [1, min(10, block_rows - 1)]}
        chosen = {"SS_fixed_order": order} if order else own
        found = sippy_unipi.system_identification(
            y, u, "N4SID", tsample=DT_S, SS_f=block_rows, **chosen
        )
        return found.A, found.B, found.C, found.D

    return prepare, run


def mdof() -> tuple[Prepare, Identify]:
    """SRIM of mdof, A and C only."""
    from mdof.realize import srim  # noqa: PLC0415

    def prepare(u: Array, y: Array) -> tuple[Array, Array]:
        return u.T, y.T

    def run(data: tuple[Array, Array], order: int, block_rows: int) -> Model:
        A, _, C, _ = srim(*data, horizon=block_rows, order=order, full=False, find="AC")
        return A, None, C, None

    return prepare, run


PEERS = {"ctrlsys": ctrlsys, "sippy": sippy, "mdof": mdof}


def measure(method: str, folder: Path, order: int, block_rows: int) -> dict[str, Any]:
    """Return CPU seconds, peak memory above the loaded data, and the model."""
    prepare, identify = PEERS[method]() if method in PEERS else flexarm(method)
    u, y = np.load(folder / "u.npy"), np.load(folder / "y.npy")
    # Imports on demand and the first call into BLAS are not the method's.
    identify(prepare(u[:_WARM_UP_SAMPLES], y[:_WARM_UP_SAMPLES]), 2, 4)
    data = prepare(u, y)
    del u, y
    # Loading has its own peak: start a new one.
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    before_kb = _status_kb("VmRSS")
    start_s = time.process_time()
    model = identify(data, order, block_rows)
    cpu_s = time.process_time() - start_s
    return {
        "cpu_s": cpu_s,
        "memory_mb": (_status_kb("VmHWM") - before_kb) / 1024.0,
        "model": [None if part is None else np.asarray(part).tolist() for part in model],
    }


def _status_kb(field: str) -> int:
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(field))


if __name__ == "__main__":
    answer = measure(sys.argv[1], Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]))
    sys.stdout.write("\n" + json.dumps(answer) + "\n")
