from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from flexarm_ident import IdentificationError, IoData, identify, reduce_model, validate_dmv
from flexarm_ident.models.modes import modal_form
from flexarm_ident.reduction.modal import truncate
from support.ident_systems import (
    DT_S,
    arm_model,
    named,
    pulse_responses,
    random_model,
    record,
    square_wave,
    step_by_step,
)

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flexarm_ident import Identification

KNOWN_HZ = (9.0, 25.0, 48.0)


def arm_record(noise: float = 0.02, samples: int = 6000) -> IoData:
    u = square_wave(samples, 1)
    y = step_by_step(arm_model(), u)
    y += noise * y.std(axis=0) * np.random.default_rng(2).normal(size=y.shape)
    return IoData(u, y, dt_s=DT_S)


@pytest.fixture(scope="module")
def data() -> IoData:
    return arm_record()


@pytest.fixture(scope="module")
def full(data: IoData) -> Identification:
    return identify(data, order=20, method="orse")


@pytest.mark.parametrize("ranking", ["mrm", "msv"])
@pytest.mark.parametrize("update", ["none", "b", "c"])
def test_reduce_model___own_order___keeps_the_input_output_behaviour(
    ranking: Any,  # noqa: ANN401
    update: Any,  # noqa: ANN401
) -> None:
    clean = record(random_model(1, states=6), 500, seed=1)
    found = identify(clean, order=6, block_rows=10, method="orse")
    reduced = reduce_model(found, clean, ranking=ranking, order=6, update=update)
    np.testing.assert_allclose(
        pulse_responses(reduced.model), pulse_responses(found.model), atol=1e-9
    )
    assert all(mode.kept for mode in reduced.modes)
    np.testing.assert_allclose(
        step_by_step(reduced.model, clean.u, reduced.x0[0]), clean.y, atol=1e-8
    )


def test_reduce_model___feedthrough___is_kept() -> None:
    model = random_model(2, states=6, feedthrough=True)
    clean = record(model, 500, seed=2)
    found = identify(clean, order=6, block_rows=10, feedthrough=True, method="orse")
    reduced = reduce_model(found, clean, order=6)
    np.testing.assert_allclose(pulse_responses(reduced.model), pulse_responses(model), atol=1e-9)


def test_truncate___some_modes___sum_of_their_pulse_responses() -> None:
    model = random_model(3, states=7)
    form = modal_form(model)
    kept = [0, 1, 4, 5, 6]
    expected = [
        (form.C[:, kept] * form.eigenvalues[kept] ** k @ form.B[kept]).real for k in range(25)
    ]
    reduced = truncate(model, kept)
    assert reduced.nstates == 5
    assert list(reduced.input_labels) == ["u0", "u1"]
    np.testing.assert_allclose(pulse_responses(reduced)[1:], expected, atol=1e-12)
    assert np.isrealobj(reduced.A)


def test_truncate___half_a_pair___raises() -> None:
    with pytest.raises(IdentificationError, match="states 3/4 are one complex pair"):
        truncate(random_model(3, states=7), [0, 1, 3])


def labels(modes: Iterable[Any]) -> set[str]:
    return {mode.label for mode in modes}


@pytest.mark.parametrize("ranking", ["mrm", "msv"])
def test_reduce_model___order___takes_the_best_ranked_modes(
    full: Identification,
    data: IoData,
    ranking: Any,  # noqa: ANN401
) -> None:
    reduced = reduce_model(full, data, ranking=ranking, order=9)
    ranked = sorted(reduced.modes, key=lambda mode: getattr(mode, f"{ranking}_rank"))
    assert reduced.order == 9
    assert labels(mode for mode in reduced.modes if mode.kept) == set(reduced.kept)
    last = max(place for place, mode in enumerate(ranked) if mode.kept)
    passed_over = [mode for mode in ranked[:last] if not mode.kept]
    # Only a pair with room for one state is passed over, for the real mode that comes last.
    assert all(mode.is_pair for mode in passed_over)
    assert not passed_over or not ranked[last].is_pair


