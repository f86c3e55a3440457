"""Ranges of values as they are written."""

import math
from contextlib import suppress

import pytest
from fuzzing import fuzz
from hypothesis import given
from hypothesis import strategies as st

from sextant.composing.config_files import search_words
from sextant.composing.overrides import parse
from sextant.config.schema.searches import dimension, is_dimension

NUMBERS = st.floats(-1e6, 1e6, allow_nan=False).map(lambda value: float(f"{value:.6g}"))


@fuzz
@given(st.sampled_from(["uniform", "log_uniform", "int"]), NUMBERS, NUMBERS, st.floats(0, 1))
def test_what_is_written_is_read_and_a_value_within_stays_within(kind, one, other, share):
    low, high = sorted((one, other))
    if kind == "int":
        low, high = math.floor(low), math.floor(high)
    text = f"{kind}({low!r}, {high!r})"
    if low >= high or (kind == "log_uniform" and low <= 0):
        with pytest.raises(ValueError, match="bounds"):
            dimension(text)
        return
    found = dimension(text)
    assert (found.kind, found.low, found.high) == (kind, low, high)
    assert low <= float(found.middle) <= high
    assert [float(end) for end in found.ends] == pytest.approx([low, high], rel=1e-5)
    shown = found.text(low + share * (high - low))
    assert float(shown) == pytest.approx(low + share * (high - low), rel=1e-5, abs=1 if kind == "int" else 1e-300)
    (override,) = parse(search_words([f"optimizer.lr={text}"]))
    assert is_dimension(override.value)
    assert dimension(override.value) == found
    (typed,) = parse([f"optimizer.lr={shown}"])  # as a number of the same value
    assert float(typed.value) == float(shown)


@pytest.mark.slow
@fuzz
@given(st.one_of(st.text(), st.from_regex(r"(uniform|int|choice)\(.{,9}\)", fullmatch=True)))
def test_any_text_is_a_range_or_is_refused(text):
    with suppress(ValueError):
        assert dimension(text).ends


def test_a_choice_keeps_commas_within_brackets_and_quotes():
    assert dimension("choice(a, [1, 2], 'b, c', {x: 1, y: 2})").options == ("a", "[1, 2]", "'b, c'", "{x: 1, y: 2}")
    for wrong in ("choice()", "choice(a, a)", "choice(a,)"):
        with pytest.raises(ValueError, match="different values"):
            dimension(wrong)


def test_only_the_words_of_a_search_are_changed():
    words = ["sweep=demo", "sweep.seeds=3", "optimizer.lr=0.1", "trainer.max_epochs=int(2.5)", "seed=0,1"]
    assert search_words(words) == words
    assert search_words(["sweep.search=tpe", "sweep.seeds=3"]) == ["++sweep.search.method=tpe", "++sweep.seeds=3"]
