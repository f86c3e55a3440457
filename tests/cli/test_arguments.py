"""Values on a command line: read exactly as they are written, and refused with what is allowed."""

import re
from typing import Annotated, Literal

import pytest
from pydantic import Field

from sextant import cli
from sextant.console.arguments import SPLIT, Options, parse_arguments
from sextant.console.console import print_mistake
from sextant.errors import UserError


class Chosen(Options):
    """One key of each kind."""

    name: str
    """what it is called, in
    one line"""
    count: int = Field(2, ge=1, le=9, examples=[4])
    """how many"""
    share: float | None = Field(None, gt=0, examples=[0.5])
    """of what"""
    kept: bool = Field(False, examples=["true"])
    """whether it is"""
    kind: Literal["round", "square"] = Field("round", examples=["square"])
    """which shape"""
    sizes: Annotated[tuple[float, ...], SPLIT] = Field((), title="numbers", examples=["1,2"])
    """how large"""
    address: str | None = Field(None, alias="server.address")
    """where"""


def test_values_are_read():
    given = {"name": "a", "count": "3", "share": "1e-3", "kept": "true", "kind": "square", "sizes": "(1, 2.5)"}
    read = Chosen.of({**given, "server.address": "x", "of another": "y"})
    assert read.model_dump() == {
        "name": "a", "count": 3, "share": 0.001, "kept": True, "kind": "square", "sizes": (1.0, 2.5), "address": "x",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("given", "says"),
    [
        *(({"count": v}, f"count={v} must be a whole number from 1 to 9\nFor example count=4") for v in ("0", "10")),
        *(({"count": v}, "must be a whole number") for v in ("", "1_0", " 3", "+3", "3.0", "-3", "٣")),
        *(({"share": v}, f"share={v} must be a number above 0") for v in ("0", "-1", "nan", "inf", "1_0", " 1", "x")),
        *(({"kept": v}, f"kept={v} must be true or false") for v in ("yes", "1", "True", "")),
        ({"kind": "Round"}, "kind=Round must be one of round, square"),
        ({"sizes": "1,x"}, "sizes=1,x must be numbers\nFor example sizes=1,2"),
        ({"name": ""}, "name= is missing: what it is called, in one line"),
    ],
)
def test_mistakes_say_what_is_allowed(given, says):
    with pytest.raises(UserError, match=re.escape(says)):
        Chosen.of({"name": "a"} | given)


def test_a_command_line_has_no_other_keys(capsys):
    assert Chosen.parse(["name=a", "count=5"], "usage").count == 5
    with pytest.raises(UserError, match=re.escape("cuont=5: unknown key\nDid you mean count=5?")):
        Chosen.parse(["name=a", "cuont=5"], "usage")
    with pytest.raises(UserError, match=r"name= is missing.*\nusage"):
        Chosen.parse([], "usage")
    with pytest.raises(SystemExit):
        Chosen.parse(["--help"], "usage")
    said = capsys.readouterr().out
    assert "name            what it is called, in one line" in said
    assert "server.address  where" in said


def test_an_empty_value_is_not_the_current_folder():
    with pytest.raises(UserError, match=re.escape("address= is empty: where\nusage")):
        parse_arguments(["name=a", "address="], {"name": "what", "address": "where"}, "usage")


def test_a_key_that_is_given_twice_is_refused():
    with pytest.raises(UserError, match="input= is given twice: photos and drive"):
        parse_arguments(["input=photos", "output=found", "input=drive"], {"input": "", "output": ""}, "usage")


def test_what_stands_between_colons_is_shown_as_it_is(capsys):
    print_mistake(UserError("input=camera:x: a camera has a number", "map=zoo:office: for example"))
    assert capsys.readouterr().err == "Error: input=camera:x: a camera has a number\nmap=zoo:office: for example\n"


def test_a_user_who_is_not_known_is_one_message(capsys):
    with pytest.raises(SystemExit) as ended:
        cli.run("inspect", ["~no such user/photos"])
    assert ended.value.code == 2
    assert "a path starts with ~ and a name, but there is no such user here" in capsys.readouterr().err
