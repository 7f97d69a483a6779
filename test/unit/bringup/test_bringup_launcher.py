"""The script `flexarm` at the root: answers before the set-up, its paths, its end."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from click.testing import CliRunner

from flexarm_bringup.cli import GROUPS, main
from flexarm_bringup.console.verb_group import LazyVerbGroup
from flexarm_bringup.verbs.checkout.bench import _BENCHES
from support.exhaustive import first_of
from support.project import PROJECT

if TYPE_CHECKING:
    from collections.abc import Iterator

    import click


def environment(script: str, install: Path) -> dict[str, str]:
    """Return the environment that bash has after a script."""
    done = subprocess.run(  # noqa: S603 - our own script
        ["/bin/bash", "-c", f"{script}; /usr/bin/env -0"],
        env={
            "PATH": "/usr/bin:/bin",
            "LD_LIBRARY_PATH": "/before",
            "install": str(install),
            "home": str(install.parent),
            "suffix": install.name.removeprefix("install"),
        },
        capture_output=True,
        text=True,
        check=True,
    )
    return dict(line.split("=", 1) for line in done.stdout.split("\0") if line)


def test_kept_paths___set___what_the_script_of_colcon_sets() -> None:
    install = Path(os.environ.get("FLEXARM_INSTALL", ""))
    if PROJECT not in install.parents:
        pytest.skip("this environment was not made by ./flexarm in this checkout")
    ours = environment('source "$install/.flexarm-paths"', install)
    theirs = environment(
        'COLCON_CURRENT_PREFIX=$install; source "$install/local_setup.bash"', install
    )
    for name in ("PATH", "PYTHONPATH", "LD_LIBRARY_PATH", "AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH"):
        assert ours[name] == theirs[name]


@pytest.mark.slow
def test_pinned_packages___require_nothing_that_is_not_pinned() -> None:
    if not (PROJECT / "requirements" / f"{os.environ.get('ROS_DISTRO')}.txt").is_file():
        pytest.skip("this environment was not made from a list of pinned packages")
    # The set-up installs the list as it is, without resolving it once more.
    done = subprocess.run(
        [sys.executable, "-m", "pip", "check", "--disable-pip-version-check"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout


def test_sources_of_a_build___are_not_the_bytecode_beside_them(tmp_path: Path) -> None:
    launch = tmp_path / "src" / "one" / "launch"
    (launch / "__pycache__").mkdir(parents=True)
    (launch / "one.launch.py").touch()
    (launch / "__pycache__" / "one.pyc").touch()
    lines = (PROJECT / "flexarm").read_text("utf-8")
    found = lines[lines.index("sources=$(") : lines.index("wanted_build=")]
    done = subprocess.run(  # noqa: S603 - our own script
        ["/bin/bash", "-c", f'{found}printf %s "$sources"'],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == "src/one/launch/one.launch.py"


@pytest.fixture
def bare(tmp_path: Path) -> Path:
    """Return a checkout that nobody has set up."""
    root = tmp_path / "checkout"
    (root / "src" / "flexarm_msgs").mkdir(parents=True)
    (root / "src" / "flexarm_msgs" / "package.xml").touch()
    for name in ("requirements", "bootstrap", "src/flexarm_bringup"):
        shutil.copytree(PROJECT / name, root / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("flexarm", "pyproject.toml"):
        shutil.copy2(PROJECT / name, root / name)
    return root


def called(
    root: Path, *arguments: str, python: str = sys.executable, **settings: str
) -> subprocess.CompletedProcess[str]:
    ours = {"PATH": "/usr/bin:/bin", "HOME": str(root), "FLEXARM_PYTHON": python}
    done = subprocess.run(  # noqa: S603 - our own script
        [root / "flexarm", *arguments],
        cwd=root,
        env=ours | settings,
        capture_output=True,
        text=True,
        check=False,
    )
    # On a busy machine that is said first.
    done.stderr = re.sub(r"^flexarm: the machine is busy.*\n", "", done.stderr)
    return done


@pytest.mark.parametrize("arguments", [(), ("-h",), ("--help",), ("demo", "--help")], ids=" ".join)
def test_help___before_the_set_up___says_what_will_happen(
    bare: Path, arguments: tuple[str, ...]
) -> None:
    before = sorted(bare.rglob("*"))
    done = called(bare, *arguments)
    assert done.returncode == 0
    assert done.stderr == ""
    assert "not set up" in done.stdout
    assert f"installs them in {bare}/.venv" in done.stdout
    assert sorted(bare.rglob("*")) == before


def test_version___before_the_set_up___is_that_of_the_command(bare: Path) -> None:
    assert called(bare, "--version").stdout == CliRunner().invoke(main, ["--version"]).output


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("idntify run1", "no verb idntify (nearest: identify): ./flexarm --help lists the verbs"),
        ("validate run1", "no verb validate: ./flexarm --help lists the verbs"),
        ("--versoin", "no option --versoin: ./flexarm --help lists the verbs"),
        ("identify run1 --ordre 10", "identify has no option --ordre (nearest: --order)"),
        ("up --reel-time", "up has no option --reel-time (nearest: --real-time)"),
        ("bag check --quick=3", "bag has no option --quick"),
        ("bench idnet", "no bench idnet (nearest: ident): ./flexarm bench --help"),
    ],
)
def test_wrong_word___before_the_set_up___is_reported_and_installs_nothing(
    bare: Path, arguments: str, said: str
) -> None:
    before = sorted(bare.rglob("*"))
    done = called(bare, *arguments.split())
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(f"flexarm: {said}")
    assert done.stderr.endswith("; nothing was set up\n")
    assert sorted(bare.rglob("*")) == before


def checked(*words: str) -> str:
    """Return what is said of a command before the set-up; nothing when it may be right."""
    done = subprocess.run(  # noqa: S603 - our own script
        [sys.executable, "-IS", PROJECT / "bootstrap" / "check_words.py", *words],
        capture_output=True,
        text=True,
        check=False,
    )
    assert bool(done.stderr) == bool(done.returncode)
    return done.stderr


def options_of(command: click.Command) -> Iterator[str]:
    """Yield the long options of a verb, and of the verbs below it."""
    for each in command.params:
        yield from (name for name in (*each.opts, *each.secondary_opts) if name[:2] == "--")
    for below in getattr(command, "commands", {}).values():
        yield from options_of(below)


@pytest.mark.parametrize("verb", first_of([verb for group in GROUPS.values() for verb in group], 6))
def test_right_words___before_the_set_up___are_let_through(verb: str) -> None:
    assert isinstance(main, LazyVerbGroup)
    known = {name for name in options_of(main.load(verb)) if name != "--help"}
    assert checked(verb, "all" if verb == "bench" else "word", "-3", *known) == ""


PAGES = (*PROJECT.glob("*.md"), *PROJECT.glob("docs/**/*.md"))
COMMANDS = sorted(
    {
        words
        for page in PAGES
        for words in re.findall(r"flexarm (bench [a-z][^`#\n|]+)", page.read_text("utf-8"))
    }
)


@pytest.mark.parametrize("words", first_of(COMMANDS, 6))
def test_bench_of_a_page___before_the_set_up___is_let_through(words: str) -> None:
    assert checked(*words.split()) == ""


@pytest.mark.parametrize("name", first_of(list(_BENCHES), 4))
def test_options_of_a_bench___before_the_set_up___are_its_own(name: str) -> None:
    (file,) = PROJECT.glob(f"bench/*/{name}.py")
    module = import_module(f"bench.{file.parent.name}.{name}")
    command = getattr(module, "command", module.main)
    known = {each for each in options_of(command) if each != "--help"}
    assert checked("bench", name, *known) == ""
    assert f"bench has no option --{name}s" in checked("bench", name, f"--{name}s")


def test_clean___removes_what_the_set_up_made_alone(bare: Path) -> None:
    before = sorted(bare.rglob("*"))
    made = [".venv", "install", "build", "log", ".venv-none", "install-kilted", "log-system"]
    for name in made:
        (bare / name).mkdir()
        (bare / name / "one").touch()
    done = called(bare, "clean")
    assert done.returncode == 0
    assert [f"/{name} (" in done.stderr for name in made] == [True] * len(made)
    assert sorted(bare.rglob("*")) == before
    assert called(bare, "clean").returncode == 0


@pytest.mark.parametrize("other", [False, True])
def test_clean___of_a_set_up_in_the_cache___leaves_no_empty_folder(
    bare: Path, *, other: bool
) -> None:
    # An environment cannot live below a path with a space in it.
    spaced = bare.rename(bare.with_name("check out"))
    cache = bare.parent / "cache"
    key = sha256(str(spaced).encode()).hexdigest()[:12]
    (cache / "flexarm" / key / ".venv").mkdir(parents=True)
    if other:
        (cache / "flexarm" / "other" / ".venv").mkdir(parents=True)
    done = called(spaced, "clean", XDG_CACHE_HOME=str(cache))
    assert (done.returncode, ".venv" in done.stderr) == (0, True)
    left = ["flexarm", "flexarm/other", "flexarm/other/.venv"] if other else []
    assert sorted(str(each.relative_to(cache)) for each in cache.rglob("*")) == left


STAND_IN = f"""#!/bin/bash
# Answers as {sys.executable}; as `-m venv` it makes an environment whose pip does nothing, but lays
# down a uv when asked for a target, and whose wheels need no repair.
case "$1 $2" in
"-m venv")
    mkdir -p "${{@: -1}}/bin"
    cat >"${{@: -1}}/bin/python" <<EOF
