import pytest

from sextant.runs.history import History, read_history


def test_each_step_and_name_is_kept_once_across_resumes(tmp_path):
    path = tmp_path / "history.jsonl"
    first = History(path)
    assert first.add(1, 10, {"a": 1.0}) == {"a": 1.0}
    assert first.add(2, 20, {"a": 2.0}) == {"a": 2.0}
    resumed = History(path)
    assert resumed.add(2, 99, {"a": 2.0, "b": 5.0}) == {"b": 5.0}
    assert resumed.add(3, 30, {"a": 3.0}) == {"a": 3.0}
    values = [(line["step"], name) for line in read_history(path) for name in line["metrics"]]
    assert values == [(1, "a"), (2, "a"), (2, "b"), (3, "a")]


def test_a_kill_while_a_resumed_history_is_tidied_loses_nothing(tmp_path, monkeypatch):
    path = tmp_path / "history.jsonl"
    History(path).add(1, 10, {"a": 1.0})

    def killed(self, target):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(type(path), "replace", killed)
        with pytest.raises(KeyboardInterrupt):
            History(path)
    assert [line["step"] for line in read_history(path)] == [1]


def test_a_line_cut_off_by_a_crash_is_dropped(tmp_path):
    path = tmp_path / "history.jsonl"
    History(path).add(1, 10, {"a": 1.0})
    with path.open("a") as file:
        file.write('{"step": 2, "time_ms"')
    History(path).add(2, 20, {"a": 2.0})
    assert [line["step"] for line in read_history(path)] == [1, 2]
