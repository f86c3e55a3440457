"""A pytest plugin: name, outcome and seconds of each test go to the file ``SEXTANT_TEST_LOG``."""

import json
import os

import pytest


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    if "PYTEST_XDIST_WORKER" in os.environ or (report.when != "call" and report.passed):
        return
    with open(os.environ["SEXTANT_TEST_LOG"], "a") as file:
        print(json.dumps([report.nodeid, report.outcome, f"{report.duration:.1f}"]), file=file)
