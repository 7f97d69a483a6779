"""Film of the page: its frames, its size and the way of its hand."""

from __future__ import annotations

from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from bench.live import pointer
from bench.live.film import FilmError, Shot, durations_ms, encoded, frames_of
from bench.live.pointer import Place

RATE_HZ = 15.0


def shots(times_s: list[float]) -> list[Shot]:
    return [Shot(time_s, b"", (0.0, 0.0), pressed=False) for time_s in times_s]


def test_frames___are_the_shots_nearest_to_their_instants() -> None:
    taken = shots([-0.3, 0.02, 0.05, 0.13, 0.18])
    frames = frames_of(taken, 0.2, RATE_HZ)
    assert [frame.time_s for frame in frames] == [0.02, 0.05, 0.13]


def test_frames___of_a_screen_that_stood_still___are_refused_with_the_way_out() -> None:
    with pytest.raises(FilmError, match=r"one shot would stand for 22 frames.*smaller --pace"):
        frames_of(shots([0.0, 1.0]), 2.0, RATE_HZ)


def test_durations___in_whole_milliseconds___add_up_to_the_length() -> None:
    durations = durations_ms(150, RATE_HZ)
    assert sum(durations) == 10_000
    assert set(durations) <= {66, 67}


def test_film___repeats_and_has_every_frame_on_its_instant() -> None:
    pictures = [Image.new("RGB", (40, 20), (10 * k, 0, 200)) for k in range(6)]
    file, colours = encoded(pictures, RATE_HZ, 10_000, palettes=(64,))
    film = Image.open(BytesIO(file))
    assert (film.n_frames, film.info["loop"], colours) == (6, 0, 64)  # type: ignore[attr-defined]
    for k, picture in enumerate(pictures):
        film.seek(k)
        assert film.convert("RGB").getpixel((5, 5)) == picture.getpixel((5, 5))


def test_film_of_many_colours___gives_up_colours_until_it_is_small_enough() -> None:
    random = np.random.default_rng(3)
    pictures = [
        Image.fromarray(random.integers(0, 256, (40, 60, 3), dtype=np.uint8)) for _ in range(4)
    ]
    rich, _ = encoded(pictures, RATE_HZ, 10**6, palettes=(128,))
    file, colours = encoded(pictures, RATE_HZ, len(rich) - 1, palettes=(128, 16, 2))
    assert colours == 16
    assert len(file) < len(rich)
    with pytest.raises(FilmError, match=r"at the least, more than 100$"):
        encoded(pictures, RATE_HZ, 100, palettes=(128, 16))


def test_pointer___between_two_places___begins_and_ends_at_rest() -> None:
    path = [Place(1.0, 0.0, 10.0), Place(3.0, 8.0, 10.0), Place(4.0, 8.0, 0.0)]
    assert pointer.at(path, 0.0) == (0.0, 10.0)
    assert pointer.at(path, 2.0) == pytest.approx((4.0, 10.0))
    assert pointer.at(path, 1.01)[0] < 0.01
    assert pointer.at(path, 9.0) == pytest.approx((8.0, 0.0))


def test_pointer___its_button___turns_where_the_path_says_also_when_time_jumps() -> None:
    path = [
        Place(0.0, 0.0, 0.0),
        Place(1.0, 5.0, 0.0, pressed=True),
        Place(2.0, 9.0, 0.0, pressed=True),
        Place(3.0, 9.0, 0.0),
    ]
    assert [place.time_s for place in pointer.turns(path, 0.0, 9.0)] == [1.0, 3.0]
    assert pointer.turns(path, 1.0, 2.5) == []


def test_drawn_pointer___has_its_tip_where_it_points() -> None:
    black = Image.new("RGB", (60, 60))
    touched = np.argwhere(np.array(pointer.drawn(black, 20, 10, pressed=False)).max(axis=2) > 64)
    assert touched.min(axis=0).tolist() == pytest.approx([10, 20], abs=2)
