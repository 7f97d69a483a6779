from __future__ import annotations

import math
import re
from dataclasses import replace
from importlib.resources import files
from string import Template
from typing import TYPE_CHECKING

import pytest

from flexarm_core.errors import SettingError
from flexarm_core.rig_description import described, load_rig, packaged
from flexarm_core.yaml_sections import SectionError

if TYPE_CHECKING:
    from pathlib import Path

GOOD = """\
name: two_link
rate_hz: 500
inputs:
  shoulder_a: {quantity: current, unit: A, limits: 1.5, slew_per_s: 100}
  elbow_nm: {quantity: torque, unit: N m, limits: [-0.5, 2], rest: 0.25, raw_per_unit: 2048}
outputs:
  shoulder_deg:
    {quantity: angle, unit: deg, scale: 0.088, offset: 2048, range: [-180, 180], wrap: 360}
  elbow_rad: {quantity: angle, unit: rad}
  elbow_rpm: {quantity: rate, unit: rpm}
  tip: {quantity: acceleration, unit: V, per_si: 0.1, range: 5}
  base: {quantity: moment, unit: V, per_si: 1.6, absent: true}
joints:
  shoulder: {input: shoulder_a, angle: shoulder_deg, travel: 90, coulomb: 0.05}
  elbow: {input: elbow_nm, angle: elbow_rad, rate: elbow_rpm, travel: [-1, 2], sign: -1,
    link_length_m: 0.3}
tracked: [elbow_rad]
driver: mine.py:Mine
settings: {port: /dev/ttyUSB0}
safety: {max_age_periods: 4, stuck_samples: 0, end_of_travel: hold}
"""


def changed(before: str, after: str) -> str:
    assert GOOD.count(before) == 1, before
    return GOOD.replace(before, after)


def test_description___whole___is_read_with_its_units_and_defaults() -> None:
    rig = described(GOOD)
    shoulder, elbow = rig.inputs
    assert (rig.name, rig.rate_hz, rig.tracked) == ("two_link", 500.0, ("elbow_rad",))
    assert (shoulder.low, shoulder.high, shoulder.slew_per_s, shoulder.rest) == (
        -1.5,
        1.5,
        100.0,
        0.0,
    )
    assert (elbow.low, elbow.high, elbow.rest, elbow.raw_per_unit) == (-0.5, 2.0, 0.25, 2048.0)
    assert [(each.low, each.high, each.sign) for each in rig.joints] == [(-90, 90, 1), (-1, 2, -1)]
    assert [each.rate for each in rig.joints] == [None, "elbow_rpm"]
    assert rig.joints[0].coulomb == pytest.approx(0.05)
    assert rig.joints[1].coulomb is None
    assert rig.output("base").absent
    assert rig.settings == {"port": "/dev/ttyUSB0"}
    assert (rig.safety.max_age_periods, rig.safety.end_of_travel) == (4, "hold")


def test_output___of_counts___has_its_value_and_its_si_unit() -> None:
    encoder = described(GOOD).output("shoulder_deg")
    assert encoder.value(2048) == pytest.approx(0.0)
    assert encoder.value(2048 + 1000) == pytest.approx(88.0)
    assert encoder.to_si(90.0) == pytest.approx(math.pi / 2.0)
    assert described(GOOD).output("elbow_rpm").to_si(60.0) == pytest.approx(2.0 * math.pi)
    assert described(GOOD).output("tip").to_si(0.981) == pytest.approx(9.81)
    assert described(GOOD).input("shoulder_a").text(-0.5) == "-0.5 A"


def test_tracked___by_default___is_the_angle_of_every_joint() -> None:
    assert described(changed("tracked: [elbow_rad]\n", "")).tracked == ("shoulder_deg", "elbow_rad")


