from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from support.browser import wait_until
from support.live_mock import LiveMock
from support.live_page import asked, opened

if TYPE_CHECKING:
    from pathlib import Path

    from support.browser import Browser


def test_chain___by_clicks_alone___ends_in_a_step_with_the_tuned_law(
    browser: Browser, mock: LiveMock
) -> None:
    opened(browser, mock)
    browser.ask("document.getElementById('step_seen').value = '0.5'")
    browser.click("#run_experiment")
    browser.click("#identify")
    browser.wait_for("document.querySelector('#stabilisation svg') !== null")
    assert asked(mock, "identify")[0]["bag"] == "C_dat3"
    x, y = browser.ask(
        """(({ x, y, width }) => [x + width / 2, y + 25])(
        document.querySelector("#stabilisation svg").getBoundingClientRect())"""
    )
    browser.click_at(x, y)
    browser.wait_for("document.getElementById('order').value === '40'")
    browser.click("#modes button")
    browser.wait_for("document.querySelector('#modes button').ariaPressed === 'true'")
    assert asked(mock, "identify")[-1]["known_modes_hz"] == [pytest.approx(9.02)]
    assert browser.ask("document.getElementById('command_model').textContent").endswith(
        "--order 40"
    )
    assert browser.ask("document.getElementById('report').pathname") == "/report/C_dat3"
    browser.click("#others button")
    browser.click("#compare")
    browser.wait_for("document.getElementById('comparison').checkVisibility()")
    (comparison,) = asked(mock, "compare")
    assert (comparison["bag"], comparison["models"]) == ("C_dat3", ["yesterday"])
    assert (comparison["order"], comparison["known_modes_hz"]) == (40, [pytest.approx(9.02)])
    address = "document.getElementById('comparison').pathname"
    assert browser.ask(address) == "/report/C_dat3/comparison"
    browser.click("#tab_tune")
    browser.click("#tune")
    browser.click("#apply")
    browser.click("#step")
    browser.wait_for("!document.getElementById('step').disabled")
    browser.click("#step")
    browser.wait_for("document.querySelectorAll('#steps .curve').length === 2")
    assert mock.arm.law == "pdpc"
    assert mock.arm.gains["pdpc.kp"] == pytest.approx(0.8)
    assert browser.console == []


def test_csv_file___dropped_on_the_page___is_identified_by_its_named_signals(
    browser: Browser, mock: LiveMock, tmp_path: Path
) -> None:
    opened(browser, mock)
    file = tmp_path / "my run.csv"
    content = b"t,motor,tip\n" + b"0.01,1.0,2.0\n" * 20_000
    file.write_bytes(content)
    drop(browser, file)
    browser.wait_for("document.querySelectorAll('#columns_rows select').length === 6")
    assert mock.dropped == {"my run.csv": content}
    # The page is longer than the window, and the file may be dropped anywhere.
    top = "document.getElementById('drop').getBoundingClientRect().top"
    browser.wait_for(f"{top} > 0 && {top} < innerHeight")
    browser.click("#identify")
    browser.wait_for(
        "document.getElementById('message').textContent.includes('choose an input and an output')"
    )
    for label, value in {
        "Role of t": "time",
        "Role of motor": "input",
        "Unit of motor": "V",
        "Role of tip": "output",
    }.items():
        browser.ask(
            f"""(() => {{ const menu = document.querySelector('[aria-label="{label}"]');
            menu.value = {value!r}; menu.dispatchEvent(new Event("change")); }})()"""
        )
    browser.click("#identify")
    browser.wait_for("document.querySelector('#stabilisation svg') !== null")
    (request,) = asked(mock, "identify")
    assert request["bag"] == "my run.csv"
    assert (request["inputs"], request["outputs"]) == (["motor_v=motor"], ["tip"])
    assert request["times"] == ["t"]
    assert browser.console == []


def test_folder___dropped_on_the_page___is_sent_with_every_file_in_it(
    browser: Browser, mock: LiveMock, tmp_path: Path
) -> None:
    opened(browser, mock)
    folder = tmp_path / "my bag"
    folder.mkdir()
    # A browser reads the names of a folder a hundred at a time.
    wanted = {f"my bag/{number}.mcap": b"%d" % number for number in range(110)}
    for name, content in wanted.items():
        (tmp_path / name).write_bytes(content)
    drop(browser, folder)
    wait_until(lambda: mock.dropped == wanted)
    assert browser.console == []


