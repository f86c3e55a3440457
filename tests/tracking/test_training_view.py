"""MLflow's pages open in the view for model training, without a change of any other answer."""

import asyncio
import json
import re
from pathlib import Path

import pytest

from sextant.tracking.training_view import CHOICES, PLUG_IN, TrainingView, app

PAGE = b"<html><head><title>MLflow</title></head></html>"
HEADERS = [(b"content-length", str(len(PAGE)).encode()), (b"etag", b"one"), (b"x-frame-options", b"SAMEORIGIN")]


def answer(path, *, method="GET", kind="http", asked=()):
    """What the server sends for a request, and the headers with which the inner application was called."""
    sent, scopes = [], []

    async def inner(scope, receive, send):
        scopes.append(scope)
        await send({"type": "http.response.start", "status": 200, "headers": HEADERS})
        await send({"type": "http.response.body", "body": PAGE[:10], "more_body": True})
        await send({"type": "http.response.body", "body": PAGE[10:]})

    async def send(message):
        sent.append(message)

    scope = {"type": kind, "path": path, "method": method, "headers": list(asked)}
    asyncio.run(TrainingView(lambda: inner)(scope, None, send))
    return sent, scopes[0]["headers"]


def test_the_start_page_stores_the_choices_and_has_its_new_length():
    (start, body), asked = answer("/", asked=[(b"If-None-Match", b"one"), (b"host", b"here")])
    headers = dict(start["headers"])
    assert body["body"].startswith(b"<html><head><script>")
    assert body["body"].endswith(PAGE.removeprefix(b"<html><head>"))
    assert int(headers[b"content-length"]) == len(body["body"])
    assert (headers[b"cache-control"], headers[b"x-frame-options"]) == (b"no-store", b"SAMEORIGIN")
    assert b"etag" not in headers
    assert asked == [(b"host", b"here")]  # otherwise the browser would use a copy without the script


@pytest.mark.parametrize(("path", "method"), [("/health", "GET"), ("/", "POST"), ("/static-files/a.js", "GET")])
def test_every_other_answer_is_passed_on_as_it_is(path, method):
    sent, asked = answer(path, method=method, asked=[(b"if-none-match", b"one")])
    assert b"".join(message.get("body", b"") for message in sent) == PAGE
    assert sent[0]["headers"] == HEADERS
    assert asked == [(b"if-none-match", b"one")]


def test_the_choices_are_ones_that_the_pages_of_this_mlflow_read():
    import mlflow

    (script,) = (Path(mlflow.__file__).parent / "server/js/build/static/js").glob("main.*.js")
    text = script.read_text()
    for key in CHOICES:
        name, version = re.fullmatch(r"(.+)_v(\d)", key).groups()
        assert f'"{name}"' in text, key
        written_out = f'key:"{name}",version:'
        assert written_out not in text or f"{written_out}{version}," in text, key
    assert json.dumps(CHOICES["mlflow.workflowType_v1"]) in text


def test_the_plug_in_is_the_application():
    assert PLUG_IN.load() is app