BAD = {
    "inputs are missing": ("inputs:\n", "outputs2:\n", 1),
    "outputs are missing": ("outputs:\n", "readings:\n", 1),
    "name is missing": ("name: two_link\n", "", 1),
    "driver is missing": ("driver: mine.py:Mine\n", "", 1),
    "rate_hz is missing": ("rate_hz: 500\n", "", 1),
    "rate_hz = 0 must lie": ("rate_hz: 500", "rate_hz: 0", 2),
    "rate_hz = 'fast' must be a finite number": ("rate_hz: 500", "rate_hz: fast", 2),
    "rate_hz = True must be a finite number": ("rate_hz: 500", "rate_hz: yes", 2),
    "rate_hz = nan must be a finite number": ("rate_hz: 500", "rate_hz: .nan", 2),
    "rate is not known (nearest: rate_hz)": ("rate_hz: 500", "rate_hz: 500\nrate: 5", 3),
    'name = 3 must be a text: write "3"': ("name: two_link", "name: 3", 1),
    "inputs.shoulder_a.quantity = 'curent' is not known (nearest: current)": (
        "quantity: current",
        "quantity: curent",
        4,
    ),
    "inputs.shoulder_a.unit = 'Amp' is not known as a unit of current": (
        "unit: A,",
        "unit: Amp,",
        4,
    ),
    "inputs.shoulder_a.limits is missing": ("limits: 1.5, ", "", 4),
    "inputs.shoulder_a.limits = [1, -1]": ("limits: 1.5", "limits: [1, -1]", 4),
    "inputs.shoulder_a.limits must be a list of two": ("limits: 1.5", "limits: [1, 2, 3]", 4),
    "inputs.shoulder_a.limits = 0: one number is the reach": ("limits: 1.5", "limits: 0", 4),
    "inputs.shoulder_a.limits = -2: one number is the reach": ("limits: 1.5", "limits: -2", 4),
    "inputs.shoulder_a.limits is missing (nearest: limit)": ("limits: 1.5", "limit: 1.5", 4),
    "inputs.elbow_nm.rest = 3 must lie from -0.5 to 2": ("rest: 0.25", "rest: 3", 5),
    "inputs.elbow_nm.raw_per_unit = 0 has no meaning": ("raw_per_unit: 2048", "raw_per_unit: 0", 5),
    "inputs.shoulder_a.slew_per_s = -100 must lie": ("slew_per_s: 100", "slew_per_s: -100", 4),
    "inputs.shoulder_a.slew is not known (nearest: slew_per_s)": (
        "slew_per_s: 100",
        "slew: 100",
        4,
    ),
    "outputs.shoulder_deg.scale = 0 has no meaning": ("scale: 0.088", "scale: 0", 8),
    "shoulder_deg: wrap = 360 needs a range": ("range: [-180, 180], wrap", "wrap", 8),
    "shoulder_deg: wrap = 720 needs a range": ("wrap: 360", "wrap: 720", 8),
    "outputs.shoulder_deg.wrap = -360 must lie": ("wrap: 360", "wrap: -360", 8),
    "outputs.shoulder_deg.range = [180, -180]": ("range: [-180, 180]", "range: [180, -180]", 8),
    "outputs.elbow_rad stands here twice": ("  elbow_rpm:", "  elbow_rad:", 10),
    "tip: acceleration in V needs per_si, the V of one m/s^2": ("per_si: 0.1, ", "", 11),
    "outputs.tip.per_si = 0 has no meaning": ("per_si: 0.1", "per_si: 0", 11),
    "elbow_rad: per_si has no meaning for angle in rad": ("unit: rad}", "unit: rad, per_si: 2}", 9),
    "outputs.base.absent = 'maybe' must be true or false": ("absent: true", "absent: maybe", 12),
    "shoulder_a is the name of an input and of an output": ("  tip:", "  shoulder_a:", 6),
    "outputs.tip 1: a name has letters": ("  tip:", "  tip 1:", 11),
    "joints.shoulder.input = 'motor' is not known": ("input: shoulder_a", "input: motor", 14),
    "joints.elbow.input = shoulder_a is that of joint shoulder": (
        "input: elbow_nm",
        "input: shoulder_a",
        15,
    ),
    "joints.elbow.angle = shoulder_deg is that of joint shoulder": (
        "angle: elbow_rad",
        "angle: shoulder_deg",
        15,
    ),
    "joints.elbow.angle = 'elbow_rpm' is not known as an angle or position": (
        "angle: elbow_rad",
        "angle: elbow_rpm",
        15,
    ),
    "joints.elbow.rate = 'tip' is not known as a rate or velocity": (
        "rate: elbow_rpm",
        "rate: tip",
        15,
    ),
    "joints.elbow.sign = 2 must be 1 or -1": ("sign: -1", "sign: 2", 15),
    "joints.shoulder.travel is missing": ("travel: 90, ", "", 14),
    "joints.elbow.travel = [2, -1]": ("travel: [-1, 2]", "travel: [2, -1]", 15),
    "joints.shoulder.coulomb = -1 must lie": ("coulomb: 0.05", "coulomb: -1", 14),
    "joints.elbow.link_length_m = 0 must lie": ("link_length_m: 0.3", "link_length_m: 0", 16),
    "joints.hip must be a mapping": ("joints:\n", "joints:\n  hip: 3\n", 14),
    "tracked = 'base' is not known": ("tracked: [elbow_rad]", "tracked: [base]", 17),
    "tracked must be a list of names, each once": ("[elbow_rad]", "[elbow_rad, elbow_rad]", 17),
    "reference_tip: names with reference_ or compensation_": ("  tip:", "  reference_tip:", 6),
    "tracked: elbow_rpm is not a joint's angle and needs a range": (
        "[elbow_rad]",
        "[elbow_rad, elbow_rpm]",
        17,
    ),
    "tracked has 3 outputs for 2 inputs": ("[elbow_rad]", "[elbow_rad, elbow_rpm, tip]", 17),
    "settings must be a mapping": ("settings: {port: /dev/ttyUSB0}", "settings: fast", 19),
    "safety.max_age_periods = 2.5 must be a whole number": ("periods: 4", "periods: 2.5", 20),
    "safety.stuck_samples = -1 must lie": ("stuck_samples: 0", "stuck_samples: -1", 20),
    "safety.end_of_travel = 'stop' is not known": (
        "end_of_travel: hold",
        "end_of_travel: stop",
        20,
    ),
    "safety.watchdog is not known": ("stuck_samples: 0", "watchdog: 0", 20),
    "outputs.shoulder_deg.offset = 1000": ("offset: 2048", "offset: 1" + 350 * "0", 8),
    "safety.stuck_samples = 1000": ("stuck_samples: 0", "stuck_samples: 1" + 350 * "0", 20),
    "name = 'two\\nlink' must be one line": ("name: two_link", 'name: "two\\nlink"', 1),
    "driver = 'mine.py:\\x1b' must be one line": ("mine.py:Mine", '"mine.py:\\e"', 18),
    "outputs.on: YAML takes on for no text: rename it": ("  tip:", "  on:", 11),
    "outputs.5: a name has letters": ("  tip:", "  5:", 11),
    "outputs.shoulder_deg.wrpa is not known (nearest: wrap)": ("wrap: 360", "wrpa: 360", 8),
    "joints.elbow.travel = [-1, 2] passes the range of elbow_rad, [-1.5, 1.5]": (
        "unit: rad}",
        "unit: rad, range: 1.5}",
        15,
    ),
    "no YAML: did not find expected ',' or '}' (while parsing a flow mapping)": (
        "unit: rad}",
        "unit: rad",
        9,
    ),
    "joints.elbow.angle = 'elbow_rad' is not known": ("unit: rad}", "unit: rad, absent: true}", 15),
}