#!/bin/sh
case "\\$2 \\$1" in
"pip "*) echo "\\$@" >>"$PIP_CALLED"
    while [ \\$# -gt 1 ] && [ "\\$1" != --target ]; do shift; done
    if [ "\\$1" = --target ]; then
        mkdir -p "\\$2/bin"
        printf '#!/bin/sh\\necho uv "\\$@" >>"$PIP_CALLED"; exit $UV_ENDS_WITH' >"\\$2/bin/uv"
        chmod +x "\\$2/bin/uv"
    fi ;;
*/fix_wheels.py) ;;
*) exec {sys.executable} "\\$@" ;;
esac
EOF
    chmod +x "${{@: -1}}/bin/python" ;;
*) exec {sys.executable} "$@" ;;
esac
"""


@pytest.fixture
def without_ros(bare: Path) -> dict[str, str]:
    """Return what to call a checkout with that sets it up without ROS 2 and without a network."""
    shutil.copytree(PROJECT / "src", bare / "src", dirs_exist_ok=True)
    python = bare / "python3"
    python.write_text(STAND_IN, "utf-8")
    python.chmod(0o755)
    return {"python": str(python), "FLEXARM_ROS": "none", "PIP_CALLED": str(bare / "pip_called")}


@pytest.mark.slow
def test_without_ros___needs_no_compiler_and_runs_the_verbs_from_the_sources(
    bare: Path, without_ros: dict[str, str]
) -> None:
    reported = called(bare, "--help", **without_ros).stdout
    assert f"installs them in {bare}/.venv-none" in reported
    assert "has no ROS 2" in reported
    assert "./flexarm test" not in reported

    done = called(bare, "catalogue", "C_dat3", **without_ros)
    assert done.returncode == 0, done.stderr
    assert "C_dat3" in done.stdout
    assert " -r base.in " in (bare / "pip_called").read_text("utf-8")

    (bare / "pip_called").unlink()
    assert (bare / ".venv-none" / "share" / "flexarm_msgs" / "msg").is_dir()
    assert called(bare, "catalogue", "C_dat3", **without_ros).stdout == done.stdout
    assert not (bare / "pip_called").exists()

    called(bare, "clean", **without_ros)
    assert not (bare / ".venv-none").exists()


@pytest.fixture
def with_ros(bare: Path) -> dict[str, str]:
    """Return what to call a checkout with that sets it up with stand-ins for pip and colcon."""
    tools = bare / "stand_ins"
    tools.mkdir()
    for name, text in (("python3", STAND_IN), ("colcon", COLCON)):
        (tools / name).write_text(text, "utf-8")
        (tools / name).chmod(0o755)
    return {
        "python": str(tools / "python3"),
        "PATH": f"{tools}:/usr/bin:/bin",
        "PIP_CALLED": str(bare / "pip_called"),
        "UV_ENDS_WITH": "0",
    }


COLCON = """#!/bin/sh
cd "$FLEXARM_ROOT" && mkdir -p install/flexarm_bringup/bin
touch install/_local_setup_util_sh.py
printf '#!/bin/sh\\necho "called: $@"\\n' >install/flexarm_bringup/bin/flexarm
chmod +x install/flexarm_bringup/bin/flexarm
"""


@pytest.mark.slow
def test_tools_of_test_and_docs___are_installed_for_the_first_verb_that_needs_them(
    bare: Path, with_ros: dict[str, str]
) -> None:
    def installed(*arguments: str) -> str:
        (bare / "pip_called").write_text("", "utf-8")
        done = called(bare, *arguments, **with_ros)
        assert done.stdout == f"called: {' '.join(arguments)}\n", done.stderr
        return (bare / "pip_called").read_text("utf-8")

    assert "-r jazzy.txt" in installed("demo")
    assert installed("test", "--help") == ""
    refused = called(bare, "bench", "idnet", **with_ros)
    assert "no bench idnet (nearest: ident)" in refused.stderr
    assert (bare / "pip_called").read_text("utf-8") == ""
    tools = installed("test")
    assert "--require-hashes -r dev.txt" in tools
    assert "jazzy.txt" not in tools
    assert installed("docs") == installed("demo") == ""


def test_python_without_headers___is_reported_before_anything_is_installed(
    bare: Path, with_ros: dict[str, str]
) -> None:
    python = Path(with_ros["python"])
    headless = '#!/bin/bash\ncase "$*" in *Python.h*) exit 1 ;; esac\n'
    python.write_text(headless + python.read_text("utf-8"), "utf-8")
    done = called(bare, "demo", **with_ros)
    assert done.returncode == 1
    assert "sudo apt-get install python3-dev" in done.stderr
    assert not (bare / ".venv").exists()


@pytest.mark.parametrize("uv_ends_with", [0, 2])
def test_pinned_packages___come_by_uv_and_where_it_fails_by_pip(
    bare: Path, with_ros: dict[str, str], uv_ends_with: int
) -> None:
    done = called(bare, "demo", **with_ros | {"UV_ENDS_WITH": str(uv_ends_with)})
    assert done.stdout == "called: demo\n", done.stderr
    calls = (bare / "pip_called").read_text("utf-8").splitlines()
    as_it_is = "--no-deps --require-hashes -r"
    assert calls[0].endswith(f"{as_it_is} uv.txt")
    assert calls[1].startswith("uv pip install")
    assert calls[1].endswith(f"{as_it_is} jazzy.txt")
    assert [call.split(" -r ")[1] for call in calls[2:]] == ["jazzy.txt"] * bool(uv_ends_with)
    assert not list((bare / ".venv").glob("uv.*"))


def test_platform_without_wheels_of_ros___is_set_up_without_ros_or_reported(bare: Path) -> None:
    platform = {"OSTYPE": "darwin23", "HOSTTYPE": "arm64"}
    assert "has no ROS 2" in called(bare, "--help", **platform).stdout
    refused = called(bare, "--help", **platform, FLEXARM_ROS="kilted")
    assert refused.returncode == 1
    assert "FLEXARM_ROS=kilted: its wheels are for x86-64 Linux" in refused.stderr
