"""What the pages show of commands: found in their text, and compared with what is printed now."""

from __future__ import annotations

from docs.pages import (
    Step,
    differences,
    drawn_alike,
    folders,
    plain_blocks,
    steps,
)

PAGE = """\
# Page
<!-- folder: examples/own -->

    $ first --option \\
        value
    one 0.5
      two
    $ second   # a remark
    ...

Text, and a list:
- with a command

      $ third
      three

<!-- file: look.py -->
```python
print(1)
```

```python
>>> 1 + 1
2

```

<!-- output of: fourth -->
```
four
```

<!-- together until: at zero -->

    ./flexarm record out/a
    ./flexarm run node \\
        -p law:=pd

<!-- drawn by: python draw.py -->
![Curve](images/curve.svg)

<!-- not run: it needs a board -->

    $ fifth
"""


def test_page___steps___are_its_commands_with_their_lines_and_its_files() -> None:
    assert list(steps(PAGE)) == [
        Step(4, ("first --option value",), ("    one 0.5", "      two")),
        Step(8, ("second",), ("    ...",)),
        Step(14, ("third",), ("      three",)),
        Step(19, file="look.py", text="print(1)\n"),
        Step(30, ("fourth",), ("four",)),
        Step(
            35,
            ("./flexarm record out/a", "./flexarm run node -p law:=pd"),
            until="at zero",
        ),
        Step(39, ("python draw.py",), picture="images/curve.svg"),
    ]
    assert folders(PAGE) == ["examples/own"]


def test_page___commands_without_a_prompt___are_reported_with_their_lines() -> None:
    assert list(plain_blocks(PAGE)) == [
        (35, "./flexarm record out/a"),
        (36, "./flexarm run node -p law:=pd"),
    ]


def test_output___as_shown___has_no_differences() -> None:
    printed = "start\n good: error 0.1988 in\n data\n 9.2 yes\n 24.1 yes\nend in 3.7 s, at 12 V\n"
    for shown in (
        ("good: error 0.199 in data",),
        ("good: error 0.200 ...", "...", "end ..."),
        ("24.1 yes",),
        ("9.2 yes", "24.0 yes"),
        ("end in ... s, at 12 V",),
        (),
    ):
        assert differences(shown, printed) == [], shown


def test_output___other_figures_words_or_order___is_reported_with_what_is_there() -> None:
    printed = "error 0.199 on 11999 samples\nmode 9.20 Hz\nmode 24.1 Hz\n"
    assert differences(("error 0.203 on 11999 samples",), printed) == [
        "error 0.203 on 11999 samples\n    now: error 0.199 on 11999 samples"
    ]
    assert differences(("mode 24.1 Hz", "mode 9.20 Hz"), printed) == ["mode 9.20 Hz"]
    assert differences(("error 0.199 on 11999 rows",), printed) == ["error 0.199 on 11999 rows"]
    assert differences(("mode 9.20 ... 25.0 Hz",), printed) == [
        "mode 9.20 ... 25.0 Hz\n    now: mode 9.20 Hz mode 24.1 Hz"
    ]


def test_output___count_of_messages___agrees_more_closely_than_a_measured_figure() -> None:
    printed = "recorded 24045 messages within 24045.0 V"
    assert differences(("recorded 24048 messages",), printed) == []
    assert differences(("recorded 24085 messages",), printed) == [
        "recorded 24085 messages\n    now: recorded 24045 messages"
    ]
    assert differences(("messages within 24085.0 V",), printed) == []


def test_picture___drawn_anew___is_another_one_when_its_places_or_words_are() -> None:
    curve = '<path d="M 1.0 2.0 L 3.0 4.0" clip-path="url(#p0123456789)"/><text x="1">Hz</text>'
    assert drawn_alike(curve, curve.replace("3.0", "3.4").replace("#p0123", "#pabcd"))
    assert not drawn_alike(curve, curve.replace("3.0", "4.5"))
    assert not drawn_alike(curve, curve.replace("Hz", "s"))
    assert not drawn_alike(curve, curve.replace(" L 3.0 4.0", ""))