@pytest.mark.parametrize(("said", "change"), BAD.items(), ids=BAD)
def test_description___that_is_wrong___is_refused_with_its_line(
    said: str, change: tuple[str, str, int]
) -> None:
    before, after, line = change
    with pytest.raises(SectionError) as refused:
        described(changed(before, after), "arm.yaml")
    assert str(refused.value).startswith(f"arm.yaml:{line}: {said}")
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("section", ["inputs", "outputs"])
@pytest.mark.parametrize("nothing", ["", " {}"])
def test_description___without_signals___is_refused(section: str, nothing: str) -> None:
    rest = "name: lamp\nrate_hz: 100\ndriver: rig.py:Mine\n"
    other = {"inputs": "outputs: {a: {unit: x}}", "outputs": "inputs: {u: {unit: x, limits: 1}}"}
    with pytest.raises(SectionError, match=rf"^arm\.yaml:5: {section} are missing: an arm has at"):
        described(f"{rest}{other[section]}\n{section}:{nothing}\n", "arm.yaml")


def test_two_joints___with_the_rate_of_one_output___are_refused() -> None:
    text = changed("travel: 90", "travel: 90, rate: elbow_rpm")
    with pytest.raises(
        SectionError, match=r"joints\.elbow\.rate = elbow_rpm is that of joint shou"
    ):
        described(text)


def test_input___named_as_a_compensation___is_refused_at_the_inputs() -> None:
    text = GOOD.replace("shoulder_a", "compensation_a")
    with pytest.raises(SectionError, match=r"^arm\.yaml:3: compensation_a: names with reference_"):
        described(text, "arm.yaml")


@pytest.mark.parametrize(
    "change", [("rate_hz: ", "rate_hz:\t"), ("limits: 1.5, ", "limits: 1.5,\t")]
)
def test_tab___where_yaml_has_it___is_read_as_a_space(change: tuple[str, str]) -> None:
    rig = replace(described(changed(*change)), text="")
    assert rig == replace(described(GOOD), text="")


