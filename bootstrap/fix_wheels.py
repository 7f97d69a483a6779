"""Make the wheels fit this machine, and take away what is there twice or never called.

The CMake files of the ROS 2 wheels carry the include paths of the machine that built them. A wheel
cannot hold a link, so it brings a library once for each of its names. And some bring their tests
and manuals, a tenth of the whole. Run after every installation; running it again changes nothing.
Usage, with the environment's own Python: `python bootstrap/fix_wheels.py`.
"""

from __future__ import annotations

import re
import shutil
import sys
import sysconfig
from collections import defaultdict
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

BUILDERS_NUMPY = re.compile(r'/opt/python/[^";]*/numpy/(?:_core|core)/include')
BUILDERS_PYTHON = re.compile(r'/opt/python/[^";]*/include/python3\.\d+')
NEVER_CALLED = [f"cmake/data/{part}" for part in ("bin/ctest", "bin/cpack", "share/cmake-*/Help")]
TESTED = ("numpy", "scipy", "numba", "matplotlib")  # wheels of which tests are a large part


def name_this_machine(prefix: Path) -> None:
    """Rewrite the builder's include paths in place."""
    python_include = sysconfig.get_path("include")
    for file in prefix.glob("share/*/cmake/*.cmake"):
        text = file.read_text()
        fixed = BUILDERS_PYTHON.sub(python_include, BUILDERS_NUMPY.sub(np.get_include(), text))
        if fixed != text:
            file.write_text(fixed)


def same_libraries(prefix: Path) -> Iterator[list[Path]]:
    """Yield the files that are one library, the one with the shortest name first."""
    by_size = defaultdict(list)
    for file in prefix.glob("lib/**/*.so*"):
        if file.is_file() and not file.is_symlink():
            by_size[file.stat().st_size].append(file)
    for files in by_size.values():
        by_content = defaultdict(list)
        for file in files if len(files) > 1 else ():
            by_content[sha256(file.read_bytes()).digest()].append(file)
        for same in by_content.values():
            yield sorted(same, key=lambda file: (len(file.name), str(file)))


def link_copies(prefix: Path) -> None:
    """Replace the copies of a library by hard links, which the loader finds where they were."""
    for first, *copies in same_libraries(prefix):
        for copy in copies:
            if not copy.samefile(first):
                copy.unlink()
                copy.hardlink_to(first)


def drop_what_nobody_calls(packages: Path) -> None:
    """Remove the parts that neither the build nor a run needs."""
    for pattern in NEVER_CALLED:
        for part in list(packages.glob(pattern)):
            if part.is_dir():
                shutil.rmtree(part)
            else:
                part.unlink()


def drop_tests(packages: Path) -> None:
    """Remove tests and their data; other modules stay: numpy.testing imports one of them."""
    for name in TESTED:
        for file in [*packages.glob(f"{name}/**/tests/**/*")]:
            is_helper = file.suffix == ".py" and not file.name.startswith("test_")
            if file.is_file() and not is_helper:
                file.unlink()


def main() -> None:
    """Do all of it in this environment."""
    prefix = Path(sys.prefix)
    name_this_machine(prefix)
    link_copies(prefix)
    for packages in prefix.glob("lib/python3*/site-packages"):
        drop_what_nobody_calls(packages)
        drop_tests(packages)


main()
