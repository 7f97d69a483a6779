from __future__ import annotations

import json
import math
import os
from typing import TYPE_CHECKING, Any

import control
import numpy as np
import pytest
import yaml

from flexarm_ident import IdentificationError
from flexarm_ident.models.files import load_models
from flexarm_ident.models.model_parameters import (
    ModelFileError,
    model_from_parameters,
    model_hash,
    model_parameters,
    nested_parameters,
    write_parameter_file,
)
from support.hostile_texts import doubled, doubled_maps
from support.ident_systems import DT_S, random_model

if TYPE_CHECKING:
    from pathlib import Path

ORIGIN = {"source": "bag: 12 #3 'ä'", "method": "orse"}


def a_model(seed: int = 1) -> control.StateSpace:
    """Return a model whose numbers are hard to write: tiny, whole, negative zero."""
    model = random_model(seed, states=3, outputs=2, inputs=2, feedthrough=True)
    model.B[0] = [1e-5, 3.0]
    model.C[1, :] = [-0.0, 2.3e-308, 1.7e308]
    return model


def its_parameters() -> dict[str, Any]:
    return dict(model_parameters("arm", a_model(), provenance=ORIGIN))


def bits(model: control.StateSpace) -> list[bytes]:
    matrices = (model.A, model.B, model.C, model.D)
    return [np.ascontiguousarray(matrix).tobytes() for matrix in matrices]


def assert_same(found: control.StateSpace, expected: control.StateSpace) -> None:
    assert bits(found) == bits(expected)
    assert found.dt == expected.dt
    assert list(found.input_labels) == list(expected.input_labels)
    assert list(found.output_labels) == list(expected.output_labels)


def test_model_parameters___model___lists_are_row_major() -> None:
    A, B = np.array([[0.5, 0.25], [0.0, 0.125]]), np.array([[1.0], [2.0]])
    C, D = np.array([[3.0, 4.0], [5.0, 6.0], [7.0, 8.0]]), np.zeros((3, 1))
    model = control.ss(A, B, C, D, 0.01, inputs=["u_v"], outputs=["y_v", "z_deg", "w"])
    parameters = model_parameters("arm", model, provenance={"method": "orse"})
    assert parameters == {
        "models.arm.states": 2,
        "models.arm.input_names": ["u_v"],
        "models.arm.output_names": ["y_v", "z_deg", "w"],
        "models.arm.dt_s": 0.01,
        "models.arm.method": "orse",
        "models.arm.hash": model_hash(model),
        "models.arm.a": [0.5, 0.25, 0.0, 0.125],
        "models.arm.b": [1.0, 2.0],
        "models.arm.c": [3.0, 4.0, 5.0, 6.0, 7.0, 8.0],
        "models.arm.d": [0.0, 0.0, 0.0],
    }


def test_model_from_parameters___own_parameters___returns_every_bit() -> None:
    assert_same(model_from_parameters("arm", its_parameters()), a_model())


def test_model_from_parameters___lists_as_arrays___are_taken() -> None:
    parameters = its_parameters()
    parameters["models.arm.a"] = np.array(parameters["models.arm.a"])
    parameters["models.arm.input_names"] = tuple(parameters["models.arm.input_names"])
    assert_same(model_from_parameters("arm", parameters), a_model())


def test_model_parameters___numbers_that_ros_cannot_read___become_zero() -> None:
    model, plain = a_model(), a_model()
    model.A[0], plain.A[0] = [5e-324, -2.2e-308, 0.5], [0.0, 0.0, 0.5]
    parameters = model_parameters("arm", model, provenance={})
    assert parameters == model_parameters("arm", plain, provenance={})
    assert_same(model_from_parameters("arm", parameters), plain)


@pytest.mark.parametrize("seed", range(5))
def test_load_models___written_file___returns_every_bit(tmp_path: Path, seed: int) -> None:
    path = tmp_path / "model.yaml"
    write_parameter_file(path, model_parameters("arm", a_model(seed), provenance=ORIGIN))
    assert_same(load_models(path)["arm"], a_model(seed))


def test_load_models___several_models___keeps_their_order(tmp_path: Path) -> None:
    parameters = dict(its_parameters())
    for seed, name in enumerate(("no_payload", "_400g"), start=2):
        parameters.update(model_parameters(name, random_model(seed), provenance={}))
    path = tmp_path / "models.yaml"
    write_parameter_file(path, parameters, node="/flexarm/controller")
    models = load_models(path)
    assert list(models) == ["arm", "no_payload", "_400g"]
    assert_same(models["no_payload"], random_model(2))


def test_load_models___flat_keys_and_other_parameters___finds_the_model(
    tmp_path: Path,
) -> None:
    path = tmp_path / "flat.yaml"
    flat = {"/a": {"ros__parameters": {"rate_hz": 300.0, **its_parameters()}}, "/b": None}
    path.write_text(yaml.safe_dump(flat, allow_unicode=True), encoding="utf-8")
    assert_same(load_models(path)["arm"], a_model())


