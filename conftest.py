"""What holds for all tests: a skipped test is a failure in CI, where nothing may be missing."""

import os

import pytest


def _fail_if_skipped(report):
    if report.skipped and not hasattr(report, 'wasxfail') and os.environ.get('CI'):
        report.outcome = 'failed'
        report.longrepr = f'skipped, which is a failure in CI: {report.longrepr[2]}'
    return report


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport():
    """Turn the skip of a test into a failure."""
    return _fail_if_skipped((yield))


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report():
    """Turn the skip of a whole file into a failure."""
    return _fail_if_skipped((yield))
