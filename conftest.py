"""What holds for all tests: a skipped test is a failure in CI, where nothing may be missing.

But for tests marked `stated_requirement`: docs/explanation/design.md lists the programs that they
need, and npm needs a network.
"""

import os

import pytest

# The test processes share the cores. Threads of small matrix products, each of which waits for
# the others, would make them many times slower on a loaded machine. Set before NumPy is imported.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')


def _fail_if_skipped(report):
    allowed = hasattr(report, 'wasxfail') or 'stated_requirement' in getattr(
        report, 'keywords', ()
    )
    if report.skipped and not allowed and os.environ.get('CI'):
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