def test_write_parameter_file___parsed_by_yaml___has_the_types_of_the_parameters(
    tmp_path: Path,
) -> None:
    path = tmp_path / "model.yaml"
    write_parameter_file(path, its_parameters())
    document = yaml.safe_load(path.read_text(encoding="utf-8"))
    found = document["/**"]["ros__parameters"]["models"]["arm"]
    expected = {key.removeprefix("models.arm."): value for key, value in its_parameters().items()}
    assert found == expected
    for key in ("a", "b", "c", "d"):
        assert all(type(entry) is float for entry in found[key])
        signs = [math.copysign(1.0, entry) for entry in expected[key]]
        assert [math.copysign(1.0, entry) for entry in found[key]] == signs


@pytest.mark.parametrize("text", ["12e45", "1_000", "0x1F", "true", "", "~", "a: b"])
def test_write_parameter_file___text_like_a_number___is_quoted(tmp_path: Path, text: str) -> None:
    path = tmp_path / "model.yaml"
    write_parameter_file(path, {"note": text, "notes": [text]})
    assert path.read_text(encoding="utf-8").count(f'"{text}"') == 2


def test_write_parameter_file___empty_list___is_refused(tmp_path: Path) -> None:
    with pytest.raises(ModelFileError, match=r"model\.yaml: modes is an empty list"):
        write_parameter_file(tmp_path / "model.yaml", {"modes": []})


@pytest.mark.parametrize("field", ["a", "b", "c", "d", "dt_s", "input_names", "output_names"])
def test_load_models___tampered_field___is_refused(tmp_path: Path, field: str) -> None:
    parameters = its_parameters()
    value = parameters[f"models.arm.{field}"]
    if isinstance(value, float):
        changed: Any = math.nextafter(value, 1.0)
    elif isinstance(value[0], float):
        changed = [math.nextafter(value[0], 1.0), *value[1:]]
    else:
        changed = ["other", *value[1:]]
    path = tmp_path / "model.yaml"
    write_parameter_file(path, {**parameters, f"models.arm.{field}": changed})
    with pytest.raises(ModelFileError, match=r"model\.yaml: models\.arm\.hash does not belong"):
        load_models(path)


def test_model_hash___every_part_of_the_model___counts() -> None:
    base = control.ss([[0.5]], [[1.0]], [[2.0]], [[0.0]], DT_S, inputs=["u"], outputs=["y"])
    others = [
        control.ss([[0.25]], [[1.0]], [[2.0]], [[0.0]], DT_S, inputs=["u"], outputs=["y"]),
        control.ss([[0.5]], [[2.0]], [[1.0]], [[0.0]], DT_S, inputs=["u"], outputs=["y"]),
        control.ss([[0.5]], [[1.0]], [[2.0]], [[1.0]], DT_S, inputs=["u"], outputs=["y"]),
        control.ss([[0.5]], [[1.0]], [[2.0]], [[0.0]], 0.01, inputs=["u"], outputs=["y"]),
        control.ss([[0.5]], [[1.0]], [[2.0]], [[0.0]], DT_S, inputs=["y"], outputs=["u"]),
    ]
    assert len({model_hash(model) for model in (base, *others)}) == 6
    assert model_hash(base) == model_hash(base.copy())


FIELDS = ("a", "b", "c", "d", "states", "input_names", "output_names", "dt_s", "hash")


@pytest.mark.parametrize("field", FIELDS)
def test_model_from_parameters___missing_field___is_named(field: str) -> None:
    parameters = its_parameters()
    del parameters[f"models.arm.{field}"]
    with pytest.raises(ModelFileError, match=rf"^models\.arm\.{field} is missing$"):
        model_from_parameters("arm", parameters)


