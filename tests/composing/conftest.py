"""Here it is composing itself that is tested: nothing that other tests composed is kept."""

import pytest

from sextant.composing import compose


@pytest.fixture(autouse=True)
def composed_anew():
    before = compose._KEPT.set(None)
    yield
    compose._KEPT.reset(before)
