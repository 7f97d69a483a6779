from __future__ import annotations

import resource
import struct
import zlib
from typing import TYPE_CHECKING

import pytest

from flexarm_ident.models.files import load_model, save_model
from flexarm_ident.models.model_parameters import ModelFileError
from support.ident_systems import random_model

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture
def content(tmp_path: Path) -> bytes:
    """Return a MAT-file with a model of three states."""
    model = random_model(1, states=3, outputs=2, inputs=2)
    save_model(tmp_path / "arm.mat", model, name="arm", provenance={"source": "a bag"})
    return (tmp_path / "arm.mat").read_bytes()


def foreign(folder: Path, content: bytes) -> Path:
    """Write a MAT-file without our digest, which tells damage before scipy sees it."""
    path = folder / "model.mat"
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(116) + content[116:])
    return path


def test_load_model___foreign_mat_file_that_kills_scipy___is_refused(
    tmp_path: Path, content: bytes
) -> None:
    # Nine doubles become nine numbers of the type 521, which is none: scipy before 1.18 dies of it.
    damaged = content.replace(struct.pack("<II", 9, 72), struct.pack("<II", 521, 72))
    assert damaged != content
    with pytest.raises(ModelFileError, match=r"model\.mat: no MAT-file of version 5: "):
        load_model(foreign(tmp_path, damaged))


@pytest.mark.slow
@pytest.mark.exhaustive
def test_load_model___foreign_mat_file_of_gigabytes___is_refused(
    tmp_path: Path, content: bytes
) -> None:
    # A matrix of 1 GB in five megabytes, compressed as MATLAB does it: flags, size, name, numbers.
    flags, name = struct.pack("<IIII", 6, 8, 6, 0), struct.pack("<HH4s", 1, 1, b"A")
    numbers = struct.pack("<II", 9, 1 << 30)
    rest = flags + struct.pack("<IIII", 5, 8, 1, 1 << 27) + name + numbers
    compressor = zlib.compressobj(1)
    packed = compressor.compress(struct.pack("<II", 14, len(rest) + (1 << 30)) + rest)
    packed += b"".join(compressor.compress(bytes(1 << 20)) for _ in range(1024))
    packed += compressor.flush()
    head = content[:128] + struct.pack("<II", 15, len(packed))
    before_kb = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    with pytest.raises(ModelFileError, match=r"model\.mat: no MAT-file of version 5: "):
        load_model(foreign(tmp_path, head + packed))
    # The largest child so far may have been another test's.
    assert resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss <= max(before_kb, 800 << 10)
