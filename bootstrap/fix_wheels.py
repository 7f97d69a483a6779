"""Make the CMake files of the ROS 2 wheels name this machine's Python and numpy.

The wheels carry the include paths of the machine that built them. Run after every installation;
running it again changes nothing. Usage, with the environment's own Python:
`python bootstrap/fix_wheels.py`.
"""

from __future__ import annotations

import re
import sys
import sysconfig
from pathlib import Path

import numpy as np

BUILDERS_NUMPY = re.compile(r'/opt/python/[^";]*/numpy/(?:_core|core)/include')
BUILDERS_PYTHON = re.compile(r'/opt/python/[^";]*/include/python3\.\d+')


def main() -> None:
    """Rewrite the files in place."""
    python_include = sysconfig.get_path("include")
    for file in Path(sys.prefix, "share").glob("*/cmake/*.cmake"):
        text = file.read_text()
        fixed = BUILDERS_PYTHON.sub(python_include, BUILDERS_NUMPY.sub(np.get_include(), text))
        if fixed != text:
            file.write_text(fixed)


main()