def drop(browser: Browser, path: Path) -> None:
    """Drag a file or folder onto the page."""
    data = {"items": [], "files": [str(path)], "dragOperationsMask": 1}
    for kind in ("dragEnter", "dragOver", "drop"):
        browser.call("Input.dispatchDragEvent", type=kind, x=500, y=500, data=data)


def test_order___clicked_while_another_is_identified_or_written___takes_its_place(
    browser: Browser, mock: LiveMock
) -> None:
    opened(browser, mock)
    mock.writing_s = 1e3
    browser.click("#tab_identify")
    browser.click("#identify")
    browser.wait_for("document.querySelector('#stabilisation svg') !== null")
    assert browser.ask("document.getElementById('report').hidden")

    def choose(*orders: int) -> None:
        """Choose orders at one stroke: a busy machine parts those of several calls."""
        browser.ask(
            f"""(() => {{ const field = document.getElementById("order");
            for (const order of {list(orders)}) {{
            field.value = order; field.dispatchEvent(new Event("change")); }} }})()"""
        )

    mock.job_step_s = 0.2
    choose(6, 8)
    wait_until(lambda: asked(mock, "identify")[-1]["order"] == 8)
    choose(12)
    wait_until(lambda: asked(mock, "identify")[-1]["order"] == 12)
    mock.writing_s = mock.job_step_s = 0.0
    browser.wait_for("!document.getElementById('report').hidden")
    assert browser.ask("document.getElementById('order').value") == "12"
    assert browser.ask("document.getElementById('command_model').textContent").endswith(" 12")
    assert [each["order"] for each in asked(mock, "identify")] == [0, 8, 12]
    assert len(asked(mock, "cancel")) == 2
    assert browser.ask("document.getElementById('message').textContent") == ""


def test_stage_tune___before_a_tuning___shows_the_line_of_the_server(
    browser: Browser, mock: LiveMock
) -> None:
    opened(browser, mock)
    line = "document.getElementById('command_tune').textContent"
    browser.click("#tab_tune")
    models = "nominal:0 nominal:0.2 nominal:0.4"
    browser.wait_for(f"{line}.startsWith('./flexarm tune --law pdpc {models} gain_margin_db 10')")
    # That law is tuned without margins, and no line is for no model.
    browser.ask(
        """(() => { const menu = document.getElementById("tuned_law");
        menu.value = "pi"; menu.dispatchEvent(new Event("change")); })()"""
    )
    browser.wait_for(f"{line} === './flexarm tune --law pi {models}'")
    assert browser.ask("document.getElementById('gain_margin').disabled")
    for _ in range(3):
        browser.click("#models [aria-pressed=true]")
    browser.wait_for("!document.getElementById('command_tune').checkVisibility()")


def test_job___cancelled___says_so_and_lets_the_next_one_begin(browser: Browser) -> None:
    with LiveMock(job_step_s=30.0) as mock:
        opened(browser, mock)
        browser.click("#run_experiment")
        browser.wait_for("!document.getElementById('cancel').disabled")
        browser.click("#cancel")
        wait_until(lambda: asked(mock, "cancel") != [])
        assert [asked(mock, "cancel")[0]["job"]] == mock.jobs


def test_job___over_a_broken_connection___goes_on(browser: Browser) -> None:
    with LiveMock(job_step_s=0.5) as mock:
        opened(browser, mock)
        browser.click("#run_experiment")
        wait_until(lambda: mock.jobs != [])
        mock.drop_pages()
        browser.wait_for("document.getElementById('recording').textContent === 'Recorded C_dat3'")
        assert len(asked(mock, "experiment")) == 1


def test_job___that_ended_without_a_connection___is_no_longer_waited_for(browser: Browser) -> None:
    with LiveMock(job_step_s=30.0) as mock:
        opened(browser, mock)
        browser.click("#run_experiment")
        browser.wait_for("!document.getElementById('running').hidden")
        wait_until(lambda: mock.jobs != [])
        mock.jobs.clear()
        browser.wait_for("document.getElementById('running').hidden")
        assert "the job ended" in browser.ask("document.getElementById('message').textContent")