def test_reduce_model___order_would_split_a_pair___takes_one_more_with_a_warning() -> None:
    clean = record(random_model(4, states=6), 500, seed=4)
    found = identify(clean, order=6, block_rows=10, method="orse")
    assert all(mode.is_pair for mode in found.modes)
    reduced = reduce_model(found, clean, order=3)
    assert reduced.order == 4
    assert "order 4 instead of 3" in reduced.warnings[0]
    assert not reduce_model(found, clean, order=4).warnings


def test_reduce_model___mrmc___keeps_the_known_modes_and_the_rigid_motion(
    full: Identification, data: IoData
) -> None:
    reduced = reduce_model(full, data, ranking="mrmc", order=8, known_modes_hz=KNOWN_HZ)
    kept = [mode for mode in reduced.modes if mode.kept]
    hz = [mode.frequency_hz for mode in kept if mode.frequency_hz > 4.5]
    assert hz == pytest.approx([45.6, 24.1, 9.4], rel=0.03)
    rigid = [mode for mode in reduced.modes if mode.frequency_hz < 4.5]
    rest = sorted(rigid, key=lambda mode: mode.mrm_rank)
    slow = labels(kept) & labels(rigid)
    assert slow == labels(rest[: len(slow)])


def test_reduce_model___mrmc_mode_far_from_all___is_left_out_with_a_warning(
    full: Identification, data: IoData
) -> None:
    clean = record(random_model(4, states=6), 500, seed=4)
    found = identify(clean, order=6, block_rows=10, method="orse")
    reduced = reduce_model(found, clean, ranking="mrmc", order=4, known_modes_hz=[0.01])
    assert "no flexible mode near 0.01 Hz" in reduced.warnings[0]
    assert not reduce_model(full, data, ranking="mrmc", order=8, known_modes_hz=KNOWN_HZ).warnings


@pytest.mark.parametrize("update", ["b", "c"])
def test_reduce_model___update___fits_the_data_at_least_as_well(
    full: Identification,
    data: IoData,
    update: Any,  # noqa: ANN401
) -> None:
    def misfit(kind: Any) -> float:  # noqa: ANN401
        reduced = reduce_model(
            full, data, ranking="mrmc", order=8, known_modes_hz=KNOWN_HZ, update=kind
        )
        dmv = validate_dmv(reduced.model, data, reduced.x0[0])
        return float(np.sum(dmv.delta**2))

    assert misfit(update) < misfit("none")


def test_reduce_model___unstable_model___is_stabilised_first() -> None:
    model = random_model(5, states=5)
    A = model.A / np.abs(np.linalg.eigvals(model.A)).max() * 1.002
    unstable = named(A, model.B, model.C, model.D)
    data = record(unstable, 400, seed=5)
    found = identify(data, order=5, block_rows=10, stable=False, method="orse")
    assert np.abs(np.linalg.eigvals(found.model.A)).max() == pytest.approx(1.002)
    assert found.warnings == ("information: the model of order 5 is unstable",)
    reduced = reduce_model(found, data, order=4)
    assert np.abs(np.linalg.eigvals(reduced.model.A)).max() < 1.0


@pytest.mark.parametrize(
    ("request_", "message"),
    [
        ({"order": 0}, "order must lie between 1 and the model's 20: 0"),
        ({"order": 21}, "order must lie between 1 and the model's 20: 21"),
        ({"order": 9, "ranking": "best"}, "ranking must be mrm, msv or mrmc: 'best'"),
        ({"order": 9, "update": "a"}, "update must be b, c or none: 'a'"),
        ({"order": 9, "ranking": "mrmc"}, "mrmc needs known_modes_hz"),
        ({"order": 9, "ranking": "mrmc", "known_modes_hz": [-1.0]}, "mrmc needs known_modes_hz"),
        (
            {"order": 5, "ranking": "mrmc", "known_modes_hz": KNOWN_HZ},
            "order 5 is too small for 3 known modes",
        ),
    ],
)
def test_reduce_model___impossible_request___raises(
    full: Identification, data: IoData, request_: dict[str, Any], message: str
) -> None:
    with pytest.raises(IdentificationError, match=message):
        reduce_model(full, data, **request_)


def test_reduce_model___record_of_another_rig___raises(full: Identification) -> None:
    other = record(random_model(6), 300, seed=6)
    with pytest.raises(IdentificationError, match=r"the record's channels .* differ"):
        reduce_model(full, other, order=9)