def test_sections___that_are_merged_from_an_anchor___are_read_as_if_they_stood_there() -> None:
    merged = changed("  tip: {", "  <<: {tip: &tip {<<: {quantity: acceleration}, ").replace(
        "range: 5}", "range: 5}}", 1
    )
    outputs = {each.name: each for each in described(merged).outputs}
    assert outputs == {each.name: each for each in described(GOOD).outputs}
    with pytest.raises(
        SectionError, match=r"^arm\.yaml:11: outputs\.tip\.scale = 0 has no meaning"
    ):
        described(merged.replace("range: 5}", "range: 5, scale: 0}"), "arm.yaml")


def test_optional_entry___left_empty___has_its_default() -> None:
    rig = replace(described(changed("coulomb: 0.05", "coulomb: ~")), text="")
    assert rig == replace(described(changed(", coulomb: 0.05", "")), text="")


def test_input___that_rests_aside___reaches_as_far_as_its_nearer_end() -> None:
    ways = {"[-0.5, 2], rest: 0.25": 0.75, "[-0.5, 2], rest: 1.5": 0.5, "[0, 2], rest: 0": 0.0}
    for limits, reach in ways.items():
        rig = described(changed("[-0.5, 2], rest: 0.25", limits))
        assert rig.input("elbow_nm").reach == pytest.approx(reach)


def test_tracks___of_a_joint_and_of_an_output___have_travel_and_range() -> None:
    rig = described(changed("tracked: [elbow_rad]", "tracked: [tip, elbow_rad]"))
    assert [(each.name, each.unit, each.low, each.high) for each in rig.tracks] == [
        ("tip", "V", -5.0, 5.0),
        ("elbow", "rad", -1.0, 2.0),
    ]
    elbow = rig.joints[1]
    assert [elbow.middle, elbow.half_travel] == pytest.approx([0.5, 1.5])


def test_units___of_an_output_in_counts___are_counts_of_one() -> None:
    rig = described(changed("unit: rad}", "unit: count, per_si: 1000}"))
    units = rig.output("elbow_rad").units
    assert units["count"] == pytest.approx(1.0)
    assert units["rad"] == pytest.approx(1000.0)
    assert units["deg"] == pytest.approx(1000.0 * math.pi / 180.0)


@pytest.mark.parametrize("text", ["", "# nothing\n", "3", "[1, 2]", "a: [", "name: *none", "\t"])
def test_description___that_is_no_mapping___is_refused(text: str) -> None:
    with pytest.raises(SectionError, match=r"^arm\.yaml:[12]: "):
        described(text, "arm.yaml")


@pytest.mark.parametrize("name", packaged())
def test_packaged___each___is_read_by_its_name(name: str) -> None:
    assert load_rig(name).name == name


def test_packaged_thesis___signals___are_those_of_the_thesis() -> None:
    rig = load_rig("thesis")
    angle = rig.output("position_v")
    # 3 V are 35 degrees, and 10 V of the drive 5 A (section 2.3).
    assert math.degrees(angle.to_si(3.0)) == pytest.approx(35.0)
    assert rig.input("command_v").to_si(10.0) == pytest.approx(5.0)
    # The drive gives 0.5 A/V (Figure 2-2).
    assert rig.input("command_v").text(1.2) == "1.2 V, 0.6 A"
    assert math.degrees(angle.to_si(rig.joints[0].high)) == pytest.approx(80.0)
    assert load_rig("thesis-nidaq").outputs == rig.outputs


def test_template___comments___are_the_defaults() -> None:
    text = files("flexarm_core").joinpath("rigs", "template.yaml").read_text("utf-8")
    filled = Template(text).substitute(
        name="arm", input_quantities="", output_quantities="", drivers=""
    )
    rig = replace(described(filled), text="")
    # The other comments are examples.
    examples = ("range", "wrap", "coulomb")
    entries = re.findall(r"^ *# (?:  )?(?!Entries)[a-z_]+: ?.*$", filled, re.MULTILINE)
    assert len(entries) > len(examples)
    safety = "".join(f"{line}\n" for line in entries if not line.startswith(" "))
    for entry in [each for each in entries if each.startswith(" ")]:
        if not any(f"# {name}:" in entry for name in examples):
            stated = filled.replace(entry, entry.replace("# ", "", 1))
            assert replace(described(stated), text="") == rig, entry
    stated = filled.replace(safety[safety.index("# safety") :], "") + re.sub(
        "(?m)^# ", "", safety[safety.index("# safety") :]
    )
    assert replace(described(stated), text="") == rig


def test_load_rig___of_no_file___names_the_packaged_ones(tmp_path: Path) -> None:
    with pytest.raises(
        SettingError, match=r"no such file, and no packaged rig \(nearest: thesis\)"
    ):
        load_rig("thesi")
    binary = tmp_path / "arm.yaml"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(SettingError, match=r"arm\.yaml: "):
        load_rig(binary)
