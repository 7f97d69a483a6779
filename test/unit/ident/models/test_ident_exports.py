from __future__ import annotations

import json
import math
import subprocess
from typing import TYPE_CHECKING, Any

import control
import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from scipy.io import loadmat, savemat

from flexarm_ident.models import mat
from flexarm_ident.models.files import EXPORTS, FORMATS, load_model, parse_exports, save_model
from flexarm_ident.models.mat_reader import answer
from flexarm_ident.models.model_parameters import ModelFileError, model_hash, model_parameters
from support.exhaustive import first_of, wide
from support.ident_systems import DT_S, random_model

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

READ_BACK = (".yaml", ".json", ".mat")
ORIGIN: dict[str, str | list[str]] = {
    "source": ["bags/run 1", "bags/ä"],
    "request": '{"method": "auto"}',
}

finite = st.floats(allow_nan=False, allow_infinity=False, allow_subnormal=False)
texts = st.text(st.characters(codec="utf-8", exclude_categories=["Cc", "Cs"]), min_size=1)


def drawn_names(count: int) -> st.SearchStrategy[list[str]]:
    # What control and a fixed-width character array in a MAT-file both keep.
    usable = texts.filter(lambda text: text == text.strip() and "." not in text)
    return st.lists(usable, min_size=count, max_size=count, unique=True)


@st.composite
def models(draw: st.DrawFn) -> control.StateSpace:
    states, inputs, outputs = (draw(st.integers(1, 3)) for _ in range(3))
    shapes = ((states, states), (states, inputs), (outputs, states), (outputs, inputs))
    matrices = [draw(arrays.arrays(np.float64, shape, elements=finite)) for shape in shapes]
    dt_s = draw(st.floats(1e-6, 1e3))
    return control.ss(
        *matrices, dt_s, inputs=draw(drawn_names(inputs)), outputs=draw(drawn_names(outputs))
    )


def a_model() -> control.StateSpace:
    """Return a model whose numbers are hard to write, with 2 inputs, 3 states and 2 outputs."""
    model = random_model(3, states=3, outputs=2, inputs=2, feedthrough=True)
    model.A[0] = [0.1, 1e22, -0.0]
    model.B[0] = [5e-5, 3.0]
    model.C[1, :] = [-0.0, 2.3e-308, 1.7976931348623157e308]
    return model


def bits(model: control.StateSpace) -> list[bytes]:
    matrices = (model.A, model.B, model.C, model.D)
    return [np.ascontiguousarray(matrix).tobytes() for matrix in matrices]


def assert_same(found: control.StateSpace, expected: control.StateSpace) -> None:
    assert bits(found) == bits(expected)
    assert found.dt == expected.dt
    assert list(found.input_labels) == list(expected.input_labels)
    assert list(found.output_labels) == list(expected.output_labels)


def saved(folder: Path, suffix: str) -> Path:
    path = folder / f"model{suffix}"
    save_model(path, a_model(), name="arm", provenance=ORIGIN)
    return path


