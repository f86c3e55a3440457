"""What is told of long work where nobody draws a bar."""

from sextant.data.rendered import notify_every


def test_a_line_every_so_often(caplog, monkeypatch):
    caplog.set_level("INFO")
    now = iter([0.0, 1.0, 6.0, 6.0, 7.0, 12.0, 12.0])
    monkeypatch.setattr("sextant.data.rendered.lock.time.monotonic", lambda: next(now))
    notify = notify_every(5.0, "rendering town")
    for done in (1, 2, 3, 4):
        notify(done * 1000, 4000)
    assert caplog.messages == ["rendering town: 2,000/4,000 images", "rendering town: 4,000/4,000 images"]