@pytest.mark.parametrize(
    ("field", "value", "complaint"),
    [
        ("a", [0.0] * 8, r"a has 8 numbers, 3 x 3 = 9 are needed"),
        ("b", [0.0] * 9, r"b has 9 numbers, 3 x 2 = 6 are needed"),
        ("c", [[0.0] * 3] * 2, r"c has 6 numbers, 2 x 3 = 6 are needed, in one flat list"),
        ("d", [0.0, 0.0, 0.0, math.nan], r"d has a number that is not finite"),
        ("a", ["x"] * 9, r"a must be a list of numbers"),
        ("a", [[1.0], [1.0, 2.0]], r"a must be a list of numbers"),
        ("a", None, r"a must be a list of numbers"),
        ("a", [10**400] * 9, r"a must be a list of numbers"),
        ("states", 0, r"states must be a whole number, 1 to 10000: 0"),
        ("states", 3.0, r"states must be a whole number, 1 to 10000: 3\.0"),
        ("states", True, r"states must be a whole number, 1 to 10000: True"),
        ("states", 10**4000, r"states must be a whole number, 1 to 10000: 1000"),
        ("dt_s", 0.0, r"dt_s must be a positive number of seconds: 0\.0"),
        ("dt_s", math.inf, r"dt_s must be a positive number of seconds: inf"),
        ("dt_s", "fast", r"dt_s must be a positive number of seconds: 'fast'"),
        ("input_names", [], r"input_names must be a list of names: \[\]"),
        ("input_names", "u", r"input_names must be a list of names: 'u'"),
        ("output_names", [1, 2], r"output_names must be a list of names: \[1, 2\]"),
        ("output_names", ["y", "y"], r"output_names must differ: \['y', 'y'\]"),
        ("hash", "0", r"hash does not belong to the model"),
    ],
)
def test_model_from_parameters___bad_field___is_refused(
    field: str, value: object, complaint: str
) -> None:
    parameters = {**its_parameters(), f"models.arm.{field}": value}
    with pytest.raises(ModelFileError, match=rf"^models\.arm\.{complaint}"):
        model_from_parameters("arm", parameters)


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"a: [1", "no YAML"),
        (b"\xff\xfe\x00", "no YAML"),
        (b"", r"no parameters models\.<name>\.\*"),
        (b"- 1\n- 2\n", r"no parameters models\.<name>\.\*"),
        (b"/**:\n  ros__parameters:\n    rate_hz: 300.0\n", r"no parameters models\.<name>"),
        (
            b"/**:\n  ros__parameters:\n    models: {arm: {a: %s}}\n" % doubled(40).encode(),
            r"has more than 2",
        ),
        (
            b"/**:\n  ros__parameters:\n    models: %s\n" % doubled_maps(40).encode(),
            r"has more than 2",
        ),
        (b"/**: {ros__parameters: {x: !!int ''}}", r"no YAML"),
        (b"/**: {ros__parameters: {" + b"x" * 1001 + b": {y: 1}}}", r"name has more than 1000"),
        (b"/**:\n  ros__parameters:\n    models: 3\n", r"no parameters models\.<name>\.\*"),
        (b"/**:\n  ros__parameters:\n    models:\n      arm: 3\n", r"models\.arm\.a is missing"),
    ],
)
def test_load_models___no_model_in_it___raises(
    tmp_path: Path, content: bytes, complaint: str
) -> None:
    path = tmp_path / "model.yaml"
    path.write_bytes(content)
    with pytest.raises(ModelFileError, match=rf"model\.yaml: .*{complaint}"):
        load_models(path)


def test_load_models___period_of_a_million_digits___is_refused_in_a_short_line(
    tmp_path: Path,
) -> None:
    parameters = {**its_parameters(), "models.arm.dt_s": "9" * 1_000_000}
    path = tmp_path / "model.json"
    path.write_text(json.dumps(nested_parameters(parameters)))
    with pytest.raises(ModelFileError, match="dt_s must be a positive number") as caught:
        load_models(path)
    assert len(str(caught.value)) < 500


def test_load_models___deep_json___is_refused(tmp_path: Path) -> None:
    path = tmp_path / "model.json"
    path.write_text('{"a":' * 900 + "1" + "}" * 900)
    with pytest.raises(ModelFileError, match=r"model\.json: "):
        load_models(path)


@pytest.mark.parametrize("suffix", [".yaml", ".json", ".mat"])
def test_load_models___pipe_or_long_file___is_refused_unread(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"model{suffix}"
    os.mkfifo(path)
    with pytest.raises(ModelFileError, match="is not a plain file"):
        load_models(path)
    path.unlink()
    path.touch()
    os.truncate(path, 9 << 20)
    with pytest.raises(ModelFileError, match="is longer than 8 MB"):
        load_models(path)


def test_load_models___missing_file___is_named(tmp_path: Path) -> None:
    with pytest.raises(ModelFileError, match=r"absent\.yaml: No such file"):
        load_models(tmp_path / "absent.yaml")


@pytest.mark.parametrize("name", ["", "a.b", "a b", "a/b"])
def test_model_parameters___name_with_other_signs___is_refused(name: str) -> None:
    with pytest.raises(ModelFileError, match="use letters, digits and underscores only"):
        model_parameters(name, a_model(), provenance={})


def test_model_parameters___provenance_named_like_a_field___is_refused() -> None:
    with pytest.raises(ModelFileError, match="provenance 'hash' is a field of the model"):
        model_parameters("arm", a_model(), provenance={"hash": "0"})


@pytest.mark.parametrize(
    ("model", "complaint"),
    [
        (control.ss([], [], [], [[1.0]], DT_S), "model arm has no states"),
        (control.ss([[0.5]], [[1.0]], [[1.0]], [[0.0]]), r"no sampling period: dt = 0"),
        (control.ss([[0.5]], [[1.0]], [[1.0]], [[0.0]], dt=True), "no sampling period: dt = True"),
        (control.ss([[0.5]], [[1.0]], [[1.0]], [[0.0]], None), "no sampling period: dt = None"),
        (control.ss([[0.5]], [[math.inf]], [[1.0]], [[0.0]], DT_S), "matrix b is not finite"),
    ],
)
def test_model_parameters___model_that_cannot_be_kept___is_refused(
    model: control.StateSpace, complaint: str
) -> None:
    with pytest.raises(IdentificationError, match=complaint):
        model_parameters("arm", model, provenance={})