@pytest.fixture
def mat_in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Read MAT-files without a process of their own, which costs half a second each."""
    monkeypatch.setattr(mat, "_read_apart", answer)


@pytest.mark.parametrize("suffix", READ_BACK)
def test_load_model___saved_model___returns_every_bit(tmp_path: Path, suffix: str) -> None:
    found = load_model(saved(tmp_path, suffix))
    assert isinstance(found, control.StateSpace)
    assert_same(found, a_model())


@pytest.mark.usefixtures("mat_in_this_process")
@pytest.mark.parametrize("suffix", first_of(READ_BACK))
@settings(max_examples=wide(20, 40), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(model=models())
@pytest.mark.slow
def test_load_model___any_saved_model_in_one_process___returns_every_bit(
    tmp_path: Path, suffix: str, model: control.StateSpace
) -> None:
    path = tmp_path / f"any{suffix}"
    save_model(str(path), model, name="_2dof", provenance={})
    assert_same(load_model(str(path)), model)


@pytest.mark.parametrize("suffix", FORMATS)
def test_save_model___same_model_twice___gives_the_same_file(tmp_path: Path, suffix: str) -> None:
    assert saved(tmp_path, suffix).read_bytes() == saved(tmp_path, suffix).read_bytes()
    assert b"Created on" not in saved(tmp_path, suffix).read_bytes()


def test_json___read_by_itself___has_the_parameters(tmp_path: Path) -> None:
    document = json.loads(saved(tmp_path, ".json").read_text(encoding="utf-8"))
    found = document["models"]["arm"]
    parameters = model_parameters("arm", a_model(), provenance=ORIGIN)
    assert found == {key.removeprefix("models.arm."): value for key, value in parameters.items()}
    assert np.array(found["a"]).reshape(3, 3).tobytes() == a_model().A.tobytes()
    assert found["source"] == ORIGIN["source"]
    assert found["hash"] == model_hash(a_model())


def test_mat___read_by_scipy___has_matlab_shapes_and_cells(tmp_path: Path) -> None:
    variables = loadmat(saved(tmp_path, ".mat"))
    for key in "ABCD":
        assert variables[key].shape == getattr(a_model(), key).shape
        assert np.ascontiguousarray(variables[key]).tobytes() == getattr(a_model(), key).tobytes()
    assert variables["dt"].tolist() == [[DT_S]]
    assert [cell.item() for cell in variables["input_names"][:, 0]] == ["u0", "u1"]
    assert [cell.item() for cell in variables["output_names"][:, 0]] == ["y0", "y1"]
    assert variables["name"].tolist() == ["arm"]
    assert variables["hash"].tolist() == [model_hash(a_model())]
    provenance = variables["provenance"][0, 0]
    assert [cell.item() for cell in provenance["source"][:, 0]] == ORIGIN["source"]
    assert provenance["request"].item() == ORIGIN["request"]


def test_mat___saved_again_compressed___is_read(tmp_path: Path) -> None:
    path = saved(tmp_path, ".mat")
    variables = {key: value for key, value in loadmat(path).items() if not key.startswith("__")}
    savemat(path, variables, do_compression=True)
    assert_same(load_model(path), a_model())


PRINT_BITS = """
#include <stdio.h>
#include <string.h>
#include "model.h"
#include "model.h"
static void show(const double *values, int count) {
    for (int i = 0; i < count; i++) {
        unsigned char raw[sizeof(double)];
        memcpy(raw, &values[i], sizeof raw);
        for (unsigned k = 0; k < sizeof raw; k++) printf("%02x", raw[k]);
    }
    printf("\\n");
}
int main(void) {
    const double dt_s = MODEL_ARM_DT_S;
    show(model_arm_a, MODEL_ARM_STATES * MODEL_ARM_STATES);
    show(model_arm_b, MODEL_ARM_STATES * MODEL_ARM_INPUTS);
    show(model_arm_c, MODEL_ARM_OUTPUTS * MODEL_ARM_STATES);
    show(model_arm_d, MODEL_ARM_OUTPUTS * MODEL_ARM_INPUTS);
    show(&dt_s, 1);
    for (int i = 0; i < MODEL_ARM_INPUTS; i++) puts(model_arm_input_names[i]);
    for (int i = 0; i < MODEL_ARM_OUTPUTS; i++) puts(model_arm_output_names[i]);
    return 0;
}
"""


def printed_by_c(folder: Path, model: control.StateSpace, *compiler: str) -> list[str]:
    """Compile a program that prints the header `model.h` and return its lines."""
    source = folder / "show.c"
    source.write_text(PRINT_BITS)
    program = folder / "show"
    command = [*compiler, "-Wall", "-Werror", "-pedantic", str(source), "-o", str(program)]
    save_model(folder / "model.h", model, name="arm", provenance=NASTY)
    subprocess.run(command, check=True, cwd=folder)  # noqa: S603 - our own program
    finished = subprocess.run([str(program)], check=True, capture_output=True)  # noqa: S603
    return finished.stdout.decode().splitlines()


NASTY: dict[str, str | list[str]] = {"source": ["/*", "*/ #error ä", "??/", "a\nb\\"]}


@pytest.mark.parametrize("compiler", [("cc", "-std=c99"), ("c++", "-x", "c++", "-std=c++11")])
def test_c_header___compiled___has_every_bit_and_name(
    tmp_path: Path, compiler: Sequence[str]
) -> None:
    names = ['a "quoted" \\name', "ä 1"], ["??/ ??=", "%s */"]
    model = control.ss(a_model(), inputs=names[0], outputs=names[1])
    matrices = (model.A, model.B, model.C, model.D, np.array([DT_S]))
    expected = [np.ascontiguousarray(matrix).tobytes().hex() for matrix in matrices]
    assert printed_by_c(tmp_path, model, *compiler) == [*expected, *names[0], *names[1]]


def test_c_header___comment___has_origin_and_hash(tmp_path: Path) -> None:
    comment = saved(tmp_path, ".h").read_text(encoding="ascii").split("*/")[0]
    assert "source: bags/run 1, bags/\\xe4" in comment
    assert f"hash: {model_hash(a_model())}" in comment


def test_load_model___c_header___names_readable_formats(tmp_path: Path) -> None:
    with pytest.raises(ModelFileError, match=r"model\.h: .*read one of \.yaml, \.json, \.mat"):
        load_model(saved(tmp_path, ".h"))


FIELDS = ("a", "b", "c", "d", "dt_s", "input_names", "output_names")
IN_MAT = dict(zip(FIELDS, ("A", "B", "C", "D", "dt", "input_names", "output_names"), strict=True))


def changed(value: Any) -> Any:  # noqa: ANN401 - a number, a list or an array
    """Return the value with its first number one bit away, or its first name another."""
    if isinstance(value, np.ndarray):
        value = value.copy()
        value.flat[0] = changed(value.flat[0])
        return value
    if isinstance(value, list):
        return [changed(value[0]), *value[1:]]
    return math.nextafter(value, 1.0) if isinstance(value, float) else "other"


def edit(path: Path, field: str, *, remove: bool) -> None:
    """Change or remove one field of a saved model with a tool that is not ours."""
    if path.suffix == ".mat":
        variables = loadmat(path)
        tree, key = variables, IN_MAT.get(field, field)
    else:
        text = path.read_text(encoding="utf-8")
        variables = json.loads(text) if path.suffix == ".json" else yaml.safe_load(text)
        root = variables if path.suffix == ".json" else variables["/**"]["ros__parameters"]
        tree, key = root["models"]["arm"], field
    if remove:
        del tree[key]
    else:
        tree[key] = changed(tree[key])
    if path.suffix == ".mat":
        savemat(path, {key: value for key, value in variables.items() if key[0] != "_"})
    else:
        # JSON is YAML.
        path.write_text(json.dumps(variables), encoding="utf-8")


@pytest.mark.usefixtures("mat_in_this_process")
@pytest.mark.parametrize("suffix", READ_BACK)
@pytest.mark.parametrize("field", FIELDS)
def test_load_model___tampered_field___is_refused(tmp_path: Path, suffix: str, field: str) -> None:
    path = saved(tmp_path, suffix)
    edit(path, field, remove=False)
    with pytest.raises(ModelFileError, match=rf"model\{suffix}: .*hash does not belong to the"):
        load_model(path)


@pytest.mark.usefixtures("mat_in_this_process")
@pytest.mark.parametrize("suffix", READ_BACK)
@pytest.mark.parametrize("field", [*FIELDS, "hash"])
def test_load_model___missing_field___is_named(tmp_path: Path, suffix: str, field: str) -> None:
    path = saved(tmp_path, suffix)
    edit(path, field, remove=True)
    named = f"variable {IN_MAT.get(field, field)}" if suffix == ".mat" else rf"models\.arm\.{field}"
    with pytest.raises(ModelFileError, match=rf"model\{suffix}: {named} is missing$"):
        load_model(path)


@pytest.mark.usefixtures("mat_in_this_process")
@pytest.mark.parametrize(
    ("variable", "value", "complaint"),
    [
        ("dt", [[0.1, 0.2]], "dt_s must be a positive number"),
        ("A", np.ones((3, 3), dtype=complex), "a must be a list of numbers"),
        ("A", np.ones((3, 2)), "a has 6 numbers, 3 x 3 = 9 are needed"),
        ("B", np.ones((2, 2)), "b has 4 numbers, 3 x 2 = 6 are needed"),
        ("D", np.full((2, 2), np.inf), "d has a number that is not finite"),
        ("output_names", np.ones((2, 1)), "output_names must be a list of names"),
    ],
)
def test_load_model___mat_file_with_odd_variable___is_refused(
    tmp_path: Path, variable: str, value: object, complaint: str
) -> None:
    path = saved(tmp_path, ".mat")
    variables = {key: item for key, item in loadmat(path).items() if key[0] != "_"}
    savemat(path, variables | {variable: value})
    with pytest.raises(ModelFileError, match=rf"model\.mat: models\.arm\.{complaint}"):
        load_model(path)


@pytest.mark.parametrize("suffix", [".yaml", ".json"])
@settings(max_examples=wide(20, 40), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_load_model___damaged_text___is_refused_or_unharmed(
    tmp_path: Path, suffix: str, data: st.DataObject
) -> None:
    assert_refused_or_unharmed(saved(tmp_path, suffix), data)


@settings(max_examples=wide(8, 40), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
@pytest.mark.slow
def test_load_model___damaged_mat_file___is_refused_or_unharmed(
    tmp_path: Path, data: st.DataObject
) -> None:
    assert_refused_or_unharmed(saved(tmp_path, ".mat"), data)


def assert_refused_or_unharmed(path: Path, data: st.DataObject) -> None:
    """Damage a file somewhere, and assert that it gives its model or one line of complaint."""
    content = bytearray(path.read_bytes())
    if data.draw(st.booleans()):
        del content[data.draw(st.integers(0, len(content) - 1)) :]
    else:
        content[data.draw(st.integers(0, len(content) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    path.write_bytes(content)
    try:
        found = load_model(path)
    except ModelFileError as error:
        complaint = str(error)
    else:
        complaint = f"{path}: none"
        assert_same(found, a_model())
    assert complaint.startswith(f"{path}: ")
    assert "\n" not in complaint


@pytest.mark.parametrize(
    "content", first_of([b"", b"no MAT-file", b"\0" * 200, b"MATLAB 5.0".ljust(300)], 2)
)
def test_load_model___no_mat_file___is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "model.mat").write_bytes(content)
    with pytest.raises(ModelFileError, match=r"model\.mat: (no MAT-file|variable A is missing)"):
        load_model(tmp_path / "model.mat")


@pytest.mark.parametrize("suffix", READ_BACK)
def test_load_model___no_file___is_named(tmp_path: Path, suffix: str) -> None:
    with pytest.raises(ModelFileError, match=rf"absent\{suffix}: No such file"):
        load_model(tmp_path / f"absent{suffix}")


@pytest.mark.parametrize("name", ["model.txt", "model", "model.MAT"])
def test_unknown_suffix___is_refused_with_the_known_ones(tmp_path: Path, name: str) -> None:
    complaint = r"no format '.*': use one of \.yaml, \.json, \.mat, \.h$"
    with pytest.raises(ModelFileError, match=complaint):
        save_model(tmp_path / name, a_model(), name="arm", provenance={})
    with pytest.raises(ModelFileError, match=complaint):
        load_model(tmp_path / name)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", FORMATS)
def test_save_model___model_without_period___leaves_no_file(tmp_path: Path, suffix: str) -> None:
    model = control.ss([[0.5]], [[1.0]], [[1.0]], [[0.0]])
    with pytest.raises(ModelFileError, match=rf"arm\{suffix}: model arm has no sampling period"):
        save_model(tmp_path / f"arm{suffix}", model, name="arm", provenance={})
    assert not list(tmp_path.iterdir())


def test_load_model___file_with_two_models___names_their_reader(tmp_path: Path) -> None:
    both = model_parameters("arm", a_model(), provenance={})
    both |= model_parameters("leg", a_model(), provenance={})
    path = tmp_path / "two.json"
    path.write_bytes(FORMATS[".json"].encode("arm", both))
    with pytest.raises(ModelFileError, match=r"holds the models arm, leg: .*load_models"):
        load_model(path)


def test_parse_exports___list___gives_suffixes_once() -> None:
    assert parse_exports("json, mat,h,json") == (".json", ".mat", ".h") == EXPORTS
    assert parse_exports("") == ()


@pytest.mark.parametrize("text", ["yaml", "json,slx", ".mat"])
def test_parse_exports___other_word___is_refused(text: str) -> None:
    with pytest.raises(ModelFileError, match=r"no format '.*' to export: choose from json, mat, h"):
        parse_exports(text)
